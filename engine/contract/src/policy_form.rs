//! Forms of policy files that can be written for other runtimes.

use crate::Error;
use std::path::Path;

/// A form of policy files that can be written for other runtimes.
pub struct PolicyForm {
    /// Name of the form in messages and properties.
    pub name: &'static str,
    /// Reads the policies in a folder that contains `policy.safetensors`; `None` if they have another form.
    pub read: ReadPolicies,
}

/// Reads the policies of one form from a folder.
///
/// # Errors
/// The file cannot be read, or has this form but is incomplete.
pub type ReadPolicies = fn(&Path) -> Result<Option<Vec<PortablePolicy>>, Error>;

/// A policy from observations of one seat to its actions, ready to be written.
pub struct PortablePolicy {
    /// The seat, if one file holds the policies of several; otherwise empty.
    pub seat: String,
    /// Names of the entries of the observation, in order.
    pub inputs: Vec<String>,
    /// Names of the entries of the action, in order.
    pub outputs: Vec<String>,
    /// Name of the function from the output of the network to an action.
    pub head: String,
    /// Writes the policy as an ONNX file, with properties by name.
    pub to_onnx: Box<dyn Fn(&[(String, String)]) -> Vec<u8>>,
}
