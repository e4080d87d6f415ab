//! Blocks and the network compared with pytorch-fid, and files that are not its weights.

use super::*;
use safetensors::Dtype;
use safetensors::tensor::TensorView;
use serde::Deserialize;
use std::cell::RefCell;
use std::collections::BTreeMap;

/// The divisor of the published channels in the blocks of the fixtures.
const SHARE: usize = 16;

#[derive(Deserialize)]
struct Fixture {
    /// Shapes of the weights of layers, and of the last two tensors.
    tensors: BTreeMap<String, Vec<usize>>,
    parameters: usize,
    blocks: Vec<BlockCase>,
    features: ThinnedTensor,
    logits: ThinnedTensor,
}

#[derive(Deserialize)]
struct BlockCase {
    name: String,
    input: [usize; 4],
    output: [usize; 4],
    #[serde(flatten)]
    expected: ThinnedTensor,
}

/// Evenly spaced numbers of a tensor.
#[derive(Deserialize)]
struct ThinnedTensor {
    step: usize,
    values: Vec<f32>,
}

fn fixture() -> Fixture {
    let text = include_str!("../../../../tests/fixtures/generators/inception.json");
    serde_json::from_str(text).unwrap()
}

impl ThinnedTensor {
    #[track_caller]
    fn assert_close(&self, name: &str, found: &[f32], tolerance: f32) {
        let found: Vec<f32> = found.iter().copied().step_by(self.step).collect();
        assert_eq!(found.len(), self.values.len(), "{name}");
        let furthest = found
            .iter()
            .zip(&self.values)
            .map(|(here, there)| (here - there).abs());
        let furthest = furthest.fold(0.0, f32::max);
        assert!(furthest < tolerance, "{name}: {furthest} away");
    }
}

/// Numbers in [-1, 1) from a hash of name and position.
fn uniform(name: &str, shape: &[usize]) -> Vec<f32> {
    let key = name.bytes().fold(0x811C_9DC5_u32, |key, byte| {
        (key ^ u32::from(byte)).wrapping_mul(0x0100_0193)
    });
    let number = |at: u32| {
        let mut x = at.wrapping_mul(0x9E37_79B1) ^ key;
        x = (x ^ (x >> 15)).wrapping_mul(0x85EB_CA6B);
        x = (x ^ (x >> 13)).wrapping_mul(0xC2B2_AE35);
        ((x ^ (x >> 16)) >> 8) as f32 * 2_f32.powi(-23) - 1.0
    };
    let count: usize = shape.iter().product();
    (1..=u32::try_from(count).unwrap()).map(number).collect()
}

/// Like `drawn` of the fixtures.
fn drawn(name: &str, shape: &[usize]) -> Vec<f32> {
    let inputs: usize = shape[1..].iter().product();
    let (size, centre) = if shape.len() > 1 {
        ((6.0 / inputs as f64).sqrt() as f32, 0.0)
    } else if name.ends_with("bn.weight") || name.ends_with("bn.running_var") {
        (0.25, 1.0)
    } else {
        (0.1, 0.0)
    };
    uniform(name, shape)
        .into_iter()
        .map(|x| x * size + centre)
        .collect()
}

/// Numbers `[batch, channels, height, width]` as maps with their channels last.
fn input(name: &str, [batch, channels, height, width]: [usize; 4]) -> Maps {
    let planes = uniform(name, &[batch, channels, height, width]);
    let n_pixels = height * width;
    let entry = |at: usize| {
        let (channel, pixel, image) = (at % channels, at / channels % n_pixels, at / channels / n_pixels);
        planes[(image * channels + channel) * n_pixels + pixel]
    };
    Maps::new((0..planes.len()).map(entry).collect(), [height, width, channels])
}

/// Numbers of maps as `[batch, channels, height, width]`.
fn planes(maps: &Maps) -> Vec<f32> {
    let [height, width, channels] = maps.shape;
    let (n_pixels, entries) = (height * width, &maps.entries);
    let entry = |at: usize| {
        let (pixel, channel, image) = (at % n_pixels, at / n_pixels % channels, at / n_pixels / channels);
        entries[(image * n_pixels + pixel) * channels + channel]
    };
    (0..entries.len()).map(entry).collect()
}

/// All tensors that are read, in order.
fn wanted() -> Vec<(String, Vec<usize>)> {
    let asked = RefCell::new(Vec::new());
    Inception::from_weights(&|name, shape| {
        asked.borrow_mut().push((name.to_string(), shape.to_vec()));
        Ok(vec![0.0; shape.iter().product()])
    })
    .unwrap();
    asked.into_inner()
}

