//! Learning curves: the mean over seeds at each measurement, with a band.

use super::{
    Band, FigureSpec, LearningCurve,
    build::{Context, by_environment, label_with_setting, level},
    chart::{Chart, Point, Scale, Series, Shape, Style},
};
use crate::{
    Error, Phase,
    statistics::{Bootstrap, Summary, estimators},
    table::{Axis, Scope},
};
use std::collections::BTreeMap;

/// One panel per environment, one line per agent and setting; agents that do not learn are levels at their final mean.
pub(super) fn build(kind: &LearningCurve, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error> {
    let scope = Scope::of(context.results, &kind.agents, &kind.environments);
    let x = Scale { label: "environment steps".into(), ..Scale::default() };
    let y = context.scale(spec, &kind.metric, kind.log_y);
    let mut chart = by_environment(spec, &scope, &kind.environments, (x, y), |scope| panel(kind, spec, context, scope))?;
    chart.notes.push(explain(kind));
    Ok(chart)
}

fn panel(kind: &LearningCurve, spec: &FigureSpec, context: Context<'_>, scope: &Scope<'_>) -> Vec<Series> {
    let agents = scope.names(Axis::Agent, &kind.agents);
    let of_agent = |agent: &String| {
        let scope = scope.at(Axis::Agent, agent);
        let settings = scope.names(Axis::Setting, &[]);
        let several = settings.len() > 1;
        let series = move |(index, setting): (usize, &String)| {
            let variant = if several { index } else { context.style(agent).variant };
            let style = Style { variant, ..context.style(agent) };
            let label = label_with_setting(spec, agent, if several { setting } else { "" });
            one(kind, &scope.at(Axis::Setting, setting), label, style)
        };
        settings.iter().enumerate().filter_map(series).collect::<Vec<_>>()
    };
    agents.iter().flat_map(of_agent).collect()
}

fn one(kind: &LearningCurve, scope: &Scope<'_>, label: String, style: Style) -> Option<Series> {
    if !scope.learns() {
        let values: Vec<f64> = scope.finals(&kind.metric).into_values().collect();
        return Summary::of(&values).map(|summary| level(label, style, (summary.n, scope.planned()), summary.mean));
    }
    let mut seeds: BTreeMap<u64, Vec<f64>> = BTreeMap::new();
    let mut n = 0;
    for trial in scope.trials.iter().filter(|trial| trial.is_ok()) {
        let curve = trial.curve(Phase::Evaluate, &kind.metric);
        n += usize::from(!curve.is_empty());
        for (step, value) in curve.into_iter().filter(|(step, _)| *step >= kind.from_step) {
            seeds.entry(step).or_default().push(value);
        }
    }
    let points = smooth(seeds.iter().map(|(step, values)| point(*step, values, kind.band)).collect(), kind.smooth);
    Some(Series { label, seeds: Some((n, scope.planned())), style, shape: Shape::Line(points) })
}

fn point(step: u64, values: &[f64], band: Band) -> Point {
    let mean = estimators::mean(values);
    let many = values.len() > 1;
    let interval = match band {
        Band::None => None,
        Band::Sd => many.then(|| (mean - estimators::sd(values), mean + estimators::sd(values))),
        Band::Interval => Bootstrap::CURVE
            .stratified(&[values.to_vec()], |tasks| estimators::mean(&tasks[0]))
            .map(|interval| (interval.low, interval.high)),
        Band::Range => many.then(|| (estimators::quantile(values, 0.0), estimators::quantile(values, 1.0))),
    };
    #[allow(clippy::cast_precision_loss, reason = "steps are far below 2^52")]
    Point { x: step as f64, y: mean, interval }
}

/// The line as a moving average; the band stays as it is.
fn smooth(mut points: Vec<Point>, smooth: f64) -> Vec<Point> {
    let heights: Vec<f64> = points.iter().map(|point| point.y).collect();
    points.iter_mut().zip(estimators::moving_average(&heights, smooth)).for_each(|(point, y)| point.y = y);
    points
}

fn explain(kind: &LearningCurve) -> String {
    let band = match kind.band {
        Band::Sd => Some("one standard deviation to each side"),
        Band::Interval => Some("95 % bootstrap intervals of the mean"),
        Band::Range => Some("from the smallest to the largest seed"),
        Band::None => None,
    };
    let (lines, bands) = if kind.smooth > 0.0 {
        (
            format!("moving averages (weight of the past {}) of means over n seeds", kind.smooth),
            "; bands, which are not averaged,",
        )
    } else {
        ("means over n seeds".into(), ", bands")
    };
    let band = band.map_or(String::new(), |band| format!("{bands} {band}"));
    let from = match kind.from_step {
        0 => String::new(),
        step => format!(", from step {step} on"),
    };
    format!("Lines are {lines}{from}{band}; straight lines are agents that do not learn.")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_by_hand() {
        let of = |band| point(5, &[1.0, 2.0, 6.0], band);
        assert_eq!((of(Band::None).y, of(Band::None).interval), (3.0, None));
        assert_eq!(of(Band::Range).interval, Some((1.0, 6.0)));
        let (low, high) = of(Band::Sd).interval.unwrap();
        assert!((high - 3.0 - 7f64.sqrt()).abs() < 1e-12 && (low - 3.0 + 7f64.sqrt()).abs() < 1e-12);
        assert_eq!(point(5, &[1.0], Band::Sd).interval, None);
    }

    #[test]
    fn the_line_is_averaged_and_the_band_is_not() {
        let raw: Vec<Point> =
            [(0, [0.0, 2.0]), (1, [2.0, 4.0]), (2, [2.0, 4.0])].map(|(step, values)| point(step, &values, Band::Range)).into();
        let smoothed = smooth(raw.clone(), 0.5);
        assert_eq!(smoothed.iter().map(|point| point.y).collect::<Vec<_>>(), [1.0, 2.0, 2.5]);
        assert!(smoothed.iter().zip(&raw).all(|(one, other)| one.interval == other.interval));
        assert_eq!(smooth(raw.clone(), 0.0), raw);
    }

    #[test]
    fn the_note_says_what_is_averaged() {
        let of = |smooth, band| explain(&LearningCurve { smooth, band, ..LearningCurve::default() });
        assert_eq!(
            of(0.0, Band::Sd),
            "Lines are means over n seeds, bands one standard deviation to each side; straight lines are agents that do not learn."
        );
        assert!(of(0.9, Band::Sd).starts_with(
            "Lines are moving averages (weight of the past 0.9) of means over n seeds; bands, which are not averaged, one"
        ));
        assert!(of(0.9, Band::None).contains("n seeds; straight"));
    }
}
