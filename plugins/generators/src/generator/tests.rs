//! Blocks and whole generators compared with PyTorch (`tests/fixtures/images`), and the parts that growth
//! keeps.

use super::*;
use crate::architecture::{AUTOGAN, Architecture, E2GAN, Upsampling};
use crate::layers::expressions;
use crate::reference::{assert_close, by_formula, networks, numbers};
use plan::{Equations, Processor};
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

fn generator(architecture: &Architecture) -> (Generator, State<f32>) {
    let mut state = State::default();
    let mut generator = Generator::new(SIZES, &mut state, &mut rng());
    architecture
        .cells
        .iter()
        .for_each(|cell| generator.grow(cell, &mut state, &mut rng()));
    (generator, state)
}

/// Compares the gradients of all parameters with a list. Where the exact gradient is zero, rounding errors in
/// proportion to the other gradients remain.
fn assert_gradients(parameters: &[Parameter], found: &[Vec<f32>], expected: &Value, what: &str) {
    let expected = expected.as_array().unwrap();
    assert_eq!(found.len(), expected.len(), "{what}");
    let largest = found
        .iter()
        .flatten()
        .fold(0.0f64, |most, g| most.max(f64::from(g.abs())));
    let tolerance = (TOLERANCE.0, 1e-5 * largest);
    for ((found, parameter), expected) in found.iter().zip(parameters).zip(expected) {
        assert_close(
            found,
            expected,
            tolerance,
            &format!("{} of {what}", parameter.name),
        );
    }
}

/// Adds the gradients of values for an upstream gradient given by the formula, as outputs `0`, `1`, and so on.
fn write_gradients<'e>(output: Expression<'e>, of: &[Expression<'e>]) {
    let equations = output.equations();
    let upstream: Vec<f64> = numbers(output.n_rows() * output.n_columns(), 7)
        .into_iter()
        .map(f64::from)
        .collect();
    let loss = (output * equations.constant(output.shape(), &upstream)).sum();
    for (at, gradient) in equations.gradients(loss, of).into_iter().enumerate() {
        equations.output(&at.to_string(), gradient * 1.0);
    }
}

fn gradients(plan: &Processor<f32>, count: usize) -> Vec<Vec<f32>> {
    let gradient = |at: usize| plan.entries(&at.to_string()).to_vec();
    (0..count).map(gradient).collect()
}

/// One pass of training with latent vectors; its plan has the outputs `images`, `map`, `central` and the gradients of
/// all parameters.
fn trained(generator: &Generator, state: &mut State<f32>, latents: &[f32]) -> Processor<f32> {
    let equations = Equations::new();
    let input = equations.input("latents", [latents.len() / SIZES.latent, SIZES.latent]);
    equations.routine("train");
    let Generated { images, map } = generator.apply(input, PassMode::Training);
    equations.output("images", images.pixels);
    equations.output("map", map.pixels * 1.0);
    equations.output("central", central_features(map));
    write_gradients(images.pixels, &expressions(generator.parameters(), &equations));
    let mut plan = Processor::new(equations.into_graph());
    plan.write("latents", latents);
    plan.run("train", state);
    plan
}

fn evaluated(generator: &Generator, state: &State<f32>, latents: &[f32]) -> Vec<f32> {
    FinishedGenerator::new(generator.clone(), state.clone())
        .evaluate(latents)
        .images
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
        let (mut state, mut parameters) = (State::default(), Vec::new());
        let start = &mut Start {
            state: &mut state,
            rng: &mut rng(),
            parameters: &mut parameters,
        };
        let block = Block::new("block".into(), &cell, !case["up"].is_null(), 3, start);
        by_formula(&parameters, &mut state, 20, 0);
        state.insert("image", [8, 3], numbers(24, 1));
        let equations = Equations::new();
        let image = equations.parameter("image", [8, 3]);
        equations.routine("train");
        let output = block.apply(Image::new(image, [2, 2]), PassMode::Training).pixels;
        equations.output("output", output);
        let all = [vec![image], expressions(&parameters, &equations)].concat();
        write_gradients(output, &all);
        let n_gradients = all.len();
        let mut plan = Processor::<f32>::new(equations.into_graph());
        plan.run("train", &mut state);
        assert_close(plan.entries("output"), &case["output"], TOLERANCE, &what);
        let found = gradients(&plan, n_gradients);
        assert_close(&found[0], &case["image"], TOLERANCE, &what);
        assert_gradients(&parameters, &found[1..], &case["parameters"], &what);
    }
}

#[test]
fn whole_generators_agree_with_pytorch() {
    for case in networks()["generators"].as_array().unwrap() {
        let genotype = case["genotype"].as_str().unwrap();
        let (generator, mut state) = generator(&genotype.parse().unwrap());
        by_formula(generator.parameters(), &mut state, 77, 0);
        let plan = trained(&generator, &mut state, &numbers(3 * 4, 1));
        assert_close(plan.entries("images"), &case["images"], TOLERANCE, genotype);
        assert_close(plan.entries("map"), &case["map"], TOLERANCE, genotype);
        for (found, expected) in plan
            .entries("central")
            .iter()
            .zip(case["central"].as_array().unwrap())
        {
            assert!(
                (f64::from(*found) - expected.as_f64().unwrap()).abs() < 1e-4,
                "{found} {expected}"
            );
        }
        let found = gradients(&plan, generator.parameters().len());
        assert_gradients(generator.parameters(), &found, &case["parameters"], genotype);
        let images = evaluated(&generator, &state, &numbers(2 * 4, 2));
        assert_close(&images, &case["evaluated"], TOLERANCE, genotype);
    }
}

