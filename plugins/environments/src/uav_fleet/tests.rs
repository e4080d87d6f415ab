//! Properties of the fleet: flights like those of `battery`, a filter that finds the health, days by hand.

use super::calibration::{Estimate, FlightLog};
use super::*;
use crate::{
    battery::{Battery, BatteryConfig, CellParameters, Cells, Load, Start},
    flight_planning::mission::Segment,
};
use contract::random::stream;
use serde_json::json;

const NOTHING: [f64; 3] = [0.0; 3];

fn config(values: serde_json::Value) -> UavFleetConfig {
    serde_json::from_value(values).unwrap()
}

fn fleet(values: serde_json::Value) -> UavFleet {
    UavFleet::new(config(values)).unwrap()
}

/// Strings with these capacities and resistances, without random factors.
fn strings(config: &UavFleetConfig, health: [(f64, f64); 4]) -> [CellString; 4] {
    health.map(|(q_mobile_c, r_ohm)| CellString {
        parameters: CellParameters::aged(q_mobile_c, r_ohm),
        wear_factor: 1.0,
        passed_c: 0.0,
        known: Estimate::of_new(config),
    })
}

const WORN: [(f64, f64); 4] = [(7500.0, 0.12), (7000.0, 0.14), (6900.0, 0.16), (6700.0, 0.17)];

fn act(environment: &mut UavFleet, choices: [f64; 3], rng: &mut Rng) -> Step {
    environment
        .step(&choices.map(|choice| vec![choice]), rng)
        .unwrap()
}

/// A flight at a constant load under an equal split is the trajectory of the `battery` environment, wear
/// included.
#[test]
fn a_flight_is_the_trajectory_of_the_battery() {
    let config = config(json!({ "step_s": 1.0, "decision_interval_s": 10.0, "cells_in_series": 4 }));
    let mut pack = strings(&config, WORN);
    let segment = Segment {
        power_w: 160.0,
        duration_s: 900.0,
    };
    let mut rng = stream(&["flight"]);
    let flown = flight::fly(&config, &SharingRule::Equal, &mut pack, &[segment], &mut rng);
    let mut battery = Battery::new(BatteryConfig {
        cells: Cells::Each(WORN.map(|(q, r)| CellParameters::aged(q, r)).to_vec()),
        load: Load::Constant { power_w: 40.0 },
        start: Start::Full,
        ageing: Some(config.ageing),
        ..BatteryConfig::default()
    })
    .unwrap();
    battery.reset(&mut rng).unwrap();
    let mut energy_j = 0.0;
    for _ in 0..90 {
        energy_j += battery
            .step(&[vec![0.25; 4]], &mut rng)
            .unwrap()
            .metric("energy_j")
            .unwrap();
    }
    for (string, cell) in pack.iter().zip(battery.cells()) {
        assert_eq!(string.parameters, *cell.parameters());
    }
    let lowest_v = battery
        .cells()
        .iter()
        .map(crate::battery::Cell::voltage_v)
        .fold(f64::INFINITY, f64::min);
    assert!(
        flown.is_whole && flown.lowest_v == lowest_v,
        "{} {lowest_v}",
        flown.lowest_v
    );
    // 160 W for 900 s, by four cells in series.
    assert!((flown.energy_j - 4.0 * energy_j).abs() < 1e-6 && (flown.energy_j - 144_000.0).abs() < 1e-6);
    // Readings at 0, 10, .. 890 s and after landing, each within the noise.
    assert_eq!(flown.log.readings.len(), 91);
    let last = flown.log.readings[90].1;
    assert!(
        last.iter()
            .zip(battery.cells())
            .all(|(read, cell)| (read - cell.voltage_v()).abs() <= 0.01)
    );
}

