//! Helpers for the tests of the algorithms with opponent models.

use super::{Algorithm, GaussianNetwork, Learner, PREDICTION_ERROR, Player, SeatUpdate, Settings};
use crate::shared::{
    batch::{Batch, BatchInputs},
    coordination,
    gradient_checks::{assert_gradient_in, outputs},
    joint::ObservationScope,
    population,
};
use contract::{Agent, Metric, Mode, Observation, random::stream};
use numerics::activation::Activation;
use plan::{Equations, Expression, Processor};

/// Settings for small networks that learn fast.
pub(crate) fn tiny() -> Settings {
    let (width, batch_size, learning_starts) = (16, 32, 32);
    Settings {
        width,
        batch_size,
        learning_starts,
        updates_per_step: 0.5,
        learning_rate: 3e-3,
        ..Settings::default()
    }
}

/// Settings of small networks with nothing between a loss and its gradient: no clipping, no normalisation.
pub(crate) fn plain() -> Settings {
    Settings {
        input_normalisation: false,
        gradient_clip: None,
        stale_policy_step: false,
        width: 6,
        ..tiny()
    }
}

/// Builds an agent for the coordination game.
pub(crate) fn learner<A: Algorithm>(algorithm: A) -> Learner<A> {
    Learner::new(algorithm, &coordination::game(), &mut stream(&["learner"])).unwrap()
}

/// `n` transitions of the untrained agent, as its first seat learns from them.
pub(crate) fn batch<A: Algorithm>(learner: &mut Learner<A>, n: usize) -> Batch {
    let mut rng = stream(&["batch"]);
    let mut transitions = coordination::decide(learner, 2 * n, &mut rng);
    transitions
        .iter_mut()
        .for_each(|transition| transition.next_observation.seats[1][0] += 0.5);
    transitions
        .iter()
        .for_each(|transition| learner.replay.push(transition));
    learner.config.batch_size = n;
    learner.batches(&mut rng).of_seats.remove(0)
}

/// Begins the routine `loss`, in which a seat learns from a batch of `n_rows`.
pub(crate) fn begin<'g, 'e, A>(
    learner: &'g Learner<A>,
    seat: usize,
    n_rows: usize,
    equations: &'e Equations,
) -> SeatUpdate<'g, 'e> {
    equations.routine("loss");
    SeatUpdate {
        game: &learner.game,
        settings: &learner.config,
        seat,
        batch: BatchInputs::new(equations, n_rows, learner.replay.widths()),
        repeats: false,
    }
}

/// An expression of a seat's update, row by row. Its draws are those of any other that draws as often before.
pub(crate) fn computed<A>(
    learner: &Learner<A>,
    seat: usize,
    batch: &Batch,
    write: impl for<'e> FnOnce(SeatUpdate<'_, 'e>) -> Expression<'e>,
) -> Vec<f32> {
    let [found] = outputs(["found"], &learner.state, batch, |equations| {
        let found = write(begin(learner, seat, batch.n_rows, equations));
        equations.output("found", found);
    });
    found
}

/// Gradient of a loss of the first seat in all parameters of a network, concatenated.
pub(crate) fn gradient<A>(
    learner: &Learner<A>,
    network: &GaussianNetwork,
    batch: &Batch,
    write: impl for<'e> FnOnce(SeatUpdate<'_, 'e>) -> Expression<'e>,
) -> Vec<f32> {
    computed(learner, 0, batch, |update| {
        let loss = write(update);
        let equations = loss.equations();
        let gradients = equations.gradients(loss, &network.network().parameters(equations));
        let rows = gradients.iter().map(|gradient| {
            let [rows, columns] = gradient.shape();
            gradient.reshape([1, rows * columns])
        });
        equations.join(&rows.collect::<Vec<_>>())
    })
}

/// Euclidean norm.
pub(crate) fn norm(x: &[f32]) -> f32 {
    x.iter().map(|x| x * x).sum::<f32>().sqrt()
}

/// Euclidean distance.
pub(crate) fn distance(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b) * (a - b))
        .sum::<f32>()
        .sqrt()
}

/// Asserts that the gradient of a loss of the first seat in every parameter of a network agrees with finite
/// differences, at fixed noise.
pub(crate) fn assert_gradient<A: Algorithm>(
    algorithm: A,
    network: impl Fn(&Player) -> &GaussianNetwork,
    loss: impl for<'e> Fn(SeatUpdate<'_, 'e>) -> Expression<'e>,
) {
    // A rectifier that switches within a step would blur the differences.
    let settings = Settings {
        activation: Activation::Tanh,
        ..*algorithm.settings()
    };
    let rng = &mut stream(&["learner"]);
    let mut learner = Learner::with_settings(algorithm, settings, &coordination::game(), rng).unwrap();
    let batch = batch(&mut learner, 12);
    let network = network(&learner.game.players[0]);
    assert!(norm(&gradient(&learner, network, &batch, &loss)) > 1e-2);
    let names = network.network().parameter_names();
    assert_gradient_in(&names, &learner.state, &batch, |equations| {
        equations.output("loss", loss(begin(&learner, 0, 12, equations)));
    });
}

