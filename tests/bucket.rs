//! Machines that share a bucket of object storage and no folder compute each trial once, whatever happens to them.
//!
//! The service is moto's server on this machine, which knows conditional writes. Machines are stores of their own.

use crate::{
    needs,
    program::{Answer, Bench, answer, trial_files},
    slurm::STUDY,
};
use std::{
    io::{Read, Write},
    net::{TcpListener, TcpStream},
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

/// Trials of some seconds, the second half of which takes from the first.
const LONG: &str = "
study: long
title: Trials of some seconds
source: made for this test
environments: { cells: { battery: { cells: 2 } } }
agents:
  dsac: { dirichlet_sac: { width: 16, batch_size: 32, learning_starts: 64 } }
  again: { policy: { from: dsac } }
protocol: { train_evaluate: { steps: 6000, environments: 8, evaluate_every: 2000, episodes: 1, final_episodes: 2, \
trace_episodes: 0 } }
seeds: 3
";

/// A server of object storage with the bucket `lab`.
struct Service {
    interpreter: &'static str,
    port: u16,
    server: Child,
}

impl Drop for Service {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

impl Service {
    /// Starts the server; `None`, after a line, where it is not installed.
    fn start() -> Option<Self> {
        let interpreter = needs::python("moto.server, boto3")?;
        let free = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = free.local_addr().unwrap().port();
        drop(free);
        let server = Command::new(interpreter)
            .args(["-m", "moto.server", "-H", "127.0.0.1", "-p", &port.to_string()])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let service = Self {
            interpreter,
            port,
            server,
        };
        let begun = Instant::now();
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            assert!(begun.elapsed() < Duration::from_secs(60), "moto does not listen");
            std::thread::sleep(Duration::from_millis(50));
        }
        service.python("s3.create_bucket(Bucket='lab')");
        Some(service)
    }

    fn address(&self) -> String {
        format!("http://127.0.0.1:{}", self.port)
    }

    fn variables(&self) -> [(&'static str, String); 3] {
        [
            ("AWS_ENDPOINT_URL", self.address()),
            ("AWS_ACCESS_KEY_ID", "key".into()),
            ("AWS_SECRET_ACCESS_KEY", "secret".into()),
        ]
    }

    /// Output of a line of Python that knows the service as `s3`.
    fn python(&self, line: &str) -> String {
        let program = format!("import boto3\ns3 = boto3.client('s3', region_name='us-east-1')\n{line}");
        let mut command = Command::new(self.interpreter);
        command.args(["-c", &program]).envs(self.variables());
        let output = command.output().unwrap();
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        String::from_utf8(output.stdout).unwrap()
    }

    /// The keys in the bucket.
    fn keys(&self) -> Vec<String> {
        // Whoever waits for a lease asks often.
        let mut service = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        let request = "GET /lab?list-type=2 HTTP/1.0\r\nHost: 127.0.0.1\r\n\r\n";
        service.write_all(request.as_bytes()).unwrap();
        let mut page = String::new();
        service.read_to_string(&mut page).unwrap();
        assert!(page.contains("ListBucketResult"), "{page}");
        let keys = page.split("<Key>").skip(1);
        keys.map(|rest| rest.split('<').next().unwrap_or_default().to_owned())
            .collect()
    }

    /// One machine begins: a store of its own.
    fn begin(&self, bench: &Bench, store: &str, arguments: &[&str]) -> Child {
        let own = ["--store", store, "--bucket", "s3://lab/team", "-o", store];
        let mut command = bench.command(&[arguments, &own].concat());
        command.envs(self.variables());
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command.spawn().unwrap()
    }

    fn run(&self, bench: &Bench, store: &str, arguments: &[&str]) -> Answer {
        end(self.begin(bench, store, arguments))
    }
}

fn end(child: Child) -> Answer {
    answer(&child.wait_with_output().unwrap())
}

/// The folder of a study, and what its trials come to on one machine.
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
        "--store",
        "here",
        "-o",
        "here-results",
    ]);
    let digests = bench.digests("here");
    (bench, digests)
}

#[test]
fn machines_that_share_a_bucket_compute_each_trial_once() {
    let Some(service) = Service::start() else { return };
    let (bench, expected) = here(STUDY);
    let machines =
        ["one", "two"].map(|store| service.begin(&bench, store, &["run", "study.yaml", "-j", "1"]));
    let [one, two] = machines.map(end);
    assert_eq!((one.code, two.code), (0, 0), "{}\n{}", one.err, two.err);
    assert_eq!(
        (bench.digests("one"), bench.digests("two")),
        (expected.clone(), expected.clone())
    );
    // Nobody has a lease any more, and every trial is shared.
    let keys = service.keys();
    assert!(keys.iter().all(|key| key.starts_with("team/trials/")), "{keys:?}");
    assert_eq!(keys.len(), expected.len());
    // A third one computes nothing.
    let third = service.run(&bench, "three", &["report", "study.yaml"]);
    assert_eq!(
        (third.code, bench.digests("three")),
        (0, expected),
        "{}",
        third.err
    );
    let again = service.run(&bench, "four", &["run", "study.yaml"]);
    assert!(
        again.code == 0 && again.err.contains("nothing runs"),
        "{}",
        again.err
    );
}

