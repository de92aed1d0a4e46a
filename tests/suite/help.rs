//! What the help of every command says: nothing that a terminal of 80 columns breaks, and examples that are understood.

use crate::common::{command, run, succeed};
use crate::documents::{alone, run_in};

/// What everything for people keeps to.
const COLUMNS: usize = 80;

/// All commands that help lists, below `command` (none for the program itself), and itself.
fn commands(command: &str) -> Vec<String> {
    let help = help(command, COLUMNS);
    let listed = help.split("Commands:\n").nth(1).map_or("", |rest| rest.split("\n\n").next().unwrap());
    // A description that goes on is further to the right.
    let names = listed.lines().filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let names = names.map(|line| line.split_whitespace().next().unwrap()).filter(|name| *name != "help");
    let below = names.flat_map(|name| commands(format!("{command} {name}").trim()));
    std::iter::once(command.to_owned()).chain(below).collect()
}

fn help(words: &str, columns: usize) -> String {
    let output = command(&format!("{words} --help")).env("COLUMNS", columns.to_string()).output().unwrap();
    assert!(output.status.success(), "{words}");
    String::from_utf8(output.stdout).unwrap()
}

fn assert_narrow(words: &str, text: &str) {
    for line in text.lines() {
        assert!(line.chars().count() <= COLUMNS, "{words}: {line}");
    }
}

#[test]
fn every_command_has_examples_that_are_understood_and_not_broken() {
    let commands = commands("");
    assert!(commands.len() > 20, "{commands:?}");
    for words in commands {
        let (narrow, wide) = (help(&words, COLUMNS), help(&words, 100));
        assert_narrow(&words, &narrow);
        let examples = |text: &str| text.split("\nExamples:\n").nth(1).map(str::to_owned);
        let narrow = examples(&narrow).unwrap_or_else(|| panic!("{words} has no examples"));
        assert_eq!(Some(&narrow), examples(&wide).as_ref(), "{words}: a line is broken");
        let (lines, _) = narrow.split_once("\n\n").unwrap_or((&narrow, ""));
        let joined = lines.replace("\\\n", " ");
        let lines: Vec<&str> = joined.lines().map(str::trim).filter(|line| !line.starts_with("# ")).collect();
        assert!(lines.iter().any(|line| line.starts_with(format!("vamaro-swarm {words}").trim())), "{words}");
        let folder = tempfile::tempdir().unwrap();
        // An earlier example has written it.
        std::fs::write(folder.path().join("before.json"), "{}").unwrap();
        for line in lines {
            // Options before this one are read first.
            let help = run_in(&format!("{} --help", alone(line)), folder.path());
            assert!(help.contains("Usage: vamaro-swarm"), "{line}");
        }
    }
}

#[test]
fn what_people_read_fits_80_columns() {
    let evaluate = "evaluate builtin --task hear-see --levels 1,0.6,0.2,0 --episodes 20 --in-process";
    for words in [
        "tasks",
        "doctor",
        "spawn --agents 4 --p 0.2 --rate 200 --episodes 1 --physics motor_noise=0.3,damping=0.3,mass=1.2",
        evaluate,
        &format!("{evaluate} --substitute own"),
    ] {
        let output = run(words);
        assert!(output.status.success(), "{words}: {output:?}");
        assert_narrow(words, &String::from_utf8(output.stdout).unwrap());
    }
    let first = succeed("spawn --agents 4 --p 0.2 --episodes 1");
    assert!(first.contains("links       p = 0.2 (probability of delivery), drop = 0.8\n"), "{first}");
}

#[test]
fn an_area_over_p_takes_more_than_one_level() {
    let evaluate =
        "evaluate builtin --task hear-see --imputers maro,hold --episodes 20 --in-process --levels";
    let text = succeed(&format!("{evaluate} 0.2"));
    assert!(!text.contains("over p") && text.contains("vs maro, p = 0.2"), "{text}");
    assert!(!succeed(&format!("{evaluate} 1")).contains("over p"));
    assert!(succeed(&format!("{evaluate} 1,0.2")).contains("over p"));
    let one = evaluate.replace("--episodes 20", "--episodes 1");
    assert!(succeed(&format!("{one} 1")).contains("1 episode each\n"));
}
