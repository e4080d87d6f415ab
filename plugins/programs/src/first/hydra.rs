//! Multiruns of Hydra: `hydra.sweeper.params` of a config, or the `multirun.yaml` that a multirun writes.

use super::{
    error::DraftRefusal,
    options,
    sweep::{CMA_ES, Range, Search, Sweep, example, integers, multiples, spelled},
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
    let (overrides, others) = overrides(hydra);
    if overrides.is_empty() && others.is_empty() {
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
    sweep.words.extend(others);
    for (key, text) in overrides {
        match range(&text) {
            Some(Range::List(values)) if values.len() == 1 => {
                sweep.note_seed(&key, &values[0]);
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

/// Keys with their override texts, those of the command last; and words that delete a key, as `~db`.
fn overrides(hydra: &Value) -> (Vec<(String, String)>, Vec<String>) {
    let params = hydra.pointer("/sweeper/params").and_then(Value::as_object);
    let of_params = params
        .into_iter()
        .flat_map(Map::iter)
        .map(|(key, value)| (key.clone(), spelled(value)));
    let tasks = hydra.pointer("/overrides/task").and_then(Value::as_array);
    let tasks = tasks.into_iter().flatten().filter_map(Value::as_str);
    let (mut all, mut others): (Vec<(String, String)>, Vec<String>) = (of_params.collect(), Vec::new());
    for task in tasks {
        match task.split_once('=').filter(|_| !task.starts_with('~')) {
            Some((key, text)) => {
                all.retain(|(other, _)| other != key);
                all.push((key.to_owned(), text.to_owned()));
            }
            None => others.push(task.to_owned()),
        }
    }
    (all, others)
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
    sweep.notes.extend(without_counterpart(sweeper));
    let is_search = ["optuna", "nevergrad", "ax"]
        .iter()
        .any(|word| kind.contains(word));
    if !is_search {
        return;
    }
    let sampler = target(&sweeper["sampler"]) + &default("sweeper/sampler");
    let method = match sampler.as_str() {
        it if it.contains("random") => "{ random: {} }",
        it if it.contains("cma") => CMA_ES,
        it if it.contains("grid") => return,
        _ => "{ tree_parzen: {} }",
    };
    let settings = sweeper["n_trials"].as_u64();
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

/// Notes on the keys of a sweeper that are not read.
fn without_counterpart(sweeper: &Value) -> Option<String> {
    const READ: [&str; 6] = ["_target_", "params", "direction", "n_trials", "n_jobs", "sampler"];
    let keys = |value: &Value, before: &str, read: &[&str]| {
        let entries = value.as_object().into_iter().flatten();
        let set = entries.filter(|(key, value)| !value.is_null() && !read.contains(&key.as_str()));
        set.map(|(key, _)| format!("`{before}{key}`"))
            .collect::<Vec<String>>()
    };
    let mut all = keys(sweeper, "", &READ);
    all.extend(keys(&sweeper["sampler"], "sampler.", &["_target_"]));
    (!all.is_empty()).then(|| {
        format!(
            "of `hydra.sweeper` these keys have no counterpart: {}",
            all.join(", ")
        )
    })
}

/// The values over which an override sweeps; `None` where a study has no counterpart.
fn range(text: &str) -> Option<Range> {
    let text = text.trim();
    let parts = split(text);
    if parts.len() > 1 {
        return Some(list(&parts));
    }
    let call = text.strip_suffix(')').and_then(|it| it.split_once('('));
    let Some((name, inside)) = call.filter(|(name, _)| is_word(name.trim())) else {
        return Some(list(&parts));
    };
    let mut arguments = split(inside);
    if name.trim() == "sort" {
        // The order of settings does not matter.
        arguments.retain(|it| !it.starts_with("reverse="));
    }
    if arguments.iter().any(|it| is_named(it)) {
        return None;
    }
    let numbers: Option<Vec<f64>> = arguments.iter().map(|it| it.parse().ok()).collect();
    match (name.trim(), arguments.as_slice()) {
        ("choice", _) => Some(list(&arguments)),
        ("shuffle" | "sort", [one]) => range(one).filter(|_| !one.starts_with('[')),
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

/// Whether an argument is written with its name, as in `range(start=1, stop=4)`.
fn is_named(argument: &str) -> bool {
    argument
        .split_once('=')
        .is_some_and(|(name, _)| is_word(name.trim()))
}

fn list(parts: &[&str]) -> Range {
    Range::List(parts.iter().map(|part| item(part)).collect())
}

/// A value as Hydra has to be given it: a text keeps its quotes where Hydra reads something else without them.
fn item(part: &str) -> Value {
    const OTHERS: [&str; 5] = ["true", "false", "null", "nan", "inf"];
    let inside = |quote: char| part.strip_prefix(quote)?.strip_suffix(quote);
    match inside('\'').or_else(|| inside('"')) {
        None => options::value(part),
        Some(text) if is_word(text) && !OTHERS.contains(&text.to_ascii_lowercase().as_str()) => text.into(),
        Some(_) => part.into(),
    }
}

fn is_word(text: &str) -> bool {
    text.starts_with(|it: char| it.is_ascii_alphabetic() || it == '_')
        && text
            .chars()
            .all(|it| it.is_ascii_alphanumeric() || "_-./".contains(it))
}

/// Splits a text at commas outside brackets and quotes.
fn split(text: &str) -> Vec<&str> {
    let (mut parts, mut depth, mut begin, mut quote) = (Vec::new(), 0, 0, None);
    let mut letters = text.char_indices();
    while let Some((place, letter)) = letters.next() {
        match letter {
            // The next letter is meant as it is.
            '\\' => drop(letters.next()),
            _ if quote == Some(letter) => quote = None,
            _ if quote.is_some() => {}
            '\'' | '"' => quote = Some(letter),
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
        assert_eq!(range("'a,b','c,d'"), list(&[json!("'a,b'"), json!("'c,d'")]));
        assert_eq!(
            range("choice(mysql,\"post,gres\")"),
            list(&[json!("mysql"), json!("\"post,gres\"")])
        );
        assert_eq!(range("'it\\'s,b',c"), list(&[json!("'it\\'s,b'"), json!("c")]));
        assert_eq!(range("'f(x)'"), list(&[json!("'f(x)'")]));
        assert_eq!(range("'1'"), list(&[json!("'1'")]));
        assert_eq!(
            range("sort(3,1,2,reverse=true)"),
            list(&[json!(3), json!(1), json!(2)])
        );
        assert_eq!(range("sort([3,1])"), None);
        assert_eq!(range("range(start=1,stop=4)"), None);
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
            settings: Some(12),
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
    fn a_word_that_deletes_a_key_stays_and_keys_of_the_sweeper_are_named() {
        let text = "hydra:\n  overrides: { task: [\"~db\", \"lr=1,2\", \"seed=3\"] }\n  sweeper: { _target_: Optuna, storage: null, \
                    study_name: x, sampler: { seed: 123 } }\n";
        let sweep = sweep("multirun.yaml", text).unwrap();
        assert_eq!(sweep.words, ["python", "train.py", "~db", "lr=1", "seed=3"]);
        let notes = sweep.notes.join("\n");
        assert!(
            notes.contains("no counterpart: `study_name`, `sampler.seed`"),
            "{notes}"
        );
        assert!(notes.contains("`seed` is 3 in the sweep"), "{notes}");
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
