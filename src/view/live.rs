//! The live view: a thread that draws what the camera takes, and passes on what keys ask for.

use std::collections::VecDeque;
use std::io::{self, IsTerminal, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, Sender, TryRecvError, bounded};
use ratatui::backend::TermionBackend;
use ratatui::layout::Rect;
use ratatui::{TerminalOptions, Viewport};
use rustix::process::{Signal, getpid, kill_process};

use super::desk::{Desk, Meaning};
use super::doubt::Doubt;
use super::draw::{self, Look};
use super::pictures::{Film, PICTURES, Pictures};
use super::scene::Scene;
use super::terminal::{Terminal, give_back, give_back_within};
use super::theme::Theme;
use super::{Facts, world};
use crate::base::error::Result;
use crate::failed;
use crate::supervisor::{Command, hold_words, release_words};

/// A view of a swarm in the terminal. Dropping it gives the terminal back.
#[derive(Debug)]
pub(crate) struct Live {
    terminal: Terminal,
    /// What the thread waits for before it draws.
    begin: Sender<Drawer>,
    closes: Arc<AtomicBool>,
    /// Ends when the thread does.
    done: Receiver<()>,
}

/// How long a view may take to close. Its terminal is given back in any case.
const LONGEST_CLOSE: Duration = Duration::from_secs(1);

/// How long a terminal that is given back may go unread.
const LONGEST_UNREAD: Duration = Duration::from_secs(10);

impl Live {
    /// Finds a terminal, and starts the thread that will draw. A thread that is started later would be pinned and scheduled
    /// as the swarm is. Where there is no terminal, `remedy` says what to do.
    ///
    /// # Errors
    /// `Usage` if there is no terminal for it.
    pub(crate) fn prepare(remedy: &str) -> Result<Live> {
        let terminal = Terminal::find(remedy)?;
        let ((begin, begun), (end, done)) = (bounded::<Drawer>(1), bounded(0));
        let thread = std::thread::Builder::new().name("view".to_owned()).spawn(move || {
            let _end = end;
            if let Ok(mut drawer) = begun.recv()
                && drawer.run().is_err()
            {
                // The terminal is gone, and nobody is there to be told. The swarm plays on.
                give_back();
            }
        });
        thread
            .map_err(|e| failed!("cannot start a thread to draw a view: {e}; allow more with `ulimit -u`"))?;
        Ok(Live { terminal, begin, closes: Arc::default(), done })
    }

    /// Takes the terminal and begins to draw what will be on the film. What keys ask for goes to `commands`, which has
    /// room for some.
    ///
    /// # Errors
    /// `Failed` if the terminal cannot be taken.
    pub(crate) fn begin(&mut self, facts: Facts, commands: Sender<Command>) -> Result<Film> {
        self.terminal.take()?;
        if std::io::stderr().is_terminal() {
            hold_words();
        }
        let (pictures, film) = Pictures::new();
        let desk = Desk::new(&facts);
        if let Some(command) = desk.first_command() {
            commands.try_send(command).expect("there is room for the first one");
        }
        let drawer = Drawer {
            terminal: self.terminal.clone(),
            canvas: None,
            pictures,
            commands,
            closes: self.closes.clone(),
            desk,
            facts,
            scene: None,
            doubt: Doubt::default(),
            speed: Speed::default(),
        };
        // The thread ends only if this ends.
        let _ = self.begin.send(drawer);
        Ok(film)
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        self.closes.store(true, Ordering::Relaxed);
        // One that has not begun ends by this.
        self.begin = bounded(0).0;
        let _ = self.done.recv_timeout(LONGEST_CLOSE);
        give_back_within(LONGEST_UNREAD);
        release_words();
    }
}

/// What the thread has.
struct Drawer {
    terminal: Terminal,
    /// What is drawn on, and how large it is.
    canvas: Option<(Canvas, Rect)>,
    pictures: Pictures,
    commands: Sender<Command>,
    closes: Arc<AtomicBool>,
    facts: Facts,
    desk: Desk,
    scene: Option<Box<Scene>>,
    doubt: Doubt,
    speed: Speed,
}

