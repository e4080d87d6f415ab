//! Sweeps of W&B: <https://docs.wandb.ai/guides/sweeps/sweep-config-keys>.

use super::{
    error::DraftRefusal,
    options::{self, OptionPurpose},
    sweep::{Range, Search, Sweep, as_parameter, example, spaced, spelled, spread},
};
use serde_json::{Map, Value};
use std::path::Path;

/// Keys without effect on results.
const PASSED_OVER: [&str; 5] = ["name", "description", "project", "entity", "imageuri"];
/// Keys that are read.
const READ: [&str; 6] = ["program", "command", "method", "metric", "parameters", "run_cap"];

/// The argument of a command that writes a boolean as a flag, which is there or not.
const FLAGS: &str = "${args_no_boolean_flags}";

/// Reads a sweep.
///
/// # Errors
/// [`DraftRefusal::Sweep`] for a missing part.
pub fn read(file: &Path, value: &Value) -> Result<Sweep, DraftRefusal> {
    let lacks = |problem: String| DraftRefusal::Sweep {
        file: file.to_owned(),
        problem,
    };
    let mut sweep = Sweep {
        what: "a sweep of W&B",
        ..Sweep::default()
    };
    let template = template(value);
    let arguments = arguments(value, &template, &mut sweep);
    let (words, prefix) = command(value, &template, &arguments).map_err(lacks)?;
    sweep.words = words;
    for (option, _) in &mut sweep.swept {
        option.insert_str(0, prefix);
    }
    method(value, &mut sweep).map_err(lacks)?;
    metric(value, &mut sweep);
    note_other_keys(value, &mut sweep);
    Ok(sweep)
}

/// Arguments of the command, each with one value, for all parameters that have a counterpart. Those with several values
/// are added to the swept ones.
fn arguments<'a>(value: &'a Value, template: &[String], sweep: &mut Sweep) -> Vec<(&'a String, Value)> {
    let is_grid = value["method"].as_str() == Some("grid");
    let has_flags = template.iter().any(|word| word == FLAGS);
    let mut arguments = Vec::new();
    for (name, parameter) in value["parameters"].as_object().into_iter().flatten() {
        if let Some(values) = flags(parameter).filter(|_| has_flags) {
            match values[..] {
                [value] => arguments.push((name, value.clone())),
                _ => sweep.notes.push(format!(
                    "`{name}` is swept and is a flag, which is there or not: no word of a study is, so it is left to the \
                     program's default; two agents, one with the flag, compare them"
                )),
            }
            continue;
        }
        match range(name, parameter, is_grid, &mut sweep.notes) {
            Some(Range::List(values)) if values.len() == 1 => {
                sweep.note_seed(name, &values[0]);
                arguments.push((name, values[0].clone()));
            }
            Some(range) => {
                arguments.push((name, example(&range)));
                sweep.swept.push((name.clone(), range));
            }
            None => {}
        }
    }
    arguments
}

fn metric(value: &Value, sweep: &mut Sweep) {
    let Some(metric) = value.get("metric") else {
        return;
    };
    sweep.metric = metric["name"].as_str().map(str::to_owned);
    sweep.lower_is_better = Some(metric["goal"].as_str() != Some("maximize"));
    if metric.get("target").is_some() {
        let note = "`metric.target` has no counterpart: all settings are tried";
        sweep.notes.push(note.into());
    }
}

fn note_other_keys(value: &Value, sweep: &mut Sweep) {
    let keys = value.as_object().into_iter().flat_map(Map::keys);
    for key in keys.map(String::as_str) {
        if key == "early_terminate" {
            let note = "`early_terminate` is left out: `method: { halving: .. }` does it for a program with `resume`";
            sweep.notes.push(note.into());
        } else if !READ.contains(&key) && !PASSED_OVER.contains(&key) {
            sweep.notes.push(format!("`{key}` has no counterpart"));
        }
    }
}

fn method(value: &Value, sweep: &mut Sweep) -> Result<(), String> {
    let cap = value.get("run_cap").and_then(Value::as_u64);
    let method = match value["method"].as_str() {
        Some("grid") => {
            if cap.is_some() {
                sweep
                    .notes
                    .push("`run_cap` has no counterpart in a grid: all settings are tried".into());
            }
            return Ok(());
        }
        Some("random") => "{ random: {} }",
        Some("bayes") => "{ tree_parzen: {} }",
        _ => return Err("its `method` is none of `grid`, `random` and `bayes`".into()),
    };
    sweep.search = Some(Search {
        method,
        settings: cap,
    });
    Ok(())
}

