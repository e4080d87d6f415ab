//! Studies of toy plugins: the messages about wrong studies, and the form of right ones.

use super::{Options, Study, json_schema, load, load_text, resolved_yaml};
use contract::trial::Trial;
use document::diagnostic::Diagnostic;
use presentation::{figure::LearningCurve, request::Kinds};
use serde_json::json;
use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
    sync::Arc,
};
use testing::toys::toys;

const SPECS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/specs");

fn read(text: &str) -> Result<Study, Vec<Diagnostic>> {
    load_text(text, "study.yaml", Path::new(SPECS), &toys(), &Options::default())
}

fn ids(study: &Study) -> Vec<String> {
    study.plan().trials.iter().map(|trial| trial.id.clone()).collect()
}

/// Options in the first line of a file: `# regimen check --profile fast --set a.b=1`.
fn options(bytes: &[u8]) -> Options {
    let text = String::from_utf8_lossy(bytes);
    let words: Vec<&str> = text.lines().next().unwrap_or_default().split(' ').collect();
    let mut options = Options::default();
    for pair in words.windows(2).filter(|pair| pair[0].starts_with("--")) {
        match pair[0] {
            "--profile" => options.profile = Some(pair[1].into()),
            "--set" => options.sets.push(pair[1].into()),
            "--seeds" => options.seeds = Some(pair[1].parse().unwrap()),
            other => panic!("no option {other}"),
        }
    }
    options
}

fn files(folder: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(Path::new(SPECS).join(folder))
        .unwrap()
        .map(|entry| entry.unwrap().path());
    let mut files: Vec<PathBuf> = entries
        .filter(|path| path.extension().is_some_and(|end| end == "yaml"))
        .collect();
    files.sort();
    files
}

fn load_file(path: &Path) -> Result<Study, Vec<Diagnostic>> {
    let bytes = std::fs::read(path).unwrap();
    let name = path.file_name().unwrap().to_string_lossy().into_owned();
    let text = document::decode(&name, &bytes)?;
    load_text(&text, &name, Path::new(SPECS), &toys(), &options(&bytes))
}

fn snapshot(folder: &str, path: &Path, text: &str) {
    let mut settings = insta::Settings::clone_current();
    settings.set_snapshot_path(Path::new(SPECS).join(folder));
    settings.set_prepend_module_to_snapshot(false);
    settings.set_omit_expression(true);
    let name = path.file_stem().unwrap().to_string_lossy().into_owned();
    let text = without_kinds(&text.replace(SPECS, "tests/specs"));
    settings.bind(|| insta::assert_snapshot!(name, text));
}

/// The same text with one word for the names of kinds where all are listed, so that a new kind changes no message.
fn without_kinds(text: &str) -> String {
    let kinds = Kinds::default();
    let sections = [("tables", kinds.of_tables()), ("figures", kinds.of_figures())];
    let sections = sections.map(|(section, kinds)| {
        let names: Vec<String> = kinds.iter().map(|kind| format!("`{}`", kind.name)).collect();
        (format!("[kinds of {section}]"), names)
    });
    let line = |line: &str| {
        let listed = |names: &[String]| names.iter().all(|name| line.contains(name.as_str()));
        let Some((word, names)) = sections.iter().find(|(_, names)| listed(names)) else {
            return line.to_owned();
        };
        // The first name of the list may be a suggestion before it.
        let from = line.find("known: ").or_else(|| line.find("one of ")).unwrap_or(0);
        let (before, list) = line.split_at(from);
        let (head, list) = list.split_at(list.find('`').unwrap_or(0));
        let others = list.split(", ").filter(|name| !names.iter().any(|it| it == name));
        let words: Vec<&str> = others.chain([word.as_str()]).collect();
        format!("{before}{head}{}", words.join(", "))
    };
    text.lines().map(line).collect::<Vec<_>>().join("\n")
}

