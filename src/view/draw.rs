//! How a terminal shows a swarm: a title, the world, the panels, and the keys.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph, Wrap};

use super::desk::Desk;
use super::doubt::Doubt;
use super::facts::Facts;
use super::scene::{Part, Scene};
use super::theme::Theme;
use super::{panels, world};

/// Everything that a picture is made of.
pub(super) struct Look<'a> {
    pub(super) facts: &'a Facts,
    pub(super) desk: &'a Desk,
    /// `None` before the first tick.
    pub(super) scene: Option<&'a Scene>,
    pub(super) doubt: &'a Doubt,
    /// Ticks a second, just now.
    pub(super) rate: Option<f64>,
    pub(super) theme: Theme,
    pub(super) marker: Marker,
}

/// Less than this shows nothing that could be read.
const LEAST: (u16, u16) = (60, 20);

/// Draws all of it.
pub(super) fn draw(frame: &mut Frame, look: &Look) {
    let area = frame.area();
    if area.width < LEAST.0 || area.height < LEAST.1 {
        let words = format!(
            "This terminal has {} columns and {} rows; a view needs {} and {}. Make it larger, or press q to end.",
            area.width, area.height, LEAST.0, LEAST.1
        );
        return frame.render_widget(Paragraph::new(words).wrap(Wrap { trim: true }), area);
    }
    let [title, body, keys] =
        Layout::vertical([Constraint::Length(1), Constraint::Min(0), Constraint::Length(1)]).areas(area);
    draw_title(frame, title, look);
    let side = (area.width * 2 / 5).clamp(34, 52);
    let [left, right] = Layout::horizontal([Constraint::Min(0), Constraint::Length(side)]).areas(body);
    world::draw(frame, left, look, world_block(look));
    panels::draw(frame, right, look);
    frame.render_widget(Line::styled(key_words(look, keys.width), look.theme.faint()), keys);
}

fn draw_title(frame: &mut Frame, area: Rect, look: &Look) {
    let Look { facts, desk, scene, theme, .. } = look;
    let mut left = vec![Span::styled(format!(" {}", facts.task), theme.heading())];
    if let Some(Scene { episode, step, .. }) = scene {
        let (episode, step) = (episode + 1, step + 1);
        left.push(Span::raw(format!(
            "  episode {episode} of {}, step {step} of {}",
            facts.episodes, facts.steps
        )));
    }
    if facts.worlds > 1 {
        left.push(Span::styled(format!("  1 of {} worlds", facts.worlds), theme.faint()));
    }
    let style = if desk.stands { theme.loud() } else { theme.heading() };
    let right = Line::from(Span::styled(format!("{} ", desk.speed_words()), style));
    frame.render_widget(Line::from(left), area);
    frame.render_widget(right.right_aligned(), area);
}

/// The frame around the world, with what there is to say about it.
fn world_block<'a>(look: &Look) -> Block<'a> {
    let Look { facts, desk, scene, theme, .. } = look;
    let chosen = desk.chosen;
    let below = match scene {
        _ if !desk.notice.is_empty() => Line::styled(format!(" {} ", desk.notice), theme.loud()),
        None => Line::raw(" waiting for the next tick "),
        _ if !facts.places => Line::raw(" this environment has no places to show "),
        _ if !facts.told => Line::raw(" no ghosts: nobody observes where agents are "),
        Some(scene) => Line::raw(guess_words(scene, chosen)),
    };
    Block::bordered().title(format!(" the world as agent {chosen} knows it ")).title_bottom(below)
}

/// How well an agent knows where the others are.
fn guess_words(scene: &Scene, agent: usize) -> String {
    match scene.parts[agent] {
        Part::Absent => return " it is not there ".to_owned(),
        Part::Missed => return " it did not decide in time ".to_owned(),
        Part::Decided => {}
    }
    let ghosts = &scene.ghosts[agent];
    if ghosts.is_empty() {
        return " it knows where everybody is ".to_owned();
    }
    let off = ghosts.iter().map(|aged| aged.ghost.place.distance(scene.positions[aged.ghost.agent]));
    let off = off.sum::<f64>() / ghosts.len() as f64;
    format!(" guesses {} of {}, off by {off:.2} m ", ghosts.len(), scene.positions.len() - 1)
}

/// The keys there are, and what they do if that fits.
fn key_words(look: &Look, width: u16) -> String {
    const LOCKSTEP: [&str; 4] = ["space pause", ". step", "-+ speed", "m full"];
    const REAL_TIME: [&str; 1] = ["space hold"];
    const STEERING: [&str; 5] = ["tab agent", "[] p", "k kill", "x stop", "q quit"];
    const WATCHING: [&str; 2] = ["tab agent", "q quit"];
    let first = if look.desk.is_paced() { &LOCKSTEP[..] } else { &REAL_TIME };
    let rest = if look.desk.is_guest() { &WATCHING[..] } else { &STEERING };
    let all: Vec<&str> = first.iter().chain(rest).copied().collect();
    let roomy = format!(" {}", all.join("  "));
    if roomy.len() <= width.into() {
        return roomy;
    }
    let keys = all.iter().filter_map(|words| words.split(' ').next());
    format!(" {}", keys.collect::<Vec<_>>().join(" "))
}

#[cfg(test)]
mod tests;
