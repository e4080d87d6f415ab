//! A whole report of synthetic results.

mod record;

use super::{Contents, Period, ProfileState, ProfileTrials, Provenance, StudyInfo, head, summary, write};
use analysis::results::Results;
use contract::{
    Build, Phase,
    cast::Actors,
    part::Part,
    recorder::Row,
    standard_metrics::{EPISODE_LENGTH, UPDATES},
    trial::Trial,
    trial_end::EndState,
    trial_result::TrialResult,
};
use presentation::{
    claim_spec::ClaimSpec,
    figure::{Bars, FigureSpec, LearningCurve, Trajectory},
    summary::Summary,
    table::{Axis, Comparison, Form, Improvement, Intervals, Margin, PublishedRow, TableSpec},
};
use serde_json::{Value, json};
use statistics::SequentialDesign;
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
    sync::Arc,
};
use testing::synthetic::{AGENTS, ended, study as recorded, trial};

/// The synthetic results with configs and with the lengths of measured episodes.
fn results() -> Results {
    let mut results = recorded();
    for result in &mut results.trials {
        let Trial { cell, key, .. } = result.trial_mut();
        key.environment = Part::new(
            "battery",
            1,
            json!({"cells": if cell.environment == "four_cells" { 4 } else { 8 }}),
        )
        .into();
        key.agent = Actors::Agent(agent(&cell.agent)).into();
        key.protocol = Part::new("train_evaluate", 1, json!({"steps": 60_000, "final_episodes": 4})).into();
        if result.is_ok() {
            record_lengths(result);
        }
    }
    results
}

fn agent(name: &str) -> Part {
    let (plugin, config) = match name {
        "dsac" => (
            "actor_critic",
            json!({"width": 256, "rate": 0.0003, "policy": "dirichlet"}),
        ),
        "ddpg" => (
            "actor_critic",
            json!({"width": 64, "rate": 0.0003, "policy": "softmax"}),
        ),
        other => (other, json!({})),
    };
    Part::new(plugin, 1, config)
}

fn record_lengths(result: &mut TrialResult) {
    let metric = u16::try_from(result.names.len()).unwrap();
    Arc::make_mut(&mut result.names).push(EPISODE_LENGTH.into());
    let measured = |row: &&Row| [Phase::Evaluate, Phase::Final].contains(&row.phase) && row.metric == 0;
    let lengths: Vec<Row> = result
        .rows
        .iter()
        .filter(measured)
        .map(|row| Row {
            metric,
            value: 600.0,
            ..*row
        })
        .collect();
    result.rows.extend(lengths);
}

fn defaults() -> BTreeMap<String, Value> {
    let configs = [
        (
            "agent actor_critic",
            json!({"width": 256, "rate": 0.001, "policy": "dirichlet"}),
        ),
        ("environment battery", json!({"cells": 4})),
        (
            "protocol train_evaluate",
            json!({"steps": 60_000, "final_episodes": 1000}),
        ),
    ];
    configs.map(|(name, config)| (name.to_owned(), config)).into()
}

fn profiles() -> Vec<ProfileState> {
    let state = |name: &str, this_report, [planned, ok, failed, own]: [usize; 4]| ProfileState {
        name: (!name.is_empty()).then(|| name.to_owned()),
        this_report,
        trials: Some(ProfileTrials {
            planned,
            ok,
            failed,
            own,
        }),
    };
    vec![
        state("", false, [40, 20, 0, 0]),
        state("smoke", true, [40, 38, 1, 19]),
        state("paper", false, [200, 0, 0, 0]),
    ]
}

