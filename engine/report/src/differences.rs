//! Settings in a study: keys of configs that differ between its agents (environments, protocols), or from the
//! default.

use super::{
    StudyInfo,
    sheet::{NONE, Sheet, SheetEntry, Tone},
};
use analysis::results::Results;
use contract::{complete_config::CompleteConfig, part::Part, trial::Purpose, trial_result::TrialResult};
use serde_json::{Map, Value};
use std::{collections::BTreeSet, path::Path};

/// The most values of one key that are written out; of more, the first ones and their number.
const MOST_VALUES: usize = 6;
/// The most characters of one value that are written out.
const MOST_CHARACTERS: usize = 48;

/// Part of a trial.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TrialPart {
    Agent,
    Protocol,
    Environment,
}

/// A config that an agent or environment has somewhere in the study.
struct Variant<'a> {
    environment: &'a str,
    setting: &'a str,
    config: Value,
}

/// An agent or environment of the study with all its configs of one plugin.
struct PluginUser<'a> {
    name: &'a str,
    variants: Vec<Variant<'a>>,
}

/// A plugin with all its users, in the order of the plan.
struct Plugin<'a> {
    name: &'a str,
    users: Vec<PluginUser<'a>>,
}

/// A table for every plugin whose configs differ from each other or from its default: agents, protocols,
/// environments.
pub(super) fn sheets(study: &StudyInfo, results: &Results) -> Vec<Sheet> {
    let of_kind = |kind: TrialPart| {
        let plugins = plugins(kind, study, results);
        plugins
            .iter()
            .filter_map(|plugin| sheet(kind, plugin, study))
            .collect::<Vec<_>>()
    };
    [TrialPart::Agent, TrialPart::Protocol, TrialPart::Environment]
        .into_iter()
        .flat_map(of_kind)
        .collect()
}

impl TrialPart {
    fn name(self) -> &'static str {
        match self {
            TrialPart::Agent => "agent",
            TrialPart::Protocol => "protocol",
            TrialPart::Environment => "environment",
        }
    }

    /// The trial's part of this kind; `None` for the agent of a trial that measures policies of others.
    fn part(self, trial: &TrialResult) -> Option<&Part> {
        match self {
            TrialPart::Agent => trial.trial.key.agent.agent(),
            TrialPart::Protocol => Some(&trial.trial.key.protocol),
            TrialPart::Environment => Some(&trial.trial.key.environment),
        }
    }

    /// The user of a trial's part. The user of a protocol is the agent that it trains.
    fn user(self, trial: &TrialResult) -> &str {
        if self == TrialPart::Environment {
            &trial.trial.cell.environment
        } else {
            &trial.trial.cell.agent
        }
    }
}

/// Plugins of a kind with their users. A protocol is shown for agents that learn, since training budgets do not
/// affect the others.
fn plugins<'a>(kind: TrialPart, study: &StudyInfo, results: &'a Results) -> Vec<Plugin<'a>> {
    let learns = |trial: &TrialResult| study.learners.contains(&trial.trial.cell.agent);
    let all = kind != TrialPart::Protocol || !results.trials.iter().any(learns);
    let mut plugins: Vec<Plugin<'a>> = Vec::new();
    // Trials of a plan share their configs, and neighbours usually have the same one.
    let mut last: Option<(&str, &str, &str, &CompleteConfig)> = None;
    for trial in results
        .trials
        .iter()
        .filter(|trial| trial.trial.cell.purpose == Purpose::Cell && (all || learns(trial)))
    {
        let Some(part) = kind.part(trial) else { continue };
        let place = (
            kind.user(trial),
            trial.trial.cell.environment.as_str(),
            trial.trial.cell.point.words(),
            &part.config,
        );
        let same = |(user, environment, setting, config): (&str, &str, &str, &CompleteConfig)| {
            (user, environment, setting) == (place.0, place.1, place.2) && config.is_same(place.3)
        };
        if !last.is_some_and(same) {
            note(
                &mut plugins,
                &part.plugin,
                place.0,
                Variant {
                    environment: place.1,
                    setting: place.2,
                    config: shown(part),
                },
            );
        }
        last = Some(place);
    }
    plugins
}

