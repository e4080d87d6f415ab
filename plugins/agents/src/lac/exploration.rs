//! Noise on observations while the policy explores, so that it learns to act on noisy measurements. Stored
//! observations have none.

use super::config::Config;
use crate::shared::box_seat::BoxSeat;
use contract::{Error, Rng};
use numerics::gaussian::standard_normal;

/// Normal noise on some channels.
#[derive(Debug, Clone, PartialEq)]
pub struct Disturbance {
    sd: f64,
    n_observed: usize,
    channels: Vec<usize>,
}

impl Disturbance {
    /// Noise that a config asks for.
    ///
    /// # Errors
    /// [`Error::Config`] where it names channels that the seat does not observe.
    pub fn new(config: &Config, seat: &BoxSeat) -> Result<Self, Error> {
        let channels = seat
            .positions(&config.exploration_noise_channels)
            .map_err(|problem| Error::config("exploration_noise_channels", problem))?;
        Ok(Self {
            sd: config.exploration_observation_sd,
            n_observed: seat.n_observed(),
            channels,
        })
    }

    /// Adds new noise to scaled observations, row by row; draws no number where the deviation is 0.
    #[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
    pub fn add_to(&self, seen: &mut [f32], rng: &mut Rng) {
        if self.sd <= 0.0 {
            return;
        }
        for row in seen.chunks_mut(self.n_observed) {
            for at in &self.channels {
                row[*at] += (self.sd * standard_normal(rng)) as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::{regulator, scaling::ObservationScaling};
    use contract::random::stream;

    /// Variances of the noise on both channels.
    fn added(sd: f64, prefixes: &[&str]) -> Result<[f32; 2], Error> {
        let config = Config {
            exploration_observation_sd: sd,
            exploration_noise_channels: prefixes.iter().map(ToString::to_string).collect(),
            ..Config::default()
        };
        let seat = BoxSeat::new("lac", ObservationScaling::Typical, &regulator::interface())?;
        let mut seen = vec![0.0; 2 * 4_000];
        Disturbance::new(&config, &seat)?.add_to(&mut seen, &mut stream(&["noise"]));
        let square = |from: usize| seen.iter().skip(from).step_by(2).map(|x| x * x).sum::<f32>() / 4e3;
        Ok([square(0), square(1)])
    }

    #[test]
    fn noise_has_its_deviation_on_the_named_channels_alone() {
        let [x, nothing] = added(0.5, &["no"]).unwrap();
        assert!(x == 0.0 && (nothing - 0.25).abs() < 0.02, "{x} {nothing}");
        let [x, nothing] = added(0.5, &[]).unwrap();
        assert!(
            (x - 0.25).abs() < 0.02 && (nothing - 0.25).abs() < 0.02,
            "{x} {nothing}"
        );
        assert_eq!(added(0.0, &[]).unwrap(), [0.0, 0.0]);
    }

    #[test]
    fn channels_that_are_not_there_are_named() {
        let text = added(0.5, &["target_"]).unwrap_err().to_string();
        assert!(
            text.contains("`exploration_noise_channels`: no observed channel begins with `target_`")
                && text.contains("x, nothing"),
            "{text}"
        );
    }
}
