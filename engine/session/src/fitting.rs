//! The needs of trials, compared with a machine, a host or a task of a queue before anything runs.

use crate::{Failure, Settings, programs};
use contract::{Registry, part::Part, resources::Capacity};
use execution::{
    executor::{self, LOCAL, Way},
    scheduler::hosts::Host,
};

/// Machines on which trials would run, and the keys that set their cores and cards.
pub(crate) struct Machines {
    /// Cores and cards of each.
    pub(crate) all: Vec<Capacity>,
    /// Their name in messages: `this machine`, `a task`.
    pub(crate) name: &'static str,
    /// Configuration keys that set the cores and cards, for messages.
    pub(crate) keys: String,
}

impl Machines {
    /// This machine, with this number of worker processes.
    pub(crate) fn here(settings: &Settings, workers: usize) -> Self {
        Self {
            all: vec![Capacity {
                cores: workers,
                gpus: settings.gpus.clone(),
            }],
            name: "this machine",
            keys: "`workers` (`-j`) and `gpus` of regimen.toml".into(),
        }
    }

    /// Hosts that answered.
    pub(crate) fn hosts(hosts: &[Host]) -> Self {
        Self {
            all: hosts.iter().map(|host| host.capacity().clone()).collect(),
            name: "the largest host",
            keys: "`workers` in [ssh] of regimen.toml".into(),
        }
    }

    /// The tasks of an executor that has a queue.
    pub(crate) fn tasks(executor: &dyn executor::Executor, name: &str) -> Self {
        let cores = executor.cpus_per_task().get();
        let gpus = executor.gpus_per_task();
        let keys = match gpus {
            Some(_) => "`cpus_per_task` and `gpus_per_task`",
            None => "`cpus_per_task`",
        };
        let gpus = (0..gpus.unwrap_or(0)).map(|card| card.to_string());
        Self {
            all: vec![Capacity {
                cores,
                gpus: gpus.collect(),
            }],
            name: "a task",
            keys: format!("{keys} in [{name}] of regimen.toml"),
        }
    }

    /// The machines of the executor that the settings name; `None` for hosts, which have not been contacted yet.
    pub(crate) fn of(registry: &Registry, settings: &Settings) -> Result<Option<Self>, Failure> {
        if settings.executor == LOCAL {
            return Ok(Some(Self::here(settings, settings.workers)));
        }
        let kind =
            executor::find(registry, &settings.executor).filter(|kind| !matches!(kind.way, Way::Hosts(_)));
        let Some(kind) = kind else { return Ok(None) };
        let executor = settings.executor(&kind, None)?;
        Ok(Some(Self::tasks(&*executor, kind.name)))
    }

    /// Refuses agents whose trials fit on none of these machines.
    pub(crate) fn refuse_unfit<'a>(
        &self,
        registry: &Registry,
        agents: impl Iterator<Item = &'a Part>,
    ) -> Result<(), Failure> {
        for part in agents {
            let needs = registry.needs(Some(part));
            if self.all.iter().any(|machine| machine.fits(&needs)) {
                continue;
            }
            let Some(largest) = self.all.iter().max_by_key(|it| (it.gpus.len(), it.cores)) else {
                continue;
            };
            return Err(Failure::refusal(format!(
                "a trial of `{}` needs {}, and {} has {}\nhelp: `needs` of the program says the first, {} the \
                 second",
                programs::in_short(registry, part),
                needs.in_words(),
                self.name,
                largest.in_words(),
                self.keys
            )));
        }
        Ok(())
    }
}
