//! What is said of summaries that tests make up.

use super::super::fixture;
use super::*;

fn one_group() -> Summary {
    let (_, mut summary) = fixture::two_tasks();
    summary.groups.truncate(1);
    summary.aggregates.clear();
    summary
}

/// The summary, and the cell of an imputer that was played at p = 1, 0.2, 0 and in a mode.
fn set_scores(summary: &mut Summary, imputer: usize, at: usize, value: f64, half: f64) {
    let cell = &mut summary.groups[0].imputers[imputer].cells[at];
    cell.score = Some(Interval { value, low: value - half, high: value + half });
}

fn text(summary: &Summary) -> String {
    findings(summary).join(" ")
}

#[test]
fn which_imputer_how_much_is_kept_and_how_sure_that_is() {
    let mut summary = one_group();
    set_scores(&mut summary, 0, 2, 0.875, 0.01);
    set_scores(&mut summary, 1, 2, 0.5, 0.02);
    set_scores(&mut summary, 2, 2, -0.5, 0.02);
    let group = &mut summary.groups[0];
    group.imputers[0].p_for_90 = Some(Interval { value: 0.05, low: 0.04, high: 0.06 });
    group.imputers[0].cells[2].seed_std = Some(3.5);
    let difference = Interval { value: 12.0, low: 9.5, high: 14.0 };
    group.imputers[0].cells[2].comparison.as_mut().unwrap().difference = difference;
    assert_eq!(
        findings(&summary),
        [
            "value-aware does best of 3 imputers: at p = 0 the team keeps 87.5 % of the score (95 % interval 86.5 to 88.5).",
            "It keeps 90 % of the score from p = 0.05 on (95 % interval 0.04 to 0.06).",
            "The difference to maro (the baseline, score 0.50) is +12.0 of return per episode (95 % interval 9.5 to \
             14.0).",
            "Intervals are over 20 episodes of each of 3 policies; from policy to policy the mean return there varies \
             with a standard deviation of 3.5.",
        ]
    );
    // Where 90 % is kept anyhow, nobody asks from where on.
    set_scores(&mut summary, 0, 2, 0.95, 0.01);
    assert!(!text(&summary).contains("keeps 90 %"));
    // Whose interval overlaps may be as good.
    set_scores(&mut summary, 1, 2, 0.93, 0.02);
    assert!(text(&summary).contains(" The interval of maro overlaps with that. "));
    set_scores(&mut summary, 2, 2, 0.93, 0.02);
    assert!(text(&summary).contains(" The intervals of maro and hold overlap with that. "));
    summary.groups[0].imputers[0].cells[2].comparison.as_mut().unwrap().difference.low = -1.0;
    assert!(text(&summary).contains("), not distinguishable from zero."), "{}", text(&summary));
}

#[test]
fn a_baseline_that_does_best_is_compared_with_the_next() {
    let mut summary = one_group();
    set_scores(&mut summary, 1, 2, 0.99, 0.001);
    set_scores(&mut summary, 0, 2, 0.9, 0.001);
    set_scores(&mut summary, 2, 2, 0.5, 0.001);
    let of_next = &mut summary.groups[0].imputers[0].cells[2].comparison.as_mut().unwrap().difference;
    *of_next = Interval { value: -4.0, low: -5.0, high: -2.0 };
    let text = text(&summary);
    assert!(
        text.starts_with("maro does best of 3 imputers: at p = 0 the team keeps 99.0 % of the score"),
        "{text}"
    );
    let against = "The difference to value-aware (the next best, score 0.90) is +4.0 of return per episode (95 % interval \
                   2.0 to 5.0).";
    assert!(text.contains(against), "{text}");
}

#[test]
fn scores_that_are_none_or_negative() {
    let mut summary = one_group();
    summary.groups[0].imputers.truncate(1);
    set_scores(&mut summary, 0, 2, -0.4, 0.1);
    let expected = "With value-aware, the only imputer played, at p = 0 the team does worse than with random actions, \
                    with a score of -0.40 (95 % interval -0.50 to -0.30).";
    assert_eq!(findings(&summary)[0], expected);
    set_scores(&mut summary, 0, 2, 0.05, 0.1);
    let expected = "at p = 0 the team keeps no measurable part of the score, which is 0.05 (95 % interval -0.05 to \
                    0.15).";
    assert!(findings(&summary)[0].ends_with(expected), "{}", findings(&summary)[0]);
    // No interval, no word of it.
    set_scores(&mut summary, 0, 2, 0.5, 0.0);
    assert!(
        findings(&summary)[0].ends_with(" at p = 0 the team keeps 50.0 % of the score."),
        "{}",
        text(&summary)
    );
    fixture::forget_scores(&mut summary.groups[0]);
    let text = text(&summary);
    assert!(text.contains("at p = 0 the mean return is -"), "{text}");
    assert!(
        text.contains("because at p = 1 these policies are not clearly better than random actions."),
        "{text}"
    );
    summary.groups[0].imputers[0].cells.remove(0);
    assert!(findings(&summary)[0].ends_with("there is no score, because p = 1 was not played."));
}

