//! Measurements of trials, on dice: an episode shows the number that it began with, independent of the agent.

use contract::{
    Action, Agent, AgentTraits, Channel, Config, DataFile, End, Environment, Error, Feed, Interface, Metric,
    Mode, NoKeeper, Observation, PerEpisode, Phase, Recorder, Registry, Rng, Seat, Space, Step, Transition,
    Updates, cast::Actors, data_file::hash_of, part::Part, standard_metrics::UPDATES, trial::TrialKey,
};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::{collections::BTreeSet, path::Path};

/// Dice with a file whose number is added to each throw.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct DiceConfig {
    /// A file with one number.
    file: DataFile,
    /// Whether the observed number is NaN.
    broken: bool,
}

impl Config for DiceConfig {}

struct Dice {
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    added: f64,
    start: f64,
}

impl Environment for Dice {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }
    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }
    fn reset(&mut self, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        self.start = rng.random::<f64>() + self.added;
        Ok(vec![vec![self.start]])
    }
    fn step(&mut self, actions: &[Vec<f64>], _: &mut Rng) -> Result<Step, Error> {
        let end = Some(End::Terminated);
        Ok(Step::new(vec![vec![self.start]], vec![actions[0][0]], end).record("start", self.start))
    }
    fn trace_channels(&self) -> Vec<Channel> {
        vec![Channel::new("nothing_yet", "")]
    }
    fn trace(&self) -> Vec<f64> {
        vec![f64::NAN]
    }
    fn snapshot(&self) -> Value {
        json!(self.start)
    }
    fn restore(&mut self, snapshot: &Value) -> Result<(), Error> {
        self.start = snapshot.as_f64().unwrap();
        Ok(())
    }
}

fn dice(config: DiceConfig) -> Result<Box<dyn Environment>, Error> {
    let named = !config.file.path().as_os_str().is_empty();
    let added = if named {
        config.file.text()?.trim().parse().unwrap()
    } else {
        0.0
    };
    let channel = || Space::Box(vec![Channel::new("number", "")]);
    let seat = Seat {
        name: String::new(),
        observation: channel(),
        action: channel(),
    };
    let metrics = vec![Metric::new("start", "", "the number").per_episode(PerEpisode::Last)];
    let added = if config.broken { f64::NAN } else { added };
    Ok(Box::new(Dice {
        seats: vec![seat],
        metrics,
        added,
        start: 0.0,
    }))
}

/// Guesses a number; in training, counts the calls of `learn`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct GuessConfig {
    /// Whether its loss is NaN.
    diverges: bool,
}

impl Config for GuessConfig {}

struct GuessingAgent {
    learns: bool,
    n_updates: u64,
    loss: f64,
}

impl Agent for GuessingAgent {
    fn act(&mut self, observations: &[Observation], _: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        Ok(observations.iter().map(|_| vec![vec![rng.random()]]).collect())
    }
    fn learn(&mut self, _: &[Transition], _: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        assert!(self.learns, "an agent that does not learn is not asked to");
        self.n_updates += 1;
        record.mean("loss", self.loss);
        record.latest("estimate", self.loss);
        Ok(())
    }
    fn updates(&self) -> Option<Updates> {
        self.learns.then_some(Updates {
            made: self.n_updates,
            first_after: 1,
        })
    }
}

fn registry() -> Registry {
    let mut registry = Registry::default();
    super::register(&mut registry);
    registry.environment("dice", 1, "One throw.", dice);
    let traits = |learns| AgentTraits {
        learns_from: if learns {
            vec![Feed::Decisions, Feed::Examples]
        } else {
            Vec::new()
        },
        ..AgentTraits::default()
    };
    registry.agent(
        "rule",
        1,
        "Guesses.",
        traits(false),
        |_: GuessConfig, _: &Interface, _| {
            Ok(Box::new(GuessingAgent {
                learns: false,
                n_updates: 0,
                loss: 0.0,
            }))
        },
    );
    registry.agent(
        "learner",
        1,
        "Guesses as well.",
        traits(true),
        |config: GuessConfig, _, _| {
            Ok(Box::new(GuessingAgent {
                learns: true,
                n_updates: 0,
                loss: if config.diverges { f64::NAN } else { 1.0 },
            }))
        },
    );
    registry
}

/// The key of a trial as a study would plan it.
fn key(agent: (&str, Value), protocol: (&str, Value)) -> TrialKey {
    let registry = registry();
    let entry = &registry.protocols[protocol.0];
    let mut protocol_config = (entry.about.resolve)(&protocol.1).unwrap();
    if !registry.agents[agent.0].traits.learns() {
        protocol_config = (entry.without_training)(&protocol_config).unwrap();
    }
    TrialKey {
        environment: Part::new("dice", 1, json!({})).into(),
        agent: Actors::Agent(Part::new(agent.0, 1, agent.1)).into(),
        protocol: Part::new(protocol.0, 1, protocol_config).into(),
        seed: 3,
        numerics: 1,
    }
}