/// The words of the command with names for its parts.
fn template(value: &Value) -> Vec<String> {
    match value.get("command").and_then(Value::as_array) {
        Some(words) => words.iter().map(spelled).collect(),
        None => ["${env}", "${interpreter}", "${program}", "${args}"]
            .map(str::to_owned)
            .to_vec(),
    }
}

/// The values of a parameter with a boolean among them.
fn flags(parameter: &Value) -> Option<Vec<&Value>> {
    let one = parameter.get("value").map(|value| vec![value]);
    let values = one.or_else(|| Some(parameter.get("values")?.as_array()?.iter().collect()))?;
    values.iter().any(|it| it.is_boolean()).then_some(values)
}

/// The words of the command with these arguments, and the prefix of an argument's name.
fn command(
    value: &Value,
    template: &[String],
    arguments: &[(&String, Value)],
) -> Result<(Vec<String>, &'static str), String> {
    let (mut words, mut prefix) = (Vec::new(), "--");
    for word in template {
        match word.as_str() {
            "${env}" => {}
            "${interpreter}" => words.push("python".into()),
            "${program}" => {
                let program = value["program"].as_str();
                words.push(
                    program
                        .ok_or("it names no `program`, and its `command` wants one")?
                        .to_owned(),
                );
            }
            args @ ("${args}" | FLAGS | "${args_no_hyphens}") => {
                prefix = if args == "${args_no_hyphens}" { "" } else { "--" };
                let word = |(name, value): &(&String, Value)| match value {
                    Value::Bool(is_there) if args == FLAGS => is_there.then(|| format!("--{name}")),
                    value => Some(format!("{prefix}{name}={}", spelled(value))),
                };
                words.extend(arguments.iter().filter_map(word));
            }
            other if other.contains("${") => return Err(without_counterpart(other)),
            other => words.push(other.to_owned()),
        }
    }
    Ok((words, prefix))
}

/// The reason why a word of the command is refused, with a remedy.
fn without_counterpart(word: &str) -> String {
    let remedy = if word.contains("${args") {
        "write the command with `{parameters}`, the path of a JSON file with all of them, into a study by hand"
    } else if word.contains("${envvar:") {
        "write its value, or let the program read the variable, by `inherit` of the study"
    } else {
        "write its value"
    };
    format!("`{word}` in its `command` has no counterpart: {remedy}")
}

/// The values of a parameter; `None` where a study has no counterpart.
fn range(name: &str, parameter: &Value, is_grid: bool, notes: &mut Vec<String>) -> Option<Range> {
    if let Some(value) = parameter.get("value") {
        return Some(Range::List(vec![as_parameter(value)]));
    }
    if let Some(values) = parameter.get("values").and_then(Value::as_array) {
        if parameter.get("probabilities").is_some() {
            notes.push(format!(
                "`{name}.probabilities` has no counterpart: its values are equally likely"
            ));
        }
        return Some(Range::List(values.iter().map(as_parameter).collect()));
    }
    let range = numbers(name, parameter, is_grid, notes);
    if range.is_none() {
        let what = match parameter["distribution"].as_str() {
            Some(distribution) => format!("the distribution `{distribution}` of `{name}`"),
            None => format!("`{name}`, whose parameters are nested or whose values are not said,"),
        };
        notes.push(format!(
            "{what} has no counterpart: it is left to the program's default"
        ));
    }
    range
}

fn numbers(name: &str, parameter: &Value, is_grid: bool, notes: &mut Vec<String>) -> Option<Range> {
    let (min, max) = (&parameter["min"], &parameter["max"]);
    let (low, high) = (min.as_f64()?, max.as_f64()?);
    let is_whole = min.is_i64() && max.is_i64();
    let step = parameter["q"].as_f64().unwrap_or(1.0);
    let inferred = if is_whole { "int_uniform" } else { "uniform" };
    match parameter["distribution"].as_str().unwrap_or(inferred) {
        "uniform" => Some(Range::Uniform(low, high)),
        "log_uniform_values" if low > 0.0 => Some(Range::LogUniform(low, high)),
        "log_uniform" => Some(Range::LogUniform(low.exp(), high.exp())),
        "int_uniform" => {
            let is_whole = low.fract() == 0.0 && high.fract() == 0.0;
            is_whole.then(|| listed(name, (0.0, 1.0), (whole(low), whole(high)), notes))?
        }
        // The values of a grid begin at the lower limit, and end before the upper one.
        "q_uniform" if is_grid && step > 0.0 => {
            let last = whole(((high - low) / step - 1e-9).ceil() - 1.0);
            listed(name, (low, step), (0, last), notes)
        }
        "q_uniform" if step > 0.0 => listed(name, (0.0, step), rounded(low, high, step), notes),
        "q_log_uniform_values" if step > 0.0 => {
            notes.push(format!(
                "the values of `{name}` are listed, and not spread by their logarithms"
            ));
            listed(name, (0.0, step), rounded(low, high, step), notes)
        }
        _ => None,
    }
}

