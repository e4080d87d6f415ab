//! Computes the line and the band of a learning curve from its runs.

use super::{Automatic, Band, LearningCurve, Line, SeedLines, chart::Point};
use statistics::{
    Bootstrap, MeanEstimate,
    common_steps::{StepSeries, at_common_steps, shared_stretch},
    estimators::{iqm, mean, median, moving_average, quantile, sd},
    thinning,
};

/// Largest number of seeds that counts as few. All of them can be seen, and the range from their smallest to their
/// largest value does not contain the mean often enough to cut an interval there. For `n` seeds of a symmetric
/// distribution it contains the mean with probability `1
/// - 2^(1 - n)`: 94 % of the time with five, 97 % with six.
pub(super) const FEW: usize = 5;

/// Display of single runs and of the band beside the line of a panel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct RunDisplay {
    pub band: Band,
    pub runs: bool,
}

impl RunDisplay {
    /// Display that a study asks for, in a panel where some agent has few seeds or no agent has.
    pub(super) fn of(kind: &LearningCurve, few: bool) -> Self {
        let runs = match kind.seeds {
            SeedLines::Said(said) => said,
            SeedLines::Chosen(Automatic::Auto) => few,
        };
        let band = match kind.band {
            Band::Auto if few && runs => Band::None,
            Band::Auto => Band::Interval,
            said => said,
        };
        Self { band, runs }
    }
}

/// A run as it is drawn: the moving average of its steps from `from_step` on.
pub(super) fn smoothed(kind: &LearningCurve, points: &[(u64, f64)]) -> StepSeries {
    let (steps, values): (Vec<u64>, Vec<f64>) = points
        .iter()
        .copied()
        .filter(|(step, _)| *step >= kind.from_step)
        .unzip();
    steps
        .into_iter()
        .zip(moving_average(&values, kind.smooth))
        .collect()
}

/// Line and band over runs at their common steps; every point is over all runs. Lines with very many steps are
/// thinned to the steps that change the drawing.
pub(super) fn over(runs: &[StepSeries], line: Line, band: Band) -> Vec<Point> {
    let runs: Vec<&[(u64, f64)]> = runs.iter().map(Vec::as_slice).collect();
    let mut middles: StepSeries = Vec::new();
    at_common_steps(&runs, |step, values| middles.push((step, middle(values, line))));
    let kept = if middles.len() > thinning::MOST {
        thinning::kept_steps(&middles)
    } else {
        (0..middles.len()).collect()
    };
    let mut kept = kept.into_iter().map(|index| middles[index].0).peekable();
    let mut points = Vec::new();
    at_common_steps(&runs, |step, values| {
        if kept.next_if_eq(&step).is_some() {
            points.push(point(step, values, line, band));
        }
    });
    points
}

/// The statistic of the line over the last values of runs; `None` if all runs end with the line.
pub(super) fn at_the_ends(runs: &[StepSeries], line: Line) -> Option<f64> {
    let slices: Vec<&[(u64, f64)]> = runs.iter().map(Vec::as_slice).collect();
    let end = shared_stretch(&slices).map(|(_, end)| end);
    let lasts: Vec<(u64, f64)> = runs.iter().filter_map(|run| run.last().copied()).collect();
    let uneven = lasts.iter().any(|(step, _)| Some(*step) != end);
    let values: Vec<f64> = lasts.into_iter().map(|(_, value)| value).collect();
    uneven.then(|| middle(&values, line))
}

/// Whether runs begin or end at different steps, so that their line leaves out a part of them.
pub(super) fn are_uneven(runs: &[StepSeries]) -> bool {
    let ends = |run: &StepSeries| (run.first().map(|it| it.0), run.last().map(|it| it.0));
    runs.iter().any(|run| ends(run) != ends(&runs[0]))
}

/// The points of one run.
pub(super) fn points(run: &[(u64, f64)]) -> Vec<Point> {
    run.iter()
        .map(|(step, value)| Point {
            x: place(*step),
            y: *value,
            interval: None,
        })
        .collect()
}

/// The place of a step on the axis.
#[allow(clippy::cast_precision_loss, reason = "steps are far below 2^52")]
pub(super) fn place(step: u64) -> f64 {
    step as f64
}

/// The statistic of the line over the values of all runs.
fn middle(values: &[f64], line: Line) -> f64 {
    match line {
        Line::Mean => mean(values),
        Line::Median => median(values),
        Line::Iqm => iqm(values),
    }
}

fn point(step: u64, values: &[f64], line: Line, band: Band) -> Point {
    let y = middle(values, line);
    let ends = (values.len() > 1).then(|| ends(values, y, line, band)).flatten();
    // The line lies in its band, even after rounding.
    Point {
        x: place(step),
        y,
        interval: ends.map(|(low, high)| (low.min(y), high.max(y))),
    }
}

