//! Training against PyTorch (`tests/fixtures/images`), and continuing from a file to the same bits.

use super::*;
use crate::architecture::{AUTOGAN, E2GAN};
use crate::generator::GeneratorSizes;
use crate::reference::{assert_close, by_formula, networks, tensor};
use numerics::parameters::parameters;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

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

/// The vectors that a discriminator remembers.
fn memory(discriminator: &Discriminator) -> Vec<Vec<f32>> {
    let mut copy = discriminator.clone();
    copy.remembered()
        .into_iter()
        .map(|numbers| numbers.clone())
        .collect()
}

/// Gives parameters from number `known` of each network on, and vectors that are not in `old`, the values of
/// `networks.py`.
fn set_new(trained: &mut Adversaries, known: [usize; 2], old: &[Vec<f32>]) {
    trained.generator = by_formula(trained.generator.clone(), 20, known[0]);
    trained.average = by_formula(trained.average.clone(), 20, known[0]);
    trained.discriminator = by_formula(trained.discriminator.clone(), 90, known[1]);
    let vectors = trained.discriminator.remembered().into_iter();
    for vector in vectors.filter(|vector| !old.contains(vector)) {
        let length = (vector.len() as f32).sqrt();
        vector.iter_mut().for_each(|x| *x = 1.0 / length);
    }
}

#[test]
fn three_stages_of_training_agree_with_pytorch() {
    let expected = &networks()["training"];
    let number = |key: &str| expected[key].as_f64().unwrap();
    let mut trained = adversaries(Training {
        learning_rate: number("rate"),
        average_decay: number("decay"),
        ..Training::default()
    });
    set_new(&mut trained, [0, 0], &[]);
    let mut losses = expected["losses"]
        .as_array()
        .unwrap()
        .iter()
        .map(|loss| loss.as_f64().unwrap());
    for (stage, cell) in E2GAN.cells.iter().enumerate() {
        let known = [
            parameters(&trained.generator).len(),
            parameters(&trained.discriminator).len(),
        ];
        let old = memory(&trained.discriminator);
        trained.grow(cell, &mut ChaCha8Rng::seed_from_u64(1));
        set_new(&mut trained, known, &old);
        let side = trained.generator.side();
        for at in (0..3).map(|repeat| 10 * stage + repeat) {
            let of_critic =
                trained.critic_step(tensor([3, side, side, 3], 200 + at), tensor([3, 4], 100 + at));
            let of_generator = trained.generator_step(tensor([3, 4], 300 + at));
            for found in [of_critic, of_generator] {
                let expected = losses.next().unwrap();
                assert!(
                    (f64::from(found) - expected).abs() < 1e-3,
                    "stage {stage}: {found} {expected}"
                );
            }
        }
    }
    let networks = [
        (parameters(&trained.generator), &expected["generator"]),
        (parameters(&trained.discriminator), &expected["discriminator"]),
    ];
    // A bias that batch normalisation takes away again (but for the borders of a map) has hardly any gradient
    // but rounding errors, whose signs Adam follows.
    let has_gradient =
        |name: &str| !name.starts_with("cells") || !name.ends_with("bias") || name.ends_with("norm.bias");
    for (found, expected) in networks {
        for (parameter, expected) in found.iter().zip(expected.as_array().unwrap()) {
            if has_gradient(&parameter.name) {
                // Nine steps move a number by up to 9e-3.
                assert_close(&parameter.values, expected, (0.0, 6e-4), &parameter.name);
            }
        }
    }
    assert_close(
        &memory(&trained.discriminator)[0],
        &expected["u"],
        (0.0, 1e-3),
        "u",
    );
    let images = values(trained.generator.evaluate(tensor([2, 4], 2)).images);
    assert_close(&images, &expected["evaluated"], (0.0, 5e-3), "images");
    let averaged = trained.averaged_generator().evaluate(tensor([2, 4], 2)).images;
    assert_close(
        &values(averaged),
        &expected["averaged"],
        (0.0, 5e-3),
        "images of the average",
    );
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
fn what_was_stored_goes_on_to_the_same_bits() {
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
