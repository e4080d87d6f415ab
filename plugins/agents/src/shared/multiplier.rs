//! A positive weight that is learned by its logarithm, such as the temperature of an entropy or the
//! multiplier of a constraint.

use numerics::optimizer::ScalarAdam;
use serde::{Deserialize, Serialize};

/// A positive weight with its optimiser.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Multiplier {
    logarithm: f64,
    adam: ScalarAdam,
}

impl Multiplier {
    /// A weight that starts at `first` and is moved by Adam with this learning rate.
    #[must_use]
    pub fn new(first: f64, learning_rate: f64) -> Self {
        Self {
            logarithm: first.ln(),
            adam: ScalarAdam::new(learning_rate),
        }
    }

    /// Current value, above 0.
    #[must_use]
    pub fn value(&self) -> f64 {
        self.logarithm.exp()
    }

    /// Takes one gradient step of the logarithm up the product `logarithm * excess`: the weight rises where
    /// `excess` is positive.
    pub fn rise_with(&mut self, excess: f64) {
        self.logarithm = self.adam.step(self.logarithm, -excess);
    }

    /// Changes the learning rate from the next step on.
    pub fn set_learning_rate(&mut self, learning_rate: f64) {
        self.adam.set_learning_rate(learning_rate);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first step of Adam has the size of the learning rate for any gradient.
    #[test]
    fn it_rises_with_an_excess_and_stays_above_zero() {
        let mut weight = Multiplier::new(0.5, 0.1);
        weight.rise_with(3.0);
        assert!((weight.value() - 0.5 * 0.1f64.exp()).abs() < 1e-8);
        (0..200).for_each(|_| weight.rise_with(-3.0));
        assert!(weight.value() > 0.0 && weight.value() < 1e-6);
        let before = weight.value();
        weight.set_learning_rate(0.0);
        weight.rise_with(3.0);
        assert_eq!(weight.value(), before);
    }

    /// The product that it ascends has the slope `excess` in the logarithm.
    #[test]
    fn its_gradient_agrees_with_finite_differences() {
        let excess = -0.7;
        let product = |logarithm: f64| logarithm * excess;
        let slope = (product(0.3 + 1e-3) - product(0.3 - 1e-3)) / 2e-3;
        let (mut weight, mut adam) = (Multiplier::new(2.0, 0.01), ScalarAdam::new(0.01));
        let mut logarithm = 2.0f64.ln();
        for _ in 0..3 {
            weight.rise_with(excess);
            logarithm = adam.step(logarithm, -slope);
        }
        assert!((weight.value().ln() - logarithm).abs() < 1e-9);
    }
}
