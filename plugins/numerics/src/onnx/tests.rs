//! Tests of the content of files. `tests/portable_policies.rs` compares the actions of runtimes with this
//! program's.

use super::*;
use crate::policy_file::{Head, Policy, Ports};
use crate::tensor_file::{HostTensor, TensorFile, TensorFileError};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

fn policy(center: Vec<f64>, spread: Vec<f64>) -> Policy {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let words = |words: &[&str]| words.iter().map(ToString::to_string).collect();
    let (inputs, outputs) = (words(&["pressure_pa", "speed"]), words(&["left", "right"]));
    let ports = Ports {
        inputs,
        center,
        spread,
        outputs,
    };
    Policy::untrained(&[2, 8, 5], &[Activation::LeakyRelu], ports, Head::Tanh, &mut rng)
}

fn message(policy: &Policy) -> Model {
    let properties = [("trial".to_owned(), "0123".to_owned())];
    Model::decode(&*policy.graph().unwrap().to_bytes(&properties)).unwrap()
}

fn constant(model: &Model, name: &str) -> Vec<f32> {
    let graph = model.graph.as_ref().unwrap();
    let tensor = graph
        .initializer
        .iter()
        .find(|tensor| tensor.name == name)
        .unwrap();
    let four = |bytes: &[u8]| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    tensor.raw_data.chunks(4).map(four).collect()
}

/// Old runtimes do not support newer versions, so the requirements of a file may only be changed deliberately.
#[test]
fn a_file_states_its_requirements_and_properties() {
    let model = message(&policy(vec![0.0; 2], vec![1.0; 2]));
    assert_eq!((model.ir_version, model.opset_import[0].version), (8, 17));
    assert_eq!(model.metadata_props[0].key, "trial");
    let graph = model.graph.clone().unwrap();
    let port = |port: &ValueInfo| {
        let kind = port.kind.clone().unwrap().tensor_type.unwrap();
        let [batch, width] = kind.shape.unwrap().dim.try_into().unwrap();
        (
            port.name.clone(),
            batch.dim_param.unwrap(),
            width.dim_value.unwrap(),
            kind.elem_type,
        )
    };
    assert_eq!(
        port(&graph.input[0]),
        ("observation".into(), "batch".into(), 2, FLOAT)
    );
    assert_eq!(
        port(&graph.output[0]),
        ("action".into(), "batch".into(), 2, FLOAT)
    );
    let operators: Vec<&str> = graph.node.iter().map(|node| node.op_type.as_str()).collect();
    // A scaling that changes nothing has no node.
    assert_eq!(operators, ["Gemm", "LeakyRelu", "Gemm", "Tanh", "Identity"]);
    assert_eq!(graph.node[1].attribute[0].f, Some(0.01));
    // Outputs beyond the entries of the action are left out of the last layer.
    let last = graph
        .initializer
        .iter()
        .find(|tensor| tensor.name == "policy.layers.1.weight");
    assert_eq!(last.unwrap().dims, [8, 2]);
}

#[test]
fn a_centre_is_known_to_twice_the_digits_and_a_spread_stays_finite() {
    let model = message(&policy(vec![101_325.37, 0.1], vec![0.5, f64::MAX]));
    let (near, rest) = (constant(&model, "center"), constant(&model, "center.rest"));
    for (at, center) in [101_325.37, 0.1].into_iter().enumerate() {
        let sum = f64::from(near[at]) + f64::from(rest[at]);
        assert!((sum - center).abs() < 1e-13 * center && f64::from(near[at]) != center);
    }
    assert_eq!(constant(&model, "spread"), [0.5, f32::MAX]);
}

#[test]
fn the_same_policy_makes_the_same_bytes_under_names_of_their_own() {
    let policy = policy(vec![1.0; 2], vec![2.0; 2]);
    let graph = policy.graph().unwrap();
    assert_eq!(graph.to_bytes(&[]), policy.graph().unwrap().to_bytes(&[]));
    let message = message(&policy).graph.unwrap();
    let mut names: Vec<String> = message
        .initializer
        .iter()
        .map(|tensor| tensor.name.clone())
        .collect();
    names.extend(message.node.iter().map(|node| node.name.clone()));
    let all = names.len();
    names.sort();
    names.dedup();
    assert_eq!(names.len(), all);
}

#[test]
fn layers_that_do_not_follow_each_other_are_refused() {
    let file = |second: [usize; 2], bias: usize| {
        let mut file = TensorFile::default();
        for (layer, shape) in [[2, 3], second].into_iter().enumerate() {
            let values = vec![0.0; shape[0] * shape[1]];
            file.insert(
                format!("net.layers.{layer}.weight"),
                HostTensor {
                    shape: shape.into(),
                    values,
                },
            );
        }
        file.insert_vector("net.layers.0.bias", vec![0.0; 3]);
        file.insert_vector("net.layers.1.bias", vec![0.0; bias]);
        file
    };
    assert_eq!(dense_layers(&file([3, 1], 1), "net").unwrap().len(), 2);
    for (second, bias) in [([4, 1], 1), ([3, 1], 2)] {
        let error = dense_layers(&file(second, bias), "net").unwrap_err();
        assert!(matches!(error, TensorFileError::Shape { .. }), "{error}");
    }
    assert!(matches!(
        dense_layers(&file([3, 1], 1), "other"),
        Err(TensorFileError::Missing { .. })
    ));
}
