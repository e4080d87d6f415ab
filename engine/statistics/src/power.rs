//! Number of seeds that a study needs: the power of Student-t intervals, and the number of seeds that gives a wanted
//! power.
//!
//! An interval decides when it clears its edges: one edge for a direction or a difference, both edges of a band for
//! equivalence. If the true values are the estimated ones, the probability of that after n seeds is `E[Phi(above - t U)
//! - Phi(t U - below)]`, with the distances in standard errors, `t` the quantile of the interval and `U = s / sigma`
//! the ratio of the observed spread to the true one, a chi variable over the root of its degrees of freedom. For one
//! edge this is the noncentral t distribution, for two it is the exact power of the two one-sided tests (Phillips 1990,
//! doi:10.1007/BF01063556); for two samples of unequal spread the degrees of freedom are approximate. The integral over
//! `U` is done numerically, with an error below 1e-9 for two and more degrees of freedom.
//!
//! A number of seeds that is based on an estimated mean and spread is itself an estimate: it would suffice if both were
//! exact.

use super::{normal, quadrature, student_t};

/// The default power.
pub const POWER: f64 = 0.8;

/// Distances from an estimate to the edges that the ends of its interval must not reach; infinite if there is no edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Room {
    /// Distance to the edge below; negative if the estimate lies beyond it.
    pub below: f64,
    /// Distance to the edge above; negative if the estimate lies beyond it.
    pub above: f64,
}

impl Room {
    /// A single edge at `distance`, on either side.
    #[must_use]
    pub fn to_edge(distance: f64) -> Self {
        Self {
            below: f64::INFINITY,
            above: distance,
        }
    }

    /// The room of an estimate between both edges of a band.
    #[must_use]
    pub fn in_band(value: f64, low: f64, high: f64) -> Self {
        Self {
            below: value - low,
            above: high - value,
        }
    }

    /// The same distances in other units.
    fn in_units_of(self, unit: f64) -> Self {
        Self {
            below: self.below / unit,
            above: self.above / unit,
        }
    }
}

/// Probability that an interval clears the edges; each of its ends is a bound at the one-sided level `nominal`.
///
/// `room` is measured from the true value, in the unit of `error`, the true standard error. NaN unless
/// `degrees_of_freedom >= 1` and `0 < nominal < 1/2`.
#[must_use]
pub fn power(room: Room, error: f64, degrees_of_freedom: f64, nominal: f64) -> f64 {
    let t = student_t::quantile(1.0 - nominal, degrees_of_freedom);
    let Room { below, above } = room.in_units_of(error);
    if below.is_nan() || above.is_nan() || t.is_nan() || t <= 0.0 || degrees_of_freedom < 1.0 {
        return f64::NAN;
    }
    let spread = SpreadRatio { degrees_of_freedom };
    // With a larger ratio the interval is wider than the band, or almost certainly crosses the edge.
    let largest = f64::midpoint(below, above).min(below.min(above) + FARTHEST) / t;
    let clear = |ratio: f64| normal::cdf(above - t * ratio) - normal::cdf(t * ratio - below);
    spread.integral(largest, 1.0 / t, clear) / spread.integral(f64::INFINITY, f64::INFINITY, |_| 1.0)
}

/// The smallest number of seeds after which the interval of a mean clears one edge with probability `wanted`, if the
/// true mean lies at `distance` from it and the true standard deviation is `sd`; `None` if more than `most` would be
/// needed.
///
/// This is the number for a direction and for a value that differs. It is an estimate if `distance` and `sd` are
/// estimates.
#[must_use]
pub fn seeds_for_power(distance: f64, sd: f64, alpha_one_sided: f64, wanted: f64, most: u32) -> Option<u32> {
    seeds_for_room(Room::to_edge(distance), sd, alpha_one_sided, wanted, most)
}

/// Like [`seeds_for_power`], for an interval that must clear every edge of `room`: with [`Room::in_band`] the number
/// for equivalence.
#[must_use]
pub fn seeds_for_room(room: Room, sd: f64, alpha_one_sided: f64, wanted: f64, most: u32) -> Option<u32> {
    let power_with = |n: u32| {
        power(
            room,
            sd / f64::from(n).sqrt(),
            f64::from(n) - 1.0,
            alpha_one_sided,
        )
    };
    fewest(2, most, |n| power_with(n) >= wanted)
}

