//! An executor of its own: the script of a job array for the batch system LSF, which a person hands over.

use engine::execution::executor::{
    Error, Executor, ExecutorKind, ExecutorOptions, RegisterExecutor as _, Wanted, Way,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::num::NonZeroUsize;

pub fn register(registry: &mut engine::Registry) {
    registry.executor(|| ExecutorKind {
        name: "lsf",
        title: "LSF",
        about: "workers in a job array of LSF, whose script is written and not submitted",
        way: Way::Written(ExecutorOptions::of(|lsf: Lsf| Ok(Box::new(lsf))), "bsub"),
    });
}

/// The table `[lsf]` in `regimen.toml`.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Lsf {
    /// Queue of the jobs; the default one of LSF.
    queue: Option<String>,
    /// Cores of a job, each with a worker process; 1.
    cpus_per_task: Option<NonZeroUsize>,
    /// Jobs that may run at a time; 100.
    max_tasks: Option<NonZeroUsize>,
    /// Number of missing trials that are worth a job; 4.
    trials_per_task: Option<NonZeroUsize>,
}

impl Executor for Lsf {
    fn cpus_per_task(&self) -> NonZeroUsize {
        self.cpus_per_task.unwrap_or(NonZeroUsize::MIN)
    }

    fn trials_per_task(&self) -> NonZeroUsize {
        self.trials_per_task
            .or(NonZeroUsize::new(4))
            .unwrap_or(NonZeroUsize::MIN)
    }

    fn shares_paths(&self) -> bool {
        true
    }

    fn written(&self, wanted: &Wanted<'_>) -> Result<String, Error> {
        let (jobs, cores) = (
            wanted.trials.div_ceil(self.trials_per_task().get()),
            self.cpus_per_task(),
        );
        let at_once = self.max_tasks.map_or(100, NonZeroUsize::get);
        let queue = self.queue.iter().map(|queue| format!("#BSUB -q {queue}\n"));
        Ok(format!(
            "#!/bin/sh\n#BSUB -J regimen[1-{jobs}]%{at_once}\n#BSUB -n {cores}\n{}cd '{}' && exec {} -j {cores}\n",
            queue.collect::<String>(),
            wanted.work.folder.display(),
            wanted.work.command(),
        ))
    }
}
