//! Charts with more lines than a legend can name: the best keep their colours and names, the rest are grey.

use super::chart::{Chart, Hue, Panel, Series, Style};
use contract::Better;
use statistics::estimators::mean;

/// Largest number of names in a legend: the number of colours.
const MOST_NAMED: usize = 8;
/// Number of best lines that keep their names in a chart with more lines than that.
const KEPT: usize = 5;

/// Makes all but the best lines grey if a chart has too many names, and returns a sentence on it. Levels, agents that
/// do not learn and published curves keep their colours, since readers compare lines with them. With several panels,
/// lines are compared by their mean rank.
pub fn name_the_best(chart: &mut Chart, better: Better) -> Option<String> {
    let lines = names(chart, is_line);
    if names(chart, |_| true).len() <= MOST_NAMED || lines.len() <= KEPT {
        return None;
    }
    let ranks: Vec<Vec<usize>> = chart
        .panels
        .iter()
        .map(|panel| ranks(panel, &lines, better))
        .collect();
    let mut ranked: Vec<usize> = (0..lines.len()).collect();
    ranked.sort_by_key(|line| ranks.iter().map(|of_panel| of_panel[*line]).sum::<usize>());
    let others: Vec<&String> = ranked[KEPT..].iter().map(|line| &lines[*line]).collect();
    for series in chart.panels.iter_mut().flat_map(|panel| &mut panel.series) {
        if is_line(series) && others.contains(&&series.label) {
            series.style = Style {
                hue: Hue::Other,
                variant: 0,
            };
        }
    }
    let which = match better {
        Better::Higher => "largest",
        Better::Lower => "smallest",
    };
    let by = if chart.panels.len() > 1 {
        " (by their mean rank over the panels)"
    } else {
        ""
    };
    Some(format!(
        "The {KEPT} lines with the {which} last values{by} have colours and names; {} others are grey, without their \
         seeds.",
        others.len()
    ))
}

/// Whether a series is a line that may become grey.
fn is_line(series: &Series) -> bool {
    series.shape.form().is_dimmable()
}

/// The names of some series, each once.
fn names(chart: &Chart, is: fn(&Series) -> bool) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for series in chart.panels.iter().flat_map(|panel| &panel.series) {
        if is(series) && !series.label.is_empty() && !names.contains(&series.label) {
            names.push(series.label.clone());
        }
    }
    names
}

/// The rank of each line of a panel by the mean of the last values of its name: the number of better lines. A line
/// without a value is ranked last.
fn ranks(panel: &Panel, lines: &[String], better: Better) -> Vec<usize> {
    let merit = |name: &String| {
        let named = panel
            .series
            .iter()
            .filter(|series| is_line(series) && series.label == *name);
        let values: Vec<f64> = named.filter_map(|series| series.shape.last_value()).collect();
        let sign = if better == Better::Higher { 1.0 } else { -1.0 };
        (!values.is_empty()).then(|| sign * mean(&values))
    };
    let merits: Vec<Option<f64>> = lines.iter().map(merit).collect();
    let rank = |one: &Option<f64>| match one {
        Some(one) => merits.iter().flatten().filter(|other| *other > one).count(),
        None => lines.len(),
    };
    merits.iter().map(rank).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::{Point, Shape, legend_names};

    fn line(label: &str, last: f64) -> Series {
        let point = |x: f64, y: f64| Point { x, y, interval: None };
        Series {
            label: label.into(),
            seeds: None,
            style: Style::of_agent(0),
            shape: Shape::Line(vec![point(0.0, 0.0), point(1.0, last)]),
        }
    }

    fn chart(panels: &[&[(&str, f64)]]) -> Chart {
        let panel = |lines: &&[(&str, f64)]| Panel {
            series: lines.iter().map(|(label, last)| line(label, *last)).collect(),
            ..Panel::default()
        };
        Chart {
            panels: panels.iter().map(panel).collect(),
            columns: 1,
            ..Chart::default()
        }
    }

    const NINE: [(&str, f64); 9] = [
        ("a", 1.0),
        ("b", 9.0),
        ("c", 2.0),
        ("d", 8.0),
        ("e", 3.0),
        ("f", 7.0),
        ("g", 4.0),
        ("h", 6.0),
        ("i", 5.0),
    ];

    #[test]
    fn the_best_of_nine_lines_keep_their_names_in_their_order() {
        let mut most = chart(&[&NINE]);
        let note = name_the_best(&mut most, Better::Higher).unwrap();
        assert!(
            note.starts_with("The 5 lines with the largest last values have colours"),
            "{note}"
        );
        assert_eq!(legend_names(&most), ["b", "d", "f", "h", "i", "4 others"]);
        let mut least = chart(&[&NINE]);
        name_the_best(&mut least, Better::Lower).unwrap();
        assert_eq!(legend_names(&least), ["a", "c", "e", "g", "i", "4 others"]);
    }

    #[test]
    fn eight_names_fit() {
        let mut eight = chart(&[&NINE[..8]]);
        assert_eq!(name_the_best(&mut eight, Better::Higher), None);
        assert_eq!(legend_names(&eight).len(), 8);
    }

    #[test]
    fn levels_keep_their_names_whatever_they_are() {
        let mut with_levels = chart(&[&NINE]);
        let level = Series {
            shape: Shape::Level(-1.0),
            ..line("floor", 0.0)
        };
        with_levels.panels[0].series.insert(0, level);
        name_the_best(&mut with_levels, Better::Higher).unwrap();
        assert_eq!(legend_names(&with_levels)[0], "floor");
    }

    #[test]
    fn over_panels_the_mean_rank_counts_and_a_missing_line_is_last() {
        let other: Vec<(&str, f64)> = NINE.iter().map(|(name, last)| (*name, -100.0 * last)).collect();
        // The sum of ranks is the same for all lines except `i`, which is in one panel only.
        let mut two = chart(&[&NINE, &other[..8]]);
        let note = name_the_best(&mut two, Better::Higher).unwrap();
        assert!(note.contains("mean rank over the panels"), "{note}");
        assert!(!legend_names(&two).contains(&"i".to_owned()));
    }
}
