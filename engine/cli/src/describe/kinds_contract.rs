//! The contract of every kind of table and figure: it describes itself, refuses unknown names, and can be built.

use crate::describe::{FitOptions, find, text};
use analysis::{
    results::{Results, SearchResult},
    search::Progress,
};
use contract::{
    Phase,
    drawing::{Drawings, Edge, Graph, Image, Node},
    trial::Trial,
    trial_result::TrialResult,
};
use document::{diagnostic::Diagnostic, schema_check::View};
use presentation::{
    figure::{self, Context},
    kinds::Kind,
    request::Kinds,
    table,
};
use serde_json::json;
use std::{collections::BTreeMap, path::Path, sync::Arc};
use study::{Options, Study};
use testing::toys::toys;

const HEAD: &str = "study: walk
environments:
  short: { corridor: { cells: 5 } }
  long: { corridor: { cells: 20 } }
  pair: { corridor: { walkers: 2 } }
agents: { rule: { walker: {} }, other: { walker: { direction: right } }, learner: { q_learning: {} } }
exclude: [{ environment: pair, agent: learner }]
protocol: { train_evaluate: { steps: 1000 } }
seeds: 3
cross_play:
  tag: { environment: pair, roles: { chaser: [walker_0], runner: [walker_1] }, agents: [rule, other] }
";

const SEARCH: &str = "tune: { learner_rates: { over: { learner.discount: { uniform: { low: 0.9, high: 0.999 } } }, metric: return, \
                      environment: short, settings: 12 } }\n";

/// Every kind with the section that it belongs to.
fn all() -> impl Iterator<Item = (&'static str, Kind)> {
    let kinds = Kinds::default();
    let tables = kinds.of_tables().into_iter().map(|kind| ("tables", kind));
    tables.chain(kinds.of_figures().into_iter().map(|kind| ("figures", kind)))
}

fn load(section: &str, kind: &Kind, options: &str) -> Result<Study, Vec<Diagnostic>> {
    let sweep = if options.contains("discount") {
        "sweep: { learner.discount: { grid: [0.9, 0.99] } }\n"
    } else {
        ""
    };
    let search = if options.contains("search:") { SEARCH } else { "" };
    let text = format!(
        "{HEAD}{search}{sweep}{section}: {{ it: {{ {}: {options} }} }}\n",
        kind.name
    );
    let points = (0..12).map(|place| vec![json!(f64::from(900 + 7 * place) / 1000.0)]);
    let progress = Progress {
        points: points.collect(),
        stops: vec![None; 12],
        parents: Vec::new(),
        chosen: Some(1),
    };
    let options = Options {
        searches: BTreeMap::from([("learner_rates".into(), progress)]),
        ..Options::default()
    };
    study::load_text(&text, "study.yaml", Path::new(""), &toys(), &options)
}

/// Keys under which kinds name what trials record. A kind without any shows artifacts or a search.
const OF_METRICS: [&str; 7] = ["channels", "metric", "of", "surface", "value", "values", "x"];

/// The example of a kind, with the first of `words` that occurs in it replaced by an unknown name; `None` if none
/// occurs.
fn with_unknown(kind: &Kind, words: &[&str]) -> Option<String> {
    let example = (kind.example)();
    let word = words.iter().find(|word| example.contains(*word))?;
    Some(example.replace(word, "nonsense"))
}

/// Values that differ by agent and seed, during learning, at the end and in a trace of a full grid.
fn made_up(trial: Arc<Trial>) -> TrialResult {
    // Settings differ, so that kinds about the effect of settings have something to show.
    let of_setting = trial.cell.point.words().bytes().map(f64::from).sum::<f64>() / 1000.0;
    let value = 10.0 * trial.cell.agent.len() as f64 + trial.key.seed as f64 + of_setting;
    let mut rows: testing::synthetic::Rows = Vec::new();
    for (phase, step) in [(Phase::Evaluate, 0), (Phase::Evaluate, 500), (Phase::Final, 1000)] {
        rows.extend(["return", "length"].map(|metric| (phase, step, 0, metric, value + step as f64)));
    }
    for (step, [x, y]) in (0..).zip([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]) {
        rows.extend(
            [("height_1", x), ("height_2", y)].map(|(channel, at)| (Phase::Trace, step, 0, channel, at)),
        );
    }
    TrialResult {
        trial,
        ..testing::synthetic::trial("", "", "", 0, &rows)
    }
}

