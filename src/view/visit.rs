//! A visit: looking at a swarm that another process runs.

use std::time::Duration;

use crossbeam::channel::{RecvTimeoutError, bounded};

use super::scene::Scene;
use super::{Facts, Live};
use crate::base::error::{Error, Result};
use crate::bus::{Guest, Living, leftovers};
use crate::supervisor::{Command, signals};

/// How a visit ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Farewell {
    /// The viewer left.
    SeenEnough,
    /// The swarm has ended.
    Over,
}

/// How often it looks: more often than there are pictures, so that none waits long.
const LOOK: Duration = Duration::from_millis(16);

/// Shows a swarm in the terminal, until it ends or the viewer leaves. It only takes pictures that the swarm
/// shows in any case, so whether it looks, sleeps or dies makes no difference to the swarm.
///
/// # Errors
/// `Usage` if there is no terminal, or no place for one more; `Interrupted` if the program was asked to stop.
pub(crate) fn visit(swarm: &Living, facts: Facts) -> Result<Farewell> {
    let mut live = Live::prepare("run top in one")?;
    let guest = match Guest::enter(swarm) {
        Err(_) if !swarm.is_alive() => {
            // It ended meanwhile; whoever comes in makes its directory again.
            leftovers(true)?;
            return Ok(Farewell::Over);
        }
        guest => guest?,
    };
    let farewell = look_on(swarm, &guest, facts, &mut live);
    // The terminal first: what is shared with a swarm may be gone.
    drop(live);
    drop(guest);
    if !swarm.is_alive() {
        // What was still being made while the swarm removed itself.
        leftovers(true)?;
    }
    farewell
}

fn look_on(swarm: &Living, guest: &Guest, facts: Facts, live: &mut Live) -> Result<Farewell> {
    let (commands, told) = bounded(8);
    let agents = facts.agents;
    let film = live.begin(Facts { guest: true, ..facts }, commands)?;
    let mut newest = None;
    loop {
        signals::check_stop()?;
        newest = guest.look(|picture| read(picture, agents))?.flatten().or(newest);
        if newest.is_some() {
            film.take(|empty| *empty = newest.take().unwrap_or_default());
        }
        if !swarm.is_alive() {
            return Ok(Farewell::Over);
        }
        match told.recv_timeout(LOOK) {
            // It asks for nothing else.
            Ok(Command::End) => return Ok(Farewell::SeenEnough),
            Ok(_) | Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => {
                return Err(Error::Interrupted("the terminal is gone".to_owned()));
            }
        }
    }
}

/// A picture, unless it does not fit so many agents.
fn read(picture: &[u8], agents: usize) -> Option<Scene> {
    postcard::from_bytes::<Scene>(picture).ok().filter(|scene| scene.fits(agents))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::view::scene::{Fate, Part};

    #[test]
    fn a_picture_comes_back_and_one_of_others_does_not() {
        let scene = Scene {
            parts: vec![Part::Missed; 2],
            fates: vec![Fate::Delayed(7); 4],
            ghosts: vec![vec![]; 2],
            errors: vec![Some(0.5); 2],
            level: Some(0.2),
            ..Scene::default()
        };
        let mut bytes = [0; 500];
        let picture = postcard::to_slice(&scene, &mut bytes).unwrap();
        assert_eq!(read(picture, 2), Some(scene));
        assert_eq!(read(picture, 3), None);
        assert_eq!(read(&picture[..picture.len() - 1], 2), None);
    }

    proptest! {
        #[test]
        fn anything_may_be_shown(bytes: Vec<u8>) {
            let _ = read(&bytes, 2);
        }
    }
}
