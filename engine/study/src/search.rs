//! The section `tune`: searched keys of an agent, the method, and the settings that were tried so far.
//!
//! A study with a search is read again for every generation. [`Progress`] holds the settings that exist and the one
//! that was chosen. Its trials are cells of their own ([`Place::Tried`](crate::cell::Place::Tried)), and the agent
//! itself has no trials before its setting is chosen.

use super::{
    path::{self, KeyPath},
    sweep::{self, Dimension},
    written::{NamedPart, Target, Written},
};
use analysis::search::{Direction, FIRST_TUNING_SEED, Failed, Method, Progress, Range, Search, lineage};
use contract::sweep_point::SweepPoint;
use document::{
    Entry, FittingEntries, Node,
    diagnostic::{Diagnostic, Sources, Span, suggest},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;

/// A search as it is written.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct SearchText {
    /// Keys of one agent by dotted path, each with its possible values.
    #[schemars(extend("minProperties" = 1))]
    over: BTreeMap<String, RangeText>,
    /// The metric by which settings are compared: its mean over the final episodes and the seeds of the search.
    metric: String,
    /// Whether higher or lower values of the metric are better.
    #[serde(default)]
    direction: Direction,
    /// The environment in which settings are compared; the only one where absent.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    environment: String,
    /// Number of settings that are tried.
    #[schemars(range(min = 1, max = 10_000))]
    settings: usize,
    /// Seeds of each setting. They differ from those of the study, on which the chosen setting is measured.
    #[serde(default = "one")]
    #[schemars(range(min = 1, max = 1000))]
    seeds: u64,
    /// Method of choosing the next setting.
    #[serde(default)]
    method: Method,
    /// Treatment of a setting with a failed trial: the search waits until the trial is run again, or goes on and ranks
    /// the setting last. A setting whose numbers are not finite always ranks last.
    #[serde(default, skip_serializing_if = "Failed::is_wait")]
    failed: Failed,
}

fn one() -> u64 {
    1
}

/// Possible values of a searched key.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum RangeText {
    /// Numbers between two limits.
    Uniform(
        /// Numbers that are equally likely before anything is known.
        Limits,
    ),
    /// Numbers above 0 between two limits.
    LogUniform(
        /// Numbers whose logarithms are equally likely before anything is known.
        Limits,
    ),
    /// Listed values.
    Choice(
        /// Values in no order.
        ValueList,
    ),
}

/// Values in no order.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub(super) struct ValueList(#[schemars(length(min = 1))] Vec<Value>);

/// Two limits, both included.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Limits {
    /// Smallest value.
    low: f64,
    /// Largest value.
    high: f64,
}

/// A search with the places of its keys in the study.
#[derive(Debug, Clone)]
pub struct LocatedSearch<'a> {
    /// The search, as later stages read it.
    pub search: Search,
    /// Index of the environment in which settings are compared.
    pub environment: usize,
    /// Index of the agent whose setting is searched.
    pub agent: usize,
    /// The searched keys, in the order of the study.
    pub paths: Vec<KeyPath<'a>>,
    /// The settings that are tried, with a value for each key, and the choice among them.
    pub progress: Progress,
}

impl LocatedSearch<'_> {
    /// The search and its progress, without places in the study.
    pub(super) fn unlocated(&self) -> (Search, Progress) {
        (self.search.clone(), self.progress.clone())
    }

    /// Environment and agent, by their indices.
    #[must_use]
    pub fn pair(&self) -> (usize, usize) {
        (self.environment, self.agent)
    }

    /// Writes the setting at a place into a config of the agent.
    pub(super) fn assign(&self, place: usize, config: &mut Node) {
        for (path, value) in self.paths.iter().zip(&self.progress.points[place]) {
            path.assign(config, &Node::from_value(path.span, value));
        }
    }

    /// The setting at a place, with its keys as they are written.
    pub(super) fn point(&self, place: usize) -> SweepPoint {
        let keys = self.search.keys.iter().map(|(text, _)| text.as_str());
        let values = self.progress.points[place].iter().cloned();
        keys.zip(values).collect()
    }

    /// The place of the setting whose learning the one at `place` continues.
    #[must_use]
    pub fn parent(&self, place: usize) -> Option<usize> {
        self.progress.parents.get(place).copied().flatten()
    }

    /// The settings that lead to the chosen member of a population, without that member; none for other searches.
    #[must_use]
    pub fn way_to_chosen(&self) -> Vec<usize> {
        let Progress { chosen, parents, .. } = &self.progress;
        let mut way = chosen.map_or_else(Vec::new, |chosen| lineage(parents, chosen));
        way.pop();
        way
    }
}