fn run(key: &TrialKey) -> Result<Recorder, Error> {
    key.run(&registry(), None, &mut |_, _| {}, &mut NoKeeper)
}

/// Step, episode and value of the rows of a metric in a phase.
fn rows(record: &Recorder, phase: Phase, metric: &str) -> Vec<(u64, u64, f64)> {
    let named = |row: &&contract::recorder::Row| {
        row.phase == phase && record.names()[usize::from(row.metric)] == metric
    };
    record
        .rows()
        .iter()
        .filter(named)
        .map(|row| (row.step, row.episode, row.value))
        .collect()
}

fn budgets() -> Vec<(&'static str, Value)> {
    let train = |steps: u64, environments: u64, every: u64| {
        let config = json!({ "steps": steps, "environments": environments, "evaluate_every": every,
            "episodes": 3, "final_episodes": 5 });
        ("train_evaluate", config)
    };
    let fit = |steps: u64, every: u64| {
        (
            "supervised_fit",
            json!({ "steps": steps, "batch": 2, "evaluate_every": every, "examples": 3,
                "final_examples": 5 }),
        )
    };
    vec![
        train(100, 10, 20),
        train(100, 1, 30),
        train(100, 64, 32),
        train(100, 64, 128),
        train(100, 64, 10),
        train(100, 7, 7),
        train(0, 7, 7),
        train(100, 7, 0),
        train(10, 1, 100),
        fit(12, 4),
        fit(13, 5),
        fit(0, 5),
        fit(12, 0),
    ]
}

#[test]
fn agents_that_do_not_learn_are_measured_when_learners_are_and_on_the_same_episodes() {
    for budget in budgets() {
        let [rule, learner] =
            ["rule", "learner"].map(|agent| run(&key((agent, json!({})), budget.clone())).unwrap());
        let starts = |record: &Recorder| rows(record, Phase::Evaluate, "start");
        assert_eq!(starts(&rule), starts(&learner), "{budget:?}");
        let [of_rule, of_learner] = [&rule, &learner].map(|record| rows(record, Phase::Final, "start"));
        let values = |rows: &[(u64, u64, f64)]| rows.iter().map(|row| row.2).collect::<Vec<_>>();
        assert_eq!(values(&of_rule), values(&of_learner), "{budget:?}");
        assert!(
            starts(&rule).is_empty() || of_rule == of_learner,
            "the last step is that of the learners: {budget:?}"
        );
        // The agent's own random numbers differ.
        assert!(
            starts(&rule).is_empty()
                || rows(&rule, Phase::Evaluate, "return") != rows(&learner, Phase::Evaluate, "return")
        );
    }
}

#[test]
fn keys_of_learning_are_not_part_of_a_trial_whose_agent_does_not_learn() {
    let id = |steps: u64, environments: u64, every: u64| {
        let config = json!({ "steps": steps, "environments": environments, "evaluate_every": every });
        key(("rule", json!({})), ("train_evaluate", config)).id()
    };
    assert_eq!(id(100, 10, 20), id(100, 1, 20));
    assert_eq!(id(100, 10, 0), id(5_000, 1, 0));
    assert_ne!(id(100, 10, 20), id(200, 10, 20));
    assert_ne!(
        id(100, 64, 128),
        id(100, 1, 128),
        "64 environments take 128 steps, which is a measurement more"
    );
    let cost = |agent: &str, protocol: (&str, Value)| {
        let part = key((agent, json!({})), protocol).protocol;
        (registry().protocols[part.plugin.as_str()].build)(&part.config)
            .unwrap()
            .total_steps()
    };
    assert_eq!(
        budgets()[..1]
            .iter()
            .map(|budget| cost("rule", budget.clone()))
            .collect::<Vec<_>>(),
        [6 * 3 + 5]
    );
    assert_eq!(cost("learner", budgets()[0].clone()), 100);
}

#[test]
fn studies_do_not_say_whether_an_agent_learns() {
    for name in ["train_evaluate", "supervised_fit"] {
        let schema = json!(registry().protocols[name].about.schema);
        let keys = schema["properties"].as_object().unwrap();
        assert!(!keys.is_empty() && !keys.contains_key("train"), "{name}");
    }
}

#[test]
fn every_measurement_has_episodes_of_its_own() {
    let budget =
        json!({ "steps": 70, "environments": 1, "evaluate_every": 10, "episodes": 10, "final_episodes": 10 });
    let record = run(&key(("learner", json!({})), ("train_evaluate", budget))).unwrap();
    let measured = rows(&record, Phase::Evaluate, "start");
    let distinct = |rows: &[(u64, u64, f64)]| {
        rows.iter()
            .map(|row| row.2.to_bits())
            .collect::<BTreeSet<_>>()
            .len()
    };
    assert_eq!((measured.len(), distinct(&measured)), (80, 80));
    let all = [measured, rows(&record, Phase::Final, "start")].concat();
    assert_eq!(distinct(&all), 90);
}

