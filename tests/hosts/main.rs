//! Swarms over several hosts: on loopback, and in network namespaces where there is root.

#[path = "../common/mod.rs"]
mod common;

mod bad_network;
mod campaign;
mod clock;
mod namespaces;
mod network;
mod relay;
mod strangers;

use std::fs::Permissions;
use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rustix::fs::{CWD, FileType, Mode, mknodat};
use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;

use common::{PROGRAM, await_sleeps, children, fail, is_running, shared_memory, stderr, succeed};

/// Has one test at a time run: each has processes enough for the machine.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A host on this machine, with a folder of its own for its swarms.
pub struct Host {
    name: String,
    at: String,
    /// What the plan of a supervisor has to say, too, for all hosts.
    top: String,
    process: Child,
    places: TempDir,
}

impl Host {
    /// Starts one on loopback, and waits until it listens.
    fn start(name: &str, more: &[&str]) -> Host {
        Host::start_by(|| Command::new(PROGRAM), name, more)
    }

    /// The same, by some command.
    fn start_by(command: impl Fn() -> Command, name: &str, more: &[&str]) -> Host {
        // Somebody else may get the port in between.
        let attempt = |_| {
            let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
            Host::start_at(command(), name, &format!("tcp/127.0.0.1:{port}"), more).ok()
        };
        (0..5).find_map(attempt).expect("it can listen at one of five ports")
    }

