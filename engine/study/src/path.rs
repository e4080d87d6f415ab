//! Dotted paths such as `learner.discount` or `protocol.steps`, and the keys that they name.

use super::written::{NamedPart, PartKind, PreparedPart, Target, Written};
use document::{
    Node, NodeKind,
    diagnostic::{Diagnostic, Sources, Span, suggest},
    schema_check::{At, Checker, View},
};
use serde_json::Value;

/// A dotted path to a key that exists.
#[derive(Debug, Clone)]
pub struct KeyPath<'a> {
    /// Owner of the config.
    pub target: Target,
    /// Keys inside the plugin's config.
    pub keys: Vec<String>,
    /// Schema of the plugin's config.
    pub config: View<'a>,
    /// Schema of a value at the key.
    pub schema: View<'a>,
    /// Position of the path.
    pub span: Span,
}

/// Finds the key that `text` names.
///
/// # Errors
/// The unknown part of the path, with the nearest known name. The list is empty if the plugin itself is unknown, which
/// the check against the schema reports.
pub fn find<'a>(
    text: &str,
    span: Span,
    at: &str,
    written: &Written,
    schema: &'a Value,
    sources: &Sources,
) -> Result<KeyPath<'a>, Vec<Diagnostic>> {
    let words: Vec<&str> = text.split('.').collect();
    let study = View::new(schema, schema);
    let place = PathText {
        words: &words,
        span,
        at,
        written,
        sources,
    };
    if words[0] == "seeds" {
        return seeds(&study, &place);
    }
    let Some((target, used)) = begin(&words, written) else {
        return Err(vec![place.names_no_part()]);
    };
    let plugin = written.plugin(target);
    let config = config_schema(study, target, plugin).ok_or_else(Vec::new)?;
    let named_twice = words.get(used) == Some(&plugin) && config.property(plugin).is_none();
    let first = used + usize::from(named_twice);
    let keys: Vec<String> = words[first..].iter().map(ToString::to_string).collect();
    if keys.is_empty() {
        return Err(vec![place.names_no_key(used, &config)]);
    }
    let own = own_keys(&config, written.part(target));
    let keys = match own {
        Some((below, ref names))
            if config.property(&keys[0]).is_none() && names.contains(&keys[0].as_str()) =>
        {
            [&[below.to_owned()], &keys[..]].concat()
        }
        _ => keys,
    };
    let schema = config.descend(&keys).map_err(|(index, mut known)| {
        if index == 0 {
            known.extend(own.into_iter().flat_map(|(_, names)| names));
        }
        vec![place.no_key(plugin, &keys, (index, first), known)]
    })?;
    Ok(KeyPath {
        target,
        keys,
        config,
        schema,
        span,
    })
}

/// The key under which a plugin keeps free keys of a study, which paths address as the plugin's own, and their names.
fn own_keys<'a, 'w>(config: &View<'a>, named: Option<&'w NamedPart>) -> Option<(&'a str, Vec<&'w str>)> {
    let names = config.property_names().into_iter();
    let is_marked = |name: &&str| {
        let property = config.property(name);
        property.is_some_and(|it| it.get("x-own-keys") == Some(&Value::Bool(true)))
    };
    let below = names.into_iter().find(is_marked)?;
    let entries = match &named?.config.get(below)?.kind {
        NodeKind::Mapping(entries) => entries.iter(),
        _ => return None,
    };
    Some((below, entries.map(|entry| entry.key.as_str()).collect()))
}

/// The seeds as a whole, or a key of their design.
fn seeds<'a>(study: &View<'a>, place: &PathText<'_>) -> Result<KeyPath<'a>, Vec<Diagnostic>> {
    let config = study.property("seeds").unwrap_or_else(|| study.clone());
    let keys: Vec<String> = place.words[1..].iter().map(ToString::to_string).collect();
    let schema = config.descend(&keys).map_err(|(index, known)| {
        let message = format!("`seeds` has no key `{}`", keys[index]);
        vec![place.unknown(1 + index, message, known)]
    })?;
    Ok(KeyPath {
        target: Target::Seeds,
        keys,
        config,
        schema,
        span: place.span,
    })
}

/// A path as it is written, for messages about it.
struct PathText<'a> {
    words: &'a [&'a str],
    span: Span,
    at: &'a str,
    written: &'a Written,
    sources: &'a Sources,
}

