//! Trajectories: one recorded episode, a row of panels per channel, a column per agent and setting.

use super::{
    Figure, FigureSpec,
    build::{Context, by_setting, label, problem},
    chart::{Chart, Hue, Panel, Point, Scale, Series, Style},
    shape::Shape,
};
use crate::{
    kinds::KindSpec,
    names::{Names, Place},
    table::{Axis, Scope},
};
use contract::{Error, Phase, trial_result::TrialResult};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Step-by-step values of one recorded episode.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Trajectory {
    /// Trace channels to draw; a word without a number (`voltage`) stands for all channels `voltage_1`, `voltage_2`,
    /// ... Each channel has a row of panels.
    pub channels: Vec<String>,
    /// Trace channels that are drawn behind `channels`, wide and grey: the first behind the first, and so on.
    pub references: Vec<String>,
    /// Agents to show, one column of panels each.
    pub agents: Vec<String>,
    /// Environment to show; the first where absent.
    pub environment: Option<String>,
    /// Seed to show; the first where absent.
    pub seed: Option<u64>,
    /// Number of the recorded episode, from 0.
    pub episode: u64,
    /// Number of episodes from there that are drawn one after the other; one where absent.
    #[schemars(range(min = 1, max = 1000))]
    pub episodes: Option<u64>,
    /// The first and the last step that are drawn, counted over all drawn episodes; all where absent.
    pub steps: Option<[u64; 2]>,
    /// A horizontal line at this value in the first row of panels.
    pub threshold: Option<f64>,
}

impl KindSpec for Trajectory {
    fn name() -> &'static str {
        "trajectory"
    }

    fn about() -> &'static str {
        "Step-by-step values of one recorded episode, one panel per agent."
    }

    fn example() -> &'static str {
        "{ channels: [height], agents: [learner, rule], environment: short }"
    }
}

impl Figure for Trajectory {
    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        let picked = names.pick(at).of_one_environment();
        names.channels(at, "channels", 1, usize::MAX, &picked);
        names.channels(at, "references", 0, self.channels.len(), &picked);
        names.seed(self.seed, at);
        if let Some([first, last]) = self.steps.filter(|[first, last]| first > last) {
            let message = format!("step {first} comes after step {last}");
            names.say(at.value("steps"), message, "write the smaller one first");
        }
    }

    fn is_recorded(&self) -> bool {
        false
    }

    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
        build(self, spec, context)
    }
}

/// A column of panels: its title and its trial.
struct Column<'a> {
    title: String,
    trial: &'a TrialResult,
}

/// Panels of one episode. Panels of a row share the vertical axis; all panels share the horizontal one.
fn build(kind: &Trajectory, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
    let (columns, cut) = columns(kind, spec, context);
    let first = columns
        .first()
        .ok_or_else(|| problem("no trial has recorded a trace of these channels"))?;
    let mut panels = Vec::new();
    for (row, channel) in kind.channels.iter().enumerate() {
        for column in &columns {
            let mut panel = panel(kind, spec, context, channel, column.trial);
            if let Some(reference) = kind.references.get(row) {
                panel
                    .series
                    .splice(0..0, behind(kind, spec, reference, column.trial));
            }
            if row == 0 {
                panel.title.clone_from(&column.title);
                panel.series.extend(kind.threshold.map(threshold));
            }
            panels.push(panel);
        }
    }
    name_once(&mut panels);
    let which = match kind.episodes.unwrap_or(1) {
        1 => format!("Episode {}", kind.episode),
        several => format!("Episodes {} to {}", kind.episode, kind.episode + several - 1),
    };
    let note = format!(
        "{which} of seed {} in {}.",
        first.trial.trial.key.seed,
        label(spec, &first.trial.trial.cell.environment)
    );
    Ok(Chart {
        panels,
        columns: columns.len(),
        shared_x: true,
        shared_y: true,
        notes: std::iter::once(note).chain(cut).collect(),
        ..Chart::default()
    })
}

/// A column for each agent and setting with a trace, or for the first such setting of each agent, with a sentence on
/// it, where columns for all would be too narrow.
fn columns<'a>(
    kind: &Trajectory,
    spec: &FigureSpec,
    context: Context<'a>,
) -> (Vec<Column<'a>>, Option<String>) {
    /// Largest number of columns with several settings of an agent.
    const MOST: usize = 6;
    let environments: Vec<String> = kind.environment.iter().cloned().collect();
    let scope = Scope::of(context.results, &kind.agents, &environments);
    let environment = scope
        .names(Axis::Environment, &[])
        .into_iter()
        .next()
        .unwrap_or_default();
    let scope = scope.at(Axis::Environment, &environment);
    let seed = kind
        .seed
        .or_else(|| scope.trials.iter().map(|trial| trial.trial.key.seed).min());
    let has_trace = |trial: &TrialResult| {
        let mut channels = kind.channels.iter();
        channels.any(|channel| !lines(kind, trial, channel).is_empty())
    };
    let is_drawn =
        |trial: &&TrialResult| Some(trial.trial.key.seed) == seed && trial.is_ok() && has_trace(trial);
    let column = |scope: &Scope<'a>, title: String, _| {
        let trial = scope.trials.iter().copied().find(is_drawn)?;
        Some(Column { title, trial })
    };
    let columns = by_setting(spec, context, (&scope, &kind.agents), column);
    let mut columns: Vec<Column<'a>> = columns.into_iter().flatten().collect();
    let all = columns.len();
    if all > MOST {
        columns.dedup_by(|next, first| next.trial.trial.cell.agent == first.trial.trial.cell.agent);
    }
    let cut =
        (columns.len() < all).then(|| "Of several settings of an agent the first one is drawn.".to_owned());
    (columns, cut)
}

