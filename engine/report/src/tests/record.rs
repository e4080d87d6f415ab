//! Parts of a folder of results on the study as a whole: causes, verdicts for programs, the sentence, the row.

use super::{CLEAR, claim, info, one_environment, provenance, published, results, two_agents};
use crate::{Contents, StudyInfo, Verdicts, sentence, write};
use presentation::{
    claim_spec::ClaimSpec,
    summary::Summary,
    table::{Cause, Comparison, TableSpec},
};
use std::fs;

#[test]
fn causes_are_printed_where_something_differs_and_nowhere_else() {
    let study = |value: f64, text: &str| {
        let refuted = ClaimSpec {
            cause: Some("Both share *one* rate.".into()),
            ..claim(text)
        };
        let table = TableSpec {
            cause: Some(Cause::OfAll("The load is another.".into())),
            ..published(value)
        };
        one_environment(vec![refuted], table)
    };
    let texts = |study: &StudyInfo| {
        let results = two_agents(CLEAR, |_, _| {});
        let mut contents = Contents::of(study, &results);
        let dir = tempfile::tempdir().unwrap();
        let paths = write(dir.path(), study, &results, &mut contents, &provenance()).unwrap();
        [paths.markdown, paths.page].map(|path| fs::read_to_string(path).unwrap())
    };
    let [report, page] = texts(&study(99.0, "dsac.cycle_length < equal.cycle_length"));
    for cause in [
        "Cause: The load is another.",
        "Cause (`dsac.cycle_length < equal.cycle_length`): Both share \\*one\\* rate.",
    ] {
        assert_eq!(report.matches(cause).count(), 1, "{cause}: {report}");
    }
    let claim = "Cause (<code>dsac.cycle_length &lt; equal.cycle_length</code>): Both share *one* rate.";
    assert!(page.contains("Cause: The load is another.") && page.contains(claim));
    let exploratory = ClaimSpec {
        exploratory: true,
        ..study(99.0, "dsac.cycle_length < equal.cycle_length").claims[0].clone()
    };
    let [report, _] = texts(&one_environment(vec![exploratory], published(11.0)));
    assert_eq!(report.matches("Cause").count(), 1, "{report}");
    let [report, page] = texts(&study(11.0, "dsac.cycle_length > equal.cycle_length"));
    assert!(!report.contains("Cause") && !page.contains("Cause"), "{report}");
}

#[test]
fn verdicts_for_programs_have_causes_and_count_what_is_judged() {
    let refuted = ClaimSpec {
        cause: Some("one rate".into()),
        ..claim("dsac.cycle_length < equal.cycle_length")
    };
    let exploratory = ClaimSpec {
        exploratory: true,
        ..refuted.clone()
    };
    let table = TableSpec {
        cause: Some(Cause::OfAll("another load".into())),
        ..published(99.0)
    };
    let of_nobody = Comparison {
        agents: vec!["nobody".into()],
        ..Comparison::default()
    };
    let empty = TableSpec {
        published: table.published.clone(),
        ..TableSpec::of(of_nobody)
    };
    let mut study = one_environment(vec![refuted, exploratory], table);
    study.tables.push(("empty".into(), empty));
    let results = two_agents(CLEAR, |_, _| {});
    let verdicts = Verdicts::of(&study, &results, &Contents::of(&study, &results));
    let said: Vec<_> = verdicts
        .verdicts
        .iter()
        .map(|it| (it.about.as_str(), it.verdict.as_str(), it.cause.as_deref()))
        .collect();
    let text = "dsac.cycle_length < equal.cycle_length in four_cells";
    let claims = [1, 2].map(|number| format!("claim {number}: {text}"));
    assert_eq!(
        said,
        [
            ("t: dsac", "DIFFERS", Some("another load")),
            ("empty", "NOT MADE", None),
            (claims[0].as_str(), "REFUTED", Some("one rate")),
            (claims[1].as_str(), "REFUTED", Some("one rate")),
        ]
    );
    let counts = [
        verdicts.judged,
        verdicts.decided,
        verdicts.differing,
        verdicts.exploratory,
    ];
    assert_eq!(counts, [3, 2, 2, 1]);
}

/// A study with `text` as its sentence.
fn with_summary(text: &str) -> StudyInfo {
    StudyInfo {
        summary: Some(Summary::parse(text).unwrap()),
        options: Vec::new(),
        ..info()
    }
}

#[test]
fn a_sentence_is_filled_from_tables_and_claims() {
    let filled = |text: &str| sentence(&with_summary(text), &Contents::of(&info(), &results())).unwrap();
    assert_eq!(
        filled("{table-3.2: four_cells, dsac} of {table-3.2: four_cells, ddpg published}"),
        "16.4 of 15.2"
    );
    assert_eq!(
        filled("{table-3.2: four_cells, ddpg verdict}; {claim 1}; {claim 4}; {{}}"),
        "DIFFERS; SUPPORTED; NOT READ; {}"
    );
    // The lengths have no published value, one table could not be made, and a claim does not exist.
    assert_eq!(
        filled(
            "{lengths: equal, four_cells published} {lengths: equal, four_cells verdict} {empty: dsac} \
             {claim 9}"
        ),
        "– – – –"
    );
    let mut contents = Contents::of(&info(), &results());
    contents.claims[1].place = "eight_cells".into();
    contents.claims[1].verdict = Err("not read".into());
    assert_eq!(
        sentence(&with_summary("{claim 1}"), &contents).unwrap(),
        "SUPPORTED in four_cells, NOT READ in eight_cells"
    );
    assert_eq!(sentence(&with_summary("a\nb"), &contents).unwrap(), "a b");
}
