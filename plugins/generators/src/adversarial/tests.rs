//! Training compared with PyTorch (`tests/fixtures/images`), and continuation from a file to the same bits.

use super::*;
use crate::architecture::{AUTOGAN, CellArchitecture, E2GAN};
use crate::generator::GeneratorSizes;
use crate::reference::{assert_close, by_formula, networks, tensor};
use numerics::parameters::{Parameter, parameters};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use serde_json::Value;

const SIZES: GeneratorSizes = GeneratorSizes {
    bottom: 2,
    channels: 3,
    latent: 4,
};

fn adversaries(training: Training) -> Adversaries {
    let (mut rng, device) = (ChaCha8Rng::seed_from_u64(11), training_device());
    Adversaries::new(
        Generator::new(SIZES, &mut rng, &device),
        Discriminator::new(4, &mut rng, &device),
        training,
    )
}

/// The singular vectors and running statistics of a discriminator.
fn memory(discriminator: &Discriminator) -> Vec<Vec<f32>> {
    let mut copy = discriminator.clone();
    copy.state_vectors()
        .into_iter()
        .map(|numbers| numbers.clone())
        .collect()
}

/// Sets the parameters from number `known` of each network on, and the vectors that are not in `old`, to the
/// values of `networks.py`.
fn set_new(trained: &mut Adversaries, known: [usize; 2], old: &[Vec<f32>]) {
    trained.generator = by_formula(trained.generator.clone(), 20, known[0]);
    trained.average = by_formula(trained.average.clone(), 20, known[0]);
    trained.discriminator = by_formula(trained.discriminator.clone(), 90, known[1]);
    let vectors = trained.discriminator.state_vectors().into_iter();
    for vector in vectors.filter(|vector| !old.contains(vector)) {
        let length = (vector.len() as f32).sqrt();
        vector.iter_mut().for_each(|x| *x = 1.0 / length);
    }
}

#[test]
fn three_stages_of_training_agree_with_pytorch() {
    let expected = &networks()["training"];
    let trained = trained_in_stages(expected);
    assert_parameters(&parameters(&trained.generator), &expected["generator"]);
    assert_parameters(&parameters(&trained.discriminator), &expected["discriminator"]);
    let vector = &memory(&trained.discriminator)[0];
    assert_close(vector, &expected["u"], (0.0, 1e-3), "u");
    let images = |generator: &Generator| values(generator.evaluate(tensor([2, 4], 2)).images);
    let of_last = images(&trained.generator);
    assert_close(&of_last, &expected["evaluated"], (0.0, 5e-3), "images");
    let of_average = images(&trained.averaged_generator());
    let what = "images of the average";
    assert_close(&of_average, &expected["averaged"], (0.0, 5e-3), what);
}

/// Three steps of both networks after each cell of the published architecture, each loss compared with
/// PyTorch's.
fn trained_in_stages(expected: &Value) -> Adversaries {
    let number = |key: &str| expected[key].as_f64().unwrap();
    let mut trained = adversaries(Training {
        learning_rate: number("rate"),
        average_decay: number("decay"),
        ..Training::default()
    });
    set_new(&mut trained, [0, 0], &[]);
    let all = expected["losses"].as_array().unwrap();
    let mut losses = all.iter().map(|loss| loss.as_f64().unwrap());
    for (stage, cell) in E2GAN.cells.iter().enumerate() {
        grow(&mut trained, cell);
        for at in (0..3).map(|repeat| 10 * stage + repeat) {
            for found in step_both(&mut trained, at) {
                let expected = losses.next().unwrap();
                let close = (f64::from(found) - expected).abs() < 1e-3;
                assert!(close, "stage {stage}: {found} {expected}");
            }
        }
    }
    trained
}

/// Adds a cell with the numbers of `networks.py`; the other parts keep theirs.
fn grow(trained: &mut Adversaries, cell: &CellArchitecture) {
    let known = [
        parameters(&trained.generator).len(),
        parameters(&trained.discriminator).len(),
    ];
    let old = memory(&trained.discriminator);
    trained.grow(cell, &mut ChaCha8Rng::seed_from_u64(1));
    set_new(trained, known, &old);
}

