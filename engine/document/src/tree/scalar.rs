//! Values of plain scalars by the core schema of YAML 1.2.2, section 10.3.2.

use super::Scalar;
use serde_json::{Number, Value};

/// A scalar of the document; only a text without quotes can be a number, a truth value or null.
pub fn scalar(text: String, plain: bool) -> Scalar {
    let value = if plain {
        core_schema(&text)
    } else {
        Value::String(text.clone())
    };
    Scalar { text, plain, value }
}

/// Numbers that are not finite stay text, since no key of a study accepts one.
fn core_schema(text: &str) -> Value {
    match text {
        "" | "~" | "null" | "Null" | "NULL" => Value::Null,
        "true" | "True" | "TRUE" => Value::Bool(true),
        "false" | "False" | "FALSE" => Value::Bool(false),
        _ => plain_number(text).map_or_else(|| Value::String(text.into()), Value::Number),
    }
}

/// The number that a text would be without quotes.
#[must_use]
pub fn plain_number(text: &str) -> Option<Number> {
    if let Some(digits) = text.strip_prefix("0x") {
        return u64::from_str_radix(digits, 16)
            .ok()
            .filter(|_| !digits.starts_with('+'))
            .map(Number::from);
    }
    if let Some(digits) = text.strip_prefix("0o") {
        return u64::from_str_radix(digits, 8)
            .ok()
            .filter(|_| !digits.starts_with('+'))
            .map(Number::from);
    }
    let unsigned = text.strip_prefix(['+', '-']).unwrap_or(text);
    let mantissa = unsigned.split(['e', 'E']).next().unwrap_or_default();
    let digits = |part: &str| part.bytes().all(|byte| byte.is_ascii_digit());
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    if !digits(whole) || !digits(fraction) || whole.is_empty() && fraction.is_empty() {
        return None;
    }
    if digits(unsigned) {
        let signed = text.strip_prefix('+').unwrap_or(text);
        let whole = signed
            .parse::<u64>()
            .map(Number::from)
            .or_else(|_| signed.parse::<i64>().map(Number::from));
        return whole
            .ok()
            .or_else(|| signed.parse::<f64>().ok().and_then(Number::from_f64));
    }
    text.parse::<f64>().ok().and_then(Number::from_f64)
}
