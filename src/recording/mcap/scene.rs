//! Steps of an episode as scenes: what a 3D panel draws. The world lies on the plane z = 0.

use glam::DVec2;

use super::messages::{Colour, Entity, FrameTransform, Line, Pose, SceneUpdate, Solid, Text, Time, Vector};
use crate::base::colours;
use crate::environment::Spec;
use crate::recording::{Arrived, Episode, Step};

/// The frame in which everything is.
pub(super) const WORLD: &str = "world";

/// Metres.
const AGENT: f32 = 0.12;
const GHOST: f32 = 0.09;
const LANDMARK: f32 = 0.08;
const WORD: f32 = 0.1;

/// Pixels.
const LINE: f32 = 2.0;

/// Lines between pairs of points, as a `foxglove.LinePrimitive` calls them.
const PAIRS: u8 = 2;

/// What is drawn bright, what is past or thought, and what is not there.
const CLEAR: f32 = 1.0;
const FAINT: f32 = 0.4;
const DIM: f32 = 0.2;

/// The agents, the landmarks and the targets, in a state of an episode.
pub(super) fn world(spec: &Spec, episode: &Episode, state: usize, now: Time) -> SceneUpdate {
    let places = &episode.agent_pos[state];
    let agents = places.iter().enumerate();
    let words = agents.clone().map(|(agent, place)| {
        let (text, above) = (agent.to_string(), AGENT);
        word(*place, above, text)
    });
    // A landmark grey, the goal white.
    let landmark = |(index, place): (usize, &DVec2)| {
        let is_goal = episode.goal_landmark == Some(index);
        solid(*place, LANDMARK, colour(if is_goal { 0xff_ffff } else { 0x8c_959f }, CLEAR))
    };
    let mut team = Entity::of("agents", now);
    team.spheres = agents.map(|(agent, place)| solid(*place, AGENT, of_agent(agent, CLEAR))).collect();
    team.texts = words.take(spec.n_agents()).collect();
    let mut landmarks = Entity::of("landmarks", now);
    landmarks.cubes = episode.landmark_pos.iter().enumerate().map(landmark).collect();
    let mut targets = Entity::of("targets", now);
    let others = episode.target_pos.get(state).into_iter().flatten();
    targets.spheres = others.map(|place| solid(*place, AGENT, colour(0xff_ffff, CLEAR))).collect();
    SceneUpdate { deletions: [], entities: vec![team, landmarks, targets] }
}

/// Who receives whom: the half of a line that is next to an agent shows what that agent received.
pub(super) fn links(episode: &Episode, step: usize, told: &Step, now: Time) -> SceneUpdate {
    let places = &episode.agent_pos[step];
    let there = |agent: usize| told.presence[agent].decided();
    let mut lines = Lines::default();
    for (receiver, of) in told.arrived.iter().enumerate().filter(|(receiver, _)| there(*receiver)) {
        for (sender, arrived) in
            of.iter().enumerate().filter(|(sender, _)| *sender != receiver && there(*sender))
        {
            let ink = match arrived {
                Arrived::After(0) => colour(colours::ARRIVES[1], CLEAR),
                Arrived::After(_) => colour(colours::ARRIVES[1], FAINT),
                Arrived::Late => colour(colours::LATE[1], CLEAR),
                Arrived::Lost => colour(colours::LOST[1], DIM),
            };
            lines.push(places[receiver], places[receiver].midpoint(places[sender]), ink);
        }
    }
    let mut links = Entity::of("links", now);
    links.lines = lines.finish();
    SceneUpdate { deletions: [], entities: vec![links] }
}

/// Where an agent thinks the others are that it was not told of just now, and a line from there to where they are.
pub(super) fn ghosts(episode: &Episode, step: usize, told: &Step, viewer: usize, now: Time) -> SceneUpdate {
    let (mut ghosts, mut lines) = (Entity::of("ghosts", now), Lines::default());
    for ghost in told.ghosts[viewer].iter().filter(|ghost| ghost.place.is_finite()) {
        let ink = of_agent(ghost.agent, FAINT);
        ghosts.spheres.push(solid(ghost.place, GHOST, ink));
        lines.push(ghost.place, episode.agent_pos[step][ghost.agent], ink);
    }
    ghosts.lines = lines.finish();
    SceneUpdate { deletions: [], entities: vec![ghosts] }
}

/// Where the agents are, as frames.
pub(super) fn frames<'a>(
    spec: &'a Spec,
    episode: &Episode,
    state: usize,
    now: Time,
) -> Vec<FrameTransform<'a>> {
    let agents = spec.agents.iter().zip(&episode.agent_pos[state]);
    let transform = agents.map(|(agent, place)| FrameTransform {
        timestamp: now,
        parent_frame_id: WORLD,
        child_frame_id: &agent.name,
        translation: vector(*place),
    });
    transform.collect()
}

impl Entity {
    /// One that holds nothing yet, and stays until another takes its place.
    fn of(id: &'static str, timestamp: Time) -> Entity {
        Entity {
            timestamp,
            frame_id: WORLD,
            id,
            lifetime: Time::ZERO,
            frame_locked: false,
            metadata: [],
            arrows: [],
            cubes: Vec::new(),
            spheres: Vec::new(),
            cylinders: [],
            lines: Vec::new(),
            triangles: [],
            texts: Vec::new(),
            models: [],
        }
    }
}

/// Lines of several colours.
#[derive(Default)]
struct Lines {
    points: Vec<Vector>,
    colors: Vec<Colour>,
}

impl Lines {
    fn push(&mut self, from: DVec2, to: DVec2, ink: Colour) {
        self.points.extend([vector(from), vector(to)]);
        self.colors.extend([ink, ink]);
    }

    /// The primitive, if there is any line.
    fn finish(self) -> Vec<Line> {
        let Some(color) = self.colors.first().copied() else { return Vec::new() };
        vec![Line {
            kind: PAIRS,
            pose: Pose::default(),
            thickness: LINE,
            scale_invariant: true,
            points: self.points,
            color,
            colors: self.colors,
            indices: [],
        }]
    }
}

fn solid(place: DVec2, size: f32, color: Colour) -> Solid {
    Solid { pose: at(place), size: Vector { x: size, y: size, z: size }, color }
}

fn word(place: DVec2, above: f32, text: String) -> Text {
    let mut pose = at(place);
    pose.position.z = above;
    Text {
        pose,
        billboard: true,
        font_size: WORD,
        scale_invariant: false,
        color: colour(0xff_ffff, CLEAR),
        text,
    }
}

fn at(place: DVec2) -> Pose {
    Pose { position: vector(place), ..Pose::default() }
}

fn vector(place: DVec2) -> Vector {
    Vector { x: place.x as f32, y: place.y as f32, z: 0.0 }
}

fn of_agent(agent: usize, alpha: f32) -> Colour {
    colour(colours::agent(agent)[1], alpha)
}

/// Two digits are enough to see.
fn colour(rgb: u32, a: f32) -> Colour {
    let [_, r, g, b] = rgb.to_be_bytes().map(|part| (f32::from(part) / 2.55).round() / 100.0);
    Colour { r, g, b, a }
}
