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

use crate::shared::{checkpoint, replay::Batch, seat};
use burn::{
    module::Module,
    tensor::{Device, Tensor},
};
use contract::{Channel, Error};
use numerics::{
    network::{Activation, Mlp, matrix, values},
    parameters::{restore, store},
    policy_file::{FILE_NAME, Head, Ports},
    tensor_file::{TensorFile, TensorFileError},
};
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

    /// Transitions with permuted assets: each has its own order, drawn uniformly, which applies to the
    /// observations before and after the step and to the shares.
    pub fn permuted(&self, batch: Batch, rng: &mut impl RngCore) -> Batch {
        let orders: Vec<Vec<usize>> = (0..batch.actions.dims()[0])
            .map(|_| {
                let mut order: Vec<usize> = (0..self.n_assets).collect();
                order.shuffle(rng);
                order
            })
            .collect();
        Batch {
            observations: reordered(&batch.observations, &self.blocks, &orders),
            actions: reordered(&batch.actions, &[0], &orders),
            next_observations: reordered(&batch.next_observations, &self.blocks, &orders),
            ..batch
        }
    }

    /// Own, mean and common features of each asset, with `more` as further own ones: `[batch * assets,
    /// features]`.
    fn features(&self, observations: &Tensor<2>, more: Option<Tensor<2>>) -> Tensor<2> {
        let batch = observations.dims()[0];
        let rows = batch * self.n_assets;
        let spread = |column: Tensor<2>| column.expand([batch, self.n_assets]).reshape([rows, 1]);
        let mut columns = Vec::new();
        for &first in &self.blocks {
            let block = observations
                .clone()
                .slice([0..batch, first..first + self.n_assets]);
            columns.push(spread(block.clone().mean_dim(1)));
            columns.push(block.reshape([rows, 1]));
        }
        for &channel in &self.common {
            columns.push(spread(
                observations.clone().slice([0..batch, channel..channel + 1]),
            ));
        }
        columns.extend(more.map(|block| block.reshape([rows, 1])));
        Tensor::cat(columns, 1)
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
    fn pool(&self, features: Tensor<2>) -> Tensor<2> {
        let [rows, width] = features.dims();
        features
            .reshape([rows / self.n_assets, self.n_assets, width])
            .mean_dim(1)
            .reshape([rows / self.n_assets, width])
    }

    /// Each asset's own features and the pooled ones side by side: `[batch * assets, 2 width]`.
    fn beside(&self, features: Tensor<2>) -> Tensor<2> {
        let [rows, width] = features.dims();
        let batch = rows / self.n_assets;
        let pooled =
            self.pool(features.clone())
                .reshape([batch, 1, width])
                .expand([batch, self.n_assets, width]);
        Tensor::cat(vec![features, pooled.reshape([rows, width])], 1)
    }
}

