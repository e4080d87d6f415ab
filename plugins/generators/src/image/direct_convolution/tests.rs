//! Tests of the loops against the sum in the module's header, and against themselves with other vectors.

use super::weight_gradient::WeightGradient;
use super::*;
use crate::reference::numbers;
use proptest::prelude::*;

/// The sum of the header, term by term.
fn naive(image: &[f32], weight: &[f32], bias: &[f32], sizes: &Sizes) -> Vec<f32> {
    let Sizes {
        n_images,
        height,
        width,
        n_inputs,
        n_outputs,
        kernel,
        stride,
        padding,
    } = *sizes;
    let ([rows, columns], mut output) = (sizes.result(), Vec::new());
    for n in 0..n_images {
        for (y, x, o) in (0..rows * columns * n_outputs)
            .map(|at| (at / n_outputs / columns, at / n_outputs % columns, at % n_outputs))
        {
            let mut sum = bias[o];
            for (ky, kx, i) in (0..kernel[0] * kernel[1] * n_inputs).map(|at| {
                (
                    at / n_inputs / kernel[1],
                    at / n_inputs % kernel[1],
                    at % n_inputs,
                )
            }) {
                let row = (stride * y + ky).wrapping_sub(padding[0]);
                let column = (stride * x + kx).wrapping_sub(padding[1]);
                if row < height && column < width {
                    let x = image[((n * height + row) * width + column) * n_inputs + i];
                    sum = x.mul_add(
                        weight[((ky * kernel[1] + kx) * n_inputs + i) * n_outputs + o],
                        sum,
                    );
                }
            }
            output.push(sum);
        }
    }
    output
}

/// Any kernel that fits, or only those that keep the size.
fn sizes(keeps_size: bool) -> impl Strategy<Value = Sizes> {
    (
        (1..4usize, 1..8usize, 1..8usize),
        (1..40usize, 1..70usize),
        [
            prop::sample::select(vec![1usize, 3, 5]),
            prop::sample::select(vec![1usize, 3, 7]),
        ],
        1..3usize,
        prop::bool::ANY,
    )
        .prop_map(
            move |((n_images, height, width), (n_inputs, n_outputs), kernel, stride, is_padded)| {
                let is_padded = keeps_size || is_padded;
                let kernel = if is_padded {
                    kernel
                } else {
                    [kernel[0].min(height), kernel[1].min(width)]
                };
                Sizes {
                    n_images,
                    height,
                    width,
                    n_inputs,
                    n_outputs,
                    kernel,
                    stride: if keeps_size { 1 } else { stride },
                    padding: if is_padded {
                        kernel.map(|side| side / 2)
                    } else {
                        [0, 0]
                    },
                }
            },
        )
}

fn convolved(image: &[f32], weight: &[f32], bias: &[f32], sizes: Sizes) -> Vec<f32> {
    let (mut panels, mut frames) = (vec![0.0; sizes.panels()], vec![0.0; sizes.frames()]);
    pack(weight, bias, &sizes, &mut panels);
    let mut output = vec![f32::NAN; sizes.n_result_pixels() * sizes.n_outputs];
    convolve(image, &panels, &sizes, &sizes.starts(), &mut output, &mut frames);
    output
}

fn of_image(weight: &[f32], upstream: &[f32], sizes: Sizes) -> Vec<f32> {
    let reversed = sizes.reversed();
    let (mut panels, mut frames) = (vec![0.0; reversed.panels()], vec![0.0; reversed.frames()]);
    pack_turned(weight, &reversed, &mut panels);
    let mut output = vec![f32::NAN; sizes.n_pixels() * sizes.n_inputs];
    convolve(
        upstream,
        &panels,
        &reversed,
        &reversed.starts(),
        &mut output,
        &mut frames,
    );
    output
}

fn of_weight(image: &[f32], upstream: &[f32], sizes: Sizes) -> Vec<f32> {
    let mut gradient = vec![f32::NAN; sizes.n_taps() * sizes.n_outputs];
    weight_gradient(
        image,
        upstream,
        &sizes,
        &sizes.starts(),
        &mut gradient,
        &mut Vec::new(),
    );
    gradient
}

