//! Behaviour of a population, compared with its rules and with searches that copy nothing.

use super::*;
use crate::search::{Direction, Method, Next, Numbers, lineage, schedule_in_words};
use proptest::prelude::*;
use serde_json::json;

const PAUSES: [u64; 3] = [100, 200, 300];

fn options() -> Population {
    Population {
        pauses: PAUSES.into(),
        replace: 0.25,
        redraw: 0.25,
    }
}

fn search(members: usize) -> Search {
    let rates = Numbers {
        low: 1e-4,
        high: 1.0,
        log: true,
        integer: false,
    };
    let batches = Range::Choice([16, 32, 64].map(|size| json!(size)).into());
    Search {
        name: "rates".into(),
        environment: "cells".into(),
        agent: "learner".into(),
        plugin: "learner".into(),
        keys: vec![
            ("learner.rate".into(), Range::Numbers(rates)),
            ("learner.batch".into(), batches),
        ],
        metric: "return".into(),
        direction: Direction::Maximize,
        settings: members,
        seeds: vec![1_000_000],
        method: Method::Population(options()),
        failed: crate::search::Failed::Wait,
    }
}

/// Lets a population learn to its end: a stretch adds `gain` of the setting and the generation to the value of its
/// parent. A gain that is not finite is a failure.
fn evolve(search: &Search, gain: impl Fn(f64, usize) -> f64) -> (Vec<Tried>, Option<usize>) {
    let (mut tried, mut learned): (Vec<Tried>, Vec<f64>) = (Vec::new(), Vec::new());
    loop {
        let parents = search.parents(&tried);
        let points = match search.next(&tried) {
            Next::Chosen(chosen, _) => return (tried, chosen),
            Next::Try(points, _) => points,
        };
        for place in tried.len()..points.len() {
            let parent = parents[place];
            let rate = points[place][0].as_f64().unwrap_or(f64::NAN);
            let value = parent.map_or(0.0, |parent| learned[parent]) + gain(rate, place / search.settings);
            learned.push(value);
            let (value, is_last) = (
                Some(value).filter(|it| it.is_finite()),
                search.compared_at(place).is_none(),
            );
            tried.push(Tried {
                parent,
                value: value.filter(|_| is_last),
                ended: is_last,
                pauses: search
                    .compared_at(place)
                    .map(|pause| (pause, value))
                    .into_iter()
                    .collect(),
                ..Tried::new(points[place].clone())
            });
        }
    }
}

/// Best if the rate is a tenth at first and a hundredth of that later.
fn wants_a_schedule(rate: f64, generation: usize) -> f64 {
    let best = if generation < 2 { -1.0 } else { -3.0 };
    -(rate.log10() - best).abs()
}

#[test]
fn the_best_go_on_and_the_worst_take_up_what_they_learned() {
    let (tried, chosen) = evolve(&search(8), wants_a_schedule);
    assert_eq!(tried.len(), 8 * 4);
    let value = |place: usize| {
        tried[place]
            .value
            .or(tried[place].pauses.values().next().copied().flatten())
    };
    for generation in 1..4 {
        let before = 8 * (generation - 1);
        let mut order: Vec<usize> = (before..before + 8).collect();
        order.sort_by(|one, other| value(*other).unwrap().total_cmp(&value(*one).unwrap()));
        for place in before + 8..before + 16 {
            let (own, parent) = (place - 8, tried[place].parent.unwrap());
            if order[6..].contains(&own) {
                assert!(order[..2].contains(&parent), "{place} goes on from {parent}");
            } else {
                assert_eq!((parent, &tried[place].point), (own, &tried[own].point));
            }
        }
    }
    let last: Vec<f64> = (24..32).map(|place| tried[place].value.unwrap()).collect();
    let best = last.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    assert!((tried[chosen.unwrap()].value.unwrap() - best).abs() < 1e-12);
}

#[test]
fn a_schedule_is_found_that_no_constant_setting_matches() {
    let (tried, chosen) = evolve(&search(24), wants_a_schedule);
    // A constant rate loses at least 2 in each half of the stretches: 4 in total.
    let value = tried[chosen.unwrap()].value.unwrap();
    assert!(value > -4.0, "{value}");
    let parents: Vec<Option<usize>> = tried.iter().map(|it| it.parent).collect();
    let way = lineage(&parents, chosen.unwrap());
    assert_eq!(way.len(), 4);
    let rates: Vec<f64> = way
        .iter()
        .map(|place| tried[*place].point[0].as_f64().unwrap())
        .collect();
    let summed: f64 = rates
        .iter()
        .enumerate()
        .map(|(place, rate)| wants_a_schedule(*rate, place))
        .sum();
    assert!(
        (summed - value).abs() < 1e-9,
        "the way to the best is what it learned with"
    );
}

#[test]
fn members_that_fail_are_replaced_and_a_generation_without_one_is_the_end() {
    let fails = |rate: f64, generation: usize| {
        if generation == 1 && rate > 0.01 {
            f64::NAN
        } else {
            rate
        }
    };
    let (tried, chosen) = evolve(&search(8), fails);
    let value = |place: usize| tried[place].pauses[&PAUSES[1]];
    let goes_on_well = |it: &Tried| value(it.parent.unwrap()).is_some();
    assert!(tried[16..24].iter().all(goes_on_well));
    assert!(chosen.is_some());
    let (tried, chosen) = evolve(
        &search(4),
        |_, generation| if generation == 1 { f64::NAN } else { 0.0 },
    );
    assert_eq!((tried.len(), chosen), (8, None));
}

#[test]
fn another_result_leads_elsewhere_from_the_next_generation_on() {
    let search = search(8);
    let (tried, _) = evolve(&search, wants_a_schedule);
    let mut other = tried[..16].to_vec();
    other[3].pauses.insert(PAUSES[0], None);
    let parents = search.parents(&other);
    assert_eq!(parents.len(), 16, "the second generation is another one now");
    assert!(parents[8..].iter().all(|parent| *parent != Some(3)));
}

#[test]
fn a_schedule_is_said_stretch_by_stretch() {
    let settings = ["rate=0.1", "rate=0.1", "rate=0.08"].map(str::to_owned);
    assert_eq!(
        schedule_in_words(&settings, &[100, 200]),
        "rate=0.1 to step 200, then rate=0.08 to the end"
    );
}

proptest! {
    #[test]
    fn what_is_explored_stays_in_its_range(seed in 0u64..1000, share in 0.0..=1.0f64, members in 2usize..12) {
        let search = search(members);
        let whole = Numbers { low: 1.0, high: 9.0, log: false, integer: true };
        let whole = Range::Numbers(whole);
        let start = whole.at(share);
        for up in [false, true] {
            let to = moved(&whole, &start, up).as_i64().unwrap();
            let from = start.as_i64().unwrap();
            prop_assert!((1..=9).contains(&to));
            prop_assert!(to != from || (up && from == 9) || (!up && from == 1));
        }
        let mut rng = random::stream(&["explored", &seed.to_string()]);
        let point = vec![search.keys[0].1.at(share), json!(32)];
        let other = explored(&search, &options(), &point, &mut rng);
        let rate = other[0].as_f64().unwrap();
        prop_assert!((1e-4..=1.0).contains(&rate));
        prop_assert!([16, 32, 64].contains(&other[1].as_i64().unwrap()));
    }
}
