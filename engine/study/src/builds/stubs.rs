//! Stubs of the artifacts that cells leave, made by agents as they begin. `check` builds the cells that take artifacts
//! from these stubs, so that the code that will read the real artifact refuses a wrong kind or shape before anything
//! runs.

use super::Builder;
use crate::{
    cell::{Cell, Source},
    dependencies,
};
use contract::{
    Agent, ArtifactKind, Error, Interface, artifact::Taken, complete_config::CompleteConfig,
    protocol::write_checkpoint_stub, random,
};
use document::diagnostic::Diagnostic;
use execution::world::fs;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

/// Stubs by cell.
#[derive(Debug, Default)]
pub struct Stubs {
    root: Option<tempfile::TempDir>,
    /// `None` if the cell's parts were refused.
    folders: BTreeMap<usize, Option<PathBuf>>,
}

impl Stubs {
    fn new_folder(&mut self, cell: usize) -> std::io::Result<PathBuf> {
        if self.root.is_none() {
            self.root = Some(tempfile::Builder::new().prefix("regimen-check-").tempdir()?);
        }
        let root = self.root.as_ref().map_or(Path::new(""), tempfile::TempDir::path);
        let folder = root.join(cell.to_string());
        fs::create_dir_all(&folder)?;
        Ok(folder)
    }
}

