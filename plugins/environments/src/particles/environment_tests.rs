//! Steps by hand or from other programs, scores of policies without skill, and refusals.

use super::*;
use ScenarioName::{CooperativeNavigation, PredatorPrey};
use Variant::{Mpe2, Openai, Thesis};
use rand::Rng as _;

const LANDMARKS: [Vector; 3] = [[0.0, 0.9], [-0.8, -0.1], [0.7, 0.7]];
const SPREAD: [Vector; 3] = [[0.1, 0.2], [-0.3, 0.4], [0.5, -0.6]];
const SPREAD_ACTIONS: [Vector; 3] = [[0.5, -0.25], [-1.0, 1.0], [0.3, 0.8]];
const CROWD: [Vector; 3] = [[0.0, 0.0], [0.2, 0.1], [-0.1, 0.25]];
const CROWD_ACTIONS: [Vector; 3] = [[0.1, 0.0], [0.0, -0.2], [0.3, 0.3]];
const HUNT: [Vector; 4] = [[0.1, 0.2], [-0.3, 0.4], [0.5, -0.6], [0.2, 0.25]];
const HUNT_ACTIONS: [Vector; 4] = [[0.5, -0.25], [-1.0, 1.0], [0.3, 0.8], [1.0, 0.2]];
const OBSTACLES: [Vector; 2] = [[0.6, 0.1], [-0.5, -0.5]];

fn config(scenario: ScenarioName, variant: Variant) -> ParticlesConfig {
    ParticlesConfig {
        scenario,
        variant,
        ..Default::default()
    }
}

/// The environment at a given start.
fn placed(variant: Variant, agents: &[Vector]) -> Particles {
    let (scenario, landmarks) = if agents.len() == 3 {
        (CooperativeNavigation, LANDMARKS.to_vec())
    } else {
        (PredatorPrey, OBSTACLES.to_vec())
    };
    let start = Start {
        agents: Some(agents.to_vec()),
        landmarks: Some(landmarks),
    };
    let mut particles = Particles::new(ParticlesConfig {
        start,
        ..config(scenario, variant)
    })
    .unwrap();
    particles.reset(&mut contract::random::stream(&[])).unwrap();
    particles
}

/// Repeats one joint action and returns the last step.
fn advance(particles: &mut Particles, actions: &[Vector], steps: usize) -> Step {
    let actions: Vec<Vec<f64>> = actions.iter().map(|action| action.to_vec()).collect();
    let mut rng = contract::random::stream(&[]);
    let mut last = particles.step(&actions, &mut rng).unwrap();
    for _ in 1..steps {
        last = particles.step(&actions, &mut rng).unwrap();
    }
    last
}

fn assert_places(particles: &Particles, expected: &[(usize, Vector)]) {
    for (agent, position) in expected {
        let ours = particles.world().agents()[*agent].position;
        assert!(
            (0..2).all(|axis| (ours[axis] - position[axis]).abs() < 1e-9),
            "agent {agent}: {ours:?}, not {position:?}"
        );
    }
}

fn assert_rewards(step: &Step, expected: &[f64]) {
    let fits = step
        .rewards
        .iter()
        .zip(expected)
        .all(|(ours, theirs)| (ours - theirs).abs() < 1e-9);
    assert!(
        fits && step.rewards.len() == expected.len(),
        "{:?}, not {expected:?}",
        step.rewards
    );
}

#[test]
fn navigation_without_contacts() {
    for (variant, rewards) in [
        (Thesis, [-3.0509687578773588, -3.6023019544546466]),
        (Openai, [3.0 * -3.0509687578773588, 3.0 * -3.6023019544546466]),
    ] {
        let mut particles = placed(variant, &SPREAD);
        assert_rewards(&advance(&mut particles, &SPREAD_ACTIONS, 1), &[rewards[0]; 3]);
        assert_places(
            &particles,
            &[(0, [0.125, 0.1875]), (1, [-0.35, 0.45]), (2, [0.515, -0.56])],
        );
        let velocity = particles.world().agents()[2].velocity;
        assert!(
            (velocity[0] - 0.15).abs() < 1e-12 && (velocity[1] - 0.4).abs() < 1e-12,
            "{velocity:?}"
        );
        assert_rewards(&advance(&mut particles, &SPREAD_ACTIONS, 4), &[rewards[1]; 3]);
        let end = [
            (0, [0.37119140625, 0.064404296875]),
            (1, [-0.8423828125, 0.9423828125]),
            (2, [0.66271484375, -0.16609375]),
        ];
        assert_places(&particles, &end);
        assert!((particles.world().agents()[1].velocity[0] + 1.525390625).abs() < 1e-12);
    }
}

