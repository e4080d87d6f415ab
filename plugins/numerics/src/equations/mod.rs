//! Networks, policies and their files as equations of a plan.
//!
//! | module | contents |
//! |---|---|
//! | [`network`] | fully connected networks |
//! | [`squashed`] | Gaussian policies squashed by tanh |
//! | [`dirichlet`] | Dirichlet policies |
//! | [`stein`] | directions of Stein variational gradient descent |
//! | [`state_file`] | the state of a plan in a file of tensors |

pub mod dirichlet;
pub mod network;
pub mod squashed;
pub mod state_file;
pub mod stein;
