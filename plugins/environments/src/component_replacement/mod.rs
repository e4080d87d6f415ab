//! Replacements and inspections of five different components, of which at least k must work.
//!
//! The system "hard-k-of-5" of imprl (P. Bhattacharjee and others, github.com/omniscientoctopus/imprl). A
//! component has one of four damage states, 0 (new) to 3 (failed), which is hidden unless it has failed
//! ([`components`]); a seat is a component.
//!
//! | symbol | here | shape, range |
//! |---|---|---|
//! | s_i | `damage`, state of component i | 0 to 3 |
//! | b_i(s) | `belief_0` .. `belief_3` of component i | `[4]`, sums to 1 |
//! | o_i | `reading` of component i after a step | 0 to 3 |
//! | t / T | `time`, the elapsed fraction of the episode | in [0, 1] |
//! | gamma | `discount` | |
//!
//! A step: every seat earns `-gamma^t (c + 2400 [fewer than k work])`, with the costs c of the replacements and
//! inspections and the states before the step, also of components that are replaced in it. Then states change
//! by the action (a replacement may fail), readings are drawn from the new states, and beliefs follow: `b'(s')
//! = P(o given s', a) sum_s P(s' given s, a) b(s)`, normalised.
//!
//! All seats observe the time and the beliefs of all components. The full state has the step, the damage and
//! the readings.
//!
//! `unread_inspections` adds two choices, `inspect_unread` and `replace_and_inspect_unread`: the inspection is
//! paid but its result is not read. The published baseline with periodic inspections does this: it charges
//! inspections which it never sends to the system.
//!
//! Metrics, sums over an episode, discounted: `cost` and its parts `replacement_cost`, `inspection_cost` and
//! `failure_cost`; and `least_cost`, a lower bound on the expected cost of every policy ([`bound`]).

pub mod bound;
pub mod components;

use crate::choices;
use arithmetic::power::powi;
use bound::{Problem, least_cost};
use components::{Component, FAILED, N_COMPONENTS, N_STATES, worn};
use contract::{Channel, End, Environment, Error, Metric, PerEpisode, Rng, Seat, Space, Step};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    sync::{Mutex, PoisonError},
};

/// Settings of the `component_replacement` environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ComponentReplacementConfig {
    /// Number k of the five components that must work; a step with fewer costs `failure_cost`.
    #[schemars(range(min = 1, max = 5), extend("x-source" = "imprl, hard-k-of-5"))]
    pub required: usize,
    /// Steps of an episode.
    #[schemars(range(min = 1, max = 1000), extend("x-source" = "imprl, hard-k-of-5"))]
    pub horizon: usize,
    /// Discount factor of costs per step; it is part of the reward, so that returns are plain sums.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "imprl, hard-k-of-5"))]
    pub discount: f64,
    /// Cost of a step in which fewer than `required` components work.
    #[schemars(range(min = 0.0, max = 1e6), extend("x-source" = "imprl: three times the cost of all replacements"))]
    pub failure_cost: f64,
    /// Factor of the published probabilities that a component leaves a state within a step; beliefs use the
    /// same factor. For environments that differ from the one in which a policy was learned.
    #[schemars(range(min = 0.0, max = 3.0), extend("x-source" = "own choice"))]
    #[serde(skip_serializing_if = "is_published")]
    pub wear: f64,
    /// Whether seats have two more choices: inspections that are paid and not read, as in the published
    /// baseline.
    pub unread_inspections: bool,
}

impl Default for ComponentReplacementConfig {
    fn default() -> Self {
        Self {
            required: 4,
            horizon: 50,
            discount: 0.99,
            failure_cost: 2400.0,
            wear: 1.0,
            unread_inspections: false,
        }
    }
}

impl contract::Config for ComponentReplacementConfig {}

/// For serde: the wear is written only where it is not the published one.
#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_published(wear: &f64) -> bool {
    wear.to_bits() == 1.0_f64.to_bits()
}

