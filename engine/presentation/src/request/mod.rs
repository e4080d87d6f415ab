//! Tables, figures, claims and the sentence against what trials record: every metric, agent, environment,
//! setting, channel and row.

mod claims;
mod figures;
mod published_curves;
mod searches;
mod summary;
mod tables;

use crate::{
    answers::Answer,
    claim_spec::{ClaimSpec, Relevance},
    figure::FigureSpec,
    kinds,
    summary::Summary,
    table::TableSpec,
    vocabulary::Vocabulary,
};
use contract::{Metric, standard_metrics::SUCCESS, trial_result::Success};
use document::{
    Entry, Kind, Node,
    diagnostic::{Diagnostic, Sources, Span, suggest},
};
use schemars::{JsonSchema, schema_for};
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

/// What a study asks for, and what is wrong with it.
#[derive(Debug, Default)]
pub struct Request {
    /// Tables by name.
    pub tables: Vec<(String, TableSpec)>,
    /// Figures by name.
    pub figures: Vec<(String, FigureSpec)>,
    /// Claims.
    pub claims: Vec<ClaimSpec>,
    /// The sentence that sums the study up.
    pub summary: Option<Summary>,
    /// Its lines in the answers of all studies.
    pub answers: Vec<Answer>,
    /// Mistakes.
    pub found: Vec<Diagnostic>,
}

impl Request {
    /// Reads the sections `tables`, `figures`, `claims`, `summary` and `answers`; files are sought from `folder`.
    /// Entries that the check against the schema refused are passed over.
    #[must_use]
    pub fn read(root: &Node, vocabulary: &Vocabulary, sources: &Sources, folder: &Path) -> Self {
        let mut request = Self::default();
        let mut names = Names::new(vocabulary, sources);
        for entry in root.get("tables").map_or(&[][..], Node::entries) {
            request
                .tables
                .extend(names.table(entry, folder).map(|spec| (entry.key.clone(), spec)));
        }
        for entry in root.get("figures").map_or(&[][..], Node::entries) {
            request
                .figures
                .extend(names.figure(entry, folder).map(|spec| (entry.key.clone(), spec)));
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

/// Checks what the study calls a success, and lets every combination that records its metric record
/// `success`.
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

/// Another share than the one of all studies, without a reason.
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
    matches!(node.kind, Kind::Mapping(_))
        .then(|| serde_json::from_value(node.to_value()).ok())
        .flatten()
}

/// The part of the study that a table or figure takes its values from.
pub struct Picked {
    /// Indices of agents.
    pub agents: Vec<usize>,
    /// Indices of environments.
    pub environments: Vec<usize>,
}

impl Picked {
    /// The same where one environment is shown: the one that is named, else the first.
    pub fn of_one_environment(mut self) -> Self {
        self.environments.truncate(1);
        self
    }
}

/// A mapping of the study with its place.
#[derive(Clone)]
pub struct Place<'a> {
    /// The mapping.
    pub node: &'a Node,
    /// Where its key stands.
    pub key: Span,
    /// Its dotted path.
    pub at: String,
}

impl<'a> Place<'a> {
    /// The value of an entry whose dotted path is known.
    #[must_use]
    pub fn of(entry: &'a Entry, at: String) -> Self {
        Self {
            node: &entry.value,
            key: entry.key_span,
            at,
        }
    }

    /// The mapping under a key; `None` where it is not given.
    #[must_use]
    pub fn below(&self, key: &str) -> Option<Place<'a>> {
        self.node
            .entry(key)
            .map(|entry| Place::of(entry, format!("{}.{key}", self.at)))
    }

    /// The items of a list.
    pub fn items(&self) -> impl Iterator<Item = Place<'a>> {
        let item = |(index, node): (usize, &'a Node)| Place {
            node,
            key: node.span,
            at: format!("{}[{index}]", self.at),
        };
        self.node.items().iter().enumerate().map(item)
    }

    /// Where the value under a key stands, or the mapping's own key where it is not given.
    pub fn value(&self, key: &str) -> (Span, String) {
        let at = format!("{}.{key}", self.at);
        match self.node.entry(key) {
            Some(entry) if matches!(entry.value.kind, Kind::Scalar(_)) => (entry.value.span, at),
            Some(entry) => (entry.key_span, at),
            None => (self.key, at),
        }
    }
}

