//! Bad input through the real binary: one clear message, the right exit code, nothing half-written.

use std::path::PathBuf;

use crate::common::{self, data, fail, run, succeed};

/// A folder with a policy file for hear-see.
fn with_policy() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("policy.safetensors");
    let imported = data("traces/hear-see/policy.safetensors");
    std::fs::copy(imported, &path).unwrap();
    (folder, path)
}

/// Runs `spawn` with a policy file of these bytes.
fn fail_with_policy(bytes: &[u8], code: i32, saying: &[&str]) {
    let (_folder, path) = with_policy();
    std::fs::write(&path, bytes).unwrap();
    fail(&format!("spawn --task hear-see --policy {}", path.display()), code, saying);
}

#[test]
fn numbers_out_of_range() {
    for p in ["1.5", "-0.1", "nan", "inf", "often"] {
        fail(&format!("spawn --p={p}"), 2, &["--p"]);
        fail(&format!("spawn --drop={p}"), 2, &["--drop"]);
    }
    for words in ["--agents 0", "--agents -1", "--episodes 0", "--worlds 0", "--worlds 5000", "--seed -1"] {
        fail(&format!("spawn {words}"), 2, &[]);
    }
}

#[test]
fn requests_that_make_no_sense() {
    fail("spawn --p 0.2 --drop 0.8", 2, &["--drop"]);
    fail("spawn --task hear-sea", 2, &["hear-sea", "hear-see"]);
    fail("spawn --task spread-xy-3", 2, &["even"]);
    fail("spawn --agents 5", 2, &["2, 3, 4, 6, 8 and 12", "spread-blindfold-5"]);
    fail("spawn --task hear-see --agents 3", 2, &["2 agents", "spread-blindfold"]);
    fail("spawn --task hear-see --agents 65", 2, &["1 to 64"]);
    fail("spawn --agents 65", 2, &["1 to 64"]);
    fail(
        "spawn --task spread-blindfold-5",
        2,
        &["no built-in policy for spread-blindfold-5", "--policy untrained"],
    );
    fail("spawn --imputer clairvoyant", 2, &["clairvoyant", "value-aware", "hold"]);
    fail("spawn --links sometimes", 2, &["uniform, asymmetric, dynamic"]);
    fail("spawn --links unifrom", 2, &["nearest is `uniform`"]);
    fail("spawn --links delay(101)", 2, &["ticks: `101` is not a whole number of ticks from 0 to 100"]);
    fail("spawn --links delay(60)+delay(60)", 2, &["up to 120 ticks", "kept for 100"]);
    fail("spawn --links level(2)", 2, &["p: `2` is not a probability from 0 to 1", "level(p)"]);
    fail(
        "spawn --links budget(31)",
        2,
        &["bytes = 31 is less than a message of this team has, 32", "32, 64"],
    );
    fail("spawn --links jam(9,9)", 2, &["until must be above from = 9"]);
    fail("spawn --links gilbert(loss=0.8,burst=2)", 2, &["burst must be at least loss / (1 - loss) = 4"]);
    fail("spawn --links range(-1)", 2, &["max: `-1` is not a number of metres from 0 to 1000000"]);
    fail("spawn --links level(0.5)+", 2, &["a model of links is missing"]);
    fail("spawn --in-process --wait spin", 2, &["--wait"]);
    fail("frobnicate", 2, &["frobnicate"]);
}

#[test]
fn communication_matrices() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("links.txt");
    for (text, says) in [
        ("1 0.5\n0.5 1\n", "4 agents need 4 rows"),
        ("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0\n", "row 3 has 3 entries"),
        ("1 0 0 7\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", "row 0, column 3"),
        ("1 0 0 x\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", "`x` is not a number"),
        ("0 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", "diagonal"),
    ] {
        std::fs::write(&path, text).unwrap();
        fail(&format!("spawn --agents 4 --links {}", path.display()), 2, &[says, "links.txt"]);
    }
    std::fs::write(&path, "1 0\n1 1\n").unwrap();
    let text = succeed(&format!("spawn --agents 2 --episodes 5 --links {}", path.display()));
    assert!(text.contains("delivered   50.00 %"), "one of two links is up: {text}");
}

#[test]
fn policies_that_are_none() {
    fail("spawn --policy no/such/file", 2, &["no/such/file"]);
    let (folder, path) = with_policy();
    succeed(&format!("spawn --task hear-see --episodes 1 --policy {}", folder.path().display()));
    let good = std::fs::read(&path).unwrap();
    fail(&format!("spawn --task SXY-4 --policy {}", path.display()), 2, &["hear-see", "spread-xy-4"]);
    fail_with_policy(b"", 1, &["policy.safetensors"]);
    fail_with_policy(&good[..good.len() / 2], 1, &["policy.safetensors"]);
    fail_with_policy(&good[..100], 1, &["policy.safetensors"]);
    fail_with_policy(b"this is no policy at all, but it is long enough to look for a header", 1, &[]);
    let mut huge_header = good.clone();
    huge_header[..8].fill(0xff);
    fail_with_policy(&huge_header, 1, &[]);
    let mut not_a_number = good.clone();
    let end = not_a_number.len();
    not_a_number[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    fail_with_policy(&not_a_number, 1, &["NaN"]);
}

#[test]
fn a_record_path_that_cannot_be_written() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing/trace.json");
    fail(&format!("spawn --episodes 1 --record {}", missing.display()), 1, &["trace.json"]);
    fail(&format!("spawn --episodes 1 --record {}", folder.path().display()), 1, &["folder"]);
}

