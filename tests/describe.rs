//! `describe` tells everything that the registry and the schemas hold, and what it shows passes `check`.

use crate::{
    contracts::{acting, ready_made},
    program::Bench,
};
use cli::describe::{self, FitOptions, Group, Subject, text};
use contract::{Registry, plugin::About};
use document::diagnostic::render;
use plugins::registry;
use serde_json::Value;
use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};
use study::Options;

const NOTHING_BUILT: FitOptions = FitOptions {
    fits: false,
    why: false,
};

/// Every plugin with what the registry says of it.
fn plugins(registry: &Registry) -> Vec<(Group, &'static str, &About)> {
    let environments = registry.environments.iter();
    let environments = environments.map(|(name, entry)| (Group::Environments, *name, &entry.about));
    let agents = registry
        .agents
        .iter()
        .map(|(name, entry)| (Group::Agents, *name, &entry.about));
    let protocols = registry.protocols.iter();
    let protocols = protocols.map(|(name, entry)| (Group::Protocols, *name, &entry.about));
    environments.chain(agents).chain(protocols).collect()
}

/// Names of all properties anywhere in a schema that can be written.
fn properties(schema: &Value, found: &mut BTreeSet<String>) {
    match schema {
        Value::Object(map) => {
            for (keyword, value) in map {
                if let ("properties", Value::Object(named)) = (keyword.as_str(), value) {
                    found.extend(named.keys().cloned());
                }
                if keyword != "default" {
                    properties(value, found);
                }
            }
        }
        Value::Array(items) => items.iter().for_each(|item| properties(item, found)),
        _ => {}
    }
}

fn words(subject: &Subject) -> BTreeSet<String> {
    let paths = subject.paths();
    paths
        .iter()
        .flat_map(|path| path.split('.'))
        .map(String::from)
        .collect()
}

#[test]
fn every_key_of_every_plugin_is_described_to_the_last_one() {
    let registry = registry();
    for (group, name, about) in plugins(&registry) {
        let subject = describe::subject(&registry, group, name, NOTHING_BUILT).unwrap();
        let (mut expected, told) = (BTreeSet::new(), words(&subject));
        properties(about.schema.as_value(), &mut expected);
        let missing: Vec<&String> = expected.difference(&told).collect();
        assert!(missing.is_empty(), "{name}: {missing:?} of {told:?}");
        let written = text::write(std::slice::from_ref(&subject));
        for key in about.schema.as_value()["properties"]
            .as_object()
            .into_iter()
            .flatten()
        {
            assert!(
                written.contains(&format!("\n  {}: ", key.0)),
                "{name}.{} is not written:\n{written}",
                key.0
            );
            assert!(
                key.1["description"].is_string(),
                "{name}.{} has no description",
                key.0
            );
        }
        assert!(
            written.contains(about.about.split_whitespace().next().unwrap()),
            "{name}"
        );
    }
}

#[test]
fn every_name_that_is_listed_is_described_and_nothing_else_is() {
    let registry = registry();
    for group in Group::ALL {
        for name in describe::names(&registry, group) {
            let found = describe::find(&registry, &name, NOTHING_BUILT).unwrap();
            assert!(found.iter().any(|subject| subject.group == group), "{name}");
        }
    }
    let names: BTreeSet<&str> = plugins(&registry).into_iter().map(|(_, name, _)| name).collect();
    let listed =
        [Group::Environments, Group::Agents, Group::Protocols].map(|group| describe::names(&registry, group));
    let listed: BTreeSet<&str> = listed.iter().flatten().map(String::as_str).collect();
    let more: Vec<&&str> = listed.difference(&names).collect();
    assert_eq!((more, names.is_subset(&listed)), (vec![&"policy"], true));
}

/// A study of an environment and an agent under a protocol, of the examples that `describe` shows.
fn study(examples: &[&str], rule: &str, protocol: &str) -> String {
    let protocol = if protocol == "offline_fit" {
        format!(
            "prepare:\n  gathered: {{ environment: plant, agent: {{ {rule}: {{}} }}, protocol: {{ gather: {{ \
             episodes: 2 }} }} }}\nprotocol: {{ offline_fit: {{ datasets: [{{ from: gathered }}] }} }}"
        )
    } else {
        format!("protocol: {{ {protocol}: {{}} }}")
    };
    format!("study: example\n{}\n{protocol}\n", examples.join("\n"))
}

fn passes(registry: &Registry, text: &str) {
    let checked = study::load_text(text, "example.yaml", Path::new(""), registry, &Options::default());
    if let Err(found) = checked {
        panic!("{text}\n{}", render(&found, false));
    }
}

