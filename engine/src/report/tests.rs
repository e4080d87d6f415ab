//! A whole report of synthetic results.

use super::{
    Contents, Provenance, StudyInfo, summary,
    synthetic::{AGENTS, study as results},
    write,
};
use crate::{
    Build,
    figure::{Bars, FigureSpec, LearningCurve, Trajectory},
    results::Results,
    table::{Axis, Comparison, Published, TableSpec},
};
use std::{collections::BTreeMap, fs, path::Path};

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
        departures: vec!["The load profile is drawn from a uniform distribution, since the text gives none.".into()],
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
        units: BTreeMap::from([("cycle_length".into(), "h".into()), ("voltage".into(), "V".into()), ("load".into(), "W".into())]),
        options: vec!["--set dsac.discount=0.9".into(), "--seeds 5".into()],
    }
}

fn provenance() -> Provenance {
    Provenance {
        commit: Some("0123abc".into()),
        dirty: true,
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
    insta::assert_snapshot!(summary(&info, &Contents::of(&info, &results()), Path::new("results/table-3.2/index.html"), 100));
}
