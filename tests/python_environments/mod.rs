//! Environments written in Python: what passes between the two programs, what is refused before anything runs, and
//! what a trial comes to whose Python fails, hangs, is killed or goes on elsewhere.

mod choices;
mod continuing;
mod ends;
mod hostile;
mod reading;
mod refusals;
mod spaces;
mod stops;

use crate::{
    book::blocks,
    needs,
    program::{Answer, Bench, repository},
    slurm::until,
};
use contract::{Channel, End, Environment, Space, random::stream};
use serde_json::{Value, json};
use std::{
    fs,
    path::PathBuf,
    process::{Command, Stdio},
    sync::OnceLock,
};

const FIXTURES: &str = "tests/fixtures/python";

/// A Python with Gymnasium and PettingZoo and the lock file of its packages; `None`, after a line, where there is none.
fn python() -> Option<(&'static str, &'static str)> {
    static LOCK: OnceLock<String> = OnceLock::new();
    let python = needs::python("gymnasium, pettingzoo")?;
    Some((python, LOCK.get_or_init(|| lock_file(python))))
}

fn lock_file(python: &str) -> String {
    let versions = "import gymnasium, numpy, pettingzoo as p\n\
                    print(f'gymnasium=={gymnasium.__version__}\\nnumpy=={numpy.__version__}\\npettingzoo=={p.__version__}')";
    let output = Command::new(python).args(["-c", versions]).output().unwrap();
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// A folder with the fixtures' environments and a lock file; `None` where there is no Python.
pub(crate) struct Place {
    pub(crate) bench: Bench,
    pub(crate) interpreter: &'static str,
}

impl Place {
    pub(crate) fn new() -> Option<Self> {
        let (interpreter, lock) = python()?;
        let bench = Bench::new();
        bench.write("requirements.txt", lock);
        for file in ["own.py", "level.py", "rules.py"] {
            fs::copy(repository().join(FIXTURES).join(file), bench.path(file)).unwrap();
        }
        Some(Self { bench, interpreter })
    }

    /// The keys of an environment beside `make` and `arguments`, in a study.
    pub(crate) fn with(&self, make: &str, arguments: &str) -> String {
        let interpreter = self.interpreter;
        format!(
            "{{ make: \"{make}\", arguments: {{ {arguments} }}, sources: [{{ file: level.py }}], lock: {{ file: \
             requirements.txt }}, interpreter: {interpreter} }}"
        )
    }

    /// Runs `study.yaml`, of which the trial `odd` ends as `state` for these reasons and the trial `well` ends well.
    pub(crate) fn one_trial_ends(
        &self,
        options: &[&str],
        [odd, well]: [&str; 2],
        state: &str,
        reasons: &[&str],
    ) {
        let answer = self
            .bench
            .run(&[&["run", "study.yaml", "-j", "1"], options].concat());
        assert_eq!(answer.code, 100, "{}", answer.err);
        assert!(answer.err.contains(&format!("ok       {well}")), "{}", answer.err);
        assert!(
            answer.err.contains(&format!("{state:<8} {odd}")),
            "{}",
            answer.err
        );
        let status = self.bench.run(&["status", "study.yaml"]).out;
        for reason in reasons {
            assert!(status.contains(reason), "`{reason}` is not in {status}");
        }
        until("Python is gone", || processes_of(self).is_empty());
    }

    /// Runs `study.yaml` once without interruption and once with a kill after its first checkpoint: the bits are the
    /// same, and nothing is left but the folder.
    pub(crate) fn goes_on_after_a_kill(&self) {
        self.bench
            .ok(&["run", "study.yaml", "-j", "1", "--store", "whole"]);
        let mut run = self.bench.command(&["run", "study.yaml", "-j", "1"]);
        let mut child = run.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        until("there is a checkpoint", || continuing::has_checkpoint(self));
        assert!(!processes_of(self).is_empty());
        child.kill().unwrap();
        child.wait().unwrap();
        until("Python is gone with its worker", || processes_of(self).is_empty());
        self.bench.ok(&["run", "study.yaml", "-j", "1"]);
        assert_eq!(self.bench.digests("store"), self.bench.digests("whole"));
        fs::remove_dir_all(self.bench.path("whole")).unwrap();
        fs::remove_dir_all(self.bench.path("store")).unwrap();
    }

    /// A study of one environment in Python, whose agents learn from a few steps.
    fn study(&self, make: &str, arguments: &str, agent: &str, protocol: &str) -> PathBuf {
        let python = self.with(make, arguments);
        let text = format!(
            "study: own\nenvironments:\n  tank: {{ python: {python} }}\nagents:\n  some: {{ {agent} }}\nprotocol: {{ \
             {protocol} }}\n"
        );
        self.bench.write("study.yaml", &text)
    }

    fn short(&self, make: &str, arguments: &str, agent: &str) -> PathBuf {
        self.study(
            make,
            arguments,
            agent,
            "train_evaluate: { steps: 160, environments: 4, evaluate_every: 80, episodes: 2, final_episodes: 3 }",
        )
    }

    pub(crate) fn config(&self, make: &str, arguments: Value) -> Value {
        let file = |name: &str| json!({ "file": self.bench.path(name) });
        let make = match make.split_once(".py:") {
            Some((file, call)) => json!({ "file": self.bench.path(&format!("{file}.py")), "call": call }),
            None => json!(make),
        };
        json!({ "make": make, "arguments": arguments, "sources": [file("level.py")],
            "lock": file("requirements.txt"), "interpreter": self.interpreter })
    }

    pub(crate) fn built(&self, make: &str, arguments: Value) -> Box<dyn Environment> {
        let build = &plugins::registry().environments["python"].build;
        build(&self.config(make, arguments).into()).unwrap_or_else(|error| panic!("{make}: {error}"))
    }

    /// Message of `check` for a study that it refuses.
    fn refusal(&self, make: &str, arguments: &str) -> String {
        self.said_by_check(2, make, arguments)
    }

    /// Message of `check` where it leaves with a code.
    fn said_by_check(&self, code: i32, make: &str, arguments: &str) -> String {
        self.short(make, arguments, RULE);
        let answer = self.bench.run(&["check", "study.yaml"]);
        assert_eq!(
            answer.code, code,
            "{make} {arguments}: {}{}",
            answer.out, answer.err
        );
        answer.err.split_whitespace().collect::<Vec<_>>().join(" ")
    }
}

const RULE: &str = "random_action: {}";
const LEARNER: &str =
    "soft_actor_critic: { width: 8, batch_size: 8, learning_starts: 16, updates_per_step: 0.25 }";

fn channels(space: &Space) -> &[Channel] {
    match space {
        Space::Box(channels) => channels,
        other => panic!("{other:?}"),
    }
}

fn names(space: &Space) -> Vec<String> {
    space.names()
}

/// Processes that run a Python of a test.
pub(crate) fn processes_of(place: &Place) -> Vec<u32> {
    let lock = place.bench.path("");
    let folder = lock.to_str().unwrap();
    let mut found = Vec::new();
    for entry in fs::read_dir("/proc").unwrap().flatten() {
        let Ok(pid) = entry.file_name().to_string_lossy().parse::<u32>() else {
            continue;
        };
        let here = fs::read_link(entry.path().join("cwd")).is_ok_and(|cwd| cwd.starts_with(folder));
        let told = fs::read(entry.path().join("cmdline")).unwrap_or_default();
        if here && String::from_utf8_lossy(&told).contains("PettingZoo's parallel interface") {
            found.push(pid);
        }
    }
    found
}

#[test]
fn the_page_of_the_book_works_as_written() {
    let Some(place) = Place::new() else { return };
    let page = fs::read_to_string(repository().join("docs/src/python-environments.md")).unwrap();
    let study = blocks(&page, "yaml")
        .into_iter()
        .find(|block| block.contains("\nprotocol:"))
        .unwrap();
    place.bench.write("my_envs.py", &blocks(&page, "python").concat());
    let interpreter = format!(" }}, interpreter: {} }} }}\nagents:", place.interpreter);
    let with_interpreter = study.replace(" } } }\nagents:", &interpreter);
    assert_ne!(with_interpreter, study);
    place.bench.write("tank.yaml", &with_interpreter);
    place.bench.ok(&["check", "tank.yaml"]);
    let table = place.bench.ok(&["run", "tank.yaml", "-j", "2"]);
    assert!(table.contains("SUPPORTED") || table.contains("sac"), "{table}");
    // The fragments that the page begins with are of the keys that there are.
    let keys = ["make", "arguments", "metrics", "sources", "lock", "interpreter"];
    assert!(keys.iter().all(|key| page.contains(&format!("\n| `{key}` |"))));
}
