//! The running trials in a terminal, a line each.

use super::{
    RunningView, in_words,
    short::{self, shortened},
};
use ratatui::{
    layout::Rect,
    style::{Modifier, Style},
    text::Line,
};

/// Width of the bars of running trials, in columns.
const BAR: usize = 10;

/// A line for each running trial: agent with setting, seed, progress, the last value of the metric, and the process if
/// there is room.
pub(super) fn running_lines(
    running: &[&RunningView],
    metric: &str,
    scroll: usize,
    area: Rect,
) -> Vec<Line<'static>> {
    let height = usize::from(area.height);
    if height == 0 {
        return Vec::new();
    }
    let from = scroll.min((running.len() + 1).saturating_sub(height));
    let shown = &running[from..(from + height - 1).min(running.len())];
    let head = if shown.len() < running.len() {
        format!(
            "running: {} to {} of {}",
            from + 1,
            from + shown.len(),
            running.len()
        )
    } else {
        "running".to_owned()
    };
    let heading = [head, "seed".into(), "steps".into(), metric.to_owned()];
    in_columns(running, shown, heading, usize::from(area.width))
}

/// The heading and a line for each of some running trials, in columns.
fn in_columns(
    running: &[&RunningView],
    shown: &[&RunningView],
    heading: [String; 4],
    width: usize,
) -> Vec<Line<'static>> {
    let rows: Vec<[String; 3]> = shown.iter().map(|it| row(it, &heading[3])).collect();
    let widest = |column: usize| {
        let cells = rows.iter().map(|row| row[column].chars().count());
        cells
            .chain([heading[column + 1].chars().count()])
            .max()
            .unwrap_or(0)
    };
    let [seed, steps, value] = [0, 1, 2].map(widest);
    // Two columns before each cell, and one between the bar and the steps. A setting matters more than the bar.
    let room = |bar: usize| width.saturating_sub(seed + steps + value + bar + 8);
    let with_bar = names_of(running, shown, room(BAR + 1));
    let is_cut = with_bar.iter().any(|name| name.ends_with('…'));
    let (names, of_bar) = if is_cut {
        (names_of(running, shown, room(0)), 0)
    } else {
        (with_bar, BAR + 1)
    };
    let of_names = names.iter().map(|name| name.chars().count()).max().unwrap_or(0);
    let of_names = of_names.max(room(of_bar).min(heading[0].chars().count().saturating_sub(2)));
    let line = |((it, name), [of_seed, done, last]): ((&&RunningView, &String), &[String; 3])| {
        let bar = if of_bar > 0 {
            bar(it.part(), BAR) + " "
        } else {
            String::new()
        };
        let line = format!("  {name:<of_names$}  {of_seed:>seed$}  {bar}{done:>steps$}  {last:>value$}");
        let fits = line.chars().count() + 2 + it.by.chars().count() <= width;
        let by = if fits { it.by.as_str() } else { "" };
        Line::raw(format!("{line}  {by}").trim_end().to_owned())
    };
    let [head, of_seed, of_steps, metric] = &heading;
    // The heading of the steps also covers the bar.
    let (under, over) = (of_names + 2, of_bar + steps);
    let first = format!("{head:<under$}  {of_seed:>seed$}  {of_steps:>over$}  {metric:>value$}");
    let bold = Style::new().add_modifier(Modifier::BOLD);
    let lines = shown.iter().zip(&names).zip(&rows).map(line);
    std::iter::once(Line::styled(first, bold)).chain(lines).collect()
}

/// The names of some running trials in `room` columns each, with the environment unless all have the same.
fn names_of(running: &[&RunningView], shown: &[&RunningView], room: usize) -> Vec<String> {
    let is_one = running
        .windows(2)
        .all(|pair| pair[0].environment == pair[1].environment);
    let name = |it: &&RunningView| match is_one {
        true => it.agent.clone(),
        false => format!("{} {}", it.environment, it.agent),
    };
    let names: Vec<String> = shown.iter().map(name).collect();
    shortened(&names.iter().map(String::as_str).collect::<Vec<_>>(), room)
}

/// Seed, steps and last value of a running trial.
fn row(it: &RunningView, metric: &str) -> [String; 3] {
    let done = short::steps(it.step);
    let steps = match it.steps {
        0 => done,
        all => format!("{done}/{}", short::steps(all)),
    };
    let value = it.values.get(metric);
    let value = value.map_or_else(|| "–".to_owned(), |value| in_words(*value));
    [it.seed.to_string(), steps, value]
}

/// A bar of this number of columns; empty if the fraction is unknown.
pub(super) fn bar(part: Option<f64>, columns: usize) -> String {
    #[allow(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a few columns"
    )]
    let full = (part.unwrap_or(0.0).clamp(0.0, 1.0) * columns as f64).floor() as usize;
    format!("{}{}", "━".repeat(full), "─".repeat(columns - full))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_setting_takes_the_place_of_the_bar() {
        let it = RunningView {
            agent:
                "learner actor_learning_rate=0.0000317 discount=0.918 target_concentration=47.4 batch_size=64"
                    .into(),
            seed: 1_000_000,
            step: 55_000,
            steps: 60_000,
            values: [("cycle_length".to_owned(), 122.8)].into(),
            ..RunningView::default()
        };
        let text = |width| -> Vec<String> {
            let lines = running_lines(&[&it], "cycle_length", 0, Rect::new(0, 0, width, 5));
            lines.iter().map(ToString::to_string).collect()
        };
        assert_eq!(
            text(80),
            [
                "running                                         seed    steps  cycle_length",
                "  learner alr=3.17e-5 d=0.918 tc=47.4 bs=64  1000000  55k/60k         122.8"
            ]
        );
        assert!(text(120)[1].contains("━━━━━━━━━─ 55k/60k"), "{:?}", text(120));
    }
}
