//! Options of the executor `slurm`: the table `[slurm]` in `regimen.toml`.

use crate::executor::{Error, four_each};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{
    num::{NonZeroU32, NonZeroUsize},
    time::Duration,
};

/// The table `[slurm]`. Every key can be left out.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table of options")]
pub struct SlurmOptions {
    /// Partition; the cluster's default.
    pub partition: Option<String>,
    /// Account to be charged.
    pub account: Option<String>,
    /// Limit of the running time of one task, in Slurm's words (`90`, `4:00:00`, `2-12:00`); the partition's
    /// default.
    pub time: Option<String>,
    /// Cores of one task, each with a worker process; 1.
    pub cpus_per_task: Option<NonZeroUsize>,
    /// Graphics cards of one task, as `--gres=gpu:N`; none. Set their kind by an argument: `["--gres=gpu:a100:1"]`.
    pub gpus_per_task: Option<NonZeroUsize>,
    /// Memory of one task in megabytes; the cluster's default.
    pub memory_mb: Option<NonZeroU32>,
    /// Tasks that may run at a time; 100.
    pub max_tasks: Option<NonZeroUsize>,
    /// Number of missing trials for each task; 4 for each of its cores.
    pub trials_per_task: Option<NonZeroUsize>,
    /// Seconds before the time limit at which a task is told to save its work; 120, and at most a quarter of `time`.
    pub signal_lead_s: Option<u64>,
    /// Number of consecutive submissions that may end without finishing a trial; 20.
    pub resubmissions: Option<usize>,
    /// Interval between two requests to the queue, in seconds; 5.
    pub poll_s: Option<NonZeroU32>,
    /// Longest time until `squeue`, `scontrol` and `scancel` answer, in seconds; 60. A command that takes longer is
    /// ended, and the controller is asked again.
    pub answer_s: Option<NonZeroU32>,
    /// Longest time until `sbatch` answers, in seconds; 300. A job that was taken without an answer is found again by
    /// its name.
    pub submit_s: Option<NonZeroU32>,
    /// Further arguments of `sbatch`, as in `["--qos=long"]`.
    pub arguments: Option<Vec<String>>,
    /// Lines of shell before the worker starts, as in `["module load cuda"]`.
    pub setup: Option<Vec<String>>,
}

/// Arguments of `sbatch` that the submission sets itself: identity, size and the location of logs.
const OURS: [&str; 13] = [
    "--job-name",
    "-J",
    "--comment",
    "--array",
    "-a",
    "--output",
    "-o",
    "--error",
    "-e",
    "--chdir",
    "-D",
    "--open-mode",
    "--wrap",
];

const LEAD_S: u64 = 120;

impl SlurmOptions {
    /// Cores of one task.
    #[must_use]
    pub fn cpus_per_task(&self) -> NonZeroUsize {
        self.cpus_per_task.unwrap_or(NonZeroUsize::MIN)
    }

    /// Tasks that may run at a time.
    #[must_use]
    pub fn max_tasks(&self) -> usize {
        self.max_tasks.map_or(100, NonZeroUsize::get)
    }

    /// Number of missing trials for each task.
    #[must_use]
    pub fn trials_per_task(&self) -> NonZeroUsize {
        self.trials_per_task
            .unwrap_or_else(|| four_each(self.cpus_per_task()))
    }

    /// Seconds between the early signal and the time limit.
    #[must_use]
    pub fn signal_lead_s(&self) -> u64 {
        let limit_s = self.time.as_deref().and_then(limit_s);
        self.signal_lead_s
            .unwrap_or_else(|| limit_s.map_or(LEAD_S, |limit_s| LEAD_S.min(limit_s / 4)))
    }

    /// Number of consecutive fruitless submissions before giving up.
    #[must_use]
    pub fn resubmissions(&self) -> usize {
        self.resubmissions.unwrap_or(20)
    }

    /// Seconds between two requests to the queue.
    #[must_use]
    pub fn poll_s(&self) -> f64 {
        self.poll_s.map_or(5.0, |seconds| f64::from(seconds.get()))
    }

    /// Longest time until a request is answered.
    #[must_use]
    pub fn answer(&self) -> Duration {
        seconds(self.answer_s, 60)
    }

    /// Longest time until a submission is answered.
    #[must_use]
    pub fn submit(&self) -> Duration {
        seconds(self.submit_s, 300)
    }

