//! Forms of policies that several agents leave, as graphs for other runtimes.
//!
//! An agent with a network of its own registers one function more: it reads `policy.safetensors` in a folder, says
//! `None` where the file is of another form, and builds a [`Graph`] for each seat otherwise.

use super::{checkpoint, opponent_modelling};
use contract::{Error, Registry, policy_form::PortablePolicy};
use numerics::{
    onnx::Graph,
    policy_file::{FILE_NAME, Head, Policy},
    tensor_file::{TensorFile, TensorFileError},
};
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use std::path::Path;

/// What errors call a policy that is read to be written elsewhere.
const WHAT: &str = "a policy";

/// Registers the forms that several agents leave.
pub(crate) fn register(registry: &mut Registry) {
    registry.policy_form("dense", dense);
    registry.policy_form("opponent_models", opponent_modelling::portable);
}

/// A fully connected network of [`numerics::policy_file`].
fn dense(dir: &Path) -> Result<Option<Vec<PortablePolicy>>, Error> {
    if tensors(dir)?.header.get("sizes").is_none() {
        return Ok(None);
    }
    let policy = Policy::read(dir).map_err(error)?;
    let graph = policy.graph().map_err(error)?;
    let header = policy.header;
    let outputs = acted(header.head, header.outputs);
    Ok(Some(vec![portable(
        String::new(),
        header.inputs,
        outputs,
        header.head,
        graph,
    )]))
}

/// Names of the entries of an action: an index has one.
fn acted(head: Head, outputs: Vec<String>) -> Vec<String> {
    if head == Head::Argmax {
        vec!["choice".into()]
    } else {
        outputs
    }
}

/// A policy with its graph; `seat` is empty where its folder says whose it is.
pub(crate) fn portable(
    seat: String,
    inputs: Vec<String>,
    outputs: Vec<String>,
    head: Head,
    graph: Graph,
) -> PortablePolicy {
    let head = json!(head);
    PortablePolicy {
        seat,
        inputs,
        outputs,
        head: head.as_str().unwrap_or_default().to_owned(),
        to_onnx: Box::new(move |properties| graph.to_bytes(properties)),
    }
}

/// The policy file in a folder.
///
/// # Errors
/// [`Error::File`] or [`Error::Checkpoint`].
pub(crate) fn tensors(dir: &Path) -> Result<TensorFile, Error> {
    TensorFile::read(&dir.join(FILE_NAME)).map_err(error)
}

/// What a policy file says of itself, in the form of one kind.
///
/// # Errors
/// [`Error::Checkpoint`] where it says something else.
pub(crate) fn header<T: DeserializeOwned>(header: &Value) -> Result<T, Error> {
    T::deserialize(header).map_err(|source| misfit(source.to_string()))
}

/// An error about a file of tensors.
pub(crate) fn error(source: TensorFileError) -> Error {
    checkpoint::error_of(WHAT)(source)
}

/// An error about what a file holds.
pub(crate) fn misfit(problem: String) -> Error {
    Error::Checkpoint { what: WHAT, problem }
}
