//! The Dirichlet distribution on burn tensors: reparameterised draws, log density and entropy of a batch,
//! differentiable.
//!
//! Values and derivatives are computed on the host in `f64` by [`crate::dirichlet`] and enter the graph
//! through one custom autodiff operation, [`crate::linearised`]. All functions take tensors with and without
//! autodiff; without, they cost no derivatives. Randomness comes from the caller's stream alone.

use burn::Tensor;
use burn::tensor::activation::log_softmax;
use burn::tensor::{Device, TensorData};
use rand::RngCore;

use crate::dirichlet;
use crate::linearised::linearised;

/// A reparameterised draw of a batch.
#[derive(Debug, Clone)]
pub struct DirichletSample {
    /// Allocation `[batch, n]`, each row a point of the simplex.
    pub action: Tensor<2>,
    /// Logarithm of the action `[batch, n]`, floored at [`dirichlet::LOG_ACTION_FLOOR`]; exact where `action`
    /// has underflowed.
    pub log_action: Tensor<2>,
}

/// Draws `a ~ Dirichlet(alpha)` for each row of `alpha` `[batch, n]`; gradients flow to `alpha`.
///
/// The gamma draws carry their implicit derivative, `ln a = ln g - ln sum g` is differentiated by burn.
/// A row with a concentration that is not positive and finite becomes NaN.
pub fn sample(alpha: Tensor<2>, rng: &mut impl RngCore) -> DirichletSample {
    let device = alpha.device();
    let rows = HostRows::of(&alpha);
    let log_action = if alpha.is_autodiff() {
        let draws: Vec<_> = rows
            .iter()
            .map(|row| dirichlet::sample_with_gradient(row, rng))
            .collect();
        let value = tensor(
            draws.iter().flat_map(|draw| &draw.log_action),
            rows.shape(),
            &device,
        );
        let slope = tensor(draws.iter().flat_map(|draw| &draw.slope), rows.shape(), &device);
        // The value is normalised already; softmax leaves it unchanged and adds the derivative of the
        // normalisation.
        log_softmax(linearised(alpha, value, slope), 1)
    } else {
        let draws: Vec<f64> = rows.iter().flat_map(|row| dirichlet::sample(row, rng)).collect();
        tensor(&draws, rows.shape(), &device)
    };
    DirichletSample {
        action: log_action.clone().exp(),
        log_action,
    }
}

/// Log density `[batch, 1]` of `log_action` `[batch, n]` under `Dirichlet(alpha)`, `alpha` `[batch, n]`.
///
/// Gradients flow to both (thesis, equation 3.13, and `alpha - 1`).
///
/// # Panics
/// If the two shapes differ.
#[must_use]
pub fn log_density(alpha: Tensor<2>, log_action: Tensor<2>) -> Tensor<2> {
    assert_eq!(
        alpha.dims(),
        log_action.dims(),
        "concentrations and actions are of one shape"
    );
    let device = alpha.device();
    let (alphas, logs) = (HostRows::of(&alpha), HostRows::of(&log_action));
    let values: Vec<f64> = alphas
        .iter()
        .zip(logs.iter())
        .map(|(alpha, log)| dirichlet::log_density(alpha, log))
        .collect();
    let mut result = tensor(&values, [alphas.batch(), 1], &device);
    if alpha.is_autodiff() {
        let in_alpha: Vec<f64> = alphas
            .iter()
            .zip(logs.iter())
            .flat_map(|(alpha, log)| dirichlet::log_density_gradient(alpha, log))
            .collect();
        result = linearised(alpha, result, tensor(&in_alpha, alphas.shape(), &device));
    }
    if log_action.is_autodiff() {
        let in_action: Vec<f64> = alphas.values.iter().map(|alpha| alpha - 1.0).collect();
        let zero = Tensor::zeros([alphas.batch(), 1], &log_action.device());
        let derivative = tensor(&in_action, alphas.shape(), &log_action.device());
        result = result + linearised(log_action, zero, derivative);
    }
    result
}

