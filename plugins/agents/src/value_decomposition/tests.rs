//! Tests of the agent as a whole and of its equations.

use super::*;
use crate::shared::{
    batch::Batch,
    gradient_checks::{assert_gradient, outputs},
};
use contract::{Channel, End, Seat, Space, random::stream};
use plan::Processor;
use std::collections::BTreeMap;

/// The two-step game of Rashid et al. 2018, section 5.1: in the first step the first seat chooses between two
/// matrix games. In one the team always earns 7; in the other 0, 1, 1 or 8.
mod two_step {
    use super::*;

    const SEEN: usize = 3;

    pub(super) fn interface() -> Interface {
        let channels = || {
            (0..SEEN)
                .map(|at| Channel::new(format!("is_{at}"), ""))
                .collect::<Vec<_>>()
        };
        let seat = |at: usize| Seat {
            name: format!("seat_{at}"),
            observation: Space::Box(channels()),
            action: Space::Discrete(vec!["a".into(), "b".into()]),
        };
        Interface {
            seats: vec![seat(0), seat(1)],
            state: channels(),
        }
    }

    pub(super) fn observation(state: usize) -> Observation {
        let seen: Vec<f64> = (0..SEEN).map(|at| f64::from(u8::from(at == state))).collect();
        Observation {
            seats: vec![seen.clone(); 2],
            state: seen,
        }
    }

    /// Next state, reward, and whether the episode ends.
    pub(super) fn play(state: usize, action: &Action) -> (usize, f64, bool) {
        let [one, two] = [action[0][0] > 0.5, action[1][0] > 0.5];
        match state {
            0 => (1 + usize::from(one), 0.0, false),
            1 => (0, 7.0, true),
            _ => (
                0,
                [[0.0, 1.0], [1.0, 8.0]][usize::from(one)][usize::from(two)],
                true,
            ),
        }
    }

    /// Return of the choices in evaluation.
    pub(super) fn score(agent: &mut dyn Agent) -> f64 {
        let (mut state, mut sum) = (0, 0.0);
        loop {
            let action = agent
                .act(&[observation(state)], Mode::Evaluate, &mut stream(&[]))
                .unwrap()
                .remove(0);
            let (next, reward, end) = play(state, &action);
            (state, sum) = (next, sum + reward);
            if end {
                return sum;
            }
        }
    }

    pub(super) fn train(agent: &mut dyn Agent, steps: usize, rng: &mut Rng) -> Recorder {
        let (mut record, mut state) = (Recorder::default(), 0);
        for _ in 0..steps {
            let action = agent
                .act(&[observation(state)], Mode::Train, rng)
                .unwrap()
                .remove(0);
            let (next, reward, end) = play(state, &action);
            let transition = Transition {
                observation: observation(state),
                action,
                rewards: vec![reward; 2],
                next_observation: observation(next),
                end: end.then_some(End::Terminated),
            };
            agent.learn(&[transition], rng, &mut record).unwrap();
            state = next;
        }
        record
    }
}

fn tiny(mixing: ValueMixing) -> Config {
    Config {
        mixing,
        width: 16,
        mixing_width: 8,
        batch_size: 32,
        learning_starts: 64,
        updates_per_step: 1.0,
        learning_rate: 5e-3,
        target_smoothing: 0.05,
        exploration_steps: 1_000_000,
        replay_capacity: 500,
        ..Config::default()
    }
}

fn agent(config: Config) -> ValueDecomposition {
    ValueDecomposition::new(config, &two_step::interface(), &mut stream(&["decomposition"])).unwrap()
}

fn trained(mixing: ValueMixing) -> (ValueDecomposition, Batch) {
    let mut agent = agent(tiny(mixing));
    two_step::train(&mut agent, 100, &mut stream(&["some"]));
    let batch = agent.replay.draw_distinct(6, &mut stream(&["batch"]));
    (agent, batch)
}

/// Writes a routine `loss` for a batch of 6.
fn write<'e>(agent: &ValueDecomposition, equations: &'e Equations) -> BatchInputs<'e> {
    let batch = BatchInputs::new(equations, 6, agent.replay.widths());
    equations.routine("loss");
    batch
}

/// Bits of parameters and moments by their names.
fn learned(agent: &ValueDecomposition) -> BTreeMap<&str, Vec<u32>> {
    let bits = |entries: &[f32]| entries.iter().map(|x| x.to_bits()).collect();
    let tensors = agent.state.tensors();
    tensors.map(|(name, _, entries)| (name, bits(entries))).collect()
}