    /// Starts one at an address; what it says if it cannot listen there.
    fn start_at(mut command: Command, name: &str, at: &str, more: &[&str]) -> Result<Host, String> {
        let places = tempfile::Builder::new().prefix("vs-").tempdir_in("/tmp").unwrap();
        command.args(["host", "--listen", at]).args(more).env("XDG_RUNTIME_DIR", places.path());
        let mut process = command.stderr(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(process.stderr.take().unwrap()).lines();
        let first = lines.next().expect("a host says that it listens").unwrap();
        if !first.contains("listening") {
            process.wait().unwrap();
            return Err(first);
        }
        // Its words would fill the pipe.
        std::thread::spawn(move || lines.for_each(drop));
        Ok(Host { name: name.to_owned(), at: at.to_owned(), top: String::new(), process, places })
    }

    fn pid(&self) -> Pid {
        Pid::from_child(&self.process)
    }

    /// The tags of the swarms it is part of, or has left behind.
    fn swarms(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.places.path().join("vamaro-swarm")).into_iter().flatten();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    /// Waits until nothing of any swarm is here.
    fn assert_empty(&self) {
        let deadline = Instant::now() + Duration::from_secs(30);
        loop {
            let swarms = self.swarms();
            if swarms.is_empty() && children(self.process.id()).is_empty() {
                return;
            }
            assert!(Instant::now() < deadline, "{} still has {swarms:?}", self.name);
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Kills it, without a chance to clean up.
    fn kill(&self) {
        kill_process(self.pid(), Signal::KILL).unwrap();
    }

    /// Removes what it has left behind after it was killed.
    fn clean(&self) {
        let tags = self.swarms();
        assert!(!tags.is_empty() && tags.iter().any(|tag| !shared_memory(tag).is_empty()));
        let mut doctor = common::command("doctor --clean");
        assert!(doctor.env("XDG_RUNTIME_DIR", self.places.path()).output().is_ok());
        self.assert_empty();
        assert!(tags.iter().all(|tag| shared_memory(tag).is_empty()));
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        for signal in [Signal::TERM, Signal::CONT] {
            let _ = kill_process(self.pid(), signal);
        }
        let _ = self.process.wait();
    }
}

/// A key in a folder, whose secret is so many times the same letter.
fn key(folder: &Path, name: &str, letter: char) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, format!("swarm:{}\n", String::from(letter).repeat(32))).unwrap();
    std::fs::set_permissions(&path, Permissions::from_mode(0o600)).unwrap();
    path
}

/// A file for `--hosts`, in a folder.
fn plan(folder: &Path, hosts: &[&Host], rest: &str) -> PathBuf {
    let entry = |host: &&Host| format!("[[host]]\nname = \"{}\"\nat = \"{}\"\n", host.name, host.at);
    let top = hosts.first().map_or(String::new(), |host| host.top.clone());
    let path = folder.join("hosts.toml");
    std::fs::write(&path, top + &hosts.iter().map(entry).collect::<String>() + rest).unwrap();
    path
}

/// Plays the same on one machine and over these hosts, and compares all that was recorded.
fn assert_same_bits(hosts: &[&Host], words: &str, rest: &str) {
    let folder = tempfile::tempdir().unwrap();
    let (here, there) = (folder.path().join("here.json"), folder.path().join("there.json"));
    let plan = plan(folder.path(), hosts, rest);
    let episodes = if words.contains("--episodes") { "" } else { "--episodes 3" };
    let words = format!("spawn {episodes} --seed 5 --audit --deadline 60s {words} --record");
    succeed(&format!("{words} {}", here.display()));
    succeed(&format!("{words} {} --hosts {}", there.display(), plan.display()));
    let [here, there] = [here, there].map(|path| std::fs::read(path).unwrap());
    assert!(here == there, "{words}: the traces differ");
    hosts.iter().for_each(|host| host.assert_empty());
}

#[test]
fn hosts_play_as_one_machine_does() {
    let _alone = alone();
    let (left, right, third) =
        (Host::start("left", &[]), Host::start("right", &[]), Host::start("third", &[]));
    assert_same_bits(&[&left, &right], "--task hear-see --p 0.6 --imputer hold --worlds 2", "");
    assert_same_bits(&[&left, &right], "--agents 4 --links gilbert(0.2,0.4)+delay(1,1)", "");
    assert_same_bits(&[&left], "--agents 4 --p 0.5 --relay", "agents = [1]\n");
    assert_same_bits(&[&left], "--agents 4 --p 0.5", "");
    let many = "--task spread-xy --agents 12 --policy untrained --p 0.5";
    assert_same_bits(&[&left, &right, &third], many, "");
}

#[test]
fn the_engine_divides_its_work_among_threads_as_we_say_unless_the_user_does() {
    let _alone = alone();
    const NAME: &str = "ZENOH_RUNTIME";
    let command = |environment: &[&str]| {
        let mut command = Command::new(PROGRAM);
        command.env_remove(NAME).envs(environment.iter().map(|threads| (NAME, threads)));
        command
    };
    let ours = Host::start_by(|| command(&[]), "ours", &[]);
    let theirs = Host::start_by(|| command(&["(rx: (worker_threads: 1))"]), "theirs", &[]);
    let (hosts, folder) = ([&ours, &theirs], tempfile::tempdir().unwrap());
    let supervisor = play(&plan(folder.path(), &hosts, ""), &hosts, "--task hear-see");
    let receive_only = hosts.map(|host| {
        let threads = std::fs::read_dir(format!("/proc/{}/task", host.process.id())).unwrap();
        let name = |thread: PathBuf| std::fs::read_to_string(thread.join("comm")).unwrap_or_default();
        threads.filter(|thread| name(thread.as_ref().unwrap().path()).starts_with("rx-")).count()
    });
    assert_eq!(receive_only, [0, 1]);
    assert_eq!(end(supervisor).0, Some(130));
}

#[test]
fn a_host_that_dies_is_agents_that_die() {
    let _alone = alone();
    let (left, right, folder) =
        (Host::start("left", &[]), Host::start("right", &[]), tempfile::tempdir().unwrap());
    let plan = plan(folder.path(), &[&left, &right], "");
    let words = "--agents 4 --on-failure continue";
    // The supervisor is killed: the hosts notice, and are there for the next.
    let mut supervisor = play(&plan, &[&left, &right], words);
    supervisor.kill().unwrap();
    supervisor.wait().unwrap();
    left.assert_empty();
    right.assert_empty();
    // A host is killed: the others play on without it.
    let supervisor = play(&plan, &[&left, &right], words);
    let agents = children(right.process.id());
    right.kill();
    await_sleeps(children(left.process.id())[0], 50);
    assert!(agents.iter().all(|agent| !is_running(*agent)));
    let (code, said) = end(supervisor);
    assert_eq!(code, Some(130), "{said}");
    left.assert_empty();
    // It is missed at the next start.
    let words = format!("spawn --agents 4 --hosts {}", plan.display());
    fail(&words, 1, &["host right", &right.at, "cannot be reached"]);
    left.assert_empty();
    right.clean();
}

#[test]
fn a_host_that_is_silent_is_lost_and_free_again_later() {
    let _alone = alone();
    let (left, right, folder) =
        (Host::start("left", &[]), Host::start("right", &[]), tempfile::tempdir().unwrap());
    let plan = plan(folder.path(), &[&left, &right], "");
    let supervisor = play(&plan, &[&left, &right], "--agents 4 --on-failure continue");
    kill_process(right.pid(), Signal::STOP).unwrap();
    // A tick waits for it until then: the others play on.
    await_sleeps(children(left.process.id())[0], 50);
    kill_process(right.pid(), Signal::CONT).unwrap();
    right.assert_empty();
    let (code, said) = end(supervisor);
    assert_eq!(code, Some(130), "{said}");
    left.assert_empty();
    succeed(&format!("spawn --agents 4 --episodes 1 --deadline 60s --hosts {}", plan.display()));
}

#[test]
fn who_dies_on_a_host_is_started_anew_there() {
    let _alone = alone();
    let (host, folder) = (Host::start("left", &[]), tempfile::tempdir().unwrap());
    let plan = plan(folder.path(), &[&host], "");
    let supervisor = play(&plan, &[&host], "--agents 4 --on-failure restart");
    let before = children(host.process.id());
    kill_process(before[0], Signal::KILL).unwrap();
    let deadline = Instant::now() + Duration::from_secs(60);
    let newcomer = loop {
        if let Some(newcomer) = children(host.process.id()).into_iter().find(|pid| !before.contains(pid)) {
            break newcomer;
        }
        assert!(Instant::now() < deadline, "nobody is started");
        std::thread::sleep(Duration::from_millis(5));
    };
    await_sleeps(newcomer, 20);
    let (code, said) = end(supervisor);
    assert_eq!(code, Some(130), "{said}");
    host.assert_empty();
}

#[test]
fn a_host_is_free_again_if_another_refuses() {
    let _alone = alone();
    let (left, right, folder) =
        (Host::start("left", &[]), Host::start("right", &[]), tempfile::tempdir().unwrap());
    let busy = play(&plan(folder.path(), &[&right], ""), &[&right], "--agents 4");
    let both = plan(folder.path(), &[&left, &right], "");
    fail(&format!("spawn --agents 4 --hosts {}", both.display()), 1, &["host right", "another swarm"]);
    left.assert_empty();
    let one = plan(folder.path(), &[&left], "");
    succeed(&format!("spawn --agents 4 --episodes 1 --deadline 60s --hosts {}", one.display()));
    assert_eq!(end(busy).0, Some(130));
}

#[test]
fn only_who_has_the_key_gets_in() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let (right, _wrong) = (key(folder.path(), "right.key", 'a'), key(folder.path(), "wrong.key", 'b'));
    let host = Host::start("left", &["--key", right.to_str().unwrap()]);
    let play = |key: &str| {
        let plan = plan(folder.path(), &[&host], "");
        std::fs::write(&plan, key.to_owned() + &std::fs::read_to_string(&plan).unwrap()).unwrap();
        format!("spawn --task hear-see --episodes 2 --deadline 60s --hosts {}", plan.display())
    };
    fail(&play(""), 1, &["host left", "does not let us in", "key"]);
    fail(&play("key = \"wrong.key\"\n"), 1, &["host left", "does not let us in", "key"]);
    assert!(succeed(&play("key = \"right.key\"\n")).contains("return"));
}