#[test]
fn every_mistake_has_its_message() {
    let files = files("invalid");
    assert!(files.len() >= 36, "{} mistakes", files.len());
    for path in files {
        let Err(found) = load_file(&path) else {
            panic!("{} passes the check", path.display())
        };
        snapshot(
            "invalid/messages",
            &path,
            &document::diagnostic::render(&found, false),
        );
        for diagnostic in found {
            assert!(
                !diagnostic.place.file.is_empty(),
                "{} has a message without a place",
                path.display()
            );
        }
    }
}

#[test]
fn what_is_probably_not_meant_has_its_warning_and_fails_nothing() {
    let warned = files("warned");
    assert!(warned.len() >= 2);
    for path in warned {
        let study = load_file(&path)
            .unwrap_or_else(|found| panic!("{}", document::diagnostic::render(&found, false)));
        assert!(!study.warnings.is_empty(), "{} warns of nothing", path.display());
        snapshot(
            "warned/messages",
            &path,
            &document::diagnostic::render(&study.warnings, false),
        );
    }
    for path in files("valid") {
        let study = load_file(&path)
            .unwrap_or_else(|found| panic!("{}", document::diagnostic::render(&found, false)));
        assert!(
            study.warnings.is_empty(),
            "{}: {}",
            path.display(),
            document::diagnostic::render(&study.warnings, false)
        );
    }
}

#[test]
fn right_studies_resolve_and_their_resolved_form_makes_the_same_trials() {
    let files = files("valid");
    assert!(files.len() >= 4);
    for path in files {
        let study = load_file(&path)
            .unwrap_or_else(|found| panic!("{}", document::diagnostic::render(&found, false)));
        let resolved = resolved_yaml(&study, Path::new(SPECS)).unwrap();
        let again =
            read(&resolved).unwrap_or_else(|found| panic!("{}", document::diagnostic::render(&found, false)));
        assert_eq!(ids(&study), ids(&again), "{}", path.display());
        assert_eq!(
            (&study.tables, &study.figures, &study.claims),
            (&again.tables, &again.figures, &again.claims)
        );
        // The draws of a search depend on the order of its keys.
        let searches = |study: &Study| format!("{:?}", study.searches);
        assert_eq!(searches(&study), searches(&again), "{}", path.display());
        assert_eq!(
            resolved,
            resolved_yaml(&again, Path::new(SPECS)).unwrap(),
            "resolving twice changes nothing"
        );
        let trials = study.plan().trials;
        let lines = trials.iter().map(|it| {
            format!(
                "# {} / {} / {} / seed {}\n",
                it.cell.environment, it.cell.agent, it.cell.point, it.key.seed
            )
        });
        snapshot("valid/resolved", &path, &(resolved + &lines.collect::<String>()));
    }
}

const HEAD: &str = "study: walk\nenvironments: { short: { corridor: { cells: 5 } }, long: { corridor: { \
                    cells: 20 } } }\n\
    agents: { right: { walker: { direction: right } }, learner: { q_learning: {} } }\nprotocol: { \
    train_evaluate: { steps: 1000 } }\n";

fn with(rest: &str) -> Study {
    read(&format!("{HEAD}{rest}"))
        .unwrap_or_else(|found| panic!("{}", document::diagnostic::render(&found, false)))
}

/// A sweep holds only the differences between its configs. Its configs equal those of a study that writes the values
/// out.
#[test]
fn configs_of_a_sweep_are_those_of_studies_without_one_and_trials_are_counted_without_being_made() {
    let (rates, slips) = ([0.1, 0.2, 0.3], [0.0, 0.1]);
    let swept = with(
        "seeds: 2\nsweep: { learner.learning_rate: { grid: [0.1, 0.2, 0.3] }, learner.network.width: { zip: [256, 8] }, \
         learner.discount: { zip: [0.99, 0.5] }, long.slip: { grid: [0.0, 0.1] } }",
    );
    let trials = swept.plan().trials;
    assert_eq!(swept.n_trials(), trials.len());
    for trial in &trials {
        assert_eq!(trial.id, trial.key.id(), "{}", trial.title());
    }
    let swept: BTreeSet<String> = ids(&swept).into_iter().collect();
    let mut single = BTreeSet::new();
    for (rate, slip, (width, discount)) in rates
        .iter()
        .flat_map(|rate| slips.iter().map(move |slip| (rate, slip)))
        .flat_map(|(rate, slip)| [(256, 0.99), (8, 0.5)].map(|last| (rate, slip, last)))
    {
        let text = HEAD
            .replace("cells: 20", &format!("cells: 20, slip: {slip}"))
            .replace(
                "q_learning: {}",
                &format!(
                    "q_learning: {{ learning_rate: {rate}, discount: {discount}, network: {{ width: {width} }} }}"
                ),
            );
        let study = read(&format!("{text}seeds: 2")).unwrap();
        assert_eq!(study.n_trials(), study.plan().trials.len());
        single.extend(ids(&study));
    }
    assert_eq!(swept, single);
}

