//! Tests of functions of `f32` and `f64`.

use super::*;

/// Values with 40 digits (`fixtures/values.py`).
const VALUES: &str = include_str!("../../fixtures/values.txt");

/// Largest errors that the modules state, in units in the last place.
const STATED: [(&str, f64); 13] = [
    ("exp", 0.85),
    ("exp_m1", 1.5),
    ("ln", 0.8),
    ("ln_1p", 0.85),
    ("tanh", 2.6),
    ("sin", 0.8),
    ("cos", 0.8),
    ("pow", 0.9),
    ("ln_gamma", 3.0),
    ("digamma", 4.0),
    ("trigamma", 4.0),
    ("normal", 6.0),
    ("cdf", 6.6),
];

#[test]
fn double_functions_are_within_the_stated_errors() {
    let mut n_values = 0;
    for (name, [x, y, high, low]) in VALUES.lines().filter_map(errors::parse) {
        let got = match (name, DOUBLE.iter().find(|function| function.0 == name)) {
            (_, Some((_, function, _))) => function(x, y),
            ("cdf", None) => normal::cdf(x),
            _ => normal(x.to_bits()),
        };
        let stated = STATED
            .iter()
            .find(|stated| stated.0 == name)
            .expect("a stated error")
            .1;
        let error = errors::of_double(got, high, low);
        assert!(
            error <= stated,
            "{name}({x:e}, {y:e}) = {got:e}, not {high:e}: {error} units"
        );
        n_values += 1;
    }
    assert!(n_values > 1000);
}

/// Tests every 997th argument; the C library's `f64` is exact to a billionth of a unit of `f32`.
#[test]
#[allow(clippy::cast_possible_truncation, reason = "inputs are below 2^32")]
fn single_functions_are_within_the_stated_errors() {
    let logistic = |x: f64| 1.0 / (1.0 + (-x).exp());
    let softplus = |x: f64| (if x > 0.0 { x } else { 0.0 }) + (-x.abs()).exp().ln_1p();
    let exact: [(f64, fn(f64) -> f64); 6] = [
        (0.96, f64::exp),
        (0.83, f64::ln),
        (0.85, f64::ln_1p),
        (1.34, f64::tanh),
        (2.41, logistic),
        (1.65, softplus),
    ];
    for ((name, function), (stated, exact)) in SINGLE.into_iter().zip(exact) {
        for i in (0..=u32::MAX).step_by(997) {
            let x = f32::from_bits(i);
            let error = errors::of_single(function(x), exact(f64::from(x)));
            assert!(
                error <= stated,
                "{name}({x:e}) = {:e}: {error} units",
                function(x)
            );
        }
    }
}

#[test]
fn special_values_of_single_functions() {
    use single::{exp, ln, ln_1p, sigmoid, softplus, tanh};
    const INFINITY: f32 = f32::INFINITY;
    let bits = |x: f32, y: f32| assert_eq!(x.to_bits(), y.to_bits(), "{x} and {y}");
    for (_, function) in SINGLE {
        for not_a_number in [0x7fc0_0000, 0xffff_ffff, 0x7f80_0001] {
            bits(function(f32::from_bits(not_a_number)), single::NAN);
        }
    }
    for (function, below, above) in [
        (exp as fn(f32) -> f32, 0.0, INFINITY),
        (tanh, -1.0, 1.0),
        (sigmoid, 0.0, 1.0),
        (softplus, 0.0, INFINITY),
        (ln, single::NAN, INFINITY),
        (ln_1p, single::NAN, INFINITY),
    ] {
        bits(function(-INFINITY), below);
        bits(function(INFINITY), above);
    }
    for zero in [0.0, -0.0] {
        bits(exp(zero), 1.0);
        bits(ln(zero), -INFINITY);
        bits(ln_1p(zero), zero);
        bits(tanh(zero), zero);
        bits(sigmoid(zero), 0.5);
    }
    bits(ln(1.0), 0.0);
    bits(ln_1p(-1.0), -INFINITY);
    bits(ln(-1.0), single::NAN);
    bits(exp(-103.9), f32::from_bits(1));
    bits(exp(88.73), INFINITY);
}

