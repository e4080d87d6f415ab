//! Nothing that was acknowledged is lost when everything is killed, at any instant and at every boundary of
//! writing.

use crate::program::{Bench, trial_files};
use rand::Rng as _;
use std::{
    collections::BTreeMap,
    os::unix::{fs::MetadataExt, process::CommandExt},
    path::PathBuf,
    process::{Child, Command, Stdio},
    time::Duration,
};

/// 40 short trials.
const STUDY: &str = "
study: crashes
environments: { cells: { battery: { cells: 2 } } }
agents:
  equal: { equal_split: {} }
  random: { random_allocation: {} }
protocol: { train_evaluate: { steps: 512, environments: 8, evaluate_every: 128, episodes: 1, \
final_episodes: 2 } }
seeds: 20
";

/// Two trials that learn.
const LEARNING: &str = "
study: learning
environments: { cells: { battery: { cells: 2 } } }
agents: { dsac: { dirichlet_sac: { width: 16, batch_size: 16, learning_starts: 64 } } }
protocol: { train_evaluate: { steps: 1024, environments: 8, evaluate_every: 256, episodes: 2, \
final_episodes: 4 } }
seeds: 2
";

/// A search whose trials pause.
fn searching() -> String {
    crate::silent::study(crate::silent::HALVING).replace("study: tuned", "study: searching")
}

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("short.yaml", STUDY);
    bench.write("learning.yaml", LEARNING);
    bench
}

const RUN: [&str; 9] = [
    "worker",
    "short.yaml",
    "learning.yaml",
    "-j",
    "2",
    "--store",
    "killed",
    "--retries",
    "0",
];

/// The uninterrupted run, to be compared with.
fn uninterrupted(bench: &Bench) -> Vec<(String, String)> {
    bench.ok(&[
        "worker",
        "short.yaml",
        "learning.yaml",
        "-j",
        "2",
        "--store",
        "whole",
    ]);
    let digests = bench.digests("whole");
    assert_eq!(digests.len(), 42);
    digests
}

/// Which acknowledgements there are: writing one anew would give it another inode or time.
fn acknowledged(bench: &Bench) -> BTreeMap<PathBuf, (u64, i64, i64)> {
    let store = bench.path("killed");
    if !store.join("trials").exists() {
        return BTreeMap::new();
    }
    let identity = |file: &PathBuf| {
        std::fs::metadata(file)
            .map(|data| (data.ino(), data.mtime(), data.mtime_nsec()))
            .unwrap()
    };
    trial_files(&store)
        .into_iter()
        .map(|file| (file.clone(), identity(&file)))
        .collect()
}

fn start(mut command: Command) -> Child {
    command
        .process_group(0)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

fn kill_group(child: &mut Child) {
    let _ = Command::new("kill")
        .args(["-KILL", "--", &format!("-{}", child.id())])
        .stderr(Stdio::null())
        .status();
    child.wait().unwrap();
}

/// Everything acknowledged before is still there and was not written again.
fn assert_kept(before: &BTreeMap<PathBuf, (u64, i64, i64)>, after: &BTreeMap<PathBuf, (u64, i64, i64)>) {
    for (file, identity) in before {
        assert_eq!(
            after.get(file),
            Some(identity),
            "{} was acknowledged and ran again",
            file.display()
        );
    }
}

#[test]
fn killed_at_a_hundred_random_instants_and_resumed_it_ends_as_if_nothing_had_happened() {
    let bench = bench();
    bench.write("regimen.toml", "checkpoint_every_s = 0.02\n");
    let whole = uninterrupted(&bench);
    let mut rng = contract::random::stream(&["kill at random instants"]);
    let (mut kills, mut rounds) = (0, 0);
    while kills < 100 {
        let mut child = start(bench.command(&RUN));
        std::thread::sleep(Duration::from_micros(rng.random_range(1_000..250_000)));
        let before = acknowledged(&bench);
        let done = child.try_wait().unwrap().is_some();
        kill_group(&mut child);
        kills += usize::from(!done);
        assert_kept(&before, &acknowledged(&bench));
        if done {
            assert_eq!(bench.digests("killed"), whole);
            std::fs::remove_dir_all(bench.path("killed")).unwrap();
            rounds += 1;
        }
    }
    bench.ok(&RUN);
    assert_eq!(
        bench.digests("killed"),
        whole,
        "after {kills} kills in {rounds} whole rounds"
    );
    // Leases and pauses of killed processes are found, and hold no results.
    bench.ok(&["fsck", "killed"]);
    assert!(
        bench
            .ok(&["fsck", "killed"])
            .contains("42 trials are whole, 0 are being computed, 0 files are wrong")
    );
}

#[test]
fn killed_at_every_boundary_of_writing_it_ends_as_if_nothing_had_happened() {
    let bench = bench();
    bench.write("regimen.toml", "checkpoint_every_s = 0\n");
    let whole = uninterrupted(&bench);
    let mut deaths = 0;
    loop {
        let mut command = bench.misused(&RUN);
        command.env("REGIMEN_TEST_CRASHES", bench.path("crashes.log"));
        let before = acknowledged(&bench);
        let status = start(command).wait().unwrap();
        assert_kept(&before, &acknowledged(&bench));
        if status.success() {
            break;
        }
        deaths += 1;
        assert!(deaths < 5_000, "it never ends");
    }
    let places = std::fs::read_to_string(bench.path("crashes.log")).unwrap();
    // Per trial: a lease, two files in six steps each, the lease again; the two that learn die in their
    // checkpoints besides.
    assert!(deaths >= 42 * 12, "{deaths} deaths");
    assert!(places.contains("checkpoint-"), "{places}");
    assert_eq!(bench.digests("killed"), whole);
    bench.ok(&["fsck", "killed"]);
    bench.ok(&["fsck", "killed"]);
}

/// The same while a search pauses its trials: every pause that was stored stays, and the choice is the same.
#[test]
fn killed_at_every_boundary_of_writing_a_search_chooses_as_if_nothing_had_happened() {
    let bench = Bench::new();
    bench.write("searching.yaml", &searching());
    bench.write("regimen.toml", "checkpoint_every_s = 0\n");
    let run = |store| {
        [
            "run",
            "searching.yaml",
            "-j",
            "2",
            "--retries",
            "0",
            "--store",
            store,
        ]
    };
    let tables = || {
        let read = |name| std::fs::read(bench.path(&format!("results/searching/tables/{name}.csv"))).unwrap();
        ["settings", "lengths"].map(read)
    };
    let whole = bench.run_misused(&run("whole"));
    assert_eq!(whole.code, 0, "{}", whole.err);
    let expected = (bench.digests("whole"), tables());
    let mut deaths = 0;
    loop {
        let mut command = bench.misused(&run("killed"));
        command.env("REGIMEN_TEST_CRASHES", bench.path("crashes.log"));
        let before = acknowledged(&bench);
        let status = start(command).wait().unwrap();
        assert_kept(&before, &acknowledged(&bench));
        if status.success() {
            break;
        }
        deaths += 1;
        assert!(deaths < 5_000, "it never ends");
    }
    let places = std::fs::read_to_string(bench.path("crashes.log")).unwrap();
    assert!(places.contains("partial-"), "{places}");
    assert!(deaths > 100, "{deaths} deaths");
    assert_eq!(
        (bench.digests("killed"), tables()),
        expected,
        "after {deaths} deaths"
    );
    bench.ok(&["fsck", "killed"]);
    let checked = bench.ok(&["fsck", "killed"]);
    assert!(
        checked.contains("have paused") && checked.contains("0 files are wrong"),
        "{checked}"
    );
}
