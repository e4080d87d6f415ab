//! A pack of lithium-ion cells in parallel: the action is the share of the load that each cell carries.
//!
//! Thesis, chapter 3. At each decision the pack demands a power P; the action is a vector of weights on the
//! simplex, and cell k delivers w_k P until the next decision. The episode terminates when a cell reaches its
//! end of discharge; the reward is 1 for every decision that the pack survives, so the return is the length
//! of the working cycle.
//!
//! | thesis | here                    | shape |
//! |--------|-------------------------|-------|
//! | a_t    | `weight_1..N`           | `[N]`, sums to 1 |
//! | V_t    | `voltage_1..N`, V       | `[N]` |
//! | I_t    | `current_1..N`, A       | `[N]`, current of the last step; at the start 8 W / V from a profile, else 0 |
//! | P_t    | `power_demand_w`, W     | demand of the coming decision |
//!
//! The current of cell k is w_k P / V_k with the voltage at the start of each step. A load given as a current
//! is shared by the weights directly; `power_demand_w` is then the current times the mean voltage. The trace's
//! `power_w` is the mean demand of the last decision.
//!
//! Each episode also has `cycle_length_bound`, an upper bound on the decisions of any controller from the same
//! start with the same demands (the module `life_bound`), where the pack has such a bound.
//!
//! Departures from the thesis, which leaves these open: the length of a decision, the initial states, the
//! parameters of aged cells and the initial currents; see the config for the values and their reasons. Surface
//! mole fractions keep a distance of 0.001 from 0 and 1 where the authors' public code has 0.01: the lives
//! under equal split and the rules of table 3.3 are the same, and the voltages of cells below 1.7 % charge are
//! right.

mod ageing;
mod cell;
mod channels;
mod config;
#[cfg(test)]
mod environment_tests;
mod ideal_cell;
mod life_bound;
#[cfg(test)]
mod life_bound_tests;
mod load;
mod model;
#[cfg(test)]
mod oracle_tests;
mod parameters;
mod start;

pub use ageing::AgeingRates;
pub use cell::Cell;
pub use config::{BatteryConfig, Cells, NamedPack};
pub use load::Load;
pub use model::{Model, Physics, State};
pub use parameters::CellParameters;
pub use start::Start;

use crate::simplex;
use contract::{Channel, End, Environment, Error, Metric, Rng, Seat, Step};
use life_bound::LifeBound;
use load::{Demand, LoadSource};
use rand::Rng as _;
use serde::{Deserialize, Serialize};
use start::InitialStates;

/// Half-widths of the process noise, in the order of [`State::NAMES`] (the authors' public code).
const PROCESS_NOISE: [f64; 8] = [0.0, 1e-10, 1e-10, 1e-10, 1e-3, 1e-5, 1e-3, 1e-5];
/// Half-width of the voltage sensors' noise, V (the authors' public code).
const SENSOR_NOISE_V: f64 = 1e-3;

/// The `battery` environment.
#[derive(Debug)]
pub struct Battery {
    config: BatteryConfig,
    steps_per_decision: usize,
    new_parameters: Vec<CellParameters>,
    load: LoadSource,
    starter: InitialStates,
    bound: Option<LifeBound>,
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    cells: Vec<Cell>,
    progress: Progress,
}

/// State of an episode besides the cells.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Progress {
    /// Steps of the simulator since the start of the episode.
    steps: u64,
    /// Decisions since the start of the episode.
    decisions: u64,
    /// Demand of the coming decision.
    demand: Demand,
    /// Weights of the last decision; `None` before the first.
    weights: Option<Vec<f64>>,
    /// Mean demand of the last decision, W.
    power_w: Option<f64>,
    /// Upper bound on the decisions of this episode, where there is one.
    bound: Option<u64>,
}

/// State of the environment in a checkpoint.
#[derive(Serialize, Deserialize)]
struct Snapshot {
    progress: Progress,
    cells: Vec<(CellParameters, State, f64)>,
}

/// Builds the environment; registered as `battery`.
///
/// # Errors
/// [`Error::Config`] where keys contradict each other, [`Error::File`] where a load file cannot be read.
pub fn build(config: BatteryConfig) -> Result<Box<dyn Environment>, Error> {
    Ok(Box::new(Battery::new(config)?))
}

impl Progress {
    /// The state before the first decision.
    fn at_start(demand: Demand) -> Self {
        Self {
            steps: 0,
            decisions: 0,
            demand,
            weights: None,
            power_w: None,
            bound: None,
        }
    }
}

