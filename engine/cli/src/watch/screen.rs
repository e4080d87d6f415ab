//! A view in a terminal of any size, and as plain text.

use super::{
    Panel, RunningView, StudyView, View,
    looks::Looks,
    running::{bar, running_lines},
    short::shortened,
};
use presentation::table::NumberFormat;
use ratatui::{
    Frame, Terminal,
    backend::TestBackend,
    layout::{Constraint, Layout, Rect},
    style::{Color, Modifier, Style},
    symbols::Marker,
    text::{Line, Span},
    widgets::{Axis, Chart, Dataset, GraphType, Paragraph},
};

/// The part of a view that is shown.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Focus {
    /// Number of the panel, taken modulo the number of panels.
    pub panel: usize,
    /// Number of the metric, taken modulo the number of metrics.
    pub metric: usize,
    /// Number of running trials to skip.
    pub scroll: usize,
    /// Whether agents have colours; without them they have marks.
    pub colours: bool,
    /// Whether keys are explained.
    pub keys: bool,
}

/// The smallest area in which curves can be read.
const LEAST_CURVES: (u16, u16) = (24, 6);
/// Width of the bar of a study, in columns.
const BAR: usize = 20;
const KEYS: &str = "q leave   ←→ environment   m metric   ↑↓ running trials";

/// Draws a view.
pub fn draw(frame: &mut Frame<'_>, view: &View, choice: Focus) {
    let area = frame.area();
    let head = head(view, choice, usize::from(area.width));
    let running: Vec<&RunningView> = view.studies.iter().flat_map(|study| &study.running).collect();
    // The head comes first, then as many running trials as fit with the curves.
    let lines = |count: usize| u16::try_from(count).unwrap_or(u16::MAX);
    let keys = u16::from(choice.keys && area.height > 2);
    let free = area.height.saturating_sub(lines(head.len()) + keys);
    let most = if free >= 2 * LEAST_CURVES.1 {
        free / 2
    } else {
        free.saturating_sub(LEAST_CURVES.1 + 1)
    };
    let shown = if running.is_empty() {
        0
    } else {
        lines(running.len() + 1).min(most.max(free.min(2)))
    };
    let [top, middle, rest, bottom] = Layout::vertical([
        Constraint::Length(lines(head.len())),
        Constraint::Length(shown),
        Constraint::Min(0),
        Constraint::Length(keys),
    ])
    .areas(area);
    frame.render_widget(Paragraph::new(head), top);
    let metric = metric(view, choice);
    frame.render_widget(
        Paragraph::new(running_lines(&running, metric, choice.scroll, middle)),
        middle,
    );
    curves(frame, view, choice, rest);
    frame.render_widget(
        Paragraph::new(KEYS).style(Style::new().add_modifier(Modifier::DIM)),
        bottom,
    );
}

/// A view as text of `width` columns, without colours.
#[must_use]
pub fn plain(view: &View, width: u16) -> String {
    let running: usize = view.studies.iter().map(|study| study.running.len()).sum();
    let curves = if view.panels().next().is_some() { 22 } else { 0 };
    let notes: usize = view.studies.iter().map(|study| study.notes.len()).sum();
    let height = 3 * view.studies.len() + notes + running.min(20) + curves + 2;
    let height = u16::try_from(height).unwrap_or(u16::MAX);
    let text = drawn(view, Focus::default(), (width, height));
    text.trim_end().to_owned()
}

/// The lines in a terminal of this size.
fn drawn(view: &View, choice: Focus, (width, height): (u16, u16)) -> String {
    // Drawing into a buffer in memory cannot fail.
    let Ok(mut terminal) = Terminal::new(TestBackend::new(width, height));
    let Ok(_) = terminal.draw(|frame| draw(frame, view, choice));
    let buffer = terminal.backend().buffer();
    let line = |y: u16| {
        let cells = (0..width).filter_map(|x| buffer.cell((x, y)));
        cells.map(ratatui::buffer::Cell::symbol).collect::<String>()
    };
    (0..height)
        .map(|y| line(y).trim_end().to_owned() + "\n")
        .collect()
}

/// The metric that is shown; empty if none is recorded.
fn metric(view: &View, choice: Focus) -> &str {
    match view.metrics.as_slice() {
        [] => "",
        all => &all[choice.metric % all.len()],
    }
}

