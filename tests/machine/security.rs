//! Who may listen, and what lies in the way: a swarm is its user's alone, and what others have put there is refused.

use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use crate::common::{PROGRAM, Swarm, root, shared_memory, stderr};
use rustix::process::Signal;

/// The user `nobody` of most systems.
const SOMEBODY_ELSE: &str = "65534";

/// Runs a script of the shell, with a /tmp and a /dev/shm of its own; `None`, and a word, where this machine allows none.
fn with_own_tmp(script: &str) -> Option<Output> {
    let probe = Command::new("unshare").args(["-rm", "sh", "-c", "true"]).output();
    if !probe.is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: this machine allows no mount namespaces");
        return None;
    }
    // The program may be in /tmp itself.
    let script = format!(
        "cp {PROGRAM} /mnt/ 2>/dev/null; mount -t tmpfs tmpfs /tmp; mount -t tmpfs tmpfs /dev/shm; {script}"
    );
    let mount = format!("mount -t tmpfs tmpfs /mnt; {script}");
    let mut command = Command::new("unshare");
    command.args(["-rm", "sh", "-c", &mount]).env("P", "/mnt/vamaro-swarm").env_remove("XDG_RUNTIME_DIR");
    command.env("TERM", "dumb");
    Some(command.output().unwrap())
}

/// Runs a script of the shell as somebody else; `None`, and a word, where this user may not.
fn as_somebody_else(script: &str) -> Option<Output> {
    as_user(SOMEBODY_ELSE, script)
}

fn as_user(user: &str, script: &str) -> Option<Output> {
    if !rustix::process::geteuid().is_root() {
        eprintln!("skipped: only root can be somebody else");
        return None;
    }
    let who = ["--reuid", user, "--regid", user, "--clear-groups", "sh", "-c", script];
    match Command::new("setpriv").args(who).env_remove("XDG_RUNTIME_DIR").output() {
        Ok(output) => Some(output),
        Err(_) => {
            eprintln!("skipped: this machine has no `setpriv`");
            None
        }
    }
}

#[test]
fn all_of_a_swarm_is_for_its_owner_only() {
    let mut swarm = Swarm::start("--agents 3 --p 0.5");
    // Everything is there, and iceoryx2's way of making it is over.
    assert!(swarm.first_line().contains("3 agents"));
    for name in shared_memory(&swarm.tag) {
        let mode = fs::symlink_metadata(Path::new("/dev/shm").join(&name)).unwrap().mode();
        assert_eq!(mode & 0o077, 0, "{name} has mode {mode:o}");
    }
    // Nobody else gets past the first two, whatever iceoryx2 gives the files below.
    let root = root(&swarm.tag);
    for folder in [root.parent().unwrap(), &root] {
        assert_eq!(fs::symlink_metadata(folder).unwrap().mode() & 0o777, 0o700, "{}", folder.display());
    }
}

#[test]
fn somebody_else_cannot_open_list_or_disturb_a_swarm() {
    let mut swarm = Swarm::start("--agents 2 --p 0.5");
    assert!(swarm.first_line().contains("2 agents"));
    let (tag, root) = (swarm.tag.clone(), root(&swarm.tag));
    let segments = shared_memory(&tag);
    assert!(segments.len() > 10);
    // Says what it could do.
    let script = format!(
        "for f in /dev/shm/vs_{tag}_*; do \
           (head -c 1 $f >/dev/null) 2>/dev/null && echo read $f; \
           (echo x >> $f) 2>/dev/null && echo wrote $f; \
           rm -f $f 2>/dev/null && echo removed $f; \
         done; ls {root} 2>/dev/null && echo listed; rm -rf {root} 2>/dev/null; \
         kill -9 {agent} 2>/dev/null && echo killed; true",
        root = root.display(),
        agent = swarm.agents[0].as_raw_nonzero()
    );
    let Some(output) = as_somebody_else(&script) else { return };
    assert_eq!(String::from_utf8_lossy(&output.stdout), "", "{}", stderr(&output));
    // Nor by our own means.
    let folder = tempfile::tempdir().unwrap();
    fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o755)).unwrap();
    let program = folder.path().join("vamaro-swarm");
    fs::copy(PROGRAM, &program).unwrap();
    as_somebody_else(&format!("{} doctor --clean", program.display()));
    assert_eq!(shared_memory(&tag).len(), segments.len());
    assert!(root.exists());
    swarm.signal_supervisor(Signal::INT);
    let (code, _, stderr) = swarm.wait();
    assert_eq!(code, Some(130), "it played on: {stderr}");
    as_somebody_else(&format!("rm -rf /tmp/vamaro-swarm-{SOMEBODY_ELSE}"));
}

