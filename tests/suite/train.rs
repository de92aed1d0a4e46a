//! Training through the real binary: what a run leaves, and that nothing but its settings decides it.

use std::fs;
use std::path::Path;

use crate::common::training::{Folder, SMALL, assert_same, result};
use crate::common::{command, fail, run, stderr, succeed};
use serde_json::Value;

#[test]
fn a_run_leaves_what_it_promises() {
    let folder = Folder::new();
    let run = folder.train("hs", "--task hear-see --steps 6000 --in-process");
    let mut names: Vec<String> =
        fs::read_dir(&run).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    let events = names.iter().position(|name| name.contains("tfevents")).unwrap();
    names.remove(events);
    assert_eq!(
        names,
        ["checkpoint.safetensors", "config.toml", "curves.svg", "metrics.csv", "policy.safetensors"]
    );
    // Rows at 0, 2000, 4000 and 6000 timesteps.
    let metrics = fs::read_to_string(run.join("metrics.csv")).unwrap();
    let timesteps: Vec<&str> = metrics.lines().skip(1).map(|line| line.split(',').next().unwrap()).collect();
    assert_eq!(timesteps, ["0", "2000", "4000", "6000"]);
    let header = metrics.lines().next().unwrap();
    for column in ["return_mean", "pg_loss", "value-aware/nll", "maro/test_p=0.2_return_mean"] {
        assert!(header.split(',').any(|name| name == column), "{column} is not in {header}");
    }
    assert!(fs::read_to_string(run.join("config.toml")).unwrap().contains("hidden = 32"));
    // The policy is one like any other, and can be kept in half the size.
    let kept = folder.path("kept.safetensors");
    succeed(&format!("export {} --out {}", run.display(), kept.display()));
    assert!(
        kept.metadata().unwrap().len() < run.join("policy.safetensors").metadata().unwrap().len() * 6 / 10
    );
    succeed(&format!("spawn --policy {} --episodes 1", kept.display()));
    let inspected = succeed(&format!("inspect {}", run.join("policy.safetensors").display()));
    assert!(inspected.contains("mappo, 6000 env steps"), "{inspected}");
    for imputer in ["value-aware", "maro"] {
        let words = format!(
            "spawn --task hear-see --policy {} --imputer {imputer} --episodes 2 --p 0.2",
            run.display()
        );
        succeed(&words);
    }
}

#[test]
fn every_column_of_every_kind_of_run_is_defined_in_the_docs() {
    let folder = Folder::new();
    let docs = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/metrics.md")).unwrap();
    let run = folder.train("hs", "--steps 250 --in-process --predictors value-aware,maro,lambda0,maro-carry");
    let metrics = fs::read_to_string(run.join("metrics.csv")).unwrap();
    for column in metrics.lines().next().unwrap().split(',') {
        let name = column.rsplit('/').next().unwrap();
        let name = match name.strip_prefix("test_p=") {
            Some(test) => format!("test_p=<level>{}", &test[test.find('_').unwrap()..]),
            None => name.to_owned(),
        };
        assert!(docs.contains(&name), "{column} (`{name}`) is not in docs/metrics.md");
    }
}

#[test]
fn every_setting_is_explained_in_the_docs() {
    let docs = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/training.md")).unwrap();
    let plan = succeed("train --dry-run --set hidden=16 --set test_episodes=1");
    let settings = plan.lines().filter_map(|line| line.split_once(" = "));
    let mut count = 0;
    for (key, _) in settings.filter(|(key, _)| !key.starts_with('#')) {
        assert!(docs.contains(&format!("| `{key}` |")), "{key} is not in docs/training.md");
        count += 1;
    }
    assert!(count > 30, "{plan}");
}

#[test]
fn processes_and_threads_change_nothing() {
    let folder = Folder::new();
    for (task, more) in [
        ("hear-see", "--predictors value-aware,maro,lambda0,maro-carry --set predictor_updates=2"),
        ("spread-xy-4", "--train-p uniform --algorithm ippo --set share_actors=true --set update_every=3"),
    ] {
        let words = format!("--task {task} --steps 3000 {more}");
        let processes = folder.train(&format!("{task}-processes"), &words);
        let one = folder.train(&format!("{task}-one"), &format!("{words} --in-process --threads 1"));
        let three = folder.train(&format!("{task}-three"), &format!("{words} --in-process --threads 3"));
        assert_same(&processes, &one);
        assert_same(&processes, &three);
    }
}

