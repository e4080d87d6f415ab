//! A whole report of synthetic results.

use super::{
    Contents, Period, ProfileState, ProfileTrials, Provenance, StudyInfo, summary,
    synthetic::{AGENTS, study as recorded},
    write,
};
use crate::{
    Phase,
    figure::{Bars, FigureSpec, LearningCurve, Trajectory},
    recorder::Row,
    results::{EPISODE_LENGTH, Results, TrialResult, UPDATES},
    table::{Axis, Comparison, Published, TableSpec},
    trial::Part,
};
use serde_json::{Value, json};
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

/// The synthetic results with configs and with the lengths of measured episodes.
fn results() -> Results {
    let mut results = recorded();
    for result in &mut results.trials {
        let key = &mut result.trial.key;
        key.environment = Part::new("battery", 1, json!({"cells": if result.trial.environment == "four_cells" { 4 } else { 8 }}));
        key.agent = agent(&result.trial.agent);
        key.protocol = Part::new("train_evaluate", 1, json!({"steps": 60_000, "final_episodes": 4}));
        if result.is_ok() {
            record_lengths(result);
        }
    }
    results
}

fn agent(name: &str) -> Part {
    let (plugin, config) = match name {
        "dsac" => ("actor_critic", json!({"width": 256, "rate": 0.0003, "policy": "dirichlet"})),
        "ddpg" => ("actor_critic", json!({"width": 64, "rate": 0.0003, "policy": "softmax"})),
        other => (other, json!({})),
    };
    Part::new(plugin, 1, config)
}

fn record_lengths(result: &mut TrialResult) {
    let metric = u16::try_from(result.names.len()).unwrap();
    result.names.push(EPISODE_LENGTH.into());
    let measured = |row: &&Row| [Phase::Evaluate, Phase::Final].contains(&row.phase) && row.metric == 0;
    let lengths: Vec<Row> = result.rows.iter().filter(measured).map(|row| Row { metric, value: 600.0, ..*row }).collect();
    result.rows.extend(lengths);
}

fn defaults() -> BTreeMap<String, Value> {
    let configs = [
        ("agent actor_critic", json!({"width": 256, "rate": 0.001, "policy": "dirichlet"})),
        ("environment battery", json!({"cells": 4})),
        ("protocol train_evaluate", json!({"steps": 60_000, "final_episodes": 1000})),
    ];
    configs.map(|(name, config)| (name.to_owned(), config)).into()
}

fn profiles() -> Vec<ProfileState> {
    let state = |name: &str, this_report, [planned, ok, failed, own]: [usize; 4]| ProfileState {
        name: (!name.is_empty()).then(|| name.to_owned()),
        this_report,
        trials: Some(ProfileTrials { planned, ok, failed, own }),
    };
    vec![state("", false, [40, 20, 0, 0]), state("smoke", true, [40, 38, 1, 19]), state("paper", false, [200, 0, 0, 0])]
}

fn improvement() -> TableSpec {
    let published = [("four_cells", 15.2), ("eight_cells", 15.9)].map(|(row, value)| (row.to_owned(), Published::Value(value)));
    TableSpec {
        caption: "Average improvement of the working cycle over an equal split.".into(),
        improvement: Some(Comparison {
            rows: Axis::Environment,
            value: "cycle_length".into(),
            relative_to: Some("equal".into()),
            agents: vec!["dsac".into(), "ddpg".into()],
            labels: BTreeMap::from([("dsac".into(), "Dirichlet SAC".into()), ("ddpg".into(), "DDPG".into())]),
            ..Comparison::default()
        }),
        published: BTreeMap::from(published),
        notes: vec!["The text gives no spread.".into()],
        ..TableSpec::default()
    }
}

