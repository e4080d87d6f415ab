//! Digests, by which files are known.

use std::io::{self, Read};

/// Letters of a digest.
pub const LENGTH: usize = 32;

/// The first 32 hexadecimal digits of a BLAKE3 hash.
#[must_use]
pub fn of_bytes(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex()[..LENGTH].to_string()
}

/// The digest of a file, read piece by piece: it may be larger than memory.
///
/// # Errors
/// Where it cannot be read.
pub fn of_file(file: impl Read) -> io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(file)?;
    Ok(hasher.finalize().to_hex()[..LENGTH].to_string())
}
