use super::*;
#[cfg(feature = "candle")]
use crate::nn::reference::CandleNetwork;
use proptest::prelude::*;

const KINDS: [(ActorKind, Sharing); 4] = [
    (ActorKind::Mlp, Sharing::Separate),
    (ActorKind::Mlp, Sharing::Shared),
    (ActorKind::Gru, Sharing::Separate),
    (ActorKind::Gru, Sharing::Shared),
];

/// What a network comes to in `steps` steps, one after the other.
fn run(
    network: &Inference,
    rows: usize,
    steps: &[Vec<f32>],
    acts: &[usize],
    outputs: usize,
) -> Vec<Vec<f32>> {
    let (mut state, mut scratch) = (network.state(rows), Scratch::default());
    let step = |inputs: &Vec<f32>| {
        let mut out = vec![0.0; rows * outputs];
        network.step(rows, inputs, acts, &mut state, &mut scratch, &mut out);
        out
    };
    steps.iter().map(step).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[cfg(feature = "candle")]
    #[test]
    fn networks_agree_with_candle(
        kind in 0usize..4, acting in any::<bool>(), skip in any::<bool>(), hidden in 1usize..70, joint in 1usize..40, n_actions in 1usize..7,
        n_agents in 1usize..5, rows in 1usize..12, seed in any::<u64>(),
    ) {
        let (actor, sharing) = KINDS[kind];
        let dims = Dims { task: "toy".to_string(), n_agents, joint, predicted: joint, n_actions, agents: Vec::new() };
        let inputs = if acting { vec![Input::Estimate, Input::OwnAction] } else { vec![Input::Estimate] };
        let predictors = vec![PredictorSpec { hidden, inputs, skip, ..PredictorSpec::paper("one") }];
        let policy = Policy::untrained(&dims, seed, Networks { sharing, hidden, predictors, ..Networks::paper(actor) }).unwrap();
        let weights: Vec<f32> = numbers(seed, policy.n_values()).iter().map(|value| value * 0.1).collect();
        let policy = policy.with_values(&weights).unwrap();
        let steps: Vec<_> = (0..4).map(|step| numbers(seed ^ step, rows * joint)).collect();
        let acts: Vec<usize> = (0..rows).map(|row| (seed as usize ^ row) % (n_agents * n_actions)).collect();
        let actors = (0..n_agents).map(|agent| {
            (policy.actor(agent).network(), n_actions, CandleNetwork::actor(&policy, agent, rows))
        });
        let predictor = &policy.predictor("one").unwrap().network;
        let predictor = (predictor, 2 * joint, CandleNetwork::predictor(&policy, "one", rows));
        for (network, outputs, mut candle) in actors.chain([predictor]) {
            for (inputs, out) in steps.iter().zip(run(network, rows, &steps, &acts, outputs)) {
                for (found, expected) in out.iter().zip(candle.step(rows, inputs, &acts)) {
                    prop_assert!((found - expected).abs() < 1e-5, "{found} is not {expected}");
                }
            }
        }
    }
}

