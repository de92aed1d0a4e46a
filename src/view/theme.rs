//! Colours: the sixteen that every terminal has, or none.

use ratatui::style::{Color, Modifier, Style};

use super::scene::Fate;

/// How things are told apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Theme {
    /// Whether there are colours. Everything is told by shape as well.
    pub(super) colours: bool,
}

/// Agents take turns. Green, yellow and red say what became of an observation.
const AGENTS: [Color; 6] = [
    Color::LightCyan,
    Color::LightMagenta,
    Color::LightBlue,
    Color::LightGreen,
    Color::LightYellow,
    Color::LightRed,
];

impl Theme {
    /// Without colours if the variable NO_COLOR is set to anything.
    pub(super) fn of_environment() -> Theme {
        Theme { colours: std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty()) }
    }

    /// A colour, if there are any.
    pub(super) fn colour(self, colour: Color) -> Color {
        Some(colour).filter(|_| self.colours).unwrap_or(Color::Reset)
    }

    /// That of an agent.
    pub(super) fn agent(self, agent: usize) -> Color {
        self.colour(AGENTS[agent % AGENTS.len()])
    }

    /// An agent where it is.
    pub(super) fn body(self, agent: usize) -> Style {
        Style::new().fg(self.agent(agent)).add_modifier(Modifier::BOLD | Modifier::REVERSED)
    }

    /// An agent where another thinks it is.
    pub(super) fn ghost(self, agent: usize) -> Style {
        Style::new().fg(self.agent(agent))
    }

    /// What became of an observation.
    pub(super) fn fate(self, fate: Fate) -> Color {
        self.colour(match fate {
            Fate::Delivered => Color::Green,
            Fate::Delayed(_) | Fate::Late => Color::Yellow,
            Fate::Lost => Color::Red,
            Fate::None => Color::DarkGray,
        })
    }

    /// What matters less.
    pub(super) fn faint(self) -> Style {
        let dim = if self.colours { Modifier::empty() } else { Modifier::DIM };
        Style::new().fg(self.colour(Color::DarkGray)).add_modifier(dim)
    }

    /// What is to be noticed.
    pub(super) fn loud(self) -> Style {
        Style::new().fg(self.colour(Color::Yellow)).add_modifier(Modifier::BOLD)
    }

    /// A heading.
    pub(super) fn heading(self) -> Style {
        Style::new().add_modifier(Modifier::BOLD)
    }
}
