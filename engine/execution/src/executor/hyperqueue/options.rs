//! Options of the executor `hyperqueue`: the table `[hyperqueue]` in `regimen.toml`.

use crate::executor::{Error, four_each};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{
    num::{NonZeroU32, NonZeroUsize},
    time::Duration,
};

/// The table `[hyperqueue]`. Every key can be left out.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table of options")]
pub struct HyperQueueOptions {
    /// Directory of the server, from the root or the home (`~/.hq-server`); where absent `HQ_SERVER_DIR`, else
    /// `~/.hq-server`.
    pub server_dir: Option<String>,
    /// The Python that has the package `hyperqueue`, in the version of the server; `python3`.
    pub python: Option<String>,
    /// Cores of one task, each with a worker process; 1.
    pub cpus_per_task: Option<NonZeroUsize>,
    /// Graphics cards of one task, as the resource `gpus/nvidia`; none.
    pub gpus_per_task: Option<NonZeroUsize>,
    /// Seconds that a worker of HyperQueue must still have of its time limit when it is given a task; 0. Tasks then do
    /// not begin at the end of an allocation.
    pub min_time_s: Option<NonZeroU32>,
    /// Largest number of tasks that are submitted and have not ended; 100.
    pub max_tasks: Option<NonZeroUsize>,
    /// Number of missing trials for each task; 4 for each of its cores.
    pub trials_per_task: Option<NonZeroUsize>,
    /// Number of consecutive submissions that may end without finishing a trial; 20.
    pub resubmissions: Option<usize>,
    /// Interval between two requests to the server, in seconds; 5.
    pub poll_s: Option<NonZeroU32>,
    /// Longest time until an answer, in seconds; 60. A request that takes longer is ended and repeated.
    pub answer_s: Option<NonZeroU32>,
    /// Lines of shell before the worker starts, as in `["module load cuda"]`.
    pub setup: Option<Vec<String>>,
}

impl HyperQueueOptions {
    /// The server's directory; empty for the default one.
    #[must_use]
    pub fn directory(&self) -> &str {
        self.server_dir.as_deref().unwrap_or_default()
    }

    /// The Python that has the package.
    #[must_use]
    pub fn python(&self) -> &str {
        self.python.as_deref().unwrap_or("python3")
    }

    /// Cores of one task.
    #[must_use]
    pub fn cpus_per_task(&self) -> NonZeroUsize {
        self.cpus_per_task.unwrap_or(NonZeroUsize::MIN)
    }

    /// Largest number of tasks that are submitted and have not ended.
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

    /// Number of consecutive fruitless submissions before giving up.
    #[must_use]
    pub fn resubmissions(&self) -> usize {
        self.resubmissions.unwrap_or(20)
    }

    /// Seconds between two requests to the server.
    #[must_use]
    pub fn poll_s(&self) -> f64 {
        self.poll_s.map_or(5.0, |seconds| f64::from(seconds.get()))
    }

    /// Longest time until an answer.
    #[must_use]
    pub fn answer(&self) -> Duration {
        Duration::from_secs(self.answer_s.map_or(60, NonZeroU32::get).into())
    }

    /// Refuses values that would mean something else in another folder, or have no effect.
    ///
    /// # Errors
    /// [`Error::Option`] with the key.
    pub fn check(&self) -> Result<(), Error> {
        let wrong = |key: &'static str, problem: String| Err(Error::Option { key, problem });
        let from_somewhere = |path: &String| !path.starts_with('/') && path != "~" && !path.starts_with("~/");
        if let Some(path) = self.server_dir.as_ref().filter(|path| from_somewhere(path)) {
            return wrong(
                "server_dir",
                format!("`{path}`: write it from the root (`/...`) or the home (`~/...`)"),
            );
        }
        if self.python().is_empty() {
            return wrong("python", "write the name or path of a Python".into());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_directory_means_the_same_in_every_folder() {
        let check = |path: &str| {
            let server_dir = Some(path.to_owned());
            HyperQueueOptions {
                server_dir,
                ..HyperQueueOptions::default()
            }
            .check()
        };
        assert!(check("/shared/hq").is_ok() && check("~/.hq-server").is_ok());
        for path in ["hq", "", "~me/hq"] {
            let said = check(path).unwrap_err().to_string();
            assert!(
                said.starts_with(&format!("`server_dir`: `{path}`: write it")),
                "{said}"
            );
        }
    }

    #[test]
    fn an_empty_name_of_python_is_refused() {
        let options: HyperQueueOptions = toml::from_str("python = \"\"").unwrap();
        assert!(options.check().unwrap_err().to_string().starts_with("`python`"));
    }
}
