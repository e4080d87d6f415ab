//! Tests of gathering and of learning from gathered data, on walks: a walk begins between two ends and is over
//! when it leaves them.

use contract::{
    Action, Agent, AgentTraits, Channel, Config, End, Environment, Error, Feed, Interface, Keeper, Metric,
    Mode, NoKeeper, Observation, Phase, Recorder, Registry, Rng, Seat, Space, Step, Transition, Updates,
    artifact::{ArtifactKind, Taken, named_in},
    cast::Actors,
    dataset::{Dataset, DatasetWriter, Episode},
    part::Part,
    standard_metrics::UPDATES,
    trial::TrialKey,
};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::{cell::Cell, collections::BTreeMap, fs, path::Path};

thread_local! {
    /// Steps of all walks of a test.
    static STEPS: Cell<u64> = const { Cell::new(0) };
}

/// Walks of one or several seats, the first of which steers. Seat `k` earns `k + 1` times the position.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct WalkConfig {
    /// Number of walks.
    seats: usize,
}

impl Default for WalkConfig {
    fn default() -> Self {
        Self { seats: 1 }
    }
}

impl Config for WalkConfig {}

struct Walk {
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    place: f64,
    steps: u64,
}

impl Environment for Walk {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }
    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }
    fn reset(&mut self, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        (self.place, self.steps) = (rng.random_range(-1.0..1.0), 0);
        Ok(vec![vec![self.place]; self.seats.len()])
    }
    fn step(&mut self, actions: &[Vec<f64>], rng: &mut Rng) -> Result<Step, Error> {
        STEPS.set(STEPS.get() + 1);
        self.place += actions[0][0] + rng.random_range(-0.4..0.4);
        self.steps += 1;
        let end = if self.place.abs() > 1.0 {
            Some(End::Terminated)
        } else {
            (self.steps == 6).then_some(End::Truncated)
        };
        let seats = self.seats.len();
        let rewards = (1..=seats).map(|times| self.place * times as f64).collect();
        Ok(Step::new(vec![vec![self.place]; seats], rewards, end).record("travelled", self.place))
    }
    fn state_channels(&self) -> Vec<Channel> {
        vec![Channel::new("steps", ""), Channel::new("place", "m")]
    }
    fn state(&self) -> Vec<f64> {
        vec![self.steps as f64, self.place]
    }
    fn trace_channels(&self) -> Vec<Channel> {
        Vec::new()
    }
    fn trace(&self) -> Vec<f64> {
        Vec::new()
    }
    fn snapshot(&self) -> Value {
        json!([self.place, self.steps])
    }
    fn restore(&mut self, snapshot: &Value) -> Result<(), Error> {
        (self.place, self.steps) = (snapshot[0].as_f64().unwrap(), snapshot[1].as_u64().unwrap());
        Ok(())
    }
}

fn seat(name: &str) -> Seat {
    let force = Channel::new("force", "").within(-1.0, 1.0);
    Seat {
        name: name.into(),
        observation: Space::Box(vec![Channel::new("place", "m")]),
        action: Space::Box(vec![force]),
    }
}

fn walk(config: WalkConfig) -> Result<Box<dyn Environment>, Error> {
    let seats = (0..config.seats).map(|at| seat(&at.to_string())).collect();
    let metrics = vec![Metric::new("travelled", "m", "sum of all places")];
    Ok(Box::new(Walk {
        seats,
        metrics,
        place: 0.0,
        steps: 0,
    }))
}

#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct NoConfig {}

impl Config for NoConfig {}

/// Pushes to the right in evaluation, and anywhere in training. Its `learn` only records the batch that it
/// gets.
#[derive(Default, Serialize, Deserialize)]
struct WalkingAgent {
    learns: bool,
    told_of: usize,
    read: u64,
    batches: u64,
}

