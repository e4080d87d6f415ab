//! Tables typeset as studies ask, by snapshot and by LaTeX itself if it is installed.

use super::*;
use crate::table::{
    Aggregate, Axis, Comparison, PublishedCell, PublishedRow, TableSpec, build, tests::improvement,
};
use serde_json::json;
use std::{collections::BTreeMap, fs, process::Command};
use testing::synthetic::study;

#[path = "../../../../../tests/skipped.rs"]
mod skipped;

fn layout(options: serde_json::Value) -> LatexLayout {
    serde_json::from_value(options).unwrap()
}

fn set(spec: TableSpec, options: serde_json::Value) -> String {
    let spec = TableSpec {
        latex: Some(layout(options)),
        ..spec
    };
    latex(&build(&spec, &study()).unwrap(), "table-1")
}

/// Aggregates with a published mean; less is better in one column.
fn aggregates() -> TableSpec {
    let kind = json!({
        "value": "cycle_length", "normalise": { "low": "equal", "high": "bound" }, "relative_to": "ddpg",
        "profile_at": [0.25, 0.5, 0.75],
    });
    TableSpec {
        caption: "Scores of τ ≥ 0.25, of `two` environments".into(),
        published: BTreeMap::from([(
            "dsac".into(),
            PublishedRow::Columns(BTreeMap::from([("mean".into(), PublishedCell::Value(0.61))])),
        )]),
        ..TableSpec::of::<Aggregate>(serde_json::from_value(kind).unwrap())
    }
}

fn comparison() -> TableSpec {
    TableSpec {
        caption: "Cycle lengths".into(),
        ..TableSpec::of(Comparison {
            value: "cycle_length".into(),
            rows: Axis::Agent.into(),
            ..Comparison::default()
        })
    }
}

/// A table of each form, with its name.
fn forms() -> Vec<(&'static str, String)> {
    let compact = json!({
        "bold_best": true, "better": "higher", "value": "half_width", "verdicts": false, "align_decimals": true,
    });
    let small = json!({ "value": "small_interval", "align_decimals": true, "text_width_mm": 90.0 });
    let turned = json!({ "wide": "turn", "bold_best": true, "value": "small_interval" });
    let alone = json!({ "value": "alone", "bold_best": true, "better": "lower", "best_of": "column" });
    vec![
        ("compact", set(improvement(), compact.clone())),
        ("split", set(improvement(), small)),
        ("turned", set(aggregates(), turned)),
        ("alone", set(comparison(), alone)),
        ("compact_comparison", set(comparison(), compact)),
    ]
}

#[test]
fn tables_are_set_as_studies_ask() {
    for (name, text) in forms() {
        insta::assert_snapshot!(name, text);
    }
}

#[test]
fn a_table_without_options_is_set_as_it_was() {
    let plain = latex(&build(&improvement(), &study()).unwrap(), "table-1");
    assert_eq!(plain, set(improvement(), json!({ "wide": "keep" })));
}

#[test]
fn what_is_too_wide_is_split_or_turned_and_every_part_has_the_headings_of_the_rows() {
    let parts = |text_width_mm: f64| {
        let text = set(aggregates(), json!({ "text_width_mm": text_width_mm }));
        (
            text.matches("\\begin{tabular}").count(),
            text.matches("    agent & ").count(),
        )
    };
    assert_eq!(parts(1000.0), (1, 1));
    let (tabulars, headings) = parts(100.0);
    assert!(tabulars > 2 && headings == tabulars, "{tabulars}");
    // A published value and its verdict stay beside the value.
    let text = set(aggregates(), json!({ "text_width_mm": 40.0 }));
    let with_published: Vec<&str> = text.lines().filter(|line| line.contains("published")).collect();
    assert!(
        with_published[0].contains("agent & mean & published & verdict"),
        "{text}"
    );
    let turned = |text_width_mm: f64| {
        let options = json!({ "wide": "turn", "text_width_mm": text_width_mm, "text_height_mm": 1000.0 });
        let text = set(aggregates(), options);
        (
            text.contains("sidewaystable"),
            text.matches("\\begin{tabular}").count(),
        )
    };
    assert_eq!((turned(100.0), turned(1000.0)), ((true, 1), (false, 1)));
}

/// Every form goes through `pdflatex`, and no line is wider than the text.
#[test]
fn latex_sets_every_form() {
    let is_there = Command::new("pdflatex").arg("--version").output();
    if !is_there.is_ok_and(|output| output.status.success()) {
        let remedy = "`apt-get install texlive-latex-recommended` installs it";
        return skipped::skip("`pdflatex` is not on the path", remedy);
    }
    let tables: String = forms()
        .into_iter()
        .map(|(_, text)| text + "\\clearpage\n")
        .collect();
    let dir = tempfile::tempdir().unwrap();
    let document = format!(
        "\\documentclass{{article}}\n\\usepackage{{booktabs,rotating}}\n\\begin{{document}}\n{tables}\\end{{document}}\n"
    );
    fs::write(dir.path().join("tables.tex"), document).unwrap();
    let output = Command::new("pdflatex")
        .args(["-interaction=nonstopmode", "-halt-on-error", "tables.tex"])
        .current_dir(dir.path())
        .output()
        .unwrap();
    let log = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{log}");
    assert!(!log.contains("Overfull"), "{log}");
    assert!(
        fs::read(dir.path().join("tables.pdf"))
            .unwrap()
            .starts_with(b"%PDF")
    );
}

#[test]
fn signs_and_special_characters() {
    use typeset::signs;
    assert_eq!(signs(&escape("-1.5 [-2, 1e-5]")), "$-$1.5 [$-$2, 1e$-$5]");
    assert_eq!(signs(&escape("–")), "--");
    assert_eq!(escape("τ ≥ \u{2212}1"), "$\\tau$ $\\ge$ $-$1");
    assert_eq!(
        escape("a_b & 5 % of {c} ~ d^2 \\ #1 $"),
        "a\\_b \\& 5 \\% of \\{c\\} \\textasciitilde{} d\\textasciicircum{}2 \\textbackslash{} \\#1 \\$"
    );
}
