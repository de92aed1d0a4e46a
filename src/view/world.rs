//! The world on the canvas: trails, links, ghosts, landmarks and agents.

use glam::DVec2;
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::{Color, Style};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use ratatui::widgets::Block;
use ratatui::widgets::canvas::{Canvas, Circle, Context, Line as Stroke, Painter, Shape};

use super::draw::Look;
use super::scene::{AgedGhost, Fate, Scene};

/// Draws one world, as the chosen agent sees it.
pub(super) fn draw(frame: &mut Frame, area: Rect, look: &Look, block: Block) {
    let Some(scene) = look.scene.filter(|scene| !scene.positions.is_empty()) else {
        return frame.render_widget(block, area);
    };
    let inside = block.inner(area);
    let [x, y] = half_sides(scene, inside);
    let cell = 2.0 * x / f64::from(inside.width.max(1));
    let canvas = Canvas::default()
        .block(block)
        .marker(look.marker)
        .x_bounds([-x, x])
        .y_bounds([-y, y])
        .paint(|context| paint(context, scene, look, cell));
    frame.render_widget(canvas, area);
}

/// Half the width and the height of what is shown, m: all that there is and some margin, in the proportions of the area,
/// whose cells are twice as high as wide.
fn half_sides(scene: &Scene, area: Rect) -> [f64; 2] {
    /// Agents start within 1 m, and their labels need room.
    const LEAST: f64 = 1.1;
    let all = scene.positions.iter().chain(&scene.trail).chain(&scene.landmarks).chain(&scene.targets);
    let farthest = all.fold(DVec2::splat(LEAST), |farthest, place| farthest.max(place.abs() + 0.1));
    let [width, height] = [f64::from(area.width.max(1)), 2.0 * f64::from(area.height.max(1))];
    let scale = (farthest.x / width).max(farthest.y / height);
    [scale * width, scale * height]
}

/// Draws it with cells that are so wide, m.
fn paint(context: &mut Context, scene: &Scene, look: &Look, cell: f64) {
    let (theme, chosen, n) = (look.theme, look.desk.chosen, scene.positions.len());
    let steps: Vec<&[DVec2]> = scene.trail.chunks_exact(n).chain([&scene.positions[..]]).collect();
    for pair in steps.windows(2) {
        for (from, to) in pair[0].iter().zip(pair[1]) {
            context.draw(&stroke(*from, *to, theme.colour(Color::DarkGray)));
        }
    }
    for (sender, fate) in scene.fates[chosen * n..][..n].iter().enumerate() {
        let [from, to] = [sender, chosen].map(|agent| scene.positions[agent]);
        context.draw(&Link { from, to, fate: *fate, dot: cell / 2.0, colour: theme.fate(*fate) });
    }
    for AgedGhost { ghost, age } in &scene.ghosts[chosen] {
        if let Some(radius) = look.doubt.of(chosen, *age) {
            let DVec2 { x, y } = ghost.place;
            context.draw(&Circle { x, y, radius, color: theme.agent(ghost.agent) });
        }
    }
    for (landmark, place) in scene.landmarks.iter().enumerate() {
        let label = if scene.goal == Some(landmark) { "◎" } else { "+" };
        print(context, *place, label, theme.heading());
    }
    for place in &scene.targets {
        print(context, *place, "◆", theme.heading());
    }
    for AgedGhost { ghost, .. } in &scene.ghosts[chosen] {
        // Around the agent itself if it is right.
        let before = ghost.place - DVec2::X * cell;
        print(context, before, &format!("({})", ghost.agent), theme.ghost(ghost.agent));
    }
    for (agent, place) in scene.positions.iter().enumerate() {
        print(context, *place, &agent.to_string(), theme.body(agent));
    }
}

fn stroke(from: DVec2, to: DVec2, color: Color) -> Stroke {
    Stroke { x1: from.x, y1: from.y, x2: to.x, y2: to.y, color }
}

fn print(context: &mut Context, place: DVec2, label: &str, style: Style) {
    context.print(place.x, place.y, Line::from(Span::styled(label.to_owned(), style)));
}

/// The way of an observation: a line if it was delivered, dashes if it was late, dots if it was lost.
struct Link {
    from: DVec2,
    to: DVec2,
    fate: Fate,
    /// Size of a dot, m.
    dot: f64,
    colour: Color,
}

impl Shape for Link {
    fn draw(&self, painter: &mut Painter) {
        let (length, gap) = match self.fate {
            Fate::None => return,
            Fate::Delivered => (1, 0),
            Fate::Delayed(_) | Fate::Late => (3, 3),
            Fate::Lost => (1, 5),
        };
        let way = self.to - self.from;
        // What a stray estimate puts far away is not worth more.
        let dots = (way.abs().max_element() / self.dot).ceil().clamp(1.0, 2000.0);
        for at in (0..=dots as usize).filter(|at| at % (length + gap) < length) {
            let place = self.from + way * (at as f64 / dots);
            if let Some((x, y)) = painter.get_point(place.x, place.y) {
                painter.paint(x, y, self.colour);
            }
        }
    }
}

/// What dots are made of: braille, but for the console of Linux, which has none.
pub(super) fn marker() -> Marker {
    match std::env::var("TERM") {
        Ok(term) if term == "linux" => Marker::Dot,
        _ => Marker::Braille,
    }
}

#[cfg(test)]
mod tests {
    use glam::dvec2;

    use super::*;

    #[test]
    fn everything_fits_and_a_metre_is_as_wide_as_high() {
        let scene = Scene {
            positions: vec![dvec2(0.3, -2.9)],
            landmarks: vec![dvec2(-0.9, 0.9)],
            ..Scene::default()
        };
        for (width, height) in [(40, 20), (10, 50), (150, 10)] {
            let [x, y] = half_sides(&scene, Rect::new(0, 0, width, height));
            assert!(x >= 1.0 - 1e-9 && y >= 3.0 - 1e-9, "{x} {y}");
            assert!((x / f64::from(width) - y / f64::from(2 * height)).abs() < 1e-12);
        }
        assert_eq!(half_sides(&Scene::default(), Rect::new(0, 0, 0, 0)), [1.1, 2.2], "no area is no error");
    }
}