/// Two or three lines for each study, and the files that could not be read.
fn head(view: &View, choice: Focus, width: usize) -> Vec<Line<'static>> {
    let bold = Style::new().add_modifier(Modifier::BOLD);
    let alarm = if choice.colours {
        Style::new().fg(Color::Red)
    } else {
        Style::new()
    };
    let mut lines = Vec::new();
    for study in &view.studies {
        let (done, all) = (study.done(), study.trials);
        lines.push(Line::from(vec![
            Span::styled(study.name.clone(), bold),
            Span::raw(format!("  {} {done}/{all} trials", bar(part(done, all), BAR))),
        ]));
        lines.push(Line::raw(format!("  {}", study.summary())));
        lines.extend(best(view, study, choice, width));
        lines.extend(
            study
                .notes
                .iter()
                .map(|note| Line::styled(format!("  {note}"), alarm)),
        );
    }
    lines
}

/// Best agent of the shown panel if the study has it, otherwise of the study's first panel.
fn best(view: &View, study: &StudyView, choice: Focus, width: usize) -> Option<Line<'static>> {
    let metric = metric(view, choice);
    let panels: Vec<_> = view.panels().collect();
    let shown = panels.get(choice.panel.checked_rem(panels.len())?);
    let own = shown.filter(|(of, _)| std::ptr::eq(*of, study));
    let (_, panel) = own.or_else(|| panels.iter().find(|(of, _)| std::ptr::eq(*of, study)))?;
    let best = view.best(panel, metric)?;
    let value = format!(": {metric} {}", best.in_words());
    let room = width.saturating_sub("  best so far ".len() + value.chars().count());
    let name = shortened(&[best.name], room).concat();
    Some(Line::raw(format!("  best so far {name}{value}")))
}

fn part(done: usize, all: usize) -> Option<f64> {
    #[allow(clippy::cast_precision_loss, reason = "it is shown in a bar")]
    let part = done as f64 / all as f64;
    part.is_finite().then_some(part)
}

/// The curves of the chosen panel and metric, under their legend.
fn curves(frame: &mut Frame<'_>, view: &View, choice: Focus, area: Rect) {
    let panels: Vec<_> = view.panels().collect();
    if panels.is_empty()
        || view.metrics.is_empty()
        || area.width < LEAST_CURVES.0
        || area.height < LEAST_CURVES.1
    {
        return;
    }
    let (study, panel) = panels[choice.panel % panels.len()];
    let metric = &view.metrics[choice.metric % view.metrics.len()];
    let study = if view.studies.len() > 1 {
        format!("{}, ", study.name)
    } else {
        String::new()
    };
    let title = format!("{study}{}: {metric}, every seed", panel.title());
    let looks = Looks::of(view, panel, metric, choice.colours);
    let legend = looks.legend(usize::from(area.width));
    let lines = u16::try_from(legend.len())
        .unwrap_or(u16::MAX)
        .clamp(1, (area.height / 3).max(1));
    let [top, names, rest] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Length(lines),
        Constraint::Min(0),
    ])
    .areas(area);
    frame.render_widget(
        Paragraph::new(title).style(Style::new().add_modifier(Modifier::BOLD)),
        top,
    );
    frame.render_widget(Paragraph::new(legend), names);
    chart(frame, panel, metric, &looks, rest);
}

fn chart(frame: &mut Frame<'_>, panel: &Panel, metric: &str, looks: &Looks<'_>, area: Rect) {
    let Some([x, y]) = panel.bounds(metric) else {
        return;
    };
    #[allow(clippy::cast_precision_loss, reason = "steps are far below 2^52")]
    let points = |curve: &Vec<(u64, f64)>| -> Vec<(f64, f64)> {
        curve.iter().map(|(step, value)| (*step as f64, *value)).collect()
    };
    let lines = panel.lines.iter().filter_map(|line| {
        let is_named = looks.has_name(line.agent);
        Some((
            is_named,
            looks.of_agent(line.agent)?,
            points(line.curves.get(metric)?),
        ))
    });
    let mut lines: Vec<(bool, (Marker, Style), Vec<(f64, f64)>)> = lines.collect();
    // Lines without a name are drawn below the others.
    lines.sort_by_key(|(is_named, ..)| *is_named);
    let datasets = lines.iter().map(|(_, (marker, style), points)| {
        let graph = if points.len() > 1 {
            GraphType::Line
        } else {
            GraphType::Scatter
        };
        Dataset::default()
            .marker(*marker)
            .graph_type(graph)
            .style(*style)
            .data(points)
    });
    let axis = |(low, high): (f64, f64), format: NumberFormat| {
        let labels = [low, f64::midpoint(low, high), high].map(|value| format.write(value));
        Axis::default().bounds([low, high]).labels(labels)
    };
    frame.render_widget(
        Chart::new(datasets.collect())
            .x_axis(axis(x, NumberFormat::Fixed(0)))
            .y_axis(axis(y, NumberFormat::fitting([y.0, y.1].into_iter()))),
        area,
    );
}