impl ComponentReplacementConfig {
    fn check(&self) -> Result<(), Error> {
        for (key, value, most) in [
            ("required", self.required, N_COMPONENTS),
            ("horizon", self.horizon, 1000),
        ] {
            if !(1..=most).contains(&value) {
                return Err(Error::config(key, format!("{value} is not in 1 to {most}")));
            }
        }
        for (key, value, most) in [
            ("discount", self.discount, 1.0),
            ("failure_cost", self.failure_cost, 1e6),
            ("wear", self.wear, 3.0),
        ] {
            if !(0.0..=most).contains(&value) {
                return Err(Error::config(key, format!("{value} is not in 0 to {most}")));
            }
        }
        Ok(())
    }

    fn problem(&self) -> Problem {
        Problem {
            required: self.required,
            horizon: self.horizon,
            discount: self.discount,
            failure_cost: self.failure_cost,
            wear: self.wear,
        }
    }
}

/// Maintenance of a component in a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Treatment {
    /// The name of the choice.
    pub name: &'static str,
    /// Whether the component is replaced.
    pub replaces: bool,
    /// Whether an inspection is paid.
    pub inspects: bool,
    /// Whether the result of the inspection is read.
    pub reads: bool,
}

const fn treatment(name: &'static str, replaces: bool, inspects: bool, reads: bool) -> Treatment {
    Treatment {
        name,
        replaces,
        inspects,
        reads,
    }
}

/// All treatments in the order of the choices; the last two exist only with `unread_inspections`.
pub const TREATMENTS: [Treatment; 5] = [
    treatment("nothing", false, false, false),
    treatment("replace", true, false, false),
    treatment("inspect", false, true, true),
    treatment("inspect_unread", false, true, false),
    treatment("replace_and_inspect_unread", true, true, false),
];

/// The `component_replacement` environment.
#[derive(Debug)]
pub struct ComponentReplacement {
    config: ComponentReplacementConfig,
    components: [Component; N_COMPONENTS],
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    progress: Progress,
    /// Computed at the first start.
    least_cost: Option<f64>,
}

/// State of an episode.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Progress {
    step: usize,
    damage: [usize; N_COMPONENTS],
    readings: [usize; N_COMPONENTS],
    beliefs: [[f64; N_STATES]; N_COMPONENTS],
}

impl Progress {
    fn new() -> Self {
        Self {
            step: 0,
            damage: [0; N_COMPONENTS],
            readings: [0; N_COMPONENTS],
            beliefs: [[1.0, 0.0, 0.0, 0.0]; N_COMPONENTS],
        }
    }

    /// Updates a component and its belief with its new state and reading.
    fn follow(
        &mut self,
        component: usize,
        of: &Component,
        treatment: Treatment,
        next: usize,
        reading: usize,
    ) {
        let (moves, reads) = (of.transition(treatment.replaces), of.readings(treatment.reads));
        let belief = self.beliefs[component];
        let predicted = |to: usize| {
            (0..N_STATES)
                .map(|from| belief[from] * moves[from][to])
                .sum::<f64>()
        };
        let joint: [f64; N_STATES] = std::array::from_fn(|to| reads[to][reading] * predicted(to));
        let evidence: f64 = joint.iter().sum();
        self.beliefs[component] = joint.map(|p| p / evidence);
        (self.damage[component], self.readings[component]) = (next, reading);
    }

    fn working(&self) -> usize {
        self.damage.iter().filter(|damage| **damage != FAILED).count()
    }
}

/// Builds the environment; registered as `component_replacement`.
///
/// # Errors
/// [`Error::Config`] for a number outside its range.
pub fn build(config: ComponentReplacementConfig) -> Result<Box<dyn Environment>, Error> {
    Ok(Box::new(ComponentReplacement::new(config)?))
}

/// The bound, computed once for each config within a process.
fn known_least_cost(config: &ComponentReplacementConfig) -> f64 {
    static KNOWN: Mutex<BTreeMap<String, f64>> = Mutex::new(BTreeMap::new());
    let problem = config.problem();
    // A panic while the lock was held has left the map unchanged.
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    *known
        .entry(format!("{problem:?}"))
        .or_insert_with(|| least_cost(&problem))
}

