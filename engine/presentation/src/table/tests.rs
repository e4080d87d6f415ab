//! Tables of synthetic results, as every renderer writes them.

use super::{
    Axis, Comparison, Form, Heading, Improvement, Intervals, Margin, PublishedCell, PublishedRow,
    PublishedValue, Statistic, TableAxis, TableSpec, build, csv, html, latex, markdown, terminal,
};
use analysis::{published_curve::PublishedCurve, results::Results};
use contract::{Phase, standard_metrics::UPDATES, trial_end::EndState, trial_result::Success};
use statistics::{SequentialDesign, Verdict};
use std::collections::BTreeMap;
use testing::synthetic::study;
use testing::synthetic::{ended, trial};

/// The improvement over an equal split, with published values for both environments.
pub(super) fn improvement() -> TableSpec {
    let of = Improvement(Comparison {
        rows: Axis::Environment.into(),
        value: "cycle_length".into(),
        relative_to: Some("equal".into()),
        labels: BTreeMap::from([("dsac".into(), "Dirichlet SAC".into())]),
        ..Comparison::default()
    });
    TableSpec {
        caption: "Average improvement of the working cycle & what it costs".into(),
        published: BTreeMap::from([
            ("four_cells".into(), PublishedRow::Value(15.2)),
            ("nine_cells".into(), PublishedRow::Value(1.0)),
        ]),
        notes: vec!["The load is drawn anew for each episode <100 % of the time>.".into()],
        ..TableSpec::of(of)
    }
}

fn final_value(environment: &str, agent: &str, seed: u64, value: f64) -> contract::trial_result::TrialResult {
    trial(
        environment,
        agent,
        "",
        seed,
        &vec![
            (Phase::Final, 1, 0, "return", value - 1.0),
            (Phase::Final, 1, 1, "return", value + 1.0),
        ],
    )
}

#[test]
fn an_improvement_in_every_format() {
    let grid = build(&improvement(), &study()).unwrap();
    insta::assert_snapshot!("improvement_markdown", markdown(&grid));
    insta::assert_snapshot!("improvement_latex", latex(&grid, "table-3.2"));
    insta::assert_snapshot!("improvement_csv", csv(&grid).unwrap());
    let lines = html(&grid).into_string().replace("><", ">\n<");
    insta::assert_snapshot!("improvement_html", lines);
    insta::assert_snapshot!(
        "improvement_terminal",
        format!("{}\n{}", terminal(&grid, 160), terminal(&grid, 80))
    );
}

#[test]
fn a_comparison_by_agent_and_environment() {
    let comparison = Comparison {
        value: "cycle_length".into(),
        statistic: Statistic::Iqm,
        ..Comparison::default()
    };
    let published = BTreeMap::from([(
        "dsac".into(),
        PublishedRow::Columns(BTreeMap::from([(
            "eight_cells".into(),
            PublishedCell::Value(23.0),
        )])),
    )]);
    let spec = TableSpec {
        published,
        margin: Some(Margin::Absolute(0.5)),
        ..TableSpec::of(comparison)
    };
    insta::assert_snapshot!(markdown(&build(&spec, &study()).unwrap()));
}

/// Two learners and a rule; the second learner stays low with seed 1.
fn learning() -> Results {
    let curve = |agent: &str, seed: u64, values: [f64; 4]| {
        let steps = (0..).step_by(10).zip(values);
        let mut rows: Vec<_> = steps
            .map(|(step, value)| (Phase::Evaluate, step, 0, "return", value))
            .collect();
        rows.extend([
            (Phase::Final, 40, 0, "return", -7.0),
            (Phase::Final, 40, 0, UPDATES, 40.0),
        ]);
        trial("e", agent, "", seed, &rows)
    };
    let rule = |seed| trial("e", "rule", "", seed, &vec![(Phase::Final, 0, 0, "return", 3.0)]);
    Results::of(vec![
        curve("a", 0, [0.0, 8.0, 8.0, 8.0]),
        curve("a", 1, [8.0, 8.0, 8.0, 6.0]),
        curve("b", 0, [0.0, 8.0, 8.0, 8.0]),
        curve("b", 1, [0.0, 0.0, 1.0, 2.0]),
        rule(0),
        rule(1),
    ])
}

