//! Multiruns of Hydra: `hydra.sweeper.params` of a config, or the `multirun.yaml` that a multirun writes.

use super::{
    error::DraftRefusal,
    options,
    sweep::{Range, SETTINGS, Search, Sweep, example, integers, multiples, spelled},
};
use serde_json::{Map, Value};
use std::path::Path;

/// Reads the config of a multirun.
///
/// # Errors
/// [`DraftRefusal::Sweep`] where it has no parameters, or its program is not found.
pub fn read(folder: &Path, file: &Path, value: &Value) -> Result<Sweep, DraftRefusal> {
    let lacks = |problem: &str| DraftRefusal::Sweep {
        file: file.to_owned(),
        problem: problem.into(),
    };
    let mut sweep = Sweep {
        what: "a multirun of Hydra",
        ..Sweep::default()
    };
    let hydra = &value["hydra"];
    let overrides = overrides(hydra);
    if overrides.is_empty() {
        return Err(lacks(
            "neither `hydra.sweeper.params` nor `hydra.overrides.task` names a key; a `multirun.yaml` lies in the folder of \
             every multirun",
        ));
    }
    let script = script(folder, hydra).ok_or_else(|| {
        lacks("which program it is of is not said: write `hydra.job.name`, the name of the program without `.py`")
    })?;
    sweep.words = vec!["python".into(), script.clone()];
    sweep.words.extend(config_name(folder, file, hydra, &script));
    for (key, text) in overrides {
        match range(&text) {
            Some(Range::List(values)) if values.len() == 1 => {
                sweep.words.push(format!("{key}={}", spelled(&values[0])));
            }
            Some(range) => {
                sweep.words.push(format!("{key}={}", spelled(&example(&range))));
                sweep.swept.push((key, range));
            }
            None => sweep.notes.push(format!(
                "`{key}: {text}` has no counterpart: it is left to the program's default"
            )),
        }
    }
    method(value, &mut sweep);
    Ok(sweep)
}

/// Keys with their override texts, those of the command last.
fn overrides(hydra: &Value) -> Vec<(String, String)> {
    let params = hydra.pointer("/sweeper/params").and_then(Value::as_object);
    let of_params = params
        .into_iter()
        .flat_map(Map::iter)
        .map(|(key, value)| (key.clone(), spelled(value)));
    let tasks = hydra.pointer("/overrides/task").and_then(Value::as_array);
    let tasks = tasks.into_iter().flatten().filter_map(Value::as_str);
    let of_tasks = tasks.filter_map(|text| text.split_once('='));
    let mut all: Vec<(String, String)> = of_params.collect();
    for (key, text) in of_tasks {
        all.retain(|(other, _)| other != key);
        all.push((key.to_owned(), text.to_owned()));
    }
    all
}

/// The program: by the name of the job, or the only Python file in the folder that imports Hydra.
fn script(folder: &Path, hydra: &Value) -> Option<String> {
    let job = hydra.pointer("/job/name").and_then(Value::as_str);
    if let Some(name) = job
        .map(|job| format!("{job}.py"))
        .filter(|name| folder.join(name).is_file())
    {
        return Some(name);
    }
    let here = if folder.as_os_str().is_empty() {
        Path::new(".")
    } else {
        folder
    };
    let names = std::fs::read_dir(here).ok()?.flatten();
    let names = names.map(|entry| entry.file_name().to_string_lossy().into_owned());
    let asks = |name: &String| {
        let text = || std::fs::read_to_string(folder.join(name)).unwrap_or_default();
        name.ends_with(".py") && text().contains("hydra.main")
    };
    let found: Vec<String> = names.filter(asks).collect();
    match &found[..] {
        [one] => Some(one.clone()),
        _ => None,
    }
}

/// The option for a config that is not the program's default one.
fn config_name(folder: &Path, file: &Path, hydra: &Value, script: &str) -> Vec<String> {
    let said = hydra.pointer("/job/config_name").and_then(Value::as_str);
    let is_multirun = file.file_name().is_some_and(|name| name == "multirun.yaml");
    let own = (!is_multirun)
        .then(|| file.file_stem().and_then(|stem| stem.to_str()))
        .flatten();
    let text = std::fs::read_to_string(folder.join(script)).unwrap_or_default();
    let is_default =
        |name: &&str| text.contains(&format!("\"{name}\"")) || text.contains(&format!("'{name}'"));
    match said.or(own).filter(|name| !is_default(name)) {
        Some(name) => vec!["--config-name".into(), name.into()],
        None => Vec::new(),
    }
}

