//! Water filling: loads the assets so that all loaded ones end at one common terminal voltage.
//!
//! Each cell is seen as a source of voltage `e_i` behind a resistance `R_i`. The allocation that keeps the
//! lowest terminal voltage as high as possible brings all cells with `e_i > v` to one level `v`:
//!
//! `sum_i v max(e_i - v, 0) / R_i = P`,   `a_i = (max(e_i - v, 0) / R_i) / sum_j (max(e_j - v, 0) / R_j)`.
//!
//! Two agents share this rule. `water_filling` is a controller: it takes `e_i = V_i + R I_i` from
//! observations (`voltage_i`, `current_i`, `power_demand_w`) and one nominal resistance.
//! `water_filling_true_state` reads more: `effective_voltage_i` (equilibrium voltage less the surface
//! overpotentials) and `resistance_ohm_i` from the full state.
//!
//! Both are reference controllers, not bounds: their shares are good for each decision alone, and a policy
//! that looks ahead can live longer. The bound on all controllers is a metric of the environment, such as
//! `cycle_length_bound`.
//!
//! | symbol | here | unit |
//! |---|---|---|
//! | e_i | `source_v` | V |
//! | R_i | `resistance_ohm` | ohm |
//! | P | `power_w` | W |
//! | v | `level_v` | V |
//!
//! If two levels meet `P`, the higher one is taken, since it needs less current. If no level meets `P`, the
//! level of the greatest power is taken. The rule is myopic: it considers the present decision only. It
//! records nothing.

use crate::shared::{allocation::equal_shares, seat};
use contract::{Action, Agent, AgentTraits, Error, Interface, Mode, Observation, Registry, Rng};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const OBSERVED: &str = "water_filling";
const TRUE_STATE: &str = "water_filling_true_state";

/// Assumptions of the controller about the cells.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Ohmic resistance that every cell is assumed to have.
    #[schemars(range(min = 1e-6, max = 1e3), extend("x-unit" = "ohm",
        "x-source" = "fresh 18650 cell, Daigle and Kulkarni 2013"))]
    pub r_ohm: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self { r_ohm: 0.117_215 }
    }
}

impl contract::Config for Config {}

/// No parameters: the controller reads them from the full state.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TrueStateConfig {}

impl contract::Config for TrueStateConfig {}

/// Controller from observed channels.
#[derive(Debug, Clone)]
pub struct WaterFilling {
    voltages: Vec<usize>,
    currents: Vec<usize>,
    demand: usize,
    resistance_ohm: Vec<f64>,
}

/// Controller from the full state.
#[derive(Debug, Clone)]
pub struct WaterFillingTrueState {
    sources: Vec<usize>,
    resistances: Vec<usize>,
    demand: usize,
}

/// Registers the controller on observables.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "equal terminal voltages, from what is observed: a reference controller";
    registry.agent(OBSERVED, version, about, AgentTraits::default(), build);
}

/// Registers the controller on the full state.
pub(crate) fn register_true_state(registry: &mut Registry, version: u32) {
    let about = "equal terminal voltages, from the true state: a reference controller";
    registry.agent(
        TRUE_STATE,
        version,
        about,
        AgentTraits::default(),
        build_true_state,
    );
}

/// Builds the controller for one seat that observes `voltage_i`, `current_i` and `power_demand_w`.
///
/// # Errors
/// [`Error::Mismatch`] where a channel is missing or the action is not on a simplex.
fn build(config: Config, interface: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    let seat = seat::only_seat(OBSERVED, interface)?;
    let n_assets = seat::simplex(OBSERVED, seat)?.len();
    let channels = seat::observed(OBSERVED, seat)?;
    let suffixes = seat::assets(OBSERVED, channels, "voltage_", n_assets)?;
    Ok(Box::new(WaterFilling {
        voltages: seat::positions(OBSERVED, channels, "voltage_", &suffixes)?,
        currents: seat::positions(OBSERVED, channels, "current_", &suffixes)?,
        demand: seat::position(OBSERVED, channels, "power_demand_w")?,
        resistance_ohm: vec![config.r_ohm; n_assets],
    }))
}

