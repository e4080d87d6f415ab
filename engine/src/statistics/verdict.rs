//! Is a published value reproduced? An equivalence test over seeds.
//!
//! The two one-sided tests of Schuirmann (1987, doi:10.1007/BF01068419) at 5 % each: the 90 % interval of the mean over
//! seeds is laid against the band of published value plus and minus margin. Inside, the value is reproduced; outside, it
//! differs; across an edge, the seeds do not tell.

use super::{Interval, mean_estimate::MeanEstimate};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Level of the interval that makes each of the two one-sided tests one of 5 %.
pub const LEVEL: f64 = 0.90;

/// How a reproduced cell compares with the published value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The whole interval lies in the band.
    Reproduced,
    /// The whole interval lies outside the band.
    Differs,
    /// The interval crosses an edge of the band, or there is only one seed.
    Inconclusive {
        /// About how many more seeds would decide; `None` where no affordable number would.
        more_seeds: Option<u32>,
    },
    /// There is no seed yet.
    NotRun,
    /// No seed ended well, or a seed's value is not finite.
    Failed,
}

impl Verdict {
    /// The word that is shown.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Verdict::Reproduced => "REPRODUCED",
            Verdict::Differs => "DIFFERS",
            Verdict::Inconclusive { .. } => "INCONCLUSIVE",
            Verdict::NotRun => "NOT RUN",
            Verdict::Failed => "FAILED",
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.word())
    }
}

/// A verdict with the numbers it rests on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Judgement {
    /// The verdict.
    pub verdict: Verdict,
    /// Seeds it rests on.
    pub n: usize,
    /// Mean over these seeds; `None` without seeds or where it is not finite.
    pub mean: Option<f64>,
    /// 90 % Student-t interval of the mean; `None` below two seeds.
    pub interval: Option<Interval>,
    /// The published value.
    pub published: f64,
    /// How far the mean may lie from the published value, in its unit.
    pub margin: f64,
}

impl Judgement {
    /// What to do about an inconclusive verdict, or which numbers to read, in one phrase; empty where nothing is to be said.
    #[must_use]
    pub fn note(&self) -> String {
        match (self.verdict, self.n) {
            (Verdict::Inconclusive { .. }, 1) => "one seed has no interval; at least 2 more are needed".into(),
            (Verdict::Inconclusive { more_seeds: Some(1) }, _) => "about 1 more seed would decide".into(),
            (Verdict::Inconclusive { more_seeds: Some(more) }, _) => format!("about {more} more seeds would decide"),
            (Verdict::Inconclusive { more_seeds: None }, _) => {
                "the mean is too near the edge of the margin for more seeds to decide".into()
            }
            (Verdict::Reproduced | Verdict::Differs | Verdict::NotRun | Verdict::Failed, _) => String::new(),
        }
    }
}

/// The margin where a study gives none: 5 % of the size of the published value.
#[must_use]
pub fn default_margin(published: f64) -> f64 {
    0.05 * published.abs()
}

/// Compares one reproduced value per seed with a published value.
///
/// `failed` is the number of seeds that did not end well: with no other seed the cell has failed. Where some seeds ended
/// well the verdict rests on them alone, and the reader must be shown that others are missing. `margin` is not negative,
/// in the unit of the values.
#[must_use]
pub fn judge(published: f64, margin: f64, values: &[f64], failed: usize) -> Judgement {
    let estimate = MeanEstimate::of(values);
    let interval = estimate.interval(LEVEL);
    let verdict = match (interval, values.len()) {
        (_, 0) if failed == 0 => Verdict::NotRun,
        (_, 0) => Verdict::Failed,
        _ if !values.iter().all(|value| value.is_finite()) => Verdict::Failed,
        (None, _) => Verdict::Inconclusive { more_seeds: Some(2) },
        (Some(interval), _) => lay_against_band(&estimate, interval, published, margin),
    };
    let mean = Some(estimate.value).filter(|mean| mean.is_finite());
    Judgement { verdict, n: values.len(), mean, interval, published, margin }
}