fn ends(values: &[f64], y: f64, line: Line, band: Band) -> Option<(f64, f64)> {
    match (band, line) {
        (Band::None | Band::Auto, _) => None,
        (Band::Sd, _) => Some((y - sd(values), y + sd(values))),
        (Band::Range, _) => Some(range(values)),
        (Band::Interval, Line::Mean) => mean_interval(values),
        (Band::Interval, Line::Median) => bootstrap(values, median),
        (Band::Interval, Line::Iqm) => bootstrap(values, iqm),
    }
}

/// The Student-t interval, as in tables. Percentiles of a bootstrap of the mean are too narrow for few seeds: with six
/// normal ones they cover 87 % instead of 95 %. The Student-t interval is not, but may exceed every possible value if
/// seeds differ much. Therefore, from six seeds on, it ends at the smallest and the largest of them. That lowers the
/// coverage by half a percent with six normal seeds, and by less with more.
fn mean_interval(values: &[f64]) -> Option<(f64, f64)> {
    let interval = MeanEstimate::of(values).interval(0.95)?;
    let (smallest, largest) = range(values);
    let cut = values.len() > FEW;
    Some(if cut {
        (interval.low.max(smallest), interval.high.min(largest))
    } else {
        (interval.low, interval.high)
    })
}

fn bootstrap(values: &[f64], statistic: fn(&[f64]) -> f64) -> Option<(f64, f64)> {
    let interval = Bootstrap::CURVE.stratified(&[values.to_vec()], |tasks| statistic(&tasks[0]))?;
    Some((interval.low, interval.high))
}

