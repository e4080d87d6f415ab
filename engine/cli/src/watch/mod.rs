//! A view of studies while their trials run: finished trials, running trials with their progress, and learning curves
//! so far. It reads a store and writes nothing into it.

mod looks;
mod page;
mod running;
mod screen;
mod short;
mod watcher;

pub use page::page;
pub use screen::{Focus, draw, plain};
pub use watcher::{Watched, Watcher};

use contract::trial_end::EndState;
use document::count::duration;
use presentation::table::NumberFormat;
use serde::{Serialize, Serializer};
use statistics::estimators::mean;
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

/// Progress of the trials of a store at one moment.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct View {
    /// Time of the view, in UTC.
    pub at: String,
    /// The studies in the order of the command line.
    pub studies: Vec<StudyView>,
    /// Names of the metrics of the curves; the first one is shown at the beginning.
    pub metrics: Vec<String>,
    /// The metrics for which lower values are better.
    pub less_is_better: BTreeSet<String>,
}

/// One study.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct StudyView {
    /// Its name.
    pub name: String,
    /// Current number of its trials.
    pub trials: usize,
    /// Number of ended trials by state. A trial that was killed from outside runs again and counts as missing.
    pub ended: BTreeMap<EndState, usize>,
    /// Trials that run now.
    pub running: Vec<RunningView>,
    /// Number of trials that have neither ended nor run.
    pub missing: usize,
    /// Estimate of the remaining time, based on stored trials.
    pub left: Left,
    /// One panel for each environment, with the curves of all trials in it.
    pub panels: Vec<Panel>,
    /// Files that could not be read, with the reason.
    pub notes: Vec<String>,
}

/// A trial that is being computed.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct RunningView {
    /// Environment, agent, setting and seed in words.
    pub title: String,
    /// Its environment.
    pub environment: String,
    /// Its agent with its setting, as in panels.
    pub agent: String,
    /// Its seed.
    pub seed: u64,
    /// The last value of each metric.
    pub values: BTreeMap<String, f64>,
    /// The last step that it recorded.
    pub step: u64,
    /// Total number of its steps; 0 if unknown.
    pub steps: u64,
    /// The process that computes it.
    pub by: String,
}

/// An estimate of the remaining time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Left {
    /// Seconds on the workers that run now; `None` if no stored trial gives a pace.
    pub wall_s: Option<f64>,
    /// Number of trials that the estimate leaves out, because no stored trial has their agent and environment.
    pub unknown: usize,
}

/// The curves of an environment, either of the study or of a search.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Panel {
    /// Name of the environment.
    pub environment: String,
    /// The search whose settings the panel compares; `None` for the panel of the study.
    pub search: Option<String>,
    /// Agents with their settings, which give lines their colours.
    pub agents: Vec<String>,
    /// One line for each trial.
    pub lines: Vec<SeedLine>,
}

/// Metrics of a trial during learning, so far.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SeedLine {
    /// Index of the agent in the panel.
    pub agent: usize,
    /// Its seed.
    pub seed: u64,
    /// Whether the trial has not ended.
    pub open: bool,
    /// Steps with values, by metric.
    #[serde(serialize_with = "whole")]
    pub curves: Arc<Curves>,
}

/// Steps with values, by metric.
pub type Curves = BTreeMap<String, Vec<(u64, f64)>>;

/// Shared values are serialized as the values themselves.
fn whole<S: Serializer>(curves: &Arc<Curves>, serializer: S) -> Result<S::Ok, S::Error> {
    curves.as_ref().serialize(serializer)
}

impl StudyView {
    /// Number of ended trials, in any state.
    #[must_use]
    pub fn done(&self) -> usize {
        self.ended.values().sum()
    }

    /// True if no trial is left to be computed.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.missing + self.running.len() == 0
    }

    /// The counts and the remaining time, as in `3 ok, 1 failed, 2 running, 4 missing; about 5 min left`.
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
    /// The fraction of its steps that is done; `None` if unknown.
    #[must_use]
    pub fn part(&self) -> Option<f64> {
        #[allow(clippy::cast_precision_loss, reason = "it is shown in a bar")]
        let part = self.step as f64 / self.steps as f64;
        part.is_finite().then(|| part.clamp(0.0, 1.0))
    }
}

impl View {
    /// The standing of each agent of a panel in a metric, the best first.
    #[must_use]
    pub fn standing<'a>(&self, panel: &'a Panel, metric: &str) -> Vec<Standing<'a>> {
        panel.standing(metric, self.less_is_better.contains(metric))
    }

    /// The best agent of a panel in a metric so far: among ended ones if there are any, otherwise among running ones.
    #[must_use]
    pub fn best<'a>(&self, panel: &'a Panel, metric: &str) -> Option<Standing<'a>> {
        let all = self.standing(panel, metric);
        let ended = all.iter().find(|it| !it.open);
        ended.or(all.first()).cloned()
    }

    /// True if no trial of any study is left to be computed.
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