#[test]
fn somebody_else_cannot_watch_a_swarm() {
    let mut swarm = Swarm::start("--agents 2");
    swarm.first_line();
    let folder = tempfile::tempdir().unwrap();
    fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o755)).unwrap();
    let program = folder.path().join("vamaro-swarm");
    fs::copy(PROGRAM, &program).unwrap();
    let (program, process) = (program.display(), swarm.supervisor().as_raw_nonzero());
    let Some(output) = as_somebody_else(&format!("{program} top {process}")) else { return };
    let error = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(
        error.contains(&format!("process {process} belongs to user 0, and you are user 65534")),
        "{error}"
    );
    let output = as_somebody_else(&format!("{program} top")).unwrap();
    let error = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(
        error.contains("no swarm of yours is running; those of other users are for them alone"),
        "{error}"
    );
    as_somebody_else(&format!("rm -rf /tmp/vamaro-swarm-{SOMEBODY_ELSE}"));
}

/// In a place of its own: others run swarms as well.
#[test]
fn top_finds_the_swarms_that_there_are() {
    let script = "$P top; echo $?; \
                  mkfifo /tmp/a /tmp/b; \
                  start() { $P spawn $2 --episodes 1000000000 >$1 & exec 3<$1; read line <&3; }; \
                  start /tmp/a '--task hear-see'; a=$!; $P top; echo $?; \
                  exec 4<&3; start /tmp/b '--agents 4'; b=$!; $P top; echo $?; echo $a $b; kill $a $b; wait";
    let Some(output) = with_own_tmp(script) else { return };
    let (stdout, error) = (String::from_utf8_lossy(&output.stdout).into_owned(), stderr(&output));
    let lines: Vec<&str> = stdout.lines().collect();
    assert_eq!(lines[..3], ["2", "2", "2"], "{stdout}{error}");
    assert!(error.contains("no swarm of yours is running; start one"), "{error}");
    // It found the one; there is no terminal here, or none that shows more than lines.
    assert!(error.contains("run top in one"), "{error}");
    assert!(error.contains("2 swarms are running; name the process of one"), "{error}");
    for (process, played) in lines[3].split(' ').zip(["hear-see     2", "spread-xy-4  4"]) {
        let row = error.lines().find(|line| line.trim_start().starts_with(process)).expect(&error);
        assert!(row.contains(played) && row.ends_with(" s"), "{row}");
    }
}

#[test]
fn too_few_processes_are_found_before_the_start() {
    // Nobody else runs anything as this one.
    const LONELY: &str = "65533";
    let folder = tempfile::tempdir().unwrap();
    fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o755)).unwrap();
    let program = folder.path().join("vamaro-swarm");
    fs::copy(PROGRAM, &program).unwrap();
    let with = |limit: u32, words: &str| {
        as_user(LONELY, &format!("exec prlimit --nproc={limit} {} {words}", program.display()))
    };
    let spawn = "spawn --task hear-see --episodes 1";
    // The program itself is one, and has a thread for those who watch.
    let Some(output) = with(6, spawn) else { return };
    let error = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert!(error.contains("2 agents need 5 more processes and threads"), "{error}");
    assert!(error.contains("`ulimit -u 7`"), "{error}");
    assert!(with(7, spawn).unwrap().status.success());
    let doctor = |limit| String::from_utf8(with(limit, "doctor").unwrap().stdout).unwrap();
    assert!(doctor(5).contains("a team of two needs 6"), "{}", doctor(5));
    assert!(doctor(60).contains("the largest team needs 130"), "{}", doctor(60));
    as_user(LONELY, &format!("rm -rf /tmp/vamaro-swarm-{LONELY}"));
}

