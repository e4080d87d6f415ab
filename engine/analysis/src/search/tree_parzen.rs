//! The tree-structured Parzen estimator with joint kernels: settings that lie near good ones and far from others.
//!
//! Bergstra, Bardenet, Bengio and Kegl 2011, "Algorithms for hyper-parameter optimization", NeurIPS, section 4, in the
//! form that Optuna made its default (Watanabe 2023, "Tree-structured Parzen estimator", arXiv 2304.11127): one mixture
//! for all keys together, a kernel for each setting and a wide one as the prior.
//!
//! | paper | here |
//! |---|---|
//! | gamma | `GOOD_SHARE`: the best settings are the good ones, at most `MOST_GOOD` of them |
//! | l(x), g(x) | `Mixture` of the good settings and of the others |
//! | l(x) / g(x) | the criterion of a proposal: the largest of `candidates` drawn from l |
//! | b | `width`: 0.2 n^(-1 / (d + 4)) of the range, and no less than one part in min(100, n + 2) of it |
//!
//! Settings whose trials are running count among the others (a constant liar), so that a batch spreads out.

use super::range::{Numbers, Range, option};
use contract::random::Rng;
use rand::Rng as _;
use serde_json::Value;
use statistics::normal;

/// Share of the settings that counts as good.
const GOOD_SHARE: f64 = 0.1;
/// Largest number of settings that count as good.
const MOST_GOOD: usize = 25;
/// Number of latest settings with equal weights; older ones weigh less.
const FULL_WEIGHTS: usize = 25;
/// Width of a kernel of a single setting.
const WIDTH: f64 = 0.2;

/// The next setting: the best of the candidates by the ratio of both densities. `tried` are the settings with values,
/// best values first, where equal ones keep their order; `under_way` are those without a value yet.
pub(super) fn propose(
    space: &[Range],
    tried: &[(&[Value], f64)],
    under_way: &[&[Value]],
    candidates: usize,
    rng: &mut Rng,
) -> Vec<Value> {
    let n_good = n_good(tried.len());
    let mut order: Vec<usize> = (0..tried.len()).collect();
    order.sort_by(|one, other| tried[*other].1.total_cmp(&tried[*one].1));
    let is_good = |index: &usize| order[..n_good].contains(index);
    // Weights fall with age, so both parts keep the order in which settings were tried.
    let (good, others): (Vec<usize>, Vec<usize>) = (0..tried.len()).partition(is_good);
    let settings = |part: &[usize]| part.iter().map(|index| tried[*index].0).collect::<Vec<_>>();
    let likely = Mixture::of(space, &settings(&good));
    let unlikely = Mixture::of(space, &[settings(&others), under_way.to_vec()].concat());
    let candidate = |_| {
        let setting = likely.draw(rng);
        let score = likely.log_density(&setting) - unlikely.log_density(&setting);
        (setting, score)
    };
    let better =
        |best: (Vec<Value>, f64), other: (Vec<Value>, f64)| if other.1 > best.1 { other } else { best };
    (0..candidates.max(1))
        .map(candidate)
        .reduce(better)
        .unwrap_or_default()
        .0
}

#[allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a share of a count is a count"
)]
fn n_good(n_tried: usize) -> usize {
    ((GOOD_SHARE * n_tried as f64).ceil() as usize).min(MOST_GOOD)
}

/// A sum of kernels over all keys.
struct Mixture<'a> {
    space: &'a [Range],
    kernels: Vec<Kernel>,
}

struct Kernel {
    weight: f64,
    /// One factor for each key.
    factors: Vec<Factor>,
}

/// The distribution of one key around one setting.
enum Factor {
    /// A normal distribution on the line of shares, cut off at its ends.
    Normal(CutNormal),
    /// Probability of each listed value.
    Listed(Vec<f64>),
}

impl<'a> Mixture<'a> {
    fn of(space: &'a [Range], settings: &[&[Value]]) -> Self {
        let n = settings.len();
        let weights = weights(n);
        let sum: f64 = weights.iter().sum();
        let width = width(n, space.len());
        let around = |setting: Option<&[Value]>| {
            let factors = space.iter().enumerate();
            let factors =
                factors.map(|(key, range)| factor(range, setting.map(|values| &values[key]), width, n));
            factors.collect()
        };
        let settings = settings.iter().copied().map(Some).chain([None]);
        let kernels = settings.zip(weights).map(|(setting, weight)| Kernel {
            weight: weight / sum,
            factors: around(setting),
        });
        Self {
            space,
            kernels: kernels.collect(),
        }
    }

    fn draw(&self, rng: &mut Rng) -> Vec<Value> {
        let weights: Vec<f64> = self.kernels.iter().map(|kernel| kernel.weight).collect();
        let kernel = &self.kernels[drawn(&weights, rng)];
        let values = self
            .space
            .iter()
            .zip(&kernel.factors)
            .map(|(range, factor)| match (range, factor) {
                (Range::Choice(values), Factor::Listed(shares)) => values[drawn(shares, rng)].clone(),
                (_, Factor::Normal(normal)) => range.at(normal.draw(rng)),
                (_, Factor::Listed(_)) => range.at(rng.random()),
            });
        values.collect()
    }

