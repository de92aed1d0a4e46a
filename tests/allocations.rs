//! What runs millions of times allocates nothing: a test binary of its own, for its own allocator.
//!
//! Allocations are counted for each thread, so of a swarm of processes those of the supervisor. Its agents run this
//! test binary, which the words that they are called with, `--exact agent <settings>`, have run the test [`agent`] alone.

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::time::Duration;

use common::acting::acting_in;
use vamaro_swarm::agent::{Agent, AgentSettings, Member, PolicySource, Registry, Sensed, dims};
use vamaro_swarm::base::error::Result;
use vamaro_swarm::bus::{
    AgentSharedPort, Header, Kind, PROTOCOL, Sample, Sensor, SupervisorPort, SwarmAddress, SwarmDirectory,
    Wait,
};
use vamaro_swarm::environment::{Outcome, Task};
use vamaro_swarm::link::{LinkSpec, Links};
use vamaro_swarm::nn::{ActorKind, Input, Networks, Policy, Scratch, Sharing};
use vamaro_swarm::supervisor::{
    Audit, Conduct, Decisions, InProcess, Ledger, Order, Processes, Session, Stage, Team, Tick,
};
use vamaro_swarm::train::{self, Batch, Ends, Settings};

/// Steps of an episode of every built-in task.
const EPISODE_STEPS: usize = 25;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

/// The system's allocator, counting the allocations of each thread.
struct Counting;

#[global_allocator]
static COUNTING: Counting = Counting;

// SAFETY: every call goes to the system's allocator unchanged; the counter itself never allocates.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        unsafe { System.dealloc(memory, layout) }
    }
}

fn allocations(work: impl FnOnce()) -> usize {
    let before = ALLOCATIONS.get();
    work();
    ALLOCATIONS.get() - before
}

#[test]
fn an_episode_allocates_nothing() {
    assert_eq!(allocations(|| drop(std::hint::black_box(vec![0u8; 64]))), 1, "the counter counts");
    let mut tasks = Task::all();
    tasks.push(Task::parse("spread-xy-64").unwrap());
    for task in tasks {
        let (spec, mut world) = (task.spec(), task.environment(1));
        let mut observations = vec![0.0; spec.n_agents() * spec.padded_obs_dim()];
        let mut actions = vec![0; spec.n_agents() * spec.action_width()];
        let mut outcome = Outcome::of(1, spec.n_agents());
        let counted = allocations(|| {
            world.reset(0, 1, 2).unwrap();
            for t in 0..spec.episode_steps {
                actions.iter_mut().enumerate().for_each(|(at, action)| *action = ((at + t) % 6) as u32);
                world.step(&actions, &[true], &mut outcome).unwrap();
                world.observe(1, &mut observations).unwrap();
                std::hint::black_box((spec.team_reward(&outcome.rewards), &observations));
            }
        });
        assert_eq!(counted, 0, "{}", task.id());
    }
}

#[test]
fn running_networks_allocates_nothing_after_the_first_pass() {
    let dims = dims(Task::parse("spread-xy-4").unwrap().spec());
    let all = vec![Input::Estimate, Input::Delivered, Input::Age];
    for (actor, sharing, actor_inputs) in [
        (ActorKind::Mlp, Sharing::Separate, vec![Input::Estimate]),
        (ActorKind::Mlp, Sharing::Shared, vec![Input::Egocentric]),
        (ActorKind::Gru, Sharing::Shared, all),
    ] {
        let networks = Networks { sharing, actor_inputs, ..Networks::paper(actor) };
        let policy = Policy::untrained(&dims, 1, networks).unwrap();
        let (actor, predictor) = (policy.actor(3), policy.predictor("value-aware").unwrap());
        let rows = 10;
        let inputs = vec![0.5; rows * dims.joint];
        let (mut memory, mut state) = (actor.state(rows), predictor.state(rows));
        let (mut logits, mut out) = (vec![0.0; rows * dims.n_actions], vec![0.0; rows * 2 * dims.predicted]);
        let mut scratch = Scratch::default();
        let mut tick = || {
            memory.hear(rows - 1, 0, None);
            actor.step(rows, &inputs, &[], &mut memory, &mut scratch, &mut logits).unwrap();
            actor.prepare(rows, &mut memory);
            predictor.step(rows, &inputs, &[], &mut state, &mut scratch, &mut out);
        };
        tick();
        assert_eq!(allocations(|| (0..5).for_each(|_| tick())), 0);
    }
}

