//! A look at studies while their trials run: what is done, what runs and how far, and learning curves as far as they
//! are known. It reads a store and writes nothing into it.

mod page;
mod screen;
mod watcher;

pub use page::page;
pub use screen::{Choice, draw, plain};
pub use watcher::{Watched, Watcher};

use crate::{report::duration, results::EndState, table::NumberFormat};
use serde::{Serialize, Serializer};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

/// What is seen at one moment.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct View {
    /// When it was seen, in UTC.
    pub at: String,
    /// The studies in the order in which they were named.
    pub studies: Vec<StudyView>,
    /// Names of the metrics that curves have, the one that is shown first at the beginning.
    pub metrics: Vec<String>,
}

/// One study.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct StudyView {
    /// Its name.
    pub name: String,
    /// How many trials it has now.
    pub trials: usize,
    /// How many ended in which state; a trial that was killed from outside runs again and is missing.
    pub ended: BTreeMap<EndState, usize>,
    /// Those that run now.
    pub running: Vec<RunningView>,
    /// How many neither ended nor run.
    pub missing: usize,
    /// How much is left, as far as stored trials tell.
    pub left: Left,
    /// An environment each, with the curves of all trials in it.
    pub panels: Vec<Panel>,
    /// What could not be read.
    pub notes: Vec<String>,
}

/// A trial that is being computed.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct RunningView {
    /// Environment, agent, setting and seed in words.
    pub title: String,
    /// The last step that it recorded.
    pub step: u64,
    /// The steps that it has in all; 0 where that is not known.
    pub steps: u64,
    /// The process that computes it.
    pub by: String,
}

/// An estimate of what is left.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Left {
    /// Seconds on as many workers as run now; `None` where no stored trial tells how long.
    pub wall_s: Option<f64>,
    /// Trials of agents that no stored trial of the environment is of, which are not in it.
    pub unknown: usize,
}

/// The curves of an environment.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Panel {
    /// Name of the environment.
    pub environment: String,
    /// Agents with their settings, which give lines their colours.
    pub agents: Vec<String>,
    /// A line per trial.
    pub lines: Vec<SeedLine>,
}

/// What a trial measured while learning, so far.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SeedLine {
    /// Which agent of the panel.
    pub agent: usize,
    /// Its seed.
    pub seed: u64,
    /// True where the trial has not ended.
    pub open: bool,
    /// Steps with values, by metric.
    #[serde(serialize_with = "whole")]
    pub curves: Arc<Curves>,
}

/// Steps with values, by metric.
pub type Curves = BTreeMap<String, Vec<(u64, f64)>>;

/// What is shared is written as what it is.
fn whole<S: Serializer>(curves: &Arc<Curves>, serializer: S) -> Result<S::Ok, S::Error> {
    curves.as_ref().serialize(serializer)
}

impl StudyView {
    /// How many trials ended, well or not.
    #[must_use]
    pub fn done(&self) -> usize {
        self.ended.values().sum()
    }

    /// True where no trial is left to be computed.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.missing + self.running.len() == 0
    }

    /// The counts and what is left, as in `3 ok, 1 failed, 2 running, 4 missing; about 5 min left`.
    #[must_use]
    pub fn summary(&self) -> String {
        let ended = self.ended.iter().map(|(state, count)| (*count, state.name()));
        let open = [(self.running.len(), "running"), (self.missing, "missing")];
        let counts: Vec<String> = ended
            .chain(open)
            .filter(|(count, _)| *count > 0)
            .map(|(count, word)| format!("{count} {word}"))
            .collect();
        let counts = if counts.is_empty() {
            "no trials".into()
        } else {
            counts.join(", ")
        };
        if self.is_finished() {
            counts
        } else {
            format!("{counts}; {}", self.left.in_words())
        }
    }
}

impl Left {
    fn in_words(self) -> String {
        let Some(wall_s) = self.wall_s else {
            return "no stored trial tells how long".into();
        };
        let unknown = match self.unknown {
            0 => String::new(),
            n => format!(", and {n} trials unlike any that ended"),
        };
        format!("about {} left{unknown}", duration(wall_s))
    }
}

impl RunningView {
    /// The part that is done; `None` where it is not known.
    #[must_use]
    pub fn part(&self) -> Option<f64> {
        #[allow(clippy::cast_precision_loss, reason = "it is shown in a bar")]
        let part = self.step as f64 / self.steps as f64;
        part.is_finite().then(|| part.clamp(0.0, 1.0))
    }
}

impl View {
    /// True where nothing of any study is left to be computed.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.studies.iter().all(StudyView::is_finished)
    }

    /// The panels that have a curve of any metric, each with its study.
    pub fn panels(&self) -> impl Iterator<Item = (&StudyView, &Panel)> {
        let of_study = |study| -> Vec<(&StudyView, &Panel)> {
            let study: &StudyView = study;
            study.panels.iter().map(|panel| (study, panel)).collect()
        };
        let panels = self.studies.iter().flat_map(of_study);
        panels.filter(|(_, panel)| panel.lines.iter().any(|line| !line.curves.is_empty()))
    }
}

impl Panel {
    /// What each agent has come to in a metric: its name, the mean of the last values of its seeds, and their number.
    #[must_use]
    pub fn standing(&self, metric: &str) -> Vec<(usize, String)> {
        let last = |agent: usize| -> Vec<f64> {
            let lines = self.lines.iter().filter(|line| line.agent == agent);
            lines
                .filter_map(|line| Some(line.curves.get(metric)?.last()?.1))
                .collect()
        };
        let agents = self
            .agents
            .iter()
            .enumerate()
            .map(|(agent, name)| (agent, name, last(agent)));
        let known = agents.filter(|(_, _, last)| !last.is_empty());
        known
            .map(|(agent, name, last)| {
                let mean = crate::statistics::estimators::mean(&last);
                let value = NumberFormat::fitting(std::iter::once(mean)).write(mean);
                (agent, format!("{name} {value} ({})", last.len()))
            })
            .collect()
    }

