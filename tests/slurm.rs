//! Trials through Slurm equal local ones, whatever happens to tasks, nodes and the controller.
//!
//! A real cluster of two nodes is started by `tests/slurm/start`. The scenarios share the cluster and run one after the
//! other.

mod fake;

use crate::{
    needs,
    program::{Answer, Bench, answer, repository},
    programs,
};
use std::{
    path::PathBuf,
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

/// Trials of a second or so, which a rule's many episodes take.
pub(crate) const STUDY: &str = "
study: small
title: A small study
source: made for this test
environments:
  cells: { battery: { cells: 4 } }
agents:
  equal: { equal_split: {} }
  rule: { rank_rule: { weights: [0.15, 0.25, 0.25, 0.35] } }
protocol: { train_evaluate: { steps: 0, final_episodes: 2000, trace_episodes: 0 } }
seeds: 3
";

/// A learner whose temperature overflows, beside a rule that does well.
pub(crate) const FAILING: &str = "
study: failing
title: A study with a trial that fails
source: made for this test
environments:
  cells: { battery: { cells: 2 } }
agents:
  equal: { equal_split: {} }
  dsac: { dirichlet_sac: { width: 16, batch_size: 16, learning_starts: 64, updates_per_step: 1, \
  temperature_learning_rate: 1, target_entropy: { nats: 1000 } } }
protocol: { train_evaluate: { steps: 256, environments: 8, evaluate_every: 128, episodes: 2, \
final_episodes: 6 } }
seeds: 1
";

/// One trial that learns for half a minute or more.
pub(crate) const LONG: &str = "
study: long
title: A trial longer than a task
source: made for this test
environments:
  cells: { battery: { cells: 2 } }
agents:
  dsac: { dirichlet_sac: {} }
protocol: { train_evaluate: { steps: 64000, evaluate_every: 0, episodes: 0, final_episodes: 10, \
trace_episodes: 0 } }
";

/// Options of Slurm in every scenario: few cores, quick answers, and logs that tell the node.
const SETTINGS: &str = "executor = \"slurm\"\n[slurm]\npoll_s = 1\ntrials_per_task = 2\nsetup = [\"echo on \
                        $SLURMD_NODENAME\"]\n";

#[test]
fn trials_through_slurm_equal_local_ones() {
    let Some(cluster) = Cluster::start() else { return };
    let expected = Expected::compute();
    both_nodes_work_and_a_second_run_does_nothing(&cluster, &expected);
    a_detached_submission_is_found_again_and_not_doubled(&cluster, &expected);
    a_cancelled_submission_ends_the_wait(&cluster);
    a_failing_trial_is_one_row(&cluster);
    a_search_chooses_what_it_chooses_here(&cluster);
    a_program_has_the_cores_and_cards_of_its_task(&cluster);
    a_task_that_is_requeued_goes_on(&cluster, &expected);
    cancelled_tasks_are_submitted_again(&cluster, &expected);
    a_time_limit_costs_no_trial(&cluster);
    a_lost_node_costs_no_trial(&cluster, &expected);
    // Last: the controller may give ids of jobs again that the nodes still know, and then drains them.
    a_controller_that_crashes_costs_no_trial(&cluster, &expected);
}

fn both_nodes_work_and_a_second_run_does_nothing(cluster: &Cluster, expected: &Expected) {
    let bench = expected.bench(STUDY, SETTINGS);
    let ran = cluster.run(&bench, &["run", "small.yaml"]);
    assert_eq!(ran.code, 0, "{}\n{}", ran.out, ran.err);
    assert!(ran.out.contains("results/small/index.html"), "{}", ran.out);
    assert_eq!(bench.digests("store"), expected.digests);
    let logs = logs(&bench);
    assert!(logs.contains("on n1") && logs.contains("on n2"), "{logs}");
    let again = cluster.run(&bench, &["run", "small.yaml"]);
    assert_eq!((again.code, submissions(&bench).len()), (0, 1), "{}", again.err);
    assert!(again.err.contains("nothing runs"), "{}", again.err);
}

fn a_detached_submission_is_found_again_and_not_doubled(cluster: &Cluster, expected: &Expected) {
    let bench = expected.bench(STUDY, SETTINGS);
    let detached = cluster.run(&bench, &["run", "small.yaml", "--detach"]);
    assert_eq!(detached.code, 0, "{}", detached.err);
    let id = only(submissions(&bench));
    assert!(
        detached.err.contains(&format!("submitted {id} (job ")),
        "{}",
        detached.err
    );
    let status = cluster.run(&bench, &["status", "small.yaml"]);
    assert!(
        status.out.contains(&format!("Slurm: {id} (job ")),
        "{}",
        status.out
    );
    let followed = cluster.run(&bench, &["run", "small.yaml"]);
    assert_eq!(followed.code, 0, "{}", followed.err);
    assert!(
        followed.err.contains(&format!("following {id} (job ")),
        "{}",
        followed.err
    );
    assert_eq!(only(submissions(&bench)), id);
    assert_eq!(bench.digests("store"), expected.digests);
}

fn a_cancelled_submission_ends_the_wait(cluster: &Cluster) {
    let bench = Expected::empty(STUDY, SETTINGS);
    let follower = cluster.spawn(&bench, &["run", "small.yaml"]);
    cluster.until_running(&bench);
    let cancelled = cluster.run(&bench, &["cancel", "small.yaml"]);
    assert_eq!(cancelled.code, 0, "{}", cancelled.err);
    let left = answer(&follower.wait_with_output().unwrap());
    assert_eq!(left.code, 106, "{}", left.err);
    assert!(left.err.contains("the submission was cancelled"), "{}", left.err);
    assert_eq!(
        cluster.run(&bench, &["cancel", "small.yaml"]).code,
        4,
        "there is nothing left to cancel"
    );
    cluster.until_idle();
}

fn a_failing_trial_is_one_row(cluster: &Cluster) {
    let (bench, local) = (Expected::empty(FAILING, SETTINGS), Expected::empty(FAILING, ""));
    assert_eq!(local.run(&["run", "small.yaml", "-j", "2"]).code, 100);
    let ran = cluster.run(&bench, &["run", "small.yaml"]);
    assert_eq!(ran.code, 100, "{}\n{}", ran.out, ran.err);
    assert!(ran.err.contains("is not finite"), "{}", ran.err);
    assert_eq!(bench.digests("store"), local.digests("store"));
}

fn a_search_chooses_what_it_chooses_here(cluster: &Cluster) {
    let bench = Bench::new();
    bench.write("tuned.yaml", &crate::searches::halving());
    bench.ok(&["run", "tuned.yaml", "--store", "local", "-o", "here"]);
    bench.write("regimen.toml", SETTINGS);
    let ran = cluster.run(&bench, &["run", "tuned.yaml", "-o", "there"]);
    assert_eq!(ran.code, 0, "{}\n{}", ran.out, ran.err);
    assert_eq!(bench.digests("store"), bench.digests("local"));
    let read =
        |folder: &str| std::fs::read_to_string(bench.path(folder).join("tables/settings.csv")).unwrap();
    assert_eq!(read("there"), read("here"));
}

/// Each node has one core and one card, of which Slurm says the number alone.
fn a_program_has_the_cores_and_cards_of_its_task(cluster: &Cluster) {
    let bench = Bench::new();
    bench.write(
        "a.sh",
        "echo r=$1\necho \"$1 cards=$CUDA_VISIBLE_DEVICES threads=$OMP_NUM_THREADS\" >>\"$2\"\n",
    );
    let notes = bench.path("notes");
    let words = format!("[sh, a.sh, \"{{seed}}\", {}]", notes.display());
    let study = programs::study_of(&words, "{ return: r }", "      needs: { cores: 1, gpus: 1 }");
    bench.write("study.yaml", &study.replace("seeds: 1", "seeds: 4"));
    bench.write("regimen.toml", SETTINGS);
    let refused = cluster.run(&bench, &["run", "study.yaml", "--yes"]);
    assert_eq!(refused.code, 2, "{}", refused.err);
    assert!(
        refused.err.contains("a task has 1 core and no GPU"),
        "{}",
        refused.err
    );
    bench.write("regimen.toml", &format!("{SETTINGS}gpus_per_task = 1\n"));
    let ran = cluster.run(&bench, &["run", "study.yaml", "--yes"]);
    assert_eq!(ran.code, 0, "{}\n{}\n{}", ran.out, ran.err, logs(&bench));
    let mut noted: Vec<String> = std::fs::read_to_string(notes)
        .unwrap()
        .lines()
        .map(Into::into)
        .collect();
    noted.sort();
    let expected: Vec<String> = (0..4).map(|seed| format!("{seed} cards=0 threads=1")).collect();
    assert_eq!(noted, expected);
}

fn a_task_that_is_requeued_goes_on(cluster: &Cluster, expected: &Expected) {
    let bench = expected.bench(STUDY, SETTINGS);
    let follower = cluster.spawn(&bench, &["run", "small.yaml"]);
    let task = cluster.until_running(&bench);
    cluster.call("scontrol", &["requeue", &task]);
    // Slurm waits for two minutes before a requeued task may start.
    until("the delay is lifted", || {
        cluster.succeeds("scontrol", &["update", &format!("jobid={task}"), "StartTime=now"])
    });
    expected.hold_for(&bench, follower);
}

fn cancelled_tasks_are_submitted_again(cluster: &Cluster, expected: &Expected) {
    let bench = expected.bench(STUDY, SETTINGS);
    let follower = cluster.spawn(&bench, &["run", "small.yaml"]);
    cluster.until_running(&bench);
    let id = only(submissions(&bench));
    cluster.call("scancel", &[&format!("--name=regimen-{id}")]);
    let told = expected.hold_for(&bench, follower);
    assert!(told.contains("submitted again: "), "{told}");
}

/// A trial that learns for longer than a task may run: every task is told to leave within half a minute of
/// its start, hands its trial back with a checkpoint, and the next one goes on from there.
fn a_time_limit_costs_no_trial(cluster: &Cluster) {
    let settings = SETTINGS.replace("[slurm]\n", "[slurm]\ntime = \"1\"\nsignal_lead_s = 50\n");
    let (bench, local) = (Expected::empty(LONG, &settings), Expected::empty(LONG, ""));
    let mut reference = local
        .command(&["run", "small.yaml", "-j", "1"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let ran = cluster.run(&bench, &["run", "small.yaml"]);
    assert_eq!(ran.code, 0, "{}\n{}", ran.out, ran.err);
    assert!(
        ran.err.contains("submitted again: "),
        "the limit was not reached:\n{}",
        ran.err
    );
    assert!(
        logs(&bench).contains("1 trial is still missing"),
        "{}",
        logs(&bench)
    );
    assert!(reference.wait().unwrap().success());
    assert_eq!(bench.digests("store"), local.digests("store"));
}

fn a_lost_node_costs_no_trial(cluster: &Cluster, expected: &Expected) {
    let bench = expected.bench(STUDY, SETTINGS);
    let follower = cluster.spawn(&bench, &["run", "small.yaml"]);
    cluster.until_running(&bench);
    cluster.kill("n1");
    expected.hold_for(&bench, follower);
    cluster.restart("n1");
    cluster.until_idle();
}

fn a_controller_that_crashes_costs_no_trial(cluster: &Cluster, expected: &Expected) {
    let bench = expected.bench(STUDY, SETTINGS);
    let follower = cluster.spawn(&bench, &["run", "small.yaml"]);
    cluster.until_running(&bench);
    cluster.kill("controller");
    // The follower asks in vain meanwhile.
    std::thread::sleep(Duration::from_secs(2));
    cluster.restart("controller");
    expected.hold_for(&bench, follower);
}

/// Records that a local run computes.
struct Expected {
    digests: Vec<(String, String)>,
}

impl Expected {
    fn compute() -> Self {
        let bench = Self::empty(STUDY, "");
        bench.ok(&["run", "small.yaml", "-j", "2"]);
        Self {
            digests: bench.digests("store"),
        }
    }

    fn empty(study: &str, settings: &str) -> Bench {
        let bench = Bench::new();
        bench.write("small.yaml", study);
        bench.write("regimen.toml", settings);
        bench
    }

    fn bench(&self, study: &str, settings: &str) -> Bench {
        assert_eq!(self.digests.len(), 6);
        Self::empty(study, settings)
    }

    /// Waits for the follower and holds its store against the local one; returns what it said.
    fn hold_for(&self, bench: &Bench, follower: Child) -> String {
        let ran = answer(&follower.wait_with_output().unwrap());
        assert_eq!(ran.code, 0, "{}\n{}\n{}", ran.out, ran.err, logs(bench));
        assert_eq!(bench.digests("store"), self.digests, "{}", ran.err);
        ran.err
    }
}

/// A cluster in a temporary folder; stopped at the end.
struct Cluster {
    folder: tempfile::TempDir,
    config: PathBuf,
}

impl Cluster {
    /// `None`, after a line, where this machine cannot have one.
    fn start() -> Option<Self> {
        needs::programs(["slurmctld", "slurmd", "munged", "sbatch", "python3"])?;
        needs::root("start a Slurm cluster")?;
        let folder = tempfile::tempdir().unwrap();
        let cluster = Self {
            config: folder.path().join("slurm.conf"),
            folder,
        };
        cluster.script(&[]);
        Some(cluster)
    }

    fn script(&self, arguments: &[&str]) {
        let mut command = Command::new(repository().join("tests/slurm/start"));
        // The daemons keep what they inherit: a pipe would never end.
        let log = std::fs::File::create(self.folder.path().join("start.log")).unwrap();
        command
            .args(arguments)
            .arg(self.folder.path())
            .stdin(Stdio::null());
        let ended = command
            .stdout(log.try_clone().unwrap())
            .stderr(log)
            .status()
            .unwrap();
        let log = std::fs::read_to_string(self.folder.path().join("start.log")).unwrap();
        assert!(ended.success() || std::thread::panicking(), "{log}");
    }

    fn restart(&self, daemon: &str) {
        self.script(&["--only", daemon]);
    }

    fn kill(&self, daemon: &str) {
        let id = std::fs::read_to_string(self.folder.path().join(format!("{daemon}.pid"))).unwrap();
        assert!(
            Command::new("kill")
                .args(["-9", id.trim()])
                .status()
                .unwrap()
                .success()
        );
    }

    fn run(&self, bench: &Bench, arguments: &[&str]) -> Answer {
        answer(
            &bench
                .command(arguments)
                .env("SLURM_CONF", &self.config)
                .output()
                .unwrap(),
        )
    }

    fn spawn(&self, bench: &Bench, arguments: &[&str]) -> Child {
        let mut command = bench.command(arguments);
        command
            .env("SLURM_CONF", &self.config)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    }

    fn succeeds(&self, program: &str, arguments: &[&str]) -> bool {
        Command::new(program)
            .args(arguments)
            .env("SLURM_CONF", &self.config)
            .output()
            .unwrap()
            .status
            .success()
    }

    fn call(&self, program: &str, arguments: &[&str]) -> String {
        let output = Command::new(program)
            .args(arguments)
            .env("SLURM_CONF", &self.config)
            .output()
            .unwrap();
        assert!(
            output.status.success(),
            "{program} {arguments:?}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
        String::from_utf8(output.stdout).unwrap()
    }

    /// Waits until a task of the bench's submission has started a trial, and returns its id.
    fn until_running(&self, bench: &Bench) -> String {
        until("a worker runs", || logs(bench).contains("worker process"));
        let name = format!("--name=regimen-{}", only(submissions(bench)));
        let running = self.call(
            "squeue",
            &["--noheader", "--array", "--states=RUNNING", "--format=%i", &name],
        );
        running
            .lines()
            .next()
            .unwrap_or_else(|| panic!("no task runs"))
            .to_owned()
    }

    fn until_idle(&self) {
        until("both nodes are idle", || {
            self.call("sinfo", &["--noheader", "--Node", "--format=%t"]) == "idle\nidle\n"
        });
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        self.script(&["--stop"]);
    }
}

/// Waits a minute and a half at most.
pub(crate) fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let started = Instant::now();
    while !is_so() {
        assert!(
            started.elapsed() < Duration::from_secs(90),
            "waited in vain until {what}"
        );
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// The names of a bench's submissions.
pub(crate) fn submissions(bench: &Bench) -> Vec<String> {
    let entries = std::fs::read_dir(bench.path("store/submissions"))
        .into_iter()
        .flatten()
        .flatten();
    entries
        .filter(|entry| entry.path().is_dir())
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect()
}

/// Output of all workers of a bench.
pub(crate) fn logs(bench: &Bench) -> String {
    let files = submissions(bench)
        .into_iter()
        .flat_map(|id| std::fs::read_dir(bench.path("store/submissions").join(id)).unwrap());
    let logs = files
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "log"));
    logs.map(|path| std::fs::read_to_string(path).unwrap_or_default())
        .collect()
}

pub(crate) fn only(names: Vec<String>) -> String {
    assert_eq!(names.len(), 1, "{names:?}");
    names.into_iter().next().unwrap_or_default()
}
