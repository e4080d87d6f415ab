//! The environment compared with trajectories of other programs (`tests/fixtures/particles`).

use super::*;
use std::{collections::BTreeMap, path::PathBuf};

/// Largest allowed deviation of any value.
const TOLERANCE: f64 = 1e-9;

/// Rows of a CSV file by column name.
fn rows(name: &str) -> Vec<BTreeMap<String, f64>> {
    let path =
        PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("../../tests/fixtures/particles/{name}.csv"));
    let mut reader = csv::Reader::from_path(path).unwrap();
    let header = reader.headers().unwrap().clone();
    let row = |record: csv::StringRecord| {
        header
            .iter()
            .zip(&record)
            .map(|(name, cell)| (name.to_owned(), cell.parse().unwrap()))
            .collect()
    };
    reader.records().map(|record| row(record.unwrap())).collect()
}

fn vectors(row: &BTreeMap<String, f64>, letter: &str, count: usize) -> Vec<Vector> {
    (0..count)
        .map(|index| ["x", "y"].map(|axis| row[&format!("{letter}{index}{axis}")]))
        .collect()
}

fn assert_close(ours: f64, theirs: f64, place: &str) {
    assert!(
        (ours - theirs).abs() <= TOLERANCE,
        "{place}: {ours} here, {theirs} there"
    );
}

fn assert_motions(particles: &Particles, row: &BTreeMap<String, f64>, place: &str) {
    let agents = particles.world().agents();
    let (positions, velocities) = (vectors(row, "p", agents.len()), vectors(row, "v", agents.len()));
    for ((motion, position), velocity) in agents.iter().zip(positions).zip(velocities) {
        for axis in 0..2 {
            assert_close(motion.position[axis], position[axis], place);
            assert_close(motion.velocity[axis], velocity[axis], place);
        }
    }
}

/// Applies the actions of a reference file and compares everything after every step.
fn follow(scenario: ScenarioName, variant: Variant, name: &str, agents: usize, landmarks: usize) {
    let (reference, observed) = (rows(name), rows(&format!("{name}_obs")));
    let start = Start {
        agents: Some(vectors(&reference[0], "p", agents)),
        landmarks: Some(vectors(&reference[0], "l", landmarks)),
    };
    let config = ParticlesConfig {
        scenario,
        variant,
        start,
        joint_observation: true,
        ..Default::default()
    };
    let mut particles = Particles::new(config).unwrap();
    let mut rng = contract::random::stream(&[]);
    let mut observations = particles.reset(&mut rng).unwrap();
    let mut compared = 0;
    for (t, row) in reference.iter().enumerate() {
        let place = format!("{name} step {t}");
        if t > 0 {
            let actions: Vec<Vec<f64>> = vectors(row, "u", agents)
                .iter()
                .map(|action| action.to_vec())
                .collect();
            let step = particles.step(&actions, &mut rng).unwrap();
            step.rewards
                .iter()
                .enumerate()
                .for_each(|(agent, reward)| assert_close(*reward, row[&format!("r{agent}")], &place));
            assert_eq!(step.end.is_some(), t == 25, "{place}");
            observations = step.observations;
        }
        assert_motions(&particles, row, &place);
        if let Some(seen) = observed.iter().find(|seen| seen["t"] == row["t"]) {
            assert_eq!(observations[0].len(), seen.len() - 1);
            let theirs = |entry: usize| seen[&format!("o{entry}")];
            observations[0]
                .iter()
                .enumerate()
                .for_each(|(entry, ours)| assert_close(*ours, theirs(entry), &place));
            compared += 1;
        }
    }
    assert_eq!((reference.len(), compared), (26, 5));
}

#[test]
fn the_thesis_environment_is_followed() {
    follow(
        ScenarioName::CooperativeNavigation,
        Variant::Thesis,
        "thesis_spread",
        3,
        3,
    );
    follow(ScenarioName::PredatorPrey, Variant::Thesis, "thesis_tag", 4, 2);
}

#[test]
fn mpe2_is_followed_through_contacts() {
    follow(
        ScenarioName::CooperativeNavigation,
        Variant::Mpe2,
        "mpe2_spread_close",
        3,
        3,
    );
    follow(ScenarioName::PredatorPrey, Variant::Mpe2, "mpe2_tag_close", 4, 2);
}
