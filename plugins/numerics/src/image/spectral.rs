//! Division of a weight by its largest singular value, as one autodiff operation.
//!
//! Miyato et al. 2018, "Spectral normalization for generative adversarial networks", arXiv:1802.05957,
//! algorithm 1.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | W | `weight`, its last dimension the outputs | `[.., outputs]`, as a matrix `[rows, outputs]` |
//! | u, v | [`SingularVectors`] | `[outputs]`, `[rows]` |
//! | sigma(W) | `v^T W u` | scalar |
//!
//! The paper's matrix is the transposed one, so its `u` belongs to the outputs here too. One step of power
//! iteration is `v = W u / |W u|`, `u = W^T v / |W^T v|`. Both are constants of the graph (as in PyTorch, and
//! by appendix A of the paper exact where they have converged). Backward, with `y = W / sigma`: `dW = (dy -
//! (sum of dy y) v u^T) / sigma`.

use super::operation::{Operation, PlainTensor, host, of_one};
use super::widest;
use burn::Tensor;
use burn::tensor::TensorData;
use std::sync::Arc;

/// Smallest length by which a vector is divided, so that a zero vector stays finite (PyTorch's default).
const EPSILON: f32 = 1e-12;

/// Estimates of the singular vectors of the largest singular value.
#[derive(Debug, Clone, PartialEq)]
pub struct SingularVectors {
    /// `u`, one number per output.
    pub of_outputs: Vec<f32>,
    /// `v`, one number per row of the weight as a matrix.
    pub of_rows: Vec<f32>,
}

impl SingularVectors {
    /// Takes one step of power iteration from `u` for `weight` `[.., outputs]`.
    ///
    /// # Panics
    /// Where the vectors do not have the numbers of outputs and rows of the weight.
    pub fn iterate<const D: usize>(&mut self, weight: &Tensor<D>) {
        let weight = crate::network::values(weight.clone());
        assert_eq!(
            weight.len(),
            self.of_outputs.len() * self.of_rows.len(),
            "a weight of as many rows and outputs as there are entries of the vectors"
        );
        self.of_rows = unit(times(&weight, &self.of_outputs));
        self.of_outputs = unit(transposed_times(&weight, &self.of_rows));
    }
}

/// Weight `[.., outputs]` divided by `v^T W u`.
///
/// # Panics
/// Where the vectors do not have the numbers of outputs and rows of the weight.
#[must_use]
pub fn normalised<const D: usize>(weight: Tensor<D>, vectors: &SingularVectors) -> Tensor<D> {
    of_one(weight, Arc::new(SpectralDivision(vectors.clone())))
}

/// Dot product in eight interleaved chains for every width of vectors, then their sum in order.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut chains = [0.0; 8];
    let (left, right) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f32 = left
        .remainder()
        .iter()
        .zip(right.remainder())
        .map(|(a, b)| a * b)
        .sum();
    for (a, b) in left.zip(right) {
        for (chain, (a, b)) in chains.iter_mut().zip(a.iter().zip(b)) {
            *chain += a * b;
        }
    }
    chains.iter().sum::<f32>() + rest
}

/// Product `W u`.
fn times(weight: &[f32], u: &[f32]) -> Vec<f32> {
    weight.chunks_exact(u.len()).map(|row| dot(row, u)).collect()
}

/// Product `W^T v`.
fn transposed_times(weight: &[f32], v: &[f32]) -> Vec<f32> {
    let n_outputs = weight.len() / v.len();
    let mut product = vec![0.0; n_outputs];
    for (row, v) in weight.chunks_exact(n_outputs).zip(v) {
        product.iter_mut().zip(row).for_each(|(sum, w)| *sum += w * v);
    }
    product
}

fn unit(mut vector: Vec<f32>) -> Vec<f32> {
    let length = dot(&vector, &vector).sqrt().max(EPSILON);
    vector.iter_mut().for_each(|x| *x /= length);
    vector
}

#[derive(Debug)]
struct SpectralDivision(SingularVectors);

impl Operation for SpectralDivision {
    fn forward(&self, inputs: Vec<PlainTensor>) -> (PlainTensor, Vec<PlainTensor>) {
        let SingularVectors { of_outputs, of_rows } = &self.0;
        let weight = inputs[0].storage::<f32>();
        assert_eq!(
            weight.len(),
            of_outputs.len() * of_rows.len(),
            "a weight of as many rows and outputs as there are entries of the vectors"
        );
        let sigma = dot(&times(weight, of_outputs), of_rows);
        let scaled = weight.iter().map(|w| w / sigma).collect();
        let output = PlainTensor::from_data(TensorData::new(scaled, inputs[0].layout().shape().clone()));
        (output.clone(), vec![output, host(vec![sigma], [1])])
    }

    fn backward(&self, kept: &[PlainTensor], upstream: &PlainTensor, _: &[bool]) -> Vec<Option<PlainTensor>> {
        let (y, dy, sigma) = (
            kept[0].storage::<f32>(),
            upstream.storage::<f32>(),
            kept[1].storage::<f32>()[0],
        );
        let (share, SingularVectors { of_outputs, of_rows }) = (dot(dy, y), &self.0);
        let dw = widest(
            #[inline(always)]
            || {
                let rows = dy.chunks_exact(of_outputs.len()).zip(of_rows);
                rows.flat_map(|(dy, v)| {
                    let factor = share * v;
                    dy.iter()
                        .zip(of_outputs)
                        .map(move |(dy, u)| (dy - factor * u) / sigma)
                })
                .collect()
            },
        );
        let shape = upstream.layout().shape().clone();
        vec![Some(PlainTensor::from_data(TensorData::new(dw, shape)))]
    }
}
