//! The table of rooms is what the imports say: each room depends only on those above it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// The rooms that a table lists, in its order: rows that begin with so many words in backquotes, which may be links.
fn rooms(file: &str, begins: &str) -> Vec<String> {
    let text = std::fs::read_to_string(root().join(file)).unwrap();
    let rows = text.lines().filter_map(|line| line.strip_prefix(begins));
    let rows = rows.filter(|row| row.starts_with(['[', '`']));
    let first = rows.map(|row| row.split('|').next().unwrap());
    let name = |word: &str| word.trim_matches(|c: char| !c.is_ascii_alphanumeric()).to_owned();
    first.flat_map(|cell| cell.split_whitespace().map(name).collect::<Vec<_>>()).collect()
}

/// All sources below a folder, with what they hold outside of tests and comments.
fn sources(folder: &Path, found: &mut BTreeMap<PathBuf, String>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() && path.file_name().unwrap() != "tests" {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") && !path.ends_with("tests.rs") {
            let text = std::fs::read_to_string(&path).unwrap();
            let code = text.split("#[cfg(test)]").next().unwrap();
            let lines = code.lines().filter(|line| !line.trim_start().starts_with("//"));
            found.insert(path, lines.collect::<Vec<_>>().join("\n"));
        }
    }
}

/// The rooms that some code names.
fn named(code: &str) -> Vec<String> {
    let behind = code.match_indices("crate::").map(|(at, found)| &code[at + found.len()..]);
    let names = behind.flat_map(|rest| match rest.strip_prefix('{') {
        Some(list) => list.split('}').next().unwrap().split(',').map(str::trim).collect(),
        None => vec![rest],
    });
    let word = |text: &str| text.chars().take_while(|c| c.is_ascii_alphanumeric() || *c == '_').collect();
    names.map(word).collect()
}

#[test]
fn rooms_depend_only_on_those_above_them() {
    let order = rooms("src/lib.rs", "//! | ");
    assert!(order.len() > 10, "{order:?}");
    let (mut found, src) = (BTreeMap::new(), root().join("src"));
    sources(&src, &mut found);
    let place = |room: &str| order.iter().position(|known| known == room);
    for (path, code) in &found {
        let path = path.strip_prefix(&src).unwrap();
        let room = path.components().next().unwrap().as_os_str().to_str().unwrap().trim_end_matches(".rs");
        // What puts rooms together is none itself.
        let Some(own) = place(room) else {
            assert!(["lib", "main", "embed", "swarm", "fuzzing"].contains(&room), "{room} is in no table");
            continue;
        };
        for other in named(code).iter().filter_map(|name| place(name)) {
            assert!(other <= own, "{} needs {}, which stands below {room}", path.display(), order[other]);
        }
    }
}

#[test]
fn the_architecture_has_the_same_table() {
    assert_eq!(rooms("docs/architecture.md", "| "), rooms("src/lib.rs", "//! | "));
}
