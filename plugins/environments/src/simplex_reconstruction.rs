//! One step: recover a point of the simplex with one hidden entry, and sort it.
//!
//! Thesis, section 3.4.3. A point is drawn uniformly from the simplex, one randomly chosen entry is removed,
//! and the others are the observation, in their order. The action should be the whole point sorted in ascending
//! order; the reward is minus its mean absolute error. The hidden entry is 1 less the sum of the others, so the
//! best reward is 0.

use crate::simplex;
use arithmetic::double::ln;
use contract::{Channel, End, Environment, Error, Metric, PerEpisode, Rng, Seat, Space, Step};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of the `simplex_reconstruction` environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SimplexReconstructionConfig {
    /// Number of entries of the point, the hidden one included.
    #[schemars(range(min = 2, max = 1000), extend("x-source" = "thesis, section 3.4.3"))]
    pub dimensions: usize,
}

impl Default for SimplexReconstructionConfig {
    fn default() -> Self {
        Self { dimensions: 4 }
    }
}

impl contract::Config for SimplexReconstructionConfig {}

/// The `simplex_reconstruction` environment.
#[derive(Debug)]
pub struct SimplexReconstruction {
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    episode: Episode,
}

/// The point of an episode, and the action.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Episode {
    /// The observed entries, `[dimensions - 1]`.
    inputs: Vec<f64>,
    /// The whole point, in ascending order, `[dimensions]`.
    target: Vec<f64>,
    /// The action; `None` before the step.
    output: Option<Vec<f64>>,
}

/// Builds the environment; registered as `simplex_reconstruction`.
///
/// # Errors
/// [`Error::Config`] for fewer than two dimensions, where no entry would be left to observe.
pub fn build(config: SimplexReconstructionConfig) -> Result<Box<dyn Environment>, Error> {
    if config.dimensions < 2 {
        return Err(Error::config(
            "dimensions",
            "a point needs an entry to show and one to hide: at least 2",
        ));
    }
    Ok(Box::new(SimplexReconstruction::new(config.dimensions)))
}

impl SimplexReconstruction {
    fn new(dimensions: usize) -> Self {
        let (mean, deviation) = typical(dimensions);
        let inputs = channels("input", dimensions - 1)
            .into_iter()
            .map(|channel| channel.typical(mean, deviation));
        let seat = Seat {
            name: String::new(),
            observation: Space::Box(inputs.collect()),
            action: Space::Simplex(
                channels("share", dimensions)
                    .into_iter()
                    .map(|channel| channel.name)
                    .collect(),
            ),
        };
        let error =
            Metric::new("mae", "", "mean absolute error of the reconstructed point").lower_is_better();
        Self {
            seats: vec![seat],
            metrics: vec![error.per_episode(PerEpisode::Last)],
            episode: Episode {
                inputs: vec![0.0; dimensions - 1],
                target: vec![0.0; dimensions],
                output: None,
            },
        }
    }
}

/// Mean and standard deviation of one entry of a uniform point: that of Beta(1, n - 1).
fn typical(dimensions: usize) -> (f64, f64) {
    let n = dimensions as f64;
    (1.0 / n, ((n - 1.0) / (n * n * (n + 1.0))).sqrt())
}

/// `prefix_1` to `prefix_count`, each in [0, 1].
fn channels(prefix: &str, count: usize) -> Vec<Channel> {
    (1..=count)
        .map(|number| Channel::new(format!("{prefix}_{number}"), "").within(0.0, 1.0))
        .collect()
}

/// A point drawn uniformly from the simplex: exponential variables over their sum are Dirichlet(1, ..., 1).
fn uniform_point(dimensions: usize, rng: &mut Rng) -> Vec<f64> {
    // The generator's numbers lie in [0, 1); 1 less that keeps the logarithm finite.
    let draws: Vec<f64> = (0..dimensions).map(|_| -ln(1.0 - rng.random::<f64>())).collect();
    let sum: f64 = draws.iter().sum();
    draws.iter().map(|draw| draw / sum).collect()
}

fn mean_absolute_error(output: &[f64], target: &[f64]) -> f64 {
    output
        .iter()
        .zip(target)
        .map(|(output, target)| (output - target).abs())
        .sum::<f64>()
        / target.len() as f64
}

impl Environment for SimplexReconstruction {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    fn reset(&mut self, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        let mut target = uniform_point(self.episode.target.len(), rng);
        let mut inputs = target.clone();
        inputs.remove(rng.random_range(0..inputs.len() as u32) as usize);
        target.sort_by(f64::total_cmp);
        self.episode = Episode {
            inputs: inputs.clone(),
            target,
            output: None,
        };
        Ok(vec![inputs])
    }