/// Reads all searches; keys that a profile or `--set` fixed are left out. `progress` gives the progress of each search
/// by name.
///
/// # Errors
/// Unknown paths and names, limits that contain nothing, and agents that are searched twice or also swept.
pub fn read<'a>(
    texts: &FittingEntries<SearchText>,
    written: &Written,
    schema: &'a Value,
    sources: &Sources,
    (fixed, dimensions): (&[KeyPath<'_>], &[Dimension<'_>]),
    progress: &BTreeMap<String, Progress>,
) -> Result<Vec<LocatedSearch<'a>>, Vec<Diagnostic>> {
    let (mut searches, mut found) = (Vec::<LocatedSearch<'a>>::new(), Vec::new());
    for named in &written.searches {
        // The check against the schema already reported a search that it refused.
        let Some(text) = texts.get(&named.name) else {
            continue;
        };
        let reader = SearchReader {
            text,
            named,
            written,
            schema,
            sources,
            fixed,
            dimensions,
        };
        match reader.search(progress, &searches) {
            Ok(search) => searches.push(search),
            Err(errors) => found.extend(errors),
        }
    }
    if found.is_empty() {
        Ok(searches)
    } else {
        Err(found)
    }
}

struct SearchReader<'a, 's> {
    text: &'s SearchText,
    named: &'s NamedPart,
    written: &'s Written,
    schema: &'a Value,
    sources: &'s Sources,
    fixed: &'s [KeyPath<'s>],
    dimensions: &'s [Dimension<'s>],
}

