//! Readiness of trials that take from others.

use crate::store::{Owner, Store};
use contract::trial_end::{EndState, TrialEnd, is_missing};

/// State of the sources of a trial.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Readiness {
    /// Every source has ended `ok`.
    Ready,
    /// Another program works on one of the sources.
    Elsewhere(String, Owner),
    /// One source will not end successfully by itself, for this reason.
    Unready(String),
}

/// State of the sources of a trial. This program no longer has any of them to run.
pub(super) fn readiness(after: &[String], store: &Store) -> Readiness {
    let mut answer = Readiness::Ready;
    for source in after {
        // Read in this order, so that a source that ends between the two reads is seen as ended.
        let (owner, end) = (store.running(source), store.end(source));
        match (end, owner) {
            (
                Ok(Some(TrialEnd {
                    state: EndState::Ok, ..
                })),
                _,
            ) => {}
            (Ok(Some(end)), None) if !is_missing(Some(&end)) => {
                let reason = if end.reason.is_empty() {
                    String::new()
                } else {
                    format!(": {}", end.reason)
                };
                return Readiness::Unready(format!("trial {source} ended as {}{reason}", end.state.name()));
            }
            (_, Some(owner)) => answer = Readiness::Elsewhere(source.clone(), owner),
            (Err(error), None) => {
                return Readiness::Unready(format!("trial {source} cannot be read: {error}"));
            }
            (Ok(_), None) => return Readiness::Unready(format!("trial {source} has not run")),
        }
    }
    answer
}

/// Whether all sources of a trial have ended `ok`.
#[must_use]
pub fn is_ready(after: &[String], store: &Store) -> bool {
    after.iter().all(|source| {
        store
            .end(source)
            .ok()
            .flatten()
            .is_some_and(|end| end.state == EndState::Ok)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::{
        cast::Actors,
        part::Part,
        trial::{Trial, TrialCell, TrialKey},
    };

    fn trial(seed: u64) -> Trial {
        let part = || Part::new("x", 1, serde_json::Value::Null);
        let agent = Actors::Agent(part());
        let key = TrialKey {
            environment: part().into(),
            agent: agent.into(),
            protocol: part().into(),
            seed,
            numerics: 1,
        };
        Trial {
            id: key.id(),
            cell: TrialCell::of("e", "a").into(),
            key,
        }
    }

    #[test]
    fn what_lacks_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        let trials: Vec<Trial> = (0..4).map(trial).collect();
        let ids: Vec<String> = trials.iter().map(|trial| trial.id.clone()).collect();
        for (trial, state) in trials.iter().zip([EndState::Ok, EndState::Nan, EndState::Killed]) {
            let end = TrialEnd {
                state,
                reason: "told".into(),
                wall_s: 0.0,
                decision_s: None,
                device: None,
                digest: String::new(),
            };
            store.acknowledge(trial, end).unwrap();
        }
        let of = |wanted: &[usize]| {
            let after: Vec<String> = wanted.iter().map(|&index| ids[index].clone()).collect();
            readiness(&after, &store)
        };
        assert_eq!(of(&[0]), Readiness::Ready);
        assert_eq!(of(&[]), Readiness::Ready);
        assert_eq!(
            of(&[0, 2]),
            Readiness::Unready(format!("trial {} has not run", ids[2]))
        );
        assert_eq!(
            of(&[0, 1]),
            Readiness::Unready(format!("trial {} ended as nan: told", ids[1]))
        );
        assert!(is_ready(&ids[..1], &store) && !is_ready(&ids, &store));
    }
}
