//! A swarm for programs of your own, and its builder.

use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::agent::{AgentSettings, PolicySource, Registry};
use crate::base::error::{Error, Result};
use crate::base::scheduling::Scheduling;
use crate::bus::Wait;
use crate::environment::{Environment, Task};
use crate::failed;
use crate::link::{Link, LinkSpec, Links, Site};
use crate::supervisor::{
    AgentCommand, Conduct, Deadlines, InProcess, Ledger, Observer, OnFailure, Processes, Session, Statistics,
};

/// A swarm that plays episodes. Dropping it ends its agents and leaves nothing behind.
///
/// It stays in the thread that built it. Its agents end when the process ends, not when that thread does.
pub struct Swarm {
    session: Session,
    ledger: Ledger<'static>,
    agents: Agents,
}

enum Agents {
    Processes(Box<Processes>),
    Here(Box<InProcess>),
    /// Taken down, after a failure.
    Gone,
}

/// Builds a [`Swarm`]. What you do not set has the default of `vamaro-swarm spawn`.
#[derive(Debug)]
pub struct SwarmBuilder {
    environment: EnvironmentChoice,
    links: LinkChoice,
    policy: PolicySource,
    imputer: Option<String>,
    registry: Registry,
    greedy: bool,
    seed: u64,
    worlds: usize,
    in_process: bool,
    relay: bool,
    recordable: bool,
    conduct: Conduct,
}

/// What is played: the name of a task, a [`Task`], or an [`Environment`] of your own.
#[derive(Debug)]
pub struct EnvironmentChoice(Played);

enum Played {
    Name(String),
    Task(Task),
    Environment(Box<dyn Environment>),
}

/// The links: text such as `gilbert(0.1, 0.3) + delay(1)`, [`Links`], or a [`Link`] of your own.
#[derive(Debug)]
pub struct LinkChoice(Linked);

#[derive(Debug)]
enum Linked {
    Words(String),
    Links(Links),
}

impl Swarm {
    /// Begins to build a swarm.
    pub fn builder() -> SwarmBuilder {
        SwarmBuilder {
            environment: "hear-see".into(),
            links: "level(1)".into(),
            policy: PolicySource::Builtin,
            imputer: None,
            registry: Registry::default(),
            greedy: false,
            seed: 0,
            worlds: 1,
            in_process: false,
            relay: false,
            recordable: false,
            conduct: Conduct::default(),
        }
    }

    /// Plays this many more episodes. Returns the statistics of all episodes so far.
    ///
    /// # Errors
    /// Whatever the environment, the links or the agents fail with. The swarm is then down.
    pub fn play(&mut self, episodes: u64) -> Result<&Statistics> {
        self.play_before(episodes, &mut [])
    }

    /// The same, while these observers look on.
    ///
    /// # Errors
    /// As [`Swarm::play`]; whatever an observer fails with.
    pub fn play_before(&mut self, episodes: u64, observers: &mut [&mut dyn Observer]) -> Result<&Statistics> {
        let Swarm { session, ledger, agents } = self;
        let mut all: Vec<&mut dyn Observer> = vec![ledger];
        all.extend(observers.iter_mut().map(|observer| &mut **observer as &mut dyn Observer));
        let end = session.next_episode().saturating_add(episodes);
        // Nothing is used again after a panic, except what the ledger has counted of earlier episodes.
        let played = catch_unwind(AssertUnwindSafe(|| match agents {
            Agents::Processes(team) => session.play(&mut **team, end, &mut all),
            Agents::Here(team) => session.play(&mut **team, end, &mut all),
            Agents::Gone => Err(failed!("this swarm was shut down after a failure; build another one")),
        }));
        let played = played.unwrap_or_else(|panic| Err(Error::outside(words_of(&*panic))));
        if played.is_err() {
            self.agents = Agents::Gone;
        }
        played.map(|()| self.ledger.statistics())
    }