#[test]
fn training_raises_returns() {
    let folder = Folder::new();
    let run = folder.train(
        "run",
        "--task hear-see --in-process --steps 30000 --seed 1 --set learning_rate=0.003 --set test_interval=30000 \
         --set test_episodes=50",
    );
    // Tests before the first update and after the last one are on the same episodes, here with everything delivered.
    let (metrics, _) = result(&run);
    let mut rows = metrics.lines().map(|line| line.split(',').collect::<Vec<&str>>());
    let columns = rows.next().unwrap();
    let tested = columns.iter().position(|name| name.ends_with("/test_p=1_return_mean")).unwrap();
    let returns: Vec<f64> = rows.map(|row| row[tested].parse().unwrap()).collect();
    let [before, after] = returns[..] else { panic!("a test before and one after: {returns:?}") };
    // Seeds 1 to 3 come from -161, -132 and -160 to -25, -45 and -30.
    assert!(after > before + 80.0, "returns of {before} before and {after} after");
}

#[test]
fn a_policy_can_learn_without_a_predictor_that_imputes_for_it() {
    let folder = Folder::new();
    let dropout = "--task hear-see --steps 3000 --train-p 0.3 --predictors none --set train_imputer=zero";
    let processes = folder.train("processes", dropout);
    let here = folder.train("here", &format!("{dropout} --in-process"));
    assert_same(&processes, &here);
    let (metrics, config) = (result(&here).0, fs::read_to_string(here.join("config.toml")).unwrap());
    assert!(metrics.contains("zero/test_p=0_return_mean") && !metrics.contains("hold/"), "{metrics}");
    assert!(config.contains("train_imputer = \"zero\""), "{config}");
    let holding = folder.train("hold", &format!("{dropout} --in-process").replace("zero", "hold"));
    let without = |metrics: &str| metrics.lines().skip(1).map(str::to_owned).collect::<Vec<_>>();
    assert_ne!(without(&metrics), without(&result(&holding).0), "what imputes changes what is learned");
}

#[test]
fn predictors_that_see_the_own_action_hold_to_the_same_promises() {
    let folder = Folder::new();
    let acting =
        "--steps 3000 --predictors maro,value-aware --train-p 0.5 --set predictor_inputs=estimate,own-action";
    let processes = folder.train("processes", &format!("--task spread-xy-2 {acting}"));
    let here = folder.train("here", &format!("--task spread-xy-2 {acting} --in-process --threads 2"));
    assert_same(&processes, &here);
    let blind = acting.replace(",own-action", "");
    let blind = folder.train("blind", &format!("--task spread-xy-2 {blind} --in-process"));
    assert_ne!(result(&here).0, result(&blind).0, "what agents do changes what is learned");

    // A run that stopped goes on with the actions that it remembers.
    let parts =
        folder.train("parts", &format!("--task spread-xy-2 {acting} --in-process").replace("3000", "1500"));
    succeed(&format!("train --resume --out {} --in-process --steps 3000", parts.display()));
    assert_same(&here, &parts);

    let policy = here.join("policy.safetensors");
    let inspected = succeed(&format!("inspect {}", policy.display()));
    assert!(inspected.contains("maro (hidden 16, sees the own action)"), "{inspected}");
    let trace = folder.path("trace.json");
    let spawn = format!("spawn --policy {} --imputer maro --p 0.3 --episodes 3", policy.display());
    succeed(&format!("{spawn} --worlds 2 --record {}", trace.display()));
    let verified = succeed(&format!("verify {}", trace.display()));
    assert!(verified.contains("all 10 comparisons hold"), "{verified}");
    let evaluate = format!("evaluate {} --task spread-xy-2 --episodes 4 --levels 0.3", policy.display());
    succeed(&format!("{evaluate} --imputers maro,hold --report {}", folder.path("report").display()));
}

