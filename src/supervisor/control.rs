//! Control: what somebody else wants of a session while it plays, carried out between ticks.

use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, Sender, bounded};

use super::{Event, Order, Stage, signals};
use crate::base::error::Result;
use crate::usage;

/// What can be asked of a session that plays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Stand still before the next tick.
    Pause,
    /// Play one tick, then stand still.
    Step,
    /// Play on.
    Resume,
    /// Play so many ticks a second at most; `None` for as many as it can. No tick is waited for longer than an hour.
    Pace(Option<f64>),
    /// Have links deliver with this probability from the next tick on: the first level in the chain of links. Without
    /// one nothing changes.
    Level(f64),
    /// Do this to an agent.
    Order(Order),
    /// End the play.
    End,
}

/// What was changed by hand: a run that was steered does not follow from its seed.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Steered {
    /// The probability of delivery that was set last.
    pub level: Option<f64>,
    /// How often it was set.
    pub levels: u64,
    /// Agents that were killed.
    pub kills: u64,
    /// Agents that were stopped.
    pub stops: u64,
    /// Whether the play was ended.
    pub ended: bool,
}

/// The session's end of what steers it. It plays on, as fast as it can, once nobody holds the other end.
#[derive(Debug)]
pub struct Control {
    commands: Receiver<Command>,
    stands: bool,
    /// Ticks to play although it stands.
    steps: u32,
    /// The shortest time from a tick to the next.
    period: Duration,
    /// When the next tick may begin.
    next: Instant,
    steered: Steered,
}

/// How long a signal may go unnoticed while a session stands still.
const LONGEST_WAIT: Duration = Duration::from_millis(50);

/// The longest time from a tick to the next.
const LONGEST_PERIOD: Duration = Duration::from_secs(3600);

impl Control {
    /// Both ends.
    pub fn new() -> (Sender<Command>, Control) {
        // More than a hand can press while a tick is played.
        let (sender, commands) = bounded(64);
        let (period, next) = (Duration::ZERO, Instant::now());
        (sender, Control { commands, stands: false, steps: 0, period, next, steered: Steered::default() })
    }

    /// What was changed so far.
    pub fn steered(&self) -> &Steered {
        &self.steered
    }

    /// Waits until the next tick is to be played, and adds what is to happen to agents before it. False if there is to be
    /// none.
    ///
    /// # Errors
    /// `Usage` if a command cannot be carried out; `Interrupted` if the program was asked to stop.
    pub(super) fn await_tick(&mut self, stage: &mut Stage, orders: &mut Vec<Order>) -> Result<bool> {
        loop {
            while let Ok(command) = self.commands.try_recv() {
                self.take(command, stage, orders)?;
            }
            if self.steered.ended {
                return Ok(false);
            }
            let now = Instant::now();
            let wait = match self.steps {
                0 if self.stands => LONGEST_WAIT,
                0 => self.next.saturating_duration_since(now),
                _ => Duration::ZERO,
            };
            if wait.is_zero() {
                self.steps = self.steps.saturating_sub(1);
                self.next = (self.next + self.period).max(now);
                return Ok(true);
            }
            signals::check_stop()?;
            match self.commands.recv_timeout(wait.min(LONGEST_WAIT)) {
                Ok(command) => self.take(command, stage, orders)?,
                Err(error) if error.is_disconnected() => (self.stands, self.next) = (false, now),
                Err(_) => {}
            }
        }
    }

    fn take(&mut self, command: Command, stage: &mut Stage, orders: &mut Vec<Order>) -> Result<()> {
        match command {
            Command::Pause => self.stands = true,
            Command::Step => (self.stands, self.steps) = (true, self.steps + 1),
            Command::Resume => (self.stands, self.steps, self.next) = (false, 0, Instant::now()),
            Command::Pace(rate) => {
                self.period = rate.map_or(Ok(Duration::ZERO), period)?;
                self.next = Instant::now();
            }
            Command::Level(p) => {
                if !(0.0..=1.0).contains(&p) {
                    return Err(usage!("a probability of delivery is 0 to 1, not {p}"));
                }
                if let Some(dial) = stage.dial() {
                    *dial = p;
                    self.steered.level = Some(p);
                    self.steered.levels += 1;
                }
            }
            Command::Order(order) => {
                let agents = stage.spec().n_agents();
                if order.agent >= agents {
                    return Err(usage!("there are agents 0 to {}, not {}", agents - 1, order.agent));
                }
                orders.push(order);
                match order.event {
                    Event::Kill => self.steered.kills += 1,
                    Event::Stop => self.steered.stops += 1,
                    Event::Return => {}
                }
            }
            Command::End => self.steered.ended = true,
        }
        Ok(())
    }
}

/// The time from a tick to the next at so many ticks a second.
fn period(rate: f64) -> Result<Duration> {
    if rate.is_nan() || rate <= 0.0 {
        return Err(usage!("a pace is more than 0 ticks a second, not {rate}; stand still with `Pause`"));
    }
    Ok(Duration::try_from_secs_f64(1.0 / rate).unwrap_or(LONGEST_PERIOD).min(LONGEST_PERIOD))
}

