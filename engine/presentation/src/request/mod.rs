//! Tables, figures, claims and the sentence against the names that trials record: every metric, agent, environment,
//! setting, channel and row.

mod claims;
mod figures;
mod kinds;
mod searches;
mod summary;
mod tables;

pub use kinds::{Kinds, RegisterKinds};

use crate::{
    answers::Answer,
    claim_spec::{ClaimSpec, Relevance},
    figure::FigureSpec,
    kinds::{Chosen, Kind, Readable},
    names::{Names, Place, quoted},
    summary::Summary,
    table::TableSpec,
    vocabulary::Vocabulary,
};
use contract::{Metric, standard_metrics::SUCCESS, trial_result::Success};
use document::{
    Node, NodeKind,
    diagnostic::{Diagnostic, Sources, suggest},
};
use schemars::{JsonSchema, schema_for};
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::path::Path;

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
    /// `folder`. Entries that the check against the schema refused are passed over.
    #[must_use]
    pub fn read(
        root: &Node,
        vocabulary: &Vocabulary,
        kinds: &Kinds,
        sources: &Sources,
        folder: &Path,
    ) -> Self {
        let mut request = Self::default();
        let mut names = Names::new(vocabulary, sources);
        for entry in root.get("tables").map_or(&[][..], Node::entries) {
            request.tables.extend(
                names
                    .table(entry, &kinds.tables, folder)
                    .map(|spec| (entry.key.clone(), spec)),
            );
        }
        for entry in root.get("figures").map_or(&[][..], Node::entries) {
            request.figures.extend(
                names
                    .figure(entry, &kinds.figures, folder)
                    .map(|spec| (entry.key.clone(), spec)),
            );
        }
        for (search, _) in &vocabulary.searches {
            request.show_search(search);
        }
        let claims = root.get("claims").map_or(&[][..], Node::items);
        for (index, item) in claims.iter().enumerate() {
            request
                .claims
                .extend(names.claim(item, &format!("claims[{index}]")));
        }
        request.summary = root
            .get("summary")
            .and_then(|node| names.sentence(node, "summary", claims.len()));
        let answers = root
            .get("answers")
            .map_or(&[][..], Node::items)
            .iter()
            .enumerate();
        let answers = answers.filter_map(|(index, node)| names.answer(node, index, claims.len()));
        request.answers = answers.collect();
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
pub fn beside_the_source(root: &Node, vocabulary: &Vocabulary, sources: &Sources) -> Vec<Diagnostic> {
    let budget = root.get("paper_budget").and_then(|budget| budget.get("agents"));
    let lists = [("paper_budget.agents", budget), ("floors", root.get("floors"))];
    let items = lists.into_iter().flat_map(|(at, list)| {
        let items = list.map_or(&[][..], Node::items).iter().enumerate();
        items.map(move |(index, item)| (format!("{at}[{index}]"), item))
    });
    let ends = ["floor", "bound"].into_iter();
    let ends = ends.filter_map(|key| Some((format!("relevance.{key}"), root.get("relevance")?.get(key)?)));
    let unknown = items.chain(ends).filter_map(|(at, item)| {
        let name = item.to_value().as_str()?.to_owned();
        let is_known = vocabulary.agents.contains(&name);
        let error = || sources.error(item.span, &at, format!("there is no agent `{name}`"));
        (!is_known).then(|| error().help(suggest(&name, vocabulary.agents.iter().map(String::as_str))))
    });
    unknown.chain(unreasoned(root, sources)).collect()
}

/// Diagnostic for a share other than the usual one without a reason.
fn unreasoned(root: &Node, sources: &Sources) -> Option<Diagnostic> {
    let node = root.get("relevance")?;
    let relevance: Relevance = typed(node)?;
    let span = node.get("share").filter(|_| relevance.lacks_reason())?.span;
    let message = format!(
        "a share of {} is another one than that of all studies",
        relevance.share
    );
    let error = sources.error(span, "relevance.share", message);
    Some(error.help("say `why`, by what a difference is worth there, or leave the share out"))
}

fn typed<T: DeserializeOwned>(node: &Node) -> Option<T> {
    // A list would be read as the fields in their order.
    matches!(node.kind, NodeKind::Mapping(_))
        .then(|| serde_json::from_value(node.to_value()).ok())
        .flatten()
}

impl Names<'_> {
    /// Reads the one kind of a table or figure with its options, and the rest of it. Of options that exclude each other
    /// all but one are removed, so that further mistakes are found too.
    fn kind<Spec: DeserializeOwned + JsonSchema, T: ?Sized>(
        &mut self,
        (what, place): (&str, &Place<'_>),
        kinds: &[Readable<T>],
        folder: &Path,
    ) -> Option<(Spec, Chosen<T>)> {
        let mut value = place.node.to_value();
        // A key without a value counts as not given.
        let options = value.as_object_mut()?;
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
        serde_json::from_value(value).ok().map(|spec| (spec, chosen))
    }

    /// Says that a table or figure gives no kind, or several. An unknown key may have been meant as the kind and has
    /// its own diagnostic.
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

    /// Says which options exclude each other, and removes all but one.
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
