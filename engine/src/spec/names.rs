//! Tables, figures and claims against what trials record: every metric, agent, environment, setting, channel and row.

use super::{
    builds::World,
    claims::{self, ClaimSpec},
};
use crate::{
    diagnostic::{Diagnostic, Sources, Span, suggest},
    document::{Entry, Kind, Node},
    figure::FigureSpec,
    table::{Axis, Comparison, Form, Published, TableSpec},
};
use serde::de::DeserializeOwned;
use std::collections::BTreeSet;

/// What a study asks for, and what is wrong with it.
#[derive(Debug, Default)]
pub struct Asked {
    /// Tables by name.
    pub tables: Vec<(String, TableSpec)>,
    /// Figures by name.
    pub figures: Vec<(String, FigureSpec)>,
    /// Claims.
    pub claims: Vec<ClaimSpec>,
    /// Mistakes.
    pub found: Vec<Diagnostic>,
}

impl Asked {
    /// Reads the sections `tables`, `figures` and `claims`. What the check against the schema refused is passed over.
    #[must_use]
    pub fn read(root: &Node, world: &World, sources: &Sources) -> Self {
        let mut asked = Self::default();
        let mut names = Names { world, sources, found: Vec::new() };
        for entry in root.get("tables").map_or(&[][..], Node::entries) {
            if let Some(spec) = typed::<TableSpec>(&entry.value) {
                names.table(&spec, entry);
                asked.tables.push((entry.key.clone(), spec));
            }
        }
        for entry in root.get("figures").map_or(&[][..], Node::entries) {
            if let Some(spec) = typed::<FigureSpec>(&entry.value) {
                names.figure(&spec, entry);
                asked.figures.push((entry.key.clone(), spec));
            }
        }
        for (index, item) in root.get("claims").map_or(&[][..], Node::items).iter().enumerate() {
            asked.claims.extend(names.claim(item, &format!("claims[{index}]")));
        }
        asked.found = names.found;
        asked
    }
}

fn typed<T: DeserializeOwned>(node: &Node) -> Option<T> {
    serde_json::from_value(node.to_value()).ok()
}

/// The part of the study that a table or figure takes its values from.
struct Picked {
    agents: Vec<usize>,
    environments: Vec<usize>,
}

/// A mapping of the study with its place.
#[derive(Clone)]
struct Place<'a> {
    node: &'a Node,
    key: Span,
    at: String,
}

impl<'a> Place<'a> {
    fn of(entry: &'a Entry, at: String) -> Self {
        Self { node: &entry.value, key: entry.key_span, at }
    }

    fn below(&self, key: &str) -> Option<Place<'a>> {
        self.node.entry(key).map(|entry| Place::of(entry, format!("{}.{key}", self.at)))
    }

    /// Where the value under a key stands, or the mapping's own key where it is not given.
    fn value(&self, key: &str) -> (Span, String) {
        let at = format!("{}.{key}", self.at);
        match self.node.entry(key) {
            Some(entry) if matches!(entry.value.kind, Kind::Scalar(_)) => (entry.value.span, at),
            Some(entry) => (entry.key_span, at),
            None => (self.key, at),
        }
    }
}

struct Names<'a> {
    world: &'a World,
    sources: &'a Sources,
    found: Vec<Diagnostic>,
}

