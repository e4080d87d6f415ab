//! Covariance matrix adaptation (CMA-ES, Hansen and Ostermeier 2001). Settings are drawn from a normal distribution
//! over the shares of the ranges, which moves to the better ones of each generation and takes their shape.
//!
//! The state is not stored. It is computed from the stored values by repeating every generation, in order, until one
//! has a setting without a value. A setting that is drawn again is not tried again: its value counts once more.

mod distribution;
mod ending;

use super::{Point, Range, tree_parzen};
use contract::random;
use distribution::Distribution;
use ending::Ending;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::{HashMap, HashSet};

/// Value of a setting that failed: worse than all others.
const FAILED: f64 = f64::MAX;
/// Number of generations without a new setting after which the search restarts with twice the population.
const MOST_IDLE_GENERATIONS: usize = 50;
/// Number of starts after which the remaining settings are drawn at random, as in a small space that is nearly
/// exhausted.
const MOST_BEGINNINGS: u64 = 12;
/// Number of random draws for each setting before settings that were tried are used again.
const MOST_DRAWS: usize = 100;

/// Covariance matrix adaptation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CmaEs {
    /// Settings of a generation, which are tried together; 4 + 3 ln d for d keys where absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 2, max = 1000))]
    pub population: Option<usize>,
    /// Standard deviation of the first generation, as a share of each range; its mean is in the middle.
    #[schemars(range(min = 0.001, max = 1.0))]
    pub spread: f64,
}

impl Default for CmaEs {
    fn default() -> Self {
        Self {
            population: None,
            spread: 0.3,
        }
    }
}

/// The settings in the order in which they are asked for, up to the first generation with a missing value, and at most
/// `n_settings`. A value is missing if `known` has none for the setting. Larger values are better.
pub(super) fn settings(
    options: &CmaEs,
    space: &[Range],
    identity: &str,
    n_settings: usize,
    known: &HashMap<String, f64>,
) -> Vec<Point> {
    let mut asked = RequestedSettings::new(space, known, n_settings);
    for beginning in 0..MOST_BEGINNINGS {
        if asked.is_done() {
            break;
        }
        search_from_the_middle(options, identity, beginning, &mut asked);
    }
    asked.fill_by_chance(identity);
    asked.points
}

/// Asks for generation after generation until the search ends or nothing more can be asked. Each start has twice the
/// population of the one before (IPOP, Auger and Hansen 2005).
fn search_from_the_middle(
    options: &CmaEs,
    identity: &str,
    beginning: u64,
    asked: &mut RequestedSettings<'_>,
) {
    let mut rng = random::stream(&["search", identity, "beginning", &beginning.to_string()]);
    let n_keys = asked.space.len();
    let population = options.population.unwrap_or_else(|| default_population(n_keys)) << beginning;
    let mut distribution = Distribution::new(n_keys, options.spread, population);
    let mut ending = Ending::new(n_keys, population);
    let mut n_idle = 0;
    loop {
        let n_before = asked.points.len();
        let mut drawn: Vec<_> = (0..population)
            .map(|_| distribution.draw(&mut rng))
            .map(|draw| (asked.value(draw.as_slice()), draw))
            .collect();
        n_idle = if asked.points.len() > n_before {
            0
        } else {
            n_idle + 1
        };
        if asked.is_done() || n_idle == MOST_IDLE_GENERATIONS {
            return;
        }
        drawn.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        let (values, ranked): (Vec<f64>, Vec<_>) = drawn.into_iter().unzip();
        distribution.learn(&ranked);
        if ending.is_reached(&values) || distribution.is_degenerate(options.spread) {
            return;
        }
    }
}

/// `4 + 3 ln n`, rounded down (Hansen 2016).
fn default_population(n_keys: usize) -> usize {
    4 + (3.0 * (n_keys as f64).ln()) as usize
}

/// The settings that were asked for so far.
struct RequestedSettings<'a> {
    space: &'a [Range],
    known: &'a HashMap<String, f64>,
    n_settings: usize,
    points: Vec<Point>,
    words: HashSet<String>,
    has_unknown: bool,
}

impl<'a> RequestedSettings<'a> {
    fn new(space: &'a [Range], known: &'a HashMap<String, f64>, n_settings: usize) -> Self {
        Self {
            space,
            known,
            n_settings,
            points: Vec::new(),
            words: HashSet::new(),
            has_unknown: false,
        }
    }

    /// Whether nothing more can be asked before the requested settings have values.
    fn is_done(&self) -> bool {
        self.has_unknown || self.points.len() >= self.n_settings
    }

    /// The value at shares, to be minimised. Shares beyond the ends are reflected there. The value of an unknown
    /// setting does not matter, since its generation is the last.
    fn value(&mut self, shares: &[f64]) -> f64 {
        let point: Point = self
            .space
            .iter()
            .zip(shares)
            .map(|(range, share)| range.at(reflected(*share)))
            .collect();
        self.ask(point).map_or(FAILED, |merit| (-merit).min(FAILED))
    }

    fn ask(&mut self, point: Point) -> Option<f64> {
        let word = word(&point);
        let value = self.known.get(&word).copied();
        if self.points.len() < self.n_settings && self.words.insert(word) {
            self.points.push(point);
            self.has_unknown |= value.is_none();
        }
        value
    }

    /// Fills up with random settings if every start came to an end before all settings were tried.
    fn fill_by_chance(&mut self, identity: &str) {
        let mut rng = random::stream(&["search", identity, "by chance"]);
        let mut draws = 0;
        while !self.is_done() {
            let point = tree_parzen::random(self.space, &mut rng);
            draws += 1;
            if draws > MOST_DRAWS * self.n_settings {
                // The space is nearly exhausted: the remaining settings are tried again.
                self.words.clear();
            }
            self.ask(point);
        }
    }
}

/// A setting in the form of a key.
pub(super) fn word(point: &Point) -> String {
    serde_json::Value::from(point.clone()).to_string()
}

/// A share between 0 and 1, as if the ends were mirrors.
fn reflected(share: f64) -> f64 {
    let turn = share.rem_euclid(2.0);
    if turn > 1.0 { 2.0 - turn } else { turn }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_reflected_at_both_ends() {
        let places = [-0.25, 0.0, 0.4, 1.0, 1.25, 2.5, -1.5];
        let expected = [0.25, 0.0, 0.4, 1.0, 0.75, 0.5, 0.5];
        for (place, expected) in places.into_iter().zip(expected) {
            assert!((reflected(place) - expected).abs() < 1e-15, "{place}");
        }
    }
}
