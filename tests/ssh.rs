//! Trials on hosts that share no folder equal local ones, whatever happens to hosts and connections.
//!
//! The hosts are daemons of OpenSSH on this machine, each on a port of its own and with a home of its own.

mod stopped;

use crate::{
    needs,
    program::{Answer, Bench, answer, trial_files},
    programs,
    slurm::STUDY,
};
use std::{
    net::{TcpListener, TcpStream},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};
use tempfile::TempDir;

/// A learner, a policy that is taken from it, and loads from a file.
const GRAPH: &str = "
study: graph
title: Trials that take from others and read a file
source: made for this test
environments:
  cells: { battery: { cells: 2, load: { file: data/load.csv } } }
agents:
  dsac: { dirichlet_sac: { width: 8, batch_size: 16, learning_starts: 64 } }
  again: { policy: { from: dsac } }
protocol: { train_evaluate: { steps: 192, environments: 8, evaluate_every: 96, episodes: 1, final_episodes: 2, \
trace_episodes: 0 } }
seeds: 2
";

/// Trials of some seconds.
const LONG: &str = "
study: long
title: Trials of some seconds
source: made for this test
environments: { cells: { battery: { cells: 4 } } }
agents: { rule: { rank_rule: { weights: [0.15, 0.25, 0.25, 0.35] } } }
protocol: { train_evaluate: { steps: 0, final_episodes: 6000, trace_episodes: 0 } }
seeds: 4
";