#[test]
fn positions_lag_in_mpe2() {
    let mut particles = placed(Mpe2, &SPREAD);
    assert_rewards(
        &advance(&mut particles, &SPREAD_ACTIONS, 1),
        &[-1.0356134691308714; 3],
    );
    assert_places(&particles, &[(0, SPREAD[0]), (1, SPREAD[1]), (2, SPREAD[2])]);
    assert_rewards(
        &advance(&mut particles, &SPREAD_ACTIONS, 4),
        &[-1.1585279868456644; 3],
    );
    let end = [
        (0, [0.294921875, 0.1025390625]),
        (1, [-0.68984375, 0.78984375]),
        (2, [0.616953125, -0.288125]),
    ];
    assert_places(&particles, &end);
}

#[test]
fn navigation_with_contacts() {
    for (variant, share) in [(Thesis, 1.0), (Openai, 3.0)] {
        let mut particles = placed(variant, &CROWD);
        assert_rewards(
            &advance(&mut particles, &CROWD_ACTIONS, 1),
            &[share * -3.0827634524450898; 3],
        );
        let first = [
            (0, [-0.051910954393743616, -0.06270708591556516]),
            (1, [0.2683281572999747, 0.12416407864998737]),
            (2, [-0.09641720290623113, 0.2935430072655778]),
        ];
        assert_places(&particles, &first);
        assert_rewards(
            &advance(&mut particles, &CROWD_ACTIONS, 2),
            &[share * -2.8718356594876355; 3],
        );
        let third = [
            (0, [-0.10629408203553212, -0.14501013617974443]),
            (1, [0.3580088637561915, 0.1283794318780958]),
            (2, [-0.05046478172065946, 0.3919432043016487]),
        ];
        assert_places(&particles, &third);
    }
}

/// Two agents overlap, the third is alone; every landmark is 1 away from the nearest agent of the pair.
#[test]
fn variants_differ_in_the_agents_that_pay_for_a_collision() {
    let apart = [[0.0, 0.0], [0.2, 0.0], [5.0, 0.0]];
    for (variant, expected) in [
        (Thesis, |c: f64| [c - 2.0, c - 2.0, c - 1.0]),
        (Openai, |c: f64| [3.0 * c - 5.0; 3]),
        (Mpe2, |c: f64| [0.5 * c - 0.5, 0.5 * c - 0.5, 0.5 * c]),
    ] as [(Variant, fn(f64) -> [f64; 3]); 3]
    {
        let particles = placed(variant, &apart);
        let (rewards, metrics) = particles.scenario.assess(particles.world());
        let [(_, total), (_, collisions), (_, distance)] = metrics[..] else {
            panic!("{metrics:?}")
        };
        assert_eq!(rewards, expected(-distance), "{variant:?}");
        assert_eq!((total, collisions), (rewards.iter().sum(), 1.0));
    }
}

#[test]
fn a_hunt_in_the_thesis() {
    let mut particles = placed(Thesis, &HUNT);
    let reward = 0.17752923617230087;
    let step = advance(&mut particles, &HUNT_ACTIONS, 1);
    assert_rewards(&step, &[-reward, -reward, -reward, reward]);
    assert!((step.metric("score").unwrap() - 2.0 * reward).abs() < 1e-9);
    assert_eq!(step.metric("catches"), Some(0.0));
    let places = [
        (0, [0.13319659946414855, 0.17159829973207427]),
        (1, [-0.37071067811865477, 0.4707106781186548]),
        (2, [0.527, -0.528]),
        (3, [0.32694748568422566, 0.27800599718726904]),
    ];
    assert_places(&particles, &places);
    let prey = particles.world().agents()[3].velocity;
    assert!((prey[0] - 1.2694748568422565).abs() < 1e-9 && (prey[1] - 0.2800599718726905).abs() < 1e-9);
    let step = advance(&mut particles, &HUNT_ACTIONS, 4);
    assert!(
        (step.rewards[0] + 0.2682454428771904).abs() < 1e-9,
        "{:?}",
        step.rewards
    );
    assert_places(
        &particles,
        &[
            (0, [0.44842460483376406, -0.03993033132499272]),
            (3, [0.8336417031938675, 0.3940183766590695]),
        ],
    );
}

#[test]
fn a_hunt_in_the_other_programs() {
    let mut particles = placed(Openai, &HUNT);
    assert_rewards(&advance(&mut particles, &HUNT_ACTIONS, 1), &[0.0; 4]);
    assert_places(
        &particles,
        &[
            (0, [0.10319659946414854, 0.18659829973207429]),
            (3, [0.2518034005358515, 0.26390170026792575]),
        ],
    );
    advance(&mut particles, &HUNT_ACTIONS, 4);
    assert_places(&particles, &[(3, [0.6664111960948468, 0.369125426569666])]);
    let mut particles = placed(Mpe2, &HUNT);
    assert_rewards(
        &advance(&mut particles, &HUNT_ACTIONS, 1),
        &[10.0, 10.0, 10.0, -10.0],
    );
    assert_places(&particles, &[(0, HUNT[0]), (3, HUNT[3])]);
    let velocity = particles.world().agents()[0].velocity;
    assert!(
        (velocity[0] - 0.031965994641485376).abs() < 1e-9 && (velocity[1] + 0.1340170026792573).abs() < 1e-9
    );
}

