//! Names that a study may use, by groups. `list`, `describe` and the reference read the same lists as `check` and the
//! readers of a study.

use super::sections;
use analysis::claim::{Aggregate, forms};
use clap::ValueEnum;
use contract::{ArtifactKind, Registry, cast};
use execution::executor;
use presentation::{kinds::Kind, request::Kinds};
use serde::Serialize;

/// A group of names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Group {
    /// Sections of a study: its keys at the top.
    Sections,
    /// Simulated systems.
    Environments,
    /// Algorithms, rules and reference controllers.
    Agents,
    /// Ways to run a trial.
    Protocols,
    /// Kinds of tables.
    Tables,
    /// Kinds of figures.
    Figures,
    /// Ways to generate the values of a swept key.
    Samplers,
    /// Relations between the two sides of a claim.
    Relations,
    /// Reductions of a trial's measurements to one number in a claim.
    Aggregates,
    /// Artifacts of trials that other trials take by `{ from: NAME }`.
    Artifacts,
    /// Executors of trials.
    Executors,
}

impl Group {
    /// All groups, in the order of display.
    pub const ALL: [Self; 11] = [
        Self::Sections,
        Self::Environments,
        Self::Agents,
        Self::Protocols,
        Self::Tables,
        Self::Figures,
        Self::Samplers,
        Self::Relations,
        Self::Aggregates,
        Self::Artifacts,
        Self::Executors,
    ];

    /// The word for the group on the command line, as in `regimen list samplers`.
    #[must_use]
    pub fn word(self) -> String {
        format!("{self:?}").to_lowercase()
    }

    /// Noun for one member of the group, in a heading.
    #[must_use]
    pub fn one(self) -> &'static str {
        match self {
            Self::Sections => "section of a study",
            Self::Environments => "environment",
            Self::Agents => "agent",
            Self::Protocols => "protocol",
            Self::Tables => "table",
            Self::Figures => "figure",
            Self::Samplers => "sampler of a sweep",
            Self::Relations => "relation of a claim",
            Self::Aggregates => "one number of a trial, in a claim",
            Self::Artifacts => "artifact of a trial",
            Self::Executors => "executor",
        }
    }

    /// Its names with a line each.
    #[must_use]
    pub fn entries(self, registry: &Registry) -> Vec<(String, String)> {
        let own = |name: &str, about: &str| (name.to_owned(), about.to_owned());
        let kinds = |kinds: Vec<Kind>| kinds.iter().map(|kind| own(kind.name, kind.about)).collect();
        match self {
            Self::Sections => sections::entries(registry),
            Self::Environments => {
                let all = registry.environments.iter();
                all.map(|(name, entry)| own(name, entry.about.about)).collect()
            }
            Self::Agents => cast::agents(registry)
                .map(|(name, about)| own(name, about.about))
                .collect(),
            Self::Protocols => {
                let all = registry.protocols.iter();
                all.map(|(name, entry)| own(name, entry.about.about)).collect()
            }
            Self::Tables => kinds(Kinds::of(registry).of_tables()),
            Self::Figures => kinds(Kinds::of(registry).of_figures()),
            Self::Samplers => sections::samplers()
                .into_iter()
                .map(|(name, form)| (name, form.about))
                .collect(),
            Self::Relations => forms::RELATIONS.map(|form| own(form.written, form.about)).into(),
            Self::Aggregates => Aggregate::ALL.map(|it| own(it.name(), it.about())).into(),
            Self::Artifacts => ArtifactKind::ALL.map(|it| own(it.name(), it.about())).into(),
            Self::Executors => executor::all(registry)
                .iter()
                .map(|kind| own(kind.name, kind.about))
                .collect(),
        }
    }
}
