//! Architectures of the agent's networks: fully connected as in the thesis, or equivariant in the assets.
//!
//! | network | here | shape |
//! |---|---|---|
//! | policy | parameters of the shares | `[batch, observed]` to `[batch, n_shares]` |
//! | critic | value of an observation and an action | `[batch, observed]`, `[batch, n_shares]` to `[batch, 1]` |
//!
//! A network has the name under which files of networks hold it.

use super::asset_network::{AssetChannels, AssetCritic, AssetPolicy};
use super::{
    NAME,
    config::{Config, NetworkKind},
};
use crate::shared::checkpoint;
use contract::{Channel, Error};
use numerics::{
    activation::Activation,
    equations::{network::Network, state_file},
    policy_file::{self, Head, Policy, Ports},
    tensor_file::{TensorFile, TensorFileError},
};
use plan::{Equations, Expression, State};
use std::path::Path;

/// Sizes from which the networks of either architecture are described.
#[derive(Debug, Clone)]
pub(super) struct Shape {
    n_observed: usize,
    n_shares: usize,
    width: usize,
    policy_layers: usize,
    critic_layers: usize,
    /// Channels by asset; set for equivariant networks.
    assets: Option<AssetChannels>,
}

/// Policy network.
#[derive(Debug, Clone)]
pub(super) enum PolicyNetwork {
    /// Fully connected.
    Dense(Network),
    /// Equivariant in the assets.
    Assets(AssetPolicy),
}

/// Critic network.
#[derive(Debug, Clone)]
pub(super) enum CriticNetwork {
    /// Fully connected.
    Dense(Network),
    /// Invariant under permutations of the assets.
    Assets(AssetCritic),
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
            n_observed: channels.len(),
            n_shares,
            width: config.width,
            policy_layers: config.policy_layers,
            critic_layers: config.critic_layers,
            assets,
        })
    }

    /// Describes the policy. Its second hidden layer has tanh, the others leaky rectifiers (thesis, section
    /// 3.4.3).
    pub(super) fn policy(&self) -> PolicyNetwork {
        if let Some(assets) = &self.assets {
            return PolicyNetwork::Assets(AssetPolicy::new("policy.Assets", assets, self.width));
        }
        let mut activations = vec![Activation::LeakyRelu; self.policy_layers];
        if let Some(second) = activations.get_mut(1) {
            *second = Activation::Tanh;
        }
        let sizes = [
            &[self.n_observed][..],
            &vec![self.width; self.policy_layers],
            &[self.n_shares],
        ];
        PolicyNetwork::Dense(Network::new("policy.Dense", &sizes.concat(), &activations))
    }

    /// Describes both critics; `group` is the beginning of their names.
    pub(super) fn critics(&self, group: &str) -> [CriticNetwork; 2] {
        ["first", "second"].map(|which| {
            if let Some(assets) = &self.assets {
                let name = format!("{group}.Assets.{which}");
                return CriticNetwork::Assets(AssetCritic::new(&name, assets, self.width));
            }
            let inputs = self.n_observed + self.n_shares;
            let sizes = [&[inputs][..], &vec![self.width; self.critic_layers], &[1]].concat();
            let activations = vec![Activation::LeakyRelu; self.critic_layers];
            let name = format!("{group}.Dense.{which}");
            CriticNetwork::Dense(Network::new(name, &sizes, &activations))
        })
    }
}

impl PolicyNetwork {
    /// Fully connected networks that it is made of.
    pub(super) fn networks(&self) -> Vec<&Network> {
        match self {
            PolicyNetwork::Dense(network) => vec![network],
            PolicyNetwork::Assets(network) => network.networks().to_vec(),
        }
    }

    /// Parameters of the shares.
    pub(super) fn apply<'e>(&self, observations: Expression<'e>) -> Expression<'e> {
        match self {
            PolicyNetwork::Dense(network) => network.apply(observations),
            PolicyNetwork::Assets(network) => network.apply(observations),
        }
    }

    /// Writes a policy as `policy.safetensors` into `dir`.
    pub(super) fn write(
        &self,
        state: &State<f32>,
        ports: Ports,
        head: Head,
        dir: &Path,
    ) -> Result<(), TensorFileError> {
        match self {
            PolicyNetwork::Dense(network) => Policy::new(network, state, ports, head).write(dir),
            PolicyNetwork::Assets(network) => network.write(state, &ports, head, dir),
        }
    }

    /// Loads the parameters that [`write`](Self::write) wrote, if they act on these ports. An equivariant policy
    /// acts on any number of assets.
    ///
    /// # Errors
    /// Those of [`checkpoint::read_policy`], and [`Error::Checkpoint`] for a network of another shape.
    pub(super) fn import(
        &self,
        state: &mut State<f32>,
        ports: &Ports,
        head: Head,
        dir: &Path,
    ) -> Result<(), Error> {
        match self {
            PolicyNetwork::Dense(network) => {
                let file = checkpoint::read_policy(NAME, dir, ports, head)?;
                state_file::restore_network(network, policy_file::PREFIX, state, &file)
            }
            PolicyNetwork::Assets(network) => {
                let file = network.channels().policy_file(NAME, dir, ports, head)?;
                network.read(state, &file)
            }
        }
        .map_err(checkpoint::error_of(NAME))
    }
}

impl CriticNetwork {
    /// Fully connected networks that it is made of.
    pub(super) fn networks(&self) -> Vec<&Network> {
        match self {
            CriticNetwork::Dense(network) => vec![network],
            CriticNetwork::Assets(network) => network.networks().to_vec(),
        }
    }

    /// Values of observations and actions.
    pub(super) fn value<'e>(&self, observations: Expression<'e>, actions: Expression<'e>) -> Expression<'e> {
        match self {
            CriticNetwork::Dense(network) => {
                network.apply(observations.equations().join(&[observations, actions]))
            }
            CriticNetwork::Assets(network) => network.value(observations, actions),
        }
    }
}

/// Fully connected networks that both critics are made of.
pub(super) fn of_critics(critics: &[CriticNetwork; 2]) -> Vec<&Network> {
    critics.iter().flat_map(CriticNetwork::networks).collect()
}

/// Parameters of several networks, one after the other.
pub(super) fn parameters<'e>(networks: &[&Network], equations: &'e Equations) -> Vec<Expression<'e>> {
    let of_each = networks.iter().flat_map(|network| network.parameters(equations));
    of_each.collect()
}

/// Adds the first parameters of networks to a state.
pub(super) fn initialise(networks: &[&Network], state: &mut State<f32>, rng: &mut contract::Rng) {
    for network in networks {
        network.initialise(1.0, state, rng);
    }
}

/// Stores networks in a file, by their names.
pub(super) fn store(networks: &[&Network], state: &State<f32>, file: &mut TensorFile) {
    for network in networks {
        state_file::store_network(network, network.name(), state, file);
    }
}

/// Restores the networks that [`store`] wrote.
///
/// # Errors
/// [`TensorFileError`] where a parameter is missing or has another shape.
pub(super) fn restore(
    networks: &[&Network],
    state: &mut State<f32>,
    file: &TensorFile,
) -> Result<(), TensorFileError> {
    networks
        .iter()
        .try_for_each(|network| state_file::restore_network(network, network.name(), state, file))
}