/// What trials record, for tables, figures and claims to be held against, and what was found wrong with
/// these.
pub struct Names<'a> {
    /// The names that are known.
    pub vocabulary: &'a Vocabulary,
    sources: &'a Sources,
    /// Rows and columns of the tables by name; none where a table cannot be read.
    shown: BTreeMap<String, (Vec<String>, Vec<String>)>,
    found: Vec<Diagnostic>,
}

impl<'a> Names<'a> {
    /// Nothing is held against them yet.
    #[must_use]
    pub fn new(vocabulary: &'a Vocabulary, sources: &'a Sources) -> Self {
        Self {
            vocabulary,
            sources,
            shown: BTreeMap::new(),
            found: Vec::new(),
        }
    }

    /// Mistakes that were found.
    #[must_use]
    pub fn into_found(self) -> Vec<Diagnostic> {
        self.found
    }
}

impl Names<'_> {
    /// Takes note of a mistake at a place.
    pub fn say(&mut self, (span, at): (Span, String), message: impl Into<String>, help: impl Into<String>) {
        let help = help.into();
        let error = self.sources.error(span, &at, message);
        self.found
            .push(if help.is_empty() { error } else { error.help(help) });
    }

    /// The one kind that a table or figure is of, and what is written for it. Of options that exclude each
    /// other all but one are left out, so that what else is wrong is found too.
    fn kind<Spec: DeserializeOwned + JsonSchema>(
        &mut self,
        what: &str,
        place: &Place<'_>,
        kinds: &'static [kinds::Kind],
    ) -> Option<(Spec, &'static kinds::Kind)> {
        let mut value = place.node.to_value();
        // A key without a value counts as not given.
        value
            .as_object_mut()?
            .retain(|key, value| !value.is_null() || kinds.iter().all(|kind| kind.name != key));
        let given: Vec<&kinds::Kind> = kinds
            .iter()
            .filter(|kind| value.get(kind.name).is_some())
            .collect();
        let [kind] = given.as_slice() else {
            self.not_one_kind::<Spec>(what, place, &given, kinds);
            return None;
        };
        self.contradictions(kind, &place.below(kind.name)?, &mut value[kind.name]);
        serde_json::from_value(value).ok().map(|spec| (spec, *kind))
    }

    /// Says that a table or figure gives no kind, or several; a key that nobody knows may have been meant and
    /// was said before.
    fn not_one_kind<Spec: JsonSchema>(
        &mut self,
        what: &str,
        place: &Place<'_>,
        given: &[&kinds::Kind],
        kinds: &[kinds::Kind],
    ) {
        let message = match given {
            [first, second, ..] => format!("{what} shows both `{}` and `{}`", first.name, second.name),
            _ => format!("{what} does not say what it shows"),
        };
        let schema = schema_for!(Spec).to_value();
        if place
            .node
            .entries()
            .iter()
            .all(|entry| schema["properties"].get(&entry.key).is_some())
        {
            let known: Vec<String> = kinds.iter().map(|kind| kind.name.to_owned()).collect();
            self.say(
                (place.key, place.at.clone()),
                message,
                format!("give exactly one of {}", quoted(&known)),
            );
        }
    }

    /// Says which options exclude each other, and removes them.
    fn contradictions(&mut self, kind: &kinds::Kind, place: &Place<'_>, value: &mut Value) {
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

    /// All agents and environments.
    pub fn all(&self) -> Picked {
        let vocabulary = self.vocabulary;
        Picked {
            agents: (0..vocabulary.agents.len()).collect(),
            environments: (0..vocabulary.environments.len()).collect(),
        }
    }

    /// Names of what traces of these environments hold.
    #[must_use]
    pub fn traced(&self, picked: &Picked) -> BTreeSet<String> {
        picked
            .environments
            .iter()
            .filter_map(|index| self.vocabulary.traced.get(index))
            .flatten()
            .cloned()
            .collect()
    }

    /// Metrics that some trial of these agents and environments records.
    #[must_use]
    pub fn recorded(&self, picked: &Picked) -> BTreeSet<String> {
        let pairs = picked
            .environments
            .iter()
            .flat_map(|environment| picked.agents.iter().map(move |agent| (*environment, *agent)));
        pairs
            .filter_map(|pair| self.vocabulary.recorded.get(&pair))
            .flatten()
            .cloned()
            .collect()
    }

    /// Says where a metric is missing, or is one that none of these trials records.
    pub fn metric(&mut self, name: &str, place: &Place<'_>, key: &str, picked: &Picked) {
        if name.is_empty() {
            return self.say(
                (place.key, place.at.clone()),
                format!("`{key}` is missing: it names a metric"),
                "",
            );
        }
        let recorded = self.recorded(picked);
        if !recorded.contains(name) && !recorded.is_empty() {
            self.unknown_metric(name, place.value(key), &recorded);
        }
    }

    /// Says that no trial records a metric, and what is recorded.
    pub fn unknown_metric(&mut self, name: &str, place: (Span, String), recorded: &BTreeSet<String>) {
        let list = recorded.iter().map(String::as_str).collect::<Vec<_>>();
        let known = list
            .iter()
            .map(|name| format!("`{name}`"))
            .collect::<Vec<_>>()
            .join(", ");
        let help = match document::diagnostic::nearest(name, &list) {
            Some(near) => format!("did you mean `{near}`? recorded here: {known}"),
            None => format!("recorded here: {known}"),
        };
        self.say(place, format!("no trial records `{name}`"), help);
    }

    /// The agents and environments that a table or figure names; all that have trials where it names none.
    pub fn pick(&mut self, place: &Place<'_>) -> Picked {
        let vocabulary = self.vocabulary;
        let one = |key: &str| {
            place
                .node
                .entry(key)
                .filter(|entry| entry.value.as_str().is_some())
        };
        let mut environments = self.listed(place, "environments", "environment", &vocabulary.environments);
        if let Some(entry) = one("environment") {
            environments = self
                .known(&entry.value, "environment", &vocabulary.environments, &place.at)
                .into_iter()
                .collect();
        }
        let agents = self.listed(place, "agents", "agent", &vocabulary.agents);
        let all = |n: usize| (0..n).collect::<Vec<_>>();
        let picked = Picked {
            agents: if agents.is_empty() {
                all(vocabulary.agents.len())
            } else {
                agents.clone()
            },
            environments: if environments.is_empty() {
                all(vocabulary.environments.len())
            } else {
                environments.clone()
            },
        };
        let before = self.found.len();
        for agent in agents {
            self.meets(place, &picked, ("agents", "agent", agent));
        }
        // One remark is enough for agents and environments that never meet.
        if before == self.found.len() {
            for environment in environments {
                self.meets(place, &picked, ("environments", "environment", environment));
            }
        }
        picked
    }

    /// Says where an agent or an environment that is named has no trial among those that are picked.
    fn meets(&mut self, place: &Place<'_>, picked: &Picked, (key, kind, index): (&str, &str, usize)) {
        let vocabulary = self.vocabulary;
        let has_trial = |pair| vocabulary.recorded.contains_key(&pair);
        let (name, others, meets) = if kind == "agent" {
            let mut environments = picked.environments.iter();
            let meets = environments.any(|environment| has_trial((*environment, index)));
            (&vocabulary.agents[index], "environments", meets)
        } else {
            let mut agents = picked.agents.iter();
            (
                &vocabulary.environments[index],
                "agents",
                agents.any(|agent| has_trial((index, *agent))),
            )
        };
        if !meets {
            let message = format!("no trial feeds the {kind} `{name}` here");
            let help = format!("`exclude` leaves out its combinations with these {others}");
            self.say(place.value(key), message, help);
        }
    }

    fn listed(&mut self, place: &Place<'_>, key: &str, kind: &str, known: &[String]) -> Vec<usize> {
        let Some(list) = place.below(key) else {
            return Vec::new();
        };
        let mut indices = Vec::new();
        for item in list.node.items() {
            let Some(index) = self.known(item, kind, known, &list.at) else {
                continue;
            };
            if indices.contains(&index) {
                self.say(
                    (item.span, list.at.clone()),
                    format!("`{}` is listed twice", known[index]),
                    "remove one of the two",
                );
            } else {
                indices.push(index);
            }
        }
        indices
    }

    /// The index of a name among those that are known; says where it is none of them.
    pub fn known(&mut self, item: &Node, kind: &str, known: &[String], at: &str) -> Option<usize> {
        let name = item.as_str()?;
        let index = known.iter().position(|it| it == name);
        if index.is_none() {
            let help = suggest(name, known.iter().map(String::as_str));
            self.say(
                (item.span, at.into()),
                format!("no {kind} is named `{name}`"),
                help,
            );
        }
        index
    }
}

/// Names in backticks, with commas.
#[must_use]
pub fn quoted(names: &[String]) -> String {
    names
        .iter()
        .map(|name| format!("`{name}`"))
        .collect::<Vec<_>>()
        .join(", ")
}
