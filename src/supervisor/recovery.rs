//! What a swarm does when agents die or hang: they are lost, their peers are told, and they are started anew.

use std::time::{Duration, Instant};

use rustix::process::Signal;

use super::clock::Period;
use super::processes::name_of;
use super::roster::{Presence, members_of};
use super::{Event, Loss, Order, Processes, Tick};
use crate::base::error::{Error, Result};

impl Processes {
    /// Loses the agents whose processes have ended.
    pub(super) fn lose_dead(&mut self) -> Result<()> {
        for (agent, how) in self.take_dead()? {
            self.lose(agent, Loss::Died(how))?;
        }
        Ok(())
    }

    /// Loses the agents that have not decided for longer than the deadline, against the clock.
    pub(super) fn lose_silent(&mut self, period: &Period) -> Result<()> {
        let (answer, ready) = (self.conduct.deadlines.answer, self.conduct.deadlines.ready);
        let periods = answer.as_nanos() as u64 / (period.ends_ns - period.begins_ns);
        // A period that has just been missed is no sign of anything.
        for agent in members_of(self.roster.silent(periods + 2)) {
            self.lose(agent, Loss::Hung(format!("did not decide for {answer:?}")))?;
        }
        for agent in members_of(self.roster.starting_for(ready)) {
            self.lose(agent, Loss::Hung(format!("did not get ready within {ready:?}")))?;
        }
        Ok(())
    }

    /// Loses an agent: ends its process, if there is one still, and notes what happened.
    pub(super) fn lose(&mut self, agent: usize, loss: Loss) -> Result<()> {
        self.end(agent);
        self.speakers.forget(agent);
        let given_up = self.roster.lose(agent, self.tick, &loss);
        if self.roster.aborts() || given_up {
            return Err(Error::Lost { names: vec![name_of(agent)], how: loss.to_string() });
        }
        Ok(())
    }

    /// Starts an agent anew. In lockstep it is ready afterwards, or due again.
    fn start_anew(&mut self, agent: usize) -> Result<()> {
        self.roster.start(agent);
        self.speakers.forget(agent);
        self.start_agent(agent)
    }

    /// Waits until all agents that are being started are ready, but for those that are lost again.
    fn await_started(&mut self) -> Result<()> {
        let longest = self.conduct.deadlines.ready;
        let done = self.wait(Instant::now() + longest, |swarm| {
            swarm.take_ready()?;
            swarm.lose_dead()?;
            Ok(swarm.roster.starting().next().is_none())
        })?;
        if !done {
            for agent in self.roster.starting() {
                self.lose(agent, Loss::Hung(format!("did not get ready within {longest:?}")))?;
            }
        }
        Ok(())
    }

    /// Waits until `take` has seen the answer of every agent that is there, as [`Processes::await_answers`] does. Who dies or does
    /// not answer is lost, and the others are told.
    pub(super) fn await_present(
        &mut self,
        what: &str,
        tick: &Tick,
        (began, longest): (Instant, Duration),
        mut take: impl FnMut(&mut Processes) -> Result<()>,
    ) -> Result<()> {
        let silent = self.await_answers(began + longest, |swarm| {
            let absent = swarm.roster.absent();
            take(swarm)?;
            swarm.lose_dead()?;
            if swarm.roster.absent() == absent { Ok(()) } else { swarm.send_sensors(tick, 0, true) }
        })?;
        if silent == 0 {
            return Ok(());
        }
        let how = format!("did not {what} within {longest:?}");
        let mut lost = Ok(());
        for agent in members_of(silent) {
            lost = lost.and(self.lose(agent, Loss::Hung(how.clone())));
        }
        // Where that ends the swarm, all of them are named.
        let names = members_of(silent).map(name_of).collect();
        lost.map_err(|_| Error::Lost { names, how })?;
        self.send_sensors(tick, 0, true)
    }

    /// Has agents return, and kills and stops agents, on purpose.
    pub(super) fn carry_out(&mut self, orders: &[Order]) -> Result<()> {
        let returns = |order: &&Order| order.event == Event::Return;
        orders.iter().filter(returns).for_each(|order| self.follow(*order));
        // Who returns may be stopped or killed again at once.
        self.take_back()?;
        orders.iter().filter(|order| !returns(order)).for_each(|order| self.follow(*order));
        Ok(())
    }

    fn follow(&mut self, Order { agent, event }: Order) {
        let presence = match (event, self.roster.presence(agent)) {
            (_, Presence::Lost) => Presence::Lost,
            (Event::Kill, _) => {
                self.end(agent);
                // Against the clock an absence takes as long as it takes.
                self.clock.as_ref().map_or(Presence::Away, |_| Presence::Due(Instant::now()))
            }
            (Event::Stop, Presence::There) => {
                self.signal(agent, Signal::STOP);
                Presence::Stopped
            }
            (Event::Return, Presence::Stopped) => {
                self.signal(agent, Signal::CONT);
                Presence::There
            }
            (Event::Return, Presence::Away) => Presence::Due(Instant::now()),
            // It was lost otherwise.
            (_, presence) => presence,
        };
        self.roster.set(agent, presence);
    }

    /// Starts those anew that are due, side by side. In lockstep they are there when this returns; against the clock, as
    /// soon as they are ready.
    pub(super) fn take_back(&mut self) -> Result<()> {
        self.lose_dead()?;
        // Who is lost while it starts is due again.
        while self.roster.due().next().is_some() {
            for agent in self.roster.due() {
                self.start_anew(agent)?;
            }
            if self.clock.is_none() {
                self.await_started()?;
            }
        }
        Ok(())
    }
}
