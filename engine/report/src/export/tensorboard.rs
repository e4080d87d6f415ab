//! Trials as runs of TensorBoard: a folder with an event file each, and `runs.json`, which maps folders to trials.

use super::{Subject, config, pretty};
use contract::{Error, recorder::Phase, trial_result::TrialResult};
use execution::{
    store::{StoredTrial, seconds_of, write_durably},
    world::fs,
};
use imported::event_file::{Event, Scalar, Summary, append, first};
use serde_json::{Value, json};
use std::{collections::BTreeMap, path::Path};

/// Phases with values by step; traces have decisions instead of steps.
const PHASES: [Phase; 3] = [Phase::Train, Phase::Evaluate, Phase::Final];

/// Sentence on the values in the list of runs.
const ABOUT: &str = "scalars by steps of the environment, means over episodes and seats; their names begin with \
                     the phase (train, evaluate, final); TensorBoard keeps them in single precision, and their \
                     wall time is when the trial ended";

/// Writes the runs of all trials that ended `ok`.
///
/// # Errors
/// [`Error::File`] where a file cannot be written.
pub(super) fn write(subject: &Subject<'_>, folder: &Path) -> Result<(), Error> {
    let mut runs = Vec::new();
    for (result, stored) in subject.trials.iter().filter(|(result, _)| result.is_ok()) {
        let name = folder_of_run(result);
        let path = folder.join(&name);
        fs::create_dir_all(&path).map_err(Error::file("create", &path))?;
        let ended = ended(*stored);
        let file = path.join(format!("events.out.tfevents.{ended}.regimen"));
        write_durably(&file, &event_file(result, ended))?;
        runs.push(describe_run(&name, result));
    }
    let described = json!({"schema": 1, "study": subject.name, "title": subject.title,
        "program": subject.program(), "description": ABOUT, "units": subject.units, "runs": runs});
    write_durably(&folder.join("runs.json"), pretty(&described).as_bytes())
}

/// Description of the trial whose run lies in a folder.
#[must_use]
pub fn describe_run(folder: &str, result: &TrialResult) -> Value {
    let trial = &result.trial;
    json!({"folder": folder, "trial": trial.id, "environment": trial.cell.environment, "agent": trial.cell.agent,
        "setting": trial.cell.point.words(), "seed": trial.key.seed, "config": config::values(&trial.key)})
}

/// Folder of a trial's run: readable names, and the beginning of the id, so that no two folders are the same.
#[must_use]
pub fn folder_of_run(result: &TrialResult) -> String {
    let trial = &result.trial;
    let keep = |letter: char| letter.is_ascii_alphanumeric() || "._-=".contains(letter);
    let word = |text: &str| -> String {
        let word: String = text
            .chars()
            .map(|letter| if keep(letter) { letter } else { '-' })
            .collect();
        word.trim_start_matches('.').to_owned()
    };
    let setting = if trial.cell.point.is_empty() {
        String::new()
    } else {
        format!("{:.60}-", word(trial.cell.point.words()))
    };
    format!(
        "{}/{}/{setting}seed-{}-{:.8}",
        word(&trial.cell.environment),
        word(&trial.cell.agent),
        trial.key.seed,
        trial.id
    )
}

/// End of the trial, in seconds since 1970; 0 where the store has none.
fn ended(stored: Option<&StoredTrial>) -> u64 {
    stored
        .and_then(|stored| seconds_of(stored.ended_at.as_deref()?))
        .unwrap_or(0)
}

#[expect(clippy::cast_precision_loss, reason = "seconds since 1970 are far below 2^52")]
fn event_file(result: &TrialResult, ended: u64) -> Vec<u8> {
    let wall_time = ended as f64;
    let mut file = Vec::new();
    append(&first(wall_time), &mut file);
    for (step, value) in scalars(result) {
        let event = Event {
            wall_time,
            step: i64::try_from(step).unwrap_or(i64::MAX),
            summary: Some(Summary { value }),
            ..Event::default()
        };
        append(&event, &mut file);
    }
    file
}

/// The values of every step, in the order of steps.
#[expect(
    clippy::cast_possible_truncation,
    reason = "TensorBoard keeps scalars in single precision"
)]
fn scalars(result: &TrialResult) -> BTreeMap<u64, Vec<Scalar>> {
    let mut scalars: BTreeMap<u64, Vec<Scalar>> = BTreeMap::new();
    for phase in PHASES {
        for metric in result.names.iter() {
            for (step, value) in result.curve(phase, metric) {
                scalars.entry(step).or_default().push(Scalar {
                    tag: format!("{}/{metric}", phase.name()),
                    simple_value: Some(value as f32),
                    ..Scalar::default()
                });
            }
        }
    }
    scalars
}
