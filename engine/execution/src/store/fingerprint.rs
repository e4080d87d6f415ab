//! Fingerprint of a stored result, by which two copies of it are compared.

use super::{METRICS, Store, TrialFile};
use contract::{Build, trial_end::EndState};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// The end of a trial, the digests of its files, and the program that computed it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Fingerprint {
    /// End state of the trial.
    pub state: EndState,
    /// Digest of the values in the metrics file; empty if there is none.
    pub digest: String,
    /// Digests of its artifacts by path inside the trial's folder: of the values of tables, and of the bytes of other
    /// files.
    pub files: BTreeMap<String, String>,
    /// Source code of the program that computed the trial, if it was recorded.
    pub build: Option<Build>,
    /// Time of the end, if the program recorded it.
    pub ended_at: Option<String>,
    /// Whether the agent trained itself, so that honest runs may differ.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub trained_itself: bool,
}

/// A difference between two copies of a trial.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// `state`, `metrics.parquet` or the path of an artifact.
    pub what: String,
    /// Value of the first copy; empty if it has none.
    pub first: String,
    /// Value of the second copy; empty if it has none.
    pub second: String,
}

impl Fingerprint {
    /// The fingerprint of an acknowledgement in a store.
    #[must_use]
    pub fn of(file: &TrialFile, store: &Store) -> Self {
        let (mut digest, mut files) = (file.end.digest.clone(), file.files.clone());
        for (name, values) in store.values_of(file) {
            match name.as_str() {
                METRICS => digest = values,
                _ => drop(files.insert(name, values)),
            }
        }
        Self {
            state: file.end.state,
            digest,
            files,
            build: file.build.clone(),
            ended_at: file.ended_at.clone(),
            trained_itself: file.trained_itself,
        }
    }

    /// Differences between this copy and `other`; empty if both have the same values. The program, the date and the
    /// computing time are measurements and do not count.
    #[must_use]
    pub fn differences(&self, other: &Self) -> Vec<Difference> {
        let mut found = Vec::new();
        let mut hold = |what: &str, first: &str, second: &str| {
            if first != second {
                found.push(Difference {
                    what: what.into(),
                    first: first.into(),
                    second: second.into(),
                });
            }
        };
        hold("state", self.state.name(), other.state.name());
        hold(METRICS, &self.digest, &other.digest);
        let names: BTreeSet<&String> = self.files.keys().chain(other.files.keys()).collect();
        for name in names {
            let digest = |it: &Self| it.files.get(name).cloned().unwrap_or_default();
            hold(name, &digest(self), &digest(other));
        }
        found
    }

    /// Whether two copies that both ended successfully may differ without damage.
    #[must_use]
    pub fn may_differ_from(&self, other: &Self) -> bool {
        let is_free = |it: &Self| it.trained_itself && it.state == EndState::Ok;
        is_free(self) && is_free(other)
    }

    /// The program that computed the trial, as text.
    #[must_use]
    pub fn by(&self) -> String {
        self.build
            .as_ref()
            .map_or_else(|| "a program that did not say".into(), ToString::to_string)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fingerprint(digest: &str, files: &[(&str, &str)]) -> Fingerprint {
        Fingerprint {
            state: EndState::Ok,
            digest: digest.into(),
            files: files
                .iter()
                .map(|(name, digest)| ((*name).into(), (*digest).into()))
                .collect(),
            build: None,
            ended_at: None,
            trained_itself: false,
        }
    }

    #[test]
    fn builds_and_dates_are_no_difference_and_every_digest_is() {
        let one = fingerprint("aa", &[("policy.safetensors", "01")]);
        let later = Fingerprint {
            build: Build::told("0123456789ab", "true"),
            ended_at: Some("2026-01-01T00:00:00Z".into()),
            ..one.clone()
        };
        assert_eq!(one.differences(&later), []);
        let other = fingerprint("bb", &[("policy.safetensors", "02"), ("graph.json", "03")]);
        let found = one.differences(&other);
        let words: Vec<(&str, &str, &str)> = found
            .iter()
            .map(|it| (it.what.as_str(), it.first.as_str(), it.second.as_str()))
            .collect();
        assert_eq!(
            words,
            [
                ("metrics.parquet", "aa", "bb"),
                ("graph.json", "", "03"),
                ("policy.safetensors", "01", "02")
            ]
        );
    }
}
