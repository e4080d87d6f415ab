//! The network by which scores describe an image: features, and the logits of its classes.
//!
//! | layer | output |
//! |---|---|
//! | convolution 3x3, rectifier, mean of 2x2 | `[batch, size / 2, size / 2, c]` |
//! | convolution 3x3, rectifier, mean of 2x2 | `[batch, size / 4, size / 4, 2 c]` |
//! | convolution 3x3, rectifier | `[batch, size / 4, size / 4, 4 c]` |
//! | mean over all pixels: the *features* | `[batch, 4 c]` |
//! | affine map: the *logits* of the classes | `[batch, classes]` |
//!
//! Weights start after He et al. 2015 in the uniform form, biases at 0. Inception score and Frechet distance are
//! relative to the network that they are computed with.

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor, TensorData};
use numerics::dense::dense;
use numerics::image::convolution::convolve_3x3;
use numerics::image::pointwise::relu;
use numerics::image::resize::{average_pool, resize_bilinear};
use numerics::network::device;
use numerics::parameters::{restore, store};
use numerics::policy_file::FILE_NAME;
use numerics::tensor_file::{TensorFile, TensorFileError};
use rand::{Rng, RngCore};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::Path;

/// The kind in the file's header, by which it differs from the policies of other agents.
const KIND: &str = "image_classifier";
const PREFIX: &str = "network";

/// Sizes of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct NetworkSizes {
    /// Height and width of the images that the network was made for, pixels, a multiple of 4.
    pub size: usize,
    /// Channels `c` of the first layer.
    pub channels: usize,
    /// Number of classes.
    pub classes: usize,
}

/// Largest height and width that a stored network may name; images are interpolated to it.
const LARGEST: usize = 1024;

impl NetworkSizes {
    /// Compares the sizes in a file with its tensors, before any network is made of these sizes.
    fn fits(self, file: &TensorFile) -> Result<(), TensorFileError> {
        let last = &file.get(&format!("{PREFIX}.last.0"))?.shape;
        let is_of = |shape: &[usize]| match (shape, self.channels.checked_mul(4)) {
            (&[features, classes], Some(expected)) => features == expected && classes == self.classes,
            _ => false,
        };
        let first = &file.get(&format!("{PREFIX}.layers.0.weight"))?.shape;
        let is_sized = (4..=LARGEST).contains(&self.size) && self.size.is_multiple_of(4);
        if is_sized
            && self.channels > 0
            && self.classes > 0
            && is_of(last)
            && first.last() == Some(&self.channels)
        {
            return Ok(());
        }
        Err(TensorFileError::Shape {
            expected: format!("layers of {self:?}"),
            found: format!("a first one of {first:?} and a last one of {last:?}"),
        })
    }
}

/// A convolution with its bias.
#[derive(Module, Debug)]
struct Convolution {
    weight: Param<Tensor<4>>,
    bias: Param<Tensor<1>>,
}

/// The feature network; the default one is empty and only takes the place of another.
#[derive(Module, Debug, Default)]
pub struct FeatureNetwork {
    layers: Vec<Convolution>,
    last: Vec<Param<Tensor<2>>>,
    last_bias: Vec<Param<Tensor<1>>>,
}

/// Features and logits of a batch of images.
#[derive(Debug)]
pub struct ImageFeatures {
    /// `[batch, 4 c]`.
    pub features: Tensor<2>,
    /// `[batch, classes]`.
    pub logits: Tensor<2>,
}

impl FeatureNetwork {
    /// A network with random weights, tracked for gradients.
    pub fn new(form: NetworkSizes, rng: &mut impl RngCore) -> Self {
        let device = device().autodiff();
        let NetworkSizes {
            channels, classes, ..
        } = form;
        let widths = [crate::images::CHANNELS, channels, 2 * channels, 4 * channels];
        let layers = widths
            .windows(2)
            .map(|pair| Convolution {
                weight: uniform([3, 3, pair[0], pair[1]], 9 * pair[0], 2.0, rng, &device),
                bias: zeros(pair[1], &device),
            })
            .collect();
        Self {
            layers,
            last: vec![uniform([4 * channels, classes], 4 * channels, 1.0, rng, &device)],
            last_bias: vec![zeros(classes, &device)],
        }
    }

