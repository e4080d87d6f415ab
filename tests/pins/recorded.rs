//! Everything that a pinned trial records.

use crate::datasets;
use contract::{Registry, cast::Actors, digest, part::Part, trial::TrialKey};
use serde_json::Value;
use std::{
    fmt::Write as _,
    panic::{AssertUnwindSafe, catch_unwind},
};

/// Hash of everything that a trial records, to the bit.
pub(crate) fn digest(registry: &Registry, trial: &[Part; 3]) -> Result<String, String> {
    Ok(digest::of_json(&Value::String(recorded(registry, trial)?)))
}

/// Every row that a trial records in one line of text, its value in bits.
pub(crate) fn recorded(registry: &Registry, trial: &[Part; 3]) -> Result<String, String> {
    let [environment, agent, protocol] = trial.clone().map(|part| Part { version: 0, ..part });
    let agent = Actors::Agent(agent);
    let key = TrialKey {
        environment: environment.into(),
        agent: agent.into(),
        protocol: protocol.into(),
        seed: 7,
        numerics: 0,
    };
    // Not every agent fits every protocol, and some say so by a panic.
    let run = AssertUnwindSafe(|| datasets::run(registry, &key, None, &mut contract::NoKeeper));
    let record = catch_unwind(run)
        .map_err(|_| "it panicked")?
        .map_err(|error| error.to_string())?;
    let mut text = String::new();
    for row in record.rows() {
        let (phase, name, bits) = (
            row.phase.name(),
            &record.names()[usize::from(row.metric)],
            row.value.to_bits(),
        );
        writeln!(
            text,
            "{phase} {} {} {} {name} {bits:016x}",
            row.step, row.episode, row.seat
        )
        .unwrap();
    }
    Ok(text)
}
