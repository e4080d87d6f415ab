//! Digests, which identify files.

use serde::Serialize;
use serde_json::Value;
use std::io::{self, Read};

/// Length of a digest, in hexadecimal digits.
pub const LENGTH: usize = 32;

/// The digest of some bytes: the first [`LENGTH`] hexadecimal digits of their BLAKE3 hash.
#[must_use]
pub fn of_bytes(bytes: &[u8]) -> String {
    of_hash(&blake3::hash(bytes))
}

/// The digest of bytes that were hashed piece by piece.
#[must_use]
pub fn of_hash(hash: &blake3::Hash) -> String {
    hash.to_hex()[..LENGTH].to_string()
}

/// The digest of a file, read piece by piece, since it may be larger than memory.
///
/// # Errors
/// It cannot be read.
pub fn of_file(file: impl Read) -> io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(file)?;
    Ok(of_hash(&hasher.finalize()))
}

/// Hash of a JSON value that does not depend on the order of keys.
#[must_use]
pub fn of_json(value: &Value) -> String {
    let mut text = Vec::new();
    write_canonical(value, &mut text);
    of_bytes(&text)
}

pub(crate) fn write_canonical(value: &Value, out: &mut Vec<u8>) {
    match value {
        Value::Object(map) => {
            let mut entries: Vec<_> = map.iter().collect();
            entries.sort_by_key(|(key, _)| *key);
            out.push(b'{');
            for (key, value) in entries {
                write_scalar(key, out);
                out.push(b':');
                write_canonical(value, out);
                out.push(b',');
            }
            out.push(b'}');
        }
        Value::Array(items) => {
            out.push(b'[');
            for item in items {
                write_canonical(item, out);
                out.push(b',');
            }
            out.push(b']');
        }
        scalar => write_scalar(scalar, out),
    }
}

pub(crate) fn write_scalar(scalar: &impl Serialize, out: &mut Vec<u8>) {
    // Neither a string nor a JSON value without children can fail to be written into memory.
    serde_json::to_writer(out, scalar).expect("a scalar is text");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_order_of_keys_does_not_reach_the_hash() {
        let (one, two) = (
            r#"{"a":1,"b":[2,{"c":3,"d":4}]}"#,
            r#"{"b":[2,{"d":4,"c":3}],"a":1}"#,
        );
        let parse = |text| serde_json::from_str::<Value>(text).unwrap();
        assert_eq!(of_json(&parse(one)), of_json(&parse(two)));
        assert_ne!(of_json(&parse("[1,2]")), of_json(&parse("[2,1]")));
    }
}
