//! Estimates worked by hand.

mod intervals;

use super::*;
use crate::agent::Truth;
use crate::environment::Unit;

fn level(p: f64) -> Condition {
    Condition::level(p).unwrap()
}

fn uniform() -> Condition {
    Condition::parse("uniform", 1).unwrap()
}

fn contender(task: &str, algorithm: &str, steps: u64) -> Contender {
    Contender {
        name: String::new(),
        task: task.to_owned(),
        algorithm: algorithm.to_owned(),
        seed: 0,
        steps,
        origin: String::new(),
        fingerprint: String::new(),
        predictors: Vec::new(),
    }
}

fn cell(contender: usize, condition: Condition, imputer: &str, returns: &[f64]) -> Cell {
    let outcome = Outcome { returns: returns.to_vec(), errors: Vec::new() };
    Cell { contender, condition, imputer: imputer.to_owned(), outcome }
}

fn random(task: &str, returns: &[f64]) -> RandomTeam {
    RandomTeam { task: task.to_owned(), returns: returns.to_vec() }
}

fn evaluation(contenders: Vec<Contender>, random: Vec<RandomTeam>, cells: Vec<Cell>) -> Evaluation {
    let episodes = cells[0].outcome.returns.len() as u64;
    let settings = Settings { episodes, ..Settings::default() };
    Evaluation { settings, axes: Vec::new(), contenders, random, cells }
}

/// Two seeds at three levels and in a mode. What is said of it below is worked by hand.
fn two_seeds() -> Evaluation {
    let mut cells = Vec::new();
    let of_seeds: [&[(Condition, &str, [f64; 4])]; 2] = [
        &[
            (level(1.0), "maro", [0.0, -2.0, 2.0, 0.0]),
            (level(1.0), "va", [0.0, -2.0, 2.0, 0.0]),
            (level(0.0), "maro", [-20.0, -22.0, -18.0, -20.0]),
            (level(0.0), "va", [-12.0, -12.0, -12.0, -12.0]),
            (level(0.5), "maro", [-10.0, -10.0, -12.0, -8.0]),
            (level(0.5), "va", [-5.0, -10.0, -5.0, -4.0]),
            (uniform(), "maro", [-100.0, -100.0, -100.0, -100.0]),
            (uniform(), "va", [-100.0, -101.0, -100.0, -99.0]),
        ],
        &[
            (level(1.0), "maro", [-10.0, -10.0, -10.0, -10.0]),
            (level(1.0), "va", [-10.0, -10.0, -10.0, -10.0]),
            (level(0.0), "maro", [-20.0, -20.0, -20.0, -20.0]),
            (level(0.0), "va", [-16.0, -16.0, -16.0, -16.0]),
            (level(0.5), "maro", [-15.0, -15.0, -16.0, -14.0]),
            (level(0.5), "va", [-12.0, -15.0, -9.0, -12.0]),
            (uniform(), "maro", [-100.0, -100.0, -100.0, -100.0]),
            (uniform(), "va", [-100.0, -101.0, -100.0, -99.0]),
        ],
    ];
    for (seed, played) in of_seeds.into_iter().enumerate() {
        cells.extend(
            played
                .iter()
                .map(|(condition, imputer, returns)| cell(seed, condition.clone(), imputer, returns)),
        );
    }
    let contenders = vec![contender("hear-see", "mappo", 5_000_000); 2];
    evaluation(contenders, vec![random("hear-see", &[-20.0, -20.0, -24.0, -16.0])], cells)
}

/// The only group of a summary.
fn only(summary: Summary) -> Group {
    assert_eq!(summary.groups.len(), 1);
    summary.groups.into_iter().next().unwrap()
}

fn assert_near(value: f64, expected: f64) {
    assert!((value - expected).abs() < 1e-12, "{value}, expected {expected}");
}

fn width(interval: Interval) -> f64 {
    interval.high - interval.low
}

