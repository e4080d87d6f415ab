//! Designs of an agent that proposes whole designs: the unfinished one, and those evaluated so far with their
//! values.

use super::seat::{kind, mismatch, only_seat};
use contract::{Choice, Error, Interface, Rng, Space, Transition, choice};
use rand::Rng as _;
use serde::{Deserialize, Serialize};

/// Index of the option of each choice, step by step.
pub type Options = Vec<Vec<usize>>;

/// A complete design and its value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EvaluatedDesign {
    /// Options of all its steps.
    pub options: Options,
    /// Sum of its rewards; more is better.
    pub value: f64,
}

/// A design whose episode is not over.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct PartialDesign {
    /// Options of the steps so far.
    pub options: Options,
    /// Sum of the rewards so far.
    pub earned: f64,
}

impl PartialDesign {
    /// Adds one step; returns the design and begins another one where the step ended the episode.
    ///
    /// # Errors
    /// [`Error::Action`] for an action that takes no option.
    pub fn take(
        &mut self,
        choices: &[Choice],
        transition: &Transition,
    ) -> Result<Option<EvaluatedDesign>, Error> {
        self.options.push(choice::taken(choices, &transition.action[0])?);
        self.earned += transition.rewards[0];
        if transition.end.is_none() {
            return Ok(None);
        }
        let Self { options, earned } = std::mem::take(self);
        Ok(Some(EvaluatedDesign {
            options,
            value: earned,
        }))
    }
}

/// Choices of the only seat of an environment.
///
/// # Errors
/// [`Error::Mismatch`] for several seats and for actions that are no choices.
pub fn choices(agent: &'static str, interface: &Interface) -> Result<Vec<Choice>, Error> {
    match &only_seat(agent, interface)?.action {
        Space::Choices(choices) if !choices.is_empty() => Ok(choices.clone()),
        other => {
            let taken = kind(other);
            let problem = format!("it chooses among options, the environment takes {taken}");
            Err(mismatch(agent, problem))
        }
    }
}

/// One option of each choice, drawn uniformly.
#[must_use]
pub fn random_design(choices: &[Choice], rng: &mut Rng) -> Vec<usize> {
    // `u32`: the width of `usize` depends on the machine and would change the stream.
    #[allow(clippy::cast_possible_truncation, reason = "nobody names 2^32 options")]
    let draw = |choice: &Choice| rng.random_range(0..choice.options.len() as u32) as usize;
    choices.iter().map(draw).collect()
}

/// Design with the largest value, the first of equals.
#[must_use]
pub fn best(tried: &[EvaluatedDesign]) -> Option<&EvaluatedDesign> {
    tried
        .iter()
        .reduce(|best, other| if other.value > best.value { other } else { best })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use contract::{Action, Agent, Channel, End, Mode, Observation, Recorder, Seat};

    /// Environment with two choices in each of two steps. The value of a design is the number of second
    /// options in it, and three more where it takes the third option of `norm` in the second step.
    pub(crate) fn interface() -> Interface {
        let choices = vec![
            Choice::new("conv", &["post", "pre"]),
            Choice::new("norm", &["none", "batch", "instance"]),
        ];
        Interface {
            seats: vec![Seat {
                name: String::new(),
                observation: Space::Box(vec![Channel::new("step", "")]),
                action: Space::Choices(choices),
            }],
            state: Vec::new(),
        }
    }

    pub(crate) const BEST: f64 = 6.0;

    fn worth(step: usize, taken: &[usize]) -> f64 {
        let second = taken.iter().filter(|option| **option == 1).count() as f64;
        second + if step == 1 && taken[1] == 2 { 3.0 } else { 0.0 }
    }

    /// Lets an agent try `n` designs; returns their values.
    pub(crate) fn search(agent: &mut dyn Agent, n: usize, rng: &mut Rng) -> Vec<f64> {
        let mut record = Recorder::default();
        let mut one = || {
            agent.restart();
            let mut sum = 0.0;
            for step in 0..2 {
                let (action, reward) = decide(agent, step, Mode::Train, rng);
                sum += reward;
                let seen = |at: usize| Observation {
                    seats: vec![vec![at as f64]],
                    state: Vec::new(),
                };
                let transition = Transition {
                    observation: seen(step),
                    action,
                    rewards: vec![reward],
                    next_observation: seen(step + 1),
                    end: (step == 1).then_some(End::Terminated),
                };
                agent.learn(&[transition], rng, &mut record).unwrap();
                if agent.truncates() {
                    break;
                }
            }
            sum
        };
        (0..n).map(|_| one()).collect()
    }

    /// Value of the design that the agent makes in evaluation.
    pub(crate) fn scored(agent: &mut dyn Agent, rng: &mut Rng) -> f64 {
        agent.restart();
        (0..2)
            .map(|step| decide(agent, step, Mode::Evaluate, rng).1)
            .sum()
    }

    fn decide(agent: &mut dyn Agent, step: usize, mode: Mode, rng: &mut Rng) -> (Action, f64) {
        let seen = Observation {
            seats: vec![vec![step as f64]],
            state: Vec::new(),
        };
        let action = agent.act(&[seen], mode, rng).unwrap().remove(0);
        let Space::Choices(choices) = &interface().seats[0].action else {
            unreachable!()
        };
        let taken = choice::taken(choices, &action[0]).unwrap();
        (action, worth(step, &taken))
    }

    #[test]
    fn a_design_is_whole_where_its_episode_ends() {
        let interface = interface();
        let choices = choices("tested", &interface).unwrap();
        let mut under_way = PartialDesign::default();
        let step = |taken: &[usize], reward: f64, end| Transition {
            observation: Observation::default(),
            action: vec![choice::vector(&choices, taken)],
            rewards: vec![reward],
            next_observation: Observation::default(),
            end,
        };
        assert_eq!(under_way.take(&choices, &step(&[1, 2], 0.5, None)).unwrap(), None);
        let whole = under_way
            .take(&choices, &step(&[0, 1], 1.0, Some(End::Terminated)))
            .unwrap();
        let expected = EvaluatedDesign {
            options: vec![vec![1, 2], vec![0, 1]],
            value: 1.5,
        };
        assert_eq!(whole, Some(expected.clone()));
        assert_eq!(under_way, PartialDesign::default());
        let worse = EvaluatedDesign {
            value: 1.0,
            ..expected.clone()
        };
        assert_eq!(
            best(&[worse, expected.clone(), expected.clone()]),
            Some(&expected)
        );
    }

    #[test]
    fn other_actions_are_refused() {
        let mut other = interface();
        other.seats[0].action = Space::Simplex(vec!["a".into()]);
        let text = choices("tested", &other).unwrap_err().to_string();
        assert!(
            text.contains("it chooses among options, the environment takes a simplex"),
            "{text}"
        );
    }
}
