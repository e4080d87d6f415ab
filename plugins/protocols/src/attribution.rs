//! Protocol `attribution`: the influence of each observed quantity on a policy's actions; nothing is learned.
//!
//! The policy acts over whole episodes. Then the values of one observed quantity are exchanged among all its decisions
//! while the other quantities stay, and the policy acts again: the *influence* is the mean distance that actions move.
//! If every quantity is exchanged at once (`whole_influence`), the policy gets another decision's observation, which
//! gives the scale for the others. An exchange separates quantities that move together in the environment, so an
//! influence shows which quantity the policy reads but not how useful the quantity is.
//!
//! An explanation that is the same for an untrained policy explains nothing. Therefore the same agent without training
//! is shown beside the trained one, with the same episodes and the same exchanges; the table kind `metrics` ranks the
//! two against each other.

use contract::{
    Config, Error, Interface, Metric, Mode, Observation, Phase, Protocol, Registry, Rng, Space, choice,
    protocol::{Run, observe},
};
use rand::seq::SliceRandom as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Beginning of the names of influences; the name of the observed quantity follows.
const INFLUENCE: &str = "influence_";
/// The influence of all quantities together. It is not ranked among the others and therefore has another beginning.
const OF_ALL: &str = "whole_influence";
/// Rows in one call of the agent.
const ROWS: usize = 256;

/// Settings of the `attribution` protocol.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Attribution {
    /// Episodes whose decisions are explained.
    #[schemars(range(min = 1, max = 100_000))]
    pub episodes: u64,
    /// Largest number of decisions that are explained, spread evenly over those of the episodes.
    #[schemars(range(min = 2, max = 1_000_000))]
    pub decisions: usize,
}

impl Default for Attribution {
    fn default() -> Self {
        Self {
            episodes: 20,
            decisions: 2000,
        }
    }
}

impl Config for Attribution {}

pub(super) fn register(registry: &mut Registry) {
    registry.protocol(
        "attribution",
        1,
        "How much each observed quantity decides what a policy does; nothing is learned.",
        |config: Attribution| config,
        |config| Ok(Box::new(config)),
    );
}

impl Protocol for Attribution {
    fn metrics(&self) -> Vec<Metric> {
        Vec::new()
    }

    fn metrics_of_interface(&self, interface: &Interface) -> Vec<Metric> {
        let mut metrics: Vec<Metric> = Vec::new();
        let names = interface.seats.iter().flat_map(|seat| seat.observation.names());
        let of_entries = names.map(|name| {
            let about = format!("how far actions move where `{name}` is that of another decision");
            Metric::new(&format!("{INFLUENCE}{name}"), "", &about)
        });
        let about = "how far actions move where the whole observation is that of another decision";
        for metric in of_entries.chain([Metric::new(OF_ALL, "", about)]) {
            if metrics.iter().all(|known| known.name != metric.name) {
                metrics.push(metric);
            }
        }
        metrics
    }

    fn records_environment_metrics(&self) -> bool {
        false
    }

    /// Explanations are compared with those of the untrained agent.
    fn compares_untrained(&self) -> bool {
        true
    }

    fn total_steps(&self) -> u64 {
        self.episodes
    }

    fn experience(&self) -> u64 {
        0
    }

    fn run(&self, run: &mut Run<'_>) -> Result<(), Error> {
        if run.agent.remembers() {
            return Err(Error::config(
                "attribution",
                "the agent remembers what it saw before, so that one decision cannot be explained by itself",
            ));
        }
        // An explanation takes seconds, so it can be stopped only at its end.
        if run.resume::<()>()?.is_some() {
            return Ok(());
        }
        let interface = (run.make_environment)()?.interface();
        let seen = spread(self.decisions(run)?, self.decisions);
        let explained = ExplainedDecisions::of(run, &interface, seen)?;
        for (seat, of) in interface.seats.iter().enumerate() {
            for (entry, name) in of.observation.names().iter().enumerate() {
                explained.record(run, seat, &[entry], &format!("{INFLUENCE}{name}"))?;
            }
            let all: Vec<usize> = (0..of.observation.len()).collect();
            explained.record(run, seat, &all, OF_ALL)?;
        }
        run.checkpoint(|| ())
    }
}