#[test]
fn two_seeds_worked_by_hand() {
    let group = only(Summary::of(&two_seeds(), &["maro"], 1).unwrap());
    assert_eq!((&group.task[..], &group.label[..]), ("hear-see", "mappo"));
    assert_eq!((&group.contenders[..], group.baseline.as_deref()), (&[0, 1][..], Some("maro")));
    assert_near(group.random.value, -20.0);
    let [maro, va] = &group.imputers[..] else { panic!("two imputers") };
    let conditions: Vec<Condition> = va.cells.iter().map(|cell| cell.condition.clone()).collect();
    assert_eq!(conditions, [level(1.0), level(0.0), level(0.5), uniform()]);

    let cell = &va.cells[2];
    // -24 / 4, -48 / 4: mean -9, variance 2 * 3^2 / 1.
    assert_eq!(cell.seed_means, [-6.0, -12.0]);
    assert_near(cell.seed_std.unwrap(), 18f64.sqrt());
    assert_near(cell.mean.value, -9.0);
    // -15 -12 (-12 -10 -9 -5) -5 -4.
    assert_near(cell.iqm.value, -36.0 / 4.0);
    // (-6 + 20) / (0 + 20) = 0.7, (-12 + 20) / (-10 + 20) = 0.8.
    assert_near(cell.score.unwrap().value, 0.75);
    assert_near(maro.cells[2].score.unwrap().value, 0.5);

    let comparison = cell.comparison.unwrap();
    // MARO's means are -10 and -15.
    assert_near(comparison.difference.value, -9.0 + 12.5);
    assert_near(comparison.relative, 3.5 / 12.5);
    // Each seed: three episodes better, one as good.
    assert_near(comparison.probability_of_improvement.value, 7.0 / 8.0);
    // sqrt(18) / sqrt(12.5) = sqrt(1.44).
    assert_near(comparison.std_ratio.unwrap(), 1.2);
    // All means are -100, so there is no spread to compare with.
    let uniform = va.cells[3].comparison.unwrap();
    assert_near(uniform.difference.value, 0.0);
    assert_near(uniform.probability_of_improvement.value, 0.25 * (0.5 + 0.0 + 0.5 + 1.0));
    assert_eq!(uniform.std_ratio, None);

    // (0, -14), (0.5, -9), (1, -5): 0.5 * 11.5 + 0.5 * 7.
    assert_near(va.return_area.unwrap().value, -9.25);
    // (0, 0.4), (0.5, 0.75), (1, 1): 0.5 * 0.575 + 0.5 * 0.875.
    assert_near(va.score_area.unwrap().value, 0.725);
    // 0.5 + 0.5 * 0.15 / 0.25, 0.5 + 0.5 * 0.4 / 0.5.
    assert_near(va.p_for_90.unwrap().value, 0.8);
    assert_near(maro.p_for_90.unwrap().value, 0.9);
}

#[test]
fn nothing_is_compared_with_itself_or_where_nothing_is_lost() {
    let group = only(Summary::of(&two_seeds(), &["maro"], 1).unwrap());
    assert!(group.imputers[0].cells.iter().all(|cell| cell.comparison.is_none()));
    let compared: Vec<bool> = group.imputers[1].cells.iter().map(|cell| cell.comparison.is_some()).collect();
    assert_eq!(compared, [false, true, true, true]);
    let group = only(Summary::of(&two_seeds(), &["hold"], 1).unwrap());
    assert_eq!(group.baseline, None);
    assert!(group.imputers.iter().flat_map(|imputer| &imputer.cells).all(|cell| cell.comparison.is_none()));
}

#[test]
fn what_oracles_explain_worked_by_hand() {
    let losses = |change: &dyn Fn(&mut Cell)| {
        let mut evaluation = two_seeds();
        for cell in evaluation.cells.iter_mut() {
            if cell.imputer == "va" {
                cell.imputer = Truth::Own.oracle("maro");
            }
            change(cell);
        }
        only(Summary::of(&evaluation, &["maro"], 1).unwrap()).losses
    };
    let expected = [
        // MARO brings in what uniform actions do, the oracle has a score of 0.4.
        (level(0.0), 1.0, 0.4, 0.4),
        // 0.5 of the score is lost, and 0.75 is the oracle's.
        (level(0.5), 0.5, 0.25, 0.5),
        // (-100 + 20) / 20 = -4, (-100 + 20) / 10 = -8, with and without the truth.
        (uniform(), 7.0, 0.0, 0.0),
    ];
    let found = losses(&|_| ());
    assert_eq!(found.len(), expected.len());
    for (found, (condition, loss, gain, share)) in found.iter().zip(expected) {
        assert_eq!((&found.condition, &found.imputer[..]), (&condition, "maro"));
        assert_near(found.loss.value, loss);
        let [explained] = &found.explained[..] else { panic!("one oracle") };
        assert_eq!(explained.truth, Truth::Own);
        assert_near(explained.gain.value, gain);
        assert_near(explained.share.unwrap().value, share);
        assert!(width(explained.gain) > 0.0 && width(explained.share.unwrap()) > 0.0);
    }
    // Where nothing is lost, nothing is a share of it.
    let nothing = losses(&|cell| {
        if cell.imputer == "maro" && cell.condition == level(0.5) {
            cell.outcome.returns = [[0.0, -2.0, 2.0, 0.0], [-10.0; 4]][cell.contender].to_vec();
        }
    });
    assert_eq!((nothing[1].loss.value, nothing[1].explained[0].share), (0.0, None));
    assert_near(nothing[1].explained[0].gain.value, -0.25);
    // Without p = 1 there are no scores, and the oracle of another imputer says nothing of this one.
    let relabel = |cell: &mut Cell| {
        cell.condition = if cell.condition.is_lossless() { level(0.9) } else { cell.condition.clone() }
    };
    assert_eq!(losses(&relabel), []);
    assert_eq!(losses(&|cell| cell.imputer = cell.imputer.replace("maro+", "hold+")), []);
}

