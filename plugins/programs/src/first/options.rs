//! Classification of options by their names: seeds, steps, tasks, and options that are copied unchanged.

use crate::{config::ProgramConfig, words::OTHERS};
use serde_json::{Map, Number, Value};
use std::{collections::BTreeSet, sync::LazyLock};

/// Purpose of an option.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OptionPurpose {
    /// The seed.
    Seed,
    /// Length of the training; of several options the one with the lowest rank.
    Steps(usize),
    /// The task.
    Task,
    /// A path, a name or a flag without effect on results.
    Stays,
    /// Anything else.
    Parameter,
}

const SEEDS: [&str; 5] = ["seed", "random_seed", "rng_seed", "random_state", "seeds"];
/// Not `n_steps`, `num_steps` and `n_epochs`, which in common programs count one rollout or update.
const STEPS: [&str; 22] = [
    "total_timesteps",
    "total_steps",
    "total_env_steps",
    "num_env_steps",
    "num_timesteps",
    "n_timesteps",
    "timesteps",
    "max_timesteps",
    "max_steps",
    "max_env_steps",
    "training_steps",
    "train_steps",
    "steps",
    "max_iters",
    "max_iterations",
    "num_iterations",
    "iterations",
    "num_episodes",
    "n_episodes",
    "episodes",
    "max_epochs",
    "epochs",
];
const TASKS: [&str; 8] = [
    "env",
    "env_id",
    "env_name",
    "environment",
    "environment_id",
    "task",
    "gym_id",
    "game",
];
/// Last words of the names of options for paths, labels and the like.
const PLACES: [&str; 22] = [
    "dir",
    "directory",
    "path",
    "folder",
    "file",
    "out",
    "output",
    "outdir",
    "logdir",
    "log",
    "logs",
    "name",
    "project",
    "entity",
    "device",
    "cuda",
    "gpu",
    "verbose",
    "workers",
    "port",
    "host",
    "tag",
];
/// Keys of a program in a study, which no parameter may hide.
static KEYS: LazyLock<BTreeSet<String>> = LazyLock::new(|| {
    let schema = schemars::schema_for!(ProgramConfig);
    let keys = schema.get("properties").and_then(Value::as_object);
    keys.into_iter().flat_map(Map::keys).cloned().collect()
});

/// The name of an option in lower case, without dashes.
fn plain(option: &str) -> String {
    let name = option.trim_start_matches(['-', '+']);
    name.to_ascii_lowercase().replace('-', "_")
}

/// The purpose of an option, by its name.
pub fn kind(option: &str) -> OptionPurpose {
    let plain = plain(option);
    let last = plain.rsplit(['.', '/']).next().unwrap_or_default();
    if SEEDS.contains(&last) {
        return OptionPurpose::Seed;
    }
    if let Some(rank) = rank_of_steps(option) {
        return OptionPurpose::Steps(rank);
    }
    if TASKS.contains(&last) {
        return OptionPurpose::Task;
    }
    let word = last.rsplit('_').next().unwrap_or_default();
    let is_place = PLACES.contains(&word) || plain.starts_with("wandb") || plain.starts_with("hydra.");
    if is_place {
        OptionPurpose::Stays
    } else {
        OptionPurpose::Parameter
    }
}

/// Position of an option in the list of names for the length of a training.
pub fn rank_of_steps(option: &str) -> Option<usize> {
    let plain = plain(option);
    let last = plain.rsplit(['.', '/']).next().unwrap_or_default();
    STEPS.iter().position(|name| *name == last)
}

/// The name of an option as a parameter of a study.
pub fn parameter_name(option: &str) -> String {
    let trimmed = option.trim_start_matches(['-', '+']);
    let letter = |it: char| {
        if it.is_ascii_alphanumeric() || it == '_' {
            it
        } else {
            '_'
        }
    };
    let mut name: String = trimmed.chars().map(letter).collect();
    if !name.starts_with(|it: char| it.is_ascii_alphabetic() || it == '_') {
        name.insert_str(0, "p_");
    }
    if KEYS.contains(&name) || OTHERS.contains(&name.as_str()) {
        name.push('_');
    }
    name
}

