//! Searches for settings: the settings to try next and the final choice, as a function of earlier results.
//!
//! A search tries settings in generations. A generation is settled when every one of its settings has a result. The
//! next one therefore depends neither on the number of workers nor on the order in which they finish, nor on anything
//! else in the store. A setting has a result when its trials ended successfully, or with a number that is not finite:
//! then it ranks last. A trial that failed in another way (an error, a limit of time or memory) says nothing about its
//! setting, and the search waits for it, see [`Failed`]. Random numbers come from streams that are named by the
//! identity of the search and by the place of a setting, so that a larger budget keeps the settings of a smaller one.

mod cma_es;
mod halving;
pub mod importance;
mod population;
mod progress;
mod proposals;
mod range;
mod tree_parzen;

pub use cma_es::CmaEs;
pub use population::{lineage, schedule_in_words};
pub use progress::Progress;
pub use proposals::Proposals;
pub use range::{Numbers, Range};

use contract::{digest, random, sweep_point::names, trial_end::EndState};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The first of the seeds with which settings are compared. Those of studies begin at 0, so that the chosen setting is
/// measured on seeds that the search has not used.
pub const FIRST_TUNING_SEED: u64 = 1_000_000;
/// Number of times that a setting that was tried before is drawn again.
const MOST_REDRAWS: usize = 100;

/// A search of a study.
#[derive(Debug, Clone, PartialEq)]
pub struct Search {
    /// Name of the search in the study.
    pub name: String,
    /// The environment in which settings are compared.
    pub environment: String,
    /// The agent whose setting is searched.
    pub agent: String,
    /// Plugin of the agent.
    pub plugin: String,
    /// The searched keys, each with its values.
    pub keys: Vec<(String, Range)>,
    /// The metric by which settings are compared.
    pub metric: String,
    /// Whether larger or smaller values of the metric are better.
    pub direction: Direction,
    /// Number of settings that are tried.
    pub settings: usize,
    /// Seeds of each setting.
    pub seeds: Vec<u64>,
    /// Method of choosing the next setting.
    pub method: Method,
    /// Treatment of a setting with a failed trial.
    pub failed: Failed,
}

/// Treatment of a setting with a trial that ended neither `ok` nor with a number that is not finite.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Failed {
    /// The search waits until the trial is run again and ends in another state.
    #[default]
    Wait,
    /// It ranks last, and the search goes on without it.
    RankLast,
}

impl Failed {
    /// Whether it is the default, which a study need not write.
    #[must_use]
    pub fn is_wait(&self) -> bool {
        *self == Self::Wait
    }
}

/// Better direction of the values of a metric.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// Larger values are better.
    #[default]
    Maximize,
    /// Smaller values are better.
    Minimize,
}

impl Direction {
    /// The value, negated if smaller ones are better: larger is always better.
    #[must_use]
    pub fn merit(self, value: f64) -> f64 {
        match self {
            Self::Maximize => value,
            Self::Minimize => -value,
        }
    }
}

/// Method of choosing the next setting.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Method {
    /// Every setting is equally likely; all are tried at once.
    Random(
        /// No options.
        NoOptions,
    ),
    /// Settings that lie near good ones and far from others.
    TreeParzen(
        /// Numbers of settings that are random and that are tried at once.
        TreeParzen,
    ),
    /// Settings from a normal distribution that moves to good ones and takes their shape; for numbers alone.
    CmaEs(
        /// Number of settings that are tried at once, and initial width.
        CmaEs,
    ),
    /// Random settings that pause, after which the best part continues: successive halving, and Hyperband with several
    /// brackets.
    Halving(
        /// Steps at which trials pause, and the share that continues.
        Halving,
    ),
    /// Random settings that learn side by side. After every pause the worst take over what the best have learned and
    /// continue with a similar setting: population based training. The result is a schedule of settings.
    Population(
        /// Steps at which members are compared, and the share that is replaced.
        Population,
    ),
}

impl Default for Method {
    fn default() -> Self {
        Self::TreeParzen(TreeParzen::default())
    }
}

/// Options of a method that has none.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NoOptions {}

/// The tree-structured Parzen estimator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TreeParzen {
    /// Number of random settings before any is proposed.
    #[schemars(range(min = 1, max = 100_000))]
    pub startup: usize,
    /// Number of settings that are proposed and tried together. More of them use more workers, but each is proposed
    /// with fewer results.
    #[schemars(range(min = 1, max = 1000))]
    pub batch: usize,
    /// Number of candidates, the best of which is proposed.
    #[schemars(range(min = 1, max = 100_000))]
    pub candidates: usize,
}

impl Default for TreeParzen {
    fn default() -> Self {
        Self {
            startup: 10,
            batch: 4,
            candidates: 24,
        }
    }
}

