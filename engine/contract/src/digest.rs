//! Digests, by which files are known.

use std::io::{self, Read};

/// Letters of a digest.
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

/// The digest of a file, read piece by piece: it may be larger than memory.
///
/// # Errors
/// Where it cannot be read.
pub fn of_file(file: impl Read) -> io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(file)?;
    Ok(of_hash(&hasher.finalize()))
}
