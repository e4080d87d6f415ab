//! A tiny problem for the tests of agents that act in a box over several steps: a plant that does not return
//! to rest by itself.
//!
//! The dynamics are `x' = x + 0.5 a`, and the reward per step is `-(x^2 + 0.05 a^2)`. The agent observes `x`
//! and a second channel without information. Episodes start with `x` uniform in `[-1, 1]` and are cut off
//! after 10 steps. Doing nothing keeps `x` where it is.

use contract::{
    Agent, Channel, End, Interface, Metric, Mode, Observation, Recorder, Rng, Seat, Space, Transition,
};
use numerics::policy_file::Policy;
use rand::Rng as _;

/// Number of steps of an episode.
const EPISODE: u32 = 10;
/// Number of plants that are stepped in parallel while learning.
const N_PLANTS: usize = 8;

/// Interface of one seat with two observed channels and one entry of the action.
pub fn interface() -> Interface {
    let seat = Seat {
        name: String::new(),
        observation: Space::Box(vec![Channel::new("x", ""), Channel::new("nothing", "")]),
        action: Space::Box(vec![Channel::new("push", "").within(-1.0, 1.0)]),
    };
    Interface {
        seats: vec![seat],
        state: Vec::new(),
    }
}

/// Plants that are stepped in parallel, each at a different step of its episode.
#[derive(Debug, Clone)]
pub struct Plants {
    places: Vec<(f64, u32)>,
    /// Constant added to every reward.
    pub bonus: f64,
}

impl Plants {
    /// Plants at random starts, with episodes that end at different steps.
    pub fn new(rng: &mut Rng) -> Self {
        let place = |at: usize| (rng.random_range(-1.0..1.0), (at as u32) % EPISODE);
        Self {
            places: (0..N_PLANTS).map(place).collect(),
            bonus: 0.0,
        }
    }

    /// Steps every plant once with the agent's training actions.
    pub fn step(&mut self, agent: &mut dyn Agent, rng: &mut Rng) -> Vec<Transition> {
        let observations: Vec<_> = self.places.iter().map(|(x, _)| observe(*x)).collect();
        let actions = agent.act(&observations, Mode::Train, rng).unwrap();
        let mut transitions = Vec::new();
        for (at, (observation, action)) in observations.into_iter().zip(actions).enumerate() {
            let (x, steps) = &mut self.places[at];
            let (next, reward) = advance(*x, action[0][0]);
            *steps += 1;
            let end = (*steps == EPISODE).then_some(End::Truncated);
            transitions.push(Transition {
                observation,
                action,
                rewards: vec![reward + self.bonus],
                next_observation: observe(next),
                end,
            });
            (*x, *steps) = end.map_or((next, *steps), |_| (rng.random_range(-1.0..1.0), 0));
        }
        transitions
    }
}

/// Next position of a plant, and the reward.
fn advance(x: f64, action: f64) -> (f64, f64) {
    (x + 0.5 * action, -(x * x + 0.05 * action * action))
}

/// Observation of a plant at `x`.
pub fn observe(x: f64) -> Observation {
    Observation {
        seats: vec![vec![x, 0.5]],
        state: Vec::new(),
    }
}

/// Lets an agent learn for `rounds` rounds of 8 steps.
pub fn train(agent: &mut dyn Agent, plants: &mut Plants, rounds: usize, rng: &mut Rng) -> Recorder {
    let mut record = Recorder::default();
    for _ in 0..rounds {
        let transitions = plants.step(agent, rng);
        agent.learn(&transitions, rng, &mut record).unwrap();
    }
    record
}

/// Evaluation action at each of these positions.
pub fn scored(agent: &mut dyn Agent, places: &[f64]) -> Vec<f64> {
    let seen: Vec<_> = places.iter().map(|x| observe(*x)).collect();
    let actions = agent.act(&seen, Mode::Evaluate, &mut contract::random::stream(&["scored"]));
    actions.unwrap().into_iter().map(|action| action[0][0]).collect()
}

