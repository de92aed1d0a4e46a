//! The channels of a file, and what is written to them of an episode.

use std::collections::BTreeMap;

use mcap::McapResult;
use mcap::records::MessageHeader;
use serde::Serialize;
use serde_json::Value;

use super::messages::{AgentMetrics, Estimate, Estimates, Links, Metrics, Receiver, Time};
use super::{Out, protobuf, scene, schemas};
use crate::environment::{Spec, Task};
use crate::recording::{Arrived, Episode, Presence, Step, Steps};

/// Numbers of channels, and what it takes to write to them.
pub(super) struct Channels {
    scene: u16,
    frames: u16,
    link_lines: u16,
    /// Agent by agent.
    ghosts: Vec<u16>,
    links: u16,
    estimates: u16,
    metrics: u16,
    steps: Steps,
    /// Nanoseconds from one tick to the next.
    tick: f64,
    /// Messages so far.
    sequence: u32,
    /// Bytes of a message.
    bytes: Vec<u8>,
}

impl Channels {
    /// The channels of a trace of this task, played at `rate` if against the clock.
    pub(super) fn create(out: &mut Out, task: &Task, rate: Option<f64>) -> McapResult<Channels> {
        let frames = out.add_schema("foxglove.FrameTransforms", "protobuf", &protobuf::schema())?;
        let frames = out.add_channel(frames, "/tf", "protobuf", &BTreeMap::new())?;
        let mut channel = |topic: &str, schema: &Value| {
            let name = schema["title"].as_str().expect("schemas have a title");
            let schema = out.add_schema(name, "jsonschema", schema.to_string().as_bytes())?;
            out.add_channel(schema, topic, "json", &BTreeMap::new())
        };
        let (spec, scene) = (task.spec(), schemas::scene_update());
        let ghosts =
            spec.agents.iter().map(|agent| channel(&format!("/scene/ghosts/{}", agent.name), &scene));
        Ok(Channels {
            ghosts: ghosts.collect::<McapResult<_>>()?,
            scene: channel("/scene", &scene)?,
            link_lines: channel("/scene/links", &scene)?,
            frames,
            links: channel("/links", &schemas::links())?,
            estimates: channel("/estimates", &schemas::estimates())?,
            metrics: channel("/metrics", &schemas::metrics())?,
            steps: Steps::of(task),
            tick: 1e9 * rate.map_or(spec.dt, |rate| 1.0 / rate),
            sequence: 0,
            bytes: Vec::new(),
        })
    }

    /// The time of a tick, ns.
    pub(super) fn time(&self, tick: u64) -> u64 {
        (tick as f64 * self.tick).round() as u64
    }

    /// Writes an episode that begins at this tick.
    pub(super) fn write(&mut self, out: &mut Out, episode: &Episode, begins: u64) -> McapResult<()> {
        let number = episode.episode.unwrap_or_default();
        let mut earned = 0.0;
        for step in 0..episode.agent_pos.len() {
            let log_time = self.time(begins + step as u64);
            let (now, reward) =
                (Time::of(log_time), step.checked_sub(1).map(|last| episode.team_reward[last]));
            earned += reward.unwrap_or_default();
            // In the last state nobody decides.
            let told = (step < episode.actions.len()).then(|| self.steps.at(episode, step)).flatten();
            let Channels { steps, sequence, bytes, .. } = self;
            let spec = &steps.spec;
            let mut to = To { out: &mut *out, sequence, bytes, log_time };
            to.write(self.scene, &scene::world(spec, episode, step, now))?;
            let frames = scene::frames(spec, episode, step, now);
            to.send(self.frames, &protobuf::frame_transforms(&frames))?;
            let metrics = Metrics { reward, ..metrics(spec, number, step, earned, told.as_ref()) };
            to.write(self.metrics, &metrics)?;
            let Some(told) = told else { continue };
            to.write(self.link_lines, &scene::links(episode, step, &told, now))?;
            for (viewer, channel) in self.ghosts.iter().enumerate() {
                to.write(*channel, &scene::ghosts(episode, step, &told, viewer, now))?;
            }
            to.write(self.links, &links(spec, number, step, &told))?;
            to.write(self.estimates, &estimates(spec, number, step, &episode.joint_estimate[step]))?;
        }
        Ok(())
    }
}

/// Where messages of one moment go.
struct To<'a> {
    out: &'a mut Out,
    sequence: &'a mut u32,
    bytes: &'a mut Vec<u8>,
    log_time: u64,
}

impl To<'_> {
    fn write(&mut self, channel: u16, message: &impl Serialize) -> McapResult<()> {
        let mut bytes = std::mem::take(self.bytes);
        bytes.clear();
        serde_json::to_writer(&mut bytes, message).expect("a message is plain data");
        self.send(channel, &bytes)?;
        *self.bytes = bytes;
        Ok(())
    }

    fn send(&mut self, channel_id: u16, bytes: &[u8]) -> McapResult<()> {
        *self.sequence = self.sequence.wrapping_add(1);
        let (sequence, log_time) = (*self.sequence, self.log_time);
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        self.out.write_to_known_channel(&header, bytes)
    }
}