/// QMIX learns that the second game is worth 8. With all choices equally likely a sum cannot represent this:
/// the nearest sums of two values to 0, 1, 1, 8 are -1.5, 2.5, 2.5 and 6.5, so that the first game looks
/// better (appendix B of the paper).
#[test]
fn the_two_step_game_is_solved_where_values_are_mixed_and_not_where_they_are_added() {
    for (mixing, expected) in [(ValueMixing::Monotonic, 8.0), (ValueMixing::Sum, 7.0)] {
        let mut agent = agent(tiny(mixing));
        two_step::train(&mut agent, 3000, &mut stream(&["game"]));
        assert_eq!(two_step::score(&mut agent), expected, "{mixing:?}");
    }
}

#[test]
fn options_as_numbers_are_learned_like_options_as_indices() {
    let named = contract::Choice::new("game", &["a", "b"]);
    let spaces = [
        Space::Discrete(named.options.clone()),
        Space::Choices(vec![named]),
    ];
    let mut agents = spaces.map(|space| {
        let mut interface = two_step::interface();
        interface
            .seats
            .iter_mut()
            .for_each(|seat| seat.action = space.clone());
        ValueDecomposition::new(tiny(ValueMixing::Monotonic), &interface, &mut stream(&["both"])).unwrap()
    });
    let (mut rngs, mut state) = ([stream(&["run"]), stream(&["run"])], 0);
    for _ in 0..120 {
        let mut taken = Vec::new();
        let seen = two_step::observation(state);
        let mut actions = Vec::new();
        for (agent, rng) in agents.iter_mut().zip(&mut rngs) {
            let action = agent
                .act(std::slice::from_ref(&seen), Mode::Train, rng)
                .unwrap()
                .remove(0);
            let seats = agent.learner.team.seats.iter().zip(&action);
            taken.push(
                seats
                    .map(|((_, seat), one)| seat.taken(one).unwrap())
                    .collect::<Vec<_>>(),
            );
            actions.push(action);
        }
        assert_eq!(taken[0], taken[1]);
        let (next, reward, end) = two_step::play(state, &actions[0]);
        for ((agent, rng), action) in agents.iter_mut().zip(&mut rngs).zip(actions) {
            let transition = Transition {
                observation: seen.clone(),
                action,
                rewards: vec![reward; 2],
                next_observation: two_step::observation(next),
                end: end.then_some(End::Terminated),
            };
            agent.learn(&[transition], rng, &mut Recorder::default()).unwrap();
        }
        state = next;
    }
    assert_eq!(learned(&agents[0]), learned(&agents[1]));
}

#[test]
fn a_sum_of_values_is_the_closest_sum() {
    let mut agent = agent(tiny(ValueMixing::Sum));
    two_step::train(&mut agent, 3000, &mut stream(&["sum"]));
    let q = agent.values(&[0.0, 0.0, 1.0].repeat(2));
    // Single steps of Adam leave some noise; the true values of the game would be 1.5 away.
    let sums = [q[0] + q[2], q[0] + q[3], q[1] + q[2], q[1] + q[3]];
    assert!(
        sums.iter()
            .zip([-1.5, 2.5, 2.5, 6.5])
            .all(|(a, b)| (a - b).abs() < 1.2),
        "{sums:?}"
    );
}

#[test]
fn independent_learners_earn_the_safe_game() {
    let mut agent = agent(tiny(ValueMixing::None));
    two_step::train(&mut agent, 3000, &mut stream(&["independent"]));
    // With a random partner a seat earns 0.5 or 4.5 in the second game, and 7 in the first.
    assert_eq!(two_step::score(&mut agent), 7.0);
}

#[test]
fn targets_are_of_the_targets_value_of_the_learned_choice() {
    for mixing in [ValueMixing::None, ValueMixing::Sum, ValueMixing::Monotonic] {
        let (agent, batch) = trained(mixing);
        let learner = &agent.learner;
        let [y, likes, of_all] = outputs(["y", "likes", "of_all"], &agent.state, &batch, |equations| {
            let inputs = write(&agent, equations);
            equations.output("y", learner.target(inputs, 0.99));
            let q = |network| learner.team.values(network, inputs.next_observations);
            equations.output("likes", q(&learner.networks.seat));
            equations.output("of_all", q(&learner.target.seat));
        });
        let (r, continues) = (&batch.rewards, &batch.continues);
        let width = batch.next_observations.len() / 6;
        let row = |i: usize| &batch.next_observations[width * i..width * (i + 1)];
        for i in 0..6 {
            let best = [0, 1].map(|seat| {
                let at = 4 * i + 2 * seat;
                of_all[at + usize::from(likes[at + 1] > likes[at])]
            });
            let expected: Vec<f32> = match (mixing, &learner.target.mixer) {
                (ValueMixing::None, _) => vec![
                    r[2 * i] + 0.99 * continues[i] * best[0],
                    r[2 * i + 1] + 0.99 * continues[i] * best[1],
                ],
                (ValueMixing::Sum, _) => vec![r[2 * i] + 0.99 * continues[i] * (best[0] + best[1])],
                (ValueMixing::Monotonic, Some(mixer)) => {
                    let mixed = mixed_alone(mixer, &agent.state, best, &row(i)[6..]);
                    vec![r[2 * i] + 0.99 * continues[i] * mixed]
                }
                _ => unreachable!("a monotonic mixture has a mixer"),
            };
            let n = expected.len();
            assert!(
                y[n * i..n * (i + 1)]
                    .iter()
                    .zip(expected)
                    .all(|(a, b)| (a - b).abs() < 1e-4),
                "{mixing:?} {i}"
            );
        }
    }
}

