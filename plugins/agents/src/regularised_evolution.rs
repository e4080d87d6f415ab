//! Regularised evolution: the youngest designs compete, the winner has a child that differs in one option, and the
//! oldest one dies.
//!
//! Real, Aggarwal, Huang and Le 2019, "Regularized evolution for image classifier architecture search", AAAI,
//! algorithm 1. A population of random designs comes first. Then, again and again, `tournament` designs are drawn
//! from the population with replacement, the best of them is the parent, its child takes another option of one choice
//! of one step, drawn uniformly, and takes the place of the oldest design. Where it is scored it makes the best design
//! that it has seen.
//!
//! Departure: the paper mutates a hidden state or an operation by turns, which its space has and others lack.
//!
//! Metrics, means since the last design: `population_return` the mean return of the population.

use crate::shared::checkpoint;
use crate::shared::designs::{Options, Tried, UnderWay, best, choices, random_design};
use engine::{
    Action, Agent, AgentTraits, Choice, Error, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates, choice,
};
use numerics::tensor_file::TensorFile;
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

const NAME: &str = "regularised_evolution";

/// Hyper-parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Designs that live.
    #[schemars(range(min = 1, max = 100_000), extend("x-source" = "Real et al. 2019: 100, for thousands of designs"))]
    pub population: usize,
    /// Designs that compete to be the parent.
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

impl engine::Config for Config {}

/// The agent.
#[derive(Debug, Clone)]
pub struct RegularisedEvolution {
    config: Config,
    choices: Vec<Choice>,
    state: State,
    /// Steps of the design that is made where it is scored.
    scored: usize,
}

/// What changes while it searches.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct State {
    under_way: UnderWay,
    /// The child under way; `None` while the first population is drawn.
    child: Option<Options>,
    tried: Vec<Tried>,
    n_children: u64,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "regularised evolution: the best of a few designs has a child, the oldest one dies";
    let metric = Metric::new("population_return", "", "mean return of the designs that live");
    let traits = AgentTraits {
        learns: true,
        metrics: vec![metric],
        designs: true,
        ..AgentTraits::default()
    };
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the agent for one seat that chooses among options.
///
/// # Errors
/// [`Error::Mismatch`] for any other seat.
fn build(config: Config, interface: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(RegularisedEvolution {
        choices: choices(NAME, interface)?,
        config,
        state: State::default(),
        scored: 0,
    }))
}

impl RegularisedEvolution {
    /// The designs that live: the youngest ones.
    fn living(&self) -> &[Tried] {
        let tried = &self.state.tried;
        &tried[tried.len().saturating_sub(self.config.population)..]
    }

    fn child(&self, rng: &mut Rng) -> Options {
        let living = self.living();
        let drawn: Vec<Tried> = (0..self.config.tournament)
            .map(|_| living[index(living.len(), rng)].clone())
            .collect();
        // The population is full where children are made, so somebody was drawn.
        let mut child = best(&drawn).map_or_else(Options::new, |parent| parent.options.clone());
        mutate(&mut child, &self.choices, rng);
        child
    }

    fn decide(&mut self, rng: &mut Rng) -> Vec<usize> {
        let step = self.state.under_way.options.len();
        if step == 0 {
            let full = self.state.tried.len() >= self.config.population;
            self.state.child = full.then(|| self.child(rng));
            self.state.n_children += u64::from(full);
        }
        let planned = self.state.child.as_ref().and_then(|child| child.get(step));
        planned
            .cloned()
            .unwrap_or_else(|| random_design(&self.choices, rng))
    }

    fn best_so_far(&mut self, rng: &mut Rng) -> Vec<usize> {
        let taken = best(&self.state.tried).and_then(|best| best.options.get(self.scored));
        self.scored += 1;
        taken
            .cloned()
            .unwrap_or_else(|| random_design(&self.choices, rng))
    }
}

/// Another option of one choice of one step; choices with a single option stay.
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

/// Below `n`. Not drawn as `usize`, whose width would reach the stream.
#[allow(clippy::cast_possible_truncation, reason = "nobody tries 2^32 designs")]
fn index(n: usize, rng: &mut Rng) -> usize {
    rng.random_range(0..n as u32) as usize
}

impl Agent for RegularisedEvolution {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let mut row = |_| {
            let taken = match mode {
                Mode::Train => self.decide(rng),
                Mode::Evaluate => self.best_so_far(rng),
            };
            vec![choice::vector(&self.choices, &taken)]
        };
        Ok(observations.iter().map(&mut row).collect())
    }

    fn learn(&mut self, transitions: &[Transition], _: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        for transition in transitions {
            if let Some(tried) = self.state.under_way.take(&self.choices, transition)? {
                self.state.tried.push(tried);
                let living = self.living();
                #[allow(clippy::cast_precision_loss, reason = "few designs live")]
                let mean = living.iter().map(|one| one.value).sum::<f64>() / living.len() as f64;
                record.mean("population_return", mean);
            }
        }
        Ok(())
    }

    fn updates(&self) -> Option<Updates> {
        Some(Updates {
            made: self.state.n_children,
            first_after: self.config.population as u64,
        })
    }

    fn remembers(&self) -> bool {
        true
    }

    fn restart(&mut self) {
        self.scored = 0;
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        checkpoint::write(NAME, dir, TensorFile::default(), &self.state)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        (_, self.state) = checkpoint::read(NAME, dir)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::designs::tests::{BEST, interface, scored, search};

    fn agent(population: usize) -> Box<dyn Agent> {
        let config = Config {
            population,
            tournament: 3,
        };
        build(config, &interface(), &mut engine::random::stream(&[])).unwrap()
    }

    #[test]
    fn it_finds_the_best_design_and_makes_it_where_it_is_scored() {
        let (mut agent, mut rng) = (agent(6), engine::random::stream(&["evolution"]));
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
        let mut rng = engine::random::stream(&["child"]);
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
    fn the_oldest_die_whatever_they_were_worth() {
        let mut agent = RegularisedEvolution {
            config: Config {
                population: 2,
                tournament: 2,
            },
            choices: choices(NAME, &interface()).unwrap(),
            state: State::default(),
            scored: 0,
        };
        let tried = |value: f64| Tried {
            options: vec![vec![0, 0]],
            value,
        };
        agent.state.tried = vec![tried(9.0), tried(1.0), tried(2.0)];
        assert_eq!(
            agent.living().iter().map(|one| one.value).collect::<Vec<_>>(),
            [1.0, 2.0]
        );
    }
}