fn links<'a>(spec: &'a Spec, episode: u64, step: usize, told: &Step) -> Links<'a> {
    let of = |(agent, arrived): (&'a String, &Vec<Arrived>)| Receiver {
        agent,
        arrived: arrived.iter().map(|arrived| arrived.code()).collect(),
    };
    Links { episode, step, receivers: names(spec).zip(&told.arrived).map(of).collect() }
}

fn estimates<'a>(spec: &'a Spec, episode: u64, step: usize, joint: &'a [Vec<f32>]) -> Estimates<'a> {
    let agents = names(spec).zip(joint).map(|(agent, joint)| Estimate { agent, joint });
    Estimates { episode, step, agents: agents.collect() }
}

fn metrics<'a>(spec: &'a Spec, episode: u64, step: usize, earned: f64, told: Option<&Step>) -> Metrics<'a> {
    let Some(told) = told else {
        return Metrics {
            episode,
            step,
            earned,
            reward: None,
            delivery: None,
            error: None,
            agents: Vec::new(),
        };
    };
    let known: Vec<f64> = told.errors.iter().flatten().copied().collect();
    let error = (!known.is_empty())
        .then(|| (known.iter().map(|error| error * error).sum::<f64>() / known.len() as f64).sqrt());
    let (mut there, mut arrived) = (0_u32, 0_u32);
    for (receiver, of) in told.arrived.iter().enumerate().filter(|(it, _)| told.presence[*it].decided()) {
        for (sender, it) in of.iter().enumerate() {
            // Who is not there sends nothing that could arrive.
            if sender != receiver && told.presence[sender] != Presence::Absent {
                there += 1;
                arrived += u32::from(matches!(it, Arrived::After(_)));
            }
        }
    }
    let of = |(agent, (presence, error)): (&'a String, (&_, &Option<f64>))| AgentMetrics {
        agent,
        presence: u8::from(*presence),
        error: *error,
    };
    Metrics {
        episode,
        step,
        earned,
        reward: None,
        delivery: (there > 0).then(|| f64::from(arrived) / f64::from(there)),
        error,
        agents: names(spec).zip(told.presence.iter().zip(&told.errors)).map(of).collect(),
    }
}

fn names(spec: &Spec) -> impl Iterator<Item = &String> {
    spec.agents.iter().map(|agent| &agent.name)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// The messages of a made-up episode of a task, each with the name of its schema.
    pub(in crate::recording::mcap) fn messages(task: &Task) -> Vec<(String, Value)> {
        messages_without(task, None)
    }

    /// The same where an agent was absent.
    fn messages_without(task: &Task, absent: Option<usize>) -> Vec<(String, Value)> {
        let spec = task.spec();
        let (team, places) = (spec.n_agents(), vec![glam::DVec2::new(0.25, -1.5); spec.n_agents()]);
        let arrived = |step: usize| {
            let row = |i| (0..team).map(|j| u8::from(i + step != j)).collect();
            (0..team).map(row).collect()
        };
        let episode = Episode {
            landmark_pos: vec![glam::DVec2::ONE; spec.landmarks],
            agent_pos: vec![places.clone(); 3],
            agent_vel: vec![places; 3],
            actions: vec![vec![crate::recording::Action::Discrete(1); team]; 2],
            obs: vec![vec![vec![0.5; spec.padded_obs_dim()]; team]; 2],
            team_reward: vec![-1.5, -0.5],
            delivered: (0..2).map(arrived).collect(),
            presence: vec![
                (0..team)
                    .map(|agent| if Some(agent) == absent { Presence::Absent } else { Presence::Decided })
                    .collect();
                2
            ],
            joint_estimate: vec![vec![vec![0.125; spec.joint_dim()]; team]; 2],
            ..Episode::default()
        };
        let file = tempfile::tempfile().unwrap();
        let out = mcap::write::NoSeek::new(std::io::BufWriter::new(file.try_clone().unwrap()));
        let mut out = mcap::WriteOptions::new().disable_seeking(true).create(out).unwrap();
        let mut channels = Channels::create(&mut out, task, None).unwrap();
        channels.write(&mut out, &episode, 10).unwrap();
        out.finish().unwrap();
        use std::io::Seek;
        let mut file = file;
        file.rewind().unwrap();
        let read = mcap::io::MessageReader::new(file).map(|message| {
            let message = message.unwrap();
            let schema = message.channel.schema.as_ref().unwrap().name.clone();
            assert!((1_000_000_000..=1_200_000_000).contains(&message.log_time), "{}", message.log_time);
            (message.channel.message_encoding == "json")
                .then(|| (schema, serde_json::from_slice(&message.data).unwrap()))
        });
        read.flatten().collect()
    }

    #[test]
    fn who_is_not_there_is_not_expected_to_be_heard() {
        let task = Task::parse("spread-blindfold").unwrap();
        let deliveries = |absent| {
            let told = messages_without(&task, absent).into_iter();
            told.filter_map(|(_, message)| message["delivery"].as_f64()).collect::<Vec<_>>()
        };
        // At the second step agent i does not hear agent i + 1.
        assert_eq!(deliveries(None)[1], 4.0 / 6.0);
        assert_eq!(deliveries(Some(0))[1], 0.5);
    }
}
