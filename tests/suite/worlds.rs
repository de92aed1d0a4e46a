//! The worlds in which the team matters, through the real binary: who sees what, and that all of it is recorded.

use std::fs;

use crate::common::succeed;
use serde_json::Value;

const WORLDS: [(&str, usize); 3] = [("predator-prey-3", 1), ("scout-3", 1), ("rendezvous-3", 0)];

fn json(path: &std::path::Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

fn rows(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

#[test]
fn they_play_alike_anywhere_and_are_taken_back_with_their_targets() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let record = |words: &str, name: &str| {
        succeed(&format!("spawn --policy untrained --p 0.3 {words} --record {}", at(name).display()));
    };
    for (task, targets) in WORLDS {
        let words = format!("--task {task} --episodes 2 --physics wind=0.5");
        record(&words, "processes.json");
        record(&format!("{words} --worlds 2 --in-process"), "worlds.json");
        record(&format!("{words} --in-process"), "compact.trace");
        assert_eq!(fs::read(at("processes.json")).unwrap(), fs::read(at("worlds.json")).unwrap(), "{task}");
        for name in ["processes.json", "compact.trace"] {
            let table = succeed(&format!("verify {}", at(name).display()));
            assert!(table.contains("comparisons hold"), "{task}: {table}");
        }
        let trace = json(&at("processes.json"));
        assert!(trace["physics"].as_str().unwrap().ends_with("wind=0.5"));
        for episode in rows(&trace["episodes"]) {
            let places = rows(&episode["target_pos"]);
            assert_eq!(places.len(), 26 * targets, "{task}");
            assert!(places.iter().all(|row| rows(row).len() == targets), "{task}");
            assert!(places.windows(2).all(|pair| pair[0] != pair[1]), "{task}: it never stands still");
        }
        let page = at("page.html");
        succeed(&format!("replay {} --html {}", at("compact.trace").display(), page.display()));
        let shows = fs::read_to_string(page).unwrap().contains("\"targets\":\"");
        assert_eq!(shows, targets > 0, "{task}");
        succeed(&format!(
            "replay {} --svg {} --step 3",
            at("compact.trace").display(),
            at("s.svg").display()
        ));
    }
}

#[test]
fn a_trace_whose_targets_are_not_those_of_its_world_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trace.json");
    succeed(&format!(
        "spawn --task scout-2 --policy untrained --episodes 1 --in-process --record {}",
        path.display()
    ));
    let whole = json(&path);
    let wrong = |change: &dyn Fn(&mut Value), says: &str| {
        let mut trace = whole.clone();
        change(&mut trace["episodes"][0]);
        fs::write(&path, trace.to_string()).unwrap();
        crate::common::fail(&format!("verify {}", path.display()), 1, &[says]);
    };
    wrong(&|episode| _ = episode["target_pos"].as_array_mut().unwrap().pop(), "not 26 rows");
    wrong(
        &|episode| {
            for name in ["target_pos", "target_vel"] {
                episode.as_object_mut().unwrap().remove(name);
            }
        },
        "0 targets, and the world 1",
    );
    wrong(&|episode| episode["target_pos"][4][0][0] = 0.123.into(), "do not hold");
}

#[test]
fn what_others_know_is_all_that_is_lacking() {
    for (task, _) in WORLDS {
        let said = succeed(&format!(
            "evaluate untrained --task {task} --imputers hold,velocity --levels 1,0 --links range(0.5) --episodes 3 \
             --substitute own --substitute others --json"
        ));
        let results: Value = serde_json::from_str(&said).unwrap();
        let imputers = rows(&results["groups"][0]["imputers"]);
        let of = |imputer: &str| -> Vec<&Value> {
            let cells = imputers.iter().filter(|named| named["imputer"] == imputer);
            cells.flat_map(|named| rows(&named["cells"])).map(|cell| &cell["mean"]["value"]).collect()
        };
        assert_eq!(of("hold").len(), 3, "{task}: p = 1, p = 0 and what is in range");
        assert_eq!(of("hold"), of("hold+oracle:own"), "{task}: each observes itself");
        let (all_known, perfect) = (of("hold+oracle:others"), of("hold")[0]);
        assert!(all_known.iter().all(|mean| *mean == perfect), "{task}: {all_known:?}, not {perfect}");
    }
}
