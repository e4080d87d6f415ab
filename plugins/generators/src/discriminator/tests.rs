use super::*;
use crate::reference::tensor;
use numerics::network::{device, values};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

fn discriminator(n_blocks: usize) -> Discriminator {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut discriminator = Discriminator::new(5, &mut rng, &device());
    (0..n_blocks).for_each(|_| discriminator.grow(&mut rng, &device()));
    discriminator
}

#[test]
fn the_largest_singular_value_of_every_weight_comes_to_one() {
    let mut trained = discriminator(3);
    (0..100).for_each(|_| {
        let _ = trained.forward(tensor([1, 16, 16, 3], 1), PassMode::Training);
    });
    let weights = numerics::parameters::parameters(&trained);
    let weights: Vec<_> = weights
        .iter()
        .filter(|parameter| parameter.name.ends_with("weight"))
        .collect();
    // Parameters begin with the last block, the vectors end with it: two convolutions and the linear layer.
    let mut memory = trained.clone();
    let pairs: Vec<Vec<f32>> = memory
        .state_vectors()
        .into_iter()
        .map(|numbers| numbers.clone())
        .collect();
    assert_eq!(weights.len() * 2, pairs.len());
    let in_order = weights[3..].iter().chain(&weights[..3]);
    for (weight, pair) in in_order.zip(pairs.chunks(2)) {
        let (u, v) = (&pair[0], &pair[1]);
        let matrix = nalgebra::DMatrix::from_row_slice(v.len(), u.len(), &weight.values);
        let sigma = (nalgebra::DVector::from_row_slice(v).transpose()
            * &matrix
            * nalgebra::DVector::from_row_slice(u))[0];
        let largest = (matrix / sigma).singular_values().max();
        assert!((largest - 1.0).abs() < 1e-3, "{} {largest}", weight.name);
    }
}

#[test]
fn scores_of_one_image_do_not_depend_on_the_others() {
    let mut trained = discriminator(2);
    let images = tensor([3, 8, 8, 3], 1);
    let all = values(trained.forward(images.clone(), PassMode::Evaluation));
    for (row, expected) in all.into_iter().enumerate() {
        let alone = values(trained.forward(images.clone().narrow(0, row, 1), PassMode::Evaluation));
        assert!((alone[0] - expected).abs() <= 1e-6 * expected.abs());
    }
}

#[test]
fn evaluation_takes_no_step_of_the_power_iteration() {
    let mut trained = discriminator(1);
    let images = tensor([2, 4, 4, 3], 1);
    let scores = |trained: &mut Discriminator, pass| values(trained.forward(images.clone(), pass));
    let before = scores(&mut trained, PassMode::Evaluation);
    assert_eq!(scores(&mut trained, PassMode::Evaluation), before);
    let _ = scores(&mut trained, PassMode::Training);
    assert_ne!(scores(&mut trained, PassMode::Evaluation), before);
}
