//! What the paper claims of its imputer, of our policies.

use super::grouping::distinct;
use super::summary::{CellSummary, Claim, Claims, Group, Summary};
use super::weighted::relative;
use crate::base::stats::mean;

/// What claims are about: one imputer against another, averaged over tasks and levels.
#[derive(Clone, Debug, PartialEq)]
pub struct Scope {
    /// Ids of the tasks.
    pub tasks: Vec<String>,
    /// Levels p.
    pub levels: Vec<f64>,
    /// The imputer.
    pub imputer: String,
    /// The one it is compared with.
    pub baseline: String,
}

impl Default for Scope {
    /// That of the paper.
    fn default() -> Scope {
        Scope {
            tasks: ["hear-see", "spread-xy-4", "spread-xy-2"].map(str::to_owned).to_vec(),
            levels: vec![0.0, 0.2],
            imputer: "value-aware".to_owned(),
            baseline: "maro".to_owned(),
        }
    }
}

impl Claims {
    /// What a summary says, label by label; nothing of a label that does not have all cells.
    pub fn of(summary: &Summary, scope: &Scope) -> Vec<Claims> {
        let labels = distinct(summary.groups.iter().map(|group| &group.label[..]));
        labels.into_iter().filter_map(|label| Claims::of_label(summary, label, scope)).collect()
    }

    fn of_label(summary: &Summary, label: &str, scope: &Scope) -> Option<Claims> {
        let claim = |task: &str, p: f64| {
            let group = summary.groups.iter().find(|group| group.label == label && group.task == task)?;
            let own = cell(group, &scope.imputer, p)?;
            let others = cell(group, &scope.baseline, p)?;
            // Means of other policies are no comparison.
            let all = |cell: &CellSummary| cell.seed_means.len() == group.contenders.len();
            if !all(own) || !all(others) {
                return None;
            }
            let reduction = |(own, others): (f64, f64)| (others > 0.0).then(|| 1.0 - own / others);
            Some(Claim {
                task: task.to_owned(),
                p,
                improvement: relative(own.mean.value - others.mean.value, others.mean.value),
                std_reduction: own.seed_std.zip(others.seed_std).and_then(reduction),
            })
        };
        let of_task = |task| scope.levels.iter().map(move |p| claim(task, *p));
        let cells = scope.tasks.iter().flat_map(|task| of_task(&task[..])).collect::<Option<Vec<Claim>>>()?;
        let improvements: Vec<f64> = cells.iter().map(|cell| cell.improvement).collect();
        let reductions: Option<Vec<f64>> = cells.iter().map(|cell| cell.std_reduction).collect();
        (!cells.is_empty()).then(|| Claims {
            label: label.to_owned(),
            imputer: scope.imputer.clone(),
            baseline: scope.baseline.clone(),
            improvement: mean(&improvements),
            std_reduction: reductions.map(|reductions| mean(&reductions)),
            cells,
        })
    }
}

fn cell<'a>(group: &'a Group, imputer: &str, p: f64) -> Option<&'a CellSummary> {
    let imputer = group.imputers.iter().find(|summary| summary.imputer == imputer)?;
    imputer.cells.iter().find(|cell| cell.condition.p() == Some(p))
}

#[cfg(test)]
mod tests {
    use super::super::condition::Condition;
    use super::super::evaluation::Settings;
    use super::super::summary::{ImputerSummary, Interval};
    use super::*;

    /// Mean and standard deviation at p = 0 and 0.2.
    type Levels = [(f64, f64); 2];

    /// Table II of the paper: MARO and Value-Aware.
    const TABLE: [(&str, [Levels; 2]); 5] = [
        ("hear-see", [[(-102.6, 26.9), (-35.9, 4.4)], [(-37.5, 2.9), (-26.3, 1.2)]]),
        ("spread-xy-4", [[(-1264.4, 19.9), (-981.7, 17.6)], [(-1133.6, 9.3), (-937.0, 15.8)]]),
        ("spread-xy-2", [[(-213.8, 20.6), (-171.4, 6.5)], [(-188.9, 2.6), (-163.5, 1.6)]]),
        ("spread-blindfold", [[(-422.0, 3.9), (-421.5, 5.1)], [(-424.6, 2.9), (-423.5, 4.5)]]),
        ("speaker-listener", [[(-27.0, 3.5), (-26.6, 1.1)], [(-27.4, 0.9), (-29.0, 0.2)]]),
    ];

