//! The tree-structured Parzen estimator over choices: options that are common among good designs and rare among the
//! others.
//!
//! Bergstra, Bardenet, Bengio and Kegl 2011, "Algorithms for hyper-parameter optimization", NeurIPS, section 4.
//!
//! | paper | here |
//! |---|---|
//! | gamma | `good_share`: the best designs are the good ones, at most `most_good` of them |
//! | l(x), g(x) | how often an option was taken among the good designs and among the others, each count raised by `prior` |
//! | l(x) / g(x) | score of a proposal: the largest of `n_candidates` drawn from l |
//!
//! Every choice of every step has densities of its own (the form for independent parameters), except that a step is
//! proposed as a whole: the score of a candidate is the product over its choices. The first `n_startup`
//! designs are drawn uniformly. In evaluation the agent makes the best design so far.
//!
//! Metrics, means since the last design: `proposal_score`, ln(l / g) of the proposal.

use crate::shared::{
    designs::{EvaluatedDesign, random_design},
    proposer::{Method, Proposer, SearchHistory},
};
use contract::{
    Agent, AgentTraits, Choice, Error, Feed, Interface, Metric, Recorder, Registry, Rng, Updates,
};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const NAME: &str = "tree_parzen";

/// Hyper-parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Number of designs that are drawn uniformly before any is proposed.
    #[schemars(range(min = 1, max = 100_000), extend("x-source" = "optuna 4: 10"))]
    pub n_startup: usize,
    /// Share of the designs that counts as good.
    #[schemars(range(min = 0.001, max = 0.999), extend("x-source" = "optuna 4: 0.1"))]
    pub good_share: f64,
    /// Largest number of designs that count as good.
    #[schemars(range(min = 1, max = 100_000), extend("x-source" = "optuna 4: 25"))]
    pub most_good: usize,
    /// Number of candidates, of which the best one is proposed.
    #[schemars(range(min = 1, max = 100_000), extend("x-source" = "optuna 4: 24"))]
    pub n_candidates: usize,
    /// Count of every option before it was taken.
    #[schemars(range(min = 1e-6, max = 1e6), extend("x-source" = "optuna 4: 1"))]
    pub prior: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            n_startup: 10,
            good_share: 0.1,
            most_good: 25,
            n_candidates: 24,
            prior: 1.0,
        }
    }
}

impl contract::Config for Config {}

/// State of the search besides its history.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct State {
    n_proposals: u64,
    /// Score ln(l / g) of the last proposal.
    score: f64,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about =
        "tree-structured Parzen estimator: options that are common among good designs and rare among others";
    let metric = Metric::new(
        "proposal_score",
        "",
        "log ratio of the densities of good designs and of others",
    );
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

/// Probability of each option of each choice in one step.
type Density = Vec<Vec<f64>>;

impl Method for Config {
    const NAME: &'static str = NAME;
    type State = State;

    fn propose(&self, history: &SearchHistory, state: &mut State, rng: &mut Rng) -> Vec<usize> {
        if history.tried.len() < self.n_startup {
            return random_design(&history.choices, rng);
        }
        let (taken, score) = self.candidate(history, rng);
        state.n_proposals += 1;
        state.score = score;
        taken
    }

    fn record_step(&self, _: &SearchHistory, state: &State, _: bool, record: &mut Recorder) {
        record.mean("proposal_score", state.score);
    }

    fn updates(&self, state: &State) -> Updates {
        Updates {
            made: state.n_proposals,
            first_after: self.n_startup as u64,
        }
    }
}

impl Config {
    /// Best of the candidates for the next step, and its ln(l / g).
    fn candidate(&self, history: &SearchHistory, rng: &mut Rng) -> (Vec<usize>, f64) {
        let step = history.under_way.options.len();
        let (good, others) = self.split(&history.tried);
        let density = |designs: &[&EvaluatedDesign]| self.density(&history.choices, designs, step);
        let (likely, unlikely) = (density(&good), density(&others));
        let candidate = |_| {
            let taken: Vec<usize> = likely.iter().map(|of_choice| drawn(of_choice, rng)).collect();
            let score = log_likelihood(&likely, &taken) - log_likelihood(&unlikely, &taken);
            (taken, score)
        };
        let better =
            |best: (Vec<usize>, f64), other: (Vec<usize>, f64)| if other.1 > best.1 { other } else { best };
        // At least one candidate is drawn, so there is a best one.
        (0..self.n_candidates)
            .map(candidate)
            .reduce(better)
            .unwrap_or_default()
    }

