//! Plain and dual numbers, and their elementary functions.
//!
//! The methods of these names of dual numbers call the C library, so values and slopes are those of
//! [`arithmetic`], joined by the chain rule. Sums, products, quotients and square roots of dual numbers have the same
//! bits everywhere.

use arithmetic::{double, power};
use num_dual::{DualNum, DualSVec64};

/// A number with or without derivatives.
pub(super) trait Number: DualNum<f64> + Copy {
    /// The value of a function at this number, whose slope there is `slope`.
    fn through(self, value: f64, slope: f64) -> Self;
}

impl Number for f64 {
    fn through(self, value: f64, _slope: f64) -> Self {
        value
    }
}

impl<const N: usize> Number for DualSVec64<N> {
    fn through(self, value: f64, slope: f64) -> Self {
        Self::new(value, self.eps * slope)
    }
}

/// Exponential function.
pub(super) fn exp<T: Number>(x: T) -> T {
    let value = double::exp(x.re());
    x.through(value, value)
}

/// Natural logarithm.
pub(super) fn ln<T: Number>(x: T) -> T {
    x.through(double::ln(x.re()), 1.0 / x.re())
}

/// Logarithm `ln(1 + x)`.
pub(super) fn ln_1p<T: Number>(x: T) -> T {
    x.through(double::ln_1p(x.re()), 1.0 / (1.0 + x.re()))
}

/// Power of a positive number.
pub(super) fn pow<T: Number>(x: T, exponent: f64) -> T {
    let value = power::pow(x.re(), exponent);
    x.through(value, exponent * value / x.re())
}

#[cfg(test)]
mod tests {
    use super::*;
    use num_dual::Derivative;

    /// Compares with the functions of the library of dual numbers.
    #[test]
    fn values_and_slopes_are_those_of_dual_numbers() {
        let at = |x: f64| {
            let mut x = DualSVec64::<2>::from(x);
            x.eps = Derivative::derivative_generic(nalgebra::Const::<2>, nalgebra::U1, 1);
            x * 3.0
        };
        for x in [0.01, 0.4, 1.0, 7.5] {
            for (got, want) in [
                (exp(at(x)), at(x).exp()),
                (ln(at(x)), at(x).ln()),
                (ln_1p(at(x)), at(x).ln_1p()),
                (pow(at(x), 1.7), at(x).powf(1.7)),
            ] {
                let slopes = [got, want].map(|it| it.eps.unwrap_generic(nalgebra::Const::<2>, nalgebra::U1));
                assert!((got.re - want.re).abs() <= 1e-15 * want.re.abs(), "{got} {want}");
                assert_eq!((slopes[0][0], slopes[1][0]), (0.0, 0.0));
                assert!((slopes[0][1] / slopes[1][1] - 1.0).abs() < 1e-15, "{got} {want}");
            }
            assert_eq!(pow(x, 1.7), pow(at(x / 3.0), 1.7).re);
        }
    }
}
