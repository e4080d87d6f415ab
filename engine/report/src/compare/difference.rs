//! The difference between two cells, and whether it exceeds the variation of their seeds.
//!
//! | values                                    | interval of the difference, 95 %                           |
//! |-------------------------------------------|------------------------------------------------------------|
//! | means over the same seeds                 | Student-t of the differences seed by seed                  |
//! | means over other seeds                    | Welch                                                      |
//! | shares of seeds with success              | exact bounds of both, not paired                           |
//! | medians or interquartile means            | bootstrap, of pairs where the seeds are the same           |
//! | values that no single seed has            | none; they moved where their own intervals have no number in common |

use super::CellValues;
use serde::Serialize;
use statistics::{
    Bootstrap, Interval, MeanEstimate, Share,
    estimators::{iqm, median},
};

/// The level of every interval.
pub const LEVEL: f64 = 0.95;

/// The second value less the first.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Difference {
    /// Value of the second cell less that of the first, in the unit of the metric.
    pub difference: f64,
    /// Its 95 % interval; `None` where the seeds give none.
    pub interval: Option<Interval>,
    /// Basis of the interval, or of the judgement without one; `None` where there is neither.
    pub basis: Option<Basis>,
    /// Judgement on the difference.
    pub fate: Fate,
}

/// Method of comparison of the seeds of two cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Basis {
    /// Student-t of the differences seed by seed.
    Paired,
    /// Welch interval of two independent samples.
    Welch,
    /// Exact bounds of the shares of two independent samples.
    ExactBounds,
    /// Bootstrap of pairs.
    PairedBootstrap,
    /// Bootstrap of two independent samples.
    Bootstrap,
    /// Overlap of the intervals of both values.
    Intervals,
}

/// Judgement on a difference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fate {
    /// Every seed has the same bits.
    Same,
    /// The interval holds 0.
    Within,
    /// The interval does not hold 0.
    Moved,
    /// The values differ and there is no interval.
    Undecided,
}

impl Basis {
    /// Word for the judgement in a table.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Basis::Paired => "paired",
            Basis::Welch => "Welch",
            Basis::ExactBounds => "exact bounds",
            Basis::PairedBootstrap => "paired bootstrap",
            Basis::Bootstrap => "bootstrap",
            Basis::Intervals => "own intervals",
        }
    }
}

impl Difference {
    /// The difference of two cells; `None` where one has no value.
    #[must_use]
    pub fn of(a: &CellValues, b: &CellValues) -> Option<Self> {
        let difference = b.value? - a.value?;
        let (interval, basis) = interval(a, b).unzip();
        let overlap = a
            .interval
            .zip(b.interval)
            .map(|((low, high), (from, to))| low <= to && from <= high);
        let fate = match (is_same(a, b), interval, overlap) {
            (true, ..) => Fate::Same,
            (_, Some(interval), _) => Fate::by(interval.contains(0.0)),
            (_, None, Some(overlap)) if a.seeds.is_empty() && b.seeds.is_empty() => Fate::by(overlap),
            _ => Fate::Undecided,
        };
        let stands_in =
            (interval.is_none() && [Fate::Within, Fate::Moved].contains(&fate)).then_some(Basis::Intervals);
        Some(Self {
            difference,
            interval,
            basis: basis.or(stands_in),
            fate,
        })
    }
}

impl Fate {
    fn by(holds: bool) -> Self {
        if holds { Self::Within } else { Self::Moved }
    }
}

/// Whether every seed has the same bits or, for values without numbers by seed, the values themselves do.
fn is_same(a: &CellValues, b: &CellValues) -> bool {
    let bits = |cell: &CellValues| {
        let seeds = cell.seeds.iter().map(|(seed, value)| (*seed, value.to_bits()));
        let ends = cell.interval.map(|(low, high)| [low.to_bits(), high.to_bits()]);
        (
            seeds.collect::<Vec<_>>(),
            cell.value.map(f64::to_bits),
            ends.filter(|_| cell.seeds.is_empty()),
        )
    };
    bits(a) == bits(b)
}

