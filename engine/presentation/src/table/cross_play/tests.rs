//! The matrix of a play against the published one, missing cells, and planned looks.

use super::*;
use crate::table::{Margin, PublishedCell, PublishedRow, TableSpec, build, csv, html, latex, markdown};
use contract::trial_result::TrialResult;
use statistics::Verdict;
use testing::encounters::{crossed, encounter, trained};

const AGENTS: [&str; 3] = ["tdom_ac", "rommeo", "pr2"];
/// The matrix of the thesis, table 4.2, and its means.
const PUBLISHED: [[f64; 4]; 3] = [
    [0.967, 1.0, 0.999, 0.989],
    [0.674, 0.997, 0.981, 0.884],
    [0.0, 0.722, 0.313, 0.345],
];
const MEANS: [f64; 3] = [0.547, 0.906, 0.764];

fn spec() -> CrossPlayTable {
    CrossPlayTable {
        play: "pursuit".into(),
        rows: "prey".into(),
        columns: "predators".into(),
        value: "score".into(),
        decimals: Some(3),
        ..CrossPlayTable::default()
    }
}

/// Scores that normalise to the published matrix: -70 becomes 0 and 30 becomes 1; seeds differ by 2.
fn results(with_floor: bool) -> Results {
    let mut trials = Vec::new();
    for (prey, row) in AGENTS.iter().zip(PUBLISHED) {
        for (predators, value) in AGENTS.iter().zip(row) {
            trials.extend(
                [(0, -1.0), (1, 1.0)]
                    .map(|(seed, shift)| encounter(prey, predators, seed, 100.0 * value - 70.0 + shift)),
            );
        }
        if with_floor {
            trials.push(encounter(prey, "still", 0, 500.0));
        }
    }
    Results::of(trials)
}

fn estimates(grid: &Grid) -> Vec<Vec<Option<f64>>> {
    let rounded = |cell: &Cell| cell.estimate.map(|estimate| (estimate * 1000.0).round() / 1000.0);
    grid.cells
        .iter()
        .map(|row| row.iter().map(rounded).collect())
        .collect()
}

#[test]
fn the_published_matrix_comes_out_with_both_means() {
    let mut wanted: Vec<Vec<Option<f64>>> = PUBLISHED
        .iter()
        .map(|row| row.iter().copied().map(Some).collect())
        .collect();
    wanted.push(MEANS.into_iter().map(Some).chain([None]).collect());
    let grid = super::build(&spec(), &results(false)).unwrap();
    assert_eq!(estimates(&grid), wanted);
    // Seeds lie at 1 on both sides of the mean, 0.01 after scaling: t(0.975, 1) = 12.706 standard errors
    // of 0.01.
    let (low, high) = grid.cells[0][0].interval.unwrap();
    assert!((high - low - 2.0 * 0.12706).abs() < 1e-5 && grid.cells[0][0].seeds.len() == 2);
    let raw = super::build(
        &CrossPlayTable {
            normalise: false,
            ..spec()
        },
        &results(false),
    )
    .unwrap();
    assert_eq!(raw.cells[2][0].estimate, Some(-70.0));
}

#[test]
fn a_floor_stands_beside_and_moves_nothing() {
    let grid = super::build(&spec(), &results(true)).unwrap();
    let columns: Vec<&str> = grid.columns.iter().map(|column| column.name.as_str()).collect();
    assert_eq!(columns, ["tdom_ac", "rommeo", "pr2", "still", MEAN]);
    assert_eq!(grid.cells[0][3].estimate, Some(5.7));
    assert_eq!(estimates(&grid)[0][4], Some(0.989));
}

#[test]
fn what_lacks_is_said() {
    let mut results = results(false);
    for trial in &mut results.trials[..3] {
        trial.end = None;
        trial.rows.clear();
    }
    let grid = super::build(&spec(), &results).unwrap();
    assert_eq!(
        (
            grid.cells[0][0].estimate,
            grid.cells[0][0].planned,
            grid.cells[0][1].seeds.len()
        ),
        (None, 2, 1)
    );
    assert!(grid.cells[0][3].seeds.is_empty() && grid.cells[3][2].seeds.len() == 2);
    assert!(
        grid.notes.iter().any(|note| note.contains("8 of 9 cells")),
        "{:?}",
        grid.notes
    );
    let alike = Results::of(vec![encounter("a", "a", 0, 1.0), encounter("a", "b", 0, 1.0)]);
    let grid = super::build(&spec(), &alike).unwrap();
    assert!(
        grid.cells[0][0].estimate.is_none()
            && grid.cells[0][0].incompleteness().contains("no two cells differ")
    );
    assert!(
        super::build(
            &CrossPlayTable {
                play: "chess".into(),
                ..spec()
            },
            &alike
        )
        .is_err()
    );
}

