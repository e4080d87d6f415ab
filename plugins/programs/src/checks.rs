//! Checks of a program's keys before anything runs.

use crate::{
    config::{ProgramConfig, Reading},
    words::{OTHERS, Word},
};
use contract::{
    Error, Metric,
    own_training::Measured,
    standard_metrics::{OWN_STEPS, TIME_PER_DECISION, TIME_PER_UPDATE, UPDATES, WALL_TIME},
};
use std::path::Path;

impl ProgramConfig {
    /// Refuses a config that cannot be run or whose metrics cannot be read.
    ///
    /// # Errors
    /// [`Error::Config`] at the key.
    pub fn check(&self) -> Result<(), Error> {
        if self.run.first().is_none_or(String::is_empty) {
            let problem = "names no program: write it with its arguments as a list, as `[python, train.py, --seed, \"{seed}\"]`";
            return Err(Error::config("run", problem));
        }
        if self.lock.is_none() {
            let problem = "names no file, so that nothing says which packages compute the numbers: write `lock: { file: \
                           uv.lock }` with the lock file of the program, or `lock: none` for one that needs no packages";
            return Err(Error::config("lock", problem));
        }
        if self.metrics.is_empty() && self.measured.is_none() {
            let problem = "names no metric, so that nothing would be known of a trial: write one with its key in the output \
                           of the program, as `{ return: episodic_return }`";
            return Err(Error::config("metrics", problem));
        }
        self.parameters
            .keys()
            .try_for_each(|name| check_parameter(name))?;
        self.needs.check()?;
        self.measures()?;
        self.sources.0.keys().try_for_each(|name| within(name))?;
        self.metrics.keys().try_for_each(|name| check_metric_name(name))?;
        let unknown = self.shown.keys().find(|name| !self.metrics.contains_key(*name));
        if let Some(name) = unknown {
            return Err(Error::config("shown", format!("no metric is named `{name}`")));
        }
        let readings = self.readings();
        let keys = readings
            .iter()
            .find(|it| it.key.is_empty() || it.key.contains('*'));
        if let Some(Reading { name, key, .. }) = keys {
            let problem = format!("`{key}` of `{name}` is no key: one metric has one");
            return Err(Error::config("metrics", problem));
        }
        readings.iter().try_for_each(|it| readable(&it.from))
    }

    /// Variables with a name in braces that would be replaced in a word of `run`, each as a warning.
    pub fn unfilled_variables(&self) -> impl Iterator<Item = Error> {
        let is_known = |name: &&str| {
            let has_kind = ["environment.", "input."]
                .iter()
                .any(|kind| name.starts_with(kind));
            has_kind || OTHERS.contains(name) || self.parameters.contains_key(*name)
        };
        self.variables.iter().filter_map(move |(variable, text)| {
            let word = Word::parse(text).ok()?;
            let name = word.names().find(is_known)?.to_owned();
            let problem = format!(
                "`{{{name}}}` stays as it is, since names in braces are replaced in `run` and `resume` alone: write it \
                 into a word there"
            );
            Some(Error::config(format!("variables.{variable}"), problem))
        })
    }

    /// Refuses a way of measuring that lacks one of its keys.
    fn measures(&self) -> Result<(), Error> {
        let policy = self.leaves.policy.as_deref();
        if self.measured == Some(Measured::Calls) && !self.resume.is_empty() {
            let problem = "a program that is measured by its calls begins anew after an interruption, since what was \
                           measured before would be measured twice: leave it out";
            return Err(Error::config("resume", problem));
        }
        if (self.measured == Some(Measured::Policy)) != policy.is_some() {
            let problem = "a policy that a program leaves is what it is measured by: write both `leaves: { policy: \
                           \"*.onnx\" }` and `measured: policy`";
            return Err(Error::config("measured", problem));
        }
        match policy {
            Some(pattern) if !is_inside(pattern) => {
                let problem = format!("`{pattern}` is no file in the working folder");
                Err(Error::config("leaves.policy", problem))
            }
            _ => Ok(()),
        }
    }
}

/// Refuses the name of a parameter that words, or dotted paths of a study, could not say.
fn check_parameter(name: &str) -> Result<(), Error> {
    let why = if OTHERS.contains(&name) {
        "it stands for something else in the words of a program".to_owned()
    } else if name.contains(['{', '}']) {
        "braces stand around names in the words of a program".to_owned()
    } else if name.contains('.') {
        let own = name.replace('.', "_");
        format!("a dot separates keys; call it `{own}`, and write `--{name}={{{own}}}` into `run`")
    } else {
        return Ok(());
    };
    let problem = format!("`{name}` is no name of a parameter: {why}");
    Err(Error::config("parameters", problem))
}

/// Refuses a file outside the working folder, or among the engine's own files.
fn within(name: &str) -> Result<(), Error> {
    let mut parts = Path::new(name).components();
    let is_inside = parts.all(|part| matches!(part, std::path::Component::Normal(_)));
    let problem = if !is_inside || name.is_empty() {
        let own = Path::new(name).file_name().unwrap_or_default().to_string_lossy();
        format!(
            "leads out of the working folder: give the file a name there, as `{own}` in `sources: {{ {own}: {{ file: PATH }} }}`"
        )
    } else if name.starts_with(crate::working_folder::NOTES) {
        "is a name of files that this program keeps there".to_owned()
    } else {
        return Ok(());
    };
    Err(Error::config("sources", format!("`{name}` {problem}")))
}

