//! Tests of the policy, and datasets for tests of the agents with it.

use super::*;
use crate::shared::gradient_checks::computed;
use contract::{Agent, Channel, Mode, Recorder};
use rand::Rng as _;

/// One observed channel `x` and one action in a box with limits -1 and 1.
pub(crate) fn cube() -> Interface {
    let mut interface = crate::shared::bandit::interface();
    interface.seats[0].action = Space::Box(vec![Channel::new("force", "").within(-1.0, 1.0)]);
    interface
}

/// `n` decisions `act(x)` of one-step episodes with `x` uniform in `[-1, 1]`, each earning `reward(x,
/// action)`.
pub(crate) fn decisions(
    n: usize,
    rng: &mut Rng,
    act: impl Fn(f64, &mut Rng) -> Vec<f64>,
    reward: impl Fn(f64, &[f64]) -> f64,
) -> Vec<Transition> {
    let decide = |rng: &mut Rng| {
        let x = rng.random_range(-1.0..1.0);
        let action = act(x, rng);
        let observation = Observation {
            seats: vec![vec![x]],
            state: Vec::new(),
        };
        let (rewards, next_observation) = (vec![reward(x, &action)], observation.clone());
        Transition {
            observation,
            action: vec![action],
            rewards,
            next_observation,
            end: Some(End::Terminated),
        }
    };
    (0..n).map(|_| decide(rng)).collect()
}

/// Trains an agent on batches of 64 drawn from `data`, as the protocol does.
pub(crate) fn fit(agent: &mut dyn Agent, data: &[Transition], batches: usize, rng: &mut Rng) -> Recorder {
    let mut record = Recorder::default();
    agent.observe_dataset(data).unwrap();
    for _ in 0..batches {
        let batch: Vec<_> = (0..64)
            .map(|_| data[rng.random_range(0..data.len())].clone())
            .collect();
        agent.learn(&batch, rng, &mut record).unwrap();
    }
    record
}

/// Asserts that an agent trained on a widely spread dataset keeps its scaling when it is restored and
/// when its policy is imported.
pub(crate) fn assert_scaling_is_kept(build: impl Fn(&mut Rng) -> Box<dyn Agent>) {
    let stream = |name: &str| contract::random::stream(&["scaling", name]);
    let mut data = decisions(50, &mut stream("data"), |_, _| vec![0.2, 0.3, 0.5], |_, _| 1.0);
    for transition in &mut data {
        transition.observation.seats[0][0] = 1e3 + 50.0 * transition.observation.seats[0][0];
    }
    let [mut one, mut two, mut three] = ["one", "two", "three"].map(|name| build(&mut stream(name)));
    fit(one.as_mut(), &data, 3, &mut stream("fit"));
    let seen = [960.0, 1_000.0, 1_040.0].map(|x| Observation {
        seats: vec![vec![x]],
        state: Vec::new(),
    });
    let act = |agent: &mut dyn Agent| agent.act(&seen, Mode::Evaluate, &mut stream("act")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    one.save(folder.path()).unwrap();
    assert!(one.export(folder.path()).unwrap());
    two.load(folder.path()).unwrap();
    assert!(three.import(folder.path()).unwrap());
    let expected = act(one.as_mut());
    assert_eq!(act(two.as_mut()), expected);
    assert_eq!(act(three.as_mut()), expected);
    let mut record = Recorder::default();
    for agent in [&mut one, &mut two] {
        agent.learn(&data, &mut stream("next"), &mut record).unwrap();
    }
    assert_eq!(act(two.as_mut()), act(one.as_mut()));
}

fn form(scale_by: ScalingSource) -> ActorSettings {
    ActorSettings {
        width: 8,
        layers: 2,
        scale_by,
    }
}

fn actor(scale_by: ScalingSource, interface: &Interface) -> DatasetActor {
    DatasetActor::new(
        "tested",
        &form(scale_by),
        interface,
        &mut contract::random::stream(&["actor"]),
    )
    .unwrap()
}

fn seen(values: &[f64]) -> Vec<Transition> {
    let observe = |x: f64| Observation {
        seats: vec![vec![x]],
        state: Vec::new(),
    };
    let transition = |x: &f64| Transition {
        observation: observe(*x),
        action: vec![vec![0.5]],
        rewards: vec![2.0],
        next_observation: observe(x + 1.0),
        end: (*x > 5.0).then_some(End::Truncated),
    };
    values.iter().map(transition).collect()
}

#[test]
fn observations_are_scaled_by_the_dataset() {
    // Mean 4, deviation sqrt((9 + 1 + 1 + 9) / 4) = sqrt(5), and a thousandth of the typical deviation 1.
    let data = seen(&[1.0, 3.0, 5.0, 7.0]);
    let spread = 5f64.sqrt() + 1e-3;
    let mut actor = actor(ScalingSource::Dataset, &cube());
    actor.observe_dataset(&data);
    let batch = actor.batch(&data);
    let close = |found: &[f32], expected: [f64; 4]| {
        assert!(
            found
                .iter()
                .zip(expected)
                .all(|(a, b)| (f64::from(*a) - b).abs() < 1e-6),
            "{found:?} {expected:?}"
        );
    };
    close(&batch.observations, [-3.0, -1.0, 1.0, 3.0].map(|x| x / spread));
    close(
        &batch.next_observations,
        [-2.0, 0.0, 2.0, 4.0].map(|x| x / spread),
    );
    assert_eq!((batch.actions, batch.rewards), (vec![0.5; 4], vec![2.0; 4]));
    assert_eq!(batch.continues, [1.0; 4], "an episode that was cut off goes on");
    let constant = seen(&[2.0, 2.0]);
    actor.observe_dataset(&constant);
    assert_eq!(actor.batch(&constant).observations, [0.0; 2]);
}

#[test]
fn other_scalings_do_not_depend_on_the_dataset() {
    for (scale_by, expected) in [(ScalingSource::Typical, 2.0), (ScalingSource::Nothing, 7.0)] {
        let mut interface = cube();
        interface.seats[0].observation = Space::Box(vec![Channel::new("x", "").typical(3.0, 2.0)]);
        let mut actor = actor(scale_by, &interface);
        actor.observe_dataset(&seen(&[100.0]));
        assert_eq!(actor.batch(&seen(&[7.0])).observations, [expected]);
    }
}

#[test]
fn centred_actions_by_hand() {
    let centred = |set: ActionSet| {
        computed(|equations| set.centred(equations.constant([1, 4], &[0.25, 0.25, 0.5, 0.0])))
    };
    assert_eq!(centred(ActionSet::Simplex), [0.0, 0.0, 1.0, -1.0]);
    assert_eq!(centred(ActionSet::Cube), [0.25, 0.25, 0.5, 0.0]);
}

#[test]
fn limits_other_than_one_are_refused() {
    let mut interface = cube();
    interface.seats[0].action = Space::Box(vec![Channel::new("force", "N").within(0.0, 5.0)]);
    let refused = DatasetActor::new(
        "tested",
        &form(ScalingSource::Typical),
        &interface,
        &mut contract::random::stream(&["x"]),
    );
    let text = refused.unwrap_err().to_string();
    assert!(text.contains("within 0 and 5"), "{text}");
}
