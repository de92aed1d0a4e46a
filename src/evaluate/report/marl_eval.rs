//! `marl-eval.json`: the returns as InstaDeep's marl-eval reads them, after Gorsane et al. (2022).

use serde_json::{Map, Value, json};

use super::words;
use crate::base::stats::mean;
use crate::evaluate::{Evaluation, Summary};

/// JSON text: environment, task, algorithm, run.
///
/// That tool compares the algorithms of an environment over its tasks. Here an environment is a label and a
/// condition, and its algorithms are the imputers, so what it compares is what
/// [`Aggregate`](crate::evaluate::Aggregate) aggregates.
pub fn marl_eval(evaluation: &Evaluation, summary: &Summary) -> String {
    let mut environments = Value::Object(Map::new());
    for cell in &evaluation.cells {
        let groups = summary.groups.iter();
        let found = groups.filter_map(|group| {
            Some((group, group.contenders.iter().position(|contender| *contender == cell.contender)?))
        });
        for (group, run) in found {
            let environment = format!("{} {}", group.label, words::condition(&cell.condition));
            // It takes no commas in the names of algorithms, and keeps nothing but the mean of a step.
            let algorithm = cell.imputer.replace(',', ";");
            let returns = &cell.outcome.returns;
            environments[environment][&group.task][algorithm][format!("run_{}", run + 1)] = json!({
                "step_1": {
                    "step_count": evaluation.contenders[cell.contender].steps,
                    "return": [mean(returns)],
                },
                "absolute_metrics": { "return": returns },
            });
        }
    }
    format!("{environments}\n")
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;

    #[test]
    fn a_run_is_found_by_its_condition_task_and_imputer() {
        let (mut evaluation, summary) = fixture::two_tasks();
        evaluation.cells[0].imputer = "a,b".to_owned();
        let read: Value = serde_json::from_str(&marl_eval(&evaluation, &summary)).unwrap();
        let environments = read.as_object().unwrap();
        assert_eq!(environments.len(), 4);
        let run = &read["mappo p = 0.2"]["hear-see"]["value-aware"]["run_3"];
        let played = evaluation.cells.iter().find(|cell| {
            cell.contender == 2 && cell.condition.p() == Some(0.2) && cell.imputer == "value-aware"
        });
        assert_eq!(run["absolute_metrics"]["return"], json!(played.unwrap().outcome.returns));
        assert_eq!(run["step_1"]["step_count"], 5_000_000);
        assert_eq!(run["step_1"]["return"].as_array().unwrap().len(), 1);
        assert!(read["mappo dynamic"]["spread-xy-2"]["hold"]["run_2"].is_object());
        assert!(read["mappo p = 1"]["hear-see"]["a;b"].is_object(), "commas are not for names");
    }
}
