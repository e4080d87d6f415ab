//! Learners in Python are trained at the protocol's pace, and go on from what they saved to the same bits.

use super::*;
use contract::{End, NoKeeper, Phase, Recorder, Transition, cast::Actors, part::Part, trial::TrialKey};

fn learner(place: &Place) -> String {
    agent(place, "rules.py:Learner", LEARNS)
}

/// The record of a trial of the learner on the native pendulum, by protocol.
fn recorded(place: &Place, protocol: &str, given: &Value) -> Recorder {
    let registry = plugins::registry();
    let part = |about: &contract::plugin::About, name: &str, values: &Value| {
        let part = Part::new(name, about.version, (about.resolve)(values).unwrap());
        crate::datasets::with_sources(part)
    };
    let more = json!({ "learns": true, "metrics": ["mean_reward"] });
    let agent = config(place, "rules.py:Learner", &more);
    let key = TrialKey {
        environment: part(&registry.environments["pendulum"].about, "pendulum", &json!({})).into(),
        agent: Actors::Agent(part(&registry.agents["python"].about, "python", &agent)).into(),
        protocol: part(&registry.protocols[protocol].about, protocol, given).into(),
        seed: 3,
        numerics: registry.numerics_version,
    };
    crate::datasets::run(&registry, &key, None, &mut NoKeeper).unwrap()
}

fn values(record: &Recorder, phase: Phase, name: &str) -> Vec<f64> {
    let named = |row: &&contract::recorder::Row| {
        row.phase == phase && record.names()[usize::from(row.metric)] == name
    };
    record.rows().iter().filter(named).map(|row| row.value).collect()
}

#[test]
fn learn_is_called_with_every_step_and_its_numbers_are_recorded() {
    let Some(place) = Place::new() else { return };
    let given =
        json!({ "steps": 40, "environments": 4, "evaluate_every": 20, "episodes": 1, "final_episodes": 1 });
    let record = recorded(&place, "train_evaluate", &given);
    assert_eq!(values(&record, Phase::Final, "updates"), [20.0]);
    let means = values(&record, Phase::Train, "mean_reward");
    assert!(
        means.len() == 2 && means.iter().all(|mean| *mean < 0.0),
        "{means:?}"
    );
}

#[test]
fn a_learner_learns_from_what_others_gathered() {
    let Some(place) = Place::new() else { return };
    let given = json!({ "steps": 6, "batch": 4, "evaluate_every": 3, "episodes": 1, "final_episodes": 1,
        "datasets": [{ "from": "given" }] });
    let record = recorded(&place, "offline_fit", &given);
    assert_eq!(values(&record, Phase::Final, "updates"), [12.0]);
}

#[test]
fn a_batch_holds_the_numbers_of_the_environment() {
    let Some(place) = Place::new() else { return };
    let interface = place.built("own.py:Tank", json!({})).interface();
    place.bench.write(
        "shown.py",
        "class Shown:\n    def act(self, observation):\n        return 0.0\n\n    def learn(self, batch):\n        \
         raise \
         RuntimeError(f'{batch.observation.tolist()} {batch.action.tolist()} {batch.reward.tolist()} \
         {batch.next_observation.tolist()} {batch.terminated.tolist()} {batch.truncated.tolist()}')\n",
    );
    let mut agent = built(&place, "shown.py:Shown", &json!({ "learns": true }), &interface).unwrap();
    let seen = |level: f64| Observation {
        seats: vec![vec![level, level - 2.0]],
        state: Vec::new(),
    };
    let transition = |action: f64, end: Option<End>| Transition {
        observation: seen(1.0),
        action: vec![vec![action]],
        rewards: vec![action],
        next_observation: seen(2.0),
        end,
    };
    let transitions = [
        transition(-0.5, None),
        transition(1.0, Some(End::Terminated)),
        transition(-1.0, Some(End::Truncated)),
    ];
    let told = agent
        .learn(&transitions, &mut stream(&["learn"]), &mut Recorder::default())
        .unwrap_err()
        .to_string();
    let batch = "[[1.0, -1.0], [1.0, -1.0], [1.0, -1.0]] [[0.25], [1.0], [0.0]] [-0.5, 1.0, -1.0] \
                 [[2.0, 0.0], [2.0, 0.0], [2.0, 0.0]] [False, True, False] [False, False, True]";
    assert!(told.contains(batch), "{told}");
}

#[test]
fn a_learner_goes_on_from_what_it_saved() {
    let Some(place) = Place::new() else { return };
    let mut tank = place.built("own.py:Tank", json!({}));
    let more = json!({ "learns": true, "metrics": ["mean_reward"] });
    let made = || built(&place, "rules.py:Learner", &more, &tank.interface()).unwrap();
    let (mut agent, mut other) = (made(), made());
    let mut rng = stream(&["learn"]);
    let seats = tank.reset(&mut rng).unwrap();
    let seen = Observation {
        seats,
        state: Vec::new(),
    };
    let learn = |agent: &mut dyn Agent, reward: f64| {
        let transition = Transition {
            observation: seen.clone(),
            action: vec![vec![0.5]],
            rewards: vec![reward],
            next_observation: seen.clone(),
            end: None,
        };
        let mut rng = stream(&["learn"]);
        agent
            .learn(&[transition], &mut rng, &mut Recorder::default())
            .unwrap();
    };
    let acts = |agent: &mut dyn Agent| {
        agent
            .act(std::slice::from_ref(&seen), Mode::Train, &mut stream(&["act"]))
            .unwrap()
    };
    learn(&mut *agent, 4.0);
    learn(&mut *agent, 6.0);
    assert_ne!(acts(&mut *agent), acts(&mut *other));
    let folder = tempfile::tempdir().unwrap();
    agent.save(folder.path()).unwrap();
    other.load(folder.path()).unwrap();
    assert_eq!(agent.updates(), other.updates());
    assert_eq!(agent.updates().unwrap().made, 4);
    for reward in [3.0, -1.0] {
        assert_eq!(acts(&mut *agent), acts(&mut *other));
        learn(&mut *agent, reward);
        learn(&mut *other, reward);
    }
    // One that saves nothing begins anew.
    let mut unsaved = built(
        &place,
        "rules.py:Unsaved",
        &json!({ "learns": true }),
        &tank.interface(),
    )
    .unwrap();
    unsaved.save(folder.path()).unwrap();
    let refusal = unsaved.load(folder.path()).unwrap_err();
    assert!(matches!(refusal, Error::Checkpoint { .. }), "{refusal}");
    assert!(
        refusal.to_string().contains("has no `save` and `load`"),
        "{refusal}"
    );
}