fn improvement() -> TableSpec {
    let published = [("four_cells", 15.2), ("eight_cells", 15.9)]
        .map(|(row, value)| (row.to_owned(), PublishedRow::Value(value)));
    let of = Improvement(Comparison {
        rows: Axis::Environment.into(),
        value: "cycle_length".into(),
        relative_to: Some("equal".into()),
        agents: vec!["dsac".into(), "ddpg".into()],
        labels: BTreeMap::from([
            ("dsac".into(), "Dirichlet SAC".into()),
            ("ddpg".into(), "DDPG".into()),
        ]),
        ..Comparison::default()
    });
    TableSpec {
        caption: "Average improvement of the working cycle over an equal split.".into(),
        published: BTreeMap::from(published),
        notes: vec!["The text gives no spread.".into()],
        ..TableSpec::of(of)
    }
}

fn info() -> StudyInfo {
    let summary = "Learning gains {table-3.2: four_cells, dsac} % <against> {table-3.2: four_cells, dsac published} \
                   % ({claim 1}).";
    let deviation =
        "The load profile of `four_cells` is drawn from a uniform distribution, since the text gives none.";
    let unit = |(name, unit): (&str, &str)| (name.to_string(), unit.to_string());
    StudyInfo {
        name: "table-3.2".into(),
        title: "Average improvement of the working cycle <with & without> learning".into(),
        source: "thesis, table 3.2".into(),
        summary: Some(Summary::parse(summary).unwrap()),
        deviations: vec![deviation.into()],
        tables: tables(),
        figures: figures(),
        claims: claims(),
        agents: AGENTS.map(String::from).into(),
        environments: vec!["four_cells".into(), "eight_cells".into()],
        learners: BTreeSet::from(["dsac".into(), "ddpg".into()]),
        defaults: defaults(),
        profiles: profiles(),
        ended: Period::of(
            ["2025-01-03T10:00:00Z", "2025-01-04T08:30:00Z"]
                .map(String::from)
                .into_iter(),
            3,
        ),
        units: BTreeMap::from([("cycle_length", "h"), ("voltage", "V"), ("load", "W")].map(unit)),
        options: vec!["--set dsac.discount=0.9".into(), "--seeds 5".into()],
        ..StudyInfo::default()
    }
}

/// A table with published values, one without, and one of an agent that does not exist.
fn tables() -> Vec<(String, TableSpec)> {
    let lengths = Comparison {
        value: "cycle_length".into(),
        ..Comparison::default()
    };
    let of_nobody = Comparison {
        agents: vec!["nobody".into()],
        ..Comparison::default()
    };
    vec![
        ("table-3.2".into(), improvement()),
        ("lengths".into(), TableSpec::of(lengths)),
        ("empty".into(), TableSpec::of(of_nobody)),
    ]
}

fn figures() -> Vec<(String, FigureSpec)> {
    let curve = LearningCurve {
        metric: "cycle_length".into(),
        ..LearningCurve::default()
    };
    let trajectory = Trajectory {
        channels: vec!["voltage".into(), "load".into()],
        threshold: Some(3.2),
        ..Trajectory::default()
    };
    let of = Comparison {
        rows: Axis::Environment.into(),
        value: "cycle_length".into(),
        ..Comparison::default()
    };
    let with_caption = |caption: &str, figure: FigureSpec| FigureSpec {
        caption: caption.into(),
        ..figure
    };
    vec![
        (
            "learning-curve".into(),
            with_caption("Cycle length while learning.", FigureSpec::of(curve)),
        ),
        (
            "voltages".into(),
            with_caption("One discharge.", FigureSpec::of(trajectory)),
        ),
        ("bars".into(), FigureSpec::of(Bars { of })),
    ]
}

fn claims() -> Vec<ClaimSpec> {
    vec![
        claim("dsac.cycle_length > equal.cycle_length"),
        ClaimSpec {
            environment: Some("four_cells".into()),
            ..claim("ddpg.cycle_length > dsac.cycle_length")
        },
        claim("dsac.cycle_length ~ bound.cycle_length in eight_cells"),
        claim("dsac.cycle_length >"),
    ]
}

fn claim(text: &str) -> ClaimSpec {
    ClaimSpec {
        claim: text.into(),
        ..ClaimSpec::default()
    }
}