#[test]
fn a_policy_may_see_what_arrives_and_do_its_own_imputation() {
    let folder = Folder::new();
    let words = "--task hear-see --steps 1500 --train-p uniform --predictors none --set train_imputer=zero \
                 --set actor=gru --set actor_inputs=estimate,delivered,age --set update_every=5";
    let processes = folder.train("processes", words);
    let here = folder.train("here", &format!("{words} --in-process --threads 2"));
    assert_same(&processes, &here);
    let blind = folder.train("blind", &format!("{words} --in-process").replace(",delivered,age", ""));
    assert_ne!(result(&here).0, result(&blind).0, "what arrives changes what is learned");

    // A run that stopped goes on with the ages of the episodes that its next update shares.
    let parts = folder.train("parts", &format!("{words} --in-process").replace("1500", "625"));
    succeed(&format!("train --resume --out {} --in-process --steps 1500", parts.display()));
    assert_same(&here, &parts);

    let [policy, half] = [here.join("policy.safetensors"), folder.path("half.safetensors")];
    let inspected = succeed(&format!("inspect {}", policy.display()));
    for words in
        ["gru, separate, hidden 32, sees what arrives, sees ages", "imputer     zero, as in training"]
    {
        assert!(inspected.contains(words), "{inspected}");
    }
    succeed(&format!("export {} --out {}", policy.display(), half.display()));
    let about: Value = serde_json::from_str(&succeed(&format!("inspect {} --json", half.display()))).unwrap();
    assert_eq!((&about["actor_inputs"][2], &about["imputer"]), (&"age".into(), &"zero".into()));

    // It plays with the imputer that it learned with, or another one, and its trace can be checked.
    let trace = folder.path("trace.json");
    let spawn = format!("spawn --policy {} --links level(0.3)+delay(0,1) --episodes 3", policy.display());
    let said = succeed(&format!("{spawn} --worlds 2 --json --record {}", trace.display()));
    let said: Value = serde_json::from_str(&said).unwrap();
    assert_eq!(said["imputer"], "zero");
    let alone = succeed(&format!("{spawn} --in-process --json"));
    let alone: Value = serde_json::from_str(&alone).unwrap();
    assert_eq!(said["return_mean"], alone["return_mean"]);
    let verified = succeed(&format!("verify {}", trace.display()));
    assert!(verified.contains("all 10 comparisons hold"), "{verified}");
    succeed(&format!("fit {} --imputers dynamics,mine --updates 1", policy.display()));
    let evaluate = format!("evaluate {} --episodes 4 --levels 1,0.3 --in-process", policy.display());
    let report = succeed(&format!("{evaluate} --report {}", folder.path("report").display()));
    assert!(
        report.contains("dynamics") && report.contains("mine") && !report.contains("teammates"),
        "{report}"
    );

    // Nobody knows what has arrived at a teammate.
    fail(&format!("{evaluate} --imputers teammates"), 2, &["`teammates` runs the actors of teammates"]);
    fail(&format!("{spawn} --imputer particles(hold)"), 2, &["`particles` runs the actors of teammates"]);
    fail(&format!("{evaluate} --substitute own"), 2, &["--substitute", "would still call the truth lost"]);
}

