//! The panels beside the world: the team, its agents and their links, and the ticks.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph, Sparkline};

use super::draw::Look;
use super::scene::{Fate, Part, Scene, Totals};

/// Draws all panels, one below the other.
pub(super) fn draw(frame: &mut Frame, area: Rect, look: &Look) {
    let Some(scene) = look.scene else {
        return frame.render_widget(Block::bordered(), area);
    };
    let rows = [Constraint::Length(8), Constraint::Min(0), Constraint::Length(6)];
    let [team, agents, ticks] = Layout::vertical(rows).areas(area);
    draw_team(frame, team, look, scene);
    draw_agents(frame, agents, look, scene);
    draw_ticks(frame, ticks, look, &scene.totals);
}

fn draw_team(frame: &mut Frame, area: Rect, look: &Look, scene: &Scene) {
    let Totals { finished, return_mean, return_ci95, delivery_rate, imputation_rmse, .. } = scene.totals;
    let mean = match (finished, return_ci95) {
        (0, _) => "no episode is over yet".to_owned(),
        (_, None) => format!("{return_mean:.1} mean"),
        (_, Some(ci)) => format!("{return_mean:.1} +- {ci:.1} mean"),
    };
    let level = look.desk.level.map(|p| format!("p = {p}"));
    let links = level.into_iter().chain(Some(look.facts.links.clone()).filter(|links| !links.is_empty()));
    let links = links.collect::<Vec<_>>().join(", ");
    let delivered = delivery_rate.map_or("-".to_owned(), percent);
    let imputed = imputation_rmse.map_or("-".to_owned(), |rmse| format!("{rmse:.4} RMSE"));
    let lines = [
        line("links", links, look),
        line("delivered", delivered, look),
        line("imputed", format!("{imputed}, {}", look.facts.imputer), look),
        line("return", format!("{:.1} so far", scene.episode_return), look),
        line("", mean, look),
    ];
    let block = Block::bordered().title(" team ");
    let inside = block.inner(area);
    frame.render_widget(block, area);
    let [text, curve] = Layout::vertical([Constraint::Length(5), Constraint::Min(0)]).areas(inside);
    frame.render_widget(Paragraph::new(lines.to_vec()), text);
    frame.render_widget(Sparkline::default().data(heights(&scene.returns, curve.width.into())), curve);
}

/// The latest returns as heights, up to 64.
fn heights(returns: &[f64], width: usize) -> Vec<u64> {
    /// The least of them is to be seen, too: an eighth of a row.
    const LEAST: f64 = 8.0;
    let latest = &returns[returns.len().saturating_sub(width)..];
    let least = latest.iter().copied().fold(f64::INFINITY, f64::min);
    let most = latest.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let height = |value: &f64| match most - least {
        span if span > 0.0 => (LEAST + (64.0 - LEAST) * (value - least) / span) as u64,
        _ => 32,
    };
    latest.iter().map(height).collect()
}

fn draw_agents(frame: &mut Frame, area: Rect, look: &Look, scene: &Scene) {
    let block = Block::bordered().title(" agents ").title_bottom(" ● heard ○ late · lost ");
    let inside = block.inner(area);
    let (n, rows) = (scene.parts.len(), usize::from(inside.height).saturating_sub(1));
    // The chosen one is always among those that are shown.
    let first = (look.desk.chosen + 1).saturating_sub(rows).min(n.saturating_sub(rows));
    let largest = scene.errors.iter().flatten().copied().fold(0.0, f64::max);
    let room = usize::from(inside.width).saturating_sub(START);
    let heading = if n <= room { (0..n).map(digit).collect() } else { "of".to_owned() };
    let mut lines =
        vec![Line::styled(format!("{:<START$}{heading}", "   error         hears"), look.theme.faint())];
    lines.extend((first..n).take(rows).map(|agent| {
        let mut spans = agent_spans(agent, look, scene, largest);
        let fates = &scene.fates[agent * n..][..n];
        if n <= room {
            spans.extend(fates.iter().enumerate().map(|(sender, fate)| mark(agent == sender, *fate, look)));
        } else {
            let heard = fates.iter().filter(|fate| **fate == Fate::Delivered).count();
            spans.push(Span::raw(format!("{heard}/{}", n - 1)));
        }
        Line::from(spans)
    }));
    frame.render_widget(Paragraph::new(lines).block(block), area);
}