fn info() -> StudyInfo {
    let comparison = Comparison { value: "cycle_length".into(), ..Comparison::default() };
    let curve = LearningCurve { metric: "cycle_length".into(), ..LearningCurve::default() };
    let trajectory =
        Trajectory { channels: vec!["voltage".into(), "load".into()], threshold: Some(3.2), ..Trajectory::default() };
    let bars = Comparison { rows: Axis::Environment, value: "cycle_length".into(), ..Comparison::default() };
    StudyInfo {
        name: "table-3.2".into(),
        title: "Average improvement of the working cycle <with & without> learning".into(),
        source: "thesis, table 3.2".into(),
        departures: vec![
            "The load profile of `four_cells` is drawn from a uniform distribution, since the text gives none.".into(),
        ],
        tables: vec![
            ("table-3.2".into(), improvement()),
            ("lengths".into(), TableSpec { comparison: Some(comparison), ..TableSpec::default() }),
            ("empty".into(), TableSpec::default()),
        ],
        figures: vec![
            (
                "learning-curve".into(),
                FigureSpec {
                    caption: "Cycle length while learning.".into(),
                    learning_curve: Some(curve),
                    ..FigureSpec::default()
                },
            ),
            (
                "voltages".into(),
                FigureSpec { caption: "One discharge.".into(), trajectory: Some(trajectory), ..FigureSpec::default() },
            ),
            ("bars".into(), FigureSpec { bars: Some(Bars { of: bars }), ..FigureSpec::default() }),
        ],
        claims: vec![
            ("dsac.cycle_length > equal.cycle_length".into(), None),
            ("ddpg.cycle_length > dsac.cycle_length".into(), Some("four_cells".into())),
            ("dsac.cycle_length ~ bound.cycle_length in eight_cells".into(), None),
            ("dsac.cycle_length >".into(), None),
        ],
        agents: AGENTS.map(String::from).into(),
        environments: vec!["four_cells".into(), "eight_cells".into()],
        learners: BTreeSet::from(["dsac".into(), "ddpg".into()]),
        defaults: defaults(),
        profiles: profiles(),
        ended: Period::of([Some("2025-01-03T10:00:00Z".into()), Some("2025-01-04T08:30:00Z".into()), None].into_iter()),
        units: BTreeMap::from([("cycle_length".into(), "h".into()), ("voltage".into(), "V".into()), ("load".into(), "W".into())]),
    }
}

fn provenance() -> Provenance {
    Provenance {
        commit: Some("0123abc".into()),
        dirty: true,
        program: "regimen 0.1.0".into(),
        plugins: vec![("agent dsac".into(), 3), ("environment battery".into(), 2)],
        cpu: "x86-64 with AVX-512".into(),
        operating_system: "Linux".into(),
        seeds: (0..5).collect(),
        profile: Some("smoke".into()),
        date: None,
    }
}

fn written(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    let (info, results) = (info(), results());
    let contents = Contents::of(&info, &results);
    let paths = write(dir, &info, &results, &contents, &provenance()).unwrap();
    let all = paths.files.iter().chain([&paths.page, &paths.markdown]);
    all.map(|path| (path.strip_prefix(dir).unwrap().display().to_string(), fs::read(path).unwrap())).collect()
}

#[test]
fn a_report_is_the_same_bytes_each_time_and_loads_nothing() {
    let dirs = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    // `REPORT=DIR` keeps the report, to be looked at.
    let first = std::env::var_os("REPORT").map_or_else(|| dirs[0].path().to_owned(), Into::into);
    let (one, two) = (written(&first), written(dirs[1].path()));
    assert!(one == two);
    let names: Vec<&str> = one.keys().map(String::as_str).collect();
    insta::assert_snapshot!("files", names.join("\n"));
    insta::assert_snapshot!("report", String::from_utf8(one["report.md"].clone()).unwrap());
    insta::assert_snapshot!("seeds", String::from_utf8(one["tables/lengths-seeds.csv"].clone()).unwrap());
    let page = String::from_utf8(one["index.html"].clone()).unwrap();
    assert!(!page.contains("<with & without>") && page.contains("&lt;with &amp; without&gt;"));
    assert!(page.contains("used 3.1 GiB of 3.0 GiB &lt;allowed&gt;"));
    let outside = page.replace("http://www.w3.org/2000/svg", "");
    assert!(["http:", "https:", "<script", "<link", "url(", "@import", "src="].iter().all(|word| !outside.contains(word)));
    assert!(
        fs::read_dir(dirs[1].path().join("figures")).unwrap().all(|entry| !entry
            .unwrap()
            .file_name()
            .to_string_lossy()
            .starts_with('.'))
    );
}

