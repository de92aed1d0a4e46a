//! `Host`: what connects an environment in Python to a supervisor.

use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use rustix::process::Signal;

use super::buffers::take;
use super::errors::raised;
use crate::agent::process::leave_with;
use crate::base::error::Result;
use crate::bus::{
    Header, Kind, Line, LineEnd, LineLayout, LineSettings, PROTOCOL, SwarmAddress, halves, join, now_ns,
};
use crate::environment::Description;
use crate::{failed, usage};

/// How long to try to open what the supervisor has created.
const OPEN_DEADLINE: Duration = Duration::from_secs(5);

/// The longest sleep before another look.
const LONGEST_SLEEP: Duration = Duration::from_millis(100);

/// The environment's end of the line to a supervisor.
#[pyclass(frozen, module = "vamaro_swarm._native")]
pub(super) struct Host(Mutex<Hosting>);

struct Hosting {
    line: Line,
    layout: LineLayout,
    worlds: usize,
    /// The request to answer.
    asked: Header,
}

/// What the supervisor asks for.
enum Request {
    /// An episode in a world, by its seed and number.
    Reset(usize, u64, u64),
    /// One step: which worlds play, and the words of all actions.
    Step(Vec<u8>, Vec<u32>),
    /// That the process ends.
    Leave,
}

#[pymethods]
impl Host {
    /// The end that a supervisor's last word on the command line tells of. From here on the process ends with its supervisor.
    #[new]
    fn new(py: Python, told: &str) -> PyResult<Host> {
        let hosting = py.detach(|| Hosting::open(told)).map_err(|error| raised(py, error))?;
        Ok(Host(Mutex::new(hosting)))
    }

    /// How many worlds the supervisor wants.
    #[getter]
    fn worlds(&self) -> PyResult<usize> {
        Ok(self.hosting()?.worlds)
    }

    /// Tells the supervisor what the environment is, as JSON.
    fn describe(&self, py: Python, description: &str) -> PyResult<()> {
        self.hosting()?.describe(description).map_err(|error| raised(py, error))
    }

    /// Waits for what the supervisor asks for. A reset is the world, the seed and the episode; a step has a byte for each world,
    /// 1 if it plays, and what all agents do, `u32 [agents, worlds, width]`. None if the process is to end.
    fn next<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let mut hosting = self.hosting()?;
        let hosting = &mut *hosting;
        let request = py.detach(|| hosting.next()).map_err(|error| raised(py, error))?;
        Ok(match request {
            Request::Leave => None,
            Request::Reset(world, seed, episode) => {
                Some((world, seed, episode).into_pyobject(py)?.into_any())
            }
            Request::Step(playing, actions) => {
                let actions = PyBytes::new(py, bytemuck::cast_slice(&actions));
                Some((PyBytes::new(py, &playing), actions).into_pyobject(py)?.into_any())
            }
        })
    }

    /// Answers the last request, of so many worlds: rewards `f64 [worlds, agents]`, 0 for each episode that goes on, 1 if it is
    /// terminated and 2 if it is truncated `u8 [worlds]`, and what agents observe, padded, `f32 [agents, worlds,
    /// observation]`.
    fn answer(
        &self,
        py: Python,
        rewards: &Bound<PyAny>,
        ends: &Bound<PyAny>,
        observations: &Bound<PyAny>,
    ) -> PyResult<()> {
        let hosting = self.hosting()?;
        let (layout, worlds) = (hosting.layout, hosting.asked.worlds as usize);
        let mut paid = vec![0.0; worlds * layout.agents];
        let mut over = vec![0; worlds];
        let mut observed = vec![0.0; layout.agents * worlds * layout.observation];
        take(rewards, &mut paid)?;
        take(ends, &mut over)?;
        take(observations, &mut observed)?;
        hosting.answer(&paid, &over, &observed).map_err(|error| raised(py, error))
    }
}

impl Host {
    fn hosting(&self) -> PyResult<MutexGuard<'_, Hosting>> {
        self.0.try_lock().map_err(|_| PyValueError::new_err("another thread is using this host"))
    }
}