    /// The statistics of the episodes so far.
    pub fn statistics(&self) -> &Statistics {
        self.ledger.statistics()
    }

    /// The agents, if they are processes.
    pub fn processes(&self) -> Option<&Processes> {
        match &self.agents {
            Agents::Processes(team) => Some(team),
            Agents::Here(_) | Agents::Gone => None,
        }
    }
}

/// What a panic said.
fn words_of(panic: &(dyn std::any::Any + Send)) -> String {
    let words = panic.downcast_ref::<String>().map(String::as_str);
    let words = words.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("nothing was said");
    format!("the environment, a link or an observer panicked ({words}); the swarm has been taken down")
}

impl SwarmBuilder {
    /// What is played.
    pub fn environment(self, environment: impl Into<EnvironmentChoice>) -> SwarmBuilder {
        SwarmBuilder { environment: environment.into(), ..self }
    }

    /// The links between the agents.
    pub fn links(self, links: impl Into<LinkChoice>) -> SwarmBuilder {
        SwarmBuilder { links: links.into(), ..self }
    }

    /// Where the policy comes from.
    pub fn policy(self, policy: PolicySource) -> SwarmBuilder {
        SwarmBuilder { policy, ..self }
    }

    /// The imputer, by its name in the registry or among the predictors of the policy.
    pub fn imputer(self, name: impl Into<String>) -> SwarmBuilder {
        SwarmBuilder { imputer: Some(name.into()), ..self }
    }

    /// The registry of imputers: the one that [`run_if_agent`](crate::run_if_agent) gets.
    pub fn registry(self, registry: &Registry) -> SwarmBuilder {
        SwarmBuilder { registry: registry.clone(), ..self }
    }

    /// Takes the most probable action instead of sampling.
    pub fn greedy(self) -> SwarmBuilder {
        SwarmBuilder { greedy: true, ..self }
    }

    /// The seed of every random draw.
    pub fn seed(self, seed: u64) -> SwarmBuilder {
        SwarmBuilder { seed, ..self }
    }

    /// The number of parallel worlds, unless the environment has its own.
    pub fn worlds(self, worlds: usize) -> SwarmBuilder {
        SwarmBuilder { worlds, ..self }
    }

    /// Runs the same agents without processes; same results, bit for bit.
    pub fn in_process(self) -> SwarmBuilder {
        SwarmBuilder { in_process: true, ..self }
    }

    /// How processes wait for each other.
    pub fn wait(mut self, wait: Wait) -> SwarmBuilder {
        self.conduct.wait = wait;
        self
    }

    /// Plays against the clock, with this many ticks a second.
    pub fn rate(mut self, rate: f64) -> SwarmBuilder {
        self.conduct.rate = Some(rate);
        self
    }

    /// What processes ask the kernel for.
    pub fn scheduling(mut self, scheduling: Scheduling) -> SwarmBuilder {
        self.conduct.scheduling = scheduling;
        self
    }

    /// How long processes may take for each phase.
    pub fn deadlines(mut self, deadlines: Deadlines) -> SwarmBuilder {
        self.conduct.deadlines = deadlines;
        self
    }

    /// What to do when an agent dies or hangs: by default the swarm ends.
    pub fn on_failure(mut self, on_failure: OnFailure) -> SwarmBuilder {
        self.conduct.on_failure = on_failure;
        self
    }

    /// Agents pass on the newest observation that they hold of each other agent.
    pub fn relay(self) -> SwarmBuilder {
        SwarmBuilder { relay: true, ..self }
    }

    /// Makes agents report the logits they decide by. A [`Recorder`](crate::supervisor::Recorder) needs them.
    pub fn recordable(self) -> SwarmBuilder {
        SwarmBuilder { recordable: true, ..self }
    }

    /// The program to run for an agent instead of this one.
    pub fn agent_command(mut self, command: AgentCommand) -> SwarmBuilder {
        self.conduct.command = Some(command);
        self
    }