fn panel(
    kind: &Trajectory,
    spec: &FigureSpec,
    context: Context<'_>,
    channel: &str,
    trial: &TrialResult,
) -> Panel {
    let lines = lines(kind, trial, channel);
    let count = lines.len();
    let series = |(index, (name, points)): (usize, (String, Vec<Point>))| {
        let alone = Style {
            variant: 0,
            ..context.style(&trial.trial.cell.agent)
        };
        let style = if count == 1 {
            alone
        } else {
            Style {
                hue: Hue::Ramp(index, count),
                variant: index,
            }
        };
        let label = if count == 1 {
            String::new()
        } else {
            label(spec, &name).replace('_', " ")
        };
        Series {
            label,
            seeds: None,
            style,
            shape: Shape::Line(points),
        }
    };
    Panel {
        title: String::new(),
        x: Scale {
            label: "decision".into(),
            ..Scale::default()
        },
        y: context.scale(spec, channel, false),
        series: lines.into_iter().enumerate().map(series).collect(),
    }
}

/// A reference channel as grey lines. All of them look alike, so the legend shows the words that their names share.
fn behind(kind: &Trajectory, spec: &FigureSpec, channel: &str, trial: &TrialResult) -> Vec<Series> {
    let shared = shared_words(&kind.references);
    let series = |(name, points): (String, Vec<Point>)| Series {
        label: shared
            .clone()
            .unwrap_or_else(|| label(spec, &name))
            .replace('_', " "),
        seeds: None,
        style: Style {
            hue: Hue::Behind,
            variant: 0,
        },
        shape: Shape::Line(points),
    };
    lines(kind, trial, channel).into_iter().map(series).collect()
}

/// The whole words with which several names begin; `None` for one name, and for names that share no word.
fn shared_words(names: &[String]) -> Option<String> {
    let (first, others) = names.split_first()?;
    let words: Vec<&str> = first.split('_').collect();
    let begins = |name: &String, n: usize| name.split('_').take(n).eq(words[..n].iter().copied());
    let shares = |n: &usize| others.iter().all(|name| begins(name, *n));
    let n = (1..=words.len()).take_while(shares).last()?;
    (!others.is_empty()).then(|| words[..n].join("_"))
}

/// The lines of a channel: the channel itself, or all `channel_1`, `channel_2`, ..., in numerical order, for
/// each seat.
fn lines(kind: &Trajectory, trial: &TrialResult, channel: &str) -> Vec<(String, Vec<Point>)> {
    let number = |name: &str| name.strip_prefix(channel)?.strip_prefix('_')?.parse::<u32>().ok();
    let mut names: Vec<(u32, &String)> = trial
        .names
        .iter()
        .filter_map(|name| Some((number(name)?, name)))
        .collect();
    names.sort();
    if let Some(name) = trial.names.iter().find(|name| *name == channel) {
        names = vec![(0, name)];
    }
    names
        .into_iter()
        .flat_map(|(_, name)| seats(kind, trial, name))
        .collect()
}

fn seats(kind: &Trajectory, trial: &TrialResult, name: &str) -> Vec<(String, Vec<Point>)> {
    let mut seats: BTreeMap<u16, Vec<Point>> = BTreeMap::new();
    let last = kind.episode + kind.episodes.unwrap_or(1).max(1) - 1;
    let drawn = || {
        let rows = trial.select(Phase::Trace, name);
        rows.filter(|row| (kind.episode..=last).contains(&row.episode))
    };
    // An episode begins where the previous one ended.
    let mut lengths: BTreeMap<u64, u64> = BTreeMap::new();
    for row in drawn() {
        let length = lengths.entry(row.episode).or_default();
        *length = (*length).max(row.step);
    }
    let [first_step, last_step] = kind.steps.unwrap_or([0, u64::MAX]);
    for row in drawn() {
        let before: u64 = lengths.range(..row.episode).map(|(_, length)| length).sum();
        if !(first_step..=last_step).contains(&(before + row.step)) {
            continue;
        }
        #[allow(clippy::cast_precision_loss, reason = "steps are far below 2^52")]
        seats.entry(row.seat).or_default().push(Point {
            x: (before + row.step) as f64,
            y: row.value,
            interval: None,
        });
    }
    let several = seats.len() > 1;
    let name = |seat: u16| {
        if several {
            format!("{name}, seat {}", seat + 1)
        } else {
            name.into()
        }
    };
    seats
        .into_iter()
        .map(|(seat, points)| (name(seat), points))
        .collect()
}

fn threshold(value: f64) -> Series {
    let style = Style {
        hue: Hue::Grey,
        variant: 1,
    };
    Series {
        label: format!("threshold {value}"),
        seeds: None,
        style,
        shape: Shape::Level(value),
    }
}

/// Gives rows that number the same entities one set of names in the legend, `1`, `2`, ..., if the words before the
/// numbers differ.
fn name_once(panels: &mut [Panel]) {
    let word = |label: &str| label.rsplit_once(' ').map(|(word, _)| word.to_owned());
    let numbered = |series: &&Series| matches!(series.style.hue, Hue::Ramp(..));
    let words: std::collections::BTreeSet<_> = panels
        .iter()
        .flat_map(|panel| {
            panel
                .series
                .iter()
                .filter(numbered)
                .map(|series| word(&series.label))
        })
        .collect();
    if words.len() < 2 {
        return;
    }
    for series in panels
        .iter_mut()
        .flat_map(|panel| &mut panel.series)
        .filter(|series| matches!(series.style.hue, Hue::Ramp(..)))
    {
        if let Some((_, number)) = series.label.rsplit_once(' ') {
            series.label = format!("no. {number}");
        }
    }
}