fn range(values: &[f64]) -> (f64, f64) {
    (quantile(values, 0.0), quantile(values, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const BANDS: [Band; 3] = [Band::Interval, Band::Sd, Band::Range];

    #[test]
    fn lines_and_bands_by_hand() {
        let of = |line, band| point(5, &[1.0, 2.0, 6.0], line, band);
        assert_eq!(
            (of(Line::Mean, Band::None).y, of(Line::Mean, Band::None).interval),
            (3.0, None)
        );
        assert_eq!(
            of(Line::Median, Band::Range),
            Point {
                x: 5.0,
                y: 2.0,
                interval: Some((1.0, 6.0))
            }
        );
        assert_eq!(point(5, &[100.0, 1.0, 3.0, -50.0], Line::Iqm, Band::None).y, 2.0);
        let (low, high) = of(Line::Mean, Band::Sd).interval.unwrap();
        assert!((high - 3.0 - 7f64.sqrt()).abs() < 1e-12 && (low - 3.0 + 7f64.sqrt()).abs() < 1e-12);
        // 4.302653 is the 97.5 % quantile for two degrees of freedom.
        let (low, high) = of(Line::Mean, Band::Interval).interval.unwrap();
        let half = 4.302_653 * (7.0_f64 / 3.0).sqrt();
        assert!((high - 3.0 - half).abs() < 1e-5 && (low - 3.0 + half).abs() < 1e-5);
        assert!(
            BANDS
                .iter()
                .all(|band| point(5, &[1.0], Line::Mean, *band).interval.is_none())
        );
    }

    #[test]
    fn intervals_of_six_seeds_end_at_the_seeds() {
        let interval = |values: &[f64]| point(0, values, Line::Mean, Band::Interval).interval.unwrap();
        // Five seeds reach the largest possible value, one fails.
        let (low, high) = interval(&[10.0, 10.0, 10.0, 10.0, 10.0, 0.0]);
        assert!(high == 10.0 && (low - 4.049).abs() < 1e-3, "{low}");
        assert!(
            interval(&[10.0, 10.0, 10.0, 10.0, 0.0]).1 > 13.0,
            "five seeds are too few to cut the interval"
        );
    }

    /// The share of intervals of the mean of six normal seeds that contain it.
    #[test]
    fn the_cut_hardly_lowers_the_coverage() {
        let mut rng = contract::random::stream(&["test", "coverage of curves"]);
        let mut uniform = || f64::from(rand::RngCore::next_u32(&mut rng)) / 2f64.powi(32);
        let mut normal = || (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
        let mut covered = 0;
        for _ in 0..4000 {
            let seeds: Vec<f64> = (0..6).map(|_| normal()).collect();
            let (low, high) = mean_interval(&seeds).unwrap();
            covered += u32::from(low <= 0.0 && 0.0 <= high);
        }
        // Nominal 3800; 3780 are expected with the cut, and the standard error is 15.
        assert!((3735..=3850).contains(&covered), "{covered}");
    }

    #[test]
    fn a_line_ends_with_the_shortest_run_and_its_last_values_are_told() {
        let runs = [vec![(10, 1.0), (20, 2.0), (30, 3.0)], vec![(20, 4.0)]];
        let middle = Point {
            x: 20.0,
            y: 3.0,
            interval: None,
        };
        assert_eq!(over(&runs, Line::Mean, Band::None), [middle]);
        assert_eq!(at_the_ends(&runs, Line::Mean), Some(3.5));
        assert!(are_uneven(&runs));
        let even = [vec![(10, 1.0), (20, 2.0)], vec![(10, 3.0), (20, 4.0)]];
        assert_eq!((at_the_ends(&even, Line::Mean), are_uneven(&even)), (None, false));
    }

    #[test]
    fn runs_at_steps_of_their_own_make_no_zigzag() {
        let run = |from: u64, value: f64| (from..1000).step_by(100).map(|step| (step, value)).collect();
        let line = over(&[run(0, 0.0), run(50, 10.0)], Line::Mean, Band::Range);
        assert_eq!((line[0].x, line[line.len() - 1].x), (50.0, 900.0));
        assert!(
            line.iter()
                .all(|point| point.y == 5.0 && point.interval == Some((0.0, 10.0)))
        );
    }

    #[test]
    fn long_runs_become_a_line_that_a_picture_can_show() {
        let run = |shift: u64| (0..100_000).map(|step| (2 * step + shift, step as f64)).collect();
        let line = over(&[run(0), run(1)], Line::Median, Band::Interval);
        assert!((1000..=4000).contains(&line.len()), "{}", line.len());
        assert!(line.iter().all(|point| point.interval.is_some()));
    }

    #[test]
    fn few_seeds_are_drawn_and_many_have_an_interval() {
        let kind = LearningCurve::default();
        let shown = |band, runs| RunDisplay { band, runs };
        assert_eq!(RunDisplay::of(&kind, true), shown(Band::None, true));
        assert_eq!(RunDisplay::of(&kind, false), shown(Band::Interval, false));
        let with = |seeds| LearningCurve {
            seeds: SeedLines::Said(seeds),
            ..LearningCurve::default()
        };
        assert_eq!(RunDisplay::of(&with(true), false), shown(Band::Interval, true));
        assert_eq!(RunDisplay::of(&with(false), true), shown(Band::Interval, false));
        assert_eq!(
            RunDisplay::of(
                &LearningCurve {
                    band: Band::Sd,
                    ..kind
                },
                true
            ),
            shown(Band::Sd, true)
        );
    }

    fn curves(seeds: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Vec<f64>>> {
        prop::collection::vec(prop::collection::vec(-1e3..1e3, 8), seeds)
    }

    fn drawn(values: &[Vec<f64>], smooth: f64, line: Line, band: Band) -> Vec<Point> {
        let kind = LearningCurve {
            smooth,
            ..LearningCurve::default()
        };
        let run = |values: &Vec<f64>| smoothed(&kind, &(0..).zip(values.iter().copied()).collect::<Vec<_>>());
        over(&values.iter().map(run).collect::<Vec<_>>(), line, band)
    }

    proptest! {
        #[test]
        fn no_line_leaves_its_band(values in curves(2..20), smooth in 0.0..0.999) {
            let lines = [Line::Mean, Line::Median, Line::Iqm];
            for (line, band) in lines.into_iter().flat_map(|line| BANDS.map(|band| (line, band))) {
                // 2000 resamples at every point would take minutes here.
                if line == Line::Mean || band != Band::Interval {
                    for point in drawn(&values, smooth, line, band) {
                        let (low, high) = point.interval.unwrap();
                        prop_assert!(low <= point.y && point.y <= high, "{line:?} {band:?} {point:?}");
                    }
                }
            }
        }

        #[test]
        fn intervals_of_many_seeds_stay_in_their_range(values in curves(6..20), smooth in 0.0..0.999) {
            let intervals = drawn(&values, smooth, Line::Mean, Band::Interval);
            for (interval, range) in intervals.iter().zip(drawn(&values, smooth, Line::Mean, Band::Range)) {
                let (inner, outer) = (interval.interval.unwrap(), range.interval.unwrap());
                prop_assert!(outer.0 <= inner.0 && inner.1 <= outer.1);
            }
        }

        #[test]
        fn the_mean_of_smoothed_runs_is_the_smoothed_mean(values in curves(1..10), smooth in 0.0..0.999) {
            let plain: Vec<f64> = drawn(&values, 0.0, Line::Mean,
                Band::None).iter().map(|point| point.y).collect();
            let average = moving_average(&plain, smooth);
            for (point, average) in drawn(&values, smooth, Line::Mean, Band::None).iter().zip(average) {
                prop_assert!((point.y - average).abs() < 1e-9);
            }
        }
    }
}
