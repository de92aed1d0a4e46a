//! What a radio did, played again.

use std::path::Path;
use std::sync::Arc;

use super::{Context, Domain, Fates, LONGEST_DELAY, Link, Model, Parameter};
use crate::base::error::Result;
use crate::base::hash::fnv1a;
use crate::base::regular;
use crate::base::rng::Purpose;
use crate::usage;

/// The most bytes the file of a log may have.
const LARGEST: u64 = 1 << 26;

/// How the file begins, without and with delays.
const COLUMNS: [&str; 2] = ["step,receiver,sender,delivered", "step,receiver,sender,delivered,delay"];

/// `trace(FILE)`: deliveries and delays as a log has them.
///
/// Each episode begins at a step of the log that is drawn, and goes on from the log's end with its beginning. So at every
/// step the mean loss of a link is that of its log.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace(pub Arc<RadioLog>);

/// Its line in the registry.
pub(super) const MODEL: Model = Model {
    name: "trace",
    about: "replays a log of a radio, from a random step of the log in each episode",
    parameters: &[Parameter { name: "FILE", domain: Domain::Log, default: None }],
    build: |arguments| Ok(Box::new(Trace(arguments[0].log().clone()))),
};

impl Link for Trace {
    fn deliveries(&mut self, context: &Context, fates: &mut Fates) -> Result<()> {
        let log = &*self.0;
        let begin = context.address.at_step(0).draws(Purpose::Log).below(log.steps);
        let step = (begin + context.address.step as usize) % log.steps;
        let of_step = &log.ticks[step * log.agents * log.agents..][..log.agents * log.agents];
        for (link, ticks) in of_step.iter().enumerate() {
            let (receiver, sender) = (link / log.agents, link % log.agents);
            match ticks {
                Some(ticks) => fates.postpone(receiver, sender, *ticks),
                None => fates.lose(receiver, sender),
            }
        }
        Ok(())
    }

    fn longest_delay(&self) -> u8 {
        self.0.longest_delay
    }
}

/// Which observations arrived, and after how many ticks, as it was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct RadioLog {
    /// Where it was read; nothing if it was not in a file.
    path: String,
    agents: usize,
    steps: usize,
    /// Ticks from sending to arrival, `[step, receiver, sender]`; `None` for what never arrived.
    ticks: Vec<Option<u8>>,
    /// The largest of them.
    longest_delay: u8,
}

impl RadioLog {
    /// Whether a text begins like a log.
    pub(super) fn is_log(text: &str) -> bool {
        text.trim_start_matches('\u{feff}').starts_with(COLUMNS[0])
    }

    /// Reads the log of a team of `agents` from a file, see [`RadioLog::parse`].
    pub fn read(path: &Path, agents: usize) -> Result<RadioLog> {
        let text = regular::read_text(path, LARGEST)?;
        let log = RadioLog::parse(&text, agents);
        let log = log.map_err(|e| usage!("log of a radio {}: {e}", path.display()))?;
        Ok(RadioLog { path: path.display().to_string(), ..log })
    }

    /// Where it was read.
    pub(super) fn path(&self) -> &str {
        &self.path
    }

    /// Parses CSV: the columns `step,receiver,sender,delivered`, and `delay` where there are any; a row for each step from
    /// 0 on and each link from one agent to another, in any order.
    pub fn parse(text: &str, agents: usize) -> Result<RadioLog> {
        let mut lines = text.trim_start_matches('\u{feff}').lines().map(str::trim).zip(1..);
        let header = lines.next().map_or("", |(header, _)| header);
        let columns = COLUMNS.iter().find(|columns| **columns == header).ok_or_else(|| {
            usage!("line 1: `{header}` is not `{}`, followed by `,delay` if there are delays", COLUMNS[0])
        })?;
        let columns = columns.split(',').count();
        let rows: Vec<(&str, usize)> = lines.filter(|(line, _)| !line.is_empty()).collect();
        if rows.is_empty() {
            return Err(usage!("it has no rows"));
        }
        let (links, of_step) = (agents * agents, agents * agents.saturating_sub(1));
        // Of a log without holes.
        let steps = rows.len().div_ceil(of_step.max(1));
        // What the log says nothing of is `None`.
        let mut found: Vec<Option<Option<u8>>> = vec![None; steps * links];
        for (line, number) in rows {
            let row = Row::parse(line, columns, agents, steps).map_err(|e| usage!("line {number}: {e}"))?;
            if found[row.link(agents)].replace(row.ticks).is_some() {
                return Err(usage!("line {number}: {row} is given twice"));
            }
        }
        let own = |at: usize| at % links / agents == at % agents;
        if let Some(hole) = (0..found.len()).find(|at| found[*at].is_none() && !own(*at)) {
            let (step, receiver, sender) = (hole / links, hole % links / agents, hole % agents);
            let row = Row { step, receiver, sender, ticks: None };
            return Err(usage!(
                "{row} is missing; a log has a row for each step from 0 on and each link from one of {agents} agents to \
                 another"
            ));
        }
        let ticks: Vec<Option<u8>> = found.into_iter().map(|ticks| ticks.unwrap_or(Some(0))).collect();
        let longest_delay = ticks.iter().flatten().copied().max().unwrap_or_default();
        Ok(RadioLog { path: String::new(), agents, steps, ticks, longest_delay })
    }

    /// Tells logs apart, 16 hexadecimal digits (FNV-1a).
    pub(crate) fn fingerprint(&self) -> String {
        let bytes = self.ticks.iter().map(|ticks| ticks.unwrap_or(u8::MAX));
        format!("{:016x}", fnv1a(bytes))
    }
}

