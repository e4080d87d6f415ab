//! Messages and effects when Slurm is busy, refuses, or is missing: the commands are small scripts here.

use super::{STUDY, submissions, until};
use crate::{
    cross_play, looks,
    program::{Answer, Bench, answer},
};
use std::{
    os::unix::fs::PermissionsExt,
    process::{Command, Stdio},
};

const SETTINGS: &str = "executor = \"slurm\"\n[slurm]\npoll_s = 1\n";

/// Counts its calls in a file and leaves with a complaint at the first ones.
const COUNT: &str =
    "n=$(($(cat count-$(basename $0) 2>/dev/null || echo 0) + 1)); echo $n > count-$(basename $0)";

/// A folder with a study and scripts in place of Slurm's commands.
fn bench(sbatch: &str, squeue: &str) -> Bench {
    let bench = Bench::new();
    bench.write(
        "small.yaml",
        &STUDY.replace("final_episodes: 2000", "final_episodes: 10"),
    );
    bench.write("regimen.toml", SETTINGS);
    std::fs::create_dir(bench.path("bin")).unwrap();
    let scripts = [
        ("sbatch", sbatch),
        ("squeue", squeue),
        ("scontrol", "echo 'MaxArraySize = 1001'"),
        ("scancel", ""),
    ];
    for (name, script) in scripts {
        let path = bench.write(
            &format!("bin/{name}"),
            &format!("#!/bin/bash\n{COUNT}\n{script}\n"),
        );
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755)).unwrap();
    }
    bench
}

fn run(bench: &Bench, arguments: &[&str]) -> Answer {
    let path = format!(
        "{}:{}",
        bench.path("bin").display(),
        std::env::var("PATH").unwrap()
    );
    answer(&bench.command(arguments).env("PATH", path).output().unwrap())
}

/// The same with the program that tests misuse.
fn run_misused(bench: &Bench, arguments: &[&str]) -> Answer {
    let path = format!(
        "{}:{}",
        bench.path("bin").display(),
        std::env::var("PATH").unwrap()
    );
    answer(&bench.misused(arguments).env("PATH", path).output().unwrap())
}

fn calls(bench: &Bench, program: &str) -> u32 {
    std::fs::read_to_string(bench.path(&format!("count-{program}")))
        .map_or(0, |text| text.trim().parse().unwrap_or(0))
}

/// The batch script, run at once in place of being queued.
const RUN: &str = "bash \"$2\" > worker.log 2>&1";

/// A queue in which two tasks of whatever is asked for run.
const TWO_RUN: &str = "for word; do case $word in --name=*) for _ in 1 2; do echo \
                       \"${word#--name=}|7|RUNNING|None\"; done;; esac; done";

#[test]
fn a_busy_controller_is_asked_again_under_the_same_name() {
    let busy =
        "if [ $n = 1 ]; then echo \"$(basename $0): error: Unexpected message received\" >&2; exit 1; fi";
    let bench = bench(&format!("{busy}; {RUN}; echo 7"), busy);
    let ran = run(&bench, &["run", "small.yaml"]);
    assert_eq!(ran.code, 0, "{}\n{}", ran.out, ran.err);
    assert!(
        ran.err
            .contains("sbatch gets no answer: Unexpected message received; trying again in 1 s"),
        "{}",
        ran.err
    );
    assert!(
        ran.err
            .contains("squeue gets no answer: Unexpected message received; trying again in 2 s"),
        "{}",
        ran.err
    );
    assert_eq!((submissions(&bench).len(), calls(&bench, "sbatch")), (1, 2));
    assert_eq!(bench.digests("store").len(), 6);
}

#[test]
fn a_job_that_was_taken_without_an_answer_is_not_submitted_twice() {
    let lost = "echo 'sbatch: error: Batch job submission failed: Socket timed out on send/recv operation' \
                >&2; exit 1";
    let bench = bench(&format!("{RUN}; {lost}"), TWO_RUN);
    let ran = run(&bench, &["run", "small.yaml"]);
    assert_eq!(ran.code, 0, "{}\n{}", ran.out, ran.err);
    assert_eq!(
        (submissions(&bench).len(), calls(&bench, "sbatch")),
        (1, 1),
        "{}",
        ran.err
    );
}