/// Mixed value of two seats' values and a state.
fn mixed_alone(mixer: &MonotonicMixer, state: &State<f32>, values: [f32; 2], full_state: &[f32]) -> f32 {
    let equations = Equations::new();
    let row = |entries: &[f32]| {
        let entries: Vec<f64> = entries.iter().map(|entry| f64::from(*entry)).collect();
        equations.constant([1, entries.len()], &entries)
    };
    equations.routine("mix");
    equations.output("mixed", mixer.apply(row(&values), row(full_state)));
    let mut processor = Processor::<f32>::new(equations.into_graph());
    processor.run("mix", &mut state.clone());
    processor.entries("mixed")[0]
}

/// The steps are so small that none crosses a kink of the activations or changes the choices of the target.
#[test]
fn gradients_of_the_loss_agree_with_finite_differences() {
    for mixing in [ValueMixing::None, ValueMixing::Sum, ValueMixing::Monotonic] {
        let (agent, batch) = trained(mixing);
        let learner = &agent.learner;
        let losses = |config: &Config| {
            outputs(["error", "loss"], &agent.state, &batch, |equations| {
                let inputs = write(&agent, equations);
                let (value, excess) = learner.value(inputs);
                let error = half_squared_error(value, learner.target(inputs, config.discount));
                equations.output("error", error);
                // An output has one name.
                equations.output("loss", loss(error, excess, config) * 1.0);
            })
        };
        let conservative = Config {
            conservatism: 0.7,
            ..tiny(mixing)
        };
        let [error, whole] = losses(&agent.config);
        assert_eq!(error, whole);
        let [error, whole] = losses(&conservative);
        assert!(whole > error);
        assert_gradient(&learner.networks.all(), &agent.state, &batch, |equations| {
            let inputs = write(&agent, equations);
            let (value, excess) = learner.value(inputs);
            let error = half_squared_error(value, learner.target(inputs, 0.99));
            equations.output("loss", loss(error, excess, &conservative));
        });
    }
}

#[test]
fn the_excess_by_hand() {
    let equations = Equations::new();
    equations.routine("excess");
    // For two seats: ln(1 + 3) - 0 and ln(1 + 1) - 0, independent of a constant added to both values of a
    // seat.
    let of_all = equations.constant([2, 2], &[0.0, 3f64.ln(), 90.0, 90.0]);
    let done = equations.constant([2, 1], &[0.0, 1.0]);
    equations.output("excess", excess(of_all, done));
    let mut processor = Processor::<f32>::new(equations.into_graph());
    processor.run("excess", &mut State::default());
    let found = processor.number("excess");
    assert!((found - (4f64.ln() + 2f64.ln()) / 2.0).abs() < 1e-5, "{found}");
}

/// Choices outside the data are not valued above those in the data, even where these earned little.
#[test]
fn choices_outside_the_data_are_held_down() {
    let lead = |conservatism: f64| {
        let mut agent = agent(Config {
            conservatism,
            ..tiny(ValueMixing::Sum)
        });
        let mut rng = stream(&["data"]);
        let step = || Transition {
            observation: two_step::observation(0),
            action: vec![vec![0.0], vec![0.0]],
            rewards: vec![-3.0, -3.0],
            next_observation: two_step::observation(0),
            end: Some(contract::End::Terminated),
        };
        let data: Vec<Transition> = (0..32).map(|_| step()).collect();
        let mut record = Recorder::default();
        (0..10).for_each(|_| agent.learn(&data, &mut rng, &mut record).unwrap());
        let seen = two_step::observation(0).seats.concat();
        #[allow(clippy::cast_possible_truncation, reason = "noughts and ones")]
        let row: Vec<f32> = seen.iter().map(|entry| *entry as f32).collect();
        let q = agent.values(&row);
        [q[0] - q[1], q[2] - q[3]]
    };
    assert!(lead(5.0).iter().all(|lead| *lead > 1.0), "{:?}", lead(5.0));
    assert!(lead(0.0).iter().all(|lead| *lead < 0.5), "{:?}", lead(0.0));
}