/// An agent with its setting, by the last values of its seeds.
#[derive(Debug, Clone, PartialEq)]
pub struct Standing<'a> {
    /// Index of the agent in the panel.
    pub agent: usize,
    /// Its name with its setting.
    pub name: &'a str,
    /// The mean of the last values.
    pub value: f64,
    /// Number of seeds with a value.
    pub seeds: usize,
    /// Whether a trial of it has not ended.
    pub open: bool,
}

impl Standing<'_> {
    /// The value and the number of seeds, as in `7.333 (3)`.
    #[must_use]
    pub fn in_words(&self) -> String {
        format!("{} ({})", in_words(self.value), self.seeds)
    }
}

/// A value with about four digits.
fn in_words(value: f64) -> String {
    NumberFormat::fitting(std::iter::once(value)).write(value)
}

impl Panel {
    /// The environment, followed by the search if the panel belongs to one.
    #[must_use]
    pub fn title(&self) -> String {
        match &self.search {
            Some(search) => format!("{}, search {search}", self.environment),
            None => self.environment.clone(),
        }
    }

    /// The standing of each agent in a metric, the best first.
    #[must_use]
    pub fn standing(&self, metric: &str, less_is_better: bool) -> Vec<Standing<'_>> {
        let of_agent = |agent: usize| {
            let lines = || self.lines.iter().filter(move |line| line.agent == agent);
            let last = lines().filter_map(|line| Some(line.curves.get(metric)?.last()?.1));
            let last: Vec<f64> = last.collect();
            (!last.is_empty()).then(|| Standing {
                agent,
                name: self.agents[agent].as_str(),
                value: mean(&last),
                seeds: last.len(),
                open: lines().any(|line| line.open),
            })
        };
        let mut all: Vec<Standing<'_>> = (0..self.agents.len()).filter_map(of_agent).collect();
        let merit = |it: &Standing<'_>| if less_is_better { it.value } else { -it.value };
        all.sort_by(|one, other| merit(one).total_cmp(&merit(other)));
        all
    }

    /// The ranges of steps and values of the lines of a metric; `None` if there is no line.
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

/// All metrics of some panels: preferred ones first, then by name.
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

    /// A study in progress: two trials are done, one failed, two run, one is missing.
    pub(crate) fn view() -> View {
        let running = |seed, step, value| RunningView {
            title: format!("four_cells dsac seed {seed}"),
            environment: "four_cells".into(),
            agent: "dsac".into(),
            seed,
            values: [("return".to_owned(), value)].into(),
            step,
            steps: 800,
            by: "process 7 on here".into(),
        };
        let panel = Panel {
            environment: "four_cells".into(),
            search: None,
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
            running: vec![running(1, 300, 4.0), running(2, 200, 6.0)],
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
            less_is_better: BTreeSet::new(),
        }
    }

    /// A search with `settings` settings of a learner; later ones are better.
    pub(crate) fn search(settings: usize) -> View {
        let mut view = view();
        let agent = |index: usize| {
            format!(
                "learner actor_learning_rate=0.000{}98622 discount=0.9{index}651 batch_size=16",
                index + 1
            )
        };
        #[allow(clippy::cast_precision_loss, reason = "small numbers")]
        let tried = |index| SeedLine {
            seed: 1_000_000,
            ..line(index, 0, 0.5 * index as f64, 8)
        };
        let study = &mut view.studies[0];
        study.panels[0] = Panel {
            environment: "four_cells".into(),
            search: Some("rates".into()),
            agents: (0..settings).map(agent).collect(),
            lines: (0..settings).map(tried).collect(),
        };
        for (index, it) in study.running.iter_mut().enumerate() {
            (it.agent, it.seed) = (agent(index), 1_000_000);
        }
        view
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
    fn standings_are_means_over_the_last_values_of_seeds_and_the_best_is_first() {
        let mut view = view();
        let panel = view.studies[0].panels[0].clone();
        let words = |view: &View| -> Vec<String> {
            let standing = view.standing(&panel, "return");
            standing
                .iter()
                .map(|it| format!("{} {}", it.name, it.in_words()))
                .collect()
        };
        // 12, 1 + 3 and 2 + 4: the mean is 22 / 3.
        assert_eq!(words(&view), ["dsac 7.333 (3)", "equal 0.0 (1)"]);
        assert_eq!(view.standing(&panel, "cost"), []);
        view.less_is_better.insert("return".into());
        assert_eq!(words(&view), ["equal 0.0 (1)", "dsac 7.333 (3)"]);
        assert_eq!(panel.bounds("return"), Some([(0.0, 800.0), (0.0, 12.0)]));
        assert_eq!(panel.bounds("cost"), None);
    }

    #[test]
    fn the_best_so_far_has_ended_where_anything_has() {
        let view = view();
        let mut panel = view.studies[0].panels[0].clone();
        assert_eq!(view.best(&panel, "return").unwrap().name, "equal");
        panel.lines.iter_mut().for_each(|line| line.open = true);
        assert_eq!(view.best(&panel, "return").unwrap().name, "dsac");
        assert_eq!(view.best(&panel, "cost"), None);
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
