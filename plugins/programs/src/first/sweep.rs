//! Sweeps of other tools: the command, the values of each option, the method by which settings are chosen, and
//! notes on keys without a counterpart in a study.

use super::{
    error::DraftRefusal,
    hydra,
    options::{self, OptionPurpose},
    wandb, yaml,
};
use serde_json::Value;
use std::{collections::BTreeSet, path::Path};

/// Most values to which a range of whole numbers or steps is expanded.
const MOST_LISTED: usize = 64;
/// Number of settings for a sweep that has no end.
const SETTINGS: u64 = 20;
/// Most seeds of a search, which measures its best setting on all of them.
const MOST_SEEDS: usize = 10;
/// The method for ranges of numbers alone.
pub const CMA_ES: &str = "{ cma_es: {} }";

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

    /// Number of values; `None` where they are not listed.
    fn count(&self) -> Option<u64> {
        match self {
            Self::List(values) => Some(values.len() as u64),
            _ => None,
        }
    }
}

/// Method for choosing settings if not all of them are tried.
#[derive(Debug, Clone, PartialEq)]
pub struct Search {
    /// The method's name in a study.
    pub method: &'static str,
    /// Number of settings, if the sweep states it.
    pub settings: Option<u64>,
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
    /// Number of settings that a search tries.
    pub settings: u64,
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
                settings: None,
            });
        }
        sweep.count_settings();
        Ok(sweep)
    }

    /// Options with several values.
    pub fn options(&self) -> BTreeSet<String> {
        self.swept.iter().map(|(option, _)| option.clone()).collect()
    }

    /// Notes that the only seed of a sweep is not that of the study.
    pub fn note_seed(&mut self, option: &str, value: &Value) {
        if options::kind(option) == OptionPurpose::Seed {
            self.notes.push(format!(
                "`{option}` is {value} in the sweep; seeds of the study count from 0"
            ));
        }
    }

    /// Decides how many settings a search tries: no more than exist. Its method has to accept lists.
    fn count_settings(&mut self) {
        let counts = self.swept.iter().map(|(_, range)| range.count());
        let all = counts
            .clone()
            .try_fold(1_u64, |all, n| Some(all.saturating_mul(n?)));
        let has_list = counts.flatten().next().is_some();
        let Some(search) = self.search.as_mut().filter(|_| !self.swept.is_empty()) else {
            self.search = None;
            return;
        };
        if has_list && search.method == CMA_ES {
            search.method = "{ tree_parzen: {} }";
        }
        self.settings = search.settings.unwrap_or(SETTINGS).min(all.unwrap_or(u64::MAX));
        let settings = self.settings;
        match search.settings {
            None => self.notes.push(format!(
                "the sweep does not say how many settings it tries: the study tries {settings}, by `settings`"
            )),
            Some(asked) if asked > settings => self.notes.push(format!(
                "the sweep asks for {asked} settings, and there are {settings}"
            )),
            Some(_) => {}
        }
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
            let most = self.search.as_ref().map_or(usize::MAX, |_| MOST_SEEDS);
            let seeds = values.len().min(most);
            self.seeds = Some(seeds);
            self.notes.push(format!(
                "the values of `{option}` become {seeds} seeds of the study, which count from 0"
            ));
        }
    }
}

/// Whole numbers between two limits, both included: all of them, or as many as may be listed.
pub fn spread(low: i64, high: i64) -> impl Iterator<Item = i64> {
    let count = usize::try_from(high.saturating_sub(low))
        .unwrap_or(0)
        .saturating_add(1);
    let stride = count.div_ceil(MOST_LISTED).max(1);
    (low..=high).step_by(stride)
}

/// Like [`spread`], as values of an option.
pub fn integers(low: i64, high: i64) -> Range {
    Range::List(spread(low, high).map(Value::from).collect())
}

/// Multiples of a step between two numbers; `None` where they are too many to be listed.
pub fn multiples(low: f64, high: f64, step: f64) -> Option<Range> {
    let count = ((high - low) / step + 1e-9).floor();
    #[allow(
        clippy::cast_precision_loss,
        reason = "a count of values that are written out"
    )]
    let is_few = step > 0.0 && count >= 0.0 && count < MOST_LISTED as f64;
    #[allow(clippy::cast_possible_truncation, reason = "it is a small count")]
    let count = if is_few { count as i64 } else { return None };
    Some(Range::List(
        (0..=count).map(|place| spaced(low, place, step)).collect(),
    ))
}

/// The value at a place of an evenly spaced list.
pub fn spaced(begin: f64, place: i64, step: f64) -> Value {
    #[allow(clippy::cast_precision_loss, reason = "places are few")]
    let number = (place as f64).mul_add(step, begin);
    // Ten decimals, so that sums of steps are written as a person would write them.
    let text = format!("{number:.10}");
    options::value(text.trim_end_matches('0').trim_end_matches('.'))
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

/// A value in the parameters of a study: a number, or the text that the program gets.
pub fn as_parameter(value: &Value) -> Value {
    match value {
        Value::Number(_) => value.clone(),
        other => spelled(other).into(),
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

    fn read(text: &str) -> Sweep {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("sweep.yaml"), format!("program: a\n{text}")).unwrap();
        Sweep::read(folder.path(), Path::new("sweep.yaml")).unwrap()
    }

    #[test]
    fn a_search_tries_no_more_settings_than_there_are_and_says_so() {
        let sweep = read("method: random\nparameters: { a: { values: [1, 2] }, b: { value: 3 } }\n");
        assert_eq!(sweep.settings, 2);
        assert!(sweep.notes[0].contains("the study tries 2"), "{:?}", sweep.notes);
        let sweep = read("method: random\nrun_cap: 9\nparameters: { a: { values: [1, 2] } }\n");
        assert_eq!(sweep.notes, ["the sweep asks for 9 settings, and there are 2"]);
        let sweep = read("method: random\nparameters: { a: { min: 0.5, max: 2.5 } }\n");
        assert_eq!(sweep.settings, SETTINGS);
    }

    #[test]
    fn seeds_of_a_sweep_are_bounded_and_noted() {
        let sweep = read(
            "method: random\nrun_cap: 4\nparameters: { seed: { min: 0, max: 100000 }, a: { min: 0.5, max: 1 } }\n",
        );
        assert_eq!(sweep.seeds, Some(MOST_SEEDS));
        assert!(
            sweep.notes.iter().any(|it| it.contains("become 10 seeds")),
            "{:?}",
            sweep.notes
        );
        let sweep = read("method: grid\nparameters: { seed: { value: 42 }, a: { values: [1, 2] } }\n");
        assert_eq!(sweep.seeds, None);
        assert_eq!(
            sweep.notes,
            ["`seed` is 42 in the sweep; seeds of the study count from 0"]
        );
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