impl Battery {
    /// A pack at its start; call `reset` before `step`.
    ///
    /// # Errors
    /// [`Error::Config`] where keys contradict each other, [`Error::File`] where a load file cannot be read.
    pub fn new(config: BatteryConfig) -> Result<Self, Error> {
        let new_parameters = config.parameters()?;
        let physics = Physics {
            thermal: config.thermal,
            mole_fraction_margin: config.mole_fraction_margin,
        };
        let count = new_parameters.len();
        let (steps_per_decision, load) = (
            config.steps_per_decision()?,
            LoadSource::new(&config.load, count)?,
        );
        let bound = LifeBound::new(&config, &new_parameters, &load, steps_per_decision);
        Ok(Self {
            steps_per_decision,
            load,
            starter: InitialStates::new(config.start.clone(), &new_parameters, physics)?,
            seats: vec![channels::seat(count)],
            metrics: channels::metrics(bound.is_some()),
            bound,
            cells: new_parameters
                .iter()
                .map(|parameters| Cell::new(*parameters, physics))
                .collect(),
            progress: Progress::at_start(Demand::Power(0.0)),
            new_parameters,
            config,
        })
    }

    /// The cells.
    #[must_use]
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    fn time_s(&self) -> f64 {
        self.progress.steps as f64 * self.config.step_s
    }

    /// Replaces each cell that is worn out by a new one.
    fn replace_worn_cells(&mut self) {
        let Some(ageing) = self.config.ageing else { return };
        let end_v = self.config.end_of_discharge_v;
        for (index, cell) in self.cells.iter_mut().enumerate() {
            let reaches_start = self.starter.renew(index, cell.parameters(), end_v);
            if ageing.has_ended(cell.parameters()) || !reaches_start {
                cell.set_parameters(self.new_parameters[index]);
                self.starter.renew(index, cell.parameters(), end_v);
            }
        }
    }

    /// Holds `weights` for one decision. Returns the mean demand, W, and the delivered energy, J.
    fn discharge(&mut self, weights: &[f64], rng: &mut Rng) -> (f64, f64) {
        let (mut power_w, mut energy_j) = (0.0, 0.0);
        for step in 0..self.steps_per_decision {
            let demand = self.load.within(self.progress.demand, self.time_s());
            let delivered_j = self.advance(weights, demand);
            let asked_w = if let Demand::Power(total_w) = demand {
                total_w
            } else {
                delivered_j / self.config.step_s
            };
            // This form of the mean returns a constant power without rounding.
            power_w += (asked_w - power_w) / (step + 1) as f64;
            energy_j += delivered_j;
            self.progress.steps += 1;
            if self.config.process_noise {
                self.disturb(rng);
            }
        }
        (power_w, energy_j)
    }

    /// Takes one step of the simulator; returns the energy that the cells delivered, J.
    fn advance(&mut self, weights: &[f64], demand: Demand) -> f64 {
        let step_s = self.config.step_s;
        let mut power_w = 0.0;
        for (cell, weight) in self.cells.iter_mut().zip(weights) {
            let before_v = cell.voltage_v();
            match demand {
                Demand::Power(total_w) => cell.draw_power(weight * total_w, step_s),
                Demand::Current(total_a) => cell.draw_current(weight * total_a, step_s),
            }
            power_w += before_v * cell.current_a();
            if let Some(ageing) = &self.config.ageing {
                cell.wear(ageing, step_s);
            }
        }
        power_w * step_s
    }

    /// Adds process noise to every state.
    fn disturb(&mut self, rng: &mut Rng) {
        for cell in &mut self.cells {
            let mut entries = cell.state().to_array();
            for (entry, half_width) in entries.iter_mut().zip(PROCESS_NOISE) {
                *entry += half_width * rng.random_range(-1.0..1.0);
            }
            cell.place(State::from_array(entries), cell.current_a());
        }
    }

    fn observe(&self, rng: &mut Rng) -> Vec<Vec<f64>> {
        let mut seen: Vec<f64> = self.cells.iter().map(Cell::voltage_v).collect();
        seen.iter_mut()
            .for_each(|voltage_v| *voltage_v += self.sensor_error_v(rng));
        seen.extend(self.cells.iter().map(Cell::current_a));
        seen.push(self.demand_w());
        vec![seen]
    }

    /// Error of the next reading of a voltage, V.
    fn sensor_error_v(&self, rng: &mut Rng) -> f64 {
        if self.config.sensor_noise {
            SENSOR_NOISE_V * rng.random_range(-1.0..1.0)
        } else {
            0.0
        }
    }

    /// Demands of the decisions of the beginning episode, W, as later steps will draw them: where the pack has
    /// a bound, the draws do not depend on actions.
    fn demands_to_come(&self, mut rng: Rng) -> impl Iterator<Item = f64> + '_ {
        let next = move |_: &f64| {
            let demand = self.load.draw(0.0, &mut rng);
            for _ in &self.cells {
                let _ = self.sensor_error_v(&mut rng);
            }
            demand.power_w()
        };
        std::iter::successors(self.progress.demand.power_w(), next)
    }

    /// The coming demand as a power, W.
    fn demand_w(&self) -> f64 {
        match self.progress.demand {
            Demand::Power(power_w) => power_w,
            Demand::Current(current_a) => {
                current_a * self.cells.iter().map(Cell::voltage_v).sum::<f64>() / self.cells.len() as f64
            }
        }
    }

    /// Smallest and largest cell voltage, V.
    fn voltage_range(&self) -> (f64, f64) {
        let range = (f64::INFINITY, f64::NEG_INFINITY);
        self.cells
            .iter()
            .map(Cell::voltage_v)
            .fold(range, |(low, high), voltage_v| {
                (low.min(voltage_v), high.max(voltage_v))
            })
    }

    fn end(&self, lowest_v: f64) -> Option<End> {
        if lowest_v <= self.config.end_of_discharge_v {
            return Some(End::Terminated);
        }
        let limit = self.config.episode_limit?;
        (self.progress.decisions >= limit).then_some(End::Truncated)
    }

    fn check_finite(&self) -> Result<(), Error> {
        match self.cells.iter().position(|cell| !cell.voltage_v().is_finite()) {
            None => Ok(()),
            Some(index) => {
                let problem = format!(
                    "the voltage of cell {} is not finite at {} s",
                    index + 1,
                    self.time_s()
                );
                Err(Error::Model {
                    model: "battery",
                    problem,
                })
            }
        }
    }
}