#[test]
fn what_is_no_file_is_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let socket = folder.path().join("socket");
    let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
    fail(&format!("spawn --episodes 1 --record {}", socket.display()), 1, &["device, pipe, socket"]);
    assert!(!socket.metadata().unwrap().is_file());
}

#[test]
fn a_policy_in_a_folder_whose_name_is_no_text() {
    use std::os::unix::ffi::OsStrExt;
    let (folder, path) = with_policy();
    let odd = folder.path().join(std::ffi::OsStr::from_bytes(b"b\xff"));
    std::fs::create_dir(&odd).unwrap();
    std::fs::rename(path, odd.join("policy.safetensors")).unwrap();
    let mut command = common::command("spawn --policy policy.safetensors --episodes 1");
    let output = command.current_dir(&odd).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", common::stderr(&output));
}

#[test]
fn an_interrupted_recording_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trace.json");
    let swarm = common::Swarm::start(&format!("--agents 2 --record {}", path.display()));
    swarm.signal_supervisor(rustix::process::Signal::TERM);
    assert_eq!(swarm.wait().0, Some(130));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn imputers_that_need_dynamics_are_refused_before_anything_starts() {
    for words in [
        "spawn --policy untrained --imputer dynamics",
        "spawn --policy untrained --imputer kalman(hold)",
        "spawn --policy untrained --imputer teammates --in-process",
        "evaluate untrained --task hear-see --imputers dynamics --levels 1",
    ] {
        fail(words, 2, &["holds no dynamics of hear-see", "vamaro-swarm fit"]);
    }
}

#[test]
fn links_without_a_name() {
    for words in ["spawn --links=", "evaluate builtin --task hear-see --links="] {
        fail(words, 2, &["a model of links is missing; there are level(p)"]);
    }
}

#[test]
fn shared_memory_that_is_too_small() {
    // In a mount namespace of its own, with a /dev/shm of 64 KiB.
    let script = format!("mount -t tmpfs -o size=64k tmpfs /dev/shm && exec {} spawn", common::PROGRAM);
    let output = std::process::Command::new("unshare").args(["-rm", "sh", "-c", &script]).output();
    let Ok(output) = output else { return eprintln!("skipped: this machine has no `unshare`") };
    let stderr = common::stderr(&output);
    if !stderr.contains("error: ") {
        return eprintln!("skipped: this machine allows no mount namespaces: {stderr}");
    }
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    for part in ["/dev/shm", "too small", "--worlds", "doctor"] {
        assert!(stderr.contains(part), "{stderr}");
    }
}

#[test]
fn importing_what_is_no_state_dict() {
    let folder = tempfile::tempdir().unwrap();
    let (actors, out) = (folder.path().join("agent.th"), folder.path().join("policy.safetensors"));
    let import = format!("import {} --task hear-see --out {}", actors.display(), out.display());
    fail(&import, 2, &["agent.th"]);
    for bytes in [&b""[..], b"PK\x03\x04 but no more", &[7; 5000]] {
        std::fs::write(&actors, bytes).unwrap();
        fail(&import, 1, &["agent.th"]);
        assert!(!out.exists());
    }
    std::fs::copy(data("import/network.th"), &actors).unwrap();
    fail(&import, 1, &["agent.th", "agents.0.fc1.bias"]);
    // Files do not say what trained them.
    let help = succeed("import --help");
    assert!(help.split_whitespace().collect::<Vec<_>>().join(" ").contains("do not say [default: unknown]"));
    fail("import x.th --task no-such-task", 2, &["no-such-task"]);
    fail("import x.th --task SL --predictor value-aware", 2, &["NAME=FILE"]);
    // Both files are looked for: they go together.
    fail("import x.th --task SL --predictor value-aware=y.th", 2, &["x.th"]);
    fail("import --onnx x.onnx --task SL --predictor value-aware=y.th", 2, &["cannot be used with"]);
}

#[test]
fn inspecting_what_nobody_knows() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("notes.txt");
    std::fs::write(&path, "hello").unwrap();
    fail(&format!("inspect {}", path.display()), 2, &["notes.txt"]);
    fail("inspect no-such-file.json", 2, &["no-such-file.json"]);
    let (_folder, policy) = with_policy();
    let text = succeed(&format!("inspect {}", policy.display()));
    assert!(text.contains("hear-see") && text.contains("actors.0.fc1.weight"), "{text}");
}

#[test]
fn helpful_commands_help() {
    for words in ["tasks", "tasks --json", "doctor", "completions bash"] {
        assert!(!succeed(words).is_empty());
    }
    assert_eq!(run("").status.code(), Some(2));
}