impl<'a> SearchReader<'a, '_> {
    fn search(
        &self,
        progress: &BTreeMap<String, Progress>,
        others: &[LocatedSearch<'_>],
    ) -> Result<LocatedSearch<'a>, Vec<Diagnostic>> {
        let text = self.text;
        let keys = self.keys()?;
        let (agent, first) = self.agent(&keys)?;
        let environment = self.environment(&text.environment)?;
        self.alone(agent, environment, first, others)?;
        self.has_room(&keys, text.settings)?;
        self.can_move(&keys, &text.method)?;
        self.has_members(text.settings, &text.method)?;
        let progress = progress.get(&self.named.name).cloned().unwrap_or_default();
        Ok(LocatedSearch {
            progress,
            environment,
            agent,
            search: Search {
                name: self.named.name.clone(),
                environment: self.written.environments[environment].name.clone(),
                agent: self.written.agents[agent].name.clone(),
                plugin: self.written.agents[agent].plugin.clone(),
                keys: keys
                    .iter()
                    .map(|(text, _, range)| (text.clone(), range.clone()))
                    .collect(),
                metric: text.metric.clone(),
                direction: text.direction,
                settings: text.settings,
                seeds: (FIRST_TUNING_SEED..FIRST_TUNING_SEED + text.seeds).collect(),
                method: text.method.clone(),
                failed: text.failed,
            },
            paths: keys.into_iter().map(|(_, path, _)| path).collect(),
        })
    }

    /// The keys in the order of the study.
    fn keys(&self) -> Result<Vec<(String, KeyPath<'a>, Range)>, Vec<Diagnostic>> {
        let (mut keys, mut found) = (Vec::new(), Vec::new());
        for entry in self.named.config.get("over").map_or(&[][..], Node::entries) {
            match self.key(entry) {
                Ok(Some((path, range))) => keys.push((entry.key.clone(), path, range)),
                Ok(None) => {}
                Err(errors) => found.extend(errors),
            }
        }
        if found.is_empty() { Ok(keys) } else { Err(found) }
    }

    fn key(&self, entry: &Entry) -> Result<Option<(KeyPath<'a>, Range)>, Vec<Diagnostic>> {
        let at = format!("{}.over.{}", self.at(), entry.key);
        let path = path::find(
            &entry.key,
            entry.key_span,
            &at,
            self.written,
            self.schema,
            self.sources,
        )?;
        if self.fixed.iter().any(|fixed| fixed.overlaps(&path)) {
            return Ok(None);
        }
        if !matches!(path.target, Target::Agent(_)) || path.is_preset() {
            let error = self.sources.error(
                entry.key_span,
                &at,
                format!("`{}` is no key of an agent", entry.key),
            );
            return Err(vec![
                error.help("a search chooses the setting of an agent: write `AGENT.KEY`"),
            ]);
        }
        let (Some(range), [written]) = (self.text.over.get(&entry.key), entry.value.entries()) else {
            return Err(Vec::new());
        };
        let range = self.range(range, written, &path, &at)?;
        Ok(Some((path, range)))
    }

    fn range(
        &self,
        range: &RangeText,
        written: &Entry,
        path: &KeyPath<'_>,
        at: &str,
    ) -> Result<Range, Vec<Diagnostic>> {
        let (low, high, log) = match range {
            RangeText::Choice(ValueList(values)) => {
                let items = written.value.items().iter();
                let wrong: Vec<_> = items.flat_map(|it| path.check(it, at, self.sources)).collect();
                return if wrong.is_empty() {
                    Ok(Range::Choice(values.clone()))
                } else {
                    Err(wrong)
                };
            }
            RangeText::Uniform(Limits { low, high }) => (*low, *high, false),
            RangeText::LogUniform(Limits { low, high }) => (*low, *high, true),
        };
        let numbers = sweep::numbers(written, path, (low, high, log), at, self.sources)
            .map_err(|error| vec![*error])?;
        let ends = [0.0, 1.0].map(|share| Node::from_value(written.key_span, &numbers.at(share)));
        let wrong: Vec<_> = ends
            .iter()
            .flat_map(|end| path.check(end, at, self.sources))
            .take(1)
            .collect();
        if wrong.is_empty() {
            Ok(Range::Numbers(numbers))
        } else {
            Err(wrong)
        }
    }

    /// The only agent whose keys are searched, and the position of its first key.
    fn agent(&self, keys: &[(String, KeyPath<'a>, Range)]) -> Result<(usize, Span), Vec<Diagnostic>> {
        let agents = keys.iter().filter_map(|(text, path, _)| match path.target {
            Target::Agent(index) => Some((text, index, path.span)),
            _ => None,
        });
        let agents: Vec<_> = agents.collect();
        let Some((_, agent, span)) = agents.first().copied() else {
            return Err(vec![
                self.error("nothing is left to be searched")
                    .help("the profile or `--set` fixes every key under `over`"),
            ]);
        };
        match agents.iter().find(|(_, other, _)| *other != agent) {
            None => Ok((agent, span)),
            Some((text, _, place)) => {
                let (first, at) = (
                    &self.written.agents[agent].name,
                    format!("{}.over.{text}", self.at()),
                );
                let error = self.sources.error(
                    *place,
                    &at,
                    format!("`{text}` is a key of another agent than `{first}`"),
                );
                Err(vec![error.help("write a search for each agent")])
            }
        }
    }

    fn environment(&self, name: &str) -> Result<usize, Vec<Diagnostic>> {
        let known = &self.written.environments;
        if name.is_empty() && known.len() == 1 {
            return Ok(0);
        }
        let span = self
            .named
            .config
            .get("environment")
            .map_or(self.named.name_span, |node| node.span);
        let names = || known.iter().map(|it| it.name.as_str());
        let (message, help) = if name.is_empty() {
            let names: Vec<&str> = names().collect();
            let message = "it is not said in which environment settings are compared".to_owned();
            (
                message,
                format!("write `environment:` and one of {}", names.join(", ")),
            )
        } else {
            (
                format!("no environment is named `{name}`"),
                suggest(name, names()),
            )
        };
        known.iter().position(|it| it.name == name).ok_or_else(|| {
            vec![
                self.sources
                    .error(span, &format!("{}.environment", self.at()), message)
                    .help(help),
            ]
        })
    }

    /// Checks that nothing else varies the agent, or the environment in which settings are compared.
    fn alone(
        &self,
        agent: usize,
        environment: usize,
        span: Span,
        others: &[LocatedSearch<'_>],
    ) -> Result<(), Vec<Diagnostic>> {
        let name = &self.written.agents[agent].name;
        if let Some(other) = others.iter().find(|other| other.agent == agent) {
            let error = self
                .sources
                .error(span, &self.at(), format!("`{name}` is searched twice"));
            return Err(vec![error.help(format!(
                "the search `{}` has it already; give it both sets of keys",
                other.search.name
            ))]);
        }
        let targets = [
            Target::Agent(agent),
            Target::Environment(environment),
            Target::Protocol,
        ];
        let swept = self
            .dimensions
            .iter()
            .flat_map(|it| &it.keys)
            .find(|key| targets.contains(&key.path.target));
        match swept {
            None => Ok(()),
            Some(key) => {
                let message = format!(
                    "`{}` is swept, so that `{name}` would have several best settings",
                    key.swept.key
                );
                let error = self.sources.error(span, &self.at(), message);
                Err(vec![
                    error
                        .note("it is swept here", self.sources.place(key.path.span))
                        .help("leave one of the two out"),
                ])
            }
        }
    }

    /// Refuses a population of one, which has no member to replace.
    fn has_members(&self, settings: usize, method: &Method) -> Result<(), Vec<Diagnostic>> {
        if settings > 1 || !matches!(method, Method::Population(_)) {
            return Ok(());
        }
        let help = "write the number of members that learn side by side, 2 at least";
        Err(self.wrong_settings("a population of one setting has nobody to learn from", help))
    }

    /// Refuses listed values for methods that sample from a normal distribution.
    fn can_move(
        &self,
        keys: &[(String, KeyPath<'a>, Range)],
        method: &Method,
    ) -> Result<(), Vec<Diagnostic>> {
        let listed = keys
            .iter()
            .find(|(_, _, range)| matches!(range, Range::Choice(_)));
        let (Method::CmaEs(_), Some((text, path, _))) = (method, listed) else {
            return Ok(());
        };
        let error = self.sources.error(
            path.span,
            &format!("{}.over.{text}", self.at()),
            format!("`{text}` is a choice, and `cma_es` searches numbers alone"),
        );
        Err(vec![error.help(
            "leave the key out, give it `uniform` or `log_uniform`, or use `tree_parzen`",
        )])
    }

    /// Checks that at least as many settings exist as are to be tried.
    fn has_room(
        &self,
        keys: &[(String, KeyPath<'a>, Range)],
        settings: usize,
    ) -> Result<(), Vec<Diagnostic>> {
        let counts: Option<Vec<usize>> = keys.iter().map(|(_, _, range)| range.count()).collect();
        let all = counts.map(|counts| counts.into_iter().fold(1, usize::saturating_mul));
        let Some(all) = all.filter(|all| *all < settings) else {
            return Ok(());
        };
        let message = format!("{settings} settings are to be tried, and there are {all}");
        let help = format!("write at most {all}, or sweep them all with `grid`");
        Err(self.wrong_settings(&message, &help))
    }

    /// A mistake in the number of settings.
    fn wrong_settings(&self, message: &str, help: &str) -> Vec<Diagnostic> {
        let written = self.named.config.get("settings");
        let span = written.map_or(self.named.name_span, |node| node.span);
        let at = format!("{}.settings", self.at());
        vec![self.sources.error(span, &at, message).help(help)]
    }

    fn at(&self) -> String {
        format!("tune.{}", self.named.name)
    }

    fn error(&self, message: &str) -> Diagnostic {
        self.sources.error(self.named.name_span, &self.at(), message)
    }
}
