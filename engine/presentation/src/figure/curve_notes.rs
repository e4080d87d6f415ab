//! The sentences under learning curves: the meaning of lines, thin lines, bands and dashes.

use super::{
    Band, LearningCurve, Line,
    chart::{Chart, Panel, Point, Series},
    over_runs::FEW,
    shape::{Curve, CurveSource, RunLine, Shape},
};
use statistics::thinning;

/// Largest number of names in a sentence; further ones are only counted.
const MOST_NAMED: usize = 5;

/// Sentences on everything that is drawn, and on nothing else.
pub(super) fn sentences(kind: &LearningCurve, chart: &Chart) -> Vec<String> {
    let drawn = NoteWriter { kind, chart };
    [
        drawn.lines(),
        drawn.carried(),
        drawn.parts(),
        drawn.thinned(),
        drawn.smoothing(),
        drawn.thin_lines(),
        drawn.bands(),
        drawn.discs(),
        drawn.short_dashes(),
        drawn.levels(),
        drawn.published(),
    ]
    .into_iter()
    .flatten()
    .collect()
}

struct NoteWriter<'a> {
    kind: &'a LearningCurve,
    chart: &'a Chart,
}

impl NoteWriter<'_> {
    fn lines(&self) -> Option<String> {
        let lines = match self.kind.line {
            Line::Mean => "means",
            Line::Median => "medians",
            Line::Iqm => "interquartile means",
        };
        let from = match self.kind.from_step {
            0 => String::new(),
            step => format!(", from step {step} on"),
        };
        self.any(is_own)
            .then(|| format!("Lines are {lines} over n seeds{from}."))
    }

    /// Sentence on the construction of a line from runs with different steps.
    fn carried(&self) -> Option<String> {
        let names = self.names(|curve| !have_same_steps(curve));
        let which = match names.len() {
            n if n > MOST_NAMED => format!("{n} lines"),
            _ => names.join(", "),
        };
        (!names.is_empty()).then(|| {
            format!(
                "Runs that were not measured at the same steps ({which}) count at each step with their last value up \
                 to it."
            )
        })
    }

    /// Sentence on lines that end although runs go on, in the study's own curves; published curves have a sentence of
    /// their own.
    fn parts(&self) -> Option<String> {
        let part = |series: &Series, curve: &Curve| {
            let whole = ends(curve.all_runs().flat_map(|run| &run.points))?;
            let name = &series.label;
            let n = series.seeds.map_or(0, |(n, _)| n);
            let line = ends(curve.points.iter());
            match line {
                _ if !is_own(curve) || line == Some(whole) => None,
                None => Some(format!(
                    "{name} has no line: there is no step at which all n = {n} runs have begun and none has ended."
                )),
                Some((first, last)) => Some(format!(
                    "The line of {name} goes from step {first} to {last}, where all n = {n} runs have values; single \
                     runs go from {} to {}.",
                    whole.0, whole.1
                )),
            }
        };
        let panels = self.chart.panels.iter();
        let series = panels.flat_map(|panel| &panel.series);
        let parts = series.filter_map(|series| match &series.shape {
            Shape::Curve(curve) => part(series, curve),
            _ => None,
        });
        let parts: Vec<String> = parts.collect();
        (!parts.is_empty()).then(|| parts.join(" "))
    }

    /// Sentence on the drawing of lines with very many steps.
    fn thinned(&self) -> Option<String> {
        let is_long = |curve: &Curve| curve.all_runs().any(|run| run.points.len() > thinning::MOST);
        self.any(is_long).then(|| {
            format!(
                "Of more than {} steps the first, the lowest, the highest and the last of each stretch are drawn; the data \
                 of the figure have all values of the runs.",
                thinning::MOST
            )
        })
    }

    /// The names of curves, each once.
    fn names(&self, is: impl Fn(&Curve) -> bool) -> Vec<&str> {
        let mut names = Vec::new();
        for series in self.chart.panels.iter().flat_map(|panel| &panel.series) {
            if let Shape::Curve(curve) = &series.shape
                && is(curve)
                && !names.contains(&series.label.as_str())
            {
                names.push(series.label.as_str());
            }
        }
        names
    }

    fn smoothing(&self) -> Option<String> {
        let weight = self.kind.smooth;
        let smoothed = weight > 0.0 && self.any(is_own);
        smoothed.then(|| {
            format!(
                "The curve of each seed was smoothed first, by a moving average (weight of \
                                  the past {weight})."
            )
        })
    }

    fn thin_lines(&self) -> Option<String> {
        let thin = |curve: &Curve| is_own(curve) && !curve.runs.is_empty();
        let uneven = |curve: &Curve| thin(curve) && curve.at_the_ends.is_some();
        let place = match (self.in_all(thin), self.any(uneven)) {
            (true, _) => String::new(),
            (false, false) => format!(", in panels where an agent has at most {FEW}"),
            (false, true) => {
                format!(
                    ", in panels where an agent has at most {FEW}, and where not all of them end together"
                )
            }
        };
        self.any(thin)
            .then(|| format!("Thin lines are the seeds{place}."))
    }

    fn bands(&self) -> Option<String> {
        let band = match self.kind.band {
            Band::Sd => {
                "one standard deviation to each side, which may leave the range of possible values".into()
            }
            Band::Range => "from the smallest to the largest seed".into(),
            Band::Auto | Band::Interval | Band::None => self.interval(),
        };
        let place = if self.kind.band == Band::Auto && !self.in_all(has_band) {
            ", in the other panels"
        } else {
            ""
        };
        self.any(has_band).then(|| format!("Bands are {band}{place}."))
    }

    /// Sentence on lines of one point.
    fn discs(&self) -> Option<String> {
        let has_bar = |curve: &Curve| curve.is_point() && has_band(curve);
        let bar = if self.any(has_bar) {
            ", with an error bar in place of the band"
        } else {
            ""
        };
        self.any(Curve::is_point)
            .then(|| format!("A disc is a line of one measurement{bar}."))
    }

    fn interval(&self) -> String {
        match self.kind.line {
            Line::Median => "95 % percentile bootstrap intervals of the median".into(),
            Line::Iqm => "95 % percentile bootstrap intervals of the interquartile mean".into(),
            Line::Mean => {
                let few = self.series().any(|(n, curve)| n <= FEW && has_band(curve));
                let place = if few {
                    format!(" from {} seeds on", FEW + 1)
                } else {
                    String::new()
                };
                let beyond = if few {
                    "; with fewer they may leave the range of possible values"
                } else {
                    ""
                };
                format!(
                    "95 % Student-t intervals of the mean, cut at the smallest and the largest \
                     seed{place}{beyond}"
                )
            }
        }
    }

    fn short_dashes(&self) -> Option<String> {
        self.any(|curve| curve.of == CurveSource::NonLearner)
            .then(|| "Short dashes are agents that do not learn.".into())
    }

    fn levels(&self) -> Option<String> {
        let level = self
            .chart
            .panels
            .iter()
            .flat_map(|panel| &panel.series)
            .any(|it| matches!(it.shape, Shape::Level(_)));
        let note = "Straight lines in short dashes are agents that do not learn; levels are final \
                    measurements on other \
                    episodes than the curves.";
        level.then(|| note.into())
    }

    fn published(&self) -> Option<String> {
        let several = self.series().any(|(n, curve)| is_published(curve) && n > 1);
        let means = if several {
            ", means over their runs where all of these have a value"
        } else {
            ""
        };
        let thin = self.any(|curve| is_published(curve) && !curve.runs.is_empty());
        let runs = if thin {
            ", with thin lines for the runs"
        } else {
            ""
        };
        let smoothed = if self.kind.smooth > 0.0 {
            ", smoothed in the same way"
        } else {
            ""
        };
        let end = if self.any(is_own) {
            ", as far as the curves of this study go"
        } else {
            ""
        };
        self.any(is_published)
            .then(|| format!("Dotted lines are published curves{means}{runs}{smoothed}{end}."))
    }

    fn any(&self, is: impl Fn(&Curve) -> bool) -> bool {
        self.series().any(|(_, curve)| is(curve))
    }

    /// Whether every panel with curves of the study has one that meets a condition.
    fn in_all(&self, is: impl Fn(&Curve) -> bool) -> bool {
        let own = |panel: &&Panel| curves(panel).any(|(_, curve)| is_own(curve));
        self.chart
            .panels
            .iter()
            .filter(own)
            .all(|panel| curves(panel).any(|(_, curve)| is(curve)))
    }

    fn series(&self) -> impl Iterator<Item = (usize, &Curve)> {
        self.chart.panels.iter().flat_map(curves)
    }
}

