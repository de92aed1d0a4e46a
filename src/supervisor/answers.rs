//! What agents answer. An agent that answers with what no answer can be is lost, as one that does not answer.

use super::{Decisions, Loss, Processes, Tick};
use crate::base::error::Result;
use crate::base::scheduling::Granted;
use crate::bus::{Header, Kind, PROTOCOL, Sample, SharedSample};
use crate::failed;

/// The message that is due.
#[derive(Clone, Copy, Debug)]
pub(super) struct Due {
    pub(super) kind: Kind,
    pub(super) tick: u64,
    pub(super) words: usize,
}

impl Due {
    /// What is wrong with a message, other than that it is late: of an agent whose messages have this `swarm`, `sender` and
    /// `incarnation`.
    pub(super) fn fault_of(&self, sample: &SharedSample, expected: &Header) -> Option<String> {
        let (header, words) = (sample.header(), sample.words().len());
        if header.protocol != PROTOCOL {
            return Some(format!(
                "speaks version {} of the protocol, and this program version {PROTOCOL}",
                header.protocol
            ));
        }
        if header.sender != expected.sender {
            return Some(format!("speaks for agent-{}", header.sender));
        }
        if header.swarm != expected.swarm {
            return Some(format!("speaks of another swarm, {:08x}", header.swarm));
        }
        if header.incarnation != expected.incarnation {
            return Some(format!(
                "says that it was started {} times before, not {}",
                header.incarnation, expected.incarnation
            ));
        }
        if header.tick != self.tick {
            let ahead = header.tick > self.tick;
            return ahead.then(|| format!("is at tick {} when tick {} is played", header.tick, self.tick));
        }
        let fits = header.fits(self.kind, expected.swarm, self.words) && words == self.words;
        (!fits).then(|| {
            format!(
                "sent {words} words as a message of kind {} with {}, when one of kind {} with {} is due",
                header.kind, header.length, self.kind as u32, self.words
            )
        })
    }
}

impl Processes {
    /// Takes note of the agents that are ready.
    pub(super) fn take_ready(&mut self) -> Result<()> {
        while let Some(sample) = self.port.receive_decision()? {
            if let Some(agent) = self.note_ready(&sample)? {
                self.answered |= 1 << agent;
            }
        }
        Ok(())
    }

    /// Takes note that an agent is ready, if the message says so; which one.
    fn note_ready(&mut self, sample: &SharedSample) -> Result<Option<usize>> {
        if sample.header().kind != Kind::Ready as u32 {
            return Ok(None);
        }
        let agent = self.take(sample, Due { kind: Kind::Ready, tick: 0, words: 1 })?;
        if let Some(agent) = agent {
            self.granted[agent] = Granted::from_bits(sample.words()[0]);
            self.roster.ready(agent);
        }
        Ok(agent)
    }

    /// Takes note of who has published its observation.
    pub(super) fn take_observations(&mut self, tick: &Tick, decisions: &mut Decisions) -> Result<()> {
        let words = self.layout.observation_words(tick.worlds);
        let due = Due { kind: Kind::Observation, tick: tick.tick, words };
        while let Some(sample) = self.port.receive_observation()? {
            let Some(agent) = self.take(&sample, due)? else { continue };
            self.answered |= 1 << agent;
            decisions.times[agent].published_ns = sample.header().sent_ns;
            let fault = match &self.chronicle {
                Some(chronicle) => {
                    chronicle.fault_of(&self.layout.told(sample.words(), tick.worlds, agent), agent, tick)
                }
                None => {
                    let own = &tick.observations[agent * words..][..words];
                    let is_own = sample.words() == bytemuck::cast_slice::<f32, u32>(own);
                    (!is_own).then(|| "something other than its sensor gave it".to_owned())
                }
            };
            if let Some(fault) = fault {
                return Err(failed!(
                    "agent-{agent} published {fault}, at tick {}; nothing played from there on can be trusted",
                    tick.tick
                ));
            }
        }
        Ok(())
    }

    /// Takes the decisions that are in, but for those sent after the end, nanoseconds of the monotonic clock.
    pub(super) fn take_decisions(
        &mut self,
        tick: &Tick,
        decisions: &mut Decisions,
        ends_ns: u64,
    ) -> Result<()> {
        let due =
            Due { kind: Kind::Decision, tick: tick.tick, words: self.layout.decision_words(tick.worlds) };
        while let Some(sample) = self.port.receive_decision()? {
            self.note_ready(&sample)?;
            if sample.header().kind == Kind::Ready as u32 || sample.header().sent_ns > ends_ns {
                continue;
            }
            let Some(agent) = self.take(&sample, due)? else { continue };
            let decision = self.layout.decision(sample.words(), tick.worlds);
            match Decisions::fault_of(&self.spec, agent, &decision) {
                None => {
                    self.answered |= 1 << agent;
                    decisions.times[agent].decided_ns = sample.header().sent_ns;
                    decisions.take(agent, &decision);
                }
                Some(fault) => self.lose(agent, Loss::Hung(fault))?,
            }
        }
        Ok(())
    }

    /// Whose message it is, if it is what is due of that agent. What is late, or of a process that is gone, is left aside.
    ///
    /// # Errors
    /// `Failed` if an agent has published an observation in the name of another: its peers may have taken it for one.
    fn take(&mut self, sample: &SharedSample, due: Due) -> Result<Option<usize>> {
        let (header, agent) = (sample.header(), sample.header().sender as usize);
        let speaker = self.speakers.of(sample, &self.agents);
        let expected = header.fits(due.kind, self.identity.swarm, due.words)
            && sample.words().len() == due.words
            && header.tick == due.tick
            && agent < self.agents.len()
            && header.incarnation == self.roster.incarnation(agent)
            && speaker.is_none_or(|speaker| speaker == agent);
        if expected {
            return Ok(Some(agent));
        }
        if let Some(speaker) = speaker.filter(|speaker| *speaker != agent)
            && due.kind == Kind::Observation
        {
            return Err(failed!(
                "agent-{speaker} published an observation in the name of agent-{agent}, at tick {}; nothing that was \
                 played from there on can be trusted",
                due.tick
            ));
        }
        if let Some(speaker) = speaker
            && let Some(fault) = due.fault_of(sample, &self.expected_of(speaker))
        {
            self.lose(speaker, Loss::Hung(fault))?;
        }
        Ok(None)
    }

    /// What all messages of an agent have in common.
    fn expected_of(&self, agent: usize) -> Header {
        Header { sender: agent as u32, incarnation: self.roster.incarnation(agent), ..self.identity }
    }
}
