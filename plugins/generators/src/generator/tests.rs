//! Blocks and whole generators compared with PyTorch (`tests/fixtures/images`), and the parts that growth
//! keeps.

use super::*;
use crate::architecture::{AUTOGAN, Architecture, E2GAN, Upsampling};
use crate::reference::{assert_close, by_formula, networks, tensor};
use burn::tensor::Gradients;
use numerics::network::device;
use numerics::optimizer::gradients;
use numerics::parameters::parameters;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use serde_json::Value;

const TOLERANCE: (f64, f64) = (1e-5, 1e-5);
const SIZES: GeneratorSizes = GeneratorSizes {
    bottom: 2,
    channels: 3,
    latent: 4,
};

fn rng() -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(5)
}

fn generator(architecture: &Architecture) -> Generator {
    let device = device().autodiff();
    let mut generator = Generator::new(SIZES, &mut rng(), &device);
    architecture
        .cells
        .iter()
        .for_each(|cell| generator.grow(cell, &mut rng(), &device));
    generator
}

/// Compares the gradients of all parameters with a list; a parameter without gradient counts as zeros. Where
/// the exact gradient is zero, rounding errors in proportion to the other gradients remain.
fn assert_gradients<M: Module>(module: &M, mut found: Gradients, expected: &Value, what: &str) {
    let (found, all) = (gradients(module, &mut found), parameters(module));
    let expected = expected.as_array().unwrap();
    assert_eq!(found.len(), expected.len(), "{what}");
    let largest = found
        .iter()
        .flatten()
        .fold(0.0f64, |most, g| most.max(f64::from(g.abs())));
    let tolerance = (TOLERANCE.0, 1e-5 * largest);
    for ((found, parameter), expected) in found.iter().zip(all).zip(expected) {
        let found = if found.is_empty() {
            vec![0.0; parameter.values.len()]
        } else {
            found.clone()
        };
        assert_close(
            &found,
            expected,
            tolerance,
            &format!("{} of {what}", parameter.name),
        );
    }
}

/// Gradients for an upstream gradient given by the formula.
fn backward(output: Tensor<4>) -> Gradients {
    let upstream = tensor(output.dims(), 7);
    (output * Tensor::from_inner(upstream)).sum().backward()
}

#[test]
fn every_kind_of_block_agrees_with_pytorch() {
    let cases = networks()["blocks"].as_array().unwrap().clone();
    assert_eq!(cases.len(), 24);
    for case in cases {
        let what = format!("order {} norm {} up {}", case["order"], case["norm"], case["up"]);
        let gene = |key: &str| case[key].as_u64().unwrap_or_default() as u8;
        let mut genotype = E2GAN.genotype();
        genotype[..3].copy_from_slice(&[gene("order"), gene("norm"), gene("up")]);
        let cell = Architecture::from_genotype(&genotype).unwrap().cells[0];
        let block = Block::new(&cell, !case["up"].is_null(), 3, &mut rng(), &device().autodiff());
        let mut block = by_formula(block, 20, 0);
        let image = Tensor::from_inner(tensor([2, 2, 2, 3], 1)).require_grad();
        let output = block.forward(image.clone(), PassMode::Training);
        assert_close(&values(output.clone()), &case["output"], TOLERANCE, &what);
        let found = backward(output);
        assert_close(
            &values(image.grad(&found).unwrap()),
            &case["image"],
            TOLERANCE,
            &what,
        );
        assert_gradients(&block, found, &case["parameters"], &what);
    }
}

#[test]
fn whole_generators_agree_with_pytorch() {
    for case in networks()["generators"].as_array().unwrap() {
        let genotype = case["genotype"].as_str().unwrap();
        let mut generator = by_formula(generator(&genotype.parse().unwrap()), 77, 0);
        let made = generator.forward(tensor([3, 4], 1), PassMode::Training);
        assert_close(&values(made.images.clone()), &case["images"], TOLERANCE, genotype);
        assert_close(&values(made.map.clone()), &case["map"], TOLERANCE, genotype);
        for (found, expected) in made
            .central_features()
            .iter()
            .zip(case["central"].as_array().unwrap())
        {
            assert!(
                (f64::from(*found) - expected.as_f64().unwrap()).abs() < 1e-4,
                "{found} {expected}"
            );
        }
        assert_gradients(&generator, backward(made.images), &case["parameters"], genotype);
        let evaluated = generator.evaluate(tensor([2, 4], 2)).images;
        assert_close(&values(evaluated), &case["evaluated"], TOLERANCE, genotype);
    }
}