#[test]
fn policies_that_meet_are_run_after_their_training() {
    let bench = bench(&format!("{RUN}; echo 7"), "");
    bench.write("small.yaml", cross_play::STUDY);
    let ran = run(&bench, &["run", "small.yaml"]);
    assert_eq!(ran.code, 0, "{}\n{}", ran.out, ran.err);
    assert_eq!(bench.digests("store").len(), cross_play::TRIALS);
}

#[test]
fn planned_looks_are_taken_by_jobs_as_on_one_machine() {
    let bench = bench(&format!("{RUN}; echo 7"), "");
    bench.write("small.yaml", looks::STUDY);
    let ran = run(&bench, &["run", "small.yaml"]);
    assert_eq!(ran.code, 0, "{}\n{}", ran.out, ran.err);
    bench.write("looks.yaml", looks::STUDY);
    bench.ok(&[
        "run",
        "looks.yaml",
        "--executor",
        "local",
        "--store",
        "local",
        "-o",
        "elsewhere",
    ]);
    assert_eq!(bench.digests("store"), bench.digests("local"));
}

#[test]
fn the_wait_ends_where_a_policy_never_comes() {
    let bench = bench(&format!("{RUN}; echo 7"), "");
    bench.write(
        "small.yaml",
        &cross_play::STUDY.replace(
            "still: { zero_action: {} }",
            "still: { misbehaving: { how: fail } }",
        ),
    );
    let ran = run_misused(&bench, &["run", "small.yaml"]);
    assert_eq!(
        (ran.code, calls(&bench, "sbatch")),
        (106, 1),
        "{}\n{}",
        ran.out,
        ran.err
    );
    let again = run_misused(&bench, &["run", "small.yaml"]);
    assert_eq!((again.code, calls(&bench, "sbatch")), (106, 1), "{}", again.err);
    assert!(
        again.err.contains("it takes what is not there; nothing runs"),
        "{}",
        again.err
    );
}

#[test]
fn what_failed_is_submitted_again_when_asked() {
    let bench = bench(&format!("{RUN}; echo 7"), "");
    let failing = STUDY.replace(
        "rule: { rank_rule: { weights: [0.15, 0.25, 0.25, 0.35] } }",
        "odd: { misbehaving: { how: fail } }",
    );
    bench.write("small.yaml", &failing.replace("steps: 0", "steps: 16"));
    assert_eq!(
        (
            run_misused(&bench, &["run", "small.yaml"]).code,
            calls(&bench, "sbatch")
        ),
        (100, 1)
    );
    let plain = run_misused(&bench, &["run", "small.yaml"]);
    assert_eq!((plain.code, calls(&bench, "sbatch")), (100, 1), "{}", plain.err);
    assert!(
        plain
            .err
            .contains("3 trials did not end ok (3 failed): `regimen run small.yaml --retry-failed`"),
        "{}",
        plain.err
    );
    let again = run_misused(&bench, &["run", "small.yaml", "--retry-failed"]);
    assert_eq!((again.code, calls(&bench, "sbatch")), (100, 2), "{}", again.err);
}

#[test]
fn a_refusal_is_told_in_slurms_words_and_not_repeated() {
    let bench = bench(
        "echo 'sbatch: error: invalid partition specified: nope' >&2\n\
         echo 'sbatch: error: Batch job submission failed: Invalid partition name specified' >&2; exit 1",
        "",
    );
    let ran = run(&bench, &["submit", "small.yaml", "--executor", "slurm"]);
    assert_eq!((ran.code, calls(&bench, "sbatch")), (2, 1));
    assert!(
        ran.err
            .contains("sbatch refuses: invalid partition specified: nope; Batch job submission failed"),
        "{}",
        ran.err
    );
    assert_eq!(run(&bench, &["status", "small.yaml"]).code, 106);
    assert_eq!(
        calls(&bench, "squeue"),
        0,
        "a refused submission is not asked about"
    );
}