fn note<'a>(plugins: &mut Vec<Plugin<'a>>, plugin: &'a str, user: &'a str, variant: Variant<'a>) {
    let at = plugins
        .iter()
        .position(|known| known.name == plugin)
        .unwrap_or_else(|| {
            plugins.push(Plugin {
                name: plugin,
                users: Vec::new(),
            });
            plugins.len() - 1
        });
    let users = &mut plugins[at].users;
    match users.iter_mut().find(|known| known.name == user) {
        Some(known) => known.variants.push(variant),
        None => users.push(PluginUser {
            name: user,
            variants: vec![variant],
        }),
    }
}

/// The config with data files named by the content that determines numbers, without their folders.
fn shown(part: &Part) -> Value {
    let mut config = part.config.whole().into_owned();
    for (pointer, content) in &part.files {
        if let Some(path) = config.pointer_mut(pointer) {
            let file = path
                .as_str()
                .and_then(|text| Path::new(text).file_name()?.to_str())
                .unwrap_or_default();
            *path = Value::String(format!(
                "{file} (content {})",
                content.get(..8).unwrap_or(content)
            ));
        }
    }
    config
}

fn sheet(kind: TrialPart, plugin: &Plugin<'_>, study: &StudyInfo) -> Option<Sheet> {
    let default = study.defaults.get(&format!("{} {}", kind.name(), plugin.name));
    let configs = plugin
        .users
        .iter()
        .flat_map(|user| user.variants.iter().map(|variant| &variant.config));
    let mut paths = Vec::new();
    differing(
        &mut Vec::new(),
        &configs.chain(default).map(Some).collect::<Vec<_>>(),
        &mut paths,
    );
    let normal: Vec<String> = paths
        .iter()
        .map(|path| word(default.and_then(|config| at(config, path))))
        .collect();
    let columns = columns(plugin, &paths);
    let mut head = vec!["key".to_owned()];
    head.extend(default.map(|_| "default".into()));
    head.extend(columns.iter().map(|(names, _)| names.join(", ")));
    let row = |(index, path): (usize, &Vec<&str>)| {
        let mut row = vec![SheetEntry::plain(path.join("."))];
        row.extend(default.map(|_| SheetEntry::of(Tone::Quiet, normal[index].clone())));
        row.extend(columns.iter().map(|(_, texts)| {
            let tone = if default.is_some() && texts[index] == normal[index] {
                Tone::Quiet
            } else {
                Tone::Plain
            };
            SheetEntry::of(tone, texts[index].clone())
        }));
        row
    };
    let rows: Vec<_> = paths.iter().enumerate().map(row).collect();
    let title = format!("{} `{}`", kind.name(), plugin.name);
    (!rows.is_empty()).then(|| Sheet {
        title,
        words: head.len(),
        head,
        rows,
        notes: Vec::new(),
    })
}

/// Users with the values of the keys; users with equal values share a column.
fn columns<'a>(plugin: &Plugin<'a>, paths: &[Vec<&str>]) -> Vec<(Vec<&'a str>, Vec<String>)> {
    let mut columns: Vec<(Vec<&str>, Vec<String>)> = Vec::new();
    for user in &plugin.users {
        let texts: Vec<String> = paths.iter().map(|path| user.text(path)).collect();
        match columns.iter_mut().find(|(_, known)| *known == texts) {
            Some((names, _)) => names.push(user.name),
            None => columns.push((vec![user.name], texts)),
        }
    }
    columns
}

/// Collects the paths at which some configs differ, in the order of keys. Mappings are compared key by key.
fn differing<'a>(path: &mut Vec<&'a str>, values: &[Option<&'a Value>], found: &mut Vec<Vec<&'a str>>) {
    if values.windows(2).all(|pair| pair[0] == pair[1]) {
        return;
    }
    let maps: Option<Vec<&'a Map<String, Value>>> = values
        .iter()
        .map(|value| value.and_then(Value::as_object))
        .collect();
    let Some(maps) = maps else {
        found.push(path.clone());
        return;
    };
    let keys: BTreeSet<&'a str> = maps
        .iter()
        .flat_map(|map| map.keys().map(String::as_str))
        .collect();
    for key in keys {
        path.push(key);
        differing(
            path,
            &maps.iter().map(|map| map.get(key)).collect::<Vec<_>>(),
            found,
        );
        path.pop();
    }
}

