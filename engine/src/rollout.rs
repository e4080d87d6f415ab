//! Drives one environment with given actions or a registered agent and writes what happened, a row per decision.
//!
//! Columns: `decision`, the environment's trace channels, the action channels that the trace does not hold already,
//! `reward` (one per seat), `end` (`terminated`, `truncated` or empty). Row 0 is the start. Where seats have names, a seat's
//! columns carry its name in front, as in `agent_0.reward`, and what it observed follows the rewards, as `agent_0.obs_0`, ...

use crate::{Action, Agent, End, Environment, Error, Mode, Observation, Seat, Step, random};
use std::{collections::BTreeMap, path::Path};

/// Where actions come from.
pub enum Actions<'a> {
    /// Given ones, in order; the rollout ends with the last.
    Given(Vec<Action>),
    /// An agent's, until the episode ends or `decisions` were made.
    Agent {
        /// The agent.
        agent: &'a mut dyn Agent,
        /// The most decisions to make.
        decisions: u64,
    },
}

/// Rolls an environment out and writes the rows as CSV.
///
/// # Errors
/// What the environment reports, and what the file system says.
pub fn write(environment: &mut dyn Environment, actions: Actions<'_>, seed: u64, out: &Path) -> Result<u64, Error> {
    let mut csv = csv::Writer::from_path(out).map_err(|source| csv_error(out, &source))?;
    let rows = rows(environment, actions, seed)?;
    for row in &rows {
        csv.write_record(row).map_err(|source| csv_error(out, &source))?;
    }
    csv.flush().map_err(Error::file("write", out))?;
    Ok(rows.len() as u64 - 2)
}

/// Header and rows of a rollout, as text; numbers are written so that they read back to the same bits.
///
/// # Errors
/// What the environment reports.
pub fn rows(environment: &mut dyn Environment, mut actions: Actions<'_>, seed: u64) -> Result<Vec<Vec<String>>, Error> {
    let columns = Columns::of(environment);
    let mut rng = random::stream(&["rollout", "environment", &seed.to_string()]);
    let mut agent_rng = random::stream(&["rollout", "agent", &seed.to_string()]);
    let mut seats = environment.reset(&mut rng)?;
    let mut rows = vec![columns.header(), columns.row(environment, &seats, 0, None)];
    for decision in 1.. {
        let action = match &mut actions {
            Actions::Given(given) => match given.get(decision as usize - 1) {
                Some(action) => action.clone(),
                None => break,
            },
            Actions::Agent { decisions, .. } if decision > *decisions => break,
            Actions::Agent { agent, .. } => {
                let state = if agent.reads_state() { environment.state() } else { Vec::new() };
                agent.act(&[Observation { seats, state }], Mode::Evaluate, &mut agent_rng)?.swap_remove(0)
            }
        };
        let step = environment.step(&action, &mut rng)?;
        rows.push(columns.row(environment, &step.observations, decision, Some((&action, &step))));
        if step.end.is_some() {
            break;
        }
        seats = step.observations;
    }
    Ok(rows)
}

/// Reads actions for the seats of an environment from a CSV file whose columns are the action channels, in any order.
///
/// # Errors
/// A column that is missing or unknown, a cell that is no number: with file, line and column.
pub fn read_actions(seats: &[Seat], path: &Path) -> Result<Vec<Action>, Error> {
    let mut reader = csv::Reader::from_path(path).map_err(|source| csv_error(path, &source))?;
    let header = reader.headers().map_err(|source| csv_error(path, &source))?.clone();
    let places: BTreeMap<String, (usize, usize)> = action_names(seats).into_iter().collect();
    let columns = header
        .iter()
        .map(|name| places.get(name).copied().ok_or_else(|| unknown_column(path, name, &places)))
        .collect::<Result<Vec<_>, _>>()?;
    if let Some((missing, _)) = places.iter().find(|(_, place)| !columns.contains(place)) {
        return Err(Error::Damaged { path: path.into(), problem: format!("column `{missing}` is missing") });
    }
    reader
        .records()
        .map(|record| parse_row(seats, &columns, &record.map_err(|source| csv_error(path, &source))?, &header, path))
        .collect()
}

