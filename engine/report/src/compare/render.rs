//! Differences between two sides, as aligned text and as Markdown.

use super::{CellValues, Compared, Fate, LEVEL, Named, Pair, Setting};
use presentation::table::{NumberFormat, align, escape_markdown, markdown_row, wrap};
use serde_json::Value;

/// Most characters of a setting; longer ones are cut.
const LONGEST: usize = 60;

/// A heading over a table; the first `words` columns are words.
struct Section {
    title: String,
    head: Vec<&'static str>,
    words: usize,
    rows: Vec<Vec<String>>,
}

/// Aligned text for a terminal of `width` columns. Cells within their intervals are listed only with `all`.
#[must_use]
pub fn text(compared: &Compared, all: bool, width: usize) -> String {
    let mut out = vec![sides(compared).join("\n")];
    for section in sections(compared, all) {
        let head: Vec<String> = section.head.iter().map(|word| (*word).to_owned()).collect();
        let left: Vec<bool> = (0..head.len()).map(|column| column < section.words).collect();
        let lines: Vec<Vec<String>> = std::iter::once(head).chain(section.rows).collect();
        out.push(format!("{}:\n{}", section.title, align(&lines, &left).trim_end()));
    }
    out.push(wrap(&summary(compared), width));
    out.join("\n\n")
}

/// The comparison as a Markdown document, with all cells where `all` is set.
#[must_use]
pub fn markdown(compared: &Compared, all: bool) -> String {
    let mut out = vec![
        "# Comparison".to_owned(),
        sides(compared).map(|side| escape_markdown(&side)).join("  \n"),
    ];
    out.push(summary(compared));
    for section in sections(compared, all) {
        let rule = |column: usize| if column < section.words { "---" } else { "--:" };
        let rules: Vec<&str> = (0..section.head.len()).map(rule).collect();
        let rows = section
            .rows
            .iter()
            .map(|row| markdown_row(row.iter().map(|entry| escape_markdown(entry))));
        let lines: Vec<String> = [
            markdown_row(section.head.iter().map(|word| (*word).to_owned())),
            format!("|{}|", rules.join("|")),
        ]
        .into_iter()
        .chain(rows)
        .collect();
        out.push(format!("## {}\n\n{}", section.title, lines.join("\n")));
    }
    out.join("\n\n") + "\n"
}

fn sides(compared: &Compared) -> [String; 2] {
    let side = |letter: &str, named: &Named| {
        let options = named.options.iter().map(|option| format!(" {option}"));
        format!(
            "{letter}: {} (study {}{})",
            named.from,
            named.study,
            options.collect::<String>()
        )
    };
    [side("A", &compared.a), side("B", &compared.b)]
}

/// The sections with content.
fn sections(compared: &Compared, all: bool) -> Vec<Section> {
    let cells = |title: &str, fates: &[Fate]| {
        let those = compared
            .cells
            .iter()
            .filter(|pair| fates.contains(&pair.difference.fate));
        Section {
            title: title.into(),
            head: vec![
                "table", "row", "column", "by", "seeds", "A", "B", "B - A", "interval",
            ],
            words: 4,
            rows: those.map(cell).collect(),
        }
    };
    let changed = |title: &str, changed: &[super::ChangedVerdict]| Section {
        title: title.into(),
        head: vec!["about", "A", "B"],
        words: 3,
        rows: changed
            .iter()
            .map(|it| vec![it.about.clone(), it.a.clone(), it.b.clone()])
            .collect(),
    };
    let only = compared
        .only
        .iter()
        .map(|it| vec![it.side.to_uppercase(), it.kind.into(), it.what.clone()]);
    let unmoved = if all { &[Fate::Within, Fate::Same][..] } else { &[] };
    let mut sections = vec![
        cells("Cells that moved", &[Fate::Moved]),
        cells("Cells that differ, without an interval", &[Fate::Undecided]),
        cells("Other cells", unmoved),
        changed("Verdicts that changed", &compared.verdicts),
        changed("Claims that changed", &compared.claims),
        Section {
            title: "On one side only".into(),
            head: vec!["side", "kind", "what"],
            words: 3,
            rows: only.collect(),
        },
        Section {
            title: "Settings that differ".into(),
            head: vec!["key", "A", "B"],
            words: 3,
            rows: compared.settings.iter().map(setting).collect(),
        },
    ];
    sections.retain(|section| !section.rows.is_empty());
    sections
}