    /// The steps and the values that the lines of a metric lie between; `None` where there is no line.
    #[must_use]
    pub fn bounds(&self, metric: &str) -> Option<[(f64, f64); 2]> {
        let points = self
            .lines
            .iter()
            .filter_map(|line| line.curves.get(metric))
            .flatten();
        #[allow(clippy::cast_precision_loss, reason = "steps are far below 2^52")]
        let points = points.map(|(step, value)| (*step as f64, *value));
        let mut points = points.filter(|(_, value)| value.is_finite()).peekable();
        points.peek()?;
        let none = (f64::INFINITY, f64::NEG_INFINITY);
        let widen = |(low, high): (f64, f64), value: f64| (low.min(value), high.max(value));
        let bounds = points.fold([none, none], |[x, y], point| {
            [widen(x, point.0), widen(y, point.1)]
        });
        Some(bounds.map(|(low, high)| {
            if low < high {
                (low, high)
            } else {
                (low - 0.5, high + 0.5)
            }
        }))
    }
}

/// All metrics of some panels: those that are preferred first, then by name.
fn metrics<'a>(preferred: &[String], panels: impl Iterator<Item = &'a Panel>) -> Vec<String> {
    let lines = panels.flat_map(|panel| &panel.lines);
    let mut known: BTreeSet<&String> = lines.flat_map(|line| line.curves.keys()).collect();
    let mut all = Vec::new();
    for metric in preferred {
        all.extend(known.take(metric).cloned());
    }
    all.extend(known.into_iter().cloned());
    all
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    fn line(agent: usize, seed: u64, slope: f64, until: u64) -> SeedLine {
        #[allow(clippy::cast_precision_loss, reason = "small numbers")]
        let curve = (0..=until)
            .map(|k| (k * 100, slope * k as f64 + seed as f64))
            .collect();
        SeedLine {
            agent,
            seed,
            open: until < 8,
            curves: Arc::new([("return".to_owned(), curve)].into()),
        }
    }

    /// A study under way: two trials are done, one failed, two run, one is missing.
    pub(crate) fn view() -> View {
        let running = |seed, step| RunningView {
            title: format!("four_cells, dsac, seed {seed}"),
            step,
            steps: 800,
            by: "process 7 on here".into(),
        };
        let panel = Panel {
            environment: "four_cells".into(),
            agents: vec!["equal".into(), "dsac".into()],
            lines: vec![
                line(0, 0, 0.0, 8),
                line(1, 0, 1.5, 8),
                line(1, 1, 1.0, 3),
                line(1, 2, 2.0, 2),
            ],
        };
        let study = StudyView {
            name: "small".into(),
            trials: 6,
            ended: [(EndState::Ok, 2), (EndState::Nan, 1)].into(),
            running: vec![running(1, 300), running(2, 200)],
            missing: 1,
            left: Left {
                wall_s: Some(90.0),
                unknown: 0,
            },
            panels: vec![panel],
            notes: Vec::new(),
        };
        View {
            at: "2026-01-02T03:04:05Z".into(),
            studies: vec![study],
            metrics: vec!["return".into()],
        }
    }

    #[test]
    fn counts_and_what_is_left_are_one_line() {
        let mut study = view().studies.remove(0);
        assert_eq!(
            study.summary(),
            "2 ok, 1 nan, 2 running, 1 missing; about 2 min left"
        );
        study.left.unknown = 2;
        assert!(
            study
                .summary()
                .ends_with("left, and 2 trials unlike any that ended")
        );
        study.left.wall_s = None;
        assert!(study.summary().ends_with("no stored trial tells how long"));
        (study.running, study.missing) = (Vec::new(), 0);
        assert_eq!(
            (study.summary().as_str(), study.is_finished()),
            ("2 ok, 1 nan", true)
        );
        assert_eq!(StudyView::default().summary(), "no trials");
    }

    #[test]
    fn standings_are_means_over_the_last_values_of_seeds() {
        let panel = &view().studies[0].panels[0];
        // 12, 1 + 3 and 2 + 4: the mean is 22 / 3.
        assert_eq!(
            panel.standing("return"),
            [(0, "equal 0.0 (1)".to_owned()), (1, "dsac 7.333 (3)".to_owned())]
        );
        assert_eq!(panel.standing("cost"), []);
        assert_eq!(panel.bounds("return"), Some([(0.0, 800.0), (0.0, 12.0)]));
        assert_eq!(panel.bounds("cost"), None);
    }

    #[test]
    fn preferred_metrics_come_first_where_they_are_recorded() {
        let mut panel = view().studies[0].panels[0].clone();
        Arc::make_mut(&mut panel.lines[0].curves).insert("cost".into(), Vec::new());
        Arc::make_mut(&mut panel.lines[1].curves).insert("length".into(), Vec::new());
        let preferred = ["unknown", "length"].map(String::from);
        assert_eq!(
            metrics(&preferred, [&panel].into_iter()),
            ["length", "cost", "return"]
        );
    }

    #[test]
    fn a_part_needs_a_length() {
        let of = |step, steps| {
            RunningView {
                step,
                steps,
                ..RunningView::default()
            }
            .part()
        };
        assert_eq!([of(1, 4), of(9, 4), of(0, 0)], [Some(0.25), Some(1.0), None]);
    }
}
