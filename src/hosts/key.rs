//! The key that a host and its supervisor share.

use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use crate::base::error::{Error, Result};
use crate::usage;

/// Shorter secrets could be guessed.
const SHORTEST: usize = 32;

/// A name and a secret, in a file of one line: `name:secret`.
#[derive(Clone)]
pub(super) struct Key {
    /// The engine of a host reads it again.
    pub(super) path: PathBuf,
    pub(super) name: String,
    pub(super) secret: String,
}

impl Key {
    /// Reads a key that nobody else can read.
    pub(super) fn read(path: &Path) -> Result<Key> {
        let shown = path.display();
        let about = std::fs::metadata(path).map_err(|e| Error::open(path, e))?;
        if about.mode() & 0o077 != 0 {
            return Err(usage!(
                "others can read the key {shown}; run `chmod 600 {shown}`, and copy it safely"
            ));
        }
        let text = std::fs::read_to_string(path).map_err(|e| Error::open(path, e))?;
        let line = text.trim();
        let parts =
            line.split_once(':').filter(|_| !line.contains(|c: char| c.is_whitespace() || c.is_control()));
        match parts {
            Some((name, secret)) if !name.is_empty() && secret.len() >= SHORTEST => {
                let path = path.canonicalize().map_err(|e| Error::open(path, e))?;
                Ok(Key { path, name: name.to_owned(), secret: secret.to_owned() })
            }
            _ => Err(usage!(
                "the key {shown} is not one line `name:secret` with a secret of {SHORTEST} or more characters; make one \
                 with `(umask 077; echo \"swarm:$(openssl rand -hex 32)\" > {shown})`"
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs::Permissions;
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    #[test]
    fn a_key_is_a_line_that_nobody_else_can_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key");
        let read = |text: &str, mode| {
            std::fs::write(&path, text).unwrap();
            std::fs::set_permissions(&path, Permissions::from_mode(mode)).unwrap();
            Key::read(&path).map(|key| (key.name, key.secret)).map_err(|e| e.to_string())
        };
        let secret = "0123456789abcdef".repeat(2);
        assert_eq!(read(&format!("swarm:{secret}\n"), 0o600), Ok(("swarm".to_owned(), secret.clone())));
        assert!(read(&format!("swarm:{secret}\n"), 0o640).unwrap_err().contains("chmod 600"));
        for wrong in [secret.clone(), "swarm:short".to_owned(), format!("a:{secret}\nb:{secret}")] {
            assert!(read(&wrong, 0o600).unwrap_err().contains("name:secret"), "{wrong}");
        }
    }
}