/// Each environment with one agent that fits it, and each agent in the first environment that it fits, under every
/// protocol that it learns from.
#[test]
fn examples_of_plugins_pass_check_together_as_they_are_described() {
    let registry = registry();
    let asked = FitOptions {
        fits: true,
        why: true,
    };
    let mut environments = BTreeMap::new();
    for name in ready_made(&registry) {
        let subject = describe::subject(&registry, Group::Environments, name, asked).unwrap();
        let facts = subject.environment.as_ref().unwrap();
        let n = facts.learners.len() + facts.rules.len() + facts.unfit.len();
        assert_eq!(
            n,
            registry.agents.len(),
            "{name}: every agent fits or is said why not"
        );
        assert!(facts.unfit.iter().all(|it| !it.reason.is_empty()), "{name}");
        assert!(
            !facts.rules.is_empty() || !facts.learners.is_empty(),
            "nobody fits {name}"
        );
        environments.insert(name, subject);
    }
    for (name, _) in acting(&registry) {
        let subject = describe::subject(&registry, Group::Agents, name, NOTHING_BUILT).unwrap();
        let fits = |environment: &&Subject| {
            let facts = environment.environment.as_ref().unwrap();
            facts.learners.iter().chain(&facts.rules).any(|it| it == name)
        };
        let Some(place) = environments.values().find(fits) else {
            panic!("{name} fits no environment with its defaults")
        };
        let rules = &place.environment.as_ref().unwrap().rules;
        let rule = rules.first().map_or(name, String::as_str);
        let facts = subject.agent.as_ref().unwrap();
        let protocols = if facts.learns {
            facts.protocols.clone()
        } else {
            vec!["train_evaluate".into()]
        };
        assert!(!protocols.is_empty(), "{name} learns from no protocol");
        let examples = [&place.examples[0].example, &subject.examples[0].example];
        for protocol in protocols.iter().filter(|protocol| is_open_to_all(protocol)) {
            passes(&registry, &study(&examples.map(String::as_str), rule, protocol));
        }
    }
}

/// Protocols that ask nothing special of the environment.
fn is_open_to_all(protocol: &str) -> bool {
    matches!(protocol, "train_evaluate" | "offline_fit")
}

#[test]
fn the_program_describes_lists_and_suggests() {
    let bench = Bench::new();
    let overview = bench.ok(&["describe"]);
    for group in Group::ALL {
        assert!(overview.contains(&group.word()), "{overview}");
    }
    let battery = bench.ok(&["describe", "battery"]);
    for part in [
        "In a study",
        "Keys",
        "Presets",
        "Records",
        "Seats",
        "Traces",
        "Agents that fit",
        "dirichlet_sac",
    ] {
        assert!(battery.contains(part), "{part}:\n{battery}");
    }
    assert!(!battery.contains("do not fit"), "{battery}");
    assert!(
        bench
            .ok(&["describe", "battery", "--why"])
            .contains("Agents that do not fit\n")
    );
    let curve = bench.ok(&["describe", "learning_curve"]);
    assert!(curve.contains("learning_curve: { metric: return"), "{curve}");
    let json: Value = serde_json::from_str(&bench.ok(&["describe", "battery", "--format", "json"])).unwrap();
    assert_eq!(
        (&json["format"], &json["found"][0]["group"]),
        (&1.into(), &"environments".into())
    );
    let json: Value = serde_json::from_str(&bench.ok(&["describe", "--format", "json"])).unwrap();
    assert!(
        json["groups"]["samplers"]
            .as_array()
            .unwrap()
            .contains(&"grid".into())
    );
    let wrong = bench.run(&["describe", "batery"]);
    assert_eq!(
        (wrong.code, wrong.err.trim()),
        (2, "error: nothing is named `batery`; did you mean `battery`?")
    );
}

#[test]
fn a_shell_completes_the_command_line_and_man_shows_it() {
    let bench = Bench::new();
    for (shell, word) in [
        ("bash", "complete -F"),
        ("zsh", "#compdef regimen"),
        ("fish", "complete -c regimen"),
    ] {
        let script = bench.ok(&["completions", shell]);
        assert!(
            script.contains(word) && script.contains("overview"),
            "{shell}: {script}"
        );
    }
    let page = bench.ok(&["man"]);
    assert!(
        page.contains(".TH regimen 1") && page.contains("regimen\\-overview"),
        "{page}"
    );
}

#[test]
fn a_plan_is_printed_with_its_cost_and_a_refusal_says_why_there_is_none() {
    let bench = Bench::new();
    let printed = bench.ok(&["describe", "td3_bc", "--plan", "battery"]);
    let costs: Vec<&str> = printed.lines().filter(|line| !line.starts_with(' ')).collect();
    assert!(
        costs
            .iter()
            .all(|line| line.contains(" operations, ") && line.contains(" bytes, kernels for a card: ")),
        "{costs:?}"
    );
    assert!(
        printed.contains("`policy.layers.0.weight` [9, 256] <- Adam"),
        "{printed}"
    );
    for (words, said) in [
        (
            ["equal_split", "battery"],
            "it does not learn by a plan of operations",
        ),
        (
            ["td3_bc", "batery"],
            "there is no `batery` among the environments",
        ),
        (["td3", "battery"], "there is no `td3` among the agents"),
        (["td3_bc", "image_samples"], "td3_bc"),
    ] {
        let answer = bench.run(&["describe", words[0], "--plan", words[1]]);
        assert!(
            answer.code == 2 && answer.err.contains(said),
            "{}: {}",
            answer.code,
            answer.err
        );
    }
}