    /// Refuses values that Slurm would misread.
    ///
    /// # Errors
    /// [`Error::Option`] with the key.
    pub fn check(&self) -> Result<(), Error> {
        let wrong = |key: &'static str, problem: String| Err(Error::Option { key, problem });
        for (key, text) in [("partition", &self.partition), ("account", &self.account)] {
            if text
                .as_ref()
                .is_some_and(|text| text.is_empty() || text.chars().any(char::is_control))
            {
                return wrong(key, "write one line, and not an empty one".into());
            }
        }
        self.check_time()?;
        for argument in self.arguments.iter().flatten() {
            let name = argument.split('=').next().unwrap_or_default();
            if !argument.starts_with('-') || argument.chars().any(char::is_control) {
                return wrong(
                    "arguments",
                    format!("`{argument}`: write one option with its value, as in \"--qos=long\""),
                );
            }
            if OURS.contains(&name) {
                return wrong(
                    "arguments",
                    format!("`{name}` is what regimen itself tells sbatch"),
                );
            }
        }
        Ok(())
    }

    fn check_time(&self) -> Result<(), Error> {
        let Some(time) = &self.time else { return Ok(()) };
        let Some(limit_s) = limit_s(time) else {
            let problem = format!(
                "`{time}` is no time limit; write minutes, hours:minutes:seconds or days-hours:minutes"
            );
            return Err(Error::Option { key: "time", problem });
        };
        if self.signal_lead_s() >= limit_s {
            let problem = format!(
                "{} s is not below the time limit of {limit_s} s",
                self.signal_lead_s()
            );
            return Err(Error::Option {
                key: "signal_lead_s",
                problem,
            });
        }
        Ok(())
    }
}

fn seconds(given: Option<NonZeroU32>, usual: u32) -> Duration {
    Duration::from_secs(given.map_or(usual, NonZeroU32::get).into())
}

/// Seconds of a time limit: `minutes`, `minutes:seconds`, `hours:minutes:seconds`,
/// `days-hours[:minutes[:seconds]]`.
fn limit_s(text: &str) -> Option<u64> {
    let numbers = |text: &str| {
        text.split(':')
            .map(|part| part.parse::<u64>().ok())
            .collect::<Option<Vec<_>>>()
    };
    let (days, seconds) = match text.split_once('-') {
        Some((days, rest)) => (
            days.parse::<u64>().ok()?,
            match numbers(rest)?[..] {
                [hours] => hours * 3600,
                [hours, minutes] => hours * 3600 + minutes * 60,
                [hours, minutes, seconds] => hours * 3600 + minutes * 60 + seconds,
                _ => return None,
            },
        ),
        None => match numbers(text)?[..] {
            [minutes] => (0, minutes * 60),
            [minutes, seconds] => (0, minutes * 60 + seconds),
            [hours, minutes, seconds] => (0, hours * 3600 + minutes * 60 + seconds),
            _ => return None,
        },
    };
    Some(days * 86_400 + seconds).filter(|limit_s| *limit_s > 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_read_as_slurm_reads_them() {
        let cases = [
            ("90", 5400),
            ("1:30", 90),
            ("4:00:00", 14_400),
            ("2-12", 216_000),
            ("1-0:30", 88_200),
            ("1-1:1:1", 90_061),
        ];
        for (text, expected) in cases {
            assert_eq!(limit_s(text), Some(expected), "{text}");
        }
        for text in ["", "0", "four", "1:2:3:4", "-1", "1-"] {
            assert_eq!(limit_s(text), None, "{text}");
        }
    }

    #[test]
    fn the_early_signal_leaves_most_of_the_time() {
        let of = |time: &str| {
            SlurmOptions {
                time: Some(time.into()),
                ..SlurmOptions::default()
            }
            .signal_lead_s()
        };
        assert_eq!(
            (SlurmOptions::default().signal_lead_s(), of("4:00:00"), of("2")),
            (120, 120, 30)
        );
    }

    #[test]
    fn what_slurm_would_misread_is_refused_by_its_key() {
        let text = |options: SlurmOptions| options.check().unwrap_err().to_string();
        let time = |time: &str| SlurmOptions {
            time: Some(time.into()),
            ..SlurmOptions::default()
        };
        assert!(text(time("soon")).starts_with("`time`: `soon`"));
        assert!(
            text(SlurmOptions {
                signal_lead_s: Some(90),
                ..time("1")
            })
            .starts_with("`signal_lead_s`: 90 s")
        );
        assert!(
            text(SlurmOptions {
                partition: Some("a\nb".into()),
                ..SlurmOptions::default()
            })
            .starts_with("`partition`")
        );
        let with = |argument: &str| SlurmOptions {
            arguments: Some(vec![argument.into()]),
            ..SlurmOptions::default()
        };
        assert!(text(with("--array=0-3")).contains("`--array` is what regimen itself"));
        assert!(text(with("long")).starts_with("`arguments`: `long`"));
        assert!(with("--qos=long").check().is_ok());
    }
}
