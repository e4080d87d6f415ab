//! A search over a small design space whose best design is known.

use super::*;
use contract::{
    Action, Agent, AgentTraits, Better, Channel, Choice, NoKeeper, Observation, Recorder, Seat, Space, Step,
    Transition, cast::Actors, choice, design::FILE, part::Part, trial::TrialKey,
};
use serde_json::json;

#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
struct DigitConfig {
    noise: f64,
}

impl Config for DigitConfig {}

/// Two steps with three options each; the value of a design is ten times the first option plus the second, plus
/// noise.
struct DigitDesigns {
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    noise: f64,
    step: usize,
}

fn choices() -> Vec<Choice> {
    vec![Choice::new("digit", &["0", "1", "2"])]
}

fn digits(config: DigitConfig) -> Result<Box<dyn Environment>, Error> {
    let seat = Seat {
        name: String::new(),
        observation: Space::Box(vec![Channel::new("step", "")]),
        action: Space::Choices(choices()),
    };
    let worth = Metric::new("worth", "", "what it is worth without noise");
    let waste = Metric {
        better: Better::Lower,
        ..Metric::new("waste", "", "the second digit")
    };
    Ok(Box::new(DigitDesigns {
        seats: vec![seat],
        metrics: vec![worth, waste],
        noise: config.noise,
        step: 0,
    }))
}

impl Environment for DigitDesigns {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }
    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }
    fn reset(&mut self, _: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        self.step = 0;
        Ok(vec![vec![0.0]])
    }
    fn step(&mut self, actions: &[Vec<f64>], rng: &mut Rng) -> Result<Step, Error> {
        use rand::Rng as _;
        let taken = choice::taken(&choices(), &actions[0])?[0];
        let worth = taken as f64 * if self.step == 0 { 10.0 } else { 1.0 };
        self.step += 1;
        let reward = worth + self.noise * rng.random_range(-1.0..1.0);
        let end = (self.step == 2).then_some(End::Terminated);
        Ok(Step::new(vec![vec![self.step as f64]], vec![reward], end)
            .record("worth", worth)
            .record("waste", if self.step == 2 { worth } else { 0.0 }))
    }
    fn trace_channels(&self) -> Vec<Channel> {
        Vec::new()
    }
    fn trace(&self) -> Vec<f64> {
        Vec::new()
    }
    fn snapshot(&self) -> Value {
        json!(self.step)
    }
    fn restore(&mut self, snapshot: &Value) -> Result<(), Error> {
        self.step = usize::try_from(snapshot.as_u64().unwrap()).unwrap();
        Ok(())
    }
}

/// Draws options; gives up every design whose first option is 0.
#[derive(Default)]
struct RandomDesigner {
    began_badly: bool,
    learned: Vec<(f64, f64)>,
}

impl Agent for RandomDesigner {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        use rand::Rng as _;
        let row = |_: &Observation| match mode {
            Mode::Train => vec![choice::vector(&choices(), &[rng.random_range(0..3usize)])],
            Mode::Evaluate => vec![choice::vector(&choices(), &[1])],
        };
        Ok(observations.iter().map(row).collect())
    }
    fn learn(&mut self, given: &[Transition], _: &mut Rng, _: &mut Recorder) -> Result<(), Error> {
        let one = &given[0];
        let taken = choice::taken(&choices(), &one.action[0])?[0];
        self.began_badly = one.observation.seats[0][0] == 0.0 && taken == 0;
        self.learned.push((one.observation.seats[0][0], one.rewards[0]));
        Ok(())
    }
    fn truncates(&mut self) -> bool {
        self.began_badly
    }
}

fn draws(_: DigitConfig, _: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(RandomDesigner::default()))
}

fn registry() -> Registry {
    let mut registry = Registry::default();
    registry.environment("digits", 1, "Two digits.", digits);
    registry.agent("draws", 1, "Draws.", AgentTraits::default(), draws);
    super::super::register(&mut registry);
    registry
}

