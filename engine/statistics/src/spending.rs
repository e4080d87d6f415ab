//! Group-sequential levels: the nominal level of each of several planned looks at a growing number of seeds.
//!
//! Testing at 5 % after 5 seeds, after 10 and so on errs far more often than in 5 % of all studies. A
//! [`SequentialDesign`] names its looks before the first seed and spends the error step by step, by the function of
//! Pocock's type of Lan and DeMets (1983, doi:10.1093/biomet/70.3.659), `alpha(t) = alpha ln(1 + (e - 1) t)` with
//! `t = n / most`. At every look an interval at the look's nominal level may be compared with any edge, independently
//! of earlier results (repeated confidence intervals, Jennison and Turnbull 1989, Journal of the Royal Statistical
//! Society B 51, 305-361).
//!
//! The boundaries follow from the recursive integration of Armitage, McPherson and Rowe (1969, doi:10.2307/2343787) for
//! normal increments. Levels have a relative error below 1e-7. They hold for normal data of known spread. By way of
//! Student's t, a nominal level p becomes the quantile `t(1 - p, n - 1)`, so they hold closely for few seeds too.
//!
//! | equation | here                                                              |
//! |----------|-------------------------------------------------------------------|
//! | t        | `time`: share of the seeds of the last look                       |
//! | S(t)     | Brownian motion without drift: sum of the seeds so far, scaled    |
//! | Z(t)     | `S(t) / sqrt(t)`, the statistic of a look, standard normal        |
//! | c        | `boundary`: the value that `Z` must reach                         |

use super::{normal, quadrature};
use serde::{Deserialize, Serialize};
use std::f64::consts::E;

/// Lower end of the integrals; less than 1e-10 of a standard normal distribution lies below.
const LOWEST: f64 = -6.4;
/// Largest increment in standard deviations; larger ones are left out.
const FARTHEST: f64 = 10.0;

/// Planned numbers of seeds, rising; the last is the largest. It is serialised as the list of these numbers.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Vec<u32>", into = "Vec<u32>")]
pub struct SequentialDesign {
    looks: Vec<u32>,
}

/// Reason why numbers of seeds are no design.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum DesignError {
    /// The list of looks is empty.
    #[error("a design has at least one look")]
    Empty,
    /// The first of several looks has too few seeds for an interval.
    #[error("the first of several looks needs at least 2 seeds, not {first}")]
    TooEarly {
        /// Seeds of the first look.
        first: u32,
    },
    /// A look has no more seeds than the one before.
    #[error("looks rise: {next} does not follow {look}")]
    NotRising {
        /// Seeds of the earlier look.
        look: u32,
        /// Seeds of the look after it.
        next: u32,
    },
}

impl TryFrom<Vec<u32>> for SequentialDesign {
    type Error = DesignError;

    fn try_from(looks: Vec<u32>) -> Result<Self, DesignError> {
        match looks[..] {
            [] => return Err(DesignError::Empty),
            [first, _, ..] if first < 2 => return Err(DesignError::TooEarly { first }),
            _ => (),
        }
        match looks.windows(2).find(|pair| pair[0] >= pair[1]) {
            Some(pair) => Err(DesignError::NotRising {
                look: pair[0],
                next: pair[1],
            }),
            None => Ok(Self { looks }),
        }
    }
}

impl From<SequentialDesign> for Vec<u32> {
    fn from(design: SequentialDesign) -> Self {
        design.looks
    }
}

impl SequentialDesign {
    /// The design with these looks.
    ///
    /// # Panics
    ///
    /// If there is no look, looks do not rise, or the first of several has fewer than two seeds; use `try_from` for
    /// numbers that are not known to be valid.
    #[must_use]
    pub fn new(looks: Vec<u32>) -> Self {
        match Self::try_from(looks) {
            Ok(design) => design,
            Err(error) => panic!("{error}"),
        }
    }

    /// One look, after `n` seeds: the level is not divided.
    #[must_use]
    pub fn fixed(n: u32) -> Self {
        Self { looks: vec![n] }
    }

    /// Numbers of seeds at which the results may be tested.
    #[must_use]
    pub fn looks(&self) -> &[u32] {
        &self.looks
    }