impl Attribution {
    /// The policy's observations in all decisions of the episodes.
    fn decisions(&self, run: &mut Run<'_>) -> Result<Vec<Observation>, Error> {
        let mut environment = (run.make_environment)()?;
        let mut acting = run.streams.agent("attribution");
        let mut all = Vec::new();
        for episode in 0..self.episodes {
            let mut rng = run.streams.environment("attribution", episode);
            let mut seats = environment.reset_to(episode, &mut rng)?;
            loop {
                let seen = observe(&*run.agent, &*environment, seats);
                let actions = run
                    .agent
                    .act(std::slice::from_ref(&seen), Mode::Evaluate, &mut acting)?;
                all.push(seen);
                environment.begin_step(&actions[0])?;
                let step = environment.step(&actions[0], &mut rng)?;
                if step.end.is_some() {
                    break;
                }
                seats = step.observations;
            }
            (run.progress)(episode + 1, self.episodes);
        }
        Ok(all)
    }
}

/// At most `most` observations, evenly spread.
fn spread(all: Vec<Observation>, most: usize) -> Vec<Observation> {
    let n = all.len();
    if n <= most {
        return all;
    }
    (0..most).map(|place| all[place * n / most].clone()).collect()
}

/// Decisions with the actions that were taken in them.
struct ExplainedDecisions<'a> {
    interface: &'a Interface,
    seen: Vec<Observation>,
    /// `[decision][seat][entry]`
    done: Vec<Vec<Vec<f64>>>,
}

impl<'a> ExplainedDecisions<'a> {
    fn of(run: &mut Run<'_>, interface: &'a Interface, seen: Vec<Observation>) -> Result<Self, Error> {
        let done = act(run, &seen)?;
        Ok(Self {
            interface,
            seen,
            done,
        })
    }

    /// Records the influence of some entries of a seat's observation on the actions of that seat.
    fn record(&self, run: &mut Run<'_>, seat: usize, entries: &[usize], metric: &str) -> Result<(), Error> {
        let mut order: Vec<usize> = (0..self.seen.len()).collect();
        // The exchange belongs to the environment and is the same for all entries: every agent gets the same exchange,
        // and the influence of all quantities is compared over the same decisions.
        let mut rng: Rng = run.streams.environment(&format!("exchange {seat}"), 0);
        order.shuffle(&mut rng);
        let mut exchanged = self.seen.clone();
        for (row, from) in exchanged.iter_mut().zip(order) {
            for &entry in entries {
                row.seats[seat][entry] = self.seen[from].seats[seat][entry];
            }
        }
        let done = act(run, &exchanged)?;
        let space = &self.interface.seats[seat].action;
        let moved = self
            .done
            .iter()
            .zip(&done)
            .map(|(before, after)| distance(space, &before[seat], &after[seat]));
        let moved: Vec<f64> = moved.collect::<Result<_, _>>()?;
        let influence = statistics::estimators::mean(&moved);
        run.record.add(Phase::Final, 0, 0, seat, metric, influence);
        Ok(())
    }
}

/// The policy's actions at these observations. A policy that samples draws the same numbers each time.
fn act(run: &mut Run<'_>, seen: &[Observation]) -> Result<Vec<Vec<Vec<f64>>>, Error> {
    let mut rng = run.streams.agent("explain");
    let mut all = Vec::with_capacity(seen.len());
    for rows in seen.chunks(ROWS) {
        all.extend(run.agent.act(rows, Mode::Evaluate, &mut rng)?);
    }
    Ok(all)
}

/// Distance of two actions, from 0 to 1: the share of a simplex that is moved, the mean over the entries of a box in
/// parts of their ranges (of four typical deviations if there is no range), or the fraction of choices that differ.
fn distance(space: &Space, one: &[f64], other: &[f64]) -> Result<f64, Error> {
    let gaps = one.iter().zip(other).map(|(a, b)| (a - b).abs());
    #[allow(clippy::cast_precision_loss, reason = "an action has few entries")]
    let mean = |sum: f64, n: usize| sum / n.max(1) as f64;
    Ok(match space {
        Space::Simplex(_) => gaps.sum::<f64>() / 2.0,
        Space::Box(channels) => {
            let widths = channels.iter().map(|channel| {
                let width = channel.high - channel.low;
                if width.is_finite() {
                    width
                } else {
                    4.0 * channel.spread
                }
            });
            let parts = gaps.zip(widths).map(|(gap, width)| (gap / width).min(1.0));
            mean(parts.sum(), channels.len())
        }
        Space::Discrete(_) => f64::from(gaps.sum::<f64>() > 0.0),
        Space::Choices(choices) => {
            let (one, other) = (choice::taken(choices, one)?, choice::taken(choices, other)?);
            let differ = one.iter().zip(&other).filter(|(a, b)| a != b).count();
            #[allow(clippy::cast_precision_loss, reason = "a few choices")]
            mean(differ as f64, choices.len())
        }
    })
}

