//! Writes an evaluation down: for people, for programs and for papers.
//!
//! `docs/formats.md` defines every file.

mod csv;
mod figures;
mod findings;
mod group;
mod markdown;
mod marl_eval;
mod notes;
mod page;
mod results;
mod table;
mod text;
mod words;

#[cfg(test)]
mod fixture;

use std::path::{Path, PathBuf};

use serde::Serialize;

#[cfg(feature = "python")]
pub use csv::{episodes as episodes_csv, summary as summary_csv};
#[cfg(feature = "python")]
pub use marl_eval::marl_eval;
pub use results::results;
pub use text::text;

use super::{Evaluation, Replay, Summary};
use crate::base::error::{Error, Result};
use crate::base::file::AtomicFile;

/// What an evaluation was made with.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Provenance {
    /// Name and version of the program.
    pub program: String,
    /// The command line.
    pub command: String,
    /// Model of the CPU and the feature set that was used: sums are grouped differently on others.
    pub cpu: String,
    /// The day, as in 2026-02-28.
    pub date: String,
}

/// The folder of the pages that play episodes.
const REPLAYS: &str = "replays";

/// Writes an evaluation into a folder that exists: `report.html`, `results.json`, `marl-eval.json`, `summary.csv`,
/// `episodes.csv`, `errors.csv`, `table.md`, and those of `robustness.svg`, `sweeps.svg`, `modes.svg`, `difference.svg` and
/// `error-by-age.svg` that have something to show; for a paper the same as PDF. The pages of replays come into `replays/`. Returns where all are.
///
/// # Errors
/// [`Error::Failed`] if a file cannot be written; those before it are complete.
pub fn write(
    folder: &Path,
    evaluation: &Evaluation,
    summary: &Summary,
    replays: &[(Replay, String)],
    provenance: &Provenance,
    paper: bool,
) -> Result<Vec<PathBuf>> {
    let imputers = words::imputers(summary);
    let figures = [
        ("robustness", figures::robustness(&summary.groups, &imputers)),
        ("sweeps", figures::sweeps(&summary.groups, &summary.axes, &imputers)),
        ("modes", figures::modes(&summary.groups, &summary.axes, &imputers)),
        ("difference", figures::difference(&summary.groups, &imputers)),
        ("error-by-age", figures::error_by_age(&summary.groups, &imputers)),
    ];
    let mut written = Vec::new();
    let mut write = |name: &str, content: Vec<u8>| {
        let path = folder.join(name);
        AtomicFile::write(&path, &content)?;
        written.push(path);
        Ok(())
    };
    // What the report leads to is there before it.
    let shown: Vec<&Replay> = replays.iter().map(|(replay, _)| replay).collect();
    make_room_for_replays(&folder.join(REPLAYS), &shown)?;
    for (replay, page) in replays {
        write(&format!("{REPLAYS}/{}", replay.file()), page.clone().into_bytes())?;
    }
    // One after the other: those with all episodes are large.
    write("report.html", page::page(summary, &shown, provenance).into_bytes())?;
    write("results.json", results::results(summary, provenance).into_bytes())?;
    write("marl-eval.json", marl_eval::marl_eval(evaluation, summary).into_bytes())?;
    write("summary.csv", csv::summary(summary).into_bytes())?;
    write("episodes.csv", csv::episodes(evaluation).into_bytes())?;
    write("errors.csv", csv::errors(summary).into_bytes())?;
    write("table.md", markdown::tables(summary).into_bytes())?;
    for (name, figure) in figures {
        let [svg, pdf] = ["svg", "pdf"].map(|format| format!("{name}.{format}"));
        let shows = !figure.panels.is_empty();
        if shows {
            write(&svg, figure.to_svg().into_bytes())?
        } else {
            remove(&folder.join(svg))?
        }
        if shows && paper { write(&pdf, figure.to_pdf())? } else { remove(&folder.join(pdf))? }
    }
    Ok(written)
}

/// Makes the folder of replays, if there are any, and removes those of an earlier evaluation that this one does not have.
fn make_room_for_replays(folder: &Path, replays: &[&Replay]) -> Result<()> {
    if !replays.is_empty() {
        std::fs::create_dir_all(folder).map_err(|e| Error::io("create the folder", folder, e))?;
    }
    let Ok(there) = folder.read_dir() else { return Ok(()) };
    let names = there.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
    let is_ours = |name: &String| ["-best.html", "-worst.html"].iter().any(|end| name.ends_with(end));
    let is_old = |name: &String| is_ours(name) && replays.iter().all(|replay| replay.file() != *name);
    names.filter(is_old).try_for_each(|name| remove(&folder.join(name)))
}

