//! Running the real binary.
#![allow(dead_code)] // Each test binary uses its part.

pub mod acting;
pub mod training;

use std::io::{PipeReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use rustix::fs::{OFlags, fcntl_setfl};
use rustix::process::{Pid, Signal, kill_process};
use vamaro_swarm::supervisor::{AgentCommand, Processes};

/// The program under test.
pub const PROGRAM: &str = env!("CARGO_BIN_EXE_vamaro-swarm");

/// A command of the program, its words separated by blanks.
pub fn command(words: &str) -> Command {
    let mut command = Command::new(PROGRAM);
    command.args(words.split_whitespace()).env_remove("IOX2_LOG_LEVEL");
    command
}

/// Runs a command to its end.
pub fn run(words: &str) -> Output {
    command(words).output().expect("the program starts")
}

/// Runs a command that must succeed; what it wrote to stdout.
pub fn succeed(words: &str) -> String {
    let output = run(words);
    assert!(output.status.success(), "{words}: {}", stderr(&output));
    String::from_utf8(output.stdout).expect("output is text")
}

/// Runs a command that must fail with this exit code, saying all of `saying` in one error on stderr.
pub fn fail(words: &str, code: i32, saying: &[&str]) {
    let output = run(words);
    let stderr = stderr(&output);
    assert_eq!(output.status.code(), Some(code), "{words}: {stderr}");
    assert_eq!(stderr.matches("error: ").count(), 1, "{words}: {stderr}");
    assert!(!stderr.contains("panicked"), "{words}: {stderr}");
    for part in saying {
        assert!(stderr.contains(part), "{words}: `{part}` is not in: {stderr}");
    }
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The command for agents of a test binary whose swarms are its own: the binary itself. The words of the command,
/// `--exact agent <settings>`, have its harness run the test `agent` of its main file and no other. That calls
/// `run_if_agent`.
pub fn this_binary() -> AgentCommand {
    AgentCommand::new("/proc/self/exe").word("--exact")
}

/// The agents of a swarm of this process, and its tag.
pub fn swarm_of(team: &Processes) -> (Vec<Pid>, String) {
    let agents: Vec<Pid> = team.process_ids().filter_map(|id| Pid::from_raw(id as i32)).collect();
    let settings = settings_of(agents[0]).expect("an agent that is ready has read its settings");
    (agents, settings["address"]["tag"].as_str().unwrap().to_owned())
}

/// A file of the test data.
pub fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// A swarm of processes that is playing. Dropping it ends it.
pub struct Swarm {
    supervisor: Option<Child>,
    pub agents: Vec<Pid>,
    pub tag: String,
}

impl Swarm {
    /// Starts a swarm and waits until its agents listen. It plays for long unless `words` say otherwise.
    pub fn start(words: &str) -> Swarm {
        let episodes = if words.contains("--episodes") { "" } else { "--episodes 10000000" };
        Swarm::of(&format!("spawn {episodes} {words}"))
    }

    /// Starts a command that runs a swarm, and waits until its agents listen.
    pub fn of(words: &str) -> Swarm {
        Swarm::writing_to(Stdio::piped(), words)
    }

    fn writing_to(stdout: Stdio, words: &str) -> Swarm {
        let supervisor = command(words).stdout(stdout).stderr(Stdio::piped()).spawn().unwrap();
        let process = supervisor.id();
        let mut swarm = Swarm { supervisor: Some(supervisor), agents: Vec::new(), tag: String::new() };
        let deadline = Instant::now() + Duration::from_secs(30);
        while Instant::now() < deadline {
            swarm.agents = children(process);
            if let Some(settings) = swarm.agents.first().and_then(|agent| settings_of(*agent)) {
                let address = &settings["address"];
                swarm.tag = address["tag"].as_str().unwrap().to_owned();
                let team = address["agents"].as_u64().unwrap() as usize;
                // One socket for the supervisor, and one for each agent once it listens.
                if swarm.agents.len() == team && sockets(&swarm.tag) > team {
                    return swarm;
                }
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        panic!("the swarm does not start: {words}");
    }

    /// The supervisor's process id, which is that of its main thread.
    pub fn supervisor(&self) -> Pid {
        Pid::from_child(self.supervisor.as_ref().unwrap())
    }

    pub fn signal_supervisor(&self, signal: Signal) {
        kill_process(self.supervisor(), signal).unwrap();
    }

    /// The first line on stdout: it is written when all processes are ready. The rest stays to be read.
    pub fn first_line(&mut self) -> String {
        let stdout = self.supervisor.as_mut().unwrap().stdout.as_mut().unwrap();
        let (mut line, mut byte) = (Vec::new(), [0]);
        while stdout.read(&mut byte).unwrap() == 1 && byte != *b"\n" {
            line.extend(byte);
        }
        String::from_utf8(line).unwrap()
    }

    /// Waits for the supervisor to end; its exit code, stdout and stderr.
    pub fn wait(mut self) -> (Option<i32>, String, String) {
        let deadline = Instant::now() + Duration::from_secs(60);
        while self.supervisor.as_mut().unwrap().try_wait().unwrap().is_none() {
            assert!(Instant::now() < deadline, "the supervisor does not end");
            std::thread::sleep(Duration::from_millis(5));
        }
        let output = self.supervisor.take().unwrap().wait_with_output().unwrap();
        (output.status.code(), String::from_utf8_lossy(&output.stdout).into_owned(), stderr(&output))
    }
}

impl Drop for Swarm {
    fn drop(&mut self) {
        if let Some(mut supervisor) = self.supervisor.take() {
            let _ = supervisor.kill();
            let _ = supervisor.wait();
        }
    }
}

/// A swarm held before its first tick: its pipe is full, so its supervisor waits with the first line.
pub struct HeldSwarm {
    pub swarm: Swarm,
    stdout: PipeReader,
    filling: Vec<u8>,
}

impl HeldSwarm {
    /// Starts a swarm that will play what `words` say, and waits until its agents listen.
    pub fn start(words: &str) -> HeldSwarm {
        let (stdout, mut full) = std::io::pipe().unwrap();
        let mut filling = Vec::new();
        fcntl_setfl(&full, OFlags::NONBLOCK).unwrap();
        while let Ok(written) = full.write(&[0; 4096]) {
            filling.resize(filling.len() + written, 0);
        }
        fcntl_setfl(&full, OFlags::empty()).unwrap();
        HeldSwarm { swarm: Swarm::writing_to(full.into(), &format!("spawn {words}")), stdout, filling }
    }

    /// Lets the swarm play.
    pub fn let_go(&mut self) {
        self.stdout.read_exact(&mut self.filling).unwrap();
    }

    /// Waits for the supervisor to end; its exit code and stderr.
    pub fn wait(self) -> (Option<i32>, String) {
        let (code, _, stderr) = self.swarm.wait();
        (code, stderr)
    }
}

/// Whether this process, and so every program it starts, was told to ignore a signal.
pub fn is_ignored(signal: Signal) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:")).unwrap();
    u64::from_str_radix(mask.trim(), 16).unwrap() >> (signal.as_raw() - 1) & 1 == 1
}

/// Fails if anything of a swarm is still on the machine.
pub fn assert_gone(agents: &[Pid], tag: &str) {
    for agent in agents {
        assert!(!is_running(*agent), "agent {agent:?} is still there");
    }
    assert_eq!(shared_memory(tag), Vec::<String>::new());
    assert!(!root(tag).exists(), "{} is still there", root(tag).display());
}

/// Whether a process is there and has not ended; one that only waits to be reaped has.
pub fn is_running(process: Pid) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", process.as_raw_nonzero()));
    stat.is_ok_and(|stat| !stat.contains(") Z "))
}

/// Fails if a process with such a command line, a pattern of `pgrep`, is still there. What was killed may take a moment.
pub fn assert_no_process(pattern: &str) {
    let deadline = Instant::now() + Duration::from_secs(10);
    loop {
        let Ok(found) = Command::new("pgrep").args(["-f", pattern]).output() else {
            return eprintln!("skipped: this machine has no `pgrep`");
        };
        let found = String::from_utf8_lossy(&found.stdout);
        if found.is_empty() {
            return;
        }
        assert!(Instant::now() < deadline, "`{pattern}` is still there: {found}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// A line of `/proc/PID/status`.
pub fn status(process: Pid, name: &str) -> String {
    let text = std::fs::read_to_string(format!("/proc/{}/status", process.as_raw_nonzero())).unwrap();
    let value = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':')).unwrap();
    value.trim().to_owned()
}

/// Waits until a process has slept so many times from now on.
pub fn await_sleeps(process: Pid, times: usize) {
    let sleeps = || status(process, "voluntary_ctxt_switches").parse::<usize>().unwrap();
    let (before, deadline) = (sleeps(), Instant::now() + Duration::from_secs(30));
    while sleeps() < before + times {
        assert!(Instant::now() < deadline, "it does not play");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// The directory of a swarm.
pub fn root(tag: &str) -> PathBuf {
    let user = rustix::process::geteuid().as_raw();
    let runtime =
        std::env::var_os("XDG_RUNTIME_DIR").map(|folder| Path::new(&folder).join("vamaro-swarm").join(tag));
    let in_tmp = PathBuf::from(format!("/tmp/vamaro-swarm-{user}")).join(tag);
    runtime.filter(|root| root.exists()).unwrap_or(in_tmp)
}

/// The names of a swarm's shared memory, that of its guests included.
pub fn shared_memory(tag: &str) -> Vec<String> {
    let names = std::fs::read_dir("/dev/shm").unwrap().filter_map(|e| e.ok()?.file_name().into_string().ok());
    names.filter(|name| name.starts_with(&format!("vs_{tag}"))).collect()
}

fn sockets(tag: &str) -> usize {
    let entries = std::fs::read_dir(root(tag)).into_iter().flatten().flatten();
    entries.filter(|entry| entry.file_name().to_string_lossy().ends_with(".event")).count()
}

/// The processes that any thread of this one has started.
pub fn children(process: u32) -> Vec<Pid> {
    let threads = std::fs::read_dir(format!("/proc/{process}/task")).into_iter().flatten().flatten();
    let texts = threads.filter_map(|thread| std::fs::read_to_string(thread.path().join("children")).ok());
    let pids = texts.collect::<Vec<String>>().join(" ");
    pids.split_whitespace().filter_map(|pid| Pid::from_raw(pid.parse().ok()?)).collect()
}

/// The settings an agent was started with: its last word, unless it is still the process that starts it.
pub fn settings_of(agent: Pid) -> Option<serde_json::Value> {
    let line = std::fs::read(format!("/proc/{}/cmdline", agent.as_raw_nonzero())).ok()?;
    // Each word ends with a zero, so nothing is behind the last one.
    let settings = serde_json::from_slice(line.split(|byte| *byte == 0).rev().nth(1)?).ok();
    settings.filter(serde_json::Value::is_object)
}