/// Asserts that a step of a seat changes the parameters of the named network and of no other, critics included.
pub(crate) fn assert_moves_only<A: Algorithm>(
    learner: &Learner<A>,
    seat: usize,
    batch: &Batch,
    network: &str,
    step: impl FnOnce(SeatUpdate<'_, '_>),
) {
    let equations = Equations::new();
    step(begin(learner, seat, batch.n_rows, &equations));
    let mut processor = Processor::<f32>::new(equations.into_graph());
    batch.write(&mut processor);
    let mut after = learner.state.clone();
    processor.run_seeded("loss", &mut after, 3);
    for (name, _, entries) in learner.state.tensors() {
        let is_own = name.starts_with(&format!("{network}."));
        assert_eq!(
            after.entries(name) != entries,
            is_own && !name.contains(".running_"),
            "{name}"
        );
    }
}

/// Asserts that the agent earns most of the possible reward in the coordination game.
pub(crate) fn assert_learns<A: Algorithm>(algorithm: A) {
    let mut rng = stream(&["coordinate"]);
    let mut learner = learner(algorithm);
    let before = coordination::score(&mut learner, &mut rng);
    let record = coordination::train(&mut learner, 150, &mut rng);
    let after = coordination::score(&mut learner, &mut rng);
    assert!(
        after > -0.2 && after > 0.5 * before,
        "{before} {after} {record:?}"
    );
}

/// Asserts that an agent with other initial weights acts and predicts like the agent whose export it imports.
pub(crate) fn assert_exports<A: Algorithm>(algorithm: A) {
    let mut one = learner(algorithm.clone());
    coordination::train(&mut one, 8, &mut stream(&["train"]));
    let dir = tempfile::tempdir().unwrap();
    assert!(one.export(dir.path()).unwrap());
    let mut two = Learner::new(algorithm, &coordination::game(), &mut stream(&["another start"])).unwrap();
    let seen = [-0.7, 0.2].map(|x| Observation {
        seats: vec![vec![x], vec![x]],
        state: Vec::new(),
    });
    let act = |learner: &mut Learner<A>| learner.act(&seen, Mode::Evaluate, &mut stream(&["x"])).unwrap();
    assert_ne!(act(&mut one), act(&mut two));
    assert!(two.import(dir.path()).unwrap());
    let actions = act(&mut one);
    assert_eq!(act(&mut two), actions);
    let errors = one.assess(&seen, &actions).unwrap();
    assert_eq!(two.assess(&seen, &actions).unwrap(), errors);
    assert!(
        errors.len() == 2
            && errors
                .iter()
                .all(|row| row.len() == 2 && row.iter().all(|error| *error > 0.0))
    );
}

/// Asserts that a trained agent records exactly the declared training metrics, and declares the metric of its
/// decisions.
pub(crate) fn assert_declared<A: Algorithm>(algorithm: A, declared: Vec<Metric>) {
    let mut learner = learner(algorithm);
    let of_decisions = learner.decision_metrics();
    assert!(of_decisions.len() == 1 && declared.contains(&of_decisions[0]));
    let of_training: Vec<_> = declared
        .into_iter()
        .filter(|metric| metric.name != PREDICTION_ERROR)
        .collect();
    coordination::assert_declared(&mut learner, &of_training);
}

/// Asserts that the observation of another seat changes a seat's action where sight is joint, and only there;
/// that such an agent learns; and that its export fits only an agent of the same sight.
pub(crate) fn assert_sight<A: Algorithm>(algorithm: impl Fn(Settings) -> A) {
    let first_action = |learner: &mut Learner<A>, of_other: f64| {
        let seen = Observation {
            seats: vec![vec![0.3], vec![of_other]],
            state: Vec::new(),
        };
        learner.act(&[seen], Mode::Evaluate, &mut stream(&["x"])).unwrap()[0][0].clone()
    };
    let agent = |sight| learner(algorithm(Settings { sight, ..tiny() }));
    let [mut own, mut joint] = [Some(ObservationScope::Own), None].map(agent);
    assert_eq!(first_action(&mut own, -0.6), first_action(&mut own, 0.6));
    assert_ne!(first_action(&mut joint, -0.6), first_action(&mut joint, 0.6));
    let untrained = first_action(&mut own, 0.0);
    coordination::train(&mut own, 8, &mut stream(&["train"]));
    assert_ne!(first_action(&mut own, 0.0), untrained);
    let dir = tempfile::tempdir().unwrap();
    own.export(dir.path()).unwrap();
    assert!(joint.import(dir.path()).is_err());
    let mut another = agent(Some(ObservationScope::Own));
    assert!(another.import(dir.path()).unwrap());
    assert_eq!(first_action(&mut another, 0.0), first_action(&mut own, 0.0));
}

/// Asserts that members of a population of the algorithm learn as trials alone.
pub(crate) fn assert_members_learn_as_alone<A: Algorithm + Clone + Sync>(algorithm: &A) {
    population::assert_members_learn_as_alone(
        |rng| Learner::new(algorithm.clone(), &coordination::game(), rng).unwrap(),
        |learner| std::slice::from_mut(&mut learner.learning),
        |learner, rng| drop(coordination::train(learner, 5, rng)),
    );
}
