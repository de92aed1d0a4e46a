//! `plot` through the real binary.

use std::path::{Path, PathBuf};

use crate::common::{command, fail, stderr, succeed};
use tempfile::TempDir;

/// The folder of a run with these settings: four tests of two predictors at two levels.
fn run_of(settings: &str, parent: &TempDir, name: &str, shift: f64) -> PathBuf {
    let folder = parent.path().join(name);
    std::fs::create_dir(&folder).unwrap();
    std::fs::write(folder.join("config.toml"), settings).unwrap();
    let mut text = String::from("timestep,entropy");
    for predictor in ["value-aware", "maro"] {
        for level in [1.0, 0.2] {
            text += &format!(",{predictor}/test_p={level}_return_mean");
        }
    }
    for row in 1..=8 {
        let value = shift - 200.0 / f64::from(row);
        // Tested in every other row.
        let tests =
            if row % 2 == 0 { format!("{value},{value},{value},{}", value * 2.0) } else { ",,,".into() };
        text += &format!("\n{},1.5,{tests}", row * 250);
    }
    std::fs::write(folder.join("metrics.csv"), text + "\n").unwrap();
    folder
}

fn hear_see(parent: &TempDir, name: &str, shift: f64) -> PathBuf {
    run_of("task = \"hear-see\"", parent, name, shift)
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap()
}

#[test]
fn one_run() {
    let here = tempfile::tempdir().unwrap();
    let folder = hear_see(&here, "a", 0.0);
    let said = succeed(&format!("plot {}", folder.display()));
    assert!(said.contains("a/curves.svg: hear-see: 1 run, up to 2000 env steps"), "{said}");
    let chart = read(&folder.join("curves.svg"));
    for text in [
        "hear-see: return of tests while training (one run; axes fit the last nine tenths)",
        "p = 1<",
        "p = 0.2<",
        "value-aware",
        "maro",
    ] {
        assert!(chart.contains(text), "`{text}` is not in the chart");
    }
    assert!(!chart.contains("class=\"band"), "one run has no standard deviation");
    let printed = succeed(&format!("plot {} --out -", folder.join("metrics.csv").display()));
    assert!(printed.starts_with("<svg") && printed.ends_with("</svg>\n"));
    assert!(printed.contains(">return of tests"), "a file alone has no task");
}

#[test]
fn several_runs() {
    let here = tempfile::tempdir().unwrap();
    let runs = ["a", "b", "c"].map(|name| hear_see(&here, name, name.len() as f64));
    let mut plot = command("plot");
    let output = plot.args(&runs).current_dir(&here).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(said.starts_with("wrote curves.svg: hear-see: 3 runs"), "{said}");
    let chart = read(&here.path().join("curves.svg"));
    assert!(chart.contains("(mean ± std of 3 runs;"));
    assert_eq!(chart.matches("class=\"band").count(), 4);
    let out = here.path().join("elsewhere.svg");
    succeed(&format!("plot {} {} --out {}", runs[2].display(), runs[0].display(), out.display()));
    assert!(read(&out).contains("of 2 runs"));
}

#[test]
fn for_a_paper() {
    let here = tempfile::tempdir().unwrap();
    let folder = hear_see(&here, "a", 0.0);
    let said = succeed(&format!("plot {} --paper", folder.display()));
    assert!(said.contains("a/curves.pdf: hear-see: 1 run"), "{said}");
    let chart = std::fs::read(folder.join("curves.pdf")).unwrap();
    assert!(chart.starts_with(b"%PDF-") && !folder.join("curves.svg").exists());
    let printed = command(&format!("plot {} --paper --out -", folder.display())).output().unwrap();
    assert_eq!(printed.stdout, chart);
}

#[test]
fn a_run_in_training() {
    let here = tempfile::tempdir().unwrap();
    let folder = hear_see(&here, "a", 0.0);
    let metrics = folder.join("metrics.csv");
    let whole = read(&metrics);
    std::fs::write(&metrics, format!("{whole}2250,1.")).unwrap();
    let said = succeed(&format!("plot {}", folder.display()));
    assert!(said.contains("up to 2000 env steps"), "{said}");
    let untested: Vec<&str> = whole.lines().take(2).collect();
    std::fs::write(&metrics, untested.join("\n") + "\n").unwrap();
    fail(&format!("plot {}", folder.display()), 2, &["nothing to plot yet"]);
}

#[test]
fn what_is_no_run() {
    let here = tempfile::tempdir().unwrap();
    let there = here.path().display();
    fail("plot", 2, &["RUN"]);
    fail(&format!("plot {there}/none"), 2, &["there is no file", "/none"]);
    fail(&format!("plot {there}"), 2, &["there is no metrics.csv in", "not the folder of a training run"]);
    std::fs::write(here.path().join("metrics.csv"), "timestep,entropy\n250,1\n").unwrap();
    fail(&format!("plot {there}"), 2, &["no metrics of tests"]);
    std::fs::write(here.path().join("config.toml"), "task = ").unwrap();
    fail(&format!("plot {there}"), 2, &["config.toml is not TOML"]);
}

#[test]
fn damaged_metrics() {
    let here = tempfile::tempdir().unwrap();
    let folder = hear_see(&here, "a", 0.0);
    let metrics = folder.join("metrics.csv");
    std::fs::write(&metrics, read(&metrics).replace("\n1000,1.5,", "\n1000,1.5.,")).unwrap();
    fail(&format!("plot {}", folder.display()), 1, &["metrics.csv, line 5", "`1.5.` is not a number"]);
    assert!(!folder.join("curves.svg").exists());
}

#[test]
fn runs_that_have_no_mean() {
    let here = tempfile::tempdir().unwrap();
    let [a, b] = [hear_see(&here, "a", 0.0), run_of("task = \"spread-xy-4\"", &here, "b", 0.0)];
    let c = run_of("clip = 0.3", &here, "c", 0.0);
    let plot = |other: &Path| format!("plot {} {} --out -", a.display(), other.display());
    fail(&plot(&b), 2, &["different settings", "hear-see", "spread-xy-4"]);
    fail(&plot(&c), 2, &["`clip` is 0.2", "0.3"]);
    fail(&plot(&a), 2, &["named twice"]);
    // Seeds and lengths may differ, and a file alone has no settings.
    succeed(&plot(&run_of("seed = 7\nsteps = 1000", &here, "d", 0.0)));
    succeed(&plot(&b.join("metrics.csv")));
}

#[test]
fn places_that_cannot_be_written() {
    let here = tempfile::tempdir().unwrap();
    let folder = hear_see(&here, "a", 0.0);
    let out = here.path().join("no/such/folder.svg");
    fail(
        &format!("plot {} --out {}", folder.display(), out.display()),
        1,
        &["cannot write", "no/such/folder.svg"],
    );
    fail(&format!("plot {} --out {}", folder.display(), here.path().display()), 1, &["it is a folder"]);
}