#[test]
fn a_larger_team_has_one_egocentric_actor_and_one_critic() {
    let folder = Folder::new();
    let words =
        "--preset team --task spread-blindfold-6 --steps 1500 --set batch_episodes=12 --set update_every=6";
    let processes = folder.train("processes", words);
    let here = folder.train("here", &format!("{words} --in-process --threads 2"));
    assert_same(&processes, &here);
    for setting in ["actor_inputs=estimate", "critic_input=all", "critic_hidden=8"] {
        let other = folder.train(setting, &format!("{words} --in-process --set {setting}"));
        assert_ne!(result(&here).0, result(&other).0, "what is learned depends on it");
    }

    let policy = here.join("policy.safetensors");
    let inspected = succeed(&format!("inspect {}", policy.display()));
    assert!(
        inspected.contains("mlp, shared, hidden 32, egocentric") && !inspected.contains("imputer"),
        "{inspected}"
    );
    let about: Value =
        serde_json::from_str(&succeed(&format!("inspect {} --json", policy.display()))).unwrap();
    assert_eq!(about["actor_inputs"], serde_json::json!(["egocentric"]));

    // Its actors can be told the truth and imagined, since what they see follows from estimates.
    let spawn = format!("spawn --policy {} --p 0.3 --episodes 3 --imputer", policy.display());
    let trace = folder.path("trace.json");
    let said = succeed(&format!("{spawn} value-aware --worlds 2 --json --record {}", trace.display()));
    let alone = succeed(&format!("{spawn} value-aware --in-process --json"));
    let [said, alone] = [said, alone].map(|said| serde_json::from_str::<Value>(&said).unwrap());
    assert_eq!(said["return_mean"], alone["return_mean"]);
    let verified = succeed(&format!("verify {}", trace.display()));
    assert!(verified.contains("all 10 comparisons hold"), "{verified}");
    succeed(&format!("fit {} --imputers dynamics", policy.display()));
    let evaluate = format!("evaluate {} --episodes 4 --levels 1,0.3 --in-process", policy.display());
    succeed(&format!(
        "{evaluate} --imputers value-aware,teammates,given-teammates,shared-dice --substitute own"
    ));
}

#[test]
fn settings_decide_what_comes_out() {
    let folder = Folder::new();
    let settings = [
        "",
        "--seed 1",
        "--task spread-xy-2",
        "--task spread-xy-2 --algorithm ippo",
        "--set critic_input=local",
        "--set advantage=gae",
        "--set share_actors=true",
        "--set share_critics=true",
        "--set standardise_rewards=false",
        "--set update_every=1",
        "--set epochs=3",
        "--set actor=gru",
        "--set predictor_inputs=estimate,own-action",
        "--train-p 0.5",
        "--train-p uniform",
        "--preset published-code",
    ];
    // What was measured and not the policy file, which says by itself how it was trained.
    let mut metrics = Vec::new();
    for (at, setting) in settings.iter().enumerate() {
        let run = folder.train(&at.to_string(), &format!("--steps 1000 --in-process {setting}"));
        metrics.push(result(&run).0);
    }
    for (at, run) in metrics.iter().enumerate() {
        let same = metrics[..at].iter().position(|other| other == run);
        assert_eq!(same, None, "{:?} changes nothing", settings[at]);
    }
}

#[test]
fn predictors_beside_a_policy_do_not_change_it() {
    let folder = Folder::new();
    let both = folder.train("both", "--steps 3000 --in-process");
    let alone = folder.train("alone", "--steps 3000 --in-process --predictors maro");
    let column = |run: &Path, name: &str| -> Vec<String> {
        let metrics = fs::read_to_string(run.join("metrics.csv")).unwrap();
        let at = metrics.lines().next().unwrap().split(',').position(|column| column == name).unwrap();
        metrics.lines().skip(1).map(|line| line.split(',').nth(at).unwrap().to_owned()).collect()
    };
    for name in ["return_mean", "critic_loss", "pg_loss", "maro/loss", "maro/test_p=0.2_return_mean"] {
        assert_eq!(column(&both, name), column(&alone, name), "{name}");
    }
}

#[test]
fn many_seeds_side_by_side() {
    let folder = Folder::new();
    let out = folder.path("hs");
    // A seed among the settings does not make all runs the same one.
    let words = format!(
        "train {SMALL} --set seed=9 --steps 1000 --in-process --seeds 3..5 --jobs 2 --out {}",
        out.display()
    );
    let summary = succeed(&words);
    assert!(summary.contains("seed 3") && summary.contains("seed 4"), "{summary}");
    let alone = folder.train("alone", "--steps 1000 --in-process --seed 4");
    assert_same(&alone, &folder.path("hs-4"));
    // Once more: one of them is done, the other has never begun.
    fs::remove_dir_all(folder.path("hs-3")).unwrap();
    succeed(&format!("{words} --resume"));
    assert!(folder.path("hs-3").join("policy.safetensors").exists());
    let refused = run(&words);
    assert_eq!(refused.status.code(), Some(1));
    let said = stderr(&refused);
    assert!(said.contains("[seed 3] error") && said.contains("3, 4"), "{said}");
}

