//! AutoGAN's search: a recurrent controller draws the options one after the other and is improved by REINFORCE; the
//! design grows cell by cell, each stage on top of the best designs of the one before.
//!
//! Gong, Chang, Jiang and Wang 2019, "AutoGAN: neural architecture search for generative adversarial networks", ICCV,
//! and its released code; Williams 1992 for REINFORCE.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | h, c | state of the controller, an LSTM, that goes from option to option and from cell to cell | `[1, width]` |
//! | a | the option taken of a choice, drawn from the softmax of its outputs | |
//! | R | reward of the design up to this cell, plus `entropy_bonus` times the entropy of its options | |
//! | b | moving mean of R, with `baseline_decay` | |
//!
//! A stage designs one cell. Its designs begin with one of `kept_designs`, drawn uniformly, and are given up after the
//! cell of the stage, so that a stage pays for no cell that it does not design. Every design brings one step of Adam
//! against `-(R - b) ln pi`. At the evaluations in `growth_at`, `derived_designs` are drawn from the
//! controller, the best `kept_designs` of them become the beginnings of the next stage, and a new controller
//! starts. In evaluation the agent takes the most likely options after the best beginning.
//!
//! Departures
//! - The released code shares the weights of all designs within a stage and trains them 15 epochs between 30
//!   steps of the controller. Here the environment trains every design on its own, so that all searches pay
//!   alike.
//! - The released code restarts a stage where the losses of the shared weights collapse; here no weights are
//!   shared.
//!
//! Metrics, means since the last design: `controller_loss`, `controller_entropy` (nats of a cell), `baseline`.

mod controller;
#[cfg(test)]
mod tests;

use crate::shared::{
    checkpoint::{self, finite},
    designs::{EvaluatedDesign, Options, PartialDesign, choices},
};
use contract::{
    Action, Agent, AgentTraits, Choice, Error, Feed, Interface, Metric, Mode, Observation, Preset, Recorder,
    Registry, Rng, Transition, Updates, choice,
};
use controller::Controller;
use numerics::tensor_file::TensorFile;
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::Path;

const NAME: &str = "autogan";

/// Hyper-parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Evaluations after which the design grows by another cell, rising; there is one cell more than entries.
    #[schemars(extend("x-source" = "released code: 15 and 35 of 65 iterations, here of 300 evaluations"))]
    pub growth_at: Vec<u64>,
    /// Number of designs that are drawn from the controller when a stage ends.
    #[schemars(range(min = 1, max = 1000), extend("x-source" = "released code"))]
    pub derived_designs: usize,
    /// Number of these designs with which the next stage begins.
    #[schemars(range(min = 1, max = 1000), extend("x-source" = "released code"))]
    pub kept_designs: usize,
    /// Units of the LSTM and of the embedding of an option.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "released code"))]
    pub width: usize,
    /// Step size of Adam.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "released code"))]
    pub learning_rate: f64,
    /// Reward per nat of entropy.
    #[schemars(range(min = 0.0, max = 1e3), extend("x-source" = "released code"))]
    pub entropy_bonus: f64,
    /// Share of the old baseline that an update keeps.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "released code"))]
    pub baseline_decay: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            growth_at: vec![69, 162],
            derived_designs: 10,
            kept_designs: 5,
            width: 100,
            learning_rate: 3.5e-4,
            entropy_bonus: 1e-3,
            baseline_decay: 0.9,
        }
    }
}

impl contract::Config for Config {
    fn presets() -> Vec<Preset> {
        vec![Preset {
            name: "released_code",
            about: "AutoGAN's released code, its stages as shares of 300 evaluations",
            values: json!({
                "growth_at": [69, 162], "derived_designs": 10, "kept_designs": 5, "width": 100,
                "learning_rate": 3.5e-4, "entropy_bonus": 1e-3, "baseline_decay": 0.9,
            }),
        }]
    }
}

impl Config {
    fn check(&self) -> Result<(), Error> {
        if self.growth_at.windows(2).any(|pair| pair[0] >= pair[1]) {
            let problem = format!(
                "{:?} do not rise; write the evaluations in their order",
                self.growth_at
            );
            return Err(Error::config("growth_at", problem));
        }
        if self.kept_designs > self.derived_designs {
            let problem = format!(
                "{} are kept of {} derived ones; lower it",
                self.kept_designs, self.derived_designs
            );
            return Err(Error::config("kept_designs", problem));
        }
        Ok(())
    }
}

