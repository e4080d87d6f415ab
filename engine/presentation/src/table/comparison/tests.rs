//! Comparisons over swept keys whose names have a word in common.

use super::{Comparison, TableAxis, compare};
use crate::table::Cell;
use analysis::results::Results;
use contract::{Phase, trial_result::TrialResult};
use testing::synthetic::trial;

/// The names of the rows of a table over a swept key, with their numbers and estimates.
fn over(key: &str, trials: Vec<TrialResult>) -> Vec<(String, Option<f64>, Vec<Option<f64>>)> {
    let comparison = Comparison {
        rows: TableAxis::Key(key.into()),
        ..Comparison::default()
    };
    let grid = compare(&comparison, &Results::of(trials)).unwrap();
    let rows = grid.rows.iter().zip(&grid.cells);
    let estimates = |cells: &[Cell]| cells.iter().map(|cell| cell.estimate).collect();
    rows.map(|(row, cells)| (row.name.clone(), row.number, estimates(cells)))
        .collect()
}

#[test]
fn of_two_keys_that_share_a_last_word_a_whole_name_takes_one() {
    let with = |agent, setting: &str, value| {
        trial(
            "plant",
            agent,
            setting,
            0,
            &vec![(Phase::Final, 1, 0, "return", value)],
        )
    };
    let both = || {
        let places = [(1, 1, 1.0), (1, 2, 2.0), (2, 1, 3.0), (2, 2, 4.0)];
        places
            .map(|(own, of_plant, value)| {
                with("dsac", &format!("dsac.rate={own} plant.rate={of_plant}"), value)
            })
            .into()
    };
    let row = |name: &str, number, values: [Option<f64>; 2]| (name.to_owned(), number, values.to_vec());
    assert_eq!(
        over("plant.rate", both()),
        [
            row("1", Some(1.0), [Some(1.0), Some(3.0)]),
            row("2", Some(2.0), [Some(2.0), Some(4.0)])
        ]
    );
    // The check refuses the last word; if it did not, nothing would be pooled.
    let values: Vec<_> = over("rate", both()).into_iter().flat_map(|row| row.2).collect();
    assert_eq!(values, [1.0, 2.0, 3.0, 4.0].map(Some));
    let of_two_agents = vec![
        with("dsac", "dsac.rate=1", 1.0),
        with("sac", "sac.rate=1", 2.0),
        with("sac", "sac.rate=2", 3.0),
    ];
    let rows = over("sac.rate", of_two_agents);
    assert_eq!(rows[1], row("1", Some(1.0), [None, Some(2.0)]));
    assert_eq!(rows[0].1, None);
}
