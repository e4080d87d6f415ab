//! The legend above the panels: outside, so that it hides no data.

use super::{
    axes::TEXT,
    chart::{Chart, Series},
    layout::text,
    paint::{Align, Mark, text_width},
};
use std::collections::BTreeSet;

const GAP: f64 = 12.0;
const LINE: f64 = 11.0;

/// Draws the legend centred in the width, in as many lines as it needs; returns its height, 0 without
/// entries.
pub(super) fn draw(chart: &Chart, width: f64, marks: &mut Vec<Mark>) -> f64 {
    let lines = lines(&entries(chart), width - 8.0);
    let mut y = LINE / 2.0 + 2.0;
    for line in &lines {
        let used: f64 = line
            .iter()
            .map(|(series, entry)| entry_width(series, entry))
            .sum::<f64>()
            - GAP;
        let mut x = ((width - used) / 2.0).max(4.0);
        for (series, entry) in line {
            let form = series.shape.form();
            marks.extend(form.sample(series.style, (x, y)));
            marks.push(text((x + form.sample_width() + 4.0, y), entry, Align::Left));
            x += entry_width(series, entry);
        }
        y += LINE;
    }
    if lines.is_empty() {
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

fn lines<'a>(entries: &[(&'a Series, String)], width: f64) -> Vec<Vec<(&'a Series, String)>> {
    let mut lines: Vec<Vec<(&Series, String)>> = Vec::new();
    let mut used = f64::INFINITY;
    for (series, entry) in entries {
        let room = entry_width(series, entry);
        if used + room - GAP > width {
            lines.push(Vec::new());
            used = 0.0;
        }
        used += room;
        if let Some(line) = lines.last_mut() {
            line.push((*series, entry.clone()));
        }
    }
    lines
}

fn entry_width(series: &Series, entry: &str) -> f64 {
    series.shape.form().sample_width() + 4.0 + text_width(entry, TEXT) + GAP
}
