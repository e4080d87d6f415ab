//! Numerics that agents share: special functions, distributions, networks and policies as equations, policy files.
//! They depend neither on the engine nor on reinforcement learning.

pub mod activation;
pub mod dirichlet;
pub mod equations;
pub mod gamma;
pub mod gauss_hermite;
pub mod gaussian;
pub mod matrices;
pub mod onnx;
pub mod policy_file;
pub mod special;
pub mod tensor_file;
pub mod unscented;

/// Version of the numbers, raised whenever a change in this crate changes those of a trial. Together with the
/// engine's version it is part of every trial's id.
pub const VERSION: u32 = 1;