#[test]
fn every_renderer_writes_it_with_published_values_beside() {
    let columns = |row: [f64; 4]| {
        let names = AGENTS.into_iter().chain([MEAN]).map(String::from);
        PublishedRow::Columns(names.zip(row.map(PublishedCell::Value)).collect())
    };
    let mut published: BTreeMap<String, PublishedRow> = AGENTS
        .into_iter()
        .zip(PUBLISHED)
        .map(|(name, row)| (name.into(), columns(row)))
        .collect();
    let means = AGENTS
        .into_iter()
        .map(String::from)
        .zip(MEANS.map(PublishedCell::Value))
        .collect();
    published.insert(MEAN.into(), PublishedRow::Columns(means));
    let spec = TableSpec {
        published,
        margin: Some(Margin::Absolute(0.1)),
        ..TableSpec::of(spec())
    };
    let grid = build(&spec, &results(false)).unwrap();
    assert!(
        grid.notes.iter().all(|note| !note.contains("have no place")),
        "{:?}",
        grid.notes
    );
    insta::assert_snapshot!("cross_play_markdown", markdown(&grid));
    insta::assert_snapshot!("cross_play_latex", latex(&grid, "table-4.2"));
    for text in [
        csv(&grid).unwrap(),
        html(&grid).into_string(),
        crate::table::terminal(&grid, 200),
    ] {
        assert!(text.contains("0.967") && text.contains(MEAN), "{text}");
    }
}

/// All seeds of both agents meet, in both roles: 1 + a_i + b_j.
fn all_meet_all(prey: [&[f64]; 2], predators: [&[f64]; 2]) -> Vec<TrialResult> {
    let named = |sides: [&[f64]; 2]| ["a", "b"].into_iter().zip(sides.map(<[f64]>::to_vec));
    let pairs = named(prey).flat_map(|one| named(predators).map(move |other| (one.clone(), other)));
    pairs
        .flat_map(|((prey, x), (predators, y))| crossed([prey, predators], [&x, &y]))
        .collect()
}

fn looked_at(results: &Results) -> Grid {
    let published = BTreeMap::from([("mean".to_owned(), PublishedCell::Value(0.0))]);
    let spec = TableSpec {
        published: [("a".to_owned(), PublishedRow::Columns(published))].into(),
        margin: Some(Margin::Absolute(0.2)),
        ..TableSpec::of(spec())
    };
    build(&spec, results).unwrap()
}

#[test]
fn later_seeds_move_no_verdict_of_an_earlier_look() {
    let design = Some(SequentialDesign::new(vec![3, 5]));
    let of = |prey: [&[f64]; 2], predators: [&[f64]; 2]| {
        let mut results = Results::of(trained(5).chain(all_meet_all(prey, predators)).collect());
        results.design.clone_from(&design);
        looked_at(&results)
    };
    let few = of(
        [&[9.0, 9.2, 9.1], &[3.0, 3.3, 3.1]],
        [&[0.0, 0.1, 0.2], &[1.0, 1.1, 1.2]],
    );
    let many = of(
        [&[9.0, 9.2, 9.1, -50.0, 70.0], &[3.0, 3.3, 3.1, 40.0, 40.0]],
        [&[0.0, 0.1, 0.2, 9.0, -80.0], &[1.0, 1.1, 1.2, -20.0, 30.0]],
    );
    let judged = |grid: &Grid| grid.cells[0][2].judgement.clone().unwrap();
    let (first, later) = (judged(&few), judged(&many));
    assert_eq!((first.verdict, first.n), (Verdict::Differs, 3));
    assert_eq!(
        (later.verdict, later.n, later.mean, later.interval),
        (first.verdict, first.n, first.mean, first.interval)
    );
    assert!(
        later.note().contains("decided at look 1 of 2"),
        "{}",
        later.note()
    );
    // The last column is over all seeds, and on the same scale.
    assert_ne!(few.cells[0][2].estimate, many.cells[0][2].estimate);
    let scale = |grid: &Grid| {
        grid.notes
            .iter()
            .find(|it| it.starts_with("0 stands for"))
            .cloned()
    };
    assert_eq!(scale(&few), scale(&many));
    assert!(
        scale(&few).unwrap().contains("after the first look, at 3 seeds"),
        "{few:?}"
    );
    let fixed = |grid: &Grid| {
        grid.cells
            .iter()
            .flatten()
            .map(|cell| cell.fixed)
            .collect::<Vec<_>>()
    };
    assert_eq!(fixed(&few), fixed(&many));
}

#[test]
fn a_look_waits_for_every_meeting_of_its_seeds() {
    let seeds: [&[f64]; 2] = [&[9.0, 9.2, 9.1], &[3.0, 3.3, 3.1]];
    let complete = |unrun: Option<usize>| {
        let mut meetings = all_meet_all(seeds, seeds);
        if let Some(index) = unrun {
            meetings[index].end = None;
        }
        let mut results = Results::of(trained(3).chain(meetings).collect());
        results.design = Some(SequentialDesign::new(vec![3, 5]));
        looked_at(&results).cells[0][0].looks.complete()
    };
    // The last trial belongs to another cell that also sets the scale.
    assert_eq!([None, Some(2), Some(7), Some(35)].map(complete), [1, 0, 0, 0]);
}
