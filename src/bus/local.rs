//! The in-process twin of the bus: the same ports, without processes or shared memory.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::Arc;

use super::{AgentPort, Header, Sample};
use crate::base::error::Result;

/// A message in this process; its receivers share it.
#[derive(Clone, Debug)]
pub struct LocalSample(Arc<(Header, Vec<u32>)>);

impl LocalSample {
    /// A message of `header.length` words that `write` fills.
    pub fn new(header: Header, write: impl FnOnce(&mut [u32])) -> LocalSample {
        let mut words = vec![0; header.length as usize];
        write(&mut words);
        LocalSample(Arc::new((header, words)))
    }
}

impl Sample for LocalSample {
    fn header(&self) -> &Header {
        &self.0.0
    }

    fn words(&self) -> &[u32] {
        &self.0.1
    }
}

/// The supervisor's side: puts sensor messages in, takes decisions out.
#[derive(Clone, Debug)]
pub struct LocalHub(Rc<RefCell<Queues>>);

#[derive(Debug)]
struct Queues {
    /// Per agent: what the supervisor sent it.
    sensors: Vec<VecDeque<LocalSample>>,
    /// Per agent: what its peers published.
    observations: Vec<VecDeque<LocalSample>>,
    decisions: VecDeque<LocalSample>,
    /// The newest ones. Kept, so that the next ones can be written in their place.
    weights: Option<LocalSample>,
}

impl LocalHub {
    /// A hub for a team of `agents`.
    pub fn new(agents: usize) -> LocalHub {
        let queues = || (0..agents).map(|_| VecDeque::new()).collect();
        let (sensors, observations, decisions) = (queues(), queues(), VecDeque::new());
        let queues = Queues { sensors, observations, decisions, weights: None };
        LocalHub(Rc::new(RefCell::new(queues)))
    }

    /// The port of one agent.
    pub fn port(&self, agent: usize) -> LocalPort {
        LocalPort { queues: self.0.clone(), agent, weights: 0 }
    }

    /// Sends a message to one agent.
    pub fn send_sensor(&self, agent: usize, message: LocalSample) {
        self.0.borrow_mut().sensors[agent].push_back(message);
    }

    /// Sends new weights to all agents.
    pub fn publish_weights(&self, header: Header, write: impl FnOnce(&mut [u32])) {
        let newest = &mut self.0.borrow_mut().weights;
        match newest.as_mut().and_then(|sample| Arc::get_mut(&mut sample.0)) {
            Some((old, words)) if words.len() as u64 == header.length => {
                *old = header;
                write(words);
            }
            _ => *newest = Some(LocalSample::new(header, write)),
        }
    }

    /// The next decision.
    pub fn receive_decision(&self) -> Option<LocalSample> {
        self.0.borrow_mut().decisions.pop_front()
    }
}

/// An agent's side.
#[derive(Debug)]
pub struct LocalPort {
    queues: Rc<RefCell<Queues>>,
    agent: usize,
    /// Which weights it received last.
    weights: u64,
}

impl AgentPort for LocalPort {
    type Sample = LocalSample;

    fn receive_sensor(&mut self) -> Result<Option<LocalSample>> {
        Ok(self.queues.borrow_mut().sensors[self.agent].pop_front())
    }

    fn receive_observation(&mut self) -> Result<Option<LocalSample>> {
        Ok(self.queues.borrow_mut().observations[self.agent].pop_front())
    }

    fn receive_weights(&mut self) -> Result<Option<LocalSample>> {
        let queues = self.queues.borrow();
        let newer = queues.weights.as_ref().filter(|sample| sample.header().weights > self.weights);
        self.weights = newer.map_or(self.weights, |sample| sample.header().weights);
        Ok(newer.cloned())
    }

    fn publish_observation(&mut self, header: Header, write: impl FnOnce(&mut [u32])) -> Result<()> {
        let message = LocalSample::new(header, write);
        for (agent, queue) in self.queues.borrow_mut().observations.iter_mut().enumerate() {
            if agent != self.agent {
                queue.push_back(message.clone());
            }
        }
        Ok(())
    }

    fn publish_decision(&mut self, header: Header, write: impl FnOnce(&mut [u32])) -> Result<()> {
        self.queues.borrow_mut().decisions.push_back(LocalSample::new(header, write));
        Ok(())
    }
}
