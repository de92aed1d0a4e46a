//! An environment that lives in a process of its own, started by a command, in any language: `docs/protocol.md`.

use std::process::Stdio;
use std::time::{Duration, Instant};

use glam::DVec2;

use super::command::AgentCommand;
use super::deadlines::Deadlines;
use super::launch::Children;
use super::signals;
use crate::base::error::{Error, Result};
use crate::bus::{
    Header, Kind, Line, LineEnd, LineLayout, LineSettings, PROTOCOL, SwarmAddress, SwarmDirectory, Wait,
    halves, join, line_memory_needed, now_ns, wait_until, wake_supervisor_of_line,
};
use crate::environment::{Description, End, Environment, Outcome, Spec, State};
use crate::failed;

/// The most 32-bit words in a message.
const MOST_WORDS: usize = 1 << 26;

/// An environment in another process. Dropping it ends and reaps that process, with all that it has started.
#[derive(Debug)]
pub struct Hosted {
    /// What it is called in errors: its command is part of that.
    name: String,
    spec: Spec,
    /// How long a step is, s, if it says so.
    tick: Option<f64>,
    layout: LineLayout,
    worlds: usize,
    deadlines: Deadlines,
    /// What agents observe, `[agents, worlds, observation]`.
    observations: Vec<f32>,
    /// The words of the last answer.
    answered: Vec<u32>,
    /// Which line it is, and how often something was asked on it.
    identity: Header,
    process: Children,
    line: Line,
    // Declared last: all else in it goes first.
    directory: SwarmDirectory,
}

impl Hosted {
    /// Starts a command that hosts so many worlds of an environment, and waits until it has said what it is. From then on it
    /// has to answer each reset and step in time.
    ///
    /// # Errors
    /// `Lost` if it ends, or does not say what it is in time; `Failed` if there cannot be such an environment; whatever
    /// starting it fails with.
    pub fn start(command: &AgentCommand, worlds: usize, deadlines: Deadlines) -> Result<Hosted> {
        let directory = SwarmDirectory::create()?;
        let tag = directory.tag().to_owned();
        let line = Line::open(&tag, LineEnd::Supervisor)?;
        let settings = LineSettings::of(&tag, worlds);
        let identity = Header { protocol: PROTOCOL, swarm: SwarmAddress::of(&tag).id(), ..Header::default() };
        let mut process = Children::new(command.clone(), move || drop(wake_supervisor_of_line(&tag)))?;
        let name = format!("the environment ({command})");
        process.start(&name, "environment", &settings, [Stdio::null(), Stdio::null()])?;
        let mut hosted = Hosted {
            name,
            spec: Spec::of("nothing yet", Vec::new()),
            tick: None,
            layout: LineLayout { agents: 0, observation: 0, action: 0 },
            worlds,
            deadlines,
            observations: Vec::new(),
            answered: Vec::new(),
            identity,
            process,
            line,
            directory,
        };
        hosted.await_answer(Kind::Describe, None, (deadlines.ready, "say what it is"))?;
        hosted.take_description()?;
        Ok(hosted)
    }

    /// How long a step is, s, if the environment says so.
    pub fn tick(&self) -> Option<f64> {
        self.tick
    }

    fn take_description(&mut self) -> Result<()> {
        let described = serde_json::from_slice::<Description>(bytemuck::cast_slice(&self.answered));
        let described = described.map_err(|e| self.wrong(&format!("describes itself wrongly: {e}")))?;
        self.tick = described.dt;
        self.spec = described.spec().map_err(|e| self.wrong(&format!("describes itself wrongly: {e}")))?;
        let spec = &self.spec;
        let (agents, observation, action) = (spec.n_agents(), spec.padded_obs_dim(), spec.action_width());
        self.layout = LineLayout { agents, observation, action };
        let asks = self.layout.step_words(self.worlds).max(LineLayout::RESET);
        let answers = self.layout.outcome_words(self.worlds);
        if asks.max(answers) > MOST_WORDS {
            return Err(self.wrong(&format!(
                "has messages of {} words for {} worlds, more than {MOST_WORDS}; use fewer --worlds",
                asks.max(answers),
                self.worlds
            )));
        }
        self.observations.resize(agents * self.worlds * observation, 0.0);
        let needed = line_memory_needed(asks) + line_memory_needed(answers);
        self.directory.promise(needed)?.map_err(|memory| {
            failed!(
                "shared memory is too small for {}, which needs up to {} KiB: /dev/shm has {} KiB to give; see what \
                 `vamaro-swarm doctor` finds",
                self.spec.id,
                needed >> 10,
                memory.available() >> 10
            )
        })?;
        self.line.make_room(asks)?;
        self.directory.take_pages()
    }

    /// Asks for something of an episode, in these many worlds, and waits for where that leads.
    fn ask(
        &mut self,
        (kind, words): (Kind, usize),
        (episode, worlds): (u64, usize),
        write: impl FnOnce(&mut [u32]),
        what: &str,
    ) -> Result<()> {
        self.identity.tick += 1;
        let header = Header {
            kind: kind as u32,
            episode,
            worlds: worlds as u32,
            length: words as u64,
            sent_ns: now_ns(),
            ..self.identity
        };
        self.line.send(header, write)?;
        let words = self.layout.outcome_words(worlds);
        self.await_answer(Kind::Outcome, Some(words), (self.deadlines.answer, what))
    }

