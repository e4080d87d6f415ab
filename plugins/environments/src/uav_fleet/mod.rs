//! A fleet of UAVs whose batteries degrade differently: calibration, load allocation, flight planning and maintenance
//! in one system.
//!
//! Thesis, section 6.5, names this task and leaves it open: "the different degradation states can be calibrated", the
//! allocation of the load "can prolong the working cycle", "the maintenance should take the overall availability of the
//! entire fleet and the maintenance cost into account", and "for each flight, the trajectory can be optimized".
//! Here the environments of its chapters are joined. Everything about the fleet itself (costs, tolerances,
//! missions) is this project's own choice.
//!
//! A seat is a UAV, a step a day. On each day a fleet of n UAVs has the missions of `required` of them to fly.
//! A seat chooses to do nothing, to replace the worst string of its pack, or all four; a UAV under maintenance
//! stays on the ground for the day. The flying UAVs share the way evenly, at most one whole mission each. So a
//! UAV on the ground increases the load of the others, and one that flies on with worn cells may run empty: the
//! mission is lost, the pack is lost, and the UAV is repaired on the next day.
//!
//! | module of the thesis | here | its simple counterpart |
//! |---|---|---|
//! | calibration (ch. 2) | an extended Kalman filter on the voltages of each flight ([`calibration`]) | the wear of an average string by the counted charge |
//! | allocation (ch. 3) | water filling on the known health, or a Dirichlet policy learned in `battery`
//! ([`allocation`]) | an equal split |
//! | coordination (ch. 4) | the agent: learners of joint values on these seats | learners on their own, or a rule per UAV |
//! | trajectory (ch. 5) | the plan that a search found in `flight_planning`, or the best one | 15 m/s over ground, as autopilots hold it |
//!
//! | symbol | here | range |
//! |---|---|---|
//! | m | UAVs that fly on a day | 0 to n |
//! | x = min(1, required / m) | part of a mission that each of them flies | (0, 1] |
//! | f | UAVs that run empty | 0 to m |
//! | r = x (m - f) / required - c_s N_s - c_o O - c_f f | reward, the same for all seats | |
//! | N_s, O | strings replaced (also after f), 1 on a day with a replacement by choice | |
//!
//! The counterpart of calibration does not assume new cells: the charge that a string has passed is counted on
//! every UAV, and a rule that ignored it would be a straw man. Calibration adds the differences between
//! strings: each UAV wears its strings by a factor (`uav_spread`), each string by another one (`wear_spread`),
//! and new ones differ (`new_spread`), all of which are hidden.
//!
//! The wind of a day is a factor, uniform between 0.5 and 1.5, times the mean wind, for which plans are made;
//! airspeeds and heights stay as planned. Flights begin full. A pack has four strings of `cells_in_series`
//! cells that are alike within a string; each is simulated as one cell of [`battery`](crate::battery), with its
//! wear ([`flight`]).
//!
//! A seat observes the known health of its own strings, a summary of that of the other UAVs, and the time. The
//! full state also has the true health. Rules read `<seat>.worst_resistance_ohm`, `<seat>.mean_resistance_ohm`
//! and `<seat>.most_charge_c` of the full state, which are known values. All random numbers of a day are drawn
//! whatever the choices, so that all policies and all modules have the same winds, new strings and (flight by
//! flight) noise.
//!
//! `bound`: all missions of a day earn 1 and there is no other reward, so that no return exceeds the number of
//! days.

pub mod allocation;
pub mod calibration;
mod channels;
pub mod config;
pub mod flight;
pub mod string;
#[cfg(test)]
mod tests;
pub mod uav;

pub use config::UavFleetConfig;

use crate::{
    choices,
    flight_planning::{self, mission::Course, optimum::optimum},
};
use allocation::SharingRule;
use config::{Modules, Planner};
use contract::{Channel, Designs, End, Environment, Error, Metric, Rng, Seat, Step};
use rand::{Rng as _, RngCore, SeedableRng};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use string::{CellString, STRINGS};
use uav::Uav;

/// The `uav_fleet` environment.
#[derive(Debug)]
pub struct UavFleet {
    config: UavFleetConfig,
    sharing: SharingRule,
    plan: Arc<[Course]>,
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    progress: Progress,
}

/// State of an episode.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct Progress {
    day: usize,
    uavs: Vec<Uav>,
}

/// Maintenance of a UAV on a day.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Maintenance {
    Nothing,
    ReplaceWorst,
    ReplaceAll,
}

/// Results of a day.
#[derive(Debug, Clone, Copy, Default)]
struct DayResult {
    missions: f64,
    failures: f64,
    replaced: f64,
    call_outs: f64,
    on_ground: f64,
    energy_j: f64,
}