impl Agent for WalkingAgent {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let force = |rng: &mut Rng| {
            if mode == Mode::Train {
                rng.random_range(-0.5..0.5)
            } else {
                0.125
            }
        };
        let act = |seen: &Observation| seen.seats.iter().map(|_| vec![force(rng)]).collect();
        Ok(observations.iter().map(act).collect())
    }
    fn observe_dataset(&mut self, transitions: &[Transition]) -> Result<(), Error> {
        assert_eq!(
            (self.told_of, self.batches),
            (0, 0),
            "it is told once, before the first batch"
        );
        self.told_of = transitions.len();
        Ok(())
    }
    fn learn(&mut self, batch: &[Transition], rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        assert!(self.learns && self.told_of > 0);
        self.read += batch.len() as u64;
        self.batches += 1;
        batch
            .iter()
            .for_each(|transition| record.mean("reward_read", transition.rewards[0]));
        record.mean("drawn", rng.random());
        record.mean("simulated", STEPS.get() as f64);
        Ok(())
    }
    fn updates(&self) -> Option<Updates> {
        self.learns.then_some(Updates {
            made: self.batches,
            first_after: 1,
        })
    }
    fn save(&self, dir: &Path) -> Result<(), Error> {
        fs::write(dir.join("walker.json"), serde_json::to_string(self).unwrap())
            .map_err(Error::file("write", dir))
    }
    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        *self = serde_json::from_slice(&fs::read(dir.join("walker.json")).unwrap()).unwrap();
        Ok(())
    }
}

fn registry() -> Registry {
    let mut registry = Registry::default();
    super::register(&mut registry);
    registry.environment("walk", 1, "A walk.", walk);
    registry.agent(
        "rule",
        1,
        "Pushes.",
        AgentTraits::default(),
        |_: NoConfig, _: &Interface, _| Ok(Box::new(WalkingAgent::default())),
    );
    let traits = AgentTraits::learner([Feed::Dataset], Vec::new());
    registry.agent("reader", 1, "Reads.", traits, |_: NoConfig, _, _| {
        Ok(Box::new(WalkingAgent {
            learns: true,
            ..WalkingAgent::default()
        }))
    });
    registry
}

/// The key of a trial as a study would plan it.
fn key(agent: &str, protocol: (&str, Value)) -> TrialKey {
    let registry = registry();
    let entry = &registry.protocols[protocol.0];
    let mut config = (entry.about.resolve)(&protocol.1).unwrap();
    if !registry.agents[agent].traits.learns() {
        config = (entry.without_training)(&config).unwrap();
    }
    let mut protocol = Part::new(protocol.0, 1, config);
    for (at, (kind, reference)) in named_in(&protocol.config) {
        protocol.artifacts.insert(
            at,
            Taken {
                trial: reference.from,
                kind,
            },
        );
    }
    let (environment, agent) = (
        Part::new("walk", 1, json!({})),
        Actors::Agent(Part::new(agent, 1, json!({}))),
    );
    TrialKey {
        environment: environment.into(),
        agent: agent.into(),
        protocol: protocol.into(),
        seed: 3,
        numerics: 1,
    }
}

/// Runs a trial that leaves its outputs in `folder` and finds the outputs of trial `x` in `products/x`.
fn run(key: &TrialKey, products: &Path, folder: &Path, keeper: &mut dyn Keeper) -> Result<Recorder, Error> {
    let find = |taken: &Taken| Ok(products.join(&taken.trial));
    key.run_after(&registry(), &find, Some(folder), &mut |_, _| {}, keeper)
}

fn gather(episodes: u64, mode: &str, trial: &Path) -> (Recorder, Dataset) {
    fs::create_dir_all(trial).unwrap();
    let key = key("rule", ("gather", json!({ "episodes": episodes, "mode": mode })));
    let record = run(&key, trial, trial, &mut NoKeeper).unwrap();
    (record, Dataset::read(trial).unwrap())
}

/// Values of a metric in a phase, in the order of steps and episodes.
fn values(record: &Recorder, phase: Phase, metric: &str) -> Vec<f64> {
    let named = |row: &&contract::recorder::Row| {
        row.phase == phase && record.names()[usize::from(row.metric)] == metric
    };
    let rows = record
        .rows()
        .iter()
        .filter(named)
        .map(|row| ((row.step, row.episode), row.value.to_bits()));
    rows.collect::<BTreeMap<_, _>>()
        .into_values()
        .map(f64::from_bits)
        .collect()
}

