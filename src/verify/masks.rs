//! Recorded links: what arrived, and how old it was, drawn again from the header and the seed.

use std::path::Path;

use super::{Comparison, Deviations};
use crate::base::error::Result;
use crate::base::rng::MAX_AGENTS;
use crate::bus::{Layout, NOT_ARRIVED};
use crate::environment::{Spec, Task};
use crate::failed;
use crate::link::{Address, Context, Fates, LinkSpec, Links, RadioLog};
use crate::recording::{Episode, Presence, Reader, RecordingHeader};
use crate::supervisor::{Arrivals, Relays};

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
    ///
    /// # Errors
    /// `Failed` if its links replay a log that is not what it was.
    pub(super) fn of(trace: &Reader) -> Result<Masks> {
        let header = trace.header.clone();
        let spec = Task::parse(&header.task)?.spec().clone();
        check_logs(&header, &spec)?;
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
        let links = links.sharing_at_start(share_at_start);
        let address = Address { seed, position: 0, episode: number, step: 0 };
        Replay::new(header, spec, links).compare(at, episode, address, found)
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
        // It delivers everything, but for what is recorded as late.
        ("network", _) => Ok(LinkSpec::network()),
        ("matrix", Some(rows)) => LinkSpec::fixed(rows, spec.n_agents()),
        (text, _) => LinkSpec::parse(text, spec),
    };
    links.ok().map(|links| links.build())
}

/// An error if a log of a radio is not the one that the trace was made with: then nothing can be said of the trace.
fn check_logs(header: &RecordingHeader, spec: &Spec) -> Result<()> {
    let (Some(text), false) = (&header.links, header.logs.is_empty()) else { return Ok(()) };
    let links = LinkSpec::parse(text, spec)
        .map_err(|e| failed!("the links of the trace cannot be drawn again: {e}"))?;
    let found: Vec<String> = links.logs().map(RadioLog::fingerprint).collect();
    if found == header.logs {
        return Ok(());
    }
    Err(failed!(
        "the log of a radio in `{text}` has changed since the trace was recorded: its fingerprint was {}, and is {}; put \
         the log back as it was to verify what arrived",
        header.logs.join(", "),
        found.join(", ")
    ))
}

/// The links of an episode, and what is under way.
struct Replay {
    links: Links,
    fates: Fates,
    arrivals: Arrivals,
    /// What agents hold, if they relay.
    relays: Option<Relays>,
    /// Whether nobody waited for anybody, so that one path may have been late, and another not.
    by_the_clock: bool,
    bytes: usize,
}

impl Replay {
    fn new(header: &RecordingHeader, spec: &Spec, links: Links) -> Replay {
        let (agents, longest_delay) = (spec.n_agents(), links.longest_delay());
        Replay {
            fates: Fates::new(agents),
            arrivals: Arrivals::new(agents, longest_delay),
            relays: header.relay.then(|| Relays::new(agents, longest_delay)),
            by_the_clock: header.rate.is_some(),
            bytes: Layout::radio_bytes(agents, spec.padded_obs_dim(), header.relay),
            links,
        }
    }

    fn compare(
        mut self,
        at: usize,
        episode: &Episode,
        address: Address,
        found: &mut Deviations,
    ) -> Result<()> {
        let agents = self.fates.agents();
        self.links.begin(0, address.episode);
        for step in 0..episode.delivered.len() {
            let address = address.at_step(step as u64);
            let positions =
                episode.agent_pos.get(step).map(Vec::as_slice).filter(|places| !places.is_empty());
            let context = Context { address, world: 0, bytes: self.bytes, positions };
            self.links.deliveries(&context, &mut self.fates)?;
            let is_absent = |agent: &usize| episode.presence(step, *agent) == Presence::Absent;
            for absent in (0..agents).filter(is_absent) {
                (0..agents).for_each(|other| self.fates.cut(absent, other));
                self.arrivals.forget_receiver(absent);
                self.relays.iter_mut().for_each(|relays| relays.forget(absent));
            }
            self.relays.iter_mut().for_each(Relays::tell);
            self.compare_step(episode, step, found.at(at, step))?;
        }
        Ok(())
    }

    /// Compares what arrives at a step, once it is known who is there.
    fn compare_step(&mut self, episode: &Episode, step: usize, deviations: &mut Deviations) -> Result<()> {
        let agents = self.fates.agents();
        let is_absent = |agent: usize| episode.presence(step, agent) == Presence::Absent;
        let was_absent =
            |agent| step.checked_sub(1).is_some_and(|step| episode.presence(step, agent) == Presence::Absent);
        // Who was lost in this step may have sent or not.
        let somebody_was_lost = (0..agents).any(|agent| is_absent(agent) && !was_absent(agent));
        let (relays, by_the_clock) = (&mut self.relays, self.by_the_clock);
        let mut arriving = [NOT_ARRIVED; MAX_AGENTS];
        self.arrivals.send(&self.fates, |receiver, messages| {
            let ages = &mut arriving[..agents];
            ages.copy_from_slice(messages);
            if let Some(relays) = relays {
                relays.receive(receiver, messages, ages);
            }
            // Who did not decide does not say what had arrived.
            if !episode.presence(step, receiver).decided() {
                return;
            }
            for sender in (0..agents).filter(|sender| *sender != receiver && !is_absent(*sender)) {
                let recorded = episode.age(step, receiver, sender);
                let age = recorded.unwrap_or(NOT_ARRIVED);
                let differs = match relays {
                    Some(relays) if by_the_clock => recorded.is_some() && age < relays.held(receiver)[sender],
                    Some(_) if somebody_was_lost => ages[sender] == messages[sender] && age > ages[sender],
                    None if recorded.is_none() && episode.is_late(step, receiver, sender) => {
                        ages[sender] == NOT_ARRIVED
                    }
                    _ => ages[sender] != age,
                };
                deviations.add(u8::from(differs), 0);
            }
            if let Some(relays) = relays.as_mut().filter(|_| somebody_was_lost) {
                let used = |sender| episode.age(step, receiver, sender).unwrap_or(NOT_ARRIVED);
                (0..agents).for_each(|sender| arriving[sender] = used(sender));
                relays.settle(receiver, &arriving[..agents]);
            }
        })
    }
}
