//! Recorded links: what arrived, and how old it was, drawn again from the header and the seed.

use std::path::Path;

use super::{Comparison, Deviations};
use crate::base::error::Result;
use crate::bus::NOT_ARRIVED;
use crate::environment::{Spec, Task};
use crate::link::{Address, Context, Fates, LinkSpec, Links};
use crate::recording::{Episode, Recording, RecordingHeader};
use crate::supervisor::Arrivals;

/// Compares which observations arrived, and their ages. Nothing for links that the recording does not name in full: those
/// of other programs, and chains with a communication matrix.
pub(super) fn compare(file: &Path, recording: &Recording) -> Result<Option<Comparison>> {
    let header = &recording.header;
    let (Some(seed), Some(share_at_start)) = (header.seed, header.comm_at_t0) else { return Ok(None) };
    let (task, mut found) = (Task::parse(&header.task)?, Deviations::default());
    for (at, episode) in recording.episodes.iter().enumerate() {
        let (Some(number), Some(links)) = (episode.episode, links(header, episode, task.spec())) else {
            return Ok(None);
        };
        let mut links = links.sharing_at_start(share_at_start);
        compare_episode(at, episode, (seed, number), &mut links, task.spec(), &mut found)?;
    }
    Ok(Some(found.largest(file, "links: what arrived, and when", 0.0)))
}

/// The links of an episode, if the recording has what they were made of.
fn links(header: &RecordingHeader, episode: &Episode, spec: &Spec) -> Option<Links> {
    let links = match (header.links.as_deref()?, &header.matrix) {
        ("level", _) => LinkSpec::level(episode.p?),
        ("matrix", Some(rows)) => LinkSpec::fixed(rows),
        (text, _) => LinkSpec::parse(text, spec),
    };
    links.ok().map(|links| links.build())
}

fn compare_episode(
    at: usize,
    episode: &Episode,
    (seed, number): (u64, u64),
    links: &mut Links,
    spec: &Spec,
    found: &mut Deviations,
) -> Result<()> {
    let agents = spec.n_agents();
    let (mut fates, mut arrivals) = (Fates::new(agents), Arrivals::new(agents, links.longest_delay()));
    let bytes = spec.padded_obs_dim() * size_of::<f32>();
    links.begin(0, number);
    for step in 0..episode.delivered.len() {
        let address = Address { seed, position: 0, episode: number, step: step as u64 };
        let positions = episode.agent_pos.get(step).map(Vec::as_slice).filter(|places| !places.is_empty());
        links.deliveries(&Context { address, world: 0, bytes, positions }, &mut fates)?;
        let deviations = found.at(at, step);
        arrivals.send(&fates, |receiver, ages| {
            for (sender, age) in ages.iter().enumerate().filter(|(sender, _)| *sender != receiver) {
                let recorded = episode.age(step, receiver, sender).unwrap_or(NOT_ARRIVED);
                deviations.add(u8::from(*age != recorded), 0);
            }
        })?;
    }
    Ok(())
}