#[test]
fn the_gathered_dataset_is_that_of_the_record() {
    let trial = tempfile::tempdir().unwrap();
    let (record, dataset) = gather(300, "train", trial.path());
    assert_eq!(
        (dataset.episodes.len(), dataset.interface.seats.clone()),
        (300, vec![seat("0")])
    );
    let rewards = |episode: &Episode| episode.rewards.iter().fold(0.0, |sum, reward| sum + reward);
    let (returns, lengths): (Vec<f64>, Vec<f64>) = dataset
        .episodes
        .iter()
        .map(|episode| (rewards(episode), episode.actions.len() as f64))
        .unzip();
    assert_eq!(values(&record, Phase::Final, "return"), returns);
    assert_eq!(values(&record, Phase::Final, "travelled"), returns);
    assert_eq!(values(&record, Phase::Final, "episode_length"), lengths);
    for episode in &dataset.episodes {
        assert_eq!(
            episode.observations[1..].concat(),
            episode.rewards,
            "the reward is the place that is seen next"
        );
        let left = episode.rewards.last().unwrap().abs() > 1.0;
        assert_eq!(episode.end, if left { End::Terminated } else { End::Truncated });
    }
    let actions = |mode| {
        gather(3, mode, trial.path())
            .1
            .episodes
            .into_iter()
            .flat_map(|it| it.actions)
            .flatten()
            .collect::<Vec<_>>()
    };
    assert!(actions("evaluate").iter().all(|force| *force == 0.125));
    assert!(actions("train").iter().all(|force| *force != 0.125));
}

#[test]
fn an_episode_does_not_depend_on_how_many_there_are() {
    let trial = tempfile::tempdir().unwrap();
    let few = gather(3, "evaluate", trial.path()).1.episodes;
    let many = gather(300, "evaluate", trial.path()).1.episodes;
    assert_eq!(few, many[..3]);
    assert_ne!(many[0], many[1]);
}

/// Saves in memory, and asks to stop at the opportunity number `at`.
struct StoppingKeeper {
    at: u64,
    seen: u64,
    saved: Option<(Value, tempfile::TempDir, Recorder)>,
}

impl Keeper for StoppingKeeper {
    fn due(&mut self) -> bool {
        self.seen += 1;
        self.seen == self.at
    }
    fn stopping(&self) -> bool {
        self.seen == self.at
    }
    fn save(&mut self, state: Value, agent: &dyn Agent, record: &mut Recorder) -> Result<(), Error> {
        let folder = tempfile::tempdir().unwrap();
        agent.save(folder.path())?;
        self.saved = Some((state, folder, record.clone()));
        Ok(())
    }
    fn load(&mut self, agent: &mut dyn Agent, record: &mut Recorder) -> Result<Option<Value>, Error> {
        let Some((state, folder, kept)) = &self.saved else {
            return Ok(None);
        };
        agent.load(folder.path())?;
        *record = kept.clone();
        Ok(Some(serde_json::from_str(&state.to_string()).unwrap()))
    }
    fn note(&mut self, _: &Recorder) -> Result<(), Error> {
        Ok(())
    }
}

/// Record and dataset of a trial.
fn outcome(record: &Recorder, folder: &Path) -> (String, Option<Dataset>) {
    let rows: Vec<_> = record
        .rows()
        .iter()
        .map(|row| (row.phase, row.step, row.episode, row.metric, row.value.to_bits()))
        .collect();
    (
        format!("{:?} {rows:?}", record.names()),
        Dataset::read(folder).ok(),
    )
}

/// Stops the trial at every opportunity to save, one after the other, and continues in another folder; returns
/// the count of opportunities.
fn assert_resumes(key: &TrialKey, products: &Path) -> u64 {
    let folder = || tempfile::tempdir().unwrap();
    let whole_folder = folder();
    let mut never = StoppingKeeper {
        at: 0,
        seen: 0,
        saved: None,
    };
    STEPS.set(0);
    let record = run(key, products, whole_folder.path(), &mut never).unwrap();
    let whole = outcome(&record, whole_folder.path());
    for at in 1..=never.seen {
        let mut keeper = StoppingKeeper {
            at,
            seen: 0,
            saved: None,
        };
        STEPS.set(0);
        assert!(
            matches!(
                run(key, products, folder().path(), &mut keeper),
                Err(Error::Stopped)
            ),
            "{at}"
        );
        keeper.at = 0;
        let second = folder();
        let record = run(key, products, second.path(), &mut keeper).unwrap();
        assert!(
            outcome(&record, second.path()) == whole,
            "stopped at {at} of {}",
            never.seen
        );
    }
    never.seen
}

#[test]
fn gathering_that_was_stopped_leaves_the_same_dataset() {
    let products = tempfile::tempdir().unwrap();
    let opportunities = assert_resumes(
        &key("rule", ("gather", json!({ "episodes": 260 }))),
        products.path(),
    );
    assert_eq!(opportunities, 2, "before each block of 256 episodes");
}