    fn summary() -> Summary {
        let cell = |p: f64, (value, std): (f64, f64)| CellSummary {
            condition: Condition::level(p).unwrap(),
            seed_means: vec![value; 3],
            seed_std: Some(std),
            mean: Interval { value, ..Interval::default() },
            iqm: Interval::default(),
            score: None,
            comparison: None,
        };
        let imputer = |name: &str, cells: Levels| ImputerSummary {
            imputer: name.to_owned(),
            cells: vec![cell(0.0, cells[0]), cell(0.2, cells[1])],
            return_area: None,
            score_area: None,
            p_for_90: None,
            errors: Vec::new(),
        };
        let groups = TABLE.map(|(task, [maro, value_aware])| Group {
            task: task.to_owned(),
            label: "mappo".to_owned(),
            contenders: vec![0, 1, 2],
            random: Interval::default(),
            baseline: Some("maro".to_owned()),
            imputers: vec![imputer("maro", maro), imputer("value-aware", value_aware)],
            losses: Vec::new(),
            profiles: Vec::new(),
        });
        let settings = Settings::default();
        Summary {
            settings,
            axes: Vec::new(),
            contenders: Vec::new(),
            groups: groups.into(),
            aggregates: Vec::new(),
            claims: Vec::new(),
        }
    }

    #[test]
    fn the_papers_table_makes_the_papers_claims() {
        let [claims] = &Claims::of(&summary(), &Scope::default())[..] else { panic!("one label") };
        let cells: Vec<_> = claims.cells.iter().map(|cell| (&cell.task[..], cell.p)).collect();
        let tasks = ["hear-see", "spread-xy-4", "spread-xy-2"];
        assert_eq!(cells, tasks.map(|task| [(task, 0.0), (task, 0.2)]).concat());
        // 65.1 / 102.6, 9.6 / 35.9, 130.8 / 1264.4, 44.7 / 981.7, 24.9 / 213.8, 7.9 / 171.4.
        let improvements = [0.6345, 0.2674, 0.1034, 0.0455, 0.1165, 0.0461];
        // 1 - 2.9 / 26.9 and so on.
        let reductions = [0.8922, 0.7273, 0.5327, 0.1023, 0.8738, 0.7538];
        for ((cell, improvement), reduction) in claims.cells.iter().zip(improvements).zip(reductions) {
            assert!((cell.improvement - improvement).abs() < 5e-5, "{cell:?}");
            assert!((cell.std_reduction.unwrap() - reduction).abs() < 5e-5, "{cell:?}");
        }
        // "more than 20 %" and "64.7 %".
        assert!((claims.improvement - 0.2022).abs() < 5e-5, "{}", claims.improvement);
        assert!((claims.std_reduction.unwrap() - 0.647).abs() < 5e-5, "{:?}", claims.std_reduction);
    }

    #[test]
    fn other_scopes_and_missing_cells() {
        let scope = |tasks: &[&str], levels: &[f64]| Scope {
            tasks: tasks.iter().map(|task| task.to_string()).collect(),
            levels: levels.to_vec(),
            ..Scope::default()
        };
        let mut summary = summary();
        let claims = Claims::of(&summary, &scope(&["speaker-listener"], &[0.2]));
        // (-29.0 + 26.6) / 26.6 is worse, though its spread is smaller.
        assert!((claims[0].improvement + 2.4 / 26.6).abs() < 1e-12);
        assert_eq!(Claims::of(&summary, &scope(&["spread-xy-2"], &[0.0, 0.4])), []);
        assert_eq!(Claims::of(&summary, &scope(&["spread-xy-3"], &[0.0])), []);
        assert_eq!(Claims::of(&summary, &scope(&[], &[])), []);
        summary.groups[0].imputers[0].cells[0].seed_std = None;
        let claims = Claims::of(&summary, &Scope::default());
        assert_eq!(claims[0].std_reduction, None);
        assert!(claims[0].improvement > 0.2);
        summary.groups[0].imputers.pop();
        assert_eq!(Claims::of(&summary, &Scope::default()), []);
    }
}
