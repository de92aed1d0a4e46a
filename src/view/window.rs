//! The window of a swarm: a thread that shows pictures of it to guests, in other processes of this user.

use std::convert::Infallible;
use std::path::PathBuf;
use std::time::Duration;

use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, bounded};
use glam::DVec2;
use postcard::ser_flavors::Size;

use super::Facts;
use super::camera::{RETURNS, TRAIL};
use super::pictures::{Film, PICTURES, Pictures};
use super::scene::{AgedGhost, Fate, Part, Scene, Totals};
use super::sign::Sign;
use crate::base::error::Result;
use crate::bus::{Host, SwarmDirectory, guests_memory_needed};
use crate::environment::places::Ghost;
use crate::failed;

/// A window that can be opened once. It closes when there is no camera any more; dropping it waits for that, so it goes after
/// the camera and before the swarm.
///
/// The swarm never waits for its thread, nor that for guests. The thread alone meets guests in shared memory, so whatever
/// they do there can only hold up the thread.
#[derive(Debug)]
pub(crate) struct Window {
    /// What the thread waits for; it goes to close a window that was never opened.
    opener: Option<Sender<Opening>>,
    /// Ends when the thread does.
    done: Receiver<Infallible>,
}

/// What the thread is given to show.
struct Opening {
    tag: String,
    directory: PathBuf,
    longest: usize,
    pictures: Pictures,
    /// Where it says that guests can come.
    opened: Sender<Result<()>>,
}

/// How often it looks for guests, and how long it waits for a tick before it looks whether they are still there.
const LOOK: Duration = Duration::from_millis(200);

/// After how many of them it tidies up while somebody watches.
const LOOKS: u32 = 20;

/// How long a window may take to open, or to close: far longer than it does, since a thread that comes to life after its swarm
/// has been removed leaves something behind, for the next start to remove.
const LONGEST: Duration = Duration::from_secs(10);

impl Window {
    /// Starts the thread. One that is started later would be pinned and scheduled as the swarm is.
    pub(crate) fn prepare() -> Result<Window> {
        let ((opener, openings), (end, done)) = (bounded::<Opening>(1), bounded(0));
        let thread = std::thread::Builder::new().name("window".to_owned()).spawn(move || {
            let _end = end;
            if let Ok(Opening { tag, directory, longest, pictures, opened }) = openings.recv() {
                let host = Host::open(&tag, longest);
                let _ = opened.send(host.as_ref().map(drop).map_err(|e| failed!("{e}")));
                // What fails later leaves guests without pictures, and the swarm alone.
                if host.and_then(|host| show(&host, &pictures, longest)).is_err() {
                    Sign::take_down(&directory);
                }
            }
        });
        thread.map_err(|e| failed!("cannot start a thread to show a swarm: {e}"))?;
        Ok(Window { opener: Some(opener), done })
    }

    /// Opens it to the swarm of this directory, and puts up its sign. What is shown is what will be on the film.
    ///
    /// # Errors
    /// `Failed` and the like if guests cannot be let in. The swarm can play without them.
    pub(crate) fn open(&mut self, swarm: &SwarmDirectory, facts: &Facts) -> Result<Film> {
        let longest = longest_picture(facts.agents);
        let needed = guests_memory_needed(longest);
        swarm.promise_more(needed)?.map_err(|memory| {
            failed!("that takes {needed} bytes of shared memory, and {} are free", memory.available())
        })?;
        let (pictures, film) = Pictures::new();
        pictures.set_watched(false);
        let (opened, is_open) = bounded(1);
        let (tag, directory) = (swarm.tag().to_owned(), swarm.path());
        let opening = Opening { tag, directory, longest, pictures, opened };
        self.opener
            .take()
            .and_then(|opener| opener.send(opening).ok())
            .ok_or_else(|| failed!("it was open before"))?;
        is_open.recv_timeout(LONGEST).map_err(|_| failed!("shared memory does not answer"))??;
        Sign::put_up(&swarm.path(), facts)?;
        Ok(film)
    }
}

impl Drop for Window {
    fn drop(&mut self) {
        self.opener = None;
        let _ = self.done.recv_timeout(LONGEST);
    }
}

