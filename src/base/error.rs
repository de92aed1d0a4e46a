//! What can go wrong, by what a caller can do about it.

use std::path::{Path, PathBuf};

/// An error with the words a user needs: what, where, and what to do next. Its source, where there is one, is part of them.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// What was asked for is impossible: ask for something else.
    #[error("{0}")]
    Usage(String),
    /// Something cannot be done with a file or folder: look at it.
    #[error("cannot {what} {}: {source}", path.display())]
    File {
        /// Such as `read`.
        what: String,
        /// The file or folder.
        path: PathBuf,
        /// Why.
        source: Source,
    },
    /// Processes of a swarm have died, or do not answer: start another swarm.
    #[error("{} {how}", names.join(", "))]
    Lost {
        /// The processes, such as `agent-1`.
        names: Vec<String>,
        /// What has become of them.
        how: String,
    },
    /// The shared memory of a swarm cannot be used: see what `vamaro-swarm doctor` finds.
    #[error("shared memory: cannot {what}: {source:?}")]
    Bus {
        /// Such as `create a node`.
        what: String,
        /// Why.
        source: Source,
    },
    /// An environment, a link, an imputer or an observer from outside has failed.
    #[error("{0}")]
    Outside(#[source] Source),
    /// Something else went wrong while a sound request was carried out.
    #[error("{0}")]
    Failed(String),
    /// Everything was carried out, but a requirement of the caller is not met.
    #[error("{0}")]
    Unmet(String),
    /// A signal asked the program to stop; everything was taken down first.
    #[error("{0}")]
    Interrupted(String),
    /// An error, and where that leaves things.
    #[error("{source}; {remark}")]
    Remarked {
        /// The error.
        source: Box<Error>,
        /// Such as what is kept.
        remark: String,
    },
}

/// What lies behind an error.
pub type Source = Box<dyn std::error::Error + Send + Sync>;

/// The result of anything that can fail with an [`enum@Error`].
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// An error of an environment, a link, an imputer or an observer of one's own.
    pub fn outside(source: impl Into<Source>) -> Error {
        Error::Outside(source.into())
    }

    /// The file at `path`, which the user has named, cannot be opened: typed wrong if it is not there.
    pub fn open(path: &Path, source: std::io::Error) -> Error {
        match source.kind() {
            std::io::ErrorKind::NotFound => Error::Usage(format!("there is no file {}", path.display())),
            _ => Error::io("open", path, source),
        }
    }

    /// A failure while doing `what` to the file at `path`.
    pub fn io(what: &str, path: &Path, source: impl Into<Source>) -> Error {
        Error::File { what: what.to_owned(), path: path.to_owned(), source: source.into() }
    }

    /// Whether processes of a swarm were lost.
    pub fn is_loss(&self) -> bool {
        match self {
            Error::Lost { .. } => true,
            Error::Remarked { source, .. } => source.is_loss(),
            _ => false,
        }
    }

    /// Adds to what went wrong, or was interrupted, where that leaves things.
    pub fn and(self, remark: String) -> Error {
        match self {
            Error::Usage(_) | Error::Unmet(_) => self,
            Error::Interrupted(words) => Error::Interrupted(format!("{words}; {remark}")),
            source => Error::Remarked { source: Box::new(source), remark },
        }
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

#[cfg(test)]
mod tests {
    use std::error::Error as _;

    use super::*;

    #[test]
    fn sources_are_kept_through_remarks() {
        let full = || std::io::Error::from_raw_os_error(28);
        let error = Error::io("write", Path::new("/a/b"), full()).and("the last one stays".to_owned());
        assert_eq!(error.to_string(), format!("cannot write /a/b: {}; the last one stays", full()));
        let source = error.source().and_then(|file| file.source()).expect("a file's error has a source");
        let io = source.downcast_ref::<std::io::Error>().expect("it is that of the system");
        assert_eq!(io.raw_os_error(), Some(28));
    }

    #[test]
    fn what_was_asked_for_and_interruptions_keep_their_kind() {
        let remark = || "finished cells are kept".to_owned();
        assert!(matches!(Error::Usage("no".into()).and(remark()), Error::Usage(words) if words == "no"));
        let interrupted = Error::Interrupted("interrupted".into()).and(remark());
        assert!(matches!(interrupted, Error::Interrupted(words) if words.ends_with("kept")));
    }
}
