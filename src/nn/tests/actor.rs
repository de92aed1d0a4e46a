use super::*;
use proptest::prelude::*;

const KINDS: [(ActorKind, Sharing); 4] = [
    (ActorKind::Mlp, Sharing::Separate),
    (ActorKind::Mlp, Sharing::Shared),
    (ActorKind::Gru, Sharing::Separate),
    (ActorKind::Gru, Sharing::Shared),
];

/// The logits of `steps` steps, one after the other.
fn run(actor: &Actor, rows: usize, inputs: &[Vec<f32>], n_actions: usize) -> Vec<Vec<f32>> {
    let (mut state, mut scratch) = (actor.state(rows), Scratch::default());
    let step = |inputs: &Vec<f32>| {
        let mut logits = vec![0.0; rows * n_actions];
        actor.forward(rows, inputs, &mut state, &mut scratch, &mut logits);
        logits
    };
    inputs.iter().map(step).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn actors_agree_with_candle(
        kind in 0usize..4, hidden in 1usize..70, joint in 1usize..40, n_actions in 1usize..7,
        n_agents in 1usize..5, rows in 1usize..12, seed in any::<u64>(),
    ) {
        let (actor, sharing) = KINDS[kind];
        let dims = Dims { task: "toy".to_string(), n_agents, joint, predicted: joint, n_actions };
        let networks = Networks { actor, sharing, hidden, predictors: Vec::new() };
        let policy = Policy::untrained(&dims, seed, networks).unwrap();
        let inputs: Vec<_> = (0..4).map(|step| numbers(seed ^ step, rows * joint)).collect();
        for agent in 0..n_agents {
            let logits = run(policy.actor(agent), rows, &inputs, n_actions);
            let mut oracle = oracle::CandleActor::new(&policy, agent, rows);
            for (inputs, logits) in inputs.iter().zip(&logits) {
                for (found, expected) in logits.iter().zip(oracle.forward(rows, inputs)) {
                    prop_assert!((found - expected).abs() < 1e-5, "{found} is not {expected}");
                }
            }
        }
    }
}

#[test]
fn a_row_is_the_same_bits_alone_and_among_others() {
    let dims = Dims { joint: 24, ..dims() };
    for (actor, sharing) in KINDS {
        let networks = Networks { sharing, ..Networks::paper(actor) };
        let policy = Policy::untrained(&dims, 3, networks).unwrap();
        let inputs: Vec<_> = (0..3).map(|step| numbers(step, 64 * dims.joint)).collect();
        let part = |from: usize, rows: usize| -> Vec<Vec<f32>> {
            inputs.iter().map(|inputs| inputs[from * dims.joint..][..rows * dims.joint].to_vec()).collect()
        };
        let alone: Vec<_> = (0..64).map(|row| run(policy.actor(1), 1, &part(row, 1), 5)).collect();
        for rows in [2, 10, 64] {
            let together = run(policy.actor(1), rows, &part(0, rows), 5);
            for (step, logits) in together.iter().enumerate() {
                let alone: Vec<f32> = alone[..rows].iter().flat_map(|steps| steps[step].clone()).collect();
                assert_eq!(bits(logits), bits(&alone), "{actor:?}, {sharing:?}, {rows} rows");
            }
        }
    }
}

#[test]
fn a_nan_in_the_input_reaches_the_logits() {
    for (actor, sharing) in KINDS {
        let policy = policy(actor, sharing);
        let mut inputs = vec![0.5; policy.dims().joint];
        inputs[2] = f32::NAN;
        let logits = run(policy.actor(0), 1, &[inputs], 5);
        assert!(logits[0].iter().all(|logit| logit.is_nan()), "{actor:?}, {sharing:?}");
    }
}

#[test]
fn what_is_prepared_changes_no_bit_and_not_the_next_episode() {
    let dims = Dims { task: "toy".to_string(), n_agents: 2, joint: 9, predicted: 9, n_actions: 5 };
    for (kind, sharing) in KINDS {
        let networks = Networks { sharing, ..Networks::paper(kind) };
        let policy = Policy::untrained(&dims, 3, networks).unwrap();
        let inputs: Vec<_> = (0..6).map(|step| numbers(step, 2 * dims.joint)).collect();
        let actor = policy.actor(1);
        let expected = run(actor, 2, &inputs, dims.n_actions);
        let (mut state, mut scratch) = (actor.state(7), Scratch::default());
        for episode in 0..3 {
            state.start(actor, 2);
            for (step, (inputs, expected)) in inputs.iter().zip(&expected).enumerate() {
                let mut logits = vec![0.0; 2 * dims.n_actions];
                actor.forward(2, inputs, &mut state, &mut scratch, &mut logits);
                assert_eq!(&logits, expected, "{kind}, {sharing}");
                // Never, always, or now and then; twice is as good as once.
                (0..episode * step % 3).for_each(|_| actor.prepare(2, &mut state));
            }
        }
    }
}
