//! Initial states of episodes.
//!
//! Most starts are points of a *profile*: the discharge of one cell from full at a constant 8 W, one state per
//! second. States from an operating discharge give cells the overpotentials of a cell at work.

use super::cell::Cell;
use super::model::{Model, Physics, State};
use super::parameters::CellParameters;
use contract::{Error, Rng};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Load of a profile, W.
pub const PROFILE_W: f64 = 8.0;
/// A profile has at most this many steps of one second, and ends where the voltage falls below
/// [`PROFILE_END_V`].
const PROFILE_STEPS: usize = 3150;
/// Voltage that ends a profile, V.
const PROFILE_END_V: f64 = 2.7;

/// The state of each cell at the start of an episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Start {
    /// Full and rested.
    Full,
    /// One index per cell: the second of that cell's own 8 W discharge from full.
    ProfileIndex(Vec<usize>),
    /// Each cell at a second of its own 8 W discharge from full, drawn independently and uniformly from
    /// [first, past the last).
    ProfileRange([usize; 2]),
    /// One state of charge per cell, in [0, 1]; rested.
    StateOfCharge(#[schemars(inner(range(min = 0.0, max = 1.0)))] Vec<f64>),
    /// Eight entries per cell: tb (K), Vo, Vsn, Vsp (V), qnB, qnS, qpB, qpS (C).
    States(Vec<[f64; 8]>),
}

impl Default for Start {
    fn default() -> Self {
        Self::ProfileRange([500, 2000])
    }
}

impl Start {
    /// The config key of a start from a profile and the largest index that cell `cell` can get from it.
    fn last_index(&self, cell: usize) -> Option<(&'static str, usize)> {
        match self {
            Start::ProfileIndex(indices) => Some(("start.profile_index", indices[cell])),
            Start::ProfileRange([_, end]) => Some(("start.profile_range", end - 1)),
            Start::Full | Start::StateOfCharge(_) | Start::States(_) => None,
        }
    }
}

/// The initial states of a config, with the profiles that they need.
#[derive(Debug, Clone)]
pub struct InitialStates {
    start: Start,
    physics: Physics,
    profiles: Vec<Arc<[State]>>,
}

impl InitialStates {
    /// Prepares `start` for cells with `parameters`.
    ///
    /// # Errors
    /// [`Error::Config`] where a list does not have one entry per cell or an index lies outside a profile.
    pub fn new(start: Start, parameters: &[CellParameters], physics: Physics) -> Result<Self, Error> {
        check_length(&start, parameters.len())?;
        let profiles = if start.last_index(0).is_some() {
            profiles(parameters, physics)
        } else {
            Vec::new()
        };
        for (cell, profile) in profiles.iter().enumerate() {
            if let Some((key, last)) = start.last_index(cell).filter(|(_, last)| *last >= profile.len()) {
                let (number, seconds) = (cell + 1, profile.len() - 1);
                return Err(Error::config(
                    key,
                    format!("index {last} is too large: the profile of cell {number} ends at {seconds}"),
                ));
            }
        }
        Ok(Self {
            start,
            physics,
            profiles,
        })
    }

    /// Computes the profile of cell `cell` for worn parameters. Returns `false` where one of its starts now
    /// lies at or below `end_of_discharge_v`.
    pub fn renew(&mut self, cell: usize, parameters: &CellParameters, end_of_discharge_v: f64) -> bool {
        let Some((_, last)) = self.start.last_index(cell) else {
            return true;
        };
        self.profiles[cell] = profile(parameters, self.physics);
        let model = Model::new(parameters, self.physics);
        self.profiles[cell]
            .get(last)
            .is_some_and(|state| model.voltage(state) > end_of_discharge_v)
    }

    /// Puts every cell into its initial state. A cell from a profile has the profile's current at that state, 8
    /// W / V, others have none.
    pub fn place(&self, cells: &mut [Cell], rng: &mut Rng) {
        for (index, cell) in cells.iter_mut().enumerate() {
            let rested = |charge: f64, cell: &Cell| State::rested(cell.parameters(), charge);
            match &self.start {
                Start::Full => cell.place(rested(1.0, cell), 0.0),
                Start::StateOfCharge(charges) => cell.place(rested(charges[index], cell), 0.0),
                Start::States(states) => cell.place(State::from_array(states[index]), 0.0),
                Start::ProfileIndex(indices) => place_loaded(cell, self.profiles[index][indices[index]]),
                Start::ProfileRange([begin, end]) => {
                    place_loaded(
                        cell,
                        self.profiles[index][rng.random_range(*begin as u32..*end as u32) as usize],
                    );
                }
            }
        }
    }
}