/// Two boxes with an arrow, and a grey image.
fn drawn() -> Drawings {
    let node = |label: &str, column| Node {
        label: label.into(),
        column,
        ..Node::default()
    };
    let edge = Edge {
        to: 1,
        ..Edge::default()
    };
    Drawings {
        graph: Some(Graph {
            nodes: vec![node("a", 0), node("b", 1)],
            edges: vec![edge],
            ..Graph::default()
        }),
        images: vec![Image {
            width: 2,
            height: 2,
            pixels: vec![128; 12],
        }],
        problem: None,
    }
}

#[test]
fn names_are_used_once_and_say_what_is_shown() {
    let names: std::collections::BTreeSet<&str> = all().map(|(_, kind)| kind.name).collect();
    assert_eq!(names.len(), all().count());
    assert!(all().all(|(_, kind)| kind.about.len() > 20 && kind.about.ends_with('.')));
}

#[test]
fn every_kind_is_described_with_the_keys_of_its_schema() {
    let schema = study::json_schema(&toys());
    for (section, kind) in all() {
        let path = [section, "any name", kind.name].map(String::from);
        let property = View::new(&schema, &schema).descend(&path).unwrap();
        assert_eq!(property.get("description").unwrap(), kind.about);
        let inner = property.as_struct().unwrap();
        let text = text::write(&find(&toys(), kind.name, FitOptions::default()).unwrap());
        // Long sentences are broken into lines.
        let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(
            words.contains(kind.about) && !inner.property_names().is_empty(),
            "{text}"
        );
        for key in inner.property_names() {
            assert!(
                text.contains(&format!("\n  {key}: ")),
                "`{key}` is not described:\n{text}"
            );
        }
    }
}

#[test]
fn every_kind_refuses_what_it_does_not_know_where_it_stands() {
    let schema = study::json_schema(&toys());
    for (section, kind) in all() {
        let unknown_key = (kind.example)().replacen('{', "{ nonsense: 1,", 1);
        let metric = with_unknown(&kind, &["return", "height"]);
        let agent = with_unknown(&kind, &["learner", "runner"]);
        assert!(agent.is_some(), "{} names no agent", kind.name);
        let path = [section, "any name", kind.name].map(String::from);
        let options = View::new(&schema, &schema)
            .descend(&path)
            .unwrap()
            .as_struct()
            .unwrap();
        let mut keys = options.property_names().into_iter();
        let names_metrics = keys.any(|key| OF_METRICS.contains(&key));
        assert!(
            metric.is_some() || !names_metrics,
            "the example of {} names no metric",
            kind.name
        );
        for options in [Some(unknown_key), metric, agent].into_iter().flatten() {
            let Err(found) = load(section, &kind, &options) else {
                panic!("{}: {options} passes", kind.name)
            };
            let is_place = |it: &Diagnostic| {
                it.message.contains("nonsense")
                    && it.path.starts_with(&format!("{section}.it.{}", kind.name))
                    && it.place.text.contains("nonsense")
            };
            assert!(found.iter().any(is_place), "{}: {options}: {found:?}", kind.name);
        }
    }
}

#[test]
fn every_kind_builds_what_its_example_asks_for() {
    for (section, kind) in all() {
        let study = load(section, &kind, (kind.example)());
        let study = study.unwrap_or_else(|found| panic!("{}", document::diagnostic::render(&found, false)));
        let trials = study.plan().trials;
        let drawings = trials.iter().map(|trial| (trial.id.clone(), drawn())).collect();
        let trials: Vec<TrialResult> = trials.into_iter().map(made_up).collect();
        let searches = study.searches.iter();
        let searches = searches.map(|(search, it)| SearchResult::of(search, it, &trials));
        let results = Results {
            drawings,
            searches: searches.collect(),
            ..Results::of(trials)
        };
        for (_, spec) in &study.tables {
            let grid = table::build(spec, &results).unwrap();
            assert!(
                grid.cells.iter().flatten().any(|cell| cell.estimate.is_some()),
                "{} is empty",
                kind.name
            );
        }
        for (_, spec) in &study.figures {
            let context = Context {
                results: &results,
                agents: &study.agents,
                units: &BTreeMap::new(),
                better: &BTreeMap::new(),
            };
            let chart = figure::build(spec, context).unwrap();
            assert!(
                chart.panels.iter().any(|panel| !panel.series.is_empty()),
                "{} is empty",
                kind.name
            );
            assert!(figure::svg(&chart).unwrap().contains("<svg"));
        }
        // A study with a search gets tables and figures that it does not name.
        assert!(study.tables.len() + study.figures.len() > study.searches.len());
    }
}
