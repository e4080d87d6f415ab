//! Ticks of an axis: their places and their texts.

/// A tick: its place and its text, empty for one without text.
#[derive(Debug, Clone, PartialEq)]
pub struct Tick {
    /// Value on the axis, in its unit.
    pub value: f64,
    /// Text at the tick; empty for a tick without text.
    pub text: String,
}

/// Ticks at round values inside `low..=high`, about `wanted` of them.
#[must_use]
pub fn linear(low: f64, high: f64, wanted: usize) -> Vec<Tick> {
    let parts = f64::from(u32::try_from(wanted.max(1)).unwrap_or(1));
    // The largest numbers are further apart than the type can represent.
    let part = Some((high - low) / parts).filter(|part| part.is_finite());
    let step = round_step(part.unwrap_or_else(|| high / parts - low / parts));
    let (first, last) = ((low / step - 1e-9).ceil(), (high / step + 1e-9).floor());
    let most = u32::try_from(wanted).unwrap_or(u32::MAX).saturating_mul(2);
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a few ticks"
    )]
    let count = ((last - first) as u32).min(most);
    let values: Vec<f64> = (0..=count)
        .map(|index| (first + f64::from(index)) * step)
        .filter(|value| value.is_finite())
        .collect();
    let largest = values
        .iter()
        .fold(0.0, |largest: f64, value| largest.max(value.abs()));
    values
        .into_iter()
        .map(|value| Tick {
            value,
            text: write(value, step, largest),
        })
        .collect()
}

/// Ticks of a logarithmic axis between two positive numbers: powers of ten with text, and 2 to 9 between them. The
/// ticks at 2 and 5 have text if few powers are in range, and all of them do if two texts would still be missing. An
/// axis with fewer than two such ticks has round steps. If many powers are in range, there are no ticks between them;
/// if very many are, only those with text have ticks.
#[must_use]
pub fn logarithmic(low: f64, high: f64, wanted: usize) -> Vec<Tick> {
    const EVERY_DIGIT: [i32; 9] = [1, 2, 3, 4, 5, 6, 7, 8, 9];
    const ROUND: &[i32] = &[1, 2, 5];
    let span = exponent(high) - exponent(low);
    let skip = round_skip(span / i32::try_from(wanted.max(1)).unwrap_or(1) + 1);
    let skips = std::iter::successors(Some(skip), |skip| (*skip >= 10).then_some(skip / 2));
    skips
        .map(|skip| (skip, ROUND))
        .chain([(1, ROUND), (1, &EVERY_DIGIT)])
        .map(|(skip, named)| of_decades(low, high, skip, named))
        .find(|ticks| ticks.iter().filter(|tick| !tick.text.is_empty()).count() >= 2)
        .unwrap_or_else(|| linear(low, high, wanted.max(FEWEST_STEPS)))
}

/// Number of powers of ten from one text to the next, rounded if it is large.
fn round_skip(skip: i32) -> i32 {
    const ROUND: [i32; 6] = [10, 20, 50, 100, 200, 500];
    if skip < ROUND[0] {
        return skip;
    }
    ROUND.into_iter().find(|round| *round >= skip).unwrap_or(skip)
}

#[allow(clippy::cast_possible_truncation, reason = "exponents of finite numbers")]
fn exponent(value: f64) -> i32 {
    value.log10().floor() as i32
}

/// Least number of steps to aim for, so that at least two ticks lie inside any range.
const FEWEST_STEPS: usize = 6;

/// Number of powers of ten beyond which there are no ticks between them.
const MOST_DIVIDED: i32 = 20;
/// Number of powers of ten beyond which only those with text have ticks.
const MOST_POWERS: i32 = 60;

/// Ticks at the digits of each power of ten, with text at every `skip`th power, and at the `named` digits if few powers
/// are in range.
fn of_decades(low: f64, high: f64, skip: i32, named: &[i32]) -> Vec<Tick> {
    let (first, last) = (exponent(low), exponent(high));
    let digits = if last - first > MOST_DIVIDED { 1 } else { 9 };
    let has_tick = |exponent: &i32| last - first <= MOST_POWERS || exponent % skip == 0;
    let few = last - first < 2;
    let plain = first >= -2 && last <= 3;
    let text = |digit, exponent| match digit {
        1 if exponent % skip == 0 => power(digit, exponent, plain),
        2..=9 if few && named.contains(&digit) => power(digit, exponent, plain),
        _ => String::new(),
    };
    (first..=last)
        .filter(has_tick)
        .flat_map(|exponent| (1..=digits).map(move |digit| (digit, exponent)))
        .map(|(digit, exponent)| Tick {
            value: f64::from(digit) * power_of_ten(exponent),
            text: text(digit, exponent),
        })
        .filter(|tick| tick.value.is_finite())
        .filter(|tick| (low * (1.0 - 1e-9)..=high * (1.0 + 1e-9)).contains(&tick.value))
        .collect()
}

