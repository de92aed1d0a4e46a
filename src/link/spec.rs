//! Links as text: `gilbert(0.1, 0.3) + delay(1)`.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use super::part::{Part, split};
use super::registry::{Argument, Model, Parameter};
use super::{CommunicationMatrix, Links, RadioLog, matrix, netem, network};
use crate::base::error::Result;
use crate::base::regular;
use crate::environment::Spec;

/// Where links are: what it takes to read them.
#[derive(Clone, Copy, Debug)]
pub struct Site {
    /// Size of the team.
    pub agents: usize,
    /// Seconds from one tick to the next, for times in seconds; `None` where nobody knows.
    pub tick: Option<f64>,
}

impl From<usize> for Site {
    /// A team of so many, somewhere.
    fn from(agents: usize) -> Site {
        Site { agents, tick: None }
    }
}

impl From<&Spec> for Site {
    /// In lockstep a tick is a step of the environment.
    fn from(spec: &Spec) -> Site {
        Site { agents: spec.n_agents(), tick: Some(spec.dt) }
    }
}

/// Models of the registry in a chain, each with its arguments: the data from which links are built.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkSpec {
    /// There is at least one.
    parts: Vec<Part>,
}

impl LinkSpec {
    /// Reads models with their arguments in parentheses, in order or by name (`level(p=0.5)`), and `+` between them. What
    /// netem takes is one of them, too. The path of an existing file alone means `matrix(FILE)`, or `trace(FILE)` if the
    /// file begins like a log.
    ///
    /// # Errors
    /// `Usage` if there is no such model, its arguments are wrong, or the links cannot be built.
    pub fn parse(text: &str, site: impl Into<Site>) -> Result<LinkSpec> {
        let (text, site) = (text.trim(), site.into());
        if Path::new(text).is_file() {
            return LinkSpec::of(&of_file(text)?, site.agents);
        }
        let read = |part| match netem::translate(part, site.tick)? {
            Some(links) => LinkSpec::parse(&links, site),
            None => LinkSpec::of(part, site.agents),
        };
        split(text, '+')
            .into_iter()
            .map(read)
            .reduce(|chain, part| chain?.then(part?))
            .expect("text has at least one part")
    }

    /// Every link delivers with probability p.
    ///
    /// # Errors
    /// `Usage` if p is no probability.
    pub fn level(p: f64) -> Result<LinkSpec> {
        LinkSpec::parse(&format!("level({p})"), 1)
    }

    /// Links by the rows of a communication matrix.
    ///
    /// # Errors
    /// `Usage` if these are none.
    pub(crate) fn fixed(rows: &[Vec<f64>], agents: usize) -> Result<LinkSpec> {
        let matrix = Argument::Matrix(Arc::new(CommunicationMatrix::of(rows, agents)?));
        Ok(LinkSpec { parts: vec![Part { model: &matrix::MODEL, arguments: vec![matrix] }] })
    }

    /// What is sent is lost or delayed by the network between machines, and by nothing else.
    pub(crate) fn network() -> LinkSpec {
        LinkSpec { parts: vec![Part { model: &network::MODEL, arguments: Vec::new() }] }
    }

    /// These links, and others behind them.
    ///
    /// # Errors
    /// `Usage` if together they postpone too much.
    pub fn then(mut self, behind: LinkSpec) -> Result<LinkSpec> {
        self.parts.extend(behind.parts);
        self.try_build()?;
        Ok(self)
    }

    /// The links, as they are before the first episode.
    pub fn build(&self) -> Links {
        self.try_build().expect("links that have been read can be built")
    }

    /// The most ticks by which anything is postponed.
    pub fn longest_delay(&self) -> u8 {
        self.build().longest_delay()
    }

    /// The p of links that are `level(p)` and nothing else.
    pub(crate) fn p(&self) -> Option<f64> {
        self.alone("level").map(Argument::number)
    }

    /// The rows of links that are `matrix(FILE)` and nothing else.
    pub(crate) fn matrix(&self) -> Option<&CommunicationMatrix> {
        self.alone("matrix").map(|argument| &**argument.matrix())
    }

