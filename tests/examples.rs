//! The examples run, with agents that are processes of theirs.

mod common;

use std::path::Path;
use std::process::Command;

/// What an example writes to stdout. Cargo puts it beside the program, unless it builds this test alone.
fn run(name: &str) -> String {
    let program = Path::new(common::PROGRAM).with_file_name("examples").join(name);
    let output = Command::new(&program).output().unwrap_or_else(|e| {
        panic!(
            "{}: {e}; build the examples first: `cargo build --examples`, with --release if this is",
            program.display()
        )
    });
    assert!(output.status.success(), "{name}: {}", common::stderr(&output));
    assert_eq!(common::stderr(&output), "", "{name}");
    String::from_utf8(output.stdout).unwrap()
}

/// The number behind a word of a line that begins so.
fn number(text: &str, line: &str, word: &str) -> f64 {
    let line = text.lines().find(|found| found.starts_with(line)).unwrap_or_else(|| panic!("{text}"));
    let behind = line.split_once(&format!("{word} ")).unwrap_or_else(|| panic!("{line}")).1;
    behind.split([' ', ',']).next().and_then(|number| number.parse().ok()).unwrap_or_else(|| panic!("{line}"))
}

#[test]
fn an_imputer_of_ones_own_is_known_to_the_agents() {
    let text = run("own_imputer");
    let [fade, hold, zero] = ["fade:", "hold:", "zero:"].map(|line| number(&text, line, "return"));
    assert!(fade != hold && fade != zero && hold > zero, "{text}");
}

#[test]
fn a_link_of_ones_own_delivers_what_it_says() {
    let text = run("own_link");
    // Of 24 steps, without the one at which all is shared, each of four agents is heard by the others in six.
    assert_eq!(number(&text, "by turns", "turns:"), 25.0);
    assert!((number(&text, "by chance", "chance:") - 25.0).abs() < 1.0, "{text}");
}

#[test]
fn an_environment_of_ones_own_is_played() {
    let text = run("own_environment");
    // They start 2/3 apart on average, walk 25 steps of at most 0.1 each, and earn twice what they are apart.
    assert!((-150.0..0.0).contains(&number(&text, "return", "return")), "{text}");
}