#[test]
fn without_the_edge_a_hunt_is_zero_sum_in_the_thesis() {
    let mut particles = placed(Thesis, &HUNT);
    for _ in 0..3 {
        let step = advance(&mut particles, &HUNT_ACTIONS, 1);
        assert_eq!(step.rewards[3], -step.rewards[0]);
    }
}

/// Returns of every seat over `episodes` random starts.
fn returns(config: ParticlesConfig, episodes: usize, random: bool) -> Vec<Vec<f64>> {
    let mut particles = Particles::new(config).unwrap();
    let mut rng = contract::random::stream(&["baselines"]);
    let seats = particles.seats().len();
    let episode = |_| {
        particles.reset(&mut rng).unwrap();
        let mut returns = vec![0.0; seats];
        loop {
            let mut draw = || if random { rng.random_range(-1.0..1.0) } else { 0.0 };
            let actions: Vec<Vec<f64>> = (0..seats).map(|_| vec![draw(), draw()]).collect();
            let step = particles.step(&actions, &mut rng).unwrap();
            returns
                .iter_mut()
                .zip(&step.rewards)
                .for_each(|(sum, reward)| *sum += reward);
            if step.end.is_some() {
                return returns;
            }
        }
    };
    (0..episodes).map(episode).collect()
}

/// The mean of `values` agrees with the mean of 150 values of the other program, within four standard errors
/// of the difference.
fn assert_mean(values: &[f64], theirs: f64, what: &str) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values
        .iter()
        .map(|value| (value - mean) * (value - mean))
        .sum::<f64>()
        / (n - 1.0);
    let error = (variance * (1.0 / n + 1.0 / 150.0)).sqrt();
    assert!(
        (mean - theirs).abs() < 4.0 * error,
        "{what}: {mean} here, {theirs} there, standard error {error}"
    );
}

/// Mean returns over 150 episodes measured with the other programs.
#[test]
fn policies_without_skill_score_as_elsewhere() {
    for (variant, random, agent, total) in [(Thesis, true, -77.8, -233.6), (Thesis, false, -71.1, -213.4)] {
        let returns = returns(config(CooperativeNavigation, variant), 3000, random);
        assert_mean(
            &returns.iter().map(|seats| seats[0]).collect::<Vec<_>>(),
            agent,
            "an agent",
        );
        assert_mean(
            &returns.iter().map(|seats| seats.iter().sum()).collect::<Vec<_>>(),
            total,
            "all agents",
        );
    }
    for (variant, random, predator, prey) in [
        (Thesis, true, -4.87, -18.6),
        (Thesis, false, -8.0, 4.15),
        (Openai, true, 3.27, -13.9),
    ] {
        let returns = returns(config(PredatorPrey, variant), 3000, random);
        assert_mean(
            &returns.iter().map(|seats| seats[0]).collect::<Vec<_>>(),
            predator,
            "a predator",
        );
        assert_mean(
            &returns.iter().map(|seats| seats[3]).collect::<Vec<_>>(),
            prey,
            "the prey",
        );
    }
}

#[test]
fn starts_that_do_not_fit_are_explained() {
    let refused = |scenario, start| {
        let config = ParticlesConfig {
            start,
            ..config(scenario, Thesis)
        };
        Particles::new(config).err().unwrap().to_string()
    };
    let few = Start {
        agents: Some(vec![[0.0; 2]; 3]),
        landmarks: None,
    };
    assert_eq!(
        refused(PredatorPrey, few),
        "`start.agents`: has 3 entries for 4 agents; write [[x, y], [x, y], [x, y], [x, y]]"
    );
    let many = Start {
        agents: None,
        landmarks: Some(vec![[0.0; 2]; 4]),
    };
    assert!(
        refused(CooperativeNavigation, many).contains("`start.landmarks`: has 4 entries for 3 landmarks")
    );
    let open = Start {
        agents: None,
        landmarks: Some(vec![[0.0, 0.0], [f64::NAN, 0.0]]),
    };
    assert!(refused(PredatorPrey, open).contains("`start.landmarks[1]`"));
    let never = ParticlesConfig {
        episode_length: 0,
        ..Default::default()
    };
    assert!(
        Particles::new(never)
            .err()
            .unwrap()
            .to_string()
            .contains("`episode_length`")
    );
}