    fn step(&mut self, actions: &[Vec<f64>], _rng: &mut Rng) -> Result<Step, Error> {
        let output = simplex::checked(actions, self.episode.target.len(), simplex::SUM_TOLERANCE)?;
        let error = mean_absolute_error(&output, &self.episode.target);
        self.episode.output = Some(output);
        let seen = vec![self.episode.inputs.clone()];
        Ok(Step::new(seen, vec![-error], Some(End::Terminated)).record("mae", error))
    }

    fn state_channels(&self) -> Vec<Channel> {
        channels("target", self.episode.target.len())
    }

    fn state(&self) -> Vec<f64> {
        self.episode.target.clone()
    }

    fn trace_channels(&self) -> Vec<Channel> {
        let dimensions = self.episode.target.len();
        [
            channels("input", dimensions - 1),
            channels("target", dimensions),
            channels("output", dimensions),
        ]
        .concat()
    }

    fn trace(&self) -> Vec<f64> {
        let output = self
            .episode
            .output
            .clone()
            .unwrap_or_else(|| vec![f64::NAN; self.episode.target.len()]);
        [self.episode.inputs.clone(), self.episode.target.clone(), output].concat()
    }

    fn snapshot(&self) -> serde_json::Value {
        // Plain lists of numbers: serde_json refuses only maps whose keys are no strings.
        serde_json::to_value(&self.episode).expect("an episode serialises")
    }

    fn restore(&mut self, snapshot: &serde_json::Value) -> Result<(), Error> {
        let misfit = |problem: String| Error::Checkpoint {
            what: "simplex_reconstruction",
            problem,
        };
        let episode = Episode::deserialize(snapshot).map_err(|source| misfit(source.to_string()))?;
        if episode.target.len() != self.episode.target.len()
            || episode.inputs.len() != self.episode.inputs.len()
        {
            return Err(misfit(format!(
                "{} entries stored, {} configured",
                episode.target.len(),
                self.episode.target.len()
            )));
        }
        self.episode = episode;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_target_is_the_sorted_point_and_the_hidden_entry_follows_from_the_others() {
        let mut environment = SimplexReconstruction::new(4);
        let mut rng = contract::random::stream(&["simplex"]);
        for _ in 0..100 {
            let inputs = environment.reset(&mut rng).unwrap().remove(0);
            let mut point = inputs.clone();
            point.push(1.0 - inputs.iter().sum::<f64>());
            point.sort_by(f64::total_cmp);
            assert!(mean_absolute_error(&point, &environment.state()) < 1e-15);
            let step = environment.step(&[environment.state()], &mut rng).unwrap();
            assert_eq!(
                (step.rewards[0], step.metric("mae").unwrap(), step.end),
                (-0.0, 0.0, Some(End::Terminated))
            );
        }
    }

    #[test]
    fn the_reward_is_the_mean_absolute_error() {
        let mut environment = SimplexReconstruction::new(4);
        let mut rng = contract::random::stream(&["simplex"]);
        environment.episode.target = vec![0.1, 0.2, 0.3, 0.4];
        let step = environment.step(&[vec![0.25; 4]], &mut rng).unwrap();
        assert!((step.rewards[0] + 0.1).abs() < 1e-15);
    }

    /// Each entry of a uniform point of the 4-simplex has mean 1/4 and, sorted, the means of Whitworth's
    /// broken stick.
    #[test]
    fn points_are_uniform() {
        let mut environment = SimplexReconstruction::new(4);
        let mut rng = contract::random::stream(&["simplex"]);
        let (episodes, mut hidden_first, mut means) = (20_000, 0, [0.0; 4]);
        for _ in 0..episodes {
            let inputs = environment.reset(&mut rng).unwrap().remove(0);
            let target = environment.state();
            means
                .iter_mut()
                .zip(&target)
                .for_each(|(mean, entry)| *mean += entry / f64::from(episodes));
            let shows_largest = inputs.iter().any(|entry| *entry == target[3]);
            hidden_first += u32::from(!shows_largest);
        }
        let sticks = [1.0 / 16.0, 7.0 / 48.0, 13.0 / 48.0, 25.0 / 48.0];
        for (mean, expected) in means.iter().zip(sticks) {
            assert!((mean - expected).abs() < 0.005, "{means:?}");
        }
        assert!((f64::from(hidden_first) / f64::from(episodes) - 0.25).abs() < 0.015);
    }

    #[test]
    fn a_snapshot_continues() {
        let mut rng = contract::random::stream(&["simplex"]);
        let (mut one, mut two) = (SimplexReconstruction::new(3), SimplexReconstruction::new(3));
        one.reset(&mut rng).unwrap();
        two.restore(&one.snapshot()).unwrap();
        assert_eq!(one.episode, two.episode);
        assert!(SimplexReconstruction::new(4).restore(&one.snapshot()).is_err());
    }
}
