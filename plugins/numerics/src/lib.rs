//! Numerical building blocks that know neither the engine nor reinforcement learning: special functions, distributions.

pub mod dirichlet;
pub mod dirichlet_policy;
pub mod gamma;
pub mod gaussian;
pub mod gaussian_policy;
pub mod linearised;
pub mod special;
