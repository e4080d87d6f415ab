//! Agents whose code is not part of this program. They are tried out in the environments of their trials, unless an
//! earlier try-out is known.

use super::{BuildResult, Builder, built};
use crate::{cell::Cell, part::Form};
use contract::{Agent, Error};
use serde_json::json;

impl Builder<'_> {
    /// Refuses an agent whose config disagrees with the agent itself on whether it learns.
    ///
    /// # Errors
    /// The refusal.
    pub(super) fn learns_as_written(&self, cell: &Cell) -> BuildResult<()> {
        let agent = &cell.parts[1];
        let entry = self.entry(cell).filter(|entry| entry.traits.by_config.is_some());
        let is_trained = cell.parts[2].given.form != Form::Alone;
        if entry.is_none_or(|entry| entry.learns_with(&agent.part.config) == is_trained) {
            return Ok(());
        }
        let problem = "it is said in the agent itself: no sweep, search or override can change it";
        Err(Box::new(self.refused(agent, &Error::config("learns", problem))))
    }

    /// Whether the agent of a cell is known to have passed a try-out in its environment.
    pub(super) fn was_tried(&mut self, cell: &Cell) -> bool {
        let is_foreign = self
            .entry(cell)
            .is_some_and(|entry| entry.traits.by_config.is_some());
        let Some(known) = self.sections.announced.filter(|_| is_foreign) else {
            return false;
        };
        let key = key(cell);
        let is_known = known.recall::<bool>(&key) == Some(true);
        if is_known {
            self.is_recalled = true;
            self.announced.insert(key, json!(true));
        }
        is_known
    }

    /// Tries out the agent of a cell in its environment.
    ///
    /// # Errors
    /// The problems that were found.
    pub(super) fn try_out(&mut self, cell: &Cell, agent: &mut dyn Agent) -> BuildResult<()> {
        let entry = &self.sections.registry.environments[cell.parts[0].part.plugin.as_str()];
        let config = self.config(cell, 0);
        let tried = built(|| {
            let config = config?;
            agent.rehearse(&|| (entry.build)(&config))
        });
        match tried {
            Ok(true) => drop(self.announced.insert(key(cell), json!(true))),
            Ok(false) => {}
            Err(error) => return Err(Box::new(self.refused(&cell.parts[1], &error))),
        }
        Ok(())
    }
}

/// Key of the note that the agent of a cell was built or tried out in its environment.
pub(super) fn key(cell: &Cell) -> String {
    format!("{} {}", cell.parts[1].id(), cell.parts[0].id())
}
