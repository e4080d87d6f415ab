//! Architectures of the agent's networks: fully connected as in the thesis, or equivariant in the assets.

use super::asset_network::{AssetChannels, AssetCritic, AssetPolicy};
use super::{
    NAME,
    config::{Config, NetworkKind},
};
use crate::shared::checkpoint;
use burn::{
    module::Module,
    tensor::{Device, Tensor},
};
use contract::{Channel, Error};
use numerics::{
    network::{Activation, Mlp, TwinMlp},
    parameters::restore,
    policy_file::{Head, PREFIX, Policy, Ports},
    tensor_file::{TensorFile, TensorFileError},
};
use rand::RngCore;
use std::path::Path;

/// Sizes from which the networks of either architecture are built.
#[derive(Debug, Clone)]
pub(super) struct Shape {
    sizes: (usize, usize),
    width: usize,
    layers: (usize, usize),
    /// Channels by asset; set for equivariant networks.
    assets: Option<AssetChannels>,
}

/// Policy network from observations `[batch, observed]` to parameters of the shares `[batch, n_shares]`.
#[derive(Module, Debug)]
pub(super) enum PolicyNetwork {
    /// Fully connected.
    Dense(Mlp),
    /// Equivariant in the assets.
    Assets(AssetPolicy),
}

/// Both critics.
#[derive(Module, Debug)]
pub(super) enum Critics {
    /// Fully connected.
    Dense(TwinMlp),
    /// Invariant under permutations of the assets.
    Assets(AssetCritics),
}

/// Two critics that are invariant under permutations of the assets.
#[derive(Module, Debug)]
pub(super) struct AssetCritics {
    first: AssetCritic,
    second: AssetCritic,
}

impl Default for PolicyNetwork {
    fn default() -> Self {
        Self::Dense(Mlp::default())
    }
}

impl Default for Critics {
    fn default() -> Self {
        Self::Dense(TwinMlp::default())
    }
}

impl Shape {
    /// Sizes that a config asks for.
    ///
    /// # Errors
    /// [`Error::Mismatch`] where the observation does not tell assets apart.
    pub(super) fn new(config: &Config, channels: &[Channel], n_shares: usize) -> Result<Self, Error> {
        let assets = match config.network {
            NetworkKind::Dense => None,
            NetworkKind::Equivariant => Some(AssetChannels::find(
                NAME,
                "network: equivariant",
                channels,
                n_shares,
            )?),
        };
        Ok(Self {
            sizes: (channels.len(), n_shares),
            width: config.width,
            layers: (config.policy_layers, config.critic_layers),
            assets,
        })
    }

    /// Creates a policy. Its second hidden layer has tanh, the others leaky rectifiers (thesis, section
    /// 3.4.3).
    pub(super) fn policy(&self, rng: &mut impl RngCore, device: &Device) -> PolicyNetwork {
        if let Some(assets) = &self.assets {
            return PolicyNetwork::Assets(AssetPolicy::new(assets, self.width, rng, device));
        }
        let activation = |layer| {
            if layer == 1 {
                Activation::Tanh
            } else {
                Activation::LeakyRelu
            }
        };
        let activations: Vec<_> = (0..self.layers.0).map(activation).collect();
        PolicyNetwork::Dense(Mlp::new(
            &self.dense(self.sizes.0, self.layers.0, self.sizes.1),
            &activations,
            1.0,
            rng,
            device,
        ))
    }

    /// Creates both critics.
    pub(super) fn critics(&self, rng: &mut impl RngCore, device: &Device) -> Critics {
        if let Some(assets) = &self.assets {
            let mut critic = || AssetCritic::new(assets, self.width, rng, device);
            return Critics::Assets(AssetCritics {
                first: critic(),
                second: critic(),
            });
        }
        let sizes = self.dense(self.sizes.0 + self.sizes.1, self.layers.1, 1);
        Critics::Dense(TwinMlp::new(
            &sizes,
            &vec![Activation::LeakyRelu; self.layers.1],
            1.0,
            rng,
            device,
        ))
    }

    fn dense(&self, inputs: usize, layers: usize, outputs: usize) -> Vec<usize> {
        [vec![inputs], vec![self.width; layers], vec![outputs]].concat()
    }

    /// Outputs of a policy, `[batch, n_shares]`.
    pub(super) fn shares(&self, policy: &PolicyNetwork, observations: &Tensor<2>) -> Tensor<2> {
        match (policy, &self.assets) {
            (PolicyNetwork::Dense(network), _) => network.forward(observations.clone()),
            (PolicyNetwork::Assets(network), Some(assets)) => network.forward(assets, observations),
            (PolicyNetwork::Assets(_), None) => {
                unreachable!("the shape that made this network knows its assets")
            }
        }
    }

    /// Writes a policy as `policy.safetensors` into `dir`.
    pub(super) fn write(
        &self,
        policy: &PolicyNetwork,
        ports: Ports,
        head: Head,
        dir: &Path,
    ) -> Result<(), TensorFileError> {
        match (policy, &self.assets) {
            (PolicyNetwork::Dense(network), _) => Policy::new(network, ports, head).write(dir),
            (PolicyNetwork::Assets(network), Some(assets)) => network.write(assets, &ports, head, dir),
            (PolicyNetwork::Assets(_), None) => {
                unreachable!("the shape that made this network knows its assets")
            }
        }
    }

    /// Reads a policy file, if its network acts on these ports. An equivariant policy acts on any number of
    /// assets.
    ///
    /// # Errors
    /// Those of [`checkpoint::read_policy`].
    pub(super) fn policy_file(&self, dir: &Path, ports: &Ports, head: Head) -> Result<TensorFile, Error> {
        match &self.assets {
            Some(assets) => assets.policy_file(NAME, dir, ports, head),
            None => checkpoint::read_policy(NAME, dir, ports, head),
        }
    }

    /// Loads the parameters that [`write`](Self::write) wrote into a policy.
    pub(super) fn read(policy: PolicyNetwork, file: &TensorFile) -> Result<PolicyNetwork, TensorFileError> {
        Ok(match policy {
            PolicyNetwork::Dense(network) => PolicyNetwork::Dense(restore(network, PREFIX, file)?),
            PolicyNetwork::Assets(network) => PolicyNetwork::Assets(network.read(file)?),
        })
    }

    /// Values of both critics, `[batch, 1]` each.
    pub(super) fn values(
        &self,
        critics: &Critics,
        observations: &Tensor<2>,
        action: Tensor<2>,
    ) -> (Tensor<2>, Tensor<2>) {
        match (critics, &self.assets) {
            (Critics::Dense(pair), _) => pair.forward(Tensor::cat(vec![observations.clone(), action], 1)),
            (Critics::Assets(pair), Some(assets)) => (
                pair.first.forward(assets, observations, action.clone()),
                pair.second.forward(assets, observations, action),
            ),
            (Critics::Assets(_), None) => unreachable!("the shape that made these critics knows its assets"),
        }
    }
}