#[test]
fn who_stops_waiting_is_told_that_the_jobs_go_on() {
    let bench = bench("echo 7", TWO_RUN);
    let path = format!(
        "{}:{}",
        bench.path("bin").display(),
        std::env::var("PATH").unwrap()
    );
    let mut command = bench.command(&["run", "small.yaml"]);
    let follower = command
        .env("PATH", path)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    until("the queue was asked", || calls(&bench, "squeue") > 0);
    assert!(
        Command::new("kill")
            .args(["-INT", &follower.id().to_string()])
            .status()
            .unwrap()
            .success()
    );
    let left = answer(&follower.wait_with_output().unwrap());
    assert_eq!((left.code, calls(&bench, "scancel")), (106, 0), "{}", left.err);
    assert!(
        left.err.contains("Slurm: 2 running") && left.err.contains("`regimen cancel small.yaml` ends them"),
        "{}",
        left.err
    );
}

#[test]
fn only_slurm_is_left_behind() {
    let bench = bench("", "");
    let ran = run(&bench, &["run", "small.yaml", "--executor", "local", "--detach"]);
    assert_eq!(ran.code, 2);
    assert!(ran.err.contains("--detach needs --executor slurm"), "{}", ran.err);
}

#[test]
fn tasks_that_die_at_once_end_the_wait_with_their_words() {
    let bench = bench(
        "for file in store/submissions/*/; do echo 'regimen: not found' > $file/array-0-task-0.log; done; \
         echo 7",
        "",
    );
    let ran = run(&bench, &["run", "small.yaml"]);
    assert_eq!((ran.code, calls(&bench, "sbatch")), (106, 4), "{}", ran.err);
    assert!(
        ran.err
            .contains("4 submissions in a row ended without finishing a trial"),
        "{}",
        ran.err
    );
    assert!(ran.err.contains("regimen: not found"), "{}", ran.err);
}

#[test]
fn the_dry_run_prints_the_script_and_asks_nobody() {
    let bench = bench("exit 1", "exit 1");
    let ran = run(
        &bench,
        &[
            "submit",
            "small.yaml",
            "--executor",
            "slurm",
            "--dry-run",
            "--seeds",
            "2",
        ],
    );
    assert_eq!(ran.code, 0, "{}", ran.err);
    assert!(
        ran.out.contains("#SBATCH --array=0-0%1\n") && ran.out.contains(" --seeds 2\n"),
        "{}",
        ran.out
    );
    assert_eq!(
        calls(&bench, "sbatch") + calls(&bench, "squeue") + calls(&bench, "scontrol"),
        0
    );
    assert!(submissions(&bench).is_empty());
}

#[test]
fn a_machine_without_slurm_is_told_so() {
    let bench = bench("", "");
    let ran = answer(
        &bench
            .command(&["run", "small.yaml"])
            .env("PATH", bench.path("nowhere"))
            .output()
            .unwrap(),
    );
    assert_eq!(ran.code, 2);
    assert!(
        ran.err.contains("cannot start `scontrol`") && ran.err.contains("where Slurm's commands are"),
        "{}",
        ran.err
    );
}

/// Commands may take a second here.
const IMPATIENT: &str = "executor = \"slurm\"\n[slurm]\npoll_s = 1\nanswer_s = 1\nsubmit_s = 1\n";

#[test]
fn a_queue_that_hangs_is_asked_again_and_hides_no_stored_trial() {
    let later = "setsid bash -c \"sleep 4; bash $2\" > worker.log 2>&1 & echo 7";
    let bench = bench(later, "if [ $n -le 2 ]; then sleep 600; fi");
    bench.write(
        "regimen.toml",
        &IMPATIENT.replace("submit_s = 1", "submit_s = 100"),
    );
    let ran = run(&bench, &["run", "small.yaml"]);
    assert_eq!(ran.code, 0, "{}\n{}", ran.out, ran.err);
    assert!(
        ran.err
            .contains("squeue gave no answer within 1 s and was ended; "),
        "{}",
        ran.err
    );
    assert_eq!(bench.digests("store").len(), 6);
}

