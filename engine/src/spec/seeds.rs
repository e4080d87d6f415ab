//! How many seeds a study has: a number, a list, or a design whose looks are fixed before the first trial.

use crate::{
    diagnostic::{Diagnostic, Sources},
    document::{Kind, Node},
    statistics::{spending::Design, statement::FEWEST_SEEDS},
};
use serde_json::{Value, json};

/// Largest number of seeds of a study.
pub(super) const MOST_SEEDS: u64 = 1_000_000;
/// Most seeds that a design may reach.
const MOST_IN_DESIGN: u64 = 1000;
/// Most looks of a design.
const MOST_LOOKS: u64 = 50;

/// The seeds of a study.
#[derive(Debug, Clone, PartialEq)]
pub struct SeedPlan {
    /// All seeds that it may use.
    pub seeds: Vec<u64>,
    /// The looks, where `run` adds seeds until all that is judged is decided.
    pub design: Option<Design>,
}

impl SeedPlan {
    /// Reads the section; one seed where it is absent.
    ///
    /// # Errors
    /// Looks that contradict each other or the limits.
    pub fn read(written: Option<&Node>, sources: &Sources) -> Result<Self, Vec<Diagnostic>> {
        let Some(node) = written else { return Ok(Self { seeds: vec![0], design: None }) };
        match (&node.kind, node.to_value()) {
            (Kind::Mapping(_), value) => {
                let looks = looks(&value).map_err(|(key, message, help)| {
                    let place = node.entry(key).map_or(node.span, |entry| entry.key_span);
                    vec![sources.error(place, &format!("seeds.{key}"), message).help(help)]
                })?;
                let most = looks.last().copied().unwrap_or(1);
                Ok(Self { seeds: (0..u64::from(most)).collect(), design: Some(Design::new(looks)) })
            }
            (_, Value::Array(list)) => Ok(Self { seeds: list.iter().filter_map(Value::as_u64).collect(), design: None }),
            (_, count) => Ok(Self { seeds: (0..count.as_u64().unwrap_or(1)).collect(), design: None }),
        }
    }

    /// Number of seeds that every combination has whatever the results are.
    #[must_use]
    pub fn certain(&self) -> usize {
        self.design.as_ref().map_or(self.seeds.len(), |design| design.looks()[0] as usize)
    }
}

/// What is wrong with a design: the key, the message, and what to write instead.
type Wrong = (&'static str, String, String);

fn looks(value: &Value) -> Result<Vec<u32>, Wrong> {
    let number = |key: &str| value.get(key).and_then(Value::as_u64);
    let (least, most) = (number("min").unwrap_or(0), number("max").unwrap_or(0));
    if least >= most {
        let message = format!("`min` is {least} and `max` is {most}, so there is nothing to add");
        return Err(("max", message, "write a larger `max`, or a plain number of seeds".into()));
    }
    let looks = match value.get("looks") {
        Some(Value::Array(list)) => list.iter().filter_map(Value::as_u64).collect(),
        Some(count) => evenly(least, most, count.as_u64().unwrap_or(2)),
        None => evenly(least, most, (most / least).clamp(2, MOST_LOOKS)),
    };
    if looks.windows(2).any(|pair| pair[0] >= pair[1]) {
        let message = format!("looks must rise, but these are {}", listed(&looks));
        return Err(("looks", message, format!("there are at most {} looks from {least} to {most}", most - least + 1)));
    }
    if looks.first() != Some(&least) || looks.last() != Some(&most) {
        let message = format!("the looks {} do not begin with `min`, {least}, and end with `max`, {most}", listed(&looks));
        return Err(("looks", message, "write the number of looks, as in `looks: 4`, to have them spread evenly".into()));
    }
    Ok(looks.into_iter().map(|look| u32::try_from(look).unwrap_or(u32::MAX)).collect())
}

fn listed(looks: &[u64]) -> String {
    looks.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")
}

/// So many looks from the least to the most seeds, at equal distances as far as whole numbers allow.
fn evenly(least: u64, most: u64, looks: u64) -> Vec<u64> {
    let steps = looks.max(2) - 1;
    (0..=steps).map(|step| least + (step * (most - least) + steps / 2) / steps).collect()
}

/// The schema of the section.
pub(super) fn schema() -> Value {
    let list = json!({ "type": "array", "minItems": 1, "maxItems": MOST_SEEDS, "uniqueItems": true, "items": { "type": "integer", "minimum": 0 } });
    let look = json!({ "type": "integer", "minimum": FEWEST_SEEDS, "maximum": MOST_IN_DESIGN });
    let design = json!({
        "type": "object", "additionalProperties": false, "required": ["min", "max"],
        "properties": {
            "min": { "description": "Seeds at the first look.", "type": "integer", "minimum": FEWEST_SEEDS, "maximum": MOST_IN_DESIGN },
            "max": { "description": "Seeds at the last look.", "type": "integer", "minimum": FEWEST_SEEDS, "maximum": MOST_IN_DESIGN },
            "looks": {
                "description": "Number of looks, spread evenly, or the numbers of seeds at each.",
                "anyOf": [
                    { "type": "integer", "minimum": 2, "maximum": MOST_LOOKS },
                    { "type": "array", "minItems": 2, "maxItems": MOST_LOOKS, "items": look },
                ],
            },
        },
    });
    json!({
        "description": "Number of replicates N (seeds 0 to N - 1), the seeds themselves, or a design `{ min, max, looks }`. With a design seeds are added look by look until every judged value and claim is decided.",
        "default": 1,
        "oneOf": [{ "type": "integer", "minimum": 1, "maximum": MOST_SEEDS }, list, design],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(value: Value) -> Result<Vec<u32>, String> {
        looks(&value).map_err(|(_, message, _)| message)
    }

    #[test]
    fn looks_are_spread_evenly_or_listed() {
        assert_eq!(read(json!({ "min": 5, "max": 30, "looks": 6 })).unwrap(), [5, 10, 15, 20, 25, 30]);
        assert_eq!(read(json!({ "min": 3, "max": 10, "looks": 3 })).unwrap(), [3, 7, 10]);
        assert_eq!(read(json!({ "min": 5, "max": 20 })).unwrap(), [5, 10, 15, 20]);
        assert_eq!(read(json!({ "min": 3, "max": 4 })).unwrap(), [3, 4]);
        assert_eq!(read(json!({ "min": 3, "max": 1000 })).unwrap().len(), 50, "as many as may be listed");
        assert_eq!(read(json!({ "min": 3, "max": 30, "looks": [3, 5, 8, 30] })).unwrap(), [3, 5, 8, 30]);
    }

    #[test]
    fn designs_that_contradict_themselves_are_refused() {
        assert!(read(json!({ "min": 5, "max": 5 })).unwrap_err().contains("nothing to add"));
        assert!(read(json!({ "min": 3, "max": 5, "looks": 9 })).unwrap_err().contains("must rise"));
        assert!(read(json!({ "min": 3, "max": 9, "looks": [3, 7, 5, 9] })).unwrap_err().contains("3, 7, 5, 9"));
        assert!(read(json!({ "min": 3, "max": 9, "looks": [4, 9] })).unwrap_err().contains("do not begin"));
    }
}
