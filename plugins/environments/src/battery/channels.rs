//! Names, units and typical values of a pack's observed and recorded quantities.

use super::load::LARGEST_W_PER_CELL;
use super::model::State;
use contract::{Channel, Metric, PerEpisode, Seat, Space};

/// Mean of max(U, 0.4) for a uniform U: the typical fraction of the largest demand.
const TYPICAL_PART: f64 = 0.58;
/// Typical deviation from that fraction.
const TYPICAL_DEVIATION: f64 = 0.22;

/// `prefix_1` to `prefix_N`.
pub fn numbered(prefix: &str, count: usize) -> Vec<String> {
    (1..=count).map(|number| format!("{prefix}_{number}")).collect()
}

fn per_cell(prefix: &str, unit: &str, cells: usize) -> Vec<Channel> {
    numbered(prefix, cells)
        .into_iter()
        .map(|name| Channel::new(name, unit))
        .collect()
}

/// The only seat: voltages, currents and the coming demand are observed, weights are the action.
pub fn seat(cells: usize) -> Seat {
    let largest_w = LARGEST_W_PER_CELL * cells as f64;
    let voltages = per_cell("voltage", "V", cells)
        .into_iter()
        .map(|channel| channel.typical(3.4, 0.2));
    let currents = per_cell("current", "A", cells)
        .into_iter()
        .map(|channel| channel.typical(2.5, 1.5));
    let demand =
        Channel::new("power_demand_w", "W").typical(TYPICAL_PART * largest_w, TYPICAL_DEVIATION * largest_w);
    Seat {
        name: String::new(),
        observation: Space::Box(voltages.chain(currents).chain([demand]).collect()),
        action: Space::Simplex(numbered("weight", cells)),
    }
}

/// Metrics of each step; with the bound where the pack has one.
pub fn metrics(has_bound: bool) -> Vec<Metric> {
    let mut metrics = vec![
        Metric::new("cycle_length", "", "decisions that the pack survived"),
        Metric::new(
            "voltage_spread_at_end_v",
            "V",
            "largest less smallest cell voltage at the end of the episode",
        )
        .lower_is_better()
        .per_episode(PerEpisode::Last),
        Metric::new("energy_j", "J", "energy delivered"),
    ];
    if has_bound {
        let about = "decisions that no controller can exceed from the same start with the same demands";
        metrics.push(Metric::new("cycle_length_bound", "", about).per_episode(PerEpisode::Last));
    }
    metrics
}

/// Channels of the full state, one block of N entries per quantity.
pub fn state(cells: usize) -> Vec<Channel> {
    let effective = per_cell("effective_voltage", "V", cells)
        .into_iter()
        .map(|channel| channel.typical(3.6, 0.2));
    let resistance = per_cell("resistance_ohm", "ohm", cells)
        .into_iter()
        .map(|channel| channel.typical(0.13, 0.03));
    let charge = per_cell("charge_c", "C", cells)
        .into_iter()
        .map(|channel| channel.typical(3500.0, 1500.0));
    effective.chain(resistance).chain(charge).collect()
}

/// Channels of a rollout; with the parameters only where they change.
pub fn trace(cells: usize, ageing: bool) -> Vec<Channel> {
    let mut channels = vec![Channel::new("t_s", "s"), Channel::new("power_w", "W")];
    channels.extend(per_cell("weight", "", cells));
    channels.extend(per_cell("voltage", "V", cells));
    channels.extend(per_cell("current", "A", cells));
    for number in 1..=cells {
        let entries = State::NAMES.iter().zip(State::UNITS);
        channels.extend(entries.map(|(name, unit)| Channel::new(format!("{name}_{number}"), unit)));
    }
    if ageing {
        for (name, unit) in [("q_mobile_c", "C"), ("r_ohm", "ohm"), ("t_diffusion", "s/m3")] {
            channels.extend(per_cell(name, unit, cells));
        }
    }
    channels
}