/// Writes a file with these tensors, whose numbers are drawn.
fn write(path: &Path, tensors: &[(String, Vec<usize>)]) {
    let numbers = |(name, shape): &(String, Vec<usize>)| -> Vec<u8> {
        drawn(name, shape)
            .into_iter()
            .flat_map(f32::to_le_bytes)
            .collect()
    };
    let bytes: Vec<Vec<u8>> = tensors.iter().map(numbers).collect();
    let views = tensors.iter().zip(&bytes).map(|((name, shape), bytes)| {
        let view = TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap();
        (name.as_str(), view)
    });
    safetensors::serialize_to_file(views, None, path).unwrap();
}

fn refusal(path: &Path) -> String {
    Inception::read(path).unwrap_err().to_string()
}

fn narrow(mut block: BlockPlan) -> BlockPlan {
    for branch in &mut block.branches {
        let layers = branch.chain.iter_mut().chain(&mut branch.fork);
        layers.for_each(|layer| layer.outputs /= SHARE);
    }
    block
}

/// The plans of a case: one block, or those of the stem.
fn plans(name: &str) -> Vec<BlockPlan> {
    let network = plan::network().into_iter();
    let wanted = if name == "stem" { "" } else { name };
    network.filter(|block| block.name == wanted).map(narrow).collect()
}

#[test]
fn every_kind_of_block_is_that_of_pytorch_fid() {
    let cases = fixture().blocks;
    assert_eq!(cases.len(), 7);
    for BlockCase {
        name,
        input: shape,
        output,
        expected,
    } in cases
    {
        let mut x = input(&format!("input of {name}"), shape);
        for plan in plans(&name) {
            let channels = x.shape[2];
            let block = Block::new(&plan, channels, &|name, shape| Ok(drawn(name, shape))).unwrap();
            x = block.see(&x);
            assert_eq!(x.shape[2], plan.outputs(channels), "{name}");
        }
        let [height, width, channels] = x.shape;
        assert_eq!([x.n_images(), channels, height, width], output, "{name}");
        expected.assert_close(&name, &planes(&x), 1e-5);
    }
}

#[test]
fn tensors_are_those_of_the_published_state_dict() {
    let Fixture {
        tensors, parameters, ..
    } = fixture();
    let mut published = BTreeMap::new();
    for (name, shape) in tensors {
        if name.starts_with("fc.") {
            published.insert(name, shape);
            continue;
        }
        for part in ["weight", "bias", "running_mean", "running_var"] {
            published.insert(format!("{name}.bn.{part}"), vec![shape[0]]);
        }
        published.insert(format!("{name}.conv.weight"), shape);
    }
    assert_eq!(published.remove("fc.bias"), Some(vec![CLASSES]));
    assert_eq!(wanted().into_iter().collect::<BTreeMap<_, _>>(), published);

    // The documentation of torchvision 0.29 gives 27 161 264 parameters, with 1000 classes and the branch that
    // only helps training: 1x1 from 768 to 128, 5x5 to 768, each with two numbers per channel for
    // normalisation, and its classes.
    let helper = 768 * 128 + 2 * 128 + 128 * 25 * 768 + 2 * 768 + (768 + 1) * 1000;
    assert_eq!(parameters, 27_161_264 - helper + 8 * (FEATURES + 1));
    let learnt = published.iter().filter(|(name, _)| !name.contains("running"));
    let learnt: usize = learnt.map(|(_, shape)| shape.iter().product::<usize>()).sum();
    assert_eq!(learnt + CLASSES, parameters);
}

#[test]
fn the_network_sees_what_pytorch_fid_sees() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("inception.safetensors");
    write(&path, &wanted());
    let images = uniform("images", &[1, 32, 32, 3]);
    let ImageFeatures { features, logits } = Inception::read(&path).unwrap().see(&images, [32; 2]);
    assert_eq!([features.len(), logits.len()], [FEATURES, CLASSES]);
    fixture().features.assert_close("features", &features, 1e-5);
    fixture().logits.assert_close("logits", &logits, 1e-5);
}

#[test]
fn a_tensor_that_is_not_there_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("inception.safetensors");
    let mut tensors = wanted();
    tensors.truncate(9);
    write(&path, &tensors);
    assert_eq!(
        refusal(&path),
        "there is no tensor `Conv2d_2a_3x3.bn.running_var`"
    );
    tensors[5].1 = vec![32, 32, 1, 1];
    write(&path, &tensors);
    assert_eq!(
        refusal(&path),
        "the tensor `Conv2d_2a_3x3.conv.weight` is [32, 32, 1, 1]; expected [32, 32, 3, 3]"
    );
}

