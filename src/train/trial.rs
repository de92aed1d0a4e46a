//! Test episodes: how the policy does by itself, at every level and with every predictor.

use std::sync::Mutex;
use std::sync::PoisonError;

use super::config::Config;
use crate::agent::{AgentSettings, PolicySource, Registry};
use crate::base::error::Result;
use crate::base::stats::{mean, std};
use crate::base::threads::side_by_side;
use crate::environment::Task;
use crate::link::Links;
use crate::nn::Policy;
use crate::supervisor::{InProcess, Ledger, Session};

/// The levels that are tested: probabilities of delivery.
pub const LEVELS: [f64; 6] = [1.0, 0.8, 0.6, 0.4, 0.2, 0.0];

/// Test episodes are numbered from here on, so that they are never those of training.
const FIRST_EPISODE: u64 = 1 << 48;

/// The most test episodes that are played side by side.
const WORLDS: u64 = 50;

/// How the team did at one level with one imputer.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// The imputer.
    pub imputer: String,
    /// Probability of delivery.
    pub level: f64,
    /// Mean return of the test episodes.
    pub return_mean: f64,
    /// Its (unbiased) standard deviation over episodes.
    pub return_std: Option<f64>,
    /// Root mean squared error of what was imputed.
    pub imputation_rmse: Option<f64>,
}

/// Plays the tests of row number `row`, imputer by imputer and level by level. All of them start from the same
/// states with the same draws. Where everything is delivered nothing is imputed, so that is played once.
pub fn test(config: &Config, task: &Task, policy: &Policy, row: usize, threads: usize) -> Result<Vec<Trial>> {
    let imputers = config.tested_imputers();
    let trials = imputers.iter().enumerate().flat_map(|(at, imputer)| {
        LEVELS
            .iter()
            .filter(move |level| at == 0 || **level < 1.0)
            .map(move |level| (imputer.clone(), *level))
    });
    let trials: Vec<_> = trials.collect();
    let results: Vec<_> = trials.iter().map(|_| Mutex::new(None)).collect();
    side_by_side(threads, trials.iter().zip(&results), |((imputer, level), result)| {
        let trial = play(config, task, policy, row, imputer, *level);
        *result.lock().unwrap_or_else(PoisonError::into_inner) = Some(trial);
    });
    let result = |cell: Mutex<Option<_>>| cell.into_inner().unwrap_or_else(PoisonError::into_inner);
    let played = results.into_iter().map(|cell| result(cell).expect("every trial was played"));
    let mut played: Vec<Trial> = played.collect::<Result<_>>()?;
    for (at, imputer) in imputers.iter().enumerate().skip(1) {
        let everything = Trial { imputer: imputer.to_string(), ..played[0].clone() };
        played.insert(at * LEVELS.len(), everything);
    }
    Ok(played)
}

fn play(
    config: &Config,
    task: &Task,
    policy: &Policy,
    row: usize,
    imputer: &str,
    level: f64,
) -> Result<Trial> {
    let settings = AgentSettings {
        spec: task.spec().clone(),
        policy: PolicySource::Training,
        // Where everything is delivered, whoever imputes has nothing to do.
        imputer: if level == 1.0 { "hold" } else { imputer }.to_owned(),
        registry: Registry::default(),
        greedy: false,
        seed: config.seed,
        worlds: config.test_episodes.min(WORLDS) as usize,
        longest_delay: 0,
        relay: config.relay,
        tell_logits: false,
    };
    let first = FIRST_EPISODE + row as u64 * config.test_episodes;
    let links = Links::level(level);
    let environment = task.environment(settings.worlds);
    let mut session = Session::new(environment, links, config.seed).relaying(config.relay).starting_at(first);
    let (mut team, mut ledger) = (InProcess::new(&settings, policy)?, Ledger::default());
    session.play(&mut team, first + config.test_episodes, &mut [&mut ledger])?;
    let statistics = ledger.into_statistics();
    let returns: Vec<f64> = statistics.episodes().iter().map(|episode| episode.episode_return).collect();
    Ok(Trial {
        imputer: imputer.to_string(),
        level,
        return_mean: mean(&returns),
        return_std: std(&returns),
        imputation_rmse: statistics.imputation_rmse(),
    })
}
