//! Discrete actions are choices for every agent that chooses, of one seat and of several.

use super::*;

/// Agents that learn to choose; all take some steps.
const LEARNERS: [(&str, &str); 4] = [
    (
        "q",
        "value_decomposition: { mixing: none, width: 8, batch_size: 8, learning_starts: 16 }",
    ),
    (
        "sum",
        "value_decomposition: { mixing: sum, width: 8, batch_size: 8, learning_starts: 16 }",
    ),
    (
        "sac",
        "independent_sac: { width: 8, batch_size: 8, learning_starts: 16 }",
    ),
    (
        "maddpg",
        "maddpg: { width: 8, batch_size: 8, learning_starts: 16 }",
    ),
];

/// A study of one environment in which all of these learn.
fn learned_by(place: &Place, make: &str, arguments: &str, agents: &[(&str, &str)]) {
    let python = place.with(make, arguments);
    let agents: String = agents
        .iter()
        .map(|(name, agent)| format!("  {name}: {{ {agent} }}\n"))
        .collect();
    let text = format!(
        "study: choosing\nenvironments:\n  task: {{ python: {python} }}\nagents:\n{agents}protocol: {{ train_evaluate: {{ \
         steps: 60, environments: 2, evaluate_every: 30, episodes: 2, final_episodes: 2 }} }}\n"
    );
    place.bench.write("study.yaml", &text);
    let answer = place.bench.run(&["run", "study.yaml", "-j", "2"]);
    assert_eq!(answer.code, 0, "{make}: {}", answer.err);
}

#[test]
fn one_seat_with_discrete_actions_is_learned_by_every_agent_that_chooses() {
    let Some(place) = Place::new() else { return };
    let one_seat = [
        ("single", LEARNER),
        ("random", RULE),
        ("left", "constant_choice: { choice: \"0\" }"),
    ];
    let all = [&LEARNERS[..], &one_seat].concat();
    learned_by(&place, "gymnasium:CartPole-v1", "", &all);
}

#[test]
fn seats_with_discrete_actions_are_learned_with_the_full_state_where_there_is_one() {
    let Some(place) = Place::new() else { return };
    let mixed = (
        "mixed",
        "value_decomposition: { mixing: monotonic, width: 8, mixing_width: 4, batch_size: 8, learning_starts: 16 }",
    );
    let all = [&LEARNERS[..], &[mixed, ("random", RULE)]].concat();
    learned_by(&place, "own.py:Valves", "", &all);
    let mut valves = place.built("own.py:Valves", json!({}));
    let interface = valves.interface();
    let names: Vec<&str> = interface.state.iter().map(|it| it.name.as_str()).collect();
    assert_eq!(names, ["state_0", "state_1"]);
    let mut rng = stream(&["valves"]);
    let seen = valves.reset(&mut rng).unwrap();
    assert_eq!(valves.state(), [seen[0][0], 0.0]);
    // Each opens with its second option, counted from 1.
    let step = valves
        .step(&[vec![-1.0, 1.0], vec![1.0, -1.0]], &mut rng)
        .unwrap();
    assert_eq!((step.rewards[0], valves.state()[1]), (1.0, 1.0));
    let kept = valves.snapshot();
    let mut other = place.built("own.py:Valves", json!({}));
    other.restore(&kept).unwrap();
    assert_eq!(other.state(), valves.state());
}

#[test]
fn several_choices_are_several() {
    let Some(place) = Place::new() else { return };
    for (kind, expected) in [
        (
            "multi_discrete",
            [
                "action_0.0",
                "action_0.1",
                "action_1.0",
                "action_1.1",
                "action_1.2",
            ],
        ),
        (
            "choices_by_name",
            ["pump.0", "pump.1", "valve.5", "valve.6", "valve.7"],
        ),
    ] {
        let mut chooser = place.built("own.py:Chooser", json!({ "kind": kind }));
        assert_eq!(names(&chooser.seats()[0].action), expected, "{kind}");
        let mut rng = stream(&["choices"]);
        chooser.reset(&mut rng).unwrap();
        let step = chooser.step(&[vec![0.0, 0.5, -1.0, 0.0, 0.2]], &mut rng).unwrap();
        // The second of two and the third of three.
        assert_eq!(step.rewards, [12.0], "{kind}");
    }
    place.short("own.py:Chooser", "kind: multi_discrete", RULE);
    place.bench.ok(&["run", "study.yaml", "-j", "1"]);
}

