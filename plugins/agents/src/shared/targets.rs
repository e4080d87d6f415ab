//! Targets of critics, and the loss between critics and targets.

use burn::tensor::Tensor;
use numerics::network::values;

/// `r + gamma (1 - d) v`; all tensors `[batch, 1]`, `continues` is `1 - d`.
#[must_use]
pub fn bootstrapped(rewards: Tensor<2>, continues: Tensor<2>, value: Tensor<2>, discount: f64) -> Tensor<2> {
    rewards + continues * value * discount
}

/// Mean of `(q - target)^2 / 2` over the batch, `[1]` (thesis, eq. 3.16).
#[must_use]
pub fn half_squared_error(q: Tensor<2>, target: Tensor<2>) -> Tensor<1> {
    (q - target).powf_scalar(2.0).mean() * 0.5
}

/// Mean of all entries, on the host.
#[must_use]
pub fn mean(x: Tensor<2>) -> f32 {
    values(x.mean())[0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use numerics::network::matrix;

    fn column(values: &[f32]) -> Tensor<2> {
        matrix(values.to_vec(), 1)
    }

    #[test]
    fn a_terminal_step_has_no_value_behind_it() {
        // 1 + 0.9 * 1 * 10 and 1 + 0.9 * 0 * 10.
        let y = bootstrapped(
            column(&[1.0, 1.0]),
            column(&[1.0, 0.0]),
            column(&[10.0, 10.0]),
            0.9,
        );
        assert_eq!(values(y), [10.0, 1.0]);
    }

    #[test]
    fn the_critic_loss_by_hand() {
        // (0.5 * 4 + 0.5 * 16) / 2.
        assert_eq!(
            values(half_squared_error(column(&[1.0, 2.0]), column(&[3.0, 6.0]))),
            [5.0]
        );
        assert_eq!(mean(column(&[1.0, 2.0])), 1.5);
    }
}