/// The value of a word: a number if it spells the same, otherwise the text. A number with an exponent is spelled anew,
/// and so is a negative one, because a text that begins with `-` would be taken for an option.
pub fn value(text: &str) -> Value {
    let Some(number) = number(text) else {
        return text.into();
    };
    let whole = text.parse::<i64>().ok();
    let has_exponent = text.contains(['e', 'E']);
    let spells_the_same = match whole {
        Some(whole) => whole.to_string() == text,
        None => text.contains('.') && (number.to_string() == text || format!("{number}.0") == text),
    };
    if !has_exponent && !text.starts_with('-') && !spells_the_same {
        return text.into();
    }
    match whole {
        Some(whole) => whole.into(),
        // Programs that ask for a whole number understand `1000000`, and some do not understand `1e6`.
        #[allow(clippy::cast_possible_truncation, reason = "it is whole and below 2^53")]
        None if number.fract() == 0.0 && number.abs() < 1e15 && has_exponent => (number as i64).into(),
        None => Number::from_f64(number).map_or_else(|| text.into(), Value::Number),
    }
}

/// Whether a word is a number, however it is spelled.
pub fn is_number(text: &str) -> bool {
    number(text).is_some()
}

fn number(text: &str) -> Option<f64> {
    let plain = text.trim_start_matches(['-', '+']);
    let begins = plain.starts_with(|it: char| it.is_ascii_digit() || it == '.');
    text.parse().ok().filter(|it: &f64| begins && it.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn options_are_told_apart_by_their_names() {
        for (option, told) in [
            ("--seed", OptionPurpose::Seed),
            ("+exp.random_seed", OptionPurpose::Seed),
            ("--env-id", OptionPurpose::Task),
            ("algo.env", OptionPurpose::Task),
            ("--log-dir", OptionPurpose::Stays),
            ("--out", OptionPurpose::Stays),
            ("--wandb-mode", OptionPurpose::Stays),
            ("hydra.run.dir", OptionPurpose::Stays),
            ("--lr", OptionPurpose::Parameter),
            ("--num-steps", OptionPurpose::Parameter),
            ("--log-std-init", OptionPurpose::Parameter),
        ] {
            assert_eq!(kind(option), told, "{option}");
        }
        assert!(matches!(kind("--total-timesteps"), OptionPurpose::Steps(0)));
        assert!(rank_of_steps("--epochs") > rank_of_steps("--max_steps"));
    }

    #[test]
    fn values_are_what_a_program_would_read() {
        for (text, read) in [
            ("3e-4", json!(0.0003)),
            ("1e6", json!(1_000_000)),
            ("-1", json!(-1)),
            ("0.5", json!(0.5)),
            ("0.00001", json!(0.00001)),
            ("1.0", json!(1.0)),
            ("-0.50", json!(-0.5)),
            ("0.50", json!("0.50")),
            ("1.10", json!("1.10")),
            ("007", json!("007")),
            ("12345678901234567890123", json!("12345678901234567890123")),
            ("True", json!("True")),
            ("nan", json!("nan")),
            ("1e999", json!("1e999")),
            ("1,2", json!("1,2")),
            ("-", json!("-")),
        ] {
            assert_eq!(value(text), read, "{text}");
        }
    }

    #[test]
    fn names_of_parameters_are_none_of_the_keys_of_a_program() {
        assert_eq!(parameter_name("--learning-rate"), "learning_rate");
        assert_eq!(parameter_name("+optim.lr"), "optim_lr");
        assert_eq!(parameter_name("--stop"), "stop_");
        assert_eq!(parameter_name("--steps"), "steps_");
        assert_eq!(parameter_name("-2"), "p_2");
        for key in ["run", "parameters", "needs", "measured", "leaves", "interpreter"] {
            assert_eq!(parameter_name(&format!("--{key}")), format!("{key}_"));
        }
    }
}
