//! Protocol `train_evaluate`: learn for a number of environment steps, measuring now and then and thoroughly at the end.

use super::{
    Protocol, Run,
    evaluation::{self, Measurement, measure, observe},
};
use crate::{Config, Environment, Error, Metric, Mode, Observation, Phase, Registry, Rng, agent::Transition};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How long to learn and how much to measure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TrainEvaluate {
    /// Environment steps to learn from, all environments together.
    #[schemars(extend("x-unit" = "steps"))]
    pub steps: u64,
    /// Environments stepped together while learning.
    #[schemars(range(min = 1, max = 4096))]
    pub environments: u64,
    /// Steps between two measurements during learning; 0 measures only at the end.
    #[schemars(extend("x-unit" = "steps"))]
    pub evaluate_every: u64,
    /// Episodes of a measurement during learning.
    pub episodes: u64,
    /// Episodes of the final measurement.
    #[schemars(range(min = 1))]
    pub final_episodes: u64,
    /// How many of the final episodes are recorded step by step, for trajectory figures.
    pub trace_episodes: u64,
}

impl Default for TrainEvaluate {
    fn default() -> Self {
        Self { steps: 60_000, environments: 64, evaluate_every: 5_000, episodes: 50, final_episodes: 1_000, trace_episodes: 1 }
    }
}

impl Config for TrainEvaluate {}

/// Registers the protocol.
pub(super) fn register(registry: &mut Registry) {
    registry.protocol(
        "train_evaluate",
        1,
        "Learn for a number of environment steps; measure whole episodes during learning and at the end.",
        |config: TrainEvaluate| TrainEvaluate { steps: 0, environments: 1, evaluate_every: 0, episodes: 0, ..config },
        |config| Ok(Box::new(config)),
    );
}

impl Protocol for TrainEvaluate {
    fn metrics(&self) -> Vec<Metric> {
        let mut metrics = evaluation::metrics();
        metrics.push(Metric::new(
            "training_return",
            "",
            "mean return, over all seats, of the episodes that ended while learning",
        ));
        metrics
    }

    fn total_steps(&self) -> u64 {
        self.steps
    }

    fn run(&self, run: &mut Run<'_>) -> Result<(), Error> {
        self.learn(run)?;
        (run.progress)(self.steps, self.steps);
        let what =
            Measurement { phase: Phase::Final, step: self.steps, episodes: self.final_episodes, traced: self.trace_episodes };
        measure(run, &what)
    }
}

/// One of the environments that learning steps together.
struct Slot {
    environment: Box<dyn Environment>,
    rng: Rng,
    observation: Observation,
    episode_return: f64,
}

impl TrainEvaluate {
    fn learn(&self, run: &mut Run<'_>) -> Result<(), Error> {
        if self.steps == 0 {
            return Ok(());
        }
        let mut slots = (0..self.environments).map(|index| open(run, index)).collect::<Result<Vec<_>, _>>()?;
        let (mut act_rng, mut learn_rng) = (run.streams.agent("act"), run.streams.agent("learn"));
        let mut step = 0;
        self.measure_when_due(run, step, 0)?;
        while step < self.steps {
            let before = step;
            let transitions = act_in_all(run, &mut slots, &mut act_rng)?;
            step += transitions.len() as u64;
            run.agent.learn(&transitions, &mut learn_rng, &mut run.record)?;
            (run.progress)(step.min(self.steps), self.steps);
            self.measure_when_due(run, step, before)?;
        }
        Ok(())
    }

    /// Measures where a multiple of `evaluate_every` was passed since `before` (and before the first step).
    fn measure_when_due(&self, run: &mut Run<'_>, step: u64, before: u64) -> Result<(), Error> {
        let due = self.evaluate_every > 0 && (step == 0 || step / self.evaluate_every > before / self.evaluate_every);
        if !due {
            return Ok(());
        }
        // The nominal step, so that curves of different seeds and environment counts share their points.
        let nominal = step / self.evaluate_every * self.evaluate_every;
        run.record.flush_means(nominal);
        measure(run, &Measurement { phase: Phase::Evaluate, step: nominal, episodes: self.episodes, traced: 0 })
    }
}

fn open(run: &mut Run<'_>, index: u64) -> Result<Slot, Error> {
    let mut environment = (run.make_environment)()?;
    let mut rng = run.streams.environment("train", index);
    let seats = environment.reset(&mut rng)?;
    let observation = observe(&*run.agent, &*environment, seats);
    Ok(Slot { environment, rng, observation, episode_return: 0.0 })
}

/// Steps every environment once with the agent's training actions; starts ended episodes anew.
fn act_in_all(run: &mut Run<'_>, slots: &mut [Slot], rng: &mut Rng) -> Result<Vec<Transition>, Error> {
    let observations: Vec<Observation> = slots.iter().map(|slot| slot.observation.clone()).collect();
    let actions = run.agent.act(&observations, Mode::Train, rng)?;
    let mut transitions = Vec::with_capacity(slots.len());
    for ((slot, action), observation) in slots.iter_mut().zip(actions).zip(observations) {
        let step = slot.environment.step(&action, &mut slot.rng)?;
        let next_observation = observe(&*run.agent, &*slot.environment, step.observations);
        slot.episode_return += step.rewards.iter().sum::<f64>();
        if step.end.is_some() {
            run.record.mean("training_return", std::mem::take(&mut slot.episode_return));
            let seats = slot.environment.reset(&mut slot.rng)?;
            slot.observation = observe(&*run.agent, &*slot.environment, seats);
        } else {
            slot.observation = next_observation.clone();
        }
        transitions.push(Transition { observation, action, rewards: step.rewards, next_observation, end: step.end });
    }
    Ok(transitions)
}