/// Removes a figure of an earlier evaluation that this one does not have.
fn remove(path: &Path) -> Result<()> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::io("remove", path, e)),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::Truth;
    use crate::evaluate::{Claim, Claims};

    #[test]
    fn all_files_are_written_whole() {
        let (evaluation, summary) = fixture::two_tasks();
        let folder = tempfile::tempdir().unwrap();
        let files = write(folder.path(), &evaluation, &summary, &[], &fixture::provenance(), false).unwrap();
        let mut there: Vec<PathBuf> =
            std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        let mut said = files.clone();
        there.sort();
        said.sort();
        assert_eq!((said, files.len()), (there, 11));
        let docs = include_str!("../../../docs/formats.md");
        for file in files {
            let name = file.file_name().unwrap().to_str().unwrap().to_owned();
            assert!(docs.contains(&format!("`{name}`")), "docs/formats.md says nothing of {name}");
            let text = std::fs::read_to_string(&file).unwrap();
            assert!(text.ends_with('\n'), "{name}");
            if name.ends_with(".json") {
                serde_json::from_str::<serde_json::Value>(&text).unwrap();
            }
        }
    }

    #[test]
    fn claims_are_in_all_that_people_read() {
        let (_, mut summary) = fixture::two_tasks();
        let readings = |summary: &Summary| {
            let page = page::page(summary, &[], &fixture::provenance());
            // Sentences are broken where a terminal ends.
            [page, markdown::tables(summary), text(summary).replace("\n  ", " ")]
        };
        assert!(readings(&summary).iter().all(|text| !text.contains("smaller by")));
        let claim = |p: f64, improvement: f64| Claim {
            task: "hear-see".to_owned(),
            p,
            improvement,
            std_reduction: Some(0.5),
        };
        summary.claims = vec![Claims {
            label: "mappo".to_owned(),
            imputer: "value-aware".to_owned(),
            baseline: "maro".to_owned(),
            improvement: 0.2022,
            std_reduction: None,
            cells: vec![claim(0.0, 0.3), claim(0.2, 0.1044)],
        }];
        for text in readings(&summary) {
            let expected = "mappo, value-aware against maro over hear-see at p = 0 and 0.2: mean return better by 20.2 %";
            assert!(text.contains(expected), "{text}");
        }
        let [page, table, _] = readings(&summary);
        assert!(
            page.contains("<th scope=\"row\">hear-see, p = 0.2</th><td>10.4 %</td><td>50.0 %</td>"),
            "{page}"
        );
        assert!(
            table.ends_with("| hear-see | 0.2 | 10.4 % | 50.0 % |\n| mean |  | 20.2 % | - |\n"),
            "{table}"
        );
    }

    #[test]
    fn what_losses_are_made_of_is_in_all_that_people_read() {
        let (_, mut summary) = fixture::two_tasks();
        summary.groups[1].losses = fixture::losses();
        let sentences = [
            "p = 0: value-aware loses 0.500 [0.490, 0.510] of the score.",
            "Not knowing its own agent's state explains 100.0 % [99.0, 101.0] of that.",
            "Not knowing agent 3's state explains -5.0 % [-6.0, -4.0] of that.",
            "p = 0.2: value-aware loses 0.005 [-0.005, 0.015] of the score.",
            "Knowing its own agent's state adds 0.005 [-0.005, 0.015].",
        ];
        let page = page::page(&summary, &[], &fixture::provenance());
        for text in [page, markdown::tables(&summary), text(&summary)] {
            assert!(sentences.iter().all(|sentence| text.contains(sentence)), "{text}");
            assert!(!text.contains("oracle"), "nobody was one");
        }
        assert!(text(&summary).lines().all(|line| line.chars().count() <= 100));
        summary.groups[0].imputers[2].imputer = Truth::Own.oracle("value-aware");
        let page = page::page(&summary, &[], &fixture::provenance());
        assert!(page.contains("Not an imputer: the agents are told a part of the truth"));
        assert!(text(&summary).contains("NAME+oracle:PART is not an imputer"));
    }

    #[test]
    fn figures_for_a_paper_are_beside_the_others_and_go_with_them() {
        let (evaluation, summary) = fixture::two_tasks();
        let folder = tempfile::tempdir().unwrap();
        let write =
            |paper| write(folder.path(), &evaluation, &summary, &[], &fixture::provenance(), paper).unwrap();
        let files = write(true);
        for name in ["robustness", "modes", "difference", "error-by-age"] {
            let figure = folder.path().join(format!("{name}.pdf"));
            assert!(files.contains(&figure) && std::fs::read(figure).unwrap().starts_with(b"%PDF-"));
        }
        write(false);
        assert!(!folder.path().join("robustness.pdf").exists(), "that of an earlier evaluation is gone");
    }

    /// Runs the recipe of the docs, if there is a Python with pandas.
    #[test]
    fn pandas_finds_the_same_means_and_differences() {
        let python = |code: &str, folder: &Path| {
            std::process::Command::new("python3").args(["-c", code]).current_dir(folder).output()
        };
        let folder = tempfile::tempdir().unwrap();
        if !python("import pandas", folder.path()).is_ok_and(|output| output.status.success()) {
            eprintln!("skipped: there is no Python with pandas");
            return;
        }
        let (evaluation, summary) = fixture::two_tasks();
        write(folder.path(), &evaluation, &summary, &[], &fixture::provenance(), false).unwrap();
        let docs = include_str!("../../../docs/formats.md");
        let recipe = docs.split("```python\n").find(|part| part.starts_with("import pandas")).unwrap();
        let output = python(recipe.split("```").next().unwrap(), folder.path()).unwrap();
        let words = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let cell = &summary.groups[0].imputers[0].cells[1];
        let difference = cell.comparison.unwrap().difference.value;
        for number in [cell.mean.value, cell.seed_std.unwrap(), difference] {
            assert!(words.contains(&format!("{number:.6}")), "{number} is not in {words}");
        }
    }

    #[test]
    fn what_has_nothing_to_show_is_not_written() {
        let (evaluation, mut summary) = fixture::two_tasks();
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), &evaluation, &summary, &[], &fixture::provenance(), false).unwrap();
        summary.groups.iter_mut().for_each(fixture::forget_baseline);
        let files = write(folder.path(), &evaluation, &summary, &[], &fixture::provenance(), false).unwrap();
        assert!(!files.contains(&folder.path().join("difference.svg")) && files.len() == 10);
        assert!(!folder.path().join("difference.svg").exists(), "that of an earlier evaluation is gone");
        assert!(
            write(&folder.path().join("none"), &evaluation, &summary, &[], &fixture::provenance(), false)
                .is_err()
        );
    }
}