/// The first and the last multiple of a step to which numbers between two limits are rounded. A limit half way between
/// two multiples counts for the inner one, since only the limit itself is rounded outwards.
fn rounded(low: f64, high: f64, step: f64) -> (i64, i64) {
    let first = whole((low / step + 0.5).floor());
    let last = whole((high / step - 0.5).ceil());
    (first, last.max(first))
}

#[allow(clippy::cast_possible_truncation, reason = "it is whole")]
fn whole(number: f64) -> i64 {
    number as i64
}

/// Evenly spaced values from `begin` on, of the first place to the last: all, or as many as may be listed.
fn listed(
    name: &str,
    (begin, step): (f64, f64),
    (first, last): (i64, i64),
    notes: &mut Vec<String>,
) -> Option<Range> {
    let values: Vec<Value> = spread(first, last)
        .map(|place| spaced(begin, place, step))
        .collect();
    let n = values.len();
    let is_seed = options::kind(name) == OptionPurpose::Seed;
    if !is_seed && i64::try_from(n).is_ok_and(|n| n <= last.saturating_sub(first)) {
        notes.push(format!("of the values of `{name}` {n} are listed, evenly spread"));
    }
    (n > 0).then_some(Range::List(values))
}

#[cfg(test)]
mod tests {
    use super::super::yaml;
    use super::*;
    use serde_json::json;

    fn sweep(text: &str) -> Result<Sweep, String> {
        let value = yaml::read("sweep.yaml", text).unwrap();
        read(Path::new("sweep.yaml"), &value).map_err(|error| error.to_string())
    }

    #[test]
    fn a_random_sweep_becomes_a_search() {
        let text = "program: train.py\nmethod: bayes\nrun_cap: 30\nmetric: { name: val/loss, goal: minimize }\n\
                    early_terminate: { type: hyperband, min_iter: 3 }\nparameters:\n  lr: { min: 1e-5, max: 1e-1, distribution: \
                    log_uniform_values }\n  gamma: { min: 0.9, max: 1.0 }\n  layers: { min: 1, max: 3 }\n  batch: { min: 32, max: 128, \
                    q: 32, distribution: q_uniform }\n  opt: { values: [adam, sgd], probabilities: [0.9, 0.1] }\n  fast: { values: \
                    [true, false] }\n  epochs: { value: 3 }\n  noise: { mu: 0, sigma: 1, distribution: normal }\n  deep: { parameters: \
                    { a: { value: 1 } } }\n";
        let sweep = sweep(text).unwrap();
        let list = |values: &[Value]| Range::List(values.to_vec());
        let swept = [
            (
                "--batch".to_owned(),
                list(&[json!(32), json!(64), json!(96), json!(128)]),
            ),
            ("--fast".into(), list(&[json!("True"), json!("False")])),
            ("--gamma".into(), Range::Uniform(0.9, 1.0)),
            ("--layers".into(), list(&[json!(1), json!(2), json!(3)])),
            ("--lr".into(), Range::LogUniform(1e-5, 0.1)),
            ("--opt".into(), list(&[json!("adam"), json!("sgd")])),
        ];
        assert_eq!(sweep.swept, swept);
        assert_eq!(
            sweep.words.join(" "),
            "python train.py --batch=32 --epochs=3 --fast=True --gamma=0.95 --layers=1 --lr=0.001 --opt=adam"
        );
        let search = Search {
            method: "{ tree_parzen: {} }",
            settings: Some(30),
        };
        assert_eq!(
            (sweep.search, sweep.metric.as_deref()),
            (Some(search), Some("val/loss"))
        );
        assert_eq!(sweep.lower_is_better, Some(true));
        let notes = sweep.notes.join("\n");
        for part in [
            "`normal` of `noise`",
            "`deep`, whose parameters are nested",
            "opt.probabilities",
            "`early_terminate`",
        ] {
            assert!(notes.contains(part), "{part}: {notes}");
        }
    }

