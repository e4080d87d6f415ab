//! The arithmetic in CUDA C++ for kernels: the headers of `cuda/`, which also compile for a processor.

/// Headers in an order in which each comes after those that it needs; sine, cosine and powers are left out.
const HEADERS: [&str; 5] = [
    include_str!("../cuda/bits.cuh"),
    include_str!("../cuda/double.cuh"),
    include_str!("../cuda/gamma_and_draws.cuh"),
    include_str!("../cuda/single.cuh"),
    include_str!("../cuda/arithmetic.cuh"),
];

/// One text with all functions that plans need, in the namespace `arithmetic`, which includes no headers.
#[must_use]
pub fn source() -> String {
    let is_own = |line: &&str| !line.starts_with("#pragma once") && !line.starts_with("#include \"");
    let lines = HEADERS.iter().flat_map(|header| header.lines().filter(is_own));
    lines.map(|line| format!("{line}\n")).collect()
}
