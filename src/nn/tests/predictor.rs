use super::*;
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn predictors_agree_with_candle(
        hidden in 1usize..70, joint in 1usize..40, rows in 1usize..12, acts in any::<bool>(), seed in any::<u64>(),
    ) {
        let dims = Dims { task: "toy".to_string(), n_agents: 2, joint, predicted: joint, n_actions: 5 };
        let inputs = if acts { vec![Input::Estimate, Input::OwnAction] } else { vec![Input::Estimate] };
        let predictors = vec![PredictorSpec { hidden, inputs, ..PredictorSpec::paper("one") }];
        let networks = Networks { hidden: 1, predictors, ..Networks::paper(ActorKind::Mlp) };
        let policy = Policy::untrained(&dims, seed, networks).unwrap();
        let predictor = policy.predictor("one").unwrap();
        let (mut state, mut scratch) = (predictor.state(rows), Scratch::default());
        let mut oracle = oracle::CandlePredictor::new(&policy, "one", rows);
        let mut out = vec![0.0; rows * 2 * joint];
        for step in 0..4 {
            let inputs = numbers(seed ^ step, rows * joint);
            let acts: Vec<usize> = (0..rows).map(|row| (seed as usize ^ step as usize ^ row) % 10).collect();
            predictor.step(rows, &inputs, &acts, &mut state, &mut scratch, &mut out);
            for (found, expected) in out.iter().zip(oracle.step(rows, &inputs, &acts)) {
                prop_assert!((found - expected).abs() < 1e-5, "{found} is not {expected}");
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
    let expected = oracle::CandlePredictor::new(&policy, "value-aware", rows).step(rows, &inputs, &[]);
    for (at, (&found, expected)) in out.iter().zip(expected).enumerate() {
        match at % (2 * predicted) {
            1 | 4 => assert_eq!(found, 0.0),
            _ => assert!((found - expected).abs() < 1e-5),
        }
    }
}

#[test]
fn a_row_is_the_same_bits_alone_and_among_others() {
    let dims = Dims { joint: 24, predicted: 16, ..dims() };
    let policy = Policy::untrained(&dims, 3, Networks::paper(ActorKind::Mlp)).unwrap();
    let predictor = policy.predictor("value-aware").unwrap();
    let inputs: Vec<_> = (0..3).map(|step| numbers(step, 64 * dims.joint)).collect();
    let run = |from: usize, rows: usize| {
        let (mut state, mut scratch) = (predictor.state(rows), Scratch::default());
        let mut out = vec![0.0; rows * 2 * dims.predicted];
        for inputs in &inputs {
            let inputs = &inputs[from * dims.joint..][..rows * dims.joint];
            predictor.step(rows, inputs, &[], &mut state, &mut scratch, &mut out);
        }
        (bits(&out), bits(&state.hidden), bits(&state.cell))
    };
    let alone: Vec<_> = (0..64).map(|row| run(row, 1)).collect();
    for rows in [2, 10, 64] {
        let (out, hidden, cell) = run(0, rows);
        assert_eq!(out, alone[..rows].iter().flat_map(|row| row.0.clone()).collect::<Vec<_>>());
        assert_eq!(hidden, alone[..rows].iter().flat_map(|row| row.1.clone()).collect::<Vec<_>>());
        assert_eq!(cell, alone[..rows].iter().flat_map(|row| row.2.clone()).collect::<Vec<_>>());
    }
}

#[test]
fn a_state_that_starts_again_is_a_new_one() {
    let policy = policy(ActorKind::Mlp, Sharing::Separate);
    let predictor = policy.predictor("maro").unwrap();
    let mut state = predictor.state(2);
    let mut out = vec![0.0; 4 * policy.dims().predicted];
    predictor.step(2, &numbers(1, 14), &[], &mut state, &mut Scratch::default(), &mut out);
    assert_ne!(state, predictor.state(2));
    for rows in [2, 1, 3] {
        state.start(predictor, rows);
        assert_eq!(state, predictor.state(rows));
    }
}
