//! The registry of environments: families of tasks and what they are called.

use super::family::{Family, Named};
use super::{hear_see, predator_prey, rendezvous, scout, simple_spread, speaker_listener, spread};
use crate::base::error::{Error, Result};
use crate::base::nearest::nearest;
use crate::base::rng::MAX_AGENTS;
use crate::usage;

/// All families. One line each, and a file.
#[rustfmt::skip]
pub(super) static FAMILIES: &[&Family] = &[
    &hear_see::FAMILY,
    &speaker_listener::FAMILY,
    &spread::XY,
    &spread::BLINDFOLD,
    &simple_spread::DISCRETE,
    &simple_spread::CONTINUOUS,
    &predator_prey::FAMILY,
    &scout::FAMILY,
    &rendezvous::FAMILY,
];

/// The family, the id and the team size that `name` stands for.
pub(super) fn find(name: &str) -> Result<(&'static Family, String, usize)> {
    let called = |named: &&Named| named.names().any(|known| known.eq_ignore_ascii_case(name));
    for family in FAMILIES {
        if let Some(named) = family.named.iter().find(called) {
            return Ok((family, named.id.to_owned(), named.n_agents));
        }
    }
    let lower = name.to_ascii_lowercase();
    let sized = |family: &&'static Family| {
        let any = family.any_size.as_ref()?;
        Some((*family, any, lower.strip_prefix(any.prefix)?))
    };
    // One prefix may begin with another.
    let longest = FAMILIES.iter().filter_map(sized).max_by_key(|(_, any, _)| any.prefix.len());
    let (family, any, size) = longest.ok_or_else(|| unknown(name))?;
    match size.parse() {
        Ok(n @ 1..=MAX_AGENTS) if n % any.group == 0 => Ok((family, format!("{}{n}", any.prefix), n)),
        _ => {
            let meant = if size.parse::<u64>().is_ok() { String::new() } else { meant(name) };
            Err(usage!("`{size}` is not a team size for {}N: N {}{meant}", any.prefix, any.allowed()))
        }
    }
}

/// The other names of a task.
pub(super) fn aliases(id: &str) -> &'static [&'static str] {
    all_named().find(|named| named.id == id).map_or(&[], |named| named.aliases)
}

/// The name of the task for a team of `n` where none is given.
pub(super) fn default_for(n: usize) -> Result<&'static str> {
    let defaults = || all_named().filter(|named| named.default_for_its_size);
    if let Some(named) = defaults().find(|named| named.n_agents == n) {
        return Ok(named.id);
    }
    let mut sizes: Vec<usize> = defaults().map(|named| named.n_agents).collect();
    sizes.sort_unstable();
    let (last, others) = sizes.split_last().expect("there are defaults");
    let others: Vec<String> = others.iter().map(usize::to_string).collect();
    Err(match n {
        1..=MAX_AGENTS => usage!(
            "there is no default task for a team of {n}, only for {} and {last} agents; name one, such as \
             `--task spread-blindfold-{n}`",
            others.join(", ")
        ),
        _ => usage!("a team has 1 to {MAX_AGENTS} agents, not {n}"),
    })
}

/// What tasks of other team sizes are called, such as `spread-xy-N (N even, from 2 to 64)`.
pub(super) fn other_sizes() -> String {
    let any = FAMILIES.iter().filter_map(|family| family.any_size.as_ref());
    let words: Vec<String> = any.map(|any| format!("{}N (N {})", any.prefix, any.allowed())).collect();
    let (last, others) = words.split_last().expect("there are families for any size");
    format!("{} and {last}", others.join(", "))
}

fn all_named() -> impl Iterator<Item = &'static Named> {
    FAMILIES.iter().flat_map(|family| family.named)
}

/// The task that was probably meant, by its id, for an error.
fn meant(name: &str) -> String {
    let known = nearest(name, all_named().flat_map(Named::names));
    let task = known.and_then(|known| all_named().find(|named| named.names().any(|name| name == known)));
    task.map_or(String::new(), |task| format!(" (did you mean `{}`?)", task.id))
}

/// Names the tasks there are, and the one that was probably meant.
fn unknown(name: &str) -> Error {
    let meant = meant(name);
    let ids = all_named().map(|named| named.id).collect::<Vec<_>>().join(", ");
    usage!("there is no task `{name}`{meant}; there are {ids}, and for other team sizes {}", other_sizes())
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
            let names = std::iter::once(task.id()).chain(task.aliases().iter().copied());
            for name in names {
                for written in [name.to_string(), name.to_uppercase(), name.to_lowercase()] {
                    assert_eq!(Task::parse(&written).unwrap().spec(), task.spec());
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
            ("simple_spread_v3", "simple-spread-3"),
        ];
        for (name, id) in expected {
            assert_eq!(id_of(name), id);
        }
    }

    #[test]
    fn spread_takes_every_team_size_it_can() {
        for n in 1..=MAX_AGENTS {
            let task = Task::parse(&format!("spread-blindfold-{n}")).unwrap();
            assert_eq!(
                (task.spec().n_agents(), task.spec().landmarks, task.spec().obs_dim(0)),
                (n, n, 4 + 2 * n)
            );
            assert_eq!(id_of(task.id()), task.id());
            let pairs = Task::parse(&format!("Spread-XY-{n}"));
            assert_eq!(pairs.is_ok(), n % 2 == 0);
            assert!(pairs.is_err() || pairs.unwrap().spec().n_agents() == n);
        }
        for (name, allowed) in [("spread-xy-", "N even, from 2 to 64"), ("spread-blindfold-", "from 1 to 64")]
        {
            for size in ["0", "-2", "65", "66", "99999999999999999999", "", "N", "4 "] {
                let error = Task::parse(&format!("{name}{size}")).unwrap_err();
                assert!(matches!(error, Error::Usage(_)), "{error:?}");
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
            ("simple_spread_v2", "did you mean `simple-spread-3`?"),
            ("simple_spread_3", "did you mean `simple-spread-3`?"),
            ("mpe2.simple_spread_v3", "did you mean `simple-spread-3`?"),
            ("simple-spread-v3", "N from 1 to 64 (did you mean `simple-spread-3`?)"),
            ("spread-xy", "did you mean `spread-xy-2`?"),
            ("simplespread", "there are hear-see, speaker-listener, spread-xy-2"),
            ("", "there is no task ``; there are"),
            ("xx", "there is no task `xx`; there are"),
            (
                "sch\u{f6}n",
                "spread-xy-N (N even, from 2 to 64), spread-blindfold-N (N from 1 to 64), simple-spread-N",
            ),
        ];
        for (name, words) in expected {
            let error = Task::parse(name).unwrap_err();
            assert!(matches!(error, Error::Usage(_)), "{error:?}");
            assert!(error.to_string().contains(words), "{error}");
        }
    }
}