#[test]
fn hops_and_ticks_over_hosts_are_measured() {
    let _alone = alone();
    let (left, right, folder) =
        (Host::start("left", &[]), Host::start("right", &[]), tempfile::tempdir().unwrap());
    let plan = plan(folder.path(), &[&left, &right], "");
    let words = format!("bench latency --agents 2 --seconds 0.1 --json --hosts {}", plan.display());
    let measured: serde_json::Value = serde_json::from_str(&succeed(&words)).unwrap();
    let hops = measured["hops"].as_array().unwrap();
    let ways = hops.iter().map(|hop| {
        assert!(hop["hop"]["count"].as_u64() > Some(0) && hop["payload"] == 120, "{hop}");
        (hop["host"].as_str().unwrap(), hop["medium"].as_str().unwrap())
    });
    let all = ["left", "right"].map(|host| ["line", "zenoh", "udp"].map(|way| (host, way)));
    assert_eq!(ways.collect::<Vec<_>>(), all.concat());
    let tick = &measured["ticks"][0];
    assert!(tick["hosts"] == 2 && tick["policy_ms"].as_f64() > Some(0.0), "{tick}");
    // Two each there and back; one that was slow may have had a frame of its own.
    assert!((8.0..10.0).contains(&tick["frames"].as_f64().unwrap()), "{tick}");
    left.assert_empty();
    right.assert_empty();
}