/// Builds the controller for one seat that observes `power_demand_w` and a state with `effective_voltage_i`,
/// `resistance_ohm_i`.
///
/// # Errors
/// [`Error::Mismatch`] where a channel is missing or the action is not on a simplex.
fn build_true_state(_: TrueStateConfig, interface: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    let seat = seat::only_seat(TRUE_STATE, interface)?;
    let n_assets = seat::simplex(TRUE_STATE, seat)?.len();
    let suffixes = seat::assets(TRUE_STATE, &interface.state, "effective_voltage_", n_assets)?;
    Ok(Box::new(WaterFillingTrueState {
        sources: seat::positions(TRUE_STATE, &interface.state, "effective_voltage_", &suffixes)?,
        resistances: seat::positions(TRUE_STATE, &interface.state, "resistance_ohm_", &suffixes)?,
        demand: seat::position(TRUE_STATE, seat::observed(TRUE_STATE, seat)?, "power_demand_w")?,
    }))
}

impl Agent for WaterFilling {
    fn act(&mut self, observations: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        let allocate = |observation: &Observation| {
            let seen = &observation.seats[0];
            let cells = self.voltages.iter().zip(&self.currents).zip(&self.resistance_ohm);
            let source_v: Vec<f64> = cells.map(|((&v, &i), r)| seen[v] + r * seen[i]).collect();
            vec![shares(&source_v, &self.resistance_ohm, seen[self.demand])]
        };
        Ok(observations.iter().map(allocate).collect())
    }
}

impl Agent for WaterFillingTrueState {
    fn act(&mut self, observations: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        let allocate = |observation: &Observation| {
            let pick = |positions: &[usize]| {
                positions
                    .iter()
                    .map(|&at| observation.state[at])
                    .collect::<Vec<f64>>()
            };
            vec![shares(
                &pick(&self.sources),
                &pick(&self.resistances),
                observation.seats[0][self.demand],
            )]
        };
        Ok(observations.iter().map(allocate).collect())
    }

    fn reads_state(&self) -> bool {
        true
    }
}

/// Shares that bring all loaded cells to one terminal voltage; equal shares where nothing can or needs to be
/// delivered.
#[must_use]
pub fn shares(source_v: &[f64], resistance_ohm: &[f64], power_w: f64) -> Vec<f64> {
    let level_v = level(source_v, resistance_ohm, power_w);
    let currents: Vec<f64> = source_v
        .iter()
        .zip(resistance_ohm)
        .map(|(e, r)| (e - level_v).max(0.0) / r)
        .collect();
    let total: f64 = currents.iter().sum();
    if total > 0.0 && total.is_finite() {
        currents.into_iter().map(|current| current / total).collect()
    } else {
        equal_shares(source_v.len())
    }
}

