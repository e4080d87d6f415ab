//! Forms of policies that several agents export, as graphs for other runtimes.
//!
//! An agent with a network of its own registers one more function. It reads `policy.safetensors` in a folder,
//! returns `None` where the file is of another form, and builds a [`Graph`] for each seat otherwise.

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

/// Subject of errors about a policy that is read for conversion.
const WHAT: &str = "a policy";

/// Registers the forms that several agents export.
pub(crate) fn register(registry: &mut Registry) {
    registry.policy_form("dense", dense);
    registry.policy_form("opponent_models", opponent_modelling::portable);
}

/// Graph of a fully connected network of [`numerics::policy_file`].
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

/// Names of the entries of an action; an index has a single entry.
fn acted(head: Head, outputs: Vec<String>) -> Vec<String> {
    if head == Head::Argmax {
        vec!["choice".into()]
    } else {
        outputs
    }
}

/// A policy with its graph; `seat` is empty where the path of its folder names the seat.
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

/// Reads the policy file in a folder.
///
/// # Errors
/// [`Error::File`] or [`Error::Checkpoint`] where the file is missing or damaged.
pub(crate) fn tensors(dir: &Path) -> Result<TensorFile, Error> {
    TensorFile::read(&dir.join(FILE_NAME)).map_err(error)
}

/// Parses the header of a policy file of one form.
///
/// # Errors
/// [`Error::Checkpoint`] where the header has other fields.
pub(crate) fn header<T: DeserializeOwned>(header: &Value) -> Result<T, Error> {
    T::deserialize(header).map_err(|source| misfit(source.to_string()))
}

/// Converts an error about a tensor file to an error of the engine.
pub(crate) fn error(source: TensorFileError) -> Error {
    checkpoint::error_of(WHAT)(source)
}

/// Error about the content of a policy file.
pub(crate) fn misfit(problem: String) -> Error {
    Error::Checkpoint { what: WHAT, problem }
}
