//! What the messages hold. Those of Foxglove have the names and fields that its JSON schemas give them.

use serde::Serialize;

/// A time, or how long something lasts.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Time {
    pub sec: u64,
    pub nsec: u64,
}

impl Time {
    pub(super) const ZERO: Time = Time { sec: 0, nsec: 0 };

    pub(super) fn of(nanoseconds: u64) -> Time {
        const SECOND: u64 = 1_000_000_000;
        Time { sec: nanoseconds / SECOND, nsec: nanoseconds % SECOND }
    }
}

/// Always left empty, but a part of the schema.
pub(super) type Nothing = [u8; 0];

/// `foxglove.SceneUpdate`.
#[derive(Debug, Serialize)]
pub(super) struct SceneUpdate {
    pub deletions: Nothing,
    pub entities: Vec<Entity>,
}

/// What replaces the entity of the same name.
#[derive(Debug, Serialize)]
pub(super) struct Entity {
    pub timestamp: Time,
    pub frame_id: &'static str,
    pub id: &'static str,
    pub lifetime: Time,
    pub frame_locked: bool,
    pub metadata: Nothing,
    pub arrows: Nothing,
    pub cubes: Vec<Solid>,
    pub spheres: Vec<Solid>,
    pub cylinders: Nothing,
    pub lines: Vec<Line>,
    pub triangles: Nothing,
    pub texts: Vec<Text>,
    pub models: Nothing,
}

/// A sphere, or a cube.
#[derive(Debug, Serialize)]
pub(super) struct Solid {
    pub pose: Pose,
    pub size: Vector,
    pub color: Colour,
}

/// Lines between pairs of points.
#[derive(Debug, Serialize)]
pub(super) struct Line {
    #[serde(rename = "type")]
    pub kind: u8,
    pub pose: Pose,
    pub thickness: f32,
    pub scale_invariant: bool,
    pub points: Vec<Vector>,
    pub color: Colour,
    pub colors: Vec<Colour>,
    pub indices: Nothing,
}

/// A word that faces whoever looks.
#[derive(Debug, Serialize)]
pub(super) struct Text {
    pub pose: Pose,
    pub billboard: bool,
    pub font_size: f32,
    pub scale_invariant: bool,
    pub color: Colour,
    pub text: String,
}

/// `foxglove.FrameTransform`: where an agent is.
#[derive(Debug)]
pub(super) struct FrameTransform<'a> {
    pub timestamp: Time,
    pub parent_frame_id: &'static str,
    pub child_frame_id: &'a str,
    pub translation: Vector,
}

#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(super) struct Pose {
    pub position: Vector,
    pub orientation: Quaternion,
}

#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(super) struct Vector {
    pub x: f32,
    pub y: f32,
    pub z: f32,
}

#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Quaternion {
    x: f32,
    y: f32,
    z: f32,
    w: f32,
}

impl Default for Quaternion {
    /// As things stand.
    fn default() -> Quaternion {
        Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }
    }
}

#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Colour {
    pub r: f32,
    pub g: f32,
    pub b: f32,
    pub a: f32,
}

/// `vamaro_swarm.Links`: what reached whom at a step.
#[derive(Debug, Serialize)]
pub(super) struct Links<'a> {
    pub episode: u64,
    pub step: usize,
    pub receivers: Vec<Receiver<'a>>,
}

/// What reached an agent.
#[derive(Debug, Serialize)]
pub(super) struct Receiver<'a> {
    pub agent: &'a str,
    /// By sender: how old it is, 254 if it was late, 255 if there is nothing.
    pub arrived: Vec<u8>,
}

/// `vamaro_swarm.Estimates`: what the agents thought at a step.
#[derive(Debug, Serialize)]
pub(super) struct Estimates<'a> {
    pub episode: u64,
    pub step: usize,
    pub agents: Vec<Estimate<'a>>,
}

/// What an agent thought.
#[derive(Debug, Serialize)]
pub(super) struct Estimate<'a> {
    pub agent: &'a str,
    /// The input of its policy; empty if it did not decide.
    pub joint: &'a [f32],
}

/// `vamaro_swarm.Metrics`: how the team does.
#[derive(Debug, Serialize)]
pub(super) struct Metrics<'a> {
    pub episode: u64,
    pub step: usize,
    /// What the team has earned so far in this episode.
    #[serde(rename = "return")]
    pub earned: f64,
    /// Of it with the last step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reward: Option<f64>,
    /// The share of observations that are there of those that agents could have of others.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub delivery: Option<f64>,
    /// That of the team.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<f64>,
    pub agents: Vec<AgentMetrics<'a>>,
}

/// How an agent does.
#[derive(Debug, Serialize)]
pub(super) struct AgentMetrics<'a> {
    pub agent: &'a str,
    /// Whether it decided, as in traces.
    pub presence: u8,
    /// Root mean squared error of what it imputed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<f64>,
}