/// Search by a recurrent controller that is trained by REINFORCE.
#[derive(Debug, Clone)]
pub struct AutoGan {
    config: Config,
    choices: Vec<Choice>,
    controller: Controller,
    state: State,
    /// Options so far of the design in evaluation.
    scored: Options,
}

/// State of the search besides the controller.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct State {
    n_evaluations: u64,
    n_updates: u64,
    /// Index of the stage: the number of cells that are already fixed.
    stage: usize,
    /// Beginnings of the designs of this stage; one empty beginning in the first stage.
    beginnings: Vec<Options>,
    /// Designs drawn so far for the next stage; `None` while the controller learns.
    derived: Option<Vec<EvaluatedDesign>>,
    beginning: Options,
    under_way: PartialDesign,
    baseline: Option<f64>,
    gives_up: bool,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "AutoGAN's search: a recurrent controller with REINFORCE, stage by stage on the best designs";
    let metrics = vec![
        Metric::new(
            "controller_loss",
            "",
            "the advantage of a cell times minus its log probability",
        )
        .lower_is_better(),
        Metric::new("controller_entropy", "nat", "entropy of the options of a cell"),
        Metric::new("baseline", "", "moving mean of what designs of the stage earned"),
    ];
    let traits = AgentTraits::learner([Feed::Designs], metrics);
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the agent for one seat that chooses among options.
///
/// # Errors
/// [`Error::Mismatch`] for any other seat, [`Error::Config`] for settings that contradict each other.
fn build(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(AutoGan::new(config, interface, rng)?))
}

impl AutoGan {
    fn new(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        let choices = choices(NAME, interface)?;
        config.check()?;
        let state = State {
            beginnings: vec![Options::new()],
            ..State::default()
        };
        Ok(Self {
            controller: fresh(&config, &choices, rng),
            config,
            choices,
            state,
            scored: Options::new(),
        })
    }

    /// Options of the next step of a design: those of its beginning, then random ones.
    fn decide(&mut self, rng: &mut Rng) -> Vec<usize> {
        let so_far = &self.state.under_way.options;
        let mut draw = |probabilities: &[f32]| drawn(probabilities, rng.random());
        match self.state.beginning.get(so_far.len()) {
            Some(given) => given.clone(),
            None => self.controller.decide(so_far, &mut draw),
        }
    }

    /// Trains the controller on the cell of the stage, whose value is the reward of the design so far.
    fn improve(&mut self, record: &mut Recorder) -> Result<(), Error> {
        let PartialDesign { options, earned } = &self.state.under_way;
        let (log_probability, entropy) = self.controller.judge(options);
        let reward = earned + self.config.entropy_bonus * entropy;
        let decay = self.config.baseline_decay;
        let baseline = self
            .state
            .baseline
            .map_or(reward, |before| decay * before + (1.0 - decay) * reward);
        let weight = baseline - reward;
        let loss = finite(
            "controller_loss",
            self.state.n_evaluations,
            log_probability * weight,
        )?;
        record.mean("controller_loss", loss);
        record.mean("controller_entropy", entropy);
        record.mean("baseline", baseline);
        self.controller.descend(options, weight);
        self.state.baseline = Some(baseline);
        self.state.n_updates += 1;
        Ok(())
    }

    /// Ends a design after the cell of its stage: keeps it for the next stage, or draws another beginning.
    fn end_of_stage_design(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        match &mut self.state.derived {
            None => self.improve(record)?,
            Some(derived) => {
                let PartialDesign { options, earned } = self.state.under_way.clone();
                derived.push(EvaluatedDesign {
                    options,
                    value: earned,
                });
            }
        }
        self.state.under_way = PartialDesign::default();
        let growth = self.config.growth_at.get(self.state.stage).copied();
        let due = growth.is_some_and(|at| self.state.n_evaluations >= at);
        if due && self.state.derived.is_none() {
            self.state.derived = Some(Vec::new());
        }
        let full = |derived: &Vec<EvaluatedDesign>| derived.len() >= self.config.derived_designs;
        if self.state.derived.as_ref().is_some_and(full) {
            self.grow(rng);
        }
        Ok(())
    }

