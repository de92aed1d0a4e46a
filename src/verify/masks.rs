//! Recorded links: what arrived, and how old it was, drawn again from the header and the seed.

use std::path::Path;

use super::{Comparison, Deviations};
use crate::base::error::Result;
use crate::bus::NOT_ARRIVED;
use crate::environment::{Spec, Task};
use crate::link::{Address, Context, Fates, LinkSpec, Links};
use crate::recording::{Episode, Presence, Reader, RecordingHeader};
use crate::supervisor::Arrivals;

/// The links of a trace, and how far they are from what was recorded.
pub(super) struct Masks {
    header: RecordingHeader,
    spec: Spec,
    /// That of all draws, and whether everything is delivered at t = 0; `None` if the links are not known. They are not
    /// where a recording does not name them in full: those of other programs, and chains with a communication matrix.
    drawn: Option<(u64, bool)>,
    found: Deviations,
}

impl Masks {
    /// Those of a trace.
    pub(super) fn of(trace: &Reader) -> Result<Masks> {
        let header = trace.header.clone();
        let spec = Task::parse(&header.task)?.spec().clone();
        let drawn = header.seed.zip(header.comm_at_t0);
        Ok(Masks { header, spec, drawn, found: Deviations::default() })
    }

    /// Compares an episode, the so-manieth of the file.
    pub(super) fn compare(&mut self, at: usize, episode: &Episode) -> Result<()> {
        let Masks { header, spec, drawn, found } = self;
        let Some((seed, share_at_start)) = *drawn else { return Ok(()) };
        let (Some(number), Some(links)) = (episode.episode, links(header, episode, spec)) else {
            *drawn = None;
            return Ok(());
        };
        let mut links = links.sharing_at_start(share_at_start);
        compare_episode(at, episode, (seed, number), &mut links, spec, found)
    }

    /// What was compared: which observations arrived, and their ages.
    pub(super) fn compared(&self, file: &Path) -> Option<Comparison> {
        self.drawn.map(|_| self.found.largest(file, "links: what arrived, and when", 0.0))
    }
}

/// The links of an episode, if the recording has what they were made of.
fn links(header: &RecordingHeader, episode: &Episode, spec: &Spec) -> Option<Links> {
    let links = match (header.links.as_deref()?, &header.matrix) {
        ("level", _) => LinkSpec::level(episode.p?),
        ("matrix", Some(rows)) => LinkSpec::fixed(rows, spec.n_agents()),
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
        let is_absent = |agent: &usize| episode.presence(step, *agent) == Presence::Absent;
        for absent in (0..agents).filter(is_absent) {
            (0..agents).for_each(|other| fates.cut(absent, other));
            arrivals.forget_receiver(absent);
        }
        let deviations = found.at(at, step);
        arrivals.send(&fates, |receiver, ages| {
            // Who did not decide does not say what had arrived, and who was lost in this step may have sent or not.
            if !episode.presence(step, receiver).decided() {
                return;
            }
            let senders = (0..agents).filter(|sender| *sender != receiver && !is_absent(sender));
            for sender in senders {
                let differs = match episode.age(step, receiver, sender) {
                    None if episode.is_late(step, receiver, sender) => ages[sender] == NOT_ARRIVED,
                    recorded => ages[sender] != recorded.unwrap_or(NOT_ARRIVED),
                };
                deviations.add(u8::from(differs), 0);
            }
        })?;
    }
    Ok(())
}
