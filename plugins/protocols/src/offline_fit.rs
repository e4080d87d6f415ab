//! Protocol `offline_fit`: learn from datasets that other trials gathered, without the simulator; measure like
//! `train_evaluate`.
//!
//! Batches are drawn uniformly and with replacement from all transitions of the datasets, joined in their
//! order. The environment is simulated only where policies are measured; a measurement has the same episodes as
//! under `train_evaluate`.

use contract::{
    Artifact, Config, Error, Feed, Interface, Metric, Phase, Protocol, Registry, Rng,
    agent::Transition,
    artifact,
    dataset::Dataset,
    protocol::{self, Blocks, Measurement, Position, Run, measure, measure_alone},
};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of the `offline_fit` protocol.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OfflineFit {
    /// The datasets, which are joined in this order.
    pub datasets: Vec<Artifact<artifact::Dataset>>,
    /// Batches to learn from. An agent made for datasets makes one update with each batch; one with a replay buffer of
    /// its own takes batches in as experience and updates at the pace of its settings.
    #[schemars(extend("x-unit" = "batches"))]
    pub steps: u64,
    /// Transitions in a batch.
    #[schemars(range(min = 1, max = 65536))]
    pub batch: u64,
    /// Batches between two measurements; 0 measures only at the end.
    #[schemars(extend("x-unit" = "batches"))]
    pub evaluate_every: u64,
    /// Episodes of a measurement during learning.
    pub episodes: u64,
    /// Episodes of the final measurement.
    #[schemars(range(min = 1))]
    pub final_episodes: u64,
    /// Number of final episodes that are recorded step by step, for trajectory figures; above 0, the surface of the
    /// reward is recorded too if the environment has one.
    pub trace_episodes: u64,
    /// False for an agent that does not learn, which is only measured. No study writes this key.
    #[schemars(skip)]
    #[serde(skip_serializing_if = "super::is_true")]
    pub train: bool,
}

impl Default for OfflineFit {
    fn default() -> Self {
        Self {
            datasets: Vec::new(),
            steps: 20_000,
            batch: 256,
            evaluate_every: 1_000,
            episodes: 50,
            final_episodes: 1_000,
            trace_episodes: 1,
            train: true,
        }
    }
}

impl Config for OfflineFit {}

pub(super) fn register(registry: &mut Registry) {
    registry.protocol(
        "offline_fit",
        1,
        "Learn from datasets that other trials gathered, without the simulator; measure whole episodes now \
         and then and at the end.",
        without_training,
        |config| Ok(Box::new(checked(config)?)),
    );
}

/// The protocol for an agent that does not learn: the measurements alone, at the same steps.
fn without_training(config: OfflineFit) -> OfflineFit {
    let alone = OfflineFit {
        datasets: Vec::new(),
        batch: 1,
        train: false,
        ..config
    };
    if alone.n_measurements() > 0 {
        alone
    } else {
        OfflineFit {
            steps: 0,
            evaluate_every: 0,
            episodes: 0,
            ..alone
        }
    }
}

fn checked(config: OfflineFit) -> Result<OfflineFit, Error> {
    if !config.train || config.steps == 0 || !config.datasets.is_empty() {
        return Ok(config);
    }
    let problem = "there is none to learn from; write `datasets: [{ from: NAME }]` with NAME an entry of \
                   `prepare` whose protocol \
                   is `gather`";
    Err(Error::config("datasets", problem))
}

impl Protocol for OfflineFit {
    fn metrics(&self) -> Vec<Metric> {
        protocol::measurement_metrics()
    }

    fn feed(&self) -> Feed {
        Feed::Dataset
    }

    fn accepts(&self, interface: &Interface, _: &[Metric]) -> Result<(), Error> {
        self.read(interface).map(drop)
    }

    fn total_steps(&self) -> u64 {
        if self.train {
            self.steps
        } else {
            self.episodes_in_all()
        }
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
            measure(run, &self.last(), blocks, || None::<FitState>)?;
        } else {
            let all = (0..self.n_measurements())
                .map(|index| self.measurement(index))
                .chain([self.last()]);
            measure_alone(run, all, self.episodes_in_all())?;
        }
        run.record_updates(Phase::Final, self.steps);
        if self.trace_episodes > 0 {
            protocol::record_static_trace(run)
        } else {
            Ok(())
        }
    }
}

