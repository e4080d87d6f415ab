//! Successive halving and Hyperband over pauses of ordinary trials.
//!
//! Li, Jamieson, DeSalvo, Rostamizadeh and Talwalkar 2018, "Hyperband", JMLR 18(185). Trials of random settings pause
//! at the same steps, and the best part of those of a bracket continues. A later bracket has fewer settings and one
//! pause less, so that settings that learn slowly have a chance. A pause does not make a different trial: a trial that
//! continues ends with the bits of one that was never paused, and is the same trial as that of a sweep.
//!
//! | paper | here |
//! |---|---|
//! | eta | 1 / `keep` |
//! | s | the bracket; bracket `b` begins with the pause `b` |
//! | r_i | `pauses` |

use super::{Direction, Halving, Tried, best_at, share_of};
use std::ops::Range;

/// The step at which each setting pauses, as far as the values decide; `None` for one that runs to its end.
pub(super) fn stops(options: &Halving, direction: Direction, tried: &[Tried]) -> Vec<Option<u64>> {
    let mut stops = vec![None; tried.len()];
    for (bracket, places) in brackets(options, tried.len()).into_iter().enumerate() {
        let mut alive: Vec<usize> = places.collect();
        for pause in &options.pauses[bracket.min(options.pauses.len())..] {
            alive.iter().for_each(|place| stops[*place] = Some(*pause));
            let Some(best) = best_part(&alive, *pause, options.keep, direction, tried) else {
                alive.clear();
                break;
            };
            alive = best;
        }
        alive.iter().for_each(|place| stops[*place] = None);
    }
    stops
}

/// Number of settings, out of `n_settings`, that run to their ends.
pub(super) fn n_ends(options: &Halving, n_settings: usize) -> usize {
    let of_bracket = |(bracket, places): (usize, Range<usize>)| {
        let pauses = options.pauses.len().saturating_sub(bracket);
        (0..pauses).fold(places.len(), |alive, _| {
            share_of(alive, options.keep).max(1).min(alive)
        })
    };
    brackets(options, n_settings)
        .into_iter()
        .enumerate()
        .map(of_bracket)
        .sum()
}

/// The settings that continue after a pause; `None` as long as one has not reached it.
fn best_part(
    alive: &[usize],
    pause: u64,
    keep: f64,
    direction: Direction,
    tried: &[Tried],
) -> Option<Vec<usize>> {
    let mut best = best_at(direction, tried, alive.iter().copied(), pause)?;
    best.truncate(share_of(alive.len(), keep).max(1));
    Some(best)
}

/// The places of each bracket, the one with the most pauses first. Brackets cost about the same number of steps.
pub(super) fn brackets(options: &Halving, n_settings: usize) -> Vec<Range<usize>> {
    let n_brackets = options.brackets.clamp(1, options.pauses.len() + 1);
    let weights: Vec<f64> = (0..n_brackets)
        .map(|bracket| 1.0 / cost(options, bracket))
        .collect();
    let sum: f64 = weights.iter().sum();
    let mut ends = Vec::new();
    let mut share = 0.0;
    for weight in &weights {
        share += weight / sum;
        ends.push(share_of(n_settings, share).min(n_settings));
    }
    // No setting is left out by rounding.
    if let Some(last) = ends.last_mut() {
        *last = n_settings;
    }
    let starts = std::iter::once(0).chain(ends.iter().copied());
    starts
        .zip(ends.iter().copied())
        .map(|(start, end)| start..end)
        .collect()
}

/// Mean number of steps of a setting of a bracket; its end is assumed to be as far beyond the last pause as `keep`
/// suggests.
#[allow(clippy::cast_precision_loss, reason = "steps are far below 2^52")]
fn cost(options: &Halving, bracket: usize) -> f64 {
    let last = options.pauses.last().map_or(1.0, |last| *last as f64);
    let steps = options
        .pauses
        .iter()
        .map(|pause| *pause as f64)
        .chain([last / options.keep]);
    let (mut before, mut alive, mut cost) = (0.0, 1.0, 0.0);
    for step in steps.skip(bracket) {
        cost += alive * (step - before);
        (before, alive) = (step, alive * options.keep);
    }
    cost
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    fn options(brackets: usize) -> Halving {
        Halving {
            pauses: vec![100, 300],
            keep: 1.0 / 3.0,
            brackets,
        }
    }

    /// Settings whose values at pauses are known up to a step.
    fn tried(values: &[Option<f64>], until: u64) -> Vec<Tried> {
        let one = |value: &Option<f64>| Tried {
            pauses: [100, 300]
                .into_iter()
                .filter(|pause| *pause <= until)
                .map(|pause| (pause, *value))
                .collect(),
            ..Tried::new(Vec::new())
        };
        values.iter().map(one).collect()
    }

    #[test]
    fn the_best_third_goes_on_and_what_failed_never_does() {
        let values: Vec<Option<f64>> = [5.0, 1.0, 7.0, 7.0, 2.0, 0.0, 3.0, 9.0, 4.0].map(Some).into();
        assert_eq!(
            stops(&options(1), Direction::Maximize, &tried(&values, 0)),
            vec![Some(100); 9]
        );
        let after = stops(&options(1), Direction::Maximize, &tried(&values, 100));
        let expected = [100, 100, 300, 300, 100, 100, 100, 300, 100].map(Some);
        assert_eq!(after, expected);
        let least = stops(&options(1), Direction::Minimize, &tried(&values, 300));
        assert_eq!(least.iter().position(Option::is_none), Some(5));
        let failed = stops(&options(1), Direction::Maximize, &tried(&[None; 9], 300));
        assert_eq!(failed, vec![Some(100); 9]);
    }

    #[test]
    fn as_many_settings_end_as_is_said() {
        for (n_brackets, n_settings) in
            (1..4).flat_map(|brackets| (0..40).map(move |settings| (brackets, settings)))
        {
            let values: Vec<Option<f64>> = (0..n_settings).map(|place| Some(f64::from(place))).collect();
            let stops = stops(&options(n_brackets), Direction::Maximize, &tried(&values, 300));
            let ends = stops.iter().filter(|stop| stop.is_none()).count();
            assert_eq!(
                n_ends(&options(n_brackets), values.len()),
                ends,
                "{n_brackets} {n_settings}"
            );
        }
    }

    #[test]
    fn a_bracket_waits_for_all_of_its_own_and_for_no_other() {
        let mut values = tried(&[Some(1.0); 12], 300);
        let places = brackets(&options(3), 12);
        assert_eq!(places.len(), 3);
        assert_eq!(places.last().unwrap().end, 12);
        // The first bracket has twice as many settings as the last, which runs all to their ends.
        assert!(
            places[0].len() > places[1].len() && places[1].len() >= places[2].len(),
            "{places:?}"
        );
        values[0].pauses = BTreeMap::new();
        let stops = stops(&options(3), Direction::Maximize, &values);
        assert!(stops[places[0].clone()].iter().all(|stop| *stop == Some(100)));
        assert!(stops[places[1].clone()].contains(&None));
        assert!(stops[places[2].clone()].iter().all(Option::is_none));
    }
}
