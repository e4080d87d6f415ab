//! Numerics that agents share: special functions, distributions, networks, optimisers, files of parameters.
//! They depend neither on the engine nor on reinforcement learning.

pub mod activation;
pub mod dense;
pub mod dirichlet;
pub mod dirichlet_policy;
pub mod equations;
pub mod gamma;
pub mod gauss_hermite;
pub mod gaussian;
pub mod gaussian_head;
pub mod gaussian_softmax;
pub mod linearised;
pub mod matrices;
pub mod network;
pub mod onnx;
pub mod optimizer;
pub mod parameters;
pub mod policy_file;
pub mod special;
pub mod squashed;
pub mod tensor_file;
pub mod unscented;

/// Version of the numbers, raised whenever a change in this crate changes those of a trial. Together with the
/// engine's version it is part of every trial's id.
pub const VERSION: u32 = 0;