/// Rows in which each block of neighbouring columns, which begin at `blocks`, is permuted by the order of the
/// row.
fn reordered(rows: &Tensor<2>, blocks: &[usize], orders: &[Vec<usize>]) -> Tensor<2> {
    let length = rows.dims()[1];
    let mut moved = values(rows.clone());
    for (row, order) in moved.chunks_mut(length).zip(orders) {
        let before = row.to_vec();
        for first in blocks {
            for (to, from) in order.iter().enumerate() {
                row[first + to] = before[first + from];
            }
        }
    }
    matrix(moved, length)
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
#[derive(Module, Debug)]
pub struct AssetPolicy {
    encoder: Mlp,
    head: Mlp,
}

impl AssetPolicy {
    /// Creates a policy with one hidden layer of `width` in the encoder and one in the head. Between them
    /// `width` linear features are pooled.
    pub fn new(channels: &AssetChannels, width: usize, rng: &mut impl RngCore, device: &Device) -> Self {
        let (encoder, head) = ([channels.n_features(), width, width], [2 * width, width, 1]);
        Self {
            encoder: Mlp::new(&encoder, &[Activation::LeakyRelu], 1.0, rng, device),
            head: Mlp::new(&head, &[Activation::LeakyRelu], 1.0, rng, device),
        }
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
        channels: &AssetChannels,
        ports: &Ports,
        head: Head,
        dir: &Path,
    ) -> Result<(), TensorFileError> {
        let mut file = TensorFile::default();
        store(&self.encoder, "encoder", &mut file);
        store(&self.head, "head", &mut file);
        let Ports {
            inputs,
            center,
            spread,
            outputs,
        } = ports;
        file.header = json!({
            "format": 1, "architecture": "equivariant", "head": head, "n_assets": channels.n_assets,
            "blocks": channels.blocks,
            "common": channels.common, "inputs": inputs, "center": center, "spread": spread,
            "outputs": outputs,
        });
        file.write(&dir.join(FILE_NAME))
    }

    /// Loads the parameters that [`write`](Self::write) wrote.
    ///
    /// # Errors
    /// [`TensorFileError`] where a tensor is missing or has another shape.
    pub fn read(self, file: &TensorFile) -> Result<Self, TensorFileError> {
        Ok(Self {
            encoder: restore(self.encoder, "encoder", file)?,
            head: restore(self.head, "head", file)?,
        })
    }

    /// Parameters of the shares: `[batch, observed]` to `[batch, assets]`.
    #[must_use]
    pub fn forward(&self, channels: &AssetChannels, observations: &Tensor<2>) -> Tensor<2> {
        let own = self.encoder.forward(channels.features(observations, None));
        let batch = observations.dims()[0];
        self.head
            .forward(channels.beside(own))
            .reshape([batch, channels.n_assets])
    }
}

/// Critic network from an observation and an action to a value.
#[derive(Module, Debug)]
pub struct AssetCritic {
    encoder: Mlp,
    head: Mlp,
}

impl AssetCritic {
    /// Creates a critic with one hidden layer of `width` in the encoder and one in the head. Between them
    /// `width` linear features are pooled.
    pub fn new(channels: &AssetChannels, width: usize, rng: &mut impl RngCore, device: &Device) -> Self {
        let (encoder, head) = ([channels.n_features() + 1, width, width], [width, width, 1]);
        Self {
            encoder: Mlp::new(&encoder, &[Activation::LeakyRelu], 1.0, rng, device),
            head: Mlp::new(&head, &[Activation::LeakyRelu], 1.0, rng, device),
        }
    }

    /// Values: `[batch, observed]` and `[batch, assets]` to `[batch, 1]`.
    #[must_use]
    pub fn forward(
        &self,
        channels: &AssetChannels,
        observations: &Tensor<2>,
        action: Tensor<2>,
    ) -> Tensor<2> {
        let own = self
            .encoder
            .forward(channels.features(observations, Some(action)));
        self.head.forward(channels.pool(own))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::random::stream;
    use numerics::network::device;
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
    fn observations() -> Tensor<2> {
        matrix(
            vec![
                0.1, 0.5, -0.4, 1.0, -1.0, 0.3, 0.7, -0.4, 0.1, 0.5, 0.3, 1.0, -1.0, 0.7,
            ],
            7,
        )
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
        let policy = AssetPolicy::new(&channels(), 8, &mut stream(&["policy"]), &device());
        let out = values(policy.forward(&channels(), &observations()));
        assert!(
            close(out[3], out[2]) && close(out[4], out[0]) && close(out[5], out[1]),
            "{out:?}"
        );
        assert!(!close(out[0], out[1]), "{out:?}");
    }

    #[test]
    fn the_value_does_not_depend_on_the_order_of_the_assets() {
        let critic = AssetCritic::new(&channels(), 8, &mut stream(&["critic"]), &device());
        let action = matrix(vec![0.2, 0.3, 0.5, 0.5, 0.2, 0.3], N);
        let out = values(critic.forward(&channels(), &observations(), action));
        assert!(close(out[0], out[1]), "{out:?}");
        let moved = matrix(vec![0.3, 0.2, 0.5, 0.5, 0.3, 0.2], N);
        assert!(!close(
            values(critic.forward(&channels(), &observations(), moved))[0],
            out[0]
        ));
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
        let many = |values: Vec<f32>| matrix(values.repeat(copies), values.len());
        let batch = Batch {
            observations: many(row([1, 2, 3], 0.0)),
            actions: many(vec![1.0, 2.0, 3.0]),
            rewards: many(vec![0.5]),
            next_observations: many(row([1, 2, 3], 100.0)),
            continues: many(vec![1.0]),
        };
        let permuted = channels().permuted(batch, &mut stream(&["permuted"]));
        let (seen, next) = (values(permuted.observations), values(permuted.next_observations));
        let mut orders = BTreeSet::new();
        for (at, shares) in values(permuted.actions).chunks(N).enumerate() {
            let order = [0, 1, 2].map(|place| shares[place] as usize);
            assert_eq!(&seen[7 * at..7 * (at + 1)], row(order, 0.0));
            assert_eq!(next[7 * at..7 * at + 6], row(order, 100.0)[..6]);
            orders.insert(order);
        }
        assert_eq!(orders.len(), 6, "all orders of three occur in {copies} draws");
        assert_eq!(values(permuted.rewards), vec![0.5; copies]);
    }
}