/// Both sides of the bus in one thread, phase by phase, with all that agents do in a tick.
#[test]
fn a_tick_over_shared_memory_allocates_nothing_but_loans_after_the_first_episode() {
    let folder = tempfile::tempdir().unwrap();
    let acting = acting_in(folder.path(), Task::parse("spread-xy-4").unwrap().spec());
    for (task, policy, imputer) in [
        ("hear-see", &PolicySource::Builtin, "value-aware"),
        ("spread-xy-4", &PolicySource::Builtin, "value-aware"),
        ("spread-xy-4", &PolicySource::Builtin, "dynamics"),
        ("spread-xy-4", &PolicySource::Builtin, "teammates"),
        ("spread-xy-2", &PolicySource::Builtin, "particles"),
        ("spread-xy-4", &PolicySource::Builtin, "hold+oracle:own"),
        ("spread-xy-4", &acting, "acting"),
        ("spread-xy-4", &acting, "seeing-all"),
    ] {
        let task = Task::parse(task).unwrap();
        let agents = task.spec().n_agents();
        let (policy, imputer) = (policy.clone(), imputer.to_owned());
        let links = LinkSpec::parse("level(0.5) + delay(0, 2)", agents).unwrap().build();
        let longest_delay = links.longest_delay();
        let relay = imputer == "dynamics";
        let settings =
            AgentSettings { policy, imputer, longest_delay, relay, ..AgentSettings::of(task.spec()) };
        let layout = settings.layout();
        let directory = SwarmDirectory::create().unwrap();
        let address = SwarmAddress { agents, longest_delay, ..SwarmAddress::of(directory.tag()) };
        let supervisor = SupervisorPort::create(&address, &layout).unwrap();
        let member = |index| {
            let agent = Agent::new(&settings, index).unwrap();
            let port = AgentSharedPort::open(&address, &layout, index, 0).unwrap();
            Member::new(agent, port, layout, address.id(), 0)
        };
        let mut members: Vec<_> = (0..agents).map(member).collect();
        let mut stage = Stage::new(task.environment(1), links, 1).relaying(relay);
        let mut decisions = Decisions { actions: vec![0; agents], ..Decisions::default() };
        for episode in 0..3 {
            stage.begin_episodes(u64::MAX).unwrap();
            for _ in 0..EPISODE_STEPS {
                let drawn = allocations(|| {
                    stage.sense().unwrap();
                    stage.draw_links(0).unwrap();
                });
                let tick = stage.tick();
                let header = Header {
                    protocol: PROTOCOL,
                    kind: Kind::Sensor as u32,
                    swarm: address.id(),
                    episode: tick.episode,
                    step: tick.step,
                    tick: tick.tick,
                    worlds: 1,
                    length: layout.sensor_words(1) as u64,
                    ..Header::default()
                };
                let (mut observed, mut decided) = (0, 0);
                let counted = [
                    allocations(|| {
                        for agent in 0..agents {
                            let sensor = Sensor {
                                carried_out: &tick.carried_out[agent..=agent],
                                ages: tick.messages(agent, 0),
                                draws: &[[0; 2]],
                                observations: tick.observation(task.spec(), agent, 0),
                            };
                            let write = |words: &mut [u32]| layout.write_sensor(words, &sensor);
                            supervisor.send_sensor(agent, header, write).unwrap();
                        }
                        supervisor.wake_agents().unwrap();
                    }),
                    allocations(|| {
                        for member in &mut members {
                            member.port().sleep(Duration::from_millis(100)).unwrap();
                            assert_eq!(member.sense().unwrap(), Sensed::Tick);
                        }
                    }),
                    allocations(|| {
                        for member in &mut members {
                            member.publish().unwrap();
                            member.port().wake_supervisor().unwrap();
                        }
                    }),
                    allocations(|| {
                        supervisor.sleep(Duration::from_millis(100)).unwrap();
                        while supervisor.receive_observation().unwrap().is_some() {
                            observed += 1;
                        }
                    }),
                    allocations(|| members.iter_mut().for_each(|member| assert!(member.collect().unwrap()))),
                    allocations(|| members.iter_mut().for_each(|member| member.decide().unwrap())),
                    allocations(|| {
                        while let Some(sample) = supervisor.receive_decision().unwrap() {
                            let decision = layout.decision(sample.words(), 1);
                            decisions.actions[sample.header().sender as usize] = decision.actions[0];
                            decided += 1;
                        }
                        // What it does is not what it decided, as after a deadline that it missed.
                        decisions.actions[0] = 0;
                    }),
                    allocations(|| members.iter_mut().for_each(Member::predict)),
                ];
                assert_eq!((observed, decided), (agents, agents), "{}", task.id());
                // iceoryx2 0.10 itself allocates once for each sample that it loans, and there is no loan without it.
                let loans = [agents, 0, agents, 0, 0, agents, 0, 0];
                const PHASES: &str = "sensor, sense, publish, observe, collect, decide, act, predict";
                let step = tick.step;
                assert!(
                    episode == 0 || counted == loans,
                    "{}, {}, step {step}: {PHASES}: {counted:?}",
                    task.id(),
                    settings.imputer
                );
                let stepped = allocations(|| stage.step_worlds(&decisions).unwrap());
                assert!(episode == 0 || (drawn, stepped) == (0, 0), "{}, step {step}", task.id());
            }
        }
    }
}