    /// Features and logits of images `[batch, size, size, 3]` in [-1, 1].
    #[must_use]
    pub fn see(&self, images: Tensor<4>) -> ImageFeatures {
        let mut x = images;
        for (at, layer) in self.layers.iter().enumerate() {
            x = relu(convolve_3x3(x, layer.weight.val(), layer.bias.val()));
            if at < 2 {
                x = average_pool(x);
            }
        }
        let [batch, height, width, channels] = x.dims();
        let features = x
            .reshape([batch, height * width, channels])
            .mean_dim(1)
            .reshape([batch, channels]);
        let logits = dense(
            features.clone(),
            self.last[0].val(),
            self.last_bias[0].val(),
            None,
        );
        ImageFeatures { features, logits }
    }

    /// As [`see`](Self::see), for images of any size, which are interpolated to that of the network.
    #[must_use]
    pub fn see_resized(&self, images: Tensor<4>, form: NetworkSizes) -> ImageFeatures {
        let [_, height, width, _] = images.dims();
        if [height, width] == [form.size; 2] {
            return self.see(images);
        }
        self.see(resize_bilinear(images, [form.size; 2]))
    }

    /// Writes network and sizes into a folder, as the policy of a trial.
    ///
    /// # Errors
    /// [`TensorFileError::File`] where the file cannot be written.
    pub fn write(&self, form: NetworkSizes, folder: &Path) -> Result<(), TensorFileError> {
        let mut file = TensorFile::default();
        file.header = json!({ "kind": KIND, "form": form });
        store(self, PREFIX, &mut file);
        file.write(&folder.join(FILE_NAME))
    }

    /// Reads a network of [`write`](Self::write), without gradients.
    ///
    /// # Errors
    /// [`TensorFileError`] where the file is missing or is not such a network.
    pub fn read(folder: &Path) -> Result<(Self, NetworkSizes), TensorFileError> {
        let path = folder.join(FILE_NAME);
        let file = TensorFile::read(&path)?;
        Self::of(&file).map_err(|problem| problem.in_file(&path))
    }

    fn of(file: &TensorFile) -> Result<(Self, NetworkSizes), TensorFileError> {
        let form: Option<NetworkSizes> = serde_json::from_value(file.header["form"].clone()).ok();
        let form = form
            .filter(|_| file.header["kind"] == KIND)
            .ok_or_else(|| TensorFileError::Format {
                problem: "it is no classifier of images".into(),
            })?;
        form.fits(file)?;
        let blank = Self::new(form, &mut ZeroRng);
        Ok((restore(blank, PREFIX, file)?.valid(), form))
    }
}

/// Returns zeros: for parameters that are then replaced by those of a file.
struct ZeroRng;

impl RngCore for ZeroRng {
    fn next_u32(&mut self) -> u32 {
        0
    }

    fn next_u64(&mut self) -> u64 {
        0
    }

    fn fill_bytes(&mut self, bytes: &mut [u8]) {
        bytes.fill(0);
    }
}

/// He et al. 2015: uniform within `sqrt(3 gain / inputs)`.
#[allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    reason = "sizes are small, parameters f32"
)]
fn uniform<const D: usize>(
    shape: [usize; D],
    inputs: usize,
    gain: f64,
    rng: &mut impl RngCore,
    device: &Device,
) -> Param<Tensor<D>> {
    let bound = (3.0 * gain / inputs as f64).sqrt() as f32;
    let numbers: Vec<f32> = (0..shape.iter().product())
        .map(|_| (rng.random::<f32>() * 2.0 - 1.0) * bound)
        .collect();
    Param::from_tensor(Tensor::from_data(TensorData::new(numbers, shape), device))
}

fn zeros(n: usize, device: &Device) -> Param<Tensor<1>> {
    Param::from_tensor(Tensor::zeros([n], device))
}

#[cfg(test)]
mod tests {
    use super::*;
    use numerics::network::values;
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

