//! Learners with seeds in two groups: those that are no better than an agent that learned nothing, and the rest.
//!
//! A mean over both describes neither, and its t interval covers too rarely where one seed in fifty collapses.

use super::StudyInfo;
use analysis::{results::Results, training_share::trained};
use contract::{Better, Phase, trial::Combination};
use presentation::table::{Cell, Grid};
use statistics::{MeanEstimate, Share, estimators::mean};

/// A sentence for each value of a table with such a split of seeds; none if numbers are relative to those of an agent.
pub(super) fn notes(grid: &Grid, metric: &str, study: &StudyInfo, results: &Results) -> Vec<String> {
    if grid.quantity.relative.is_some() || study.floors.is_empty() {
        return Vec::new();
    }
    let note = |(place, cell): (String, &Cell)| {
        let (better, floor) = floor_of(cell, metric, study, results)?;
        let split = Split::of(cell, better, floor)?;
        Some(format!("{place}: {}", split.in_words(grid)))
    };
    grid.places().filter_map(note).collect()
}

/// The better direction, and the best value of an agent that learned nothing, for the one learner behind a cell.
fn floor_of(cell: &Cell, metric: &str, study: &StudyInfo, results: &Results) -> Option<(Better, f64)> {
    let better = *study.better.get(metric)?;
    let mut behind = cell.rests_on.iter();
    let (Some(own), None) = (behind.next(), behind.next()) else {
        return None;
    };
    let is = |it: &Combination, agent: &str| it.environment == own.environment && it.agent == agent;
    let trials: Vec<_> = results
        .trials
        .iter()
        .filter(|it| it.combination() == own)
        .collect();
    if trained(&trials, results).is_empty() {
        return None;
    }
    let of_floor = |floor: &String| {
        let trials = results
            .trials
            .iter()
            .filter(|it| is(it.combination(), floor) && it.is_ok());
        let values: Vec<f64> = trials.filter_map(|it| it.mean(Phase::Final, metric)).collect();
        (!values.is_empty()).then(|| mean(&values))
    };
    let floors = study.floors.iter().filter_map(of_floor);
    let best = floors.reduce(match better {
        Better::Higher => f64::max,
        Better::Lower => f64::min,
    })?;
    Some((better, best))
}

/// Seeds on both sides of a floor.
#[derive(Debug, PartialEq)]
struct Split {
    collapsed: Share,
    others: Vec<f64>,
}

impl Split {
    fn of(cell: &Cell, better: Better, floor: f64) -> Option<Self> {
        let is_better = |value: f64| match better {
            Better::Higher => value > floor,
            Better::Lower => value < floor,
        };
        let values = cell.seeds.iter().map(|(_, value)| *value);
        let others: Vec<f64> = values.clone().filter(|value| is_better(*value)).collect();
        let collapsed = Share::of(values.map(|value| !is_better(value)));
        (collapsed.successes > 0 && !others.is_empty()).then_some(Self { collapsed, others })
    }

    fn in_words(&self, grid: &Grid) -> String {
        let Share { successes, n } = self.collapsed;
        let percent = |share: f64| format!("{:.0}", 100.0 * share);
        let range = self.collapsed.interval(0.95).map_or_else(String::new, |it| {
            format!(
                ", {} to {} % by the exact 95 % interval",
                percent(it.low),
                percent(it.high)
            )
        });
        let estimate = MeanEstimate::of(&self.others);
        let rest = grid.format.write(estimate.value);
        let rest = estimate.interval(0.95).map_or_else(
            || rest.clone(),
            |it| {
                format!(
                    "{rest} [{}, {}]",
                    grid.format.write(it.low),
                    grid.format.write(it.high)
                )
            },
        );
        format!(
            "{successes} of {n} seeds are no better than an agent that learned nothing ({} %{range}); the mean of the rest is {rest}.",
            percent(self.collapsed.value())
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::standard_metrics::UPDATES;
    use presentation::table::{self, Axis, Comparison, TableSpec};
    use std::collections::BTreeMap;
    use testing::synthetic::trial;

    #[test]
    fn seeds_that_collapsed_are_counted_and_the_rest_has_a_mean() {
        let last = |agent: &str, seed: u64, value: f64, learns: bool| {
            let mut rows = vec![(Phase::Final, 10, 0, "x", value)];
            rows.extend(learns.then_some((Phase::Final, 10, 0, UPDATES, 3.0)));
            let mut it = trial("field", agent, "", seed, &rows);
            let mut protocol = (*it.trial.key.protocol).clone();
            protocol.config = serde_json::json!({ "steps": 10 }).into();
            it.trial_mut().key.protocol = protocol.into();
            it
        };
        let learner = [5.0, 5.2, -40.0, 5.1]
            .into_iter()
            .zip(0..)
            .map(|(x, seed)| last("learner", seed, x, true));
        let steady = [5.0, 5.2, 5.3]
            .into_iter()
            .zip(0..)
            .map(|(x, seed)| last("steady", seed, x, true));
        let random = (0..3).map(|seed| last("random", seed, 1.0, false));
        let results = Results::of(learner.chain(steady).chain(random).collect());
        let study = StudyInfo {
            floors: vec!["random".into()],
            better: BTreeMap::from([("x".to_owned(), Better::Higher)]),
            ..StudyInfo::default()
        };
        let spec = TableSpec::of(Comparison {
            rows: Axis::Agent.into(),
            value: "x".into(),
            ..Comparison::default()
        });
        let grid = table::build(&spec, &results).unwrap();
        let notes = notes(&grid, "x", &study, &results);
        assert_eq!(notes.len(), 1, "{notes:?}");
        assert!(
            notes[0].starts_with(
                "learner: 1 of 4 seeds are no better than an agent that learned nothing (25 %, 1 to 81 % by the \
                 exact 95 % interval); the mean of the rest is 5.1"
            ),
            "{notes:?}"
        );
    }
}
