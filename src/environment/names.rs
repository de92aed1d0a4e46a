//! How tasks are called: ids, the paper's names, the reference environments' ids, and families of any N.

use super::task::Family;
use crate::base::error::{Error, Result};
use crate::base::rng::MAX_AGENTS;
use crate::usage;

/// A task with a name of its own.
pub(super) struct Named {
    pub family: Family,
    pub n_agents: usize,
    id: &'static str,
    aliases: &'static [&'static str],
}

const fn named(family: Family, n_agents: usize, id: &'static str, aliases: &'static [&'static str]) -> Named {
    Named { family, n_agents, id, aliases }
}

/// The tasks of the reference environments: first the paper's name where it has one, then theirs.
#[rustfmt::skip]
pub(super) const TABLE: [Named; 8] = [
    named(Family::HearSee, 2, "hear-see", &["HS", "SimpleBlindDeaf-v0"]),
    named(Family::SpeakerListener, 2, "speaker-listener", &["SL", "SimpleSpeakerListener-v0"]),
    named(Family::SpreadXy, 2, "spread-xy-2", &["SXY-2", "SimpleSpreadXY-v0"]),
    named(Family::SpreadXy, 4, "spread-xy-4", &["SXY-4", "SimpleSpreadXY4-v0"]),
    named(Family::SpreadXy, 8, "spread-xy-8", &["SimpleSpreadXY8-v0"]),
    named(Family::SpreadBlindfold, 3, "spread-blindfold", &["SBF", "SimpleSpreadBlind-v0", "spread-blindfold-3"]),
    named(Family::SpreadBlindfold, 6, "spread-blindfold-6", &["SimpleSpreadBlind6-v0"]),
    named(Family::SpreadBlindfold, 12, "spread-blindfold-12", &["SimpleSpreadBlind12-v0"]),
];

/// A family whose tasks are called by a prefix and the size of the team.
struct AnySize {
    family: Family,
    prefix: &'static str,
    /// Teams are made of groups of so many agents.
    group: usize,
}

const ANY_SIZE: [AnySize; 2] = [
    AnySize { family: Family::SpreadXy, prefix: "spread-xy-", group: 2 },
    AnySize { family: Family::SpreadBlindfold, prefix: "spread-blindfold-", group: 1 },
];

impl AnySize {
    fn allowed(&self) -> String {
        let even = if self.group == 2 { "even, " } else { "" };
        format!("{even}from {} to {MAX_AGENTS}", self.group)
    }
}

/// The family and the team size that `name` stands for.
pub(super) fn find(name: &str) -> Result<(Family, usize)> {
    if let Some(named) =
        TABLE.iter().find(|named| named.names().any(|known| known.eq_ignore_ascii_case(name)))
    {
        return Ok((named.family, named.n_agents));
    }
    let lower = name.to_ascii_lowercase();
    for any in ANY_SIZE {
        if let Some(size) = lower.strip_prefix(any.prefix) {
            return match size.parse() {
                Ok(n @ 1..=MAX_AGENTS) if n % any.group == 0 => Ok((any.family, n)),
                _ => Err(usage!("`{size}` is no team size for {}N: N {}", any.prefix, any.allowed())),
            };
        }
    }
    Err(unknown(name))
}

/// The id and the other names of the task of this family and team size.
pub(super) fn of(family: Family, n_agents: usize) -> (String, &'static [&'static str]) {
    if let Some(named) = TABLE.iter().find(|named| (named.family, named.n_agents) == (family, n_agents)) {
        return (named.id.to_string(), named.aliases);
    }
    let prefix = ANY_SIZE.iter().find(|any| any.family == family).map_or("", |any| any.prefix);
    (format!("{prefix}{n_agents}"), &[])
}

impl Named {
    fn names(&self) -> impl Iterator<Item = &'static str> {
        std::iter::once(self.id).chain(self.aliases.iter().copied())
    }
}

/// Names the tasks there are, and the one that was probably meant.
fn unknown(name: &str) -> Error {
    let meant = nearest(name).map_or(String::new(), |known| format!(" (did you mean `{known}`?)"));
    let ids = TABLE.iter().map(|named| named.id).collect::<Vec<_>>().join(", ");
    let [xy, blindfold] = ANY_SIZE.each_ref().map(|any| format!("{}N (N {})", any.prefix, any.allowed()));
    usage!("there is no task `{name}`{meant}; there are {ids}, and for other team sizes {xy} and {blindfold}")
}

/// The name fewest edits away, if these are few for its length.
fn nearest(name: &str) -> Option<&'static str> {
    let name = name.to_ascii_lowercase();
    let distance = |known: &str| edit_distance(&name, &known.to_ascii_lowercase());
    TABLE
        .iter()
        .flat_map(Named::names)
        .map(|known| (distance(known), known))
        .filter(|&(edits, known)| edits <= known.len() / 3)
        .min_by_key(|&(edits, _)| edits)
        .map(|(_, known)| known)
}

