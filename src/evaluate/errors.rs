//! How far imputed values are from what was lost, by the time since something was last received.

use std::collections::VecDeque;
use std::time::Duration;

use super::evaluation::{AgeErrors, Calibration, UnitErrors};
use crate::agent::{JointLayout, Truth};
use crate::base::error::Result;
use crate::bus::NOT_ARRIVED;
use crate::environment::{Spec, Unit, Value};
use crate::nn::{Dims, Policy, Predictor, PredictorState, Scratch};
use crate::supervisor::{Decisions, Observer, Stage, Tick};

/// Half the width of the central 50 % and 95 % intervals of a normal distribution, in sigma.
const WITHIN_50: f64 = 0.674_489_750_196_082;
const WITHIN_95: f64 = 1.959_963_984_540_054;

/// No sigma counts as smaller: it is about as far as neighbouring f32 values of an observation can be apart. A
/// predictor can become as sure as it likes of values that never move.
const SMALLEST_SIGMA: f64 = 1e-6;

/// Compares the estimates of a team with the truth while it plays.
///
/// What the predictor was sure of is computed here once more, from the same estimates: agents send no sigma.
#[derive(Debug)]
pub(super) struct ErrorLedger {
    spec: Spec,
    layout: JointLayout,
    /// Steps since receiver i received sender j, `[agents, worlds, agents]`; `None` before it ever did.
    ages: Vec<Option<usize>>,
    expectation: Option<Expectation>,
    /// What nobody imputes, since the agents are oracles: of each receiver, by dim, `[agents, predicted]`.
    told: Vec<bool>,
    /// The ages there can be: the oldest value was received when the episode started, and never again.
    oldest: usize,
    /// Of the episodes under way, `[worlds, units, oldest]`.
    open: Vec<AgeErrors>,
    /// Of finished episodes, added up in their order, `[units, oldest]`.
    finished: Vec<AgeErrors>,
}

/// How far off the predictor expects to be.
#[derive(Debug)]
struct Expectation {
    predictor: Predictor,
    dims: Dims,
    /// What each row's agent does, by its number among the team's actions.
    acts: Vec<usize>,
    state: PredictorState,
    scratch: Scratch,
    /// `[agents, worlds, 2, predicted]`.
    out: Vec<f32>,
    /// Of what is carried, `[agents, worlds, predicted]`.
    variances: Vec<f64>,
    /// Those of the changes in the last steps, as many as links may postpone by, the latest one last:
    /// `[kept, agents, worlds, predicted]`.
    changes: VecDeque<Vec<f64>>,
}

impl ErrorLedger {
    /// For episodes of `task`, imputed with the predictor of this name, if `policy` has one.
    pub(super) fn new(spec: &Spec, policy: &Policy, imputer: &str) -> ErrorLedger {
        let (imputer, truth) = Truth::split(imputer);
        let layout = JointLayout::of(spec);
        let mut told = vec![false; layout.agents * layout.predicted()];
        for (receiver, told) in told.chunks_exact_mut(layout.predicted()).enumerate() {
            let dims = truth.iter().flat_map(|truth| truth.dims(spec, receiver));
            dims.for_each(|dim| told[dim] = true);
        }
        let expectation = policy.predictor(imputer).map(|predictor| Expectation {
            predictor: predictor.clone(),
            dims: policy.dims().clone(),
            acts: Vec::new(),
            state: predictor.state(0),
            scratch: Scratch::default(),
            out: Vec::new(),
            variances: Vec::new(),
            changes: VecDeque::new(),
        });
        ErrorLedger {
            spec: spec.clone(),
            layout,
            ages: Vec::new(),
            expectation,
            told,
            oldest: spec.episode_steps - 1,
            open: Vec::new(),
            finished: vec![AgeErrors::default(); Unit::ALL.len() * (spec.episode_steps - 1)],
        }
    }

    /// An episode starts in each of `worlds` worlds, whose links may postpone by so many ticks.
    fn restart(&mut self, worlds: usize, longest_delay: u8) {
        let rows = self.layout.agents * worlds;
        restart(&mut self.ages, rows * self.layout.agents, None);
        restart(&mut self.open, worlds * self.finished.len(), AgeErrors::default());
        if let Some(expectation) = &mut self.expectation {
            expectation.state.start(rows);
            let values = rows * self.layout.predicted();
            restart(&mut expectation.variances, values, 0.0);
            expectation.changes.resize_with(longest_delay.into(), Vec::new);
            expectation.changes.iter_mut().for_each(|change| restart(change, values, 0.0));
            expectation.out.resize(rows * 2 * self.layout.predicted(), 0.0);
        }
    }

