//! No controller exceeds the bound: rules, controllers that know the state, searches over a single episode, and
//! every allocation of a coarse grid.

use super::*;
use rand::Rng as _;

const PACKS: [&str; 3] = ["4", "8", "\"second_life\""];

fn config(cells: &str) -> BatteryConfig {
    serde_json::from_str(&format!("{{\"cells\": {cells}}}")).unwrap()
}

fn rng(pack: &str, episode: usize) -> Rng {
    contract::random::stream(&["life bound", pack, &episode.to_string()])
}

/// Chooses weights from the environment before a decision, the decision's number, and a random stream of its
/// own.
type Controller<'a> = &'a mut dyn FnMut(&Battery, usize, &mut Rng) -> Vec<f64>;

/// Number of decisions survived, the bound, and the lowest voltage at the end.
fn play(battery: &mut Battery, mut rng: Rng, controller: Controller<'_>) -> (u64, u64, f64) {
    let mut own = contract::random::stream(&["controller"]);
    battery.reset(&mut rng).unwrap();
    for decision in 0.. {
        let weights = controller(battery, decision, &mut own);
        let step = battery.step(&[weights], &mut rng).unwrap();
        if step.end.is_some() {
            let survived = decision as u64 + u64::from(step.end == Some(End::Truncated));
            return (
                survived,
                step.metric("cycle_length_bound").unwrap() as u64,
                battery.voltage_range().0,
            );
        }
    }
    unreachable!("packs end")
}

fn normalised(weights: Vec<f64>) -> Vec<f64> {
    let total: f64 = weights.iter().sum();
    let equal = 1.0 / weights.len() as f64;
    weights
        .iter()
        .map(|weight| if total > 0.0 { weight / total } else { equal })
        .collect()
}

/// Weights that equalise the terminal voltages, computed from the true state.
fn level(battery: &Battery) -> Vec<f64> {
    let (state, n) = (battery.state(), battery.cells.len());
    let currents = |v: f64| {
        state[..n]
            .iter()
            .zip(&state[n..2 * n])
            .map(|(e, r)| (e - v).max(0.0) / r)
            .collect::<Vec<_>>()
    };
    let (mut low, mut high) = (1.8, 4.2);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if middle * currents(middle).iter().sum::<f64>() > battery.demand_w() {
            low = middle;
        } else {
            high = middle;
        }
    }
    normalised(currents(low))
}

/// Shares in the order of the voltages, the last share for the highest voltage.
fn by_rank(battery: &Battery, share: impl Fn(usize) -> f64) -> Vec<f64> {
    let mut order: Vec<usize> = (0..battery.cells.len()).collect();
    order.sort_by(|a, b| {
        battery.cells[*a]
            .voltage_v()
            .total_cmp(&battery.cells[*b].voltage_v())
    });
    let mut weights = vec![0.0; order.len()];
    order
        .iter()
        .enumerate()
        .for_each(|(rank, cell)| weights[*cell] = share(rank));
    normalised(weights)
}

fn powers_of_charge(battery: &Battery, exponent: f64) -> Vec<f64> {
    normalised(
        battery
            .cells
            .iter()
            .map(|cell| cell.state().charge_c().powf(exponent))
            .collect(),
    )
}

#[test]
fn no_rule_and_no_informed_controller_outlives_the_bound() {
    for pack in PACKS {
        let mut battery = Battery::new(config(pack)).unwrap();
        let n = battery.cells.len();
        let mut controllers: Vec<Box<dyn FnMut(&Battery, usize, &mut Rng) -> Vec<f64>>> = vec![
            Box::new(|battery, _, _| vec![1.0 / battery.cells.len() as f64; battery.cells.len()]),
            Box::new(|battery, _, _| level(battery)),
            Box::new(|battery, _, _| by_rank(battery, |rank| (rank + 1) as f64)),
            Box::new(move |battery, _, _| by_rank(battery, |rank| f64::from(u8::from(rank >= n / 2)))),
            Box::new(|battery, _, _| powers_of_charge(battery, 0.5)),
            Box::new(|battery, _, _| powers_of_charge(battery, 1.0)),
            Box::new(|battery, _, own| {
                normalised(battery.cells.iter().map(|_| own.random::<f64>()).collect())
            }),
            // Cells take turns, so that overpotentials fade in between.
            Box::new(|battery, decision, _| {
                let turn = |(cell, weight): (usize, f64)| {
                    if (cell + decision) % 2 == 0 {
                        1.6 * weight
                    } else {
                        weight
                    }
                };
                normalised(level(battery).into_iter().enumerate().map(turn).collect())
            }),
        ];
        let (mut longest, mut bounds) = (0, 0);
        for episode in 0..40 {
            let played: Vec<_> = controllers
                .iter_mut()
                .map(|one| play(&mut battery, rng(pack, episode), &mut **one))
                .collect();
            let bound = played[0].1;
            for (controller, (survived, own_bound, _)) in played.iter().enumerate() {
                assert_eq!(
                    *own_bound, bound,
                    "{pack} {episode}: the bound is of the episode, not of the controller"
                );
                assert!(
                    *survived <= bound,
                    "{pack} {episode}: controller {controller} survives {survived} of {bound}"
                );
            }
            longest += played.iter().map(|(survived, ..)| survived).max().unwrap();
            bounds += bound;
        }
        let tightness = longest as f64 / bounds as f64;
        let expected = if pack == PACKS[2] { 0.58 } else { 0.78 };
        assert!(tightness > expected, "{pack}: {tightness}");
    }
}

