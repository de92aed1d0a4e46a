//! A program without the feature `view` has no view.

use super::{Facts, Film};
use crate::base::error::Result;
use crate::supervisor::Control;

/// There is none.
#[derive(Debug)]
pub(crate) enum Live {}

impl Live {
    /// Nobody ever gets here.
    pub(crate) fn begin(&mut self, _facts: Facts) -> Result<(Film, Control)> {
        match *self {}
    }

    /// Nor here.
    pub(crate) fn close(self) {
        match self {}
    }
}
