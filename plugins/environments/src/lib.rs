//! Environments: simulated systems with one or more seats.
//!
//! "The thesis" is Y. Tian, "Prescriptive Maintenance and Operation with Deep Reinforcement Learning",
//! dissertation: chapter 2 for `turbofan` (Y. Tian, M. Arias Chao, C. Kulkarni, K. Goebel and O. Fink, "Real-time
//! model calibration with deep reinforcement learning", Mechanical Systems and Signal Processing 165 (2022)
//! 108284), chapter 3 for `allocation_bandit`, `simplex_reconstruction` and `battery` (Y. Tian, M. Han,
//! C. Kulkarni and O. Fink, "A prescriptive Dirichlet power allocation policy with deep reinforcement
//! learning", Reliability Engineering and System Safety 224 (2022) 108529), chapter 4 for the games (Y. Tian,
//! K.-R. Kladny, Q. Wang, Z. Huang and O. Fink, "Multi-agent actor-critic with time dynamical opponent
//! model", Neurocomputing 517 (2023) 165-172), section 6.5 for `uav_fleet`.
//!
//! To add an environment, write a module with a config and a [`contract::Environment`], and one line in
//! [`register`].

pub mod allocation_bandit;
pub mod battery;
mod choices;
pub mod component_replacement;
pub mod differential_game;
pub mod flight_planning;
pub mod grid_reconfiguration;
pub mod inspection_planning;
pub mod particles;
pub mod pendulum;
mod policy_network;
pub mod redundancy;
mod simplex;
pub mod simplex_reconstruction;
pub mod turbofan;
pub mod uav_fleet;
mod unit_box;

/// Registers every environment of this crate.
pub fn register(registry: &mut contract::Registry) {
    registry.environment(
        "allocation_bandit",
        1,
        "one allocation with a known best answer",
        allocation_bandit::build,
    );
    registry.environment(
        "battery",
        2,
        "share a load among the cells of a lithium-ion pack",
        battery::build,
    );
    let about = "replace and inspect five deteriorating components, of which k must work";
    registry.environment("component_replacement", 1, about, component_replacement::build);
    let about = "players share the higher of two hills, of which the wider one is a trap";
    registry.environment("differential_game", 1, about, differential_game::build);
    let about = "airspeeds and heights of a UAV's flight over ground, for the least energy in a wind";
    registry.environment("flight_planning", 1, about, flight_planning::build);
    let about = "switches of a distribution feeder, so that most load is supplied after faults";
    registry.environment("grid_reconfiguration", 1, about, grid_reconfiguration::build);
    let about = "inspect and repair cracking components, of which k of n must work";
    registry.environment("inspection_planning", 1, about, inspection_planning::build);
    let about = "agents push discs in a plane: cooperative navigation, or predators and prey";
    registry.environment("particles", 2, about, particles::build);
    let about = "swing a rod up on its pivot and hold it upright";
    registry.environment("pendulum", 1, about, pendulum::build);
    let about = "spare components of a system in series, for the best reliability that a budget buys";
    registry.environment("redundancy", 1, about, redundancy::build);
    registry.environment(
        "simplex_reconstruction",
        1,
        "recover and sort a point of the simplex of which one entry is hidden",
        simplex_reconstruction::build,
    );
    let about = "performance of a turbofan over a flight, for the health parameters that actions set";
    registry.environment("turbofan", 1, about, turbofan::build);
    let about = "health parameters that let a turbofan's model follow its sensors";
    registry.environment("turbofan_calibration", 2, about, turbofan::calibration::build);
    let about = "what a turbofan's sensors read, sample by sample: examples for a surrogate";
    registry.environment("turbofan_samples", 2, about, turbofan::samples::build);
    let about = "replace worn cells of a fleet of UAVs that calibrates, allocates loads and plans flights";
    registry.environment("uav_fleet", 1, about, uav_fleet::build);
    let about = "two opposed players on the surface of the differential game";
    registry.environment("zero_sum_game", 1, about, differential_game::build_zero_sum);
}
