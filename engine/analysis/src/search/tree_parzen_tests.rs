//! The densities by hand and against numerical sums.

use super::*;
use contract::random;
use serde_json::json;

fn space() -> Vec<Range> {
    vec![
        Range::Numbers(Numbers {
            low: 0.0,
            high: 2.0,
            log: false,
            integer: false,
        }),
        Range::Numbers(Numbers {
            low: 1.0,
            high: 4.0,
            log: true,
            integer: true,
        }),
        Range::Choice(vec![json!("a"), json!("b")]),
    ]
}

#[test]
fn a_density_sums_to_one() {
    let space = space();
    let settings = [
        vec![json!(0.3), json!(2), json!("b")],
        vec![json!(1.9), json!(4), json!("a")],
    ];
    let settings: Vec<&[Value]> = settings.iter().map(Vec::as_slice).collect();
    let mixture = Mixture::of(&space, &settings);
    let mut sum = 0.0;
    let n = 2000;
    for place in 0..n {
        let share = 2.0 * (f64::from(place) + 0.5) / f64::from(n);
        for integer in 1..=4 {
            for word in ["a", "b"] {
                sum += mixture
                    .log_density(&[json!(share), json!(integer), json!(word)])
                    .exp()
                    / f64::from(n);
            }
        }
    }
    assert!((sum - 1.0).abs() < 1e-6, "{sum}");
}

#[test]
fn kernels_are_as_wide_and_weigh_as_much_as_is_written() {
    // Two keys: 0.2 * 16^(-1/6); with few settings one part in n + 2.
    assert!((width(16, 2) - 0.2 * 16f64.powf(-1.0 / 6.0)).abs() < 1e-15);
    assert_eq!(width(1, 2), 1.0 / 3.0);
    assert_eq!(weights(2), [1.0, 1.0, 1.0]);
    let old = weights(28);
    assert_eq!(old.len(), 29);
    let expected = [1.0 / 28.0, (1.0 / 28.0 + 1.0) / 2.0, 1.0, 1.0];
    assert!(
        old.iter()
            .zip(expected)
            .all(|(one, other)| (one - other).abs() < 1e-15),
        "{old:?}"
    );
    assert_eq!([0, 1, 10, 11, 400].map(n_good), [0, 1, 1, 2, 25]);
    assert_eq!(
        listed(&[json!("a"), json!("b")], Some(&json!("b")), 3),
        [0.25 / 1.5, 1.25 / 1.5]
    );
}

#[test]
fn what_is_drawn_has_the_density() {
    let space = vec![space().remove(0)];
    let setting = [json!(0.4)];
    let mixture = Mixture::of(&space, &[&setting]);
    let mut rng = random::stream(&["draws"]);
    let n = 20_000;
    let below = |limit: f64, rng: &mut Rng| {
        let inside = (0..n)
            .filter(|_| mixture.draw(rng)[0].as_f64().unwrap() < limit)
            .count();
        inside as f64 / f64::from(n)
    };
    let expected = |limit: f64| {
        let cells = 4000;
        let at = |place| limit * (f64::from(place) + 0.5) / f64::from(cells);
        // Densities are over shares, which are half as long as values here.
        let sum: f64 = (0..cells)
            .map(|place| mixture.log_density(&[json!(at(place))]).exp())
            .sum();
        sum * limit / 2.0 / f64::from(cells)
    };
    for limit in [0.3, 0.8, 1.5] {
        let (found, expected) = (below(limit, &mut rng), expected(limit));
        assert!(
            (found - expected).abs() < 0.015,
            "{limit}: {found} against {expected}"
        );
    }
}

#[test]
fn settings_under_way_repel() {
    let space = vec![space().remove(0)];
    let tried: Vec<([Value; 1], f64)> = (0..12)
        .map(|place| ([json!(0.15 * f64::from(place))], -f64::from(place)))
        .collect();
    let tried: Vec<(&[Value], f64)> = tried.iter().map(|(point, value)| (&point[..], *value)).collect();
    let mean = |under_way: &[&[Value]]| {
        let mut rng = random::stream(&["liar"]);
        let drawn = (0..200).map(|_| {
            propose(&space, &tried, under_way, 24, &mut rng)[0]
                .as_f64()
                .unwrap()
        });
        drawn.sum::<f64>() / 200.0
    };
    let there = [json!(0.0)];
    assert!(mean(&[&there, &there, &there]) > mean(&[]) + 0.02);
}