    /// The models, in the order of the chain.
    pub fn models(&self) -> impl Iterator<Item = &'static Model> {
        self.parts.iter().map(|part| part.model)
    }

    /// The parameters that are numbers, with their values, in the order of the chain.
    pub(crate) fn numbers(&self) -> Vec<(&'static str, f64)> {
        let number = |(parameter, argument): (&Parameter, &Argument)| match argument {
            Argument::Number(value) => Some((parameter.name, *value)),
            _ => None,
        };
        let of_part = |part: &Part| {
            let parameters = part.model.parameters.iter().zip(&part.arguments);
            parameters.filter_map(number).collect::<Vec<_>>()
        };
        self.parts.iter().flat_map(of_part).collect()
    }

    /// The matrices that have been read for it, in the order of the chain.
    pub fn matrices(&self) -> impl Iterator<Item = &CommunicationMatrix> {
        self.parts.iter().flat_map(|part| &part.arguments).filter_map(|argument| match argument {
            Argument::Matrix(matrix) => Some(&**matrix),
            _ => None,
        })
    }

    /// The same of logs.
    pub fn logs(&self) -> impl Iterator<Item = &RadioLog> {
        self.parts.iter().flat_map(|part| &part.arguments).filter_map(|argument| match argument {
            Argument::Log(log) => Some(&**log),
            _ => None,
        })
    }

    /// What recordings call the links: only the name for a model whose p or matrix they hold beside it, else all of the
    /// text.
    pub(crate) fn recorded_name(&self) -> String {
        match &self.parts[..] {
            [part] if self.p().is_some() || self.matrix().is_some() => part.model.name.to_owned(),
            _ => self.to_string(),
        }
    }

    /// What the links do, for people.
    pub(crate) fn about(&self) -> String {
        match &self.parts[..] {
            [part] if part.model.parameters.iter().all(|parameter| parameter.domain.is_file()) => {
                part.model.about.to_owned()
            }
            _ => self.to_string(),
        }
    }

    /// One model with its arguments.
    fn of(text: &str, agents: usize) -> Result<LinkSpec> {
        Ok(LinkSpec { parts: vec![Part::read(text, agents)?] })
    }

    fn try_build(&self) -> Result<Links> {
        Links::chain(self.parts.iter().map(Part::build).collect::<Result<_>>()?)
    }

    /// The argument of a model of this name that stands alone.
    fn alone(&self, name: &str) -> Option<&Argument> {
        match &self.parts[..] {
            [Part { model, arguments }] if model.name == name => arguments.first(),
            _ => None,
        }
    }
}

impl fmt::Display for LinkSpec {
    /// As it is read, but for the path of a matrix.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let parts: Vec<String> = self.parts.iter().map(Part::to_string).collect();
        f.write_str(&parts.join(" + "))
    }
}

/// The model that a file alone stands for.
fn of_file(path: &str) -> Result<String> {
    /// The most bytes that are looked at.
    const BEGINNING: u64 = 64;
    let is_log = RadioLog::is_log(&String::from_utf8_lossy(&regular::beginning(Path::new(path), BEGINNING)?));
    Ok(format!("{}({path})", if is_log { "trace" } else { "matrix" }))
}

#[cfg(test)]
mod tests {
    use super::super::testing::{STEPS, rows};
    use super::*;
    use crate::base::error::Error;

    #[test]
    fn links_are_read_as_they_are_written() {
        for (text, canonical) in [
            ("level(0.50)", "level(0.5)"),
            (" level ( p = 0.5 ) ", "level(0.5)"),
            ("uniform", "uniform"),
            ("uniform()+level(1)", "uniform + level(1)"),
            ("dynamic + level(0.25)+asymmetric", "dynamic + level(0.25) + asymmetric"),
            ("gilbert(0.1, 0.3)", "gilbert(0.1, 0.3)"),
            ("gilbert(burst=10, loss=0.8)", "gilbert(loss=0.8, burst=10)"),
            ("gemodel(0.1, 0.3, 1-k=0.2)", "gemodel(0.1, 0.3, 1, 0.2)"),
            ("budget(64)", "budget(64, turns)"),
            ("jam(3, 9) + jam(0, 0, 0.5)", "jam(3, 9) + jam(x=0, y=0, radius=0.5)"),
        ] {
            let spec = LinkSpec::parse(text, 3).unwrap();
            assert_eq!(spec.to_string(), canonical);
            assert_eq!(LinkSpec::parse(canonical, 3).unwrap().to_string(), canonical);
        }
        assert_eq!(LinkSpec::parse("level(0.3)", 2).unwrap().p(), Some(0.3));
        assert_eq!(LinkSpec::parse("level(0.3) + level(0.3)", 2).unwrap().p(), None);
        assert_eq!(LinkSpec::level(0.1).unwrap().recorded_name(), "level");
        let network = LinkSpec::network();
        assert_eq!(
            (network.recorded_name(), network.p(), network.longest_delay()),
            ("network".to_owned(), None, 0)
        );
        assert!(LinkSpec::parse("network", 4).is_err(), "there is none but between hosts");
    }