/// The curves of a panel with their numbers of seeds.
fn curves(panel: &Panel) -> impl Iterator<Item = (usize, &Curve)> {
    panel.series.iter().filter_map(|series| match &series.shape {
        Shape::Curve(curve) => Some((series.seeds.map_or(0, |(n, _)| n), curve)),
        _ => None,
    })
}

/// Whether all runs were measured at the same steps, up to the end of the line.
fn have_same_steps(curve: &Curve) -> bool {
    let Some((first, last)) = ends(curve.points.iter()) else {
        return true;
    };
    let steps = |run: &RunLine| -> Vec<f64> {
        let steps = run.points.iter().map(|point| point.x);
        steps.filter(|step| (first..=last).contains(step)).collect()
    };
    let mut all = curve.all_runs().map(steps);
    let first = all.next();
    all.all(|steps| Some(&steps) == first.as_ref())
}

/// The first and the last place of some points.
fn ends<'a>(points: impl Iterator<Item = &'a Point>) -> Option<(f64, f64)> {
    points.fold(None, |ends: Option<(f64, f64)>, point| {
        Some(ends.map_or((point.x, point.x), |(first, last)| {
            (first.min(point.x), last.max(point.x))
        }))
    })
}

fn has_band(curve: &Curve) -> bool {
    curve.points.iter().any(|point| point.interval.is_some())
}

fn is_own(curve: &Curve) -> bool {
    curve.of != CurveSource::Publication
}

fn is_published(curve: &Curve) -> bool {
    curve.of == CurveSource::Publication
}