/// Mean return of episodes that start at -1, -0.9, ..., 1, for a rule that acts on each position.
pub fn mean_return(mut act: impl FnMut(&[f64]) -> Vec<f64>) -> f64 {
    let mut places: Vec<f64> = (0..=20).map(|i| f64::from(i) / 10.0 - 1.0).collect();
    let mut sum = 0.0;
    for _ in 0..EPISODE {
        let actions = act(&places);
        for (x, action) in places.iter_mut().zip(actions) {
            let (next, reward) = advance(*x, action);
            *x = next;
            sum += reward;
        }
    }
    sum / 21.0
}

/// Asserts that an agent learns: after `rounds` rounds, and not before, its return is less than a third of
/// that of doing nothing and a fifth of that of random actions away from zero.
pub fn assert_learns(agent: &mut dyn Agent, rounds: usize) {
    let mut rng = contract::random::stream(&["regulator"]);
    let idle = mean_return(|places| vec![0.0; places.len()]);
    let random = mean_return(|places| places.iter().map(|_| rng.random_range(-1.0..1.0)).collect());
    let before = mean_return(|places| scored(agent, places));
    let mut plants = Plants::new(&mut rng);
    train(agent, &mut plants, rounds, &mut rng);
    let after = mean_return(|places| scored(agent, places));
    let learned = |score: f64| score > idle / 3.0 && score > random / 5.0;
    assert!(
        learned(after) && !learned(before),
        "{before} before, {after} after; idle {idle}, random {random}"
    );
}

/// Asserts that an agent restored from a checkpoint in the middle of episodes makes the same updates and
/// takes the same actions as the agent that was not interrupted.
pub fn assert_continues(build: impl Fn(&mut Rng) -> Box<dyn Agent>) {
    let mut rng = contract::random::stream(&["continues"]);
    let (mut one, mut plants) = (build(&mut rng), Plants::new(&mut rng));
    train(one.as_mut(), &mut plants, 13, &mut rng);
    let dir = tempfile::tempdir().unwrap();
    one.save(dir.path()).unwrap();
    let mut two = build(&mut contract::random::stream(&["another start"]));
    two.load(dir.path()).unwrap();
    assert!(
        two.updates() == one.updates() && two.updates().is_some_and(|updates| updates.made > 0),
        "{:?}",
        two.updates()
    );
    let go_on = |agent: &mut dyn Agent| {
        let (mut plants, mut rng) = (plants.clone(), rng.clone());
        let record = train(agent, &mut plants, 6, &mut rng);
        (format!("{record:?}"), plants.step(agent, &mut rng))
    };
    assert_eq!(go_on(one.as_mut()), go_on(two.as_mut()));
    assert!(matches!(
        two.load(&dir.path().join("nowhere")),
        Err(contract::Error::File { .. })
    ));
}

/// Asserts that a trained agent records exactly these metrics.
pub fn assert_records(agent: &mut dyn Agent, expected: &[&str]) {
    let mut rng = contract::random::stream(&["record"]);
    let mut plants = Plants::new(&mut rng);
    let mut record = train(agent, &mut plants, 13, &mut rng);
    record.flush_means(1);
    let mut expected = expected.to_vec();
    let mut recorded: Vec<_> = record.names().iter().map(String::as_str).collect();
    expected.sort_unstable();
    recorded.sort_unstable();
    assert_eq!(recorded, expected);
}

/// Names of declared metrics.
pub fn names(declared: &[Metric]) -> Vec<&str> {
    declared.iter().map(|metric| metric.name.as_str()).collect()
}

/// Asserts that the exported policy takes the agent's evaluation actions, and that a new agent imports it.
pub fn assert_exports(build: impl Fn(&mut Rng) -> Box<dyn Agent>) {
    let mut rng = contract::random::stream(&["exports"]);
    let (mut one, mut two) = (build(&mut rng), build(&mut rng));
    let mut plants = Plants::new(&mut rng);
    train(one.as_mut(), &mut plants, 13, &mut rng);
    let dir = tempfile::tempdir().unwrap();
    assert!(one.export(dir.path()).unwrap());
    let action = scored(one.as_mut(), &[0.3])[0];
    let exported = Policy::read(dir.path()).unwrap().act(&[0.3, 0.5])[0];
    assert!((action - exported).abs() < 1e-6, "{action} {exported}");
    assert_ne!(scored(two.as_mut(), &[0.3])[0], action);
    assert!(two.import(dir.path()).unwrap());
    assert_eq!(scored(two.as_mut(), &[0.3])[0], action);
}