fn provenance() -> Provenance {
    Provenance {
        build: Build::told("0123abc", "true"),
        builds: vec![(Build::told("0123abc", "true"), 37), (None, 2)],
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
    let mut contents = Contents::of(&info, &results);
    let paths = write(dir, &info, &results, &mut contents, &provenance()).unwrap();
    let all = paths.files.iter().chain([&paths.page, &paths.markdown]);
    all.map(|path| {
        (
            path.strip_prefix(dir).unwrap().display().to_string(),
            fs::read(path).unwrap(),
        )
    })
    .collect()
}

#[test]
#[expect(
    clippy::disallowed_methods,
    reason = "whoever looks at the report says where it goes"
)]
fn a_report_is_the_same_bytes_each_time_and_loads_nothing() {
    let dirs = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    // `REPORT=DIR` keeps the report for inspection by eye.
    let first = std::env::var_os("REPORT").map_or_else(|| dirs[0].path().to_owned(), Into::into);
    let (one, two) = (written(&first), written(dirs[1].path()));
    assert!(one == two);
    let names: Vec<&str> = one.keys().map(String::as_str).collect();
    insta::assert_snapshot!("files", names.join("\n"));
    insta::assert_snapshot!("report", String::from_utf8(one["report.md"].clone()).unwrap());
    insta::assert_snapshot!(
        "verdicts",
        String::from_utf8(one["verdicts.json"].clone()).unwrap()
    );
    insta::assert_snapshot!(
        "seeds",
        String::from_utf8(one["tables/lengths-seeds.csv"].clone()).unwrap()
    );
    let page = String::from_utf8(one["index.html"].clone()).unwrap();
    assert!(!page.contains("<with & without>") && page.contains("&lt;with &amp; without&gt;"));
    assert!(page.contains("used 3.1 GiB of 3.0 GiB &lt;allowed&gt;"));
    let outside = page.replace("http://www.w3.org/2000/svg", "");
    assert!(
        ["http:", "https:", "<link", "url(", "@import", "src="]
            .iter()
            .all(|word| !outside.contains(word))
    );
    assert!(
        fs::read_dir(dirs[1].path().join("figures"))
            .unwrap()
            .all(|entry| !entry.unwrap().file_name().to_string_lossy().starts_with('.'))
    );
}

#[test]
fn verdicts_and_claims_are_counted() {
    let contents = Contents::of(&info(), &results());
    assert_eq!(contents.verdicts(false).iter().map(|(_, n)| n).sum::<usize>(), 4);
    assert_eq!(
        contents.outcomes(false),
        [("SUPPORTED", 2), ("REFUTED", 2), ("NOT READ", 1)]
    );
    assert!(contents.contradicts());
    assert_eq!(contents.claims[0].word(), "SUPPORTED");
    assert_eq!(contents.claims[2].word(), "REFUTED");
    assert_eq!(contents.claims[4].word(), "NOT READ");
}

#[test]
fn a_claim_across_environments_pairs_the_seeds_of_its_sides() {
    let held = |text: &str| {
        let info = StudyInfo {
            claims: vec![claim(text)],
            ..info()
        };
        Contents::of(&info, &results()).claims
    };
    let across = held("dsac.cycle_length in eight_cells > dsac.cycle_length in four_cells");
    let [line] = across.as_slice() else {
        panic!("{} lines", across.len());
    };
    assert_eq!(line.place, "eight_cells, four_cells");
    let verdict = line.verdict.as_ref().unwrap();
    let own = |environment: &str| {
        let claims = held(&format!("dsac.cycle_length > 0 in {environment}"));
        claims[0].verdict.as_ref().unwrap().difference.unwrap()
    };
    let expected = own("eight_cells") - own("four_cells");
    assert!(verdict.paired && verdict.n >= 3, "{verdict:?}");
    assert!(
        (verdict.difference.unwrap() - expected).abs() < 1e-9,
        "{verdict:?}"
    );
    let of: BTreeSet<&str> = line.rests_on.iter().map(|it| it.environment.as_str()).collect();
    assert_eq!(of, BTreeSet::from(["eight_cells", "four_cells"]));
}