/// Not a test: what the agents of the one below run.
#[test]
fn agent() {
    vamaro_swarm::run_if_agent(&Registry::default());
}

/// A team that notes how many allocations there have been when a tick of it begins and when it ends.
struct Counted<'a> {
    team: Processes,
    ticks: &'a mut Vec<[usize; 2]>,
}

impl Team for Counted<'_> {
    fn muster(&mut self, orders: &[Order]) -> Result<u64> {
        self.team.muster(orders)
    }

    fn tick(&mut self, tick: &Tick, decisions: &mut Decisions) -> Result<()> {
        let begun = ALLOCATIONS.get();
        self.team.tick(tick, decisions)?;
        self.ticks.push([begun, ALLOCATIONS.get()]);
        Ok(())
    }

    fn longest_delay(&self) -> u8 {
        self.team.longest_delay()
    }

    fn renew(&mut self, weights: &[f32]) -> Result<()> {
        self.team.renew(weights)
    }
}

/// All that the supervisor of a swarm of processes does while it plays.
#[test]
fn a_supervisor_allocates_nothing_but_loans_after_the_first_episode() {
    const EPISODES: usize = 12;
    for (wait, rate) in [(Wait::Block, None), (Wait::Spin, None), (Wait::Block, Some(2000.0))] {
        let task = Task::parse("spread-xy-4").unwrap();
        let imputer = "value-aware".to_owned();
        let settings = AgentSettings {
            imputer,
            policy: PolicySource::Training,
            worlds: 2,
            longest_delay: 3,
            ..AgentSettings::of(task.spec())
        };
        let policy = Policy::untrained(&dims(task.spec()), 1, Networks::paper(ActorKind::Mlp)).unwrap();
        let conduct = Conduct { wait, rate, command: Some(common::this_binary()), ..Conduct::default() };
        let mut ticks = Vec::with_capacity(EPISODES * EPISODE_STEPS);
        let team = Processes::start(&settings, &policy, conduct.clone()).unwrap();
        let links = LinkSpec::parse("gilbert(0.1, 0.3) + delay(2, 1)", 4).unwrap().build();
        let mut session = Session::new(task.environment(settings.worlds), links, 1);
        let (mut ledger, mut audit) = (Ledger::default(), Audit::default());
        let episodes = (EPISODES * settings.worlds) as u64;
        let mut team = Counted { team, ticks: &mut ticks };
        session.play(&mut team, episodes, &mut [&mut ledger, &mut audit]).unwrap();
        assert!(audit.holds());
        assert_eq!(ticks.len(), EPISODES * EPISODE_STEPS);
        for (at, pair) in ticks.windows(2).enumerate().skip(EPISODE_STEPS) {
            let ([begun, ended], [next, _]) = (pair[0], pair[1]);
            // iceoryx2 0.10 allocates for each sample that it loans: here the message to each agent.
            assert_eq!(ended - begun, task.spec().n_agents(), "{conduct:?}, tick {at}");
            // The results of all episodes are kept, in a list that grows when they end.
            let kept = usize::from((at + 1) % EPISODE_STEPS == 0);
            assert!(next - ended <= kept, "{conduct:?}, after tick {at}: {}", next - ended);
        }
    }
}