/// Reads the sweeper, from its target or from the list of defaults.
fn method(value: &Value, sweep: &mut Sweep) {
    let sweeper = &value["hydra"]["sweeper"];
    let default = |key: &str| {
        let mut defaults = value["defaults"].as_array().into_iter().flatten();
        let name = |it: &Value| {
            it.get(format!("override hydra/{key}"))?
                .as_str()
                .map(str::to_owned)
        };
        defaults.find_map(name).unwrap_or_default()
    };
    let target = |value: &Value| value["_target_"].as_str().unwrap_or_default().to_lowercase();
    let kind = target(sweeper) + &default("sweeper");
    let is_search = ["optuna", "nevergrad", "ax"]
        .iter()
        .any(|word| kind.contains(word));
    if !is_search {
        return;
    }
    let sampler = target(&sweeper["sampler"]) + &default("sweeper/sampler");
    let method = match sampler.as_str() {
        it if it.contains("random") => "{ random: {} }",
        it if it.contains("cma") => "{ cma_es: {} }",
        it if it.contains("grid") => return,
        _ => "{ tree_parzen: {} }",
    };
    let trials = sweeper["n_trials"].as_u64();
    if trials.is_none() {
        sweep.notes.push(format!(
            "`n_trials` is not said: the study tries {SETTINGS} settings"
        ));
    }
    let settings = trials.unwrap_or(SETTINGS);
    sweep.search = Some(Search { method, settings });
    match &sweeper["direction"] {
        Value::String(text) => sweep.lower_is_better = Some(text == "minimize"),
        Value::Array(_) => sweep
            .notes
            .push("several directions have no counterpart: a search goes by one metric".into()),
        _ => {}
    }
    sweep.notes.push(
        "Hydra goes by what the function returns; the study by a metric that the program writes".into(),
    );
    if sweeper.get("n_jobs").is_some() {
        sweep
            .notes
            .push("`n_jobs` is an option of `run`, as in `-j 4`".into());
    }
}

/// The values over which an override sweeps; `None` where a study has no counterpart.
fn range(text: &str) -> Option<Range> {
    let text = text.trim();
    let parts = split(text);
    if parts.len() > 1 {
        return Some(list(&parts));
    }
    let Some((name, inside)) = text.strip_suffix(')').and_then(|it| it.split_once('(')) else {
        return Some(list(&parts));
    };
    let arguments = split(inside);
    let numbers: Option<Vec<f64>> = arguments.iter().map(|it| it.parse().ok()).collect();
    match (name.trim(), arguments.as_slice()) {
        ("choice", _) => Some(list(&arguments)),
        ("shuffle", [one]) => range(one),
        ("shuffle" | "sort", _) => Some(list(&arguments)),
        ("range", _) => steps(&numbers?),
        ("interval", [_, _]) => {
            let numbers = numbers?;
            Some(Range::Uniform(numbers[0], numbers[1]))
        }
        ("int", [one]) => match range(one)? {
            #[allow(clippy::cast_possible_truncation, reason = "limits of whole numbers")]
            Range::Uniform(low, high) => Some(integers(low.ceil() as i64, high.floor() as i64)),
            _ => None,
        },
        ("tag", ["log", one]) => match range(one)? {
            Range::Uniform(low, high) if low > 0.0 => Some(Range::LogUniform(low, high)),
            _ => None,
        },
        _ => None,
    }
}

/// The numbers of `range(..)`, whose end is exclusive.
fn steps(numbers: &[f64]) -> Option<Range> {
    let (start, stop, step) = match *numbers {
        [stop] => (0.0, stop, 1.0),
        [start, stop] => (start, stop, 1.0),
        [start, stop, step] => (start, stop, step),
        _ => return None,
    };
    multiples(start, stop - step * 1e-6, step)
}

fn list(parts: &[&str]) -> Range {
    let plain = |part: &&str| part.trim_matches(|it| "\"'".contains(it)).to_owned();
    Range::List(parts.iter().map(|part| options::value(&plain(part))).collect())
}

