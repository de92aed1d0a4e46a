//! `results.json`: the summary, for programs.

use serde::Serialize;

use super::Provenance;
use crate::evaluate::Summary;

/// The whole file.
#[derive(Serialize)]
struct Results<'a> {
    format: &'static str,
    version: u32,
    #[serde(flatten)]
    provenance: &'a Provenance,
    #[serde(flatten)]
    summary: &'a Summary,
}

/// JSON text. Numbers that are not finite are null.
pub fn results(summary: &Summary, provenance: &Provenance) -> String {
    let results = Results { format: "vamaro-swarm evaluation", version: 1, provenance, summary };
    serde_json::to_string_pretty(&results).expect("keys are text") + "\n"
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::super::fixture;
    use super::*;

    #[test]
    fn it_holds_what_was_measured_and_how() {
        let (_, mut summary) = fixture::two_tasks();
        summary.groups[0].imputers[1].cells[1].mean.low = f64::NAN;
        let results: Value = serde_json::from_str(&results(&summary, &fixture::provenance())).unwrap();
        assert_eq!((&results["format"], &results["version"]), (&json!("vamaro-swarm evaluation"), &json!(1)));
        assert_eq!(results["program"], "vamaro-swarm 0.1.0");
        assert_eq!(results["settings"]["episodes"], 20);
        assert_eq!(results["contenders"].as_array().unwrap().len(), 5);
        let group = &results["groups"][0];
        assert_eq!((&group["task"], &group["contenders"]), (&json!("hear-see"), &json!([0, 1, 2])));
        let cell = &group["imputers"][1]["cells"][1];
        assert_eq!(cell["condition"], json!({"level": 0.2}));
        assert_eq!(cell["mean"]["value"], summary.groups[0].imputers[1].cells[1].mean.value);
        assert!(cell["mean"]["low"].is_null());
        assert_eq!(group["imputers"][0]["cells"][3]["condition"], "dynamic");
        assert!(results["aggregates"][0]["iqm"]["high"].is_f64());
    }
}
