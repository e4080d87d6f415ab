//! Learners on a device: the same bits as on cores, and a device that is lost or missing.
//!
//! The device of these tests is the processor, which runs the text of the kernels for a card.

use crate::program::Bench;

const STUDY: &str = "\
study: small
environments: { two: { battery: { cells: 2, episode_limit: 12 } } }
agents:
  dsac: { dirichlet_sac: { width: 8, batch_size: 16, learning_starts: 32, replay_capacity: 512 } }
  ddpg: { ddpg: { width: 8, batch_size: 16, learning_starts: 32, replay_capacity: 512 } }
  equal: { equal_split: {} }
protocol: { train_evaluate: { steps: 96, environments: 4, evaluate_every: 48, episodes: 3, final_episodes: 6 } }
seeds: 3
tables:
  lives: { comparison: { rows: agent, value: cycle_length } }
";

fn on_cores() -> Vec<(String, String)> {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.ok(&["run", "small.yaml"]);
    bench.digests("store")
}

#[test]
fn trials_on_a_device_have_the_digests_of_trials_on_cores() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    let ran = bench.run_misused(&["run", "small.yaml", "--device", "literal"]);
    assert_eq!(ran.code, 0, "{}\n{}", ran.out, ran.err);
    assert!(
        ran.err.contains("worker processes and a literal processor;"),
        "{}",
        ran.err
    );
    assert_eq!(bench.digests("store"), on_cores());
    // The learners were there, not in the worker processes.
    let folders = std::fs::read_dir(bench.path(".")).unwrap();
    let folders = folders.map(|entry| entry.unwrap().path());
    let programs: Vec<_> = folders
        .filter(|path| path.to_string_lossy().contains("programs-"))
        .collect();
    assert_eq!(programs.len(), 1, "{programs:?}");
    let compiled = std::fs::read_dir(&programs[0]).unwrap().count();
    assert!(compiled >= 8, "{compiled} files of programs");
}

#[test]
fn a_lost_device_loses_no_trial_and_cores_go_on_to_the_same_digests() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.write(
        "regimen.toml",
        "device = \"short-lived\"\ncheckpoint_every_s = 0\n",
    );
    let lost = bench.run_misused(&["run", "small.yaml"]);
    assert_ne!(lost.code, 0, "{}\n{}", lost.out, lost.err);
    assert!(
        lost.err.contains("the card is lost: it fell off the bus"),
        "{}",
        lost.err
    );
    let ends = bench.digests("store").len();
    assert!(ends < 9, "{ends} trials have ended");
    let again = bench.run_misused(&["run", "small.yaml", "--device", "processor"]);
    assert_eq!(again.code, 0, "{}\n{}", again.out, again.err);
    assert_eq!(bench.digests("store"), on_cores());
}

#[test]
fn a_machine_without_a_card_says_in_one_sentence_what_it_lacks() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    let mut command = bench.command(&["run", "small.yaml", "--device", "cuda"]);
    // A card of the machine is hidden.
    let answer = crate::program::answer(&command.env("CUDA_VISIBLE_DEVICES", "").output().unwrap());
    assert_eq!(answer.code, 2, "{}\n{}", answer.out, answer.err);
    let known = ["this machine has no driver of NVIDIA", "the driver finds no card"];
    assert!(
        known.iter().any(|words| answer.err.contains(words)),
        "{}",
        answer.err
    );
    let rest = "without `--device cuda` the trials run on cores, with the same bits";
    assert!(answer.err.contains(rest), "{}", answer.err);
    assert!(!bench.path("store/trials").exists(), "nothing has run");
}

#[test]
fn an_unknown_device_is_refused_with_those_that_are_known() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    let answer = bench.run(&["run", "small.yaml", "--device", "gpu"]);
    assert_ne!(answer.code, 0);
    assert!(
        answer
            .err
            .contains("there is no device `gpu`; known: processor, cuda"),
        "{}",
        answer.err
    );
}
