//! Protocol `supervised_fit`: fit a policy to examples whose answer the environment knows.
//!
//! One example is one episode start: the observation is the input, the full state the target. Every batch is drawn anew;
//! measurements are on examples of their own.

use super::{
    Protocol, Run,
    evaluation::{self, Measurement, measure, observe},
};
use crate::{Config, End, Environment, Error, Metric, Phase, Registry, Rng, agent::Transition};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How long to fit and how much to measure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SupervisedFit {
    /// Batches to fit.
    #[schemars(extend("x-unit" = "batches"))]
    pub steps: u64,
    /// Examples in a batch.
    #[schemars(range(min = 1, max = 65536))]
    pub batch: u64,
    /// Batches between two measurements; 0 measures only at the end.
    #[schemars(extend("x-unit" = "batches"))]
    pub evaluate_every: u64,
    /// Examples of a measurement during the fit.
    pub examples: u64,
    /// Examples of the final measurement.
    #[schemars(range(min = 1))]
    pub final_examples: u64,
}

impl Default for SupervisedFit {
    fn default() -> Self {
        Self { steps: 2_000, batch: 64, evaluate_every: 50, examples: 1_000, final_examples: 10_000 }
    }
}

impl Config for SupervisedFit {}

/// Registers the protocol.
pub(super) fn register(registry: &mut Registry) {
    registry.protocol(
        "supervised_fit",
        1,
        "Fit a policy to examples: the observation is the input, the environment's full state the target.",
        |config: SupervisedFit| SupervisedFit { steps: 0, evaluate_every: 0, examples: 0, ..config },
        |config| Ok(Box::new(config)),
    );
}

impl Protocol for SupervisedFit {
    fn metrics(&self) -> Vec<Metric> {
        evaluation::metrics()
    }

    fn total_steps(&self) -> u64 {
        self.steps
    }

    fn run(&self, run: &mut Run<'_>) -> Result<(), Error> {
        let mut environment = (run.make_environment)()?;
        let (mut examples_rng, mut learn_rng) = (run.streams.environment("train", 0), run.streams.agent("learn"));
        for step in 0..self.steps {
            self.measure_when_due(run, step)?;
            let batch = self.draw(run, &mut *environment, &mut examples_rng)?;
            run.agent.learn(&batch, &mut learn_rng, &mut run.record)?;
            (run.progress)(step + 1, self.steps);
        }
        self.measure_when_due(run, self.steps)?;
        measure(run, &Measurement { phase: Phase::Final, step: self.steps, episodes: self.final_examples, traced: 0 })
    }
}

impl SupervisedFit {
    fn draw(&self, run: &Run<'_>, environment: &mut dyn Environment, rng: &mut Rng) -> Result<Vec<Transition>, Error> {
        (0..self.batch)
            .map(|_| {
                let seats = environment.reset(rng)?;
                let mut observation = observe(&*run.agent, environment, seats);
                observation.state = environment.state();
                Ok(Transition {
                    next_observation: observation.clone(),
                    observation,
                    action: Vec::new(),
                    rewards: Vec::new(),
                    end: Some(End::Terminated),
                })
            })
            .collect()
    }

    fn measure_when_due(&self, run: &mut Run<'_>, step: u64) -> Result<(), Error> {
        if self.evaluate_every == 0 || !step.is_multiple_of(self.evaluate_every) {
            return Ok(());
        }
        run.record.flush_means(step);
        measure(run, &Measurement { phase: Phase::Evaluate, step, episodes: self.examples, traced: 0 })
    }
}
