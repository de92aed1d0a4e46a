//! A lost observation never reaches imputer or policy: with every lost payload replaced by NaN, nothing
//! changes by a bit.

use vamaro_swarm::agent::{AgentSettings, PolicySource};
use vamaro_swarm::base::error::Result;
use vamaro_swarm::bus::{AgentPort, Header, Kind, Layout, LocalPort, LocalSample, Sample};
use vamaro_swarm::environment::Task;
use vamaro_swarm::link::Links;
use vamaro_swarm::supervisor::{Decisions, InProcess, Stage, Team};

/// Steps of an episode of every built-in task.
const EPISODE_STEPS: usize = 25;

/// A port that replaces what the links lose by NaN before the agent receives it.
struct Poisoned {
    port: LocalPort,
    layout: Layout,
    /// How old what arrives at this tick is, `[worlds, agents]`.
    ages: Vec<u8>,
}

impl AgentPort for Poisoned {
    type Sample = LocalSample;

    fn receive_sensor(&mut self) -> Result<Option<LocalSample>> {
        let sample = self.port.receive_sensor()?;
        if let Some(sample) = &sample {
            let worlds = sample.header().worlds as usize;
            let sensor = self.layout.sensor(sample.words(), worlds);
            self.ages = sensor.ages.to_vec();
        }
        Ok(sample)
    }

    fn receive_observation(&mut self) -> Result<Option<LocalSample>> {
        let Some(sample) = self.port.receive_observation()? else { return Ok(None) };
        let header = *sample.header();
        assert_eq!(header.kind, Kind::Observation as u32);
        Ok(Some(LocalSample::new(header, |words| {
            words.copy_from_slice(sample.words());
            for (world, words) in words.chunks_exact_mut(self.layout.observation).enumerate() {
                if self.ages[world * self.layout.agents + header.sender as usize] != 0 {
                    words.fill(f32::NAN.to_bits());
                }
            }
        })))
    }

    fn receive_weights(&mut self) -> Result<Option<LocalSample>> {
        self.port.receive_weights()
    }

    fn publish_observation(&mut self, header: Header, write: impl FnOnce(&mut [u32])) -> Result<()> {
        self.port.publish_observation(header, write)
    }

    fn publish_decision(&mut self, header: Header, write: impl FnOnce(&mut [u32])) -> Result<()> {
        self.port.publish_decision(header, write)
    }
}

/// Everything a team decided in two batches of episodes.
fn play(
    team: &mut impl Team,
    task: &Task,
    p: f64,
    share_at_start: bool,
) -> Vec<(Vec<u32>, Vec<u32>, Vec<u32>)> {
    let mut stage = Stage::new(task.environment(3), Links::level(p).sharing_at_start(share_at_start), 5);
    let (mut decisions, mut all) = (Decisions::default(), Vec::new());
    while stage.next_episode() < 6 {
        stage.begin_episodes(6).unwrap();
        for _ in 0..EPISODE_STEPS {
            stage.sense().unwrap();
            stage.draw_links().unwrap();
            team.tick(&stage.tick(), &mut decisions).unwrap();
            stage.step_worlds(&decisions).unwrap();
            let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect();
            all.push((decisions.actions.clone(), bits(&decisions.estimates), bits(&decisions.logits)));
        }
    }
    all
}

#[test]
fn nothing_of_a_lost_observation_gets_through() {
    let imputers = ["zero".to_owned(), "hold".to_owned(), "velocity".to_owned(), "value-aware".to_owned()];
    for (name, share_at_start) in [("hear-see", true), ("spread-xy-4", false)] {
        let task = Task::parse(name).unwrap();
        for imputer in imputers.clone() {
            let settings = AgentSettings {
                imputer,
                worlds: 3,
                policy: PolicySource::Builtin,
                tell_logits: true,
                ..AgentSettings::of(task.spec())
            };
            let (layout, policy) = (settings.layout(), settings.policy.load(task.spec()).unwrap());
            for p in [0.0, 0.3, 0.8] {
                let mut plain = InProcess::new(&settings, &policy).unwrap();
                let poison = |port| Poisoned { port, layout, ages: Vec::new() };
                let mut poisoned = InProcess::with_ports(&settings, &policy, poison).unwrap();
                let expected = play(&mut plain, &task, p, share_at_start);
                assert!(play(&mut poisoned, &task, p, share_at_start) == expected, "{name}, p = {p}");
                let finite = |bits: &u32| f32::from_bits(*bits).is_finite();
                assert!(
                    expected.iter().all(|(_, estimates, logits)| estimates.iter().chain(logits).all(finite))
                );
            }
        }
    }
}
