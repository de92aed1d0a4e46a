//! The desk: what whoever looks has chosen, and what keys do to it.

use super::facts::Facts;
use super::keys::Key;
use super::scene::Scene;
use crate::supervisor::{Command, Event, Order};

/// What is chosen.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Desk {
    agents: usize,
    /// See [`Facts`].
    pace: Option<f64>,
    recorded: bool,
    guest: bool,
    /// The agent whose estimate is shown, and whom keys concern.
    pub(super) chosen: usize,
    /// Whether the swarm stands still; in real time, whether the picture does.
    pub(super) stands: bool,
    /// Which of the [`SPEEDS`].
    speed: usize,
    /// The probability of delivery, where it can be set.
    pub(super) level: Option<f64>,
    /// The agents that were killed or stopped by hand, bit by bit.
    down: u64,
    /// What the last key came to, where nothing else shows it.
    pub(super) notice: String,
}

/// Multiples of the world's own time; the last is as fast as it goes.
const SPEEDS: [f64; 10] = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, f64::INFINITY];

/// A key changes p by one of so many steps from 0 to 1.
const STEPS: f64 = 20.0;

/// What a key means.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Meaning {
    /// A command to the swarm.
    Told(Command),
    /// Only the picture changes.
    Seen,
    /// Draw everything anew.
    Anew,
    /// As Ctrl-C does.
    Interrupt,
    /// Nothing.
    Nothing,
}

impl Desk {
    /// Nothing is changed yet, and the swarm plays as fast as its world.
    pub(super) fn new(facts: &Facts) -> Desk {
        let Facts { agents, pace, level, recorded, guest, .. } = *facts;
        let pace = pace.filter(|_| !guest);
        let speed = SPEEDS.iter().position(|speed| *speed == 1.0).expect("one of them is 1");
        let (chosen, stands, down, notice) = (0, false, 0, String::new());
        Desk { agents, pace, recorded, guest, chosen, stands, speed, level, down, notice }
    }

    /// How fast the swarm is to begin.
    pub(super) fn first_command(&self) -> Option<Command> {
        self.is_paced().then(|| Command::Pace(self.rate()))
    }

    /// Takes in what a guest sees others change.
    pub(super) fn note(&mut self, scene: &Scene) {
        if self.guest {
            self.level = self.level.and(scene.level);
        }
    }

    /// What a key does.
    pub(super) fn press(&mut self, key: Key) -> Meaning {
        self.notice.clear();
        match key {
            Key::Char('q') => Meaning::Told(Command::End),
            Key::Ctrl('c') => Meaning::Interrupt,
            Key::Ctrl('l') => Meaning::Anew,
            Key::Char('\t' | 'n') | Key::Right => self.choose(1),
            Key::BackTab | Key::Char('N') | Key::Left => self.choose(self.agents - 1),
            Key::Char(' ') => self.stand(!self.stands),
            Key::Char('.' | '+' | '=' | '-' | '_' | 'm' | ']' | '[' | 'k' | 'x') | Key::Up | Key::Down
                if self.guest =>
            {
                self.refuse("top only watches; whoever runs `spawn --view` can steer")
            }
            Key::Char('.') => self.step(),
            Key::Char('+' | '=') => self.run(|speed| (speed + 1).min(SPEEDS.len() - 1)),
            Key::Char('-' | '_') => self.run(|speed| speed.saturating_sub(1)),
            Key::Char('m') => self.run(|_| SPEEDS.len() - 1),
            Key::Char(']') | Key::Up => self.turn(1.0),
            Key::Char('[') | Key::Down => self.turn(-1.0),
            Key::Char('k') => self.order(Event::Kill),
            Key::Char('x') => self.order(Event::Stop),
            _ => Meaning::Nothing,
        }
    }

    fn choose(&mut self, by: usize) -> Meaning {
        self.chosen = (self.chosen + by) % self.agents;
        Meaning::Seen
    }

    fn stand(&mut self, stands: bool) -> Meaning {
        self.stands = stands;
        match self.pace {
            // A clock waits for nobody.
            None => Meaning::Seen,
            Some(_) if stands => Meaning::Told(Command::Pause),
            Some(_) => Meaning::Told(Command::Resume),
        }
    }

