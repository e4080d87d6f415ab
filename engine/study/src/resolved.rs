//! The sections of a study from which trials are made, with every default.

use super::{
    checked_sections::Sections,
    config,
    search::LocatedSearch,
    seeds::SeedPlan,
    written::{NamedPart, PartKind, PreparedPart, PreparedTrial, Target},
};
use document::{Entry, Node};
use presentation::vocabulary::Play;
use serde_json::{Map, Value, json};

/// A section of a study.
#[derive(Debug, Clone, PartialEq)]
pub enum Section {
    /// A value whose keys are sorted.
    Plain(Value),
    /// A mapping whose order is the study's.
    Named(Entries),
    /// Searches in the order of the study.
    Searches(Vec<(String, WrittenSearch)>),
}

/// A search as it is written. Its draws depend on the order of the keys under `over`.
#[derive(Debug, Clone, PartialEq)]
pub struct WrittenSearch {
    /// The section `over`.
    pub(super) over: Entries,
    /// Everything else.
    pub(super) rest: Value,
}

impl Section {
    pub(super) fn map(self, change: impl Fn(&str, Value) -> Value) -> Self {
        match self {
            Section::Plain(value) => Section::Plain(change("", value)),
            Section::Named(pairs) => Section::Named(
                pairs
                    .into_iter()
                    .map(|(name, value)| {
                        let value = change(&name, value);
                        (name, value)
                    })
                    .collect(),
            ),
            // A search names no files.
            searches @ Section::Searches(_) => searches,
        }
    }
}

/// The sections from which trials are made, in the order of a study, with all defaults.
pub fn sections(
    root: &Node,
    sections: &Sections<'_>,
    plan: &SeedPlan,
    plays: &[Play],
) -> Vec<(String, Section)> {
    let mut files = config::Files::new(sections.folder);
    let mut full = |target, named: &NamedPart| {
        let plugin = sections.plugin(target);
        let part = plugin
            .and_then(|plugin| config::resolve(&plugin, &named.config, &mut files, sections.sources).ok());
        // A config that is complete only with a sweep or an override stays as it is written.
        json!({ named.plugin.clone(): part.map_or_else(|| named.config.to_value(),
            |part| part.config.whole().into_owned()) })
    };
    let mut parts = |list: &[NamedPart], target: fn(usize) -> Target| {
        let pairs = list
            .iter()
            .enumerate()
            .map(|(index, named)| (named.name.clone(), full(target(index), named)));
        Section::Named(pairs.collect())
    };
    let environments = parts(&sections.written.environments, Target::Environment);
    let agents = parts(&sections.written.agents, Target::Agent);
    let protocol = full(Target::Protocol, &sections.written.protocol);
    let exclude = json!(sections.text.exclude.0.as_deref().unwrap_or_default());
    let written = vec![
        ("environments".into(), environments),
        ("agents".into(), agents),
        ("protocol".into(), Section::Plain(protocol)),
        ("seeds".into(), Section::Plain(seeds(plan))),
        ("sweep".into(), sweep(root, sections)),
        ("exclude".into(), Section::Plain(exclude)),
        ("overrides".into(), Section::Plain(overrides(sections))),
    ];
    let entries = sections.written.prepared.iter().enumerate();
    let prepared = entries.map(|(index, entry)| (entry.name.clone(), prepared(index, entry, &mut full)));
    let prepared = ("prepare", prepared.collect());
    let searches = sections.written.searches.iter().zip(sections.searches);
    let searches: Vec<_> = searches
        .map(|(named, it)| (named.name.clone(), search(named, it)))
        .collect();
    let searches = (!searches.is_empty()).then(|| ("tune".into(), Section::Searches(searches)));
    let plain = |name: &str| Some((name.into(), Section::Plain(root.get(name)?.to_value())));
    let judged_by = ["success", "paper_budget", "floors", "relevance"];
    let named = [prepared].into_iter().chain(named_sections(root, plays));
    let named = named.filter(|(_, entries)| !entries.is_empty());
    let named = named.map(|(name, entries)| (name.into(), Section::Named(entries)));
    written
        .into_iter()
        .chain(judged_by.into_iter().filter_map(plain))
        .chain(named)
        .chain(searches)
        .collect()
}

