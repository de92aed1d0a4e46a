//! The JSON schemas of the messages. Each says the type of every field, without alternatives: viewers build their own
//! types of it.

use serde_json::{Map, Value, json};

fn object(title: &str, fields: &[(&str, Value)]) -> Value {
    let properties: Map<String, Value> =
        fields.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
    json!({"title": title, "type": "object", "properties": properties})
}

fn list(items: Value) -> Value {
    json!({"type": "array", "items": items})
}

fn number() -> Value {
    json!({"type": "number"})
}

fn integer() -> Value {
    json!({"type": "integer"})
}

fn text() -> Value {
    json!({"type": "string"})
}

fn flag() -> Value {
    json!({"type": "boolean"})
}

/// A time, or how long something lasts.
fn time(title: &str) -> Value {
    object(title, &[("sec", integer()), ("nsec", integer())])
}

fn vector() -> Value {
    object("foxglove.Vector3", &[("x", number()), ("y", number()), ("z", number())])
}

fn quaternion() -> Value {
    object("foxglove.Quaternion", &[("x", number()), ("y", number()), ("z", number()), ("w", number())])
}

fn pose() -> Value {
    object("foxglove.Pose", &[("position", vector()), ("orientation", quaternion())])
}

fn colour() -> Value {
    object("foxglove.Color", &[("r", number()), ("g", number()), ("b", number()), ("a", number())])
}

fn solid(title: &str) -> Value {
    object(title, &[("pose", pose()), ("size", vector()), ("color", colour())])
}

fn line() -> Value {
    object(
        "foxglove.LinePrimitive",
        &[
            ("type", integer()),
            ("pose", pose()),
            ("thickness", number()),
            ("scale_invariant", flag()),
            ("points", list(vector())),
            ("color", colour()),
            ("colors", list(colour())),
            ("indices", list(integer())),
        ],
    )
}

fn word() -> Value {
    object(
        "foxglove.TextPrimitive",
        &[
            ("pose", pose()),
            ("billboard", flag()),
            ("font_size", number()),
            ("scale_invariant", flag()),
            ("color", colour()),
            ("text", text()),
        ],
    )
}

/// Primitives that are never drawn here have no fields.
fn none(title: &str) -> Value {
    list(object(title, &[]))
}

pub(super) fn scene_update() -> Value {
    let deletion = object(
        "foxglove.SceneEntityDeletion",
        &[("timestamp", time("time")), ("type", integer()), ("id", text())],
    );
    let pair = object("foxglove.KeyValuePair", &[("key", text()), ("value", text())]);
    let entity = object(
        "foxglove.SceneEntity",
        &[
            ("timestamp", time("time")),
            ("frame_id", text()),
            ("id", text()),
            ("lifetime", time("duration")),
            ("frame_locked", flag()),
            ("metadata", list(pair)),
            ("arrows", none("foxglove.ArrowPrimitive")),
            ("cubes", list(solid("foxglove.CubePrimitive"))),
            ("spheres", list(solid("foxglove.SpherePrimitive"))),
            ("cylinders", none("foxglove.CylinderPrimitive")),
            ("lines", list(line())),
            ("triangles", none("foxglove.TriangleListPrimitive")),
            ("texts", list(word())),
            ("models", none("foxglove.ModelPrimitive")),
        ],
    );
    object("foxglove.SceneUpdate", &[("deletions", list(deletion)), ("entities", list(entity))])
}

pub(super) fn links() -> Value {
    let receiver = object("vamaro_swarm.Receiver", &[("agent", text()), ("arrived", list(integer()))]);
    of_step("vamaro_swarm.Links", &[("receivers", list(receiver))])
}

pub(super) fn estimates() -> Value {
    let estimate = object("vamaro_swarm.Estimate", &[("agent", text()), ("joint", list(number()))]);
    of_step("vamaro_swarm.Estimates", &[("agents", list(estimate))])
}

pub(super) fn metrics() -> Value {
    let agent = object(
        "vamaro_swarm.AgentMetrics",
        &[("agent", text()), ("presence", integer()), ("error", number())],
    );
    of_step(
        "vamaro_swarm.Metrics",
        &[
            ("return", number()),
            ("reward", number()),
            ("delivery", number()),
            ("error", number()),
            ("agents", list(agent)),
        ],
    )
}

fn of_step(title: &str, fields: &[(&str, Value)]) -> Value {
    object(title, &[&[("episode", integer()), ("step", integer())], fields].concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether all of a value is what a schema says, and in the schema.
    fn fits(value: &Value, schema: &Value) -> bool {
        match schema["type"].as_str().unwrap() {
            "object" => value.as_object().is_some_and(|fields| {
                fields.iter().all(|(name, field)| {
                    schema["properties"].get(name).is_some_and(|schema| fits(field, schema))
                })
            }),
            "array" => {
                value.as_array().is_some_and(|items| items.iter().all(|it| fits(it, &schema["items"])))
            }
            "number" => value.is_number(),
            "integer" => value.is_u64(),
            "string" => value.is_string(),
            "boolean" => value.is_boolean(),
            other => panic!("viewers do not know {other}"),
        }
    }

    #[test]
    fn messages_are_what_their_schemas_say() {
        use crate::environment::Task;
        use crate::recording::mcap::channels::tests::messages;
        let seen = messages(&Task::parse("spread-xy-4").unwrap());
        for (schema, name) in [
            (scene_update(), "foxglove.SceneUpdate"),
            (links(), "vamaro_swarm.Links"),
            (estimates(), "vamaro_swarm.Estimates"),
            (metrics(), "vamaro_swarm.Metrics"),
        ] {
            assert_eq!(schema["title"], name);
            let of_it: Vec<&Value> = seen.iter().filter(|(of, _)| of == name).map(|(_, it)| it).collect();
            assert!(!of_it.is_empty(), "{name}");
            for value in of_it {
                assert!(fits(value, &schema), "{name}: {value}");
            }
            assert!(!fits(&json!({"other": 1}), &schema));
        }
    }
}