/// Effect of steps of 5 s instead of 1 s on the voltages and the wear of a whole flight of worn strings.
#[test]
fn long_steps_of_the_simulation_change_little() {
    let fly = |step_s: f64| {
        let config = config(json!({ "step_s": step_s, "sensor_noise_v": 0.0 }));
        let mut pack = strings(&config, WORN);
        let mission = &config.mission;
        let segments = mission.segments(&mission.constant_plan(), 1.0, 1.0);
        let flown = flight::fly(
            &config,
            &SharingRule::Equal,
            &mut pack,
            &segments,
            &mut stream(&["step"]),
        );
        assert!(flown.is_whole);
        let read = flown.log.readings.last().unwrap().1;
        (read, pack.map(|string| string.parameters.r_ohm))
    };
    let ((fine_v, fine_ohm), (coarse_v, coarse_ohm)) = (fly(1.0), fly(5.0));
    for i in 0..4 {
        assert!((fine_v[i] - coarse_v[i]).abs() < 5e-3, "{fine_v:?} {coarse_v:?}");
        assert!(
            (fine_ohm[i] - coarse_ohm[i]).abs() < 2e-5,
            "{fine_ohm:?} {coarse_ohm:?}"
        );
    }
}

/// Strings that were counted as average ones, but are not: after three flights with noise of 10 mV the filter
/// is within 4 mOhm, where counting is off by 24. The capacity, which moves voltages little before a pack is
/// nearly empty, is found to 300 C at best.
#[test]
fn the_filter_finds_the_health() {
    let config = config(json!({}));
    let passed_c = 40_000.0;
    let factors = [0.4, 0.8, 1.2, 1.6];
    let mut pack = factors.map(|wear_factor| {
        let mut string = CellString {
            parameters: CellParameters::FRESH,
            wear_factor,
            passed_c: 0.0,
            known: Estimate::of_new(&config),
        };
        string.parameters = string
            .ageing(&config.ageing)
            .worn(&string.parameters, passed_c, 1.0);
        string.pass(&config, passed_c);
        string
    });
    let error = |pack: &[CellString; 4]| {
        pack.iter().fold((0.0_f64, 0.0_f64), |(q, r), string| {
            let (known, truth) = (string.known, string.parameters);
            (
                q.max((known.q_mobile_c - truth.q_mobile_c).abs()),
                r.max((known.r_ohm - truth.r_ohm).abs()),
            )
        })
    };
    let counted = error(&pack);
    assert!(counted.0 > 230.0 && counted.1 > 0.02, "{counted:?}");
    let mut rng = stream(&["filter"]);
    let segments = config.mission.segments(&config.mission.constant_plan(), 1.0, 1.0);
    for _ in 0..3 {
        let flown = flight::fly(&config, &SharingRule::Known, &mut pack, &segments, &mut rng);
        assert!(flown.is_whole);
        for (at, string) in pack.iter_mut().enumerate() {
            string.known.correct(&config, &flown.log, at);
            string.pass(&config, flown.charge_c[at]);
        }
    }
    let found = error(&pack);
    assert!(found.0 < 300.0 && found.1 < 4e-3, "{found:?}");
}

#[test]
fn nothing_read_corrects_nothing() {
    let config = config(json!({}));
    let mut known = Estimate::of_new(&config);
    known.correct(&config, &FlightLog::default(), 0);
    assert_eq!(known, Estimate::of_new(&config));
}

/// Counted by hand: 1000 C at the published mean rates.
#[test]
fn wear_is_counted_by_hand() {
    let config = config(json!({}));
    let mut known = Estimate::of_new(&config);
    known.wear(&config, 1000.0);
    assert!((known.q_mobile_c - 7590.0).abs() < 1e-9 && (known.r_ohm - 0.118_215).abs() < 1e-12);
}

#[test]
fn days_by_hand() {
    let mut environment =
        fleet(json!({ "first_charge_c": 0.0, "new_spread": 0.0, "wear_spread": 0.0, "uav_spread": 0.0 }));
    let mut rng = stream(&["days"]);
    environment.reset(&mut rng).unwrap();
    // All UAVs fly: all missions are flown, without any cost.
    let step = act(&mut environment, NOTHING, &mut rng);
    assert!(
        (step.rewards[0] - 1.0).abs() < 1e-12 && step.rewards == [step.rewards[0]; 3],
        "{step:?}"
    );
    assert_eq!(
        (
            step.metric("cost").unwrap(),
            step.metric("days_on_ground").unwrap(),
            step.metric("bound").unwrap()
        ),
        (0.0, 0.0, 1.0)
    );
    // One pack is replaced: two UAVs still fly all missions, for four strings at 0.2 and a call-out at 0.5.
    let step = act(&mut environment, [2.0, 0.0, 0.0], &mut rng);
    assert!((step.rewards[0] - (1.0 - 0.8 - 0.5)).abs() < 1e-12, "{step:?}");
    assert_eq!(
        (
            step.metric("replaced_strings").unwrap(),
            step.metric("call_outs").unwrap(),
            step.metric("days_on_ground").unwrap()
        ),
        (4.0, 1.0, 1.0)
    );
    assert_eq!(environment.progress.uavs[0].most_charge_c(), 0.0);
    // Two UAVs are under maintenance with one call-out: half of the missions are flown.
    let step = act(&mut environment, [0.0, 1.0, 1.0], &mut rng);
    assert!((step.rewards[0] - (0.5 - 0.4 - 0.5)).abs() < 1e-12, "{step:?}");
    // No UAV flies.
    let step = act(&mut environment, [1.0; 3], &mut rng);
    assert_eq!(
        (
            step.metric("missions").unwrap(),
            step.metric("replaced_strings").unwrap(),
            step.metric("energy_kj").unwrap()
        ),
        (0.0, 3.0, 0.0)
    );
}