#[test]
fn a_swept_key_is_that_of_its_agent_however_it_is_written() {
    let study = |rest: &str| {
        let text = "study: walk\nenvironments: { short: { corridor: { cells: 5 } } }\nagents:\n  one: { q_learning: {} }\n  \
                    two: { q_learning: {} }\n  walker: { walker: {} }\nprotocol: { train_evaluate: { steps: 1000 } }\n\
                    seeds: 2\nsweep:\n  agents.one.learning_rate: { grid: [0.1, 0.2] }\n  \
                    two.learning_rate: { grid: [0.3, 0.4] }\n";
        read(&format!("{text}{rest}"))
    };
    let own = "claims: [\"one[learning_rate=0.1].return > 0\", \"two[learning_rate=0.3].return > 0\"]\n";
    assert!(study(own).is_ok());
    let found = study("claims: [\"one[learning_rate=0.3].return > 0\"]\n").unwrap_err();
    assert_eq!(found[0].message, "the sweep gives `learning_rate` no value `0.3`");
    // No sweep varies the walker, beside one whose key is written in full.
    let labelled = "tables:\n  final: { comparison: { rows: setting, columns: agent, value: return, agents: [one, walker], \
                    labels: { as given: plain } } }\n";
    assert!(study(labelled).is_ok(), "{:?}", study(labelled).err());
}

#[test]
fn a_sweep_multiplies_only_the_trials_of_its_owner() {
    let study = with(
        "seeds: 3\nsweep: { learner.learning_rate: { grid: [0.1, 0.2] }, long.slip: { grid: [0.0, 0.1] } }",
    );
    let trials = study.plan().trials;
    let count = |environment: &str, agent: &str| {
        trials
            .iter()
            .filter(|trial| trial.cell.environment == environment && trial.cell.agent == agent)
            .count()
    };
    assert_eq!(count("short", "right"), 3);
    assert_eq!(count("short", "learner"), 6);
    assert_eq!(count("long", "right"), 6);
    assert_eq!(count("long", "learner"), 12);
    assert_eq!(
        trials.last().unwrap().cell.point.words(),
        "learning_rate=0.2 slip=0.1"
    );
}

#[test]
fn trial_ids_are_those_of_their_keys_and_forget_names() {
    let study = with("seeds: 2");
    for trial in study.plan().trials {
        assert_eq!(trial.id, trial.key.id());
    }
    let renamed = read(
        &HEAD
            .replace("learner:", "other:")
            .replace("study: walk", "study: stroll"),
    )
    .unwrap();
    assert_eq!(ids(&with("")), ids(&renamed));
}

#[test]
fn agents_that_do_not_learn_do_not_depend_on_the_training_budget() {
    let (short, long) = (
        with(""),
        read(&HEAD.replace("steps: 1000", "steps: 5000")).unwrap(),
    );
    let of = |study: &Study, agent: &str| {
        study
            .plan()
            .trials
            .iter()
            .filter(|trial| trial.cell.agent == agent)
            .map(|trial| trial.id.clone())
            .collect::<Vec<_>>()
    };
    assert_eq!(of(&short, "right"), of(&long, "right"));
    assert_ne!(of(&short, "learner"), of(&long, "learner"));
}