/// A search that knows the whole episode: it changes shares at random for a while and keeps changes that
/// prolong life.
#[test]
fn no_search_through_an_episode_outlives_the_bound() {
    const BLOCK: usize = 8;
    for pack in PACKS {
        let mut battery = Battery::new(config(pack)).unwrap();
        let n = battery.cells.len();
        for episode in 0..3 {
            let mut luck = contract::random::stream(&["search", pack, &episode.to_string()]);
            let mut best: (Vec<f64>, (u64, f64)) = (vec![0.0; n * 40], (0, 0.0));
            for _ in 0..250 {
                let mut changed = best.0.clone();
                let (first, length) = (
                    luck.random_range(0..changed.len() as u32),
                    luck.random_range(1..3 * n as u32),
                );
                for entry in changed.iter_mut().skip(first as usize).take(length as usize) {
                    *entry += luck.random_range(-0.5..0.5);
                }
                let mut follow = |battery: &Battery, decision: usize, _: &mut Rng| {
                    let at = (decision / BLOCK * n).min(changed.len() - n);
                    let shares = level(battery).into_iter().zip(&changed[at..at + n]);
                    normalised(shares.map(|(share, change)| share * change.exp()).collect())
                };
                let (survived, bound, lowest_v) = play(&mut battery, rng(pack, episode), &mut follow);
                assert!(survived <= bound, "{pack} {episode}: {survived} of {bound}");
                if (survived, lowest_v) >= best.1 {
                    best = (changed, (survived, lowest_v));
                }
            }
        }
    }
}

/// Most decisions that two cells survive when every decision is one of `LEVELS` allocations.
fn longest(cells: &[Cell], demands_w: &[f64], steps: usize) -> u64 {
    const LEVELS: usize = 7;
    let Some((demand_w, rest)) = demands_w.split_first() else {
        return 0;
    };
    let after = |level: usize| {
        let first = level as f64 / (LEVELS - 1) as f64;
        let mut cells = cells.to_vec();
        for (cell, weight) in cells.iter_mut().zip([first, 1.0 - first]) {
            (0..steps).for_each(|_| cell.draw_power(weight * demand_w, 1.0));
        }
        let survived = cells.iter().all(|cell| cell.voltage_v() > 3.0);
        if survived {
            1 + longest(&cells, rest, steps)
        } else {
            0
        }
    };
    (0..LEVELS).map(after).max().unwrap_or(0)
}

/// Two cells near their end, a few long decisions: all allocations of a grid are tried.
#[test]
fn the_best_of_all_allocations_lies_below_the_bound() {
    let (mut best, mut bounds) = (0, 0);
    for episode in 0..12 {
        let mut rng = rng("small", episode);
        let charges = [rng.random_range(0.08..0.2), rng.random_range(0.08..0.2)];
        let config = BatteryConfig {
            cells: Cells::Count(2),
            start: Start::StateOfCharge(charges.to_vec()),
            load: Load::Uniform {
                low_w: 8.0,
                high_w: 24.0,
            },
            decision_interval_s: 40.0,
            ..BatteryConfig::default()
        };
        let mut battery = Battery::new(config).unwrap();
        battery.reset(&mut rng).unwrap();
        let bound = battery.progress.bound.unwrap();
        let demands_w: Vec<f64> = battery
            .demands_to_come(rng.clone())
            .take(bound as usize + 1)
            .collect();
        let optimum = longest(&battery.cells, &demands_w, 40);
        assert!(optimum <= bound, "{episode}: {optimum} of {bound}");
        best += optimum;
        bounds += bound;
    }
    assert!(
        best > 20 && best as f64 >= 0.6 * bounds as f64,
        "{best} of {bounds}"
    );
}

#[test]
fn the_demands_to_come_are_those_that_come() {
    for sensor_noise in [false, true] {
        let mut battery = Battery::new(BatteryConfig {
            sensor_noise,
            ..config("4")
        })
        .unwrap();
        let mut rng = rng("demands", 0);
        let first = battery.reset(&mut rng).unwrap()[0][8];
        let expected: Vec<f64> = battery.demands_to_come(rng.clone()).take(6).collect();
        let step = |_| battery.step(&[vec![0.25; 4]], &mut rng).unwrap().observations[0][8];
        let seen: Vec<f64> = std::iter::once(first).chain((0..5).map(step)).collect();
        assert_eq!(seen, expected);
    }
}

#[test]
fn a_limit_of_decisions_bounds_too() {
    let mut battery = Battery::new(BatteryConfig {
        episode_limit: Some(7),
        ..config("4")
    })
    .unwrap();
    let (survived, bound, _) = play(&mut battery, rng("limit", 0), &mut |_, _, _| vec![0.25; 4]);
    assert_eq!((survived, bound), (7, 7));
}

#[test]
fn where_the_facts_do_not_hold_there_is_no_bound() {
    let has_bound = |keys: serde_json::Value| {
        let battery = Battery::new(serde_json::from_value(keys).unwrap()).unwrap();
        battery
            .metrics()
            .iter()
            .any(|metric| metric.name == "cycle_length_bound")
    };
    use serde_json::json;
    assert!(
        has_bound(json!({})) && has_bound(json!({"load": {"constant": {"power_w": 8.0}}, "start": "full"}))
    );
    for keys in [
        json!({"thermal": true}),
        json!({"process_noise": true}),
        json!({"ageing": {}}),
        json!({"load": {"constant_current": {"current_a": 2.0}}}),
        json!({"load": {"uniform": {"low_w": 0.0, "high_w": 2.0}}}),
        json!({"cells": 1, "start": {"states": [[292.1, 0.0, 0.0, 0.0, 3000.0, 333.0, 5000.0, 555.0]]}}),
        json!({"mole_fraction_margin": 0.01}),
        json!({"step_s": 10.0}),
    ] {
        assert!(!has_bound(keys.clone()), "{keys}");
    }
}
