//! Lines that a program says while nobody listens, or says twice: every line counts, and none counts twice.

use super::*;
use std::process::{Child, Command, Stdio};

fn signal(pid: u32, name: &str) {
    let sent = Command::new("kill").args([name, &pid.to_string()]).status();
    assert!(sent.unwrap().success(), "{name} to {pid}");
}

fn begun(place: &Place) -> Child {
    let mut command = place.bench.command(&["run", "study.yaml", "-j", "1", "--yes"]);
    command
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// The process that runs the trial of a run.
fn worker(run: &Child) -> Option<u32> {
    let is_child = |pid: &u32| {
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        let parent = stat
            .rsplit_once(") ")
            .and_then(|(_, rest)| rest.split(' ').nth(1)?.parse().ok());
        let line = fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        parent == Some(run.id()) && line.contains("trial-worker")
    };
    let names = fs::read_dir("/proc").unwrap().flatten();
    names
        .filter_map(|entry| entry.file_name().to_string_lossy().parse().ok())
        .find(is_child)
}

/// Stops the worker of a run once the program has said so many lines, waits for `then`, and kills the worker.
fn deafen(place: &Place, lines: usize, then: &str) {
    let mut run = begun(place);
    let said = place.bench.path("said");
    let count = || fs::read_to_string(&said).map_or(0, |text| text.lines().count());
    until("it says something", || count() >= lines && worker(&run).is_some());
    let worker = worker(&run).unwrap();
    signal(worker, "-STOP");
    until("it goes on unheard", || {
        fs::read_to_string(&said).unwrap().contains(then)
    });
    signal(worker, "-KILL");
    assert_eq!(run.wait().unwrap().code(), Some(0));
}

/// The record of the only trial: phase, step, metric, unit and value of each row.
fn recorded(place: &Place) -> Vec<String> {
    let fields = |row: &String| row.split(',').skip(5).take(6).collect::<Vec<_>>().join(",");
    place.rows().iter().map(fields).collect()
}

/// Counts to six and notes each line, and its end, beside the study.
fn counting(body: &str, more: &str) -> Place {
    let place = Place::new("", "{ return: r }", more);
    let said = place.bench.path("said");
    place
        .bench
        .write("a.sh", &body.replace("SAID", &said.display().to_string()));
    place.edit(
        "[sh, a.sh, \"{seed}\", \"{steps}\"]",
        "[sh, a.sh, \"{checkpoint}\"]",
    );
    place.edit("steps: 1000, evaluate_every: 200", "steps: 6, evaluate_every: 1");
    place
}

const LINE: &str = "n=$((n + 1)); echo \"step=$n r=$n\"; echo \"$n\" >>SAID; sleep 0.2\n";

#[test]
fn a_program_that_ends_while_its_worker_stands_still_is_recorded_whole() {
    let body = format!("n=0; while [ $n -lt 6 ]; do {LINE}done\necho end >>SAID\n");
    let place = counting(&body, "");
    deafen(&place, 1, "end");
    let unheard = recorded(&place);
    let alone = counting(&body, "");
    assert_eq!(alone.run(&[]).code, 0);
    assert_eq!(unheard, recorded(&alone));
}

#[test]
fn lines_that_a_checkpoint_stands_behind_are_not_lost() {
    let body = format!(
        "n=0; [ \"$2\" = --resume ] && n=$(cat \"$1/state\")\nwhile [ $n -lt 6 ]; do {LINE}echo $n >\"$1/new\"; mv \"$1/new\" \
         \"$1/state\"; done\n"
    );
    let resume = "      resume: [\"--resume\"]";
    let place = counting(&body, resume);
    deafen(&place, 1, "4\n");
    let unheard = recorded(&place);
    let alone = counting(&body, resume);
    assert_eq!(alone.run(&[]).code, 0);
    assert_eq!(unheard, recorded(&alone));
}

/// A program is killed behind a line that its checkpoint does not cover.
#[test]
fn a_step_that_is_said_again_counts_as_said_the_second_time() {
    for source in ["stdout", "log"] {
        let say = match source {
            "stdout" => "say() { echo \"step=$1 r=$2\"; }",
            _ => "say() { echo \"{\\\"step\\\": $1, \\\"r\\\": $2}\" >>\"$REGIMEN_LOG\"; }",
        };
        let body = format!(
            "{say}\nif [ \"$2\" = --resume ]; then say 2 20; exit 0; fi\nsay 1 1; echo 1 >\"$1/state\"; say 2 10; sleep 0.5; kill \
             -9 $$\n"
        );
        let reads = format!("      reads: {{ from: {source} }}\n      resume: [\"--resume\"]");
        let place = counting(&body, &reads);
        assert_eq!(place.run(&[]).code, 0, "{}", place.trial()["end"]);
        let rows = place.rows();
        let trained: Vec<&String> = rows.iter().filter(|row| row.contains(",return,")).collect();
        assert!(
            trained.iter().any(|row| row.contains("20")) && trained.iter().all(|row| !row.contains("15")),
            "{source}: {rows:?}"
        );
    }
}

/// Lines without a step are numbered, and a program that says them again would find other numbers.
#[test]
fn a_program_without_steps_begins_anew() {
    let body = "n=0; [ \"$2\" = --resume ] && n=$(cat \"$1/state\")\nwhile [ $n -lt 6 ]; do\n  n=$((n + 1)); echo \"r=$n\"\n  [ \
                $((n % 2)) = 0 ] && echo $n >\"$1/state\"\n  if [ $n = 3 ] && [ ! -f SAID ]; then touch SAID; sleep 0.3; kill -9 $$; \
                fi\ndone\nexit 0\n";
    let resume = "      resume: [\"--resume\"]";
    let place = counting(body, resume);
    assert_eq!(place.run(&[]).code, 0, "{}", place.trial()["end"]);
    let alone = counting(body, resume);
    fs::write(alone.bench.path("said"), "").unwrap();
    assert_eq!(alone.run(&[]).code, 0);
    assert_eq!(recorded(&place), recorded(&alone));
}