#[test]
fn exploration_declines_and_is_absent_in_evaluation() {
    let config = Config {
        exploration_steps: 100,
        ..Config::default()
    };
    let at = |step| config.exploration_at(step);
    assert!((at(0) - 1.0).abs() < 1e-12 && (at(50) - 0.525).abs() < 1e-12 && (at(500) - 0.05).abs() < 1e-12);
    let at_once = Config {
        exploration_steps: 0,
        ..config
    };
    assert!((at_once.exploration_at(0) - 0.05).abs() < 1e-12);
    let mut agent = agent(tiny(ValueMixing::Sum));
    let rows = vec![two_step::observation(1); 400];
    let mut chosen = |mode| agent.act(&rows, mode, &mut stream(&["rows"])).unwrap();
    let scored = chosen(Mode::Evaluate);
    assert!(scored.iter().all(|action| *action == scored[0]));
    let explored = chosen(Mode::Train);
    let ones = explored.iter().flatten().filter(|choice| choice[0] > 0.5).count();
    // 800 fair choices have a deviation of 14.
    assert!((330..470).contains(&ones), "{ones}");
}

#[test]
fn a_saved_agent_continues() {
    for mixing in [ValueMixing::None, ValueMixing::Monotonic] {
        let mut rng = stream(&["continues"]);
        let mut one = agent(tiny(mixing));
        two_step::train(&mut one, 100, &mut rng);
        let dir = tempfile::tempdir().unwrap();
        one.save(dir.path()).unwrap();
        let mut two = ValueDecomposition::new(
            tiny(mixing),
            &two_step::interface(),
            &mut stream(&["another start"]),
        )
        .unwrap();
        two.load(dir.path()).unwrap();
        assert!(two.updates() == one.updates() && two.updates().unwrap().made > 0);
        let (mut first, mut second) = (rng.clone(), rng);
        let records = (
            two_step::train(&mut one, 20, &mut first),
            two_step::train(&mut two, 20, &mut second),
        );
        assert_eq!(format!("{:?}", records.0), format!("{:?}", records.1));
        assert_eq!(learned(&one), learned(&two));
        assert!(matches!(
            two.load(&dir.path().join("nowhere")),
            Err(Error::File { .. })
        ));
    }
}

#[test]
fn recorded_metrics_are_declared() {
    let mut record = two_step::train(
        &mut agent(tiny(ValueMixing::Monotonic)),
        80,
        &mut stream(&["record"]),
    );
    record.flush_means(1);
    let mut recorded: Vec<_> = record.names().to_vec();
    recorded.sort_unstable();
    assert_eq!(recorded, ["exploration", "value", "value_loss"]);
}

#[test]
fn misfits_are_refused() {
    let refused = |change: &dyn Fn(&mut Config, &mut Interface)| {
        let (mut config, mut interface) = (tiny(ValueMixing::Monotonic), two_step::interface());
        change(&mut config, &mut interface);
        build(config, &interface, &mut stream(&["x"]))
            .err()
            .unwrap()
            .to_string()
    };
    assert!(refused(&|config, _| config.replay_capacity = 9).contains("`batch_size`"));
    assert!(refused(&|config, _| config.exploration = 0.01).contains("0.05 is above `exploration`, 0.01"));
    assert!(refused(&|_, all| all.state.clear()).contains("reads the full state"));
    assert!(refused(&|_, all| all.seats.clear()).contains("no seats"));
    assert!(
        refused(&|_, all| all.seats[1].observation = Space::Box(Vec::new()))
            .contains("`seat_1` is not as seat `seat_0`")
    );
    assert!(
        refused(&|_, all| all.seats[1].action = Space::Discrete(vec!["a".into()]))
            .contains("`seat_1` is not as")
    );
    assert!(refused(&|_, all| all.seats[0].action = Space::Box(Vec::new())).contains("takes a box"));
}

#[test]
fn members_of_a_population_learn_as_trials_alone() {
    crate::shared::population::assert_members_learn_as_alone(
        |rng| ValueDecomposition::new(tiny(ValueMixing::Monotonic), &two_step::interface(), rng).unwrap(),
        |agent| std::slice::from_mut(&mut agent.learning),
        |agent, rng| drop(two_step::train(agent, 70, rng)),
    );
}