    /// Waits for an answer to the last question: of this kind, and so many words if that is known.
    fn await_answer(
        &mut self,
        kind: Kind,
        words: Option<usize>,
        (longest, what): (Duration, &str),
    ) -> Result<()> {
        let deadline = Instant::now() + longest;
        let sleep = |hosted: &Hosted, longest| hosted.line.sleep(longest);
        let came = wait_until(self, Wait::Block, deadline, sleep, |hosted| {
            signals::check_stop()?;
            let came = hosted.take_answer(kind, words)?;
            if !came {
                hosted.process.check_alive()?;
            }
            Ok(came)
        })?;
        if came {
            return Ok(());
        }
        let how = format!("did not {what} within {longest:?}");
        Err(Error::Lost { names: vec![self.name.clone()], how })
    }

    /// Takes the next answer, if it is there.
    fn take_answer(&mut self, kind: Kind, words: Option<usize>) -> Result<bool> {
        let Hosted { line, answered, identity, .. } = self;
        let read = |header: &Header, payload: &[u32]| {
            let length = words.unwrap_or(payload.len());
            if !header.fits(kind, identity.swarm, length) || payload.len() != length {
                return Err(*header);
            }
            answered.clear();
            answered.extend_from_slice(payload);
            // What answers another question is of no use to anybody.
            Ok(header.tick == identity.tick)
        };
        match line.receive(read)? {
            None => Ok(false),
            Some(Ok(came)) => Ok(came),
            Some(Err(Header { protocol, kind, length, .. })) => Err(self.wrong(&format!(
                "sent a message that cannot be read, of {length} words and kind {kind}, in version {protocol} of the \
                 protocol; this program speaks version {PROTOCOL}"
            ))),
        }
    }

    fn wrong(&self, how: &str) -> Error {
        failed!("{} {how}", self.name)
    }

    /// Keeps what was observed in the worlds from this one on, `[agents, worlds, observation]`.
    fn keep_observations(&mut self, first: usize, worlds: usize) {
        let Hosted { layout, answered, observations, .. } = self;
        let (here, there) = (self.worlds * layout.observation, worlds * layout.observation);
        let told = layout.outcome(answered, worlds).observations;
        for (kept, told) in observations.chunks_exact_mut(here).zip(told.chunks_exact(there)) {
            kept[first * layout.observation..][..there].copy_from_slice(told);
        }
    }
}

impl Environment for Hosted {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn worlds(&self) -> usize {
        self.worlds
    }

    fn reset(&mut self, world: usize, seed: u64, episode: u64) -> Result<()> {
        let [low, high] = halves(seed);
        let write = |words: &mut [u32]| words.copy_from_slice(&[world as u32, low, high]);
        self.ask((Kind::Reset, LineLayout::RESET), (episode, 1), write, "begin an episode")?;
        self.keep_observations(world, 1);
        Ok(())
    }

    fn observe(&mut self, worlds: usize, out: &mut [f32]) -> Result<()> {
        let (here, there) = (self.worlds * self.layout.observation, worlds * self.layout.observation);
        for (out, kept) in out.chunks_exact_mut(there).zip(self.observations.chunks_exact(here)) {
            out.copy_from_slice(&kept[..there]);
        }
        Ok(())
    }

    fn step(&mut self, actions: &[u32], playing: &[bool], outcome: &mut Outcome) -> Result<()> {
        let worlds = playing.len();
        let write = |words: &mut [u32]| {
            let (plays, acts) = words.split_at_mut(worlds);
            plays.iter_mut().zip(playing).for_each(|(word, plays)| *word = u32::from(*plays));
            acts.copy_from_slice(actions);
        };
        self.ask((Kind::Step, self.layout.step_words(worlds)), (0, worlds), write, "take a step")?;
        self.keep_observations(0, worlds);
        let agents = self.layout.agents;
        let told = self.layout.outcome(&self.answered, worlds);
        for world in (0..worlds).filter(|world| playing[*world]) {
            let rows = told.rewards[world * agents..][..agents].iter();
            let paid = rows.map(|halves| f64::from_bits(join(*halves)));
            for (agent, (kept, reward)) in outcome.rewards[world * agents..].iter_mut().zip(paid).enumerate()
            {
                if !reward.is_finite() {
                    let agent = &self.spec.agents[agent].name;
                    return Err(self.wrong(&format!("gives {agent} the reward {reward}, which is no number")));
                }
                *kept = reward;
            }
            outcome.ends[world] = match told.ends[world] {
                0 => End::Open,
                1 => End::Terminated,
                2 => End::Truncated,
                other => return Err(self.wrong(&format!("ends an episode with {other}, not 0, 1 or 2"))),
            };
        }
        Ok(())
    }

    fn state(&self, _world: usize) -> State {
        State::default()
    }

    fn set_state(&mut self, _world: usize, _state: &State, _last_actions: Option<&[u32]>) -> Result<()> {
        Err(failed!("{} lives in another process: its state can be set only there", self.spec.id))
    }

    fn positions(&self, _world: usize) -> &[DVec2] {
        &[]
    }
}

impl Drop for Hosted {
    fn drop(&mut self) {
        let header = Header { kind: Kind::Shutdown as u32, sent_ns: now_ns(), ..self.identity };
        // One that cannot be told is ended at once.
        let told = self.line.send(header, |_| {}).is_ok();
        self.process.reap(if told { self.deadlines.leave } else { Duration::ZERO });
    }
}