#[test]
fn renewing_weights_allocates_nothing_after_the_first_time() {
    for (kind, task) in [(ActorKind::Mlp, "hear-see"), (ActorKind::Gru, "spread-xy-4")] {
        let task = Task::parse(task).unwrap();
        let imputer = "value-aware".to_owned();
        let settings = AgentSettings { imputer, ..AgentSettings::of(task.spec()) };
        let policy = Policy::untrained(&dims(task.spec()), 1, Networks::paper(kind)).unwrap();
        let mut team = InProcess::new(&settings, &policy).unwrap();
        let mut stage = Stage::new(task.environment(1), Links::level(0.5), 1);
        let weights = vec![0.01; policy.n_values()];
        let mut decisions = Decisions::default();
        let mut first_tick = |renews: bool| {
            stage.begin_episodes(u64::MAX).unwrap();
            stage.sense().unwrap();
            stage.draw_links(0).unwrap();
            allocations(|| {
                if renews {
                    team.renew(&weights).unwrap();
                }
                team.tick(&stage.tick(), &mut decisions).unwrap();
            })
        };
        let [_, first] = [false, true].map(&mut first_tick);
        let [plain, renewing] = [false, true].map(&mut first_tick);
        assert!(renewing < first, "the first time, shared weights are copied");
        assert_eq!(renewing, plain, "{}", task.id());
    }
}

#[test]
fn an_update_allocates_nothing_once_warm() {
    for (kind, task) in [(ActorKind::Mlp, "hear-see"), (ActorKind::Gru, "spread-xy-4")] {
        let task = Task::parse(task).unwrap();
        let (n, episodes, steps) = (task.spec().n_agents(), 3, EPISODE_STEPS);
        let batch = Batch {
            episodes,
            steps,
            observations: vec![0.5; (steps + 1) * episodes * n * task.spec().padded_obs_dim()],
            joint: vec![0.5; (steps + 1) * episodes * task.spec().joint_dim()],
            estimates: Vec::new(),
            ages: Vec::new(),
            actions: vec![1; steps * episodes * n],
            rewards: (0..steps * episodes).map(|at| at as f32).collect(),
            ends: Ends::truncated(episodes, steps),
        };
        let available = vec![5; n];
        let settings = Settings::paper(kind);
        let mut team = train::Learner::untrained(
            settings,
            &dims(task.spec()),
            task.spec().padded_obs_dim(),
            &available,
            1,
            1,
        );
        team.update(&batch, &[]);
        let counted = allocations(|| {
            std::hint::black_box(team.update(&batch, &[]));
        });
        assert_eq!(counted, 0, "{}", task.id());
    }
}
