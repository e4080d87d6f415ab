//! Times of trials as a trace in the Trace Event Format, for Perfetto and the tracing page of Chromium.
//!
//! The store keeps the end and the duration of a trial, so a trial that was stopped and resumed seems to have begun
//! later than it did. The store does not keep the worker. Trials that ran at the same time lie in different lanes,
//! and there are as many lanes as trials ever ran at once.

use super::{Subject, pretty};
use contract::{Error, trial_result::TrialResult};
use execution::store::{StoredTrial, seconds_of, write_durably};
use serde_json::{Value, json};
use std::path::Path;

/// Name of the file.
const FILE: &str = "trace.json";
/// Resolution of the times of ends, in seconds; consecutive trials may seem to overlap by as much.
const RESOLUTION_S: f64 = 1.0;
const MICROSECONDS: f64 = 1e6;

/// Sentence on the times.
const ABOUT: &str = "a bar is the wall-clock time that a trial took, laid before the second in which it ended; lanes \
                     are trials that ran at the same time, not workers";

/// Writes the trace of all trials that ended.
///
/// # Errors
/// [`Error::File`] where the file cannot be written.
pub(super) fn write(subject: &Subject<'_>, folder: &Path) -> Result<(), Error> {
    let spans = spans(&subject.trials);
    let first = spans.iter().map(|span| span.from).fold(f64::INFINITY, f64::min);
    let lanes = lanes(&spans);
    let mut events = vec![named("process_name", 0, subject.name)];
    let n_lanes = lanes.iter().max().map_or(0, |last| last + 1);
    events.extend((0..n_lanes).map(|lane| named("thread_name", lane, &format!("lane {}", lane + 1))));
    events.extend(
        spans
            .iter()
            .zip(&lanes)
            .map(|(span, lane)| span.event(first, *lane)),
    );
    let trace = json!({"traceEvents": events, "displayTimeUnit": "ms",
        "otherData": {"study": subject.name, "program": subject.program(), "description": ABOUT}});
    write_durably(&folder.join(FILE), pretty(&trace).as_bytes())
}

/// A trial in time, in seconds since 1970.
struct Span<'a> {
    from: f64,
    to: f64,
    trial: &'a TrialResult,
}

/// Trials whose end is known, in the order of their beginnings.
fn spans<'a>(trials: &[(&'a TrialResult, Option<&StoredTrial>)]) -> Vec<Span<'a>> {
    let span = |(trial, stored): &(&'a TrialResult, Option<&StoredTrial>)| {
        let stored = (*stored)?;
        #[allow(clippy::cast_precision_loss, reason = "seconds since 1970 are exact")]
        let to = seconds_of(stored.ended_at.as_ref()?)? as f64;
        let from = to - stored.end.wall_s;
        Some(Span { from, to, trial })
    };
    let mut spans: Vec<Span<'_>> = trials.iter().filter_map(span).collect();
    spans.sort_by(|one, other| one.from.total_cmp(&other.from));
    spans
}

/// The lane of each span: the first one that is free at its beginning.
fn lanes(spans: &[Span<'_>]) -> Vec<usize> {
    let mut free_from: Vec<f64> = Vec::new();
    let lane = |span: &Span<'_>| {
        let free = free_from.iter().position(|end| *end <= span.from + RESOLUTION_S);
        let lane = free.unwrap_or(free_from.len());
        free_from.resize(free_from.len().max(lane + 1), 0.0);
        free_from[lane] = span.to;
        lane
    };
    spans.iter().map(lane).collect()
}

impl Span<'_> {
    fn event(&self, first: f64, lane: usize) -> Value {
        let (trial, cell) = (&self.trial.trial, &self.trial.trial.cell);
        let state = self.trial.end.as_ref().map(|end| end.state.name());
        json!({"ph": "X", "pid": 0, "tid": lane, "cat": cell.environment,
            "name": format!("{} {} seed {}", cell.environment, cell.agent, trial.key.seed),
            "ts": ((self.from - first) * MICROSECONDS).round(), "dur": ((self.to - self.from) * MICROSECONDS).round(),
            "args": {"trial": trial.id, "setting": cell.point.to_string(), "end": state}})
    }
}

/// The name of the process or of a lane.
fn named(kind: &str, lane: usize, name: &str) -> Value {
    json!({"ph": "M", "pid": 0, "tid": lane, "name": kind, "args": {"name": name}})
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::synthetic::trial;

    #[test]
    fn lanes_are_as_many_as_trials_ran_at_once() {
        let result = trial("cells", "equal", "", 0, &Vec::new());
        let span = |from: f64, to: f64| Span {
            from,
            to,
            trial: &result,
        };
        // Two workers: one computes a long trial; the other computes two trials beside it, and one more afterwards.
        let spans = [
            span(0.0, 10.0),
            span(0.5, 30.0),
            span(9.6, 20.0),
            span(31.0, 40.0),
        ];
        assert_eq!(lanes(&spans), [0, 1, 0, 0]);
        assert_eq!(
            lanes(&[span(0.0, 10.0), span(1.0, 9.0), span(2.0, 8.0)]),
            [0, 1, 2]
        );
        let bar = spans[2].event(0.5, 1);
        assert_eq!((&bar["ts"], &bar["dur"]), (&json!(9.1e6), &json!(10.4e6)));
    }
}
