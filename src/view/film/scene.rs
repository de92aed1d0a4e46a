//! A moment of an episode, drawn with whatever pen: the still twin of what `page.js` draws.

use glam::DVec2;

use super::{Film, Take};
use crate::base::colours;
use crate::recording::Arrived;

/// The side of the picture of one world, and what the words below it take.
const SIDE: f64 = 360.0;
const BELOW: f64 = 48.0;
/// Between two worlds side by side, and around all.
const GAP: f64 = 12.0;

/// Steps of which a trail tells.
const TRAIL: usize = 10;

/// What draws. x grows to the right and y downwards.
pub(super) trait Pen {
    /// A filled circle.
    fn disc(&mut self, centre: DVec2, radius: f64, ink: Ink);

    /// A circle.
    fn ring(&mut self, centre: DVec2, radius: f64, stroke: Stroke);

    /// A line through these points.
    fn line(&mut self, points: &[DVec2], stroke: Stroke);

    /// A line of text whose baseline begins at a point, or has its middle there.
    fn text(&mut self, at: DVec2, size: f64, anchor: Anchor, ink: Ink, text: &str);
}

/// How a line looks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stroke {
    pub ink: Ink,
    pub width: f64,
    /// How much of what is behind it it hides.
    pub alpha: f64,
    /// The length of a dash and of the gap behind it; zeros for a solid line.
    pub dash: [f64; 2],
}

/// Which end of a text is at its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
}

/// What a colour stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ink {
    Paper,
    Stage,
    Grid,
    Soft,
    Text,
    Agent(usize),
    Arrives,
    Late,
    Lost,
}

impl Ink {
    /// All of them, those of agents once each.
    pub(super) const ALL: [Ink; 15] = [
        Ink::Paper,
        Ink::Stage,
        Ink::Grid,
        Ink::Soft,
        Ink::Text,
        Ink::Arrives,
        Ink::Late,
        Ink::Lost,
        Ink::Agent(0),
        Ink::Agent(1),
        Ink::Agent(2),
        Ink::Agent(3),
        Ink::Agent(4),
        Ink::Agent(5),
        Ink::Agent(6),
    ];

    /// Its colour on light and on dark paper, as in `page.css` and `page.js`.
    pub(super) fn colours(self) -> [u32; 2] {
        match self {
            Ink::Paper => [0xff_ffff, 0x0d_1117],
            Ink::Stage => [0xfb_fcfd, 0x10_151c],
            Ink::Grid => [0xd8_dde3, 0x30_363d],
            Ink::Soft => [0x57_606a, 0x9d_a7b1],
            Ink::Text => [0x24_292f, 0xe6_edf3],
            Ink::Arrives => colours::ARRIVES,
            Ink::Late => colours::LATE,
            Ink::Lost => colours::LOST,
            Ink::Agent(agent) => colours::agent(agent),
        }
    }
}

/// A moment of the same episode in one film, or in several side by side.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moment<'a> {
    pub films: &'a [Film],
    /// Which of their takes.
    pub take: usize,
    /// Steps since the beginning, and the part of one.
    pub time: f64,
    /// The agent whose ghosts and links are shown.
    pub viewer: usize,
}

/// How places become points of a picture.
struct View {
    centre: DVec2,
    scale: f64,
    /// The middle of the picture.
    middle: DVec2,
}

