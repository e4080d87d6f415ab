//! Networks that treat assets alike: a permutation of the assets permutes the shares of the policy and leaves
//! the value of the critic unchanged.
//!
//! Zaheer et al. 2017, "Deep sets", arXiv:1703.06114. One small encoder, the same for every asset, reads the
//! asset's own channels, their means over all assets and the common channels. Its outputs are pooled over the
//! assets, and a second network reads own and pooled features. Experience with one asset thus trains the
//! networks for all assets, which matters more the more assets there are.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | x_i | own channels of asset i, their means, common channels | `[batch * assets, features]` |
//! | h_i | `encoder(x_i)` | `[batch * assets, width]` |
//! | h | mean of h_i over the assets | `[batch, width]` |
//! | policy | `head(h_i, h)` | `[batch, assets]` |
//! | critic | `head(h)`, where x_i also holds the share of asset i | `[batch, 1]` |

use crate::shared::{batch::Batch, checkpoint, seat};
use contract::{Channel, Error};
use numerics::{
    activation::Activation,
    equations::{
        network::Network,
        state_file::{restore_network, store_network},
    },
    policy_file::{FILE_NAME, Head, Ports},
    tensor_file::{TensorFile, TensorFileError},
};
use plan::{Expression, State};
use rand::{RngCore, seq::SliceRandom};
use serde_json::json;
use std::path::Path;

/// Channels of an observation by asset.
#[derive(Debug, Clone, PartialEq)]
pub struct AssetChannels {
    n_assets: usize,
    /// First channel of each block of `n_assets` neighbouring channels, one channel per asset.
    blocks: Vec<usize>,
    /// Channels of no asset.
    common: Vec<usize>,
}

impl AssetChannels {
    /// Finds blocks of channels `<word>_1` to `<word>_N`, which the setting `wish` requires.
    ///
    /// # Errors
    /// [`Error::Mismatch`] where the observation has no such block.
    pub fn find(
        agent: &'static str,
        wish: &str,
        channels: &[Channel],
        n_assets: usize,
    ) -> Result<Self, Error> {
        let (mut blocks, mut common, mut index) = (Vec::new(), Vec::new(), 0);
        while index < channels.len() {
            if begins_block(&channels[index..], n_assets) {
                blocks.push(index);
                index += n_assets;
            } else {
                common.push(index);
                index += 1;
            }
        }
        if blocks.is_empty() {
            let problem =
                format!("`{wish}` needs channels that are numbered from 1 to {n_assets}, one per share");
            return Err(seat::mismatch(agent, problem));
        }
        Ok(Self {
            n_assets,
            blocks,
            common,
        })
    }

    /// Permutes the assets of transitions: each has its own order, drawn uniformly, which applies to the
    /// observations before and after the step and to the shares.
    pub fn permute(&self, batch: &mut Batch, rng: &mut impl RngCore) {
        let orders: Vec<Vec<usize>> = (0..batch.n_rows)
            .map(|_| {
                let mut order: Vec<usize> = (0..self.n_assets).collect();
                order.shuffle(rng);
                order
            })
            .collect();
        reorder(&mut batch.observations, &self.blocks, &orders);
        reorder(&mut batch.actions, &[0], &orders);
        reorder(&mut batch.next_observations, &self.blocks, &orders);
    }

    /// Own, mean and common features of each asset, with `more` as further own ones: `[batch * assets,
    /// features]`.
    fn features<'e>(&self, observations: Expression<'e>, more: Option<Expression<'e>>) -> Expression<'e> {
        let n_rows = observations.n_rows() * self.n_assets;
        let mut columns = Vec::new();
        for first in &self.blocks {
            let block = observations.columns(*first..first + self.n_assets);
            columns.push(block.mean_columns().repeat_rows(self.n_assets));
            columns.push(block.reshape([n_rows, 1]));
        }
        for channel in &self.common {
            let common = observations.columns(*channel..channel + 1);
            columns.push(common.repeat_rows(self.n_assets));
        }
        columns.extend(more.map(|block| block.reshape([n_rows, 1])));
        observations.equations().join(&columns)
    }

