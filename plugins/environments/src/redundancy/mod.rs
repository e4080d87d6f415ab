//! Redundancy allocation: the spare components that a system gets for its budget, subsystem by subsystem.
//!
//! The system is that of Fyffe, Hines and Lee (1968), 14 subsystems in series with three or four types of
//! component each ([`system`]); cost is at most 130 and weight at most 159 to 191, the 33 problems of Y.
//! Nakagawa and S. Miyazaki, "Surrogate constraints algorithm for reliability optimization problems with two
//! constraints", IEEE Transactions on Reliability R-30 (1981) 175-180. Types may be mixed within a subsystem,
//! and an action fills each place with a type or leaves it empty: the encoding of D. W. Coit and A. E. Smith,
//! "Reliability optimization of series-parallel systems using a genetic algorithm", IEEE Transactions on
//! Reliability 45 (1996) 254-260.
//!
//! An episode is a design, a step one subsystem. Before it is designed, a subsystem has one component of its
//! lightest type. The reward of a step is its gain in the score of the present system
//! ([`system::Total::score`]: -ln(1 - R) within the budgets, below 0 beyond them), so that an episode earns the
//! final score less that of the system of lightest components. An empty subsystem makes R = 0.
//!
//! The optimum is found by dynamic programming over the same designs ([`optimum`]). Departure: the papers allow
//! eight components in a subsystem, the default of `places` is four; all 33 optima have at most four, so none
//! is lost (a test checks this), and random designs come near the budgets.

pub mod optimum;
pub mod system;

use contract::{
    Channel, Choice, End, Environment, Error, Metric, PerEpisode, Preset, Rng, Seat, Space, Step,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::{
    collections::BTreeMap,
    sync::{Mutex, PoisonError},
};
use system::{Budget, Component, Counts, MOST_TYPES, Part, SUBSYSTEMS, Total};

/// Settings of the `redundancy` environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RedundancyConfig {
    /// Number of subsystems, the first of the published 14.
    #[schemars(
        range(min = 1, max = 14),
        extend("x-source" = "Fyffe, Hines and Lee (1968)")
    )]
    pub subsystems: usize,
    /// Places for components in every subsystem. The published optima fill at most four; the papers allow
    /// eight.
    #[schemars(range(min = 1, max = 8))]
    pub places: usize,
    /// The largest cost of a system.
    #[schemars(
        range(min = 1, max = 1000),
        extend("x-source" = "Fyffe, Hines and Lee (1968)")
    )]
    pub cost_budget: usize,
    /// The largest weight of a system; 159 to 191 in the published problems.
    #[schemars(
        range(min = 1, max = 1000),
        extend("x-source" = "Nakagawa and Miyazaki (1981)")
    )]
    pub weight_budget: usize,
}

impl Default for RedundancyConfig {
    fn default() -> Self {
        Self {
            subsystems: SUBSYSTEMS.len(),
            places: 4,
            cost_budget: 130,
            weight_budget: 191,
        }
    }
}

impl contract::Config for RedundancyConfig {
    fn presets() -> Vec<Preset> {
        let preset = |name, about, values| Preset { name, about, values };
        vec![
            preset(
                "weight_191",
                "the first problem of Nakagawa and Miyazaki (the defaults): both budgets bind; optimum 0.986811",
                json!({}),
            ),
            preset(
                "weight_175",
                "the problem in the middle: the weight alone binds; optimum 0.975708",
                json!({ "weight_budget": 175 }),
            ),
            preset(
                "weight_159",
                "the last problem: the weight alone binds; optimum 0.954565",
                json!({ "weight_budget": 159 }),
            ),
            preset(
                "small",
                "the first four subsystems, for short runs; optimum 0.987784",
                json!({ "subsystems": 4, "cost_budget": 26, "weight_budget": 52 }),
            ),
        ]
    }
}

impl RedundancyConfig {
    fn budget(&self) -> Budget {
        Budget {
            cost: self.cost_budget,
            weight: self.weight_budget,
        }
    }

    fn types(&self) -> &'static [&'static [Component]] {
        &SUBSYSTEMS[..self.subsystems]
    }

    fn check(&self) -> Result<(), Error> {
        let ranges = [
            ("subsystems", self.subsystems, SUBSYSTEMS.len()),
            ("places", self.places, 8),
            ("cost_budget", self.cost_budget, 1000),
            ("weight_budget", self.weight_budget, 1000),
        ];
        for (key, value, most) in ranges {
            if !(1..=most).contains(&value) {
                return Err(Error::config(key, format!("{value} is not in 1 to {most}")));
            }
        }
        Ok(())
    }
}

