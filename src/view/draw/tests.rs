//! What is drawn, on a terminal in memory.

use glam::{DVec2, dvec2};
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::style::Color;

use super::*;
use crate::environment::Task;
use crate::environment::places::Ghost;
use crate::view::keys::Key;
use crate::view::scene::{AgedGhost, Fate, Totals};

fn facts(task: &str) -> Facts {
    let facts = Facts::of(Task::parse(task).unwrap().spec());
    Facts { episodes: 100, imputer: "hold".to_owned(), level: Some(0.2), ..facts }
}

/// Everybody in a row, of whom agent 0 hears agent 1, agent 2 late, and nobody else.
fn scene(agents: usize) -> Scene {
    let mut fates = vec![Fate::Lost; agents * agents];
    (fates[0], fates[1], fates[2]) = (Fate::None, Fate::Delivered, Fate::Delayed(1));
    let positions: Vec<DVec2> = (0..agents).map(|agent| dvec2(agent as f64 * 0.25 - 0.5, 0.0)).collect();
    let ghost = Ghost { agent: 2, place: dvec2(0.0, 0.75), observers: [2, 2], imputed: true };
    let mut ghosts = vec![vec![]; agents];
    ghosts[0].extend((agents > 2).then_some(AgedGhost { ghost, age: 3 }));
    Scene {
        episode: 11,
        step: 6,
        trail: positions.iter().map(|place| *place - DVec2::Y * 0.5).collect(),
        landmarks: vec![dvec2(-0.5, -0.9), dvec2(0.5, 0.9)],
        targets: vec![dvec2(0.5, -0.9)],
        goal: Some(1),
        parts: vec![Part::Decided; agents],
        fates,
        ghosts,
        errors: vec![Some(0.25); agents],
        episode_return: -31.25,
        returns: vec![-50.0, -30.0, -40.0],
        totals: Totals {
            finished: 11,
            return_mean: -40.0,
            return_ci95: Some(2.5),
            delivery_rate: Some(0.2),
            imputation_rmse: Some(0.1963),
            due: 1000,
            missed: 5,
            tick_p50_us: 161.4,
            tick_p99_us: 225.0,
            ..Totals::default()
        },
        positions,
        ..Scene::default()
    }
}

struct Picture {
    facts: Facts,
    scene: Option<Scene>,
    keys: &'static [Key],
    colours: bool,
    size: (u16, u16),
}

impl Picture {
    fn of(task: &str, agents: usize) -> Picture {
        let (facts, scene) = (facts(task), Some(scene(agents)));
        Picture { facts, scene, keys: &[], colours: true, size: (80, 24) }
    }

    fn draw(&self) -> Terminal<TestBackend> {
        let (mut desk, mut doubt) = (Desk::new(&self.facts), Doubt::default());
        for key in self.keys {
            desk.press(*key);
        }
        self.scene.iter().for_each(|scene| doubt.note(scene));
        let look = Look {
            facts: &self.facts,
            desk: &desk,
            scene: self.scene.as_ref(),
            doubt: &doubt,
            rate: Some(10.0),
            theme: Theme { colours: self.colours },
            marker: Marker::Braille,
        };
        let mut terminal = Terminal::new(TestBackend::new(self.size.0, self.size.1)).unwrap();
        terminal.draw(|frame| draw(frame, &look)).unwrap();
        terminal
    }

    /// What is to be read, row by row.
    fn text(&self) -> String {
        let terminal = self.draw();
        let rows = terminal.backend().buffer().content().chunks(self.size.0.into());
        rows.map(|row| row.iter().map(|cell| cell.symbol()).collect::<String>() + "\n").collect()
    }

    #[track_caller]
    fn says(&self, all: &[&str]) {
        let text = self.text();
        for words in all {
            assert!(text.contains(words), "`{words}` is not in:\n{text}");
        }
    }
}

#[test]
fn everything_is_to_be_read_from_80_columns_on() {
    for size in [(80, 24), (100, 30), (200, 60)] {
        Picture { size, ..Picture::of("spread-xy-4", 4) }.says(&[
            "spread-xy-4  episode 12 of 100, step 7 of 25",
            "speed x1 ",
            "the world as agent 0 knows it",
            "guesses 1 of 3, off by 0.75 m",
            "(2)",
            "p = 0.2",
            "20.0 %",
            "0.1963 RMSE, hold",
            "-31.2 so far",
            "-40.0 +- 2.5 mean",
            "▁█▄",
            "hears 0123",
            " 0 0.250   ████████    -●○·",
            " 3 0.250   ████████    ···-",
            "p50 161, p99 225 us",
            "10 ticks/s",
            "0.5 %, late -",
            "space pause  . step  -+ speed  m full  tab agent  [] p  k kill  x stop  q quit",
        ]);
    }
}