impl ComponentReplacement {
    fn new(config: ComponentReplacementConfig) -> Result<Self, Error> {
        config.check()?;
        Ok(Self {
            seats: seats(&config),
            metrics: metrics(),
            components: worn(config.wear),
            progress: Progress::new(),
            least_cost: None,
            config,
        })
    }

    /// Costs of the step, undiscounted: replacements, inspections, failure.
    fn costs(&self, treatments: &[Treatment]) -> [f64; 3] {
        let sum = |is_meant: fn(&Treatment) -> bool, cost: fn(&Component) -> f64| {
            let pairs = treatments
                .iter()
                .zip(&self.components)
                .filter(|(treatment, _)| is_meant(treatment));
            pairs.map(|(_, component)| cost(component)).sum()
        };
        let failed = self.progress.working() < self.config.required;
        [
            sum(
                |treatment| treatment.replaces,
                |component| component.replacement_cost,
            ),
            sum(
                |treatment| treatment.inspects,
                |component| component.inspection_cost,
            ),
            if failed { self.config.failure_cost } else { 0.0 },
        ]
    }

    /// Takes a step in which `draw` gives the new state and the reading of each component and its treatment.
    fn advance(
        &mut self,
        treatments: &[Treatment],
        draw: impl Fn(usize, Treatment) -> (usize, usize),
    ) -> Step {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_possible_wrap,
            reason = "at most 1000 steps"
        )]
        let discount = powi(self.config.discount, self.progress.step as i32);
        let costs = self.costs(treatments).map(|cost| discount * cost);
        for (component, treatment) in treatments.iter().enumerate() {
            let (next, reading) = draw(component, *treatment);
            let of = &self.components[component];
            self.progress.follow(component, of, *treatment, next, reading);
        }
        self.progress.step += 1;
        let cost: f64 = costs.iter().sum();
        let end = (self.progress.step >= self.config.horizon).then_some(End::Terminated);
        let [replacement, inspection, failure] = costs;
        Step::new(self.observe(), vec![-cost; N_COMPONENTS], end)
            .record("cost", cost)
            .record("replacement_cost", replacement)
            .record("inspection_cost", inspection)
            .record("failure_cost", failure)
            .record("least_cost", self.least_cost.unwrap_or_default())
    }

    #[allow(clippy::cast_precision_loss, reason = "at most 1000 steps")]
    fn observe(&self) -> Vec<Vec<f64>> {
        let time = self.progress.step as f64 / self.config.horizon as f64;
        let seen: Vec<f64> = [time].into_iter().chain(self.progress.beliefs.concat()).collect();
        vec![seen; N_COMPONENTS]
    }
}

/// The first entry whose cumulative probability is above `uniform`.
fn drawn(probabilities: &[f64; N_STATES], uniform: f64) -> usize {
    let mut sum = 0.0;
    let passed = |p: &&f64| {
        sum += **p;
        sum <= uniform
    };
    let count = probabilities.iter().take_while(passed).count();
    // Rounding may leave the sum a little below 1: then the last possible entry is returned.
    let last = probabilities.iter().rposition(|p| *p > 0.0).unwrap_or_default();
    count.min(last)
}

fn metrics() -> Vec<Metric> {
    let cost = |name, about| Metric::new(name, "", about).lower_is_better();
    vec![
        cost("cost", "discounted costs of an episode"),
        cost("replacement_cost", "discounted costs of replacements"),
        cost("inspection_cost", "discounted costs of inspections"),
        cost(
            "failure_cost",
            "discounted costs of steps in which too few components work",
        ),
        cost(
            "least_cost",
            "expected cost of the best policy that sees all states: no other one costs less",
        )
        .per_episode(PerEpisode::Last),
    ]
}

fn name(component: usize) -> String {
    format!("component_{component}")
}