/// A power of ten; includes the smallest ones, whose inverse is no finite number.
fn power_of_ten(exponent: i32) -> f64 {
    if exponent < -300 {
        10f64.powf(f64::from(exponent))
    } else {
        10f64.powi(exponent)
    }
}

/// The next of 1, 2, 2.5, 5 and 10 times a power of ten, or one that is only a little smaller.
fn round_step(step: f64) -> f64 {
    let power = 10f64.powf(step.log10().floor());
    let factor = [1.0, 2.0, 2.5, 5.0, 10.0]
        .into_iter()
        .take_while(|factor| (factor * power).is_finite())
        .find(|factor| factor * power >= 0.85 * step);
    factor.unwrap_or(1.0) * power
}

/// Writes a tick with the digits that the step needs; `largest` is the largest value on the axis.
fn write(value: f64, step: f64, largest: f64) -> String {
    let (divisor, suffix) = match largest {
        _ if largest >= 1e9 || (largest > 0.0 && largest < 1e-3) => return scientific(value, step, largest),
        _ if largest >= 1e6 => (1e6, "M"),
        _ if largest >= 1e4 => (1e3, "k"),
        _ => (1.0, ""),
    };
    if value == 0.0 {
        "0".into()
    } else {
        format!("{}{suffix}", minus(&fixed(value / divisor, step / divisor)))
    }
}

fn scientific(value: f64, step: f64, largest: f64) -> String {
    if value.abs() < step / 2.0 {
        return "0".into();
    }
    let exponent = largest.log10().floor();
    let unit = 10f64.powf(exponent);
    #[allow(clippy::cast_possible_truncation, reason = "exponent of a finite number")]
    let power = superscript(exponent as i32);
    format!("{}×10{power}", minus(&fixed(value / unit, step / unit)))
}

/// Largest number of decimal places of a tick.
const MOST_DECIMALS: i32 = 15;

fn fixed(value: f64, step: f64) -> String {
    // 2.5 needs one more digit than its power of ten.
    let decimals = (0..=MOST_DECIMALS)
        .find(|decimals| is_whole(step * 10f64.powi(*decimals)))
        .unwrap_or(MOST_DECIMALS);
    format!("{value:.*}", usize::try_from(decimals).unwrap_or(0))
}

fn is_whole(number: f64) -> bool {
    (number - number.round()).abs() < 1e-6 * number.abs().max(1e-9)
}

fn power(digit: i32, exponent: i32, plain: bool) -> String {
    match digit {
        _ if plain => minus(&fixed(
            f64::from(digit) * 10f64.powi(exponent),
            10f64.powi(exponent),
        )),
        1 => format!("10{}", superscript(exponent)),
        _ => format!("{digit}×10{}", superscript(exponent)),
    }
}

fn superscript(exponent: i32) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let raise = |c: char| c.to_digit(10).map_or('⁻', |digit| DIGITS[digit as usize]);
    exponent.to_string().chars().map(raise).collect()
}

