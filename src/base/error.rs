//! What can go wrong, and the exit code it ends with.

use std::path::Path;

/// An error with the words a user needs: what, where, and what to do next.
///
/// The variants are the exit codes of the program, because that is what a caller can act on.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The command line or a file it names asks for something impossible (exit code 2).
    #[error("{0}")]
    Usage(String),
    /// The request was sound, but carrying it out failed (exit code 1).
    #[error("{0}")]
    Failed(String),
    /// Everything was carried out, but a requirement of the caller is not met (exit code 3).
    #[error("{0}")]
    Unmet(String),
    /// A signal asked the program to stop; everything was taken down first (exit code 130).
    #[error("{0}")]
    Interrupted(String),
}

/// The result of anything that can fail with an [`enum@Error`].
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// The exit code a program ends with on this error.
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Failed(_) => 1,
            Error::Usage(_) => 2,
            Error::Unmet(_) => 3,
            Error::Interrupted(_) => 130,
        }
    }

    /// The file at `path`, which the user has named, cannot be opened: typed wrong if it is not there.
    pub fn open(path: &Path, source: std::io::Error) -> Error {
        match source.kind() {
            std::io::ErrorKind::NotFound => Error::Usage(format!("there is no file {}", path.display())),
            _ => Error::io("open", path, source),
        }
    }

    /// A failure while doing `what` to the file at `path`.
    pub fn io(what: &str, path: &Path, source: impl std::fmt::Display) -> Error {
        Error::Failed(format!("cannot {what} {}: {source}", path.display()))
    }
}

/// Shorthand for [`Error::Usage`] with a formatted message.
#[macro_export]
macro_rules! usage {
    ($($words:tt)*) => { $crate::base::error::Error::Usage(format!($($words)*)) };
}

/// Shorthand for [`Error::Failed`] with a formatted message.
#[macro_export]
macro_rules! failed {
    ($($words:tt)*) => { $crate::base::error::Error::Failed(format!($($words)*)) };
}