    /// Seeds of the last look.
    #[must_use]
    pub fn most(&self) -> u32 {
        self.looks.last().copied().unwrap_or_default()
    }

    /// One-sided nominal level of each look, such that the probability of crossing at any look up to the k-th
    /// is the spent `alpha(t_k)`; the only look of a fixed design has `alpha` itself. NaN unless `alpha` lies
    /// between 0 and 1.
    #[must_use]
    pub fn nominal_levels(&self, alpha: f64) -> Vec<f64> {
        if self.looks.len() == 1 || !(alpha > 0.0 && alpha < 1.0) {
            let level = if alpha > 0.0 && alpha < 1.0 {
                alpha
            } else {
                f64::NAN
            };
            return vec![level; self.looks.len()];
        }
        let times: Vec<f64> = self
            .looks
            .iter()
            .map(|&n| f64::from(n) / f64::from(self.most()))
            .collect();
        let mut paths = Paths::at_start();
        let mut level_of = |(k, &time): (usize, &f64)| {
            let boundary = paths.boundary(time, alpha);
            if let Some(&next) = times.get(k + 1) {
                paths = paths.below(boundary, time, next);
            }
            normal::upper_tail(boundary)
        };
        times.iter().enumerate().map(&mut level_of).collect()
    }
}

/// The part of `alpha` that may be spent up to `time`.
fn spent(alpha: f64, time: f64) -> f64 {
    alpha * ((E - 1.0) * time).ln_1p()
}

/// The paths that have not crossed at any look so far: the density of `Z` at the rising points of a quadrature, times
/// their weights.
struct Paths {
    time: f64,
    points: Vec<(f64, f64)>,
}

impl Paths {
    /// Every path, at 0.
    fn at_start() -> Self {
        Self {
            time: 0.0,
            points: vec![(0.0, 1.0)],
        }
    }

    /// The boundary at `time`: the share of all paths that reach it there for the first time is the level spent between
    /// the looks.
    fn boundary(&self, time: f64, alpha: f64) -> f64 {
        let newly = spent(alpha, time) - spent(alpha, self.time);
        // The paths that are high enough now include all that cross now, but not all of them cross for the first time.
        let (mut low, mut high) = (-normal::quantile(spent(alpha, time)), -normal::quantile(newly));
        let mut boundary = low;
        // The share is convex, so that Newton's method from below neither overshoots nor needs ten steps.
        for _ in 0..60 {
            let excess = self.crossing(time, boundary) - newly;
            if excess > 0.0 {
                low = boundary;
            } else {
                high = boundary;
            }
            let newton = boundary + excess / self.density(time, boundary);
            let next = if newton > low && newton < high {
                newton
            } else {
                f64::midpoint(low, high)
            };
            if (next - boundary).abs() < 1e-12 {
                return next;
            }
            boundary = next;
        }
        boundary
    }

    /// Share of all paths that have not crossed so far and have `Z >= boundary` at `time`.
    fn crossing(&self, time: f64, boundary: f64) -> f64 {
        let too_low = self
            .points
            .partition_point(|(place, _)| self.increment(*place, time, boundary) > FARTHEST);
        let crossing = |(place, weight): &(f64, f64)| {
            weight * normal::upper_tail(self.increment(*place, time, boundary))
        };
        self.points[too_low..].iter().map(crossing).sum()
    }

    /// Density of `Z = value` at `time` among paths that have not crossed so far.
    fn density(&self, time: f64, value: f64) -> f64 {
        let too_low = self
            .points
            .partition_point(|(place, _)| self.increment(*place, time, value) > FARTHEST);
        let near = self.points[too_low..]
            .iter()
            .map(|(place, weight)| (self.increment(*place, time, value), weight));
        let sum: f64 = near
            .take_while(|(step, _)| *step > -FARTHEST)
            .map(|(step, weight)| weight * normal::density(step))
            .sum();
        (time / (time - self.time)).sqrt() * sum
    }

    /// The increment of `S` that leads from `Z = place` now to `Z = value` at `time`, in its standard
    /// deviations.
    fn increment(&self, place: f64, time: f64, value: f64) -> f64 {
        (value * time.sqrt() - place * self.time.sqrt()) / (time - self.time).sqrt()
    }

