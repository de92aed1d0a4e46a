//! A page that plays episodes, for a browser. It needs no other file and no network.

use glam::DVec2;
use maud::{Markup, PreEscaped, html};
use serde_json::{Value, json};

use super::{Film, Take};
use crate::base::page;

/// Says that there is no ghost.
const NONE: i16 = i16::MIN;

/// The page of one film, or of several side by side that have the same episodes. At first it shows what `viewer` sees.
pub(crate) fn page(films: &[Film], viewer: usize) -> String {
    let task = &films[0].spec().id;
    let names: Vec<&str> = films.iter().map(|film| &film.name[..]).collect();
    let title = format!("{task}: {}", names.join(" beside "));
    let data = json!({"films": films.iter().map(|of| film(of, viewer)).collect::<Vec<_>>()}).to_string();
    // Nothing in it may end the script.
    let data = data.replace('<', "\\u003c");
    let body = html! {
        main {
            h1 { (title) }
            div class={ "stages" @if films.len() == 1 { " one" } } {
                @for (index, film) in films.iter().enumerate() { (stage(index, film)) }
            }
            (controls(&films[0]))
            figure {
                canvas #curves role="img" aria-label="Return and imputation error, step by step" {}
                @if films.len() > 1 {
                    figcaption { "Solid: " (films[0].name) ". Dashed: " (films[1].name) ". Drag to see another moment." }
                } @else { figcaption { "Drag to see another moment." } }
            }
            p.aside #said role="status" aria-live="polite" {}
            (legend(films))
        }
        script #data type="application/json" { (PreEscaped(data)) }
        script { (PreEscaped(include_str!("page.js"))) }
    };
    page::page(&title, include_str!("page.css"), &body)
}

fn stage(index: usize, film: &Film) -> Markup {
    let policy = film.header.policy.iter().map(|policy| format!("policy {policy}"));
    let seed = film.header.seed.iter().map(|seed| format!("seed {seed}"));
    let conditions = film.takes.first().map(|take| film.conditions(take));
    let about: Vec<String> = conditions.into_iter().chain(policy).chain(seed).collect();
    html! {
        figure {
            canvas id={ "stage-" (index) } role="img" {}
            figcaption { b { (film.name) } " " (about.join(", ")) br; span id={ "told-" (index) } {} }
        }
    }
}

fn controls(film: &Film) -> Markup {
    html! {
        div.controls role="group" aria-label="Playing" {
            div.time {
                button #play type="button" { "Play" }
                button #back type="button" aria-label="One step back" { "<" }
                button #forward type="button" aria-label="One step forward" { ">" }
                input #step type="range" min="0" value="0" aria-label="Step";
                output #clock {}
            }
            label {
                "Speed"
                select #speed {
                    @for speed in ["0.1", "0.25", "0.5", "1", "2", "4"] {
                        option value=(speed) selected[speed == "1"] { (speed) " x" }
                    }
                }
            }
            label {
                "Episode"
                select #episode {
                    @for take in &film.takes {
                        option { (take.number) @if let Some(p) = take.p { " (p = " (p) ")" } }
                    }
                }
            }
            label {
                "Agent"
                select #agent {
                    option value="-1" { "all" }
                    @for (index, agent) in film.spec().agents.iter().enumerate() {
                        option value=(index) { (index) @if agent.name != format!("agent-{index}") { " (" (agent.name) ")" } }
                    }
                }
            }
            @for (what, label) in [("ghosts", "Ghosts"), ("links", "Links"), ("trails", "Trails")] {
                label { input id=(what) type="checkbox" checked; (label) }
            }
        }
    }
}

