//! A tiny problem for the tests of learning agents: one decision per episode, reward minus the distance to a
//! known answer.

use contract::{Agent, End, Interface, Metric, Mode, Observation, Recorder, Rng, Transition};
use numerics::policy_file::Policy;
use rand::Rng as _;

/// The best shares where the observation is `x` in `[-1, 1]`: `(0.5 + 0.3 x, 0.3 - 0.2 x, 0.2 - 0.1 x)`.
pub fn best(x: f64) -> Vec<f64> {
    vec![0.5 + 0.3 * x, 0.3 - 0.2 * x, 0.2 - 0.1 * x]
}

/// One observed channel, three shares, the answer as the state.
pub fn interface() -> Interface {
    crate::shared::seat::tests::allocation(&["x"], &["best_1", "best_2", "best_3"], 3)
}

/// Draws `n` random observations and lets the agent decide on each in training mode.
pub fn decide(agent: &mut dyn Agent, n: usize, rng: &mut Rng) -> Vec<Transition> {
    let seen: Vec<f64> = (0..n).map(|_| rng.random_range(-1.0..1.0)).collect();
    let observe = |x: &f64| Observation {
        seats: vec![vec![*x]],
        state: best(*x),
    };
    let observations: Vec<Observation> = seen.iter().map(observe).collect();
    let actions = agent.act(&observations, Mode::Train, rng).unwrap();
    let transition = |(observation, action): (Observation, contract::Action)| {
        let reward = -distance(&action[0], &observation.state);
        let next_observation = observation.clone();
        Transition {
            observation,
            action,
            rewards: vec![reward],
            next_observation,
            end: Some(End::Terminated),
        }
    };
    observations.into_iter().zip(actions).map(transition).collect()
}

/// Trains for `rounds` rounds of 16 decisions.
pub fn train(agent: &mut dyn Agent, rounds: usize, rng: &mut Rng) -> Recorder {
    let mut record = Recorder::default();
    for _ in 0..rounds {
        let transitions = decide(agent, 16, rng);
        agent.learn(&transitions, rng, &mut record).unwrap();
    }
    record
}

/// Mean distance of the evaluated actions to the best ones, over 21 observations.
pub fn error(agent: &mut dyn Agent, rng: &mut Rng) -> f64 {
    let seen: Vec<f64> = (0..=20).map(|i| f64::from(i) / 10.0 - 1.0).collect();
    let observations: Vec<_> = seen
        .iter()
        .map(|x| Observation {
            seats: vec![vec![*x]],
            state: best(*x),
        })
        .collect();
    let actions = agent.act(&observations, Mode::Evaluate, rng).unwrap();
    actions
        .iter()
        .zip(&seen)
        .map(|(action, x)| distance(&action[0], &best(*x)))
        .sum::<f64>()
        / 21.0
}

/// Asserts that an agent restored from a checkpoint makes the same updates and takes the same actions as the
/// agent that was not interrupted.
pub fn assert_continues(build: impl Fn(&mut Rng) -> Box<dyn Agent>) {
    let mut rng = contract::random::stream(&["continues"]);
    let mut one = build(&mut rng);
    train(one.as_mut(), 5, &mut rng);
    let dir = tempfile::tempdir().unwrap();
    one.save(dir.path()).unwrap();
    let mut two = build(&mut contract::random::stream(&["another start"]));
    two.load(dir.path()).unwrap();
    assert!(
        two.updates() == one.updates() && two.updates().is_some_and(|updates| updates.made > 0),
        "{:?}",
        two.updates()
    );
    let (mut rng_one, mut rng_two) = (rng.clone(), rng);
    let (record_one, record_two) = (
        train(one.as_mut(), 3, &mut rng_one),
        train(two.as_mut(), 3, &mut rng_two),
    );
    assert_eq!(format!("{record_one:?}"), format!("{record_two:?}"));
    assert_eq!(
        decide(one.as_mut(), 4, &mut rng_one),
        decide(two.as_mut(), 4, &mut rng_two)
    );
    assert!(matches!(
        two.load(&dir.path().join("nowhere")),
        Err(contract::Error::File { .. })
    ));
}

/// Asserts that a trained agent records exactly the declared metrics.
pub fn assert_declared(agent: &mut dyn Agent, declared: &[Metric]) {
    let mut record = train(agent, 5, &mut contract::random::stream(&["record"]));
    record.flush_means(1);
    let mut declared: Vec<_> = declared.iter().map(|metric| metric.name.as_str()).collect();
    let mut recorded: Vec<_> = record.names().iter().map(String::as_str).collect();
    declared.sort_unstable();
    recorded.sort_unstable();
    assert_eq!(recorded, declared);
}

/// Asserts that the exported policy takes the agent's evaluation actions.
pub fn assert_exports(agent: &mut dyn Agent) {
    let dir = tempfile::tempdir().unwrap();
    assert!(agent.export(dir.path()).unwrap());
    let observation = Observation {
        seats: vec![vec![0.3]],
        state: Vec::new(),
    };
    let action = agent
        .act(
            &[observation],
            Mode::Evaluate,
            &mut contract::random::stream(&["x"]),
        )
        .unwrap()
        .remove(0)
        .remove(0);
    let exported = Policy::read(dir.path()).unwrap().act(&[0.3]);
    assert!(
        action.iter().zip(&exported).all(|(a, b)| (a - b).abs() < 1e-6),
        "{action:?} {exported:?}"
    );
}

/// Asserts that an agent which imports another agent's policy takes its evaluation actions to the bit, and
/// that a policy with other channels is refused.
pub fn assert_imports(build: impl Fn(&Interface, &mut Rng) -> Box<dyn Agent>) {
    let stream = |name: &str| contract::random::stream(&["imports", name]);
    let (mut one, mut two) = (
        build(&interface(), &mut stream("one")),
        build(&interface(), &mut stream("two")),
    );
    train(one.as_mut(), 6, &mut stream("train"));
    let dir = tempfile::tempdir().unwrap();
    assert!(one.export(dir.path()).unwrap());
    let seen = [0.3, -0.7].map(|x| Observation {
        seats: vec![vec![x]],
        state: Vec::new(),
    });
    let act = |agent: &mut dyn Agent| agent.act(&seen, Mode::Evaluate, &mut stream("act")).unwrap();
    assert_ne!(act(one.as_mut()), act(two.as_mut()));
    assert!(two.import(dir.path()).unwrap());
    assert_eq!(act(one.as_mut()), act(two.as_mut()));
    assert!(matches!(
        two.import(&dir.path().join("nowhere")),
        Err(contract::Error::File { .. })
    ));
    let mut other = build(
        &crate::shared::seat::tests::allocation(&["y"], &["best_1", "best_2", "best_3"], 3),
        &mut stream("one"),
    );
    let refusal = other.import(dir.path()).unwrap_err().to_string();
    assert!(
        refusal.contains("`inputs` of the policy is [\"x\"], here [\"y\"]"),
        "{refusal}"
    );
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum()
}
