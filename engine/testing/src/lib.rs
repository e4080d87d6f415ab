//! Small plugins and made-up results, for the tests of the engine's crates.

#![allow(
    missing_docs,
    clippy::missing_panics_doc,
    clippy::must_use_candidate,
    reason = "tests alone use it"
)]

pub mod encounters;
pub mod synthetic;
pub mod toys;
