//! Time and memory of `check`, `status`, `plan` and `report` over a store of many trials.
//!
//! usage: plan SETTINGS SEEDS [FOLDER [packed]]
//!
//! Writes a store (into FOLDER, which is kept; otherwise into a temporary folder) in which every trial of a
//! study of SETTINGS sweep points and SEEDS seeds has ended, each in a folder without metrics or, where it is asked
//! for, with one value and packed; then starts the program on it: nothing stored,
//! everything done, everything done with one more seed, one more sweep point, and everything new because of more
//! training steps. Prints one line of JSON, for each command `[seconds, peak memory in MB]`.

#![expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]

use contract::{
    Phase, Recorder,
    trial::Trial,
    trial_end::{EndState, TrialEnd},
};

use execution::store::{Store, TrialFile};
use std::{
    collections::BTreeMap,
    path::Path,
    process::Command,
    time::{Duration, Instant},
};

#[expect(clippy::print_stdout, reason = "a benchmark prints its figure")]
fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| word != "--bench")
        .collect();
    let number = |index: usize, otherwise: usize| {
        words
            .get(index)
            .and_then(|word| word.parse().ok())
            .unwrap_or(otherwise)
    };
    let (settings, seeds) = (number(0, 1000), number(1, 100));
    let temporary = tempfile::tempdir().unwrap();
    let folder = words.get(2).map_or(temporary.path(), Path::new);
    let path = |name: &str| folder.join(name);
    std::fs::write(path("study.yaml"), study(settings, seeds)).unwrap();
    std::fs::write(path("wider.yaml"), study(settings + 1, seeds)).unwrap();
    let packed = words.get(3).is_some_and(|word| word == "packed");
    let trials = fill(&path("study.yaml"), &path("store"), packed.then_some(folder));
    let more = (seeds + 1).to_string();
    let measured = |arguments: &[&str]| measured(folder, arguments);
    println!(
        "{}",
        serde_json::json!({
            "trials": trials,
            "check": measured(&["check", "study.yaml"]),
            "status_nothing_stored": measured(&["status", "study.yaml", "--store", "empty"]),
            "plan_nothing_stored": measured(&["plan", "study.yaml", "--store", "empty"]),
            "report_nothing_stored": measured(&["report", "study.yaml", "--store", "empty"]),
            "status": measured(&["status", "study.yaml"]),
            "plan": measured(&["plan", "study.yaml"]),
            "report": if packed { measured(&["report", "study.yaml"]) } else { (0.0, 0) },
            "plan_new_seed": measured(&["plan", "study.yaml", "--seeds", &more]),
            "plan_new_point": measured(&["plan", "wider.yaml"]),
            "plan_all_new": measured(&["plan", "study.yaml", "--set", "protocol.steps=240000"]),
        })
    );
}

/// Seconds that the program takes, and the most memory that it held, as the system last said before its end.
fn measured(folder: &Path, arguments: &[&str]) -> (f64, u64) {
    let started = Instant::now();
    let out = std::fs::File::create(folder.join("out")).unwrap();
    let mut program = Command::new(env!("CARGO_BIN_EXE_regimen"))
        .args(arguments)
        .current_dir(folder)
        .stderr(out.try_clone().unwrap())
        .stdout(out)
        .spawn()
        .unwrap();
    let mut peak_mb = 0;
    let ended = loop {
        if let Some(ended) = program.try_wait().unwrap() {
            break ended;
        }
        peak_mb = peak_mb.max(most_memory_mb(program.id()));
        std::thread::sleep(Duration::from_millis(5));
    };
    let said = std::fs::read_to_string(folder.join("out")).unwrap();
    assert!(matches!(ended.code(), Some(0 | 106)), "{said}");
    (started.elapsed().as_secs_f64(), peak_mb)
}

fn most_memory_mb(process: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = line.and_then(|text| text.trim().trim_end_matches(" kB").parse::<u64>().ok());
    kilobytes.unwrap_or(0) / 1024
}

fn study(settings: usize, seeds: usize) -> String {
    let rates: Vec<String> = (1..=settings)
        .map(|index| format!("{:e}", 1e-6 * index as f64))
        .collect();
    format!(
        "study: many\nenvironments: {{ four: {{ battery: {{ cells: 4 }} }} }}\nagents: {{ dsac: {{ \
         dirichlet_sac: {{}} }} }}\n\
         protocol: {{ train_evaluate: {{ steps: 60000 }} }}\nseeds: {seeds}\n\
         sweep:\n  dsac.actor_learning_rate: {{ grid: [{}] }}\n\
         tables: {{ lengths: {{ comparison: {{ rows: dsac.actor_learning_rate, value: cycle_length }} }} }}\n",
        rates.join(", ")
    )
}

/// So many trials are packed at once.
const PACKED_AT_ONCE: usize = 20_000;

/// Ends every trial of a study; `packed` is the folder in which packs are asked for.
fn fill(study: &Path, root: &Path, packed: Option<&Path>) -> usize {
    let registry = plugins::registry();
    let study = study::load(study, &registry, &study::Options::default()).unwrap();
    let (store, plan) = (Store::at(root), study.plan());
    match packed {
        None => plan.trials.iter().for_each(|trial| acknowledge(&store, trial)),
        Some(folder) => {
            for some in plan.trials.chunks(PACKED_AT_ONCE) {
                for trial in some {
                    let mut record = Recorder::default();
                    record.add(Phase::Final, 60_000, 0, 0, "cycle_length", trial.key.seed as f64);
                    store.finish(trial, &record, 1.0).unwrap();
                }
                measured(folder, &["pack", "--settle-s", "0"]);
            }
        }
    }
    plan.trials.len()
}

/// Acknowledges a trial, without the flushes that a run pays for.
fn acknowledge(store: &Store, trial: &Trial) {
    let end = TrialEnd {
        state: EndState::Ok,
        reason: String::new(),
        wall_s: 1.0,
        decision_s: None,
        device: None,
        digest: "0".repeat(32),
    };
    let file = TrialFile::new(trial, end, BTreeMap::new());
    let folder = store.folder(&trial.id);
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("trial.json"), file.to_bytes().unwrap()).unwrap();
}
