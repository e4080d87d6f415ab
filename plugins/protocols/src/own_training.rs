//! Training by the agent itself: the protocol waits, reads its values, and builds the record from them.
//!
//! While the training runs, values become rows as they arrive, for live views. The final record is built again from all
//! values at the end, in one order, so that it does not depend on the times at which they were read:
//!
//! | phase | rows |
//! |---|---|
//! | `train` | every value at its own step |
//! | `evaluate` | at each multiple of `evaluate_every`: the mean of the last values up to there |
//! | `final` | the mean of the last values, at the last step of the protocol |
//!
//! Measurements on the protocol's own episodes ([`own_measuring`]) come after these rows.

use super::{
    own_measuring::{self, RequestedMeasurements},
    train_evaluate::TrainEvaluate,
};
use contract::{
    Error, OwnTraining, Phase, Recorder, clock,
    own_training::{Advance, Assignment, Curve, TrainingAllocation},
    protocol::Run,
    resources::Share,
    standard_metrics::OWN_STEPS,
};
use statistics::estimators::mean;
use std::time::{Duration, Instant};

/// Time between two polls of a training.
const LOOK: Duration = Duration::from_millis(50);
/// Time between two copies of the training's output.
const KEEP_EVERY: Duration = Duration::from_secs(5);

/// Lets the agent train for the steps of a protocol.
pub(super) fn run(of: &TrainEvaluate, run: &mut Run<'_>) -> Result<(), Error> {
    let (steps, every) = (of.steps, of.evaluate_every);
    let mut temporary = None;
    let place = place(run, &mut temporary)?;
    let assignment = Assignment {
        steps,
        evaluate_every: every,
        ..run.assignment.clone()
    };
    let grid = Grid { steps, every };
    own(run)?.begin(&assignment, &place)?;
    let mut taken = RequestedMeasurements::default();
    let until = until_it_ends(of, &place, &mut taken, run);
    keep_output(run)?;
    if let Some(until) = until? {
        return pause(grid, until, run);
    }
    settle(grid, taken, run)?;
    (run.progress)(steps, steps);
    run.record.all_finite()?;
    own_measuring::end(of, run)
}

/// Replaces the rows that were shown while the training ran by its final record.
fn settle(grid: Grid, taken: RequestedMeasurements, run: &mut Run<'_>) -> Result<(), Error> {
    let training = own(run)?;
    taken.is_whole(training.measured())?;
    let curves = training.curves(true)?;
    let mut record = settled(grid, curves, None);
    end(grid.steps, curves, taken.reached(), &mut record);
    taken.into_record(&mut record);
    record.decided_as(&run.record);
    run.keeper.begin_anew();
    run.record = record;
    Ok(())
}

/// Reads values until the training ends, or until the step of a pause, which is returned.
fn until_it_ends(
    of: &TrainEvaluate,
    place: &TrainingAllocation,
    taken: &mut RequestedMeasurements,
    run: &mut Run<'_>,
) -> Result<Option<u64>, Error> {
    let grid = Grid {
        steps: of.steps,
        every: of.evaluate_every,
    };
    let (mut live, mut heard, mut kept) = (LiveRecord::new(grid), clock::now(), clock::now());
    loop {
        let advance = own(run)?.advance(LOOK)?;
        let Some(training) = run.agent.own_training() else {
            return Err(no_training());
        };
        let has_grown = live.record(training.curves(false)?, &mut run.record);
        let reached = live.step.max(taken.reached().unwrap_or(0));
        (run.progress)(reached.min(grid.steps), grid.steps);
        run.keeper.note(&run.record).map_err(Error::of_store)?;
        run.record.all_finite()?;
        if advance == Advance::Ended {
            return Ok(None);
        }
        if run.keeper.stopping() {
            own(run)?.stop();
            return Err(Error::Stopped);
        }
        if let Some(until) = place.until.filter(|until| live.step > *until) {
            return Ok(Some(until));
        }
        if let Advance::Asks(asked) = advance
            && let Err(error) = taken.answer(of, asked, run)
        {
            own(run)?.stop();
            return Err(error);
        }
        if has_grown || advance != (Advance::Running { heard: false }) {
            heard = clock::now();
        }
        // A process that is ended because of a limit still leaves its last copy.
        if heard > kept && clock::since(kept) > KEEP_EVERY {
            keep_output(run)?;
            kept = clock::now();
        }
        hold_patience(run, heard)?;
    }
}

