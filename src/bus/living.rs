//! Swarms that are alive, for those who look for one.

use std::path::{Path, PathBuf};

use super::directory::{LockedPlaces, SHARED_MEMORY, names_in, tag_in};
use super::place::{Lock, is_ours, locked};
use crate::base::error::Result;

/// A swarm of this user that is alive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Living {
    /// Its tag.
    pub(crate) tag: String,
    /// Its directory.
    pub(crate) root: PathBuf,
}

impl Living {
    /// Whether it is still alive.
    pub(crate) fn is_alive(&self) -> bool {
        matches!(locked(&self.root), Ok(Lock::Held))
    }
}

/// This user's swarms that are alive, wherever their directories are that can be seen from here.
pub(crate) fn living() -> Result<Vec<Living>> {
    let places = LockedPlaces::take()?;
    let mut all = Vec::new();
    for tag in places.tags() {
        all.extend(places.roots(&tag).map(|root| Living { tag: tag.clone(), root }));
    }
    all.retain(Living::is_alive);
    Ok(all)
}

/// Whether other users have swarms, or left something of one behind.
pub(crate) fn have_others_swarms() -> bool {
    let folder = Path::new(SHARED_MEMORY);
    names_in(folder).iter().any(|name| tag_in(name).is_some() && !is_ours(&folder.join(name)))
}
