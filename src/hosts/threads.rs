//! How the engine divides its work among threads.

use std::ffi::OsString;
use std::os::unix::process::CommandExt;
use std::process::Command;

/// Where it reads that, when it first starts a thread. There is no other way to say it.
const NAME: &str = "ZENOH_RUNTIME";

/// The same two threads receive, let others in, and do what is asked. By default two only receive, and one that sees that
/// something has come wakes the other to take it. They are two, since one may have to wait until its answer finds room. Those
/// that send stay apart: else all could wait for room that only they can make.
const TWO: &str = "(rx: (handover: app), acc: (handover: app), app: (worker_threads: 2))";

/// If the program is started with words that need the engine, and the user says nothing else to it, this process starts the
/// program anew with that in its environment: then a frame wakes one thread fewer. A program cannot safely change the
/// environment that it has. If it cannot be started anew, the engine does as it does by default.
pub fn share_engine_threads(words: &[OsString]) {
    let needs_engine =
        words.iter().any(|word| word == "host" || word.as_encoded_bytes().starts_with(b"--hosts"));
    if needs_engine
        && std::env::var_os(NAME).is_none()
        && let Ok(program) = std::env::current_exe()
    {
        let _ = Command::new(program).args(words).env(NAME, TWO).exec();
    }
}