    /// Starts the next stage from the best different designs.
    fn grow(&mut self, rng: &mut Rng) {
        let mut derived = self.state.derived.take().unwrap_or_default();
        derived.sort_by(|one, other| other.value.total_cmp(&one.value));
        let mut kept: Vec<Options> = Vec::new();
        for tried in derived {
            if kept.len() < self.config.kept_designs && !kept.contains(&tried.options) {
                kept.push(tried.options);
            }
        }
        self.state.beginnings = kept;
        self.state.stage += 1;
        self.state.baseline = None;
        self.controller = fresh(&self.config, &self.choices, rng);
    }
}

fn fresh(config: &Config, choices: &[Choice], rng: &mut Rng) -> Controller {
    let sizes: Vec<usize> = choices.iter().map(|choice| choice.options.len()).collect();
    Controller::new(&sizes, config.width, config.learning_rate, rng)
}

/// Option at which the cumulative probability passes `uniform`, a number in 0..1.
fn drawn(probabilities: &[f32], uniform: f64) -> usize {
    let mut left = uniform;
    let passed = |share: &f32| {
        left -= f64::from(*share);
        left < 0.0
    };
    probabilities
        .iter()
        .position(passed)
        .unwrap_or(probabilities.len() - 1)
}

fn most_likely(probabilities: &[f32]) -> usize {
    let better = |best: usize, at: usize| {
        if probabilities[at] > probabilities[best] {
            at
        } else {
            best
        }
    };
    (0..probabilities.len()).fold(0, better)
}

impl Agent for AutoGan {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let mut row = |_| {
            let taken = match mode {
                Mode::Train => {
                    if self.state.under_way.options.is_empty() {
                        #[allow(clippy::cast_possible_truncation, reason = "a few designs are kept")]
                        let at = rng.random_range(0..self.state.beginnings.len() as u32) as usize;
                        self.state.beginning = self.state.beginnings[at].clone();
                    }
                    self.decide(rng)
                }
                Mode::Evaluate => {
                    let given = self.state.beginnings[0].get(self.scored.len()).cloned();
                    let (controller, scored) = (&mut self.controller, &self.scored);
                    let taken = given.unwrap_or_else(|| controller.decide(scored, &mut most_likely));
                    self.scored.push(taken.clone());
                    taken
                }
            };
            vec![choice::vector(&self.choices, &taken)]
        };
        Ok(observations.iter().map(&mut row).collect())
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        for transition in transitions {
            self.state.n_evaluations += 1;
            self.state
                .under_way
                .options
                .push(choice::taken(&self.choices, &transition.action[0])?);
            self.state.under_way.earned += transition.rewards[0];
            let cell_of_stage = self.state.under_way.options.len() > self.state.stage;
            // In the last stage a design goes on to its end; the controller decides all remaining cells.
            let grows = self.state.stage < self.config.growth_at.len();
            let ended = transition.end.is_some();
            self.state.gives_up = grows && cell_of_stage && !ended;
            if ended || self.state.gives_up {
                self.end_of_stage_design(rng, record)?;
            }
        }
        Ok(())
    }

    /// The update by a design of one step, as those of the first stage are.
    fn plan(&mut self, _: usize) -> Option<String> {
        Some(self.controller.plan(1))
    }

    fn updates(&self) -> Option<Updates> {
        Some(Updates {
            made: self.state.n_updates,
            first_after: 1,
        })
    }

    fn remembers(&self) -> bool {
        true
    }

    fn restart(&mut self) {
        self.scored.clear();
    }

    fn truncates(&mut self) -> bool {
        self.state.gives_up
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        let mut file = TensorFile::default();
        self.controller.store(&mut file);
        checkpoint::write(NAME, dir, file, &self.state)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        let (file, state) = checkpoint::read(NAME, dir)?;
        self.controller
            .restore(&file)
            .map_err(checkpoint::error_of(NAME))?;
        self.state = state;
        Ok(())
    }
}
