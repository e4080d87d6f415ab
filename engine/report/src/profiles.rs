//! Profiles of a study, and their stored trials.

use document::count::{count, either};
use serde::{Deserialize, Serialize};

/// A profile of a study, with the state of its trials.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProfileState {
    /// Its name; `None` for the study without a profile.
    pub name: Option<String>,
    /// Whether the report is made of exactly its trials.
    pub this_report: bool,
    /// Its trials; `None` where the study with this profile is refused.
    pub trials: Option<ProfileTrials>,
}

/// Number of trials of a profile by their state in the store.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProfileTrials {
    /// Number of planned trials.
    pub planned: usize,
    /// Number of trials that ended `ok`.
    pub ok: usize,
    /// Number of trials that ended otherwise.
    pub failed: usize,
    /// Number of trials that ended and belong to no other profile. Profiles usually share the trials of agents that do
    /// not learn.
    pub own: usize,
}

impl ProfileState {
    /// The name; a phrase for the study without a profile.
    #[must_use]
    pub fn name(&self) -> &str {
        self.name.as_deref().unwrap_or("default")
    }

    /// The state of its trials in words, without its name.
    #[must_use]
    pub fn sentence(&self) -> String {
        let Some(trials) = self.trials else {
            return "the study is refused with it".into();
        };
        let ProfileTrials {
            planned,
            ok,
            failed,
            own,
        } = trials;
        let failures = if failed == 0 {
            String::new()
        } else {
            format!(", {failed} failed")
        };
        let stored = if ok == planned {
            format!("all {planned} trials are stored")
        } else {
            format!(
                "{ok} of {} {} stored",
                count(planned, "trial"),
                either(&ok, "is", "are")
            )
        };
        let how = match (ok + failed, own) {
            _ if self.this_report => ": this report",
            (0, _) => ": never run",
            (ended, 0) if ended < planned => ", all of them shared with other profiles: never run itself",
            _ => "",
        };
        format!("{stored}{failures}{how}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sentence(planned: usize, ok: usize, failed: usize, own: usize) -> String {
        let trials = Some(ProfileTrials {
            planned,
            ok,
            failed,
            own,
        });
        ProfileState {
            name: Some("paper".into()),
            this_report: false,
            trials,
        }
        .sentence()
    }

    #[test]
    fn what_never_ran_is_told_from_what_ran_in_part() {
        assert_eq!(sentence(45, 0, 0, 0), "0 of 45 trials are stored: never run");
        assert_eq!(
            sentence(45, 9, 0, 0),
            "9 of 45 trials are stored, all of them shared with other profiles: never run itself"
        );
        assert_eq!(sentence(45, 9, 2, 2), "9 of 45 trials are stored, 2 failed");
        assert_eq!(sentence(45, 45, 0, 0), "all 45 trials are stored");
        let refused = ProfileState {
            name: Some("paper".into()),
            ..ProfileState::default()
        };
        assert_eq!(refused.sentence(), "the study is refused with it");
        let trials = Some(ProfileTrials {
            planned: 3,
            ok: 3,
            failed: 0,
            own: 3,
        });
        let this = ProfileState {
            name: None,
            this_report: true,
            trials,
        };
        assert_eq!(
            (this.name(), this.sentence().as_str()),
            ("default", "all 3 trials are stored: this report")
        );
    }
}
