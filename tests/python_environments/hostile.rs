//! An environment that does whatever environments can do: every command ends, says why, and leaves nothing behind.

use super::*;
use std::time::{Duration, Instant};

/// The environment's fault, the message of `check` and the end of the trial; both are well where nothing is given.
const WAYS: &[(&str, &str, &str)] = &[
    ("fork", "", ""),
    ("session", "", ""),
    ("subprocess", "", ""),
    ("copies", "", ""),
    ("breeds", "", ""),
    ("flood", "", ""),
    ("late", "", ""),
    ("silence", "longer than the limit of 5 s", "timeout"),
    ("stopped", "longer than the limit of 5 s", "timeout"),
    ("deaf", "longer than the limit of 5 s", "timeout"),
    ("leaves", "left with exit code 3", "failed"),
    ("killed", "was ended by signal 9", "killed"),
    ("crash", "was ended by signal 11", "failed"),
    ("memory", "above the limit of 500 MB", "oom"),
    ("heirs", "above the limit of 500 MB", "oom"),
    (
        "shape",
        "has 3 entries in place of 2: it has the shape (3,)",
        "failed",
    ),
    ("nan", "after step 5, which is no finite number", "nan"),
    ("old", "step returned 4 values in place of observation", "failed"),
];

/// Steps of an environment after which something happens: within a rehearsal, and after one.
const EARLY: u32 = 5;
const LATE: u32 = 25;

impl Place {
    /// A study of the hostile environment, and the config of the same.
    fn hostile(&self, how: &str, after: u32) {
        let source = repository().join(FIXTURES).join("hostile.py");
        fs::copy(source, self.bench.path("hostile.py")).unwrap();
        let study = self.short(
            "hostile.py:Hostile",
            &format!("how: {how}, after: {after}"),
            LEARNER,
        );
        // Where nothing ends by itself the shorter limit is waited for, and nowhere else.
        let ends_by_itself = !["silence", "stopped", "deaf", "never"].contains(&how);
        let wall_time_s = if ends_by_itself { 50 } else { 5 };
        let limits = format!("limits: {{ wall_time_s: {wall_time_s}, memory_mb: 500, retries: 0 }}\n");
        fs::write(&study, fs::read_to_string(&study).unwrap() + &limits).unwrap();
        let python = self.with("hostile.py:Hostile", &format!("how: {how}, after: {after}"));
        self.bench.write("config.yaml", &python);
    }

    /// Runs a command, which ends by itself within some time or is killed, and leaves no process.
    fn ends(&self, arguments: &[&str], how: &str) -> Option<Answer> {
        let mut command = self.bench.command(arguments);
        let child = command
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let begun = Instant::now();
        // Nothing limits a rollout.
        let is_killed =
            arguments[0] == "rollout" && ["silence", "stopped", "deaf", "memory", "heirs"].contains(&how);
        let most = Duration::from_secs(if is_killed { 3 } else { 60 });
        let output = std::thread::scope(|scope| {
            let pid = child.id();
            let (tell, told) = std::sync::mpsc::channel();
            scope.spawn(move || {
                if told.recv_timeout(most).is_err() {
                    Command::new("kill")
                        .args(["-KILL", &pid.to_string()])
                        .status()
                        .unwrap();
                }
            });
            let output = child.wait_with_output().unwrap();
            let _ = tell.send(());
            output
        });
        assert!(
            is_killed || begun.elapsed() < most,
            "{how}: {arguments:?} took {:?}",
            begun.elapsed()
        );
        until(&format!("{how}: {arguments:?} leaves nothing"), || {
            left_in(self).is_empty()
        });
        (!is_killed).then(|| crate::program::answer(&output))
    }
}

/// Processes whose folder is that of the test.
fn left_in(place: &Place) -> Vec<PathBuf> {
    let folder = place.bench.path("").canonicalize().unwrap();
    let all = fs::read_dir("/proc").unwrap().flatten();
    all.filter(|it| fs::read_link(it.path().join("cwd")).is_ok_and(|cwd| cwd.starts_with(&folder)))
        .map(|it| it.path())
        .collect()
}

#[test]
fn check_ends_says_why_and_leaves_nothing() {
    let Some(place) = Place::new() else { return };
    for (how, said, _) in WAYS {
        place.hostile(how, EARLY);
        let answer = place.ends(&["check", "study.yaml"], how).unwrap();
        let words = answer.err.split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(answer.code, if said.is_empty() { 0 } else { 2 }, "{how}: {words}");
        assert!(words.contains(said), "{how}: {words}");
        assert!(!words.contains("ssss"), "{how}");
    }
}