/// Copies the training's output, however it ended.
fn keep_output(run: &mut Run<'_>) -> Result<(), Error> {
    match own(run)?.output() {
        Some(said) => run.keeper.keep_output(&said).map_err(Error::of_store),
        None => Ok(()),
    }
}

/// Ends a training that has been silent for too long.
fn hold_patience(run: &mut Run<'_>, heard: Instant) -> Result<(), Error> {
    match run.keeper.patience() {
        Some(patience) if clock::since(heard) > patience => {
            own(run)?.stop();
            Err(Error::Silent { limit: patience })
        }
        _ => Ok(()),
    }
}

/// Stops the training and keeps the values up to a step. Later work is in its files, and counts once it continues.
fn pause(grid: Grid, until: u64, run: &mut Run<'_>) -> Result<(), Error> {
    own(run)?.stop();
    let record = settled(grid, own(run)?.curves(false)?, Some(until));
    run.keeper.begin_anew();
    run.record = record;
    run.keeper.look(&run.record);
    Err(Error::Stopped)
}

/// The folder in which the training works: one of the trial, or a temporary one.
fn place(run: &mut Run<'_>, temporary: &mut Option<tempfile::TempDir>) -> Result<TrainingAllocation, Error> {
    if let Some(place) = run.keeper.place().map_err(Error::of_store)? {
        return Ok(place);
    }
    let made = tempfile::tempdir().map_err(Error::file("create a folder in", &std::env::temp_dir()))?;
    let folder = temporary.insert(made).path().to_owned();
    Ok(TrainingAllocation {
        folder,
        until: None,
        patience: None,
        share: Share::default(),
    })
}

pub(super) fn own<'a>(run: &'a mut Run<'_>) -> Result<&'a mut dyn OwnTraining, Error> {
    run.agent.own_training().ok_or_else(no_training)
}

fn no_training() -> Error {
    Error::config("agent", "it does not train itself")
}

/// The steps at which values count as measurements.
#[derive(Debug, Clone, Copy)]
struct Grid {
    steps: u64,
    every: u64,
}

impl Grid {
    /// The measurements of a curve at multiples of `every` from `first` up to `last`; none before its first
    /// value.
    fn measured(self, curve: &Curve, first: u64, last: u64) -> Vec<(u64, f64)> {
        if self.every == 0 {
            return Vec::new();
        }
        let steps = (first / self.every..=last.min(self.steps) / self.every).map(|it| it * self.every);
        let at = |step| Some((step, recent(curve, step)?));
        steps.filter(|step| *step >= first).filter_map(at).collect()
    }
}

/// The mean of the last values of a curve up to a step.
fn recent(curve: &Curve, until: u64) -> Option<f64> {
    let values = curve.values.iter().filter(|(step, _)| *step <= until);
    let values: Vec<f64> = values.map(|(_, value)| *value).collect();
    let last = usize::try_from(curve.last).unwrap_or(usize::MAX);
    let from = values.len().saturating_sub(last);
    (!values.is_empty()).then(|| mean(&values[from..]))
}

/// The largest step of a curve.
fn last_step(curve: &Curve) -> Option<u64> {
    curve.values.iter().map(|(step, _)| *step).max()
}

/// The metric that shows the progress of a training: the return, or else the first one.
fn lead(curves: &[Curve]) -> Option<&Curve> {
    let named = curves.iter().find(|it| it.metric.name == "return");
    named.or(curves.first())
}

