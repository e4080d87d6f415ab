//! Hosts on which processes stand still while their connections live: silence is all that tells.

use super::{Hosts, LONG, begin, descendants, end, here, wait_for_trials};
use crate::program::{Answer, Bench};
use std::{
    io::{BufRead, BufReader, Read as _},
    process::{Child, Command},
    time::{Duration, Instant},
};

/// How long a host may be silent, as the reference says.
const SILENT_FOR: Duration = Duration::from_secs(30);
/// Time that the machine may add to that: the last sign of life, the look at a clock, and a start of processes
/// under load.
const SLACK: Duration = Duration::from_secs(15);

/// Processes that stand still; none of them outlives the test.
struct Stopped(Vec<u32>);

impl Stopped {
    /// Stops those of the processes that a host has started which `is_meant` by their command lines.
    fn on(hosts: &Hosts, name: &str, is_meant: impl Fn(&str) -> bool) -> Self {
        let daemon = hosts.daemons.iter().find(|it| it.0 == name).unwrap();
        let mut started = descendants(daemon.1.id());
        started.remove(0);
        started.retain(|pid| {
            let line = std::fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap_or_default();
            is_meant(&line)
        });
        let stopped = Self(started);
        assert!(!stopped.0.is_empty(), "nothing to stop on {name}");
        stopped.send("-STOP");
        stopped
    }

    fn send(&self, signal: &str) {
        for pid in &self.0 {
            let _ = Command::new("kill").args([signal, &pid.to_string()]).status();
        }
    }
}

impl Drop for Stopped {
    fn drop(&mut self) {
        self.send("-KILL");
    }
}

/// True for the program that runs trials on a host for another machine, and not for the shells before it.
fn is_relay(line: &str) -> bool {
    line.split('\0').nth(1) == Some("relay")
}

/// Waits for a word on the terminal of a run; what it said until then.
fn wait_for_word(said: &mut impl BufRead, word: &str) -> String {
    let mut all = String::new();
    while !all.contains(word) {
        let read = said.read_line(&mut all).unwrap();
        assert!(read > 0, "the run has ended without `{word}`:\n{all}");
    }
    all
}

#[test]
fn a_relay_that_stands_still_is_noticed_and_the_other_host_has_its_trial() {
    let Some(hosts) = Hosts::start(&["one", "two"]) else {
        return;
    };
    let (bench, expected) = here(LONG);
    bench.write(
        "regimen.toml",
        &hosts.settings(&["one", "two"], "workers = 1\npatience_s = 2\n"),
    );
    let mut run = begin(&bench, &["run", "study.yaml", "--store", "far"]);
    let mut said = BufReader::new(run.stderr.take().unwrap());
    wait_for_trials(&hosts, "two");
    let relay = Stopped::on(&hosts, "two", is_relay);
    let begun = Instant::now();
    let mut all = wait_for_word(&mut said, "two: nothing was heard from it for 30 s");
    let silent = begun.elapsed();
    assert!(silent < SILENT_FOR + SLACK, "{silent:?}\n{all}");
    assert!(all.contains("; its trial goes to the others"), "{all}");
    said.read_to_string(&mut all).unwrap();
    assert_eq!(run.wait().unwrap().code(), Some(0), "{all}");
    assert_eq!(bench.digests("far"), expected);
    // It stood still to the end: no trial came from there.
    let state = std::fs::read_to_string(format!("/proc/{}/stat", relay.0[0])).unwrap();
    assert!(state.contains(") T "), "{state}");
}

/// Sends Ctrl-C once and waits for the end of the run.
fn interrupted(run: Child) -> (Answer, Duration) {
    let begun = Instant::now();
    let told = Command::new("kill")
        .args(["-INT", &run.id().to_string()])
        .status();
    assert!(told.unwrap().success());
    (end(run), begun.elapsed())
}

fn goes_on(bench: &Bench, expected: &[(String, String)]) {
    bench.ok(&["run", "study.yaml", "--store", "far"]);
    assert_eq!(bench.digests("far"), expected);
}

#[test]
fn where_everything_stands_still_one_signal_ends_the_run() {
    let names = ["one", "two"];
    let Some(hosts) = Hosts::start(&names) else { return };
    let (bench, expected) = here(LONG);
    bench.write("regimen.toml", &hosts.settings(&names, "workers = 1\n"));
    let run = begin(&bench, &["run", "study.yaml", "--store", "far"]);
    names.iter().for_each(|name| wait_for_trials(&hosts, name));
    let stopped = names.map(|name| Stopped::on(&hosts, name, |_| true));
    let (ran, took) = interrupted(run);
    assert_eq!(ran.code, 106, "{}", ran.err);
    assert!(took < SILENT_FOR, "{took:?}\n{}", ran.err);
    assert!(ran.err.contains("the same command goes on"), "{}", ran.err);
    drop(stopped);
    goes_on(&bench, &expected);
}
