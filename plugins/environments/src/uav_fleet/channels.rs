//! Names, units and typical values of a fleet's observed and recorded quantities.

use super::UavFleetConfig;
use super::string::STRINGS;
use super::uav::Uav;
use contract::{Channel, Metric, PerEpisode, Seat, Space};

/// Maintenance of a UAV on a day, by its position.
pub const CHOICES: [&str; 3] = ["nothing", "replace_worst", "replace_all"];

pub fn name(uav: usize) -> String {
    format!("uav_{uav}")
}

fn resistance(name: impl Into<String>) -> Channel {
    Channel::new(name, "ohm").within(0.0, 10.0).typical(0.16, 0.03)
}

fn capacity(name: impl Into<String>) -> Channel {
    Channel::new(name, "C").within(-1e5, 1e5).typical(7200.0, 300.0)
}

fn passed(name: impl Into<String>) -> Channel {
    Channel::new(name, "C")
        .within(0.0, 1e9)
        .typical(40_000.0, 25_000.0)
}

fn grounded(name: impl Into<String>) -> Channel {
    Channel::new(name, "").within(0.0, 1.0).typical(0.0, 0.3)
}

/// Channels of a seat's own UAV: known resistances and capacities, the worst first, and the largest charge.
fn of_own() -> Vec<Channel> {
    let each = |of: fn(String) -> Channel, what: &'static str| {
        (1..=STRINGS).map(move |rank| of(format!("{what}_{rank}")))
    };
    each(resistance, "known_resistance_ohm")
        .chain(each(capacity, "known_capacity_c"))
        .chain([passed("most_charge_c"), grounded("grounded")])
        .collect()
}

/// Channels of another UAV, which are also part of the full state, where rules read them.
fn summary(prefix: &str) -> Vec<Channel> {
    let named = |name: &str| format!("{prefix}{name}");
    vec![
        resistance(named("worst_resistance_ohm")),
        resistance(named("mean_resistance_ohm")),
        passed(named("most_charge_c")),
        grounded(named("grounded")),
    ]
}

/// The seats: their own UAV, the others in turn, the elapsed fraction of the episode.
pub fn seats(config: &UavFleetConfig) -> Vec<Seat> {
    let others = (1..config.uavs).flat_map(|next| summary(&format!("next_{next}.")));
    let time = Channel::new("time", "").within(0.0, 1.0).typical(0.5, 0.3);
    let observation: Vec<Channel> = of_own().into_iter().chain(others).chain([time]).collect();
    let seat = |uav: usize| Seat {
        name: name(uav),
        observation: Space::Box(observation.clone()),
        action: Space::Discrete(CHOICES.map(Into::into).to_vec()),
    };
    (0..config.uavs).map(seat).collect()
}

/// Observations, one vector per seat.
pub fn observe(uavs: &[Uav], time: f64) -> Vec<Vec<f64>> {
    let one = |at: usize| {
        let own = &uavs[at];
        let ranked = own.by_resistance();
        let known = |of: fn(&super::calibration::Estimate) -> f64| {
            ranked.iter().map(move |string| of(&own.strings[*string].known))
        };
        let others = (1..uavs.len()).flat_map(|next| summarised(&uavs[(at + next) % uavs.len()]));
        known(|known| known.r_ohm)
            .chain(known(|known| known.q_mobile_c))
            .chain([own.most_charge_c(), f64::from(u8::from(own.grounded))])
            .chain(others)
            .chain([time])
            .collect()
    };
    (0..uavs.len()).map(one).collect()
}

fn summarised(uav: &Uav) -> [f64; 4] {
    [
        uav.worst_resistance_ohm(),
        uav.mean_resistance_ohm(),
        uav.most_charge_c(),
        f64::from(u8::from(uav.grounded)),
    ]
}

/// The full state: the known summary of every UAV, then the true health of its strings; the day.
pub fn state_channels(config: &UavFleetConfig) -> Vec<Channel> {
    let of = |uav: usize| {
        let prefix = format!("{}.", name(uav));
        let each = |of: fn(String) -> Channel, what: &str| -> Vec<Channel> {
            (1..=STRINGS)
                .map(|string| of(format!("{prefix}{what}_{string}")))
                .collect()
        };
        let truth = [each(resistance, "resistance_ohm"), each(capacity, "capacity_c")];
        summary(&prefix).into_iter().chain(truth.concat())
    };
    let last = config.horizon as f64;
    let day = Channel::new("step", "d")
        .within(0.0, last)
        .typical(last / 2.0, last / 3.0);
    (0..config.uavs).flat_map(of).chain([day]).collect()
}

/// The values of [`state_channels`].
pub fn state(uavs: &[Uav], day: usize) -> Vec<f64> {
    let of = |uav: &Uav| {
        let truth = uav.strings.iter().map(|string| string.parameters);
        let (r, q): (Vec<f64>, Vec<f64>) = truth
            .map(|true_one| (true_one.r_ohm, true_one.q_mobile_c))
            .unzip();
        [summarised(uav).to_vec(), r, q].concat()
    };
    uavs.iter().flat_map(of).chain([day as f64]).collect()
}

/// Metrics of each day.
pub fn metrics() -> Vec<Metric> {
    let cost = |name, unit, about| Metric::new(name, unit, about).lower_is_better();
    vec![
        Metric::new(
            "missions",
            "d",
            "missions that were flown on their day, in days' worth of them",
        ),
        cost("cost", "", "costs of replacements, call-outs and failures"),
        cost("failures", "", "UAVs that ran empty in flight"),
        cost("replaced_strings", "", "strings that were replaced"),
        cost("call_outs", "", "days on which something was replaced by choice"),
        cost("days_on_ground", "d", "days of UAVs on the ground"),
        cost("energy_kj", "kJ", "energy that the packs delivered"),
        cost(
            "resistance_error_ohm",
            "ohm",
            "root mean square of what is known of the resistances less the true ones",
        )
        .per_episode(PerEpisode::Mean),
        Metric::new(
            "bound",
            "",
            "return that nobody can exceed: all missions are flown, and nothing is spent",
        ),
    ]
}