#[test]
fn central_features_are_the_mean_of_four_pixels() {
    let equations = Equations::new();
    let map = equations.input("map", [2 * 6 * 6, 3]);
    equations.routine("see");
    equations.output("central", central_features(Image::new(map, [6; 2])));
    let mut plan = Processor::<f32>::new(equations.into_graph());
    let map = numbers(2 * 6 * 6 * 3, 1);
    plan.write("map", &map);
    plan.run("see", &mut State::default());
    let pixel =
        |image: usize, y: usize, x: usize, channel: usize| map[((image * 6 + y) * 6 + x) * 3 + channel];
    for (channel, found) in plan.entries("central").iter().enumerate() {
        let of = |image| [(2, 2), (2, 3), (3, 2), (3, 3)].map(|(y, x)| pixel(image, y, x, channel));
        let mean = [of(0), of(1)].as_flattened().iter().sum::<f32>() / 8.0;
        assert!((mean - found).abs() < 1e-6);
    }
}

/// Entries of all parameters, in their order.
fn entries(generator: &Generator, state: &State<f32>) -> Vec<Vec<f32>> {
    let all = generator.parameters().iter();
    all.map(|parameter| state.entries(&parameter.name).to_vec())
        .collect()
}

#[test]
fn growing_keeps_what_is_there() {
    let mut state = State::default();
    let mut grown = Generator::new(SIZES, &mut state, &mut rng());
    let latents = numbers(4, 1);
    assert_eq!(evaluated(&grown, &state, &latents).len(), 2 * 2 * 3);
    for (n_cells, cell) in AUTOGAN.cells.iter().enumerate() {
        let before = (grown.parameters().to_vec(), entries(&grown, &state));
        grown.grow(cell, &mut state, &mut rng());
        let n_before = before.0.len();
        assert_eq!(grown.parameters()[..n_before], before.0);
        assert_eq!(entries(&grown, &state)[..n_before], before.1);
        let side = 4 << n_cells;
        assert_eq!((grown.n_cells(), grown.side()), (n_cells + 1, side));
        let plan = trained(&grown, &mut state.clone(), &latents);
        assert_eq!(plan.entries("map").len(), side * side * SIZES.channels);
        assert_eq!(evaluated(&grown, &state, &latents).len(), side * side * 3);
    }
}

#[test]
fn every_architecture_of_a_sample_makes_images() {
    for index in (0..crate::architecture::N_ARCHITECTURES).step_by(7919) {
        let architecture = Architecture::from_index(index).unwrap();
        let (generator, state) = generator(&architecture);
        let images = evaluated(&generator, &state, &numbers(2 * 4, 1));
        assert_eq!(images.len(), 2 * 16 * 16 * 3);
        assert!(images.iter().all(|x| x.abs() <= 1.0), "{architecture}");
    }
}

#[test]
fn evaluation_remembers_nothing_and_a_copy_has_its_own_memory() {
    let (generator, state) = generator(&E2GAN);
    let memory = |state: &State<f32>| -> Vec<Vec<f32>> {
        let all = state.tensors().filter(|(name, ..)| name.ends_with(".running"));
        all.map(|(_, _, entries)| entries.to_vec()).collect()
    };
    let before = memory(&state);
    assert_eq!(before.len(), 7);
    let mut finished = FinishedGenerator::new(generator.clone(), state.clone());
    let images = finished.evaluate(&numbers(2 * 4, 2));
    assert_eq!(memory(&finished.state), before);
    assert_eq!(finished.evaluate(&numbers(2 * 4, 2)), images);
    let mut copy = state.clone();
    let _ = trained(&generator, &mut copy, &numbers(2 * 4, 2));
    assert_eq!(memory(&state), before);
    assert_ne!(memory(&copy), before);
}

#[test]
fn a_stream_decides_all_numbers_and_they_have_their_bounds() {
    let (one, state) = generator(&E2GAN);
    let (two, other) = generator(&E2GAN);
    assert_eq!(
        (one.parameters(), entries(&one, &state)),
        (two.parameters(), entries(&two, &other))
    );
    for Parameter { name, shape } in one.parameters() {
        let largest = state
            .entries(name)
            .iter()
            .fold(0.0f32, |most, x| most.max(x.abs()));
        let [rows, outputs] = *shape;
        let bound = if name.contains("doublings") && name.ends_with("weight") {
            0.5 / (rows as f32).sqrt()
        } else if name.ends_with("convolution.weight") {
            // Three channels: one row for each place of the kernel and each of them.
            (6.0 / (rows + rows / 3 * outputs) as f32).sqrt()
        } else if name.ends_with("norm.weight") {
            1.1
        } else {
            1.0
        };
        assert!(largest <= bound, "{name} {largest} {bound}");
    }
}

#[test]
fn learnt_doublings_follow_each_other() {
    let (mut state, mut parameters) = (State::default(), Vec::new());
    let start = &mut Start {
        state: &mut state,
        rng: &mut rng(),
        parameters: &mut parameters,
    };
    let enlargement = Enlargement::new("enlargement".into(), Upsampling::Deconvolution, 4, 3, start);
    assert_eq!(parameters.len(), 4);
    let equations = Equations::new();
    let map = Image::new(equations.input("map", [4, 3]), [2, 2]);
    equations.routine("enlarge");
    let enlarged = enlargement.apply(map);
    assert_eq!((enlarged.n_images(), enlarged.height, enlarged.width), (1, 8, 8));
}
