use super::*;
use crate::reference::numbers;
use plan::{Equations, Processor};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

fn discriminator(n_blocks: usize) -> (Discriminator, State<f32>) {
    let (mut rng, mut state) = (ChaCha8Rng::seed_from_u64(3), State::default());
    let mut discriminator = Discriminator::new(5, &mut state, &mut rng);
    (0..n_blocks).for_each(|_| discriminator.grow(&mut state, &mut rng));
    (discriminator, state)
}

/// A plan with one pass, whose images are the input `images` and scores the output `scores`.
fn plan(discriminator: &Discriminator, [n_images, side]: [usize; 2], pass: PassMode) -> Processor<f32> {
    let equations = Equations::new();
    let images = Image::new(equations.input("images", [n_images * side * side, 3]), [side; 2]);
    equations.routine("score");
    equations.output("scores", discriminator.apply(images, pass));
    let mut plan = Processor::new(equations.into_graph());
    plan.write("images", &numbers(n_images * side * side * 3, 1));
    plan
}

fn scores(plan: &mut Processor<f32>, state: &mut State<f32>) -> Vec<f32> {
    plan.run("score", state);
    plan.entries("scores").to_vec()
}

#[test]
fn the_largest_singular_value_of_every_weight_comes_to_one() {
    let (trained, mut state) = discriminator(3);
    let mut plan = plan(&trained, [1, 16], PassMode::Training);
    (0..100).for_each(|_| _ = scores(&mut plan, &mut state));
    let weights = trained.parameters().iter();
    let layers: Vec<&str> = weights.filter_map(|it| it.name.strip_suffix(".weight")).collect();
    let vectors = state
        .tensors()
        .filter(|(name, ..)| name.ends_with(".u") || name.ends_with(".v"));
    assert_eq!((layers.len(), vectors.count()), (2 * 4 + 2 + 1, 2 * layers.len()));
    for layer in layers {
        let [weight, u, v] = ["weight", "u", "v"].map(|part| state.entries(&format!("{layer}.{part}")));
        let matrix = nalgebra::DMatrix::from_row_slice(v.len(), u.len(), weight);
        let sigma = (nalgebra::DVector::from_row_slice(v).transpose()
            * &matrix
            * nalgebra::DVector::from_row_slice(u))[0];
        let largest = (matrix / sigma).singular_values().max();
        assert!((largest - 1.0).abs() < 1e-3, "{layer} {largest}");
    }
}

#[test]
fn scores_of_one_image_do_not_depend_on_the_others() {
    let (trained, mut state) = discriminator(2);
    let images = numbers(3 * 8 * 8 * 3, 1);
    let all = scores(&mut plan(&trained, [3, 8], PassMode::Evaluation), &mut state);
    let mut alone = plan(&trained, [1, 8], PassMode::Evaluation);
    for (image, expected) in images.chunks_exact(8 * 8 * 3).zip(all) {
        alone.write("images", image);
        assert_eq!(scores(&mut alone, &mut state), [expected]);
    }
}

#[test]
fn evaluation_takes_no_step_of_the_power_iteration() {
    let (trained, mut state) = discriminator(1);
    let [mut evaluated, mut training] =
        [PassMode::Evaluation, PassMode::Training].map(|pass| plan(&trained, [2, 4], pass));
    let before = scores(&mut evaluated, &mut state);
    assert_eq!(scores(&mut evaluated, &mut state), before);
    let _ = scores(&mut training, &mut state);
    assert_ne!(scores(&mut evaluated, &mut state), before);
}