/// A row of a log.
struct Row {
    step: usize,
    receiver: usize,
    sender: usize,
    ticks: Option<u8>,
}

impl Row {
    fn parse(line: &str, columns: usize, agents: usize, steps: usize) -> Result<Row> {
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        if fields.len() != columns {
            return Err(usage!("it has {} fields, not {columns}", fields.len()));
        }
        let whole = |at: usize, name: &str, most: usize| match fields[at].parse() {
            Ok(value) if value <= most => Ok(value),
            _ => Err(usage!("{name}: `{}` is not a whole number from 0 to {most}", fields[at])),
        };
        let last = agents.saturating_sub(1);
        let step = whole(0, "step", steps - 1)
            .map_err(|e| usage!("{e}, the steps of a log with so many rows; are some missing?"))?;
        let (receiver, sender) = (whole(1, "receiver", last)?, whole(2, "sender", last)?);
        if receiver == sender {
            return Err(usage!("agent {sender} has no link to itself"));
        }
        let delivered = whole(3, "delivered", 1)? == 1;
        let delay = match fields.get(4) {
            Some(&"") | None => 0,
            Some(_) if !delivered => {
                return Err(usage!("delay: what is not delivered has no delay; leave it empty"));
            }
            Some(_) => whole(4, "delay", LONGEST_DELAY.into())? as u8,
        };
        Ok(Row { step, receiver, sender, ticks: delivered.then_some(delay) })
    }

    /// Its place in a log of `agents`.
    fn link(&self, agents: usize) -> usize {
        (self.step * agents + self.receiver) * agents + self.sender
    }
}

impl std::fmt::Display for Row {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let Row { step, receiver, sender, .. } = self;
        write!(f, "the row of step {step}, receiver {receiver}, sender {sender}")
    }
}

#[cfg(test)]
mod tests {
    use super::super::Links;
    use super::super::testing::{STEPS, context};
    use super::*;

    /// Four steps of two agents: agent 0 receives the first three, the second of them late; agent 1 only the last.
    const LOG: &str = "step,receiver,sender,delivered,delay\n0,0,1,1,\n0,1,0,0,\n1,0,1,1,2\n1,1,0,0,\n\
                       3,1,0,1,0\n3,0,1,0,\n2,0,1,1,0\n2,1,0,0,\n";

    #[test]
    fn an_episode_is_a_part_of_the_log() {
        let mut links =
            Links::from(Trace(Arc::new(RadioLog::parse(LOG, 2).unwrap()))).sharing_at_start(false);
        assert_eq!(links.longest_delay(), 2);
        let (mut fates, mut begins) = (Fates::new(2), [0; 4]);
        for episode in 0..400 {
            let mut seen = |step| {
                links.deliveries(&context(episode, step), &mut fates).unwrap();
                (fates.delay(0, 1), fates.delay(1, 0))
            };
            let all: Vec<_> = (0..STEPS).map(&mut seen).collect();
            let begin = (3 + 4 - all.iter().position(|(_, back)| back.is_some()).unwrap()) % 4;
            begins[begin] += 1;
            let log = [(Some(0), None), (Some(2), None), (Some(0), None), (None, Some(0))];
            assert!((0..STEPS as usize).all(|step| all[step] == log[(begin + step) % 4]), "{all:?}");
        }
        // So every step has the mean loss of the log. Five sigma of 400 draws of a quarter are 43.
        assert!(begins.iter().all(|count: &i32| (count - 100).abs() < 43), "{begins:?}");
    }

    #[test]
    fn wrong_logs_say_what_is_wrong() {
        let header = "step,receiver,sender,delivered\n";
        for (text, words) in [
            ("", "line 1: `` is not `step,receiver,sender,delivered`"),
            ("step,receiver,sender\n", "line 1"),
            (header, "no rows"),
            (&format!("{header}0,0,1,1\n"), "the row of step 0, receiver 1, sender 0 is missing"),
            (
                &format!("{header}1,0,1,1\n1,1,0,1\n"),
                "step: `1` is not a whole number from 0 to 0, the steps of a log",
            ),
            (
                &format!("{header}1,0,1,1\n1,1,0,1\n0,1,0,1\n"),
                "the row of step 0, receiver 0, sender 1 is missing",
            ),
            (
                &format!("{header}0,0,1,1\n\n0,0,1,0\n"),
                "line 4: the row of step 0, receiver 0, sender 1 is given twice",
            ),
            (&format!("{header}0,0,1\n"), "line 2: it has 3 fields, not 4"),
            (&format!("{header}0,0,2,1\n"), "sender: `2` is not a whole number from 0 to 1"),
            (&format!("{header}0,0,1,2\n"), "delivered: `2` is not a whole number from 0 to 1"),
            (&format!("{header}0,1,1,1\n"), "agent 1 has no link to itself"),
            (
                &format!("{},delay\n0,0,1,1,101\n", header.trim()),
                "delay: `101` is not a whole number from 0 to 100",
            ),
            (&format!("{},delay\n0,0,1,0,1\n", header.trim()), "what is not delivered has no delay"),
        ] {
            let message = RadioLog::parse(text, 2).unwrap_err().to_string();
            assert!(message.contains(words), "{text:?}: {message}");
        }
    }

    #[test]
    fn logs_are_told_apart() {
        let log = |text: &str| RadioLog::parse(text, 2).unwrap().fingerprint();
        assert_eq!(log(LOG), log(&LOG.replace("2,0,1,1,0", "2,0,1,1,")));
        assert_ne!(log(LOG), log(&LOG.replace("1,0,1,1,2", "1,0,1,1,1")));
    }
}