    /// Reads a policy file, if its network acts on these channels: on as many assets, or on another number of
    /// assets with the same words for the blocks of channels and the same common channels. Typical values of
    /// the channels are then those of these assets.
    ///
    /// # Errors
    /// Those of [`checkpoint::read_policy`].
    pub fn policy_file(
        &self,
        agent: &'static str,
        dir: &Path,
        ports: &Ports,
        head: Head,
    ) -> Result<TensorFile, Error> {
        let file = TensorFile::read(&dir.join(FILE_NAME)).map_err(checkpoint::error_of(agent))?;
        if file.header["n_assets"] == json!(self.n_assets) {
            return checkpoint::read_policy(agent, dir, ports, head);
        }
        let inputs: Vec<String> = serde_json::from_value(file.header["inputs"].clone()).unwrap_or_default();
        let places = |key: &str| serde_json::from_value(file.header[key].clone()).unwrap_or_default();
        let theirs = Self {
            n_assets: 0,
            blocks: places("blocks"),
            common: places("common"),
        }
        .words(&inputs);
        let ours = self.words(&ports.inputs);
        if theirs == ours && file.header["head"] == json!(head) {
            return Ok(file);
        }
        let problem = format!(
            "the policy reads {} for each asset, here there are {}",
            theirs.join(", "),
            ours.join(", ")
        );
        Err(Error::Checkpoint { what: agent, problem })
    }

    /// Words of the channels of an asset and of the common channels, without the numbers of the assets.
    fn words(&self, inputs: &[String]) -> Vec<String> {
        let name = |place: &usize| inputs.get(*place).map_or("", String::as_str);
        let of_assets = self
            .blocks
            .iter()
            .map(|first| name(first).trim_end_matches("_1").to_owned());
        of_assets
            .chain(self.common.iter().map(|place| format!("{} of none", name(place))))
            .collect()
    }

    fn n_features(&self) -> usize {
        2 * self.blocks.len() + self.common.len()
    }

    /// Mean over the assets: `[batch * assets, width]` to `[batch, width]`.
    #[allow(clippy::cast_precision_loss, reason = "a number of assets is far below 2^52")]
    fn pool<'e>(&self, features: Expression<'e>) -> Expression<'e> {
        features.sum_groups(self.n_assets) / self.n_assets as f64
    }

    /// Each asset's own features and the pooled ones side by side: `[batch * assets, 2 width]`.
    fn beside<'e>(&self, features: Expression<'e>) -> Expression<'e> {
        let pooled = self.pool(features).repeat_rows(self.n_assets);
        features.equations().join(&[features, pooled])
    }
}

/// Permutes each block of neighbouring columns, which begin at `blocks`, by the order of the row.
fn reorder(rows: &mut [f32], blocks: &[usize], orders: &[Vec<usize>]) {
    let length = rows.len() / orders.len();
    for (row, order) in rows.chunks_mut(length).zip(orders) {
        let before = row.to_vec();
        for first in blocks {
            for (to, from) in order.iter().enumerate() {
                row[first + to] = before[first + from];
            }
        }
    }
}

fn begins_block(channels: &[Channel], n_assets: usize) -> bool {
    let word = |channel: &Channel| channel.name.rsplit_once('_').map(|(word, _)| word.to_owned());
    let Some(first) = channels.first().and_then(word) else {
        return false;
    };
    let fits = |(index, channel): (usize, &Channel)| channel.name == format!("{first}_{}", index + 1);
    channels.len() >= n_assets && channels.iter().take(n_assets).enumerate().all(fits)
}

/// Policy network from an observation to the parameters of the shares.
#[derive(Debug, Clone)]
pub struct AssetPolicy {
    channels: AssetChannels,
    encoder: Network,
    head: Network,
}

impl AssetPolicy {
    /// Describes a policy with one hidden layer of `width` in the encoder and one in the head. Between them
    /// `width` linear features are pooled.
    #[must_use]
    pub fn new(name: &str, channels: &AssetChannels, width: usize) -> Self {
        let (encoder, head) = ([channels.n_features(), width, width], [2 * width, width, 1]);
        Self {
            encoder: two_layers(format!("{name}.encoder"), encoder),
            head: two_layers(format!("{name}.head"), head),
            channels: channels.clone(),
        }
    }