fn key(noise: f64, protocol: Value) -> TrialKey {
    let protocol = serde_json::to_value(serde_json::from_value::<Search>(protocol).unwrap()).unwrap();
    TrialKey {
        environment: Part::new("digits", 1, json!({ "noise": noise })).into(),
        agent: Actors::Agent(Part::new("draws", 1, json!({ "noise": 0.0 }))).into(),
        protocol: Part::new("search", 1, protocol).into(),
        seed: 5,
        numerics: 1,
    }
}

fn run(key: &TrialKey, folder: Option<&Path>, keeper: &mut dyn contract::Keeper) -> Result<Recorder, Error> {
    key.run(&registry(), folder, &mut |_, _| (), keeper)
}

/// Step and value of a metric in a phase.
fn values(record: &Recorder, phase: Phase, metric: &str) -> Vec<(u64, f64)> {
    record
        .rows()
        .iter()
        .filter(|row| row.phase == phase && record.names()[usize::from(row.metric)] == metric)
        .map(|row| (row.step, row.value))
        .collect()
}

#[test]
fn the_best_design_is_found_measured_again_and_left_for_others() {
    let folder = tempfile::tempdir().unwrap();
    let key = key(0.0, json!({ "evaluations": 60, "final_episodes": 2 }));
    let record = run(&key, Some(folder.path()), &mut NoKeeper).unwrap();
    assert_eq!(values(&record, Phase::Final, "worth"), [(60, 22.0), (60, 22.0)]);
    let best = values(&record, Phase::Evaluate, "return");
    assert!(best.windows(2).all(|pair| pair[0].1 <= pair[1].1), "{best:?}");
    assert_eq!(best.last().unwrap().1, 22.0);
    let tried = values(&record, Phase::Evaluate, "candidate_worth");
    assert!(tried.iter().any(|(_, worth)| *worth < 22.0));

    let designs = Designs::read(folder.path()).unwrap().designs;
    assert_eq!(designs[0].observed_return, 22.0);
    assert_eq!(designs[0].options[0]["digit"], "2");
    let of_options: std::collections::BTreeSet<_> =
        designs.iter().map(|it| format!("{:?}", it.options)).collect();
    assert_eq!(of_options.len(), designs.len(), "no two take the same options");
    let dataset = Dataset::read(folder.path()).unwrap();
    let steps: usize = dataset.episodes.iter().map(|episode| episode.actions.len()).sum();
    assert!((60..62).contains(&steps), "{steps}");
}

#[test]
fn a_metric_makes_one_design_better_than_another_in_its_better_direction() {
    let folder = tempfile::tempdir().unwrap();
    let by = |metric: &str| json!({ "evaluations": 90, "final_episodes": 1, "by": metric });
    let record = run(&key(8.0, by("worth")), Some(folder.path()), &mut NoKeeper).unwrap();
    assert_eq!(values(&record, Phase::Final, "worth"), [(90, 22.0)]);
    let best = values(&record, Phase::Evaluate, "worth");
    assert!(best.windows(2).all(|pair| pair[0].1 <= pair[1].1), "{best:?}");
    let returns = values(&record, Phase::Evaluate, "return");
    assert!(
        returns.windows(2).any(|pair| pair[0].1 > pair[1].1),
        "{returns:?}"
    );
    let designs = Designs::read(folder.path()).unwrap().designs;
    let told: Vec<_> = designs.iter().filter_map(|it| it.chosen_by.clone()).collect();
    assert_eq!(told.len(), designs.len());
    assert!(
        told.windows(2).all(|pair| pair[0].value >= pair[1].value),
        "{told:?}"
    );
    assert_eq!((told[0].metric.as_str(), told[0].value), ("worth", 22.0));

    let record = run(&key(0.0, by("waste")), Some(folder.path()), &mut NoKeeper).unwrap();
    assert_eq!(values(&record, Phase::Final, "waste"), [(90, 0.0)]);
}