impl Builder<'_> {
    /// Makes the stubs that a cell takes; false if one cannot be made, which is reported elsewhere.
    ///
    /// # Errors
    /// A cell that does not leave the artifact that is taken from it.
    pub(super) fn sources_are_there(&mut self, cell: &Cell) -> Result<bool, Box<Diagnostic>> {
        for source in cell.sources.iter() {
            let Some(folder) = self.stub(source.cell) else {
                return Ok(false);
            };
            if !source.kind.lies_in(&folder) {
                return Err(Box::new(self.leaves_another(cell, source, &folder)));
            }
        }
        Ok(true)
    }

    /// The folder with the stubs of a cell; `None` if its parts are refused.
    pub(super) fn stub(&mut self, index: usize) -> Option<PathBuf> {
        if let Some(known) = self.stubs.folders.get(&index) {
            return known.clone();
        }
        // Every stretch of a schedule leaves the same things as its first one.
        let cell = self.cells.at(index);
        let first = cell.parts[2].given.stretch.and_then(|_| {
            let mut all = 0..self.cells.len();
            all.find(|other| self.cells.place(*other) == cell.place)
        });
        let made = match first.filter(|first| *first != index) {
            Some(first) => self.stub(first),
            None => self.make_stub(index, &cell),
        };
        self.stubs.folders.insert(index, made.clone());
        made
    }

    fn make_stub(&mut self, index: usize, cell: &Cell) -> Option<PathBuf> {
        if !self.sources_are_there(cell).ok()? {
            return None;
        }
        self.environment(cell).ok()?;
        let facts = self.facts(cell)?;
        let agent = self.agent(cell, &facts.interface).ok()?;
        let protocol = &self.sections.registry.protocols[cell.parts[2].part.plugin.as_str()];
        let protocol = (protocol.build)(&self.config(cell, 2).ok()?).ok()?;
        let folder = self.stubs.new_folder(index).ok()?;
        let trains_itself = self.entry(cell).is_some_and(|entry| entry.traits.trains_itself);
        if !cell.is_policy() && (agent.updates().is_some() || trains_itself) {
            agent.export(&folder).ok()?;
        }
        if protocol.leaves().contains(&ArtifactKind::Checkpoint) {
            write_checkpoint_stub(&folder, &*agent).ok()?;
        }
        protocol.write_stub(&facts.interface, &folder).ok()?;
        Some(folder)
    }

    /// The config from which a part is built, with the content of data files and with stubs for artifacts.
    pub(super) fn config(&self, cell: &Cell, part: usize) -> Result<CompleteConfig, Error> {
        let resolved = &cell.parts[part].part;
        let of_part = cell.sources.iter().filter(|source| source.part == part);
        let folders: BTreeMap<&Taken, &PathBuf> = of_part
            .filter_map(|source| {
                Some((
                    resolved.artifacts.get(&source.pointer)?,
                    self.stubs.folders.get(&source.cell)?.as_ref()?,
                ))
            })
            .collect();
        let find = |taken: &Taken| {
            let found = folders.get(taken).map(|folder| (*folder).clone());
            found.ok_or_else(|| Error::Source {
                trial: taken.trial.clone(),
                problem: "no stub of it was made".into(),
            })
        };
        resolved.loaded(&find)
    }

    /// The agent whose policy a cell measures, loaded with the stub of the policy.
    pub(super) fn policy(
        &mut self,
        cell: &Cell,
        interface: &Interface,
    ) -> Result<Box<dyn Agent>, Box<Diagnostic>> {
        let unusable = |builder: &Self, source: &Source, problem: String| {
            let name = dependencies::name(builder.sections, builder.cells.place(source.cell));
            Box::new(builder.at(
                cell,
                source,
                format!("the policy of `{name}` cannot be used here: {problem}"),
            ))
        };
        // A policy names its source in one place, which was found before.
        let Some(source) = cell.sources.iter().find(|source| source.part == 1) else {
            return Err(Box::new(self.sections.sources.error(
                Default::default(),
                "agents",
                "this policy has no source",
            )));
        };
        let trained = self.cells.at(source.cell);
        let entry = self
            .sections
            .registry
            .agents
            .get(trained.parts[1].part.plugin.as_str());
        let Some(entry) = entry.filter(|entry| entry.learns_with(&trained.parts[1].part.config)) else {
            return Err(unusable(
                self,
                source,
                "it was not trained there; name the trial that trains it, or use the rule itself".into(),
            ));
        };
        let built = self
            .config(&trained, 1)
            .and_then(|config| (entry.build)(&config, interface, &mut random::stream(&["check"])));
        let mut agent = built.map_err(|error| unusable(self, source, error.to_string()))?;
        let folder = self.stub(source.cell).unwrap_or_default();
        match agent.import(&folder) {
            Ok(true) => Ok(agent),
            Ok(false) => Err(unusable(
                self,
                source,
                "this agent takes up no stored policy".into(),
            )),
            Err(error) => Err(unusable(self, source, error.to_string())),
        }
    }

    fn leaves_another(&self, cell: &Cell, source: &Source, folder: &Path) -> Diagnostic {
        let name = dependencies::name(self.sections, self.cells.place(source.cell));
        let left: Vec<&str> = ArtifactKind::ALL
            .into_iter()
            .filter(|kind| kind.lies_in(folder))
            .map(ArtifactKind::name)
            .collect();
        let left = if left.is_empty() {
            "nothing for others".into()
        } else {
            left.join(" and ")
        };
        let help = match source.kind {
            ArtifactKind::Policy | ArtifactKind::Networks => "take it from an entry whose agent learns",
            ArtifactKind::Checkpoint => "give the protocol of that trial `leave_checkpoint: true`",
            ArtifactKind::Dataset => {
                "take it from an entry of `prepare` whose protocol gathers one, as `gather` does"
            }
            ArtifactKind::Choice => "take it from an entry that searches",
            ArtifactKind::Graph | ArtifactKind::Images => {
                "take it from an entry whose protocol leaves drawings"
            }
        };
        self.at(
            cell,
            source,
            format!("`{name}` leaves {left}, and a {} is taken here", source.kind),
        )
        .help(help)
    }

    /// A mistake about an artifact that a cell takes, at the place where it is named.
    pub(super) fn at(&self, cell: &Cell, source: &Source, message: String) -> Diagnostic {
        let (span, at) =
            dependencies::place(self.sections, &cell.parts[source.part], &source.pointer, "from");
        self.sections.sources.error(span, &at, message)
    }
}