fn readable(from: &str) -> Result<(), Error> {
    if crate::output::is_noted(from) {
        return Ok(());
    }
    if is_inside(from) {
        return Ok(());
    }
    let problem =
        format!("`{from}` is none of `stdout`, `stderr` and `log`, and no file in the working folder");
    Err(Error::config("metrics", problem))
}

/// Whether a name or pattern stays in the working folder.
fn is_inside(pattern: &str) -> bool {
    let is_plain = |part| {
        matches!(
            part,
            std::path::Component::Normal(_) | std::path::Component::CurDir
        )
    };
    !pattern.is_empty() && Path::new(pattern).components().all(is_plain)
}

/// Refuses names that claims cannot write and names of the engine's own metrics.
fn check_metric_name(name: &str) -> Result<(), Error> {
    let taken = [
        OWN_STEPS,
        UPDATES,
        WALL_TIME,
        TIME_PER_UPDATE,
        TIME_PER_DECISION,
        "success",
    ];
    let problem = if taken.contains(&name) {
        Some("is recorded of every trial; take another name")
    } else {
        Metric::name_problem(name)
    };
    let refusal = |problem| Error::config("metrics", format!("`{name}` {problem}"));
    problem.map_or(Ok(()), |problem| Err(refusal(problem)))
}

#[cfg(test)]
mod tests {
    use crate::config::tests::config;
    use serde_json::{Value, json};

    fn refusal(key: &str, value: Value) -> String {
        let mut whole = json!({ "run": ["sh", "a.sh"], "lock": "none", "metrics": { "loss": "l" } });
        whole[key] = value;
        config(whole).check().unwrap_err().to_string()
    }

    #[test]
    fn missing_keys_are_named_with_a_remedy() {
        for (key, value, why) in [
            ("run", json!([]), "`run`: names no program"),
            ("run", json!([""]), "`run`: names no program"),
            ("lock", json!(null), "`lock`: names no file"),
            ("metrics", json!({}), "`metrics`: names no metric"),
            ("measured", json!("policy"), "write both"),
            ("leaves", json!({ "policy": "*.onnx" }), "write both"),
            ("metrics", json!({ "a-b": "x" }), "no name that a claim could say"),
            ("metrics", json!({ "updates": "x" }), "is recorded of every trial"),
            ("metrics", json!({ "a": "x*" }), "is no key"),
            (
                "metrics",
                json!({ "a": { "key": "x", "from": "../log" } }),
                "no file in the working folder",
            ),
            ("parameters", json!({ "seed": 1 }), "stands for something else"),
            ("parameters", json!({ "{a}": 1 }), "braces stand around names"),
            (
                "parameters",
                json!({ "optim.lr": 1 }),
                "a dot separates keys; call it `optim_lr`, and write `--optim.lr={optim_lr}` into `run`",
            ),
            ("shown", json!({ "b": { "unit": "s" } }), "no metric is named `b`"),
            (
                "sources",
                json!({ "../a.py": { "file": "../a.py" } }),
                "leads out of the working folder: give the file a name there, as `a.py` in `sources: { a.py: { file: PATH } }`",
            ),
            (
                "sources",
                json!({ ".regimen/a": { "file": "a" } }),
                "files that this program keeps",
            ),
        ] {
            let told = refusal(key, value);
            assert!(told.contains(why), "{told}");
        }
    }

    #[test]
    fn a_name_in_braces_in_a_variable_is_doubted_and_other_braces_are_not() {
        let variables =
            json!({ "A": "{seed}", "B": "{\"a\": 1}", "C": "{x}", "D": "run-{lr}", "E": "{{seed}}" });
        let config = config(json!({ "variables": variables, "parameters": { "lr": 1 } }));
        let doubts: Vec<String> = config.unfilled_variables().map(|it| it.to_string()).collect();
        assert_eq!(doubts.len(), 2, "{doubts:?}");
        assert!(
            doubts[0].starts_with("`variables.A`: `{seed}` stays as it is"),
            "{doubts:?}"
        );
        assert!(doubts[1].starts_with("`variables.D`: `{lr}`"), "{doubts:?}");
    }

    #[test]
    fn a_way_to_measure_has_what_it_needs() {
        let told = |more: Value| {
            let mut whole = json!({ "run": ["sh"], "lock": "none" });
            let keys = more.as_object().unwrap().clone();
            whole.as_object_mut().unwrap().extend(keys);
            config(whole).check().map_err(|error| error.to_string())
        };
        assert_eq!(
            told(json!({ "measured": "calls" })),
            Ok(()),
            "metrics of its own are not needed"
        );
        let policy = |pattern| json!({ "measured": "policy", "leaves": { "policy": pattern } });
        assert_eq!(told(policy("runs/*.onnx")), Ok(()));
        assert!(
            told(policy("../a.onnx"))
                .unwrap_err()
                .contains("no file in the working folder")
        );
        let resumed = json!({ "measured": "calls", "resume": ["--resume"] });
        assert!(
            told(resumed)
                .unwrap_err()
                .contains("begins anew after an interruption")
        );
    }
}
