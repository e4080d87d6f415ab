//! Parts of the two estimators of a policy gradient: the bandit's reward, the policy's mean and the moments
//! of the estimates.

use super::checkpoint;
use contract::{Better, Error, Interface, Metric, Recorder, Updates};
use numerics::tensor_file::TensorFile;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Reward `v . a - c |a|^2` of an allocation bandit, read from its full state.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Reward {
    /// Values v, one per entry of the action.
    pub(crate) values: Vec<f64>,
    /// Curvature c.
    pub(crate) curvature: f64,
}

/// Positions of the reward's parameters in the full state.
#[derive(Debug, Clone)]
pub(crate) struct RewardChannels {
    values: Vec<usize>,
    curvature: usize,
}

impl RewardChannels {
    /// Finds `value_1`, `value_2`, ... and `curvature` among the state channels.
    ///
    /// # Errors
    /// [`Error::Mismatch`] where the state does not contain them.
    pub(crate) fn find(agent: &'static str, interface: &Interface) -> Result<Self, Error> {
        let position = |name: &str| interface.state.iter().position(|channel| channel.name == name);
        let values: Vec<usize> = (1..)
            .map_while(|number| position(&format!("value_{number}")))
            .collect();
        match position("curvature") {
            Some(curvature) if values.len() >= 2 => Ok(Self { values, curvature }),
            _ => Err(Error::Mismatch {
                agent,
                problem:
                    "it needs an environment whose state has `value_1`, `value_2`, ... and `curvature`, as \
                     `allocation_bandit`"
                        .into(),
            }),
        }
    }

    /// Number of entries of the action.
    pub(crate) fn len(&self) -> usize {
        self.values.len()
    }

    /// Reward function with the parameters in a state.
    pub(crate) fn read(&self, state: &[f64]) -> Reward {
        Reward {
            values: self.values.iter().map(|&index| state[index]).collect(),
            curvature: state[self.curvature],
        }
    }
}

/// Mean action of the policy: `given`, which must lie inside the simplex, or else equal shares.
pub(crate) fn mean_action(given: Option<Vec<f64>>, entries: usize) -> Result<Vec<f64>, Error> {
    #[allow(clippy::cast_precision_loss, reason = "a handful of entries")]
    let mean = given.unwrap_or_else(|| vec![1.0 / entries as f64; entries]);
    let sum: f64 = mean.iter().sum();
    if mean.len() != entries || mean.iter().any(|share| *share <= 0.0) || (sum - 1.0).abs() > 1e-9 {
        return Err(Error::config(
            "mean",
            format!("write {entries} shares above 0 that sum to 1"),
        ));
    }
    Ok(mean)
}

/// Running mean and variance of single-sample gradient estimates (Welford's algorithm).
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Moments {
    count: f64,
    mean: Vec<f64>,
    squares: Vec<f64>,
    batches: u64,
}

impl Moments {
    /// Adds one estimate.
    pub(crate) fn add(&mut self, estimate: &[f64]) {
        self.mean.resize(estimate.len(), 0.0);
        self.squares.resize(estimate.len(), 0.0);
        self.count += 1.0;
        for ((mean, squares), value) in self.mean.iter_mut().zip(&mut self.squares).zip(estimate) {
            let deviation = value - *mean;
            *mean += deviation / self.count;
            *squares += deviation * (value - *mean);
        }
    }

    /// Writes the moments into `dir`.
    ///
    /// # Errors
    /// [`Error::File`] where the operating system refuses.
    pub(crate) fn save(&self, agent: &'static str, dir: &Path) -> Result<(), Error> {
        checkpoint::write(agent, dir, TensorFile::default(), self)
    }

    /// Restores the moments that [`save`](Self::save) wrote for estimates with `entries` entries.
    ///
    /// # Errors
    /// [`Error::File`] or [`Error::Checkpoint`] where the file is missing or does not fit.
    pub(crate) fn load(&mut self, agent: &'static str, dir: &Path, entries: usize) -> Result<(), Error> {
        let (_, moments): (_, Self) = checkpoint::read(agent, dir)?;
        if ![moments.mean.len(), moments.squares.len()]
            .iter()
            .all(|stored| [0, entries].contains(stored))
        {
            let problem = format!("{} entries stored, {entries} needed", moments.mean.len());
            return Err(Error::Checkpoint { what: agent, problem });
        }
        *self = moments;
        Ok(())
    }

    /// Counts batches: these agents learn nothing, and each batch of samples updates the estimate.
    pub(crate) fn updates(&self) -> Updates {
        Updates {
            made: self.batches,
            first_after: 1,
        }
    }

    /// Ends a batch: records bias and spread of the estimates against the exact gradient.
    pub(crate) fn end_batch(&mut self, exact: &[f64], record: &mut Recorder) {
        self.batches += 1;
        let difference: Vec<f64> = self
            .mean
            .iter()
            .zip(exact)
            .map(|(mean, exact)| mean - exact)
            .collect();
        let variance = self.squares.iter().sum::<f64>() / (self.count - 1.0).max(1.0);
        record.latest("gradient_bias", norm(&difference) / norm(exact));
        record.latest(
            "gradient_bias_noise",
            (variance / self.count).sqrt() / norm(exact),
        );
        record.latest("gradient_variance", variance);
        record.latest("gradient_relative_variance", variance / norm(exact).powi(2));
        record.latest("gradient_norm", norm(exact));
    }
}

/// Euclidean norm.
pub(crate) fn norm(vector: &[f64]) -> f64 {
    vector.iter().map(|entry| entry * entry).sum::<f64>().sqrt()
}

/// Metrics of both estimators.
pub(crate) fn metrics() -> Vec<Metric> {
    let metric = |name, about| Metric {
        better: Better::Lower,
        ..Metric::new(name, "", about)
    };
    vec![
        metric(
            "gradient_bias",
            "|mean estimate - exact gradient| / |exact gradient|",
        ),
        metric(
            "gradient_bias_noise",
            "what sampling alone leaves of the bias: sqrt(variance / samples) / |exact gradient|",
        ),
        metric(
            "gradient_variance",
            "variance of a single-sample estimate, summed over the parameters",
        ),
        metric(
            "gradient_relative_variance",
            "gradient_variance / |exact gradient|^2",
        ),
        metric("gradient_norm", "|exact gradient|"),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_by_hand() {
        let mut moments = Moments::default();
        for estimate in [[1.0, 0.0], [3.0, 0.0], [2.0, 3.0]] {
            moments.add(&estimate);
        }
        assert_eq!(moments.mean, [2.0, 1.0]);
        assert!((moments.squares.iter().sum::<f64>() - 8.0).abs() < 1e-12);
    }
}