#[cfg(test)]
mod tests {
    use super::{super::numbered_episodes::recorded, *};
    use contract::{Channel, choice::Choice};
    use serde_json::json;
    use std::collections::BTreeMap;

    fn influences(agent: &str, seed: u64) -> Result<BTreeMap<String, f64>, Error> {
        let config = json!({ "episodes": 40, "decisions": 100 });
        let record = recorded(agent, "attribution", &config, seed)?;
        let named =
            |row: &contract::recorder::Row| (record.names()[usize::from(row.metric)].clone(), row.value);
        Ok(record.rows().iter().map(named).collect())
    }

    #[test]
    fn only_the_quantity_that_a_policy_reads_has_influence() {
        let found = influences("repeats", 0).unwrap();
        let names: Vec<&str> = found.keys().map(String::as_str).collect();
        assert_eq!(
            names,
            ["influence_decision", "influence_number", "whole_influence"]
        );
        // Two independent uniform numbers lie a third of their range apart.
        assert!((found["influence_number"] - 1.0 / 3.0).abs() < 0.06, "{found:?}");
        assert_eq!(found["influence_decision"], 0.0);
        assert_eq!(found["whole_influence"], found["influence_number"]);
        assert_eq!(influences("repeats", 0).unwrap(), found);
        assert_ne!(influences("repeats", 1).unwrap(), found);
    }

    #[test]
    fn an_agent_that_remembers_is_not_explained() {
        let said = influences("remembers", 0).unwrap_err().to_string();
        assert!(said.contains("remembers what it saw before"), "{said}");
    }

    #[test]
    fn actions_lie_between_nothing_and_everything_apart() {
        let simplex = Space::Simplex(vec!["a".into(), "b".into(), "c".into()]);
        let far = |space: &Space, one: &[f64], other: &[f64]| distance(space, one, other).unwrap();
        assert_eq!(far(&simplex, &[1.0, 0.0, 0.0], &[0.0, 0.5, 0.5]), 1.0);
        assert_eq!(far(&simplex, &[0.5, 0.5, 0.0], &[0.25, 0.5, 0.25]), 0.25);
        let limited = Channel::new("a", "").within(-1.0, 1.0);
        let open = Channel::new("b", "").typical(0.0, 0.5);
        let both = Space::Box(vec![limited, open]);
        assert_eq!(far(&both, &[-1.0, 0.0], &[0.0, 1.0]), 0.5);
        assert_eq!(far(&both, &[-1.0, 0.0], &[1.0, 9.0]), 1.0);
        let discrete = Space::Discrete(vec!["a".into(), "b".into()]);
        assert_eq!(
            [far(&discrete, &[0.0], &[1.0]), far(&discrete, &[1.0], &[1.0])],
            [1.0, 0.0]
        );
        let choices = Space::Choices(vec![Choice::new("x", &["a", "b"]), Choice::new("y", &["a", "b"])]);
        assert_eq!(far(&choices, &[1.0, 0.0, 1.0, 0.0], &[0.0, 1.0, 0.9, 0.0]), 0.5);
    }

    #[test]
    fn decisions_are_spread_evenly() {
        let seen = |number: f64| Observation {
            seats: vec![vec![number]],
            state: Vec::new(),
        };
        let all: Vec<Observation> = (0..10).map(|it| seen(f64::from(it))).collect();
        let few: Vec<f64> = spread(all.clone(), 3).iter().map(|it| it.seats[0][0]).collect();
        assert_eq!(few, [0.0, 3.0, 6.0]);
        assert_eq!(spread(all, 20).len(), 10);
    }
}