/// Shows pictures as long as there is a camera and somebody looks.
fn show(host: &Host, pictures: &Pictures, longest: usize) -> Result<()> {
    let (mut empty, mut bytes) = (Some(Box::<Scene>::default()), vec![0; longest]);
    let (mut pause, mut looks, mut was_watched) = (LOOK, 0, false);
    loop {
        match pictures.taken.recv_timeout(pause) {
            Ok(scene) => {
                if let Ok(picture) = postcard::to_slice(&*scene, &mut bytes) {
                    host.show(picture)?;
                }
                (empty, pause) = (Some(scene), Duration::from_secs(1) / PICTURES);
            }
            Err(RecvTimeoutError::Timeout) => {
                let is_watched = host.guests() > 0;
                pictures.set_watched(is_watched);
                if is_watched && let Some(scene) = empty.take() {
                    let _ = pictures.wanted.try_send(scene);
                }
                looks += u32::from(is_watched);
                if looks > LOOKS || was_watched && !is_watched {
                    host.tidy()?;
                    looks = 0;
                }
                (pause, was_watched) = (LOOK, is_watched);
            }
            Err(RecvTimeoutError::Disconnected) => return Ok(()),
        }
    }
}

/// The most bytes of a picture of so many agents. One of an environment with more landmarks and targets than that is not shown.
fn longest_picture(agents: usize) -> usize {
    let far = DVec2::splat(f64::MAX);
    let ghost = Ghost { agent: agents, place: far, observers: [agents; 2], imputed: true };
    let count = u64::MAX;
    let scene = Scene {
        episode: count,
        step: u32::MAX,
        tick: count,
        positions: vec![far; agents],
        trail: vec![far; TRAIL * agents],
        landmarks: vec![far; 64 + 2 * agents],
        targets: vec![far; 64],
        goal: Some(usize::MAX),
        parts: vec![Part::Absent; agents],
        fates: vec![Fate::Delayed(u8::MAX); agents * agents],
        ghosts: vec![vec![AgedGhost { ghost, age: u32::MAX }; agents]; agents],
        errors: vec![Some(0.0); agents],
        episode_return: 0.0,
        returns: vec![0.0; RETURNS],
        level: Some(0.0),
        totals: Totals {
            finished: count,
            return_ci95: Some(0.0),
            delivery_rate: Some(0.0),
            late_rate: Some(0.0),
            imputation_rmse: Some(0.0),
            missed: count,
            absent: count,
            due: count,
            ..Totals::default()
        },
    };
    postcard::serialize_with_flavor(&scene, Size::default()).expect("counting bytes does not fail")
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;
    use crate::bus::{Guest, living};
    use crate::environment::Task;

    #[test]
    fn who_looks_sees_what_is_on_the_film_and_nothing_is_taken_for_nobody() {
        let swarm = SwarmDirectory::create().unwrap();
        let facts = Facts::of(Task::parse("hear-see").unwrap().spec());
        let mut window = Window::prepare().unwrap();
        let film = window.open(&swarm, &facts).unwrap();
        assert!(!film.is_watched());
        film.take(|_| panic!("nobody looks"));
        let found = living().unwrap().into_iter().find(|other| other.tag == swarm.tag()).unwrap();
        assert_eq!(Sign::of(&found).unwrap().facts().unwrap(), facts);
        let guest = Guest::enter(&found).unwrap();
        let deadline = Instant::now() + Duration::from_secs(60);
        let seen = loop {
            film.take(|scene| scene.tick = 7);
            if let Some(seen) = guest.look(|picture| postcard::from_bytes::<Scene>(picture).unwrap()).unwrap()
            {
                break seen;
            }
            assert!(Instant::now() < deadline, "nothing is shown");
            std::thread::sleep(Duration::from_millis(1));
        };
        assert_eq!((seen.tick, film.is_watched()), (7, true));
        // The thread ends with the film.
        drop(film);
        let ended = window.done.recv_timeout(Duration::from_secs(60));
        assert_eq!(ended, Err(RecvTimeoutError::Disconnected));
    }

    #[test]
    fn pictures_are_small() {
        assert!(longest_picture(4) < 16_000, "{}", longest_picture(4));
        assert!(longest_picture(64) < 300_000, "{}", longest_picture(64));
    }
}
