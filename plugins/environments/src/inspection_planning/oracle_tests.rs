//! The environment compared with trajectories of the published program (`tests/fixtures/inspection_planning`).

use super::*;
use serde_json::json;
use std::path::PathBuf;

/// The published table of crack growth.
pub(super) fn table() -> String {
    concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../experiments/data/imp_marl_crack_growth.csv"
    )
    .into()
}

#[derive(Debug, Deserialize)]
struct Trajectories {
    uncorrelated: Vec<Run>,
    correlated: Vec<Run>,
}

#[derive(Debug, Deserialize)]
struct Run {
    kind: String,
    campaign: bool,
    #[serde(rename = "return")]
    sum: f64,
    steps: Vec<RecordedStep>,
}

/// A step, and the beliefs after it.
#[derive(Debug, Deserialize)]
struct RecordedStep {
    action: Vec<usize>,
    /// 1 where a crack was found.
    inspection: Vec<u8>,
    reward: f64,
    p_fail: Vec<f64>,
    d_rate: Vec<f64>,
    /// Beliefs of the first two components, in some steps.
    belief: Option<Vec<Vec<f64>>>,
    alpha: Option<Vec<f64>>,
}

fn trajectories() -> Trajectories {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../../tests/fixtures/inspection_planning/imp_marl.json");
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn assert_close(ours: f64, theirs: f64, tolerance: f64, place: &str) {
    let allowed = tolerance * theirs.abs().max(1.0);
    assert!(
        (ours - theirs).abs() <= allowed,
        "{place}: {ours} here, {theirs} there"
    );
}

/// Replays the recorded actions and findings; returns the number of full beliefs that were compared.
fn follow(run: &Run, correlated: bool, tolerance: f64) -> usize {
    let config =
        json!({ "correlated": correlated, "campaign": run.campaign, "crack_growth": { "file": table() } });
    let mut environment = InspectionPlanning::new(serde_json::from_value(config).unwrap()).unwrap();
    environment.reset(&mut contract::random::stream(&[])).unwrap();
    let (mut sum, mut compared) = (0.0, 0);
    for (t, recorded) in run.steps.iter().enumerate() {
        let place = format!("{} step {t}, correlated {correlated}", run.kind);
        let treatments: Vec<Treatment> = recorded
            .action
            .iter()
            .map(|choice| Treatment::ALL[*choice])
            .collect();
        let step = environment.advance(&treatments, |component, _| recorded.inspection[component] == 1);
        assert_close(step.rewards[0], recorded.reward, tolerance, &place);
        assert_eq!(step.end.is_some(), t == 29, "{place}");
        sum += step.rewards[0];
        compared += assert_knowledge(&environment, recorded, tolerance, &place);
    }
    assert_close(sum, run.sum, tolerance, &run.kind);
    compared
}

fn assert_knowledge(
    environment: &InspectionPlanning,
    recorded: &RecordedStep,
    tolerance: f64,
    place: &str,
) -> usize {
    for (component, marginal) in environment.marginals.iter().enumerate() {
        assert_close(marginal[FAILED], recorded.p_fail[component], tolerance, place);
        #[allow(clippy::cast_precision_loss, reason = "an age")]
        let age = environment.progress.beliefs.ages[component] as f64;
        assert!(
            (age - recorded.d_rate[component]).abs() < 0.5,
            "{place}: age {age}"
        );
    }
    let beliefs = recorded.belief.iter().flatten().zip(&environment.marginals);
    for (theirs, ours) in beliefs {
        theirs
            .iter()
            .zip(ours)
            .for_each(|(theirs, ours)| assert_close(*ours, *theirs, tolerance, place));
    }
    for (theirs, ours) in recorded
        .alpha
        .iter()
        .flatten()
        .zip(&environment.progress.beliefs.weights)
    {
        assert_close(*ours, *theirs, tolerance, place);
    }
    usize::from(recorded.belief.is_some())
}

#[test]
fn uncorrelated_components_follow_the_published_program() {
    let runs = trajectories().uncorrelated;
    let compared: usize = runs.iter().map(|run| follow(run, false, 1e-10)).sum();
    assert_eq!((runs.len(), compared), (4, 4));
}

/// Initial sizes are computed here and agree with the published table to 1e-10, by which failures are
/// multiplied.
#[test]
fn correlated_components_follow_the_published_program() {
    let runs = trajectories().correlated;
    let compared: usize = runs.iter().map(|run| follow(run, true, 1e-7)).sum();
    assert_eq!((runs.len(), compared), (3, 3));
}