#[test]
fn presets_and_nested_defaults_are_laid_in_order() {
    let text = HEAD
        .replace("cells: 5", "preset: thesis, slip: 0.2")
        .replace("q_learning: {}", "q_learning: { network: { depth: 3 } }");
    let trials = read(&text).unwrap().plan().trials;
    let environment = &trials[0].key.environment.config;
    assert_eq!(
        (&environment["cells"], &environment["slip"]),
        (&json!(50), &json!(0.2))
    );
    assert!(environment.get("preset").is_none());
    let agent = &trials
        .iter()
        .find(|trial| trial.cell.agent == "learner")
        .unwrap()
        .key
        .agent
        .agent()
        .unwrap()
        .config;
    assert_eq!(
        agent["network"],
        json!({ "width": 256, "depth": 3 }),
        "the width is the agent's default, not the network's"
    );
}

#[test]
fn options_come_after_the_profile_and_take_keys_out_of_the_sweep() {
    let text = format!(
        "{HEAD}sweep: {{ learner.discount: {{ grid: [0.9, 0.99] }} }}\nprofiles: {{ smoke: {{ \
         protocol.steps: 100, seeds: 4 }} }}"
    );
    let options = Options {
        profile: Some("smoke".into()),
        sets: vec![
            "learner.discount=0.5".into(),
            "agents.learner.q_learning.network.width=8".into(),
        ],
        seeds: Some(2),
        ..Options::default()
    };
    let study = load_text(&text, "a.yaml", Path::new(""), &toys(), &options).unwrap();
    let trials = study.plan().trials;
    assert_eq!(study.seeds, [0, 1]);
    assert_eq!(trials.len(), 2 * 2 * 2);
    let learner = &trials
        .iter()
        .find(|trial| trial.cell.agent == "learner")
        .unwrap()
        .key;
    assert_eq!(
        (
            &learner.agent.agent().unwrap().config["discount"],
            &learner.protocol.config["steps"]
        ),
        (&json!(0.5), &json!(100))
    );
    assert_eq!(
        learner.agent.agent().unwrap().config["network"]["width"],
        json!(8)
    );
}

#[test]
fn seeds_may_begin_anywhere() {
    let seeds = |text: &str| {
        let text = format!("{HEAD}seeds: {text}");
        let study = load_text(&text, "a.yaml", Path::new(""), &toys(), &Options::default()).unwrap();
        let of_first = |plan: crate::plan::Plan| {
            let first = plan.trials[0].cell.clone();
            let own = plan.trials.iter().filter(|trial| trial.cell == first);
            own.map(|trial| trial.key.seed).collect::<Vec<_>>()
        };
        let resolved = resolved_yaml(&study, Path::new("")).unwrap();
        let written = resolved.lines().skip_while(|line| !line.starts_with("seeds:"));
        let more = |line: &&str| line.starts_with([' ', '-']);
        let written: Vec<&str> = written
            .clone()
            .take(1)
            .chain(written.skip(1).take_while(more))
            .collect();
        (
            of_first(study.plan()),
            written.join(" ").split_whitespace().collect::<Vec<_>>().join(" "),
        )
    };
    let design = seeds("{ first: 100, min: 3, max: 9, looks: 3 }");
    assert_eq!(design.0, [100, 101, 102], "those of the first look");
    assert_eq!(design.1, "seeds: first: 100 looks: [3, 6, 9] max: 9 min: 3");
    assert_eq!(seeds("7-9"), (vec![7, 8, 9], "seeds: 7-9".into()));
    assert_eq!(seeds("0-2").1, "seeds: 3");
    assert_eq!(seeds("4, 1-2"), (vec![4, 1, 2], "seeds: [4, 1, 2]".into()));
}