#[test]
fn verdicts_and_claims_are_counted() {
    let contents = Contents::of(&info(), &results());
    assert_eq!(contents.verdicts().iter().map(|(_, n)| n).sum::<usize>(), 4);
    assert_eq!(contents.outcomes().map(|(_, n)| n), [2, 2, 0, 0, 1]);
    assert!(contents.contradicts());
    assert_eq!(contents.claims[0].word(), "SUPPORTED");
    assert_eq!(contents.claims[2].word(), "REFUTED");
    assert_eq!(contents.claims[4].word(), "NOT READ");
}

#[test]
fn a_report_of_nothing_says_so() {
    let contents = Contents::of(&info(), &Results::default());
    assert!(
        contents.tables.iter().all(|(_, table)| table.is_err()) && contents.figures.iter().all(|(_, figure)| figure.is_err())
    );
    assert_eq!(contents.outcomes()[3], ("NOT RUN", 4));
    let dir = tempfile::tempdir().unwrap();
    let paths = write(dir.path(), &info(), &Results::default(), &contents, &provenance()).unwrap();
    assert!(fs::read_to_string(paths.page).unwrap().contains("no trial of the study belongs to it"));
}

#[test]
fn the_summary_for_a_terminal() {
    let info = info();
    let results = results();
    let contents = Contents::of(&info, &results);
    insta::assert_snapshot!(summary(&info, &results, &contents, Path::new("results/table-3.2/index.html"), 100));
}

#[test]
fn the_sections_of_the_page_stand_in_their_order() {
    let dir = tempfile::tempdir().unwrap();
    let page = String::from_utf8(written(dir.path())["index.html"].clone()).unwrap();
    let sections: Vec<&str> = page.split("<section id=\"").skip(1).filter_map(|text| text.split('"').next()).collect();
    let names = ["tables", "figures", "claims", "departures", "budgets", "settings-that-differ", "values-by-seed"];
    let names = names.into_iter().chain(["what-was-run", "profiles", "provenance"]).map(|name| format!("section-{name}"));
    assert!(names.eq(sections.iter().map(ToString::to_string)), "{sections:?}");
    assert!(sections.iter().all(|section| page.contains(&format!("<a href=\"#{section}\">"))));
    assert!(page.contains("The load profile of <code>four_cells</code>"));
    assert!(page.contains("<summary>lengths: 38 values</summary>") && page.contains("href=\"tables/lengths-seeds.csv\""));
    assert!(page.contains("<dt>paper</dt><dd>0 of 200 trials are stored: never run</dd>"));
}

#[test]
fn an_agent_that_made_no_update_is_flagged_everywhere() {
    let (info, mut results) = (info(), results());
    for result in results.trials.iter_mut().filter(|result| result.trial.agent == "dsac") {
        let updates = result.names.iter().position(|name| name == UPDATES).unwrap();
        result.rows.iter_mut().filter(|row| usize::from(row.metric) == updates).for_each(|row| row.value = 0.0);
    }
    let contents = Contents::of(&info, &results);
    let dir = tempfile::tempdir().unwrap();
    let paths = write(dir.path(), &info, &results, &contents, &provenance()).unwrap();
    assert!(fs::read_to_string(paths.page).unwrap().contains("<b class=\"problem\">0: not trained</b>"));
    let sentence = "`dsac` in `eight_cells`: 0 updates in 5 of 5 trials: not trained.";
    assert!(fs::read_to_string(paths.markdown).unwrap().contains(sentence));
    assert!(summary(&info, &results, &contents, dir.path(), 100).contains(&sentence.replace('`', "")));
}
