//! Limits of one trial, and the ends after which it is tried again. Neither affects a trial's identity or its numbers.

use contract::trial_end::EndState;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Limits from a study or `regimen.toml`; an absent one does not limit anything, or has its default.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// Longest time that an attempt at a trial may take; then its process is ended and the trial is a
    /// `timeout`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.001, max = 1e9), extend("x-unit" = "s"))]
    pub wall_time_s: Option<f64>,
    /// Longest time without output or values from a program that trains itself; after it the program is ended and the
    /// trial is a `timeout`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.001, max = 1e9), extend("x-unit" = "s"))]
    pub stalled_after_s: Option<f64>,
    /// Largest memory of a trial's process; beyond it the process is ended and the trial is `oom`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1), extend("x-unit" = "MB"))]
    pub memory_mb: Option<u64>,
    /// Number of times that a trial is tried again; 2 where absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 100))]
    pub retries: Option<u32>,
    /// The ends after which it is tried again, except `ok`; only `killed` where absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub retry_on: Option<Vec<EndState>>,
    /// Wait before the first retry; it doubles with each further one. 0.5 where absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 86400.0), extend("x-unit" = "s"))]
    pub retry_delay_s: Option<f64>,
}

/// A limit that has no effect, or that nothing could satisfy.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{key}` is {value}: {instead}")]
pub struct LimitError {
    /// Key of the limit.
    pub key: &'static str,
    /// The given value.
    pub value: String,
    /// The values that are allowed.
    pub instead: &'static str,
}

impl Limits {
    /// Refuses limits without effect and limits that nothing could satisfy, wherever they are written.
    ///
    /// # Errors
    /// [`LimitError`] for the first key that is wrong.
    pub fn check(&self) -> Result<(), LimitError> {
        let wrong = |key, value: &dyn ToString, instead| {
            let value = value.to_string();
            Err(LimitError { key, value, instead })
        };
        let times = [
            ("wall_time_s", self.wall_time_s),
            ("stalled_after_s", self.stalled_after_s),
        ];
        for (key, time) in times {
            // NaN lies in no range.
            if let Some(value) = time.filter(|value| !(0.001..=1e9).contains(value)) {
                let instead = "write seconds from 0.001 to 1e9, or leave it out where nothing is limited";
                return wrong(key, &value, instead);
            }
        }
        if self.memory_mb == Some(0) {
            let instead = "write 1 megabyte or more, or leave it out where nothing is limited";
            return wrong("memory_mb", &0, instead);
        }
        if let Some(value) = self.retries.filter(|value| *value > 100) {
            return wrong("retries", &value, "write a number from 0 to 100");
        }
        if let Some(value) = self
            .retry_delay_s
            .filter(|value| !(0.0..=86_400.0).contains(value))
        {
            return wrong("retry_delay_s", &value, "write seconds from 0 to 86400");
        }
        if self.retry_on.iter().flatten().any(|state| *state == EndState::Ok) {
            let instead = "a trial that ended ok has nothing to try again; write some of failed, panicked, \
                           timeout, oom, nan and killed";
            return wrong("retry_on", &"ok", instead);
        }
        Ok(())
    }

    /// These limits combined with those of the machine: the tighter wall time and memory apply, and the machine's
    /// values for retries take precedence.
    #[must_use]
    pub fn on(&self, machine: &Limits) -> Limits {
        let tighter = |a: Option<f64>, b: Option<f64>| a.into_iter().chain(b).reduce(f64::min);
        Limits {
            wall_time_s: tighter(self.wall_time_s, machine.wall_time_s),
            stalled_after_s: tighter(self.stalled_after_s, machine.stalled_after_s),
            memory_mb: self.memory_mb.into_iter().chain(machine.memory_mb).min(),
            retries: machine.retries.or(self.retries),
            retry_on: machine.retry_on.clone().or_else(|| self.retry_on.clone()),
            retry_delay_s: machine.retry_delay_s.or(self.retry_delay_s),
        }
    }