impl OfflineFit {
    /// Everything up to the final measurement; returns the position at which that measurement continues.
    fn fit_and_measure(&self, run: &mut Run<'_>) -> Result<Option<Blocks>, Error> {
        match run.resume()? {
            None if self.steps == 0 => {}
            None => {
                let fit = FitState::start(run);
                let transitions = self.transitions(run)?;
                run.agent.observe_dataset(&transitions)?;
                self.measure_when_due(run, &fit, None)?;
                self.fit(run, fit, &transitions)?;
            }
            Some(Position {
                learning: Some(fit),
                measuring,
            }) => {
                let transitions = self.transitions(run)?;
                if measuring.is_some() {
                    self.measure_when_due(run, &fit, measuring)?;
                }
                self.fit(run, fit, &transitions)?;
            }
            Some(Position {
                learning: None,
                measuring,
            }) => return Ok(measuring),
        }
        Ok(None)
    }

    /// The transitions of all datasets.
    fn transitions(&self, run: &Run<'_>) -> Result<Vec<Transition>, Error> {
        let datasets = self.read(&(run.make_environment)()?.interface())?;
        let transitions: Vec<Vec<Transition>> = datasets
            .iter()
            .map(Dataset::transitions)
            .collect::<Result<_, _>>()?;
        let transitions = transitions.concat();
        if transitions.is_empty() {
            return Err(Error::config(
                "datasets",
                "they hold no decision to learn from: nothing was gathered",
            ));
        }
        Ok(transitions)
    }

    /// The datasets, checked against this environment.
    fn read(&self, here: &Interface) -> Result<Vec<Dataset>, Error> {
        let read = |(index, product): (usize, &Artifact<artifact::Dataset>)| {
            Dataset::read_for(product.folder()?, here).map_err(|error| match error {
                Error::OtherInterface { .. } => {
                    let problem = format!("`{}` cannot be learned from here: {error}", product.source());
                    Error::config(format!("datasets.{index}"), problem)
                }
                other => other,
            })
        };
        self.datasets.iter().enumerate().map(read).collect()
    }

    /// Number of measurements before the final one: before the first batch, and after every `evaluate_every`.
    fn n_measurements(&self) -> u64 {
        if self.steps == 0 {
            0
        } else {
            self.steps
                .checked_div(self.evaluate_every)
                .map_or(0, |count| count + 1)
        }
    }

    /// Number of the episodes of all measurements.
    fn episodes_in_all(&self) -> u64 {
        self.n_measurements()
            .saturating_mul(self.episodes)
            .saturating_add(self.final_episodes)
    }

    fn measurement(&self, index: u64) -> Measurement {
        Measurement::while_learning(index, index * self.evaluate_every, self.episodes)
    }

    fn last(&self) -> Measurement {
        Measurement::at_the_end(self.steps, self.final_episodes, self.trace_episodes)
    }

    fn fit(&self, run: &mut Run<'_>, mut fit: FitState, transitions: &[Transition]) -> Result<(), Error> {
        while fit.step < self.steps {
            run.checkpoint(|| Position {
                learning: Some(&fit),
                measuring: None,
            })?;
            let batch = fit.draw(transitions, self.batch);
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
            || Some(fit),
        )
    }
}

/// State of the fit between two batches.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct FitState {
    /// Batches so far.
    step: u64,
    batch_rng: Rng,
    learn_rng: Rng,
}

impl FitState {
    fn start(run: &Run<'_>) -> Self {
        Self {
            step: 0,
            batch_rng: run.streams.agent("batches"),
            learn_rng: run.streams.agent("learn"),
        }
    }

    /// Transitions drawn uniformly with replacement.
    fn draw(&mut self, transitions: &[Transition], count: u64) -> Vec<Transition> {
        (0..count)
            .map(|_| transitions[self.batch_rng.random_range(0..transitions.len())].clone())
            .collect()
    }
}
