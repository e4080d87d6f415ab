//! Measurements of an agent that trains itself, on the same episodes as for agents that the protocol trains: during the
//! training, when the program asks for one, or afterwards with the policy that it left.

use super::{own_training::own, train_evaluate::TrainEvaluate};
use contract::{
    Error, Phase, Recorder,
    own_training::{MEASURED, Measured, MeasurementPoint},
    protocol::{Measurement, Run, measure, record_static_trace},
};
use std::collections::BTreeMap;

/// Measurements that a training has requested so far.
#[derive(Debug, Default)]
pub(super) struct RequestedMeasurements {
    record: Recorder,
    /// Number of the next measurement during the training.
    next: u64,
    has_last: bool,
    /// The largest step that the training named.
    reached: Option<u64>,
}

impl RequestedMeasurements {
    /// The largest step at which the training requested a measurement.
    pub(super) fn reached(&self) -> Option<u64> {
        self.reached
    }

    /// Makes the measurement that is due and sends its means to the training.
    pub(super) fn answer(
        &mut self,
        of: &TrainEvaluate,
        asked: MeasurementPoint,
        run: &mut Run<'_>,
    ) -> Result<(), Error> {
        let means = match self.due(of, asked)? {
            Some(what) => Some(self.measure(&what, run)?),
            None => None,
        };
        own(run)?.answer(means.as_ref())
    }

    /// The measurement that is due: one for each multiple of `evaluate_every`, as for other agents.
    fn due(&mut self, of: &TrainEvaluate, asked: MeasurementPoint) -> Result<Option<Measurement>, Error> {
        let step = match asked {
            MeasurementPoint::Last if self.has_last => {
                let problem = "the last measurement was asked for twice: `trial.measure(act)` without a step is made once";
                return Err(Error::config(MEASURED, problem));
            }
            MeasurementPoint::Last => {
                self.has_last = true;
                return Ok(Some(of.last()));
            }
            MeasurementPoint::At(step) => step,
        };
        self.reached = self.reached.max(Some(step));
        let index = step.checked_div(of.evaluate_every);
        let Some(index) = index.filter(|index| *index >= self.next && step <= of.steps) else {
            return Ok(None);
        };
        self.next = index + 1;
        Ok(Some(of.measurement(step)))
    }

    fn measure(&mut self, what: &Measurement, run: &mut Run<'_>) -> Result<BTreeMap<String, f64>, Error> {
        let before = run.record.rows().len();
        measure(run, what, None, || None::<()>)?;
        run.record.all_finite()?;
        let part = run.record.since(before);
        self.record.append(&part);
        Ok(means(&part))
    }

    /// Adds the measurements to the record of the training, which is built again from the training's own values.
    pub(super) fn into_record(self, record: &mut Recorder) {
        record.append(&self.record);
    }

    /// Refuses a training that omitted its last measurement.
    pub(super) fn is_whole(&self, measured: Option<Measured>) -> Result<(), Error> {
        if measured != Some(Measured::Calls) || self.has_last {
            return Ok(());
        }
        let problem =
            "the program ended without its last measurement: `trial.measure(act)` without a step makes it";
        Err(Error::config(MEASURED, problem))
    }
}

/// The mean of each metric over the episodes of a measurement.
fn means(record: &Recorder) -> BTreeMap<String, f64> {
    let mut sums: BTreeMap<&str, (f64, f64)> = BTreeMap::new();
    for row in record.rows().iter().filter(|row| row.phase != Phase::Trace) {
        let (sum, count) = sums.entry(&record.names()[usize::from(row.metric)]).or_default();
        (*sum, *count) = (*sum + row.value, *count + 1.0);
    }
    let mean = |(name, (sum, count)): (&str, (f64, f64))| (name.to_owned(), sum / count);
    sums.into_iter().map(mean).collect()
}

/// Makes the remaining measurements, once the training has ended and all its values are in the record.
pub(super) fn end(of: &TrainEvaluate, run: &mut Run<'_>) -> Result<(), Error> {
    let measured = own(run)?.measured();
    if measured == Some(Measured::Policy) {
        own(run)?.take_up()?;
        measure(run, &of.last(), None, || None::<()>)?;
    }
    if measured.is_some() && of.trace_episodes > 0 {
        record_static_trace(run)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(taken: &mut RequestedMeasurements, asked: MeasurementPoint) -> Option<u64> {
        let of = TrainEvaluate {
            steps: 100,
            evaluate_every: 10,
            ..TrainEvaluate::default()
        };
        taken.due(&of, asked).unwrap().map(|what| what.step)
    }

    #[test]
    fn one_measurement_is_due_for_each_multiple_and_one_at_the_end() {
        let mut taken = RequestedMeasurements::default();
        let steps = [0, 5, 12, 19, 40, 30, 100, 101];
        let due: Vec<_> = steps
            .iter()
            .map(|step| asked(&mut taken, MeasurementPoint::At(*step)))
            .collect();
        assert_eq!(
            due,
            [Some(0), None, Some(10), None, Some(40), None, Some(100), None]
        );
        assert_eq!(taken.reached(), Some(101));
        assert!(taken.is_whole(Some(Measured::Calls)).is_err() && taken.is_whole(None).is_ok());
        assert_eq!(asked(&mut taken, MeasurementPoint::Last), Some(100));
        assert!(taken.is_whole(Some(Measured::Calls)).is_ok());
        let twice = taken
            .due(&TrainEvaluate::default(), MeasurementPoint::Last)
            .unwrap_err();
        assert!(twice.to_string().contains("asked for twice"), "{twice}");
    }

    #[test]
    fn without_measurements_during_training_none_is_due() {
        let of = TrainEvaluate {
            evaluate_every: 0,
            ..TrainEvaluate::default()
        };
        assert_eq!(
            RequestedMeasurements::default()
                .due(&of, MeasurementPoint::At(10))
                .unwrap(),
            None
        );
    }

    #[test]
    fn means_are_those_of_episodes() {
        let mut record = Recorder::default();
        for (episode, value) in [(0, 1.0), (1, 4.0)] {
            record.add(Phase::Final, 9, episode, 0, "return", value);
        }
        record.add(Phase::Trace, 0, 0, 0, "return", 100.0);
        assert_eq!(means(&record), [("return".to_owned(), 2.5)].into());
    }
}