#[test]
fn central_features_are_the_mean_of_four_pixels() {
    let map = tensor([2, 6, 6, 3], 1);
    let made = GeneratedBatch {
        images: map.clone(),
        map: map.clone(),
    };
    let centre = values(map.slice([0..2, 2..4, 2..4]));
    for (channel, found) in made.central_features().iter().enumerate() {
        let mean = centre.iter().skip(channel).step_by(3).sum::<f32>() / 8.0;
        assert!((mean - found).abs() < 1e-6);
    }
}

#[test]
fn growing_keeps_what_is_there() {
    let device = device().autodiff();
    let mut grown = Generator::new(SIZES, &mut rng(), &device);
    assert_eq!(grown.evaluate(tensor([1, 4], 1)).images.dims(), [1, 2, 2, 3]);
    for (n_cells, cell) in AUTOGAN.cells.iter().enumerate() {
        let before = parameters(&grown);
        grown.grow(cell, &mut rng(), &device);
        assert_eq!(parameters(&grown)[..before.len()], before);
        assert_eq!((grown.n_cells(), grown.side()), (n_cells + 1, 4 << n_cells));
        assert_eq!(
            grown.evaluate(tensor([1, 4], 1)).map.dims(),
            [1, 4 << n_cells, 4 << n_cells, 3]
        );
    }
}

#[test]
fn every_architecture_of_a_sample_makes_images() {
    for index in (0..crate::architecture::N_ARCHITECTURES).step_by(7919) {
        let architecture = Architecture::from_index(index).unwrap();
        let images = values(generator(&architecture).evaluate(tensor([2, 4], 1)).images);
        assert_eq!(images.len(), 2 * 16 * 16 * 3);
        assert!(images.iter().all(|x| x.abs() <= 1.0), "{architecture}");
    }
}

#[test]
fn evaluation_remembers_nothing_and_a_copy_has_its_own_memory() {
    let mut original = generator(&E2GAN);
    let memory = |generator: &Generator| -> Vec<Vec<f32>> {
        generator
            .clone()
            .state_vectors()
            .into_iter()
            .map(|numbers| numbers.clone())
            .collect()
    };
    let before = memory(&original);
    let _ = original.evaluate(tensor([2, 4], 1));
    assert_eq!(memory(&original), before);
    let mut copy = original.clone();
    copy.forward(tensor([2, 4], 1), PassMode::Training);
    assert_eq!(memory(&original), before);
    assert_ne!(memory(&copy), before);
    original.adopt(copy.clone());
    assert_eq!(memory(&original), memory(&copy));
}

#[test]
fn a_stream_decides_all_numbers_and_they_have_their_bounds() {
    let one = generator(&E2GAN);
    assert_eq!(parameters(&one), parameters(&generator(&E2GAN)));
    for parameter in parameters(&one) {
        let largest = parameter.values.iter().fold(0.0f32, |most, x| most.max(x.abs()));
        let bound = match parameter.shape[..] {
            [side, _, inputs, outputs] if parameter.name.contains("convolution") => {
                (6.0 / (side * side * (inputs + outputs)) as f32).sqrt()
            }
            [_, 2, 2, outputs] => 0.5 / (outputs as f32).sqrt(),
            [_] if parameter.name.ends_with("norm.weight") => 1.1,
            _ => 1.0,
        };
        assert!(largest <= bound, "{} {largest} {bound}", parameter.name);
    }
    let enlargement = Enlargement::new(Upsampling::Deconvolution, 4, 3, &mut rng(), &device());
    assert_eq!(parameters(&enlargement).len(), 4);
    assert_eq!(enlargement.forward(tensor([1, 2, 2, 3], 1)).dims(), [1, 8, 8, 3]);
}