impl Moment<'_> {
    /// Width and height of its picture.
    pub(super) fn size(&self) -> (f64, f64) {
        let worlds = self.films.len() as f64;
        (worlds * SIDE + (worlds + 1.0) * GAP, SIDE + BELOW + 2.0 * GAP)
    }

    /// What it is, in words.
    pub(super) fn title(&self) -> String {
        let Film { takes, .. } = &self.films[0];
        let task = &self.films[0].spec().id;
        format!("{task}, episode {}, step {:.0}", takes[self.take].number, self.time.floor())
    }

    pub(super) fn draw(&self, pen: &mut dyn Pen) {
        for (index, film) in self.films.iter().enumerate() {
            let corner = DVec2::new(GAP + index as f64 * (SIDE + GAP), GAP);
            let view = self.view(corner + SIDE / 2.0);
            self.draw_ground(pen, corner, &view, &film.takes[self.take]);
            self.draw_team(pen, &view, film);
            self.draw_words(pen, corner + DVec2::new(0.0, SIDE), film);
        }
    }

    /// A view of everything that is anywhere in the episode.
    fn view(&self, middle: DVec2) -> View {
        let takes = self.films.iter().map(|film| &film.takes[self.take]);
        let places = takes.flat_map(Take::places);
        let (low, high) = places
            .fold((DVec2::NEG_ONE, DVec2::ONE), |(low, high), place| (low.min(*place), high.max(*place)));
        let half = 0.56 * (high - low).max_element();
        View { centre: (low + high) / 2.0, scale: SIDE / 2.0 / half, middle }
    }

    fn draw_ground(&self, pen: &mut dyn Pen, corner: DVec2, view: &View, take: &Take) {
        let (left, right) = (corner.x, corner.x + SIDE);
        let frame = [(left, corner.y), (right, corner.y), (right, corner.y + SIDE), (left, corner.y + SIDE)];
        let frame = frame.map(DVec2::from);
        let half = SIDE / 2.0 / view.scale;
        let apart = grid(half);
        for lines in 0..2 {
            let (low, high) = (view.centre[lines] - half, view.centre[lines] + half);
            for at in (low / apart).ceil() as i64..=(high / apart).floor() as i64 {
                let through = view.point(DVec2::splat(at as f64 * apart))[lines];
                let mut ends = [corner, corner + SIDE];
                ends.iter_mut().for_each(|end| end[lines] = through);
                pen.line(&ends, Stroke { width: if at == 0 { 1.0 } else { 0.5 }, ..solid(Ink::Grid) });
            }
        }
        pen.line(&[&frame[..], &frame[..1]].concat(), solid(Ink::Grid));
        for (index, landmark) in take.landmarks.iter().enumerate() {
            let (at, arm) = (view.point(*landmark), 0.7 * view.size());
            for turned in [DVec2::new(arm, arm), DVec2::new(arm, -arm)] {
                pen.line(&[at - turned, at + turned], Stroke { width: 2.5, ..solid(Ink::Soft) });
            }
            if take.goal == Some(index) {
                pen.ring(at, 1.4 * view.size(), Stroke { width: 2.0, ..solid(Ink::Text) });
            }
        }
    }

    fn draw_team(&self, pen: &mut dyn Pen, view: &View, film: &Film) {
        let take = &film.takes[self.take];
        let team = film.spec().n_agents();
        let at: Vec<DVec2> = (0..team).map(|agent| view.point(take.place(agent, self.time))).collect();
        for target in 0..take.targets.first().map_or(0, Vec::len) {
            let (at, arm) = (view.point(between(&take.targets, target, self.time)), view.size());
            let corners = [DVec2::X, DVec2::Y, DVec2::NEG_X, DVec2::NEG_Y, DVec2::X].map(|to| at + arm * to);
            pen.line(&corners, Stroke { width: 2.5, ..solid(Ink::Text) });
        }
        for agent in 0..team {
            let now = self.time.floor();
            let steps = (0..=TRAIL).rev().map(|back| now - back as f64).filter(|step| *step >= 0.0);
            let trail: Vec<DVec2> =
                steps.chain([self.time]).map(|time| view.point(take.place(agent, time))).collect();
            pen.line(&trail, Stroke { width: 2.5, alpha: 0.4, ..solid(Ink::Agent(agent)) });
        }
        let step = take.steps.get(self.time as usize).or(take.steps.last());
        let there = |agent: usize| step.is_none_or(|step| step.presence[agent].decided());
        if let Some(step) = step {
            for sender in
                (0..team).filter(|sender| *sender != self.viewer && there(*sender) && there(self.viewer))
            {
                pen.line(&[at[sender], at[self.viewer]], stroke_of(step.arrived[self.viewer][sender]));
            }
            for ghost in &step.ghosts[self.viewer] {
                let (place, ink) = (view.point(ghost.place), Ink::Agent(ghost.agent));
                if (place - view.middle).abs().max_element() > SIDE / 2.0 {
                    continue;
                }
                pen.line(&[at[ghost.agent], place], Stroke { dash: [1.0, 3.0], ..solid(ink) });
                pen.ring(place, view.size(), Stroke { width: 2.0, alpha: 0.85, dash: [4.0, 3.0], ink });
                view.word(pen, place, ink, ghost.agent);
            }
        }
        for (agent, place) in at.iter().enumerate() {
            let (ink, size) = (Ink::Agent(agent), view.size());
            pen.disc(*place, size, if there(agent) { ink } else { Ink::Stage });
            if !there(agent) {
                pen.ring(*place, size, Stroke { width: 2.0, dash: [3.0, 3.0], ..solid(ink) });
            }
            view.word(pen, *place, if there(agent) { Ink::Paper } else { ink }, agent);
            if agent == self.viewer && step.is_some() {
                pen.ring(*place, size + 4.0, Stroke { width: 2.0, ..solid(Ink::Text) });
            }
        }
    }

    fn draw_words(&self, pen: &mut dyn Pen, corner: DVec2, film: &Film) {
        let take = &film.takes[self.take];
        let step = (self.time as usize).min(take.steps_taken());
        let below = |line: f64| corner + DVec2::new(2.0, 4.0 + 18.0 * line);
        let conditions = film.conditions(take);
        let words = if conditions.is_empty() { &film.name } else { &conditions };
        pen.text(below(1.0), 14.0, Anchor::Start, Ink::Text, words);
        let told = format!("step {step} of {}, return {:.1}", take.steps_taken(), take.returns[step]);
        pen.text(below(2.0), 12.0, Anchor::Start, Ink::Soft, &told);
    }
}

