//! Rules act in environments of every kind, in the numbers of those who wrote them.

use super::*;
use contract::{NoKeeper, Space, cast::Actors, part::Part, trial::TrialKey};

/// The actions of a rule in an environment of this program.
fn in_ours(place: &Place, name: &str, make: &str, arguments: &Value) -> Vec<Vec<f64>> {
    let entry = &plugins::registry().environments[name];
    let mut environment = (entry.build)(&entry.about.defaults).unwrap();
    let more = json!({ "arguments": arguments });
    let mut agent = built(place, make, &more, &environment.interface())
        .unwrap_or_else(|error| panic!("{name} {make}: {error}"));
    first_actions(&mut *agent, &mut *environment)
}

#[test]
fn a_rule_acts_in_every_kind_of_space_of_built_in_environments() {
    let Some(place) = Place::new() else { return };
    let acts = |name: &str, make: &str, arguments: Value| in_ours(&place, name, make, &arguments);
    assert_eq!(
        acts("pendulum", "rules.py:Numbered", json!({ "number": 0.5 })),
        [[0.5]]
    );
    let shares = acts("allocation_bandit", "rules.py:Shares", json!({}));
    assert!(
        shares[0]
            .iter()
            .all(|share| *share == 1.0 / shares[0].len() as f64),
        "{shares:?}"
    );
    let treated = acts(
        "inspection_planning",
        "rules.py:ByName",
        json!({ "option": "repair" }),
    );
    let registry = plugins::registry();
    let entry = &registry.environments["inspection_planning"];
    let seats = (entry.build)(&entry.about.defaults).unwrap().seats().to_vec();
    let Space::Discrete(names) = &seats[0].action else {
        panic!("{:?}", seats[0])
    };
    let at = names.iter().position(|name| name == "repair").unwrap();
    assert_eq!(treated, vec![vec![at as f64]; seats.len()]);
}

#[test]
fn a_rule_acts_in_the_numbers_of_an_environment_in_python() {
    let Some(place) = Place::new() else { return };
    let acts = |environment: &str, arguments: Value, make: &str, of_rule: Value| {
        let mut environment = place.built(environment, arguments);
        let more = json!({ "arguments": of_rule });
        let mut agent = built(&place, make, &more, &environment.interface()).unwrap();
        first_actions(&mut *agent, &mut *environment)
    };
    // The tank is filled from 0 to 1, which stands for -1 to 1.
    assert_eq!(
        acts("own.py:Tank", json!({}), "rules.py:Quarter", json!({})),
        [[-0.5]]
    );
    // Three openings, counted from 1.
    assert_eq!(
        acts(
            "own.py:Valve",
            json!({}),
            "rules.py:Numbered",
            json!({ "number": 2 })
        ),
        [[-1.0, 1.0, -1.0]]
    );
    // The second of two, and the second of three that are counted from 5.
    assert_eq!(
        acts(
            "own.py:Chooser",
            json!({ "kind": "choices_by_name" }),
            "rules.py:Several",
            json!({ "entries": [1, 6] })
        ),
        [[-1.0, 1.0, -1.0, 1.0, -1.0]]
    );
    let pair = acts("own.py:Pair", json!({}), "rules.py:Pair", json!({}));
    assert!(pair[0][0].abs() == 0.5 && pair[1] == [0.25], "{pair:?}");
}

#[test]
fn an_agent_is_made_with_what_it_asks_for_by_name() {
    let Some(place) = Place::new() else { return };
    let told = |make: &str| {
        let interface = place.built(make, json!({})).interface();
        let refusal = built(&place, "rules.py:Told", &json!({}), &interface);
        refusal.err().unwrap().to_string()
    };
    let tank = told("own.py:Tank");
    assert!(
        tank.contains("[''] ['observation_0', 'observation_1'] ['action'] Box("),
        "{tank}"
    );
    assert!(tank.contains("Box(0.0, 1.0, (1,), float64)"), "{tank}");
    let valve = told("own.py:Valve");
    assert!(
        valve.contains("['1', '2', '3']") && valve.contains("Discrete(3, start=1)"),
        "{valve}"
    );
    let pair = told("own.py:Pair");
    assert!(
        pair.contains("['filler', 'drainer'] {'filler': ['observation']"),
        "{pair}"
    );
}

