//! Protocol `supervised_fit`: fit a policy to examples whose answer the environment knows.
//!
//! One example is one episode start: the observation is the input, the full state the target. Every batch is drawn anew;
//! measurements are on examples of their own.

use super::{
    Protocol, Run,
    evaluation::{self, Measurement, measure, observe},
    position::{Blocks, Position, restored},
};
use crate::{Config, End, Environment, Error, Metric, Phase, Registry, Rng, agent::Transition};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

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

    fn gives_examples(&self) -> bool {
        true
    }

    fn total_steps(&self) -> u64 {
        self.steps
    }

    fn run(&self, run: &mut Run<'_>) -> Result<(), Error> {
        let mut blocks = None;
        match run.resume()? {
            None => {
                let fit = Fit::start(run)?;
                self.measure_when_due(run, &fit, None)?;
                self.fit(run, fit)?;
            }
            Some(Position { learning: Some(saved), measuring }) => {
                let fit = Fit::restored(run, saved)?;
                if measuring.is_some() {
                    self.measure_when_due(run, &fit, measuring)?;
                }
                self.fit(run, fit)?;
            }
            Some(Position { learning: None, measuring }) => blocks = measuring,
        }
        let what = Measurement { phase: Phase::Final, step: self.steps, episodes: self.final_examples, traced: 0 };
        measure(run, &what, blocks, || None::<SavedFit>)
    }
}

impl SupervisedFit {
    fn fit(&self, run: &mut Run<'_>, mut fit: Fit) -> Result<(), Error> {
        while fit.step < self.steps {
            run.checkpoint(|| Position { learning: Some(fit.save()), measuring: None })?;
            let batch = (0..self.batch).map(|_| fit.draw(run)).collect::<Result<Vec<_>, _>>()?;
            run.agent.learn(&batch, &mut fit.learn_rng, &mut run.record)?;
            fit.step += 1;
            (run.progress)(fit.step, self.steps);
            self.measure_when_due(run, &fit, None)?;
        }
        Ok(())
    }

    fn measure_when_due(&self, run: &mut Run<'_>, fit: &Fit, blocks: Option<Blocks>) -> Result<(), Error> {
        if self.evaluate_every == 0 || !fit.step.is_multiple_of(self.evaluate_every) {
            return Ok(());
        }
        run.record.flush_means(fit.step);
        let what = Measurement { phase: Phase::Evaluate, step: fit.step, episodes: self.examples, traced: 0 };
        measure(run, &what, blocks, || Some(fit.save()))
    }
}

/// A fit between two batches.
struct Fit {
    /// Batches so far.
    step: u64,
    environment: Box<dyn Environment>,
    examples_rng: Rng,
    learn_rng: Rng,
}

/// What [`Fit`] is restored from.
#[derive(Debug, Serialize, Deserialize)]
struct SavedFit {
    step: u64,
    /// `None` before the first example: the environment is then as it is made.
    environment: Option<Value>,
    examples_rng: Rng,
    learn_rng: Rng,
}

impl Fit {
    fn start(run: &mut Run<'_>) -> Result<Self, Error> {
        let environment = (run.make_environment)()?;
        let (examples_rng, learn_rng) = (run.streams.environment("train", 0), run.streams.agent("learn"));
        Ok(Self { step: 0, environment, examples_rng, learn_rng })
    }

    fn save(&self) -> SavedFit {
        SavedFit {
            step: self.step,
            environment: (self.step > 0).then(|| self.environment.snapshot()),
            examples_rng: self.examples_rng.clone(),
            learn_rng: self.learn_rng.clone(),
        }
    }

    fn restored(run: &mut Run<'_>, saved: SavedFit) -> Result<Self, Error> {
        let SavedFit { step, environment, examples_rng, learn_rng } = saved;
        let environment = match environment {
            Some(snapshot) => restored(run.make_environment, &snapshot)?,
            None => (run.make_environment)()?,
        };
        Ok(Self { step, environment, examples_rng, learn_rng })
    }

    /// One example: a start and its answer.
    fn draw(&mut self, run: &Run<'_>) -> Result<Transition, Error> {
        let seats = self.environment.reset(&mut self.examples_rng)?;
        let mut observation = observe(&*run.agent, &*self.environment, seats);
        observation.state = self.environment.state();
        Ok(Transition {
            next_observation: observation.clone(),
            observation,
            action: Vec::new(),
            rewards: Vec::new(),
            end: Some(End::Terminated),
        })
    }
}