/// Image, weight, bias and gradient in the result.
fn operands(sizes: &Sizes) -> [Vec<f32>; 4] {
    [
        numbers(sizes.n_pixels() * sizes.n_inputs, 1),
        numbers(sizes.n_taps() * sizes.n_outputs, 2),
        numbers(sizes.n_outputs, 3),
        numbers(sizes.n_result_pixels() * sizes.n_outputs, 4),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// The results are equal bit by bit: one chain of fused operations in the order of the weights.
    #[test]
    fn any_number_of_channels_equals_the_naive_sum(sizes in sizes(false)) {
        let [image, weight, bias, _] = operands(&sizes);
        prop_assert_eq!(convolved(&image, &weight, &bias, sizes), naive(&image, &weight, &bias, &sizes));
    }

    /// `<y(x, W), dy> = <x, dx> = <W, dW>` without a bias, since `y` is linear in both.
    #[test]
    fn gradients_are_transposed_sums(sizes in sizes(true)) {
        let [image, weight, bias, upstream] = operands(&sizes);
        let product = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
        let expected = product(&convolved(&image, &weight, &vec![0.0; bias.len()], sizes), &upstream);
        let tolerance = 1e-5 * (sizes.n_pixels() * weight.len()) as f64;
        let of_image = product(&of_image(&weight, &upstream, sizes), &image);
        let of_weight = product(&of_weight(&image, &upstream, sizes), &weight);
        prop_assert!((expected - of_image).abs() < tolerance, "{} {}", expected, of_image);
        prop_assert!((expected - of_weight).abs() < tolerance, "{} {}", expected, of_weight);
    }

    /// Every width of vectors, and no vectors at all, give the same bits.
    #[cfg(target_arch = "x86_64")]
    #[test]
    fn every_width_of_vectors_gives_the_same_bits(sizes in sizes(true)) {
        use pulp::{Scalar, Simd, x86::{V3, V4}};
        let [image, weight, bias, upstream] = operands(&sizes);
        let (mut panels, starts) = (vec![0.0; sizes.panels()], sizes.starts());
        pack(&weight, &bias, &sizes, &mut panels);
        fn forward<S: Simd>(simd: S, (image, panels): (&[f32], &[f32]), sizes: Sizes, starts: &[usize]) -> Vec<f32> {
            let mut output = vec![0.0; sizes.n_result_pixels() * sizes.n_outputs];
            let frames = &mut vec![0.0; sizes.frames()];
            simd.vectorize(ConvolutionPass { image, panels, sizes, starts, output: &mut output, frames });
            output
        }
        // Rows of whole panels, as the pass has them.
        let width = sizes.n_outputs.next_multiple_of(PANEL);
        let upstream: Vec<f32> = numbers(upstream.len() / sizes.n_outputs * width, 4);
        fn gradient<S: Simd>(simd: S, (image, upstream): (&[f32], &[f32]), sizes: Sizes, starts: &[usize]) -> Vec<f32> {
            let width = sizes.n_outputs.next_multiple_of(PANEL);
            let (mut sums, frames) = (vec![0.0; sizes.n_taps() * width], &mut vec![0.0; sizes.frames()]);
            simd.vectorize(WeightGradient { image, upstream, sizes, starts, width, sums: &mut sums, frames });
            sums
        }
        let plain = (
            forward(Scalar, (&image, &panels), sizes, &starts),
            gradient(Scalar, (&image, &upstream), sizes, &starts),
        );
        if let Some(narrow) = V3::try_new() {
            prop_assert_eq!(&forward(narrow, (&image, &panels), sizes, &starts), &plain.0);
            prop_assert_eq!(&gradient(narrow, (&image, &upstream), sizes, &starts), &plain.1);
        }
        if let Some(wide) = V4::try_new() {
            prop_assert_eq!(&forward(wide, (&image, &panels), sizes, &starts), &plain.0);
            prop_assert_eq!(&gradient(wide, (&image, &upstream), sizes, &starts), &plain.1);
        }
    }
}