fn cell(pair: &Pair) -> Vec<String> {
    let difference = &pair.difference;
    let ends = difference.interval.map(|interval| [interval.low, interval.high]);
    let values = [pair.a.value, pair.b.value].into_iter().flatten();
    let format = NumberFormat::fitting(values.chain([difference.difference]));
    let write = |value: Option<f64>| value.map_or_else(String::new, |value| format.write(value));
    // A difference may be much smaller than the values.
    let small = NumberFormat::fitting(ends.into_iter().flatten().chain([difference.difference]));
    vec![
        pair.place.table.clone(),
        pair.place.row.clone(),
        pair.place.column.clone(),
        difference.basis.map_or("", super::Basis::name).into(),
        seeds(&pair.a, &pair.b),
        write(pair.a.value),
        write(pair.b.value),
        small.write(difference.difference),
        ends.map_or_else(String::new, |[low, high]| {
            format!("[{}, {}]", small.write(low), small.write(high))
        }),
    ]
}

fn seeds(a: &CellValues, b: &CellValues) -> String {
    match (a.seeds.len(), b.seeds.len()) {
        (0, 0) => String::new(),
        (a, b) if a == b => a.to_string(),
        (a, b) => format!("{a}, {b}"),
    }
}

fn setting(setting: &Setting) -> Vec<String> {
    let word = |value: &Option<Value>| {
        let text = match value {
            None => "–".to_owned(),
            Some(Value::String(text)) => text.clone(),
            Some(value) => value.to_string(),
        };
        if text.chars().count() > LONGEST {
            format!("{}…", text.chars().take(LONGEST).collect::<String>())
        } else {
            text
        }
    };
    vec![setting.key.clone(), word(&setting.a), word(&setting.b)]
}

/// The comparison in sentences.
fn summary(compared: &Compared) -> String {
    let counts = compared.counts;
    let open = counts.moved + counts.within;
    let mut text = format!(
        "Of {} cells that both have, {} moved, {} stayed within the interval of the difference, {} are the same for \
         every seed",
        compared.cells.len(),
        counts.moved,
        counts.within,
        counts.same,
    );
    if counts.undecided > 0 {
        text += &format!(
            ", {} differ and have too few seeds for an interval",
            counts.undecided
        );
    }
    text += &format!(
        ". Of {} verdicts and claims that both have, {} changed.",
        counts.judged,
        compared.verdicts.len() + compared.claims.len()
    );
    if open > 0 {
        text += &format!(
            " Each interval is one of {:.0} %: of {open} cells that differ in nothing but chance, about {:.1} would \
             move.",
            100.0 * LEVEL,
            (1.0 - LEVEL) * f64::from(u32::try_from(open).unwrap_or(u32::MAX))
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::{CellAddress, Side};
    use serde_json::json;

    fn side(letter: &str, values: &[f64], discount: f64) -> Side {
        let place = |row: &str| CellAddress {
            table: "table-1".into(),
            row: row.into(),
            column: "return".into(),
        };
        let measured = |values: Vec<f64>| CellValues {
            statistic: "mean".into(),
            value: Some(statistics::estimators::mean(&values)),
            seeds: (0..).zip(values).collect(),
            interval: None,
        };
        let still: Vec<f64> = values
            .iter()
            .enumerate()
            .map(|(place, value)| value * (-1f64).powi(i32::try_from(place).unwrap()))
            .collect();
        Side {
            named: Named {
                from: letter.into(),
                study: "small".into(),
                options: vec!["--seeds 3".into()],
            },
            cells: [
                (place("dsac"), measured(values.to_vec())),
                (place("still"), measured(still)),
            ]
            .into(),
            settings: super::super::flat(
                &json!({"agents": {"x": {"discount": discount, "text": "x".repeat(80)}}}),
            ),
            verdicts: Vec::new(),
        }
    }

    #[test]
    fn text_and_markdown_show_what_moved() {
        let a = side("first", &[1.0, 2.0, 3.0, 4.0], 0.9);
        let b = side("second", &[2.0, 3.1, 4.0, 5.1], 0.99);
        let compared = Compared::of(&a, &b);
        let text = text(&compared, false, 100);
        for part in [
            "A: first (study small --seeds 3)\n",
            "Cells that moved:\n",
            "agents.x.discount  0.9  0.99",
            "Of 2 cells that both have, 1 moved, 1 stayed",
            "about 0.1 would",
        ] {
            assert!(text.contains(part), "{part}\n{text}");
        }
        let line = text.lines().find(|line| line.contains("dsac")).unwrap();
        let words: Vec<&str> = line.split_whitespace().collect();
        assert_eq!(
            words[..8],
            [
                "table-1", "dsac", "return", "paired", "4", "2.500", "3.550", "1.050"
            ]
        );
        assert!(!text.contains("still"), "{text}");
        assert!(super::text(&compared, true, 100).contains("still"));
        let page = markdown(&compared, false);
        assert!(
            page.contains("## Cells that moved\n\n| table | row |") && page.ends_with("|\n"),
            "{page}"
        );
    }

    #[test]
    fn long_settings_are_cut() {
        let row = setting(&Setting {
            key: "k".into(),
            a: Some(json!("y".repeat(80))),
            b: None,
        });
        assert_eq!(row[1].chars().count(), LONGEST + 1);
        assert_eq!(row[2], "–");
    }
}