    /// The program to run for one agent, in any language: `docs/protocol.md` says what it has to do.
    pub fn other_agent(mut self, agent: usize, command: AgentCommand) -> SwarmBuilder {
        self.conduct.others.push((agent, command));
        self
    }

    /// Starts the swarm. Returns when all its agents are ready.
    ///
    /// # Errors
    /// `Usage` if a setting makes no sense, such as a task, a model of links or an imputer that does not exist.
    /// `Failed` if agents are to be processes of this program, but it has not called
    /// [`run_if_agent`](crate::run_if_agent). Otherwise whatever starting them fails with.
    pub fn build(self) -> Result<Swarm> {
        if self.worlds == 0 || self.conduct.rate.is_some_and(|rate| !(rate > 0.0 && rate.is_finite())) {
            return Err(crate::usage!(
                "a swarm needs 1 or more worlds, and a rate that is finite and above 0 ticks a second"
            ));
        }
        let environment = match self.environment.0 {
            Played::Name(name) => Task::parse(&name)?.environment(self.worlds),
            Played::Task(task) => task.environment(self.worlds),
            Played::Environment(environment) => environment,
        };
        let spec = environment.spec().clone();
        let site =
            Site { tick: Some(self.conduct.rate.map_or(spec.dt, |rate| 1.0 / rate)), ..Site::from(&spec) };
        let links = self.links.build(site)?;
        let policy = self.policy.load(&spec)?;
        let settings = AgentSettings {
            imputer: self.registry.choose(self.imputer.as_deref(), &policy)?,
            registry: self.registry,
            policy: self.policy,
            greedy: self.greedy,
            seed: self.seed,
            worlds: environment.worlds(),
            longest_delay: links.longest_delay(),
            relay: self.relay,
            tell_logits: self.recordable,
            spec,
        };
        let agents = if self.in_process {
            Agents::Here(Box::new(InProcess::new(&settings, &policy)?))
        } else {
            Agents::Processes(Box::new(Processes::start(&settings, &policy, self.conduct)?))
        };
        let session = Session::new(environment, links, self.seed).relaying(self.relay);
        Ok(Swarm { session, ledger: Ledger::default(), agents })
    }
}

impl LinkChoice {
    fn build(self, site: Site) -> Result<Links> {
        match self.0 {
            Linked::Words(words) => LinkSpec::parse(&words, site).map(|links| links.build()),
            Linked::Links(links) => Ok(links),
        }
    }
}

impl From<&str> for LinkChoice {
    fn from(words: &str) -> LinkChoice {
        LinkChoice(Linked::Words(words.to_owned()))
    }
}

impl From<Links> for LinkChoice {
    fn from(links: Links) -> LinkChoice {
        LinkChoice(Linked::Links(links))
    }
}

impl<L: Link + 'static> From<L> for LinkChoice {
    fn from(link: L) -> LinkChoice {
        LinkChoice(Linked::Links(link.into()))
    }
}

impl From<&str> for EnvironmentChoice {
    fn from(name: &str) -> EnvironmentChoice {
        EnvironmentChoice(Played::Name(name.to_owned()))
    }
}

impl From<Task> for EnvironmentChoice {
    fn from(task: Task) -> EnvironmentChoice {
        EnvironmentChoice(Played::Task(task))
    }
}

impl<E: Environment + 'static> From<E> for EnvironmentChoice {
    fn from(environment: E) -> EnvironmentChoice {
        EnvironmentChoice(Played::Environment(Box::new(environment)))
    }
}

impl From<Box<dyn Environment>> for EnvironmentChoice {
    fn from(environment: Box<dyn Environment>) -> EnvironmentChoice {
        EnvironmentChoice(Played::Environment(environment))
    }
}

impl std::fmt::Debug for Played {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Played::Name(name) => write!(f, "{name}"),
            Played::Task(task) => write!(f, "{}", task.id()),
            Played::Environment(environment) => write!(f, "{}", environment.spec().id),
        }
    }
}
