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

/// Columns of the bars of running trials.
const BAR: usize = 10;

/// A line for each running trial: agent with setting, seed, how far it is, the last value of the metric, and the process
/// where there is room.
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
    let rows: Vec<[String; 3]> = shown.iter().map(|it| row(it, metric)).collect();
    let widest = |column: usize, heading: &str| {
        let cells = rows.iter().map(|row| row[column].chars().count());
        cells.chain([heading.chars().count()]).max().unwrap_or(0)
    };
    let widths = [widest(0, "seed"), widest(1, "steps"), widest(2, metric)];
    // Two columns before each of four cells, one before the bar.
    let rest = widths.iter().sum::<usize>() + BAR + 9;
    let names = names_of(running, shown, usize::from(area.width).saturating_sub(rest));
    let width = names.iter().map(|name| name.chars().count()).max().unwrap_or(0);
    let [seed, steps, value] = widths;
    let line = |((it, name), [of_seed, of_steps, last]): ((&&RunningView, &String), &[String; 3])| {
        let bar = bar(it.part(), BAR);
        let line = format!("  {name:<width$}  {of_seed:>seed$}  {bar} {of_steps:>steps$}  {last:>value$}");
        let free = usize::from(area.width).saturating_sub(line.chars().count() + 2);
        let by = if it.by.chars().count() <= free {
            it.by.as_str()
        } else {
            ""
        };
        Line::raw(format!("{line}  {by}").trim_end().to_owned())
    };
    // The heading of the steps stands over the bar, too.
    let columns = width.max(head.chars().count().saturating_sub(2)) + 2;
    let over = BAR + 1 + steps;
    let heading = format!(
        "{head:<columns$}  {:>seed$}  {:>over$}  {metric:>value$}",
        "seed", "steps"
    );
    let bold = Style::new().add_modifier(Modifier::BOLD);
    let rows = shown.iter().zip(&names).zip(&rows).map(line);
    std::iter::once(Line::styled(heading, bold)).chain(rows).collect()
}

/// The names of some running trials in so many columns each, with the environment where not all have the same.
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

/// A bar of some columns; empty where the part is not known.
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
