//! Sentences under tables, figures and claims on what holds for whole agents or metrics.

use analysis::results::{Programs, Results, repeats_in_words};
use contract::standard_metrics::{TIMES_ARE_OF_THE_MACHINE, names_times};
use serde::Serialize;

/// The most imported entries with a sentence each; more share one.
const MOST_ORIGINS: usize = 5;

/// Notes with sentences on the agents in the table or figure: on imported runs, and on programs that were computed
/// twice.
pub(super) fn with_agents(
    mut notes: Vec<String>,
    results: &Results,
    programs: Programs,
    printed: impl Fn(&str) -> Option<String>,
) -> Vec<String> {
    let origins: Vec<_> = results
        .imported
        .iter()
        .filter(|origin| printed(&origin.name).is_some())
        .collect();
    match origins.len() {
        n if n > MOST_ORIGINS => notes.push(format!(
            "{n} of these are imported and were not run here; under Provenance stands what each is."
        )),
        _ => notes.extend(origins.into_iter().map(|origin| origin.sentence.clone())),
    }
    notes.extend(repeats_in_words(&results.repeated, programs, printed));
    notes
}

/// Notes with the sentence on times, where a table or figure shows times.
pub(super) fn with_times(spec: &impl Serialize, mut notes: Vec<String>) -> Vec<String> {
    notes.extend(names_times(spec).then(|| TIMES_ARE_OF_THE_MACHINE.to_owned()));
    notes
}
