//! `replay`: recorded episodes as a page, a film or a frame.

use std::path::{Path, PathBuf};

use clap::{ArgGroup, Args};

use super::{policy_source, print, tell};
use crate::base::error::{Error, Result};
use crate::base::file::AtomicFile;
use crate::recording::{Reader, Rerun};
use crate::usage;
use crate::view::film::{Film, Moment, gif, page, svg};

/// Play recorded episodes in a browser, or draw them as an animation or a frame
#[derive(Debug, Args)]
#[command(
    override_usage = "vamaro-swarm replay [OPTIONS] <TRACE>...",
    group(ArgGroup::new("picture").args(["html", "svg", "gif"]).required(true).multiple(true)),
    after_help = "\
Examples:
  vamaro-swarm spawn --agents 4 --p 0.2 --episodes 20 --record trace.json
  # a page for a browser, which needs no other file
  vamaro-swarm replay trace.json --html replay.html
  # two runs of the same episodes, side by side
  vamaro-swarm spawn --agents 4 --p 0.2 --imputer hold --episodes 20 \\
      --record hold.json
  vamaro-swarm replay trace.json hold.json --html both.html
  # an animation, and a frame of it
  vamaro-swarm replay trace.json hold.json --gif both.gif --episode 3
  vamaro-swarm replay trace.json --svg frame.svg --episode 3 --step 12"
)]
pub struct Replay {
    /// A recording or a trace, or two of one task, to be shown side by side
    #[arg(required = true, num_args = 1..=2, value_name = "TRACE")]
    traces: Vec<PathBuf>,

    /// Write a page for a browser, with the first 100 episodes or that of --episode
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,

    /// Write an animation of one episode, at half the world's own pace
    #[arg(long, value_name = "FILE")]
    gif: Option<PathBuf>,

    /// Write a frame of one episode
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,

    /// The episode to show, by its number [default: the first; all in a page]
    #[arg(long, value_name = "E")]
    episode: Option<u64>,

    /// The step of the frame [default: the end of the episode]
    #[arg(long, value_name = "S", requires = "svg")]
    step: Option<usize>,

    /// Policy to run compact traces with, which leave out the agents' estimates [default: the one beside the trace, or
    /// the one it names]
    #[arg(long, value_name = "FILE|DIR|builtin")]
    policy: Option<String>,

    /// The agent whose links and ghosts (where it thinks the others are) are shown first
    #[arg(long, value_name = "I", default_value_t = 0)]
    agent: usize,
}

/// Episodes in a page that are shown unless one is asked for.
const MOST_EPISODES: usize = 100;

impl Replay {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let mut films = self.traces.iter().map(|path| self.film(path)).collect::<Result<Vec<_>>>()?;
        if let [one, other] = &mut films[..] {
            match_up(one, other)?;
        }
        let (spec, takes) = (films[0].spec(), &films[0].takes);
        if self.agent >= spec.n_agents() {
            return Err(usage!(
                "{} has {} agents, counted from 0: there is no agent {}",
                spec.id,
                spec.n_agents(),
                self.agent
            ));
        }
        let steps = takes[0].steps_taken();
        let step = self.step.unwrap_or(steps);
        if step > steps {
            return Err(usage!("episode {} has {steps} steps: there is no step {step}", takes[0].number));
        }
        let moment = Moment { films: &films, take: 0, time: step as f64, viewer: self.agent };
        let one = format!("{}, episode {}", spec.id, takes[0].number);
        if let Some(file) = &self.html {
            let many =
                format!("{}, {} episode{}", spec.id, takes.len(), if takes.len() == 1 { "" } else { "s" });
            write(file, page(&films, self.agent).as_bytes(), &many)?;
        }
        if let Some(file) = &self.svg {
            write(file, svg(&moment).as_bytes(), &format!("{one}, step {step}"))?;
        }
        if let Some(file) = &self.gif {
            write(file, &gif(&moment)?, &one)?;
        }
        Ok(())
    }

    /// The episodes of a file that are to be seen.
    fn film(&self, path: &Path) -> Result<Film> {
        let mut recording = Reader::open(path)?;
        let name = path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        let mut film = Film::of(name, recording.header.clone())?;
        let policy = self.policy.as_deref().map(|name| policy_source(name, 0)).transpose()?;
        // A compact trace leaves it to us what agents thought.
        let team = recording.is_compact().then(|| Rerun::new(path, &recording.header, policy.as_ref()));
        let (mut team, mut left_out) = (team.transpose()?, 0);
        for (number, episode) in (0..).zip(recording.by_ref()) {
            let mut episode = episode?;
            match self.episode {
                Some(wanted) if wanted != episode.episode.unwrap_or(number) => continue,
                None if film.takes.len() >= MOST_EPISODES => {
                    left_out += 1;
                    continue;
                }
                _ => {}
            }
            if let Some(team) = &mut team {
                team.think(&mut episode).map_err(|what| Error::io("replay", path, what))?;
            }
            film.push(number, &episode)?;
        }
        if let Some(what) = recording.unfinished() {
            tell(&format!("note: {}: {what}", path.display()));
        }
        if film.takes.is_empty() {
            return Err(match self.episode {
                Some(wanted) => usage!("{} has no episode {wanted}", path.display()),
                None => usage!("{} has no episodes", path.display()),
            });
        }
        if left_out > 0 {
            tell(&format!(
                "note: the first {MOST_EPISODES} episodes of {} are shown, {left_out} are left out; --episode names another",
                path.display()
            ));
        }
        Ok(film)
    }
}

/// Leaves two films the episodes that both have.
fn match_up(one: &mut Film, other: &mut Film) -> Result<()> {
    if one.spec().id != other.spec().id {
        return Err(usage!(
            "{} is of {}, {} of {}: both traces must be of one task",
            one.name,
            one.spec().id,
            other.name,
            other.spec().id
        ));
    }
    if one.header.seed != other.header.seed {
        tell("note: the traces have different seeds, so their episodes do not begin alike");
    }
    let numbers = |film: &Film| film.takes.iter().map(|take| take.number).collect::<Vec<_>>();
    let (mine, theirs) = (numbers(one), numbers(other));
    one.takes.retain(|take| theirs.contains(&take.number));
    other.takes.retain(|take| mine.contains(&take.number));
    if one.takes.is_empty() {
        return Err(usage!("{} and {} have no episode in common", one.name, other.name));
    }
    if one.name == other.name {
        one.name += " (1)";
        other.name += " (2)";
    }
    Ok(())
}

/// Writes a picture, and says of what.
fn write(file: &Path, bytes: &[u8], what: &str) -> Result<()> {
    AtomicFile::write(file, bytes)?;
    print(&format!("wrote {}: {what}, {} kB\n", file.display(), bytes.len().div_ceil(1000)))
}