    /// Fully connected networks that it is made of.
    #[must_use]
    pub fn networks(&self) -> [&Network; 2] {
        [&self.encoder, &self.head]
    }

    /// Channels that it reads.
    #[must_use]
    pub fn channels(&self) -> &AssetChannels {
        &self.channels
    }

    /// Writes the policy for other programs: the tensors `encoder.*` and `head.*` of the two networks, each
    /// `x W + b` with a leaky rectifier (0.01) between its two layers, and a JSON header.
    ///
    /// The header's `blocks` are the first channels of the blocks, `common` the channels of no asset.
    /// Features of asset i: for each block its mean and its i-th channel, then the common channels. The head
    /// reads the encoder's output of the asset and its mean over the assets.
    ///
    /// # Errors
    /// [`TensorFileError::File`] where the system refuses.
    pub fn write(
        &self,
        state: &State<f32>,
        ports: &Ports,
        head: Head,
        dir: &Path,
    ) -> Result<(), TensorFileError> {
        let mut file = TensorFile::default();
        store_network(&self.encoder, "encoder", state, &mut file);
        store_network(&self.head, "head", state, &mut file);
        let Ports {
            inputs,
            center,
            spread,
            outputs,
        } = ports;
        let AssetChannels {
            n_assets,
            blocks,
            common,
        } = &self.channels;
        file.header = json!({
            "format": 1, "architecture": "equivariant", "head": head, "n_assets": n_assets, "blocks": blocks,
            "common": common, "inputs": inputs, "center": center, "spread": spread, "outputs": outputs,
        });
        file.write(&dir.join(FILE_NAME))
    }

    /// Loads the parameters that [`write`](Self::write) wrote.
    ///
    /// # Errors
    /// [`TensorFileError`] where a tensor is missing or has another shape.
    pub fn read(&self, state: &mut State<f32>, file: &TensorFile) -> Result<(), TensorFileError> {
        restore_network(&self.encoder, "encoder", state, file)?;
        restore_network(&self.head, "head", state, file)
    }

    /// Parameters of the shares: `[batch, observed]` to `[batch, assets]`.
    #[must_use]
    pub fn apply<'e>(&self, observations: Expression<'e>) -> Expression<'e> {
        let own = self.encoder.apply(self.channels.features(observations, None));
        let shares = self.head.apply(self.channels.beside(own));
        shares.reshape([observations.n_rows(), self.channels.n_assets])
    }
}

/// Critic network from an observation and an action to a value.
#[derive(Debug, Clone)]
pub struct AssetCritic {
    channels: AssetChannels,
    encoder: Network,
    head: Network,
}

impl AssetCritic {
    /// Describes a critic with one hidden layer of `width` in the encoder and one in the head. Between them
    /// `width` linear features are pooled.
    #[must_use]
    pub fn new(name: &str, channels: &AssetChannels, width: usize) -> Self {
        let (encoder, head) = ([channels.n_features() + 1, width, width], [width, width, 1]);
        Self {
            encoder: two_layers(format!("{name}.encoder"), encoder),
            head: two_layers(format!("{name}.head"), head),
            channels: channels.clone(),
        }
    }

    /// Fully connected networks that it is made of.
    #[must_use]
    pub fn networks(&self) -> [&Network; 2] {
        [&self.encoder, &self.head]
    }

    /// Values: `[batch, observed]` and `[batch, assets]` to `[batch, 1]`.
    #[must_use]
    pub fn value<'e>(&self, observations: Expression<'e>, actions: Expression<'e>) -> Expression<'e> {
        let features = self.channels.features(observations, Some(actions));
        self.head.apply(self.channels.pool(self.encoder.apply(features)))
    }
}