type Canvas = ratatui::Terminal<TermionBackend<Terminal>>;

impl Drawer {
    /// Draws until it is told to close.
    ///
    /// # Errors
    /// Whatever the terminal fails with.
    fn run(&mut self) -> io::Result<()> {
        let _ = self.pictures.wanted.try_send(Box::default());
        self.draw()?;
        let (mut next, mut is_old) = (Instant::now(), false);
        while !self.closes.load(Ordering::Relaxed) {
            for key in self.terminal.await_keys(next)? {
                is_old = true;
                match self.desk.press(key) {
                    Meaning::Told(command) => self.tell(command),
                    Meaning::Anew => self.canvas = None,
                    // What the terminal would have done itself.
                    Meaning::Interrupt => drop(kill_process(getpid(), Signal::INT)),
                    Meaning::Seen | Meaning::Nothing => {}
                }
            }
            let is_free = self.terminal.send()?;
            if Instant::now() < next {
                continue;
            }
            next = Instant::now() + Duration::from_secs(1) / PICTURES;
            match self.pictures.taken.try_recv() {
                Ok(scene) => is_old |= self.see(scene),
                Err(TryRecvError::Empty) => {}
                Err(TryRecvError::Disconnected) => return Ok(()),
            }
            let is_resized = self.canvas.as_ref().map(|(_, area)| *area) != Some(self.terminal.area()?);
            // Where the last picture is still on its way, this one is dropped.
            if is_free && (is_old || is_resized) {
                self.draw()?;
                is_old = false;
            }
        }
        Ok(())
    }

    /// Takes in a new picture, unless an old one is held, and asks for the next. Whether it is to be drawn.
    fn see(&mut self, scene: Box<Scene>) -> bool {
        self.speed.note(scene.tick);
        self.doubt.note(&scene);
        self.desk.note(&scene);
        let is_held = self.desk.stands && !self.desk.is_paced();
        let empty = if is_held { Some(scene) } else { self.scene.replace(scene) };
        let _ = self.pictures.wanted.try_send(empty.unwrap_or_default());
        !is_held
    }

    fn draw(&mut self) -> io::Result<()> {
        let area = self.terminal.area()?;
        let mut canvas = match self.canvas.take() {
            Some((canvas, size)) if size == area => canvas,
            _ => canvas(&self.terminal, area)?,
        };
        let look = Look {
            facts: &self.facts,
            desk: &self.desk,
            scene: self.scene.as_deref(),
            doubt: &self.doubt,
            rate: self.speed.ticks_a_second(),
            theme: Theme::of_environment(),
            marker: world::marker(),
        };
        canvas.draw(|frame| draw::draw(frame, &look))?;
        self.canvas = Some((canvas, area));
        Ok(())
    }

    fn tell(&self, command: Command) {
        // A hand that presses more than a session takes between two ticks presses again.
        let _ = self.commands.try_send(command);
    }
}

/// An empty canvas.
fn canvas(terminal: &Terminal, area: Rect) -> io::Result<Canvas> {
    terminal.clone().write_all(b"\x1b[2J")?;
    let backend = TermionBackend::new(terminal.clone());
    ratatui::Terminal::with_options(backend, TerminalOptions { viewport: Viewport::Fixed(area) })
}

/// How fast a swarm plays.
#[derive(Debug, Default)]
struct Speed {
    /// When which tick was played.
    seen: VecDeque<(Instant, u64)>,
}

impl Speed {
    fn note(&mut self, tick: u64) {
        const SPAN: Duration = Duration::from_secs(2);
        let now = Instant::now();
        self.seen.push_back((now, tick));
        while self.seen.len() > 2 && self.seen[1].0 + SPAN < now {
            self.seen.pop_front();
        }
    }

    fn ticks_a_second(&self) -> Option<f64> {
        let (first, last) = (self.seen.front()?, self.seen.back()?);
        let span = (last.0 - first.0).as_secs_f64();
        (span > 0.0).then(|| (last.1 - first.1) as f64 / span)
    }
}