fn legend(films: &[Film]) -> Markup {
    let keys = [
        ("Space", "play or pause"),
        ("Left, Right", "one step back, one step forward"),
        ("Home, End", "the beginning, the end"),
        ("n, b", "the next, the previous episode"),
        ("a", "the next agent"),
        ("+, -", "faster, slower"),
        ("g, l, t", "ghosts, links, trails on or off"),
    ];
    let meanings = [
        ("dots", "agents, with their trails; a dashed one was absent or did not decide in time"),
        ("crosses", "landmarks; the ringed one is the goal"),
        ("squares on a corner", "those who move and are not of the team"),
        (
            "dashed circles",
            "ghosts: where the chosen agent thinks those others are that it did not hear at this step",
        ),
        (
            "green lines",
            "what the chosen agent receives; dashed: delayed by the links, by as many ticks as the number says",
        ),
        ("red dots", "what the links lost"),
        ("orange lines", "what came after the deadline, in real time"),
        ("imputation error", "root mean square error of what the chosen agent imputed, or the whole team"),
    ];
    let list = |entries: &[(&str, &str)]| {
        html! { dl { @for (term, meaning) in entries { dt { (term) } dd { (meaning) } } } }
    };
    html! {
        details { summary { "Keys" } (list(&keys)) }
        details {
            summary { "Legend" }
            (list(if films.iter().any(Film::is_of_a_trace) { &meanings } else { &meanings[..3] }))
        }
    }
}

fn film(film: &Film, viewer: usize) -> Value {
    let places = film.takes.iter().flat_map(Take::places);
    let largest = places.fold(1.0, |largest: f64, place| largest.max(place.abs().max_element()));
    // Places are whole multiples of this.
    let unit = 1.2 * largest / f64::from(i16::MAX);
    json!({
        "name": film.name,
        "agents": film.spec().agents.iter().map(|agent| &agent.name).collect::<Vec<_>>(),
        "dt": film.spec().dt,
        "unit": unit,
        "viewer": if film.is_of_a_trace() { json!(viewer) } else { json!(-1) },
        "episodes": film.takes.iter().map(|take| episode(take, unit)).collect::<Vec<_>>(),
    })
}

fn episode(take: &Take, unit: f64) -> Value {
    let whole = |place: &DVec2| {
        place
            .to_array()
            .map(|value| (value / unit).round().clamp(f64::from(NONE + 1), f64::from(i16::MAX)) as i16)
    };
    let i16s = |values: Vec<i16>| base64(bytemuck::cast_slice(&values));
    let mut episode = json!({
        "steps": take.steps_taken(),
        "landmarks": take.landmarks.iter().map(DVec2::to_array).collect::<Vec<_>>(),
        "goal": take.goal,
        "places": i16s(take.positions.iter().flatten().flat_map(whole).collect()),
        "returns": f32s(take.returns.iter().map(|value| *value as f32)),
    });
    if !take.targets.is_empty() {
        episode["targets"] = i16s(take.targets.iter().flatten().flat_map(whole).collect()).into();
    }
    if take.steps.is_empty() {
        return episode;
    }
    let agents = take.positions[0].len();
    let arrived = take.steps.iter().flat_map(|step| step.arrived.iter().flatten());
    let links: Vec<u8> = arrived.map(|arrived| arrived.code()).collect();
    episode["links"] = base64(&links).into();
    let mut ghosts = Vec::new();
    for of in take.steps.iter().flat_map(|step| &step.ghosts) {
        let first = ghosts.len();
        ghosts.resize(first + 2 * agents, NONE);
        for ghost in of {
            ghosts[first + 2 * ghost.agent..][..2].copy_from_slice(&whole(&ghost.place));
        }
    }
    if ghosts.iter().any(|value| *value != NONE) {
        episode["ghosts"] = i16s(ghosts).into();
    }
    let errors = take.steps.iter().flat_map(|step| &step.errors);
    episode["errors"] = f32s(errors.map(|error| error.map_or(f32::NAN, |error| error as f32))).into();
    let presence: Vec<u8> =
        take.steps.iter().flat_map(|step| &step.presence).map(|it| (*it).into()).collect();
    if presence.iter().any(|it| *it != 0) {
        episode["presence"] = base64(&presence).into();
    }
    episode
}

fn f32s(values: impl Iterator<Item = f32>) -> String {
    base64(bytemuck::cast_slice(&values.collect::<Vec<f32>>()))
}

/// Bytes as text, as browsers read them: RFC 4648.
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let bits = group.iter().fold(0, |bits, byte| bits << 8 | u32::from(*byte)) << (8 * (3 - group.len()));
        for letter in 0..4 {
            let six = bits >> (18 - 6 * letter) & 63;
            text.push(if letter <= group.len() { LETTERS[six as usize].into() } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_become_the_text_of_the_standard() {
        for (bytes, text) in
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")]
        {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
    }
}