/// Differential entropy `[batch, 1]` of `Dirichlet(alpha)`, `alpha` `[batch, n]`; gradients flow to `alpha`.
#[must_use]
pub fn entropy(alpha: Tensor<2>) -> Tensor<2> {
    let device = alpha.device();
    let rows = HostRows::of(&alpha);
    let values: Vec<f64> = rows.iter().map(dirichlet::entropy).collect();
    let value = tensor(&values, [rows.batch(), 1], &device);
    if !alpha.is_autodiff() {
        return value;
    }
    let gradients: Vec<f64> = rows.iter().flat_map(dirichlet::entropy_gradient).collect();
    linearised(alpha, value, tensor(&gradients, rows.shape(), &device))
}

/// Rows of a tensor on the host.
struct HostRows {
    values: Vec<f64>,
    columns: usize,
}

impl HostRows {
    fn of(tensor: &Tensor<2>) -> Self {
        Self {
            values: tensor.to_data().iter::<f64>().collect(),
            columns: tensor.dims()[1],
        }
    }

    fn iter(&self) -> impl Iterator<Item = &[f64]> {
        self.values.chunks(self.columns)
    }

    fn batch(&self) -> usize {
        self.values.len() / self.columns
    }

    fn shape(&self) -> [usize; 2] {
        [self.batch(), self.columns]
    }
}