#[test]
fn a_trial_ends_in_its_state_and_leaves_nothing() {
    let Some(place) = Place::new() else { return };
    for (how, _, state) in WAYS {
        place.hostile(how, LATE);
        let store = format!("store-{how}");
        let answer = place
            .ends(&["run", "study.yaml", "-j", "1", "--store", &store], how)
            .unwrap();
        let expected = match *state {
            "" => 0,
            "killed" => 106,
            _ => 100,
        };
        assert_eq!(answer.code, expected, "{how}: {}", answer.err);
        assert!(answer.err.contains(state), "{how}: {}", answer.err);
        assert!(
            !answer.err.contains("ssss") && !answer.out.contains("ssss"),
            "{how}"
        );
    }
}

#[test]
fn a_rollout_leaves_nothing() {
    let Some(place) = Place::new() else { return };
    let rollout = [
        "rollout",
        "python",
        "--config",
        "config.yaml",
        "--agent",
        "random_action",
        "--out",
        "out.csv",
    ];
    for (how, said, _) in WAYS {
        place.hostile(how, EARLY);
        if let Some(answer) = place.ends(&rollout, how) {
            assert_eq!(answer.code == 0, said.is_empty(), "{how}: {}", answer.err);
        }
    }
}

#[test]
fn an_interpreter_that_says_nothing_is_not_waited_for_without_end_or_word() {
    let Some(place) = Place::new() else { return };
    place.bench.write("sleeper", "#!/bin/sh\nsleep 60\nexit 0\n");
    place
        .bench
        .write("escaping", "#!/bin/sh\nsetsid sleep 60 &\nsleep 60\n");
    for interpreter in ["sleeper", "escaping"] {
        name_interpreter(&place, interpreter);
        for command in ["check", "plan", "run"] {
            let answer = place.ends(&[command, "study.yaml"], interpreter).unwrap();
            let words = answer.err.split_whitespace().collect::<Vec<_>>().join(" ");
            assert_eq!(answer.code, 2, "{command}: {words}");
            for said in [
                "waiting for the start of `",
                "at most 7 s",
                "`interpreter`: the start of `",
                "was ended: it took longer than the limit of 7 s; it had said nothing",
            ] {
                assert!(words.contains(said), "{command}: {words}");
            }
        }
    }
    leaves_nothing_when_it_is_killed(&place, "escaping");
}

/// Writes a study whose environment names this program of the bench as its interpreter, and waits 7 s for it at most.
fn name_interpreter(place: &Place, interpreter: &str) {
    Command::new("chmod")
        .arg("+x")
        .arg(place.bench.path(interpreter))
        .status()
        .unwrap();
    place.hostile("nothing", EARLY);
    let study = fs::read_to_string(place.bench.path("study.yaml")).unwrap();
    let silent = study
        .replace(
            &format!("interpreter: {}", place.interpreter),
            &format!("interpreter: ./{interpreter}"),
        )
        .replace("wall_time_s: 50", "wall_time_s: 7");
    assert_ne!(study, silent);
    place.bench.write("study.yaml", &silent);
}

/// A `check` that waits for the interpreter may be killed meanwhile: nothing in the interpreter's group is left.
fn leaves_nothing_when_it_is_killed(place: &Place, interpreter: &str) {
    let study = fs::read_to_string(place.bench.path("study.yaml")).unwrap();
    place.bench.write("patient.yaml", &study);
    let mut child = place
        .bench
        .command(&["check", "patient.yaml"])
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    until("the interpreter runs", || left_in(place).len() > 2);
    child.kill().unwrap();
    child.wait().unwrap();
    until("nothing in its group is left", || {
        let own = |it: &PathBuf| {
            fs::read_to_string(it.join("cmdline")).is_ok_and(|told| told.contains(interpreter))
        };
        !left_in(place).iter().any(own)
    });
    // A process that left the group is ended by the test.
    left_in(place).iter().for_each(|it| {
        let pid = it.file_name().unwrap();
        Command::new("kill").arg("-KILL").arg(pid).status().unwrap();
    });
}

#[test]
fn an_episode_without_end_is_remarked_on() {
    let Some(place) = Place::new() else { return };
    place.hostile("never", EARLY);
    let answer = place.ends(&["check", "study.yaml"], "never").unwrap();
    assert_eq!(answer.code, 0, "{}", answer.err);
    let words = answer.err.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(
        words.contains("an episode had not ended after 10000 steps with drawn actions"),
        "{words}"
    );
    let answer = place.ends(&["run", "study.yaml", "-j", "1"], "never").unwrap();
    assert_eq!(answer.code, 100, "{}", answer.err);
    assert!(answer.err.contains("timeout"), "{}", answer.err);
}
