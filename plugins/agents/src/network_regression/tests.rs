//! Tests of the agent as a whole.

use super::*;
use contract::{End, Seat, random::stream};

/// Interface with two channels; one of them is twice the answer in other units.
fn interface() -> Interface {
    let channel = |name: &str, center, spread| Channel::new(name, "").typical(center, spread);
    Interface {
        seats: vec![Seat {
            name: String::new(),
            observation: Space::Box(vec![channel("noise", 0.0, 1.0), channel("signal_1", 10.0, 2.0)]),
            action: Space::Box(vec![Channel::new("answer", "").within(-1.0, 1.0)]),
        }],
        state: vec![channel("true_answer", 100.0, 50.0)],
    }
}

fn example(rng: &mut Rng) -> Transition {
    let (answer, noise) = (rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0));
    let observation = Observation {
        seats: vec![vec![noise, 10.0 + 2.0 * answer]],
        state: vec![100.0 + 50.0 * answer],
    };
    Transition {
        next_observation: observation.clone(),
        observation,
        action: Vec::new(),
        rewards: Vec::new(),
        end: Some(End::Terminated),
    }
}

/// The agent after some batches, and its mean absolute error.
fn fitted(config: Config, batches: usize) -> (NetworkRegression, f64) {
    let mut rng = stream(&["regression"]);
    let mut agent = NetworkRegression::new(config, &interface(), &mut rng).unwrap();
    let mut record = Recorder::default();
    for _ in 0..batches {
        let batch: Vec<Transition> = (0..32).map(|_| example(&mut rng)).collect();
        agent.learn(&batch, &mut rng, &mut record).unwrap();
    }
    let tests: Vec<Observation> = (0..200).map(|_| example(&mut rng).observation).collect();
    let acted = agent.act(&tests, Mode::Evaluate, &mut rng).unwrap();
    let pairs = acted.iter().zip(&tests);
    let off: f64 = pairs
        .map(|(action, it)| (action[0][0] - (it.state[0] - 100.0) / 50.0).abs())
        .sum();
    (agent, off / 200.0)
}

fn tiny(inputs: Option<&[&str]>) -> Config {
    Config {
        width: 16,
        layers: 2,
        learning_rate: 3e-3,
        halved_every: Some(200),
        updates_per_batch: 2,
        memory: 100,
        inputs: inputs.map(|words| words.iter().map(ToString::to_string).collect()),
    }
}

#[test]
fn it_finds_the_answer_where_it_sees_it_and_the_mean_where_it_does_not() {
    assert!(fitted(tiny(None), 0).1 > 0.2);
    assert!(fitted(tiny(None), 500).1 < 0.05);
    assert!(fitted(tiny(Some(&["signal_"])), 500).1 < 0.05);
    for blind in [&[] as &[&str], &["noise"]] {
        let (_, off) = fitted(tiny(Some(blind)), 500);
        // The mean is off by a half for a uniform answer around 0.
        assert!((0.4..0.6).contains(&off), "{off}");
    }
}

#[test]
fn steps_are_halved_little_by_little() {
    let (agent, _) = fitted(tiny(None), 50);
    assert!((agent.learning_rate() - 3e-3 * 0.5_f64.sqrt()).abs() < 1e-12);
}

#[test]
fn a_saved_agent_continues_and_an_exported_one_acts_the_same() {
    let (mut agent, _) = fitted(tiny(None), 20);
    let folder = tempfile::tempdir().unwrap();
    agent.save(folder.path()).unwrap();
    assert!(agent.export(folder.path()).unwrap());
    let mut rng = stream(&["again"]);
    let mut again = NetworkRegression::new(tiny(None), &interface(), &mut rng).unwrap();
    let mut imported = again.clone();
    again.load(folder.path()).unwrap();
    imported.import(folder.path()).unwrap();
    let batch: Vec<Transition> = (0..32).map(|_| example(&mut rng)).collect();
    let seen: Vec<Observation> = batch.iter().map(|it| it.observation.clone()).collect();
    let mut act = |agent: &mut NetworkRegression| agent.act(&seen, Mode::Evaluate, &mut rng).unwrap();
    let expected = act(&mut agent);
    assert_eq!(act(&mut imported), expected);
    let policy = Policy::read(folder.path()).unwrap();
    assert!((policy.act(&seen[0].seats[0])[0] - expected[0][0][0]).abs() < 1e-6);
    let mut record = Recorder::default();
    for agent in [&mut agent, &mut again] {
        agent.learn(&batch, &mut stream(&["x"]), &mut record).unwrap();
    }
    assert_eq!(act(&mut agent), act(&mut again));
}

#[test]
fn the_last_examples_are_remembered() {
    let (agent, _) = fitted(tiny(Some(&["signal_"])), 4);
    // 128 examples, of which 100 are kept; the signal of each equals its answer.
    assert_eq!(agent.memory.len(), 100);
    assert!(agent.memory.rows().all(|row| (row[0] - row[1]).abs() < 1e-6));
    let all = fitted(tiny(Some(&["signal_"])), 3).0;
    assert!((28..96).all(|at| agent.memory.row(at) == all.memory.row(at)));
    assert!((0..28).all(|at| agent.memory.row(at) != all.memory.row(at)));
}

#[test]
fn misfits_are_refused() {
    let message = |config: Config, interface: &Interface| {
        let built = NetworkRegression::new(config, interface, &mut stream(&["x"]));
        built.unwrap_err().to_string()
    };
    let unknown = message(tiny(Some(&["target_"])), &interface());
    assert!(
        unknown.contains("no channel begins with `target_`; there are: noise, signal_1"),
        "{unknown}"
    );
    let mut stateless = interface();
    stateless.state.clear();
    assert!(message(tiny(None), &stateless).contains("state of 1 channels"));
    let shares = seat::tests::allocation(&["x"], &["a", "b"], 2);
    assert!(message(tiny(None), &shares).contains("numbers in a box"));
    let forgetful = Config {
        memory: 0,
        ..tiny(None)
    };
    assert!(message(forgetful, &interface()).contains("updates of remembered examples"));
}

#[test]
fn members_of_a_population_learn_as_trials_alone() {
    crate::shared::population::assert_members_learn_as_alone(
        |rng| NetworkRegression::new(tiny(None), &interface(), rng).unwrap(),
        |agent| std::slice::from_mut(&mut agent.learning),
        |agent, rng| {
            let batch: Vec<Transition> = (0..32).map(|_| example(rng)).collect();
            agent.learn(&batch, rng, &mut Recorder::default()).unwrap();
        },
    );
}
