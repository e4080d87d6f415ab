//! Tests of the loops against the sum in the module's header, and against themselves with other vectors.

use super::*;
use crate::image::oracle_tests::numbers;
use proptest::prelude::*;

/// The sum of the header, term by term.
fn naive(image: &[f32], weight: &[f32], bias: &[f32], sizes: &Sizes) -> Vec<f32> {
    let Sizes {
        n_images,
        height,
        width,
        n_inputs,
        n_outputs,
        side,
    } = *sizes;
    let reach = side / 2;
    let mut output = Vec::new();
    for n in 0..n_images {
        for (y, x, o) in (0..height * width * n_outputs)
            .map(|at| (at / n_outputs / width, at / n_outputs % width, at % n_outputs))
        {
            let mut sum = bias[o];
            for (ky, kx, i) in (0..side * side * n_inputs)
                .map(|at| (at / n_inputs / side, at / n_inputs % side, at % n_inputs))
            {
                let (row, column) = ((y + ky).wrapping_sub(reach), (x + kx).wrapping_sub(reach));
                if row < height && column < width {
                    let x = image[((n * height + row) * width + column) * n_inputs + i];
                    sum = x.mul_add(weight[((ky * side + kx) * n_inputs + i) * n_outputs + o], sum);
                }
            }
            output.push(sum);
        }
    }
    output
}

fn sizes() -> impl Strategy<Value = Sizes> {
    (
        1..4usize,
        1..8usize,
        1..8usize,
        1..40usize,
        1..70usize,
        prop::bool::ANY,
    )
        .prop_map(|(n_images, height, width, n_inputs, n_outputs, wide)| Sizes {
            n_images,
            height,
            width,
            n_inputs,
            n_outputs,
            side: if wide { 3 } else { 1 },
        })
}

fn n_pixels(sizes: &Sizes) -> usize {
    sizes.n_images * sizes.height * sizes.width
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// The results are equal bit by bit: one chain of fused operations in the order of the weights.
    #[test]
    fn any_number_of_channels_equals_the_naive_sum(sizes in sizes()) {
        let (image, weight) = (numbers(n_pixels(&sizes) * sizes.n_inputs, 1), numbers(sizes.n_weights(), 2));
        let bias = numbers(sizes.n_outputs, 3);
        prop_assert_eq!(convolve(&image, &weight, Some(&bias), sizes), naive(&image, &weight, &bias, &sizes));
    }

    /// `<y(x, W), dy> = <x, dx> = <W, dW>` without a bias, since `y` is linear in both.
    #[test]
    fn gradients_are_transposed_sums(sizes in sizes()) {
        let (image, weight) = (numbers(n_pixels(&sizes) * sizes.n_inputs, 1), numbers(sizes.n_weights(), 2));
        let upstream = numbers(n_pixels(&sizes) * sizes.n_outputs, 3);
        let product = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
        let expected = product(&convolve(&image, &weight, None, sizes), &upstream);
        let tolerance = 1e-5 * (n_pixels(&sizes) * sizes.n_weights()) as f64;
        let of_image = product(&image_gradient(&weight, &upstream, sizes), &image);
        let of_weight = product(&weight_gradient(&image, &upstream, sizes), &weight);
        prop_assert!((expected - of_image).abs() < tolerance, "{} {}", expected, of_image);
        prop_assert!((expected - of_weight).abs() < tolerance, "{} {}", expected, of_weight);
    }

    #[cfg(target_arch = "x86_64")]
    #[test]
    fn every_width_of_vectors_gives_the_same_bits(sizes in sizes()) {
        use pulp::{Simd, x86::{V3, V4}};
        let (image, weight) = (numbers(n_pixels(&sizes) * sizes.n_inputs, 1), numbers(sizes.n_weights(), 2));
        let (bias, upstream) = (numbers(sizes.n_outputs, 3), numbers(n_pixels(&sizes) * sizes.n_outputs, 4));
        let forward = || ConvolutionPass { image: &image, panels: panels(&weight, Some(&bias), &sizes), sizes };
        let gradient = || WeightGradient { image: &image, upstream: &upstream, sizes };
        // A processor with only one of the widths has nothing to compare.
        if let (Some(narrow), Some(wide)) = (V3::try_new(), V4::try_new()) {
            prop_assert_eq!(Simd::vectorize(narrow, forward()), Simd::vectorize(wide, forward()));
            prop_assert_eq!(Simd::vectorize(narrow, gradient()), Simd::vectorize(wide, gradient()));
        }
    }
}