    /// Longest duration of an attempt.
    #[must_use]
    pub fn wall_time(&self) -> Option<Duration> {
        self.wall_time_s
            .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
    }

    /// Largest memory of a process in bytes.
    #[must_use]
    pub fn memory_bytes(&self) -> Option<u64> {
        self.memory_mb
            .map(|megabytes| megabytes.saturating_mul(1_000_000))
    }

    /// Wait before the next attempt after `attempts` of them; `None` if the end is final.
    #[must_use]
    pub fn retry_after(&self, end: EndState, attempts: u32) -> Option<Duration> {
        let again = self
            .retry_on
            .as_ref()
            .map_or(end == EndState::Killed, |states| states.contains(&end));
        if !again || end == EndState::Ok || attempts > self.retries.unwrap_or(2) {
            return None;
        }
        let doubled = self.retry_delay_s.unwrap_or(0.5)
            * 2f64.powi(i32::try_from(attempts).unwrap_or(i32::MAX).saturating_sub(1));
        // The wait stays below an hour, for any number of attempts.
        Duration::try_from_secs_f64(doubled.min(3600.0)).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_was_killed_is_tried_again_unless_asked_otherwise() {
        let limits = Limits::default();
        assert_eq!(
            limits.retry_after(EndState::Killed, 1),
            Some(Duration::from_millis(500))
        );
        assert_eq!(
            limits.retry_after(EndState::Killed, 2),
            Some(Duration::from_secs(1))
        );
        assert_eq!(limits.retry_after(EndState::Killed, 3), None);
        for end in [
            EndState::Ok,
            EndState::Failed,
            EndState::Panicked,
            EndState::Timeout,
            EndState::Oom,
            EndState::Nan,
        ] {
            assert_eq!(limits.retry_after(end, 1), None);
        }
        let asked = Limits {
            retry_on: Some(vec![EndState::Timeout]),
            retries: Some(1),
            ..Limits::default()
        };
        assert!(asked.retry_after(EndState::Timeout, 1).is_some());
        assert!(asked.retry_after(EndState::Timeout, 2).is_none());
        assert!(asked.retry_after(EndState::Killed, 1).is_none());
    }

    #[test]
    fn what_limits_nothing_or_everything_is_refused() {
        let told = |limits: Limits| limits.check().map_err(|error| error.to_string());
        assert_eq!(told(Limits::default()), Ok(()));
        for value in [-1.0, 0.0, f64::NAN, f64::INFINITY, 1e300] {
            let limits = Limits {
                wall_time_s: Some(value),
                ..Limits::default()
            };
            let told = told(limits).unwrap_err();
            assert!(
                told.starts_with(&format!("`wall_time_s` is {value}: write ")),
                "{told}"
            );
        }
        for value in [-0.5, f64::NAN, f64::INFINITY] {
            let limits = Limits {
                retry_delay_s: Some(value),
                ..Limits::default()
            };
            assert!(told(limits).unwrap_err().contains("from 0 to 86400"));
        }
        let limits = Limits {
            memory_mb: Some(0),
            ..Limits::default()
        };
        assert!(told(limits).unwrap_err().contains("1 megabyte or more"));
        let limits = Limits {
            retry_on: Some(vec![EndState::Timeout, EndState::Ok]),
            ..Limits::default()
        };
        assert!(told(limits).unwrap_err().starts_with("`retry_on` is ok: "));
    }

    #[test]
    fn the_tighter_limit_holds() {
        let study = Limits {
            wall_time_s: Some(10.0),
            retries: Some(5),
            ..Limits::default()
        };
        let machine = Limits {
            wall_time_s: Some(20.0),
            memory_mb: Some(500),
            retries: Some(0),
            ..Limits::default()
        };
        let both = study.on(&machine);
        assert_eq!(
            (both.wall_time_s, both.memory_mb, both.retries),
            (Some(10.0), Some(500), Some(0))
        );
    }
}