#[test]
fn the_last_measurements_during_learning() {
    let comparison = Comparison {
        last: Some(2),
        decimals: Some(2),
        ..Comparison::default()
    };
    let grid = build(&TableSpec::of(comparison), &learning()).unwrap();
    assert_eq!(
        grid.quantity.to_string(),
        "return, mean of the last 2 measurements"
    );
    let seeds: Vec<_> = grid.cells.iter().map(|row| row[0].seeds.clone()).collect();
    assert_eq!(
        seeds,
        [
            vec![(0, 8.0), (1, 7.0)],
            vec![(0, 8.0), (1, 1.5)],
            vec![(0, 3.0), (1, 3.0)]
        ]
    );
}

#[test]
fn values_of_many_sizes_have_powers_of_ten() {
    let comparison: Comparison =
        serde_json::from_value(serde_json::json!({ "significant_digits": 3, "last": 2 })).unwrap();
    let table = build(&TableSpec::of(comparison.clone()), &learning()).unwrap();
    assert!(
        markdown(&table).contains("| 7.50e0 [1.15e0, 1.39e1] |"),
        "{}",
        markdown(&table)
    );
    let written = serde_json::to_value(comparison).unwrap();
    assert_eq!(
        (&written["significant_digits"], &written["decimals"]),
        (&3.into(), &serde_json::Value::Null)
    );
}

#[test]
fn results_against_the_budget() {
    let comparison = Comparison {
        at_steps: vec![15, 30, 31],
        smooth: Some(0.5),
        decimals: Some(1),
        ..Comparison::default()
    };
    let published = BTreeMap::from([(
        "a".into(),
        PublishedRow::Columns(BTreeMap::from([("31".into(), PublishedCell::Value(9.0))])),
    )]);
    let mut results = learning();
    results.trials[3] = ended(results.trials[3].clone(), EndState::Timeout, "60 s");
    let grid = build(
        &TableSpec {
            published,
            ..TableSpec::of(comparison)
        },
        &results,
    )
    .unwrap();
    let seeds = |column: usize| {
        grid.cells
            .iter()
            .map(|row| row[column].seeds.clone())
            .collect::<Vec<_>>()
    };
    // The averages of seed 0 are 0, 4, 6, 7; the rule has the same value at every step.
    assert_eq!(
        seeds(0),
        [vec![(0, 4.0), (1, 8.0)], vec![(0, 4.0)], vec![(0, 3.0), (1, 3.0)]]
    );
    assert_eq!(
        seeds(1),
        [vec![(0, 7.0), (1, 7.0)], vec![(0, 7.0)], vec![(0, 3.0), (1, 3.0)]]
    );
    assert_eq!(seeds(2), [vec![], vec![], vec![(0, 3.0), (1, 3.0)]]);
    insta::assert_snapshot!(markdown(&grid));
    let comparison = Comparison {
        at_steps: vec![10, 20],
        last: Some(2),
        ..Comparison::default()
    };
    let last_two = super::compare(&comparison, &results).unwrap();
    assert_eq!(
        last_two.quantity.to_string(),
        "return, mean of the last 2 measurements until the environment steps of each column"
    );
    assert_eq!(
        (last_two.cells[0][0].estimate, last_two.cells[1][1].seeds.clone()),
        (Some(6.0), vec![(0, 8.0)])
    );
}

