//! Protocol `train_evaluate`: learn for a number of environment steps, with short measurements on the way and a
//! longer one at the end.

use super::own_training;
use contract::{
    Artifact, ArtifactKind, Checkpoint, Config, Environment, Error, Metric, Mode, Observation, Phase,
    Protocol, Registry, Rng,
    agent::Transition,
    exact,
    own_training::Measured,
    part::Part,
    protocol::{self, Blocks, Measurement, Position, Run, measure, measure_alone, observe, restored},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// Settings of the `train_evaluate` protocol.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TrainEvaluate {
    /// Environment steps to learn from, all environments together.
    #[schemars(extend("x-unit" = "steps"))]
    pub steps: u64,
    /// Number of environments that are stepped together during learning.
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
    /// Number of final episodes that are recorded step by step, for trajectory figures; above 0, the surface of the
    /// reward is recorded too if the environment has one.
    pub trace_episodes: u64,
    /// The trial whose learning continues here, up to `steps`, with the config that the agent has here; it left a
    /// checkpoint. Learning starts from the beginning where absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub go_on_from: Option<Artifact<Checkpoint>>,
    /// Whether learning can continue in another trial. The trial's folder then holds the checkpoint, with
    /// experience and environments.
    #[serde(skip_serializing_if = "super::is_false")]
    pub leave_checkpoint: bool,
    /// False for an agent that does not learn, which is only measured. No study writes this key.
    #[schemars(skip)]
    #[serde(skip_serializing_if = "super::is_true")]
    pub train: bool,
}

impl Default for TrainEvaluate {
    fn default() -> Self {
        Self {
            steps: 60_000,
            environments: 64,
            evaluate_every: 5_000,
            episodes: 50,
            final_episodes: 1_000,
            trace_episodes: 1,
            go_on_from: None,
            leave_checkpoint: false,
            train: true,
        }
    }
}

impl Config for TrainEvaluate {}

const NAME: &str = "train_evaluate";
const VERSION: u32 = 2;

/// The final measurement alone, as part of a trial's key.
fn measuring(episodes: u64) -> Part {
    let alone = without_training(TrainEvaluate {
        steps: 0,
        final_episodes: episodes,
        trace_episodes: 0,
        ..TrainEvaluate::default()
    });
    Part::new(NAME, VERSION, json!(alone))
}

pub(super) fn register(registry: &mut Registry) {
    registry.protocol(
        NAME,
        VERSION,
        "Learn for a number of environment steps; measure whole episodes during learning and at the end.",
        without_training,
        |config| Ok(Box::new(config)),
    );
    registry.lets_train(NAME, for_own_training);
    registry.measuring = Some(measuring);
}

/// The protocol for an agent that trains itself: the length, the steps between its measurements, and the
/// measurements that the engine makes.
fn for_own_training(config: TrainEvaluate, measured: Option<Measured>) -> TrainEvaluate {
    let of_final = |given: u64, none: u64| if measured.is_some() { given } else { none };
    TrainEvaluate {
        steps: config.steps,
        environments: 1,
        evaluate_every: config.evaluate_every,
        episodes: if measured == Some(Measured::Calls) {
            config.episodes
        } else {
            0
        },
        final_episodes: of_final(config.final_episodes, 1),
        trace_episodes: of_final(config.trace_episodes, 0),
        go_on_from: None,
        leave_checkpoint: false,
        train: true,
    }
}

/// The protocol for an agent that does not learn: the measurements alone, at the same steps.
fn without_training(config: TrainEvaluate) -> TrainEvaluate {
    let environments = if config.is_measured_as_with_one_environment() {
        1
    } else {
        config.environments
    };
    let alone = TrainEvaluate {
        environments,
        go_on_from: None,
        leave_checkpoint: false,
        train: false,
        ..config
    };
    if alone.n_measurements() > 0 {
        alone
    } else {
        TrainEvaluate {
            steps: 0,
            environments: 1,
            evaluate_every: 0,
            episodes: 0,
            ..alone
        }
    }
}

