//! `report.html`: everything on one page, without scripts. Its only links lead to replays.

use maud::{Markup, html};

use super::group::{figure, group};
use super::table::{Cell, Table, on_demand};
use super::{Provenance, figures, findings, notes, words};
use crate::base::page;
use crate::evaluate::grouping::distinct;
use crate::evaluate::{Aggregate, Claims, Condition, Replay, Settings, Summary};

/// The page, with links to these replays.
pub fn page(summary: &Summary, replays: &[&Replay], provenance: &Provenance) -> String {
    let tasks = distinct(summary.groups.iter().map(|group| &group.task[..]));
    let title = format!("Robustness to lossy links: {}", tasks.join(", "));
    let groups = summary.groups.iter().enumerate();
    let groups = groups.map(|(index, of)| {
        let replays: Vec<&Replay> = replays.iter().copied().filter(|replay| replay.group == index).collect();
        (format!("group-{index}"), words::group(of), group(summary, of, &replays))
    });
    let rest = [
        (!summary.aggregates.is_empty()).then(|| ("aggregates", "Over tasks", aggregates(summary))),
        (!summary.claims.is_empty()).then(|| ("claims", "The paper's claims", claims(summary))),
        Some(("policies", "Policies", policies(summary))),
        Some(("notes", "What the numbers mean", definitions(summary))),
        Some(("made", "How it was played", made(summary, provenance))),
    ];
    let rest = rest.into_iter().flatten();
    let rest = rest.map(|(id, heading, content)| (id.to_owned(), heading.to_owned(), content));
    let sections: Vec<(String, String, Markup)> = groups.chain(rest).collect();
    let body = html! {
        main {
            h1 { (title) }
            (opening(summary))
            nav aria-label="Contents" {
                ul { @for (id, heading, _) in &sections { li { a href={ "#" (id) } { (heading) } } } }
            }
            @for (id, heading, content) in &sections { h2 id=(id) { (heading) } (content) }
        }
    };
    page::page(&title, include_str!("page.css"), &body)
}

/// What was found, then the figure.
fn opening(summary: &Summary) -> Markup {
    let robustness = figures::robustness(&summary.groups, &words::imputers(summary));
    html! {
        @for finding in findings::findings(summary) { p.finding { (finding) } }
        (figure(&robustness))
        @if summary.groups.iter().any(words::has_scores) {
            p.caption { "Score: 0 is what uniformly random actions return, 1 what the same policies return at p = 1, \
                where everything is delivered." }
        }
    }
}

fn aggregates(summary: &Summary) -> Markup {
    let labels = distinct(summary.aggregates.iter().map(|aggregate| &aggregate.label[..]));
    html! {
        p {
            "Scores of all policies of several tasks, after Agarwal et al. (2021). Here intervals resample policies \
            within each task, not episodes: with three policies a task they are rough, too narrow rather than too wide, \
            and a task with one policy does not vary at all."
        }
        @for label in labels {
            @let of_label: Vec<&Aggregate> = summary.aggregates.iter().filter(|of| of.label == label).collect();
            (over_tasks(label, &of_label))
        }
    }
}

/// A row per imputer, a column per condition.
fn over_tasks(label: &str, aggregates: &[&Aggregate]) -> Markup {
    let conditions = distinct(aggregates.iter().map(|aggregate| &aggregate.condition));
    let imputers = distinct(aggregates.iter().map(|aggregate| &aggregate.imputer[..]));
    let table = |caption: String, value: &dyn Fn(&Aggregate) -> String| {
        let row = |imputer: &&str| {
            let of = |condition: &Condition| {
                aggregates.iter().find(|of| of.imputer == *imputer && of.condition == *condition)
            };
            let any = conditions.iter().copied().find_map(of).expect("the imputer is of these aggregates");
            let counts = [any.tasks.len(), any.runs].map(|n| Cell::of(n.to_string()));
            let cell =
                |condition: &&Condition| of(condition).map_or_else(Cell::none, |of| Cell::of(value(of)));
            ((*imputer).to_owned(), counts.into_iter().chain(conditions.iter().map(cell)).collect())
        };
        let columns = ["imputer", "tasks", "policies"].map(str::to_owned).into_iter();
        Table {
            caption,
            columns: columns.chain(conditions.iter().map(|condition| words::condition(condition))).collect(),
            rows: imputers.iter().map(row).collect(),
        }
    };
    let tasks = distinct(aggregates.iter().flat_map(|aggregate| &aggregate.tasks));
    let tasks = tasks.into_iter().cloned().collect::<Vec<_>>().join(", ");
    let caption = format!("{label}: interquartile mean of the scores. Tasks: {tasks}.");
    let more = [
        table("Its 95 % interval.".to_owned(), &|of| words::ends(&of.iqm, 2)),
        table("Mean over tasks of the mean score.".to_owned(), &|of| words::number(of.mean.value, 2)),
        table("Its 95 % interval.".to_owned(), &|of| words::ends(&of.mean, 2)),
    ];
    html! {
        (table(caption, &|of| words::number(of.iqm.value, 2)).markup())
        (on_demand("Intervals, and means over tasks", &more))
    }
}

