//! The environment `named`: values that distinguish tasks, without a simulation.

use contract::{Channel, Environment, Error, Rng, Seat, Step};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::{borrow::Cow, collections::BTreeMap};

/// Settings of the `named` environment: the id of the task, and further values for the program.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct NamedConfig(BTreeMap<String, Value>);

impl contract::Config for NamedConfig {}

impl JsonSchema for NamedConfig {
    fn schema_name() -> Cow<'static, str> {
        "NamedConfig".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "type": "object",
            "properties": {
                "id": {
                    "type": "string",
                    "description": "The name of the task, as the program knows it: `{environment.id}` in its words.",
                },
            },
            "additionalProperties": {
                "description": "A value that belongs to the task: `{environment.KEY}` in the words of a program.",
            },
        })
    }
}

/// A task that only programs simulate.
#[derive(Debug)]
struct NamedTask;

/// Builds the environment; registered as `named`.
pub fn build(config: NamedConfig) -> Result<Box<dyn Environment>, Error> {
    match config.0.get("id").and_then(Value::as_str) {
        Some(id) if !id.is_empty() => Ok(Box::new(NamedTask)),
        _ => {
            let problem =
                "names no task: write the name by which the program knows it, as `{ id: CartPole-v1 }`";
            Err(Error::config("id", problem))
        }
    }
}

fn refusal() -> Error {
    Error::Mismatch {
        agent: "named",
        problem: "the environment is named alone: only a program can act in it".into(),
    }
}

impl Environment for NamedTask {
    fn seats(&self) -> &[Seat] {
        &[]
    }

    fn reset(&mut self, _: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        Err(refusal())
    }

    fn step(&mut self, _: &[Vec<f64>], _: &mut Rng) -> Result<Step, Error> {
        Err(refusal())
    }

    fn trace_channels(&self) -> Vec<Channel> {
        Vec::new()
    }

    fn trace(&self) -> Vec<f64> {
        Vec::new()
    }

    fn snapshot(&self) -> Value {
        Value::Null
    }

    fn restore(&mut self, _: &Value) -> Result<(), Error> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_task_has_an_id_and_any_other_values() {
        let built = |config: Value| build(serde_json::from_value(config).unwrap());
        assert!(built(json!({ "id": "CartPole-v1", "noise": 0.1, "deep": { "a": [1] } })).is_ok());
        for wrong in [json!({}), json!({ "id": "" }), json!({ "id": 3 })] {
            let told = built(wrong).err().unwrap().to_string();
            assert!(told.contains("`id`: names no task"), "{told}");
        }
    }

    #[test]
    fn nothing_can_act_in_it() {
        let mut named = build(serde_json::from_value(json!({ "id": "a" })).unwrap()).unwrap();
        assert!(named.interface().seats.is_empty());
        let mut rng = contract::random::stream(&["named"]);
        assert!(named.reset(&mut rng).is_err() && named.step(&[], &mut rng).is_err());
    }
}
