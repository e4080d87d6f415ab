//! Searches on functions whose best value is known, and properties of every search.

use super::*;
use proptest::prelude::*;

fn numbers(low: f64, high: f64, log: bool, integer: bool) -> Range {
    Range::Numbers(Numbers {
        low,
        high,
        log,
        integer,
    })
}

fn search(keys: Vec<(&str, Range)>, method: Method, settings: usize, seed: u64) -> Search {
    Search {
        name: "rates".into(),
        environment: "short".into(),
        agent: "learner".into(),
        plugin: "learner".into(),
        keys: keys
            .into_iter()
            .map(|(key, range)| (key.to_owned(), range))
            .collect(),
        metric: "return".into(),
        direction: Direction::Minimize,
        settings,
        seeds: vec![seed],
        method,
        failed: Failed::Wait,
    }
}

/// Runs a search to its end on a function; a value that is not finite stands for a failed trial.
fn run(search: &Search, value: impl Fn(&[f64]) -> f64) -> (Vec<Tried>, Option<usize>) {
    let mut tried: Vec<Tried> = Vec::new();
    loop {
        match search.next(&tried) {
            Next::Try(points, _) => tried.extend(points.into_iter().skip(tried.len()).map(|point| {
                let numbers: Vec<f64> = point
                    .iter()
                    .map(|value| value.as_f64().unwrap_or(f64::NAN))
                    .collect();
                ended(point, value(&numbers))
            })),
            Next::Chosen(chosen, _) => return (tried, chosen),
        }
    }
}

#[test]
fn proposals_after_earlier_ones_are_those_from_the_beginning() {
    let keys = || vec![("x", numbers(0.0, 1.0, false, false))];
    for method in [parzen(4, 1), parzen(4, 3)] {
        let search = search(keys(), method, 20, 3);
        let (all, _) = run(&search, |x| (x[0] - 0.3).powi(2));
        let mut other = all.clone();
        // A failed trial that was tried again.
        other[9].value = Some(-1.0);
        let mut earlier = Proposals::default();
        for tried in [
            &all[..],
            &all[..7],
            &other[..10],
            &all[..12],
            &[],
            &all[..19],
            &all[..],
        ] {
            assert_eq!(search.next_after(tried, &mut earlier), search.next(tried));
        }
    }
}

fn ended(point: Point, value: f64) -> Tried {
    Tried {
        value: Some(value).filter(|value| value.is_finite()),
        ended: true,
        ..Tried::new(point)
    }
}

fn parzen(startup: usize, batch: usize) -> Method {
    Method::TreeParzen(TreeParzen {
        startup,
        batch,
        candidates: 24,
    })
}

fn adaptation(population: Option<usize>) -> Method {
    Method::CmaEs(CmaEs {
        population,
        ..CmaEs::default()
    })
}

fn square() -> Vec<(&'static str, Range)> {
    vec![
        ("learner.rate", numbers(1e-6, 1e-1, true, false)),
        ("learner.width", numbers(8.0, 256.0, true, true)),
    ]
}

/// Best at a rate of 1e-3 and a width of 64.
fn bowl(point: &[f64]) -> f64 {
    (point[0].log10() + 3.0).powi(2) + (point[1] / 64.0).ln().powi(2)
}

#[test]
fn what_follows_is_a_function_of_the_results_alone() {
    let search = search(square(), parzen(6, 4), 26, 0);
    let (tried, chosen) = run(&search, bowl);
    assert_eq!(tried.len(), 26);
    assert_eq!(search.next(&tried), Next::Chosen(chosen, vec![None; 26]));
    assert_eq!(search.ranking(&tried)[0], chosen.unwrap());
    // A value that changes affects the generations after it.
    let mut other = tried.clone();
    other[7].value = Some(-1.0);
    let Next::Try(points, _) = search.next(&other) else {
        panic!("another value leads to the same settings")
    };
    let same = points
        .iter()
        .zip(&tried)
        .take_while(|(point, it)| **point == it.point)
        .count();
    assert!((10..26).contains(&same), "{same}");
}