    fn step(&mut self) -> Meaning {
        if !self.is_paced() {
            return self.refuse("no stepping: a clock waits for nobody");
        }
        self.stands = true;
        Meaning::Told(Command::Step)
    }

    fn run(&mut self, speed: impl Fn(usize) -> usize) -> Meaning {
        if !self.is_paced() {
            return self.refuse("the speed is set by --rate");
        }
        self.speed = speed(self.speed);
        Meaning::Told(Command::Pace(self.rate()))
    }

    fn turn(&mut self, by: f64) -> Meaning {
        let Some(level) = self.level else {
            return self.refuse("these links have no level to set");
        };
        if self.recorded {
            return self.refuse("p cannot change in a recorded run");
        }
        // To the next on the grid, from wherever it was.
        let at = level * STEPS;
        let next = if by > 0.0 { (at + 1e-9).floor() } else { (at - 1e-9).ceil() } + by;
        let level = (next / STEPS).clamp(0.0, 1.0);
        self.level = Some(level);
        Meaning::Told(Command::Level(level))
    }

    fn order(&mut self, event: Event) -> Meaning {
        let (agent, bit) = (self.chosen, 1 << self.chosen);
        let is_down = self.down & bit != 0;
        let event = if is_down { Event::Return } else { event };
        // Who is killed in real time returns by itself.
        let returns = event == Event::Kill && !self.is_paced();
        self.down = if is_down || returns { self.down & !bit } else { self.down | bit };
        let (done, undo) = match event {
            Event::Kill if returns => ("killed", ", and restarts"),
            Event::Kill => ("killed", "; k restarts it"),
            Event::Stop => ("stopped", "; x lets it continue"),
            Event::Return => ("told to return", ""),
        };
        self.notice = format!("agent {agent} is {done}{undo}");
        Meaning::Told(Command::Order(Order { agent, event }))
    }

    fn refuse(&mut self, why: &str) -> Meaning {
        self.notice = why.to_owned();
        Meaning::Seen
    }

    /// Ticks a second; `None` for as many as there can be.
    fn rate(&self) -> Option<f64> {
        let rate = self.pace? * SPEEDS[self.speed];
        rate.is_finite().then_some(rate)
    }

    /// Whether the swarm can be paused and paced.
    pub(super) fn is_paced(&self) -> bool {
        self.pace.is_some()
    }

    /// Whether whoever looks can change nothing.
    pub(super) fn is_guest(&self) -> bool {
        self.guest
    }