impl Environment for Battery {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    fn reset(&mut self, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        self.replace_worn_cells();
        self.starter.place(&mut self.cells, rng);
        let demand = self.load.draw(0.0, rng);
        self.progress = Progress::at_start(demand);
        self.check_finite()?;
        let observation = self.observe(rng);
        let bound = self.bound.as_ref();
        self.progress.bound =
            bound.map(|bound| bound.decisions(&self.cells, self.demands_to_come(rng.clone())));
        Ok(observation)
    }

    fn step(&mut self, actions: &[Vec<f64>], rng: &mut Rng) -> Result<Step, Error> {
        let weights = simplex::checked(actions, self.cells.len(), self.config.weight_sum_tolerance)?;
        let (power_w, energy_j) = self.discharge(&weights, rng);
        self.progress.decisions += 1;
        self.check_finite()?;
        let (lowest_v, highest_v) = self.voltage_range();
        let end = self.end(lowest_v);
        let reward = if end == Some(End::Terminated) { 0.0 } else { 1.0 };
        self.progress.power_w = Some(power_w);
        self.progress.weights = Some(weights);
        self.progress.demand = self.load.draw(self.time_s(), rng);
        let bound = self.progress.bound.map(|decisions| decisions as f64);
        Ok(Step::new(self.observe(rng), vec![reward], end)
            .record("cycle_length", reward)
            .record("voltage_spread_at_end_v", highest_v - lowest_v)
            .record("energy_j", energy_j)
            .record_all(bound.map(|decisions| ("cycle_length_bound", decisions))))
    }

    fn state_channels(&self) -> Vec<Channel> {
        channels::state(self.cells.len())
    }

    fn state(&self) -> Vec<f64> {
        let effective = self.cells.iter().map(Cell::effective_voltage_v);
        let resistance = self.cells.iter().map(|cell| cell.parameters().r_ohm);
        effective
            .chain(resistance)
            .chain(self.cells.iter().map(|cell| cell.state().charge_c()))
            .collect()
    }

    fn trace_channels(&self) -> Vec<Channel> {
        channels::trace(self.cells.len(), self.config.ageing.is_some())
    }

    fn trace(&self) -> Vec<f64> {
        let mut row = vec![self.time_s(), self.progress.power_w.unwrap_or(f64::NAN)];
        match &self.progress.weights {
            Some(weights) => row.extend(weights),
            None => row.extend(self.cells.iter().map(|_| f64::NAN)),
        }
        row.extend(self.cells.iter().map(Cell::voltage_v));
        row.extend(self.cells.iter().map(Cell::current_a));
        row.extend(self.cells.iter().flat_map(|cell| cell.state().to_array()));
        if self.config.ageing.is_some() {
            row.extend(self.cells.iter().map(|cell| cell.parameters().q_mobile_c));
            row.extend(self.cells.iter().map(|cell| cell.parameters().r_ohm));
            row.extend(self.cells.iter().map(|cell| cell.parameters().t_diffusion));
        }
        row
    }

    fn snapshot(&self) -> serde_json::Value {
        let cells = self
            .cells
            .iter()
            .map(|cell| (*cell.parameters(), *cell.state(), cell.current_a()))
            .collect();
        let snapshot = Snapshot {
            progress: self.progress.clone(),
            cells,
        };
        // Plain structs of numbers: serde_json refuses only maps whose keys are no strings.
        serde_json::to_value(snapshot).expect("a snapshot serialises")
    }

    fn restore(&mut self, snapshot: &serde_json::Value) -> Result<(), Error> {
        let misfit = |problem: String| Error::Checkpoint {
            what: "battery",
            problem,
        };
        let Snapshot { progress, cells } =
            Snapshot::deserialize(snapshot).map_err(|source| misfit(source.to_string()))?;
        if cells.len() != self.cells.len() {
            return Err(misfit(format!(
                "{} cells stored, {} configured",
                cells.len(),
                self.cells.len()
            )));
        }
        for (cell, (parameters, state, current_a)) in self.cells.iter_mut().zip(cells) {
            cell.set_parameters(parameters);
            cell.place(state, current_a);
        }
        self.progress = progress;
        Ok(())
    }
}