/// The losses of one step of the discriminator and one of the generator, with inputs number `at`.
fn step_both(trained: &mut Adversaries, at: usize) -> [f32; 2] {
    let side = trained.generator.side();
    let of_critic = trained.critic_step(tensor([3, side, side, 3], 200 + at), tensor([3, 4], 100 + at));
    [of_critic, trained.generator_step(tensor([3, 4], 300 + at))]
}

fn assert_parameters(found: &[Parameter], expected: &Value) {
    // A bias in front of batch normalisation has almost no gradient (except at the borders of a map) but
    // rounding errors, whose signs Adam follows.
    let has_gradient =
        |name: &str| !name.starts_with("cells") || !name.ends_with("bias") || name.ends_with("norm.bias");
    let pairs = found.iter().zip(expected.as_array().unwrap());
    for (parameter, expected) in pairs.filter(|(parameter, _)| has_gradient(&parameter.name)) {
        // Nine steps move a number by up to 9e-3.
        assert_close(&parameter.values, expected, (0.0, 6e-4), &parameter.name);
    }
}

fn two_steps(trained: &mut Adversaries, rng: &mut ChaCha8Rng) -> Vec<f32> {
    let side = trained.generator.side();
    let mut losses = Vec::new();
    for step in 0..2 {
        losses.push(trained.critic_step(tensor([4, side, side, 3], step), latents(4, 4, rng)));
        losses.push(trained.generator_step(latents(4, 4, rng)));
    }
    losses
}

#[test]
fn a_stored_training_continues_to_the_same_bits() {
    let grown = || {
        let mut trained = adversaries(Training::default());
        AUTOGAN.cells[..2]
            .iter()
            .for_each(|cell| trained.grow(cell, &mut ChaCha8Rng::seed_from_u64(2)));
        trained
    };
    let (mut one, mut rng) = (grown(), ChaCha8Rng::seed_from_u64(4));
    let _ = two_steps(&mut one, &mut rng);
    one.grow(&AUTOGAN.cells[2], &mut rng);
    let _ = two_steps(&mut one, &mut rng);
    let mut file = TensorFile::default();
    one.store("gan", &mut file);
    let folder = tempfile::tempdir().unwrap();
    file.write(&folder.path().join("state.safetensors")).unwrap();
    let file = TensorFile::read(&folder.path().join("state.safetensors")).unwrap();
    let mut two = grown();
    assert!(two.restore("gan", &TensorFile::default()).is_err());
    two.grow(&AUTOGAN.cells[2], &mut ChaCha8Rng::seed_from_u64(3));
    two.restore("gan", &file).unwrap();
    let losses = [
        two_steps(&mut one, &mut rng.clone()),
        two_steps(&mut two, &mut rng),
    ];
    assert_eq!(losses[0], losses[1]);
    let state = |trained: &Adversaries| {
        let mut file = TensorFile::default();
        trained.store("gan", &mut file);
        file
    };
    assert_eq!(state(&one), state(&two));
}

#[test]
fn a_copy_trains_by_itself() {
    let mut one = adversaries(Training::default());
    one.grow(&E2GAN.cells[0], &mut ChaCha8Rng::seed_from_u64(2));
    let mut copy = one.clone();
    let losses = two_steps(&mut copy, &mut ChaCha8Rng::seed_from_u64(4));
    assert_eq!(two_steps(&mut one, &mut ChaCha8Rng::seed_from_u64(4)), losses);
}

#[test]
fn a_critic_learns_to_tell_noise_from_a_gradient() {
    let mut trained = adversaries(Training {
        learning_rate: 0.01,
        ..Training::default()
    });
    trained.grow(&E2GAN.cells[0], &mut ChaCha8Rng::seed_from_u64(2));
    let real = Tensor::<4>::ones([8, 4, 4, 3], &device());
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let first = trained.critic_step(real.clone(), latents(8, 4, &mut rng));
    let last = (0..60)
        .map(|_| trained.critic_step(real.clone(), latents(8, 4, &mut rng)))
        .last()
        .unwrap();
    assert!(last < 0.5 * first, "{first} {last}");
}