/// Successive halving.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Halving {
    /// Steps at which trials pause, in order; the protocol measures at each of them.
    #[schemars(length(min = 1, max = 20), inner(range(min = 1)), extend("x-unit" = "steps"))]
    pub pauses: Vec<u64>,
    /// Share of the settings that continues after a pause, at least one.
    #[serde(default = "third")]
    #[schemars(range(min = 0.01, max = 0.99))]
    pub keep: f64,
    /// Groups of settings. Each later one has fewer settings and one pause less, at about the same cost.
    #[serde(default = "one")]
    #[schemars(range(min = 1, max = 21))]
    pub brackets: usize,
}

/// Population based training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Population {
    /// Steps after which members are compared, in order.
    #[schemars(length(min = 1, max = 1000), inner(range(min = 1)), extend("x-unit" = "steps"))]
    pub pauses: Vec<u64>,
    /// Share of the members that is replaced after a pause, at least one and at most half.
    #[serde(default = "quarter")]
    #[schemars(range(min = 0.01, max = 0.5))]
    pub replace: f64,
    /// Probability that a value of a replaced member is drawn again from its whole range; otherwise a number changes by
    /// a fifth, and a listed value moves to a neighbour.
    #[serde(default = "quarter")]
    #[schemars(range(min = 0, max = 1))]
    pub redraw: f64,
}

fn quarter() -> f64 {
    0.25
}

fn third() -> f64 {
    1.0 / 3.0
}

fn one() -> usize {
    1
}

/// A setting: a value for each key of the search.
pub type Point = Vec<Value>;

/// A setting with its results.
#[derive(Debug, Clone, PartialEq)]
pub struct Tried {
    /// Values of the setting, one for each key.
    pub point: Point,
    /// The place of the setting whose learning it continues; `None` if it starts from the beginning.
    pub parent: Option<usize>,
    /// Mean of the metric over the seeds; `None` if it ranks last or has not ended.
    pub value: Option<f64>,
    /// Whether its result is final: its trials ended successfully, or in a way that ranks it last.
    pub ended: bool,
    /// The same mean at each pause that all of its trials reached; `None` if it ranks last.
    pub pauses: BTreeMap<u64, Option<f64>>,
}

impl Tried {
    /// A setting without results.
    #[must_use]
    pub fn new(point: Point) -> Self {
        Self {
            point,
            parent: None,
            value: None,
            ended: false,
            pauses: BTreeMap::new(),
        }
    }
}

/// The next step of a search.
#[derive(Debug, Clone, PartialEq)]
pub enum Next {
    /// These settings are tried, each until its pause, or to its end if it has none.
    Try(Vec<Point>, Vec<Option<u64>>),
    /// The search is over. The best setting is at this place; `None` if every one has failed. The second field has the
    /// steps at which the settings pause.
    Chosen(Option<usize>, Vec<Option<u64>>),
}

impl Search {
    /// The next step of a method whose distribution of settings adapts.
    fn adapted(&self, options: &CmaEs, tried: &[Tried]) -> Next {
        let ended = tried.iter().filter(|it| it.ended);
        let known = ended
            .map(|it| (cma_es::word(&it.point), self.merit(it)))
            .collect();
        let points = cma_es::settings(options, &self.space(), &self.identity(), self.settings, &known);
        let is_whole = points.len() == self.settings && tried.iter().all(|it| it.ended);
        let stops = vec![None; points.len()];
        if is_whole && tried.iter().map(|it| &it.point).eq(&points) {
            return Next::Chosen(self.best(tried, |_| true), stops);
        }
        Next::Try(points, stops)
    }

    /// The names of its keys where they appear side by side.
    #[must_use]
    pub fn key_names(&self) -> Vec<&str> {
        let keys: Vec<&str> = self.keys.iter().map(|(key, _)| key.as_str()).collect();
        names(&keys)
    }

    /// Number of settings that can run to their ends.
    #[must_use]
    pub fn n_ends(&self) -> usize {
        match &self.method {
            Method::Halving(options) => halving::n_ends(options, self.settings),
            _ => self.settings,
        }
    }

    fn space(&self) -> Vec<Range> {
        self.keys.iter().map(|(_, range)| range.clone()).collect()
    }

    /// The next step of a method whose settings pause.
    fn halved(&self, options: &Halving, points: Vec<Point>, known: Option<&[Tried]>) -> Next {
        let nothing: Vec<Tried> = points.iter().cloned().map(Tried::new).collect();
        let known = known.unwrap_or(&nothing);
        let stops = halving::stops(options, self.direction, known);
        let waits = |(stop, it): (&Option<u64>, &Tried)| match stop {
            None => !it.ended,
            Some(pause) => !it.pauses.contains_key(pause),
        };
        if stops.iter().zip(known).any(waits) {
            return Next::Try(points, stops);
        }
        // The store may hold further results of a stopped setting, for instance from a sweep; they do not count.
        let chosen = self.best(known, |place| stops[place].is_none());
        Next::Chosen(chosen, stops)
    }

