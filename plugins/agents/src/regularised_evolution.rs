//! Regularised evolution: the youngest designs compete, the winner has a child that differs in one option, and the
//! oldest one dies.
//!
//! Real, Aggarwal, Huang and Le 2019, "Regularized evolution for image classifier architecture search", AAAI,
//! algorithm 1. A population of random designs comes first. Then, again and again, `tournament` designs are
//! drawn from the population with replacement; the best of them is the parent; its child takes another option
//! of one choice of one step, drawn uniformly, and replaces the oldest design. In evaluation the agent makes
//! the best design so far.
//!
//! Departure: the paper alternates between mutations of a hidden state and of an operation, which its space
//! has and others lack.
//!
//! Metrics, means since the last design: `population_return` the mean return of the population.

use crate::shared::{
    designs::{EvaluatedDesign, Options, best, random_design},
    proposer::{Method, Proposer, SearchHistory},
};
use contract::{
    Agent, AgentTraits, Choice, Error, Feed, Interface, Metric, Recorder, Registry, Rng, Updates,
};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const NAME: &str = "regularised_evolution";

/// Hyper-parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Number of designs in the population.
    #[schemars(range(min = 1, max = 100_000), extend("x-source" = "Real et al. 2019: 100, for thousands of designs"))]
    pub population: usize,
    /// Number of designs that compete to be the parent.
    #[schemars(range(min = 1, max = 100_000), extend("x-source" = "Real et al. 2019: a quarter of the population"))]
    pub tournament: usize,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            population: 20,
            tournament: 5,
        }
    }
}

impl contract::Config for Config {}

/// State of the search besides its history.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct State {
    /// Child whose steps are being made; `None` while the first population is drawn.
    child: Option<Options>,
    n_children: u64,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "regularised evolution: the best of a few designs has a child, the oldest one dies";
    let metric = Metric::new("population_return", "", "mean return of the designs that live");
    let traits = AgentTraits::learner([Feed::Designs], vec![metric]);
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the agent for one seat that chooses among options.
///
/// # Errors
/// [`Error::Mismatch`] for any other seat.
fn build(config: Config, interface: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(Proposer::new(config, interface)?))
}

impl Config {
    /// Population: the youngest designs.
    fn living<'a>(&self, tried: &'a [EvaluatedDesign]) -> &'a [EvaluatedDesign] {
        &tried[tried.len().saturating_sub(self.population)..]
    }

    fn child(&self, history: &SearchHistory, rng: &mut Rng) -> Options {
        let living = self.living(&history.tried);
        let drawn: Vec<EvaluatedDesign> = (0..self.tournament)
            .map(|_| living[index(living.len(), rng)].clone())
            .collect();
        // The population is full when children are made, so at least one design was drawn.
        let mut child = best(&drawn).map_or_else(Options::new, |parent| parent.options.clone());
        mutate(&mut child, &history.choices, rng);
        child
    }
}

impl Method for Config {
    const NAME: &'static str = NAME;
    type State = State;

    fn propose(&self, history: &SearchHistory, state: &mut State, rng: &mut Rng) -> Vec<usize> {
        let step = history.under_way.options.len();
        if step == 0 {
            let full = history.tried.len() >= self.population;
            state.child = full.then(|| self.child(history, rng));
            state.n_children += u64::from(full);
        }
        let planned = state.child.as_ref().and_then(|child| child.get(step));
        planned
            .cloned()
            .unwrap_or_else(|| random_design(&history.choices, rng))
    }

    fn record_step(&self, history: &SearchHistory, _: &State, whole: bool, record: &mut Recorder) {
        if whole {
            let living = self.living(&history.tried);
            #[allow(clippy::cast_precision_loss, reason = "few designs live")]
            let mean = living.iter().map(|one| one.value).sum::<f64>() / living.len() as f64;
            record.mean("population_return", mean);
        }
    }

    fn updates(&self, state: &State) -> Updates {
        Updates {
            made: state.n_children,
            first_after: self.population as u64,
        }
    }
}

/// Changes one choice of one step to another option; choices with a single option stay.
fn mutate(design: &mut Options, choices: &[Choice], rng: &mut Rng) {
    let open: Vec<(usize, usize)> = (0..design.len())
        .flat_map(|step| (0..choices.len()).map(move |choice| (step, choice)))
        .filter(|(_, choice)| choices[*choice].options.len() > 1)
        .collect();
    if open.is_empty() {
        return;
    }
    let (step, choice) = open[index(open.len(), rng)];
    let shift = 1 + index(choices[choice].options.len() - 1, rng);
    design[step][choice] = (design[step][choice] + shift) % choices[choice].options.len();
}

/// Draws an index below `n` as `u32`: the width of `usize` would change the stream.
#[allow(clippy::cast_possible_truncation, reason = "nobody tries 2^32 designs")]
fn index(n: usize, rng: &mut Rng) -> usize {
    rng.random_range(0..n as u32) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::designs::{
        choices,
        tests::{BEST, interface, scored, search},
    };

    fn agent(population: usize) -> Box<dyn Agent> {
        let config = Config {
            population,
            tournament: 3,
        };
        build(config, &interface(), &mut contract::random::stream(&[])).unwrap()
    }

    #[test]
    fn it_finds_the_best_design_and_makes_it_in_evaluation() {
        let (mut agent, mut rng) = (agent(6), contract::random::stream(&["evolution"]));
        let values = search(&mut *agent, 80, &mut rng);
        assert!(values.contains(&BEST));
        let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
        assert!(mean(&values[60..]) > mean(&values[..6]) + 1.0, "{values:?}");
        assert_eq!(scored(&mut *agent, &mut rng), BEST);
        assert_eq!(agent.updates().unwrap().made, 74);
    }

    #[test]
    fn a_child_differs_from_its_parent_in_one_option() {
        let choices = choices(NAME, &interface()).unwrap();
        let mut rng = contract::random::stream(&["child"]);
        let parent = vec![vec![0, 2], vec![1, 1]];
        let mut seen = std::collections::BTreeSet::new();
        for _ in 0..200 {
            let mut child = parent.clone();
            mutate(&mut child, &choices, &mut rng);
            let differences = child
                .concat()
                .iter()
                .zip(parent.concat())
                .filter(|(a, b)| **a != *b)
                .count();
            assert_eq!(differences, 1);
            seen.insert(child);
        }
        // One neighbour for each choice of two options, two for each of three.
        assert_eq!(seen.len(), 6);
    }

    #[test]
    fn the_oldest_designs_die_for_any_value() {
        let config = Config {
            population: 2,
            tournament: 2,
        };
        let tried = |value: f64| EvaluatedDesign {
            options: vec![vec![0, 0]],
            value,
        };
        let all = [tried(9.0), tried(1.0), tried(2.0)];
        let living: Vec<f64> = config.living(&all).iter().map(|one| one.value).collect();
        assert_eq!(living, [1.0, 2.0]);
    }
}