#[test]
fn a_larger_budget_keeps_the_settings_of_a_smaller_one() {
    for method in [Method::Random(NoOptions {}), parzen(4, 3), adaptation(Some(3))] {
        let few = run(&search(square(), method.clone(), 10, 0), bowl).0;
        let many = run(&search(square(), method, 19, 0), bowl).0;
        assert_eq!(few[..], many[..10]);
    }
}

#[test]
fn a_setting_that_failed_is_never_chosen_and_nothing_is_where_all_failed() {
    let own = search(square(), parzen(4, 2), 20, 1);
    let (tried, chosen) = run(&own, |point| if point[0] > 1e-4 { f64::NAN } else { bowl(point) });
    assert!(tried.iter().any(|it| it.value.is_none()));
    assert!(tried[chosen.unwrap()].value.is_some());
    // Settings that fail are avoided.
    let failed = |part: &[Tried]| part.iter().filter(|it| it.value.is_none()).count();
    assert!(failed(&tried[12..]) < 5, "{tried:?}");
    assert_eq!(run(&own, |_| f64::NAN).1, None);
}

#[test]
fn a_small_space_is_not_tried_twice_before_it_is_tried_whole() {
    let keys = || {
        let words = Range::Choice(vec![json!("relu"), json!("tanh"), json!("silu")]);
        vec![
            ("learner.cells", numbers(1.0, 4.0, false, true)),
            ("learner.unit", words),
        ]
    };
    for method in [Method::Random(NoOptions {}), parzen(3, 2)] {
        let (tried, _) = run(&search(keys(), method, 12, 0), |point| point[0]);
        let mut words: Vec<String> = tried.iter().map(|it| json!(it.point).to_string()).collect();
        words.sort();
        words.dedup();
        assert!(words.len() >= 11, "{} different", words.len());
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn settings_stay_in_their_ranges(low in 1e-6f64..1.0, factor in 1.5f64..1e4, batch in 1usize..6, log: bool, integer: bool) {
        let range = Numbers { low: low.ceil(), high: low.ceil() * factor.ceil(), log, integer };
        let own = Range::Numbers(range);
        // `check` refuses more settings than there are.
        let settings = own.count().map_or(20, |count| count.min(20));
        let own = search(vec![("learner.rate", own)], parzen(3, batch), settings, 0);
        let (tried, _) = run(&own, |point| (point[0] - 2.0).abs());
        for it in tried {
            let value = it.point[0].as_f64().unwrap();
            prop_assert!(value >= range.low && value <= range.high);
            prop_assert!(!integer || value.fract() == 0.0);
        }
    }
}

/// A function whose smallest value is 0, with its keys.
type Function = (Vec<(&'static str, Range)>, fn(&[Value]) -> f64);

fn at(point: &[Value], index: usize) -> f64 {
    point[index].as_f64().unwrap()
}

fn plain(low: f64, high: f64) -> Range {
    numbers(low, high, false, false)
}

fn rates(low: f64) -> Range {
    numbers(low, 1e-1, true, false)
}

/// The functions of `tests/fixtures/search/optuna_regret.py`.
fn function(name: &str) -> Function {
    [bowls, waves, settings].iter().find_map(|of| of(name)).unwrap()
}

/// Functions with few minima near the best one.
fn bowls(name: &str) -> Option<Function> {
    Some(match name {
        "sphere" => (
            vec![
                ("a", plain(-5.0, 10.0)),
                ("b", plain(-5.0, 10.0)),
                ("c", plain(-5.0, 10.0)),
            ],
            |x| (0..3).map(|key| at(x, key).powi(2)).sum(),
        ),
        "rosenbrock" => (vec![("a", plain(-2.0, 2.0)), ("b", plain(-2.0, 2.0))], |x| {
            100.0 * (at(x, 1) - at(x, 0).powi(2)).powi(2) + (1.0 - at(x, 0)).powi(2)
        }),
        "camel" => (vec![("a", plain(-3.0, 3.0)), ("b", plain(-2.0, 2.0))], |x| {
            let (a, b) = (at(x, 0).powi(2), at(x, 1).powi(2));
            (4.0 - 2.1 * a + a * a / 3.0) * a
                + at(x, 0) * at(x, 1)
                + (4.0 * b - 4.0) * b
                + 1.031_628_453_489_877
        }),
        "styblinski" => (
            vec![
                ("a", plain(-5.0, 5.0)),
                ("b", plain(-5.0, 5.0)),
                ("c", plain(-5.0, 5.0)),
            ],
            |x| {
                let of = |v: f64| (v.powi(4) - 16.0 * v * v + 5.0 * v) / 2.0 + 39.166_165_703_771_42;
                (0..3).map(|key| of(at(x, key))).sum()
            },
        ),
        _ => return None,
    })
}

/// Functions with many minima.
fn waves(name: &str) -> Option<Function> {
    use std::f64::consts::{E, PI};
    Some(match name {
        "ackley" => (vec![("a", plain(-15.0, 30.0)), ("b", plain(-15.0, 30.0))], |x| {
            let (a, b) = (at(x, 0), at(x, 1));
            let waves = ((2.0 * PI * a).cos() + (2.0 * PI * b).cos()) / 2.0;
            -20.0 * (-0.2 * ((a * a + b * b) / 2.0).sqrt()).exp() - waves.exp() + 20.0 + E
        }),
        "rastrigin" => (vec![("a", plain(-4.0, 5.12)), ("b", plain(-4.0, 5.12))], |x| {
            20.0 + (0..2)
                .map(|key| at(x, key).powi(2) - 10.0 * (2.0 * PI * at(x, key)).cos())
                .sum::<f64>()
        }),
        "branin" => (vec![("a", plain(-5.0, 10.0)), ("b", plain(0.0, 15.0))], |x| {
            let (a, b) = (at(x, 0), at(x, 1));
            let bend = b - 5.1 / (4.0 * PI * PI) * a * a + 5.0 / PI * a - 6.0;
            bend * bend + 10.0 * (1.0 - 1.0 / (8.0 * PI)) * a.cos() + 10.0 - 0.397_887_357_729_738_16
        }),
        _ => return None,
    })
}

/// Functions of keys as agents have them: over decades, whole numbers, words.
fn settings(name: &str) -> Option<Function> {
    Some(match name {
        "rates" => (vec![("a", rates(1e-6)), ("b", rates(1e-6))], |x| {
            (at(x, 0).log10() + 3.5).powi(2) + (at(x, 1).log10() + 4.5).powi(2)
        }),
        "widths" => (
            vec![
                ("a", numbers(8.0, 512.0, true, true)),
                ("b", numbers(1.0, 8.0, false, true)),
            ],
            |x| (at(x, 0) / 64.0).log2().powi(2) + (at(x, 1) - 3.0).powi(2),
        ),
        "mixed" => {
            let words = Range::Choice(["relu", "tanh", "silu", "elu"].map(|word| json!(word)).into());
            (
                vec![
                    ("a", rates(1e-5)),
                    ("b", words),
                    ("c", numbers(1.0, 16.0, false, true)),
                ],
                |x| {
                    let of_word = match x[1].as_str() {
                        Some("relu") => 1.0,
                        Some("tanh") => 2.0,
                        Some("silu") => 0.0,
                        _ => 3.0,
                    };
                    (at(x, 0).log10() + 3.0).powi(2) + of_word + (at(x, 2) - 11.0).abs() / 4.0
                },
            )
        }
        _ => return None,
    })
}

/// Median over seeds of the smallest value among 60 settings, 10 of them random.
fn median_regret(name: &str, method: &Method, n_seeds: u64) -> f64 {
    let (keys, value) = function(name);
    let of_seed = |seed| {
        let own = search(keys.clone(), method.clone(), 60, seed);
        let mut tried: Vec<Tried> = Vec::new();
        while tried.len() < own.settings {
            let points = match method {
                Method::CmaEs(_) => match own.next(&tried) {
                    Next::Try(points, _) => points.into_iter().skip(tried.len()).collect(),
                    Next::Chosen(..) => panic!("{name}: over after {} settings", tried.len()),
                },
                // `next` computes every earlier setting again.
                _ => own.generation(&tried, own.end_of_generation(tried.len())),
            };
            tried.extend(points.into_iter().map(|point| {
                let value = value(&point);
                ended(point, value)
            }));
        }
        tried
            .iter()
            .filter_map(|it| it.value)
            .fold(f64::INFINITY, f64::min)
    };
    let mut regrets: Vec<f64> = (0..n_seeds).map(of_seed).collect();
    regrets.sort_by(f64::total_cmp);
    regrets[regrets.len() / 2]
}

/// The median lies within the quartiles of Optuna 5.0.0 or below, one setting at a time, and far below that of random
/// search on most of the functions.
#[test]
fn regret_is_that_of_optuna_on_ten_functions() {
    let table = include_str!("../../../../tests/fixtures/search/optuna_regret.csv");
    let (mut wrong, mut far_below_chance) = (Vec::new(), 0);
    for line in table.lines().skip(1) {
        let words: Vec<&str> = line.split(',').collect();
        let [median, upper, chance] = [2, 3, 4].map(|column: usize| words[column].parse::<f64>().unwrap());
        let ours = median_regret(words[0], &parzen(10, 1), 15);
        far_below_chance += usize::from(ours < 0.6 * chance);
        if ours > upper {
            wrong.push(format!("{}: {ours} against {median}, at most {upper}", words[0]));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(far_below_chance >= 7, "{far_below_chance}");
}

/// The same for covariance matrix adaptation, which searches only numbers.
#[test]
fn regret_of_adaptation_is_that_of_optuna_on_nine_functions() {
    let table = include_str!("../../../../tests/fixtures/search/optuna_cma_es_regret.csv");
    let mut wrong = Vec::new();
    for line in table.lines().skip(1) {
        let words: Vec<&str> = line.split(',').collect();
        let [median, upper] = [2, 3].map(|column: usize| words[column].parse::<f64>().unwrap());
        // Optuna begins with a sixth of each range.
        let method = Method::CmaEs(CmaEs {
            population: None,
            spread: 1.0 / 6.0,
        });
        let ours = median_regret(words[0], &method, 15);
        if ours > upper {
            wrong.push(format!("{}: {ours} against {median}, at most {upper}", words[0]));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn adaptation_turns_to_a_narrow_valley_and_begins_anew_where_it_ends() {
    let valley = |x: &[f64]| 1e4 * (x[0] - x[1]).powi(2) + (x[0] - 0.3).powi(2);
    let keys = || {
        vec![
            ("learner.a", numbers(-1.0, 1.0, false, false)),
            ("learner.b", numbers(-1.0, 1.0, false, false)),
        ]
    };
    let best_of = |seed| {
        let (tried, chosen) = run(&search(keys(), adaptation(None), 400, seed), valley);
        // All 400 are different, although the first run may end earlier.
        let mut words: Vec<String> = tried.iter().map(|it| cma_es::word(&it.point)).collect();
        words.sort();
        words.dedup();
        assert_eq!(words.len(), 400);
        tried[chosen.unwrap()].value.unwrap()
    };
    let mut best: Vec<f64> = (0..9).map(best_of).collect();
    best.sort_by(f64::total_cmp);
    // The Python package `cmaes` reaches 2e-8 or less in half of twelve runs; two of them find no valley.
    assert!(best[4] < 1e-6, "{best:?}");
}

#[test]
fn adaptation_tries_a_small_space_whole_and_outlives_failures() {
    let keys = || {
        vec![
            ("learner.a", numbers(1.0, 4.0, false, true)),
            ("learner.b", numbers(1.0, 3.0, false, true)),
        ]
    };
    let own = search(keys(), adaptation(None), 12, 0);
    let (tried, chosen) = run(&own, |x| if x[0] > 2.0 { f64::NAN } else { x[0] + x[1] });
    assert_eq!(tried[chosen.unwrap()].value, Some(2.0));
    let mut words: Vec<String> = tried.iter().map(|it| cma_es::word(&it.point)).collect();
    words.sort();
    words.dedup();
    assert_eq!(words.len(), 12);
    assert_eq!(run(&own, |_| f64::NAN).1, None);
}
