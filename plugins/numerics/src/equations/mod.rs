//! Networks, policies and their files as equations of a plan.
//!
//! | module | contents |
//! |---|---|
//! | [`network`] | fully connected networks |
//! | [`input_norm`] | networks whose inputs are normalised |
//! | [`squashed`] | Gaussian policies squashed by tanh |
//! | [`gaussian_softmax`] | Gaussian policies mapped to the simplex by softmax |
//! | [`dirichlet`] | Dirichlet policies |
//! | [`stein`] | directions of Stein variational gradient descent |
//! | [`state_file`] | the state of a plan in a file of tensors |

pub mod dirichlet;
pub mod gaussian_softmax;
pub mod input_norm;
pub mod network;
pub mod squashed;
pub mod state_file;
pub mod stein;