/// The interval of the difference with its basis; `None` where the seeds give none.
fn interval(a: &CellValues, b: &CellValues) -> Option<(Interval, Basis)> {
    let (left, right) = (a.values(), b.values());
    let paired = a.seeds.keys().eq(b.seeds.keys());
    match (a.statistic.as_str(), b.statistic.as_str()) {
        ("mean", "mean") if paired => {
            let differences: Vec<f64> = right.iter().zip(&left).map(|(b, a)| b - a).collect();
            Some((MeanEstimate::of(&differences).interval(LEVEL)?, Basis::Paired))
        }
        ("mean", "mean") => Some((
            MeanEstimate::difference(&right, &left).interval(LEVEL)?,
            Basis::Welch,
        )),
        ("share", "share") => {
            let share = |values: &[f64]| Share::of(values.iter().map(|value| *value > 0.5));
            let interval = share(&right).interval_of_difference(share(&left), LEVEL)?;
            Some((interval, Basis::ExactBounds))
        }
        ("median", "median") => resampled(&left, &right, paired, median),
        ("interquartile mean", "interquartile mean") => resampled(&left, &right, paired, iqm),
        _ => None,
    }
}

fn resampled(
    left: &[f64],
    right: &[f64],
    paired: bool,
    statistic: fn(&[f64]) -> f64,
) -> Option<(Interval, Basis)> {
    let bootstrap = Bootstrap {
        level: LEVEL,
        ..Bootstrap::TABLE
    };
    if !paired {
        let difference = |[right, left]: [&[Vec<f64>]; 2]| statistic(&right[0]) - statistic(&left[0]);
        let interval = bootstrap.independent([&[right.to_vec()], &[left.to_vec()]], difference)?;
        return Some((interval, Basis::Bootstrap));
    }
    // The resampled items are the indices of the pairs.
    let places: Vec<f64> = (0u32..).map(f64::from).take(left.len()).collect();
    let at = |values: &[f64], places: &[f64]| {
        let drawn: Vec<f64> = places.iter().map(|place| values[*place as usize]).collect();
        statistic(&drawn)
    };
    let difference = |drawn: &[Vec<f64>]| at(right, &drawn[0]) - at(left, &drawn[0]);
    Some((
        bootstrap.stratified(&[places], difference)?,
        Basis::PairedBootstrap,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(statistic: &str, seeds: &[(u64, f64)]) -> CellValues {
        let values: Vec<f64> = seeds.iter().map(|(_, value)| *value).collect();
        CellValues {
            statistic: statistic.into(),
            value: Some(statistics::estimators::mean(&values)),
            seeds: seeds.iter().copied().collect(),
            ..CellValues::default()
        }
    }

    fn of(a: &CellValues, b: &CellValues) -> Difference {
        Difference::of(a, b).unwrap()
    }

    /// Differences of 1, 2 and 3: mean 2, standard error 1/sqrt(3), and 4.3027 of Student-t with 2 degrees.
    #[test]
    fn the_same_seeds_are_compared_pair_by_pair() {
        let a = cell("mean", &[(0, 10.0), (1, 20.0), (2, 30.0)]);
        let b = cell("mean", &[(0, 11.0), (1, 22.0), (2, 33.0)]);
        let difference = of(&a, &b);
        let half = 4.302_652_729_7 / 3f64.sqrt();
        let interval = difference.interval.unwrap();
        assert!((difference.difference - 2.0).abs() < 1e-12 && (interval.high - 2.0 - half).abs() < 1e-8);
        assert_eq!(
            (difference.basis, difference.fate),
            (Some(Basis::Paired), Fate::Within)
        );
        let shifted = cell("mean", &[(0, 11.0), (1, 21.1), (2, 31.2)]);
        assert_eq!(of(&a, &shifted).fate, Fate::Moved);
    }

    #[test]
    fn other_seeds_are_samples_that_share_nothing() {
        let a = cell("mean", &[(0, 10.0), (1, 20.0), (2, 30.0)]);
        let b = cell("mean", &[(3, 11.0), (4, 21.1), (5, 31.2)]);
        let difference = of(&a, &b);
        let welch = MeanEstimate::difference(&b.values(), &a.values()).interval(LEVEL);
        assert_eq!(
            (difference.basis, difference.interval),
            (Some(Basis::Welch), welch)
        );
        assert_eq!(difference.fate, Fate::Within);
    }

    #[test]
    fn the_same_bits_are_the_same_and_one_seed_decides_nothing() {
        let one = cell("mean", &[(0, 0.1)]);
        assert_eq!(of(&one, &one).fate, Fate::Same);
        let other = of(&one, &cell("mean", &[(0, 0.1 + 1e-16 + 2e-17)]));
        assert_eq!((other.fate, other.basis), (Fate::Undecided, None));
        // Rules without random numbers have no spread, so any change counts.
        let fixed = |value| cell("mean", &[(0, value), (1, value)]);
        assert_eq!(of(&fixed(1.0), &fixed(1.0 + 1e-9)).fate, Fate::Moved);
    }

    #[test]
    fn shares_have_their_own_interval() {
        let share = |successes: u64| {
            let seeds: Vec<_> = (0..10)
                .map(|seed| (seed, f64::from(u8::from(seed < successes))))
                .collect();
            cell("share", &seeds)
        };
        let (none, few, all) = (share(0), share(1), share(10));
        assert_eq!(of(&none, &few).fate, Fate::Within);
        let difference = of(&few, &all);
        assert_eq!(
            (difference.basis, difference.fate),
            (Some(Basis::ExactBounds), Fate::Moved)
        );
    }

    #[test]
    fn pairs_stay_together_when_medians_are_resampled() {
        let wide: Vec<(u64, f64)> = (0..9).map(|seed| (seed, 100.0 * seed as f64)).collect();
        let shifted: Vec<(u64, f64)> = wide.iter().map(|(seed, value)| (*seed, value + 1.0)).collect();
        let elsewhere: Vec<(u64, f64)> = shifted.iter().map(|(seed, value)| (seed + 20, *value)).collect();
        for statistic in ["median", "interquartile mean"] {
            let (a, b) = (cell(statistic, &wide), cell(statistic, &shifted));
            let paired = of(&a, &b);
            assert_eq!(
                (paired.basis, paired.fate),
                (Some(Basis::PairedBootstrap), Fate::Moved)
            );
            let apart = of(&a, &cell(statistic, &elsewhere));
            assert_eq!((apart.basis, apart.fate), (Some(Basis::Bootstrap), Fate::Within));
        }
    }

    #[test]
    fn values_without_seeds_are_held_against_each_other_by_their_intervals() {
        let value = |value: f64, interval: Option<(f64, f64)>| CellValues {
            statistic: "aggregates".into(),
            value: Some(value),
            interval,
            ..CellValues::default()
        };
        let fate = |a: &CellValues, b: &CellValues| (of(a, b).fate, of(a, b).basis);
        let (low, near, far) = (
            value(1.0, Some((0.5, 1.5))),
            value(2.0, Some((1.4, 2.6))),
            value(3.0, Some((2.5, 3.5))),
        );
        assert_eq!(fate(&low, &near), (Fate::Within, Some(Basis::Intervals)));
        assert_eq!(fate(&low, &far), (Fate::Moved, Some(Basis::Intervals)));
        assert_eq!(fate(&low, &low), (Fate::Same, None));
        assert_eq!(fate(&low, &value(1.0, None)), (Fate::Undecided, None));
        assert_eq!(Difference::of(&low, &CellValues::default()), None);
    }
}