/// The `redundancy` environment.
#[derive(Debug)]
pub struct Redundancy {
    config: RedundancyConfig,
    seats: Vec<Seat>,
    choices: Vec<Choice>,
    metrics: Vec<Metric>,
    optimal_reliability: f64,
    /// Components of the subsystems designed so far.
    designed: Vec<Counts>,
}

/// Builds the environment; registered as `redundancy`.
///
/// # Errors
/// [`Error::Config`] for a number outside its range and where no design is within the budgets.
pub fn build(config: RedundancyConfig) -> Result<Box<dyn Environment>, Error> {
    Ok(Box::new(Redundancy::new(config)?))
}

/// The reliability of the best design, computed once for each config within a process.
fn known_optimum(config: &RedundancyConfig) -> Option<f64> {
    static KNOWN: Mutex<BTreeMap<String, Option<f64>>> = Mutex::new(BTreeMap::new());
    let find = || {
        let best = optimum::optimum(config.types(), config.places, config.budget());
        best.map(|best| best.reliability)
    };
    // A panic while the lock was held has left the map unchanged.
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    *known.entry(format!("{config:?}")).or_insert_with(find)
}

impl Redundancy {
    fn new(config: RedundancyConfig) -> Result<Self, Error> {
        config.check()?;
        let Some(best) = known_optimum(&config) else {
            let problem = format!(
                "no design of {} subsystems costs at most {} and weighs at most {}",
                config.subsystems, config.cost_budget, config.weight_budget
            );
            return Err(Error::config("weight_budget", problem));
        };
        let choices = choices(config.places);
        let seat = Seat {
            name: String::new(),
            observation: Space::Box(channels(&config)),
            action: Space::Choices(choices.clone()),
        };
        Ok(Self {
            seats: vec![seat],
            choices,
            metrics: metrics(),
            optimal_reliability: best,
            designed: Vec::new(),
            config,
        })
    }

    /// Reliability, cost and weight of the subsystems designed so far.
    fn designed_total(&self) -> Total {
        Total::of(self.designed_parts())
    }

    /// Reliability, cost and weight of the whole system, with the lightest components in the remaining
    /// subsystems.
    fn present_system(&self) -> Total {
        let others = self.config.types()[self.designed.len()..].iter();
        let starters = others.map(|types| Part::of(types, &system::starter(types)));
        Total::of(self.designed_parts().chain(starters))
    }

    fn designed_parts(&self) -> impl Iterator<Item = Part> {
        let with_types = self.config.types().iter().zip(&self.designed);
        with_types.map(|(types, counts)| Part::of(types, counts))
    }

    fn observe(&self) -> Vec<f64> {
        let (total, budget) = (self.designed_total(), self.config.budget());
        let present = |subsystem| {
            if subsystem == self.designed.len() {
                1.0
            } else {
                0.0
            }
        };
        (0..self.config.subsystems)
            .map(present)
            .chain([
                1.0 - share(total.cost, budget.cost),
                1.0 - share(total.weight, budget.weight),
                total.reliability,
            ])
            .collect()
    }

