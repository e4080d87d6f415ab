//! Descriptions of toy plugins are complete, and every example of a section passes `check`.

use super::*;
use document::diagnostic::render;
use serde_json::json;
use study::Options;
use testing::toys::toys;

const SECTIONS: [(&str, &str); 7] = [
    ("study", "study: walk"),
    (
        "environments",
        "environments:
  short: { corridor: { cells: 5 } }
  long: { corridor: { cells: 20 } }
  pair: { corridor: { walkers: 2 } }",
    ),
    (
        "agents",
        "agents: { rule: { walker: {} }, other: { walker: { direction: right } }, learner: { q_learning: {} } }",
    ),
    ("exclude", "exclude: [{ environment: pair, agent: learner }]"),
    ("protocol", "protocol: { train_evaluate: { steps: 1000 } }"),
    ("seeds", "seeds: 3"),
    (
        "cross_play",
        "cross_play:
  tag: { environment: pair, roles: { chaser: [walker_0], runner: [walker_1] }, agents: [rule, other] }",
    ),
];

fn found(name: &str) -> Vec<Subject> {
    find(
        &toys(),
        name,
        FitOptions {
            fits: true,
            why: true,
        },
    )
    .unwrap()
}

/// A study in which an example replaces the sections that it has.
fn study_with(example: &str) -> String {
    let is_there = |section: &str| {
        example
            .lines()
            .any(|line| line.starts_with(&format!("{section}:")))
    };
    let rest = SECTIONS.iter().filter(|(section, _)| !is_there(section));
    let rest: Vec<&str> = rest.map(|(_, text)| *text).collect();
    format!("{}\n{example}\n", rest.join("\n"))
}

fn passes(example: &str) {
    let (text, folder) = (study_with(example), tempfile::tempdir().unwrap());
    // Names that the examples of imported runs use.
    std::fs::create_dir(folder.path().join("runs")).unwrap();
    let run = "global_step,env,charts/episodic_return\n0,1,0.5\n100,2,0.7\n";
    std::fs::write(folder.path().join("runs/a.csv"), run).unwrap();
    std::fs::write(folder.path().join("common.yaml"), "limits: { retries: 1 }").unwrap();
    let confirmed = study_with("seeds: 5\nclaims: [learner.return > rule.return]");
    std::fs::write(folder.path().join("first-look.yaml"), confirmed).unwrap();
    let study = study::load_text(&text, "study.yaml", folder.path(), &toys(), &Options::default());
    if let Err(found) = study {
        panic!("{text}\n{}", render(&found, false));
    }
}

#[test]
fn every_section_has_an_example_and_every_example_passes_check() {
    let of_plugins = ["environments", "agents"];
    for name in names(&toys(), Group::Sections) {
        let subject = &found(&name)[0];
        assert!(!subject.about.is_empty() && subject.value.is_some(), "{name}");
        assert!(
            !subject.examples.is_empty() || of_plugins.contains(&name.as_str()),
            "{name} has no example"
        );
        for example in &subject.examples {
            assert!(
                example.example.contains(&format!("{name}:")),
                "{name}: {}",
                example.example
            );
            passes(&example.example);
        }
    }
}

#[test]
fn a_registry_with_a_first_study_shows_its_plugins() {
    let registry = Registry {
        first_study: Some(("corridor", "q_learning")),
        ..toys()
    };
    let text = text::write(&find(&registry, "agents", FitOptions::default()).unwrap());
    assert!(text.contains("learner: { q_learning: {} }"), "{text}");
}

#[test]
fn every_sampler_relation_and_aggregate_has_an_example_that_passes_check() {
    for group in [Group::Samplers, Group::Relations, Group::Aggregates] {
        for name in names(&toys(), group) {
            let subject = subject(&toys(), group, &name, FitOptions::default()).unwrap();
            let [example] = subject.examples.as_slice() else {
                panic!("{name}: {:?}", subject.examples)
            };
            // Successes are known only if the study defines them.
            let success = if name == "given_success" {
                "\nsuccess: { metric: return, above: 0 }"
            } else {
                ""
            };
            passes(&format!("{}{success}", example.example));
        }
    }
    let samplers = names(&toys(), Group::Samplers);
    assert_eq!(
        samplers,
        ["grid", "zip", "random", "log_uniform", "latin_hypercube"]
    );
}