/// Packs at the end of their life: UAVs that fly run empty, are repaired for a day, and return with new cells.
#[test]
fn a_uav_that_runs_empty_is_lost_for_the_day_and_grounded_for_the_next() {
    let mut environment = fleet(json!({ "uavs": 3 }));
    let mut rng = stream(&["empty"]);
    environment.reset(&mut rng).unwrap();
    for uav in &mut environment.progress.uavs[..2] {
        uav.strings
            .iter_mut()
            .for_each(|string| string.parameters = CellParameters::aged(5000.0, 0.5));
    }
    let step = act(&mut environment, NOTHING, &mut rng);
    assert_eq!(
        (
            step.metric("failures").unwrap(),
            step.metric("replaced_strings").unwrap()
        ),
        (2.0, 8.0)
    );
    assert!((step.metric("missions").unwrap() - 1.0 / 3.0).abs() < 1e-12);
    assert!((step.rewards[0] - (1.0 / 3.0 - 8.0 * 0.2 - 2.0 * 5.0)).abs() < 1e-12);
    assert_eq!(step.observations[0][9], 1.0, "it sees that it is grounded");
    // A choice for a grounded UAV is neither carried out nor paid.
    let step = act(&mut environment, [2.0, 0.0, 0.0], &mut rng);
    assert_eq!(
        (
            step.metric("cost").unwrap(),
            step.metric("replaced_strings").unwrap(),
            step.metric("days_on_ground").unwrap()
        ),
        (0.0, 0.0, 2.0)
    );
    assert!((step.metric("missions").unwrap() - 0.5).abs() < 1e-12);
    let step = act(&mut environment, NOTHING, &mut rng);
    assert_eq!(step.metric("days_on_ground").unwrap(), 0.0);
}

/// For random choices no day earns more than its bound, and missions and costs add up to the reward.
#[test]
fn no_day_earns_more_than_its_bound() {
    let mut environment = fleet(json!({ "uavs": 3, "required": 2 }));
    let mut rng = stream(&["bound"]);
    environment.reset(&mut rng).unwrap();
    for day in 0..60 {
        let choices =
            [0, 1, 2].map(|uav| f64::from(u8::from(rng.random::<f64>() < 0.1) * (1 + (day + uav) % 2)));
        let step = act(&mut environment, choices, &mut rng);
        assert!(
            (step.rewards[0] - (step.metric("missions").unwrap() - step.metric("cost").unwrap())).abs()
                < 1e-12
        );
        assert!(
            step.rewards[0] <= step.metric("bound").unwrap() && step.metric("missions").unwrap() >= 0.0,
            "{step:?}"
        );
    }
}

#[test]
fn the_worst_string_is_the_one_of_the_largest_known_resistance() {
    let mut environment = fleet(json!({}));
    let mut rng = stream(&["worst"]);
    environment.reset(&mut rng).unwrap();
    let uav = &mut environment.progress.uavs[1];
    uav.strings[2].known.r_ohm = 0.3;
    let before = uav.strings;
    act(&mut environment, [0.0, 1.0, 0.0], &mut rng);
    let after = environment.progress.uavs[1].strings;
    let changed: Vec<usize> = (0..4).filter(|at| after[*at] != before[*at]).collect();
    assert_eq!(changed, [2], "it did not fly");
    assert_eq!(after[2].passed_c, 0.0);
}