/// Two datasets, `few` with 2 episodes and `more` with 5.
fn products() -> tempfile::TempDir {
    let products = tempfile::tempdir().unwrap();
    gather(2, "evaluate", &products.path().join("few"));
    gather(5, "train", &products.path().join("more"));
    STEPS.set(0);
    products
}

fn fit(changed: Value) -> (&'static str, Value) {
    let mut config = json!({
        "datasets": [{ "from": "few" }, { "from": "more" }], "steps": 8, "batch": 4, "evaluate_every": 4,
        "episodes": 3,
        "final_episodes": 260,
    });
    config
        .as_object_mut()
        .unwrap()
        .extend(changed.as_object().unwrap().clone());
    ("offline_fit", config)
}

#[test]
fn batches_come_from_all_datasets_and_nothing_is_simulated_for_them() {
    let products = products();
    let folder = tempfile::tempdir().unwrap();
    let of = |name: &str| {
        Dataset::read(&products.path().join(name))
            .unwrap()
            .transitions()
            .unwrap()
            .into_iter()
            .map(|it| it.rewards[0])
            .collect::<Vec<_>>()
    };
    let (few, more) = (of("few"), of("more"));
    let total = few.len() + more.len();
    // Batches of one transition, so that the mean of a batch is a reward.
    let key = key(
        "reader",
        fit(json!({ "steps": 200, "batch": 1, "evaluate_every": 1, "episodes": 0, "final_episodes": 1 })),
    );
    let record = run(&key, products.path(), folder.path(), &mut NoKeeper).unwrap();
    let seen = values(&record, Phase::Train, "reward_read");
    assert_eq!(seen.len(), 200);
    assert!(
        seen.iter()
            .all(|reward| few.contains(reward) || more.contains(reward))
    );
    assert!(
        few.iter()
            .chain(&more)
            .filter(|reward| seen.contains(reward))
            .count()
            * 10
            >= total * 9,
        "nearly all were drawn"
    );
    assert!(
        values(&record, Phase::Train, "simulated")
            .iter()
            .all(|steps| *steps == 0.0)
    );
    assert_eq!(values(&record, Phase::Final, UPDATES), [200.0]);
}

#[test]
fn agents_meet_the_same_episodes_under_both_protocols() {
    let products = products();
    let folder = tempfile::tempdir().unwrap();
    let measured = |agent: &str, protocol: (&str, Value)| {
        let record = run(
            &key(agent, protocol),
            products.path(),
            folder.path(),
            &mut NoKeeper,
        )
        .unwrap();
        [Phase::Evaluate, Phase::Final].map(|phase| values(&record, phase, "return"))
    };
    let simulated =
        json!({ "steps": 8, "environments": 1, "evaluate_every": 4, "episodes": 3, "final_episodes": 260 });
    let rule = measured("rule", ("train_evaluate", simulated));
    assert_eq!(rule[0].len(), 9);
    assert_eq!(measured("rule", fit(json!({}))), rule);
    assert_eq!(measured("reader", fit(json!({}))), rule);
}

#[test]
fn learning_that_was_stopped_ends_with_the_same_bits() {
    let products = products();
    assert_eq!(
        assert_resumes(&key("reader", fit(json!({}))), products.path()),
        8 + 3 + 2
    );
    assert_eq!(
        assert_resumes(&key("rule", fit(json!({}))), products.path()),
        3 + 2
    );
}

#[test]
fn an_agent_that_does_not_learn_takes_no_dataset() {
    let id = |changed: Value| key("rule", fit(changed)).id();
    assert_eq!(id(json!({})), id(json!({ "datasets": [], "batch": 9 })));
    assert_ne!(id(json!({})), id(json!({ "steps": 12 })));
    assert!(key("rule", fit(json!({}))).taken().is_empty());
    let taken = key("reader", fit(json!({}))).taken();
    assert_eq!(
        taken,
        ["few", "more"].map(|trial| Taken {
            trial: trial.into(),
            kind: ArtifactKind::Dataset
        })
    );
    assert_eq!(
        id(json!({ "steps": 0 })),
        id(json!({ "steps": 12, "evaluate_every": 0 }))
    );
}