#[test]
fn a_report_of_nothing_says_so() {
    let mut contents = Contents::of(&info(), &Results::default());
    assert!(
        contents.tables.iter().all(|(_, table)| table.is_err())
            && contents.figures.iter().all(|(_, figure)| figure.is_err())
    );
    assert_eq!(contents.outcomes(false)[0], ("NOT RUN", 4));
    let dir = tempfile::tempdir().unwrap();
    let paths = write(
        dir.path(),
        &info(),
        &Results::default(),
        &mut contents,
        &provenance(),
    )
    .unwrap();
    assert!(
        fs::read_to_string(paths.page)
            .unwrap()
            .contains("no trial of the study belongs to it")
    );
}

#[test]
fn a_drawing_that_is_refused_costs_its_figure_alone() {
    let (info, results) = (info(), results());
    let mut contents = Contents::of(&info, &results);
    let broken = presentation::figure::Chart {
        panels: vec![presentation::figure::Panel {
            series: vec![presentation::figure::Series {
                label: String::new(),
                seeds: None,
                style: presentation::figure::Style::default(),
                shape: presentation::figure::Shape::Images(presentation::figure::Tiles {
                    images: vec![contract::drawing::Image {
                        width: 4,
                        height: 4,
                        pixels: vec![0; 5],
                    }],
                    columns: 1,
                    ..presentation::figure::Tiles::default()
                }),
            }],
            ..presentation::figure::Panel::default()
        }],
        columns: 1,
        ..presentation::figure::Chart::default()
    };
    let name = contents.figures[0].0.clone();
    contents.figures[0].1 = Ok(broken);
    let drawn = contents.figures.iter().filter(|(_, chart)| chart.is_ok()).count();
    let dir = tempfile::tempdir().unwrap();
    write(dir.path(), &info, &results, &mut contents, &provenance()).unwrap();
    assert!(!contents.unmade().is_empty());
    let reason = contents.figures[0].1.as_ref().unwrap_err();
    assert!(
        reason.contains(&format!("its data are in `figures/{name}.csv`")),
        "{reason}"
    );
    for file in ["report.md", "index.html"] {
        let text = fs::read_to_string(dir.path().join(file)).unwrap();
        assert!(text.contains("Could not be drawn: "), "{file}");
    }
    let files = |extension: &str| {
        let entries = fs::read_dir(dir.path().join("figures")).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.filter(|name| name.ends_with(extension)).count()
    };
    assert_eq!(
        (files(".csv"), files(".svg"), files(".pdf")),
        (drawn, drawn - 1, drawn - 1)
    );
}

#[test]
fn the_summary_for_a_terminal() {
    let info = info();
    let results = results();
    let contents = Contents::of(&info, &results);
    let page = Path::new("results/table-3.2/index.html");
    insta::assert_snapshot!(summary(&info, &results, &contents, page, 100, true));
    insta::assert_snapshot!(
        "the_first_screen",
        summary(&info, &results, &contents, page, 100, false)
    );
}