fn minus(text: &str) -> String {
    text.replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::axes::Range;
    use proptest::prelude::*;

    fn texts(ticks: &[Tick]) -> Vec<&str> {
        ticks
            .iter()
            .map(|tick| tick.text.as_str())
            .filter(|text| !text.is_empty())
            .collect()
    }

    #[test]
    fn linear_ticks_are_short() {
        assert_eq!(texts(&linear(0.0, 60_000.0, 4)), ["0", "20k", "40k", "60k"]);
        assert_eq!(texts(&linear(0.0, 1.0, 4)), ["0", "0.25", "0.50", "0.75", "1.00"]);
        assert_eq!(texts(&linear(-0.1, 0.31, 4)), ["−0.1", "0", "0.1", "0.2", "0.3"]);
        assert_eq!(texts(&linear(0.0, 3e6, 3)), ["0", "1M", "2M", "3M"]);
        assert_eq!(
            texts(&linear(0.0, 4e-5, 4)),
            ["0", "1×10⁻⁵", "2×10⁻⁵", "3×10⁻⁵", "4×10⁻⁵"]
        );
        assert_eq!(
            texts(&linear(12.0, 14.0, 4)),
            ["12.0", "12.5", "13.0", "13.5", "14.0"]
        );
    }

    #[test]
    fn logarithmic_ticks_are_powers_of_ten() {
        assert_eq!(
            texts(&logarithmic(1e-5, 1.0, 6)),
            ["10⁻⁵", "10⁻⁴", "10⁻³", "10⁻²", "10⁻¹", "10⁰"]
        );
        assert_eq!(texts(&logarithmic(1.0, 12.0, 6)), ["1", "2", "5", "10"]);
    }

    #[test]
    fn a_logarithmic_axis_is_marked_twice_however_short() {
        assert_eq!(texts(&logarithmic(1.6, 6.1, 6)), ["2", "5"]);
        assert_eq!(texts(&logarithmic(2.1, 6.1, 6)), ["3", "4", "5", "6"]);
        assert_eq!(texts(&logarithmic(2.1, 2.9, 6)), ["2.2", "2.4", "2.6", "2.8"]);
    }

    /// Numbers of any size, including the largest and the smallest ones.
    fn extreme() -> impl Strategy<Value = f64> {
        prop_oneof![
            any::<f64>().prop_filter("finite", |value| value.is_finite()),
            (-308i32..309, -9.99f64..9.99).prop_map(|(exponent, digits)| digits * 10f64.powi(exponent)),
            prop::sample::select(vec![
                0.0,
                f64::MAX,
                f64::MIN,
                f64::MIN_POSITIVE,
                5e-324,
                1e-308,
                1e308
            ]),
        ]
        .prop_filter("finite", |value| value.is_finite())
    }

    fn few_and_finite(ticks: &[Tick], wanted: usize) -> Result<(), TestCaseError> {
        prop_assert!(ticks.len() <= (2 * wanted + 2).max(200), "{} ticks", ticks.len());
        prop_assert!(ticks.iter().all(|tick| tick.value.is_finite()), "{ticks:?}");
        let texts = texts(ticks);
        prop_assert!(texts.len() <= (2 * wanted + 2).max(20), "{texts:?}");
        prop_assert!(
            texts
                .iter()
                .all(|text| text.len() < 40 && !text.contains("NaN") && !text.contains("inf")),
            "{texts:?}"
        );
        Ok(())
    }

    #[test]
    fn a_logarithmic_axis_over_all_numbers_has_as_many_ticks_as_fit() {
        let ticks = logarithmic(5e-324, f64::MAX, 5);
        assert!((3..=7).contains(&ticks.len()), "{ticks:?}");
        assert!(ticks.iter().all(|tick| !tick.text.is_empty()));
        let ticks = logarithmic(1e-15, 1e15, 6);
        assert_eq!((ticks.len(), texts(&ticks).len()), (31, 5));
    }

    proptest! {
        #[test]
        fn every_axis_has_few_ticks_at_finite_places(values in prop::collection::vec(extreme(), 1..6), log: bool, wanted in 1usize..12) {
            let range = Range::around(values.into_iter(), log, 0.06);
            prop_assert!(range.low.is_finite() && range.high.is_finite() && range.low < range.high, "{range:?}");
            let ticks = if log { logarithmic(range.low, range.high, wanted) } else { linear(range.low, range.high, wanted) };
            few_and_finite(&ticks, wanted)?;
            for tick in &ticks {
                prop_assert!((0.0..=1.0).contains(&range.part(tick.value)));
            }
        }

        #[test]
        fn ticks_lie_in_range_and_are_few(low in -1e6f64..1e6, width in 1e-3f64..1e6, wanted in 2usize..9) {
            let ticks = linear(low, low + width, wanted);
            prop_assert!(!ticks.is_empty() && ticks.len() <= wanted + 2);
            let slack = width * 1e-6;
            prop_assert!(ticks.iter()
                .all(|tick| tick.value >= low - slack && tick.value <= low + width + slack));
        }

        #[test]
        fn logarithmic_ticks_lie_in_range_and_two_are_named(low in 1e-6f64..1e6, factor in 1.01f64..1e9, wanted in 2usize..9) {
            let ticks = logarithmic(low, low * factor, wanted);
            prop_assert!(texts(&ticks).len() >= 2, "{ticks:?}");
            let slack = low * factor * 1e-6;
            prop_assert!(ticks.iter()
                .all(|tick| tick.value >= low - slack && tick.value <= low * factor + slack));
        }
    }
}