impl Hosting {
    fn open(told: &str) -> Result<Hosting> {
        let told: LineSettings = serde_json::from_str(told).map_err(|e| {
            usage!(
                "an environment is started by `vamaro-swarm spawn --env COMMAND`, which adds what it has to know; \
                 this is something else: {e}"
            )
        })?;
        if told.wire.protocol != PROTOCOL {
            return Err(failed!(
                "the program that started this environment speaks version {} of the protocol, and this package \
                 {PROTOCOL}; install both from the same source",
                told.wire.protocol
            ));
        }
        leave_with(told.supervisor, Signal::KILL)?;
        let deadline = Instant::now() + OPEN_DEADLINE;
        let line = loop {
            match Line::open(&told.tag, LineEnd::Environment) {
                Err(_) if Instant::now() < deadline => std::thread::sleep(Duration::from_millis(20)),
                opened => break opened?,
            }
        };
        let swarm = SwarmAddress::of(&told.tag).id();
        Ok(Hosting {
            line,
            layout: LineLayout { agents: 0, observation: 0, action: 0 },
            worlds: told.worlds,
            asked: Header { protocol: PROTOCOL, swarm, ..Header::default() },
        })
    }

    fn describe(&mut self, description: &str) -> Result<()> {
        let described: Result<Description> =
            serde_json::from_str(description).map_err(|e| usage!("this is no description: {e}"));
        let spec = described?.spec()?;
        let (agents, observation, action) = (spec.n_agents(), spec.padded_obs_dim(), spec.action_width());
        self.layout = LineLayout { agents, observation, action };
        let words = description.len().div_ceil(size_of::<u32>());
        self.line.make_room(words.max(self.layout.outcome_words(self.worlds)))?;
        let header = Header { kind: Kind::Describe as u32, length: words as u64, ..self.asked };
        self.line.send(header, |words| {
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(words);
            bytes.fill(b' ');
            bytes[..description.len()].copy_from_slice(description.as_bytes());
        })
    }

    /// Waits without an end, but not for longer than the supervisor lives: the kernel ends this process with it.
    fn next(&mut self) -> Result<Request> {
        let Header { swarm, .. } = self.asked;
        let (layout, most) = (self.layout, self.worlds);
        loop {
            let read = |header: &Header, words: &[u32]| {
                let worlds = header.worlds as usize;
                let fits = |kind, length| header.fits(kind, swarm, length) && words.len() == length;
                let request = if fits(Kind::Shutdown, 0) {
                    Request::Leave
                } else if fits(Kind::Reset, LineLayout::RESET) && (words[0] as usize) < most && worlds == 1 {
                    Request::Reset(words[0] as usize, join([words[1], words[2]]), header.episode)
                } else if worlds <= most && fits(Kind::Step, layout.step_words(worlds)) {
                    let (playing, actions) = words.split_at(worlds);
                    Request::Step(playing.iter().map(|word| *word as u8).collect(), actions.to_vec())
                } else {
                    return Err(failed!("the supervisor sent a message that cannot be read: {header:?}"));
                };
                Ok((*header, request))
            };
            if let Some(read) = self.line.receive(read)? {
                let (asked, request) = read?;
                self.asked = asked;
                return Ok(request);
            }
            self.line.sleep(LONGEST_SLEEP)?;
        }
    }

    fn answer(&self, rewards: &[f64], ends: &[u8], observations: &[f32]) -> Result<()> {
        let length = self.layout.outcome_words(self.asked.worlds as usize) as u64;
        let header = Header { kind: Kind::Outcome as u32, length, sent_ns: now_ns(), ..self.asked };
        self.line.send(header, |words| {
            let (paid, rest) = words.split_at_mut(2 * rewards.len());
            let (over, observed) = rest.split_at_mut(ends.len());
            for (pair, reward) in paid.chunks_exact_mut(2).zip(rewards) {
                pair.copy_from_slice(&halves(reward.to_bits()));
            }
            over.iter_mut().zip(ends).for_each(|(word, end)| *word = u32::from(*end));
            observed.copy_from_slice(bytemuck::cast_slice(observations));
        })
    }
}