    fn log_density(&self, setting: &[Value]) -> f64 {
        let of_kernel = |kernel: &Kernel| {
            let factors = self.space.iter().zip(&kernel.factors).zip(setting);
            kernel.weight.ln()
                + factors
                    .map(|((range, factor), value)| factor.log_density(range, value))
                    .sum::<f64>()
        };
        let logs: Vec<f64> = self.kernels.iter().map(of_kernel).collect();
        let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        largest + logs.iter().map(|log| (log - largest).exp()).sum::<f64>().ln()
    }
}

/// The factor around a value, or the wide one before any result.
fn factor(range: &Range, value: Option<&Value>, width: f64, n_settings: usize) -> Factor {
    match range {
        Range::Numbers(numbers) => Factor::Normal(match value.and_then(Value::as_f64) {
            Some(value) => CutNormal::new(middle(numbers, value), width),
            None => CutNormal::new(0.5, 1.0),
        }),
        Range::Choice(values) => Factor::Listed(listed(values, value, n_settings)),
    }
}

/// Every value has a part of one count, and the value of the setting has a whole one more.
#[allow(clippy::cast_precision_loss, reason = "few settings and values")]
fn listed(values: &[Value], taken: Option<&Value>, n_settings: usize) -> Vec<f64> {
    let prior = 1.0 / (n_settings as f64 + 1.0);
    let count = |value: &Value| prior + f64::from(u8::from(Some(value) == taken));
    let sum: f64 = values.iter().map(count).sum();
    values.iter().map(|value| count(value) / sum).collect()
}

fn middle(numbers: &Numbers, value: f64) -> f64 {
    let (from, to) = numbers.cell(value);
    0.5 * (from + to)
}

impl Factor {
    fn log_density(&self, range: &Range, value: &Value) -> f64 {
        match (self, range) {
            (Self::Normal(normal), Range::Numbers(numbers)) => {
                let (from, to) = numbers.cell(value.as_f64().unwrap_or(f64::NAN));
                normal.log_density(from, to)
            }
            (Self::Listed(shares), Range::Choice(values)) => {
                let at = values.iter().position(|known| known == value);
                at.map_or(f64::NEG_INFINITY, |at| shares[at].ln())
            }
            _ => 0.0,
        }
    }
}

/// A normal distribution cut off at 0 and 1.
#[derive(Clone, Copy)]
struct CutNormal {
    mean: f64,
    sd: f64,
    /// Probability below 0, and between 0 and 1, of the distribution that is not cut off.
    below: f64,
    inside: f64,
}

impl CutNormal {
    fn new(mean: f64, sd: f64) -> Self {
        let [below, most] = [0.0, 1.0].map(|end| normal::cdf((end - mean) / sd));
        Self {
            mean,
            sd,
            below,
            inside: most - below,
        }
    }

    fn draw(&self, rng: &mut Rng) -> f64 {
        let probability = self.below + rng.random::<f64>() * self.inside;
        (self.mean + self.sd * normal::quantile(probability)).clamp(0.0, 1.0)
    }

    /// Logarithm of the probability of a stretch, or of the density at a point.
    fn log_density(&self, from: f64, to: f64) -> f64 {
        let scaled = |share: f64| (share - self.mean) / self.sd;
        let amount = if to > from {
            normal::cdf(scaled(to)) - normal::cdf(scaled(from))
        } else {
            normal::density(scaled(from)) / self.sd
        };
        // The value is so far from the mean that no digit is left; its probability is taken as the smallest number.
        (amount.max(f64::MIN_POSITIVE) / self.inside).ln()
    }
}

/// A weight for each setting, the oldest first, and one for the wide kernel before any result.
#[allow(clippy::cast_precision_loss, reason = "few settings")]
fn weights(n_settings: usize) -> Vec<f64> {
    let n_old = n_settings.saturating_sub(FULL_WEIGHTS);
    let first = 1.0 / n_settings.max(1) as f64;
    let ramp = (0..n_old).map(|index| first + (1.0 - first) * index as f64 / (n_old.max(2) - 1) as f64);
    ramp.chain(std::iter::repeat_n(1.0, n_settings - n_old + 1))
        .collect()
}

#[allow(clippy::cast_precision_loss, reason = "few settings and keys")]
fn width(n_settings: usize, n_keys: usize) -> f64 {
    let n = n_settings as f64;
    let least = 1.0 / (n + 2.0).min(100.0);
    (WIDTH * n.max(1.0).powf(-1.0 / (n_keys as f64 + 4.0))).clamp(least, 1.0)
}

/// An index, drawn with the probability of its share.
fn drawn(shares: &[f64], rng: &mut Rng) -> usize {
    let mut left: f64 = rng.random();
    let passed = |share: &f64| {
        left -= share;
        left < 0.0
    };
    shares.iter().position(passed).unwrap_or(shares.len() - 1)
}

/// A setting whose values are all equally likely.
pub(super) fn random(space: &[Range], rng: &mut Rng) -> Vec<Value> {
    let value = |range: &Range| match range {
        Range::Choice(values) => values[option(rng.random(), values.len())].clone(),
        Range::Numbers(numbers) => numbers.at(rng.random()),
    };
    space.iter().map(value).collect()
}

#[cfg(test)]
#[path = "tree_parzen_tests.rs"]
mod tests;