/// Entries with their names, in the order of the study.
pub(super) type Entries = Vec<(String, Value)>;

/// The sections of named entries besides environments and agents; empty if a study has none.
fn named_sections(root: &Node, plays: &[Play]) -> [(&'static str, Entries); 2] {
    let imported = root.get("imported").map_or(&[][..], Node::entries).iter();
    let imported = imported.map(|entry| (entry.key.clone(), entry.value.to_value()));
    let plays = plays.iter().map(|it| (it.name.clone(), play(it)));
    [("imported", imported.collect()), ("cross_play", plays.collect())]
}

fn seeds(plan: &SeedPlan) -> Value {
    let first = plan.seeds.first().copied().unwrap_or_default();
    let in_order = (first..).zip(&plan.seeds).all(|(next, seed)| next == *seed);
    match (&plan.design, plan.seeds.as_slice()) {
        (Some(design), _) => {
            let looks = design.looks();
            let mut written = json!({ "min": looks[0], "max": design.most(), "looks": looks });
            if first > 0 {
                written["first"] = json!(first);
            }
            written
        }
        (None, seeds) if in_order && first == 0 => json!(seeds.len()),
        (None, [first, _, .., last]) if in_order => json!(format!("{first}-{last}")),
        (None, seeds) => json!(seeds),
    }
}

/// An entry of `prepare`; parts that it takes from the study stay names.
fn prepared(
    index: usize,
    entry: &PreparedTrial,
    full: &mut impl FnMut(Target, &NamedPart) -> Value,
) -> Value {
    let mut value = Map::new();
    for kind in PartKind::ALL {
        let chosen = match (kind, &entry.environment, &entry.agent) {
            (PartKind::Environment, PreparedPart::OfStudy(name, _), _)
            | (PartKind::Agent, _, PreparedPart::OfStudy(name, _)) => json!(name),
            _ => match entry.own(kind) {
                Some(named) => full(Target::Prepared(index, kind), named),
                None => continue,
            },
        };
        value.insert(kind.name().into(), chosen);
    }
    Value::Object(value)
}

/// A search without keys that a profile or an option fixed.
fn search(named: &NamedPart, searched: &LocatedSearch<'_>) -> WrittenSearch {
    let over = named.config.get("over").map_or(&[][..], Node::entries).iter();
    let is_searched = |entry: &&Entry| searched.search.keys.iter().any(|(key, _)| *key == entry.key);
    let mut rest = named.config.to_value();
    rest.as_object_mut().and_then(|rest| rest.remove("over"));
    WrittenSearch {
        over: over
            .filter(is_searched)
            .map(|entry| (entry.key.clone(), entry.value.to_value()))
            .collect(),
        rest,
    }
}

fn play(play: &Play) -> Value {
    let roles: Map<String, Value> = play
        .roles
        .iter()
        .map(|(role, seats)| (role.clone(), json!(seats)))
        .collect();
    let agents: Vec<&str> = play.players.iter().map(|player| player.name.as_str()).collect();
    json!({
        "environment": play.environment, "roles": roles, "agents": agents, "episodes": play.episodes,
        "pairs": play.pairs,
        "environment_config": play.environment_config,
    })
}

/// The sweep without keys that a profile or an option fixed.
fn sweep(root: &Node, sections: &Sections<'_>) -> Section {
    let kept = |entry: &&Entry| {
        let mut keys = sections.swept();
        keys.any(|key| *key.swept.key == entry.key)
    };
    let entries = root
        .get("sweep")
        .map_or(&[][..], Node::entries)
        .iter()
        .filter(kept);
    Section::Named(
        entries
            .map(|entry| (entry.key.clone(), entry.value.to_value()))
            .collect(),
    )
}

/// The overrides without keys that a profile or an option fixed.
fn overrides(sections: &Sections<'_>) -> Value {
    let written = sections.text.overrides.0.iter().flatten().zip(sections.overrides);
    let kept = written.filter_map(|(text, kept)| Some(json!(text.0.as_ref()?.kept(kept))));
    kept.collect()
}
