//! Trials that were killed go on from a snapshot of Python, or start over, to the same bits.

use super::*;

/// A trial of some seconds in slow tanks.
fn long(place: &Place, make: &str) {
    place.study(
        make,
        "",
        LEARNER,
        "train_evaluate: { steps: 600, environments: 2, evaluate_every: 200, episodes: 2, final_episodes: 3 }",
    );
}

/// True where a checkpoint of the running trial lies in the store.
pub(super) fn has_checkpoint(place: &Place) -> bool {
    let entries = |folder: PathBuf| {
        fs::read_dir(folder)
            .into_iter()
            .flatten()
            .flatten()
            .map(|it| it.path())
    };
    let running = entries(place.bench.path("store/trials"))
        .flat_map(entries)
        .map(|trial| trial.join("running"));
    let is_checkpoint = |path: PathBuf| {
        path.file_name()
            .is_some_and(|it| it.to_string_lossy().starts_with("checkpoint-"))
    };
    running.flat_map(entries).any(is_checkpoint)
}

#[test]
fn a_killed_trial_goes_on_or_starts_over_to_the_same_bits() {
    let Some(place) = Place::new() else { return };
    place.bench.write("regimen.toml", "checkpoint_every_s = 0.2\n");
    for make in ["own.py:Slow", "own.py:Held", "own.py:Forgetful"] {
        long(&place, make);
        place.goes_on_after_a_kill();
    }
}

#[test]
fn a_snapshot_is_taken_only_of_what_continues_alike() {
    let Some(place) = Place::new() else { return };
    let mut rng = stream(&["snapshot"]);
    let mut after = |make: &str| {
        let mut environment = place.built(make, json!({}));
        environment.reset(&mut rng).unwrap();
        for _ in 0..5 {
            environment.step(&[vec![0.5]], &mut rng).unwrap();
        }
        environment
    };
    let mut tank = after("own.py:Tank");
    let snapshot: Value = serde_json::from_str(&tank.snapshot().to_string()).unwrap();
    let mut other = place.built("own.py:Tank", json!({}));
    other.restore(&snapshot).unwrap();
    let go_on = |environment: &mut dyn Environment| {
        let mut rng = stream(&["on"]);
        (0..15)
            .map(|_| environment.step(&[vec![-0.2]], &mut rng).unwrap())
            .collect::<Vec<_>>()
    };
    assert_eq!(go_on(&mut *tank), go_on(&mut *other));
    for (make, why) in [
        ("own.py:Held", "cannot be pickled"),
        ("own.py:Forgetful", "does not continue as it does itself"),
    ] {
        let mut environment = after(make);
        let before = environment.snapshot();
        let told = environment.restore(&before).unwrap_err().to_string();
        assert!(
            told.contains("checkpoint of python does not fit") && told.contains(why),
            "{told}"
        );
    }
}
