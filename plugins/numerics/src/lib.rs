//! Numerical building blocks that know neither the engine nor reinforcement learning: special functions, distributions,
//! networks, optimisers, files of parameters.

pub mod activation;
pub mod dirichlet;
pub mod dirichlet_policy;
pub mod gamma;
pub mod gaussian;
pub mod gaussian_policy;
mod linearised;
pub mod network;
pub mod optimizer;
pub mod parameters;
pub mod policy_file;
pub mod special;
pub mod tensor_file;
