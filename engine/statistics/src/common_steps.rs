//! Runs that were measured at steps of their own, evaluated at common steps: a value holds until the next one is
//! measured. The steps are those at which any of the runs was measured, from the latest first step of a run to the
//! earliest last step of one. Every run therefore has a value at each of them, and no value comes from before a run
//! began or from after it ended. Runs with equal steps keep these steps and their own values.

/// Values of a run by step, in ascending order.
pub type StepSeries = Vec<(u64, f64)>;

/// Calls `see` with each shared step and the values of all runs there, in their order.
pub fn at_common_steps(runs: &[&[(u64, f64)]], mut see: impl FnMut(u64, &[f64])) {
    let Some((begin, end)) = shared_stretch(runs) else {
        return;
    };
    let within = |(step, _): &&(u64, f64)| (begin..=end).contains(step);
    let own = runs.iter().flat_map(|run| run.iter().filter(within));
    let mut steps: Vec<u64> = own.map(|(step, _)| *step).collect();
    steps.sort_unstable();
    steps.dedup();
    let mut places = vec![0; runs.len()];
    let mut values = vec![0.0; runs.len()];
    for step in steps {
        for ((run, place), value) in runs.iter().zip(&mut places).zip(&mut values) {
            while run.get(*place + 1).is_some_and(|(next, _)| *next <= step) {
                *place += 1;
            }
            *value = run[*place].1;
        }
        see(step, &values);
    }
}

/// The first and the last step at which all runs have a value; `None` if there is none.
#[must_use]
pub fn shared_stretch(runs: &[&[(u64, f64)]]) -> Option<(u64, u64)> {
    let ends = |run: &&[(u64, f64)]| Some((run.first()?.0, run.last()?.0));
    let ends: Vec<(u64, u64)> = runs.iter().map(ends).collect::<Option<_>>()?;
    let begin = ends.iter().map(|(first, _)| *first).max()?;
    let end = ends.iter().map(|(_, last)| *last).min()?;
    (begin <= end).then_some((begin, end))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    fn common(runs: &[StepSeries]) -> Vec<(u64, Vec<f64>)> {
        let slices: Vec<&[(u64, f64)]> = runs.iter().map(Vec::as_slice).collect();
        let mut seen = Vec::new();
        at_common_steps(&slices, |step, values| seen.push((step, values.to_vec())));
        seen
    }

    #[test]
    fn a_value_holds_until_the_next_one_between_the_last_begin_and_the_first_end() {
        let runs = [
            vec![(0, 0.0), (100, 1.0), (200, 2.0)],
            vec![(50, 10.0), (150, 11.0), (250, 12.0)],
        ];
        let expected = [
            (50, vec![0.0, 10.0]),
            (100, vec![1.0, 10.0]),
            (150, vec![1.0, 11.0]),
            (200, vec![2.0, 11.0]),
        ];
        assert_eq!(common(&runs), expected);
    }

    #[test]
    fn runs_that_share_no_stretch_have_no_common_steps() {
        assert!(common(&[vec![(0, 1.0), (5, 1.0)], vec![(6, 1.0)]]).is_empty());
        assert!(common(&[vec![(0, 1.0)], vec![]]).is_empty());
        assert!(common(&[]).is_empty());
    }

    fn run() -> impl Strategy<Value = StepSeries> {
        prop::collection::btree_map(0u64..60, -1e3f64..1e3, 1..30).prop_map(|run| run.into_iter().collect())
    }

    proptest! {
        #[test]
        fn every_run_counts_at_every_step_with_its_last_value(runs in prop::collection::vec(run(), 1..6)) {
            for (step, values) in common(&runs) {
                prop_assert_eq!(values.len(), runs.len());
                for (run, value) in runs.iter().zip(values) {
                    let last = run.iter().rfind(|(at, _)| *at <= step);
                    prop_assert_eq!(last.map(|(_, value)| *value), Some(value));
                    prop_assert!(run.last().unwrap().0 >= step, "a run that ended counts no longer");
                }
            }
        }

        #[test]
        fn runs_with_the_same_steps_keep_their_values(steps in prop::collection::btree_set(0u64..500, 1..40), n in 1usize..5) {
            let runs: Vec<StepSeries> = (0..n).map(|run| steps.iter().map(|step| (*step, (*step * 7 + run as u64) as f64)).collect()).collect();
            let own: BTreeMap<u64, Vec<f64>> = steps.iter().enumerate()
                .map(|(at, step)| (*step, runs.iter().map(|run| run[at].1).collect())).collect();
            prop_assert_eq!(common(&runs), own.into_iter().collect::<Vec<_>>());
        }
    }
}