/// All modules get the same cells, winds and new strings.
#[test]
fn modules_change_nothing_of_what_is_drawn() {
    let drawn = |modules: &str| {
        let mut environment = fleet(json!({ "modules": modules }));
        let mut rng = stream(&["common"]);
        environment.reset(&mut rng).unwrap();
        act(&mut environment, [2.0, 0.0, 0.0], &mut rng);
        let uav = &environment.progress.uavs[0];
        (uav.strings.map(|string| string.parameters), rng.next_u64())
    };
    for modules in [
        "without_calibration",
        "without_allocation",
        "without_planning",
        "without",
        "informed",
    ] {
        assert_eq!(drawn("full"), drawn(modules), "{modules}");
    }
}

#[test]
fn each_module_does_what_it_is_there_for() {
    // Consumption of the fleet, and error of the known health, over ten days without replacements.
    let ten_days = |modules: &str| {
        let mut environment = fleet(json!({ "modules": modules, "first_charge_c": 20_000.0 }));
        let mut rng = stream(&["modules"]);
        environment.reset(&mut rng).unwrap();
        let days: Vec<Step> = (0..10)
            .map(|_| act(&mut environment, NOTHING, &mut rng))
            .collect();
        let sum = |metric| days.iter().filter_map(|day| day.metric(metric)).sum::<f64>();
        assert_eq!(sum("failures"), 0.0, "{modules}: a UAV ran empty");
        (sum("energy_kj"), days[9].metric("resistance_error_ohm").unwrap())
    };
    let (full, counted) = (ten_days("full"), ten_days("without_calibration"));
    assert!(full.1 < 0.3 * counted.1, "{full:?} {counted:?}");
    assert_eq!(ten_days("informed").1, 0.0);
    assert!(ten_days("without_planning").0 > 1.005 * full.0);
}

#[test]
fn equal_streams_give_equal_episodes_and_a_snapshot_goes_on() {
    let mut one = fleet(json!({ "horizon": 6 }));
    let mut other = fleet(json!({ "horizon": 6 }));
    let (mut first, mut second) = (stream(&["same"]), stream(&["same"]));
    assert_eq!(one.reset(&mut first).unwrap(), other.reset(&mut second).unwrap());
    for day in 0..3 {
        let choices = [0.0, 1.0, f64::from(day)];
        assert_eq!(
            act(&mut one, choices, &mut first),
            act(&mut other, choices, &mut second)
        );
    }
    let text = one.snapshot().to_string();
    other.restore(&serde_json::from_str(&text).unwrap()).unwrap();
    for day in 3..6 {
        let step = act(&mut one, NOTHING, &mut first);
        assert_eq!(step, act(&mut other, NOTHING, &mut second));
        assert_eq!(step.end, (day == 5).then_some(End::Terminated));
    }
    let misfit = fleet(json!({ "uavs": 2, "required": 1 })).restore(&serde_json::from_str(&text).unwrap());
    let text = misfit.unwrap_err().to_string();
    assert!(text.contains("3 UAVs stored, 2 configured"), "{text}");
}

/// The plan of a search is flown; one with another number of legs is refused.
#[test]
fn a_plan_that_a_search_found_is_flown() {
    let folder = tempfile::tempdir().unwrap();
    let found = |legs: usize| {
        let action = contract::choice::vector(&flight_planning::choices(), &[6, 2]);
        let design = contract::Design {
            candidate: 0,
            observed_return: 0.0,
            chosen_by: None,
            actions: vec![action; legs],
            options: Vec::new(),
        };
        let designs = vec![design];
        Designs { designs }.write(folder.path()).unwrap();
        let product = json!({ "from": "search", "folder": folder.path() });
        UavFleet::new(config(json!({ "planning": { "found": product } })))
    };
    let fleet = found(6).unwrap();
    assert!(fleet.plan.iter().all(|course| *course == Course::of(6, 2)));
    let text = found(5).unwrap_err().to_string();
    assert!(
        text.contains("`planning.found`: the search planned 5 legs, the mission has 6"),
        "{text}"
    );
    Designs::default().write(folder.path()).unwrap();
    let product = json!({ "from": "search", "folder": folder.path() });
    let blank = UavFleet::new(config(json!({ "planning": { "found": product } }))).unwrap();
    assert_eq!(blank.plan[..], [Course::CONSTANT; 6]);
}
