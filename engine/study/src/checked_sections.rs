//! The sections of a study from which cells are made, read and checked one by one.

use super::{
    config::Plugin,
    known_agents::KnownAgents,
    overrides::Override,
    path,
    search::LocatedSearch,
    sections::StudyText,
    sweep::{Dimension, LocatedKey},
    written::{PartKind, Selection, Target, Written},
};
use contract::{
    Registry, cast,
    own_training::{MEASURED, Measured},
};
use document::{
    diagnostic::{Diagnostic, Sources},
    schema_check::View,
};
use execution::{limits::Limits, store::Announcements};
use serde_json::Value;
use std::path::Path;

/// Largest number of trials of one study.
pub const MOST_TRIALS: u64 = 1_000_000;

/// Everything from which cells are made.
pub struct Sections<'a> {
    /// The sections as they are written.
    pub(super) text: &'a StudyText,
    /// Named parts of the study.
    pub written: &'a Written,
    /// Registered plugins.
    pub registry: &'a Registry,
    /// JSON Schema of a study.
    pub schema: &'a Value,
    /// Texts of the study, for messages.
    pub sources: &'a Sources,
    /// Folder of the study.
    pub folder: &'a Path,
    /// Values for some combinations.
    pub overrides: &'a [Override<'a>],
    /// Dimensions of the sweep.
    pub dimensions: &'a [Dimension<'a>],
    /// Searches for settings.
    pub searches: &'a [LocatedSearch<'a>],
    /// Combinations that are left out.
    pub excluded: &'a [Selection],
    /// Limits of one trial.
    pub limits: &'a Limits,
    /// Known announcements of environments that were tried out before.
    pub announced: Option<&'a Announcements>,
    /// Agents that are not built again.
    pub known: &'a KnownAgents,
    /// Whether the study is read without a profile and options of the command line.
    pub is_as_written: bool,
}

impl Sections<'_> {
    /// Number of cells, without making them.
    #[must_use]
    pub fn count(&self) -> u64 {
        let points = |pair| {
            let concerned = self.concerned(&Target::of_pair(pair));
            let counts = concerned.iter().map(|(_, count)| *count as u64);
            counts.fold(1, u64::saturating_mul)
        };
        self.pairs()
            .map(points)
            .fold(self.written.prepared.len() as u64, u64::saturating_add)
    }

    /// Pairs of an environment and an agent that are not left out.
    pub fn pairs(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let agents = self.written.agents.len();
        let all = (0..self.written.environments.len())
            .flat_map(move |environment| (0..agents).map(move |agent| (environment, agent)));
        all.filter(|(environment, agent)| !self.excluded.iter().any(|it| it.matches(*environment, *agent)))
    }

    /// The dimensions that affect these targets, by their places, with the number of points of each.
    pub(super) fn concerned(&self, targets: &[Target]) -> Vec<(usize, usize)> {
        let all = self.dimensions.iter().enumerate();
        all.filter(|(_, it)| it.concerns(targets))
            .map(|(index, it)| (index, it.n_points()))
            .collect()
    }

    /// The swept keys, in the order of the sweep.
    pub(super) fn swept(&self) -> impl Iterator<Item = &LocatedKey<'_>> {
        self.dimensions.iter().flat_map(|dimension| &dimension.keys)
    }

    /// A warning for samples that gave the same setting.
    pub fn repeats(&self) -> impl Iterator<Item = Diagnostic> {
        self.dimensions
            .iter()
            .filter_map(|dimension| dimension.repeats(self.sources))
    }

    /// Whether an agent learns, according to its config as written.
    pub(super) fn learns(&self, agent: Target) -> bool {
        let named = self.written.part(agent);
        named.is_some_and(|named| {
            let entry = self.registry.agents.get(named.plugin.as_str());
            entry.is_some_and(|entry| match entry.traits.by_config {
                None => entry.traits.learns(),
                Some(_) => entry.learns_with(&named.config.to_value()),
            })
        })
    }

    /// Form in which an agent that trains itself is measured, according to its config as written.
    pub(super) fn measured(&self, agent: Target) -> Option<Measured> {
        let said = self.written.part(agent)?.config.get(MEASURED)?;
        // Another word is refused when the agent's own config is read.
        serde_json::from_value(said.to_value()).ok()
    }

    /// The setting that was chosen for an agent: the index of the search and the setting's place there.
    pub(super) fn chosen(&self, agent: usize) -> Option<(usize, usize)> {
        let search = self.searches.iter().position(|it| it.agent == agent)?;
        Some((search, self.searches[search].progress.chosen?))
    }

    /// The plugin of a part.
    #[must_use]
    pub fn plugin(&self, target: Target) -> Option<Plugin<'_>> {
        let named = self.written.part(target)?;
        let (kind, at) = match target {
            Target::Environment(_) => (PartKind::Environment, format!("environments.{}", named.name)),
            Target::Agent(_) => (PartKind::Agent, format!("agents.{}", named.name)),
            Target::Protocol => (PartKind::Protocol, "protocol".into()),
            Target::Prepared(_, kind) => (kind, format!("prepare.{}.{}", named.name, kind.name())),
            Target::Play(_) | Target::Search(_) | Target::Seeds => return None,
        };
        let about = match kind {
            PartKind::Environment => &self.registry.environments.get(named.plugin.as_str())?.about,
            PartKind::Agent => {
                cast::agents(self.registry)
                    .find(|(name, _)| *name == named.plugin)?
                    .1
            }
            PartKind::Protocol => &self.registry.protocols.get(named.plugin.as_str())?.about,
        };
        let schema = path::config_schema(View::new(self.schema, self.schema), target, &named.plugin)?;
        Some(Plugin {
            name: &named.plugin,
            about,
            schema,
            at: format!("{at}.{}", named.plugin),
            span: named.plugin_span,
        })
    }
}
