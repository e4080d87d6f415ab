//! Metrics of an episode, aggregated over its steps.

use crate::{Error, Metric, PerEpisode, Step, exact};
use serde::{Deserialize, Serialize};

/// Metrics of an episode that has not ended.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct EpisodeMetrics {
    /// Sum, largest, smallest or last value so far of each metric, in the order of the environment's metrics.
    #[serde(with = "exact")]
    values: Vec<f64>,
    steps: u64,
}

impl EpisodeMetrics {
    /// Metrics of an episode before its first step; `metrics` are those of the environment.
    #[must_use]
    pub fn new(metrics: &[Metric]) -> Self {
        Self {
            values: vec![0.0; metrics.len()],
            steps: 0,
        }
    }

    /// Adds the values that a step recorded.
    ///
    /// # Errors
    /// [`Error::Recorded`] if the step did not record each of `metrics` once.
    pub fn add(&mut self, metrics: &[Metric], step: &Step) -> Result<(), Error> {
        let is_first = self.steps == 0;
        self.steps += 1;
        if step.metrics.len() > metrics.len() {
            return Err(other_than(metrics, step));
        }
        for (place, (sum, metric)) in self.values.iter_mut().zip(metrics).enumerate() {
            // Steps record metrics in the order in which they are declared, or nearly so.
            let here = step.metrics.get(place).filter(|(name, _)| *name == metric.name);
            let value = here
                .map(|(_, value)| *value)
                .or_else(|| step.metric(&metric.name))
                .ok_or_else(|| other_than(metrics, step))?;
            match metric.per_episode {
                PerEpisode::Sum | PerEpisode::Mean => *sum += value,
                PerEpisode::Max if !is_first => *sum = sum.max(value),
                PerEpisode::Min if !is_first => *sum = sum.min(value),
                PerEpisode::Last | PerEpisode::Max | PerEpisode::Min => *sum = value,
            }
        }
        Ok(())
    }

    /// The value of each metric over the episode so far.
    #[must_use]
    pub fn of_episode(&self, metrics: &[Metric]) -> Vec<f64> {
        #[allow(
            clippy::cast_precision_loss,
            reason = "an episode has far fewer than 2^52 decisions"
        )]
        let steps = self.steps as f64;
        let value = |(value, metric): (&f64, &Metric)| match metric.per_episode {
            PerEpisode::Mean => value / steps,
            _ => *value,
        };
        self.values.iter().zip(metrics).map(value).collect()
    }
}

fn other_than(metrics: &[Metric], step: &Step) -> Error {
    let names = |names: Vec<&str>| match names.is_empty() {
        true => "none".to_owned(),
        false => names.join(", "),
    };
    Error::Recorded {
        recorded: names(step.metrics.iter().map(|(name, _)| &**name).collect()),
        declared: names(metrics.iter().map(|metric| &*metric.name).collect()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn metrics() -> [Metric; 5] {
        let all = [
            PerEpisode::Sum,
            PerEpisode::Mean,
            PerEpisode::Last,
            PerEpisode::Max,
            PerEpisode::Min,
        ];
        let names = ["sum", "mean", "last", "max", "min"];
        std::array::from_fn(|place| Metric::new(names[place], "", "").per_episode(all[place]))
    }

    fn step(names: [&'static str; 5], value: f64) -> Step {
        names
            .into_iter()
            .fold(Step::default(), |step, name| step.record(name, value))
    }

    #[test]
    fn values_of_steps_are_joined_by_their_names() {
        let metrics = metrics();
        let mut episode = EpisodeMetrics::new(&metrics);
        for (names, value) in [
            (["sum", "mean", "last", "max", "min"], -1.0),
            (["min", "max", "last", "mean", "sum"], 4.0),
            (["mean", "sum", "min", "last", "max"], 3.0),
        ] {
            episode.add(&metrics, &step(names, value)).unwrap();
        }
        assert_eq!(episode.of_episode(&metrics), [6.0, 2.0, 3.0, 4.0, -1.0]);
    }

    #[test]
    fn a_step_that_records_other_metrics_is_refused() {
        let metrics = metrics();
        let said = |step: &Step| {
            let error = EpisodeMetrics::new(&metrics).add(&metrics, step);
            error.unwrap_err().to_string()
        };
        let told = said(&step(["sum", "mean", "last", "max", "most"], 1.0));
        assert_eq!(
            told,
            "the environment recorded sum, mean, last, max, most at a step; its metrics are sum, mean, last, max, min"
        );
        let more = step(["sum", "mean", "last", "max", "min"], 1.0).record("more", 1.0);
        assert!(said(&more).contains("max, min, more at a step"));
    }
}