impl PathText<'_> {
    /// The message about a word that is unknown.
    fn unknown(&self, index: usize, message: String, known: Vec<&str>) -> Diagnostic {
        let words = self.words;
        let before: usize = words[..index].iter().map(|word| word.chars().count() + 1).sum();
        let span = Span {
            column: self.span.column + before,
            length: words[index].chars().count(),
            ..self.span
        };
        let error = self.sources.error(span, self.at, message);
        error.help(suggest(words[index], known))
    }

    /// The message about a key at `index` that its owner does not have. Keys begin at the word `first`.
    fn no_key(
        &self,
        plugin: &str,
        keys: &[String],
        (index, first): (usize, usize),
        known: Vec<&str>,
    ) -> Diagnostic {
        let owner = match index {
            0 => format!("`{plugin}`"),
            _ => format!("`{}` of `{plugin}`", keys[..index].join(".")),
        };
        let message = format!("{owner} has no key `{}`", keys[index]);
        self.unknown(first + index, message, known)
    }

    /// The message about a path whose first words name nothing in the study.
    fn names_no_part(&self) -> Diagnostic {
        let Self { words, written, .. } = self;
        let named = |list: &'_ [NamedPart]| list.iter().map(|it| it.name.clone()).collect::<Vec<_>>();
        let (what, index, known) = match words {
            ["prepare", ..] => return nothing_prepared(words, self.span, self.at, written, self.sources),
            ["cross_play", _, ..] => ("play", 1, named(&written.plays)),
            ["tune", _, ..] => ("search", 1, named(&written.searches)),
            _ => {
                let is_section = words.len() > 1 && ["environments", "agents"].contains(&words[0]);
                let known = written.names().into_iter().chain(["protocol", "seeds"]);
                (
                    "environment or agent",
                    usize::from(is_section),
                    known.map(String::from).collect(),
                )
            }
        };
        let message = format!("no {what} is named `{}`", words[index]);
        self.unknown(index, message, known.iter().map(String::as_str).collect())
    }

    /// The message about a path that ends before a key.
    fn names_no_key(&self, used: usize, config: &View<'_>) -> Diagnostic {
        let names = config.property_names();
        let example = format!("{}.{}", self.words[used - 1], names.first().unwrap_or(&"key"));
        let message = format!("`{}` names no key", self.words.join("."));
        let error = self.sources.error(self.span, self.at, message);
        error.help(format!("write a key behind it: `{example}`"))
    }
}

/// The message about a path that begins with `prepare` and names nothing.
fn nothing_prepared(
    words: &[&str],
    span: Span,
    at: &str,
    written: &Written,
    sources: &Sources,
) -> Diagnostic {
    let name = words.get(1).copied().unwrap_or_default();
    let Some(entry) = written.prepared.iter().find(|entry| entry.name == name) else {
        let known = written.prepared.iter().map(|entry| entry.name.as_str());
        return sources
            .error(span, at, format!("no entry of `prepare` is named `{name}`"))
            .help(suggest(name, known));
    };
    let part = words.get(2).copied().unwrap_or_default();
    let message = format!("`{part}` is no part that is written in the entry `{name}` of `prepare`");
    let help = match (part, &entry.environment, &entry.agent) {
        ("environment", PreparedPart::OfStudy(own, _), _) | ("agent", _, PreparedPart::OfStudy(own, _)) => {
            format!("it takes the study's `{own}`, whose keys are set there: `{own}.KEY`")
        }
        ("protocol", ..) => "it takes the study's, whose keys are set there: `protocol.KEY`".into(),
        _ => suggest(part, PartKind::ALL.map(PartKind::name)),
    };
    sources.error(span, at, message).help(help)
}

/// The target of the first words, and the number of these words.
fn begin(words: &[&str], written: &Written) -> Option<(Target, usize)> {
    let environment = |name: &str| {
        written
            .environments
            .iter()
            .position(|it| it.name == name)
            .map(Target::Environment)
    };
    let agent = |name: &str| {
        written
            .agents
            .iter()
            .position(|it| it.name == name)
            .map(Target::Agent)
    };
    match words {
        ["protocol", ..] => Some((Target::Protocol, 1)),
        ["cross_play", name, ..] => {
            let index = written.plays.iter().position(|play| play.name == *name)?;
            Some((Target::Play(index), 2))
        }
        ["tune", name, ..] => {
            let index = written.searches.iter().position(|search| search.name == *name)?;
            Some((Target::Search(index), 2))
        }
        ["prepare", name, part, ..] => {
            let index = written.prepared.iter().position(|entry| entry.name == *name)?;
            let kind = PartKind::ALL.into_iter().find(|kind| kind.name() == *part)?;
            written.prepared[index]
                .own(kind)
                .map(|_| (Target::Prepared(index, kind), 3))
        }
        ["environments", name, ..] => environment(name).map(|target| (target, 2)),
        ["agents", name, ..] => agent(name).map(|target| (target, 2)),
        [name, ..] => environment(name)
            .or_else(|| agent(name))
            .map(|target| (target, 1)),
        [] => None,
    }
}

