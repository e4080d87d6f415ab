use super::*;

/// The draft of a sweep whose program has written these lines.
fn looked_at(
    name: &str,
    sweep: &str,
    keys: &[&str],
    lines: &str,
) -> (ProgramDraft, Result<(), DraftRefusal>) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("train.py"), "hydra.main").unwrap();
    std::fs::write(folder.path().join(name), sweep).unwrap();
    let mut draft = ProgramDraft::begin(&Given {
        from: name,
        folder: folder.path(),
        sources: &[],
        runs_for: Duration::from_secs(1),
    })
    .unwrap();
    let notes = draft.probe.place().notes();
    std::fs::create_dir_all(&notes).unwrap();
    std::fs::write(notes.join("stdout.jsonl"), lines).unwrap();
    draft.ran = ProbeRun {
        has_ended: true,
        keys: keys.iter().map(|it| (*it).to_owned()).collect(),
    };
    let found = draft.find_metrics();
    (draft, found)
}

const LOSSES: &str = "{\"step\":1,\"loss\":\"2\"}\n{\"step\":2,\"loss\":\"1\"}\n";
const SWEEP: &str = "program: train.py\nmethod: random\nmetric: { name: acc, goal: maximize }\nparameters:\n  lr: { values: \
                     [1, 2] }\n";

#[test]
fn the_goal_of_a_sweep_is_that_of_no_other_metric() {
    let (draft, _) = looked_at("sweep.yaml", SWEEP, &["loss"], LOSSES);
    let text = draft.text("a");
    assert!(text.contains("metric: loss\n    direction: minimize\n"), "{text}");
    let notes = draft.notes.join("\n");
    assert!(
        notes.contains("`acc` of the sweep was not read; `--seconds`")
            && notes.contains("`loss`, whose lower"),
        "{notes}"
    );
    let hydra = "defaults: [{ override hydra/sweeper: optuna }]\nhydra: { sweeper: { direction: maximize, n_trials: 9, params: \
                 { lr: \"1,2\" } } }\n";
    let (draft, _) = looked_at("tune.yaml", hydra, &["loss"], LOSSES);
    assert!(
        draft.text("a").contains("direction: minimize\n"),
        "{}",
        draft.text("a")
    );
    assert!(
        draft.notes.join("\n").contains("a value without a name"),
        "{:?}",
        draft.notes
    );
    let named = SWEEP.replace("acc", "loss");
    let (draft, _) = looked_at("sweep.yaml", &named, &["loss"], LOSSES);
    assert!(!draft.text("a").contains("minimize"), "{}", draft.text("a"));
}

#[test]
fn no_profile_tries_more_settings_than_there_are() {
    let (draft, _) = looked_at("sweep.yaml", SWEEP, &["loss"], LOSSES);
    let text = draft.text("a");
    assert!(text.contains("    settings: 2\n"), "{text}");
    assert!(text.contains("tune.tuned.settings: 2 }"), "{text}");
}

#[test]
fn a_metric_that_is_no_finite_number_is_named() {
    let lines = "{\"step\":1,\"loss\":\"2\",\"acc\":\"1\"}\n{\"step\":2,\"loss\":\"1\",\"acc\":\"nan\"}\n";
    let (draft, _) = looked_at("sweep.yaml", SWEEP, &["loss", "acc"], lines);
    let notes = draft.notes.join("\n");
    assert!(
        notes.contains("`acc` of `stdout` is left out: it is NaN at step 2")
            && !notes.contains("`--seconds`"),
        "{notes}"
    );
    let (_, found) = looked_at("sweep.yaml", SWEEP, &["acc"], lines);
    let told = found.unwrap_err().to_string();
    assert!(told.contains("`acc` of `stdout` is NaN at step 2"), "{told}");
}

#[test]
fn variables_of_the_command_are_those_of_the_study() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("train.py"), "").unwrap();
    let draft = ProgramDraft::begin(&Given {
        from: "LR=3 python train.py",
        folder: folder.path(),
        sources: &[],
        runs_for: Duration::from_secs(1),
    });
    let text = draft.unwrap().text("a");
    assert!(
        text.contains("variables: { LR: \"3\" }") && text.contains("run: [python, train.py]"),
        "{text}"
    );
}
