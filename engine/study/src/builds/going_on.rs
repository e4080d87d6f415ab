//! Checks of learning that continues from an artifact: the environment must be the same, and the learned values must
//! fit the agent.

use super::Builder;
use crate::{cell::Cell, dependencies, parts, search::LocatedSearch};
use contract::{
    Agent, ArtifactKind, Interface,
    protocol::{load_from_checkpoint, write_checkpoint_stub},
    random,
};
use document::diagnostic::Diagnostic;
use std::path::Path;

const WHAT_MAY_DIFFER: &str =
    "networks must have the form with which learning began; rates and the like may differ";

impl Builder<'_> {
    /// Refuses a cell that continues from an artifact that does not fit it. The stretches of a schedule fit each other
    /// if the settings at the ends of its ranges do.
    pub(super) fn goes_on_well(&mut self, cell: &Cell, interface: &Interface) -> Result<(), Box<Diagnostic>> {
        let from = cell.sources.iter().find(|it| it.kind == ArtifactKind::Checkpoint);
        let Some(source) = from.filter(|_| cell.parts[2].given.stretch.is_none()) else {
            return Ok(());
        };
        let begun = self.cells.at(source.cell);
        let name = dependencies::name(self.sections, begun.place);
        if begun.parts[0].id() != cell.parts[0].id() {
            let message =
                format!("`{name}` learns in another environment than the one in which that shall go on");
            return Err(Box::new(self.at(cell, source, message)));
        }
        let folder = self.stub(source.cell).unwrap_or_default();
        let mut agent = self.agent(cell, interface)?;
        load_from_checkpoint(&mut *agent, &folder).map_err(|error| {
            let message = format!("what `{name}` learned does not fit the agent that shall go on: {error}");
            Box::new(self.at(cell, source, message).help(WHAT_MAY_DIFFER))
        })
    }

    /// Refuses a population over a key that changes the shape of networks, because a member could not take over the
    /// learned values of another.
    pub(super) fn members_fit(&mut self, searched: &LocatedSearch<'_>) -> Result<(), Box<Diagnostic>> {
        if !searched.search.is_population() {
            return Ok(());
        }
        let pair = (searched.environment, searched.agent);
        let first = self.cells.of_pair(pair).next().map(|index| self.cells.at(index));
        let facts = first.and_then(|cell| self.facts(&cell));
        let (Some(facts), Ok(folder)) = (facts, tempfile::tempdir()) else {
            return Ok(());
        };
        let interface = &facts.interface;
        let shares = vec![0.0; searched.paths.len()];
        // Settings that cannot be built are reported elsewhere.
        let Some(first) = self.member(searched, &shares, interface) else {
            return Ok(());
        };
        if write_checkpoint_stub(folder.path(), &*first).is_err() {
            return Ok(());
        }
        for key in 0..shares.len() {
            let mut other = shares.clone();
            other[key] = 1.0;
            if let Some(member) = self.member(searched, &other, interface) {
                self.takes_up(searched, key, member, folder.path())?;
            }
        }
        Ok(())
    }

    fn takes_up(
        &self,
        searched: &LocatedSearch<'_>,
        key: usize,
        mut member: Box<dyn Agent>,
        folder: &Path,
    ) -> Result<(), Box<Diagnostic>> {
        load_from_checkpoint(&mut *member, folder).map_err(|error| {
            let (text, _) = &searched.search.keys[key];
            let at = format!("tune.{}.over.{text}", searched.search.name);
            let message =
                format!("members with different `{text}` cannot take up what others have learned: {error}");
            let error = self
                .sections
                .sources
                .error(searched.paths[key].span, &at, message);
            Box::new(error.help(format!("{WHAT_MAY_DIFFER}; another method can search this key")))
        })
    }

    /// An agent whose searched keys lie at these shares of their ranges; `None` if it cannot be built.
    fn member(
        &self,
        searched: &LocatedSearch<'_>,
        shares: &[f64],
        interface: &Interface,
    ) -> Option<Box<dyn Agent>> {
        let part = parts::member(self.sections, searched, shares)?;
        let entry = self.sections.registry.agents.get(part.plugin.as_str())?;
        if !part.artifacts.is_empty() {
            return None;
        }
        (entry.build)(&part.config, interface, &mut random::stream(&["check"])).ok()
    }
}
