//! Facts on a study that its report needs besides the results.

use super::{period::Period, profiles::ProfileState, stages::Stage};
use contract::Better;
use presentation::{
    answers::Answer,
    claim_spec::{ClaimSpec, Relevance},
    figure::FigureSpec,
    summary::Summary,
    table::TableSpec,
};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use study::{Confirmation, Repeats};

/// Facts on a study that a report needs besides its results.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StudyInfo {
    /// Its name, which is the name of its folder.
    pub name: String,
    /// Title of the study.
    pub title: String,
    /// Source that it reproduces.
    pub source: String,
    /// Summary sentence, with placeholders.
    pub summary: Option<Summary>,
    /// Its lines in the answers of all studies.
    pub answers: Vec<Answer>,
    /// The verdicts that are read together with those of this study, such as `chapter 3`; its own alone where absent.
    pub family: Option<String>,
    /// Deviations from the source.
    pub deviations: Vec<String>,
    /// Samples of its sweep, where several drew the same setting.
    pub repeats: Option<Repeats>,
    /// Tables by name, in order.
    pub tables: Vec<(String, TableSpec)>,
    /// Figures by name, in order.
    pub figures: Vec<(String, FigureSpec)>,
    /// Claims of the study, in its order.
    pub claims: Vec<ClaimSpec>,
    /// Rounds of claims and published values on further seeds.
    pub confirm: Vec<Confirmation>,
    /// Agents in the study's order, which gives them their colours.
    pub agents: Vec<String>,
    /// Environments in the study's order.
    pub environments: Vec<String>,
    /// Entries of a study whose trials take artifacts from each other; empty where no entry does.
    pub stages: Vec<Stage>,
    /// Whether the profile is the one for trying the study out: its trials are no results.
    pub is_rehearsal: bool,
    /// Agents that a trained agent must be better than to have learned.
    pub floors: Vec<String>,
    /// Rule for the smallest difference that matters, for claims that state none.
    pub relevance: Option<Relevance>,
    /// The better direction by metric.
    pub better: BTreeMap<String, Better>,
    /// Units by metric.
    pub units: BTreeMap<String, String>,
    /// Agents that learn.
    pub learners: BTreeSet<String>,
    /// Configs with every default, by kind and name of the plugin, as in `agent dsac`.
    pub defaults: BTreeMap<String, Value>,
    /// The study without a profile and with each of its profiles; empty where it has none.
    pub profiles: Vec<ProfileState>,
    /// Period in which its trials ended, where the store knows it.
    pub ended: Option<Period>,
    /// Options of the command line that make the results differ from the study as its file has it, as `--set
    /// dsac.discount=0.9`.
    pub options: Vec<String>,
    /// Plugins with another version in the trials than in the program, as in `environment battery 1, now 2`.
    pub earlier_versions: Vec<String>,
    /// Keys of the study that had other values when the trials ran.
    pub changed_settings: Vec<String>,
}

impl StudyInfo {
    /// Sentence on the options of the command line; `None` without options.
    pub(super) fn asked_with(&self) -> Option<String> {
        (!self.options.is_empty()).then(|| format!("Computed with {}.", self.options.join(", ")))
    }

    /// Sentence under the profile for trying the study out, that its trials are no results; `None` otherwise.
    pub(super) fn rehearsal(&self) -> Option<&'static str> {
        self.is_rehearsal.then_some(
            "This is no result: the profile `smoke` only tries the study out, with budgets from which nothing follows. \
             Nothing is judged, and what the study says of budgets is said of another one.",
        )
    }

    /// Sentences on trials that differ from those of the present study.
    pub(super) fn outdated(&self) -> Vec<String> {
        let sentence = |what: &str, names: &[String]| {
            (!names.is_empty()).then(|| format!("{what}: {}.", names.join("; ")))
        };
        let versions = sentence("Of an earlier version", &self.earlier_versions);
        let settings = sentence("Of other settings than the study has now", &self.changed_settings);
        versions.into_iter().chain(settings).collect()
    }
}
