//! Tables, figures, claims and the summary, checked against the names that trials record: every metric, agent,
//! environment, setting, channel and row.

mod claims;
mod figures;
mod kinds;
mod searches;
mod summary;
mod tables;

pub use kinds::{Kinds, RegisterKinds};

use crate::{
    answers::{Answer, AnswerText},
    claim_spec::{ClaimSpec, ClaimText, Relevance},
    figure::FigureSpec,
    kinds::{Chosen, Kind, Readable},
    names::{Names, Place, quoted},
    summary::Summary,
    table::TableSpec,
    vocabulary::Vocabulary,
};
use analysis::results::PaperBudget;
use contract::{Metric, standard_metrics::SUCCESS, trial_result::Success};
use document::{
    Fitting, FittingEntries, FittingItems, Node,
    diagnostic::{Diagnostic, Sources, suggest},
    schema_check::SLUG,
};
use schemars::{JsonSchema, schema_for};
use serde::{Deserialize, de::DeserializeOwned};
use serde_json::{Map, Value, json};
use std::{collections::BTreeMap, path::Path};

/// The sections of a study on its results, as they are written.
#[derive(Debug, Default, Deserialize, JsonSchema)]
pub struct RequestText {
    /// The result, in a sentence with placeholders: `{TABLE: ROW}` or `{TABLE: ROW, COLUMN}` for a value, with
    /// `published` or `verdict` after it for these, and `{claim N}` for the verdict on a claim.
    pub summary: Fitting<String>,
    /// Printed items of the source, or questions, beside the findings; the answers of all studies have a line for each.
    pub answers: FittingItems<AnswerText>,
    /// Length of the source's training. If trainings here are less than half as long, differing values and refuted
    /// claims are NOT AT THIS BUDGET.
    pub paper_budget: Fitting<PaperBudget>,
    /// Agents that do nothing, act at random or follow a simple rule. If no trained agent is better than all of them,
    /// no claim that compares trained agents is judged: NOT LEARNED.
    #[schemars(extend("x-kind" = "agent"))]
    pub floors: Fitting<Vec<String>>,
    /// The smallest difference that matters for claims of a direction without `min_effect`: a share of the range from
    /// floor to bound.
    pub relevance: Fitting<Relevance>,
    /// Tables by name.
    #[schemars(with = "BTreeMap<String, TableSpec>", extend("propertyNames" = json!({ "pattern": SLUG })))]
    pub tables: FittingEntries<Map<String, Value>>,
    /// Figures by name.
    #[schemars(with = "BTreeMap<String, FigureSpec>", extend("propertyNames" = json!({ "pattern": SLUG })))]
    pub figures: FittingEntries<Map<String, Value>>,
    /// Comparisons that the results support, refute or leave open.
    pub claims: FittingItems<ClaimText>,
}

/// Tables, figures, claims and sentences that a study asks for, with the mistakes in them.
#[derive(Debug, Default)]
pub struct Request {
    /// Tables by name, in the order of the study.
    pub tables: Vec<(String, TableSpec)>,
    /// Figures by name, in the order of the study.
    pub figures: Vec<(String, FigureSpec)>,
    /// Claims that could be read, in the order of the study.
    pub claims: Vec<ClaimSpec>,
    /// The sentence that sums the study up.
    pub summary: Option<Summary>,
    /// Its lines in the answers of all studies.
    pub answers: Vec<Answer>,
    /// Mistakes in these sections.
    pub found: Vec<Diagnostic>,
}

