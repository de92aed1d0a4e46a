//! An environment of one's own: two agents on a line see where they are, and are paid for meeting.
//!
//!     cargo run --example own_environment

use vamaro_swarm::agent::{PolicySource, Registry};
use vamaro_swarm::base::error::Result;
use vamaro_swarm::base::rng::{Draws, Purpose};
use vamaro_swarm::environment as env;
use vamaro_swarm::{Swarm, run_if_agent};

#[derive(Default)]
struct Line([f64; 2]);

impl env::World for Line {
    fn reset(&mut self, seed: u64, episode: u64) -> Result<()> {
        let mut draws = Draws::new(seed, Purpose::Reset, episode, 0);
        self.0 = [(); 2].map(|()| draws.between(-1.0, 1.0));
        Ok(())
    }

    fn observe(&self, agent: usize, out: &mut [f32]) {
        out[0] = self.0[agent] as f32;
    }

    fn step(&mut self, actions: env::Actions, rewards: &mut [f64]) -> Result<env::End> {
        for (agent, place) in self.0.iter_mut().enumerate() {
            *place += 0.1 * (f64::from(actions.choice(agent)) - 1.0);
        }
        let apart = (self.0[0] - self.0[1]).abs();
        rewards.fill(-apart);
        Ok(if apart < 0.05 { env::End::Terminated } else { env::End::Open })
    }

    fn set_state(&mut self, state: &env::State, _last_actions: Option<env::Actions>) -> Result<()> {
        self.0 = [0, 1].map(|agent| state.positions[agent].x);
        Ok(())
    }
}

fn spec() -> env::Spec {
    let place = |agent| env::Value::place(env::About::Agent(agent), env::Axis::X);
    let agent = |agent| env::AgentSpec {
        name: format!("walker {agent}"),
        observation: vec![place(agent)],
        actions: env::ActionSpace::Discrete(3),
    };
    env::Spec::of("line", vec![agent(0), agent(1)])
}

fn main() -> Result<()> {
    run_if_agent(&Registry::default());

    let worlds = env::Worlds::new(spec(), 10, |_| Line::default());
    let builder = Swarm::builder().environment(worlds).policy(PolicySource::Untrained(1)).links("level(0.5)");
    let mut swarm = builder.build()?;
    println!("return {:.2}", swarm.play(100)?.return_mean());
    Ok(())
}