/// Schema of the config of a plugin, as part of the schema `study`.
pub fn config_schema<'a>(study: View<'a>, target: Target, plugin: &str) -> Option<View<'a>> {
    match target {
        Target::Environment(_) | Target::Prepared(_, PartKind::Environment) => {
            study.property("environments")?.property("any")?.property(plugin)
        }
        Target::Agent(_) | Target::Prepared(_, PartKind::Agent) => {
            study.property("agents")?.property("any")?.property(plugin)
        }
        Target::Protocol | Target::Prepared(_, PartKind::Protocol) => {
            study.property("protocol")?.property(plugin)
        }
        Target::Play(_) => study.property("cross_play")?.property("any"),
        Target::Search(_) => study.property("tune")?.property("any"),
        Target::Seeds => None,
    }
}

impl KeyPath<'_> {
    /// Checks a value for this key.
    #[must_use]
    pub fn check(&self, value: &Node, at: &str, sources: &Sources) -> Vec<Diagnostic> {
        let mut checker = Checker::new(sources);
        let name = self.keys.last().map_or("seeds", String::as_str).into();
        checker.check(
            value,
            &At {
                key: self.span,
                name,
                path: at.into(),
            },
            &self.schema,
        );
        checker.found
    }

    /// Writes a value at this key of a config.
    pub fn assign(&self, config: &mut Node, value: &Node) {
        assign(config, &self.config, &self.keys, self.span, value);
    }

    /// Replaces the value at this key of the study, as profiles and `--set` do.
    pub fn set(&self, written: &mut Written, value: &Node) {
        match self.target {
            Target::Environment(index) => self.assign(&mut written.environments[index].config, value),
            Target::Agent(index) => self.assign(&mut written.agents[index].config, value),
            Target::Protocol => self.assign(&mut written.protocol.config, value),
            Target::Play(index) => self.assign(&mut written.plays[index].config, value),
            Target::Search(index) => self.assign(&mut written.searches[index].config, value),
            Target::Prepared(index, kind) => {
                written.prepared[index]
                    .own_mut(kind)
                    .into_iter()
                    .for_each(|named| self.assign(&mut named.config, value));
            }
            Target::Seeds => {
                let seeds = written
                    .seeds
                    .get_or_insert_with(|| Node::empty_mapping(self.span));
                self.assign(seeds, value);
            }
        }
    }

    /// Whether the key is `preset`, which is no key of the config itself.
    #[must_use]
    pub fn is_preset(&self) -> bool {
        self.keys == ["preset"]
    }

    /// Whether both name the same key, or one names a key inside the other.
    #[must_use]
    pub fn overlaps(&self, other: &KeyPath<'_>) -> bool {
        self.target == other.target
            && self
                .keys
                .iter()
                .zip(&other.keys)
                .all(|(mine, theirs)| mine == theirs)
    }
}

/// Writes a value at `keys` below `node`. A mapping with fixed keys is written key by key, so that its other keys stay;
/// a variant of an enum replaces another variant.
pub fn assign(node: &mut Node, schema: &View<'_>, keys: &[String], span: Span, value: &Node) {
    let Some((first, rest)) = keys.split_first() else {
        match schema
            .as_struct()
            .filter(|_| matches!(value.kind, NodeKind::Mapping(_)))
        {
            Some(_) => value.entries().iter().for_each(|entry| {
                assign(
                    node,
                    schema,
                    std::slice::from_ref(&entry.key),
                    entry.key_span,
                    &entry.value,
                );
            }),
            None => *node = value.clone(),
        }
        return;
    };
    let places = schema.alternatives();
    if let NodeKind::Mapping(entries) = &mut node.kind
        && places.len() > 1
        && places.iter().any(|place| place.variant() == Some(first))
    {
        entries.retain(|entry| entry.key == *first);
    }
    let below = places.iter().find_map(|place| place.property(first));
    if let (Some(entry), Some(below)) = (node.entry_or_insert(first, span), below) {
        if rest.is_empty() {
            entry.key_span = span;
        }
        assign(&mut entry.value, &below, rest, span, value);
    }
}
