//! The message about running trials when a run is stopped.

use crate::programs;
use contract::Registry;
use execution::scheduler::{Event, Task};
use std::collections::BTreeMap;

/// The trials that run, until the first of them is stopped.
pub(super) struct Stopping<'a> {
    registry: &'a Registry,
    tasks: &'a [Task<'a>],
    /// The trial of each busy slot.
    running: BTreeMap<usize, usize>,
    is_told: bool,
}

impl<'a> Stopping<'a> {
    /// No trial runs yet.
    pub(super) fn of(registry: &'a Registry, tasks: &'a [Task<'a>]) -> Self {
        Self {
            registry,
            tasks,
            running: BTreeMap::new(),
            is_told: false,
        }
    }

    /// Takes note of an event; the message when the first trial is stopped.
    pub(super) fn hear(&mut self, event: &Event) -> Option<String> {
        match event {
            Event::Started { slot, trial } => drop(self.running.insert(*slot, *trial)),
            Event::Ended { slot, .. }
            | Event::Retried { slot, .. }
            | Event::Paused { slot, .. }
            | Event::Lost { slot, .. }
            | Event::Broken { slot, .. } => drop(self.running.remove(slot)),
            Event::Stopped { .. } if !std::mem::replace(&mut self.is_told, true) => {
                return Some(format!(
                    "stopping: {}; a second Ctrl-C ends at once",
                    self.in_words()
                ));
            }
            _ => {}
        }
        None
    }

    /// The fate of the running trials.
    fn in_words(&self) -> &'static str {
        let begins_anew = |trial: &&usize| {
            let agent = self.tasks[**trial].trial.key.agent.agent();
            agent.is_some_and(|part| programs::begins_anew(self.registry, part))
        };
        match self.running.values().filter(begins_anew).count() {
            0 => "running trials save a checkpoint",
            all if all == self.running.len() => {
                "running trials begin anew with the next run, since their programs have no `resume`"
            }
            _ => {
                "running trials save a checkpoint; those of programs without `resume` begin anew with the next run"
            }
        }
    }
}
