//! Trials through HyperQueue equal local ones, whatever happens to tasks, workers, the server and those who wait.
//!
//! Server and workers are those of the published package, each in a process of its own.

mod refusals;

use crate::{
    needs,
    program::{Answer, Bench, answer, repository},
    searches,
    slurm::{FAILING, LONG, STUDY, logs, only, submissions, until},
};
use std::{
    io::{BufRead as _, BufReader},
    path::PathBuf,
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

#[test]
fn trials_through_hyperqueue_equal_local_ones() {
    let Some(mut cluster) = Cluster::start() else {
        return;
    };
    let (_one, _other) = (cluster.worker(), cluster.worker());
    let bench = cluster.bench(STUDY, "min_time_s = 1\n");
    let ran = bench.run(&["run", "small.yaml"]);
    assert_eq!(ran.code, 0, "{}\n{}", ran.out, ran.err);
    assert!(ran.out.contains("results/small/index.html"), "{}", ran.out);
    assert_eq!(bench.digests("store"), local(STUDY));
    assert!(
        ran.err.contains("HyperQueue: ") && ran.err.contains("(job 1@"),
        "{}",
        ran.err
    );
    let again = bench.run(&["run", "small.yaml"]);
    assert_eq!((again.code, submissions(&bench).len()), (0, 1), "{}", again.err);
    assert!(again.err.contains("nothing runs"), "{}", again.err);
}

#[test]
fn a_detached_submission_is_found_again_and_not_doubled() {
    let Some(mut cluster) = Cluster::start() else {
        return;
    };
    let bench = cluster.bench(STUDY, "");
    let detached = bench.run(&["run", "small.yaml", "--detach"]);
    assert_eq!(detached.code, 0, "{}", detached.err);
    let id = only(submissions(&bench));
    assert!(
        detached.err.contains(&format!("submitted {id} (")),
        "{}",
        detached.err
    );
    let status = bench.run(&["status", "small.yaml"]);
    assert!(
        status.out.contains(&format!("HyperQueue: {id} (")),
        "{}",
        status.out
    );
    assert!(status.out.contains("3 pending"), "{}", status.out);
    let _worker = cluster.worker();
    let followed = bench.run(&["run", "small.yaml"]);
    assert_eq!(followed.code, 0, "{}", followed.err);
    assert!(
        followed.err.contains(&format!("following {id} (")),
        "{}",
        followed.err
    );
    assert_eq!(only(submissions(&bench)), id);
    assert_eq!(bench.digests("store"), local(STUDY));
}

#[test]
fn who_waits_may_be_interrupted_and_goes_on() {
    let Some(mut cluster) = Cluster::start() else {
        return;
    };
    let _worker = cluster.worker();
    let bench = cluster.bench(STUDY, "");
    let follower = spawn(&bench, &["run", "small.yaml"]);
    until("a worker runs", || logs(&bench).contains("worker process"));
    let left = interrupted(follower);
    assert_eq!(left.code, 106, "{}", left.err);
    assert!(
        left.err.contains("the jobs go on without this program"),
        "{}",
        left.err
    );
    hold(&bench, spawn(&bench, &["run", "small.yaml"]), STUDY);
    assert_eq!(submissions(&bench).len(), 1);
}

/// HyperQueue starts the task again elsewhere, where its trial goes on.
#[test]
fn a_worker_that_is_killed_costs_no_trial() {
    let Some(mut cluster) = Cluster::start() else {
        return;
    };
    let (one, other) = (cluster.worker(), cluster.worker());
    let bench = cluster.bench(STUDY, "");
    let follower = spawn(&bench, &["run", "small.yaml"]);
    until("both workers run", || {
        logs(&bench).matches("worker process").count() >= 2
    });
    drop(one);
    hold(&bench, follower, STUDY);
    drop(other);
}

/// A task that ends badly is not started again by HyperQueue.
#[test]
fn a_task_that_dies_is_submitted_again() {
    let Some(mut cluster) = Cluster::start() else {
        return;
    };
    let _worker = cluster.worker();
    let bench = cluster.bench(STUDY, "trials_per_task = 6\n");
    let follower = spawn(&bench, &["run", "small.yaml"]);
    let mut process = None;
    until("status says which process computes", || {
        let told = bench.run(&["status", "small.yaml"]).out;
        let rest = told.split_once(": process ").map(|(_, rest)| rest.to_owned());
        process = rest.and_then(|rest| Some(rest.split_once(' ')?.0.to_owned()));
        process.is_some()
    });
    let killed = Command::new("kill")
        .args(["-KILL", &process.unwrap_or_default()])
        .status();
    assert!(killed.unwrap().success());
    let told = hold(&bench, follower, STUDY);
    assert!(told.contains("submitted again: "), "{told}");
    assert_eq!(submissions(&bench).len(), 2);
}

#[test]
fn a_search_chooses_what_it_chooses_here() {
    let Some(mut cluster) = Cluster::start() else {
        return;
    };
    let _worker = cluster.worker();
    let bench = cluster.bench(&searches::halving(), "");
    bench.ok(&[
        "run",
        "small.yaml",
        "--executor",
        "local",
        "--store",
        "local",
        "-o",
        "here",
    ]);
    let ran = bench.run(&["run", "small.yaml", "-o", "there"]);
    assert_eq!(ran.code, 0, "{}\n{}", ran.out, ran.err);
    assert_eq!(bench.digests("store"), bench.digests("local"));
}

/// The number of a job means nothing to the server that comes after it, which gives the same number again.
#[test]
fn a_server_that_is_killed_costs_no_trial() {
    let Some(mut cluster) = Cluster::start() else {
        return;
    };
    let worker = cluster.worker();
    let bench = cluster.bench(STUDY, "");
    let follower = spawn(&bench, &["run", "small.yaml"]);
    until("a worker runs", || logs(&bench).contains("worker process"));
    cluster.kill();
    drop(worker);
    // It is asked in vain meanwhile.
    std::thread::sleep(Duration::from_secs(2));
    let status = bench.run(&["status", "small.yaml"]);
    assert!(
        status.err.contains("warning: nobody can be asked"),
        "{}",
        status.err
    );
    cluster.restart();
    let _worker = cluster.worker();
    let told = hold(&bench, follower, STUDY);
    assert!(told.contains("HyperQueue's client gets no answer: "), "{told}");
    assert!(told.contains("submitted again: "), "{told}");
}

/// The task that computes leaves with a checkpoint, and the one that waits finds out when it begins.
#[test]
fn a_cancelled_submission_ends_the_wait_and_its_tasks() {
    let Some(mut cluster) = Cluster::start() else {
        return;
    };
    let _worker = cluster.worker();
    let bench = cluster.bench(
        &LONG.replace("protocol:", "seeds: 2\nprotocol:"),
        "trials_per_task = 1\n",
    );
    let follower = spawn(&bench, &["run", "small.yaml"]);
    until("a worker runs", || logs(&bench).contains("worker process"));
    let cancelled = bench.run(&["cancel", "small.yaml"]);
    assert_eq!(cancelled.code, 0, "{}", cancelled.err);
    let left = answer(&follower.wait_with_output().unwrap());
    assert_eq!(left.code, 106, "{}", left.err);
    assert!(left.err.contains("the submission was cancelled"), "{}", left.err);
    let nobody = format!(
        "nobody waits for submission {} any more",
        only(submissions(&bench))
    );
    until("both tasks have left", || {
        let logs = logs(&bench);
        logs.contains("still missing; the same command goes on") && logs.contains(&nobody)
    });
    assert_eq!(
        bench.run(&["cancel", "small.yaml"]).code,
        4,
        "there is nothing left to cancel"
    );
}

#[test]
fn a_trial_that_fails_is_one_row() {
    let Some(mut cluster) = Cluster::start() else {
        return;
    };
    let _worker = cluster.worker();
    let bench = cluster.bench(FAILING, "");
    let ran = bench.run(&["run", "small.yaml"]);
    assert_eq!(ran.code, 100, "{}\n{}", ran.out, ran.err);
    assert!(ran.err.contains("is not finite"), "{}", ran.err);
    let here = Bench::new();
    here.write("small.yaml", FAILING);
    assert_eq!(here.run(&["run", "small.yaml", "-j", "1"]).code, 100);
    assert_eq!(bench.digests("store"), here.digests("store"));
}

/// More trials than tasks may be handed over: those that are there pull until none is left.
#[test]
fn no_more_tasks_are_handed_over_than_may_live() {
    let Some(mut cluster) = Cluster::start() else {
        return;
    };
    let bench = cluster.bench(STUDY, "");
    let detached = bench.run(&["run", "small.yaml", "--detach", "-j", "2"]);
    assert!(detached.err.contains("2 tasks, 2 at a time"), "{}", detached.err);
    let _worker = cluster.worker();
    hold(&bench, spawn(&bench, &["run", "small.yaml", "-j", "2"]), STUDY);
    assert_eq!(submissions(&bench).len(), 1);
}

/// Results of the same study here.
fn local(study: &str) -> Vec<(String, String)> {
    let bench = Bench::new();
    bench.write("small.yaml", study);
    bench.ok(&["worker", "small.yaml", "-j", "2"]);
    bench.digests("store")
}

/// Waits for the follower and holds its store against a local one; returns what it said.
fn hold(bench: &Bench, follower: Child, study: &str) -> String {
    let ran = answer(&follower.wait_with_output().unwrap());
    assert_eq!(ran.code, 0, "{}\n{}\n{}", ran.out, ran.err, logs(bench));
    assert_eq!(bench.digests("store"), local(study), "{}", ran.err);
    ran.err
}

fn spawn(bench: &Bench, arguments: &[&str]) -> Child {
    let mut command = bench.command(arguments);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command.spawn().unwrap()
}

/// Output of a program that is interrupted, which it notices soon.
fn interrupted(child: Child) -> Answer {
    let id = child.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-INT", &id])
            .status()
            .unwrap()
            .success()
    );
    let begun = Instant::now();
    let left = answer(&child.wait_with_output().unwrap());
    assert!(begun.elapsed() < Duration::from_secs(20), "{}", left.err);
    left
}