    /// The paths that do not reach `boundary` at `time` either. `next` is the time of the look after it: the
    /// panels are at most as wide as two standard deviations of the increments before and after, in units of
    /// `Z`.
    fn below(&self, boundary: f64, time: f64, next: f64) -> Self {
        let shortest = (next - time).min(time - self.time);
        let widest = 2.0 * (shortest / time).sqrt();
        let point = |(place, weight)| (place, weight * self.density(time, place));
        Self {
            time,
            points: quadrature::points(LOWEST, boundary, widest).map(point).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        student_t,
        tests::{assert_close, normal_pair, numbers, sequential_reference},
    };
    use proptest::prelude::*;

    fn looks(value: &serde_json::Value) -> Vec<u32> {
        serde_json::from_value(value.clone()).unwrap()
    }

    #[test]
    fn levels_agree_with_rpact() {
        let text = include_str!("../../../tests/fixtures/statistics/spending.json");
        let cases: Vec<serde_json::Value> = serde_json::from_str(text).unwrap();
        for case in &cases {
            let levels =
                SequentialDesign::new(looks(&case["looks"])).nominal_levels(case["alpha"].as_f64().unwrap());
            for (level, expected) in levels.iter().zip(numbers(&case["levels"])) {
                assert!(
                    (level - expected).abs() < 2e-8,
                    "{level} is not {expected} in {case}"
                );
            }
        }
        assert_eq!(cases.len(), 17);
    }

    /// The same integrals on a much finer grid, which shows the accuracy stated above.
    #[test]
    fn levels_agree_with_a_fine_grid() {
        for case in sequential_reference()["spending"].as_array().unwrap() {
            let levels =
                SequentialDesign::new(looks(&case["looks"])).nominal_levels(case["alpha"].as_f64().unwrap());
            for (level, expected) in levels.iter().zip(numbers(&case["levels"])) {
                assert!(
                    (level / expected - 1.0).abs() < 1e-7,
                    "{level} is not {expected} in {case}"
                );
            }
        }
    }

    #[test]
    fn one_look_is_not_divided() {
        assert_eq!(SequentialDesign::fixed(5).nominal_levels(0.05), [0.05]);
        assert_eq!(
            (SequentialDesign::fixed(5).most(), SequentialDesign::fixed(5)),
            (5, SequentialDesign::new(vec![5]))
        );
        assert_eq!(
            SequentialDesign::new(vec![5, 10]).nominal_levels(f64::NAN).len(),
            2
        );
        assert!(SequentialDesign::fixed(5).nominal_levels(1.0)[0].is_nan());
    }

    #[test]
    fn what_is_no_design() {
        let error = |looks: &[u32]| SequentialDesign::try_from(looks.to_vec()).unwrap_err();
        assert_eq!(error(&[]), DesignError::Empty);
        assert_eq!(error(&[1, 4]), DesignError::TooEarly { first: 1 });
        assert_eq!(error(&[5, 10, 10]), DesignError::NotRising { look: 10, next: 10 });
        assert_eq!(error(&[5, 3]).to_string(), "looks rise: 3 does not follow 5");
    }

    #[test]
    fn it_is_written_as_a_list() {
        let design = SequentialDesign::new(vec![5, 10, 30]);
        assert_eq!(serde_json::to_string(&design).unwrap(), "[5,10,30]");
        assert_eq!(
            serde_json::from_str::<SequentialDesign>("[5,10,30]").unwrap(),
            design
        );
        let error = serde_json::from_str::<SequentialDesign>("[5,10,8]")
            .unwrap_err()
            .to_string();
        assert!(error.contains("8 does not follow 10"), "{error}");
    }

    /// Looks with the half-width of the interval there, in standard deviations of the sample.
    fn rule(levels: &[f64]) -> Vec<(usize, f64)> {
        let half_width = |(n, level): (u32, &f64)| {
            let n = f64::from(n);
            (n as usize, student_t::quantile(1.0 - level, n - 1.0) / n.sqrt())
        };
        LOOKS.into_iter().zip(levels).map(half_width).collect()
    }

    /// Whether the first interval that lies inside or outside the band lies inside, and the number of seeds by then.
    fn decide(rule: &[(usize, f64)], moments: &[(f64, f64)], low: f64, high: f64) -> (bool, usize) {
        for &(n, half_width) in rule {
            let (mean, sd) = moments[n - 1];
            let (from, to) = (mean - half_width * sd, mean + half_width * sd);
            if low <= from && to <= high {
                return (true, n);
            }
            if to < low || high < from {
                return (false, n);
            }
        }
        (false, moments.len())
    }

    /// Mean and standard deviation of the first one, two and so on of `n` standard normal draws.
    fn moments(n: usize, rng: &mut contract::random::Rng) -> Vec<(f64, f64)> {
        let (mut sum, mut squares) = (0.0, 0.0);
        let mut next = |(k, draw): (usize, f64)| {
            let n = (k + 1) as f64;
            sum += draw;
            squares += draw * draw;
            (sum / n, ((squares - sum * sum / n) / (n - 1.0)).sqrt())
        };
        (0..n / 2)
            .flat_map(|_| normal_pair(rng))
            .enumerate()
            .map(&mut next)
            .collect()
    }

    const LOOKS: [u32; 6] = [5, 10, 15, 20, 25, 30];

    /// The share of studies that a rule calls reproduced although the true value lies exactly at the edge of the band,
    /// with margins of half a standard deviation, one and two, and the mean number of seeds if the true value is the
    /// published one, with margin one.
    fn operating_characteristics(levels: &[f64]) -> ([f64; 3], f64) {
        let (rule, runs) = (rule(levels), 60_000);
        let mut rng = contract::random::stream(&["test", "sequential equivalence"]);
        let (mut reproduced, mut seeds) = ([0_u32; 3], 0);
        for _ in 0..runs {
            let moments = moments(30, &mut rng);
            for (count, margin) in reproduced.iter_mut().zip([0.5, 1.0, 2.0]) {
                *count += u32::from(decide(&rule, &moments, -2.0 * margin, 0.0).0);
            }
            seeds += decide(&rule, &moments, -1.0, 1.0).1;
        }
        (
            reproduced.map(|count| f64::from(count) / f64::from(runs)),
            seeds as f64 / f64::from(runs),
        )
    }

    fn assert_characteristics(levels: &[f64], sizes: [f64; 3], seeds: f64) {
        let found = operating_characteristics(levels);
        // The standard error of a share is at most 0.0015.
        let close = found
            .0
            .iter()
            .zip(sizes)
            .all(|(found, size)| (found - size).abs() < 0.004);
        assert!(close && (found.1 - seeds).abs() < 0.1, "{found:?}");
    }

    #[test]
    fn the_level_holds_over_all_looks() {
        let levels = SequentialDesign::new(LOOKS.to_vec()).nominal_levels(0.05);
        assert_characteristics(&levels, [0.034, 0.052, 0.053], 13.3);
    }

    /// Without spending, the level does not hold.
    #[test]
    fn without_spending_the_level_does_not_hold() {
        assert_characteristics(&[0.05; 6], [0.113, 0.144, 0.147], 9.6);
    }

    proptest! {
        /// Each level is at most the one that may be spent by then and at least the one spent there. Together they
        /// exceed the total, since crossings at several looks count once.
        #[test]
        fn levels_are_bounded(
            looks in prop::collection::btree_set(2_u32..200, 2..8),
            alpha in prop::sample::select(vec![1e-5, 0.001, 0.05, 0.4]),
        ) {
            let design = SequentialDesign::new(looks.into_iter().collect());
            let levels = design.nominal_levels(alpha);
            let mut before = 0.0;
            for (level, n) in levels.iter().zip(design.looks()) {
                let now = spent(alpha, f64::from(*n) / f64::from(design.most()));
                prop_assert!(*level >= (now - before) * (1.0 - 1e-9) && *level <= now * (1.0 + 1e-9));
                before = now;
            }
            assert_close(before, alpha, 1e-15);
            prop_assert!(levels.iter().sum::<f64>() > alpha);
        }
    }
}