#[test]
fn special_values_of_double_functions() {
    let bits = |x: f64, y: f64| assert_eq!(x.to_bits(), y.to_bits(), "{x} and {y}");
    const INFINITY: f64 = f64::INFINITY;
    for (_, function, _) in DOUBLE {
        bits(function(f64::from_bits(0xffff_0000_0000_0001), 2.0), double::NAN);
    }
    for (function, below, zero, above) in [
        (double::exp as fn(f64) -> f64, 0.0, 1.0, INFINITY),
        (double::exp_m1, -1.0, -0.0, INFINITY),
        (double::ln, double::NAN, -INFINITY, INFINITY),
        (double::ln_1p, double::NAN, -0.0, INFINITY),
        (double::tanh, -1.0, -0.0, 1.0),
        (trigonometry::sin, double::NAN, -0.0, double::NAN),
        (trigonometry::cos, double::NAN, 1.0, double::NAN),
        (gamma::ln_gamma, double::NAN, double::NAN, INFINITY),
        (gamma::digamma, double::NAN, double::NAN, INFINITY),
        (gamma::trigamma, double::NAN, double::NAN, 0.0),
    ] {
        bits(function(-INFINITY), below);
        bits(function(-0.0), zero);
        bits(function(INFINITY), above);
    }
    bits(double::ln(1.0), 0.0);
    bits(double::ln_1p(-1.0), -INFINITY);
    bits(double::exp(-745.1), f64::from_bits(1));
    bits(double::exp(709.79), INFINITY);
    assert_eq!([gamma::ln_gamma(1.0), gamma::ln_gamma(2.0)], [0.0; 2]);
    bits(trigonometry::sin(trigonometry::HALF_PI_HIGH), 1.0);
}

#[test]
fn special_values_of_the_normal_distribution() {
    let bits = |x: f64, y: f64| assert_eq!(x.to_bits(), y.to_bits(), "{x} and {y}");
    const INFINITY: f64 = f64::INFINITY;
    for (x, probability) in [(-INFINITY, 0.0), (0.0, 0.5), (INFINITY, 1.0)] {
        bits(normal::cdf(x), probability);
        bits(normal::quantile(probability), x);
    }
    bits(normal::cdf(-f64::NAN), double::NAN);
    for outside in [-0.1, 1.1, -f64::NAN] {
        bits(normal::quantile(outside), double::NAN);
    }
}

#[test]
fn many_quantiles_are_those_of_one_number() {
    let inside = (1..1000).map(|i| f64::from(i) / 1000.0);
    let ends = [0.0, 1e-300, 0.075, 0.925, 1.0, -0.1, f64::NAN];
    let probabilities: Vec<f64> = inside.chain(ends).collect();
    let mut quantiles = probabilities.clone();
    normal::quantiles(&mut quantiles);
    for (found, probability) in quantiles.into_iter().zip(probabilities) {
        assert_eq!(found.to_bits(), normal::quantile(probability).to_bits());
    }
}

/// Tests the special cases of IEEE 754 against the C library.
#[test]
fn powers_of_special_numbers_are_those_of_the_c_library() {
    let numbers = [
        0.0,
        1.0,
        2.0,
        3.0,
        0.5,
        1.5,
        1e-300,
        1e300,
        9_007_199_254_740_991.0,
        9_007_199_254_740_992.0,
        5e-324,
        f64::MAX,
        f64::INFINITY,
    ];
    let signed = || numbers.into_iter().flat_map(|x| [x, -x]).chain([f64::NAN]);
    for x in signed() {
        for y in signed() {
            let (got, want) = (power::pow(x, y), x.powf(y));
            let is_near = (got - want).abs() <= 1e-15 * want.abs();
            let is_same = got.to_bits() == want.to_bits() || got.is_nan() && want.is_nan();
            assert!(is_near || is_same, "{x:e} to {y:e}: {got:e}, not {want:e}");
            assert_eq!(
                got.is_sign_negative() && !got.is_nan(),
                want.is_sign_negative() && !want.is_nan()
            );
        }
    }
}

#[test]
fn whole_powers_by_hand() {
    assert_eq!(power::powi(3.0, 5), 243.0);
    assert_eq!(power::powi(-2.0, -3), -0.125);
    assert_eq!(power::powi(0.0, 0), 1.0);
    assert_eq!(power::powi(2.0, i32::MIN), 0.0);
    // The factors are x and x^4, from the lowest bit on.
    let x = 1.1;
    assert_eq!(power::powi(x, 5), x * ((x * x) * (x * x)));
}

