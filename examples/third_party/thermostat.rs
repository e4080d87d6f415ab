//! A room that loses heat, and a heater between 0 and 1.

use engine::{Channel, Config, End, Environment, Error, Registry, Rng, Seat, Space, Step};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// Temperature that the room shall have, in degrees Celsius.
const WANTED: f64 = 20.0;

/// Parameters; what stands above a field is what `describe` prints.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Thermostat {
    /// Decisions of an episode.
    #[schemars(range(min = 1))]
    decisions: u32,
    /// Temperature outside.
    #[schemars(range(min = -40.0, max = 20.0), extend("x-unit" = "degC"))]
    outside: f64,
}

impl Default for Thermostat {
    fn default() -> Self {
        Self {
            decisions: 12,
            outside: 5.0,
        }
    }
}

impl Config for Thermostat {}

pub fn register(registry: &mut Registry) {
    registry.environment("thermostat", 1, "a room with a heater", |config: Thermostat| {
        let seen = Space::Box(vec![Channel::new("temperature", "degC").typical(WANTED, 5.0)]);
        let heat = Space::Box(vec![Channel::new("heat", "").within(0.0, 1.0)]);
        let seats = vec![Seat {
            name: String::new(),
            observation: seen,
            action: heat,
        }];
        Ok(Box::new(Room {
            config,
            seats,
            temperature: WANTED,
            decisions: 0,
        }))
    });
}

struct Room {
    config: Thermostat,
    seats: Vec<Seat>,
    temperature: f64,
    decisions: u32,
}

impl Environment for Room {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn reset(&mut self, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        (self.temperature, self.decisions) = (rng.random_range(self.config.outside..WANTED + 5.0), 0);
        Ok(vec![vec![self.temperature]])
    }

    fn step(&mut self, actions: &[Vec<f64>], rng: &mut Rng) -> Result<Step, Error> {
        let heat = actions[0][0].clamp(0.0, 1.0);
        self.temperature +=
            0.1 * (self.config.outside - self.temperature) + 4.0 * heat + rng.random_range(-0.2..0.2);
        self.decisions += 1;
        let end = (self.decisions == self.config.decisions).then_some(End::Truncated);
        let off = self.temperature - WANTED;
        let reward = -off * off;
        Ok(Step::new(vec![vec![self.temperature]], vec![reward], end))
    }

    fn trace_channels(&self) -> Vec<Channel> {
        vec![Channel::new("temperature", "degC")]
    }

    fn trace(&self) -> Vec<f64> {
        vec![self.temperature]
    }

    fn snapshot(&self) -> Value {
        json!([self.temperature, self.decisions])
    }

    fn restore(&mut self, snapshot: &Value) -> Result<(), Error> {
        let misfit = |error: serde_json::Error| Error::Checkpoint {
            what: "thermostat",
            problem: error.to_string(),
        };
        (self.temperature, self.decisions) = <(f64, u32)>::deserialize(snapshot).map_err(misfit)?;
        Ok(())
    }
}
