//! Plays episodes and makes their rows.

use super::columns::Columns;
use contract::{Action, Agent, Environment, Error, Mode, Observation, Rng, Step, dataset::Episode, random};
use presentation::table::guarded_csv as guarded;
use std::path::Path;

/// The source of actions.
pub enum Actions<'a> {
    /// Given actions, in order; the rollout ends with the last.
    Given(Vec<Action>),
    /// The actions of an agent, until the episode ends or `decisions` were made.
    Agent {
        /// The agent.
        agent: &'a mut dyn Agent,
        /// The most decisions to make.
        decisions: u64,
    },
}

/// Writes rows as CSV, and returns the number of decisions in them: all rows but the header and the start.
///
/// # Errors
/// Error of the file system.
pub fn write(rows: &[Vec<String>], out: &Path) -> Result<u64, Error> {
    let failed = |source: csv::Error| match source.into_kind() {
        csv::ErrorKind::Io(source) => Error::file("write", out)(source),
        _ => Error::file("write", out)(std::io::Error::other("a row has another number of columns")),
    };
    let mut csv = csv::Writer::from_path(out).map_err(failed)?;
    for row in rows {
        csv.write_record(row.iter().map(|field| guarded(field).into_owned()))
            .map_err(failed)?;
    }
    csv.flush().map_err(Error::file("write", out))?;
    let decisions = rows
        .iter()
        .skip(1)
        .filter(|row| row.first().is_some_and(|decision| decision != "0"));
    Ok(decisions.count() as u64)
}

/// Header and rows of a rollout, as text. Numbers are written so that reading them gives the same bits.
///
/// # Errors
/// Error of the environment.
pub fn rows(
    environment: &mut dyn Environment,
    mut actions: Actions<'_>,
    seed: u64,
) -> Result<Vec<Vec<String>>, Error> {
    let columns = Columns::of(environment);
    let mut rows = vec![columns.header()];
    play(
        environment,
        &mut actions,
        seed,
        &mut |environment, seats, done| match done {
            None => rows.extend(columns.start(environment, seats)),
            Some(Done {
                decision,
                action,
                step,
            }) => {
                rows.push(columns.row(environment, seats, decision, Some((action, step))));
            }
        },
    )?;
    Ok(rows)
}

/// The episode that an agent plays in an environment, equal to that of [`rows`] with the same seed. An episode that has
/// not ended after `decisions` is truncated there.
///
/// # Errors
/// Error of the environment.
pub fn episode(
    environment: &mut dyn Environment,
    agent: &mut dyn Agent,
    decisions: u64,
    seed: u64,
) -> Result<Episode, Error> {
    let mut played = Episode::default();
    let mut actions = Actions::Agent { agent, decisions };
    play(
        environment,
        &mut actions,
        seed,
        &mut |environment, seats, done| {
            played.see(environment, seats);
            if let Some(Done { action, step, .. }) = done {
                played.take(action, &step.rewards);
                played.end = step.end.unwrap_or(played.end);
            }
        },
    )?;
    Ok(played)
}

/// A decision and its outcome.
struct Done<'a> {
    decision: u64,
    action: &'a Action,
    step: &'a Step,
}

/// Callback for the start and for every step: the environment, the seats' observations, and the decision before them.
type Told<'a> = dyn FnMut(&dyn Environment, &[Vec<f64>], Option<Done<'_>>) + 'a;

/// Plays an episode until it ends or the actions run out.
fn play(
    environment: &mut dyn Environment,
    actions: &mut Actions<'_>,
    seed: u64,
    told: &mut Told<'_>,
) -> Result<(), Error> {
    let mut rng = random::rollout(seed);
    let mut agent_rng = random::stream(&["rollout", "agent", &seed.to_string()]);
    let mut seats = environment.reset(&mut rng)?;
    told(environment, &seats, None);
    for decision in 1.. {
        let Some(action) = actions.of(decision, environment, &seats, &mut agent_rng)? else {
            break;
        };
        let step = environment
            .step(&action, &mut rng)
            .map_err(|error| of_decision(error, decision))?;
        let done = Done {
            decision,
            action: &action,
            step: &step,
        };
        told(environment, &step.observations, Some(done));
        if step.end.is_some() {
            break;
        }
        seats = step.observations;
    }
    Ok(())
}

impl Actions<'_> {
    /// The action of a decision, counted from 1; `None` after the last.
    fn of(
        &mut self,
        decision: u64,
        environment: &dyn Environment,
        seats: &[Vec<f64>],
        rng: &mut Rng,
    ) -> Result<Option<Action>, Error> {
        match self {
            Actions::Given(given) => Ok(given.get(decision as usize - 1).cloned()),
            Actions::Agent { decisions, .. } if decision > *decisions => Ok(None),
            Actions::Agent { agent, .. } => {
                let state = if agent.reads_state() {
                    environment.state()
                } else {
                    Vec::new()
                };
                let seats = seats.to_vec();
                let mut actions = agent.act(&[Observation { seats, state }], Mode::Evaluate, rng)?;
                Ok(Some(actions.swap_remove(0)))
            }
        }
    }
}

/// The error for a refused action, with the number of its decision.
fn of_decision(error: Error, decision: u64) -> Error {
    match error {
        Error::Action { problem } => Error::Action {
            problem: format!("decision {decision}: {problem}"),
        },
        other => other,
    }
}
