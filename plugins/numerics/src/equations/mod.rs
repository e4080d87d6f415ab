//! Networks, policies and their files as equations of a plan.
//!
//! | module | contents |
//! |---|---|
//! | [`network`] | fully connected networks |
//! | [`input_norm`] | networks whose inputs are normalised |
//! | [`squashed`] | Gaussian policies squashed by tanh |
//! | [`dirichlet`] | Dirichlet policies |
//! | [`state_file`] | the state of a plan in a file of tensors |

pub mod dirichlet;
pub mod input_norm;
pub mod network;
pub mod squashed;
pub mod state_file;
