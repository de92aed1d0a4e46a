//! `spawn --view`, driven through a pseudo-terminal: what is on the screen, what keys do, and that the terminal is given
//! back whatever happens.

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::num::NonZeroU16;
use std::os::fd::OwnedFd;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{OFlags, fcntl_setfl};
use rustix::process::{Pid, Signal, kill_process};
use rustix::pty::{OpenptFlags, grantpt, ioctl_tiocgptpeer, openpt, unlockpt};
use rustix::termios::{LocalModes, Winsize, tcgetattr, tcsetwinsize};

use crate::common::{PROGRAM, children, is_running, succeed};

/// Longer than anything takes here.
const LONG: Duration = Duration::from_secs(60);

/// A program in a terminal of its own.
pub struct Seat {
    pub program: Child,
    keyboard: File,
    /// The end that the program has. As long as it is held here, its settings can be read.
    terminal: OwnedFd,
    screen: vt100::Parser,
}

impl Seat {
    /// Starts `spawn --view` with these words in a terminal of so many columns and rows.
    fn of(words: &str, columns: u16, rows: u16) -> Seat {
        Seat::at(&format!("spawn --view {words}"), columns, rows)
    }

    /// Starts the command of these words in a terminal of so many columns and rows.
    pub fn at(words: &str, columns: u16, rows: u16) -> Seat {
        let keyboard = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
        grantpt(&keyboard).unwrap();
        unlockpt(&keyboard).unwrap();
        fcntl_setfl(&keyboard, OFlags::NONBLOCK).unwrap();
        let peer = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let terminal = ioctl_tiocgptpeer(&keyboard, peer).unwrap();
        let end = || Stdio::from(terminal.try_clone().unwrap());
        tcsetwinsize(&terminal, size(columns, rows)).unwrap();
        let program = in_session(&["--ctty"], words)
            .env("TERM", "xterm-256color")
            .env_remove("NO_COLOR")
            .stdin(end())
            .stdout(end())
            .stderr(end())
            .spawn()
            .unwrap();
        let [width, height] = [columns, rows].map(|size| NonZeroU16::new(size).unwrap());
        let screen = vt100::Parser::new(height, width, 0);
        Seat { program, keyboard: keyboard.into(), terminal, screen }
    }

    /// Waits until all of these words are on the screen.
    #[track_caller]
    pub fn sees(&mut self, words: &[&str]) {
        self.sees_that(|seat| words.iter().all(|words| seat.text().contains(words)));
    }

    #[track_caller]
    pub fn sees_that(&mut self, holds: impl Fn(&Seat) -> bool) {
        let deadline = Instant::now() + LONG;
        while !holds(self) {
            let ended = self.program.try_wait().unwrap();
            assert!(Instant::now() < deadline && ended.is_none(), "{ended:?}:\n{}", self.text());
            self.read();
        }
    }

    pub fn press(&mut self, keys: &str) {
        self.keyboard.write_all(keys.as_bytes()).unwrap();
    }

    fn text(&self) -> String {
        self.screen.screen().contents()
    }

    /// Takes in what the program has written since. Whether it was anything.
    fn read(&mut self) -> bool {
        let mut bytes = [0; 1 << 16];
        match self.keyboard.read(&mut bytes) {
            Ok(read) => self.screen.process(&bytes[..read]),
            Err(e) if e.kind() == ErrorKind::WouldBlock => {
                std::thread::sleep(Duration::from_millis(5));
                return false;
            }
            Err(e) => panic!("{e}"),
        }
        true
    }