#[test]
fn groups_are_policies_trained_alike() {
    let contenders = vec![
        contender("spread-xy-2", "mappo", 5_000_000),
        contender("hear-see", "mappo", 20_000_000),
        contender("hear-see", "ippo", 5_000_000),
        contender("hear-see", "mappo", 5_000_000),
        contender("spread-xy-2", "mappo", 5_000_000),
    ];
    let cells = (0..5).map(|at| cell(at, level(0.0), "maro", &[-1.0])).collect();
    let summary = Summary::of(&evaluation(contenders, vec![], cells), &["maro"], 1).unwrap();
    let groups: Vec<_> = summary
        .groups
        .iter()
        .map(|group| (&group.task[..], &group.label[..], &group.contenders[..]))
        .collect();
    assert_eq!(
        groups,
        [
            ("spread-xy-2", "mappo 5 M", &[0, 4][..]),
            ("hear-see", "mappo 20 M", &[1]),
            ("hear-see", "ippo", &[2]),
            ("hear-see", "mappo 5 M", &[3]),
        ]
    );
}

#[test]
fn cells_that_only_some_played_are_about_these() {
    let cells = vec![
        cell(0, level(0.0), "maro", &[-4.0, -2.0]),
        cell(1, level(0.0), "maro", &[-40.0, -20.0]),
        cell(1, level(0.0), "va", &[-10.0, -10.0]),
        cell(0, level(0.0), "hold", &[-6.0, -6.0]),
    ];
    let group = only(
        Summary::of(&evaluation(vec![contender("hear-see", "mappo", 1); 2], vec![], cells), &["maro"], 1)
            .unwrap(),
    );
    let [maro, va, hold] = &group.imputers[..] else { panic!("three imputers") };
    assert_eq!(maro.cells[0].seed_means, [-3.0, -30.0]);
    assert_eq!(va.cells[0].seed_means, [-10.0]);
    let comparison = va.cells[0].comparison.unwrap();
    assert_eq!((comparison.difference.value, comparison.relative), (20.0, 2.0 / 3.0));
    assert_eq!(comparison.std_ratio, None);
    assert_eq!(hold.cells[0].comparison.unwrap().difference.value, -3.0);
}

#[test]
fn the_least_that_can_be_played_has_a_summary() {
    let one = evaluation(
        vec![contender("hear-see", "mappo", 1)],
        vec![random("hear-see", &[-8.0])],
        vec![cell(0, level(0.2), "zero", &[0.0])],
    );
    let group = only(Summary::of(&one, &["zero"], 2).unwrap());
    let point = |value| Interval { value, low: value, high: value };
    assert_eq!(group.random, point(-8.0));
    let imputer = &group.imputers[0];
    assert_eq!((imputer.return_area, imputer.score_area, imputer.p_for_90), (None, None, None));
    assert_eq!(
        (imputer.cells[0].mean, imputer.cells[0].iqm, imputer.cells[0].score),
        (point(0.0), point(0.0), None)
    );
    assert_eq!(Summary::of(&Evaluation::default(), &["zero"], 2).unwrap().groups, []);
}

#[test]
fn a_baseline_of_zero_has_no_share() {
    let cells = vec![
        cell(0, level(0.0), "maro", &[0.0]),
        cell(0, level(0.0), "hold", &[0.0]),
        cell(0, level(0.0), "va", &[1.0]),
    ];
    let group = only(
        Summary::of(&evaluation(vec![contender("hear-see", "mappo", 1)], vec![], cells), &["maro"], 1)
            .unwrap(),
    );
    let relative = |imputer: usize| group.imputers[imputer].cells[0].comparison.unwrap().relative;
    assert_eq!((relative(1), relative(2)), (0.0, f64::INFINITY));
}