fn seats(config: &ComponentReplacementConfig) -> Vec<Seat> {
    let of = |component: usize| {
        (0..N_STATES).map(move |state| {
            Channel::new(format!("{}.belief_{state}", name(component)), "")
                .within(0.0, 1.0 + 1e-9)
                .typical(0.25, 0.3)
        })
    };
    let time = Channel::new("time", "").within(0.0, 1.0).typical(0.5, 0.3);
    let observation: Vec<Channel> = [time].into_iter().chain((0..N_COMPONENTS).flat_map(of)).collect();
    let n_choices = if config.unread_inspections { 5 } else { 3 };
    let choices: Vec<String> = TREATMENTS[..n_choices]
        .iter()
        .map(|treatment| treatment.name.into())
        .collect();
    let seat = |component| Seat {
        name: name(component),
        observation: Space::Box(observation.clone()),
        action: Space::Discrete(choices.clone()),
    };
    (0..N_COMPONENTS).map(seat).collect()
}

impl Environment for ComponentReplacement {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    fn reset(&mut self, _rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        self.least_cost
            .get_or_insert_with(|| known_least_cost(&self.config));
        self.progress = Progress::new();
        Ok(self.observe())
    }

    fn step(&mut self, actions: &[Vec<f64>], rng: &mut Rng) -> Result<Step, Error> {
        let chosen = choices::taken(&self.seats, actions)?;
        let treatments: Vec<Treatment> = chosen.into_iter().map(|choice| TREATMENTS[choice]).collect();
        // Two numbers for every component whatever its treatment, so that all policies have the same random
        // numbers.
        let uniform: [[f64; 2]; N_COMPONENTS] = std::array::from_fn(|_| [rng.random(), rng.random()]);
        let (damage, components) = (self.progress.damage, self.components);
        let draw = |component: usize, treatment: Treatment| {
            let of = &components[component];
            let [moved, read] = uniform[component];
            let next = drawn(&of.transition(treatment.replaces)[damage[component]], moved);
            (next, drawn(&of.readings(treatment.reads)[next], read))
        };
        Ok(self.advance(&treatments, draw))
    }

    fn state_channels(&self) -> Vec<Channel> {
        let of = |component: usize| {
            ["damage", "reading"].map(|channel| {
                Channel::new(format!("{}.{channel}", name(component)), "")
                    .within(0.0, 3.0)
                    .typical(1.0, 1.0)
            })
        };
        #[allow(clippy::cast_precision_loss, reason = "at most 1000 steps")]
        let last = self.config.horizon as f64;
        let step = Channel::new("step", "")
            .within(0.0, last)
            .typical(last / 2.0, last / 3.0);
        [step].into_iter().chain((0..N_COMPONENTS).flat_map(of)).collect()
    }

    #[allow(clippy::cast_precision_loss, reason = "states, and at most 1000 steps")]
    fn state(&self) -> Vec<f64> {
        let Progress {
            step,
            damage,
            readings,
            ..
        } = &self.progress;
        let of = |component: usize| [damage[component] as f64, readings[component] as f64];
        [*step as f64]
            .into_iter()
            .chain((0..N_COMPONENTS).flat_map(of))
            .collect()
    }

    fn trace_channels(&self) -> Vec<Channel> {
        self.state_channels()
            .into_iter()
            .map(|channel| {
                if channel.name == "step" {
                    Channel::new("t", "")
                } else {
                    channel
                }
            })
            .collect()
    }

    fn trace(&self) -> Vec<f64> {
        self.state()
    }

    fn snapshot(&self) -> serde_json::Value {
        // Plain structs of numbers: serde_json refuses only maps whose keys are no strings.
        serde_json::to_value((&self.progress, self.least_cost)).expect("a snapshot serialises")
    }

    fn restore(&mut self, snapshot: &serde_json::Value) -> Result<(), Error> {
        (self.progress, self.least_cost) =
            Deserialize::deserialize(snapshot).map_err(|source: serde_json::Error| Error::Checkpoint {
                what: "component_replacement",
                problem: source.to_string(),
            })?;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