    /// How fast it is to be, in words.
    pub(super) fn speed_words(&self) -> String {
        match (self.pace, SPEEDS[self.speed]) {
            (None, _) if self.stands => "picture held".to_owned(),
            (None, _) if self.guest => "watching".to_owned(),
            (None, _) => "real time".to_owned(),
            (Some(_), _) if self.stands => "paused".to_owned(),
            (Some(_), speed) if speed.is_infinite() => "full speed".to_owned(),
            (Some(_), speed) => format!("speed x{speed}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::Task;

    fn desk(pace: Option<f64>, level: Option<f64>, recorded: bool) -> Desk {
        let task = Task::parse("spread-blindfold").unwrap();
        Desk::new(&Facts { pace, level, recorded, ..Facts::of(task.spec()) })
    }

    fn press(desk: &mut Desk, keys: &str) -> Vec<Meaning> {
        keys.chars().map(|key| desk.press(Key::Char(key))).collect()
    }

    #[test]
    fn p_moves_along_a_grid_and_ends_at_0_and_1() {
        use Command::Level;
        use Meaning::Told;
        let mut desk = desk(Some(10.0), Some(0.92), false);
        assert_eq!(press(&mut desk, "]"), [Told(Level(0.95))]);
        assert_eq!(press(&mut desk, "]]"), [Told(Level(1.0)); 2]);
        assert_eq!(press(&mut desk, "["), [Told(Level(0.95))]);
        desk.level = Some(0.22);
        assert_eq!(press(&mut desk, "[["), [Told(Level(0.2)), Told(Level(0.15))]);
        assert_eq!(press(&mut desk, "[[[["), [0.1, 0.05, 0.0, 0.0].map(|p| Told(Level(p))));
    }

    #[test]
    fn pace_is_a_multiple_of_the_worlds_own_time() {
        let pace = |rate| Meaning::Told(Command::Pace(rate));
        let mut desk = desk(Some(10.0), None, false);
        assert_eq!(desk.first_command(), Some(Command::Pace(Some(10.0))));
        assert_eq!(press(&mut desk, "+m+"), [pace(Some(20.0)), pace(None), pace(None)]);
        assert_eq!(press(&mut desk, "-"), [pace(Some(500.0))]);
        assert_eq!(
            press(&mut desk, "---------"),
            [200.0, 100.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 1.0].map(|rate| pace(Some(rate)))
        );
        assert_eq!(desk.speed_words(), "speed x0.1");
    }

    #[test]
    fn a_step_pauses_and_a_blank_plays_on() {
        let told = Meaning::Told;
        let mut desk = desk(Some(10.0), None, false);
        let meant = press(&mut desk, ". . ");
        assert_eq!(meant, [Command::Step, Command::Resume, Command::Step, Command::Resume].map(told));
        assert_eq!(press(&mut desk, " "), [told(Command::Pause)]);
        assert_eq!(desk.speed_words(), "paused");
    }

    #[test]
    fn a_clock_is_neither_paused_nor_paced() {
        let mut desk = desk(None, None, false);
        assert_eq!(desk.first_command(), None);
        assert_eq!(press(&mut desk, " .+m"), [Meaning::Seen; 4]);
        assert!(desk.stands && desk.notice.contains("--rate"), "{desk:?}");
        assert_eq!(press(&mut desk, "k k").len(), 3);
        assert_eq!(desk.down, 0, "who is killed returns by itself");
    }

    #[test]
    fn a_guest_chooses_agents_holds_the_picture_and_changes_nothing() {
        let task = Task::parse("spread-blindfold").unwrap();
        let facts = Facts { guest: true, level: Some(0.5), ..Facts::of(task.spec()) };
        let mut desk = Desk::new(&facts);
        assert_eq!((desk.first_command(), desk.speed_words().as_str()), (None, "watching"));
        for key in ".+=-_m][kx".chars().map(Key::Char).chain([Key::Up, Key::Down]) {
            assert_eq!(desk.press(key), Meaning::Seen, "{key:?}");
            assert!(desk.notice.contains("only watches"), "{desk:?}");
        }
        assert_eq!((desk.level, desk.down, desk.stands), (Some(0.5), 0, false));
        assert_eq!(press(&mut desk, "\t "), [Meaning::Seen; 2]);
        assert_eq!((desk.chosen, desk.speed_words().as_str()), (1, "picture held"));
        assert_eq!(press(&mut desk, "q"), [Meaning::Told(Command::End)]);
    }

    #[test]
    fn agents_are_chosen_in_turn_and_return_by_the_key_that_took_them_down() {
        let order = |agent, event| Meaning::Told(Command::Order(Order { agent, event }));
        let mut desk = desk(Some(10.0), None, false);
        assert_eq!(press(&mut desk, "\t\tk"), [Meaning::Seen, Meaning::Seen, order(2, Event::Kill)]);
        assert_eq!(press(&mut desk, "\tx\n"), [Meaning::Seen, order(0, Event::Stop), Meaning::Nothing]);
        assert_eq!(
            press(&mut desk, "xNk"),
            [order(0, Event::Return), Meaning::Seen, order(2, Event::Return)]
        );
    }

    #[test]
    fn what_cannot_be_done_is_said() {
        let mut fixed = desk(Some(10.0), None, false);
        assert_eq!(press(&mut fixed, "]"), [Meaning::Seen]);
        assert!(fixed.notice.contains("no level"), "{fixed:?}");
        let mut recorded = desk(Some(10.0), Some(0.5), true);
        assert_eq!(press(&mut recorded, "]["), [Meaning::Seen; 2]);
        assert!(recorded.notice.contains("recorded"), "{recorded:?}");
        press(&mut recorded, "n");
        assert_eq!(recorded.notice, "", "a notice goes with the next key");
        let killed = Command::Order(Order { agent: 1, event: Event::Kill });
        assert_eq!(press(&mut recorded, "k"), [Meaning::Told(killed)], "a trace says who was absent");
    }
}