#[test]
fn a_file_that_is_cut_off_is_refused_wherever_it_ends() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("inception.safetensors");
    let tensors = &wanted()[..5];
    write(&path, tensors);
    let whole = std::fs::read(&path).unwrap();
    for (kept, message) in [
        (
            whole.len() - 1,
            "the file ends before the end of the tensor `Conv2d_1a_3x3.conv.weight`",
        ),
        (200, "is no safetensors file: it ends in its header"),
        (3, "is no safetensors file: it ends in its header"),
    ] {
        std::fs::write(&path, &whole[..kept]).unwrap();
        let text = refusal(&path);
        assert!(text.contains(message), "{kept}: {text}");
    }
    std::fs::write(&path, b"\x04\0\0\0\0\0\0\0text").unwrap();
    assert!(refusal(&path).contains("is no safetensors file: expected"));
    std::fs::remove_file(&path).unwrap();
    assert!(refusal(&path).starts_with("cannot read `"));
}

#[test]
fn a_tensor_with_a_changed_bit_is_refused_or_has_its_shape() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("weights.safetensors");
    let view = TensorView::new(Dtype::F32, vec![2, 3], &[0; 24]).unwrap();
    safetensors::serialize_to_file([("last", view)], None, &path).unwrap();
    let whole = std::fs::read(&path).unwrap();
    let read = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        WeightFile::read(&path)?.tensor("last", &[2, 3])
    };
    for place in 0..whole.len() {
        assert!(read(&whole[..place]).is_err(), "cut at {place}");
        for bit in 0..8 {
            let mut changed = whole.clone();
            changed[place] ^= 1 << bit;
            if let Ok(values) = read(&changed) {
                assert_eq!(values.len(), 6, "bit {bit} of byte {place}");
            }
        }
    }
}

#[test]
fn half_precision_is_read_and_other_numbers_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("inception.safetensors");
    let write = |dtype, bytes: &[u8]| {
        let view = TensorView::new(dtype, vec![2], bytes).unwrap();
        safetensors::serialize_to_file([("bn.running_var", view)], None, &path).unwrap();
        WeightFile::read(&path).unwrap().tensor("bn.running_var", &[2])
    };
    // 1.5 and the smallest number above 0, by IEEE 754.
    let read = write(Dtype::F16, &[0x00, 0x3E, 0x01, 0x00]).unwrap();
    assert_eq!(read, [1.5, 2_f32.powi(-24)]);
    let message = |dtype, bytes: &[u8]| write(dtype, bytes).unwrap_err().to_string();
    assert_eq!(
        message(Dtype::BF16, &[0; 4]),
        "the tensor `bn.running_var` holds BF16; expected F32 or F16"
    );
    assert_eq!(
        message(Dtype::F16, &[0x00, 0x3E, 0x00, 0x7C]),
        "the tensor `bn.running_var` has inf at entry 1 (the first is 0)"
    );
    assert_eq!(
        message(Dtype::F16, &[0x00, 0xBE, 0x00, 0x00]),
        "the tensor `bn.running_var` has -1.5 at entry 0 (the first is 0)"
    );
}

#[test]
fn images_of_a_batch_are_seen_apart() {
    let plan = plans("Mixed_7c").remove(0);
    let block = Block::new(&plan, 128, &|name, shape| Ok(drawn(name, shape))).unwrap();
    let both = input("two images", [2, 128, 4, 5]);
    let seen = block.see(&both).means().entries;
    let images = both.entries.chunks_exact(128 * 4 * 5);
    let apart = images.flat_map(|image| block.see(&Maps::new(image.to_vec(), both.shape)).means().entries);
    assert_eq!(seen, apart.collect::<Vec<_>>());
}

#[test]
fn every_half_of_a_number_is_read_exactly() {
    for bits in 0..=u16::MAX {
        let (exponent, fraction) = (i32::from(bits >> 10 & 0x1F), f64::from(bits & 0x3FF));
        let size = match exponent {
            0 => fraction * 2f64.powi(-24),
            31 => continue,
            _ => (1024.0 + fraction) * 2f64.powi(exponent - 25),
        };
        let expected = if bits >> 15 == 1 { -size } else { size };
        assert_eq!(f64::from(weights::widened(bits)), expected, "{bits:x}");
    }
    assert_eq!(
        [0x7C00, 0xFC00].map(weights::widened),
        [f32::INFINITY, f32::NEG_INFINITY]
    );
    assert!(weights::widened(0x7C01).is_nan());
}