/// Builds the environment; registered as `uav_fleet`.
///
/// # Errors
/// Errors of [`UavFleetConfig::check`], and of reading a policy or a plan of another trial.
pub fn build(config: UavFleetConfig) -> Result<Box<dyn Environment>, Error> {
    Ok(Box::new(UavFleet::new(config)?))
}

impl UavFleet {
    fn new(config: UavFleetConfig) -> Result<Self, Error> {
        config.check()?;
        let sharing = match config.modules {
            Modules::WithoutAllocation | Modules::Without => SharingRule::Equal,
            Modules::Informed => SharingRule::True,
            Modules::Full | Modules::WithoutCalibration | Modules::WithoutPlanning => {
                SharingRule::of(&config.allocation)?
            }
        };
        Ok(Self {
            sharing,
            plan: plan(&config)?.into(),
            seats: channels::seats(&config),
            metrics: channels::metrics(),
            progress: Progress::default(),
            config,
        })
    }

    fn observe(&self) -> Vec<Vec<f64>> {
        let time = self.progress.day as f64 / self.config.horizon as f64;
        channels::observe(&self.progress.uavs, time)
    }

    /// Runs a day: the chosen maintenance is carried out, and the other UAVs fly.
    fn pass(&mut self, works: &[Maintenance], strength: f64, draws: &mut [Rng]) -> DayResult {
        let new: Vec<[CellString; STRINGS]> = draws
            .iter_mut()
            .zip(&self.progress.uavs)
            .map(|(rng, uav)| self.new_strings(uav.wear_factor, rng))
            .collect();
        let mut day = DayResult::default();
        let flying: Vec<bool> = (0..works.len())
            .map(|uav| !self.keep_on_ground(uav, works[uav], &new[uav], &mut day))
            .collect();
        let n_flying = flying.iter().filter(|flies| **flies).count();
        let required = self.config.required as f64;
        let share = (required / n_flying.max(1) as f64).min(1.0);
        let segments = self.config.mission.segments(&self.plan, strength, share);
        for (uav, _) in flying.iter().enumerate().filter(|(_, flies)| **flies) {
            let strings = &mut self.progress.uavs[uav].strings;
            let flight = flight::fly(&self.config, &self.sharing, strings, &segments, &mut draws[uav]);
            day.energy_j += flight.energy_j;
            if flight.is_whole {
                day.missions += share / required;
                self.learn(uav, &flight);
            } else {
                day.failures += 1.0;
                self.recover(uav, &new[uav], &mut day);
            }
        }
        day
    }

    fn new_strings(&self, uav_factor: f64, rng: &mut Rng) -> [CellString; STRINGS] {
        let new = std::array::from_fn(|_| CellString::new(&self.config, uav_factor, rng));
        if self.config.modules == Modules::Informed {
            new.map(informed)
        } else {
            new
        }
    }

    /// Whether a UAV stays on the ground: it is repaired after it ran empty, or under maintenance by choice.
    fn keep_on_ground(
        &mut self,
        uav: usize,
        work: Maintenance,
        new: &[CellString; STRINGS],
        day: &mut DayResult,
    ) -> bool {
        let one = &mut self.progress.uavs[uav];
        if one.grounded {
            one.grounded = false;
        } else {
            let order = one.by_resistance();
            let which = match work {
                Maintenance::Nothing => return false,
                Maintenance::ReplaceWorst => &order[..1],
                Maintenance::ReplaceAll => &order[..],
            };
            one.replace(which, new);
            day.replaced += which.len() as f64;
            day.call_outs = 1.0;
        }
        day.on_ground += 1.0;
        true
    }

    /// Updates a UAV's knowledge of its strings after a flight.
    fn learn(&mut self, uav: usize, flight: &flight::Flight) {
        let (config, uav) = (&self.config, &mut self.progress.uavs[uav]);
        let counts_only = matches!(config.modules, Modules::WithoutCalibration | Modules::Without);
        for (at, string) in uav.strings.iter_mut().enumerate() {
            if !counts_only && config.modules != Modules::Informed {
                string.known.correct(config, &flight.log, at);
            }
            string.pass(config, flight.charge_c[at]);
            if config.modules == Modules::Informed {
                *string = informed(*string);
            }
        }
    }

    /// Gives a UAV that ran empty a new pack and grounds it for the next day.
    fn recover(&mut self, uav: usize, new: &[CellString; STRINGS], day: &mut DayResult) {
        let uav = &mut self.progress.uavs[uav];
        uav.replace(&[0, 1, 2, 3], new);
        uav.grounded = true;
        day.replaced += STRINGS as f64;
    }

    fn cost(&self, day: &DayResult) -> f64 {
        let UavFleetConfig {
            string_cost,
            call_out_cost,
            failure_cost,
            ..
        } = self.config;
        string_cost * day.replaced + call_out_cost * day.call_outs + failure_cost * day.failures
    }