    /// Has the program draw and reads nothing of it, until no more fits into the terminal.
    fn fill(&mut self) {
        let deadline = Instant::now() + LONG;
        while poll(&mut [PollFd::new(&self.terminal, PollFlags::OUT)], Some(&Timespec::default())).unwrap()
            > 0
        {
            assert!(Instant::now() < deadline, "there is always room");
            self.press("\x0c");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    pub fn id(&self) -> Pid {
        Pid::from_child(&self.program)
    }

    /// Waits for the program to end. It must have given the terminal back; its exit code, and what is to be read then.
    #[track_caller]
    pub fn ends(mut self) -> (Option<i32>, String) {
        let deadline = Instant::now() + LONG;
        let ended = loop {
            self.read();
            if let Some(ended) = self.program.try_wait().unwrap() {
                break ended;
            }
            assert!(Instant::now() < deadline, "it does not end:\n{}", self.text());
        };
        while self.read() {}
        let (screen, text) = (self.screen.screen(), self.text());
        assert!(!screen.alternate_screen() && !screen.hide_cursor(), "{text}");
        let modes = tcgetattr(&self.terminal).unwrap().local_modes;
        assert!(modes.contains(LocalModes::ICANON | LocalModes::ECHO | LocalModes::ISIG), "{modes:?}");
        assert!(!text.contains("panicked"), "{text}");
        (ended.code(), text)
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

fn size(columns: u16, rows: u16) -> Winsize {
    Winsize { ws_row: rows, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 }
}

/// A command in a session of its own, with these options of `setsid`.
fn in_session(options: &[&str], words: &str) -> Command {
    let mut command = Command::new("setsid");
    command.args(options).arg(PROGRAM).args(words.split_whitespace());
    command
}

#[test]
fn keys_pause_step_choose_set_p_and_end() {
    let mut seat = Seat::of("--agents 4 --p 0.5 --in-process --episodes 100000", 80, 24);
    seat.sees(&["spread-xy-4  episode", "of 100000", "speed x1", "the world as agent 0 knows it", "q quit"]);
    seat.press(" ");
    seat.sees(&["paused"]);
    let step = |seat: &Seat| seat.text().split("step ").nth(1).unwrap().split(' ').next().unwrap().to_owned();
    // A tick that was under way may still be drawn: with two steps there is one that is stepped.
    for _ in 0..2 {
        let before = step(&seat);
        seat.press(".");
        seat.sees_that(|seat| step(seat) != before);
    }
    seat.press("\t]");
    seat.sees(&["the world as agent 1 knows it", "p = 0.55", "paused"]);
    seat.press("k");
    seat.sees(&["agent 1 is killed; k restarts it"]);
    seat.press("..");
    seat.sees(&[" 1 absent", "it is not there"]);
    seat.press("km ");
    seat.sees(&["full speed", "+-", "mean"]);
    seat.press("q");
    let (code, text) = seat.ends();
    assert_eq!(code, Some(0), "{text}");
    for words in
        ["spread-xy-4: 4 agents in-process", "return", "p set 1 time, last to 0.55, 1 kill, ended after"]
    {
        assert!(text.contains(words), "{text}");
    }
}

#[test]
fn who_interrupts_or_ends_it_gets_the_terminal_back() {
    let interrupt: fn(&mut Seat) = |seat| seat.press("\x03");
    let end: fn(&mut Seat) = |seat| kill_process(seat.id(), Signal::TERM).unwrap();
    for stop in [interrupt, end] {
        let mut seat = Seat::of("--in-process --episodes 100000", 80, 24);
        seat.sees(&["hear-see  episode"]);
        stop(&mut seat);
        let (code, text) = seat.ends();
        assert_eq!(code, Some(130), "{text}");
        assert!(text.contains("error: interrupted"), "{text}");
    }
}

#[test]
fn a_run_that_fails_says_so_on_a_terminal_that_is_whole() {
    let mut seat = Seat::of("--agents 2 --on-failure abort --episodes 100000", 80, 24);
    seat.sees(&["speed x1"]);
    seat.press(" ");
    seat.sees(&["paused"]);
    kill_process(children(seat.program.id())[0], Signal::KILL).unwrap();
    seat.press(".");
    let (code, text) = seat.ends();
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("was killed by signal 9"), "{text}");
}

#[test]
fn who_does_not_read_misses_pictures_and_nothing_else() {
    let mut seat = Seat::of("--in-process --episodes 100000", 200, 60);
    seat.sees(&["the world as agent 0 knows it"]);
    seat.fill();
    std::thread::sleep(Duration::from_millis(1100));
    seat.press("\t+");
    seat.sees(&["the world as agent 1 knows it", "speed x2"]);
    // Nor does it matter at the end.
    seat.fill();
    seat.press("\x03");
    std::thread::sleep(Duration::from_millis(300));
    let (code, text) = seat.ends();
    assert_eq!(code, Some(130), "{text}");
    assert!(text.contains("error: interrupted"), "{text}");
}

#[test]
fn a_trace_says_who_was_killed_by_hand() {
    let folder = tempfile::tempdir().unwrap();
    let trace = folder.path().join("run.json");
    let words = format!("--agents 4 --p 0.5 --in-process --episodes 4 --record {}", trace.display());
    let mut seat = Seat::of(&words, 80, 24);
    seat.sees(&["speed x1"]);
    seat.press(" ]");
    seat.sees(&["p cannot change in a recorded run"]);
    seat.press("k.");
    seat.sees(&["it is not there"]);
    seat.press("km ");
    let (code, text) = seat.ends();
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("1 kill"), "{text}");
    succeed(&format!("verify {}", trace.display()));
    let trace: serde_json::Value = serde_json::from_slice(&std::fs::read(&trace).unwrap()).unwrap();
    let episodes = trace["episodes"].as_array().unwrap();
    assert!(episodes.iter().any(|episode| episode["presence"].is_array()), "{text}");
}

#[test]
fn a_terminal_may_be_tiny_grow_and_vanish() {
    let mut seat = Seat::of("--in-process --episodes 100000 --links uniform", 30, 6);
    seat.sees(&["This terminal has 30 columns", "Make it"]);
    let [width, height] = [100, 30].map(|size| NonZeroU16::new(size).unwrap());
    seat.screen.screen_mut().set_size(height, width);
    tcsetwinsize(&seat.terminal, size(100, 30)).unwrap();
    seat.sees(&["the world as agent 0 knows it", "uniform", "hears 01"]);
    seat.press("]");
    seat.sees(&["these links have no level to set"]);
    // Both ends go, as if a window were closed.
    let Seat { program, keyboard, terminal, .. } = &mut seat;
    let nowhere = || OwnedFd::from(File::open("/dev/null").unwrap());
    (*keyboard, *terminal) = (nowhere().into(), nowhere());
    let deadline = Instant::now() + LONG;
    let ended = loop {
        assert!(Instant::now() < deadline, "it goes on without a terminal");
        match program.try_wait().unwrap() {
            Some(ended) => break ended,
            None => std::thread::sleep(Duration::from_millis(5)),
        }
    };
    assert_eq!(ended.code(), Some(130));
    assert!(!is_running(seat.id()));
}

#[test]
fn without_a_terminal_there_is_no_view() {
    let refused = in_session(&[], "spawn --view --in-process").stdin(Stdio::null()).output().unwrap();
    let said = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{said}");
    assert!(
        said.contains("there is no terminal to show a view in") && said.contains("leave out --view"),
        "{said}"
    );
}
