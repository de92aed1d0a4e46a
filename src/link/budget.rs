//! A channel that all share, with room for so many bytes a tick.

use super::{Context, Domain, Fates, Link, Model, Parameter};
use crate::base::error::Result;
use crate::usage;

/// `budget(bytes, who)`: as many observations are sent at each tick as fit into so many bytes, each to everybody. The
/// others are dropped.
///
/// Each agent has one observation to send at each tick. By `turns`, those begin who follow in number on the last that
/// sent; by `priority`, those with the lowest numbers always send.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    bytes: usize,
    by_turns: bool,
}

/// Its line in the registry.
pub(super) const MODEL: Model = Model {
    name: "budget",
    about: "a shared channel with room for this many bytes a tick: agents send in turn, or by priority",
    parameters: &[
        Parameter { name: "bytes", domain: Domain::Whole("bytes", 1.0, 1e9), default: None },
        Parameter { name: "who", domain: Domain::Word(&["turns", "priority"]), default: Some("turns") },
    ],
    build: |arguments| {
        let (bytes, by_turns) = (arguments[0].number() as usize, arguments[1].word() == "turns");
        Ok(Box::new(Budget { bytes, by_turns }))
    },
};

impl Link for Budget {
    fn deliveries(&mut self, context: &Context, fates: &mut Fates) -> Result<()> {
        let (agents, fit) = (fates.agents(), self.bytes / context.bytes);
        if fit == 0 {
            let fitting: Vec<String> = (1..=agents).map(|n| (n * context.bytes).to_string()).collect();
            let fitting = match &fitting[..] {
                [one, two, .., all] if agents > 4 => format!("{one}, {two}, .., {all}"),
                _ => fitting.join(", "),
            };
            return Err(usage!(
                "budget: bytes = {} is less than a message of this team has, {}; these hold 1 to {agents} messages: \
                 {fitting}",
                self.bytes,
                context.bytes
            ));
        }
        let first = if self.by_turns { context.address.step as usize * fit } else { 0 };
        fates.silence(|sender| (sender + agents - first % agents) % agents >= fit);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{STEPS, context, links, rows};
    use super::*;

    /// Who is heard at each step in a team of six, whose observations have 32 bytes each.
    fn heard(text: &str) -> Vec<Vec<usize>> {
        let by = |row: u64| (1..6).filter(|sender| row >> sender & 1 == 1).collect();
        // Agent 0 receives everybody but itself by links.
        (1..STEPS).map(|step| by(rows(text, 0, step, 6)[0])).collect()
    }

    #[test]
    fn by_turns_all_are_heard_equally_often() {
        // At step 1 the second and third speak, at step 2 the fourth and fifth, then the first two.
        for text in ["budget(64)", "budget(bytes=95, who=turns)"] {
            let heard = heard(text);
            assert_eq!(heard[..4], [vec![2, 3], vec![4, 5], vec![1], vec![2, 3]], "{text}");
            let loss = 1.0 - heard.iter().flatten().filter(|sender| **sender == 4).count() as f64 / 24.0;
            assert!((loss - 2.0 / 3.0).abs() < 1e-12, "{text}: {loss}");
        }
        assert!(heard("budget(192)").iter().all(|heard| heard.len() == 5));
    }

    #[test]
    fn by_priority_the_first_are_always_heard() {
        assert!(heard("budget(64, priority)").iter().all(|heard| heard[..] == [1]));
        assert_eq!(rows("budget(32, priority)", 3, 7, 3), [0b001, 0b011, 0b101]);
    }

    #[test]
    fn less_than_one_observation_is_refused() {
        let error =
            links("budget(31)").deliveries(&context(0, 1), &mut Fates::new(4)).unwrap_err().to_string();
        assert!(error.contains("bytes = 31") && error.ends_with("messages: 32, 64, 96, 128"), "{error}");
        let error =
            links("budget(31)").deliveries(&context(0, 1), &mut Fates::new(9)).unwrap_err().to_string();
        assert!(error.ends_with("1 to 9 messages: 32, 64, .., 288"), "{error}");
    }
}
