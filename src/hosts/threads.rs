//! How the engine divides its work among threads.

use std::ffi::OsString;

/// Where it reads that, when it first starts a thread. There is no other way to say it.
const NAME: &str = "ZENOH_RUNTIME";

/// The same two threads receive, let others in, and do what is asked. By default two only receive, and one that sees that
/// something has come wakes the other to take it. They are two, since one may have to wait until its answer finds room. Those
/// that send stay apart: else all could wait for room that only they can make.
const TWO: &str = "(rx: (handover: app), acc: (handover: app), app: (worker_threads: 2))";

/// Says it to the engine, unless the user does, if the program is started with words that need the engine: then a frame wakes
/// one thread fewer. Programs that are started later are told, too.
///
/// # Safety
/// No other thread may be running: it could be reading the environment.
pub unsafe fn share_engine_threads(words: &[OsString]) {
    let needs_engine =
        words.iter().any(|word| word == "host" || word.as_encoded_bytes().starts_with(b"--hosts"));
    if needs_engine && std::env::var_os(NAME).is_none() {
        // SAFETY: nobody else runs, as the caller promises.
        unsafe { std::env::set_var(NAME, TWO) };
    }
}