/// The record of a training: of all of it, or up to a step, with the same rows up to there.
fn settled(grid: Grid, curves: &[Curve], until: Option<u64>) -> Recorder {
    let mut rows = Vec::new();
    for (place, curve) in curves.iter().enumerate() {
        let counts = |step: u64| until.is_none_or(|until| step <= until);
        let mut values: Vec<(u64, f64)> = curve.values.iter().copied().filter(|it| counts(it.0)).collect();
        values.sort_by_key(|(step, _)| *step);
        let last = last_step(curve).unwrap_or(0).min(until.unwrap_or(u64::MAX));
        let train =
            numbered(&values).map(|(step, episode, value)| (step, Phase::Train, place, episode, value));
        rows.extend(train);
        let measured = grid.measured(curve, 0, last).into_iter();
        rows.extend(measured.map(|(step, value)| (step, Phase::Evaluate, place, 0, value)));
    }
    rows.sort_by_key(|(step, phase, place, episode, _)| (*step, *phase, *place, *episode));
    let mut record = Recorder::default();
    for (step, phase, place, episode, value) in rows {
        record.add(phase, step, episode, 0, &curves[place].metric.name, value);
    }
    record
}

/// Values, each with the number of earlier values at the same step.
fn numbered(values: &[(u64, f64)]) -> impl Iterator<Item = (u64, u64, f64)> {
    let mut before = None;
    values.iter().map(move |(step, value)| {
        let episode = match before {
            Some((last, episode)) if last == *step => episode + 1,
            _ => 0,
        };
        before = Some((*step, episode));
        (*step, episode, *value)
    })
}

/// Records the last step of a training, which requested measurements up to `asked`, if at all. A training
/// without any step records none.
fn end(steps: u64, curves: &[Curve], asked: Option<u64>, record: &mut Recorder) {
    for curve in curves {
        if let Some(value) = recent(curve, u64::MAX) {
            record.add(Phase::Final, steps, 0, 0, &curve.metric.name, value);
        }
    }
    #[allow(clippy::cast_precision_loss, reason = "steps are far below 2^52")]
    if let Some(done) = curves.iter().filter_map(last_step).chain(asked).max() {
        record.add(Phase::Final, steps, 0, 0, OWN_STEPS, done as f64);
    }
}

/// Rows of a running training: values as they arrive, and measurements once no value can change them.
struct LiveRecord {
    grid: Grid,
    /// For each curve, the number of values that became rows, and the step of the next measurement.
    taken: Vec<(usize, u64)>,
    /// The last step so far.
    step: u64,
}

impl LiveRecord {
    fn new(grid: Grid) -> Self {
        Self {
            grid,
            taken: Vec::new(),
            step: 0,
        }
    }