#[test]
fn errors_are_those_of_lossy_levels() {
    let age = |count, squared| AgeErrors { count, squared, calibration: None };
    let known = |count, z_squared| AgeErrors {
        count,
        squared: 1.0,
        calibration: Some(Calibration { count, z_squared, within_50: 1, within_95: 2 }),
    };
    let of = |unit, ages: &[AgeErrors]| UnitErrors { unit, ages: ages.to_vec() };
    let mut evaluation = two_seeds();
    let mut set = |contender, condition, errors: &[UnitErrors]| {
        let wanted = |cell: &&mut Cell| {
            (cell.contender, &cell.condition, &cell.imputer[..]) == (contender, &condition, "va")
        };
        evaluation.cells.iter_mut().find(wanted).unwrap().outcome.errors = errors.to_vec();
    };
    set(0, level(0.0), &[of(Unit::Metre, &[age(1, 4.0)]), of(Unit::One, &[known(3, 2.0)])]);
    set(1, level(0.0), &[of(Unit::Metre, &[age(2, 1.0), age(7, 7.0)])]);
    set(0, level(0.5), &[of(Unit::One, &[known(5, 3.0)]), of(Unit::Metre, &[age(1, 1.0)])]);
    set(0, uniform(), &[of(Unit::Metre, &[age(100, 100.0)])]);
    set(0, level(1.0), &[of(Unit::Metre, &[age(100, 100.0)])]);
    let group = only(Summary::of(&evaluation, &["maro"], 1).unwrap());
    let calibration = Some(Calibration { count: 8, z_squared: 5.0, within_50: 2, within_95: 4 });
    assert_eq!(
        group.imputers[1].errors,
        [
            of(Unit::Metre, &[age(4, 6.0), age(7, 7.0)]),
            of(Unit::One, &[AgeErrors { count: 8, squared: 2.0, calibration }]),
        ]
    );
    assert_eq!(group.imputers[0].errors, []);
}

/// Policies that score so at p = 0, task by task; scores are exact.
fn scored(tasks: &[(&str, &[f64])]) -> Summary {
    let (mut contenders, mut teams, mut cells) = (Vec::new(), Vec::new(), Vec::new());
    for (task, scores) in tasks {
        teams.push(random(task, &[-8.0, -8.0]));
        for score in *scores {
            cells.push(cell(contenders.len(), level(1.0), "va", &[0.0, 0.0]));
            cells.push(cell(contenders.len(), level(0.0), "va", &[8.0 * (score - 1.0); 2]));
            contenders.push(contender(task, "mappo", 1));
        }
    }
    Summary::of(&evaluation(contenders, teams, cells), &["maro"], 2).unwrap()
}

#[test]
fn aggregates_worked_by_hand() {
    let summary = scored(&[("hear-see", &[0.5, 0.75]), ("spread-xy-2", &[0.25]), ("spread-xy-3", &[0.0])]);
    let [lossless, lossy] = &summary.aggregates[..] else { panic!("two conditions") };
    assert_eq!((&lossless.condition, lossless.mean.value, width(lossless.mean)), (&level(1.0), 1.0, 0.0));
    assert_eq!((&lossy.label[..], &lossy.imputer[..], &lossy.condition), ("mappo", "va", &level(0.0)));
    assert_eq!((lossy.tasks.len(), lossy.runs), (3, 4));
    // The mean of 5/8, 1/4 and 0; that of the two runs in the middle of 0, 1/4, 1/2, 3/4. Resamples vary in the first task only: its
    // runs are both 1/2, both 3/4, or one of each.
    assert_eq!(lossy.mean, Interval { value: 0.875 / 3.0, low: 0.25, high: 1.0 / 3.0 });
    assert_eq!(lossy.iqm, Interval { value: 0.375, low: 0.375, high: 0.5 });
}

#[test]
fn aggregates_are_over_tasks_that_have_scores() {
    assert_eq!(scored(&[("hear-see", &[0.5, 0.75])]).aggregates, []);
    // The policy of the third task is as good as random where everything is delivered.
    let mut evaluation = two_seeds();
    for task in ["spread-xy-2", "spread-xy-3"] {
        let contender_of = evaluation.contenders.len();
        evaluation.contenders.push(contender(task, "mappo", 5_000_000));
        evaluation.random.push(random(task, &[-8.0; 4]));
        let best = if task == "spread-xy-2" { 0.0 } else { -8.0 };
        evaluation.cells.push(cell(contender_of, level(1.0), "va", &[best; 4]));
        evaluation.cells.push(cell(contender_of, level(0.5), "va", &[-8.0; 4]));
    }
    let summary = Summary::of(&evaluation, &["maro"], 1).unwrap();
    assert!(summary.aggregates.iter().all(|aggregate| aggregate.tasks == ["hear-see", "spread-xy-2"]));
    let conditions: Vec<_> =
        summary.aggregates.iter().map(|one| (one.condition.clone(), one.mean.value)).collect();
    // ((0.7 + 0.8) / 2 + 0) / 2.
    assert_eq!(conditions.len(), 2);
    assert_eq!(conditions[0], (level(1.0), 1.0));
    assert_near(conditions[1].1, 0.375);
}