#[test]
fn a_profile_narrows_a_sweep_and_options_come_after_it() {
    let text = format!(
        "{HEAD}sweep: {{ learner.discount: {{ grid: [0.8, 0.9, 0.99] }} }}\nprofiles: {{ smoke: {{ \
         sweep.learner.discount: {{ grid: [0.5, 0.6] }}, seeds: 1 }} }}"
    );
    let discounts = |profile: Option<&str>, sets: &[&str]| {
        let options = Options {
            profile: profile.map(Into::into),
            sets: sets.iter().map(ToString::to_string).collect(),
            ..Options::default()
        };
        let study = load_text(&text, "a.yaml", Path::new(""), &toys(), &options).unwrap();
        let trials = study.plan().trials;
        let learners = trials.iter().filter(|trial| trial.cell.agent == "learner");
        let discounts = learners.map(|trial| trial.key.agent.agent().unwrap().config["discount"].to_string());
        discounts
            .collect::<std::collections::BTreeSet<_>>()
            .into_iter()
            .collect::<Vec<_>>()
    };
    assert_eq!(discounts(None, &[]), ["0.8", "0.9", "0.99"]);
    assert_eq!(discounts(Some("smoke"), &[]), ["0.5", "0.6"]);
    assert_eq!(
        discounts(Some("smoke"), &["sweep.learner.discount={ grid: [0.7] }"]),
        ["0.7"]
    );
    assert_eq!(discounts(Some("smoke"), &["learner.discount=0.4"]), ["0.4"]);
}

#[test]
fn no_option_and_no_profile_changes_a_confirmation() {
    let claims = "claims: [{ claim: learner.return > right.return, why: any }]\nconfirm: [{ claims: [1], seeds: 100-102, why: more }]";
    let load = |rest: &str, sets: &[&str]| {
        let options = Options {
            sets: sets.iter().map(ToString::to_string).collect(),
            ..Options::default()
        };
        let text = format!("{HEAD}{claims}\n{rest}");
        load_text(&text, "a.yaml", Path::new(""), &toys(), &options)
    };
    assert_eq!(load("", &[]).unwrap().confirm.len(), 1);
    for (rest, sets) in [
        ("", &["confirm.0.seeds=3-9"][..]),
        ("profiles: { smoke: { confirm.0.seeds: 200-201 } }", &[]),
    ] {
        let found = load(rest, sets).unwrap_err();
        assert!(found[0].message.contains("are fixed in the file"), "{found:?}");
        assert_eq!(found[0].path, "confirm.0.seeds");
    }
}

#[test]
fn overrides_hold_for_their_combinations_only() {
    let study =
        with("overrides: [{ environment: long, set: { protocol.steps: 2000, learner.discount: 0.5 } }]");
    for trial in study
        .plan()
        .trials
        .iter()
        .filter(|trial| trial.cell.agent == "learner")
    {
        let expected = if trial.cell.environment == "long" {
            (json!(2000), json!(0.5))
        } else {
            (json!(1000), json!(0.99))
        };
        assert_eq!(
            (
                &trial.key.protocol.config["steps"],
                &trial.key.agent.agent().unwrap().config["discount"]
            ),
            (&expected.0, &expected.1)
        );
    }
}

#[test]
fn zipped_keys_go_together_and_samplers_share_their_index() {
    let zip =
        with("sweep: { learner.discount: { zip: [0.9, 0.99] }, learner.learning_rate: { zip: [0.1, 0.2] } }");
    let settings: BTreeSet<String> = zip
        .plan()
        .trials
        .into_iter()
        .map(|trial| trial.cell.point.words().to_owned())
        .collect();
    assert_eq!(
        settings,
        [
            "",
            "discount=0.9 learning_rate=0.1",
            "discount=0.99 learning_rate=0.2"
        ]
        .map(String::from)
        .into()
    );
    let sampled = with(
        "sweep: { learner.discount: { random: { low: 0, high: 1, samples: 7 } }, \
         learner.network.width: { log_uniform: { low: 8, high: 512, samples: 7 } } }",
    );
    let trials = sampled.plan().trials;
    assert_eq!(
        trials
            .iter()
            .filter(|trial| trial.cell.agent == "learner")
            .count(),
        2 * 7
    );
    assert!(
        trials
            .iter()
            .filter(|it| it.cell.agent == "learner")
            .all(|it| it.key.agent.agent().unwrap().config["network"]["width"].is_u64())
    );
}