/// Cell by cell and in the mean.
fn claims(summary: &Summary) -> Markup {
    let row = |heading: String, improvement, std_reduction| {
        (heading, words::improvement(improvement, std_reduction).map(Cell::of).to_vec())
    };
    let table = |claims: &Claims| {
        let cells = claims
            .cells
            .iter()
            .map(|cell| row(format!("{}, p = {}", cell.task, cell.p), cell.improvement, cell.std_reduction));
        let mean = row("mean".to_owned(), claims.improvement, claims.std_reduction);
        Table {
            caption: words::claim(claims),
            columns: ["cell", "mean return better by", "std smaller by"].map(str::to_owned).to_vec(),
            rows: cells.chain([mean]).collect(),
        }
    };
    html! {
        p {
            "A standard deviation over a few policies is a guess: so is by how much one is smaller than another. Of each             task there are as many policies as its section says."
        }
        @for claims in &summary.claims { (table(claims).markup()) }
    }
}

fn policies(summary: &Summary) -> Markup {
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
    let table = Table {
        caption: "As named on the command line; the fingerprint is of the weights.".to_owned(),
        columns: columns.map(str::to_owned).to_vec(),
        rows: rows.collect(),
    };
    table.markup()
}

fn definitions(summary: &Summary) -> Markup {
    let imputers = words::imputers(summary);
    let played = notes::IMPUTERS.iter().filter(|(name, _)| imputers.contains(name));
    let texts = |(term, meaning): &(&str, &str)| ((*term).to_owned(), (*meaning).to_owned());
    let conditions = summary.groups.iter().flat_map(words::conditions);
    // Levels and modes are among the statistics.
    let links = conditions.filter(|condition| condition.p().is_none());
    let models = links.flat_map(|condition| condition.links().models());
    let models = models.filter(|model| !model.parameters.is_empty());
    let models = distinct(models.map(|model| (model.signature(), model.about.to_owned())));
    let oracle = words::has_oracles(&imputers).then_some(&notes::ORACLE);
    html! {
        (list(notes::STATISTICS.iter().map(texts).chain(models)))
        h3 { "Imputers" }
        (list(played.chain(oracle).map(texts)))
    }
}

fn made(summary: &Summary, provenance: &Provenance) -> Markup {
    let Settings { episodes, seed, greedy, comm_at_t0, physics, relay } = summary.settings;
    let Provenance { program, command, cpu, date } = provenance;
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
        (
            "messages",
            if relay { "also carry the newest observations that their senders hold of others" } else { "" }
                .to_owned(),
        ),
        ("program", program.clone()),
        ("CPU", cpu.clone()),
        ("date", date.clone()),
    ];
    let said = settings.into_iter().filter(|(_, value)| !value.is_empty());
    html! {
        p {
            "Frozen policies play while the links between their agents lose observations, and an imputer stands in for \
            what is lost. All policies of a task were played from the same initial states with the same draws of actions \
            and links, whatever the condition and the imputer, so differences are paired."
        }
        (list(said.map(|(term, value)| (term.to_owned(), value))))
        pre { code { (command) } }
        p {
            "Every random draw is determined by the seed and its purpose, so the same command gives bit-identical numbers \
            on the same CPU feature set, whatever the number of threads. These numbers and more are in results.json, \
            summary.csv and errors.csv beside this page, and every episode is in episodes.csv."
        }
    }
}

/// Terms with what they mean.
fn list(terms: impl IntoIterator<Item = (String, String)>) -> Markup {
    html! { dl { @for (term, meaning) in terms { dt { (term) } dd { (meaning) } } } }
}
#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;

    #[test]
    fn it_needs_nothing_from_elsewhere() {
        let (_, summary) = fixture::two_tasks();
        let page = page(&summary, &[], &fixture::provenance());
        assert!(page.starts_with("<!DOCTYPE html>") && page.ends_with("</html>\n"));
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
        let page = page(&summary, &[], &fixture::provenance());
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
        // One above all, and four of each of two tasks.
        assert_eq!(page.matches("<figure>").count(), 9);
        assert!(page.contains(">Over tasks</h2>") && page.contains("<td>2</td><td>5</td>"));
        assert!(page.contains("vamaro-swarm evaluate runs/* --report report"));
        for tag in ["table", "figure", "div", "dl", "tr", "td", "th", "nav", "h2", "h3", "p", "details"] {
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
            let page = page(&summary, &[], &fixture::provenance());
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
        let page = page(&summary, &[], &provenance);
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
        let page = page(&summary, &[], &fixture::provenance());
        for absent in ["Against", "What was imputed", "Over tasks", "NaN"] {
            assert!(!page.contains(absent), "{absent}");
        }
        assert_eq!(page.matches("<figure>").count(), 1);
    }

    #[test]
    fn it_opens_with_what_was_found_and_the_figure() {
        let (_, summary) = fixture::two_tasks();
        let page = page(&summary, &[], &fixture::provenance());
        let finding = page.find("<p class=\"finding\">In the mean over 2 tasks").unwrap();
        let figure = page.find("<figure>").unwrap();
        assert!(finding < figure && figure < page.find("<table>").unwrap());
        assert!(figure < page.find("<h2").unwrap());
    }
}