fn at<'a>(config: &'a Value, path: &[&str]) -> Option<&'a Value> {
    path.iter().try_fold(config, |value, key| value.get(key))
}

impl PluginUser<'_> {
    /// The value of a key. Several values are listed with their environments, or in the order of settings.
    fn text(&self, path: &[&str]) -> String {
        let mut places: Vec<(String, BTreeSet<&str>)> = Vec::new();
        for variant in &self.variants {
            let text = word(at(&variant.config, path));
            match places.iter_mut().find(|(known, _)| *known == text) {
                Some((_, environments)) => drop(environments.insert(variant.environment)),
                None => places.push((text, BTreeSet::from([variant.environment]))),
            }
        }
        let environments: BTreeSet<&str> = self.variants.iter().map(|variant| variant.environment).collect();
        let by_environment = places.iter().map(|(_, own)| own.len()).sum::<usize>() == environments.len();
        let settings = self
            .variants
            .iter()
            .any(|variant| variant.setting != self.variants[0].setting);
        match places.as_slice() {
            [(text, _)] => text.clone(),
            several if by_environment => {
                let word = |(text, own): &(String, BTreeSet<&str>)| {
                    format!("{text} ({})", own.iter().copied().collect::<Vec<_>>().join(", "))
                };
                several.iter().map(word).collect::<Vec<_>>().join("; ")
            }
            several => format!(
                "{}{}",
                some_of(several),
                if settings { ", by setting" } else { "" }
            ),
        }
    }
}

fn some_of(values: &[(String, BTreeSet<&str>)]) -> String {
    let words = |values: &[(String, BTreeSet<&str>)]| {
        values
            .iter()
            .map(|(text, _)| text.as_str())
            .collect::<Vec<_>>()
            .join(", ")
    };
    match values {
        [first @ .., last] if values.len() > MOST_VALUES => {
            format!(
                "{}, …, {} ({} values)",
                words(&first[..MOST_VALUES - 2]),
                last.0,
                values.len()
            )
        }
        _ => words(values),
    }
}