impl Steered {
    /// Whether what was played is no longer what the seed says.
    pub fn any(&self) -> bool {
        self.levels + self.kills + self.stops > 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::{AgentSettings, PolicySource};
    use crate::base::error::Error;
    use crate::environment::Task;
    use crate::link::{LinkSpec, Links};
    use crate::supervisor::{Decisions, InProcess, Ledger, Observer, Session, Statistics};

    /// Calls this with the number of the tick that was played, and who was absent.
    struct Then<F>(F);

    impl<F: FnMut(u64, u64)> Observer for Then<F> {
        fn ticked(&mut self, stage: &Stage, decisions: &Decisions, _: Duration) -> Result<()> {
            (self.0)(stage.tick().tick, decisions.absent);
            Ok(())
        }
    }

    /// Plays two episodes under a control that begins with these commands, and is given more after ticks.
    fn play(
        links: Links,
        first: &[Command],
        then: impl FnMut(u64, u64, &mut Option<Sender<Command>>),
    ) -> (Statistics, Steered) {
        try_to_play(links, first, then).unwrap()
    }

    fn try_to_play(
        links: Links,
        first: &[Command],
        mut then: impl FnMut(u64, u64, &mut Option<Sender<Command>>),
    ) -> Result<(Statistics, Steered)> {
        let task = Task::parse("hear-see").unwrap();
        let policy = PolicySource::Builtin.load(task.spec()).unwrap();
        let longest_delay = links.longest_delay();
        let settings = AgentSettings { longest_delay, ..AgentSettings::of(task.spec()) };
        let mut team = InProcess::new(&settings, &policy).unwrap();
        let (commands, control) = Control::new();
        first.iter().for_each(|command| commands.send(*command).unwrap());
        let mut session = Session::new(task.environment(1), links, 0).steered_by(control);
        let (mut ledger, mut commands) = (Ledger::default(), Some(commands));
        let mut then = Then(|tick, absent| then(tick, absent, &mut commands));
        session.play(&mut team, 2, &mut [&mut ledger, &mut then])?;
        Ok((ledger.into_statistics(), session.steered().unwrap().clone()))
    }

    fn send(commands: &Option<Sender<Command>>, command: Command) {
        commands.as_ref().unwrap().send(command).unwrap();
    }

    #[test]
    fn p_is_another_from_the_next_tick_on() {
        let (statistics, steered) = play(Links::level(0.0), &[], |tick, _, commands| {
            if tick == 25 {
                send(commands, Command::Level(1.0));
            }
        });
        let delivered: Vec<u64> = statistics.episodes().iter().map(|episode| episode.delivered).collect();
        assert_eq!(delivered, [0, 48]);
        assert_eq!((steered.level, steered.levels, steered.any()), (Some(1.0), 1, true));
    }

    #[test]
    fn the_first_level_of_a_chain_is_the_one_that_is_set() {
        let links = |words| LinkSpec::parse(words, 2).unwrap().build();
        let all = [Command::Level(1.0)];
        let (statistics, steered) = play(links("delay(1) + level(0)"), &all, |_, _, _| {});
        assert!(statistics.delayed_rate().unwrap() > 0.9 && steered.any());
        let (statistics, steered) = play(links("asymmetric"), &all, |_, _, _| {});
        assert!(statistics.delivery_rate().unwrap() < 0.999);
        assert_eq!(steered, Steered::default(), "where there is none nothing changes");
    }

    #[test]
    fn who_stands_still_plays_step_by_step_and_ends_when_told() {
        let (statistics, steered) = play(Links::level(1.0), &[Command::Step; 3], |tick, _, commands| {
            if tick == 3 {
                send(commands, Command::End);
            }
        });
        assert_eq!((statistics.ticks(), steered.ended, steered.any()), (3, true, false));
    }

    #[test]
    fn nobody_stands_still_for_a_hand_that_is_gone() {
        let first = [Command::Pace(Some(1e-3)), Command::Step];
        let (statistics, steered) = play(Links::level(1.0), &first, |_, _, commands| drop(commands.take()));
        assert_eq!((statistics.ticks(), steered), (50, Steered::default()));
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let nobody = Order { agent: 2, event: Event::Kill };
        let levels = [f64::NAN, 2.0, -0.1].map(Command::Level);
        let paces = [f64::NAN, 0.0, -0.0, -1.0].map(|rate| Command::Pace(Some(rate)));
        for command in levels.into_iter().chain(paces).chain([Command::Order(nobody)]) {
            let refused = try_to_play(Links::level(1.0), &[command], |_, _, _| {});
            assert!(matches!(refused, Err(Error::Usage(_))), "{command:?}: {refused:?}");
        }
        assert_eq!([1e-19, f64::MIN_POSITIVE / 2.0].map(|rate| period(rate).unwrap()), [LONGEST_PERIOD; 2]);
        assert_eq!(period(f64::INFINITY).unwrap(), Duration::ZERO);
    }

    #[test]
    fn agents_are_taken_down_and_return_between_ticks() {
        let mut seen = Vec::new();
        let order = |agent, event| Command::Order(Order { agent, event });
        let (statistics, steered) = play(Links::level(1.0), &[], |tick, absent, commands| {
            seen.push(absent);
            match tick {
                3 => send(commands, order(1, Event::Kill)),
                5 => send(commands, order(1, Event::Return)),
                6 => send(commands, order(0, Event::Stop)),
                7 => send(commands, order(0, Event::Return)),
                _ => {}
            }
        });
        assert_eq!(seen[..9], [0, 0, 0, 0b10, 0b10, 0, 0b01, 0, 0]);
        assert_eq!((statistics.absent(), steered.kills, steered.stops), (3, 1, 1));
    }
}
