//! Hosts against the clock, each with a clock of its own.

use std::process::Command;

use serde_json::Value;

use crate::common::{PROGRAM, fail, succeed};
use crate::{Host, alone, plan};

/// Starts a host whose monotonic clock is so many seconds ahead of ours; `None` where this user may have no such clock.
fn start_ahead(name: &str, seconds: i64) -> Option<Host> {
    let command = |program: &str| {
        let mut command = Command::new("unshare");
        command.args(["--time", "--monotonic", &seconds.to_string(), program]);
        command
    };
    let can = command("true").output().is_ok_and(|output| output.status.success());
    can.then(|| Host::start_by(|| command(PROGRAM), name, &[]))
}

/// What a host is said to have been like.
fn of<'a>(summary: &'a Value, host: &Host) -> &'a Value {
    let all = summary["hosts"].as_array().unwrap();
    all.iter().find(|one| one["name"] == *host.name && one["at"] == *host.at).unwrap()
}

#[test]
fn hosts_play_by_one_clock_whatever_theirs_say() {
    let _alone = alone();
    const AHEAD: i64 = 5000;
    // None can begin before its machine does.
    const BEHIND: i64 = -10;
    let (Some(ahead), Some(behind)) = (start_ahead("ahead", AHEAD), start_ahead("behind", BEHIND)) else {
        return eprintln!("skipped: this user may not make time namespaces");
    };
    let folder = tempfile::tempdir().unwrap();
    let plan = plan(folder.path(), &[&ahead, &behind], "");
    let play = |words: &str| -> Value {
        let words =
            format!("spawn --agents 4 --episodes 1 --deadline 60s --json {words} --hosts {}", plan.display());
        serde_json::from_str(&succeed(&words)).unwrap()
    };
    // Half a period is 25 ms: enough for something to arrive in time. How much, is for a benchmark.
    let summary = play("--rate 20 --audit");
    for (host, seconds) in [(&ahead, AHEAD), (&behind, BEHIND)] {
        let about = of(&summary, host);
        let (offset, error) = (about["offset_ns"].as_i64().unwrap(), about["error_ns"].as_u64().unwrap());
        assert!(offset.abs_diff(seconds * 1_000_000_000) <= error, "{about}");
        assert_eq!(about["clock_jumps"], 0);
        // 25 ticks of two: by another clock all of them would be missed.
        assert!(about["missed_ticks"].as_u64().unwrap() < 50, "{summary}");
        host.assert_empty();
    }
    assert!(summary["delivery_rate"].as_f64().unwrap() > 0.0, "{summary}");
    // In lockstep clocks are compared, too.
    let summary = play("--p 0.5");
    let about = of(&summary, &ahead);
    assert!(
        about["offset_ns"].as_i64().unwrap() > 1_000_000_000 && about["missed_ticks"].is_null(),
        "{about}"
    );
}

#[test]
fn a_host_that_is_lost_stops_no_clock() {
    let _alone = alone();
    let (left, right, folder) =
        (Host::start("left", &[]), Host::start("right", &[]), tempfile::tempdir().unwrap());
    let plan = plan(folder.path(), &[&left, &right], "");
    let supervisor = crate::play(&plan, &[&left, &right], "--agents 4 --rate 50 --on-failure continue");
    right.kill();
    crate::common::await_sleeps(crate::common::children(left.process.id())[0], 20);
    let (code, said) = crate::end(supervisor);
    assert_eq!(code, Some(130), "{said}");
    left.assert_empty();
    right.clean();
    fail(&format!("spawn --hosts {} --rate 0", plan.display()), 2, &["rate"]);
}