    /// Notes what the agents made of a tick in the worlds that play.
    fn note(&mut self, tick: &Tick, decisions: &Decisions, plays: impl Fn(usize) -> bool) {
        let agents = self.layout.agents;
        for row in 0..agents * tick.worlds {
            let ages = &mut self.ages[row * agents..(row + 1) * agents];
            let used = decisions.used(tick, row / tick.worlds, row % tick.worlds);
            // What there is of a receiver that is not there is old.
            let there = decisions.absent >> (row / tick.worlds) & 1 == 0;
            for (sender, age) in ages.iter_mut().enumerate() {
                let used = if there { used[sender] } else { NOT_ARRIVED };
                *age = match used {
                    NOT_ARRIVED => age.map(|age| age + 1),
                    arrived => Some(arrived.into()),
                };
                if let Some(expectation) = &mut self.expectation {
                    let arrived = Some(used).filter(|age| *age != NOT_ARRIVED);
                    let own = sender == row / tick.worlds;
                    expectation.state.hear(row, sender, if own { Some(0) } else { arrived });
                    if let Some(age) = arrived {
                        expectation.arrived(&self.layout, row, sender, age.into());
                    }
                }
            }
            if there && plays(row % tick.worlds) {
                self.compare(tick, decisions, row);
            }
        }
        if let Some(expectation) = &mut self.expectation {
            expectation.step(&self.layout, decisions, tick.worlds);
        }
    }

    /// Compares the estimate of one receiver in one world with the truth.
    fn compare(&mut self, tick: &Tick, decisions: &Decisions, row: usize) {
        let ErrorLedger { spec, layout, ages, expectation, told, oldest, open, finished } = self;
        let told = &told[row / tick.worlds * layout.predicted()..][..layout.predicted()];
        let errors = &mut open[row % tick.worlds * finished.len()..];
        let joint = layout.joint();
        let estimate = &decisions.estimates[row * joint..(row + 1) * joint];
        for (sender, age) in ages[row * layout.agents..].iter().take(layout.agents).enumerate() {
            let Some(age) = age.and_then(|age| age.checked_sub(1)) else { continue };
            let truth = tick.observation(spec, sender, row % tick.worlds);
            for (dim, Value { unit, .. }) in spec.agents[sender].observation.iter().enumerate() {
                let at = sender * layout.unique + dim;
                if told[at] {
                    continue;
                }
                let error = f64::from(estimate[at]) - f64::from(truth[dim]);
                let squared = error * error;
                let states = |expectation: &&Expectation| !expectation.predictor.spec().held.contains(&at);
                let calibration = expectation.as_ref().filter(states).map(|expectation| {
                    let z_squared = squared / expectation.variances[row * layout.predicted() + at];
                    let within = |width: f64| u64::from(z_squared <= width * width);
                    let (within_50, within_95) = (within(WITHIN_50), within(WITHIN_95));
                    Calibration { count: 1, z_squared, within_50, within_95 }
                });
                errors[*unit as usize * *oldest + age].add(&AgeErrors { count: 1, squared, calibration });
            }
        }
    }

    /// The episodes are over.
    fn close(&mut self) {
        for errors in self.open.chunks_exact(self.finished.len()) {
            self.finished.iter_mut().zip(errors).for_each(|(sum, errors)| sum.add(errors));
        }
    }

    /// The errors of all finished episodes.
    pub(super) fn finish(self) -> Vec<UnitErrors> {
        let of = |unit: Unit| {
            let ages = &self.finished[unit as usize * self.oldest..][..self.oldest];
            let oldest = ages.iter().rposition(|errors| errors.count > 0)?;
            Some(UnitErrors { unit, ages: ages[..=oldest].to_vec() })
        };
        Unit::ALL.into_iter().filter_map(of).collect()
    }
}

impl Observer for ErrorLedger {
    fn begin_episodes(&mut self, stage: &Stage) -> Result<()> {
        self.restart(stage.worlds(), stage.longest_delay());
        Ok(())
    }