/// The smallest number from `least` to `most` that is enough, found by bisection; every larger number must be enough
/// too.
pub(super) fn fewest(least: u32, most: u32, enough: impl Fn(u32) -> bool) -> Option<u32> {
    if least > most || !enough(most) {
        return None;
    }
    let (mut low, mut high) = (least, most);
    while low < high {
        let middle = low.midpoint(high);
        if enough(middle) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    Some(high)
}

/// Number of standard deviations beyond which the integral is cut off.
const FARTHEST: f64 = 9.0;

/// The distribution of the standard deviation of a sample over that of its population.
struct SpreadRatio {
    degrees_of_freedom: f64,
}

impl SpreadRatio {
    /// Integral of the density times `function` up to `largest`, up to a constant factor. `function` changes over
    /// lengths of `scale`.
    fn integral(&self, largest: f64, scale: f64, function: impl Fn(f64) -> f64) -> f64 {
        let sd = (2.0 * self.degrees_of_freedom).sqrt().recip();
        let (low, high) = ((1.0 - FARTHEST * sd).max(0.0), (1.0 + FARTHEST * sd).min(largest));
        let term = |(ratio, weight): (f64, f64)| weight * self.density(ratio) * function(ratio);
        quadrature::points(low, high, sd.min(scale)).map(term).sum()
    }

    /// Density up to a constant factor, scaled to be 1 at 1.
    fn density(&self, ratio: f64) -> f64 {
        let v = self.degrees_of_freedom;
        ((v - 1.0) * ratio.ln() - v * (ratio * ratio - 1.0) / 2.0).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        MeanEstimate,
        tests::{normal_pair, numbers, sequential_reference},
    };
    use proptest::prelude::*;

    /// Each case has the distance, standard deviation, n, level and power.
    #[test]
    fn one_edge_agrees_with_the_noncentral_t_distribution_of_scipy() {
        for case in sequential_reference()["power"]["one_edge"]
            .as_array()
            .unwrap()
            .iter()
            .map(numbers)
        {
            let found = power(
                Room::to_edge(case[0]),
                case[1] / case[2].sqrt(),
                case[2] - 1.0,
                case[3],
            );
            assert!((found - case[4]).abs() < 1e-9, "{found} at {case:?}");
        }
    }

    #[test]
    fn two_edges_agree_with_scipy() {
        for case in sequential_reference()["power"]["two_edges"]
            .as_array()
            .unwrap()
            .iter()
            .map(numbers)
        {
            let room = Room {
                below: case[0],
                above: case[1],
            };
            let found = power(room, case[2] / case[3].sqrt(), case[3] - 1.0, case[4]);
            assert!((found - case[5]).abs() < 1e-9, "{found} at {case:?}");
        }
    }

    #[test]
    fn numbers_of_seeds_agree_with_statsmodels() {
        for case in sequential_reference()["power"]["seeds"]
            .as_array()
            .unwrap()
            .iter()
            .map(numbers)
        {
            // statsmodels gives a fraction of a seed.
            let seeds = seeds_for_power(case[0], case[1], case[2], case[3], 5000);
            assert_eq!(seeds, Some(case[4].ceil() as u32), "{case:?}");
        }
    }

    #[test]
    fn what_no_number_of_seeds_gives() {
        assert_eq!(seeds_for_power(0.0, 1.0, 0.05, 0.8, 1000), None);
        assert_eq!(seeds_for_power(-1.0, 1.0, 0.05, 0.8, 1000), None);
        assert_eq!(seeds_for_power(0.01, 1.0, 0.05, 0.8, 1000), None);
        assert_eq!(seeds_for_power(1.0, f64::NAN, 0.05, 0.8, 1000), None);
        assert_eq!(seeds_for_power(1.0, 0.0, 0.05, 0.8, 1000), Some(2));
        assert_eq!(seeds_for_power(1.0, 1.0, 0.05, 0.8, 1), None);
        assert_eq!(
            seeds_for_room(Room::in_band(12.0, 9.0, 11.0), 1.0, 0.05, 0.8, 1000),
            None
        );
    }

    /// The share of simulated studies that end REPRODUCED with the computed number of seeds and with one fewer.
    #[test]
    fn the_number_for_equivalence_is_right_in_four_of_five_studies() {
        let (low, high) = (-1.0, 1.4);
        let n = seeds_for_room(Room::in_band(0.0, low, high), 1.0, 0.05, POWER, 100).unwrap() as usize;
        let mut rng = contract::random::stream(&["test", "power of equivalence"]);
        let mut inside = [0_u32; 2];
        for _ in 0..20_000 {
            let draws: Vec<f64> = (0..n.div_ceil(2))
                .flat_map(|_| normal_pair(&mut rng))
                .take(n)
                .collect();
            for (fewer, count) in inside.iter_mut().enumerate() {
                let interval = MeanEstimate::of(&draws[fewer..]).interval(0.9).unwrap();
                *count += u32::from(low <= interval.low && interval.high <= high);
            }
        }
        let exact = [n, n - 1].map(|n| {
            let n = n as f64;
            power(Room::in_band(0.0, low, high), n.sqrt().recip(), n - 1.0, 0.05)
        });
        assert!(exact[0] >= POWER && exact[1] < POWER, "{exact:?}");
        // The standard error of a share is 0.0028.
        for (count, exact) in inside.into_iter().zip(exact) {
            assert!(
                (f64::from(count) / 20_000.0 - exact).abs() < 0.01,
                "{count} {exact}"
            );
        }
    }

    proptest! {
        #[test]
        fn power_grows_with_the_room(below in -3.0..6.0, above in -3.0..6.0, more in 0.0..3.0, n in 2..40) {
            let of = |below, above| power(Room { below, above }, 1.0, f64::from(n) - 1.0, 0.05);
            let (narrow, wide) = (of(below, above), of(below + more, above));
            prop_assert!((0.0..=1.0).contains(&narrow) && wide >= narrow - 1e-9, "{narrow} {wide}");
            prop_assert!((narrow - of(above, below)).abs() < 1e-12);
        }

        #[test]
        fn the_number_is_the_smallest(distance in 0.2..3.0, nominal in 0.01..0.1) {
            let n = seeds_for_power(distance, 1.0, nominal, POWER, 1000).unwrap();
            let of = |n: u32| power(Room::to_edge(distance), f64::from(n).sqrt().recip(), f64::from(n) - 1.0,
                nominal);
            prop_assert!(of(n) >= POWER && (n == 2 || of(n - 1) < POWER));
        }
    }
}
