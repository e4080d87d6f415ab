//! Sweeps of other tools: the command, the values of each option, the method by which settings are chosen, and
//! notes on keys without a counterpart in a study.

use super::{
    error::DraftRefusal,
    hydra,
    options::{self, OptionPurpose},
    wandb, yaml,
};
use serde_json::Value;
use std::path::Path;

/// Most values to which a range of whole numbers or steps is expanded.
const MOST_LISTED: usize = 64;
/// Number of settings for a sweep that has no end.
pub const SETTINGS: u64 = 20;

/// Values of an option.
#[derive(Debug, Clone, PartialEq)]
pub enum Range {
    /// Listed values.
    List(Vec<Value>),
    /// Uniform between two limits.
    Uniform(f64, f64),
    /// Uniform in the logarithm between two limits.
    LogUniform(f64, f64),
}

impl Range {
    /// The listed texts.
    pub fn texts(&self) -> impl Iterator<Item = &str> {
        let listed = match self {
            Self::List(values) => &values[..],
            _ => &[],
        };
        listed.iter().filter_map(Value::as_str)
    }
}

/// Method for choosing settings if not all of them are tried.
#[derive(Debug, Clone, PartialEq)]
pub struct Search {
    /// The method's name in a study.
    pub method: &'static str,
    /// Number of settings.
    pub settings: u64,
}

/// The sweep of another tool.
#[derive(Debug, Default, PartialEq)]
pub struct Sweep {
    /// Kind of the sweep, in a word or two.
    pub what: &'static str,
    /// The command, with one value of each option.
    pub words: Vec<String>,
    /// Options with several values.
    pub swept: Vec<(String, Range)>,
    /// Method for choosing settings; `None` if all are tried.
    pub search: Option<Search>,
    /// The metric by which the sweep compares settings.
    pub metric: Option<String>,
    /// Whether lower values of that metric are better; `None` if the sweep does not state it.
    pub lower_is_better: Option<bool>,
    /// Number of seeds in the sweep.
    pub seeds: Option<usize>,
    /// Sentences on keys without a counterpart.
    pub notes: Vec<String>,
}

impl Sweep {
    /// Reads the file of a sweep, given relative to the study's folder.
    ///
    /// # Errors
    /// [`DraftRefusal`] for a file that is not a sweep, and for a missing part.
    pub fn read(folder: &Path, file: &Path) -> Result<Self, DraftRefusal> {
        let path = folder.join(file);
        let text = std::fs::read_to_string(&path).map_err(contract::Error::file("read", &path))?;
        let value = yaml::read(&file.display().to_string(), &text)?;
        let mut sweep = if value.get("hydra").is_some() {
            hydra::read(folder, file, &value)?
        } else if value.get("parameters").is_some_and(Value::is_object) {
            wandb::read(file, &value)?
        } else {
            return Err(DraftRefusal::NoSweep(file.to_owned()));
        };
        sweep.count_seeds();
        if sweep.search.is_none()
            && sweep
                .swept
                .iter()
                .any(|(_, range)| !matches!(range, Range::List(_)))
        {
            sweep.search = Some(Search {
                method: "{ random: {} }",
                settings: SETTINGS,
            });
            sweep
                .notes
                .push(format!("a range is sampled {SETTINGS} times: look at `settings`"));
        }
        Ok(sweep)
    }

    /// Turns a sweep over seeds into replicates.
    fn count_seeds(&mut self) {
        let Some(place) = self
            .swept
            .iter()
            .position(|(option, _)| options::kind(option) == OptionPurpose::Seed)
        else {
            return;
        };
        let (option, range) = self.swept.remove(place);
        if let Range::List(values) = range {
            self.seeds = Some(values.len());
            let n = values.len();
            self.notes.push(format!(
                "the {n} values of `{option}` are {n} seeds of the study, which count from 0"
            ));
        }
    }
}

/// Whole numbers between two limits, both included: all of them, or as many as may be listed.
pub fn integers(low: i64, high: i64) -> Range {
    let count = usize::try_from(high.saturating_sub(low))
        .unwrap_or(0)
        .saturating_add(1);
    let stride = count.div_ceil(MOST_LISTED).max(1);
    Range::List((low..=high).step_by(stride).map(Value::from).collect())
}

/// Multiples of a step between two numbers; `None` where they are too many to be listed.
pub fn multiples(low: f64, high: f64, step: f64) -> Option<Range> {
    let count = ((high - low) / step + 1e-9).floor();
    #[allow(
        clippy::cast_precision_loss,
        reason = "a count of values that are written out"
    )]
    let is_few = step > 0.0 && count >= 0.0 && count < MOST_LISTED as f64;
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "it is a small count"
    )]
    let count = if is_few { count as u32 } else { return None };
    let value = |place: u32| {
        // Ten decimals, so that sums of steps are written as a person would write them.
        let text = format!("{:.10}", f64::from(place).mul_add(step, low));
        options::value(text.trim_end_matches('0').trim_end_matches('.'))
    };
    Some(Range::List((0..=count).map(value).collect()))
}

/// One value of a range, with which the probe starts the program.
pub fn example(range: &Range) -> Value {
    let round = |value: f64| options::value(&format!("{value:.2e}"));
    match range {
        Range::List(values) => values.first().cloned().unwrap_or_default(),
        Range::Uniform(low, high) => round(f64::midpoint(*low, *high)),
        Range::LogUniform(low, high) => round((low.ln().midpoint(high.ln())).exp()),
    }
}

/// A value as a word of a command, in Python's notation.
pub fn spelled(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Bool(true) => "True".into(),
        Value::Bool(false) => "False".into(),
        Value::Null => "None".into(),
        other => other.to_string(),
    }
}

/// A value in the parameters of a study.
pub fn as_parameter(value: &Value) -> Value {
    match value {
        Value::Number(_) => value.clone(),
        other => options::value(&spelled(other)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn ranges_are_written_out_where_they_are_short() {
        assert_eq!(integers(1, 3), Range::List(vec![json!(1), json!(2), json!(3)]));
        let Range::List(many) = integers(0, 1000) else {
            panic!()
        };
        assert!(many.len() <= MOST_LISTED && many[0] == json!(0));
        assert_eq!(
            multiples(0.1, 0.35, 0.1),
            Some(Range::List(vec![json!(0.1), json!(0.2), json!(0.3)]))
        );
        assert_eq!(
            multiples(16.0, 64.0, 16.0),
            Some(Range::List([16, 32, 48, 64].map(Value::from).to_vec()))
        );
        assert_eq!(multiples(0.0, 1e6, 0.5), None);
        assert_eq!(multiples(0.0, 1.0, 0.0), None);
    }

    #[test]
    fn one_value_is_taken_of_each_range() {
        assert_eq!(example(&Range::LogUniform(1e-5, 1e-1)), json!(0.001));
        assert_eq!(example(&Range::Uniform(0.0, 1.0)), json!(0.5));
        assert_eq!(example(&Range::List(vec![json!("a")])), json!("a"));
        assert_eq!(
            (spelled(&json!(true)), spelled(&json!(null))),
            ("True".into(), "None".into())
        );
    }
}