    fn ticked(&mut self, stage: &Stage, decisions: &Decisions, _exchange: Duration) -> Result<()> {
        self.note(&stage.tick(), decisions, |world| stage.plays(world));
        Ok(())
    }

    fn end_episodes(&mut self, _stage: &Stage) -> Result<()> {
        self.close();
        Ok(())
    }
}

impl Expectation {
    /// What a sender observed so many steps ago has arrived: since then the variances of the changes have added up.
    fn arrived(&mut self, layout: &JointLayout, row: usize, sender: usize, age: usize) {
        let first = row * layout.predicted() + sender * layout.unique;
        for at in first..first + layout.unique {
            self.variances[at] = self.changes.iter().rev().take(age).map(|change| change[at]).sum();
        }
    }

    /// Adds the variance of the change that the predictor expects from here to the next step.
    fn step(&mut self, layout: &JointLayout, decisions: &Decisions, worlds: usize) {
        let predicted = layout.predicted();
        let Expectation { predictor, dims, acts, state, scratch, out, .. } = self;
        acts.clear();
        let actions = decisions.actions.iter().enumerate();
        acts.extend(actions.map(|(row, action)| dims.act(row / worlds, *action as usize)));
        predictor.step(layout.agents * worlds, &decisions.estimates, acts, state, scratch, out);
        let sigma = self.predictor.spec().sigma;
        let raw = self.out.chunks_exact(2 * predicted).flat_map(|out| &out[predicted..]);
        let changes = raw.map(|raw| f64::from(sigma.log_std(*raw)).exp().max(SMALLEST_SIGMA).powi(2));
        let mut oldest = self.changes.pop_front();
        for (at, (variance, change)) in self.variances.iter_mut().zip(changes).enumerate() {
            *variance += change;
            if let Some(kept) = &mut oldest {
                kept[at] = change;
            }
        }
        self.changes.extend(oldest);
    }
}

