//! Files of strangers that the program reads: each function takes the bytes of a file and panics where a reader does,
//! or where what it says of the file cannot be true. The fuzzer calls them with what it makes up, the tests with what
//! it has found.

use analysis::claim;
use contract::{Registry, recorder::Phase, trial::Trial};
use document::diagnostic::render_first;
use execution::store::{
    Store, TrialFile,
    metric_log::{self, LogEnd},
};
use numerics::policy_file::{FILE_NAME, Policy};
use std::{
    fs,
    path::{Path, PathBuf},
    sync::{LazyLock, Mutex},
};
use study::{Options, Study};

/// Every target by its name, which is that of its folder of examples.
pub const ALL: [(&str, fn(&[u8])); 5] = [
    ("study", study),
    ("claim", claim),
    ("trial_file", trial_file),
    ("metric_log", metric_log),
    ("policy", policy),
];

/// Longest message that a mistake may lead to, in bytes.
const LONGEST_MESSAGE: usize = 1 << 20;

/// A study: it is refused with a message of bearable length, or it resolves to a study of the same trials.
pub fn study(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    match read(text) {
        Err(message) => assert!(
            (1..LONGEST_MESSAGE).contains(&message.len()),
            "{} bytes",
            message.len()
        ),
        Ok(study) => {
            let resolved = study::resolved_yaml(&study, Path::new("")).expect("what was read can be written");
            let again = read(&resolved).unwrap_or_else(|message| panic!("{message}\n{resolved}"));
            assert_eq!(ids(&study), ids(&again), "{resolved}");
        }
    }
}

/// A study of plugins that are small to build: what is sought are faults of the reader.
fn read(text: &str) -> Result<Study, String> {
    static REGISTRY: LazyLock<Mutex<Registry>> = LazyLock::new(|| {
        let mut registry = plugins::registry();
        registry
            .environments
            .retain(|name, _| !name.starts_with("turbofan"));
        registry
            .agents
            .retain(|name, entry| !entry.traits.learns() || *name == "dirichlet_sac");
        Mutex::new(registry)
    });
    let registry = REGISTRY.lock().expect("nobody panicked with it");
    // Nothing lies in this folder, so that a study names no file of this machine by chance.
    let nowhere = Path::new("/nowhere");
    study::load_text(text, "study.yaml", nowhere, &registry, &Options::default())
        .map_err(|problems| render_first(&problems))
}

fn ids(study: &Study) -> Vec<String> {
    study.plan().trials.iter().map(|trial| trial.id.clone()).collect()
}

/// A claim: it is refused at a place inside its text, or it is written as something that reads the same.
pub fn claim(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    match claim::parse(text) {
        Err(error) => assert!(error.position <= text.len(), "{error:?}"),
        Ok(claim) => assert_eq!(claim::parse(&claim.to_string()), Ok(claim)),
    }
}

/// An acknowledgement, as it is and with a check that holds: it is never believed of another trial, and `fsck` moves
/// nothing but what lies in the store.
pub fn trial_file(bytes: &[u8]) {
    with_folder(|folder| {
        let id = "0123456789abcdef0123456789abcdef";
        ends_at(&folder.join("raw"), id, bytes);
        let Ok(file) = serde_json::from_slice::<TrialFile>(bytes) else {
            return;
        };
        let (id, sealed) = (
            file.key.id(),
            file.to_bytes().expect("what was read can be written"),
        );
        ends_at(&folder.join("sealed"), &id, &sealed);
    });
}

fn ends_at(root: &Path, id: &str, bytes: &[u8]) {
    let store = Store::at(root.join("store"));
    let outside = root.join("outside");
    let of_trial = store.folder(id);
    fs::create_dir_all(&of_trial).expect("a folder of the test");
    fs::write(&outside, "kept").expect("a file of the test");
    fs::write(of_trial.join("trial.json"), bytes).expect("a file of the test");
    let file = store.file(id);
    if let Ok(Some(file)) = &file {
        assert_eq!(file.key.id(), id);
        let trial = Trial {
            id: id.into(),
            cell: Default::default(),
            key: file.key.clone(),
        };
        let _ = store.load(&trial.into());
    }
    assert_eq!(store.end(id).is_ok(), file.is_ok());
    store.check(true, Vec::new()).expect("a store that can be read");
    assert_eq!(fs::read_to_string(&outside).expect("it stays"), "kept");
}

/// The log of a running trial, as it is and as the payloads of whole frames: what is read names its own metrics.
pub fn metric_log(bytes: &[u8]) {
    with_folder(|folder| {
        let path = folder.join("metrics.log");
        for log in [bytes.to_vec(), framed(bytes)] {
            fs::write(&path, &log).expect("a file of the test");
            let contents = metric_log::read(&path).expect("a file");
            let n_names = contents.table.names.len();
            let rows = &contents.table.rows;
            assert!(
                rows.iter()
                    .all(|row| usize::from(row.metric) < n_names && row.phase <= Phase::Final)
            );
            if let LogEnd::Torn { offset } | LogEnd::Damaged { offset } = contents.end {
                assert!(offset < log.len());
            }
        }
    });
}

/// Whole frames with these payloads: of each, the first two bytes give the length.
fn framed(mut bytes: &[u8]) -> Vec<u8> {
    let first: &[u8] = b"regimen metric log 1\nid";
    let (mut log, mut number) = (frame(0, first), 1u64);
    while let Some((length, rest)) = bytes.split_at_checked(2) {
        let length = usize::from(u16::from_le_bytes([length[0], length[1]])).min(rest.len());
        log.extend(frame(number, &rest[..length]));
        (bytes, number) = (&rest[length..], number + 1);
    }
    log
}

/// A frame as the log's own table describes it.
fn frame(number: u64, payload: &[u8]) -> Vec<u8> {
    let length = u32::try_from(payload.len()).expect("a short payload");
    let head = [&length.to_le_bytes()[..], &number.to_le_bytes()].concat();
    let check = blake3::hash(&[&head, payload].concat());
    [&head, &check.as_bytes()[..8], payload].concat()
}

/// A policy: it is refused, or it acts on an observation of the length that it names.
pub fn policy(bytes: &[u8]) {
    with_folder(|folder| {
        fs::write(folder.join(FILE_NAME), bytes).expect("a file of the test");
        if let Ok(policy) = Policy::read(folder) {
            let action = policy.act(&vec![0.5; policy.header.inputs.len()]);
            assert!(action.len() <= policy.header.outputs.len());
        }
    });
}

/// Runs something in a folder that is gone afterwards.
fn with_folder(run: impl FnOnce(&Path)) {
    let folder: PathBuf = std::env::temp_dir();
    let folder = tempfile::tempdir_in(folder).expect("a folder of the test");
    run(folder.path());
}
