//! Whether a trial can begin that plays the policies of others.

use crate::{
    results::{EndState, TrialEnd},
    store::{Owner, Store, is_missing},
};

/// What the trials say of each other.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Readiness {
    /// All policies are there.
    Ready,
    /// One of them is still to come from this program.
    Soon,
    /// Another program works on one of them.
    Elsewhere(String, Owner),
    /// One of them does not come, and why.
    Unready(String),
}

/// How far the trials are whose policies one plays. `is_ours` tells which of them this program has still to run.
pub(super) fn readiness(after: &[String], store: &Store, is_ours: impl Fn(&str) -> bool) -> Readiness {
    let mut answer = Readiness::Ready;
    for source in after {
        if is_ours(source) {
            answer = Readiness::Soon;
            continue;
        }
        // In this order: what ends between the two looks is seen to have ended.
        let (owner, end) = (store.running(source), store.end(source));
        match (end, owner) {
            (Ok(Some(TrialEnd { state: EndState::Ok, .. })), _) => {}
            (Ok(Some(end)), None) if !is_missing(Some(&end)) => {
                let reason = if end.reason.is_empty() { String::new() } else { format!(": {}", end.reason) };
                return Readiness::Unready(format!("trial {source} ended as {}{reason}", end.state.name()));
            }
            (_, Some(owner)) => answer = Readiness::Elsewhere(source.clone(), owner),
            (Err(error), None) => return Readiness::Unready(format!("trial {source} cannot be read: {error}")),
            (Ok(_), None) => return Readiness::Unready(format!("trial {source} has not run")),
        }
    }
    answer
}

/// True where every trial whose policy is played has ended `ok`.
#[must_use]
pub fn is_ready(after: &[String], store: &Store) -> bool {
    after.iter().all(|source| store.end(source).ok().flatten().is_some_and(|end| end.state == EndState::Ok))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        setting::Setting,
        trial::{Part, Trial, TrialKey},
    };

    fn trial(seed: u64) -> Trial {
        let part = || Part::new("x", 1, serde_json::Value::Null);
        let key = TrialKey { environment: part(), agent: part(), protocol: part(), seed, numerics: 1, device: "cpu".into() };
        Trial { id: key.id(), environment: "e".into(), agent: "a".into(), setting: String::new(), point: Setting::default(), key }
    }

    #[test]
    fn what_lacks_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        let trials: Vec<Trial> = (0..4).map(trial).collect();
        let ids: Vec<String> = trials.iter().map(|trial| trial.id.clone()).collect();
        for (trial, state) in trials.iter().zip([EndState::Ok, EndState::Nan, EndState::Killed]) {
            let end = TrialEnd { state, reason: "told".into(), wall_s: 0.0, digest: String::new() };
            store.acknowledge(trial, &end).unwrap();
        }
        let of = |wanted: &[usize], ours: &[usize]| {
            let after: Vec<String> = wanted.iter().map(|&index| ids[index].clone()).collect();
            readiness(&after, &store, |id| ours.iter().any(|&index| ids[index] == id))
        };
        assert_eq!(of(&[0], &[]), Readiness::Ready);
        assert_eq!(of(&[], &[]), Readiness::Ready);
        assert_eq!(of(&[0, 3], &[3]), Readiness::Soon);
        assert_eq!(of(&[0, 2], &[]), Readiness::Unready(format!("trial {} has not run", ids[2])));
        // That one fails for good is said though another one is still to come.
        assert_eq!(of(&[3, 1], &[3]), Readiness::Unready(format!("trial {} ended as nan: told", ids[1])));
        assert!(is_ready(&ids[..1], &store) && !is_ready(&ids, &store));
    }
}