#[test]
fn published_curves_are_compared_at_equal_steps() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("logs.csv");
    std::fs::write(
        &file,
        "run,step,value\nx,8,1\nx,18,5\nx,28,9\ny,8,3\ny,18,7\ny,28,10\n",
    )
    .unwrap();
    let curve = PublishedCurve {
        label: "logs".into(),
        agent: Some("a".into()),
        file,
        step: "step".into(),
        value: "value".into(),
        by: Some("run".into()),
        ..PublishedCurve::default()
    };
    let comparison = Comparison {
        at_steps: vec![10, 20, 30, 60],
        last: Some(2),
        ..Comparison::default()
    };
    let spec = TableSpec {
        published_curves: vec![curve],
        ..TableSpec::of(comparison)
    };
    let grid = build(&spec, &learning()).unwrap();
    let references: Vec<_> = grid.cells[0]
        .iter()
        .map(|cell| {
            cell.judgement
                .as_ref()
                .map(|it| (it.reference.value, it.reference.runs))
        })
        .collect();
    // Up to step 10 there is only one measurement, and the logs end at 28. The two runs differ by 2 and by 1.5.
    let runs = |difference: f64| Some((statistics::estimators::sd(&[0.0, difference]), 2));
    assert_eq!(
        references,
        [None, Some((4.0, runs(2.0))), Some((7.75, runs(1.5))), None]
    );
    assert!(grid.cells[1].iter().all(|cell| cell.judgement.is_none()));
    assert!(
        grid.notes
            .contains(&"Published curve logs: 2 runs, the last 2 measurements up to each step.".to_owned())
    );
}

#[test]
fn the_steps_until_a_level_or_why_there_are_none() {
    let comparison = Comparison {
        steps_until_above: Some(5.0),
        smooth: Some(0.5),
        ..Comparison::default()
    };
    let spec = TableSpec::of(comparison);
    let grid = build(&spec, &learning()).unwrap();
    assert_eq!(
        grid.quantity.to_string(),
        "environment steps until the moving average (weight 0.5) of return is above 5"
    );
    assert_eq!(grid.columns[0].label, "steps");
    // The averages of seed 0 are 0, 4, 6, 7.
    assert_eq!(
        (grid.cells[0][0].seeds.clone(), grid.cells[1][0].seeds.clone()),
        (vec![(0, 20.0), (1, 0.0)], vec![(0, 20.0)])
    );
    assert_eq!(
        grid.cells[1][0].incompleteness(),
        "1 of 2 seeds; seed 1: never above 5"
    );
    assert!(grid.cells[2][0].seeds.is_empty() && spec.kind.metric_of_unit().is_none());
}

#[test]
fn a_metric_of_learning_has_last_values_and_the_final_one_says_so() {
    let rows = vec![
        (Phase::Train, 10, 0, "loss", 4.0),
        (Phase::Train, 20, 0, "loss", 2.0),
        (Phase::Final, 20, 0, "return", 1.0),
    ];
    let results = Results::of(vec![trial("e", "a", "", 0, &rows)]);
    let of = |last| {
        let comparison = Comparison {
            value: "loss".into(),
            last,
            ..Comparison::default()
        };
        build(&TableSpec::of(comparison), &results).unwrap()
    };
    assert_eq!(of(Some(1)).cells[0][0].seeds, [(0, 2.0)]);
    assert_eq!(
        of(None).cells[0][0].incompleteness(),
        "0 of 1 seeds; seed 0: `loss` was recorded while learning and not at the end, so that `last: 1` has it"
    );
}

#[test]
fn ratios_are_paired_by_seed_and_made_of_means() {
    let pairs = [(0, 3.0, 2.0), (1, 10.0, 5.0), (2, 1.0, 4.0)];
    let mut trials: Vec<_> = pairs
        .iter()
        .flat_map(|&(seed, a, b)| [final_value("e", "a", seed, a), final_value("e", "b", seed, b)])
        .collect();
    trials.push(final_value("e", "a", 7, 100.0));
    trials.push(ended(final_value("e", "b", 7, 1.0), EndState::Timeout, "60 s"));
    let results = Results::of(trials);
    let of = |form| {
        let comparison = Comparison {
            relative_to: Some("b".into()),
            form: Some(form),
            ..Comparison::default()
        };
        super::compare(&comparison, &results).unwrap().cells[0][0].clone()
    };
    assert_eq!(of(Form::Ratio).seeds, [(0, 1.5), (1, 2.0), (2, 0.25)]);
    assert_eq!(of(Form::Ratio).estimate, Some(1.25));
    assert_eq!(of(Form::Difference).seeds, [(0, 1.0), (1, 5.0), (2, -3.0)]);
    assert_eq!(of(Form::PercentChange).seeds, [(0, 50.0), (1, 100.0), (2, -75.0)]);
    assert_eq!(of(Form::Value).seeds.len(), 4);
    assert_eq!(
        of(Form::Ratio).incompleteness(),
        "3 of 4 seeds; seed 7: `b` has no result"
    );
}