#[test]
fn a_rule_in_python_comes_to_the_bits_of_the_same_rule_here() {
    let Some(place) = Place::new() else { return };
    let registry = plugins::registry();
    let part = |about: &contract::plugin::About, name: &str, values: Value| {
        Part::new(name, about.version, (about.resolve)(&values).unwrap())
    };
    let returns = |agent: &str, values: Value| {
        let task = &registry.environments["inspection_planning"].about;
        let protocol = &registry.protocols["train_evaluate"];
        let given = json!({ "steps": 0, "final_episodes": 20 });
        let given = (protocol.about.resolve)(&given).unwrap();
        let given = (protocol.without_training)(&given).unwrap();
        let key = TrialKey {
            environment: part(task, "inspection_planning", json!({})).into(),
            agent: Actors::Agent(part(&registry.agents[agent].about, agent, values)).into(),
            protocol: Part::new("train_evaluate", protocol.about.version, given).into(),
            seed: 3,
            numerics: registry.numerics_version,
        };
        let record = key.run(&registry, None, &mut |_, _| {}, &mut NoKeeper).unwrap();
        let rows = record.rows().iter().map(|row| (row.metric, row.value.to_bits()));
        rows.collect::<Vec<_>>()
    };
    let here = returns("constant_choice", json!({ "choice": "inspect" }));
    let more = json!({ "arguments": { "option": "inspect" } });
    assert!(here.len() > 20);
    assert_eq!(here, returns("python", config(&place, "rules.py:ByName", &more)));
}

#[test]
fn rules_stand_beside_learners_and_are_measured_alone() {
    let Some(place) = Place::new() else { return };
    let agents = [
        ("rule", rule(&place, "rules.py:Rule", "threshold: 2.5")),
        ("drawn", rule(&place, "rules.py:Drawn", "")),
        ("holding", rule(&place, "rules.py:Holding", "")),
        (
            "sac",
            "soft_actor_critic: { width: 8, batch_size: 8, learning_starts: 16, updates_per_step: 0.25 }"
                .into(),
        ),
    ];
    let agents: Vec<(&str, &str)> = agents.iter().map(|(name, it)| (*name, it.as_str())).collect();
    study(&place, &environment(&place, "own.py:Tank"), &agents, SHORT);
    place.bench.ok(&["check", "study.yaml"]);
    place.bench.ok(&["run", "study.yaml", "-j", "2"]);
    place
        .bench
        .ok(&["run", "study.yaml", "-j", "1", "--store", "other"]);
    assert_eq!(place.bench.digests("store"), place.bench.digests("other"));
    // More training is none of theirs.
    let rules = &agents[..3];
    let longer = SHORT.replace("environments: 4", "environments: 8");
    study(&place, &environment(&place, "own.py:Tank"), rules, &longer);
    place.bench.ok(&["run", "study.yaml", "-j", "1"]);
    assert_eq!(place.bench.digests("store").len(), 4);
    until("Python is gone", || processes_of(&place).is_empty());
}

#[test]
fn a_rule_is_shown_by_rollout() {
    let Some(place) = Place::new() else { return };
    let config = |make: &str| config(&place, make, &json!({ "arguments": { "number": 0.5 } })).to_string();
    place.bench.write("agent.yaml", &config("rules.py:Numbered"));
    let common = [
        "rollout",
        "pendulum",
        "--agent",
        "python",
        "--agent-config",
        "agent.yaml",
    ];
    let options = ["--decisions", "3", "--out", "rows.csv"];
    place.bench.ok(&[&common[..], &options].concat());
    let rows = fs::read_to_string(place.bench.path("rows.csv")).unwrap();
    assert_eq!(
        rows.lines().filter(|line| line.contains(",1,0.5,")).count(),
        3,
        "{rows}"
    );
}