fn place_loaded(cell: &mut Cell, state: State) {
    cell.place(state, 0.0);
    cell.place(state, PROFILE_W / cell.voltage_v());
}

/// One profile per cell; equal cells share theirs.
fn profiles(parameters: &[CellParameters], physics: Physics) -> Vec<Arc<[State]>> {
    let mut made: Vec<(CellParameters, Arc<[State]>)> = Vec::new();
    for one in parameters {
        if !made.iter().any(|(known, _)| known == one) {
            made.push((*one, profile(one, physics)));
        }
    }
    let find = |one| {
        made.iter()
            .find(|(known, _)| known == one)
            .map(|(_, profile)| profile.clone())
    };
    parameters.iter().filter_map(find).collect()
}

/// The discharge of a full cell at 8 W, one state per second, independent of the environment's step size.
fn profile(parameters: &CellParameters, physics: Physics) -> Arc<[State]> {
    let mut cell = Cell::new(*parameters, physics);
    let mut states = vec![*cell.state()];
    while states.len() <= PROFILE_STEPS && cell.voltage_v() >= PROFILE_END_V {
        cell.draw_power(PROFILE_W, 1.0);
        states.push(*cell.state());
    }
    states.into()
}

fn check_length(start: &Start, cells: usize) -> Result<(), Error> {
    let (key, entries) = match start {
        Start::Full => return Ok(()),
        Start::ProfileRange([begin, end]) if begin >= end => {
            return Err(Error::config(
                "start.profile_range",
                format!("[{begin}, {end}) is empty"),
            ));
        }
        Start::ProfileRange([_, end]) if *end > PROFILE_STEPS + 1 => {
            return Err(Error::config(
                "start.profile_range",
                format!("{end} is too large: a profile has {PROFILE_STEPS} steps"),
            ));
        }
        Start::ProfileRange(_) => return Ok(()),
        Start::ProfileIndex(indices) => ("start.profile_index", indices.len()),
        Start::StateOfCharge(charges) => ("start.state_of_charge", charges.len()),
        Start::States(states) => ("start.states", states.len()),
    };
    if entries == cells {
        return Ok(());
    }
    Err(Error::config(
        key,
        format!("has {entries} entries for {cells} cells; write one per cell"),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PHYSICS: Physics = Physics {
        thermal: false,
        mole_fraction_margin: 1e-3,
    };

    #[test]
    fn indices_stay_in_their_range_and_differ_between_cells() {
        let parameters = [CellParameters::FRESH; 3];
        let starter = InitialStates::new(Start::ProfileRange([500, 503]), &parameters, PHYSICS).unwrap();
        let mut cells = parameters.map(|one| Cell::new(one, PHYSICS));
        let mut rng = contract::random::stream(&["start"]);
        let mut seen = [[false; 3]; 3];
        for _ in 0..100 {
            starter.place(&mut cells, &mut rng);
            for (cell, seen) in cells.iter().zip(&mut seen) {
                let index = (500..503)
                    .position(|index| starter.profiles[0][index] == *cell.state())
                    .unwrap();
                seen[index] = true;
                assert_eq!(cell.current_a(), PROFILE_W / cell.voltage_v());
            }
        }
        assert_eq!(seen, [[true; 3]; 3]);
    }

    #[test]
    fn lists_need_one_entry_per_cell() {
        for start in [
            Start::ProfileIndex(vec![1]),
            Start::StateOfCharge(vec![1.0; 3]),
            Start::States(vec![[0.0; 8]; 5]),
            Start::ProfileRange([7, 7]),
            Start::ProfileRange([7, 9000]),
        ] {
            assert!(matches!(
                InitialStates::new(start, &[CellParameters::FRESH; 4], PHYSICS),
                Err(Error::Config { .. })
            ));
        }
    }

    #[test]
    fn an_index_past_the_profile_names_the_cell() {
        let parameters = [CellParameters::FRESH, CellParameters::aged(4000.0, 0.2)];
        let error = InitialStates::new(Start::ProfileRange([500, 2000]), &parameters, PHYSICS)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("`start.profile_range`: index 1999 is too large: the profile of cell 2 ends at"),
            "{error}"
        );
    }
}