    #[test]
    fn a_file_is_a_matrix_by_itself_and_in_a_chain() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("who (a=b, c+d).txt");
        std::fs::write(&file, "1 0\n1 1\n").unwrap();
        let path = file.display();
        let alone = LinkSpec::parse(&path.to_string(), 2).unwrap();
        assert_eq!((alone.recorded_name(), alone.matrix().unwrap().p(0, 1)), ("matrix".to_owned(), 0.0));
        let error = LinkSpec::parse(&path.to_string(), 3).unwrap_err().to_string();
        assert!(error.contains("3 agents need 3 rows"), "{error}");
        let plain = folder.path().join("matrix.txt");
        std::fs::rename(&file, &plain).unwrap();
        let chain = format!("level(1) + matrix({})", plain.display());
        assert_eq!(rows(&chain, 0, 1, 2), [0b01, 0b11]);
    }

    #[test]
    fn what_is_delivered_is_what_all_deliver_by_draws_of_their_own() {
        let (mut alone, mut both) = (0, 0);
        for step in 1..STEPS {
            let [a, twice] = ["level(0.5)", "level(0.5) + level(0.5)"].map(|text| rows(text, 4, step, 6));
            let three = rows("level(0.5) + level(0.5) + uniform", 4, step, 6);
            for ((a, twice), three) in a.iter().zip(&twice).zip(&three) {
                assert_eq!((twice & !a, three & !twice), (0, 0), "behind a link nothing comes back");
                alone += a.count_ones();
                both += twice.count_ones();
            }
        }
        let others = |count: u32| f64::from(count - 6 * 24) / (30.0 * 24.0);
        // Five sigma of 720 draws are 0.09 and 0.08.
        assert!((others(alone) - 0.5).abs() < 0.09 && (others(both) - 0.25).abs() < 0.08);
    }

    #[test]
    fn wrong_links_say_what_would_be_right() {
        for (text, words) in [
            ("levle(0.5)", "no links `levle`, and no file of that name; the nearest is `level`"),
            ("", "a model of links is missing; there are level(p), matrix(FILE), uniform"),
            ("level(0.5) +", "a model of links is missing"),
            ("level", "`p` is missing; expected level(p)"),
            ("level()", "`p` is missing"),
            ("level(2)", "p: `2` is not a probability from 0 to 1"),
            ("level(nan)", "p: `nan` is not a probability"),
            ("level(0.5, 1)", "`1` is one argument too many"),
            ("level(0.5, p=1)", "`p` is given twice"),
            ("level([0.5, 1])", "is for `evaluate --links` alone"),
            ("level(q=1)", "there is no parameter `q`"),
            ("level(0.5", "a `)` is missing"),
            ("uniform(1)", "`1` is one argument too many; expected uniform"),
            (
                "gilbert(0.8, 10)",
                "r: `10` is not a probability from 0 to 1; expected gilbert(p, r) or gilbert(loss, burst)",
            ),
            ("gilbert(loss=0.8, burst=0.5)", "burst: `0.5` is not a number of steps from 1 to 1000000"),
            ("gilbert(loss=0.8, burst=2)", "burst must be at least loss / (1 - loss) = 4"),
            ("gilbert(loss=0.8, r=0.1)", "there is no parameter `loss`"),
            ("gemodel(0.1, 0.3, 2)", "1-h: `2` is not a probability"),
            ("range(-1)", "max: `-1` is not a number of metres from 0 to 1000000"),
            ("range(1, sigma=-2)", "sigma: `-2` is not a variance in dB squared from 0 to 10000"),
            ("budget(0)", "bytes: `0` is not a whole number of bytes from 1 to"),
            ("budget(64, luck)", "who: `luck` is not turns or priority"),
            ("tdma(65)", "slots: `65` is not a whole number of slots from 1 to 64"),
            ("jam(9, 3)", "until must be above from = 9"),
            ("jam(0, 0, radius=-1)", "radius: `-1` is not a number of metres from 0"),
            ("latency(100, 1)", "up to 101 ticks"),
            ("trace(no such file)", "no such file"),
            ("matrix(no such file)", "no such file"),
        ] {
            let error = LinkSpec::parse(text, 2).unwrap_err();
            assert!(matches!(error, Error::Usage(_)), "{text}: {error:?}");
            assert!(error.to_string().contains(words), "{text}: {error}");
        }
    }
}