impl Protocol for TrainEvaluate {
    fn metrics(&self) -> Vec<Metric> {
        let mut metrics = protocol::measurement_metrics();
        metrics.push(Metric::new(
            "training_return",
            "",
            "mean return, over all seats, of the episodes that ended while learning",
        ));
        metrics
    }

    fn doubt(&self) -> Option<Error> {
        let last = self.steps_taken().checked_div(self.evaluate_every)? * self.evaluate_every;
        let problem = format!(
            "{} does not divide {} steps, so the learning curve ends at step {last}",
            self.evaluate_every, self.steps
        );
        (self.train && last < self.steps).then(|| Error::config("evaluate_every", problem))
    }

    fn leaves(&self) -> Vec<ArtifactKind> {
        let kinds = self.leave_checkpoint.then_some(ArtifactKind::Checkpoint);
        kinds.into_iter().collect()
    }

    fn total_steps(&self) -> u64 {
        if self.train {
            self.steps
        } else {
            self.episodes_in_all()
        }
    }

    fn measures_at(&self, step: u64) -> bool {
        let every = self.evaluate_every;
        every > 0 && step > 0 && step < self.steps && step.is_multiple_of(every) && self.stride() == every
    }

    fn experience(&self) -> u64 {
        if self.train { self.steps_taken() } else { 0 }
    }