#[test]
fn what_cannot_be_is_said_by_name() {
    let _alone = alone();
    let (host, folder) = (Host::start("left", &[]), tempfile::tempdir().unwrap());
    let plan = plan(folder.path(), &[&host], "");
    fail("host --listen tcp/0.0.0.0:7447", 2, &["--key"]);
    let far = folder.path().join("far.toml");
    std::fs::write(&far, "[[host]]\nname = \"far\"\nat = \"tcp/192.0.2.1:7447\"\n").unwrap();
    fail(&format!("spawn --hosts {}", far.display()), 2, &["host far", "no key"]);
    let pipe = folder.path().join("pipe");
    mknodat(CWD, &pipe, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
    fail(&format!("spawn --hosts {}", pipe.display()), 1, &["pipe", "name a regular file"]);
    fail(&format!("host --key {}", pipe.display()), 1, &["pipe", "name a regular file"]);
    fail("host --listen 127.0.0.1", 2, &["tcp/192.168.1.11:7447"]);
    fail(&format!("host --listen {}", host.at), 1, &["cannot listen", &host.at]);
    fail(&format!("spawn --hosts {} --wait spin", plan.display()), 2, &["--wait block"]);
    let busy = play(&plan, &[&host], "--agents 4");
    fail(&format!("spawn --hosts {}", plan.display()), 1, &["host left", "another swarm"]);
    assert_eq!(end(busy).0, Some(130));
    host.assert_empty();
}

/// Plays for long; returns once each of these hosts does.
fn play(plan: &Path, hosts: &[&Host], words: &str) -> Child {
    let mut command = common::command(&format!("spawn --episodes 10000000 --deadline 60s {words}"));
    command.arg("--hosts").arg(plan).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut supervisor = command.spawn().unwrap();
    // It says what it plays when all agents are ready.
    let first = BufReader::new(supervisor.stdout.take().unwrap()).lines().next();
    assert!(first.is_some_and(|line| line.unwrap().contains("agents")));
    hosts.iter().for_each(|host| await_sleeps(children(host.process.id())[0], 20));
    supervisor
}

/// Has a supervisor end; its exit code, and what it said.
fn end(supervisor: Child) -> (Option<i32>, String) {
    // Not SIGINT: what a script starts in the background ignores that.
    kill_process(Pid::from_child(&supervisor), Signal::TERM).unwrap();
    let output = await_end(supervisor);
    (output.status.code(), stderr(&output))
}

/// Waits for a supervisor to end.
fn await_end(mut supervisor: Child) -> Output {
    let deadline = Instant::now() + Duration::from_secs(120);
    while supervisor.try_wait().unwrap().is_none() {
        if Instant::now() > deadline {
            supervisor.kill().unwrap();
            panic!("the supervisor does not end: {}", stderr(&supervisor.wait_with_output().unwrap()));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    supervisor.wait_with_output().unwrap()
}
