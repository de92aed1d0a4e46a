//! Made-up evaluations with the statistics one would expect of them, roughly.

use super::Provenance;
use crate::agent::Truth;
use crate::base::stats::{ci95, mean, std};
use crate::environment::Unit;
use crate::evaluate::{
    AgeErrors, Aggregate, Calibration, Cell, CellSummary, Comparison, Condition, Contender, Evaluation,
    Explained, Group, ImputerSummary, Interval, Loss, Outcome, RandomTeam, Settings, Summary, UnitErrors,
};

/// A task, the return of its policies where all is delivered, and their number.
pub type Played<'a> = (&'a str, f64, usize);

/// Three policies of one task and two of another, at three levels and in a mode, with three imputers.
pub fn two_tasks() -> (Evaluation, Summary) {
    let conditions = conditions(&["1", "0.2", "0", "dynamic"]);
    let tasks = [("hear-see", -24.0, 3), ("spread-xy-2", -151.0, 2)];
    played(&tasks, &conditions, &["value-aware", "maro", "hold"], 20)
}

/// Levels by their p, and links.
pub fn conditions(texts: &[&str]) -> Vec<Condition> {
    let condition = |text: &&str| match text.parse() {
        Ok(p) => Condition::level(p).unwrap(),
        Err(_) => Condition::parse(text, 2).unwrap(),
    };
    texts.iter().map(condition).collect()
}

pub fn provenance() -> Provenance {
    Provenance {
        program: "vamaro-swarm 0.1.0".to_owned(),
        command: "vamaro-swarm evaluate runs/* --report report".to_owned(),
        cpu: "a CPU, AVX-512".to_owned(),
        date: "2026-02-28".to_owned(),
    }
}

/// Policies of tasks under all conditions with all imputers, the first of which lose the least. The second is
/// the baseline.
pub fn played(
    tasks: &[Played],
    conditions: &[Condition],
    imputers: &[&str],
    episodes: u64,
) -> (Evaluation, Summary) {
    let mut evaluation = Evaluation {
        settings: Settings { episodes, comm_at_t0: true, ..Settings::default() },
        ..Evaluation::default()
    };
    for (task, full, seeds) in tasks {
        evaluation
            .random
            .push(RandomTeam { task: (*task).to_owned(), returns: returns(3.0 * full, 9, episodes) });
        for seed in 0..*seeds as u64 {
            let contender = evaluation.contenders.len();
            evaluation.contenders.push(contender_of(task, seed));
            for condition in conditions {
                for (rank, imputer) in imputers.iter().enumerate() {
                    let lost = 1.0 - condition.p().unwrap_or(0.5);
                    let level = full * (1.0 + 0.25 * (rank + 1) as f64 * lost.powi(2) + 0.01 * seed as f64);
                    let outcome = Outcome { returns: returns(level, seed, episodes), errors: errors(rank) };
                    let (condition, imputer) = (condition.clone(), (*imputer).to_owned());
                    evaluation.cells.push(Cell { contender, condition, imputer, outcome });
                }
            }
        }
    }
    let groups: Vec<Group> =
        tasks.iter().map(|(task, ..)| group(&evaluation, task, conditions, imputers)).collect();
    let summary = Summary {
        settings: evaluation.settings.clone(),
        axes: Vec::new(),
        contenders: evaluation.contenders.clone(),
        aggregates: aggregates(&groups, conditions, imputers),
        groups,
        claims: Vec::new(),
    };
    (evaluation, summary)
}

/// What one knows from oracles of `value-aware`, which explain all of a loss, and nothing of one that is none.
pub fn losses() -> Vec<Loss> {
    let interval = |value: f64| Interval { value, low: value - 0.01, high: value + 0.01 };
    let loss = |p: f64, loss: f64| {
        let explained = |truth, gain: f64| Explained {
            truth,
            gain: interval(gain),
            share: (loss > 0.01).then(|| interval(gain / loss)),
        };
        Loss {
            imputer: "value-aware".to_owned(),
            condition: Condition::level(p).unwrap(),
            loss: interval(loss),
            explained: vec![explained(Truth::Own, loss), explained(Truth::Agent(3), -0.025)],
        }
    };
    vec![loss(0.0, 0.5), loss(0.2, 0.005)]
}

/// A group that was not played with the baseline.
pub fn forget_baseline(group: &mut Group) {
    group.baseline = None;
    let cells = group.imputers.iter_mut().flat_map(|imputer| &mut imputer.cells);
    cells.for_each(|cell| cell.comparison = None);
}

/// A group whose policies are no better than random, as far as was played.
pub fn forget_scores(group: &mut Group) {
    for imputer in &mut group.imputers {
        imputer.cells.iter_mut().for_each(|cell| cell.score = None);
        (imputer.score_area, imputer.p_for_90) = (None, None);
    }
}

fn contender_of(task: &str, seed: u64) -> Contender {
    Contender {
        name: format!("runs/{task}-{seed}"),
        task: task.to_owned(),
        algorithm: "mappo".to_owned(),
        seed,
        steps: 5_000_000,
        origin: "trained by vamaro-swarm 0.1.0".to_owned(),
        fingerprint: format!("{:016x}", 0x1234_5678_9abc_def0 + seed),
        predictors: vec!["value-aware".to_owned(), "maro".to_owned()],
    }
}

