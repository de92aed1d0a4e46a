//! How pictures get from a camera to who draws them.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crossbeam::channel::{Receiver, Sender, bounded};

use super::scene::Scene;

/// At most so many pictures a second.
pub(super) const PICTURES: u32 = 20;

/// The drawing end: where empty scenes go, and where filled ones come from.
#[derive(Debug)]
pub(crate) struct Pictures {
    pub(crate) wanted: Sender<Box<Scene>>,
    pub(crate) taken: Receiver<Box<Scene>>,
    /// Whether anybody looks.
    watched: Arc<AtomicBool>,
}

/// The camera's end of the [`Pictures`].
#[derive(Debug)]
pub(crate) struct Film {
    /// Scenes to fill.
    wanted: Receiver<Box<Scene>>,
    taken: Sender<Box<Scene>>,
    watched: Arc<AtomicBool>,
}

impl Pictures {
    /// Both ends, for one scene under way.
    pub(crate) fn new() -> (Pictures, Film) {
        let ((wanted, to_fill), (filled, taken)) = (bounded(1), bounded(1));
        let watched = Arc::new(AtomicBool::new(true));
        let film = Film { wanted: to_fill, taken: filled, watched: watched.clone() };
        (Pictures { wanted, taken, watched }, film)
    }

    /// Says whether anybody looks, as at first.
    pub(super) fn set_watched(&self, watched: bool) {
        self.watched.store(watched, Ordering::Relaxed);
    }
}

impl Film {
    /// Whether anybody looks.
    pub(super) fn is_watched(&self) -> bool {
        self.watched.load(Ordering::Relaxed)
    }

    /// Fills a scene, if one is waited for.
    pub(super) fn take(&self, fill: impl FnOnce(&mut Scene)) {
        if let Ok(mut scene) = self.wanted.try_recv() {
            fill(&mut scene);
            // Who waited for it may have left.
            let _ = self.taken.try_send(scene);
        }
    }
}