    /// Adds the new rows; returns whether there were any.
    fn record(&mut self, curves: &[Curve], record: &mut Recorder) -> bool {
        self.taken.resize(curves.len(), (0, 0));
        let mut has_grown = false;
        for (curve, (taken, next)) in curves.iter().zip(&mut self.taken) {
            let name = &curve.metric.name;
            for (step, value) in curve.values.get(*taken..).unwrap_or_default() {
                record.add(Phase::Train, *step, 0, 0, name, *value);
                has_grown = true;
            }
            *taken = curve.values.len();
            // The last step of a curve may still get more values.
            let Some(before) = last_step(curve).and_then(|last| last.checked_sub(1)) else {
                continue;
            };
            for (step, value) in self.grid.measured(curve, *next, before) {
                record.add(Phase::Evaluate, step, 0, 0, name, value);
                *next = step + 1;
            }
        }
        self.step = lead(curves).and_then(last_step).unwrap_or(0);
        has_grown
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::Metric;
    use proptest::prelude::*;

    fn curve(name: &str, last: u64, values: &[(u64, f64)]) -> Curve {
        Curve {
            metric: Metric::new(name, "", ""),
            last,
            values: values.to_vec(),
        }
    }

    fn rows(record: &Recorder, phase: Phase, name: &str) -> Vec<(u64, f64)> {
        let rows = record.rows().iter().filter(|row| row.phase == phase);
        let named = rows.filter(|row| record.names()[usize::from(row.metric)] == name);
        named.map(|row| (row.step, row.value)).collect()
    }

    const GRID: Grid = Grid { steps: 30, every: 10 };

    /// The record of a training that ended.
    fn ended(grid: Grid, curves: &[Curve]) -> Recorder {
        let mut record = settled(grid, curves, None);
        end(grid.steps, curves, None, &mut record);
        record
    }

    #[test]
    fn a_measurement_is_the_mean_of_the_last_values_up_to_its_step() {
        let curves = [curve("return", 2, &[(5, 1.0), (10, 3.0), (10, 5.0), (27, 9.0)])];
        let record = ended(GRID, &curves);
        assert_eq!(rows(&record, Phase::Train, "return"), curves[0].values);
        assert_eq!(
            rows(&record, Phase::Evaluate, "return"),
            [(10, 4.0), (20, 4.0)],
            "nothing before the first value, nothing beyond the last"
        );
        assert_eq!(rows(&record, Phase::Final, "return"), [(30, 7.0)]);
        assert_eq!(rows(&record, Phase::Final, OWN_STEPS), [(30, 27.0)]);
    }

    #[test]
    fn without_steps_between_measurements_there_is_the_last_one_alone() {
        let grid = Grid { every: 0, ..GRID };
        let record = ended(grid, &[curve("loss", 1, &[(5, 1.0)])]);
        assert_eq!(rows(&record, Phase::Evaluate, "loss"), []);
        assert_eq!(rows(&record, Phase::Final, "loss"), [(30, 1.0)]);
    }

    #[test]
    fn a_training_that_passes_the_last_step_is_measured_up_to_it() {
        let record = ended(GRID, &[curve("return", 1, &[(10, 1.0), (41, 4.0)])]);
        assert_eq!(
            rows(&record, Phase::Evaluate, "return"),
            [(10, 1.0), (20, 1.0), (30, 1.0)]
        );
        assert_eq!(rows(&record, Phase::Final, "return"), [(30, 4.0)]);
    }

    proptest! {
        /// A search compares the same values at a pause as at the end.
        #[test]
        fn the_record_up_to_a_step_is_the_beginning_of_the_whole(
            values in proptest::collection::vec((0u64..40, -9.0..9.0), 1..20), until in 0u64..4, last in 1u64..4,
        ) {
            let curves = [curve("a", last, &values), curve("b", 1, &values[..values.len() / 2])];
            let (part, whole) = (settled(GRID, &curves, Some(until * 10)), ended(GRID, &curves));
            prop_assert_eq!(part.rows(), &whole.rows()[..part.rows().len()]);
            let next = &whole.rows()[part.rows().len()];
            prop_assert!(next.step > until * 10 || next.phase == Phase::Final);
        }

        /// The measurements that a live view shows are those of the record, however often it is updated.
        #[test]
        fn the_rows_of_a_running_training_are_those_of_the_record(
            mut values in proptest::collection::vec((0u64..40, -9.0..9.0), 1..20), pieces in 1usize..6,
        ) {
            values.sort_by_key(|(step, _)| *step);
            let (mut live, mut seen) = (LiveRecord::new(GRID), Recorder::default());
            for piece in 1..=pieces {
                let until = values.len() * piece / pieces;
                live.record(&[curve("a", 2, &values[..until])], &mut seen);
            }
            let whole = ended(GRID, &[curve("a", 2, &values)]);
            prop_assert_eq!(rows(&seen, Phase::Train, "a"), rows(&whole, Phase::Train, "a"));
            let (seen, all) = (rows(&seen, Phase::Evaluate, "a"), rows(&whole, Phase::Evaluate, "a"));
            prop_assert_eq!(&seen[..], &all[..seen.len()]);
            prop_assert!(seen.len() + 1 >= all.len());
        }
    }
}