/// A network with one hidden layer.
fn two_layers(name: String, sizes: [usize; 3]) -> Network {
    Network::new(name, &sizes, &[Activation::LeakyRelu])
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::random::stream;
    use plan::{Equations, Processor};
    use std::collections::BTreeSet;

    const N: usize = 3;

    fn channels() -> AssetChannels {
        let names = [
            "voltage_1",
            "voltage_2",
            "voltage_3",
            "current_1",
            "current_2",
            "current_3",
            "power_demand_w",
        ];
        let channels: Vec<Channel> = names.into_iter().map(|name| Channel::new(name, "")).collect();
        AssetChannels::find("test", "it", &channels, N).unwrap()
    }

    /// Two observations of one pack; the second has its assets in the order 3, 1, 2.
    const SEEN: [f64; 14] = [
        0.1, 0.5, -0.4, 1.0, -1.0, 0.3, 0.7, -0.4, 0.1, 0.5, 0.3, 1.0, -1.0, 0.7,
    ];

    /// Outputs of new networks for both observations and two actions.
    fn outputs(
        networks: [&Network; 2],
        actions: [f64; 6],
        of: impl for<'e> Fn(Expression<'e>, Expression<'e>) -> Expression<'e>,
    ) -> Vec<f32> {
        let (mut state, mut rng) = (State::default(), stream(&["networks"]));
        for network in networks {
            network.initialise(1.0, &mut state, &mut rng);
        }
        let equations = Equations::new();
        let (seen, done) = (
            equations.constant([2, 7], &SEEN),
            equations.constant([2, N], &actions),
        );
        equations.routine("apply");
        equations.output("out", of(seen, done));
        let mut processor = Processor::new(equations.into_graph());
        processor.run("apply", &mut state);
        processor.entries("out").to_vec()
    }

    fn close(left: f32, right: f32) -> bool {
        (left - right).abs() < 1e-5
    }

    #[test]
    fn blocks_and_common_channels_are_told_apart() {
        assert_eq!(
            channels(),
            AssetChannels {
                n_assets: N,
                blocks: vec![0, 3],
                common: vec![6]
            }
        );
        let unnumbered = [Channel::new("constant", "")];
        assert!(matches!(
            AssetChannels::find("test", "it", &unnumbered, N),
            Err(Error::Mismatch { .. })
        ));
    }

    #[test]
    fn permuted_assets_get_permuted_shares() {
        let policy = AssetPolicy::new("policy", &channels(), 8);
        let out = outputs(policy.networks(), [0.0; 6], |seen, _| policy.apply(seen));
        assert!(
            close(out[3], out[2]) && close(out[4], out[0]) && close(out[5], out[1]),
            "{out:?}"
        );
        assert!(!close(out[0], out[1]), "{out:?}");
    }

    #[test]
    fn the_value_does_not_depend_on_the_order_of_the_assets() {
        let critic = AssetCritic::new("critic", &channels(), 8);
        let values = |actions| outputs(critic.networks(), actions, |seen, done| critic.value(seen, done));
        let out = values([0.2, 0.3, 0.5, 0.5, 0.2, 0.3]);
        assert!(close(out[0], out[1]), "{out:?}");
        let moved = values([0.3, 0.2, 0.5, 0.5, 0.3, 0.2]);
        assert!(!close(moved[0], out[0]));
    }

    #[test]
    fn assets_of_a_transition_are_permuted_together() {
        // Entry 10 a + b of an observation is channel b of asset a, and 7 is common; the shares follow the
        // same order of assets.
        let row = |order: [usize; 3], next: f32| -> Vec<f32> {
            let block = |channel: usize| order.map(|asset| next + (10 * asset + channel) as f32);
            [&block(0)[..], &block(1)[..], &[7.0]].concat()
        };
        let copies = 200;
        let mut batch = Batch {
            n_rows: copies,
            observations: row([1, 2, 3], 0.0).repeat(copies),
            actions: [1.0, 2.0, 3.0].repeat(copies),
            rewards: vec![0.5; copies],
            next_observations: row([1, 2, 3], 100.0).repeat(copies),
            continues: vec![1.0; copies],
        };
        channels().permute(&mut batch, &mut stream(&["permuted"]));
        let (seen, next) = (batch.observations, batch.next_observations);
        let mut orders = BTreeSet::new();
        for (at, shares) in batch.actions.chunks(N).enumerate() {
            let order = [0, 1, 2].map(|place| shares[place] as usize);
            assert_eq!(&seen[7 * at..7 * (at + 1)], row(order, 0.0));
            assert_eq!(next[7 * at..7 * at + 6], row(order, 100.0)[..6]);
            orders.insert(order);
        }
        assert_eq!(orders.len(), 6, "all orders of three occur in {copies} draws");
        assert_eq!(batch.rewards, vec![0.5; copies]);
    }
}