fn refusal(key: &TrialKey, products: &Path) -> String {
    let folder = tempfile::tempdir().unwrap();
    run(key, products, folder.path(), &mut NoKeeper).map_or_else(|error| error.to_string(), |_| "ran".into())
}

#[test]
fn an_unsuitable_dataset_is_refused_with_a_remedy() {
    let products = products();
    let none = refusal(&key("reader", fit(json!({ "datasets": [] }))), products.path());
    assert!(
        none.contains("write `datasets: [{ from: NAME }]`") && none.contains("`gather`"),
        "{none}"
    );
    let interface = Interface {
        seats: vec![seat("0")],
        state: Vec::new(),
    };
    Dataset::write_empty(&products.path().join("few"), &interface).unwrap();
    let empty = key("reader", fit(json!({ "datasets": [{ "from": "few" }] })));
    let registry = registry();
    let protocol = empty
        .protocol
        .loaded(&|taken| Ok(products.path().join(&taken.trial)))
        .unwrap();
    assert!(
        (registry.protocols["offline_fit"].build)(&protocol).is_ok(),
        "a stub is empty"
    );
    let text = refusal(&empty, products.path());
    assert!(
        text.contains("`datasets`: they hold no decision to learn from"),
        "{text}"
    );
    assert_eq!(
        refusal(&key("reader", fit(json!({}))), products.path()),
        "ran",
        "another one holds enough"
    );
    let mut other = interface.clone();
    other.seats[0].observation = Space::Box(vec![Channel::new("speed", "m/s")]);
    DatasetWriter::create(&products.path().join("more"), &other)
        .unwrap()
        .finish()
        .unwrap();
    let text = refusal(&key("reader", fit(json!({}))), products.path());
    assert!(
        text.contains("entry 1 of the observation is `speed` in m/s there and `place` in m here"),
        "{text}"
    );
    assert!(
        text.starts_with("`datasets.1`: `more` cannot be learned from here"),
        "{text}"
    );
    let missing = refusal(
        &key("reader", fit(json!({ "datasets": [{ "from": "nowhere" }] }))),
        products.path(),
    );
    assert!(
        missing.contains("cannot read") && missing.contains("nowhere"),
        "{missing}"
    );
}

#[test]
fn of_several_seats_all_is_gathered_and_the_full_state_too() {
    let folder = tempfile::tempdir().unwrap();
    let mut several = key("rule", ("gather", json!({ "episodes": 40, "mode": "train" })));
    std::sync::Arc::make_mut(&mut several.environment).config = json!({ "seats": 2 }).into();
    let record = run(&several, folder.path(), folder.path(), &mut NoKeeper).unwrap();
    let dataset = Dataset::read(folder.path()).unwrap();
    assert_eq!(dataset.episodes.len(), 40);
    let transitions = dataset.transitions().unwrap();
    for one in &transitions {
        let [seen, next] = [&one.observation, &one.next_observation].map(|it| it.seats[0][0]);
        assert_eq!(one.observation.seats[1], [seen]);
        assert_eq!(one.rewards, [next, 2.0 * next]);
        assert_eq!(
            (one.observation.state[1], one.next_observation.state[1]),
            (seen, next)
        );
        assert_eq!(one.next_observation.state[0], one.observation.state[0] + 1.0);
        assert!(one.action.len() == 2 && one.action[0] != one.action[1]);
    }
    let second = |episode: &Episode| episode.rewards.chunks(2).map(|pair| pair[1]).sum::<f64>();
    let returns: Vec<f64> = dataset.episodes.iter().map(second).collect();
    let recorded = values(&record, Phase::Final, "travelled");
    for (twice, once) in returns.iter().zip(recorded) {
        assert!((twice - 2.0 * once).abs() < 1e-12);
    }
}

#[test]
fn the_stub_of_what_is_gathered_is_an_empty_dataset() {
    let folder = tempfile::tempdir().unwrap();
    let registry = registry();
    let entry = &registry.protocols["gather"];
    let protocol = (entry.build)(&entry.about.defaults).unwrap();
    assert_eq!(protocol.leaves(), [ArtifactKind::Dataset]);
    let interface = Interface {
        seats: vec![seat("0")],
        state: Vec::new(),
    };
    protocol.write_stub(&interface, folder.path()).unwrap();
    assert_eq!(
        Dataset::read_for(folder.path(), &interface).unwrap(),
        Dataset {
            interface,
            episodes: Vec::new()
        }
    );
}