    fn run(&self, run: &mut Run<'_>) -> Result<(), Error> {
        if run.agent.own_training().is_some() {
            return own_training::run(self, run);
        }
        if self.train {
            let (learned, blocks) = self.learn_and_measure(run)?;
            (run.progress)(self.steps, self.steps);
            measure(run, &self.last(), blocks, || learned.as_ref())?;
            if let Some(learned) = learned {
                protocol::leave_checkpoint(run, &learned)?;
            }
        } else {
            let all = (0..self.n_measurements())
                .map(|place| self.measurement(place * self.stride()))
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

impl TrainEvaluate {
    /// Everything up to the final measurement; returns the state of learning, if it is to be left for other trials, and
    /// the position at which the final measurement continues.
    fn learn_and_measure(&self, run: &mut Run<'_>) -> Result<(Option<SavedLearning>, Option<Blocks>), Error> {
        let learning = match run.resume()? {
            None if self.steps == 0 => return Ok((None, None)),
            None => self.begin(run)?,
            Some(Position {
                learning: Some(saved @ SavedLearning { is_over: true, .. }),
                measuring,
            }) => return Ok((Some(saved), measuring)),
            Some(Position {
                learning: Some(saved),
                measuring,
            }) => {
                let learning = LearningState::restored(run, saved)?;
                if measuring.is_some() {
                    self.measure_when_due(run, &learning, measuring)?;
                }
                learning
            }
            Some(Position {
                learning: None,
                measuring,
            }) => return Ok((None, measuring)),
        };
        let learned = self.learn(run, learning)?;
        let kept = self.leave_checkpoint.then(|| SavedLearning {
            is_over: true,
            ..learned.save()
        });
        Ok((kept, None))
    }

    /// The state of learning at its first step, or the one that another trial left.
    fn begin(&self, run: &mut Run<'_>) -> Result<LearningState, Error> {
        let Some(product) = &self.go_on_from else {
            let learning = LearningState::start(run, self.environments)?;
            self.measure_when_due(run, &learning, None)?;
            return Ok(learning);
        };
        let saved: SavedLearning = protocol::take_up_checkpoint(run, product)?;
        let count = saved.slots.len() as u64;
        let problem = if count != self.environments {
            format!(
                "{count} environments learned together, and here {} do",
                self.environments
            )
        } else if saved.step >= self.steps {
            format!(
                "it stands at step {}, and learning ends at step {} here",
                saved.step, self.steps
            )
        } else {
            return LearningState::restored(run, saved)
                .map_err(|error| protocol::checkpoint_misfit(product, &error));
        };
        Err(protocol::checkpoint_misfit(product, &problem))
    }

    /// Environment steps that learning takes, a multiple of the number of environments.
    fn steps_taken(&self) -> u64 {
        self.steps
            .div_ceil(self.environments)
            .saturating_mul(self.environments)
    }

    /// Steps between two measurements. Several multiples of `evaluate_every` that are passed at once are one
    /// measurement.
    fn stride(&self) -> u64 {
        self.evaluate_every.max(self.environments)
    }

    /// Number of measurements before the final one, the first of them before the first step.
    fn n_measurements(&self) -> u64 {
        if self.steps == 0 || self.evaluate_every == 0 {
            0
        } else {
            self.steps_taken() / self.stride() + 1
        }
    }

    /// Number of the episodes of all measurements.
    fn episodes_in_all(&self) -> u64 {
        self.n_measurements()
            .saturating_mul(self.episodes)
            .saturating_add(self.final_episodes)
    }

    /// Whether measurements fall on the same steps as if environments were stepped one by one.
    fn is_measured_as_with_one_environment(&self) -> bool {
        let last = |steps: u64| steps.checked_div(self.evaluate_every);
        self.stride() == self.evaluate_every && last(self.steps_taken()) == last(self.steps)
    }

    /// The measurement that is due when `step` is reached.
    pub(super) fn measurement(&self, step: u64) -> Measurement {
        let index = step / self.evaluate_every;
        // The nominal step, so that curves of different seeds and environment counts share their points.
        Measurement::while_learning(index, index * self.evaluate_every, self.episodes)
    }

    pub(super) fn last(&self) -> Measurement {
        Measurement::at_the_end(self.steps, self.final_episodes, self.trace_episodes)
    }

    fn learn(&self, run: &mut Run<'_>, mut learning: LearningState) -> Result<LearningState, Error> {
        while learning.step < self.steps {
            run.checkpoint(|| Position {
                learning: Some(learning.save()),
                measuring: None,
            })?;
            learning.advance(run)?;
            (run.progress)(learning.step.min(self.steps), self.steps);
            self.measure_when_due(run, &learning, None)?;
        }
        Ok(learning)
    }

    /// Measures if the last step passed a multiple of `evaluate_every`, and before the first step.
    fn measure_when_due(
        &self,
        run: &mut Run<'_>,
        learning: &LearningState,
        blocks: Option<Blocks>,
    ) -> Result<(), Error> {
        let LearningState { step, before, .. } = *learning;
        let due = self.evaluate_every > 0
            && (step == 0 || step / self.evaluate_every > before / self.evaluate_every);
        if !due {
            return Ok(());
        }
        let what = self.measurement(step);
        if blocks.is_none() {
            run.record.flush_means(what.step);
            run.record_updates(Phase::Train, what.step);
        }
        measure(run, &what, blocks, || Some(learning.save()))
    }
}

/// State of learning between two steps.
struct LearningState {
    /// Environment steps so far, all environments together.
    step: u64,
    /// Environment steps before the last step.
    before: u64,
    slots: Vec<LearningSlot>,
    act_rng: Rng,
    learn_rng: Rng,
}

/// One of the environments that are stepped together during learning.
struct LearningSlot {
    environment: Box<dyn Environment>,
    rng: Rng,
    observation: Observation,
    episode_return: f64,
}

/// Form of [`LearningState`] in a checkpoint.
#[derive(Debug, Serialize, Deserialize)]
struct SavedLearning {
    /// Whether learning is over here and can only continue in another trial.
    #[serde(default)]
    is_over: bool,
    step: u64,
    before: u64,
    slots: Vec<SavedSlot>,
    act_rng: Rng,
    learn_rng: Rng,
}

#[derive(Debug, Serialize, Deserialize)]
struct SavedSlot {
    environment: Value,
    rng: Rng,
    #[serde(with = "exact")]
    seats: Vec<Vec<f64>>,
    #[serde(with = "exact")]
    state: Vec<f64>,
    #[serde(with = "exact")]
    episode_return: f64,
}

impl LearningState {
    fn start(run: &mut Run<'_>, environments: u64) -> Result<Self, Error> {
        let slots = (0..environments)
            .map(|index| LearningSlot::open(run, index))
            .collect::<Result<Vec<_>, _>>()?;
        let (act_rng, learn_rng) = (run.streams.agent("act"), run.streams.agent("learn"));
        Ok(Self {
            step: 0,
            before: 0,
            slots,
            act_rng,
            learn_rng,
        })
    }

    fn save(&self) -> SavedLearning {
        SavedLearning {
            is_over: false,
            step: self.step,
            before: self.before,
            slots: self.slots.iter().map(LearningSlot::save).collect(),
            act_rng: self.act_rng.clone(),
            learn_rng: self.learn_rng.clone(),
        }
    }

    fn restored(run: &mut Run<'_>, saved: SavedLearning) -> Result<Self, Error> {
        let SavedLearning {
            step,
            before,
            slots,
            act_rng,
            learn_rng,
            ..
        } = saved;
        let slots = slots
            .into_iter()
            .map(|slot| LearningSlot::restored(run, slot))
            .collect::<Result<Vec<_>, _>>()?;
        Ok(Self {
            step,
            before,
            slots,
            act_rng,
            learn_rng,
        })
    }

    /// Steps every environment once and lets the agent learn from it.
    fn advance(&mut self, run: &mut Run<'_>) -> Result<(), Error> {
        let transitions = act_in_all(run, &mut self.slots, &mut self.act_rng)?;
        self.before = self.step;
        self.step += transitions.len() as u64;
        run.agent
            .learn(&transitions, &mut self.learn_rng, &mut run.record)
    }
}

impl LearningSlot {
    fn open(run: &mut Run<'_>, index: u64) -> Result<Self, Error> {
        let mut environment = (run.make_environment)()?;
        let mut rng = run.streams.environment("train", index);
        let seats = environment.reset(&mut rng)?;
        let observation = observe(&*run.agent, &*environment, seats);
        Ok(Self {
            environment,
            rng,
            observation,
            episode_return: 0.0,
        })
    }

    fn save(&self) -> SavedSlot {
        SavedSlot {
            environment: self.environment.snapshot(),
            rng: self.rng.clone(),
            seats: self.observation.seats.clone(),
            state: self.observation.state.clone(),
            episode_return: self.episode_return,
        }
    }

    fn restored(run: &Run<'_>, saved: SavedSlot) -> Result<Self, Error> {
        let SavedSlot {
            environment,
            rng,
            seats,
            state,
            episode_return,
        } = saved;
        let environment = restored(run.make_environment, &environment)?;
        Ok(Self {
            environment,
            rng,
            observation: Observation { seats, state },
            episode_return,
        })
    }
}

/// Steps every environment once with the agent's training actions; begins a new episode if one ended.
fn act_in_all(
    run: &mut Run<'_>,
    slots: &mut [LearningSlot],
    rng: &mut Rng,
) -> Result<Vec<Transition>, Error> {
    let observations: Vec<Observation> = slots.iter().map(|slot| slot.observation.clone()).collect();
    let actions = run.agent.act(&observations, Mode::Train, rng)?;
    let mut transitions = Vec::with_capacity(slots.len());
    for (slot, action) in slots.iter_mut().zip(&actions) {
        slot.environment.begin_step(action)?;
    }
    for ((slot, action), observation) in slots.iter_mut().zip(actions).zip(observations) {
        let step = slot.environment.step(&action, &mut slot.rng)?;
        let next_observation = observe(&*run.agent, &*slot.environment, step.observations);
        slot.episode_return += step.rewards.iter().sum::<f64>();
        if step.end.is_some() {
            run.record
                .mean("training_return", std::mem::take(&mut slot.episode_return));
            let seats = slot.environment.reset(&mut slot.rng)?;
            slot.observation = observe(&*run.agent, &*slot.environment, seats);
        } else {
            slot.observation = next_observation.clone();
        }
        transitions.push(Transition {
            observation,
            action,
            rewards: step.rewards,
            next_observation,
            end: step.end,
        });
    }
    Ok(transitions)
}
