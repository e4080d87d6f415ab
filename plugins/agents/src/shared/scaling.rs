//! Scaling of observations for a network: each channel is centred and divided by a typical deviation.

use contract::{Channel, Observation};
use numerics::policy_file::Ports;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Scaling of observations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ObservationScaling {
    /// `(x - center) / spread` with the typical value and deviation that the environment states for each
    /// channel.
    #[default]
    Typical,
    /// As observed, in SI units.
    None,
}

/// Center and spread of each channel of one seat's observation.
#[derive(Debug, Clone, PartialEq)]
pub struct Scaling {
    names: Vec<String>,
    center: Vec<f64>,
    spread: Vec<f64>,
}

impl Scaling {
    /// Builds the scaling of these channels.
    #[must_use]
    pub fn new(kind: ObservationScaling, channels: &[Channel]) -> Self {
        let names = channels.iter().map(|channel| channel.name.clone()).collect();
        let (center, spread) = match kind {
            ObservationScaling::Typical => channels
                .iter()
                .map(|channel| (channel.center, channel.spread))
                .unzip(),
            ObservationScaling::None => channels.iter().map(|_| (0.0, 1.0)).unzip(),
        };
        Self {
            names,
            center,
            spread,
        }
    }

    /// Replaces the values that are subtracted and those that divide.
    #[must_use]
    pub fn with(self, center: Vec<f64>, spread: Vec<f64>) -> Self {
        Self {
            center,
            spread,
            ..self
        }
    }

    /// Hides the channels at positions where `blind` holds: networks see 0 for them. Their spread becomes so
    /// large that nothing is left in single precision.
    pub fn flatten(&mut self, blind: impl Fn(usize) -> bool) {
        let flattened = self.spread.iter_mut().enumerate().filter(|(at, _)| blind(*at));
        flattened.for_each(|(_, spread)| *spread = f64::MAX);
    }

    /// Number of channels.
    #[must_use]
    pub fn n_channels(&self) -> usize {
        self.names.len()
    }

    /// Scaled observations of the only seat, row by row, with `n_channels` entries each.
    #[must_use]
    pub fn rows(&self, observations: &[Observation]) -> Vec<f32> {
        let seen = observations.iter().map(|observation| &observation.seats[0]);
        seen.flat_map(|seen| self.apply(seen)).collect()
    }

    /// Scaled observation as the input of a network.
    #[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
    pub fn apply<'a>(&'a self, observation: &'a [f64]) -> impl Iterator<Item = f32> + 'a {
        observation
            .iter()
            .zip(&self.center)
            .zip(&self.spread)
            .map(|((x, center), spread)| ((x - center) / spread) as f32)
    }

    /// Inputs and outputs of a policy as its file describes them.
    #[must_use]
    pub fn ports(&self, outputs: &[String]) -> Ports {
        let Self {
            names,
            center,
            spread,
        } = self.clone();
        Ports {
            inputs: names,
            center,
            spread,
            outputs: outputs.to_vec(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_volt_becomes_a_deviation() {
        let channels = [
            Channel::new("voltage_1", "V").typical(3.4, 0.2),
            Channel::new("power_demand_w", "W"),
        ];
        let scaled: Vec<f32> = Scaling::new(ObservationScaling::Typical, &channels)
            .apply(&[3.5, 2.0])
            .collect();
        assert!((scaled[0] - 0.5).abs() < 1e-6 && scaled[1] == 2.0);
        let raw: Vec<f32> = Scaling::new(ObservationScaling::None, &channels)
            .apply(&[3.5, 2.0])
            .collect();
        assert_eq!(raw, [3.5, 2.0]);
    }
}