fn parse_row(
    seats: &[Seat],
    columns: &[(usize, usize)],
    record: &csv::StringRecord,
    header: &csv::StringRecord,
    path: &Path,
) -> Result<Action, Error> {
    let mut action: Action = seats.iter().map(|seat| vec![0.0; seat.action.len()]).collect();
    for ((&(seat, entry), cell), name) in columns.iter().zip(record).zip(header) {
        action[seat][entry] = cell.trim().parse().map_err(|_| Error::Damaged {
            path: path.into(),
            problem: format!("line {}, column `{name}`: `{cell}` is no number", record.position().map_or(0, csv::Position::line)),
        })?;
    }
    Ok(action)
}

fn unknown_column(path: &Path, name: &str, places: &BTreeMap<String, (usize, usize)>) -> Error {
    let known = places.keys().cloned().collect::<Vec<_>>().join(", ");
    Error::Damaged {
        path: path.into(),
        problem: format!("column `{name}` is no action of this environment; its actions: {known}"),
    }
}

/// Column name, seat and entry of every action channel.
fn action_names(seats: &[Seat]) -> Vec<(String, (usize, usize))> {
    let named = |(index, seat): (usize, &Seat)| {
        let seat_name = seat.name.clone();
        seat.action
            .names()
            .into_iter()
            .enumerate()
            .map(move |(entry, name)| (of_seat(&seat_name, &name), (index, entry)))
            .collect::<Vec<_>>()
    };
    seats.iter().enumerate().flat_map(named).collect()
}

/// Column name, seat and entry of what named seats observe.
fn observation_names(seats: &[Seat]) -> Vec<(String, (usize, usize))> {
    let named = seats.iter().enumerate().filter(|(_, seat)| !seat.name.is_empty());
    let entries = |(index, seat): (usize, &Seat)| {
        let name = seat.name.clone();
        (0..seat.observation.len()).map(move |entry| (of_seat(&name, &format!("obs_{entry}")), (index, entry)))
    };
    named.flat_map(entries).collect()
}

fn of_seat(seat: &str, name: &str) -> String {
    if seat.is_empty() { name.into() } else { format!("{seat}.{name}") }
}

/// Which columns a rollout has.
struct Columns {
    trace: Vec<String>,
    actions: Vec<(String, (usize, usize))>,
    rewards: Vec<String>,
    observations: Vec<(String, (usize, usize))>,
}

impl Columns {
    fn of(environment: &dyn Environment) -> Self {
        let trace: Vec<String> = environment.trace_channels().into_iter().map(|channel| channel.name).collect();
        let mut actions = action_names(environment.seats());
        actions.retain(|(name, _)| !trace.contains(name));
        let mut rewards: Vec<String> = environment.seats().iter().map(|seat| of_seat(&seat.name, "reward")).collect();
        rewards.retain(|name| !trace.contains(name));
        Self { trace, actions, rewards, observations: observation_names(environment.seats()) }
    }

    fn header(&self) -> Vec<String> {
        let actions = self.actions.iter().map(|(name, _)| name.clone());
        let trace = self.trace.iter().cloned();
        std::iter::once("decision".into())
            .chain(trace)
            .chain(actions)
            .chain(self.rewards.iter().cloned())
            .chain(self.observations.iter().map(|(name, _)| name.clone()))
            .chain(["end".into()])
            .collect()
    }

    fn row(
        &self,
        environment: &dyn Environment,
        seats: &[Vec<f64>],
        decision: u64,
        done: Option<(&Action, &Step)>,
    ) -> Vec<String> {
        let mut row = vec![decision.to_string()];
        row.extend(environment.trace().into_iter().map(cell));
        row.extend(
            self.actions.iter().map(|(_, (seat, entry))| done.map_or(String::new(), |(action, _)| cell(action[*seat][*entry]))),
        );
        row.extend((0..self.rewards.len()).map(|seat| done.map_or(String::new(), |(_, step)| cell(step.rewards[seat]))));
        row.extend(self.observations.iter().map(|(_, (seat, entry))| cell(seats[*seat][*entry])));
        row.push(end_word(done.and_then(|(_, step)| step.end)).into());
        row
    }
}

fn cell(value: f64) -> String {
    if value.is_nan() { String::new() } else { format!("{value}") }
}

fn end_word(end: Option<End>) -> &'static str {
    match end {
        None => "",
        Some(End::Terminated) => "terminated",
        Some(End::Truncated) => "truncated",
    }
}

fn csv_error(path: &Path, source: &csv::Error) -> Error {
    Error::Damaged { path: path.into(), problem: source.to_string() }
}