    /// One value per metric.
    fn recorded(&self, day: &DayResult) -> [(&'static str, f64); 9] {
        let uavs = &self.progress.uavs;
        let squares: f64 = uavs.iter().map(Uav::squared_error).sum();
        let error = (squares / (uavs.len() * STRINGS) as f64).sqrt();
        [
            ("missions", day.missions),
            ("cost", self.cost(day)),
            ("failures", day.failures),
            ("replaced_strings", day.replaced),
            ("call_outs", day.call_outs),
            ("days_on_ground", day.on_ground),
            ("energy_kj", day.energy_j / 1000.0),
            ("resistance_error_ohm", error),
            ("bound", 1.0),
        ]
    }
}

/// The plan that is flown every day.
fn plan(config: &UavFleetConfig) -> Result<Vec<Course>, Error> {
    match (config.modules, &config.planning) {
        (Modules::WithoutPlanning | Modules::Without, _) => Ok(config.mission.constant_plan()),
        (Modules::Informed, _) | (_, Planner::Optimum) => Ok(optimum(&config.mission)),
        (_, Planner::Found(product)) => {
            let designs = Designs::read(product.folder()?)?.designs;
            let Some(best) = designs.first() else {
                // In a rehearsal the search has left no plan yet.
                return Ok(config.mission.constant_plan());
            };
            if best.actions.len() != config.mission.legs.len() {
                let (found, legs) = (best.actions.len(), config.mission.legs.len());
                let problem = format!("the search planned {found} legs, the mission has {legs}");
                return Err(Error::config("planning.found", problem));
            }
            best.actions
                .iter()
                .map(|action| flight_planning::course(action))
                .collect()
        }
    }
}

/// The string with its true health as the known one.
fn informed(string: CellString) -> CellString {
    let mut string = string;
    string.known.q_mobile_c = string.parameters.q_mobile_c;
    string.known.r_ohm = string.parameters.r_ohm;
    string
}

impl Maintenance {
    const ALL: [Self; 3] = [Self::Nothing, Self::ReplaceWorst, Self::ReplaceAll];
}

impl Environment for UavFleet {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    fn reset(&mut self, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        let mut uavs: Vec<Uav> = (0..self.config.uavs)
            .map(|_| Uav::used(&self.config, rng))
            .collect();
        if self.config.modules == Modules::Informed {
            for uav in &mut uavs {
                uav.strings = uav.strings.map(informed);
            }
        }
        self.progress = Progress { day: 0, uavs };
        Ok(self.observe())
    }

    fn step(&mut self, actions: &[Vec<f64>], rng: &mut Rng) -> Result<Step, Error> {
        let chosen = choices::taken(&self.seats, actions)?;
        let works: Vec<Maintenance> = chosen
            .into_iter()
            .map(|choice| Maintenance::ALL[choice])
            .collect();
        let strength =
            2.0 - config::STRONGEST_WIND + 2.0 * (config::STRONGEST_WIND - 1.0) * rng.random::<f64>();
        let mut draws: Vec<Rng> = works.iter().map(|_| Rng::seed_from_u64(rng.next_u64())).collect();
        let day = self.pass(&works, strength, &mut draws);
        self.progress.day += 1;
        let reward = day.missions - self.cost(&day);
        let end = (self.progress.day >= self.config.horizon).then_some(End::Terminated);
        let step = Step::new(self.observe(), vec![reward; works.len()], end);
        Ok(step.record_all(self.recorded(&day)))
    }

    fn state_channels(&self) -> Vec<Channel> {
        channels::state_channels(&self.config)
    }

    fn state(&self) -> Vec<f64> {
        channels::state(&self.progress.uavs, self.progress.day)
    }

    fn trace_channels(&self) -> Vec<Channel> {
        self.state_channels()
            .into_iter()
            .map(|channel| {
                let is_day = channel.name == "step";
                let name = if is_day { "t".into() } else { channel.name };
                Channel { name, ..channel }
            })
            .collect()
    }

    fn trace(&self) -> Vec<f64> {
        self.state()
    }

    fn snapshot(&self) -> serde_json::Value {
        // Plain structs of numbers: serde_json refuses only maps whose keys are no strings.
        serde_json::to_value(&self.progress).expect("a snapshot serialises")
    }

    fn restore(&mut self, snapshot: &serde_json::Value) -> Result<(), Error> {
        let misfit = |problem: String| Error::Checkpoint {
            what: "uav_fleet",
            problem,
        };
        let progress = Progress::deserialize(snapshot).map_err(|source| misfit(source.to_string()))?;
        let (stored, configured) = (progress.uavs.len(), self.config.uavs);
        if stored != configured {
            return Err(misfit(format!("{stored} UAVs stored, {configured} configured")));
        }
        self.progress = progress;
        Ok(())
    }
}
