//! Worlds and networks allocate nothing while they run: a test binary of its own, for its own allocator.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use vamaro_swarm::nn::{ActorKind, Dims, Networks, Policy, Scratch, Sharing};
use vamaro_swarm::world::{EPISODE_STEPS, Task, World};

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
        let mut world = World::new(&task);
        let mut observation = vec![0.0; task.padded_obs_dim()];
        let mut actions = vec![0; task.n_agents()];
        let counted = allocations(|| {
            world.reset(1, 2);
            for t in 0..EPISODE_STEPS {
                actions.iter_mut().enumerate().for_each(|(agent, action)| *action = ((agent + t) % 6) as u8);
                world.step(&actions);
                (0..actions.len()).for_each(|agent| world.observe(agent, &mut observation));
                std::hint::black_box((world.team_reward(), &observation));
            }
        });
        assert_eq!(counted, 0, "{}", task.id());
    }
}

#[test]
fn running_networks_allocates_nothing_after_the_first_pass() {
    let dims = Dims { task: "toy".to_string(), n_agents: 4, joint: 24, predicted: 16, n_actions: 5 };
    for (actor, sharing) in [(ActorKind::Mlp, Sharing::Separate), (ActorKind::Gru, Sharing::Shared)] {
        let networks = Networks { sharing, ..Networks::paper(actor) };
        let policy = Policy::untrained(&dims, 1, networks).unwrap();
        let (actor, predictor) = (policy.actor(3), policy.predictor("value-aware").unwrap());
        let rows = 10;
        let inputs = vec![0.5; rows * dims.joint];
        let (mut hidden, mut state) = (vec![0.0; rows * actor.state_len()], predictor.state(rows));
        let (mut logits, mut out) = (vec![0.0; rows * dims.n_actions], vec![0.0; rows * 2 * dims.predicted]);
        let mut scratch = Scratch::default();
        let mut tick = || {
            actor.forward(rows, &inputs, &mut hidden, &mut scratch, &mut logits);
            predictor.step(rows, &inputs, &mut state, &mut scratch, &mut out);
        };
        tick();
        assert_eq!(allocations(|| (0..5).for_each(|_| tick())), 0);
    }
}
