//! Protocol `estimator_tracking`: let an agent estimate something from more and more samples, and record what it has so far.
//!
//! The agent does not improve; its `learn` takes in one-step samples and says its running estimates with
//! [`Recorder::latest`](crate::Recorder::latest). They are recorded at 1, 2, 4, 8, ... batches and at the end.

use super::{Protocol, Run, evaluation::observe};
use crate::{Config, Environment, Error, Metric, Mode, Observation, Phase, Registry, Rng, agent::Transition};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How many samples to take.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct EstimatorTracking {
    /// Batches of samples.
    #[schemars(range(min = 1), extend("x-unit" = "batches"))]
    pub batches: u64,
    /// Samples in a batch, each the first step of an episode.
    #[schemars(range(min = 1, max = 65536))]
    pub batch: u64,
}

impl Default for EstimatorTracking {
    fn default() -> Self {
        Self { batches: 1024, batch: 256 }
    }
}

impl Config for EstimatorTracking {}

/// Registers the protocol.
pub(super) fn register(registry: &mut Registry) {
    registry.protocol(
        "estimator_tracking",
        1,
        "Let an agent estimate something from more and more one-step samples; nothing is learned.",
        |config: EstimatorTracking| config,
        |config| Ok(Box::new(config)),
    );
}

impl Protocol for EstimatorTracking {
    fn metrics(&self) -> Vec<Metric> {
        Vec::new()
    }

    fn records_environment_metrics(&self) -> bool {
        false
    }

    fn total_steps(&self) -> u64 {
        self.batches * self.batch
    }

    fn run(&self, run: &mut Run<'_>) -> Result<(), Error> {
        let mut environment = (run.make_environment)()?;
        let mut environment_rng = run.streams.environment("train", 0);
        let (mut act_rng, mut learn_rng) = (run.streams.agent("act"), run.streams.agent("learn"));
        for batch in 1..=self.batches {
            let samples = self.sample(run, &mut *environment, &mut environment_rng, &mut act_rng)?;
            run.agent.learn(&samples, &mut learn_rng, &mut run.record)?;
            if batch.is_power_of_two() {
                run.record.record_latest(Phase::Evaluate, batch * self.batch);
            }
            (run.progress)(batch * self.batch, self.total_steps());
        }
        run.record.record_latest(Phase::Final, self.total_steps());
        Ok(())
    }
}

impl EstimatorTracking {
    fn sample(
        &self,
        run: &mut Run<'_>,
        environment: &mut dyn Environment,
        environment_rng: &mut Rng,
        act_rng: &mut Rng,
    ) -> Result<Vec<Transition>, Error> {
        // One environment is stepped once from as many starts as there are samples: starts must not depend on each other.
        let seats = environment.reset(environment_rng)?;
        let start = observe(&*run.agent, environment, seats);
        let observations: Vec<Observation> = vec![start; usize::try_from(self.batch).unwrap_or(usize::MAX)];
        let actions = run.agent.act(&observations, Mode::Train, act_rng)?;
        let mut samples = Vec::with_capacity(observations.len());
        for (observation, action) in observations.into_iter().zip(actions) {
            environment.reset(environment_rng)?;
            let step = environment.step(&action, environment_rng)?;
            let next_observation = observe(&*run.agent, environment, step.observations);
            samples.push(Transition { observation, action, rewards: step.rewards, next_observation, end: step.end });
        }
        Ok(samples)
    }
}
