//! How long a supervisor and its hosts wait for each other: on a bad network all of it is longer.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::supervisor::parse_duration;

/// The longest silence: who has not been heard of for so long is gone. Either side is heard of four times as often. It has
/// to be the same on all machines of a swarm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub(crate) struct Patience {
    ms: u64,
}

impl Default for Patience {
    fn default() -> Patience {
        Patience { ms: 2000 }
    }
}

impl Patience {
    /// Reads one, such as `10s`.
    pub(crate) fn parse(text: &str) -> Result<Patience, String> {
        const SENSIBLE: std::ops::RangeInclusive<Duration> =
            Duration::from_secs(1)..=Duration::from_secs(300);
        let silence = parse_duration(text).filter(|silence| SENSIBLE.contains(silence));
        let silence = silence.ok_or("expected a time from 1s to 300s, such as 10s")?;
        Ok(Patience { ms: silence.as_millis() as u64 })
    }

    /// The longest silence.
    pub(crate) fn silence(self) -> Duration {
        Duration::from_millis(self.ms)
    }

    /// For a host to be connected to, to answer a question, or to leave once its agents have.
    pub(super) fn reply(self) -> Duration {
        self.silence() * 3 / 2
    }

    /// For a host to receive a policy and to make room for the agents.
    pub(super) fn join(self) -> Duration {
        self.silence() * 15
    }

    /// For a supervisor to be there after it has asked a host to join.
    pub(super) fn arrival(self) -> Duration {
        self.silence() * 5 / 2
    }
}

impl TryFrom<String> for Patience {
    type Error = String;

    fn try_from(text: String) -> Result<Patience, String> {
        Patience::parse(&text)
    }
}

impl From<Patience> for String {
    fn from(patience: Patience) -> String {
        format!("{}ms", patience.ms)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_read_as_it_is_written() {
        let patience = Patience::parse("10s").unwrap();
        assert_eq!(Patience::parse(&String::from(patience)), Ok(patience));
        for wrong in ["10", "0s", "999ms", "301s", "-1s", "1e30s"] {
            assert!(Patience::parse(wrong).is_err(), "{wrong}");
        }
    }
}
