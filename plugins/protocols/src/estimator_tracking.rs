//! Protocol `estimator_tracking`: an agent estimates quantities from more and more samples, and its running
//! estimates are recorded.
//!
//! The agent does not improve; its `learn` takes in one-step samples and records its running estimates with
//! [`Recorder::latest`](contract::Recorder::latest). They are recorded after 1, 2, 4, 8, ... batches and at the
//! end.

use contract::{
    Config, Environment, Error, Metric, Mode, Observation, Phase, Protocol, Registry, Rng,
    agent::Transition,
    protocol::{Run, observe, restored},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Settings of the `estimator_tracking` protocol.
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
        Self {
            batches: 1024,
            batch: 256,
        }
    }
}

impl Config for EstimatorTracking {}

pub(super) fn register(registry: &mut Registry) {
    registry.protocol(
        "estimator_tracking",
        2,
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

    fn experience(&self) -> u64 {
        self.total_steps()
    }

    fn run(&self, run: &mut Run<'_>) -> Result<(), Error> {
        let mut sampling = match run.resume()? {
            Some(saved) => Sampling::restored(run, saved)?,
            None => Sampling::start(run)?,
        };
        while sampling.batch < self.batches {
            run.checkpoint(|| sampling.save())?;
            let samples = sampling.draw(run, self.batch)?;
            run.agent
                .learn(&samples, &mut sampling.learn_rng, &mut run.record)?;
            sampling.batch += 1;
            if sampling.batch.is_power_of_two() {
                run.record
                    .record_latest(Phase::Evaluate, sampling.batch * self.batch);
                run.record_updates(Phase::Train, sampling.batch * self.batch);
            }
            (run.progress)(sampling.batch * self.batch, self.total_steps());
        }
        run.record.record_latest(Phase::Final, self.total_steps());
        run.record_updates(Phase::Final, self.total_steps());
        Ok(())
    }
}

/// State of the sampling between two batches.
struct Sampling {
    /// Batches so far.
    batch: u64,
    environment: Box<dyn Environment>,
    environment_rng: Rng,
    act_rng: Rng,
    learn_rng: Rng,
}

/// Form of [`Sampling`] in a checkpoint.
#[derive(Debug, Serialize, Deserialize)]
struct SavedSampling {
    batch: u64,
    /// `None` before the first batch, when the environment is as it was built.
    environment: Option<Value>,
    environment_rng: Rng,
    act_rng: Rng,
    learn_rng: Rng,
}

impl Sampling {
    fn start(run: &mut Run<'_>) -> Result<Self, Error> {
        let environment = (run.make_environment)()?;
        let environment_rng = run.streams.environment("train", 0);
        let (act_rng, learn_rng) = (run.streams.agent("act"), run.streams.agent("learn"));
        Ok(Self {
            batch: 0,
            environment,
            environment_rng,
            act_rng,
            learn_rng,
        })
    }

    fn save(&self) -> SavedSampling {
        SavedSampling {
            batch: self.batch,
            environment: (self.batch > 0).then(|| self.environment.snapshot()),
            environment_rng: self.environment_rng.clone(),
            act_rng: self.act_rng.clone(),
            learn_rng: self.learn_rng.clone(),
        }
    }

    fn restored(run: &mut Run<'_>, saved: SavedSampling) -> Result<Self, Error> {
        let SavedSampling {
            batch,
            environment,
            environment_rng,
            act_rng,
            learn_rng,
        } = saved;
        let environment = match environment {
            Some(snapshot) => restored(run.make_environment, &snapshot)?,
            None => (run.make_environment)()?,
        };
        Ok(Self {
            batch,
            environment,
            environment_rng,
            act_rng,
            learn_rng,
        })
    }

    fn draw(&mut self, run: &mut Run<'_>, samples: u64) -> Result<Vec<Transition>, Error> {
        let Self {
            environment,
            environment_rng,
            act_rng,
            ..
        } = self;
        // One environment is stepped once from as many starts as there are samples, so starts must not depend on each
        // other.
        let seats = environment.reset(environment_rng)?;
        let start = observe(&*run.agent, &**environment, seats);
        let observations: Vec<Observation> = vec![start; usize::try_from(samples).unwrap_or(usize::MAX)];
        let actions = run.agent.act(&observations, Mode::Train, act_rng)?;
        let mut samples = Vec::with_capacity(observations.len());
        for (observation, action) in observations.into_iter().zip(actions) {
            environment.reset(environment_rng)?;
            let step = environment.step(&action, environment_rng)?;
            let next_observation = observe(&*run.agent, &**environment, step.observations);
            samples.push(Transition {
                observation,
                action,
                rewards: step.rewards,
                next_observation,
                end: step.end,
            });
        }
        Ok(samples)
    }
}