#[test]
fn trials_that_were_computed_alone_are_brought_and_a_machine_that_is_killed_is_made_up_for() {
    let Some(service) = Service::start() else { return };
    let (bench, expected) = here(LONG);
    let dies = service.begin(&bench, "one", &["run", "study.yaml", "-j", "1"]);
    let begun = Instant::now();
    while !service.keys().iter().any(|key| key.starts_with("team/leases/")) {
        assert!(begun.elapsed() < Duration::from_secs(60), "nothing runs");
        std::thread::sleep(Duration::from_millis(20));
    }
    let killed = Command::new("kill").args(["-9", &dies.id().to_string()]).status();
    assert!(killed.unwrap().success());
    end(dies);
    let left = service.keys();
    assert!(left.iter().any(|key| key.starts_with("team/leases/")), "{left:?}");
    let heir = service.run(&bench, "two", &["run", "study.yaml", "-j", "2"]);
    assert_eq!(
        (heir.code, bench.digests("two")),
        (0, expected.clone()),
        "{}",
        heir.err
    );
    // The next run brings the trials that lay in the store of another machine before it knew the bucket.
    service.python("for it in s3.list_objects_v2(Bucket='lab')['Contents']: s3.delete_object(Bucket='lab', Key=it['Key'])");
    let brings = service.run(&bench, "here", &["run", "study.yaml"]);
    assert!(brings.err.contains("brought 6 trials"), "{}", brings.err);
    assert_eq!(service.keys().len(), expected.len());
}

#[test]
fn failures_are_shared_and_tried_again_and_what_is_damaged_is_fetched_anew() {
    let Some(service) = Service::start() else { return };
    let (bench, expected) = here(LONG);
    let own = |store: &'static str| ["--store", store, "--bucket", "s3://lab/team", "-o", store];
    bench.write("fails.yaml", &crate::end_states::study("{ how: fail }"));
    let failing = |store: &'static str, more: &[&str]| {
        let arguments = [&["run", "fails.yaml"], &own(store)[..], more].concat();
        let mut command = bench.misused(&arguments);
        answer(&command.envs(service.variables()).output().unwrap())
    };
    let first = failing("one", &[]);
    assert_eq!(first.code, 100, "{}", first.err);
    // Another machine has the failure from the bucket, and tries again where it is asked to.
    let other = failing("two", &[]);
    assert!(
        other.code == 100 && !other.err.contains("running "),
        "{}",
        other.err
    );
    let again = failing("two", &["--retry-failed"]);
    assert!(
        again.code == 100 && again.err.contains("running 1") && !again.err.contains("by another program"),
        "{}",
        again.err
    );
    // A trial that is damaged here is set aside and comes back from the bucket.
    let brings = service.run(&bench, "here", &["run", "study.yaml"]);
    assert!(brings.err.contains("brought 6 trials"), "{}", brings.err);
    let damaged = trial_files(&bench.path("here"))[0].with_file_name("metrics.parquet");
    std::fs::write(&damaged, "PAR1 no longer").unwrap();
    let mended = service.run(&bench, "here", &["run", "study.yaml"]);
    assert_eq!(
        (mended.code, bench.digests("here")),
        (0, expected),
        "{}",
        mended.err
    );
    assert!(mended.err.contains("by another program"), "{}", mended.err);
}

#[test]
fn a_bucket_that_cannot_be_used_is_said() {
    let bench = Bench::new();
    bench.write("study.yaml", STUDY);
    let run = |bucket: &str, variables: &[(&str, &str)]| {
        let mut command = bench.command(&["run", "study.yaml", "--bucket", bucket]);
        command.envs(variables.iter().copied());
        answer(&command.output().unwrap())
    };
    let keys = [("AWS_ACCESS_KEY_ID", "key"), ("AWS_SECRET_ACCESS_KEY", "secret")];
    let nowhere = [keys[0], keys[1], ("AWS_ENDPOINT_URL", "http://127.0.0.1:1")];
    for (answer, said) in [
        (run("lab/team", &keys), "`s3://bucket/prefix`"),
        (run("s3://lab", &[]), "set AWS_ACCESS_KEY_ID"),
        (run("s3://lab", &nowhere), "the service cannot be reached"),
    ] {
        assert_eq!(answer.code, 2, "{}", answer.err);
        assert!(answer.err.contains(said), "{}", answer.err);
    }
    let Some(service) = Service::start() else { return };
    let mut command = bench.command(&["run", "study.yaml", "--bucket", "s3://other"]);
    let absent = answer(&command.envs(service.variables()).output().unwrap());
    assert!(
        absent.code == 2 && absent.err.contains("NoSuchBucket"),
        "{}",
        absent.err
    );
}
