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

use crate::image::{Image, resize::bilinear};
use crate::images::CHANNELS;
use crate::layers::{Parameter, expressions};
use numerics::policy_file::FILE_NAME;
use numerics::tensor_file::{HostTensor, TensorFile, TensorFileError};
use plan::{Activation, Equations, Expression, Plans, State};
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

/// One part of the network: its name in files and in the state, its shape in files, and the numbers that enter
/// an output with the gain of what follows; none for a bias.
struct Part {
    name: String,
    shape: Vec<usize>,
    entering: Option<(usize, f64)>,
}

impl NetworkSizes {
    /// Parts in the order of their random numbers.
    fn parts(self) -> Vec<Part> {
        let part = |name: String, shape: Vec<usize>, entering| Part {
            name: format!("{PREFIX}.{name}"),
            shape,
            entering,
        };
        let c = self.channels;
        let widths = [CHANNELS, c, 2 * c, 4 * c];
        let mut parts = Vec::new();
        for (at, pair) in widths.windows(2).enumerate() {
            let (inputs, outputs) = (pair[0], pair[1]);
            let entering = Some((9 * inputs, 2.0));
            parts.push(part(
                format!("layers.{at}.weight"),
                vec![3, 3, inputs, outputs],
                entering,
            ));
            parts.push(part(format!("layers.{at}.bias"), vec![outputs], None));
        }
        parts.push(part(
            "last.0".into(),
            vec![4 * c, self.classes],
            Some((4 * c, 1.0)),
        ));
        parts.push(part("last_bias.0".into(), vec![self.classes], None));
        parts
    }

    /// Parameters, weight and bias of each layer.
    fn parameters(self) -> Vec<Parameter> {
        let parameter = |Part { name, shape, .. }: Part| {
            // Parts have one output in each column.
            let (n_columns, rows) = shape
                .split_last()
                .map_or((1, &[][..]), |(last, rows)| (*last, rows));
            let shape = [rows.iter().product(), n_columns];
            Parameter { name, shape }
        };
        self.parts().into_iter().map(parameter).collect()
    }
}

/// Features and logits of images in equations.
#[derive(Debug, Clone, Copy)]
pub struct Seen<'e> {
    /// `[batch, 4 c]`.
    pub features: Expression<'e>,
    /// `[batch, classes]`.
    pub logits: Expression<'e>,
}

/// The feature network with its numbers.
#[derive(Debug, Clone)]
pub struct FeatureNetwork {
    form: NetworkSizes,
    /// Parameters, and their optimisers where it is trained.
    pub(crate) state: State<f32>,
    plans: Plans,
}

/// Features and logits of a batch of images.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageFeatures {
    /// `[batch, 4 c]`.
    pub features: Vec<f32>,
    /// `[batch, classes]`.
    pub logits: Vec<f32>,
}

impl FeatureNetwork {
    /// A network with random weights.
    pub fn new(form: NetworkSizes, rng: &mut impl RngCore) -> Self {
        let mut state = State::default();
        for (part, Parameter { name, shape }) in form.parts().into_iter().zip(form.parameters()) {
            let count = shape[0] * shape[1];
            let entries = part.entering.map_or_else(
                || vec![0.0; count],
                |(inputs, gain)| uniform(count, inputs, gain, rng),
            );
            state.insert(name, shape, entries);
        }
        Self::with(form, state)
    }

    fn with(form: NetworkSizes, state: State<f32>) -> Self {
        Self {
            form,
            state,
            plans: Plans::default(),
        }
    }

    /// Sizes of the network.
    #[must_use]
    pub fn form(&self) -> NetworkSizes {
        self.form
    }

    /// Features and logits of images `[batch, side, side, 3]` in [-1, 1], which are interpolated where their side is
    /// not that of the network.
    ///
    /// # Panics
    /// Where the numbers are no whole number of images.
    pub fn see(&mut self, images: &[f32], side: usize) -> ImageFeatures {
        let size = self.form.size;
        if side != size {
            return self.see(&bilinear(images, CHANNELS, [side; 2], [size; 2]), size);
        }
        let (form, n_images) = (self.form, images.len() / (size * size * CHANNELS));
        let plan = self.plans.of_rows(n_images, |equations| {
            let images = form.images(equations, n_images);
            equations.routine("see");
            let Seen { features, logits } = form.apply(images);
            equations.output("features", features);
            equations.output("logits", logits);
        });
        plan.write("images", images);
        plan.run("see", &mut self.state);
        let [features, logits] = ["features", "logits"].map(|name| plan.entries(name).to_vec());
        ImageFeatures { features, logits }
    }