#[test]
fn random_starts_stay_in_their_squares() {
    let mut particles = Particles::new(config(PredatorPrey, Thesis)).unwrap();
    let mut rng = contract::random::stream(&["starts"]);
    let mut farthest = [0.0_f64; 2];
    for _ in 0..1000 {
        particles.reset(&mut rng).unwrap();
        for (index, motion) in particles.world().motions().iter().enumerate() {
            let kind = usize::from(index >= 4);
            farthest[kind] = motion
                .position
                .iter()
                .fold(farthest[kind], |most, entry| most.max(entry.abs()));
            assert_eq!(motion.velocity, [0.0; 2]);
        }
    }
    assert!(
        (0.999..1.0).contains(&farthest[0]) && (0.899..0.9).contains(&farthest[1]),
        "{farthest:?}"
    );
}

#[test]
fn actions_beyond_the_limits_are_refused_or_clipped() {
    let mut rng = contract::random::stream(&[]);
    let wild = vec![vec![0.0, 0.0], vec![0.0, -1.5], vec![0.0, 0.0]];
    for variant in [Thesis, Openai] {
        let problem = placed(variant, &SPREAD)
            .step(&wild, &mut rng)
            .unwrap_err()
            .to_string();
        assert!(
            problem.contains("agent_1.force_y is -1.5, outside [-1, 1]"),
            "{problem}"
        );
    }
    let (mut clipped, mut limit) = (placed(Mpe2, &SPREAD), placed(Mpe2, &SPREAD));
    let most = vec![vec![0.0, 0.0], vec![0.0, -1.0], vec![0.0, 0.0]];
    assert_eq!(
        clipped.step(&wild, &mut rng).unwrap(),
        limit.step(&most, &mut rng).unwrap()
    );
    assert_eq!(clipped.world().motions(), limit.world().motions());
    for actions in [
        vec![vec![0.0; 2]; 2],
        vec![vec![0.0; 3]; 3],
        vec![vec![f64::NAN; 2]; 3],
    ] {
        assert!(matches!(
            placed(Mpe2, &SPREAD).step(&actions, &mut rng),
            Err(Error::Action { .. })
        ));
    }
}

#[test]
fn a_joint_observation_is_everybodys_one_after_the_other() {
    for scenario in [CooperativeNavigation, PredatorPrey] {
        let joint = ParticlesConfig {
            joint_observation: true,
            ..config(scenario, Thesis)
        };
        let (mut joint, mut own) = (
            Particles::new(joint).unwrap(),
            Particles::new(config(scenario, Thesis)).unwrap(),
        );
        let (mut one, mut other) = (
            contract::random::stream(&["same"]),
            contract::random::stream(&["same"]),
        );
        let (joint_seen, own_seen) = (joint.reset(&mut one).unwrap(), own.reset(&mut other).unwrap());
        assert!(joint_seen.iter().all(|seen| *seen == own_seen.concat()));
        let names = |seat: &Seat| seat.observation.names();
        assert_eq!(names(&joint.seats()[0])[own.widths[0]], "agent_1.velocity_x");
        assert!(
            joint
                .seats()
                .iter()
                .all(|seat| seat.observation.len() == joint_seen[0].len())
        );
        let mut unique = names(&joint.seats()[0]);
        unique.sort();
        unique.dedup();
        assert_eq!(unique.len(), joint_seen[0].len());
    }
}

#[test]
fn a_restored_episode_continues_to_the_same_bits() {
    for (scenario, variant) in [
        (CooperativeNavigation, Thesis),
        (PredatorPrey, Thesis),
        (PredatorPrey, Mpe2),
    ] {
        let mut first = Particles::new(config(scenario, variant)).unwrap();
        let mut rng = contract::random::stream(&["restored"]);
        first.reset(&mut rng).unwrap();
        let seats = first.seats().len();
        let mut draw = || {
            (0..seats)
                .map(|_| vec![rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0)])
                .collect::<Vec<_>>()
        };
        let mut unused = contract::random::stream(&[]);
        (0..10).for_each(|_| drop(first.step(&draw(), &mut unused).unwrap()));
        let text = first.snapshot().to_string();
        let mut second = Particles::new(config(scenario, variant)).unwrap();
        second.restore(&serde_json::from_str(&text).unwrap()).unwrap();
        for step in 11..=25 {
            let actions = draw();
            let (one, two) = (
                first.step(&actions, &mut unused).unwrap(),
                second.step(&actions, &mut unused).unwrap(),
            );
            assert_eq!(one, two);
            assert_eq!(one.end.is_some(), step == 25);
            assert_eq!((first.state(), first.trace()), (second.state(), second.trace()));
        }
    }
    let mut navigation = Particles::new(config(CooperativeNavigation, Thesis)).unwrap();
    assert!(
        navigation
            .restore(&serde_json::json!({"steps": 1, "motions": []}))
            .is_err()
    );
}
