//! Errors in units in the last place: the spacing of numbers at the exact value, denormal ones included.

/// Error of an `f32` against an exact value in `f64`; zero if both are infinite of one sign or both are NaN.
#[must_use]
pub fn of_single(got: f32, exact: f64) -> f64 {
    let (largest, limit) = (
        f64::from(f32::MAX),
        f64::from(f32::MAX) * (1.0 + 0.25 * f64::from(f32::EPSILON)),
    );
    if exact.is_nan() || got.is_nan() {
        return if exact.is_nan() && got.is_nan() {
            0.0
        } else {
            f64::INFINITY
        };
    }
    if got.is_infinite() || exact.abs() > limit {
        let is_right = got.is_infinite() && exact.abs() >= largest && f64::from(got) * exact > 0.0;
        return if is_right { 0.0 } else { f64::INFINITY };
    }
    let exponent = (exact.to_bits() >> 52 & 0x7ff).max(1023 - 126);
    let unit = f64::from_bits((exponent - 23) << 52);
    (f64::from(got) - exact).abs() / unit
}

/// Error of an `f64` against the sum `high + low`; `high` is the `f64` nearest to it.
#[must_use]
pub fn of_double(got: f64, high: f64, low: f64) -> f64 {
    let exponent = high.to_bits() >> 52 & 0x7ff;
    // The unit times 2^1000 for small values, so that it is representable; 2^-1074 is the unit of denormal
    // numbers.
    let scale = if exponent < 100 {
        f64::from_bits(2023 << 52)
    } else {
        1.0
    };
    let unit = if exponent < 100 {
        f64::from_bits((exponent.max(1) - 1 + 1023 - 74) << 52)
    } else {
        f64::from_bits((exponent - 52) << 52)
    };
    (((got - high) * scale) - low * scale).abs() / unit
}

/// One line of `fixtures/values.txt`: the name of a function, its arguments, and the value as a sum of two numbers.
#[must_use]
pub fn parse(line: &str) -> Option<(&str, [f64; 4])> {
    let mut words = line.split_whitespace();
    let name = words.next()?;
    let mut numbers = [0.0; 4];
    for number in &mut numbers {
        *number = f64::from_bits(u64::from_str_radix(words.next()?, 16).ok()?);
    }
    Some((name, numbers))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_by_hand() {
        assert_eq!(of_single(1.0 + f32::EPSILON, 1.0), 1.0);
        assert_eq!(of_single(f32::from_bits(3), f64::from(f32::from_bits(1))), 2.0);
        assert_eq!(of_single(f32::INFINITY, 1e39), 0.0);
        assert_eq!(of_single(f32::MAX, 1e39), f64::INFINITY);
        assert_eq!(of_single(f32::NAN, 1.0), f64::INFINITY);
        assert_eq!(of_double(1.0 + f64::EPSILON, 1.0, 0.25 * f64::EPSILON), 0.75);
        assert_eq!(of_double(f64::from_bits(5), f64::from_bits(3), 0.0), 2.0);
        let small = f64::MIN_POSITIVE * 4.0;
        assert_eq!(of_double(f64::from_bits(small.to_bits() + 3), small, 0.0), 3.0);
    }
}