/// Constant tensor of `device` from numbers rounded to `f32`.
fn tensor<'a>(values: impl IntoIterator<Item = &'a f64>, shape: [usize; 2], device: &Device) -> Tensor<2> {
    let values: Vec<f32> = values.into_iter().map(|&value| value as f32).collect();
    Tensor::from_data(TensorData::new(values, shape), device)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    const ALPHA: [[f32; 3]; 2] = [[0.7, 3.0, 12.0], [150.0, 2.2, 1.0]];
    const WEIGHTS: [[f32; 3]; 2] = [[1.0, -2.0, 0.5], [0.3, 1.5, -1.0]];

    fn rng() -> ChaCha8Rng {
        ChaCha8Rng::seed_from_u64(21)
    }

    fn doubles(tensor: Tensor<2>) -> Vec<f64> {
        tensor.into_data().iter::<f64>().collect()
    }

    fn gradient(at: [[f32; 3]; 2], loss: impl FnOnce(Tensor<2>) -> Tensor<2>) -> Vec<f64> {
        let input = Tensor::<2>::from_data(at, &Device::default().autodiff()).require_grad();
        doubles(input.grad(&loss(input.clone()).sum().backward()).unwrap())
    }

    /// Central differences of the summed loss on plain tensors, with steps that `f32` resolves.
    fn differences(at: [[f32; 3]; 2], loss: impl Fn(Tensor<2>) -> Tensor<2>) -> Vec<f64> {
        let moved = |index: usize, factor: f32| {
            let mut point = at;
            point[index / 3][index % 3] *= factor;
            let step = f64::from(point[index / 3][index % 3]) - f64::from(at[index / 3][index % 3]);
            (
                doubles(loss(Tensor::from_data(point, &Device::default())))
                    .iter()
                    .sum::<f64>(),
                step,
            )
        };
        let quotient = |index| {
            let ((above, up), (below, down)) = (moved(index, 1.01), moved(index, 0.99));
            (above - below) / (up - down)
        };
        (0..6).map(quotient).collect()
    }

    fn assert_close(got: &[f64], want: &[f64], tolerance: f64) {
        for (got_one, want_one) in got.iter().zip(want) {
            assert!(
                (got_one - want_one).abs() <= tolerance * want_one.abs().max(0.1),
                "{got:?}, not {want:?}"
            );
        }
    }

    fn weights(like: &Tensor<2>) -> Tensor<2> {
        Tensor::from_data(WEIGHTS, &like.device())
    }

    #[test]
    fn sample_lies_on_the_simplex_and_equals_the_host_draw() {
        let plain = sample(Tensor::from_data(ALPHA, &Device::default()), &mut rng());
        let tracked = sample(
            Tensor::from_data(ALPHA, &Device::default().autodiff()),
            &mut rng(),
        );
        let mut rng = rng();
        let host: Vec<f64> = ALPHA
            .iter()
            .flat_map(|row| dirichlet::sample(&row.map(f64::from), &mut rng))
            .collect();
        assert_close(&doubles(plain.log_action), &host, 1e-6);
        assert_close(&doubles(tracked.log_action.inner()), &host, 1e-6);
        assert!(
            doubles(plain.action.sum_dim(1))
                .iter()
                .all(|sum| (sum - 1.0).abs() < 1e-6)
        );
    }

    #[test]
    fn gradient_of_a_sample_is_the_implicit_one() {
        let mut stream = rng();
        let got = gradient(ALPHA, |alpha| {
            let weights = weights(&alpha);
            sample(alpha, &mut stream).action * weights
        });
        let mut stream = rng();
        let host = |(alpha, weights): (&[f32; 3], &[f32; 3])| {
            let draw = dirichlet::sample_with_gradient(&alpha.map(f64::from), &mut stream);
            let upstream: Vec<f64> = draw
                .action()
                .iter()
                .zip(weights)
                .map(|(a, w)| a * f64::from(*w))
                .collect();
            draw.gradient(&upstream)
        };
        let want: Vec<f64> = ALPHA.iter().zip(&WEIGHTS).flat_map(host).collect();
        for (got, want) in got.iter().zip(&want) {
            assert!(
                (got - want).abs() <= 1e-4 * want.abs() + 1e-7,
                "{got}, not {want}"
            );
        }
    }

    #[test]
    fn log_density_has_the_gradient_of_its_differences() {
        let log_action = [
            [0.2_f32.ln(), 0.3_f32.ln(), 0.5_f32.ln()],
            [0.9_f32.ln(), 0.04_f32.ln(), 0.06_f32.ln()],
        ];
        let in_alpha = |alpha: Tensor<2>| {
            let log_action = Tensor::from_data(log_action, &alpha.device());
            log_density(alpha, log_action)
        };
        let in_action =
            |log_action: Tensor<2>| log_density(Tensor::from_data(ALPHA, &log_action.device()), log_action);
        assert_close(&gradient(ALPHA, in_alpha), &differences(ALPHA, in_alpha), 2e-3);
        assert_close(
            &gradient(log_action, in_action),
            &differences(log_action, in_action),
            2e-3,
        );
    }

    #[test]
    fn entropy_has_the_gradient_of_its_differences() {
        assert_close(&gradient(ALPHA, entropy), &differences(ALPHA, entropy), 2e-3);
        let host: Vec<f64> = ALPHA
            .iter()
            .map(|row| dirichlet::entropy(&row.map(f64::from)))
            .collect();
        assert_close(
            &doubles(entropy(Tensor::from_data(ALPHA, &Device::default()))),
            &host,
            1e-6,
        );
    }

    #[test]
    fn a_plain_action_is_a_constant_of_a_tracked_density() {
        let log_action = Tensor::<2>::from_data(
            [[0.2_f32.ln(), 0.3_f32.ln(), 0.5_f32.ln()]; 2],
            &Device::default(),
        );
        let got = gradient(ALPHA, |alpha| log_density(alpha, log_action.clone()));
        let logs = [0.2_f32, 0.3, 0.5].map(|a| f64::from(a.ln()));
        let host = |row: &[f32; 3]| dirichlet::log_density_gradient(&row.map(f64::from), &logs);
        assert_close(&got, &ALPHA.iter().flat_map(host).collect::<Vec<f64>>(), 1e-5);
    }

    /// The entropy is minus the mean log density, so minus the log density of draws, differentiated through
    /// both of its arguments, has the entropy's gradient as its mean.
    #[test]
    fn pathwise_gradient_of_the_log_density_is_the_entropys() {
        let (alpha, batch) = ([2.0, 0.8, 4.0], 20_000);
        let device = Device::default().autodiff();
        let input = Tensor::<2>::from_data([[2.0, 0.8, 4.0]], &device).require_grad();
        let repeated = input.clone().repeat_dim(0, batch);
        let draw = sample(repeated.clone(), &mut rng());
        let loss = log_density(repeated, draw.log_action).mean().neg();
        let got = doubles(input.grad(&loss.backward()).unwrap());
        for (got, want) in got.iter().zip(dirichlet::entropy_gradient(&alpha)) {
            assert!((got - want).abs() < 0.02, "{got}, not {want}");
        }
    }
}