#[test]
fn a_place_that_somebody_has_prepared_is_refused_with_what_to_do() {
    for prepare in ["mkdir -m 777", "ln -s /mnt", "touch"] {
        let script = format!(
            "{prepare} /tmp/vamaro-swarm-0; for c in doctor 'spawn --episodes 1'; do $P $c; echo $?; done"
        );
        let Some(output) = with_own_tmp(&script) else { return };
        let (stdout, stderr) = (String::from_utf8_lossy(&output.stdout).into_owned(), stderr(&output));
        let codes: Vec<&str> = stdout.lines().filter(|line| line.len() == 1).collect();
        assert_eq!(codes, ["1", "1"], "{prepare}: {stdout}{stderr}");
        assert!(
            stderr.contains("/tmp/vamaro-swarm-0") && stderr.contains("XDG_RUNTIME_DIR"),
            "{prepare}: {stderr}"
        );
    }
    // With a folder of one's own nobody is in the way.
    let script = "mkdir -m 777 /tmp/vamaro-swarm-0; mkdir -m 700 /tmp/own; export XDG_RUNTIME_DIR=/tmp/own; \
                  $P spawn --episodes 1 >/dev/null && $P doctor && stat -c %a /tmp/own/vamaro-swarm && ls /tmp/own/vamaro-swarm";
    let Some(output) = with_own_tmp(script) else { return };
    let stdout = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(stdout.contains("in /tmp/own/vamaro-swarm\n"), "{stdout}{}", stderr(&output));
    assert!(stdout.ends_with("This machine is ready.\n700\n"), "nothing is left: {stdout}");
}

#[test]
fn a_runtime_folder_that_is_unfit_is_said_and_left_out() {
    let long = "x".repeat(60);
    let script = format!(
        "mkdir -m 777 /tmp/open; mkdir -m 700 /tmp/{long}; for d in /tmp/open /tmp/{long} /tmp/none run; do \
         XDG_RUNTIME_DIR=$d $P doctor --json | grep XDG; XDG_RUNTIME_DIR=$d $P spawn --episodes 1 >/dev/null; echo $?; done"
    );
    let Some(output) = with_own_tmp(&script) else { return };
    let stdout = String::from_utf8_lossy(&output.stdout).into_owned();
    for part in ["others may write to", "too long for a socket", "cannot be used", "no absolute path"] {
        assert!(stdout.contains(part), "{part}: {stdout}{}", stderr(&output));
    }
    assert_eq!(stdout.lines().filter(|line| *line == "0").count(), 4, "{stdout}");
}

#[test]
fn leftovers_are_found_wherever_a_swarm_was() {
    let script = "mkdir -m 700 /tmp/own; export XDG_RUNTIME_DIR=/tmp/own; \
                  for d in own/vamaro-swarm vamaro-swarm-0; do mkdir -p -m 700 /tmp/$d; mkdir /tmp/$d/0badf00d; done; \
                  $P doctor --clean | grep dead; ls /tmp/own/vamaro-swarm /tmp/vamaro-swarm-0 | grep 0badf00d";
    let Some(output) = with_own_tmp(script) else { return };
    let stdout = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        stdout.contains("removed what was left of 1 dead swarm") && !stdout.contains("0badf00d"),
        "{stdout}"
    );
}

#[test]
fn a_pipe_with_the_name_of_a_lock_makes_nobody_wait() {
    struct Removed(PathBuf);
    impl Drop for Removed {
        fn drop(&mut self) {
            let _ = fs::remove_file(&self.0);
        }
    }
    let path = Removed(PathBuf::from("/dev/shm/vs_0dd1eaf5_lock"));
    let made = Command::new("mkfifo").arg(&path.0).status().unwrap();
    assert!(made.success());
    for words in ["doctor", "spawn --episodes 1"] {
        let mut command = Command::new("timeout");
        let status =
            command.args(["20", PROGRAM]).args(words.split(' ')).stdout(Stdio::null()).status().unwrap();
        assert!(status.success(), "{words}: {status}");
    }
    assert!(!path.0.exists(), "it is a leftover like others");
}