/// A value as in a study file, cut where it is long.
fn word(value: Option<&Value>) -> String {
    let text = match value {
        None => return NONE.into(),
        Some(Value::String(text)) => text.clone(),
        Some(value) => value.to_string(),
    };
    let short: String = text.chars().take(MOST_CHARACTERS).collect();
    if short.len() < text.len() {
        short + "…"
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::cast::Actors;
    use serde_json::json;
    use std::sync::Arc;
    use testing::synthetic::trial;

    fn made(environment: &str, agent: &str, setting: &str, config: Value, steps: u64) -> TrialResult {
        let mut result = trial(environment, agent, setting, 0, &Vec::new());
        result.trial_mut().key.agent = Actors::Agent(Part::new(
            if agent == "rule" { "split" } else { "sac" },
            1,
            config,
        ))
        .into();
        result.trial_mut().key.protocol =
            Part::new("train", 1, json!({"steps": steps, "episodes": 5})).into();
        result
    }

    fn study() -> StudyInfo {
        let defaults = [
            (
                "agent sac",
                json!({"rate": 0.1, "network": {"width": 8, "deep": false}, "start": "full"}),
            ),
            ("agent split", json!({})),
            ("protocol train", json!({"steps": 100, "episodes": 5})),
        ];
        StudyInfo {
            defaults: defaults.map(|(name, config)| (name.to_owned(), config)).into(),
            learners: ["one", "two"].map(String::from).into(),
            ..StudyInfo::default()
        }
    }

    fn config(rate: f64, width: u64, start: Value) -> Value {
        json!({"rate": rate, "network": {"width": width, "deep": false}, "start": start})
    }

    fn texts(sheet: &Sheet) -> Vec<Vec<&str>> {
        sheet
            .rows
            .iter()
            .map(|row| row.iter().map(|entry| entry.text.as_str()).collect())
            .collect()
    }

    #[test]
    fn only_keys_that_differ_are_shown_beside_their_default() {
        let range = json!({"range": [1, 2]});
        let trials = vec![
            made("tank", "one", "", config(0.1, 8, range), 100),
            made("tank", "two", "", config(0.5, 8, json!("full")), 100),
            made("tank", "rule", "", json!({}), 0),
        ];
        let sheets = sheets(&study(), &Results::of(trials));
        assert_eq!(
            sheets.len(),
            1,
            "the protocol of agents that learn has its defaults, and the rule has no key"
        );
        assert_eq!(
            (sheets[0].title.as_str(), sheets[0].head.join("/").as_str()),
            ("agent `sac`", "key/default/one/two")
        );
        let expected = [
            ["rate", "0.1", "0.1", "0.5"],
            ["start", "full", "{\"range\":[1,2]}", "full"],
        ];
        assert_eq!(texts(&sheets[0]), expected);
        assert_eq!(
            sheets[0].rows[0]
                .iter()
                .map(|entry| entry.tone)
                .collect::<Vec<_>>()[1..],
            [Tone::Quiet, Tone::Quiet, Tone::Plain]
        );
    }

    #[test]
    fn overrides_are_told_by_environment_and_sweeps_by_setting() {
        let mut trials = vec![
            made("pond", "one", "", config(0.1, 8, json!("full")), 100),
            made("tank", "one", "", config(0.1, 16, json!("full")), 200),
        ];
        let rates = (1..=8).map(|k| {
            made(
                "tank",
                "two",
                &format!("rate={k}"),
                config(f64::from(k), 8, json!("full")),
                100,
            )
        });
        trials.extend(rates);
        let sheets = sheets(&study(), &Results::of(trials));
        let expected = [
            ["network.width", "8", "8 (pond); 16 (tank)", "8"],
            [
                "rate",
                "0.1",
                "0.1",
                "1.0, 2.0, 3.0, 4.0, …, 8.0 (8 values), by setting",
            ],
        ];
        assert_eq!(texts(&sheets[0]), expected);
        assert_eq!(
            texts(&sheets[1]),
            [["steps", "100", "100 (pond); 200 (tank)", "100"]]
        );
    }

    #[test]
    fn alike_users_share_a_column_and_without_defaults_only_differences_count() {
        let trials = ["one", "two", "three"].map(|agent| {
            made(
                "tank",
                agent,
                "",
                config(0.7, 8, json!("full")),
                if agent == "two" { 300 } else { 50 },
            )
        });
        let study = StudyInfo {
            learners: ["one", "two", "three"].map(String::from).into(),
            ..StudyInfo::default()
        };
        let sheets = sheets(&study, &Results::of(trials.into()));
        assert_eq!(sheets.len(), 1);
        assert_eq!(
            (sheets[0].head.join("/").as_str(), texts(&sheets[0])),
            ("key/one, three/two", vec![vec!["steps", "50", "300"]])
        );
    }

    #[test]
    fn data_files_are_known_by_their_content() {
        let mut one = made(
            "tank",
            "one",
            "",
            json!({"load": {"file": "/far/away/load.csv"}}),
            100,
        );
        let Actors::Agent(agent) = Arc::make_mut(&mut one.trial_mut().key.agent) else {
            unreachable!("these trials have agents")
        };
        agent.files.insert("/load/file".into(), "0123456789abcdef".into());
        let two = made("tank", "two", "", json!({"load": {"file": "other.csv"}}), 100);
        let study = StudyInfo {
            defaults: std::collections::BTreeMap::new(),
            ..study()
        };
        let sheets = sheets(&study, &Results::of(vec![one, two]));
        assert_eq!(
            texts(&sheets[0]),
            [["load.file", "load.csv (content 01234567)", "other.csv"]]
        );
    }
}
