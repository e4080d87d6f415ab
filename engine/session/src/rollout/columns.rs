//! The columns of a rollout and their values.

use contract::{Action, End, Environment, Seat, Step};

/// The columns of a rollout.
pub(super) struct Columns {
    trace: Vec<String>,
    actions: Vec<(String, (usize, usize))>,
    rewards: Vec<String>,
    observations: Vec<(String, (usize, usize))>,
}

impl Columns {
    /// The columns of an environment's rollouts.
    pub(super) fn of(environment: &dyn Environment) -> Self {
        let trace: Vec<String> = environment
            .trace_channels()
            .into_iter()
            .map(|channel| channel.name)
            .collect();
        let mut actions = action_names(environment.seats());
        actions.retain(|(name, _)| !trace.contains(name));
        let mut rewards: Vec<String> = environment
            .seats()
            .iter()
            .map(|seat| of_seat(&seat.name, "reward"))
            .collect();
        rewards.retain(|name| !trace.contains(name));
        Self {
            trace,
            actions,
            rewards,
            observations: observation_names(environment.seats()),
        }
    }

    /// Their names.
    pub(super) fn header(&self) -> Vec<String> {
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

    /// The row of the start; `None` if it would be empty, for example if every decision is a point by itself.
    pub(super) fn start(&self, environment: &dyn Environment, seats: &[Vec<f64>]) -> Option<Vec<String>> {
        let blank = !self.trace.is_empty() && environment.trace().iter().all(|value| value.is_nan());
        (!blank).then(|| self.row(environment, seats, 0, None))
    }

    /// The row after a decision, or of the start.
    pub(super) fn row(
        &self,
        environment: &dyn Environment,
        seats: &[Vec<f64>],
        decision: u64,
        done: Option<(&[Vec<f64>], &Step)>,
    ) -> Vec<String> {
        let mut row = vec![decision.to_string()];
        row.extend(environment.trace().into_iter().map(cell));
        row.extend(
            self.actions.iter().map(|(_, (seat, entry))| {
                done.map_or(String::new(), |(action, _)| cell(action[*seat][*entry]))
            }),
        );
        row.extend(
            (0..self.rewards.len())
                .map(|seat| done.map_or(String::new(), |(_, step)| cell(step.rewards[seat]))),
        );
        row.extend(
            self.observations
                .iter()
                .map(|(_, (seat, entry))| cell(seats[*seat][*entry])),
        );
        row.push(end_word(done.and_then(|(_, step)| step.end)).into());
        row
    }
}

/// Column name, seat and entry of every action channel.
pub(super) fn action_names(seats: &[Seat]) -> Vec<(String, (usize, usize))> {
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

/// An action of zeros.
pub(super) fn blank_action(seats: &[Seat]) -> Action {
    seats.iter().map(|seat| vec![0.0; seat.action.len()]).collect()
}

/// Column name, seat and entry of the observations of named seats.
fn observation_names(seats: &[Seat]) -> Vec<(String, (usize, usize))> {
    let named = seats.iter().enumerate().filter(|(_, seat)| !seat.name.is_empty());
    let entries = |(index, seat): (usize, &Seat)| {
        let name = seat.name.clone();
        (0..seat.observation.len())
            .map(move |entry| (of_seat(&name, &format!("obs_{entry}")), (index, entry)))
    };
    named.flat_map(entries).collect()
}

fn of_seat(seat: &str, name: &str) -> String {
    if seat.is_empty() {
        name.into()
    } else {
        format!("{seat}.{name}")
    }
}

fn cell(value: f64) -> String {
    if value.is_nan() {
        String::new()
    } else {
        format!("{value}")
    }
}

fn end_word(end: Option<End>) -> &'static str {
    match end {
        None => "",
        Some(End::Terminated) => "terminated",
        Some(End::Truncated) => "truncated",
    }
}