#[test]
fn equal_measurements_of_other_schedules_have_equal_episodes() {
    let starts = |every: u64| {
        let budget = json!({ "steps": 2 * every, "environments": 1, "evaluate_every": every, "episodes": 4,
            "final_episodes": 1 });
        let record = run(&key(("rule", json!({})), ("train_evaluate", budget))).unwrap();
        rows(&record, Phase::Evaluate, "start")
            .into_iter()
            .map(|row| row.2)
            .collect::<Vec<_>>()
    };
    assert_eq!(starts(10), starts(25));
}

#[test]
fn updates_are_recorded_at_every_measurement_and_once_at_the_end() {
    let budgets = [
        (
            (
                "train_evaluate",
                json!({ "steps": 40, "environments": 4, "evaluate_every": 20 }),
            ),
            vec![(0, 0), (20, 5), (40, 10)],
            (40, 10),
        ),
        (
            ("supervised_fit", json!({ "steps": 6, "evaluate_every": 3 })),
            vec![(0, 0), (3, 3), (6, 6)],
            (6, 6),
        ),
        (
            ("estimator_tracking", json!({ "batches": 5, "batch": 3 })),
            vec![(3, 1), (6, 2), (12, 4)],
            (15, 5),
        ),
    ];
    for (protocol, train, last) in budgets {
        let record = run(&key(("learner", json!({})), protocol)).unwrap();
        #[allow(clippy::cast_precision_loss, reason = "a handful of updates")]
        let row = |(step, updates): (u64, u64)| (step, 0, updates as f64);
        assert_eq!(
            rows(&record, Phase::Train, UPDATES),
            train.into_iter().map(row).collect::<Vec<_>>()
        );
        assert_eq!(rows(&record, Phase::Final, UPDATES), [row(last)]);
        assert!(rows(&record, Phase::Evaluate, UPDATES).is_empty());
    }
    let record = run(&key(("rule", json!({})), budgets_of_rule())).unwrap();
    assert!(!record.names().iter().any(|name| name == UPDATES));
}

fn budgets_of_rule() -> (&'static str, Value) {
    budgets().swap_remove(0)
}

#[test]
fn a_trial_that_records_no_number_says_which_and_when() {
    let reason = |key: &TrialKey| match run(key) {
        Err(error @ Error::NotFinite { .. }) => error.to_string(),
        other => panic!("{other:?}"),
    };
    let train = || {
        (
            "train_evaluate",
            json!({ "steps": 40, "environments": 4, "evaluate_every": 20 }),
        )
    };
    let diverging = |protocol| key(("learner", json!({ "diverges": true })), protocol);
    assert_eq!(
        reason(&diverging(train())),
        "loss (phase train) is not finite at step 20: NaN"
    );
    let tracking = ("estimator_tracking", json!({ "batches": 4, "batch": 3 }));
    assert_eq!(
        reason(&diverging(tracking)),
        "estimate (phase evaluate) is not finite at step 3: NaN"
    );
    for (protocol, step) in [
        (train(), "start (phase evaluate) is not finite at step 0: NaN"),
        (
            ("train_evaluate", json!({ "steps": 0 })),
            "start (phase final) is not finite at step 0: NaN",
        ),
    ] {
        let mut broken = key(("rule", json!({})), protocol);
        std::sync::Arc::make_mut(&mut broken.environment).config = json!({ "broken": true }).into();
        assert_eq!(reason(&broken), step);
    }
}

/// A trial whose environment reads a file that has this content when the trial is planned.
fn with_file(path: &Path, content: &str) -> TrialKey {
    std::fs::write(path, content).unwrap();
    let mut key = key(("rule", json!({})), budgets_of_rule());
    std::sync::Arc::make_mut(&mut key.environment).config = json!({ "file": path }).into();
    std::sync::Arc::make_mut(&mut key.environment)
        .files
        .insert("/file".into(), hash_of(path).unwrap());
    key
}

#[test]
fn a_data_file_that_changed_since_the_plan_ends_the_trial_until_it_is_restored() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("added.txt");
    let key = with_file(&path, "1");
    let before = run(&key).unwrap();
    std::fs::write(&path, "2").unwrap();
    match run(&key) {
        Err(Error::DataFileChanged { path: named }) => assert_eq!(named, path),
        other => panic!("{other:?}"),
    }
    std::fs::remove_file(&path).unwrap();
    assert!(matches!(run(&key), Err(Error::File { .. })));
    std::fs::write(&path, "1").unwrap();
    assert_eq!(run(&key).unwrap().rows(), before.rows());
}

#[test]
fn a_data_file_that_changes_while_its_trial_runs_does_not_reach_it() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("added.txt");
    let key = with_file(&path, "1");
    let before = run(&key).unwrap();
    let mut overwritten = 0;
    let mut overwrite = |_, _| {
        overwritten += 1;
        std::fs::write(&path, "2").unwrap();
    };
    let during = key.run(&registry(), None, &mut overwrite, &mut NoKeeper).unwrap();
    assert!(overwritten > 1);
    assert_eq!(during.rows(), before.rows());
}