#[test]
fn a_row_is_the_same_bits_alone_and_among_others() {
    let dims = Dims { joint: 24, predicted: 16, ..dims() };
    let steps: Vec<_> = (0..3).map(|step| numbers(step, 64 * dims.joint)).collect();
    let part = |from: usize, rows: usize| -> Vec<Vec<f32>> {
        steps.iter().map(|inputs| inputs[from * dims.joint..][..rows * dims.joint].to_vec()).collect()
    };
    for (actor, sharing) in KINDS {
        let policy = Policy::untrained(&dims, 3, Networks { sharing, ..Networks::paper(actor) }).unwrap();
        let predictor = &policy.predictor("value-aware").unwrap().network;
        for (network, outputs) in [(policy.actor(1).network(), 5), (predictor, 32)] {
            let alone: Vec<_> = (0..64).map(|row| run(network, 1, &part(row, 1), &[], outputs)).collect();
            for rows in [2, 10, 64] {
                for (step, out) in run(network, rows, &part(0, rows), &[], outputs).iter().enumerate() {
                    let alone: Vec<f32> =
                        alone[..rows].iter().flat_map(|steps| steps[step].clone()).collect();
                    assert_eq!(bits(out), bits(&alone), "{actor:?}, {sharing:?}, {rows} rows");
                }
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
        let logits = run(policy.actor(0).network(), 1, &[inputs], &[], 5);
        assert!(logits[0].iter().all(|logit| logit.is_nan()), "{actor:?}, {sharing:?}");
    }
}

#[test]
fn what_is_prepared_changes_no_bit_and_not_the_next_episode() {
    let dims = Dims {
        task: "toy".to_string(),
        n_agents: 2,
        joint: 9,
        predicted: 9,
        n_actions: 5,
        agents: Vec::new(),
    };
    for (kind, sharing) in KINDS {
        let networks = Networks { sharing, ..Networks::paper(kind) };
        let policy = Policy::untrained(&dims, 3, networks).unwrap();
        let steps: Vec<_> = (0..6).map(|step| numbers(step, 2 * dims.joint)).collect();
        let actor = policy.actor(1);
        let expected = run(actor.network(), 2, &steps, &[], dims.n_actions);
        let (mut state, mut scratch) = (actor.state(7), Scratch::default());
        for episode in 0..3 {
            state.start(2);
            for (step, (inputs, expected)) in steps.iter().zip(&expected).enumerate() {
                let mut logits = vec![0.0; 2 * dims.n_actions];
                actor.step(2, inputs, &[], &mut state, &mut scratch, &mut logits).unwrap();
                assert_eq!(&logits, expected, "{kind}, {sharing}");
                // Never, always, or now and then; twice is as good as once.
                (0..episode * step % 3).for_each(|_| actor.prepare(2, &mut state));
            }
        }
    }
}

#[test]
fn a_held_dim_is_predicted_not_to_change() {
    let policy = policy(ActorKind::Mlp, Sharing::Separate);
    let predictor = policy.predictor("value-aware").unwrap();
    let (rows, predicted) = (4, policy.dims().predicted);
    let mut out = vec![f32::NAN; rows * 2 * predicted];
    let inputs = numbers(5, rows * policy.dims().joint);
    predictor.step(rows, &inputs, &[], &mut predictor.state(rows), &mut Scratch::default(), &mut out);
    let free = run(&predictor.network, rows, &[inputs], &[], 2 * predicted);
    for (at, (&found, &free)) in out.iter().zip(&free[0]).enumerate() {
        let held = [1, 4].contains(&(at % (2 * predicted)));
        assert_eq!(found, if held { 0.0 } else { free });
    }
}

#[test]
fn a_state_that_starts_again_is_a_new_one() {
    let policy = policy(ActorKind::Gru, Sharing::Separate);
    let predictor = &policy.predictor("maro").unwrap().network;
    for (network, outputs) in [(policy.actor(0).network(), 5), (predictor, 2 * policy.dims().predicted)] {
        let (mut state, mut out) = (network.state(2), vec![0.0; 2 * outputs]);
        network.step(2, &numbers(1, 14), &[], &mut state, &mut Scratch::default(), &mut out);
        assert_ne!(state, network.state(2));
        let mut copy = network.state(1);
        copy.copy_from(&state);
        assert_eq!(copy, state);
        for rows in [2, 1, 3] {
            state.start(rows);
            assert_eq!(state, network.state(rows));
        }
    }
}

#[test]
fn a_soft_bounded_sigma_stays_within_bounds_and_has_the_slope_that_it_says() {
    let raws = (-400..400).map(|at| at as f32 * 0.05);
    for (at, sigma) in raws.flat_map(|raw| [Sigma::Exp, Sigma::SoftBounded].map(|sigma| (raw, sigma))) {
        let slope = (sigma.log_std(at + 0.01) - sigma.log_std(at - 0.01)) / 0.02;
        assert!((slope - sigma.slope(at)).abs() < 1e-3, "{sigma:?} at {at}: {slope}");
    }
    assert_eq!(Sigma::Exp.log_std(-9.5), -9.5);
    assert_eq!(Sigma::SoftBounded.log_std(-3.0), -3.0);
    assert_eq!([-1e3, 1e3].map(|raw| Sigma::SoftBounded.log_std(raw)), [-7.0, 1.0]);
}

#[test]
fn senses_say_what_arrived_how_old_it_is_and_what_was_not_expected() {
    use Input::{Age, Delivered, Estimate, Innovation};
    let dims = Dims {
        task: "toy".to_string(),
        n_agents: 2,
        joint: 5,
        predicted: 4,
        n_actions: 5,
        agents: Vec::new(),
    };
    let inputs = vec![Estimate, Delivered, Age, Innovation];
    let predictors = vec![PredictorSpec { hidden: 3, inputs, ..PredictorSpec::paper("one") }];
    let policy =
        Policy::untrained(&dims, 3, Networks { predictors, ..Networks::paper(ActorKind::Mlp) }).unwrap();
    let predictor = policy.predictor("one").unwrap();
    let (mut state, mut scratch, mut out) = (predictor.state(1), Scratch::default(), vec![0.0; 8]);
    let mut step = |estimate: &[f32; 5], age: Option<u8>| {
        state.hear(0, 0, Some(0));
        state.hear(0, 1, age);
        predictor.step(1, estimate, &[], &mut state, &mut scratch, &mut out);
        let expected: Vec<f32> = estimate.iter().zip(&out[..4]).map(|(value, delta)| value + delta).collect();
        (state.seen().to_vec(), expected)
    };
    // Nothing is expected of the first step, and nothing has arrived before it.
    let (seen, expected) = step(&[0.1, 0.2, 0.3, 0.4, 0.5], None);
    assert_eq!(seen, [0.1, 0.2, 0.3, 0.4, 0.5, 1.0, 0.0, 0.0, 0.04, 0.0, 0.0, 0.0, 0.0]);
    // What does not arrive is what was expected.
    let estimate = [0.3, 0.1, expected[2], expected[3], 0.5];
    let (seen, expected_next) = step(&estimate, None);
    assert_eq!(seen[5..9], [1.0, 0.0, 0.0, 0.08]);
    assert_eq!(seen[9..], [0.3 - expected[0], 0.1 - expected[1], 0.0, 0.0]);
    let (seen, _) = step(&[0.0; 5], Some(3));
    assert_eq!(seen[5..9], [1.0, 1.0, 0.0, 0.12]);
    assert_eq!(seen[9..], [0, 1, 2, 3].map(|dim: usize| 0.0 - expected_next[dim]));
    let mut fresh = predictor.state(1);
    fresh.copy_from(&state);
    fresh.start(1);
    assert_eq!(fresh, predictor.state(1));
}

#[test]
fn networks_make_the_same_bits_of_f16_and_of_its_values() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("half");
    for (actor, sharing) in KINDS {
        let saved = Policy::untrained(&dims(), 5, networks(actor, sharing)).unwrap();
        saved.save_half(&path).unwrap();
        let of_halves = Policy::open(&path, &dims()).unwrap();
        let of_values = of_halves.with_values(&values(&of_halves)).unwrap();
        assert!(of_halves.tensors().all(|(_, tensor)| tensor.halves().is_some()));
        assert!(of_values.tensors().all(|(_, tensor)| tensor.halves().is_none()));
        for rows in [1, 2, 9] {
            let steps: Vec<_> = (0..3).map(|step| numbers(step, rows * dims().joint)).collect();
            let [halves, values] = [&of_halves, &of_values]
                .map(|policy| run(policy.actor(1).network(), rows, &steps, &[], dims().n_actions));
            assert_eq!(halves, values, "{actor} {sharing}, {rows} rows");
        }
        // New weights are f32: those of the file count no more.
        let mut renewed = of_halves.actor(0).clone();
        renewed.renew(&vec![0.0; of_halves.actor_range(0).len()]);
        let out = run(renewed.network(), 1, &[numbers(1, dims().joint)], &[], dims().n_actions);
        assert_eq!(out, [vec![0.0; dims().n_actions]]);
    }
}

#[test]
fn a_network_that_is_taken_roughly_says_nearly_the_same_and_takes_new_weights() {
    for actor in [ActorKind::Mlp, ActorKind::Gru] {
        let networks = Networks { hidden: 64, ..networks(actor, Sharing::Separate) };
        let policies = [1, 2].map(|seed| Policy::untrained(&dims(), seed, networks.clone()).unwrap());
        let steps: Vec<Vec<f32>> = (0..5).map(|seed| numbers(seed, 2 * dims().joint)).collect();
        let says = |network: &Inference| run(network, 2, &steps, &[], dims().n_actions);
        let [first, second] = [0, 1].map(|at: usize| says(policies[at].actor(0).roughly().network()));
        let exact = says(policies[0].actor(0).network()).concat();
        let rough = first.concat();
        let wrong = rough.iter().zip(&exact).map(|(rough, exact)| (rough - exact).abs());
        let wrong = wrong.fold(0.0, f32::max);
        assert!(wrong > 0.0 && wrong < 0.02, "{actor}: {wrong}");

        // The first time in memory of its own, the second time in place.
        let mut renewed = policies[1].actor(0).roughly();
        for (policy, expected) in [(0, first), (1, second)] {
            let weights = &values(&policies[policy])[policies[policy].actor_range(0)];
            renewed.renew(weights);
            assert_eq!(says(renewed.network()), expected, "{actor}");
        }
    }
}