impl Request {
    /// Reads the sections `tables`, `figures`, `claims`, `summary` and `answers`; paths of files are relative to
    /// `folder`. Entries that the check against the schema refused are skipped.
    #[must_use]
    pub fn read(
        (text, root): (&RequestText, &Node),
        vocabulary: &Vocabulary,
        kinds: &Kinds,
        sources: &Sources,
        folder: &Path,
    ) -> Self {
        let mut request = Self::default();
        let mut names = Names::new(vocabulary, sources);
        for entry in root.get("tables").map_or(&[][..], Node::entries) {
            let keys = text.tables.get(&entry.key);
            let spec = names.table((keys, entry), &kinds.tables, folder);
            request.tables.extend(spec.map(|spec| (entry.key.clone(), spec)));
        }
        for entry in root.get("figures").map_or(&[][..], Node::entries) {
            let keys = text.figures.get(&entry.key);
            let spec = keys.and_then(|keys| names.figure((keys, entry), &kinds.figures, folder));
            request.figures.extend(spec.map(|spec| (entry.key.clone(), spec)));
        }
        for search in &vocabulary.searches {
            request.show_search(&search.name);
        }
        for (index, claim, node) in text.claims.located(root.get("claims")) {
            let at = format!("claims[{index}]");
            let Some(claim) = names.claim(claim, node, &at) else {
                continue;
            };
            let same = |it: &ClaimSpec| (&it.claim, &it.environment) == (&claim.claim, &claim.environment);
            if request.claims.iter().any(same) {
                let message = "this claim is given twice";
                names.say((node.span, at), message, "give it once, with one `min_effect`");
            }
            request.claims.push(claim);
        }
        let count = text.claims.0.as_ref().map_or(0, Vec::len);
        request.summary = text.summary.0.as_ref().and_then(|summary| {
            let node = root.get("summary")?;
            names.sentence(summary, (node.span, "summary"), count)
        });
        let answers = text.answers.located(root.get("answers"));
        request.answers = answers
            .filter_map(|(index, answer, node)| {
                names.answer(answer, node, &format!("answers[{index}]"), count)
            })
            .collect();
        request.found = names.found;
        request
    }
}

/// Checks the study's definition of success, and adds `success` to every combination that records its metric.
pub fn success(
    root: &Node,
    success: Option<&Success>,
    vocabulary: &mut Vocabulary,
    sources: &Sources,
) -> Vec<Diagnostic> {
    let (Some(entry), Some(success)) = (root.entry("success"), success) else {
        return Vec::new();
    };
    let mut names = Names::new(vocabulary, sources);
    let place = Place::of(entry, "success".into());
    let all = names.all();
    names.metric(&success.metric, &place, "metric", &all);
    match (success.above, success.below) {
        (None, None) => {
            let message = "a success needs a limit";
            names.say(
                (place.key, place.at.clone()),
                message,
                "write `above: VALUE` or `below: VALUE`",
            );
        }
        (Some(above), Some(below)) if above >= below => {
            names.say(
                place.value("above"),
                format!("nothing is above {above} and below {below}"),
                "",
            );
        }
        _ => {}
    }
    if names.recorded(&all).contains(SUCCESS) {
        let message = format!("trials of this study record `{SUCCESS}` themselves");
        names.say((place.key, place.at.clone()), message, "leave the section out");
    }
    let found = names.found;
    for recorded in vocabulary
        .recorded
        .values_mut()
        .filter(|recorded| recorded.contains(&success.metric))
    {
        recorded.insert(SUCCESS.into());
    }
    vocabulary.metrics.push(Metric::new(
        SUCCESS,
        "",
        "1 for a seed with success, 0 for one without",
    ));
    found
}

/// Checks the agents that `paper_budget`, `floors` and `relevance` name, and the reason of the latter.
pub fn beside_the_source(
    text: &RequestText,
    root: &Node,
    vocabulary: &Vocabulary,
    sources: &Sources,
) -> Vec<Diagnostic> {
    let node = |section: &str, key: &str| root.get(section)?.get(key);
    let budget = text.paper_budget.0.as_ref().map(|budget| &budget.agents);
    let lists = [
        ("paper_budget.agents", budget, node("paper_budget", "agents")),
        ("floors", text.floors.0.as_ref(), root.get("floors")),
    ];
    let items = lists.into_iter().flat_map(|(at, names, list)| {
        let nodes = list.map_or(&[][..], Node::items);
        let items = names.into_iter().flatten().zip(nodes).enumerate();
        items.map(move |(index, (name, item))| (format!("{at}[{index}]"), name, item))
    });
    let ends = text.relevance.0.iter();
    let ends = ends.flat_map(|it| [("floor", &it.floor), ("bound", &it.bound)]);
    let ends =
        ends.filter_map(|(key, name)| Some((format!("relevance.{key}"), name, node("relevance", key)?)));
    let unknown = items.chain(ends).filter_map(|(at, name, item)| {
        let error = || sources.error(item.span, &at, format!("there is no agent `{name}`"));
        let help = || suggest(name, vocabulary.agents.iter().map(String::as_str));
        (!vocabulary.agents.contains(name)).then(|| error().help(help()))
    });
    let unreasoned = text.relevance.0.as_ref();
    let unreasoned = unreasoned.and_then(|it| unreasoned_share(it, node("relevance", "share")?, sources));
    unknown.chain(unreasoned).collect()
}