#[test]
fn conditions_that_are_no_levels_and_one_where_nothing_is_lost() {
    let mut summary = one_group();
    for imputer in &mut summary.groups[0].imputers {
        imputer.cells.retain(|cell| cell.condition.p() != Some(0.0) && cell.condition.p() != Some(0.2));
    }
    let text_of = |summary: &Summary| findings(summary)[0].clone();
    assert!(text_of(&summary).contains(": under dynamic "), "{}", text_of(&summary));
    assert!(!text(&summary).contains("from p ="), "{}", text(&summary));
    for imputer in &mut summary.groups[0].imputers {
        imputer.cells.truncate(1);
    }
    let text = text_of(&summary);
    assert!(
        text.starts_with("Nothing was lost: p = 1 is all that was played. The mean return is -"),
        "{text}"
    );
    summary.groups[0].imputers.clear();
    assert_eq!(findings(&summary), [""; 0]);
}

#[test]
fn few_policies_and_few_episodes_are_called_so() {
    let mut summary = one_group();
    let certainty = |summary: &Summary| findings(summary).pop().unwrap();
    for cell in summary.groups[0].imputers.iter_mut().flat_map(|imputer| &mut imputer.cells) {
        cell.seed_means.truncate(2);
    }
    assert!(certainty(&summary).ends_with(" (from two policies, a rough guess)."), "{}", certainty(&summary));
    for cell in summary.groups[0].imputers.iter_mut().flat_map(|imputer| &mut imputer.cells) {
        cell.seed_means.truncate(1);
        cell.seed_std = None;
    }
    let expected = "Intervals are over 20 episodes of one policy: they say nothing about policies from other training runs.";
    assert_eq!(certainty(&summary), expected);
    summary.settings.episodes = 19;
    assert!(certainty(&summary).ends_with(" With so few episodes they are too narrow."));
}

#[test]
fn oracles_and_imputers_of_some_policies_do_not_compete() {
    let mut summary = one_group();
    let rename = |summary: &mut Summary, name: String| summary.groups[0].imputers[0].imputer = name;
    rename(&mut summary, Truth::Own.oracle("maro"));
    assert!(text(&summary).starts_with("maro does best of 2 imputers"), "{}", text(&summary));
    rename(&mut summary, "value-aware".to_owned());
    summary.groups[0].imputers[0].cells.iter_mut().for_each(|cell| cell.seed_means.truncate(1));
    assert!(text(&summary).starts_with("maro does best of 2 imputers"), "{}", text(&summary));
}

#[test]
fn several_tasks_have_a_mean() {
    let (_, mut summary) = fixture::two_tasks();
    let at = summary.aggregates.iter().position(|of| of.condition.p() == Some(0.0)).unwrap();
    for (index, value) in [0.9, 0.7, 0.2].into_iter().enumerate() {
        summary.aggregates[at + index].mean = Interval { value, low: value - 0.05, high: value + 0.05 };
    }
    for (group, value) in [(0, 0.85), (1, 0.95)] {
        summary.groups[group].imputers[0].cells[2].score = Some(Interval { value, low: value, high: value });
    }
    assert_eq!(
        findings(&summary),
        [
            "In the mean over 2 tasks (mappo) value-aware does best of 3 imputers: at p = 0 the team keeps 90.0 % of the \
             score (95 % interval 85.0 to 95.0).",
            "Task by task its score is between 0.85 (hear-see) and 0.95 (spread-xy-2).",
            "This interval is over policies, 5 in all: with so few policies it is rough.",
        ]
    );
    let mean = &mut summary.aggregates[at].mean;
    (mean.low, mean.high) = (mean.value, mean.value);
    assert!(text(&summary).ends_with("There is no interval over policies, as each task has one."));
    // Without scores in common there is a sentence for each group.
    summary.aggregates.clear();
    let each = findings(&summary);
    assert_eq!(each.len(), 2);
    assert!(
        each[1].starts_with("spread-xy-2: mappo: value-aware does best of 3 imputers: at p = 0"),
        "{each:?}"
    );
}
