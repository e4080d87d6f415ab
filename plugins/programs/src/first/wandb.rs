//! Sweeps of W&B: <https://docs.wandb.ai/guides/sweeps/sweep-config-keys>.

use super::{
    error::DraftRefusal,
    sweep::{Range, SETTINGS, Search, Sweep, as_parameter, example, integers, multiples, spelled},
};
use serde_json::{Map, Value};
use std::path::Path;

/// Keys without effect on results.
const PASSED_OVER: [&str; 5] = ["name", "description", "project", "entity", "imageuri"];
/// Keys that are read.
const READ: [&str; 6] = ["program", "command", "method", "metric", "parameters", "run_cap"];

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
    let nothing = Map::new();
    let mut arguments = Vec::new();
    for (name, parameter) in value["parameters"].as_object().unwrap_or(&nothing) {
        match range(name, parameter, &mut sweep.notes) {
            Some(Range::List(values)) if values.len() == 1 => arguments.push((name, values[0].clone())),
            Some(range) => {
                arguments.push((name, example(&range)));
                sweep.swept.push((name.clone(), range));
            }
            None => {}
        }
    }
    let (words, prefix) = command(value, &arguments).map_err(lacks)?;
    sweep.words = words;
    for (option, _) in &mut sweep.swept {
        option.insert_str(0, prefix);
    }
    method(value, &mut sweep).map_err(lacks)?;
    if let Some(metric) = value.get("metric") {
        sweep.metric = metric["name"].as_str().map(str::to_owned);
        sweep.lower_is_better = Some(metric["goal"].as_str() != Some("maximize"));
        if metric.get("target").is_some() {
            sweep
                .notes
                .push("`metric.target` has no counterpart: all settings are tried".into());
        }
    }
    for key in value
        .as_object()
        .into_iter()
        .flat_map(Map::keys)
        .map(String::as_str)
    {
        if key == "early_terminate" {
            let note = "`early_terminate` is left out: `method: { halving: .. }` does it for a program with `resume`";
            sweep.notes.push(note.into());
        } else if !READ.contains(&key) && !PASSED_OVER.contains(&key) {
            sweep.notes.push(format!("`{key}` has no counterpart"));
        }
    }
    Ok(sweep)
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
    if cap.is_none() {
        sweep.notes.push(format!(
            "a sweep without `run_cap` has no end: the study tries {SETTINGS} settings"
        ));
    }
    let settings = cap.unwrap_or(SETTINGS);
    sweep.search = Some(Search { method, settings });
    Ok(())
}

/// The words of the command with these arguments, and the prefix of an argument's name.
fn command(value: &Value, arguments: &[(&String, Value)]) -> Result<(Vec<String>, &'static str), String> {
    let default = ["${env}", "${interpreter}", "${program}", "${args}"].map(Value::from);
    let template = value
        .get("command")
        .and_then(Value::as_array)
        .map_or(&default[..], Vec::as_slice);
    let (mut words, mut prefix) = (Vec::new(), "--");
    for word in template {
        match spelled(word).as_str() {
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
            args @ ("${args}" | "${args_no_boolean_flags}" | "${args_no_hyphens}") => {
                prefix = if args == "${args_no_hyphens}" { "" } else { "--" };
                words.extend(
                    arguments
                        .iter()
                        .map(|(name, value)| format!("{prefix}{name}={}", spelled(value))),
                );
            }
            other if other.contains("${") => {
                return Err(format!(
                    "`{other}` in its `command` has no counterpart: write the command with `{{parameters}}`, the path of a \
                     JSON file with all of them, into a study by hand"
                ));
            }
            other => words.push(other.to_owned()),
        }
    }
    Ok((words, prefix))
}

/// The values of a parameter; `None` where a study has no counterpart.
fn range(name: &str, parameter: &Value, notes: &mut Vec<String>) -> Option<Range> {
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
    let range = numbers(name, parameter, notes);
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

fn numbers(name: &str, parameter: &Value, notes: &mut Vec<String>) -> Option<Range> {
    let (min, max) = (&parameter["min"], &parameter["max"]);
    let (low, high) = (min.as_f64()?, max.as_f64()?);
    let whole = min.as_i64().zip(max.as_i64());
    let step = parameter["q"].as_f64().unwrap_or(1.0);
    let inferred = if whole.is_some() { "int_uniform" } else { "uniform" };
    let distribution = parameter["distribution"].as_str().unwrap_or(inferred);
    match distribution {
        "uniform" => Some(Range::Uniform(low, high)),
        "log_uniform_values" if low > 0.0 => Some(Range::LogUniform(low, high)),
        "log_uniform" => Some(Range::LogUniform(low.exp(), high.exp())),
        "int_uniform" => {
            let (low, high) = whole?;
            let range = integers(low, high);
            if let Range::List(values) = &range
                && i64::try_from(values.len()).is_ok_and(|n| n <= high.saturating_sub(low))
            {
                let n = values.len();
                notes.push(format!(
                    "of the whole numbers of `{name}` {n} are listed, evenly spread"
                ));
            }
            Some(range)
        }
        "q_uniform" => multiples(low, high, step),
        "q_log_uniform_values" => {
            notes.push(format!(
                "the values of `{name}` are listed, and not spread by their logarithms"
            ));
            multiples(low, high, step)
        }
        _ => None,
    }
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
            settings: 30,
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
    }
}