#[test]
fn an_agent_that_does_not_fit_is_told_the_seat_and_those_that_do() {
    let Some(place) = Place::new() else { return };
    let refused = |make: &str, arguments: &str, agent: &str| {
        place.short(make, arguments, agent);
        let answer = place.bench.run(&["check", "study.yaml"]);
        assert_eq!(answer.code, 2, "{}", answer.err);
        answer.err.split_whitespace().collect::<Vec<_>>().join(" ")
    };
    let box_of_one = refused("own.py:Tank", "", "value_decomposition: { mixing: none }");
    assert!(
        box_of_one.contains("it takes one of several choices, the one seat takes a box"),
        "{box_of_one}"
    );
    assert!(
        box_of_one.contains("agents that fit and learn: ") && box_of_one.contains("`soft_actor_critic`"),
        "{box_of_one}"
    );
    let several = refused(
        "own.py:Chooser",
        "kind: multi_discrete",
        "value_decomposition: { mixing: none }",
    );
    assert!(
        several.contains("the one seat takes several choices at once"),
        "{several}"
    );
    let seats = refused("own.py:Pair", "", "value_decomposition: { mixing: none }");
    assert!(seats.contains("seat `filler` takes a box"), "{seats}");
    assert!(
        seats.contains("that fit and do not learn: ") && seats.contains("`random_action`"),
        "{seats}"
    );
}

#[test]
fn entries_of_info_are_metrics_of_tables_and_claims() {
    let Some(place) = Place::new() else { return };
    let study = |make: &str, metrics: &str, claim: &str| {
        let python = place
            .with(make, "")
            .replace("arguments: {  }", &format!("metrics: {{ {metrics} }}"));
        let text = format!(
            "study: own\nenvironments:\n  tank: {{ python: {python} }}\nagents:\n  some: {{ {RULE} }}\n  other: {{ \
             zero_action: {{}} }}\nprotocol: {{ train_evaluate: {{ steps: 40, environments: 2, evaluate_every: 20, \
             episodes: 2, final_episodes: 3 }} }}\ntables:\n  costs: {{ comparison: {{ rows: agent, value: {claim} }} \
             }}\nclaims:\n  - some.{claim} > other.{claim}\n"
        );
        place.bench.write("study.yaml", &text);
        place.bench.run(&["run", "study.yaml", "-j", "1"])
    };
    let metrics = "cost: sum, level: { take: mean, unit: m, lower_is_better: true }, peak: max, score: last";
    let answer = study("own.py:Priced", metrics, "cost");
    assert_eq!(answer.code, 0, "{}", answer.err);
    // 20 steps at a cost of 2.
    assert!(answer.out.contains("40"), "{}", answer.out);
    let refused = |make: &str, metrics: &str, said: &str| {
        let answer = study(make, metrics, "return");
        let words = answer.err.split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(answer.code, 2, "{words}");
        assert!(words.contains(said), "{words}");
    };
    refused(
        "own.py:Priced",
        "price: sum",
        "`metrics` takes `price`, and the info of step has cost, level, peak",
    );
    refused("own.py:Priced", "cost: biggest", "`sum`");
    refused(
        "own.py:Priced",
        "return: sum",
        "`return` is recorded of every environment",
    );
    refused("own.py:Priced", "note: last", "`metrics` takes `note`");
    refused(
        "own.py:Priced",
        "word: sum",
        "`word` of the info of step is 'high' (str) in place of a number",
    );
    let mut pair = {
        let mut config = place.config("own.py:Pair", json!({}));
        config["metrics"] = json!({ "level": "last" });
        (plugins::registry().environments["python"].build)(&config.into()).unwrap()
    };
    let found: Vec<&str> = pair.metrics().iter().map(|it| it.name.as_str()).collect();
    assert_eq!(found, ["filler_level", "drainer_level"]);
    let mut rng = stream(&["info"]);
    pair.reset(&mut rng).unwrap();
    let step = pair.step(&[vec![1.0], vec![0.5]], &mut rng).unwrap();
    assert_eq!(step.metric("filler_level"), Some(step.rewards[0]));
    assert_eq!(step.metric("drainer_level"), Some(-step.rewards[0]));
}