#[test]
fn the_sections_of_the_page_stand_in_their_order() {
    let dir = tempfile::tempdir().unwrap();
    let page = String::from_utf8(written(dir.path())["index.html"].clone()).unwrap();
    let sections: Vec<&str> = page
        .split("<section id=\"")
        .skip(1)
        .filter_map(|text| text.split('"').next())
        .collect();
    let names = [
        "tables",
        "figures",
        "claims",
        "deviations",
        "meaning-of-the-verdicts",
        "budgets",
        "settings-that-differ",
        "values-by-seed",
    ];
    let names = names
        .into_iter()
        .chain(["what-was-run", "profiles", "provenance"])
        .map(|name| format!("section-{name}"));
    assert!(names.eq(sections.iter().map(ToString::to_string)), "{sections:?}");
    assert!(
        sections
            .iter()
            .all(|section| page.contains(&format!("<a href=\"#{section}\">")))
    );
    assert!(page.contains("The load profile of <code>four_cells</code>"));
    assert!(
        page.contains("<summary>lengths: 38 values</summary>")
            && page.contains("href=\"tables/lengths-seeds.csv\"")
    );
    assert!(page.contains("<dt>paper</dt><dd>0 of 200 trials are stored: never run</dd>"));
}

#[test]
fn an_agent_that_made_no_update_is_flagged_everywhere() {
    let (info, mut results) = (info(), results());
    for result in results
        .trials
        .iter_mut()
        .filter(|result| result.trial.cell.agent == "dsac")
    {
        let updates = result.names.iter().position(|name| name == UPDATES).unwrap();
        result
            .rows
            .iter_mut()
            .filter(|row| usize::from(row.metric) == updates)
            .for_each(|row| row.value = 0.0);
    }
    let mut contents = Contents::of(&info, &results);
    let dir = tempfile::tempdir().unwrap();
    let paths = write(dir.path(), &info, &results, &mut contents, &provenance()).unwrap();
    assert!(
        fs::read_to_string(paths.page)
            .unwrap()
            .contains("<b class=\"problem\">0: not trained</b>")
    );
    let sentence = "`dsac` in `eight_cells`: 0 updates in 5 of 5 trials: not trained.";
    assert!(fs::read_to_string(paths.markdown).unwrap().contains(sentence));
    assert!(summary(&info, &results, &contents, dir.path(), 100, false).contains(sentence));
}