#[test]
fn what_a_data_file_holds_is_hashed_and_its_path_is_not() {
    let (one, two) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let text = HEAD.replace("cells: 5", "cells: 5, terrain: { file: heights.csv }");
    let plan = |dir: &Path, content: &str| {
        std::fs::write(dir.join("heights.csv"), content).unwrap();
        load_text(&text, "a.yaml", dir, &toys(), &Options::default())
            .unwrap()
            .plan()
            .trials[0]
            .clone()
    };
    let (first, elsewhere, changed) = (
        plan(one.path(), "1\n"),
        plan(two.path(), "1\n"),
        plan(two.path(), "2\n"),
    );
    assert_eq!(first.id, elsewhere.id);
    assert_ne!(first.id, changed.id);
    assert_eq!(
        first.key.environment.config["terrain"]["file"],
        json!(one.path().join("heights.csv").display().to_string())
    );
    assert_eq!(first.id, first.key.id());
}

#[test]
fn a_hundred_thousand_trials_are_planned() {
    let seeds = with("seeds: 25000");
    let trials = seeds.plan().trials;
    assert_eq!(trials.len(), 100_000);
    for of_cell in trials.chunk_by(|one, other| {
        one.cell.agent == other.cell.agent && one.cell.environment == other.cell.environment
    }) {
        let first = &of_cell[0];
        assert_eq!(of_cell.len(), 25_000);
        let shares =
            |trial: &Arc<Trial>| Arc::ptr_eq(&trial.cell, &first.cell) && trial.key.shares_parts(&first.key);
        assert!(
            of_cell.iter().all(shares),
            "what seeds have in common is there once"
        );
    }
    let grid: Vec<f64> = (1..=250).map(|index| f64::from(index) / 1000.0).collect();
    let settings = with(&format!(
        "exclude: [{{ agent: right }}, {{ environment: short }}]\nsweep: {{ learner.discount: {{ grid: \
         {grid:?} }}, learner.learning_rate: {{ grid: {:?} }} }}",
        &grid[..80]
    ));
    assert_eq!(settings.plan().trials.len(), 20_000);
}

/// Memory grows with the values of keys, not with their combinations.
#[test]
fn a_large_grid_keeps_what_single_values_change() {
    let only_one = "exclude: [{ agent: right }, { environment: short }]";
    let rates: Vec<f64> = (1..=250).map(|index| f64::from(index) / 1000.0).collect();
    let widths: Vec<u32> = (1..=80).collect();
    let large = with(&format!(
        "{only_one}\nsweep: {{ learner.discount: {{ grid: {rates:?} }}, learner.network.width: {{ grid: {widths:?} }} }}"
    ));
    assert_eq!(large.cells.len(), 20_000);
    assert!(large.cells.n_kept() <= 250 + 80, "{}", large.cells.n_kept());
    let trials = large.plan().trials;
    for index in [0, 1, 79, 80, 81, 12_345, 19_999] {
        let (rate, width) = (rates[index / 80], widths[index % 80]);
        let agent = format!("q_learning: {{ discount: {rate}, network: {{ width: {width} }} }}");
        let alone = read(&format!("{}{only_one}", HEAD.replace("q_learning: {}", &agent))).unwrap();
        assert_eq!(ids(&alone), [trials[index].id.as_str()]);
        assert_eq!(trials[index].id, trials[index].key.id());
    }
}

