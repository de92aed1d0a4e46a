//! `report.html`: everything on one page, without links or scripts.

use super::html::{Cell, Html, Table};
use super::{Provenance, group, notes, words};
use crate::evaluate::grouping::distinct;
use crate::evaluate::{Aggregate, Claims, Condition, Settings, Summary};
use crate::plot::escape;

/// The page.
pub fn page(summary: &Summary, provenance: &Provenance) -> String {
    let tasks = distinct(summary.groups.iter().map(|group| &group.task[..]));
    let title = format!("Robustness to lossy links: {}", tasks.join(", "));
    let mut html = Html::default();
    html.raw("<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">");
    html.raw("<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">");
    html.element("title", &title);
    html.raw(&format!("<style>\n{}</style>\n</head>\n<body>\n<main>", include_str!("page.css")));
    html.element("h1", &title);
    introduction(&mut html, summary, provenance);
    for (index, group) in summary.groups.iter().enumerate() {
        section(&mut html, &format!("group-{index}"), &words::group(group));
        group::group(&mut html, summary, group);
    }
    if !summary.aggregates.is_empty() {
        section(&mut html, "aggregates", "Over tasks");
        aggregates(&mut html, summary);
    }
    if !summary.claims.is_empty() {
        section(&mut html, "claims", "The paper's claims");
        summary.claims.iter().for_each(|claims| html.table(&claimed(claims)));
    }
    section(&mut html, "policies", "Policies");
    policies(&mut html, summary);
    section(&mut html, "notes", "What the numbers mean");
    definitions(&mut html, summary);
    section(&mut html, "made", "How it was made");
    made(&mut html, provenance);
    html.raw("</main>\n</body>\n</html>");
    html.finish()
}

fn section(html: &mut Html, id: &str, heading: &str) {
    html.raw(&format!("<h2 id=\"{id}\">{}</h2>", escape(heading)));
}

fn introduction(html: &mut Html, summary: &Summary, provenance: &Provenance) {
    let Settings { episodes, seed, greedy, comm_at_t0, physics } = summary.settings;
    html.element(
        "p",
        "What frozen policies still bring in while the links between their agents lose observations, and an imputer \
         stands in for what is lost. All policies of a task were played from the same initial states with the same \
         draws of actions and links, whatever the condition and the imputer, so that differences are paired.",
    );
    let conditions = distinct(summary.groups.iter().flat_map(words::conditions));
    let conditions: Vec<String> = conditions.into_iter().map(words::condition).collect();
    let settings = [
        ("policies", words::policies(summary.contenders.len())),
        ("conditions", conditions.join(", ")),
        ("imputers", words::imputers(summary).join(", ")),
        ("episodes", format!("{episodes} of each policy, condition and imputer; seed {seed}")),
        ("actions", if greedy { "the most probable" } else { "sampled from the policy" }.to_owned()),
        (
            "at t = 0",
            if comm_at_t0 { "everything is delivered" } else { "links lose as they do later" }.to_owned(),
        ),
        ("physics", physics.to_string()),
        ("made", format!("{} by {}", provenance.date, provenance.program)),
    ];
    html.list(settings.map(|(term, value)| (term.to_owned(), value)));
    html.raw("<nav aria-label=\"Contents\"><ul>");
    let groups = summary.groups.iter().enumerate();
    let groups = groups.map(|(index, group)| (format!("group-{index}"), words::group(group)));
    let over_tasks = (!summary.aggregates.is_empty()).then_some(("aggregates", "Over tasks"));
    let rest = [("policies", "Policies"), ("notes", "What the numbers mean"), ("made", "How it was made")];
    let claims = (!summary.claims.is_empty()).then_some(("claims", "The paper's claims"));
    let rest =
        over_tasks.into_iter().chain(claims).chain(rest).map(|(id, text)| (id.to_owned(), text.to_owned()));
    for (id, text) in groups.chain(rest) {
        html.raw(&format!("<li><a href=\"#{id}\">{}</a></li>", escape(&text)));
    }
    html.raw("</ul></nav>");
}

fn aggregates(html: &mut Html, summary: &Summary) {
    html.element(
        "p",
        "Scores of all policies of several tasks, after Agarwal et al. (2021). Here intervals resample policies within \
         each task, not episodes: with three policies a task they are rough, too narrow rather than too wide, and a \
         task with one policy does not vary at all.",
    );
    let labels = distinct(summary.aggregates.iter().map(|aggregate| &aggregate.label[..]));
    for label in labels {
        let of_label: Vec<&Aggregate> =
            summary.aggregates.iter().filter(|aggregate| aggregate.label == label).collect();
        html.table(&over_tasks(label, &of_label));
    }
}

/// A row per imputer, a column per condition.
fn over_tasks(label: &str, aggregates: &[&Aggregate]) -> Table {
    let conditions = distinct(aggregates.iter().map(|aggregate| &aggregate.condition));
    let imputers = distinct(aggregates.iter().map(|aggregate| &aggregate.imputer[..]));
    let row = |imputer: &&str| {
        let cell = |condition: &&Condition| {
            let found = aggregates.iter().find(|a| a.imputer == *imputer && a.condition == **condition);
            let Some(aggregate) = found else { return Cell::of("-") };
            let Aggregate { mean, iqm, .. } = aggregate;
            let mean = [format!("mean {}", words::number(mean.value, 2)), words::ends(mean, 2)];
            let notes = std::iter::once(words::ends(iqm, 2)).chain(mean).collect();
            Cell { value: words::number(iqm.value, 2), notes, strong: false }
        };
        let of = aggregates.iter().find(|aggregate| aggregate.imputer == *imputer);
        let of = of.map(|a| Cell {
            notes: vec![format!("{} tasks", a.tasks.len())],
            ..Cell::of(a.runs.to_string())
        });
        let cells = of.into_iter().chain(conditions.iter().map(cell));
        ((*imputer).to_owned(), cells.collect())
    };
    let columns = ["imputer", "policies"].map(str::to_owned).into_iter();
    Table {
        caption: format!(
            "{label}: interquartile mean of the scores and its 95 % interval; below, the mean over tasks. Tasks: {}.",
            distinct(aggregates.iter().flat_map(|aggregate| &aggregate.tasks))
                .into_iter()
                .cloned()
                .collect::<Vec<_>>()
                .join(", ")
        ),
        columns: columns.chain(conditions.iter().map(|condition| words::condition(condition))).collect(),
        rows: imputers.iter().map(row).collect(),
    }
}

/// Cell by cell and in the mean.
fn claimed(claims: &Claims) -> Table {
    let row = |heading: String, improvement, std_reduction| {
        (heading, words::improvement(improvement, std_reduction).map(Cell::of).to_vec())
    };
    let cells = claims.cells.iter();
    let cells =
        cells.map(|cell| row(format!("{}, p = {}", cell.task, cell.p), cell.improvement, cell.std_reduction));
    let mean = row("mean".to_owned(), claims.improvement, claims.std_reduction);
    Table {
        caption: words::claim(claims),
        columns: ["cell", "mean return better by", "std smaller by"].map(str::to_owned).to_vec(),
        rows: cells.chain([mean]).collect(),
    }
}

fn policies(html: &mut Html, summary: &Summary) {
    let columns = ["policy", "task", "algorithm", "seed", "env steps", "predictors", "origin", "fingerprint"];
    let rows = summary.contenders.iter().map(|contender| {
        let cells = [
            contender.task.clone(),
            contender.algorithm.clone(),
            contender.seed.to_string(),
            contender.steps.to_string(),
            contender.predictors.join(", "),
            contender.origin.clone(),
            contender.fingerprint.clone(),
        ];
        (contender.name.clone(), cells.map(Cell::of).to_vec())
    });
    html.table(&Table {
        caption: "As named on the command line; the fingerprint is of the weights.".to_owned(),
        columns: columns.map(str::to_owned).to_vec(),
        rows: rows.collect(),
    });
}

fn definitions(html: &mut Html, summary: &Summary) {
    let imputers = words::imputers(summary);
    let played = notes::IMPUTERS.iter().filter(|(name, _)| imputers.contains(name));
    let texts = |(term, meaning): &(&str, &str)| ((*term).to_owned(), (*meaning).to_owned());
    let conditions = summary.groups.iter().flat_map(words::conditions);
    // Levels and modes are among the statistics.
    let links = conditions.filter(|condition| condition.p().is_none());
    let models = links.flat_map(|condition| condition.links().models());
    let models = models.filter(|model| !model.parameters.is_empty());
    let models = distinct(models.map(|model| (model.signature(), model.about.to_owned())));
    html.list(notes::STATISTICS.iter().map(texts).chain(models));
    html.element("h3", "Imputers");
    let oracle = words::has_oracles(&imputers).then_some(&notes::ORACLE);
    html.list(played.chain(oracle).map(texts));
}

fn made(html: &mut Html, provenance: &Provenance) {
    let Provenance { program, command, cpu, date } = provenance;
    html.raw(&format!("<pre><code>{}</code></pre>", escape(command)));
    html.list(
        [("program", program), ("CPU", cpu), ("date", date)]
            .map(|(term, value)| (term.to_owned(), value.clone())),
    );
    html.element(
        "p",
        "Every draw is found by the seed and what it is for, so the same command gives the same numbers in every bit \
         on the same CPU feature set, whatever the number of threads. These numbers and more are in results.json, \
         summary.csv and errors.csv beside this page, and every episode is in episodes.csv.",
    );
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;

    #[test]
    fn it_needs_nothing_from_elsewhere() {
        let (_, summary) = fixture::two_tasks();
        let page = page(&summary, &fixture::provenance());
        assert!(page.starts_with("<!doctype html>") && page.ends_with("</html>\n"));
        assert_eq!(page.matches("http").count(), page.matches("<svg xmlns=\"http").count());
        assert!(!page.contains("<script") && !page.contains("src=") && !page.contains("url("));
        let links = page.matches("href=\"").count();
        assert_eq!(links, page.matches("href=\"#").count());
        for (at, _) in page.match_indices("href=\"#") {
            let id = page[at + 7..].split('"').next().unwrap();
            assert!(page.contains(&format!(" id=\"{id}\"")), "{id}");
        }
    }

    #[test]
    fn everything_is_there() {
        let (_, summary) = fixture::two_tasks();
        let page = page(&summary, &fixture::provenance());
        for group in &summary.groups {
            assert!(page.contains(&format!(">{}</h2>", words::group(group))));
            for imputer in &group.imputers {
                assert!(page.contains(&format!("<th scope=\"row\">{}</th>", imputer.imputer)));
                for cell in &imputer.cells {
                    assert!(page.contains(&words::ends(&cell.mean, 1)));
                    let difference = cell.comparison.map(|comparison| words::ends(&comparison.difference, 1));
                    assert!(difference.is_none_or(|difference| page.contains(&difference)));
                }
            }
        }
        for contender in &summary.contenders {
            assert!(page.contains(&contender.name) && page.contains(&contender.fingerprint));
        }
        // Two tasks with three figures each.
        assert_eq!(page.matches("<figure>").count(), 6);
        assert!(page.contains(">Over tasks</h2>") && page.contains("<td>5<small>2 tasks</small>"));
        assert!(page.contains("vamaro-swarm evaluate runs/* --report report"));
        for tag in ["table", "figure", "div", "dl", "tr", "td", "th", "nav", "h2", "h3", "p"] {
            let count = |end: &str| page.matches(end).count();
            assert_eq!(
                count(&format!("<{tag}>")) + count(&format!("<{tag} ")),
                count(&format!("</{tag}>")),
                "{tag}"
            );
        }
    }

    #[test]
    fn links_are_explained_where_they_were_played() {
        let about = |conditions: &[&str]| {
            let conditions = fixture::conditions(conditions);
            let (_, summary) = fixture::played(&[("hear-see", -24.0, 1)], &conditions, &["hold"], 20);
            let page = page(&summary, &fixture::provenance());
            (page.contains("<dt>gilbert(p, r)</dt>"), page.contains("<dt>delay(ticks, jitter = 0)</dt>"))
        };
        assert_eq!(about(&["1", "0.2", "dynamic"]), (false, false));
        assert_eq!(about(&["1", "gilbert(0.1, 0.3)"]), (true, false));
        assert_eq!(about(&["1", "gilbert(0.1, 0.3) + delay(1, 1)"]), (true, true));
    }

    #[test]
    fn names_are_text() {
        let (_, mut summary) = fixture::two_tasks();
        let hostile = "<script>alert(\"x\")</script>&\n";
        summary.contenders[0].name = hostile.to_owned();
        summary.contenders[0].origin = hostile.to_owned();
        summary.groups[0].label = hostile.to_owned();
        summary.groups[0].baseline = Some(hostile.to_owned());
        summary.groups[0].imputers[0].imputer = hostile.to_owned();
        summary.aggregates[0].imputer = hostile.to_owned();
        let provenance = Provenance { command: hostile.to_owned(), ..fixture::provenance() };
        let page = page(&summary, &provenance);
        assert!(!page.contains("<script") && !page.contains("alert(\"x"));
        assert!(page.matches("&lt;script&gt;alert(&quot;x&quot;)&lt;/script&gt;&amp;").count() > 10);
    }

    #[test]
    fn what_was_not_played_is_left_out() {
        let (_, mut summary) = fixture::two_tasks();
        summary.groups.truncate(1);
        summary.aggregates.clear();
        let group = &mut summary.groups[0];
        for imputer in &mut group.imputers {
            imputer.errors.clear();
            imputer.cells.retain(|cell| cell.condition.p() == Some(1.0));
        }
        let page = page(&summary, &fixture::provenance());
        for absent in ["Against", "What was imputed", "Over tasks", "NaN"] {
            assert!(!page.contains(absent), "{absent}");
        }
        assert_eq!(page.matches("<figure>").count(), 1);
    }
}