fn lay_against_band(estimate: &MeanEstimate, interval: Interval, published: f64, margin: f64) -> Verdict {
    let (low, high) = (published - margin, published + margin);
    if low <= interval.low && interval.high <= high {
        Verdict::Reproduced
    } else if interval.high < low || high < interval.low {
        Verdict::Differs
    } else {
        let to_nearest_edge = (margin - (estimate.value - published).abs()).abs();
        Verdict::Inconclusive { more_seeds: estimate.more_seeds(LEVEL, to_nearest_edge) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::tests::{assert_close, numbers, reference};
    use proptest::prelude::*;

    fn verdict(published: f64, margin: f64, values: &[f64]) -> Verdict {
        judge(published, margin, values, 0).verdict
    }

    #[test]
    fn equivalence_agrees_with_statsmodels() {
        let mut reproduced = 0;
        for case in reference()["equivalence"].as_array().unwrap() {
            let number = |key: &str| case[key].as_f64().unwrap();
            let judgement = judge(number("published"), number("margin"), &numbers(&case["values"]), 0);
            assert_eq!(judgement.verdict == Verdict::Reproduced, number("p") < 0.05, "{judgement:?}");
            reproduced += u32::from(judgement.verdict == Verdict::Reproduced);
        }
        assert!((1..9).contains(&reproduced));
    }

    #[test]
    fn intervals_agree_with_scipy() {
        for case in reference()["one_sample"].as_array().unwrap() {
            let interval = judge(0.0, 1.0, &numbers(&case["values"]), 0).interval.unwrap();
            let ends = numbers(&case["interval_90"]);
            assert_close(interval.low, ends[0], 1e-11);
            assert_close(interval.high, ends[1], 1e-11);
        }
    }

    #[test]
    fn the_band_decides() {
        // Mean 100, standard deviation 1, five seeds: 90 % interval 100 -+ 0.953.
        let values = [98.735_088_936, 99.367_544_468, 100.0, 100.632_455_532, 101.264_911_064];
        assert_eq!(verdict(100.0, 1.0, &values), Verdict::Reproduced);
        assert_eq!(verdict(103.0, 2.0, &values), Verdict::Differs);
        // Half a unit inside the edge: t(0.95, n - 1) / sqrt(n) falls below 0.5 at n = 13 (1.782 / 3.606 = 0.494).
        assert_eq!(verdict(101.5, 2.0, &values), Verdict::Inconclusive { more_seeds: Some(8) });
        assert_eq!(verdict(102.5, 2.0, &values), Verdict::Inconclusive { more_seeds: Some(8) });
        assert_eq!(verdict(102.0, 2.0, &values), Verdict::Inconclusive { more_seeds: None });
    }

    #[test]
    fn few_seeds_and_none() {
        let one = judge(5.0, 1.0, &[5.0], 0);
        assert_eq!((one.verdict, one.interval), (Verdict::Inconclusive { more_seeds: Some(2) }, None));
        assert!(one.note().contains("at least 2"));
        assert_eq!(verdict(5.0, 1.0, &[]), Verdict::NotRun);
        assert_eq!(judge(5.0, 1.0, &[], 3).verdict, Verdict::Failed);
        assert_eq!(verdict(5.0, 1.0, &[5.0, f64::NAN]), Verdict::Failed);
    }

    #[test]
    fn no_spread() {
        assert_eq!(verdict(0.1, 0.0, &[0.1, 0.1, 0.1]), Verdict::Reproduced);
        assert_eq!(verdict(0.1, 0.01, &[0.105, 0.105]), Verdict::Reproduced);
        assert_eq!(verdict(0.1, 0.01, &[0.12, 0.12]), Verdict::Differs);
    }

    #[test]
    fn words_and_margin() {
        assert_eq!(Verdict::NotRun.to_string(), "NOT RUN");
        assert_eq!(format!("{:>8}", Verdict::Failed), "  FAILED");
        assert_eq!((default_margin(-40.0), default_margin(0.0)), (2.0, 0.0));
    }

    /// `n` values with exactly this mean and sample standard deviation: pairs at equal distance, the mean itself if odd.
    fn sample(mean: f64, sd: f64, n: u32) -> Vec<f64> {
        let distance = sd * (f64::from(n - 1) / f64::from(n - n % 2)).sqrt();
        (0..n)
            .map(|i| {
                if i == n - n % 2 {
                    mean
                } else if i % 2 == 0 {
                    mean - distance
                } else {
                    mean + distance
                }
            })
            .collect()
    }

    proptest! {
        #[test]
        fn the_advised_number_of_seeds_decides_and_one_fewer_does_not(mean in 95.0..105.0, margin in 0.5..4.0) {
            if let Verdict::Inconclusive { more_seeds: Some(more) } = verdict(100.0, margin, &sample(mean, 1.0, 4)) {
                let word = |more: u32| verdict(100.0, margin, &sample(mean, 1.0, 4 + more)).word();
                prop_assert_ne!(word(more), "INCONCLUSIVE");
                prop_assert_eq!(word(more - 1), "INCONCLUSIVE");
            }
        }

        #[test]
        fn a_wider_margin_never_unmakes_a_reproduction(values in prop::collection::vec(90.0..110.0, 2..12), margin in 0.0..20.0) {
            if verdict(100.0, margin, &values) == Verdict::Reproduced {
                prop_assert_eq!(verdict(100.0, margin + 1.0, &values), Verdict::Reproduced);
            }
        }
    }
}