/// A process of the package, killed at the end.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A server without workers in a temporary folder.
struct Cluster {
    folder: tempfile::TempDir,
    python: &'static str,
    server: Option<Running>,
    workers: usize,
}

impl Cluster {
    /// `None`, with a message, where the package is not installed.
    fn start() -> Option<Self> {
        let mut cluster = Self {
            folder: tempfile::tempdir().unwrap(),
            python: needs::python("hyperqueue")?,
            server: None,
            workers: 0,
        };
        cluster.restart();
        Some(cluster)
    }

    fn directory(&self) -> PathBuf {
        self.folder.path().join("server")
    }

    fn restart(&mut self) {
        let directory = self.directory();
        self.server = Some(self.process(&["server", &directory.to_string_lossy()]));
    }

    fn kill(&mut self) {
        self.server = None;
    }

    /// One more worker, with one core.
    fn worker(&mut self) -> Running {
        self.workers += 1;
        let own = self.folder.path().join(format!("worker-{}", self.workers));
        let directory = self.directory();
        self.process(&[
            "worker",
            &directory.to_string_lossy(),
            &own.to_string_lossy(),
            "1",
        ])
    }

    fn process(&self, arguments: &[&str]) -> Running {
        let mut command = Command::new(self.python);
        command.arg(repository().join("tests/hyperqueue/cluster.py"));
        command
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped());
        let mut child = command.stderr(Stdio::null()).spawn().unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let begun = lines.any(|line| line.is_ok_and(|line| line == "begun"));
        assert!(begun, "{arguments:?} does not begin");
        Running(child)
    }

    /// A folder with a study, whose runs go to this server; a task is worth two trials.
    fn bench(&self, study: &str, settings: &str) -> Bench {
        let bench = Bench::new();
        bench.write("small.yaml", study);
        let (directory, python) = (self.directory(), self.python);
        let two = if settings.contains("trials_per_task") {
            ""
        } else {
            "trials_per_task = 2\n"
        };
        let settings = format!(
            "executor = \"hyperqueue\"\n[hyperqueue]\nserver_dir = \"{}\"\npython = \"{python}\"\npoll_s = 1\n{two}{settings}",
            directory.display()
        );
        bench.write("regimen.toml", &settings);
        bench
    }
}
