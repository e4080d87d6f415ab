//! The sections of a study as they are written. Editors use their schema for completion, studies are validated by it,
//! and the sections are read into these types. The tree of the document gives positions and the order of names.

use super::{
    confirmations::ConfirmationText,
    overrides::{ExcludeText, OverrideText},
    search::SearchText,
    seeds::SeedsText,
    sweep::Generator,
    written::{NamedPart, Written},
};
use contract::trial_result::Success;
use document::{
    Fitting, FittingEntries, FittingItems, Node,
    schema_check::{NAME, SLUG},
};
use execution::limits::Limits;
use imported::ImportedText;
use presentation::{request::RequestText, vocabulary::Pairs};
use schemars::JsonSchema;
use serde::Deserialize;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// Environments, agents, seeds and sweeps, and the tables, figures and claims made of their trials.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields, title = "A study")]
pub(super) struct StudyText {
    /// Name of the study and of its folder of results.
    #[schemars(extend("pattern" = SLUG))]
    pub study: Fitting<String>,
    /// Files whose sections this one begins with: one, or several of which later ones win. The study's own sections
    /// override them key by key; lists and values are replaced.
    pub include: Fitting<Files>,
    /// Keys by name, which `<<: NAME` inserts into any mapping; keys beside `<<` take precedence.
    #[schemars(extend("propertyNames" = json!({ "pattern": NAME })))]
    pub blocks: FittingEntries<Map<String, Value>>,
    /// Subject of the study, as a heading.
    pub title: Fitting<String>,
    /// Source of the published numbers.
    pub source: Fitting<String>,
    /// A name for the studies whose verdicts are read together, such as `chapter 3`. The overview takes these
    /// together (Holm); without it the study is a family of its own.
    #[schemars(length(min = 1))]
    pub family: Fitting<String>,
    /// Deviations from the source, one sentence each.
    pub deviations: Fitting<Vec<String>>,
    /// Number of replicates N (seeds 0 to N - 1), the seeds themselves, ranges of them as in `100-199`, or a design
    /// `{ min, max, looks }`, with `first` where it does not begin with seed 0. With a design seeds are added
    /// look by look until every judged value and claim is decided.
    #[schemars(extend("default" = 1))]
    pub seeds: Fitting<SeedsText>,
    /// The criterion by which a seed counts as a success; adds the metric `success`.
    pub success: Fitting<Success>,
    /// Swept keys, each with the way its values are made.
    pub sweep: FittingEntries<Generator>,
    /// Searches for settings of agents, by name. The results of such an agent are those of its best setting, measured
    /// on seeds that the search has not seen.
    #[schemars(extend("propertyNames" = json!({ "pattern": NAME })))]
    pub tune: FittingEntries<SearchText>,
    /// Named budgets of the study: values that replace others, by dotted path.
    #[schemars(extend("propertyNames" = json!({ "pattern": NAME })))]
    pub profiles: FittingEntries<Map<String, Value>>,
    /// Combinations that are left out.
    pub exclude: FittingItems<ExcludeText>,
    /// Plays by name: agents that meet after they were trained, in every combination over roles.
    #[schemars(extend("propertyNames" = json!({ "pattern": NAME })))]
    pub cross_play: FittingEntries<PlayText>,
    /// Runs of other programs by name, each entry in one environment or a list of such. They appear beside the agents
    /// in tables, figures and claims, marked as imported.
    #[schemars(extend("propertyNames" = json!({ "pattern": NAME })))]
    pub imported: FittingEntries<Parts>,
    /// Values for some combinations only.
    pub overrides: FittingItems<OverrideText>,
    /// The sections on results.
    #[serde(flatten)]
    pub request: RequestText,
    /// Rounds of claims and published values on fresh seeds. The final verdict on each is that of all its seeds
    /// together, with the level divided among all looks.
    pub confirm: FittingItems<ConfirmationText>,
    /// Limits of one trial, and failures after which it is tried again; the numbers of trials do not depend on them.
    pub limits: Fitting<Limits>,
}

impl StudyText {
    /// Reads the sections that can be read; the check against the schema reports the others.
    pub(super) fn read(root: &Node) -> Self {
        // A document that is no mapping has no sections.
        serde_json::from_value(root.to_value()).unwrap_or_default()
    }

    /// Reads the searches, plays and seeds again, since a profile or an option may have changed their keys.
    pub(super) fn read_parts(&mut self, written: &Written) {
        let values = |parts: &[NamedPart]| -> Value {
            let value = |named: &NamedPart| (named.name.clone(), named.config.to_value());
            parts.iter().map(value).collect()
        };
        self.tune = Fitting::read(values(&written.searches));
        self.cross_play = Fitting::read(values(&written.plays));
        self.seeds = written
            .seeds
            .as_ref()
            .map_or_else(Fitting::default, |node| Fitting::read(node.to_value()));
    }
}

/// One file or several.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Files {
    /// The path of one file, from the folder of this one.
    One(String),
    /// The paths of several.
    Several(Vec<Fitting<String>>),
}

/// Agents that meet after they were trained.
#[derive(Debug, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct PlayText {
    /// The environment in which the agents were trained.
    pub environment: String,
    /// Seats by role, at least two roles; every seat of the environment has one.
    #[schemars(extend("propertyNames" = json!({ "pattern": NAME })))]
    pub roles: BTreeMap<String, Seats>,
    /// Agents of the study, those that learn with the policy of their final training step; all that learn
    /// where absent.
    #[serde(default)]
    #[schemars(length(min = 1))]
    pub agents: Vec<String>,
    /// Episodes of each combination and seed.
    #[serde(default = "episodes")]
    #[schemars(range(min = 1, max = 1_000_000_000))]
    pub episodes: u64,
    /// Choice of the seeds of agents that meet.
    #[serde(default)]
    pub pairs: Pairs,
    /// Keys of the environment that differ from the training.
    #[serde(default)]
    pub environment_config: Map<String, Value>,
}

/// Names of the role's seats.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Seats(#[schemars(length(min = 1))] pub Vec<String>);

/// Default number of episodes of each trial of a play.
fn episodes() -> u64 {
    100
}

/// Imported runs in one environment, or in several.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Parts {
    /// Runs in one environment.
    One(Box<ImportedText>),
    /// Runs in several environments, one part for each.
    Several(#[schemars(length(min = 1))] Vec<ImportedText>),
}
