//! What a protocol is: how one trial runs; and the protocols that fit any environment.

mod estimator_tracking;
mod evaluation;
mod supervised_fit;
mod train_evaluate;

use crate::{Agent, Environment, Error, Metric, Recorder, Registry, random::Streams};

pub use estimator_tracking::EstimatorTracking;
pub use supervised_fit::SupervisedFit;
pub use train_evaluate::TrainEvaluate;

/// Registers the protocols of the engine.
pub fn register(registry: &mut Registry) {
    train_evaluate::register(registry);
    supervised_fit::register(registry);
    estimator_tracking::register(registry);
}

/// What a protocol works with. Everything in it belongs to one trial.
pub struct Run<'a> {
    /// Makes one more copy of the trial's environment.
    pub make_environment: &'a dyn Fn() -> Result<Box<dyn Environment>, Error>,
    /// The trial's agent, freshly initialised.
    pub agent: Box<dyn Agent>,
    /// The trial's random streams.
    pub streams: Streams,
    /// Where numbers go.
    pub record: Recorder,
    /// Told how far the trial is: steps done, steps in all.
    pub progress: &'a mut dyn FnMut(u64, u64),
}

/// How one trial runs, from the first step to the final measurement.
pub trait Protocol: Send + Sync {
    /// What it records besides the environment's and the agent's metrics.
    fn metrics(&self) -> Vec<Metric>;

    /// True where the environment's metrics are recorded per episode under their names.
    fn records_environment_metrics(&self) -> bool {
        true
    }

    /// Steps in all, for progress and cost estimates.
    fn total_steps(&self) -> u64;

    /// Runs the trial.
    ///
    /// # Errors
    /// Whatever the environment or the agent reports, and [`Error::NotFinite`] for a measurement that is no number.
    fn run(&self, run: &mut Run<'_>) -> Result<(), Error>;
}