    /// Writes network and sizes into a folder, as the policy of a trial.
    ///
    /// # Errors
    /// [`TensorFileError::File`] where the file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), TensorFileError> {
        let mut file = TensorFile::default();
        file.header = json!({ "kind": KIND, "form": self.form });
        for Part { name, shape, .. } in self.form.parts() {
            let values = self.state.entries(&name).to_vec();
            file.insert(name, HostTensor { shape, values });
        }
        file.write(&folder.join(FILE_NAME))
    }

    /// Reads a network of [`write`](Self::write).
    ///
    /// # Errors
    /// [`TensorFileError`] where the file is missing or is not such a network.
    pub fn read(folder: &Path) -> Result<Self, TensorFileError> {
        let path = folder.join(FILE_NAME);
        let file = TensorFile::read(&path)?;
        Self::of(&file).map_err(|problem| problem.in_file(&path))
    }

    fn of(file: &TensorFile) -> Result<Self, TensorFileError> {
        let form: Option<NetworkSizes> = serde_json::from_value(file.header["form"].clone()).ok();
        let form = form
            .filter(|_| file.header["kind"] == KIND)
            .ok_or_else(|| TensorFileError::Format {
                problem: "it is no classifier of images".into(),
            })?;
        form.fits(file)?;
        let mut state = State::default();
        for (part, Parameter { name, shape }) in form.parts().into_iter().zip(form.parameters()) {
            let stored = file.get(&name)?;
            if stored.shape != part.shape {
                return Err(TensorFileError::Shape {
                    expected: format!("`{name}` {:?}", part.shape),
                    found: format!("{:?}", stored.shape),
                });
            }
            state.insert(name, shape, stored.values.clone());
        }
        Ok(Self::with(form, state))
    }

    /// Takes the numbers of another network of the same form; optimisers stay as they are.
    ///
    /// # Panics
    /// Where the other network has another form.
    pub(crate) fn adopt(&mut self, other: &Self) {
        for Parameter { name, .. } in self.form.parameters() {
            let entries = other.state.entries(&name);
            self.state.entries_mut(&name).copy_from_slice(entries);
        }
    }
}

impl NetworkSizes {
    /// Images of the network's size that a caller writes as `images`.
    #[must_use]
    pub fn images(self, equations: &Equations, n_images: usize) -> Image<'_> {
        let pixels = equations.input("images", [n_images * self.size * self.size, CHANNELS]);
        Image::new(pixels, [self.size; 2])
    }

    /// All parameters, weight and bias of each layer.
    #[must_use]
    pub fn expressions(self, equations: &Equations) -> Vec<Expression<'_>> {
        expressions(&self.parameters(), equations)
    }

    /// Features and logits of images of the network's size.
    #[must_use]
    pub fn apply(self, images: Image<'_>) -> Seen<'_> {
        let parameters = self.expressions(images.pixels.equations());
        let (layers, last) = parameters.split_at(parameters.len() - 2);
        let mut x = images;
        for (at, layer) in layers.chunks_exact(2).enumerate() {
            x = x.convolve(3, layer[0], layer[1]).relu();
            if at < 2 {
                x = x.average_pool();
            }
        }
        let features = x.sum_pixels() / (x.height * x.width) as f64;
        Seen {
            features,
            logits: features.dense(last[0], last[1], Activation::Identity),
        }
    }
}

/// He et al. 2015: uniform within `sqrt(3 gain / inputs)`.
#[allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    reason = "sizes are small, parameters f32"
)]
fn uniform(count: usize, inputs: usize, gain: f64, rng: &mut impl RngCore) -> Vec<f32> {
    let bound = (3.0 * gain / inputs as f64).sqrt() as f32;
    (0..count)
        .map(|_| (rng.random::<f32>() * 2.0 - 1.0) * bound)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

    const FORM: NetworkSizes = NetworkSizes {
        size: 8,
        channels: 2,
        classes: 3,
    };

    fn network() -> FeatureNetwork {
        FeatureNetwork::new(FORM, &mut ChaCha8Rng::seed_from_u64(4))
    }

    fn images(size: usize) -> Vec<f32> {
        (0..2 * size * size * 3)
            .map(|i| (i as f32 * 12.9898).sin())
            .collect()
    }

    #[test]
    fn a_stored_network_sees_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let mut network = network();
        network.write(folder.path()).unwrap();
        let mut read = FeatureNetwork::read(folder.path()).unwrap();
        assert_eq!(read.form(), FORM);
        let (one, two) = (network.see(&images(8), 8), read.see(&images(8), 8));
        assert_eq!((one.features.len(), one.logits.len()), (2 * 8, 2 * 3));
        assert_eq!(one, two);
    }

    /// Networks of earlier versions are read.
    #[test]
    fn a_file_has_the_names_and_shapes_that_it_always_had() {
        let folder = tempfile::tempdir().unwrap();
        network().write(folder.path()).unwrap();
        let file = TensorFile::read(&folder.path().join(FILE_NAME)).unwrap();
        let shapes: [(&str, &[usize]); 8] = [
            ("layers.0.weight", &[3, 3, 3, 2]),
            ("layers.0.bias", &[2]),
            ("layers.1.weight", &[3, 3, 2, 4]),
            ("layers.1.bias", &[4]),
            ("layers.2.weight", &[3, 3, 4, 8]),
            ("layers.2.bias", &[8]),
            ("last.0", &[8, 3]),
            ("last_bias.0", &[3]),
        ];
        for (name, shape) in shapes {
            assert_eq!(
                file.get(&format!("network.{name}")).unwrap().shape,
                shape,
                "{name}"
            );
        }
    }

    #[test]
    fn images_of_another_size_are_interpolated() {
        let mut network = network();
        let small = network.see(&images(4), 4);
        let by_hand = network.see(&bilinear(&images(4), 3, [4, 4], [8, 8]), 8);
        assert_eq!(small, by_hand);
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
            let mut file = TensorFile::default();
            file.header = json!({ "kind": KIND, "form": form });
            let network = network();
            for Part { name, shape, .. } in FORM.parts() {
                let values = network.state.entries(&name).to_vec();
                file.insert(name, HostTensor { shape, values });
            }
            file.write(&folder.path().join(FILE_NAME)).unwrap();
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
        network().write(folder.path()).unwrap();
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
                Ok(mut network) => {
                    let seen = network.see(&images(FORM.size), FORM.size).logits.len();
                    assert_eq!(seen, 2 * network.form().classes, "bit {bit} of byte {place}");
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