#[test]
fn slices_have_the_bits_of_single_numbers() {
    let each: [fn(&mut [f32]); 6] = [
        slices::exp,
        slices::ln,
        slices::ln_1p,
        slices::tanh,
        slices::sigmoid,
        slices::softplus,
    ];
    for ((name, function), slice) in SINGLE.into_iter().zip(each) {
        for n in [0, 1, 7, 100_003] {
            #[allow(clippy::cast_possible_truncation, reason = "any bit pattern")]
            let inputs: Vec<f32> = (0..n).map(|i| f32::from_bits(mix(i) as u32)).collect();
            let mut values = inputs.clone();
            slice(&mut values);
            for (x, y) in inputs.into_iter().zip(values) {
                assert_eq!(function(x).to_bits(), y.to_bits(), "{name}({x:e})");
            }
        }
    }
}

proptest! {
    #[test]
    fn exp_and_ln_are_inverse(x in -80.0..80.0_f32, y in -700.0..700.0_f64) {
        prop_assert!((single::ln(single::exp(x)) - x).abs() <= 1e-7 * x.abs().max(2.0));
        prop_assert!((double::ln(double::exp(y)) - y).abs() <= 3e-16 * y.abs().max(1.0));
    }

    #[test]
    fn functions_rise(x in -90.0..90.0_f32, by in 1e-3..1.0_f32) {
        for function in [single::exp, single::tanh, single::sigmoid, single::softplus] {
            prop_assert!(function(x) <= function(x + by));
        }
    }

    #[test]
    fn odd_and_even_functions_are_so(x in any::<f64>()) {
        prop_assume!(!x.is_nan());
        prop_assert_eq!(double::tanh(-x).to_bits(), (-double::tanh(x)).to_bits());
        prop_assert_eq!(trigonometry::cos(-x).to_bits(), trigonometry::cos(x).to_bits());
        prop_assume!(x.is_finite());
        prop_assert_eq!(trigonometry::sin(-x).to_bits(), (-trigonometry::sin(x)).to_bits());
        let one = trigonometry::sin(x) * trigonometry::sin(x) + trigonometry::cos(x) * trigonometry::cos(x);
        prop_assert!((one - 1.0).abs() < 4e-16);
    }

    #[test]
    fn gamma_functions_obey_their_recurrences(exponent in -3.0..6.0_f64) {
        let x = power::pow(10.0, exponent);
        let close = |a: f64, b: f64, scale: f64| (a - b).abs() <= 2e-15 * scale.abs().max(1.0);
        let [ln_gamma, digamma, trigamma] =
            [gamma::ln_gamma, gamma::digamma, gamma::trigamma].map(|function| (function(x), function(x + 1.0)));
        prop_assert!(close(ln_gamma.1, ln_gamma.0 + double::ln(x), ln_gamma.0));
        prop_assert!(close(digamma.1, digamma.0 + 1.0 / x, 1.0 / x + double::ln(x)));
        prop_assert!(close(trigamma.1, trigamma.0 - 1.0 / (x * x), trigamma.0));
    }

    #[test]
    fn normal_quantiles_and_probabilities_are_inverse(exponent in -300.0..-0.31_f64) {
        let tail = power::pow(10.0, exponent);
        let x = normal::quantile(tail);
        // The relative slope of a tail at x is about |x|.
        prop_assert!((normal::cdf(x) / tail - 1.0).abs() < 2e-15 * (1.0 + x * x));
        // The difference 1 - tail is rounded by at most 2^-54, which is multiplied by the slope of the quantile, one
        // over the density.
        let slope = (0.5 * std::f64::consts::TAU.ln() + 0.5 * x * x).exp();
        let rounded = slope * 0.5_f64.powi(54);
        let off = (normal::quantile(1.0 - tail) + x).abs();
        prop_assert!(off < rounded + 1e-15 * (1.0 + x.abs()) || tail < 1e-3, "{tail:e}: {off:e}");
    }

    #[test]
    fn powers_of_powers_multiply(x in 0.01..100.0_f64, y in -10.0..10.0_f64) {
        let twice = power::pow(power::pow(x, y), 2.0);
        prop_assert!((twice / power::pow(x, 2.0 * y) - 1.0).abs() < 1e-15);
        prop_assert!((power::powi(x, 7) / power::pow(x, 7.0) - 1.0).abs() < 2e-15);
    }
}
