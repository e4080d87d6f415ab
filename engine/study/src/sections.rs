//! The sections of a study as they are written. Editors complete by their schemas, and studies are held
//! against them before the sections are read one by one, with the positions of what is in them.

use super::{
    confirmations::ConfirmationText, cross_play::EPISODES, search::SearchText, seeds::SeedsText,
    sweep::Generator,
};
use analysis::results::PaperBudget;
use contract::trial_result::Success;
use document::schema_check::{NAME, SLUG};
use execution::limits::Limits;
use imported::ImportedText;
use presentation::{
    answers::AnswerText,
    claim_spec::{ClaimSpec, Relevance},
    figure::FigureSpec,
    table::TableSpec,
    vocabulary::Pairs,
};
use schemars::JsonSchema;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// Environments, agents, seeds and sweeps, and the tables, figures and claims made of their trials.
#[derive(JsonSchema)]
#[schemars(deny_unknown_fields, title = "A study")]
#[allow(dead_code, reason = "its schema alone is used")]
pub(super) struct Sections {
    /// Name of the study and of its folder of results.
    #[schemars(extend("pattern" = SLUG))]
    study: String,
    /// Files whose sections this one begins with: one, or several of which later ones win. The study's own sections are
    /// laid over them, key by key; lists and values are replaced.
    include: Files,
    /// Keys by name, which `<<: NAME` puts into any mapping; keys beside `<<` win.
    #[schemars(extend("propertyNames" = json!({ "pattern": NAME })))]
    blocks: BTreeMap<String, Map<String, Value>>,
    /// Subject of the study, as a heading.
    title: String,
    /// Where the published numbers come from.
    source: String,
    /// A name for the studies whose verdicts are read together, such as `chapter 3`. The overview takes these
    /// together (Holm); without it the study is a family of its own.
    #[schemars(length(min = 1))]
    family: String,
    /// The result, in a sentence with placeholders: `{TABLE: ROW}` or `{TABLE: ROW, COLUMN}` for a value, with
    /// `published` or `verdict` after it for these, and `{claim N}` for the verdict on a claim.
    summary: String,
    /// Printed items of the source, or questions, beside what was found: the answers of all studies have a line for
    /// each.
    answers: Vec<AnswerText>,
    /// Deviations from the source, one sentence each.
    deviations: Vec<String>,
    /// Number of replicates N (seeds 0 to N - 1), the seeds themselves, ranges of them as in `100-199`, or a design
    /// `{ min, max, looks }`, with `first` where it does not begin with seed 0. With a design seeds are added
    /// look by look until every judged value and claim is decided.
    #[schemars(extend("default" = 1))]
    seeds: SeedsText,
    /// The criterion by which a seed counts as a success; adds the metric `success`.
    success: Success,
    /// How long the source trained. Where the trainings here are less than half as long, what differs and what is
    /// refuted is NOT AT THIS BUDGET.
    paper_budget: PaperBudget,
    /// Agents that do nothing, act at random or by a plain rule. Where no trained agent is better than all of them, no
    /// claim that compares trained agents is judged: NOT LEARNED.
    #[schemars(extend("x-kind" = "agent"))]
    floors: Vec<String>,
    /// Which difference matters for claims of a direction without `min_effect`: a share of the range from floor to bound.
    relevance: Relevance,
    /// Swept keys, each with the way its values are made.
    sweep: BTreeMap<String, Generator>,
    /// Searches for settings of agents, by name. Results of such an agent are those of the best setting, measured on
    /// seeds that the search has not seen.
    #[schemars(extend("propertyNames" = json!({ "pattern": NAME })))]
    tune: BTreeMap<String, SearchText>,
    /// Named budgets of the study: values that replace others, by dotted path.
    #[schemars(extend("propertyNames" = json!({ "pattern": NAME })))]
    profiles: BTreeMap<String, Map<String, Value>>,
    /// Combinations that are left out.
    exclude: Vec<ExcludeText>,
    /// Plays by name: agents that meet after they were trained, in every combination over roles.
    #[schemars(extend("propertyNames" = json!({ "pattern": NAME })))]
    cross_play: BTreeMap<String, PlayText>,
    /// Runs of other programs by name, each entry in one environment or a list of such. They stand beside the agents in
    /// tables, figures and claims, and are marked there as imported.
    #[schemars(extend("propertyNames" = json!({ "pattern": NAME })))]
    imported: BTreeMap<String, Parts>,
    /// Values for some combinations only.
    overrides: Vec<OverrideText>,
    /// Tables by name.
    #[schemars(extend("propertyNames" = json!({ "pattern": SLUG })))]
    tables: BTreeMap<String, TableSpec>,
    /// Figures by name.
    #[schemars(extend("propertyNames" = json!({ "pattern": SLUG })))]
    figures: BTreeMap<String, FigureSpec>,
    /// Comparisons that the results support, refute or leave open.
    claims: Vec<ClaimText>,
    /// Rounds of claims and published values on fresh seeds. The last word on each is that of all its seeds together,
    /// with the level divided among all looks.
    confirm: Vec<ConfirmationText>,
    /// Limits of one trial, and failures that are tried again; no trial's numbers depend on it.
    limits: Limits,
}