/// How many bytes must be inserted, removed or replaced to turn `from` into `to` (Levenshtein).
fn edit_distance(from: &str, to: &str) -> usize {
    // edits[k]: from the part of `from` read so far to the first k bytes of `to`.
    let mut edits: Vec<usize> = (0..=to.len()).collect();
    for (read, byte) in from.bytes().enumerate() {
        let mut replaced = std::mem::replace(&mut edits[0], read + 1);
        for (k, goal) in to.bytes().enumerate() {
            let replace = replaced + usize::from(byte != goal);
            replaced = edits[k + 1];
            edits[k + 1] = replace.min(replaced + 1).min(edits[k] + 1);
        }
    }
    edits[to.len()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::Task;

    fn id_of(name: &str) -> String {
        Task::parse(name).unwrap().id().to_string()
    }

    #[test]
    fn a_task_answers_to_all_its_names_in_any_case() {
        for task in Task::all() {
            let names = std::iter::once(task.id()).chain(task.aliases());
            for name in names {
                for written in [name.to_string(), name.to_uppercase(), name.to_lowercase()] {
                    assert_eq!(Task::parse(&written).unwrap(), task);
                }
            }
        }
        let expected = [
            ("HS", "hear-see"),
            ("SL", "speaker-listener"),
            ("SXY-2", "spread-xy-2"),
            ("SXY-4", "spread-xy-4"),
            ("SBF", "spread-blindfold"),
            ("SimpleBlindDeaf-v0", "hear-see"),
            ("SimpleSpeakerListener-v0", "speaker-listener"),
            ("SimpleSpreadXY-v0", "spread-xy-2"),
            ("SimpleSpreadXY4-v0", "spread-xy-4"),
            ("SimpleSpreadXY8-v0", "spread-xy-8"),
            ("SimpleSpreadBlind-v0", "spread-blindfold"),
            ("SimpleSpreadBlind6-v0", "spread-blindfold-6"),
            ("SimpleSpreadBlind12-v0", "spread-blindfold-12"),
            ("spread-blindfold-3", "spread-blindfold"),
        ];
        for (name, id) in expected {
            assert_eq!(id_of(name), id);
        }
    }

    #[test]
    fn spread_takes_every_team_size_it_can() {
        for n in 1..=MAX_AGENTS {
            let task = Task::parse(&format!("spread-blindfold-{n}")).unwrap();
            assert_eq!((task.n_agents(), task.n_landmarks(), task.obs_dim(0)), (n, n, 4 + 2 * n));
            assert_eq!(id_of(task.id()), task.id());
            let pairs = Task::parse(&format!("Spread-XY-{n}"));
            assert_eq!(pairs.is_ok(), n % 2 == 0);
            assert!(pairs.is_err() || pairs.unwrap().n_agents() == n);
        }
        for (name, allowed) in [("spread-xy-", "N even, from 2 to 64"), ("spread-blindfold-", "from 1 to 64")]
        {
            for size in ["0", "-2", "65", "66", "99999999999999999999", "", "N", "4 "] {
                let error = Task::parse(&format!("{name}{size}")).unwrap_err();
                assert_eq!(error.exit_code(), 2);
                assert!(error.to_string().contains(allowed), "{error}");
            }
        }
    }

    #[test]
    fn an_unknown_name_is_answered_with_those_that_exist() {
        let expected = [
            ("speaker-listner", "did you mean `speaker-listener`?"),
            ("spread-blind", "did you mean `spread-blindfold`?"),
            ("SPREAD_XY_4", "did you mean `spread-xy-4`?"),
            ("spread-xy", "did you mean `spread-xy-2`?"),
            ("simplespread", "there are hear-see, speaker-listener, spread-xy-2"),
            ("", "there is no task ``; there are"),
            ("xx", "there is no task `xx`; there are"),
            ("sch\u{f6}n", "spread-xy-N (N even, from 2 to 64) and spread-blindfold-N (N from 1 to 64)"),
        ];
        for (name, words) in expected {
            let error = Task::parse(name).unwrap_err();
            assert_eq!(error.exit_code(), 2);
            assert!(error.to_string().contains(words), "{error}");
        }
    }

    #[test]
    fn edits_are_counted() {
        for (from, to, edits) in [("", "", 0), ("", "abc", 3), ("kitten", "sitting", 3), ("flaw", "lawn", 2)]
        {
            assert_eq!(edit_distance(from, to), edits);
            assert_eq!(edit_distance(to, from), edits);
        }
    }
}
