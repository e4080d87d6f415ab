//! Fully connected networks for the seats of a game, with equal hidden layers.

use contract::Error;
use numerics::activation::Activation;
use numerics::equations::network::Network;

/// Size and activation of the hidden layers of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HiddenLayers {
    /// Number of units of each layer.
    pub width: usize,
    /// Number of layers.
    pub layers: usize,
    /// Activation after each layer.
    pub activation: Activation,
}

impl HiddenLayers {
    /// Describes a network from `inputs` to `outputs`.
    #[must_use]
    pub fn network(self, name: impl Into<String>, inputs: usize, outputs: usize) -> Network {
        let sizes = [vec![inputs], vec![self.width; self.layers], vec![outputs]].concat();
        Network::new(name, &sizes, &vec![self.activation; self.layers])
    }
}

/// Refuses a batch that can never be drawn without replacement.
///
/// # Errors
/// [`Error::Config`] where the batch is larger than the buffer.
pub fn check_batch(batch_size: usize, replay_capacity: usize) -> Result<(), Error> {
    if batch_size <= replay_capacity {
        return Ok(());
    }
    let problem = format!(
        "{batch_size} transitions are drawn without replacement from a buffer of {replay_capacity}; \
         lower it or raise `replay_capacity`"
    );
    Err(Error::Config {
        key: "batch_size".into(),
        problem,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_hidden_layers_are_alike() {
        let hidden = HiddenLayers {
            width: 7,
            layers: 3,
            activation: Activation::Tanh,
        };
        let network = hidden.network("some", 2, 5);
        assert_eq!(
            (network.sizes(), network.activations()),
            ([2, 7, 7, 7, 5].as_slice(), [Activation::Tanh; 3].as_slice())
        );
    }

    #[test]
    fn a_batch_fits_the_buffer() {
        assert!(check_batch(8, 8).is_ok());
        let text = check_batch(9, 8).unwrap_err().to_string();
        assert!(
            text.contains("`batch_size`: 9 transitions") && text.contains("`replay_capacity`"),
            "{text}"
        );
    }
}