/// Splits a text at commas outside brackets.
fn split(text: &str) -> Vec<&str> {
    let (mut parts, mut depth, mut begin) = (Vec::new(), 0, 0);
    for (place, letter) in text.char_indices() {
        match letter {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth -= 1,
            ',' if depth == 0 => {
                parts.push(text[begin..place].trim());
                begin = place + 1;
            }
            _ => {}
        }
    }
    parts.push(text[begin..].trim());
    parts
}

#[cfg(test)]
mod tests {
    use super::super::yaml;
    use super::*;
    use serde_json::json;

    fn sweep(name: &str, text: &str) -> Result<Sweep, String> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(
            folder.path().join("train.py"),
            "@hydra.main(config_name=\"config\")",
        )
        .unwrap();
        let value = yaml::read(name, text).unwrap();
        read(folder.path(), Path::new(name), &value).map_err(|error| error.to_string())
    }

    #[test]
    fn values_are_read_as_hydra_writes_them() {
        let list = |values: &[Value]| Some(Range::List(values.to_vec()));
        assert_eq!(range("1e-3, 1e-4"), list(&[json!(0.001), json!(0.0001)]));
        assert_eq!(range("choice(adam, 'sgd')"), list(&[json!("adam"), json!("sgd")]));
        assert_eq!(range("[1,2],[3]"), list(&[json!("[1,2]"), json!("[3]")]));
        assert_eq!(range("range(1,4)"), list(&[json!(1), json!(2), json!(3)]));
        assert_eq!(range("range(0, 1, 0.5)"), list(&[json!(0), json!(0.5)]));
        assert_eq!(range("shuffle(range(2))"), list(&[json!(0), json!(1)]));
        assert_eq!(range("interval(0, 1)"), Some(Range::Uniform(0.0, 1.0)));
        assert_eq!(range("int(interval(1, 2))"), list(&[json!(1), json!(2)]));
        assert_eq!(
            range("tag(log, interval(1e-5, 1))"),
            Some(Range::LogUniform(1e-5, 1.0))
        );
        assert_eq!(range("mysql"), list(&[json!("mysql")]));
        assert_eq!(range("glob(*)"), None);
        assert_eq!(range("tag(log, interval(0, 1))"), None);
    }

    #[test]
    fn a_multirun_that_was_run_becomes_a_grid() {
        let text = include_str!("../../fixtures/multirun.yaml");
        let sweep = sweep("multirun.yaml", text).unwrap();
        assert_eq!(
            sweep.words,
            ["python", "train.py", "lr=0.1", "seed=1", "db=mysql"]
        );
        let lists = [
            ("lr".to_owned(), Range::List(vec![json!(0.1), json!(0.2)])),
            ("seed".into(), integers(1, 2)),
        ];
        assert_eq!((sweep.swept, sweep.search), (lists.to_vec(), None));
    }

    #[test]
    fn a_config_with_a_sweeper_becomes_a_search() {
        let text = "defaults:\n  - _self_\n  - override hydra/sweeper: optuna\nhydra:\n  sweeper:\n    n_trials: 12\n    \
                    direction: maximize\n    params:\n      lr: tag(log, interval(1e-5, 1e-1))\n      model: glob(*)\nlr: 0.1\n";
        let sweep = sweep("conf/tune.yaml", text).unwrap();
        assert_eq!(
            sweep.words,
            ["python", "train.py", "--config-name", "tune", "lr=0.001"]
        );
        let search = Search {
            method: "{ tree_parzen: {} }",
            settings: 12,
        };
        assert_eq!((sweep.search, sweep.lower_is_better), (Some(search), Some(false)));
        assert!(
            sweep
                .notes
                .iter()
                .any(|note| note.contains("`model: glob(*)` has no counterpart")),
            "{:?}",
            sweep.notes
        );
    }

    #[test]
    fn missing_parts_of_a_multirun_are_named() {
        assert!(
            sweep("config.yaml", "hydra: { job: {} }\n")
                .unwrap_err()
                .contains("hydra.sweeper.params")
        );
        let folder = tempfile::tempdir().unwrap();
        let value = json!({ "hydra": { "sweeper": { "params": { "lr": "1,2" } } } });
        let told = read(folder.path(), Path::new("config.yaml"), &value)
            .unwrap_err()
            .to_string();
        assert!(told.contains("`hydra.job.name`"), "{told}");
    }
}