/// The highest level `v` with `sum_i v max(e_i - v, 0) / R_i = P`, or the level of the greatest power if
/// there is none.
///
/// With the `k` cells of the highest `e_i` loaded, the power is the parabola `v (S - G v)` with `S = sum e_i
/// / R_i` and `G = sum 1 / R_i`, valid between `e_{k+1}` and `e_k`; the pieces are tried from the highest
/// level down.
fn level(source_v: &[f64], resistance_ohm: &[f64], power_w: f64) -> f64 {
    let mut order: Vec<usize> = (0..source_v.len()).filter(|&i| source_v[i] > 0.0).collect();
    order.sort_by(|&a, &b| source_v[b].total_cmp(&source_v[a]));
    let (mut s, mut g) = (0.0, 0.0);
    let (mut best_v, mut best_w) = (f64::INFINITY, 0.0);
    for (k, &i) in order.iter().enumerate() {
        s += source_v[i] / resistance_ohm[i];
        g += 1.0 / resistance_ohm[i];
        let floor_v = order.get(k + 1).map_or(0.0, |&next| source_v[next]);
        let discriminant = s * s - 4.0 * g * power_w;
        let root_v = (s + discriminant.max(0.0).sqrt()) / (2.0 * g);
        if discriminant >= 0.0 && root_v >= floor_v {
            return root_v;
        }
        let top_v = (s / (2.0 * g)).clamp(floor_v, source_v[i]);
        let top_w = top_v * (s - g * top_v);
        if top_w > best_w {
            (best_v, best_w) = (top_v, top_w);
        }
    }
    best_v
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::seat::tests::allocation;
    use proptest::prelude::*;

    fn close(a: &[f64], b: &[f64]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12)
    }

    #[test]
    fn equal_cells_share_equally() {
        assert!(close(&shares(&[3.7; 4], &[0.1; 4], 40.0), &[0.25; 4]));
    }

    #[test]
    fn two_cells_by_hand() {
        // Level 3 V: currents (4 - 3) / 0.5 = 2 A and (3.5 - 3) / 0.25 = 2 A, 12 W in all.
        assert!((level(&[4.0, 3.5], &[0.5, 0.25], 12.0) - 3.0).abs() < 1e-12);
        assert!(close(&shares(&[4.0, 3.5], &[0.5, 0.25], 12.0), &[0.5, 0.5]));
    }

    #[test]
    fn a_low_cell_rests() {
        // Level 3.6 V: (4 - 3.6) / 0.5 = 0.8 A of the first cell, 2.88 W; the second cell lies below the
        // level.
        assert!((level(&[4.0, 3.5], &[0.5, 0.25], 2.88) - 3.6).abs() < 1e-12);
        assert!(close(&shares(&[4.0, 3.5], &[0.5, 0.25], 2.88), &[1.0, 0.0]));
    }

    #[test]
    fn too_much_power_takes_the_level_of_the_greatest_power() {
        // One cell delivers e^2 / (4 R) = 8 W at most, at half its voltage.
        assert!((level(&[4.0], &[0.5], 100.0) - 2.0).abs() < 1e-12);
        // Two: S = 22, G = 6, greatest at S / 2G = 11/6 V.
        assert!((level(&[4.0, 3.5], &[0.5, 0.25], 1e3) - 11.0 / 6.0).abs() < 1e-12);
    }

    #[test]
    fn nothing_to_deliver_is_shared_equally() {
        assert_eq!(shares(&[4.0, 3.0], &[0.1, 0.1], 0.0), [0.5, 0.5]);
        assert_eq!(shares(&[-1.0, -2.0], &[0.1, 0.1], 5.0), [0.5, 0.5]);
    }

    #[test]
    fn both_agents_find_their_channels_by_name() {
        let mut rng = contract::random::stream(&["water"]);
        let observed = [
            "power_demand_w",
            "voltage_1",
            "voltage_2",
            "current_1",
            "current_2",
        ];
        let state = [
            "charge_1",
            "resistance_ohm_1",
            "effective_voltage_1",
            "effective_voltage_2",
            "resistance_ohm_2",
        ];
        let interface = allocation(&observed, &state, 2);
        // V + R I = 3.5 + 0.5 * 1 = 4 and 3.25 + 0.5 * 0.5 = 3.5; level 3 V: 2 A and 1 A, 9 W.
        let seen = Observation {
            seats: vec![vec![9.0, 3.5, 3.25, 1.0, 0.5]],
            state: vec![0.0, 0.5, 4.0, 3.5, 0.25],
        };
        let mut on_observables = build(Config { r_ohm: 0.5 }, &interface, &mut rng).unwrap();
        let action = on_observables
            .act(std::slice::from_ref(&seen), Mode::Evaluate, &mut rng)
            .unwrap();
        assert!(close(&action[0][0], &[2.0 / 3.0, 1.0 / 3.0]));
        let mut on_state = build_true_state(TrueStateConfig {}, &interface, &mut rng).unwrap();
        let twelve_watts = Observation {
            seats: vec![vec![12.0, 0.0, 0.0, 0.0, 0.0]],
            state: seen.state,
        };
        assert!(on_state.reads_state());
        assert!(close(
            &on_state.act(&[twelve_watts], Mode::Evaluate, &mut rng).unwrap()[0][0],
            &[0.5, 0.5]
        ));
        assert!(
            build(
                Config::default(),
                &allocation(&["voltage_1", "current_1"], &[], 1),
                &mut rng
            )
            .is_err()
        );
    }

    proptest! {
        #[test]
        fn the_level_meets_the_demand_and_shares_sum_to_one(
            cells in prop::collection::vec((2.5..4.2f64, 0.05..0.3f64), 1..9), per_cell_w in 0.1..12.0f64,
        ) {
            let (e, r): (Vec<f64>, Vec<f64>) = cells.into_iter().unzip();
            let power_w = per_cell_w * e.len() as f64;
            let v = level(&e, &r, power_w);
            let delivered = |v: f64| e.iter().zip(&r).map(|(e, r)| v * (e - v).max(0.0) / r).sum::<f64>();
            let greatest = (1..4200).map(|mv| delivered(f64::from(mv) * 1e-3)).fold(0.0, f64::max);
            if greatest >= power_w {
                prop_assert!((delivered(v) - power_w).abs() < 1e-9 * power_w);
                prop_assert!(delivered(v + 1e-3) < power_w + 1e-9);
            } else {
                prop_assert!(delivered(v) >= greatest * (1.0 - 1e-9));
            }
            prop_assert!((shares(&e, &r, power_w).iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
    }
}