    fn values(method: &str, parameter: &str) -> (Vec<Value>, String) {
        let text = format!("program: a\nmethod: {method}\nparameters: {{ a: {{ {parameter} }} }}\n");
        let sweep = sweep(&text).unwrap();
        let values = match sweep.swept.first() {
            Some((_, Range::List(values))) => values.clone(),
            _ => Vec::new(),
        };
        (values, sweep.notes.join("\n"))
    }

    #[test]
    fn quantised_values_are_multiples_as_they_are_drawn() {
        let tens = |all: &[i64]| all.iter().map(|it| json!(it)).collect::<Vec<_>>();
        let of = |method, parameter| values(method, parameter).0;
        let ten = "distribution: q_uniform, min: 5, max: 45, q: 10";
        assert_eq!(of("random", ten), tens(&[10, 20, 30, 40]));
        assert_eq!(of("grid", ten), tens(&[5, 15, 25, 35]));
        assert_eq!(
            of(
                "random",
                "distribution: q_log_uniform_values, min: 1, max: 20, q: 5"
            ),
            tens(&[0, 5, 10, 15, 20])
        );
        assert_eq!(
            of("random", "distribution: q_uniform, min: 0.12, max: 0.31, q: 0.1"),
            [json!(0.1), json!(0.2), json!(0.3)]
        );
        let whole = "distribution: int_uniform, min: 1.0, max: 3.0";
        assert_eq!(of("random", whole), tens(&[1, 2, 3]));
        let (many, notes) = values("random", "distribution: q_uniform, min: 0, max: 1000, q: 0.5");
        assert!(
            many.len() <= 64 && notes.contains("listed, evenly spread"),
            "{notes}"
        );
    }

    #[test]
    fn texts_that_look_like_numbers_stay_texts() {
        let (values, _) = values("grid", "values: [\"1.10\", \"007\", 1.10, true]");
        assert_eq!(values, [json!("1.10"), json!("007"), json!(1.1), json!("True")]);
    }

    #[test]
    fn booleans_are_flags_where_the_command_has_them_so() {
        let text = |fast: &str| {
            format!(
                "program: a\nmethod: grid\ncommand: [\"${{program}}\", \"{FLAGS}\"]\nparameters: {{ fast: {{ {fast} }}, lr: \
                 {{ value: 0.1 }} }}\n"
            )
        };
        assert_eq!(
            sweep(&text("value: true")).unwrap().words,
            ["a", "--fast", "--lr=0.1"]
        );
        assert_eq!(sweep(&text("value: false")).unwrap().words, ["a", "--lr=0.1"]);
        let swept = sweep(&text("values: [true, false]")).unwrap();
        assert_eq!((swept.words.len(), swept.swept.len()), (2, 0));
        assert!(
            swept.notes[0].contains("`fast` is swept and is a flag"),
            "{:?}",
            swept.notes
        );
    }

    #[test]
    fn a_grid_with_a_command_of_its_own() {
        let text = "method: grid\nprogram: run.sh\ncommand:\n  - ${env}\n  - sh\n  - ${program}\n  - fixed\n  - \
                    ${args_no_hyphens}\nparameters:\n  lr: { values: [0.1, 0.2] }\n";
        let sweep = sweep(text).unwrap();
        assert_eq!(sweep.words, ["sh", "run.sh", "fixed", "lr=0.1"]);
        assert_eq!((sweep.swept[0].0.as_str(), sweep.search), ("lr", None));
    }

    #[test]
    fn unreadable_sweeps_are_refused_with_the_reason() {
        let told = |text| sweep(text).unwrap_err();
        assert!(told("method: x\nprogram: a\nparameters: {}\n").contains("none of `grid`"));
        assert!(told("method: grid\nparameters: {}\n").contains("names no `program`"));
        let json = "method: grid\nprogram: a\ncommand: [\"${args_json}\"]\nparameters: {}\n";
        assert!(told(json).contains("`${args_json}` in its `command`"));
        let told = told(&json.replace("args_json", "envvar:HOME"));
        assert!(
            told.contains("by `inherit`") && !told.contains("{parameters}"),
            "{told}"
        );
    }
}