#[test]
fn forms_of_seeds_are_told_with_their_keys() {
    let seeds = &found("seeds")[0];
    let paths = seeds.paths();
    for path in ["seeds.first", "seeds.min", "seeds.max", "seeds.looks"] {
        assert!(paths.iter().any(|it| it == path), "{path}: {paths:?}");
    }
    let value = seeds.value.as_ref().unwrap();
    assert_eq!(value.forms.len(), 4);
    assert_eq!(value.forms[0].written, "an integer from 1 to 1000000");
}

#[test]
fn what_plugins_have_is_described() {
    insta::assert_snapshot!(
        "describe",
        [
            "corridor",
            "q_learning",
            "train_evaluate",
            "comparison",
            "claims",
            "sweep"
        ]
        .map(|name| text::write(&found(name)))
        .join("\n=====\n")
    );
}

#[test]
fn all_of_a_name_are_found_and_a_wrong_name_gets_the_nearest() {
    let groups: Vec<Group> = found("policy").into_iter().map(|subject| subject.group).collect();
    assert_eq!(groups, [Group::Agents, Group::Artifacts]);
    let error = find(&toys(), "coridor", FitOptions::default()).unwrap_err();
    assert_eq!(error.nearest.as_deref(), Some("corridor"));
    assert_eq!(
        error.to_string(),
        "nothing is named `coridor`; did you mean `corridor`?"
    );
    let error = find(&toys(), "xyzzy", FitOptions::default()).unwrap_err();
    assert!(error.to_string().contains("`regimen describe` says"), "{error}");
}

#[test]
fn every_name_of_every_group_is_described_in_all_forms() {
    let registry = toys();
    let overview = text::overview(&registry);
    let pages = markdown::pages(&registry);
    assert_eq!(pages.len(), Group::ALL.len());
    for (group, page) in Group::ALL.into_iter().zip(pages) {
        for (name, about) in group.entries(&registry) {
            let subject = subject(&registry, group, &name, FitOptions::default()).unwrap();
            assert!(!about.is_empty() && !subject.about.is_empty(), "{name}");
            assert_eq!(json!(subject)["group"], json!(group.word()), "{name}");
            assert!(overview.contains(&name), "{name} is not listed");
            let heading = format!("## {}\n", name.replace('>', "&gt;").replace('<', "&lt;"));
            assert!(page.text.contains(&heading), "{heading}");
        }
    }
}

/// Fields of the JSON form that programs may rely on.
#[test]
fn the_form_for_programs_has_its_keys() {
    let corridor = json!(found("corridor"));
    let key = |name: &str| {
        let keys = corridor[0]["keys"].as_array().unwrap();
        keys.iter().find(|key| key["name"] == name).unwrap().clone()
    };
    let step = key("step_s");
    assert_eq!(
        [
            &step["type"],
            &step["range"],
            &step["unit"],
            &step["source"],
            &step["required"],
            &step["default"]
        ],
        [
            &json!("a number"),
            &json!("from 0.01 to 60"),
            &json!("s"),
            &json!("table 1"),
            &json!(false),
            &json!(1.0)
        ]
    );
    let forms = key("start")["forms"].clone();
    assert_eq!(forms[0]["written"], "`random`");
    assert_eq!(forms[1]["keys"][0]["keys"][0]["name"], "cell");
    assert!(corridor[0]["metrics"][0]["per_episode"].is_string());
    assert!(corridor[0]["environment"]["seats"][0]["does"]["kind"].is_string());
    assert_eq!(corridor[0]["environment"]["learners"], json!(["q_learning"]));
}
