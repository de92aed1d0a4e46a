//! Intervals, and what has none.

use super::*;
use crate::base::rng::{Draws, Purpose};

#[test]
fn threads_make_no_difference_and_the_seed_does() {
    assert_eq!(
        Summary::of(&two_seeds(), &["maro"], 1).unwrap(),
        Summary::of(&two_seeds(), &["maro"], 3).unwrap()
    );
    let interval = |seed| {
        let returns: Vec<f64> = (0..40).map(|e| f64::from(e).sqrt()).collect();
        let cells = vec![cell(0, level(0.0), "maro", &returns)];
        let mut evaluation = evaluation(vec![contender("hear-see", "mappo", 1)], vec![], cells);
        evaluation.settings.seed = seed;
        only(Summary::of(&evaluation, &["maro"], 2).unwrap()).imputers[0].cells[0].mean
    };
    let (one, other) = (interval(1), interval(2));
    assert_eq!(one, interval(1));
    assert_eq!(one.value, other.value);
    assert_ne!(one, other);
}

#[test]
fn pairs_stay_together() {
    let returns: Vec<f64> = (0..16).map(|e| f64::from(e * e % 17)).collect();
    let shifted: Vec<f64> = returns.iter().map(|value| value + 3.0).collect();
    let mirrored: Vec<f64> = returns.iter().map(|value| -value).collect();
    let cells = vec![
        cell(0, level(0.5), "maro", &returns),
        cell(0, level(0.5), "va", &shifted),
        cell(1, level(0.5), "maro", &mirrored),
        cell(1, level(0.5), "va", &mirrored),
    ];
    let group = only(
        Summary::of(&evaluation(vec![contender("hear-see", "mappo", 1); 2], vec![], cells), &["maro"], 1)
            .unwrap(),
    );
    // 3 for one seed and 0 for the other, whatever the episodes; sums of 16 small whole numbers are exact.
    let comparison = group.imputers[1].cells[0].comparison.unwrap();
    assert_eq!(comparison.difference, Interval { value: 1.5, low: 1.5, high: 1.5 });
    assert_eq!(comparison.probability_of_improvement, Interval { value: 0.75, low: 0.75, high: 0.75 });
    // Episodes are the same for both seeds, so what one gains the other loses.
    assert_eq!(group.imputers[0].cells[0].mean, Interval::default());
}

#[test]
fn scores_move_with_the_random_team_and_with_what_is_lossless() {
    // Of two episodes the first, the second or both count. The scores are 1/2, 9/10 and 14/20.
    let cells = vec![cell(0, level(1.0), "maro", &[0.0, 0.0]), cell(0, level(0.0), "maro", &[-5.0, -1.0])];
    let random = vec![random("hear-see", &[-10.0, -10.0])];
    let group = only(
        Summary::of(&evaluation(vec![contender("hear-see", "mappo", 1)], random, cells), &["maro"], 1)
            .unwrap(),
    );
    let [lossless, lossy] = &group.imputers[0].cells[..] else { panic!("two cells") };
    assert_eq!(lossless.score, Some(Interval { value: 1.0, low: 1.0, high: 1.0 }));
    assert_eq!(lossy.score, Some(Interval { value: 0.7, low: 0.5, high: 0.9 }));
    assert_eq!(group.imputers[0].score_area, Some(Interval { value: 0.85, low: 0.75, high: 0.95 }));
    // 1 - 0.1 / 0.3 * 1; 1 - 0.1 / 0.5; the score is 0.9 everywhere.
    let p = group.imputers[0].p_for_90.unwrap();
    assert_near(p.value, 2.0 / 3.0);
    assert_near(p.high, 0.8);
    assert_near(p.low, 0.0);
    assert_eq!(lossy.seed_std, None);
}

#[test]
fn what_is_no_better_than_random_has_no_score() {
    let summary = |lossless: [f64; 4]| {
        let cells = vec![
            cell(0, level(1.0), "maro", &lossless),
            cell(0, level(0.0), "maro", &[-9.0, -9.0, -9.0, -9.0]),
        ];
        let random = vec![random("hear-see", &[-8.0, -8.0, -8.0, -8.0])];
        only(
            Summary::of(&evaluation(vec![contender("hear-see", "none", 0)], random, cells), &["maro"], 1)
                .unwrap(),
        )
    };
    for lossless in [[-9.0, -9.0, -9.0, -9.0], [-8.0, -8.0, -8.0, -8.0], [-1.0, -1.0, -1.0, -9.0]] {
        // The last is better, but may be worse in other episodes.
        let imputer = &summary(lossless).imputers[0];
        assert!(imputer.cells.iter().all(|cell| cell.score.is_none()), "{lossless:?}");
        assert_eq!((imputer.score_area, imputer.p_for_90), (None, None));
        assert!(imputer.return_area.is_some());
    }
    assert!(summary([-7.0, -7.0, -7.0, -7.0]).imputers[0].score_area.is_some());
}

#[test]
fn intervals_cover_the_truth_as_often_as_they_say() {
    // Policies that all depend on where an episode starts: their returns are correlated.
    const EPISODES: usize = 60;
    let trial = |trial: u64| {
        let mut draws = Draws::new(trial, Purpose::Reset, 0, 0);
        let starts: Vec<f64> = (0..EPISODES).map(|_| draws.between(-3.0, 3.0)).collect();
        let mut returns = |mean: f64| -> Vec<f64> {
            starts.iter().map(|start| mean + start + draws.between(-1.0, 1.0)).collect()
        };
        let mut cells = Vec::new();
        for seed in 0..3 {
            cells.push(cell(seed, level(1.0), "va", &returns(0.0)));
            cells.push(cell(seed, level(0.0), "va", &returns(-4.0)));
        }
        let random = vec![random("hear-see", &returns(-10.0))];
        let mut evaluation = evaluation(vec![contender("hear-see", "mappo", 1); 3], random, cells);
        evaluation.settings.seed = trial;
        let group = only(Summary::of(&evaluation, &["maro"], 2).unwrap());
        let covers = |interval: Interval, truth| interval.low <= truth && truth <= interval.high;
        let lossy = &group.imputers[0].cells[1];
        [covers(lossy.mean, -4.0), covers(lossy.iqm, -4.0), covers(lossy.score.unwrap(), 0.6)]
    };
    let mut covered = [0.0; 3];
    const TRIALS: u64 = 200;
    for seen in (0..TRIALS).map(trial) {
        covered.iter_mut().zip(seen).for_each(|(covered, seen)| *covered += f64::from(u8::from(seen)));
    }
    // The standard error of 0.95 in 200 trials is 0.015.
    let shares = covered.map(|covered| covered / TRIALS as f64);
    assert!(shares.iter().all(|share| (0.90..=0.99).contains(share)), "{shares:?}");
}