#[test]
fn a_metric_that_is_not_there_is_refused_at_its_key() {
    let environment = digits(DigitConfig::default()).unwrap();
    let search = Search {
        by: Some("wort".into()),
        ..Search::default()
    };
    let refused = search.accepts(&environment.interface(), environment.metrics());
    let Err(Error::Config { key, problem }) = refused else {
        panic!("{refused:?}");
    };
    assert_eq!(key, "by");
    assert!(
        problem.contains("`wort`") && problem.contains("did you mean `worth`?"),
        "{problem}"
    );
    assert!(
        !serde_json::to_string(&Search::default())
            .unwrap()
            .contains("\"by\"")
    );
}

#[test]
fn designs_that_are_given_up_cost_what_was_evaluated_and_are_no_designs() {
    let folder = tempfile::tempdir().unwrap();
    let record = run(
        &key(0.0, json!({ "evaluations": 60, "final_episodes": 1 })),
        Some(folder.path()),
        &mut NoKeeper,
    )
    .unwrap();
    let dataset = Dataset::read(folder.path()).unwrap();
    let given_up = dataset.episodes.iter().filter(|it| it.actions.len() == 1);
    assert!(
        given_up
            .clone()
            .all(|it| it.end == End::Truncated && it.rewards == [0.0])
    );
    let whole = values(&record, Phase::Evaluate, "candidate_return").len();
    assert!(given_up.count() + whole == dataset.episodes.len() && whole < dataset.episodes.len());
}

#[test]
fn the_policy_or_the_last_designs_can_be_chosen() {
    let policy = json!({ "evaluations": 20, "choose": "policy", "final_episodes": 1 });
    let record = run(&key(0.0, policy), None, &mut NoKeeper).unwrap();
    assert_eq!(values(&record, Phase::Final, "return"), [(20, 11.0)]);
    let last = json!({ "evaluations": 20, "among_last": 0.001, "final_episodes": 1 });
    let record = run(&key(0.0, last), None, &mut NoKeeper).unwrap();
    let last = values(&record, Phase::Evaluate, "candidate_return")
        .last()
        .unwrap()
        .1;
    assert_eq!(values(&record, Phase::Final, "return")[0].1, last);
}

/// Saves at every opportunity and stops at one of them.
#[derive(Default)]
struct InterruptingKeeper {
    after: u64,
    saves: u64,
    state: Option<(Value, Recorder)>,
}

impl contract::Keeper for InterruptingKeeper {
    fn due(&mut self) -> bool {
        true
    }
    fn stopping(&self) -> bool {
        self.saves == self.after
    }
    fn save(&mut self, state: Value, _: &dyn Agent, record: &mut Recorder) -> Result<(), Error> {
        self.saves += 1;
        self.state = Some((state, record.clone()));
        Ok(())
    }
    fn load(&mut self, _: &mut dyn Agent, record: &mut Recorder) -> Result<Option<Value>, Error> {
        Ok(self.state.take().map(|(state, kept)| {
            *record = kept;
            state
        }))
    }
    fn note(&mut self, _: &Recorder) -> Result<(), Error> {
        Ok(())
    }
}

#[test]
fn a_search_that_is_stopped_anywhere_ends_the_same() {
    let key = key(3.0, json!({ "evaluations": 21, "final_episodes": 4 }));
    let whole = run(&key, None, &mut NoKeeper).unwrap();
    let rows = |record: &Recorder| format!("{:?} {:?}", record.names(), record.rows());
    let mut stops = 0;
    for after in 1.. {
        let mut keeper = InterruptingKeeper {
            after,
            ..InterruptingKeeper::default()
        };
        match run(&key, None, &mut keeper) {
            Err(Error::Stopped) => stops += 1,
            Ok(_) => break,
            Err(error) => panic!("{error}"),
        }
        assert_eq!(
            rows(&run(&key, None, &mut keeper).unwrap()),
            rows(&whole),
            "stopped at {after}"
        );
    }
    assert!(stops > 21, "{stops}");
}

#[test]
fn only_one_seat_designs() {
    let two = Interface {
        seats: vec![digits(DigitConfig::default()).unwrap().seats()[0].clone(); 2],
        state: Vec::new(),
    };
    assert!(matches!(
        Search::default().accepts(&two, &[]),
        Err(Error::ManySeats { seats: 2 })
    ));
    assert_eq!(FILE, "choice.json");
}
