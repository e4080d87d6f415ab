//! Environments: simulated systems with one or more seats.
//!
//! To add one, write a module with a config and an [`engine::Environment`], and one line in [`register`].

pub mod allocation_bandit;
pub mod battery;
mod simplex;
pub mod simplex_reconstruction;

/// Registers every environment of this crate.
pub fn register(registry: &mut engine::Registry) {
    registry.environment("allocation_bandit", 1, "one allocation with a known best answer", allocation_bandit::build);
    registry.environment("battery", 1, "share a load among the cells of a lithium-ion pack", battery::build);
    registry.environment(
        "simplex_reconstruction",
        1,
        "recover and sort a point of the simplex of which one entry is hidden",
        simplex_reconstruction::build,
    );
}