#[test]
fn a_submission_that_hangs_is_sent_again_under_its_name() {
    let bench = bench(
        &format!("if [ $n = 1 ]; then sleep 600; fi; setsid {RUN} & sleep 0.1; echo 7"),
        "",
    );
    bench.write("regimen.toml", IMPATIENT);
    let ran = run(&bench, &["run", "small.yaml"]);
    assert_eq!(ran.code, 0, "{}\n{}", ran.out, ran.err);
    assert!(
        ran.err
            .contains("sbatch gave no answer within 1 s and was ended; trying again in 1 s"),
        "{}",
        ran.err
    );
    assert_eq!(submissions(&bench).len(), 1);
}

#[test]
fn one_interrupt_ends_the_wait_for_a_command_that_hangs() {
    for (sbatch, squeue, hanging) in [("sleep 600", "", "sbatch"), ("echo 7", "sleep 600", "squeue")] {
        let bench = bench(sbatch, squeue);
        let path = format!(
            "{}:{}",
            bench.path("bin").display(),
            std::env::var("PATH").unwrap()
        );
        let mut command = bench.command(&["run", "small.yaml"]);
        let run = command
            .env("PATH", path)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let run = run.spawn().unwrap();
        until("the command was called", || calls(&bench, hanging) > 0);
        let interrupted = std::time::Instant::now();
        let pid = run.id().to_string();
        assert!(
            Command::new("kill")
                .args(["-INT", &pid])
                .status()
                .unwrap()
                .success()
        );
        let left = answer(&run.wait_with_output().unwrap());
        assert!(
            interrupted.elapsed().as_secs() < 50,
            "the limit is a minute or more"
        );
        assert_eq!(left.code, 106, "{}", left.err);
        assert!(
            left.err.contains("`regimen cancel small.yaml` ends them"),
            "{}",
            left.err
        );
    }
}

#[test]
fn who_holds_the_lock_of_submissions_is_named_and_not_waited_for_without_end() {
    let bench = bench(&format!("{RUN}; echo 7"), "");
    bench.write("regimen.toml", IMPATIENT);
    std::fs::create_dir_all(bench.path("store/submissions")).unwrap();
    let path = bench.write("store/submissions/lock", "process 12 on elsewhere\n");
    let held = std::fs::File::options().append(true).open(path).unwrap();
    held.lock().unwrap();
    let refused = run(&bench, &["run", "small.yaml"]);
    assert_eq!(
        (refused.code, calls(&bench, "sbatch")),
        (106, 0),
        "{}",
        refused.err
    );
    for words in [
        "which process 12 on elsewhere holds",
        "process 12 on elsewhere holds `",
    ] {
        assert!(refused.err.contains(words), "{words}: {}", refused.err);
    }
    drop(held);
    bench.write("regimen.toml", SETTINGS);
    assert_eq!(run(&bench, &["run", "small.yaml"]).code, 0);
}

#[test]
fn a_damaged_record_of_a_submission_is_set_aside_and_said() {
    for command in ["status", "run", "submit", "cancel"] {
        let bench = bench(&format!("{RUN}; echo 7"), "");
        bench.write("regimen.toml", SETTINGS);
        std::fs::create_dir_all(bench.path("store/submissions/0123456789")).unwrap();
        let record = bench.write("store/submissions/0123456789/submission.json", "{\"schema\": 1");
        let checked = bench.run(&["fsck", "store", "--dry-run"]);
        assert!(
            checked
                .out
                .contains("damaged   submissions/0123456789/submission.json: ")
                && record.exists(),
            "{}",
            checked.out
        );
        let executor = ["--executor", "slurm"];
        let more = if command == "submit" { &executor[..] } else { &[] };
        let did = run(&bench, &[&[command, "small.yaml"][..], more].concat());
        let expected = match command {
            "status" => 106,
            "cancel" => 4,
            _ => 0,
        };
        assert_eq!(did.code, expected, "{command}: {}", did.err);
        for words in ["was set aside in `aside/1`", "named regimen-0123456789"] {
            assert!(did.err.contains(words), "{command}: {}", did.err);
        }
        assert!(!record.exists());
        let again = run(&bench, &["status", "small.yaml"]);
        assert!(!again.err.contains("aside"), "{}", again.err);
        let checked = bench.ok(&["fsck", "store"]);
        assert!(checked.contains("0 files are wrong"), "{checked}");
    }
}