/// Diagnostic for a share other than the usual one without a reason.
fn unreasoned_share(relevance: &Relevance, node: &Node, sources: &Sources) -> Option<Diagnostic> {
    let span = Some(node).filter(|_| relevance.lacks_reason())?.span;
    let message = format!(
        "a share of {} is another one than that of all studies",
        relevance.share
    );
    let error = sources.error(span, "relevance.share", message);
    Some(error.help("say `why`, by what a difference is worth there, or leave the share out"))
}

impl Names<'_> {
    /// Reads the one kind of a table or figure with its options, and the rest of it. All but one of the options that
    /// exclude each other are removed, so that further mistakes are found too.
    fn kind<Spec: DeserializeOwned + JsonSchema, T: ?Sized>(
        &mut self,
        keys: &Map<String, Value>,
        (what, place): (&str, &Place<'_>),
        kinds: &[Readable<T>],
        folder: &Path,
    ) -> Option<(Spec, Chosen<T>)> {
        let mut options = keys.clone();
        // A key without a value counts as not given.
        options.retain(|key, value| !value.is_null() || kinds.iter().all(|it| it.kind.name != key));
        let given: Vec<_> = kinds
            .iter()
            .filter(|it| options.contains_key(it.kind.name))
            .collect();
        let [it] = given.as_slice() else {
            let name = |it: &Readable<T>| it.kind.name.to_owned();
            let given: Vec<String> = given.into_iter().map(name).collect();
            let known: Vec<String> = kinds.iter().map(name).collect();
            self.not_one_kind::<Spec>((what, place), &given, &known);
            return None;
        };
        let mut own = options.remove(it.kind.name)?;
        self.contradictions(&it.kind, &place.below(it.kind.name)?, &mut own);
        let chosen = it.read(own, folder).ok()?;
        serde_json::from_value(json!(options))
            .ok()
            .map(|spec| (spec, chosen))
    }

    /// Reports a table or figure with no kind or several. An unknown key may have been intended as the kind and has its
    /// own diagnostic.
    fn not_one_kind<Spec: JsonSchema>(
        &mut self,
        (what, place): (&str, &Place<'_>),
        given: &[String],
        kinds: &[String],
    ) {
        let message = match given {
            [first, second, ..] => format!("{what} shows both `{first}` and `{second}`"),
            _ => format!("{what} does not say what it shows"),
        };
        let schema = schema_for!(Spec).to_value();
        let is_known = |key: &String| kinds.contains(key) || schema["properties"].get(key).is_some();
        if place.node.entries().iter().all(|entry| is_known(&entry.key)) {
            let help = format!("give exactly one of {}", quoted(kinds));
            self.say((place.key, place.at.clone()), message, help);
        }
    }

    /// Reports options that exclude each other, and removes all but one.
    fn contradictions(&mut self, kind: &Kind, place: &Place<'_>, value: &mut Value) {
        while let Some(contradiction) = (kind.contradiction)(value) {
            let Some((key, outer)) = contradiction.at.split_last() else {
                return;
            };
            let (mut here, mut inner) = (place.clone(), &mut *value);
            for key in outer {
                here = here.below(key).unwrap_or(here);
                inner = &mut inner[*key];
            }
            self.say(here.value(key), contradiction.message.clone(), contradiction.help);
            if inner
                .as_object_mut()
                .and_then(|options| options.remove(*key))
                .is_none()
            {
                return;
            }
        }
    }
}