/// A point that names another file has another hash of its content, and is kept whole.
#[test]
fn a_large_grid_keeps_what_does_not_follow_from_single_values() {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in [("flat.csv", "1\n"), ("steep.csv", "2\n")] {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    let read = |keys: &str, rest: &str| {
        let text = HEAD.replace("cells: 5", keys);
        let text = format!("{text}exclude: [{{ agent: right }}, {{ environment: long }}]\n{rest}");
        load_text(&text, "study.yaml", folder.path(), &toys(), &Options::default()).unwrap()
    };
    let slips: Vec<f64> = (0..1100).map(|index| f64::from(index) / 10_000.0).collect();
    let large = read(
        "cells: 5",
        &format!(
            "sweep: {{ short.slip: {{ grid: {slips:?} }}, short.terrain.file: {{ grid: [flat.csv, steep.csv] }} }}"
        ),
    );
    assert!(large.cells.n_kept() >= 1100);
    let trials = large.plan().trials;
    for index in [0, 1, 2, 3, 2198, 2199] {
        let (slip, file) = (slips[index / 2], ["flat.csv", "steep.csv"][index % 2]);
        let keys = format!("cells: 5, slip: {slip}, terrain: {{ file: {file} }}");
        assert_eq!(ids(&read(&keys, "")), [trials[index].id.as_str()]);
        assert_eq!(trials[index].id, trials[index].key.id());
    }
}

#[test]
fn the_schema_names_all_plugins() {
    let registry = toys();
    let schema = json_schema(&registry);
    let learner = &schema["$defs"]["agent.q_learning"];
    assert_eq!(
        learner["properties"]["learning_rate"]["exclusiveMinimum"],
        json!(0.0)
    );
    assert_eq!(
        learner["properties"]["network"]["$ref"],
        json!("#/$defs/agent.q_learning.Network")
    );
    assert_eq!(
        schema["$defs"]["agent.q_learning.Network"]["properties"]["width"]["minimum"],
        json!(1)
    );
}

#[test]
fn mistakes_have_a_form_for_programs() {
    let found = read(&HEAD.replace("cells: 5", "cels: 5")).unwrap_err();
    let json = document::diagnostic::to_json(&found);
    assert_eq!(json[0]["path"], json!("environments.short.corridor.cels"));
    assert_eq!(
        (&json[0]["place"]["line"], &json[0]["place"]["length"]),
        (&json!(2), &json!(4))
    );
}

#[test]
fn an_override_of_a_mapping_keeps_its_other_keys() {
    let text = HEAD.replace("q_learning: {}", "q_learning: { network: { depth: 5 } }");
    let study = read(&format!(
        "{text}overrides: [{{ set: {{ learner.network: {{ width: 8 }} }} }}]"
    ))
    .unwrap();
    let trials = study.plan().trials;
    let learner = trials.iter().find(|trial| trial.cell.agent == "learner").unwrap();
    assert_eq!(
        learner.key.agent.agent().unwrap().config["network"],
        json!({ "width": 8, "depth": 5 })
    );
    assert_eq!(
        ids(&study),
        ids(&read(&resolved_yaml(&study, Path::new(SPECS)).unwrap()).unwrap())
    );
}

#[test]
fn a_swept_variant_takes_the_place_of_the_written_one() {
    let text = HEAD.replace("cells: 5", "cells: 5, start: random");
    let study = read(&format!(
        "{text}sweep: {{ short.start.fixed.cell: {{ grid: [1, 2] }} }}"
    ))
    .unwrap();
    let starts: BTreeSet<String> = study
        .plan()
        .trials
        .iter()
        .map(|trial| trial.key.environment.config["start"].to_string())
        .collect();
    assert_eq!(
        starts,
        [
            r#"{"fixed":{"cell":0}}"#,
            r#"{"fixed":{"cell":1}}"#,
            r#"{"fixed":{"cell":2}}"#
        ]
        .map(String::from)
        .into()
    );
    assert_eq!(
        ids(&study),
        ids(&read(&resolved_yaml(&study, Path::new(SPECS)).unwrap()).unwrap())
    );
}

#[test]
fn every_setting_is_built_and_refused_where_it_is_written() {
    let Err(found) = read(&format!(
        "{HEAD}sweep: {{ short.start.fixed.cell: {{ grid: [1, 5] }} }}"
    )) else {
        panic!("cell 5 of cells 0 to 4")
    };
    assert_eq!(found.len(), 1);
    assert_eq!(
        (
            found[0].place.line,
            found[0].place.text.chars().nth(found[0].place.column - 1)
        ),
        (5, Some('5'))
    );
}

#[test]
fn the_resolved_study_can_be_stored_in_another_folder() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("regimen.toml"), "").unwrap();
    let (study_dir, results) = (dir.path().join("experiments"), dir.path().join("results/walk"));
    std::fs::create_dir_all(&study_dir).unwrap();
    std::fs::create_dir_all(&results).unwrap();
    std::fs::write(study_dir.join("one.csv"), "1").unwrap();
    std::fs::write(study_dir.join("two.csv"), "2").unwrap();
    let text = HEAD.replace("cells: 5", "cells: 5, terrain: { file: one.csv }");
    let sweep = "sweep: { short.terrain.file: { grid: [one.csv, two.csv] } }";
    let study = load_text(
        &format!("{text}{sweep}"),
        "a.yaml",
        &study_dir,
        &toys(),
        &Options::default(),
    )
    .unwrap();
    let path = results.join("resolved.yaml");
    std::fs::write(&path, resolved_yaml(&study, &results).unwrap()).unwrap();
    let stored = std::fs::read_to_string(&path).unwrap();
    assert!(
        stored.contains("grid: [../../experiments/one.csv, ../../experiments/two.csv]"),
        "{stored}"
    );
    assert_eq!(
        ids(&study),
        ids(&load(&path, &toys(), &Options::default()).unwrap())
    );
    // If neither folder is a project, that message comes first.
    std::fs::remove_file(dir.path().join("regimen.toml")).unwrap();
    let found = load(&path, &toys(), &Options::default()).unwrap_err();
    let told = document::diagnostic::render(&found, false);
    assert!(
        told.contains("leads out") && told.contains("`regimen.toml`"),
        "{told}"
    );
}