impl View {
    fn point(&self, place: DVec2) -> DVec2 {
        self.middle + (place - self.centre) * self.scale * DVec2::new(1.0, -1.0)
    }

    /// The radius of an agent.
    fn size(&self) -> f64 {
        (0.06 * self.scale).max(7.0)
    }

    /// The number of an agent, in its middle.
    fn word(&self, pen: &mut dyn Pen, at: DVec2, ink: Ink, agent: usize) {
        let size = self.size().max(10.0);
        pen.text(at + DVec2::new(0.0, 0.35 * size), size, Anchor::Middle, ink, &agent.to_string());
    }
}

impl Take {
    /// Where an agent is at a time between two steps.
    fn place(&self, agent: usize, time: f64) -> DVec2 {
        between(&self.positions, agent, time)
    }
}

/// Where one of those whose places these are, `[T + 1][..]`, is at a time between two steps.
fn between(places: &[Vec<DVec2>], one: usize, time: f64) -> DVec2 {
    let last = places.len() - 1;
    let step = (time as usize).min(last);
    let part = time.min(last as f64) - step as f64;
    places[step][one].lerp(places[(step + 1).min(last)][one], part)
}

/// How far apart the lines of a grid are that reaches so far from its middle, m: half a metre, or as many as keep them few.
fn grid(half: f64) -> f64 {
    let mut apart = 0.5;
    while half / apart > 12.0 {
        apart *= 2.0;
    }
    apart
}

fn solid(ink: Ink) -> Stroke {
    Stroke { ink, width: 1.0, alpha: 1.0, dash: [0.0; 2] }
}

fn stroke_of(arrived: Arrived) -> Stroke {
    match arrived {
        Arrived::After(0) => Stroke { width: 2.2, alpha: 0.85, ..solid(Ink::Arrives) },
        Arrived::After(_) => Stroke { width: 2.2, alpha: 0.85, dash: [9.0, 4.0], ..solid(Ink::Arrives) },
        Arrived::Late => Stroke { width: 2.0, alpha: 0.9, dash: [6.0, 5.0], ..solid(Ink::Late) },
        Arrived::Lost => Stroke { width: 1.5, alpha: 0.6, dash: [2.0, 6.0], ..solid(Ink::Lost) },
    }
}
