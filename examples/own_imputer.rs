//! An imputer of one's own: what is not received fades away.
//!
//!     cargo run --example own_imputer
//!
//! The agents are processes of this very program: each runs `main` as far as `run_if_agent`, which knows the imputer too.

use vamaro_swarm::agent::Inbox;
use vamaro_swarm::agent::imputer::{Carried, Imputer, Registry, Setup, Step};
use vamaro_swarm::base::error::Result;
use vamaro_swarm::{Swarm, run_if_agent};

/// Like `hold`, but with each step a value counts for less.
#[derive(Debug)]
struct Fade(Carried);

impl Imputer for Fade {
    fn begin_episodes(&mut self, _worlds: usize) {
        self.0.forget();
    }

    fn fuse(&mut self, world: usize, own: &[f32], inbox: &Inbox, estimate: &mut [f32]) {
        self.0.fuse(world, own, inbox, estimate);
    }

    fn predict(&mut self, step: &Step) {
        for (carried, estimate) in self.0.follow(step.estimates) {
            carried.iter_mut().zip(estimate).for_each(|(value, now)| *value = 0.9 * now);
        }
    }
}

fn main() -> Result<()> {
    let fade = |setup: &Setup| Ok(Box::new(Fade(Carried::new(setup))) as Box<dyn Imputer>);
    let registry = Registry::default().with_imputer("fade", "what was received last, fading", fade);
    run_if_agent(&registry);

    for imputer in ["fade", "hold", "zero"] {
        let builder = Swarm::builder().environment("spread-xy-4").links("level(0.2)").worlds(10);
        let mut swarm = builder.imputer(imputer).registry(&registry).build()?;
        println!("{imputer}: return {:.1}", swarm.play(100)?.return_mean());
    }
    Ok(())
}