    const FORM: NetworkSizes = NetworkSizes {
        size: 8,
        channels: 2,
        classes: 3,
    };

    fn network() -> FeatureNetwork {
        FeatureNetwork::new(FORM, &mut ChaCha8Rng::seed_from_u64(4))
    }

    fn images(size: usize) -> Tensor<4> {
        let numbers = (0..2 * size * size * 3)
            .map(|i| (i as f32 * 12.9898).sin())
            .collect();
        Tensor::from_data(TensorData::new::<f32, _>(numbers, [2, size, size, 3]), &device())
    }

    #[test]
    fn a_stored_network_sees_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let network = network();
        network.write(FORM, folder.path()).unwrap();
        let (read, form) = FeatureNetwork::read(folder.path()).unwrap();
        assert_eq!(form, FORM);
        let (one, two) = (network.see(images(8)), read.see(images(8)));
        assert_eq!(one.features.dims(), [2, 8]);
        assert_eq!(one.logits.dims(), [2, 3]);
        assert_eq!(values(one.logits), values(two.logits));
        assert_eq!(values(one.features), values(two.features));
    }

    #[test]
    fn images_of_another_size_are_interpolated() {
        let network = network().valid();
        let small = network.see_resized(images(4), FORM);
        let by_hand = network.see(resize_bilinear(images(4), [8, 8]));
        assert_eq!(values(small.logits), values(by_hand.logits));
    }

    #[test]
    fn sizes_that_no_tensor_bears_out_are_refused_before_anything_is_made_of_them() {
        let folder = tempfile::tempdir().unwrap();
        let much = 1 << 40;
        for form in [
            NetworkSizes { size: much, ..FORM },
            NetworkSizes { size: 6, ..FORM },
            NetworkSizes {
                channels: much,
                ..FORM
            },
            NetworkSizes {
                channels: usize::MAX,
                ..FORM
            },
            NetworkSizes {
                classes: much,
                ..FORM
            },
            NetworkSizes { classes: 0, ..FORM },
        ] {
            network().write(form, folder.path()).unwrap();
            let text = FeatureNetwork::read(folder.path()).unwrap_err().to_string();
            assert!(
                text.contains(FILE_NAME) && text.contains("expected layers"),
                "{text}"
            );
        }
    }

    #[test]
    fn a_changed_bit_or_a_cut_is_refused_by_the_name_of_the_file_or_leaves_a_network_of_its_form() {
        let folder = tempfile::tempdir().unwrap();
        network().write(FORM, folder.path()).unwrap();
        let path = folder.path().join(FILE_NAME);
        let whole = std::fs::read(&path).unwrap();
        let read = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            FeatureNetwork::read(folder.path())
        };
        // The header, and one bit of each eighth number.
        let header = 8 + usize::try_from(u64::from_le_bytes(whole[..8].try_into().unwrap())).unwrap();
        let numbers = (header..whole.len()).step_by(29).map(|place| (place, place % 8));
        for (place, bit) in (0..header)
            .flat_map(|place| (0..8).map(move |bit| (place, bit)))
            .chain(numbers)
        {
            let mut changed = whole.clone();
            changed[place] ^= 1 << bit;
            match read(&changed) {
                Ok((network, form)) => {
                    let seen = network.see(images(FORM.size)).logits.dims();
                    assert_eq!(seen, [2, form.classes], "bit {bit} of byte {place}");
                }
                Err(error) => assert!(error.to_string().contains(FILE_NAME), "{error}"),
            }
            let error = read(&whole[..place]).unwrap_err().to_string();
            assert!(error.contains(FILE_NAME), "cut at {place}: {error}");
        }
    }

    #[test]
    fn the_policy_of_an_agent_is_no_feature_network() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = TensorFile::default();
        file.header = json!({ "kind": "policy" });
        file.write(&folder.path().join(FILE_NAME)).unwrap();
        let text = FeatureNetwork::read(folder.path()).unwrap_err().to_string();
        assert!(text.contains("it is no classifier of images"), "{text}");
    }
}