fn returns(level: f64, seed: u64, episodes: u64) -> Vec<f64> {
    let noise = |episode: u64| ((episode * 7 + seed * 3) as f64).sin() + (episode as f64 * 0.7).cos();
    (0..episodes).map(|episode| level * (1.0 + 0.3 * noise(episode))).collect()
}

fn errors(rank: usize) -> Vec<UnitErrors> {
    let ages = |scale: f64| {
        (1..=6).map(move |age| {
            let count = 6000 / age;
            let rmse = scale * (rank + 1) as f64 * age as f64;
            let calibration = Calibration {
                count,
                z_squared: count as f64 * (1.0 + 0.1 * age as f64),
                within_50: count * 48 / 100,
                within_95: count * 91 / 100,
            };
            let calibration = (rank < 2).then_some(calibration);
            AgeErrors { count, squared: rmse * rmse * count as f64, calibration }
        })
    };
    [(Unit::Metre, 0.01), (Unit::MetrePerSecond, 0.05)]
        .map(|(unit, scale)| UnitErrors { unit, ages: ages(scale).collect() })
        .to_vec()
}

fn group(evaluation: &Evaluation, task: &str, conditions: &[Condition], imputers: &[&str]) -> Group {
    let of_task = |index: &usize| evaluation.contenders[*index].task == task;
    let contenders: Vec<usize> = (0..evaluation.contenders.len()).filter(of_task).collect();
    let random = evaluation.random.iter().find(|random| random.task == task).unwrap();
    let random = interval(&random.returns);
    let baseline = imputers.get(1).copied();
    let played = |condition: &Condition, imputer: &str| -> Vec<&[f64]> {
        let same = |cell: &&Cell| {
            of_task(&cell.contender) && cell.condition == *condition && cell.imputer == imputer
        };
        evaluation.cells.iter().filter(same).map(|cell| &cell.outcome.returns[..]).collect()
    };
    let imputer = |imputer: &&str| {
        let cells: Vec<CellSummary> = conditions
            .iter()
            .map(|condition| {
                let means = |runs: &[&[f64]]| runs.iter().map(|run| mean(run)).collect::<Vec<_>>();
                let (runs, full) = (played(condition, imputer), played(&conditions[0], imputer));
                let (seed_means, estimate) = (means(&runs), interval(&runs.concat()));
                let share = |value: f64| (value - random.value) / (mean(&full.concat()) - random.value);
                let score = scaled(&estimate, share);
                let compared = baseline.filter(|name| name != imputer && condition.p() != Some(1.0));
                let comparison = compared.map(|name| {
                    let other = played(condition, name);
                    let pairs = runs.concat().into_iter().zip(other.concat());
                    let differences: Vec<f64> = pairs.map(|(here, there)| here - there).collect();
                    let better = differences.iter().filter(|difference| **difference > 0.0).count() as f64;
                    let share = better / differences.len() as f64;
                    Comparison {
                        difference: interval(&differences),
                        relative: mean(&differences) / mean(&other.concat()).abs(),
                        probability_of_improvement: Interval {
                            value: share,
                            low: share - 0.02,
                            high: share + 0.02,
                        },
                        std_ratio: std(&seed_means)
                            .zip(std(&means(&other)))
                            .map(|(here, there)| here / there),
                    }
                });
                CellSummary {
                    condition: condition.clone(),
                    seed_std: std(&seed_means),
                    seed_means,
                    mean: estimate,
                    iqm: estimate,
                    score: Some(score),
                    comparison,
                }
            })
            .collect();
        let worst = cells.last().unwrap();
        ImputerSummary {
            imputer: (*imputer).to_owned(),
            return_area: Some(worst.mean),
            score_area: worst.score,
            p_for_90: worst.score.map(|score| scaled(&score, |score| 1.0 - score)),
            errors: errors(imputers.iter().position(|name| name == imputer).unwrap()),
            cells,
        }
    };
    Group {
        task: task.to_owned(),
        label: "mappo".to_owned(),
        contenders,
        random,
        baseline: baseline.map(str::to_owned),
        imputers: imputers.iter().map(imputer).collect(),
        losses: Vec::new(),
        profiles: Vec::new(),
    }
}

fn aggregates(groups: &[Group], conditions: &[Condition], imputers: &[&str]) -> Vec<Aggregate> {
    let mut aggregates = Vec::new();
    for (at, condition) in conditions.iter().enumerate().filter(|_| groups.len() > 1) {
        for (rank, imputer) in imputers.iter().enumerate() {
            let score = groups[0].imputers[rank].cells[at].score.unwrap();
            aggregates.push(Aggregate {
                label: "mappo".to_owned(),
                condition: condition.clone(),
                imputer: (*imputer).to_owned(),
                tasks: groups.iter().map(|group| group.task.clone()).collect(),
                runs: groups.iter().map(|group| group.contenders.len()).sum(),
                mean: score,
                iqm: score,
            });
        }
    }
    aggregates
}

fn interval(values: &[f64]) -> Interval {
    let (value, half) = (mean(values), ci95(values).unwrap());
    Interval { value, low: value - half, high: value + half }
}

fn scaled(interval: &Interval, scale: impl Fn(f64) -> f64) -> Interval {
    let (low, high) = (scale(interval.low), scale(interval.high));
    Interval { value: scale(interval.value), low: low.min(high), high: low.max(high) }
}
