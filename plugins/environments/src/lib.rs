//! Environments: simulated systems with one or more seats.
//!
//! To add one, write a module with a config and an [`engine::Environment`], and one line in [`register`].

pub mod allocation_bandit;
pub mod battery;
pub mod differential_game;
pub mod particles;
mod simplex;
pub mod simplex_reconstruction;
mod unit_box;

/// Registers every environment of this crate.
pub fn register(registry: &mut engine::Registry) {
    registry.environment("allocation_bandit", 1, "one allocation with a known best answer", allocation_bandit::build);
    registry.environment("battery", 2, "share a load among the cells of a lithium-ion pack", battery::build);
    let about = "players share the higher of two hills, of which the wider one is a trap";
    registry.environment("differential_game", 1, about, differential_game::build);
    let about = "agents push discs in a plane: cooperative navigation, or predators and prey";
    registry.environment("particles", 1, about, particles::build);
    registry.environment(
        "simplex_reconstruction",
        1,
        "recover and sort a point of the simplex of which one entry is hidden",
        simplex_reconstruction::build,
    );
    let about = "two opposed players on the surface of the differential game";
    registry.environment("zero_sum_game", 1, about, differential_game::build_zero_sum);
}