    /// Steps at which trials may pause.
    #[must_use]
    pub fn pauses(&self) -> &[u64] {
        match &self.method {
            Method::Halving(options) => &options.pauses,
            Method::Random(_) | Method::TreeParzen(_) | Method::CmaEs(_) | Method::Population(_) => &[],
        }
    }

    /// Places of the settings from the best to the worst; of equal ones the earlier is better.
    #[must_use]
    pub fn ranking(&self, tried: &[Tried]) -> Vec<usize> {
        let mut order: Vec<usize> = (0..tried.len()).collect();
        order.sort_by(|one, other| self.merit(&tried[*other]).total_cmp(&self.merit(&tried[*one])));
        order
    }

    /// The place of the best setting of those whose places count; `None` if none has a value.
    #[must_use]
    pub fn best(&self, tried: &[Tried], counts: impl Fn(usize) -> bool) -> Option<usize> {
        let first = self.ranking(tried).into_iter().find(|place| counts(*place))?;
        tried[first].value.map(|_| first)
    }

    /// Whether a setting with a trial in this end state ranks last, and the search goes on without it.
    #[must_use]
    pub fn ranks_last(&self, end: EndState) -> bool {
        match end {
            // The numbers of the trial decide this: it ends like that wherever it runs.
            EndState::Nan => true,
            EndState::Failed | EndState::Panicked | EndState::Timeout | EndState::Oom => {
                self.failed == Failed::RankLast
            }
            EndState::Ok | EndState::Killed | EndState::Paused => false,
        }
    }

    fn merit(&self, tried: &Tried) -> f64 {
        tried
            .value
            .map_or(f64::NEG_INFINITY, |value| self.direction.merit(value))
    }

    /// The setting at a place; `points` are those before it and `tried` those with a known end. A setting that was
    /// tried before is drawn again, and finally drawn at random.
    fn propose(&self, place: usize, points: &[Point], tried: &[Tried]) -> Point {
        let mut rng = random::stream(&["search", &self.identity(), &place.to_string()]);
        let space = self.space();
        let known: Vec<(&[Value], f64)> = tried.iter().map(|it| (&it.point[..], self.merit(it))).collect();
        let under_way: Vec<&[Value]> = points[tried.len()..].iter().map(Vec::as_slice).collect();
        let mut draw = |by_chance: bool| match &self.method {
            Method::TreeParzen(options) if place >= options.startup && !by_chance => {
                tree_parzen::propose(&space, &known, &under_way, options.candidates, &mut rng)
            }
            _ => tree_parzen::random(&space, &mut rng),
        };
        let mut point = draw(false);
        for redraw in 0..2 * MOST_REDRAWS {
            if !points.contains(&point) {
                break;
            }
            point = draw(redraw >= MOST_REDRAWS);
        }
        point
    }

    /// Hash of the searched keys and the method. Names of the study and the number of settings are not part of it.
    fn identity(&self) -> String {
        let last = |text: &str| text.split_once('.').map_or(text, |(_, key)| key).to_owned();
        let keys: Vec<(String, String)> = self
            .keys
            .iter()
            .map(|(key, range)| (last(key), format!("{range:?}")))
            .collect();
        // These words are those of earlier versions, so that the streams of a study do not change.
        let direction = match self.direction {
            Direction::Maximize => "most",
            Direction::Minimize => "least",
        };
        digest::of_json(&json!([
            self.plugin,
            keys,
            self.metric,
            direction,
            self.method,
            self.seeds
        ]))
    }
}

/// These places from the best to the worst at a pause, without those that failed; of equal ones the earlier is better.
/// `None` as long as one has not reached the pause.
fn best_at(
    direction: Direction,
    tried: &[Tried],
    places: impl Iterator<Item = usize>,
    pause: u64,
) -> Option<Vec<usize>> {
    let merit = |place: usize| {
        let value = tried[place].pauses.get(&pause)?;
        Some((place, value.map(|value| direction.merit(value))))
    };
    let merits: Vec<(usize, Option<f64>)> = places.map(merit).collect::<Option<_>>()?;
    let well = merits
        .into_iter()
        .filter_map(|(place, merit)| Some((place, merit?)));
    let mut well: Vec<(usize, f64)> = well.collect();
    well.sort_by(|one, other| other.1.total_cmp(&one.1));
    Some(well.into_iter().map(|(place, _)| place).collect())
}

/// A share of a count, rounded.
#[allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a share of a count is a count"
)]
fn share_of(count: usize, share: f64) -> usize {
    (count as f64 * share).round() as usize
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