/// The columns of the agents' panel in front of what they hear.
const START: usize = 23;

/// The last digit of a number heads its column.
fn digit(number: usize) -> String {
    (number % 10).to_string()
}

fn agent_spans<'a>(agent: usize, look: &Look, scene: &Scene, largest: f64) -> Vec<Span<'a>> {
    const BAR: f64 = 8.0;
    let (theme, is_chosen) = (look.theme, agent == look.desk.chosen);
    let label = format!("{agent:>2}");
    let label = Span::styled(label, if is_chosen { theme.body(agent) } else { theme.ghost(agent) });
    let (text, bar) = match (scene.parts[agent], scene.errors[agent]) {
        (Part::Absent, _) => ("absent".to_owned(), 0.0),
        (Part::Missed, _) => ("missed".to_owned(), 0.0),
        (Part::Decided, None) => ("-".to_owned(), 0.0),
        (Part::Decided, Some(error)) => (format!("{error:.3}"), BAR * error / largest.max(1e-9)),
    };
    let bar = "█".repeat(bar.round() as usize);
    vec![label, Span::raw(format!(" {text:<7} {bar:<12}"))]
}

fn mark<'a>(is_own: bool, fate: Fate, look: &Look) -> Span<'a> {
    let mark = match fate {
        _ if is_own => "-",
        Fate::None => " ",
        Fate::Delivered => "●",
        Fate::Delayed(_) | Fate::Late => "○",
        Fate::Lost => "·",
    };
    Span::styled(mark, ratatui::style::Style::new().fg(look.theme.fate(fate)))
}

fn draw_ticks(frame: &mut Frame, area: Rect, look: &Look, totals: &Totals) {
    let Totals { missed, absent, due, late_rate, tick_p50_us, tick_p99_us, .. } = *totals;
    let share = |count: u64| if due > 0 { percent(count as f64 / due as f64) } else { "-".to_owned() };
    let late = late_rate.map_or("-".to_owned(), percent);
    let rate = look.rate.map_or("-".to_owned(), |rate| format!("{rate:.0} ticks/s"));
    let lines = [
        line("time", time_words(tick_p50_us, tick_p99_us), look),
        line("rate", rate, look),
        line("missed", format!("{}, late {late}", share(missed)), look),
        line("absent", share(absent), look),
    ];
    frame.render_widget(Paragraph::new(lines.to_vec()).block(Block::bordered().title(" ticks ")), area);
}

fn line<'a>(about: &'a str, words: String, look: &Look) -> Line<'a> {
    Line::from(vec![Span::styled(format!("{about:<11}"), look.theme.faint()), Span::raw(words)])
}

/// Both in microseconds, or in milliseconds where they are long.
fn time_words(p50_us: f64, p99_us: f64) -> String {
    if p99_us < 10_000.0 {
        format!("p50 {p50_us:.0}, p99 {p99_us:.0} us")
    } else {
        format!("p50 {:.1}, p99 {:.1} ms", p50_us / 1e3, p99_us / 1e3)
    }
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_shows_the_latest_and_even_the_least_of_them() {
        assert_eq!(heights(&[5.0, -3.0, -1.0, 1.0], 3), [8, 36, 64]);
        assert_eq!(heights(&[-2.0, -2.0], 9), [32, 32]);
        assert!(heights(&[], 9).is_empty());
    }

    #[test]
    fn long_times_have_fewer_digits() {
        assert_eq!(time_words(161.4, 225.0), "p50 161, p99 225 us");
        assert_eq!(time_words(1765.0, 32408.0), "p50 1.8, p99 32.4 ms");
    }
}