#[test]
fn a_killed_trial_of_a_learner_goes_on_or_starts_over_to_the_same_bits() {
    let Some(place) = Place::new() else { return };
    place.bench.write("regimen.toml", "checkpoint_every_s = 0.2\n");
    let unsaved = agent(&place, "rules.py:Unsaved", "learns: true,");
    for learner in [learner(&place), unsaved] {
        let protocol = "{ steps: 600, environments: 2, evaluate_every: 200, episodes: 2, final_episodes: 3 }";
        study(
            &place,
            &environment(&place, "own.py:Slow"),
            &[("learner", &learner)],
            protocol,
        );
        place.goes_on_after_a_kill();
    }
}

#[test]
fn what_a_learner_left_is_shown_by_rollout_and_taken_by_others() {
    let Some(place) = Place::new() else { return };
    study(
        &place,
        &environment(&place, "own.py:Tank"),
        &[("learner", &learner(&place))],
        SHORT,
    );
    place.bench.ok(&["run", "study.yaml", "-j", "1"]);
    let id = place.bench.digests("store").remove(0).0;
    place.bench.ok(&["rollout", "--trial", &id, "--out", "rows.csv"]);
    let rows = fs::read_to_string(place.bench.path("rows.csv")).unwrap();
    assert!(rows.lines().count() > 10, "{rows}");
    let config = config(
        &place,
        "rules.py:Learner",
        &json!({ "learns": true, "metrics": ["mean_reward"] }),
    );
    place.bench.write("agent.yaml", &config.to_string());
    let untrained = [
        "rollout",
        "pendulum",
        "--agent",
        "python",
        "--agent-config",
        "agent.yaml",
        "--out",
        "untrained.csv",
    ];
    let answer = place.bench.run(&untrained);
    assert!(
        answer.code == 2 && answer.err.contains("--policy"),
        "{}",
        answer.err
    );
    // No other runtime acts by it.
    let answer = place.bench.run(&["export", "--onnx", &id, "--to", "policies"]);
    assert!(
        answer.code != 0 && answer.err.contains("in a form that is known here"),
        "{}",
        answer.err
    );
    let answer = place
        .bench
        .run(&["export", "study.yaml", "--to", "taken", "--as", "onnx"]);
    assert!(
        answer.err.contains("no trial of `own` left a policy"),
        "{}",
        answer.err
    );
}

/// A pause keeps what a learner saved; one that saves nothing starts over. Either ends with the bits of a trial that
/// was never paused.
#[test]
fn halving_pauses_learners_and_the_best_end_as_if_they_had_never_paused() {
    let Some(place) = Place::new() else { return };
    let search = |method: &str| {
        format!(
            "tune:\n  spreads:\n    over: {{ learner.arguments.spread: {{ choice: [1, 2, 3, 4] }} }}\n    metric: \
             return\n    settings: 4\n    method: {method}\nseeds: 1\n"
        )
    };
    for maker in ["rules.py:Spread", "rules.py:UnsavedSpread"] {
        let metrics = if maker.contains("Unsaved") {
            ""
        } else {
            "metrics: [mean_reward],"
        };
        let learner = agent(
            &place,
            maker,
            &format!("learns: true, {metrics} arguments: {{ spread: 1 }},"),
        );
        let ends = |method: &str, store: &str| {
            study(
                &place,
                &environment(&place, "own.py:Tank"),
                &[("learner", &learner)],
                SHORT,
            );
            let text = fs::read_to_string(place.bench.path("study.yaml")).unwrap();
            place.bench.write("study.yaml", &(text + &search(method)));
            let said = place
                .bench
                .run(&["run", "study.yaml", "-j", "1", "--store", store]);
            assert_eq!(said.code, 0, "{}", said.err);
            (said.err, place.bench.digests(store))
        };
        let store = |kind: &str| format!("{kind}-{}", maker.trim_start_matches("rules.py:"));
        let (said, ended) = ends("{ halving: { pauses: [80], keep: 0.5 } }", &store("paused"));
        assert_eq!(said.matches("] paused").count(), 4, "{said}");
        let (_, whole) = ends("{ random: {} }", &store("whole"));
        let whole: std::collections::BTreeMap<_, _> = whole.into_iter().collect();
        let of_search = ended.iter().filter(|(id, _)| whole.contains_key(id));
        assert!(of_search.clone().count() >= 2, "{ended:?} {whole:?}");
        assert!(
            of_search.clone().all(|(id, digest)| whole[id] == *digest),
            "{ended:?} {whole:?}"
        );
    }
}