/// One file or several.
#[derive(serde::Serialize, JsonSchema)]
#[serde(untagged)]
#[allow(dead_code, reason = "its schema alone is used")]
enum Files {
    /// The path of one file, from the folder of this one.
    One(String),
    /// The paths of several.
    Several(Vec<String>),
}

/// A combination that is left out.
#[derive(serde::Serialize, JsonSchema)]
#[schemars(deny_unknown_fields, extend("minProperties" = 1, "x-kind" = "environment or agent"))]
#[allow(dead_code, reason = "its schema alone is used")]
struct ExcludeText {
    /// The environment; all where absent.
    #[serde(default)]
    environment: String,
    /// The agent; all where absent.
    #[serde(default)]
    agent: String,
}

/// Values for a combination.
#[derive(serde::Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[allow(dead_code, reason = "its schema alone is used")]
struct OverrideText {
    /// The environment; all where absent.
    #[serde(default)]
    environment: String,
    /// The agent; all where absent.
    #[serde(default)]
    agent: String,
    /// Values by dotted path.
    set: Map<String, Value>,
}

/// Agents that meet after they were trained.
#[derive(serde::Serialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[allow(dead_code, reason = "its schema alone is used")]
struct PlayText {
    /// The environment in which the agents were trained.
    environment: String,
    /// Seats by role, at least two roles; every seat of the environment has one.
    #[schemars(extend("propertyNames" = json!({ "pattern": NAME })))]
    roles: BTreeMap<String, Seats>,
    /// Agents of the study, those that learn with the policy of their final training step; all that learn
    /// where absent.
    #[serde(default)]
    #[schemars(length(min = 1))]
    agents: Vec<String>,
    /// Episodes of each combination and seed.
    #[serde(default = "episodes")]
    #[schemars(range(min = 1, max = 1_000_000_000))]
    episodes: u64,
    /// Which seeds of the agents meet.
    #[serde(default)]
    pairs: Pairs,
    /// Keys of the environment that differ from the training.
    #[serde(default)]
    environment_config: Map<String, Value>,
}

/// Imported runs in one environment, or in several.
#[derive(serde::Serialize, JsonSchema)]
#[serde(untagged)]
#[allow(dead_code, reason = "its schema alone is used")]
enum Parts {
    /// In one.
    One(Box<ImportedText>),
    /// In several, a part for each.
    Several(#[schemars(length(min = 1))] Vec<ImportedText>),
}

fn episodes() -> u64 {
    EPISODES
}

/// Names of the role's seats.
#[derive(serde::Serialize, JsonSchema)]
#[serde(transparent)]
struct Seats(#[schemars(length(min = 1))] Vec<String>);

/// A claim alone, or with what is known of it besides.
#[derive(serde::Serialize, JsonSchema)]
#[serde(untagged)]
#[allow(dead_code, reason = "its schema alone is used")]
enum ClaimText {
    /// The comparison, such as `learner.return > rule.return`.
    Alone(String),
    /// The comparison with what is known of it besides.
    Long(ClaimSpec),
}