    /// The metrics of the present design.
    fn recorded(&self) -> [(&'static str, f64); 4] {
        let total = self.present_system();
        let is_feasible = total.is_within(self.config.budget());
        let reliability = if is_feasible { total.reliability } else { 0.0 };
        let gap = (1.0 - reliability) / (1.0 - self.optimal_reliability) - 1.0;
        let feasible = f64::from(u8::from(is_feasible));
        [
            ("reliability", reliability),
            ("optimum", self.optimal_reliability),
            ("gap", gap),
            ("feasible", feasible),
        ]
    }
}

/// One choice per place; option 0 leaves it empty, option j puts a component of type j there.
fn choices(places: usize) -> Vec<Choice> {
    let place = |place: usize| {
        Choice::new(
            format!("place_{place}"),
            &["empty", "type_1", "type_2", "type_3", "type_4"],
        )
    };
    (1..=places).map(place).collect()
}

/// Number of components of each type that an action buys for the present subsystem; a type that the subsystem
/// does not have leaves its place empty.
fn bought(taken: &[usize], types: usize) -> Counts {
    let mut counts = Counts::default();
    for of in taken.iter().filter_map(|option| option.checked_sub(1)) {
        if of < types {
            counts[of] += 1;
        }
    }
    counts
}

#[allow(clippy::cast_precision_loss, reason = "costs and weights are far below 2^52")]
fn share(spent: usize, budget: usize) -> f64 {
    spent as f64 / budget as f64
}

/// Channels of the observation: one per subsystem, 1 for the next one to design, then the remaining budgets.
fn channels(config: &RedundancyConfig) -> Vec<Channel> {
    let most = |of: fn(&Component) -> usize| -> usize {
        let dearest = |types: &&[Component]| types.iter().map(of).max().unwrap_or(0);
        config.places * config.types().iter().map(dearest).sum::<usize>()
    };
    let left = |name: &str, most: usize, budget: usize| {
        Channel::new(name, "")
            .within(1.0 - share(most, budget), 1.0)
            .typical(0.5, 0.5)
    };
    let present = |subsystem: usize| {
        Channel::new(format!("subsystem_{subsystem}"), "")
            .within(0.0, 1.0)
            .typical(0.0, 0.3)
    };
    (1..=config.subsystems)
        .map(present)
        .chain([
            left("remaining_cost", most(|one| one.cost), config.cost_budget),
            left("remaining_weight", most(|one| one.weight), config.weight_budget),
            Channel::new("reliability_so_far", "")
                .within(0.0, 1.0)
                .typical(0.95, 0.1),
        ])
        .collect()
}

fn metrics() -> Vec<Metric> {
    let last = |name, about| Metric::new(name, "", about).per_episode(PerEpisode::Last);
    vec![
        last(
            "reliability",
            "probability that the system works; 0 for a design beyond a budget",
        ),
        last(
            "optimum",
            "the largest reliability of any design within the budgets",
        ),
        last(
            "gap",
            "how much more often the system fails than the best one, as a part of how often that one fails",
        )
        .lower_is_better(),
        last("feasible", "1 for a design within both budgets, else 0"),
    ]
}

impl Environment for Redundancy {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    fn reset(&mut self, _rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        self.designed.clear();
        Ok(vec![self.observe()])
    }

    fn step(&mut self, actions: &[Vec<f64>], _rng: &mut Rng) -> Result<Step, Error> {
        crate::unit_box::check_seats(actions, 1)?;
        let taken = contract::choice::taken(&self.choices, &actions[0])?;
        let Some(types) = self.config.types().get(self.designed.len()) else {
            return Err(Error::Model {
                model: "redundancy",
                problem: "every subsystem is designed; the episode has ended".into(),
            });
        };
        let before = self.present_system().score(self.config.budget());
        self.designed.push(bought(&taken, types.len()));
        let after = self.present_system().score(self.config.budget());
        let end = (self.designed.len() == self.config.subsystems).then_some(End::Terminated);
        Ok(Step::new(vec![self.observe()], vec![after - before], end).record_all(self.recorded()))
    }

    fn state_channels(&self) -> Vec<Channel> {
        channels(&self.config)
    }

    fn state(&self) -> Vec<f64> {
        self.observe()
    }

    fn trace_channels(&self) -> Vec<Channel> {
        let count = |of: usize| Channel::new(format!("bought_{of}"), "").within(0.0, 8.0);
        ["designed", "cost", "weight"]
            .map(|name| Channel::new(name, "").within(0.0, f64::INFINITY))
            .into_iter()
            .chain([Channel::new("system_reliability", "").within(0.0, 1.0)])
            .chain((1..=MOST_TYPES).map(count))
            .collect()
    }

    /// The present system, and the purchases of the last step.
    #[allow(clippy::cast_precision_loss, reason = "costs and weights are far below 2^52")]
    fn trace(&self) -> Vec<f64> {
        let total = self.present_system();
        let bought = match self.designed.last() {
            Some(counts) => counts.map(|count| count as f64),
            None => [f64::NAN; MOST_TYPES],
        };
        [self.designed.len(), total.cost, total.weight]
            .map(|value| value as f64)
            .into_iter()
            .chain([total.reliability])
            .chain(bought)
            .collect()
    }

    fn snapshot(&self) -> serde_json::Value {
        json!(self.designed)
    }

    fn restore(&mut self, snapshot: &serde_json::Value) -> Result<(), Error> {
        let misfit = |problem| Error::Checkpoint {
            what: "redundancy",
            problem,
        };
        let designed = Vec::<Counts>::deserialize(snapshot).map_err(|source| misfit(source.to_string()))?;
        let (length, most) = (designed.len(), self.config.subsystems);
        if length > most {
            return Err(misfit(format!("{length} designed subsystems of {most}")));
        }
        self.designed = designed;
        Ok(())
    }
}

#[cfg(test)]
mod environment_tests;
