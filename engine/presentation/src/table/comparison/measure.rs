//! The number of one seed: a choice among its trial's measurements, and its relation to the number of another agent.

use super::{
    Comparison,
    build::Relation,
    taken::{MeasurementChoice, StepMeasurement},
};
use crate::table::{MissingReason, Scope};
use contract::{Phase, trial_result::TrialResult};
use statistics::estimators::{mean, moving_average};

/// Rule for the number of a trial in one cell.
pub(super) struct Measure<'a> {
    pub(super) comparison: &'a Comparison,
    /// The step of the column; `None` if columns are no steps.
    pub(super) at_step: Option<u64>,
}

/// The value of one seed, or the reason for its absence.
pub(super) fn seed_value(
    trial: &TrialResult,
    measure: &Measure<'_>,
    relation: &Relation<'_>,
) -> Result<f64, MissingReason> {
    let value = measure.of(trial)?;
    let Some(other) = relation.other() else {
        return Ok(value);
    };
    let (seed, agent) = (trial.trial.key.seed, other.to_owned());
    let Some(other) = relation.counterpart(trial) else {
        return Err(MissingReason::NoCounterpart { seed, agent });
    };
    if !other.is_ok() {
        return Err(MissingReason::CounterpartFailed { seed, agent });
    }
    let related = relation.apply(value, measure.of(other)?);
    if related.is_finite() {
        return Ok(related);
    }
    Err(MissingReason::DivisionByZero {
        seed,
        agent,
        metric: measure.comparison.value.clone(),
    })
}

impl Measure<'_> {
    /// The trials that were trained at least up to the step of the column.
    pub(super) fn trained_for<'a>(&self, scope: &Scope<'a>) -> Scope<'a> {
        let Some(step) = self.at_step else {
            return scope.clone();
        };
        let reaches = |trial: &&&TrialResult| match self.curve(trial).as_slice() {
            [_, .., (last, _)] => !trial.is_ok() || *last >= step,
            _ => true,
        };
        Scope {
            trials: scope.trials.iter().filter(reaches).copied().collect(),
        }
    }

    fn curve(&self, trial: &TrialResult) -> Vec<(u64, f64)> {
        trial.while_learning(&self.comparison.value)
    }

    /// The value of a trial, at the end or at a step before it. Agents that do not learn are measured at the end
    /// only.
    fn of(&self, trial: &TrialResult) -> Result<f64, MissingReason> {
        let curve = self.curve(trial);
        let values: Vec<f64> = curve.iter().map(|(_, value)| *value).collect();
        match (self.comparison.taken(), self.at_step) {
            (MeasurementChoice::StepsUntilAbove { level, smooth }, _) => {
                steps_until(level, smooth, &curve, &values, trial)
            }
            (MeasurementChoice::Last(last), _) if !values.is_empty() => Ok(mean_of_last(last, &values)),
            (MeasurementChoice::AtSteps { of, .. }, Some(step)) if values.len() > 1 => {
                match curve.partition_point(|(measured_at, _)| *measured_at <= step) {
                    0 => Err(MissingReason::NotMeasured {
                        seed: trial.trial.key.seed,
                        until: step,
                    }),
                    end => Ok(at_step(of, &values[..end])),
                }
            }
            // The only measurement during learning counts as the last one, regardless of the step.
            (
                MeasurementChoice::AtSteps {
                    of: StepMeasurement::Last(last),
                    ..
                },
                _,
            ) if !values.is_empty() => Ok(mean_of_last(last, &values)),
            (MeasurementChoice::RootMeanSquare, _) => self.recorded(trial, TrialResult::root_mean_square),
            _ => self.recorded(trial, TrialResult::mean),
        }
    }

    /// The reduction of the episodes of the final measurement to one number.
    fn recorded(
        &self,
        trial: &TrialResult,
        pooled: fn(&TrialResult, Phase, &str) -> Option<f64>,
    ) -> Result<f64, MissingReason> {
        let (seed, metric) = (trial.trial.key.seed, &self.comparison.value);
        pooled(trial, Phase::Final, metric).ok_or_else(|| MissingReason::NotRecorded {
            seed,
            metric: metric.clone(),
            while_learning: !self.curve(trial).is_empty(),
        })
    }
}

fn steps_until(
    level: f64,
    smooth: f64,
    curve: &[(u64, f64)],
    values: &[f64],
    trial: &TrialResult,
) -> Result<f64, MissingReason> {
    let passed = moving_average(values, smooth)
        .iter()
        .position(|average| *average > level);
    #[allow(clippy::cast_precision_loss, reason = "steps are far below 2^52")]
    let steps = passed.map(|index| curve[index].0 as f64);
    steps.ok_or(MissingReason::NeverAbove {
        seed: trial.trial.key.seed,
        level,
    })
}

fn at_step(of: StepMeasurement, values: &[f64]) -> f64 {
    match of {
        StepMeasurement::Average(smooth) => moving_average(values, smooth)[values.len() - 1],
        StepMeasurement::Last(last) => mean_of_last(last, values),
    }
}

fn mean_of_last(last: u64, values: &[f64]) -> f64 {
    mean(
        &values[values
            .len()
            .saturating_sub(usize::try_from(last).unwrap_or(usize::MAX))..],
    )
}