/// Daemons on this machine, and how `ssh` reaches them.
struct Hosts {
    folder: TempDir,
    daemons: Vec<(&'static str, Child)>,
}

impl Hosts {
    /// Starts a daemon for each name; `None`, after a line, where OpenSSH is not installed.
    fn start(names: &[&'static str]) -> Option<Self> {
        let [daemon, _, _] = needs::programs(["sshd", "ssh", "ssh-keygen"])?;
        let mut hosts = Self {
            folder: tempfile::tempdir().unwrap(),
            daemons: Vec::new(),
        };
        for key in ["host", "user"] {
            let made = Command::new("ssh-keygen")
                .args(["-q", "-t", "ed25519", "-N", "", "-f"])
                .arg(hosts.path(key))
                .status();
            assert!(made.unwrap().success());
        }
        // A daemon of the administrator gives up its rights in this folder.
        let _ = std::fs::create_dir_all("/run/sshd");
        let mut client = String::new();
        for name in names {
            let port = hosts.daemon(&daemon, name);
            client += &format!("Host {name}\n  Port {port}\n");
        }
        client += "Host gone\n  Port 1\n";
        client += &format!(
            "Host *\n  HostName 127.0.0.1\n  IdentityFile {}\n  IdentitiesOnly yes\n  StrictHostKeyChecking no\n  \
             UserKnownHostsFile /dev/null\n  LogLevel ERROR\n",
            hosts.path("user").display()
        );
        std::fs::write(hosts.path("client"), client).unwrap();
        Some(hosts)
    }

    /// Starts a daemon whose home is a folder of its own; its port.
    fn daemon(&mut self, program: &Path, name: &'static str) -> u16 {
        let home = self.path(name);
        std::fs::create_dir(&home).unwrap();
        let free = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = free.local_addr().unwrap().port();
        drop(free);
        let config = format!(
            "Port {port}\nListenAddress 127.0.0.1\nHostKey {host}\nAuthorizedKeysFile {user}.pub\nStrictModes no\n\
             UsePAM no\nPidFile none\nPasswordAuthentication no\nMaxStartups 100\nPermitRootLogin yes\n\
             ForceCommand HOME={home}; export HOME; cd {home} && eval \"$SSH_ORIGINAL_COMMAND\"\n",
            host = self.path("host").display(),
            user = self.path("user").display(),
            home = home.display()
        );
        let file = self.path(&format!("{name}.config"));
        std::fs::write(&file, config).unwrap();
        let started = Command::new(program)
            .args(["-D", "-e", "-f"])
            .arg(file)
            .stderr(Stdio::null())
            .spawn();
        self.daemons.push((name, started.unwrap()));
        let begun = Instant::now();
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            assert!(
                begun.elapsed() < Duration::from_secs(20),
                "{name} does not listen"
            );
            std::thread::sleep(Duration::from_millis(20));
        }
        port
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Where a host works.
    fn work(&self, name: &str) -> PathBuf {
        self.path(name).join(".cache/regimen")
    }

    /// Options of a run for them.
    fn settings(&self, names: &[&str], more: &str) -> String {
        let command = format!("[\"ssh\", \"-F\", \"{}\"]", self.path("client").display());
        format!("executor = \"ssh\"\n[ssh]\nhosts = {names:?}\ncommand = {command}\n{more}")
    }

    /// A host dies with everything that runs on it.
    fn kill(&mut self, name: &str) {
        let place = self.daemons.iter().position(|it| it.0 == name).unwrap();
        let (_, mut daemon) = self.daemons.remove(place);
        for process in descendants(daemon.id()) {
            let _ = Command::new("kill")
                .args(["-KILL", &process.to_string()])
                .status();
        }
        daemon.wait().unwrap();
    }
}

impl Drop for Hosts {
    fn drop(&mut self) {
        let names: Vec<_> = self.daemons.iter().map(|it| it.0).collect();
        names.into_iter().for_each(|name| self.kill(name));
    }
}

/// A process and all that it started, in the order of their beginnings.
fn descendants(root: u32) -> Vec<u32> {
    let parents: Vec<(u32, u32)> = std::fs::read_dir("/proc")
        .unwrap()
        .filter_map(|entry| {
            let pid = entry.ok()?.file_name().to_str()?.parse().ok()?;
            let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
            let parent = stat.rsplit_once(") ")?.1.split(' ').nth(1)?.parse().ok()?;
            Some((pid, parent))
        })
        .collect();
    let mut all = vec![root];
    let mut place = 0;
    while place < all.len() {
        let parent = all[place];
        all.extend(parents.iter().filter(|it| it.1 == parent).map(|it| it.0));
        place += 1;
    }
    all
}

/// Metrics of every trial of a study that runs here.
fn here(study: &str) -> (Bench, Vec<(String, String)>) {
    let bench = Bench::new();
    bench.write("study.yaml", study);
    std::fs::create_dir(bench.path("data")).unwrap();
    bench.write("data/load.csv", "t_s,power_w\n0,12\n300,20\n");
    bench.ok(&[
        "run",
        "study.yaml",
        "-j",
        "2",
        "--executor",
        "local",
        "--store",
        "here",
    ]);
    let digests = bench.digests("here");
    (bench, digests)
}

/// Trials that lie on a host.
fn left_on(work: &Path) -> Vec<PathBuf> {
    let stores = std::fs::read_dir(work)
        .unwrap()
        .map(|entry| entry.unwrap().path());
    stores
        .map(|folder| folder.join("store"))
        .filter(|store| store.join("trials").exists())
        .flat_map(|store| trial_files(&store))
        .collect()
}

#[test]
fn trials_on_hosts_equal_local_ones_and_leave_nothing_there() {
    let Some(hosts) = Hosts::start(&["one", "two"]) else {
        return;
    };
    let (bench, expected) = here(STUDY);
    bench.write(
        "regimen.toml",
        &hosts.settings(&["one", "gone", "two"], "workers = 2\n"),
    );
    let ran = bench.run(&["run", "study.yaml", "--store", "far"]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    assert_eq!(bench.digests("far"), expected);
    assert!(
        ran.err
            .contains("running 6 trials on 4 worker processes of 2 hosts"),
        "{}",
        ran.err
    );
    assert!(ran.err.contains("warning: gone is left out: "), "{}", ran.err);
    for name in ["one", "two"] {
        let files = std::fs::read_dir(hosts.work(name)).unwrap();
        let programs = files.filter(|entry| {
            let name = entry.as_ref().unwrap().file_name();
            name.to_string_lossy().starts_with("regimen-")
        });
        assert_eq!(programs.count(), 1);
        let left = left_on(&hosts.work(name));
        assert!(left.is_empty(), "{left:?}");
    }
    let again = bench.run(&["run", "study.yaml", "--store", "far"]);
    assert!(
        again.code == 0 && again.err.contains("nothing runs"),
        "{}",
        again.err
    );
    // The results that arrived are whole.
    assert_eq!(bench.run(&["fsck", "far"]).code, 0);
}

#[test]
fn hosts_get_what_trials_take_and_the_files_of_the_study() {
    let Some(hosts) = Hosts::start(&["one", "two"]) else {
        return;
    };
    let (bench, expected) = here(GRAPH);
    bench.write("regimen.toml", &hosts.settings(&["one", "two"], "workers = 1\n"));
    let ran = bench.run(&["run", "study.yaml", "--store", "far"]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    assert_eq!((expected.len(), bench.digests("far")), (4, expected));
    bench.write("regimen.toml", "executor = \"ssh\"\n");
    let nobody = bench.run(&["run", "study.yaml", "--store", "none", "-o", "none"]);
    assert!(
        nobody.code == 2 && nobody.err.contains("name at least one"),
        "{}",
        nobody.err
    );
    bench.write("regimen.toml", &hosts.settings(&["one", "two"], "workers = 1\n"));
    // A file elsewhere, and a search that pauses, are refused before anything is asked.
    std::fs::write(hosts.path("load.csv"), "t_s,power_w\n0,12\n").unwrap();
    let outside = GRAPH.replace("data/load.csv", &hosts.path("load.csv").to_string_lossy());
    bench.write("outside.yaml", &outside);
    let refused = bench.run(&["run", "outside.yaml", "--store", "far", "-o", "outside"]);
    assert_eq!(refused.code, 2, "{}", refused.err);
    assert!(
        refused.err.contains("lies outside of this folder"),
        "{}",
        refused.err
    );
    bench.write("pausing.yaml", &crate::searches::halving());
    let refused = bench.run(&["run", "pausing.yaml", "--store", "far", "-o", "pausing"]);
    assert_eq!(refused.code, 2, "{}", refused.err);
    assert!(refused.err.contains("`rates` pauses trials"), "{}", refused.err);
}

/// The files of a program are brought to a host; it runs there and what it says comes home.
#[test]
fn programs_run_on_hosts_with_their_sources() {
    let Some(hosts) = Hosts::start(&["one", "two"]) else {
        return;
    };
    let bench = Bench::new();
    bench.write("train.sh", programs::WALKER);
    bench.write("more.sh", "echo \"brought to $(pwd)\" >&2\n");
    let run = "[sh, -c, \". ./more.sh; sh train.sh 0.5 $0 $1\", \"{seed}\", \"{steps}\"]";
    let study = programs::study_of(
        run,
        "{ return: charts/return }",
        "      reads: { step: global_step }",
    );
    bench.write("study.yaml", &study.replace("seeds: 1", "seeds: 4"));
    bench.ok(&["run", "study.yaml", "-j", "2", "--store", "here", "--yes"]);
    bench.write("regimen.toml", &hosts.settings(&["one", "two"], "workers = 1\n"));
    let ran = bench.run(&["run", "study.yaml", "--store", "far", "--yes"]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    assert_eq!(bench.digests("far"), bench.digests("here"));
    let outputs: Vec<PathBuf> = trial_files(&bench.path("far"))
        .iter()
        .map(|file| file.with_file_name("output.gz"))
        .collect();
    assert!(outputs.iter().all(|output| output.exists()), "{outputs:?}");
    // A trial that no host has room for is refused.
    bench.write(
        "study.yaml",
        &study.replace("reads:", "needs: { cores: 3 }\n      reads:"),
    );
    let refused = bench.run(&["run", "study.yaml", "--store", "none", "--yes"]);
    assert_eq!(refused.code, 2, "{}", refused.err);
    assert!(
        refused.err.contains("the largest host has 1 core and no GPU"),
        "{}",
        refused.err
    );
}

/// Waits until so many trials run on a host.
fn wait_for_trials(hosts: &Hosts, name: &str) {
    let begun = Instant::now();
    let running = || {
        let daemon = hosts.daemons.iter().find(|it| it.0 == name).unwrap();
        let works = |pid: &u32| {
            let line = std::fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap_or_default();
            line.contains("trial-worker")
        };
        descendants(daemon.1.id()).iter().any(works)
    };
    while !running() {
        assert!(
            begun.elapsed() < Duration::from_secs(60),
            "nothing runs on {name}"
        );
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn begin(bench: &Bench, arguments: &[&str]) -> Child {
    let mut command = bench.command(arguments);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command.spawn().unwrap()
}

fn end(child: Child) -> Answer {
    answer(&child.wait_with_output().unwrap())
}

#[test]
fn a_host_that_dies_is_made_up_for() {
    let Some(mut hosts) = Hosts::start(&["one", "two"]) else {
        return;
    };
    let (bench, expected) = here(LONG);
    bench.write(
        "regimen.toml",
        &hosts.settings(&["one", "two"], "workers = 1\npatience_s = 2\n"),
    );
    let run = begin(&bench, &["run", "study.yaml", "--store", "far"]);
    wait_for_trials(&hosts, "two");
    hosts.kill("two");
    let ran = end(run);
    assert_eq!(ran.code, 0, "{}", ran.err);
    assert_eq!(bench.digests("far"), expected);
    assert!(
        ran.err
            .contains("two: the connection broke; its trial goes to the others"),
        "{}",
        ran.err
    );
    assert!(ran.err.contains("it is given up"), "{}", ran.err);
    // Without any host the rest stays missing, and nothing is counted against the trials.
    hosts.kill("one");
    let none = bench.run(&["run", "study.yaml", "--store", "none", "-o", "none"]);
    assert_eq!(none.code, 106, "{}", none.err);
    assert!(none.err.contains("no host can be reached"), "{}", none.err);
}

#[test]
fn limits_are_held_on_hosts_and_a_run_that_is_stopped_goes_on() {
    let Some(hosts) = Hosts::start(&["one"]) else {
        return;
    };
    let (bench, expected) = here(LONG);
    bench.write("regimen.toml", &hosts.settings(&["one"], "workers = 2\n"));
    let run = begin(&bench, &["run", "study.yaml", "--store", "far"]);
    wait_for_trials(&hosts, "one");
    let stopped = Command::new("kill")
        .args(["-INT", &run.id().to_string()])
        .status();
    assert!(stopped.unwrap().success());
    let ran = end(run);
    assert_eq!(ran.code, 106, "{}", ran.err);
    assert!(ran.err.contains("the same command goes on"), "{}", ran.err);
    let limited = bench.run(&["run", "study.yaml", "--store", "far", "--wall-time-s", "0.2"]);
    assert_eq!(limited.code, 100, "{}", limited.err);
    assert!(
        limited.err.contains("it took longer than the limit of 0.2 s"),
        "{}",
        limited.err
    );
    bench.ok(&["run", "study.yaml", "--store", "far", "--retry-failed"]);
    assert_eq!(bench.digests("far"), expected);
}