impl Names<'_> {
    fn say(&mut self, (span, at): (Span, String), message: impl Into<String>, help: impl Into<String>) {
        let help = help.into();
        let error = self.sources.error(span, &at, message);
        self.found.push(if help.is_empty() { error } else { error.help(help) });
    }

    fn table(&mut self, spec: &TableSpec, entry: &Entry) {
        let place = Place::of(entry, format!("tables.{}", entry.key));
        let kinds = [("improvement", &spec.improvement), ("comparison", &spec.comparison)];
        let given: Vec<_> = kinds.into_iter().filter_map(|(kind, it)| Some((kind, it.as_ref()?))).collect();
        let [(kind, comparison)] = given.as_slice() else {
            let named = given.iter().map(|(kind, _)| *kind).collect::<Vec<_>>();
            return self.one_kind(&format!("the table `{}`", entry.key), &place, &named, "`improvement` or `comparison`");
        };
        let Some(inner) = place.below(kind) else { return };
        let (rows, columns) = self.comparison(comparison, &inner, *kind == "improvement");
        for (row, published) in &spec.published {
            self.published(row, published, &rows, &columns, &place);
        }
    }

    fn one_kind(&mut self, what: &str, place: &Place<'_>, given: &[&str], kinds: &str) {
        let message = match given {
            [] => format!("{what} does not say what it shows"),
            [first, second, ..] => format!("{what} shows both `{first}` and `{second}`"),
            [_] => return,
        };
        self.say((place.key, place.at.clone()), message, format!("give exactly one of {kinds}"));
    }

    /// Checks a comparison; returns the names of its rows and columns.
    fn comparison(&mut self, spec: &Comparison, place: &Place<'_>, improvement: bool) -> (Vec<String>, Vec<String>) {
        let picked = self.pick(place);
        self.metric(&spec.value, place, "value", &picked);
        if let Some(other) = &spec.relative_to {
            self.known_agent(other, place, "relative_to", &picked);
        }
        let needs = improvement || matches!(spec.form, Some(Form::Difference | Form::Ratio | Form::PercentChange));
        if needs && spec.relative_to.is_none() {
            let message = "`relative_to` is missing: this compares agents with one of them";
            self.say((place.key, place.at.clone()), message, format!("agents: {}", quoted(&self.world.agents)));
        }
        if spec.columns == Some(spec.rows) {
            self.say(
                place.value("columns"),
                "rows and columns are the same",
                "choose another of `agent`, `environment`, `setting`",
            );
        }
        let has_sweep = self.world.settings.iter().any(|setting| !setting.is_empty());
        for (key, axis) in [("rows", Some(spec.rows)), ("columns", spec.columns)] {
            if axis == Some(Axis::Setting) && !has_sweep {
                self.say(place.value(key), format!("`{key}` are settings, but the study has no `sweep`"), "");
            }
        }
        let rows = self.names_of(spec.rows, &picked);
        let columns = self.columns(spec, &picked);
        self.labels(place, &rows, &columns);
        (rows, columns)
    }

    fn names_of(&self, axis: Axis, picked: &Picked) -> Vec<String> {
        match axis {
            Axis::Agent => picked.agents.iter().map(|index| self.world.agents[*index].clone()).collect(),
            Axis::Environment => picked.environments.iter().map(|index| self.world.environments[*index].clone()).collect(),
            Axis::Setting => self.world.settings.iter().filter(|setting| !setting.is_empty()).cloned().collect(),
        }
    }

    /// Names of the columns: those asked for, or the first of agent, environment and setting that varies and is no row.
    fn columns(&self, spec: &Comparison, picked: &Picked) -> Vec<String> {
        if let Some(axis) = spec.columns {
            return self.names_of(axis, picked);
        }
        let rest = [Axis::Agent, Axis::Environment, Axis::Setting].into_iter().filter(|axis| *axis != spec.rows);
        rest.map(|axis| self.names_of(axis, picked)).find(|names| names.len() > 1).unwrap_or_default()
    }

    fn published(&mut self, row: &str, published: &Published, rows: &[String], columns: &[String], place: &Place<'_>) {
        let Some(section) = place.below("published") else { return };
        let Some(inner) = section.below(row) else { return };
        if !rows.iter().any(|known| known == row) {
            let message = format!("no trial feeds the row `{row}` of published values");
            self.say((inner.key, inner.at.clone()), message, suggest(row, rows.iter().map(String::as_str)));
        }
        let Published::Columns(values) = published else { return };
        for column in values.keys().filter(|column| !columns.contains(column)) {
            let span = inner.node.entry(column).map_or(inner.key, |entry| entry.key_span);
            let message = format!("no trial feeds the column `{column}` of published values");
            let help = if columns.is_empty() {
                format!("the table has one column: write `{row}: VALUE`")
            } else {
                suggest(column, columns.iter().map(String::as_str))
            };
            self.say((span, format!("{}.{column}", inner.at)), message, help);
        }
    }

    fn labels(&mut self, place: &Place<'_>, rows: &[String], columns: &[String]) {
        let Some(labels) = place.below("labels") else { return };
        let known: Vec<&str> = rows.iter().chain(columns).map(String::as_str).collect();
        for entry in labels.node.entries().iter().filter(|entry| !known.contains(&entry.key.as_str())) {
            let message = format!("`{}` is no row or column, so its label is never printed", entry.key);
            self.say(
                (entry.key_span, format!("{}.{}", labels.at, entry.key)),
                message,
                suggest(&entry.key, known.iter().copied()),
            );
        }
    }

    fn figure(&mut self, spec: &FigureSpec, entry: &Entry) {
        const KINDS: [&str; 6] = ["learning_curve", "trajectory", "bars", "grouped_lines", "scatter", "contour"];
        let place = Place::of(entry, format!("figures.{}", entry.key));
        let given: Vec<&str> = KINDS.into_iter().filter(|kind| place.node.entry(kind).is_some()).collect();
        let [kind] = given.as_slice() else {
            let kinds = KINDS.map(|kind| format!("`{kind}`")).join(", ");
            return self.one_kind(&format!("the figure `{}`", entry.key), &place, &given, &kinds);
        };
        let Some(inner) = place.below(kind) else { return };
        if let Some(bars) = &spec.bars {
            let of = inner.below("of").unwrap_or(inner.clone());
            self.comparison(&bars.of, &of, false);
        }
        let picked = self.pick(&inner);
        if let Some(curve) = &spec.learning_curve {
            self.metric(&curve.metric, &inner, "metric", &picked);
        }
        if let Some(lines) = &spec.grouped_lines {
            self.metric(&lines.metric, &inner, "metric", &picked);
            self.swept(&lines.x, &inner);
        }
        if let Some(scatter) = &spec.scatter {
            self.metric(&scatter.x, &inner, "x", &picked);
            self.metric(&scatter.y, &inner, "y", &picked);
        }
        if let Some(trajectory) = &spec.trajectory {
            self.channels(&inner, "channels", 1, usize::MAX, &picked);
            self.seed(trajectory.seed, &inner);
        }
        if let Some(contour) = &spec.contour {
            self.channels(&inner, "surface", 3, 3, &picked);
            self.channels(&inner, "path", 0, 2, &picked);
            self.seed(contour.seed, &inner);
        }
        self.figure_labels(&place);
    }

    fn figure_labels(&mut self, place: &Place<'_>) {
        let Some(labels) = place.below("labels") else { return };
        let all =
            Picked { agents: (0..self.world.agents.len()).collect(), environments: (0..self.world.environments.len()).collect() };
        let mut known = self.traced(&all);
        known.extend(self.recorded(&all));
        known.extend(self.world.agents.iter().chain(&self.world.environments).chain(&self.world.settings).cloned());
        for entry in labels.node.entries().iter().filter(|entry| !known.contains(&entry.key)) {
            let message = format!("nothing in this figure is called `{}`, so its label is never printed", entry.key);
            let help = suggest(&entry.key, known.iter().map(String::as_str).filter(|name| !name.is_empty()));
            self.say((entry.key_span, format!("{}.{}", labels.at, entry.key)), message, help);
        }
    }

    fn swept(&mut self, key: &str, place: &Place<'_>) {
        if self.world.swept.is_empty() {
            self.say(place.value("x"), format!("`x` is `{key}`, but the study has no `sweep`"), "");
        } else if !self.world.swept.iter().any(|known| known == key) {
            let help = suggest(key, self.world.swept.iter().map(String::as_str));
            self.say(place.value("x"), format!("no sweep varies `{key}`"), help);
        }
    }

    fn seed(&mut self, seed: Option<u64>, place: &Place<'_>) {
        if let Some(seed) = seed.filter(|seed| !self.world.seeds.contains(seed)) {
            let seeds = self.world.seeds.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
            self.say(place.value("seed"), format!("no trial has the seed {seed}"), format!("seeds of this study: {seeds}"));
        }
    }

    /// Names of recorded or traced values, where a word without a number stands for all numbered ones.
    fn channels(&mut self, place: &Place<'_>, key: &str, least: usize, most: usize, picked: &Picked) {
        let list = place.below(key);
        let items = list.as_ref().map_or(&[][..], |list| list.node.items());
        if items.len() < least || items.len() > most || (1..most).contains(&items.len()) && most == 2 {
            let wanted = if least == most || most == 2 { most.to_string() } else { format!("at least {least}") };
            self.say(place.value(key), format!("`{key}` has {} names, but needs {wanted}", items.len()), "");
        }
        let mut known = self.traced(picked);
        known.extend(self.recorded(picked));
        let whole = |name: &str| {
            name.rsplit_once('_').filter(|(_, number)| number.parse::<u32>().is_ok()).map(|(word, _)| word.to_string())
        };
        let words: BTreeSet<String> = known.iter().filter_map(|name| whole(name)).collect();
        for item in items {
            let Some(name) = item.as_str().filter(|name| !known.contains(*name) && !words.contains(*name)) else { continue };
            let help = suggest(name, words.iter().chain(known.iter().filter(|name| whole(name).is_none())).map(String::as_str));
            self.say((item.span, format!("{}.{key}", place.at)), format!("no trial traces `{name}`"), help);
        }
    }

    fn traced(&self, picked: &Picked) -> BTreeSet<String> {
        picked.environments.iter().filter_map(|index| self.world.traced.get(index)).flatten().cloned().collect()
    }

    fn recorded(&self, picked: &Picked) -> BTreeSet<String> {
        let pairs =
            picked.environments.iter().flat_map(|environment| picked.agents.iter().map(move |agent| (*environment, *agent)));
        pairs.filter_map(|pair| self.world.recorded.get(&pair)).flatten().cloned().collect()
    }

    fn metric(&mut self, name: &str, place: &Place<'_>, key: &str, picked: &Picked) {
        if name.is_empty() {
            return self.say((place.key, place.at.clone()), format!("`{key}` is missing: it names a metric"), "");
        }
        let recorded = self.recorded(picked);
        if !recorded.contains(name) && !recorded.is_empty() {
            self.unknown_metric(name, place.value(key), &recorded);
        }
    }

    fn unknown_metric(&mut self, name: &str, place: (Span, String), recorded: &BTreeSet<String>) {
        let list = recorded.iter().map(String::as_str).collect::<Vec<_>>();
        let known = list.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
        let help = match crate::diagnostic::nearest(name, &list) {
            Some(near) => format!("did you mean `{near}`? recorded here: {known}"),
            None => format!("recorded here: {known}"),
        };
        self.say(place, format!("no trial records `{name}`"), help);
    }

    /// The agents and environments that a table or figure names; all that have trials where it names none.
    fn pick(&mut self, place: &Place<'_>) -> Picked {
        let world = self.world;
        let one = |key: &str| place.node.entry(key).filter(|entry| entry.value.as_str().is_some());
        let mut environments = self.listed(place, "environments", "environment", &world.environments);
        if let Some(entry) = one("environment") {
            environments = self.known(&entry.value, "environment", &world.environments, &place.at).into_iter().collect();
        }
        let agents = self.listed(place, "agents", "agent", &world.agents);
        let all = |n: usize| (0..n).collect::<Vec<_>>();
        let picked = Picked {
            agents: if agents.is_empty() { all(world.agents.len()) } else { agents.clone() },
            environments: if environments.is_empty() { all(world.environments.len()) } else { environments.clone() },
        };
        let has_trial = |pair| world.recorded.contains_key(&pair);
        let before = self.found.len();
        for agent in agents {
            if !picked.environments.iter().any(|environment| has_trial((*environment, agent))) {
                let message = format!("no trial feeds the agent `{}` here", world.agents[agent]);
                self.say(place.value("agents"), message, "`exclude` leaves out its combinations with these environments");
            }
        }
        // One remark is enough for agents and environments that never meet.
        for environment in environments.into_iter().filter(|_| before == self.found.len()).collect::<Vec<_>>() {
            if !picked.agents.iter().any(|agent| has_trial((environment, *agent))) {
                let message = format!("no trial feeds the environment `{}` here", world.environments[environment]);
                self.say(place.value("environments"), message, "`exclude` leaves out its combinations with these agents");
            }
        }
        picked
    }

    fn listed(&mut self, place: &Place<'_>, key: &str, kind: &str, known: &[String]) -> Vec<usize> {
        let Some(list) = place.below(key) else { return Vec::new() };
        let mut indices = Vec::new();
        for item in list.node.items() {
            let Some(index) = self.known(item, kind, known, &list.at) else { continue };
            if indices.contains(&index) {
                self.say((item.span, list.at.clone()), format!("`{}` is listed twice", known[index]), "remove one of the two");
            } else {
                indices.push(index);
            }
        }
        indices
    }

    fn known(&mut self, item: &Node, kind: &str, known: &[String], at: &str) -> Option<usize> {
        let name = item.as_str()?;
        let index = known.iter().position(|it| it == name);
        if index.is_none() {
            let help = suggest(name, known.iter().map(String::as_str));
            self.say((item.span, at.into()), format!("no {kind} is named `{name}`"), help);
        }
        index
    }

    fn known_agent(&mut self, name: &str, place: &Place<'_>, key: &str, picked: &Picked) {
        let Some(index) = self.world.agents.iter().position(|known| known == name) else {
            let help = suggest(name, self.world.agents.iter().map(String::as_str));
            return self.say(place.value(key), format!("no agent is named `{name}`"), help);
        };
        if !picked.environments.iter().any(|environment| self.world.recorded.contains_key(&(*environment, index))) {
            let message = format!("no trial feeds the agent `{name}` here");
            self.say(place.value(key), message, "`exclude` leaves out its combinations with these environments");
        }
    }

    fn claim(&mut self, item: &Node, at: &str) -> Option<ClaimSpec> {
        let (spec, text) = match item.as_str() {
            Some(text) => (ClaimSpec { claim: text.into(), ..ClaimSpec::default() }, item),
            None => (typed::<ClaimSpec>(item)?, item.get("claim")?),
        };
        let environment = match item.get("environment") {
            Some(node) => Some(self.known(node, "environment", &self.world.environments, &format!("{at}.environment"))?),
            None => None,
        };
        // The text may begin with a quotation mark, which is part of the span but not of the claim.
        let quote = usize::from(text.span.length > spec.claim.chars().count());
        let word = |position: usize, length: usize| Span { column: text.span.column + quote + position, length, ..text.span };
        match claims::operands(&spec.claim) {
            Err(mistake) => {
                let length = mistake.length(&spec.claim);
                let example = "a claim reads `AGENT.METRIC > AGENT.METRIC`, with `>`, `<`, `>=` or `<=` and numbers where needed";
                self.say((word(mistake.position, length), at.into()), mistake.message, example);
            }
            Ok(operands) => {
                for operand in operands {
                    let (agent, metric) = (operand.agent.chars().count(), operand.metric.chars().count());
                    let spans = [word(operand.position, agent), word(operand.position + agent + 1, metric)];
                    self.operand(&operand, environment, spans.map(|span| (span, at.to_string())));
                }
            }
        }
        Some(spec)
    }

    fn operand(&mut self, operand: &claims::Operand, environment: Option<usize>, [agent_at, metric_at]: [(Span, String); 2]) {
        let Some(agent) = self.world.agents.iter().position(|known| *known == operand.agent) else {
            let help = suggest(&operand.agent, self.world.agents.iter().map(String::as_str));
            return self.say(agent_at, format!("no agent is named `{}`", operand.agent), help);
        };
        let environments = environment.map_or_else(|| (0..self.world.environments.len()).collect(), |index| vec![index]);
        let recorded = self.recorded(&Picked { agents: vec![agent], environments });
        if recorded.is_empty() {
            self.say(agent_at, format!("no trial feeds the agent `{}` here", operand.agent), "`exclude` leaves it out");
        } else if !recorded.contains(&operand.metric) {
            self.unknown_metric(&operand.metric, metric_at, &recorded);
        }
    }
}

fn quoted(names: &[String]) -> String {
    names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
}
