//! A tiny game for the tests of agents that play several seats. All seats earn the same, and one alone can
//! earn little.

use contract::{
    Agent, Channel, End, Interface, Metric, Mode, Observation, Recorder, Rng, Seat, Space, Transition,
};
use numerics::policy_file::Policy;
use rand::Rng as _;

/// Interface with one seat per entry, which observes and acts with these numbers of entries.
pub fn interface(observed: &[usize], acted: &[usize]) -> Interface {
    let channels = |word: &str, seat: usize, n: usize| {
        (0..n)
            .map(|i| Channel::new(format!("{word}_{seat}_{i}"), "").within(-1.0, 1.0))
            .collect::<Vec<_>>()
    };
    let seat = |(seat, (observed, acted)): (usize, (&usize, &usize))| Seat {
        name: format!("seat_{seat}"),
        observation: Space::Box(channels("see", seat, *observed)),
        action: Space::Box(channels("act", seat, *acted)),
    };
    Interface {
        seats: observed.iter().zip(acted).enumerate().map(seat).collect(),
        state: Vec::new(),
    }
}

/// Interface of two seats that both observe one number `x` and choose one number each.
pub fn game() -> Interface {
    interface(&[1, 1], &[1, 1])
}

/// Common reward: the first seat should do `x / 2`, the second the opposite of the first.
fn reward(x: f64, action: &[Vec<f64>]) -> f64 {
    -(action[0][0] - 0.5 * x).powi(2) - (action[0][0] + action[1][0]).powi(2)
}

/// Draws `n` random observations and lets the agent decide on each in training mode.
pub fn decide(agent: &mut dyn Agent, n: usize, rng: &mut Rng) -> Vec<Transition> {
    let seen: Vec<f64> = (0..n).map(|_| rng.random_range(-1.0..1.0)).collect();
    let observations: Vec<Observation> = seen.iter().map(|x| observe(*x)).collect();
    let actions = agent.act(&observations, Mode::Train, rng).unwrap();
    let transition = |(observation, action): (Observation, contract::Action)| {
        let rewards = vec![reward(observation.seats[0][0], &action); 2];
        let next_observation = observation.clone();
        Transition {
            observation,
            action,
            rewards,
            next_observation,
            end: Some(End::Terminated),
        }
    };
    observations.into_iter().zip(actions).map(transition).collect()
}

/// Trains for `rounds` rounds of 8 decisions.
pub fn train(agent: &mut dyn Agent, rounds: usize, rng: &mut Rng) -> Recorder {
    let mut record = Recorder::default();
    for _ in 0..rounds {
        let transitions = decide(agent, 8, rng);
        agent.learn(&transitions, rng, &mut record).unwrap();
    }
    record
}

/// Mean reward of the evaluated actions over 21 observations; the best possible is 0.
pub fn score(agent: &mut dyn Agent, rng: &mut Rng) -> f64 {
    let seen: Vec<f64> = (0..=20).map(|i| f64::from(i) / 10.0 - 1.0).collect();
    let observations: Vec<_> = seen.iter().map(|x| observe(*x)).collect();
    let actions = agent.act(&observations, Mode::Evaluate, rng).unwrap();
    actions
        .iter()
        .zip(&seen)
        .map(|(action, x)| reward(*x, action))
        .sum::<f64>()
        / 21.0
}

/// Asserts that an agent restored from a checkpoint makes the same updates and takes the same actions as the
/// agent that was not interrupted.
pub fn assert_continues(build: impl Fn(&mut Rng) -> Box<dyn Agent>) {
    let mut rng = contract::random::stream(&["continues"]);
    let mut one = build(&mut rng);
    train(one.as_mut(), 8, &mut rng);
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
    let mut record = train(agent, 8, &mut contract::random::stream(&["record"]));
    record.flush_means(1);
    let mut declared: Vec<_> = declared.iter().map(|metric| metric.name.as_str()).collect();
    let mut recorded: Vec<_> = record.names().iter().map(String::as_str).collect();
    declared.sort_unstable();
    recorded.sort_unstable();
    assert_eq!(recorded, declared);
}

fn observe(x: f64) -> Observation {
    Observation {
        seats: vec![vec![x], vec![x]],
        state: Vec::new(),
    }
}

/// Asserts that the exported policies take the agent's evaluation actions; the policy of each seat reads
/// `observed` entries.
pub fn assert_exports(agent: &mut dyn Agent, x: f64, observed: usize) {
    let dir = tempfile::tempdir().unwrap();
    assert!(agent.export(dir.path()).unwrap());
    let action = agent
        .act(
            &[observe(x)],
            Mode::Evaluate,
            &mut contract::random::stream(&["x"]),
        )
        .unwrap()
        .remove(0);
    for (seat, action) in action.iter().enumerate() {
        let policy = Policy::read(&dir.path().join(format!("seat_{seat}"))).unwrap();
        assert!(
            (action[0] - policy.act(&vec![x; observed])[0]).abs() < 1e-6,
            "{action:?}"
        );
    }
}