#[test]
fn settings_split_the_rows_and_are_never_pooled() {
    let with =
        |setting: &str, value| trial("e", "a", setting, 0, &vec![(Phase::Final, 1, 0, "return", value)]);
    let results = Results::of(vec![
        with("rate=1", 1.0),
        with("rate=2", 5.0),
        final_value("f", "a", 0, 9.0),
    ]);
    let grid = super::compare(
        &Comparison {
            columns: Some(Axis::Environment.into()),
            ..Comparison::default()
        },
        &results,
    )
    .unwrap();
    let rows: Vec<&str> = grid.rows.iter().map(|row| row.label.as_str()).collect();
    assert_eq!(rows, ["a, rate=1", "a, rate=2", "a"]);
    assert_eq!(grid.cells[1][0].estimate, Some(5.0));
    assert_eq!(grid.cells[1][1].planned, 0);
}

#[test]
fn a_baseline_without_the_setting_serves_all_settings() {
    let with =
        |setting: &str, value| trial("e", "a", setting, 0, &vec![(Phase::Final, 1, 0, "return", value)]);
    let results = Results::of(vec![
        with("a.rate=1", 1.0),
        with("a.rate=2", 5.0),
        final_value("e", "b", 0, 2.0),
    ]);
    let comparison = Comparison {
        rows: Axis::Setting.into(),
        relative_to: Some("b".into()),
        form: Some(Form::Ratio),
        ..Comparison::default()
    };
    let grid = super::compare(&comparison, &results).unwrap();
    assert_eq!(
        grid.cells
            .iter()
            .map(|row| row[0].estimate.unwrap())
            .collect::<Vec<_>>(),
        [0.5, 2.5]
    );
}

#[test]
fn swept_keys_are_rows_and_columns_and_other_keys_split_the_rows() {
    let with =
        |setting: &str, value| trial("e", "a", setting, 0, &vec![(Phase::Final, 1, 0, "return", value)]);
    let results = Results::of(vec![
        with("a.rate=1 a.width=8 a.depth=2", 1.0),
        with("a.rate=1 a.width=16 a.depth=2", 2.0),
        with("a.rate=2 a.width=8 a.depth=2", 3.0),
        with("a.rate=2 a.width=16 a.depth=2", 4.0),
        with("a.rate=1 a.width=8 a.depth=3", 5.0),
    ]);
    let comparison = Comparison {
        rows: TableAxis::Key("a.rate".into()),
        columns: Some(TableAxis::Key("width".into())),
        ..Comparison::default()
    };
    let grid = super::compare(&comparison, &results).unwrap();
    let values: Vec<Vec<_>> = grid
        .cells
        .iter()
        .map(|row| row.iter().map(|cell| cell.estimate).collect())
        .collect();
    let names = |headings: &[Heading]| headings.iter().map(|it| it.name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&grid.rows), ["1, depth=2", "1, depth=3", "2, depth=2"]);
    assert_eq!(
        (names(&grid.columns), grid.corner()),
        (vec!["8".to_owned(), "16".to_owned()], "rate")
    );
    let expected = [[Some(1.0), Some(2.0)], [Some(5.0), None], [Some(3.0), Some(4.0)]];
    assert_eq!(values, expected);
}