    /// The good designs and the others; the earlier of equal designs ranks higher.
    fn split<'a>(
        &self,
        tried: &'a [EvaluatedDesign],
    ) -> (Vec<&'a EvaluatedDesign>, Vec<&'a EvaluatedDesign>) {
        let mut ranked: Vec<&EvaluatedDesign> = tried.iter().collect();
        ranked.sort_by(|one, other| other.value.total_cmp(&one.value));
        #[allow(
            clippy::cast_precision_loss,
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of a count is a count"
        )]
        let n_good = (ranked.len() as f64 * self.good_share).ceil() as usize;
        let others = ranked.split_off(n_good.min(self.most_good).min(ranked.len()));
        (ranked, others)
    }

    fn density(&self, choices: &[Choice], designs: &[&EvaluatedDesign], step: usize) -> Density {
        let of_choice = |(at, choice): (usize, &Choice)| {
            let mut counts = vec![self.prior; choice.options.len()];
            for design in designs {
                if let Some(taken) = design.options.get(step) {
                    counts[taken[at]] += 1.0;
                }
            }
            let sum: f64 = counts.iter().sum();
            counts.into_iter().map(|count| count / sum).collect()
        };
        choices.iter().enumerate().map(of_choice).collect()
    }
}

/// Draws an option with the probabilities of `density`.
fn drawn(density: &[f64], rng: &mut Rng) -> usize {
    let mut left: f64 = rng.random();
    let passed = |share: &f64| {
        left -= share;
        left < 0.0
    };
    density.iter().position(passed).unwrap_or(density.len() - 1)
}

fn log_likelihood(density: &Density, taken: &[usize]) -> f64 {
    density
        .iter()
        .zip(taken)
        .map(|(of_choice, at)| of_choice[*at].ln())
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::designs::{
        choices,
        tests::{BEST, interface, scored, search},
    };

    #[test]
    fn it_finds_the_best_design_and_makes_it_in_evaluation() {
        let startup = Config {
            n_startup: 20,
            ..Config::default()
        };
        let (mut agent, mut rng) = (
            Proposer::new(startup, &interface()).unwrap(),
            contract::random::stream(&["parzen"]),
        );
        let values = search(&mut agent, 100, &mut rng);
        let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
        assert!(mean(&values[80..]) > mean(&values[..20]) + 1.0, "{values:?}");
        assert!(scored(&mut agent, &mut rng) >= BEST - 1.0, "{values:?}");
        assert_eq!(agent.updates().unwrap().made, 160);
    }

    /// Two of the four designs are good; both took `norm` 2, and none of the others did.
    #[test]
    fn densities_by_hand() {
        let config = Config {
            good_share: 0.5,
            ..Config::default()
        };
        let choices = choices(NAME, &interface()).unwrap();
        let tried = |conv: usize, norm: usize, value: f64| EvaluatedDesign {
            options: vec![vec![conv, norm]],
            value,
        };
        let all = [
            tried(0, 2, 4.0),
            tried(1, 2, 3.0),
            tried(0, 0, 1.0),
            tried(0, 1, 2.0),
        ];
        let (good, others) = config.split(&all);
        assert_eq!(good.iter().map(|one| one.value).collect::<Vec<_>>(), [4.0, 3.0]);
        let density = |designs: &[&EvaluatedDesign], step| config.density(&choices, designs, step);
        let close = |density: &Density, expected: &[&[f64]]| {
            for (found, expected) in density.iter().zip(expected) {
                assert!(
                    found.iter().zip(*expected).all(|(a, b)| (a - b).abs() < 1e-15),
                    "{found:?}"
                );
            }
        };
        close(&density(&good, 0), &[&[0.5, 0.5], &[0.2, 0.2, 0.6]]);
        close(&density(&others, 0), &[&[0.75, 0.25], &[0.4, 0.4, 0.2]]);
        close(&density(&good, 1), &[&[0.5, 0.5], &[1.0 / 3.0; 3]]);
        let ratio =
            log_likelihood(&density(&good, 0), &[1, 2]) - log_likelihood(&density(&others, 0), &[1, 2]);
        assert!((ratio - (2.0f64 * 3.0).ln()).abs() < 1e-12);
    }

    #[test]
    fn options_are_drawn_as_often_as_their_density_says() {
        let mut rng = contract::random::stream(&["density"]);
        let counts = (0..30_000).fold([0.0; 3], |mut counts, _| {
            counts[drawn(&[0.2, 0.7, 0.1], &mut rng)] += 1.0 / 30_000.0;
            counts
        });
        let expected = [0.2, 0.7, 0.1];
        assert!(
            counts
                .iter()
                .zip(expected)
                .all(|(a, b): (&f64, f64)| (a - b).abs() < 0.01),
            "{counts:?}"
        );
    }
}
