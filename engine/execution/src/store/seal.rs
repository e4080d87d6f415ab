//! A checksum at the end of a JSON object, with which a changed bit anywhere in the file is noticed.

use contract::digest::{self, LENGTH};

const BEFORE: &[u8] = b",\"check\":\"";
const AFTER: &[u8] = b"\"}";

/// Adds the key `check` to the text of a JSON object: a hash of everything before it.
pub(super) fn sealed(mut object: Vec<u8>) -> Vec<u8> {
    // The closing brace comes after the checksum.
    object.pop();
    let check = digest::of_bytes(&object);
    object.extend([BEFORE, check.as_bytes(), AFTER].concat());
    object
}

/// Whether the text is as [`sealed`] made it.
pub(super) fn is_sealed(text: &[u8]) -> bool {
    before_check(text).is_some()
}

/// The text of the object that was [`sealed`]; `None` if the checksum does not match.
pub(super) fn unsealed(text: &[u8]) -> Option<Vec<u8>> {
    before_check(text).map(|object| [object, b"}"].concat())
}

/// The text before a matching checksum.
fn before_check(text: &[u8]) -> Option<&[u8]> {
    let tail = BEFORE.len() + LENGTH + AFTER.len();
    let (object, tail) = text.len().checked_sub(tail).map(|length| text.split_at(length))?;
    (tail == [BEFORE, digest::of_bytes(object).as_bytes(), AFTER].concat()).then_some(object)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn any_changed_bit_breaks_the_seal(place in 0.0..1.0f64, bit in 0u8..8) {
            let mut text = sealed(br#"{"schema":2,"end":{"state":"ok","wall_s":0.25}}"#.to_vec());
            prop_assert!(is_sealed(&text));
            prop_assert!(serde_json::from_slice::<serde_json::Value>(&text).is_ok());
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss,
                reason = "a place in the text")]
            let index = (place * text.len() as f64) as usize;
            text[index] ^= 1 << bit;
            prop_assert!(!is_sealed(&text));
        }
    }
}