#[cfg(test)]
mod tests {
    use super::super::tests::{search, view};
    use super::*;

    #[test]
    fn a_terminal_of_the_usual_size_shows_everything() {
        let choice = Focus {
            keys: true,
            colours: true,
            ..Focus::default()
        };
        insta::assert_snapshot!(drawn(&view(), choice, (80, 24)));
    }

    #[test]
    fn a_small_one_shows_what_matters_most() {
        let choice = Focus {
            keys: true,
            ..Focus::default()
        };
        insta::assert_snapshot!(drawn(&view(), choice, (40, 12)));
    }

    #[test]
    fn a_search_has_readable_settings_and_names_its_best_five() {
        let choice = Focus {
            colours: true,
            ..Focus::default()
        };
        insta::assert_snapshot!(drawn(&search(9), choice, (80, 24)));
    }

    #[test]
    fn without_colours_the_rest_is_not_drawn() {
        let text = plain(&search(9), 80);
        assert!(text.contains("4 others are not drawn"), "{text}");
        assert!(!plain(&search(5), 80).contains("others"));
    }

    #[test]
    fn every_line_fits_and_wide_ones_name_the_process() {
        for width in [80, 160] {
            let text = plain(&search(9), width);
            let fits = |line: &str| line.chars().count() <= usize::from(width);
            assert!(text.lines().all(fits) && !text.contains('…'), "{text}");
            assert_eq!(text.contains("process 7 on here"), width == 160, "{text}");
        }
    }

    #[test]
    fn trials_of_several_environments_name_theirs() {
        let mut view = view();
        assert!(!plain(&view, 80).contains("  four_cells dsac"));
        view.studies[0].running[1].environment = "two_cells".into();
        let text = plain(&view, 80);
        assert!(
            text.contains("  four_cells dsac") && text.contains("  two_cells dsac"),
            "{text}"
        );
    }

    #[test]
    fn every_size_can_be_drawn() {
        let mut many = view();
        let running = many.studies[0].running.clone();
        many.studies[0].running = running.into_iter().cycle().take(50).collect();
        many.studies.push(many.studies[0].clone());
        let odd = View {
            metrics: vec!["none".into()],
            ..many.clone()
        };
        for view in [view(), search(9), many, odd, View::default()] {
            for (width, height) in (0..40).flat_map(|width| (0..30).map(move |height| (width, height))) {
                let choice = Focus {
                    panel: 7,
                    metric: 9,
                    scroll: 99,
                    colours: width % 2 == 0,
                    keys: true,
                };
                drawn(&view, choice, (width, height));
            }
        }
    }

    #[test]
    fn many_running_trials_leave_room_for_curves_and_are_scrolled() {
        let mut view = view();
        view.studies[0].running = (0..50)
            .map(|seed| RunningView {
                agent: format!("trial_{seed}"),
                ..RunningView::default()
            })
            .collect();
        let text = drawn(&view, Focus::default(), (80, 24));
        assert!(
            text.contains("running: 1 to 9 of 50") && text.contains("every seed"),
            "{text}"
        );
        let scrolled = drawn(
            &view,
            Focus {
                scroll: 45,
                ..Focus::default()
            },
            (80, 24),
        );
        assert!(
            scrolled.contains("running: 42 to 50 of 50") && scrolled.contains("trial_49"),
            "{scrolled}"
        );
    }

    #[test]
    fn plain_text_is_as_long_as_what_there_is_to_say() {
        let text = plain(&view(), 80);
        assert!(
            text.starts_with("small  ━━━━━━━━━━────────── 3/6 trials\n"),
            "{text}"
        );
        assert!(
            text.contains("2 ok, 1 nan, 2 running, 1 missing; about") && !text.contains("q leave"),
            "{text}"
        );
        assert!(text.lines().count() <= 31 && !text.contains('\u{1b}'), "{text}");
        let mut view = view();
        view.studies[0].panels.clear();
        view.studies[0].running.clear();
        assert_eq!(plain(&view, 80).lines().count(), 2);
    }
}
