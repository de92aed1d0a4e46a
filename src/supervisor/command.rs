//! The program that runs an agent.

use std::ffi::OsString;
use std::fmt;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::Command;
use std::sync::OnceLock;

use crate::base::error::Result;
use crate::failed;

/// This program, even if its file has been replaced since it started.
const SELF: &str = "/proc/self/exe";

/// How this program is started once more, if it has called [`run_if_agent`](crate::run_if_agent), so that it can run as
/// an agent.
static THIS_PROGRAM: OnceLock<AgentCommand> = OnceLock::new();

/// The program that is run for an agent. Its last two words are `agent` and the settings, as JSON. One that is not this
/// program may be in any language: `docs/protocol.md` says what it has to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AgentCommand {
    program: PathBuf,
    words: Vec<OsString>,
}

impl AgentCommand {
    /// Another program, which must call [`run_if_agent`](crate::run_if_agent).
    pub fn new(program: impl Into<PathBuf>) -> AgentCommand {
        AgentCommand { program: program.into(), words: Vec::new() }
    }

    /// Adds a word in front of the last two.
    pub fn word(mut self, word: impl Into<OsString>) -> AgentCommand {
        self.words.push(word.into());
        self
    }

    /// The program and the words that a shell would make of a line, which is run without one: quotes and backslashes count,
    /// variables and patterns do not.
    ///
    /// # Errors
    /// `Usage` if a quote is not closed, or there is no word.
    #[cfg(feature = "cli")]
    pub fn parse(line: &str) -> Result<AgentCommand> {
        let words = shlex::split(line).ok_or_else(|| {
            crate::usage!("the command `{line}` has a quote or backslash that nothing follows")
        })?;
        let (program, words) =
            words.split_first().ok_or_else(|| crate::usage!("the command has no words"))?;
        Ok(words.iter().fold(AgentCommand::new(program), |command, word| command.word(word)))
    }

    /// This very program.
    ///
    /// # Errors
    /// `Failed` if it has not called [`run_if_agent`](crate::run_if_agent). It would start itself over and over.
    pub fn this_program() -> Result<AgentCommand> {
        THIS_PROGRAM.get().cloned().ok_or_else(|| {
            failed!(
                "this program cannot start itself as an agent; call \
                 `vamaro_swarm::run_if_agent` first thing in `main`, or name the program to run for an agent (AgentCommand)"
            )
        })
    }

    /// Notes that this program can run as an agent, and that its file is all it takes to start it.
    pub(crate) fn allow_this_program() {
        AgentCommand::new(SELF).stand_for_this_program();
    }

    /// Notes that this command starts this program, which can run as an agent. What was noted first holds.
    pub(crate) fn stand_for_this_program(self) {
        let _ = THIS_PROGRAM.set(self);
    }

    /// The command that does `what` with these settings.
    pub(super) fn command(&self, what: &str, settings: &str) -> Command {
        let mut command = self.start();
        command.args([what, settings]);
        command
    }

    /// The command without the last two words.
    pub(crate) fn start(&self) -> Command {
        let mut command = Command::new(&self.program);
        if self.program.as_os_str() == SELF {
            command.arg0("vamaro-swarm");
        }
        command.args(&self.words);
        command
    }
}

impl fmt::Display for AgentCommand {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}", self.program.display())?;
        self.words.iter().try_for_each(|word| write!(f, " {}", word.display()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::AgentSettings;
    use crate::bus::Wait;
    use crate::environment::Task;
    use crate::supervisor::Processes;

    #[test]
    fn a_program_that_has_not_said_that_it_can_be_an_agent_starts_none() {
        // Nothing in this test binary says so.
        let settings = AgentSettings::of(Task::parse("hear-see").unwrap().spec());
        let policy = settings.policy.load(&settings.spec).unwrap();
        let error = Processes::start(&settings, &policy, Wait::Block).unwrap_err().to_string();
        assert!(error.contains("run_if_agent") && error.contains("first thing in `main`"), "{error}");
    }

    #[test]
    #[cfg(feature = "cli")]
    fn a_line_becomes_the_words_that_a_shell_makes_of_it() {
        let line = "python3 'my agent.py' --name=\"two words\" $HOME";
        let command = AgentCommand::parse(line).unwrap().command("agent", "{}");
        assert_eq!(command.get_program(), "python3");
        let words: Vec<_> = command.get_args().collect();
        assert_eq!(words, ["my agent.py", "--name=two words", "$HOME", "agent", "{}"]);
        for (line, why) in [("python3 'agent.py", "quote"), ("  ", "no words")] {
            let error = AgentCommand::parse(line).unwrap_err().to_string();
            assert!(error.contains(why), "{error}");
        }
    }

    #[test]
    fn the_words_of_a_command_come_before_what_an_agent_is_told() {
        let command = AgentCommand::new("python3").word("-u").word("agent.py").command("agent", "{}");
        assert_eq!(command.get_program(), "python3");
        assert_eq!(command.get_args().collect::<Vec<_>>(), ["-u", "agent.py", "agent", "{}"]);
    }
}