/// Makes `values` so many of the same, without giving memory back.
fn restart<T: Clone>(values: &mut Vec<T>, length: usize, value: T) {
    values.clear();
    values.resize(length, value);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::dims;
    use crate::environment::Task;
    use crate::nn::{ActorKind, Meta, Networks};

    /// Hear-see with a predictor that expects no change, with sigma 1, whatever it sees.
    fn sure_of_nothing() -> (Spec, Policy) {
        let spec = Task::parse("hear-see").unwrap().spec().clone();
        let networks = Networks::paper(ActorKind::Mlp);
        let values = vec![0.0; Policy::untrained(&dims(&spec), 0, networks.clone()).unwrap().n_values()];
        let policy = Policy::new(&dims(&spec), Meta::new("hear-see", 0), networks, &values).unwrap();
        (spec, policy)
    }

    /// Plays four steps in one world. Agent 1 observes the places 1, 2, 3, 4 m, at rest, and agent 0 believes
    /// them to be off by 0.1 m per step without news; agent 1 always knows what agent 0 observes.
    fn four_steps(imputer: &str, received: [bool; 4]) -> Vec<UnitErrors> {
        four_steps_of(imputer, received.map(|received| if received { 0 } else { NOT_ARRIVED }))
    }

    /// The same, of what arrives at agent 0 at these ages.
    fn four_steps_of(imputer: &str, arriving: [u8; 4]) -> Vec<UnitErrors> {
        let (spec, policy) = sure_of_nothing();
        let mut ledger = ErrorLedger::new(&spec, &policy, imputer);
        ledger.restart(1, 3);
        let hears = [0.5, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let sees = [1.0, 2.0, 3.0, 4.0, 0.0, 0.0, 0.0, 0.0];
        let observations = [hears, sees].concat();
        let mut age = 0;
        for (step, arriving) in arriving.into_iter().enumerate() {
            age = if arriving == NOT_ARRIVED { age + 1 } else { arriving };
            let believed = sees.map(|value| if value > 0.0 { value + 0.1 * f32::from(age) } else { value });
            let decisions = Decisions {
                ages: vec![0, arriving, 0, 0],
                estimates: [hears, believed, hears, sees].concat(),
                ..Decisions::default()
            };
            let step = step as u32;
            let (observations, ages) = (&observations, &[0; 4]);
            let tick = Tick {
                episode: 0,
                step,
                tick: 1,
                agents: 2,
                worlds: 1,
                absent: 0,
                carried_out: &[0; 2],
                observations,
                ages,
                messages: ages,
                held: &[],
                told: &[],
            };
            ledger.note(&tick, &decisions, |_| true);
        }
        ledger.close();
        ledger.finish()
    }

    #[test]
    fn errors_are_those_of_what_was_imputed_by_age_and_unit() {
        let errors = four_steps("hold", [true, false, false, true]);
        // Four places and four velocities, one and two steps old; padding is no value.
        assert_eq!(errors.iter().map(|of| of.unit).collect::<Vec<_>>(), [Unit::Metre, Unit::MetrePerSecond]);
        let [places, velocities] = &errors[..] else { panic!() };
        assert_eq!(places.ages.iter().map(|age| age.count).collect::<Vec<_>>(), [4, 4]);
        assert!((places.ages[0].rmse().unwrap() - 0.1).abs() < 1e-6);
        assert!((places.ages[1].rmse().unwrap() - 0.2).abs() < 1e-6);
        assert!(velocities.ages.iter().all(|age| age.rmse() == Some(0.0) && age.calibration.is_none()));
        assert_eq!(four_steps("hold", [true; 4]), []);
    }

    #[test]
    fn what_an_oracle_is_told_is_not_imputed() {
        let counts = |imputer: &str| -> Vec<Vec<u64>> {
            let errors = four_steps(imputer, [true, false, false, true]);
            errors.iter().map(|of| of.ages.iter().map(|age| age.count).collect()).collect()
        };
        // Of what agent 1 observes, half is about itself and half about agent 0, which does not hear of it.
        assert_eq!(counts("value-aware"), [[4, 4], [4, 4]]);
        for truth in [Truth::Own, Truth::Others, Truth::Agent(0)] {
            assert_eq!(counts(&truth.oracle("value-aware")), [[2, 2], [2, 2]], "{truth}");
        }
        assert_eq!(counts(&Truth::Constants.oracle("value-aware")), [[4, 4], [4, 4]]);
        let told = four_steps(&Truth::Own.oracle("value-aware"), [true, false, false, true]);
        assert_eq!(
            told[0].ages[0].calibration.map(|stated| stated.count),
            Some(2),
            "as its predictor states"
        );
    }

    #[test]
    fn what_was_never_received_has_no_age() {
        assert_eq!(["hold", "value-aware"].map(|imputer| four_steps(imputer, [false; 4])), [[], []]);
        let late = four_steps("value-aware", [false, false, true, false]);
        assert_eq!(late, four_steps("value-aware", [true, false, true, true]), "only the news count");
    }

    #[test]
    fn the_variance_of_what_is_expected_adds_up_until_news_come() {
        let errors = four_steps("value-aware", [true, false, false, false]);
        for (age, found) in errors[0].ages.iter().enumerate() {
            // Sigma is 1 for each step, the error 0.1 a step: z^2 = (0.1 a)^2 / a for each of four places.
            let found = found.calibration.unwrap();
            let expected = 4.0 * 0.01 * (age + 1) as f64;
            assert!((found.z_squared - expected).abs() < 1e-6, "{found:?}");
            assert_eq!((found.within_50, found.within_95), (4, 4));
        }
        let renewed = four_steps("value-aware", [true, false, true, false]);
        assert_eq!(renewed[0].ages.len(), 1, "news are as good at any time");
        assert_eq!(renewed[0].ages[0].count, 8);
        assert!((renewed[0].ages[0].calibration.unwrap().z_squared - 8.0 * 0.01).abs() < 1e-6);
    }

    #[test]
    fn what_arrives_late_is_as_old_as_it_is() {
        // Agent 0 hears of agent 1 at once, not, two steps late, and not.
        let errors = four_steps_of("value-aware", [0, NOT_ARRIVED, 2, NOT_ARRIVED]);
        let [places, _] = &errors[..] else { panic!() };
        assert_eq!(places.ages.iter().map(|age| age.count).collect::<Vec<_>>(), [4, 4, 4]);
        for (age, found) in (1..).zip(&places.ages) {
            // Sigma is 1 for each of the steps since it was made.
            let expected = 4.0 * 0.01 * f64::from(age);
            assert!((found.calibration.unwrap().z_squared - expected).abs() < 1e-6, "{found:?}");
        }
    }
}