#[test]
fn bodies_ghosts_landmarks_and_targets_are_where_they_are() {
    let terminal = Picture::of("spread-xy-4", 4).draw();
    let buffer = terminal.backend().buffer();
    let place = |symbol: &str| {
        let cells = (2..22).flat_map(|y| (1..45).map(move |x| (x, y)));
        cells.filter(|(x, y)| buffer[(*x, *y)].symbol() == symbol).collect::<Vec<_>>()
    };
    // The middle of the world is that of its panel, which has 44 columns and 20 rows inside.
    let ([zero], [goal], [landmark]) = (&place("0")[..], &place("◎")[..], &place("+")[..]) else {
        panic!("{:?} {:?} {:?}", place("0"), place("◎"), place("+"));
    };
    assert!((11..=12).contains(&zero.1), "{zero:?} is on the horizontal axis");
    assert!(goal.0 > 30 && goal.1 < 6 && landmark.0 < 15 && landmark.1 > 18, "{goal:?} {landmark:?}");
    let [target] = place("◆")[..] else { panic!("{:?}", place("◆")) };
    assert!(target.0 > 30 && target.1 > 18, "{target:?}");
    // Agent 2 is in the middle, and thought to be above that.
    let twos: Vec<(u16, u16)> = place("2");
    assert_eq!(twos.len(), 2, "{twos:?}");
    assert!(twos[0].0 == twos[1].0 && twos[0].1 < twos[1].1 - 5, "{twos:?}");
    assert_eq!(buffer[(twos[0].0 - 1, twos[0].1)].symbol(), "(");
}

#[test]
fn without_colours_nothing_is_coloured_and_with_them_only_the_sixteen() {
    for colours in [false, true] {
        let terminal = Picture { colours, ..Picture::of("spread-xy-4", 4) }.draw();
        let cells = terminal.backend().buffer().content().iter();
        let used: std::collections::HashSet<Color> = cells.flat_map(|cell| [cell.fg, cell.bg]).collect();
        assert!(used.iter().all(|colour| !matches!(colour, Color::Rgb(..) | Color::Indexed(_))), "{used:?}");
        assert_eq!(used.len() > 1, colours, "{used:?}");
    }
}

#[test]
fn large_teams_are_shown_as_far_as_they_fit() {
    // The chosen one is always among them.
    let mut picture = Picture { keys: &[Key::Left], ..Picture::of("spread-xy-64", 64) };
    picture.says(&["63 0.250", "0/63", "the world as agent 63 knows it"]);
    picture.size = (200, 60);
    picture.keys = &[];
    picture.says(&[" 0 0.250", "1/63"]);
    let picture = Picture { size: (130, 24), ..Picture::of("spread-blindfold-12", 12) };
    picture.says(&["hears 012345678901", "-●○·········"]);
}

#[test]
fn what_cannot_be_shown_is_said() {
    let mut picture = Picture::of("speaker-listener", 2);
    picture.says(&["no ghosts: nobody observes where agents are"]);
    picture.facts.places = false;
    picture.scene = Some(Scene { positions: vec![], trail: vec![], ..scene(2) });
    picture.says(&["this environment has no places to show", "hears 01"]);
    picture.scene = None;
    picture.says(&["waiting for the next tick", "q quit"]);
}

#[test]
fn who_is_not_there_is_marked() {
    let mut picture = Picture::of("spread-xy-4", 4);
    let scene = picture.scene.as_mut().unwrap();
    (scene.parts[0], scene.parts[1]) = (Part::Absent, Part::Missed);
    picture.says(&["it is not there", " 0 absent", " 1 missed"]);
}

#[test]
fn a_terminal_that_is_too_small_says_so_and_none_is_too_small_to_draw() {
    let small = |size| Picture { size, ..Picture::of("spread-xy-4", 4) };
    small((40, 10)).says(&["This terminal has 40 columns", "Make it"]);
    for size in [(1, 1), (2, 30), (59, 20), (60, 19)] {
        assert!(!small(size).text().contains("team"), "{size:?}");
    }
    small((60, 20)).says(&["team", " 0 0.250", "ticks", " space . -+ m tab [] k x q"]);
}

#[test]
fn keys_and_notices_are_those_of_the_mode() {
    let mut picture = Picture { keys: &[Key::Char(' ')], ..Picture::of("hear-see", 2) };
    picture.says(&["paused"]);
    picture.facts.pace = None;
    picture.says(&["picture held", "space hold  tab agent"]);
    picture.keys = &[Key::Char('.')];
    picture.says(&["no stepping: a clock waits for nobody "]);
    picture.facts.guest = true;
    picture.says(&["watching", "top only watches", "space hold  tab agent  q quit"]);
}
