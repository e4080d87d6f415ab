//! Numerics that environments and agents share: networks, optimisers, files of parameters.

pub mod network;
pub mod optimizer;
pub mod parameters;
pub mod policy_file;
pub mod tensor_file;