#[test]
fn nothing_to_show_is_said() {
    let missing = Comparison {
        relative_to: Some("nobody".into()),
        ..Comparison::default()
    };
    let message = |comparison: &Comparison, results: &Results| {
        super::compare(comparison, results).unwrap_err().to_string()
    };
    assert_eq!(
        message(&missing, &study()),
        "table: `relative_to`: no trial has the agent `nobody`"
    );
    assert_eq!(
        message(&Comparison::default(), &Results::default()),
        "table: no trial of the study belongs to it"
    );
    let no_other = Comparison {
        form: Some(Form::Ratio),
        ..Comparison::default()
    };
    assert!(message(&no_other, &study()).contains("`relative_to` must name"));
}

/// Success is a return above 9.
fn judge_above_nine(results: &mut Results) -> Success {
    let success = Success {
        metric: "return".into(),
        above: Some(9.0),
        below: None,
    };
    let trials = results.trials.iter_mut();
    trials.for_each(|trial| trial.judge_success(&success));
    success
}

/// A seed without success has ended too, so its look is complete, although the value is based only on the other seeds.
#[test]
fn seeds_without_success_complete_a_look() {
    let mut results = Results::of(
        (0..)
            .zip([9.5, 2.0, 9.7])
            .map(|(seed, value)| final_value("e", "a", seed, value))
            .collect(),
    );
    let success = judge_above_nine(&mut results);
    (results.design, results.success) = (Some(SequentialDesign::new(vec![3, 6])), Some(success));
    let comparison = Comparison {
        given_success: true,
        ..Comparison::default()
    };
    let cell = super::compare(&comparison, &results).unwrap().cells[0][0].clone();
    assert_eq!(
        (cell.seeds, cell.planned, cell.looks.complete()),
        (vec![(0, 9.5), (2, 9.7)], 2, 1)
    );
    results.trials[1].end = None;
    assert_eq!(
        super::compare(&comparison, &results).unwrap().cells[0][0]
            .looks
            .complete(),
        0
    );
}

#[test]
fn values_of_another_system_are_printed_and_not_judged() {
    let trials = (0..5).map(|seed| final_value("e", "a", seed, 9.5 + seed as f64));
    let results = Results::of(trials.collect());
    let mut spec = TableSpec::of(Comparison::default());
    spec.published.insert("a".into(), PublishedRow::Value(1.0));
    let verdict = |spec: &TableSpec| {
        let grid = super::build(spec, &results).unwrap();
        let judgement = grid.cells[0][0].judgement.clone().unwrap();
        (judgement.verdict, grid.notes)
    };
    assert_eq!(verdict(&spec).0, Verdict::Differs);
    spec.of_another_system = Some("an engine that is not public".into());
    let (verdict, notes) = verdict(&spec);
    assert_eq!(verdict, Verdict::NotJudged);
    assert_eq!(
        notes,
        ["Published values are of another system and are not judged: an engine that is not public."]
    );
}

#[test]
fn a_published_share_of_three_runs_decides_less_than_an_exact_one() {
    let values = (0..20).map(|seed| if seed < 3 { 9.5 } else { 2.0 });
    let trials = (0..)
        .zip(values)
        .map(|(seed, value)| final_value("e", "a", seed, value));
    let mut results = Results::of(trials.collect());
    judge_above_nine(&mut results);
    let told = |published: PublishedRow| {
        let comparison = Comparison {
            value: "success".into(),
            ..Comparison::default()
        };
        let spec = TableSpec {
            published: BTreeMap::from([("a".into(), published)]),
            margin: Some(Margin::Absolute(0.2)),
            ..TableSpec::of(comparison)
        };
        let grid = build(&spec, &results).unwrap();
        let notes = grid.footnotes(Intervals::InBrackets).join(" ");
        (grid.cells[0][0].verdict().unwrap(), notes)
    };
    let (verdict, notes) = told(PublishedRow::Value(0.667));
    assert_eq!(verdict, Verdict::Differs);
    assert!(notes.contains("Published values count as exact."), "{notes}");
    let (verdict, notes) = told(PublishedRow::Entry(PublishedValue {
        value: 0.667,
        n: Some(3),
        ..PublishedValue::default()
    }));
    assert_eq!(verdict, Verdict::Inconclusive);
    assert!(
        notes.contains("Published shares with a number of runs count as uncertain"),
        "{notes}"
    );
}