/// Five seeds of `dsac` and `equal` in one environment, with these differences, and with the trials changed by
/// `change`.
fn two_agents(
    differences: [f64; 5],
    change: impl Fn(&mut Vec<(Phase, u64, u64, &'static str, f64)>, u64),
) -> Results {
    let mut trials = Vec::new();
    for (seed, difference) in (0..).zip(differences) {
        trials.push(trial(
            "four_cells",
            "equal",
            "",
            seed,
            &vec![(Phase::Final, 1, 0, "cycle_length", 10.0)],
        ));
        let mut rows = vec![
            (Phase::Final, 9, 0, "cycle_length", 10.0 + difference),
            (Phase::Final, 9, 0, UPDATES, 40.0),
        ];
        change(&mut rows, seed);
        trials.push(trial("four_cells", "dsac", "", seed, &rows));
    }
    Results::of(trials)
}

fn one_environment(claims: Vec<ClaimSpec>, table: TableSpec) -> StudyInfo {
    StudyInfo {
        environments: vec!["four_cells".into()],
        tables: vec![("t".into(), table)],
        claims,
        ..info()
    }
}

fn published(value: f64) -> TableSpec {
    let comparison = Comparison {
        value: "cycle_length".into(),
        agents: vec!["dsac".into()],
        ..Comparison::default()
    };
    let published = BTreeMap::from([("dsac".into(), PublishedRow::Value(value))]);
    TableSpec {
        published,
        margin: Some(Margin::Absolute(1.0)),
        ..TableSpec::of(comparison)
    }
}

const CLEAR: [f64; 5] = [1.0, 1.1, 0.9, 1.05, 0.95];

#[test]
fn what_made_no_update_is_not_judged() {
    let untrained = two_agents(CLEAR, |rows, _| rows[1].4 = 0.0);
    let contents = Contents::of(
        &one_environment(
            vec![claim("dsac.cycle_length > equal.cycle_length")],
            published(11.0),
        ),
        &untrained,
    );
    assert_eq!(
        (contents.verdicts(false), contents.outcomes(false)),
        (vec![("NOT TRAINED", 1)], vec![("NOT TRAINED", 1)])
    );
    let grid = contents.tables[0].1.as_ref().unwrap();
    assert!(
        grid.footnotes(Intervals::InBrackets)
            .iter()
            .any(|note| note == "dsac: 0 updates: dsac was not trained."),
        "{:?}",
        grid.footnotes(Intervals::InBrackets)
    );
    assert_eq!(contents.claims[0].notes(), ["0 updates: dsac was not trained"]);
    let trained = two_agents(CLEAR, |_, _| {});
    let contents = Contents::of(
        &one_environment(
            vec![claim("dsac.cycle_length > equal.cycle_length")],
            published(11.0),
        ),
        &trained,
    );
    assert_eq!(
        (contents.verdicts(false), contents.outcomes(false)),
        (vec![("REPRODUCED", 1)], vec![("SUPPORTED", 1)])
    );
}

#[test]
fn what_was_used_to_choose_a_setting_is_never_reproduced() {
    let results = two_agents(CLEAR, |_, _| {});
    let on = || Some("the load was chosen by it".to_owned());
    let calibrated = ClaimSpec {
        calibrated_on: on(),
        ..claim("dsac.cycle_length > equal.cycle_length")
    };
    let table = TableSpec {
        calibrated_on: on(),
        ..published(11.0)
    };
    let contents = Contents::of(&one_environment(vec![calibrated], table), &results);
    assert_eq!(
        (contents.verdicts(false), contents.outcomes(false)),
        (vec![("CALIBRATED", 1)], vec![("CALIBRATED", 1)])
    );
    assert!(
        contents.tables[0]
            .1
            .as_ref()
            .unwrap()
            .footnotes(Intervals::InBrackets)
            .iter()
            .any(|note| note.contains("the load was chosen by it"))
    );
    assert!(!contents.contradicts() && contents.open().is_empty());
}

#[test]
fn what_was_thought_of_later_is_counted_apart_and_asks_for_no_seeds() {
    let results = two_agents([1.0, -1.0, 0.5, -0.5, 0.1], |_, _| {});
    let exploratory = ClaimSpec {
        exploratory: true,
        ..claim("dsac.cycle_length > equal.cycle_length")
    };
    let table = TableSpec {
        exploratory: true,
        ..published(11.0)
    };
    let contents = Contents::of(&one_environment(vec![exploratory], table), &results);
    assert!(contents.verdicts(false).is_empty() && contents.outcomes(false).is_empty());
    assert_eq!(
        (contents.verdicts(true), contents.outcomes(true)),
        (vec![("INCONCLUSIVE", 1)], vec![("INCONCLUSIVE", 1)])
    );
    assert_eq!(head::lines(&StudyInfo::default(), &contents).len(), 2);
    assert!(contents.open().is_empty());
    assert!(
        contents.claims[0]
            .notes()
            .iter()
            .any(|note| note.starts_with("exploratory: "))
    );
}

#[test]
fn what_differs_too_little_to_matter_is_decided_and_asks_for_no_seeds() {
    let results = two_agents([1.0, -1.0, 0.5, -0.5, 0.1], |_, _| {});
    let line = |min_effect| ClaimSpec {
        min_effect: Some(min_effect),
        ..claim("dsac.cycle_length > equal.cycle_length")
    };
    let held = |min_effect| {
        Contents::of(
            &one_environment(vec![line(min_effect)], published(11.0)),
            &results,
        )
    };
    let [wide, narrow] = [2.0, 0.5].map(held);
    assert_eq!(wide.outcomes(false), [("EQUIVALENT", 1)]);
    assert_eq!(narrow.outcomes(false), [("INCONCLUSIVE", 1)]);
    assert_eq!(
        (wide.open().len() + 1, wide.contradicts()),
        (narrow.open().len(), false)
    );
    assert!(
        wide.claims[0]
            .notes()
            .contains(&"differences of less than 2 do not matter".to_owned())
    );
}

#[test]
fn an_agent_beside_itself_is_not_judged() {
    let comparison = Comparison {
        value: "cycle_length".into(),
        relative_to: Some("equal".into()),
        form: Some(Form::Ratio),
        agents: vec!["equal".into(), "dsac".into()],
        ..Comparison::default()
    };
    let values = [
        ("equal".into(), PublishedRow::Value(1.0)),
        ("dsac".into(), PublishedRow::Value(1.1)),
    ];
    let table = TableSpec {
        published: BTreeMap::from(values),
        ..TableSpec::of(comparison)
    };
    let contents = Contents::of(&one_environment(Vec::new(), table), &two_agents(CLEAR, |_, _| {}));
    assert_eq!(contents.verdicts(false), [("REPRODUCED", 1), ("NOT JUDGED", 1)]);
    assert_eq!(contents.verdicts_together(), contents.verdicts(false));
}

/// Twelve claims, each with a one-sided p of about 0.01: none holds if they are taken together.
#[test]
fn many_claims_together_are_held_to_more() {
    let results = two_agents([1.0, 0.2, 0.6, 1.6, 0.4], |_, _| {});
    let alone = Contents::of(
        &one_environment(vec![claim("dsac.cycle_length > 10")], published(99.0)),
        &results,
    );
    assert_eq!(
        (alone.outcomes(false), alone.outcomes_together()),
        (vec![("SUPPORTED", 1)], vec![("SUPPORTED", 1)])
    );
    let claims = (0..12)
        .map(|index| claim(&format!("dsac.cycle_length > {}", 10.0 - 1e-6 * f64::from(index))))
        .collect();
    let contents = Contents::of(&one_environment(claims, published(99.0)), &results);
    assert_eq!(
        (contents.outcomes(false), contents.outcomes_together()),
        (vec![("SUPPORTED", 12)], vec![("INCONCLUSIVE", 12)])
    );
    assert_eq!(
        contents.claims[0].verdict_in_words(),
        "SUPPORTED (Holm: INCONCLUSIVE)"
    );
    let head: Vec<String> = head::lines(&StudyInfo::default(), &contents)
        .into_iter()
        .map(|line| line.what)
        .collect();
    assert_eq!(
        head,
        [
            "Published values",
            "Claims, all together (Holm)",
            "Claims, one by one"
        ]
    );
}

#[test]
fn open_statements_ask_for_the_next_look() {
    let mut results = two_agents([1.0, -0.8, 0.6, 1.6, -0.4], |_, _| {});
    results.design = Some(SequentialDesign::new(vec![5, 10]));
    let claims = vec![
        claim("dsac.cycle_length > equal.cycle_length"),
        claim("dsac.cycle_length < 50"),
    ];
    let study = one_environment(claims, published(10.5));
    let contents = Contents::judged(&study, &results);
    let open = contents.open();
    assert_eq!(
        (
            open.len(),
            open[0].complete,
            open[0].rests_on.len(),
            open[1].rests_on.len()
        ),
        (2, 1, 1, 2)
    );
    // A look is complete when all its trials have ended, in any state.
    results.trials[0].end = None;
    let contents = Contents::judged(&study, &results);
    assert_eq!(
        contents.open().iter().map(|it| it.complete).collect::<Vec<_>>(),
        [1, 0]
    );
    // A claim without a complete look is open, alone and together with the others.
    assert_eq!(
        (contents.outcomes(false), contents.outcomes_together()),
        (
            vec![("SUPPORTED", 1), ("INCONCLUSIVE", 1)],
            vec![("SUPPORTED", 1), ("INCONCLUSIVE", 1)]
        )
    );
    results.trials[0] = ended(results.trials[1].clone(), EndState::Oom, "x");
    results.trials[0].trial_mut().cell_mut().agent = "equal".into();
    assert_eq!(Contents::judged(&study, &results).open()[1].complete, 1);
}