#[test]
fn published_curves_are_found_from_the_study_and_from_its_results() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("regimen.toml"), "").unwrap();
    let (study_dir, results) = (dir.path().join("experiments"), dir.path().join("results/walk"));
    std::fs::create_dir_all(study_dir.join("curves")).unwrap();
    std::fs::create_dir_all(&results).unwrap();
    std::fs::write(study_dir.join("curves/one.csv"), "step,value\n10,1\n20,3\n").unwrap();
    let figure = "figures: { curve: { learning_curve: { environments: [short], published: \
                  [{ label: One, file: curves/one.csv, step: step, value: value }] } } }";
    let study = load_text(
        &format!("{HEAD}{figure}"),
        "a.yaml",
        &study_dir,
        &toys(),
        &Options::default(),
    )
    .unwrap();
    let path = results.join("resolved.yaml");
    let resolved = resolved_yaml(&study, &results).unwrap();
    assert!(
        resolved.contains("file: ../../experiments/curves/one.csv"),
        "{resolved}"
    );
    std::fs::write(&path, resolved).unwrap();
    for study in [study, load(&path, &toys(), &Options::default()).unwrap()] {
        let kind = study.figures[0].1.kind.downcast::<LearningCurve>().unwrap();
        let curve = &kind.published[0];
        assert_eq!(curve.runs().unwrap()[0].points, [(10, 1.0), (20, 3.0)]);
    }
}

#[test]
fn a_study_that_cannot_be_read_is_a_message() {
    let found = load(Path::new("no/such/study.yaml"), &toys(), &Options::default()).unwrap_err();
    assert!(document::diagnostic::render(&found, false).contains("--> no/such/study.yaml"));
}

/// A valid study with most kinds of sections, to be broken at random.
fn material() -> String {
    std::fs::read_to_string(Path::new(SPECS).join("valid/tables_and_figures.yaml")).unwrap()
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig { cases: 300, failure_persistence: None,
        ..Default::default() })]

    #[test]
    fn no_broken_study_makes_the_check_panic(at in 0usize..1600, length in 0usize..12,
        word in "[a-z0-9:{}\\[\\],. \n'\"-]{0,6}") {
        let text = material();
        let at = text.char_indices().map(|(index, _)| index).nth(at % text.chars().count()).unwrap();
        let end = (at + length..=text.len()).find(|end| text.is_char_boundary(*end)).unwrap_or(text.len());
        let broken = format!("{}{word}{}", &text[..at], &text[end..]);
        if let Err(found) = read(&broken) {
            proptest::prop_assert!(!found.is_empty(), "an error without a message:\n{broken}");
            proptest::prop_assert!(!document::diagnostic::render(&found, true).is_empty());
        }
    }
}
