//! The legend above the panels: outside, so that it hides no data.

use super::{
    axes::{TEXT, break_lines},
    category_labels::shortened,
    chart::{Chart, Series},
    layout::{count, text},
    paint::{Align, Mark, text_width},
};
use std::collections::BTreeSet;

const GAP: f64 = 12.0;
const LINE: f64 = 11.0;

/// One entry in its lines; one that is longer than the figure is broken between words.
struct Entry<'a> {
    series: &'a Series,
    texts: Vec<String>,
}

impl<'a> Entry<'a> {
    /// An entry that is no wider than `width` points.
    fn of(series: &'a Series, text: String, width: f64) -> Self {
        let room = width - series.shape.form().sample_width() - 4.0;
        let texts = if text_width(&text, TEXT) <= room {
            vec![text]
        } else {
            let lines = break_lines(&text, room);
            lines.iter().map(|line| shortened(line, room)).collect()
        };
        Self { series, texts }
    }

    /// Its width with the gap after it, in points.
    fn width(&self) -> f64 {
        let widths = self.texts.iter().map(|text| text_width(text, TEXT));
        self.series.shape.form().sample_width() + 4.0 + widths.fold(0.0, f64::max) + GAP
    }
}

/// Draws the legend centred in the width, in as many lines as it needs; returns its height, 0 without
/// entries.
pub(super) fn draw(chart: &Chart, width: f64, marks: &mut Vec<Mark>) -> f64 {
    let rows = rows(entries(chart), width - 8.0);
    let mut y = LINE / 2.0 + 2.0;
    for row in &rows {
        let used: f64 = row.iter().map(Entry::width).sum::<f64>() - GAP;
        let mut x = ((width - used) / 2.0).max(4.0);
        for entry in row {
            let form = entry.series.shape.form();
            marks.extend(form.sample(entry.series.style, (x, y)));
            for (index, line) in entry.texts.iter().enumerate() {
                let at = (x + form.sample_width() + 4.0, y + LINE * count(index));
                marks.push(text(at, line, Align::Left));
            }
            x += entry.width();
        }
        let lines = row.iter().map(|entry| entry.texts.len()).max().unwrap_or(1);
        y += LINE * count(lines);
    }
    if rows.is_empty() {
        0.0
    } else {
        y - LINE / 2.0 + 2.0
    }
}

/// One entry per name and look, and one for all lines that are grey in a crowded chart. If panels differ in the number
/// of seeds, the entry has the range.
pub(super) fn entries(chart: &Chart) -> Vec<(&Series, String)> {
    let mut groups: Vec<Vec<&Series>> = Vec::new();
    for series in chart
        .panels
        .iter()
        .flat_map(|panel| &panel.series)
        .filter(|series| !series.label.is_empty() && !series.is_other())
    {
        let look = |series: &Series| {
            (
                series.label.clone(),
                series.style,
                series.shape.form().is_published(),
            )
        };
        let same = |group: &&mut Vec<&Series>| look(group[0]) == look(series);
        match groups.iter_mut().find(same) {
            Some(group) => group.push(series),
            None => groups.push(vec![series]),
        }
    }
    groups
        .into_iter()
        .map(|group| (first_line(&group), name(&group)))
        .chain(others(chart))
        .collect()
}

/// One of the grey lines, with the number of their names; `None` if no line is grey.
fn others(chart: &Chart) -> Option<(&Series, String)> {
    let series = chart.panels.iter().flat_map(|panel| &panel.series);
    let others: Vec<&Series> = series.filter(|series| series.is_other()).collect();
    let names: BTreeSet<&str> = others.iter().map(|series| series.label.as_str()).collect();
    let first = others.first()?;
    Some((first, format!("{} others", names.len())))
}

/// The first line of a group, or a reference if the group has no line, so that the sample shows the dash.
fn first_line<'a>(group: &[&'a Series]) -> &'a Series {
    group
        .iter()
        .copied()
        .find(|series| !series.shape.form().is_reference())
        .unwrap_or(group[0])
}

fn name(group: &[&Series]) -> String {
    let counts = || group.iter().filter_map(|series| series.seeds).map(|(n, _)| n);
    match (counts().min(), counts().max()) {
        (Some(low), Some(high)) if low < high => format!("{} (n = {low} to {high})", group[0].label),
        _ => group[0].legend(),
    }
}

fn rows(entries: Vec<(&Series, String)>, width: f64) -> Vec<Vec<Entry<'_>>> {
    let mut rows: Vec<Vec<Entry<'_>>> = Vec::new();
    let mut used = f64::INFINITY;
    for (series, text) in entries {
        let entry = Entry::of(series, text, width);
        let room = entry.width();
        if used + room - GAP > width {
            rows.push(Vec::new());
            used = 0.0;
        }
        used += room;
        if let Some(row) = rows.last_mut() {
            row.push(entry);
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::{Panel, Shape, Style};

    #[test]
    fn an_entry_longer_than_the_figure_is_broken_and_a_long_word_loses_its_middle() {
        const WIDTH: f64 = 241.0;
        let label = format!("sac, {} batch_size=256, width=64", "x".repeat(90));
        let series = |label: &str| Series {
            label: label.into(),
            seeds: Some((3, 3)),
            style: Style::default(),
            shape: Shape::Line(Vec::new()),
        };
        let chart = Chart {
            panels: vec![Panel {
                series: vec![series(&label), series("rule")],
                ..Panel::default()
            }],
            columns: 1,
            ..Chart::default()
        };
        let mut marks = Vec::new();
        let height = draw(&chart, WIDTH, &mut marks);
        let texts: Vec<(f64, f64, &str)> = marks
            .iter()
            .filter_map(|mark| match mark {
                Mark::Text { at, text, .. } => Some((at.0, at.1, text.as_str())),
                _ => None,
            })
            .collect();
        assert!(
            texts
                .iter()
                .all(|(x, _, text)| x + text_width(text, TEXT) <= WIDTH - 3.9)
        );
        let words: Vec<&str> = texts.iter().map(|(.., text)| *text).collect();
        assert_eq!(words[0], "sac,");
        assert!(words[1].contains('…'), "{words:?}");
        assert_eq!(words[2..], ["batch_size=256, width=64 (n = 3)", "rule (n = 3)"]);
        assert!(texts.windows(2).all(|pair| pair[1].1 - pair[0].1 > LINE - 1e-9));
        assert!(height > 4.0 * LINE);
    }
}