#[test]
fn a_dry_run_plans_and_writes_nothing() {
    let folder = Folder::new();
    let out = folder.path("run");
    let plan = succeed(&format!("train {SMALL} --steps 1M --dry-run --out {}", out.display()));
    for part in [
        "1000000 env steps to go",
        "4000 updates",
        "env steps/s",
        " MB",
        "hidden = 32",
        "task = \"hear-see\"",
    ] {
        assert!(plan.contains(part), "{part} is not in {plan}");
    }
    assert!(!out.exists());
    // What it prints is a configuration.
    let config = folder.path("config.toml");
    fs::write(&config, plan).unwrap();
    succeed(&format!("train --config {} --steps 250 --in-process --out {}", config.display(), out.display()));
}

#[test]
fn a_summary_that_programs_read() {
    let folder = Folder::new();
    let words =
        format!("train {SMALL} --steps 500 --in-process --json --out {}", folder.path("run").display());
    let summary: Value = serde_json::from_str(&succeed(&words)).unwrap();
    assert_eq!((&summary["task"], &summary["timesteps"]), (&"hear-see".into(), &500.into()));
    assert_eq!(summary["tests"].as_array().unwrap().len(), 12);
    assert_eq!(summary["tests"][0]["return_mean"], summary["tests"][6]["return_mean"], "p = 1 is one test");
}

#[test]
fn teams_can_be_trained_over_any_links() {
    let folder = Folder::new();
    const LINKS: &str = "gilbert(loss=0.5, burst=4) + delay(1, 1)";
    let train = |name: &str, more: &str| {
        let out = folder.path(name);
        let mut command = command(&format!("train {SMALL} --steps 1000 --out {} {more}", out.display()));
        let output = command.args(["--train-p", LINKS]).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        out
    };
    assert_same(&train("processes", ""), &train("here", "--in-process"));
}

#[test]
fn bad_requests_are_refused_and_nothing_is_written() {
    let folder = Folder::new();
    let out = folder.path("run");
    let with = |words: &str| format!("train --out {} {words}", out.display());
    fail(&with("--set learning_rat=1"), 2, &["learning_rat", "nearest is `learning_rate`"]);
    fail(&with("--set clip"), 2, &["KEY=VALUE"]);
    fail(&with("--set clip=wide"), 2, &["`clip`"]);
    fail(&with("--task hear-sea"), 2, &["hear-sea", "hear-see"]);
    fail(&with("--steps 1.5"), 2, &["--steps", "1e6"]);
    fail(&with("--steps 0"), 2, &["--steps"]);
    fail(&with("--train-p 1.5"), 2, &["train_p", "0 to 1"]);
    fail(&with("--train-p delay(101)"), 2, &["`train_p`", "from 0 to 100"]);
    fail(&with("--train-p 0.5 --set predictors=[]"), 2, &["needs a predictor"]);
    fail(&with("--predictors kalman"), 2, &["kalman", "value-aware"]);
    fail(&with("--config nowhere.toml"), 2, &["nowhere.toml"]);
    fail(&with("--resume"), 2, &["no run to resume"]);
    fail(&with("--seeds 5..5"), 2, &["--seeds"]);
    fail(&with("--seeds 0..2 --seed 1"), 2, &["--seed"]);
    fail(&with("--jobs 2"), 2, &["--seeds"]);
    fail("train --resume", 2, &["--out"]);
    assert!(!out.exists());
    let blind = with("--task speaker-listener --set predictor_inputs=estimate,proximity");
    fail(&blind, 2, &["`predictor_inputs`", "does not tell where two agents or more are"]);
    let file = folder.path("file");
    fs::write(&file, "something else").unwrap();
    fail(&format!("train --out {}", file.display()), 1, &["file"]);
    let config = folder.path("config.toml");
    fs::write(&config, "clip = 0.2\nepoch = 3\n").unwrap();
    fail(&with(&format!("--config {}", config.display())), 2, &["config.toml", "`epoch`", "`epochs`"]);
}
