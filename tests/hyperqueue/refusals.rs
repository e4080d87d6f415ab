//! Messages and effects where Python, the package or the server is missing, or an answer is.

use super::{Cluster, interrupted, local, spawn};
use crate::{
    needs,
    program::Bench,
    slurm::{STUDY, submissions, until},
};
use serde_json::Value;
use std::{fs, os::unix::fs::PermissionsExt as _};

/// A folder with the study and an interpreter that is a script of the test.
fn bench(python: &str, settings: &str) -> Bench {
    let bench = Bench::new();
    bench.write(
        "small.yaml",
        &STUDY.replace("final_episodes: 2000", "final_episodes: 10"),
    );
    let path = bench.write("python", &format!("#!/bin/sh\n{python}\n"));
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    let settings = format!(
        "executor = \"hyperqueue\"\n[hyperqueue]\npoll_s = 1\ntrials_per_task = 2\npython = \"{}\"\n{settings}",
        path.display()
    );
    bench.write("regimen.toml", &settings);
    bench
}

/// Fails for good, and says this.
fn is_refused(bench: &Bench, expected: &str) {
    let ran = bench.run(&["run", "small.yaml"]);
    assert!(
        ran.code == 2 && ran.err.contains(expected),
        "{}\n{}",
        ran.code,
        ran.err
    );
    let record = record(bench);
    assert!(record.contains("\"state\": \"refused\""), "{record}");
}

/// Record of a submission.
fn record(bench: &Bench) -> String {
    let folder = bench.path("store/submissions").join(&submissions(bench)[0]);
    fs::read_to_string(folder.join("submission.json")).unwrap()
}

#[test]
fn without_python_package_or_server_it_is_said_what_lacks() {
    let nothing = bench("", "");
    fs::remove_file(nothing.path("python")).unwrap();
    is_refused(&nothing, "name a Python that has the package `hyperqueue`");
    let Some(_) = needs::program("python3") else {
        return;
    };
    // Without its site an interpreter has no packages.
    let server = bench("exec python3 -S \"$@\"", "");
    let directory = server.path("server");
    server.write(
        "regimen.toml",
        &format!(
            "{}server_dir = \"{}\"\n",
            fs::read_to_string(server.path("regimen.toml")).unwrap(),
            directory.display()
        ),
    );
    is_refused(&server, "no server of HyperQueue has its directory at `");
    fs::create_dir(&directory).unwrap();
    fs::write(directory.join("access.json"), "{\"server_uid\": \"QjNQVn\"}").unwrap();
    is_refused(&server, "-m pip install hyperqueue==");
}

#[test]
fn a_relative_directory_is_refused_before_anything_runs() {
    let bench = bench("", "server_dir = \"hq\"\n");
    let ran = bench.run(&["plan", "small.yaml"]);
    let expected = "regimen.toml: [hyperqueue] `server_dir`: `hq`: write it from the root";
    assert!(ran.code == 2 && ran.err.contains(expected), "{}", ran.err);
}

#[test]
fn nobody_waits_for_an_answer_without_end() {
    let bench = bench("touch asked; exec sleep 600", "answer_s = 1\n");
    let waiting = spawn(&bench, &["run", "small.yaml"]);
    until("it is asked", || bench.path("asked").exists());
    std::thread::sleep(std::time::Duration::from_secs(2));
    let left = interrupted(waiting);
    assert_eq!(left.code, 106, "{}", left.err);
    let silent = "HyperQueue's client gave no answer within 1 s and was ended; trying again in 1 s";
    assert!(left.err.contains(silent), "{}", left.err);
}

/// The first answer is lost; the second time it is found beside the record.
#[test]
fn a_job_that_was_taken_without_an_answer_is_not_submitted_twice() {
    let Some(mut cluster) = Cluster::start() else {
        return;
    };
    let lost = format!(
        "case \"$3\" in submit) if [ ! -e asked ]; then touch asked; {0} \"$@\" > /dev/null; exec sleep 600; fi;; \
         esac\nexec {0} \"$@\"",
        cluster.python
    );
    let settings = format!(
        "answer_s = 5\nserver_dir = \"{}\"\n",
        cluster.directory().display()
    );
    let bench = bench(&lost, &settings);
    let study = fs::read_to_string(bench.path("small.yaml")).unwrap();
    let _worker = cluster.worker();
    let ran = bench.run(&["run", "small.yaml"]);
    assert_eq!(ran.code, 0, "{}\n{}", ran.out, ran.err);
    let silent = "HyperQueue's client gave no answer within 5 s and was ended; trying again in 1 s";
    assert!(ran.err.contains(silent), "{}", ran.err);
    assert!(record(&bench).contains("\"job\": \"1@"), "{}", ran.err);
    assert_eq!(bench.digests("store"), local(&study));
}

#[test]
fn a_dry_run_prints_the_request_and_touches_nothing() {
    let bench = bench("touch asked", "cpus_per_task = 2\n");
    let out = bench.ok(&["submit", "small.yaml", "--executor", "hyperqueue", "--dry-run"]);
    let request: Value = serde_json::from_str(&out).unwrap();
    assert!(request["tasks"] == 3 && request["cpus"] == 2, "{request}");
    let command = request["command"][2].as_str().unwrap();
    assert!(
        command.contains(" worker ") && command.contains(" -j 2"),
        "{command}"
    );
    assert!(!bench.path("asked").exists() && !bench.path("store").exists());
}
