//! Protocol `supervised_fit`: fit a policy to examples whose target the environment knows.
//!
//! An example is the start of an episode: the observation is the input, the full state the target. Every batch is newly
//! drawn; measurements have examples of their own.

use contract::{
    Config, End, Environment, Error, Feed, Metric, Phase, Protocol, Registry, Rng,
    agent::Transition,
    protocol::{self, Blocks, Measurement, Position, Run, measure, measure_alone, observe, restored},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Settings of the `supervised_fit` protocol.
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
    /// False for an agent that does not learn, which is only measured. No study writes this key.
    #[schemars(skip)]
    #[serde(skip_serializing_if = "super::is_true")]
    pub train: bool,
}

impl Default for SupervisedFit {
    fn default() -> Self {
        Self {
            steps: 2_000,
            batch: 64,
            evaluate_every: 50,
            examples: 1_000,
            final_examples: 10_000,
            train: true,
        }
    }
}

impl Config for SupervisedFit {}

pub(super) fn register(registry: &mut Registry) {
    registry.protocol(
        "supervised_fit",
        2,
        "Fit a policy to examples: the observation is the input, the environment's full state the target.",
        without_training,
        |config| Ok(Box::new(config)),
    );
}

/// The protocol for an agent that does not learn: the measurements alone, at the same steps.
fn without_training(config: SupervisedFit) -> SupervisedFit {
    let alone = SupervisedFit {
        batch: 1,
        train: false,
        ..config
    };
    if alone.evaluate_every > 0 {
        alone
    } else {
        SupervisedFit {
            steps: 0,
            examples: 0,
            ..alone
        }
    }
}

impl Protocol for SupervisedFit {
    fn metrics(&self) -> Vec<Metric> {
        protocol::measurement_metrics()
    }

    fn feed(&self) -> Feed {
        Feed::Examples
    }

    fn total_steps(&self) -> u64 {
        if self.train {
            self.steps
        } else {
            self.examples_in_all()
        }
    }

    fn measures_at(&self, step: u64) -> bool {
        self.evaluate_every > 0 && step > 0 && step < self.steps && step.is_multiple_of(self.evaluate_every)
    }

    fn experience(&self) -> u64 {
        if self.train {
            self.steps.saturating_mul(self.batch)
        } else {
            0
        }
    }

    fn run(&self, run: &mut Run<'_>) -> Result<(), Error> {
        if self.train {
            let blocks = self.fit_and_measure(run)?;
            measure(run, &self.last(), blocks, || None::<SavedFit>)?;
        } else {
            let all = (0..self.n_measurements())
                .map(|index| self.measurement(index))
                .chain([self.last()]);
            measure_alone(run, all, self.examples_in_all())?;
        }
        run.record_updates(Phase::Final, self.steps);
        Ok(())
    }
}

impl SupervisedFit {
    /// Everything up to the final measurement; returns the position at which that measurement continues.
    fn fit_and_measure(&self, run: &mut Run<'_>) -> Result<Option<Blocks>, Error> {
        match run.resume()? {
            None => {
                let fit = FitState::start(run)?;
                self.measure_when_due(run, &fit, None)?;
                self.fit(run, fit)?;
            }
            Some(Position {
                learning: Some(saved),
                measuring,
            }) => {
                let fit = FitState::restored(run, saved)?;
                if measuring.is_some() {
                    self.measure_when_due(run, &fit, measuring)?;
                }
                self.fit(run, fit)?;
            }
            Some(Position {
                learning: None,
                measuring,
            }) => return Ok(measuring),
        }
        Ok(None)
    }

    /// Number of measurements before the final one: before the first batch, and after every `evaluate_every`.
    fn n_measurements(&self) -> u64 {
        self.steps
            .checked_div(self.evaluate_every)
            .map_or(0, |count| count + 1)
    }

    /// Number of the examples of all measurements.
    fn examples_in_all(&self) -> u64 {
        self.n_measurements()
            .saturating_mul(self.examples)
            .saturating_add(self.final_examples)
    }

    fn measurement(&self, index: u64) -> Measurement {
        Measurement::while_learning(index, index * self.evaluate_every, self.examples)
    }

    fn last(&self) -> Measurement {
        Measurement::at_the_end(self.steps, self.final_examples, 0)
    }

    fn fit(&self, run: &mut Run<'_>, mut fit: FitState) -> Result<(), Error> {
        while fit.step < self.steps {
            run.checkpoint(|| Position {
                learning: Some(fit.save()),
                measuring: None,
            })?;
            let batch = (0..self.batch)
                .map(|_| fit.draw(run))
                .collect::<Result<Vec<_>, _>>()?;
            run.agent.learn(&batch, &mut fit.learn_rng, &mut run.record)?;
            fit.step += 1;
            (run.progress)(fit.step, self.steps);
            self.measure_when_due(run, &fit, None)?;
        }
        Ok(())
    }

    fn measure_when_due(
        &self,
        run: &mut Run<'_>,
        fit: &FitState,
        blocks: Option<Blocks>,
    ) -> Result<(), Error> {
        if self.evaluate_every == 0 || !fit.step.is_multiple_of(self.evaluate_every) {
            return Ok(());
        }
        if blocks.is_none() {
            run.record.flush_means(fit.step);
            run.record_updates(Phase::Train, fit.step);
        }
        measure(
            run,
            &self.measurement(fit.step / self.evaluate_every),
            blocks,
            || Some(fit.save()),
        )
    }
}

/// State of the fit between two batches.
struct FitState {
    /// Batches so far.
    step: u64,
    environment: Box<dyn Environment>,
    examples_rng: Rng,
    learn_rng: Rng,
}

/// Form of [`FitState`] in a checkpoint.
#[derive(Debug, Serialize, Deserialize)]
struct SavedFit {
    step: u64,
    /// `None` before the first example, when the environment is as it was built.
    environment: Option<Value>,
    examples_rng: Rng,
    learn_rng: Rng,
}

impl FitState {
    fn start(run: &mut Run<'_>) -> Result<Self, Error> {
        let environment = (run.make_environment)()?;
        let (examples_rng, learn_rng) = (run.streams.environment("train", 0), run.streams.agent("learn"));
        Ok(Self {
            step: 0,
            environment,
            examples_rng,
            learn_rng,
        })
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
        let SavedFit {
            step,
            environment,
            examples_rng,
            learn_rng,
        } = saved;
        let environment = match environment {
            Some(snapshot) => restored(run.make_environment, &snapshot)?,
            None => (run.make_environment)()?,
        };
        Ok(Self {
            step,
            environment,
            examples_rng,
            learn_rng,
        })
    }

    /// Draws one example: a start and its target.
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
