//! Tests of operators of layers and shapes by hand-worked numbers.

use super::{
    messages::{Attribute, Node},
    operators::{Settings, computed},
    tensor::{ElementType, Tensor},
};

/// Output of an operator on tensors, with settings by name.
fn of(
    operator: &str,
    settings: &[(&str, &[i64])],
    inputs: &[&Tensor],
    outputs: usize,
) -> Result<Vec<Tensor>, String> {
    let attribute = |(name, values): &(&str, &[i64])| Attribute {
        name: (*name).into(),
        ints: values.to_vec(),
        ..Attribute::default()
    };
    let node = Node {
        attribute: settings.iter().map(attribute).collect(),
        ..Node::default()
    };
    let settings = Settings::of(&node, 17).unwrap();
    let inputs: Vec<Option<&Tensor>> = inputs.iter().copied().map(Some).collect();
    computed(operator, &settings, &inputs, outputs)
}

fn one(operator: &str, settings: &[(&str, &[i64])], inputs: &[&Tensor]) -> (Vec<usize>, Vec<f64>) {
    let found = of(operator, settings, inputs, 1).unwrap().remove(0);
    (found.shape, found.values)
}

/// The numbers 0 to 5 in two rows.
fn rows() -> Tensor {
    let values = (0..6).map(f64::from).collect();
    Tensor::new(ElementType::Single, vec![2, 3], values)
}

#[test]
fn shapes_change_and_numbers_stay() {
    let (x, plain) = (rows(), rows().values);
    assert_eq!(
        one("Reshape", &[], &[&x, &Tensor::whole(&[0, 1, -1])]),
        (vec![2, 1, 3], plain.clone())
    );
    assert_eq!(
        one("Flatten", &[("axis", &[0])], &[&x]),
        (vec![1, 6], plain.clone())
    );
    assert_eq!(
        one("Flatten", &[("axis", &[2])], &[&x]),
        (vec![6, 1], plain.clone())
    );
    assert_eq!(
        one("Unsqueeze", &[], &[&x, &Tensor::whole(&[0, -1])]).0,
        [1, 2, 3, 1]
    );
    let long = x.reshaped(vec![1, 2, 1, 3]).unwrap();
    assert_eq!(one("Squeeze", &[], &[&long]).0, [2, 3]);
    assert_eq!(one("Squeeze", &[("axes", &[0])], &[&long]).0, [2, 1, 3]);
    assert_eq!(one("Shape", &[], &[&x]), (vec![2], vec![2.0, 3.0]));
    assert_eq!(one("Shape", &[("start", &[-1])], &[&x]), (vec![1], vec![3.0]));
    assert_eq!(
        one("Shape", &[("start", &[1]), ("end", &[0])], &[&x]),
        (vec![0], vec![])
    );
    assert_eq!(
        one("ConstantOfShape", &[], &[&Tensor::whole(&[2])]),
        (vec![2], vec![0.0; 2])
    );
    assert_eq!(
        one("Expand", &[], &[&Tensor::whole(&[7]), &Tensor::whole(&[1, 2])]),
        (vec![1, 2], vec![7.0; 2])
    );
}

#[test]
fn parts_are_taken_and_put_together() {
    let x = rows();
    assert_eq!(
        one("Transpose", &[], &[&x]),
        (vec![3, 2], vec![0.0, 3.0, 1.0, 4.0, 2.0, 5.0])
    );
    let [from, to, axis] = [[1], [i64::MAX], [-1]].map(|it| Tensor::whole(&it));
    assert_eq!(
        one("Slice", &[], &[&x, &from, &to, &axis]),
        (vec![2, 2], vec![1.0, 2.0, 4.0, 5.0])
    );
    assert_eq!(
        one("Slice", &[("starts", &[-1]), ("ends", &[2])], &[&x]),
        (vec![1, 3], vec![3.0, 4.0, 5.0])
    );
    assert_eq!(
        one("Gather", &[("axis", &[1])], &[&x, &Tensor::whole(&[-1, 0])]).1,
        [2.0, 0.0, 5.0, 3.0]
    );
    assert_eq!(one("Concat", &[("axis", &[1])], &[&x, &x]).0, [2, 6]);
    assert_eq!(one("Concat", &[("axis", &[0])], &[&x, &x]).1[6..], x.values[..]);
    let parts = of("Split", &[("axis", &[1])], &[&x, &Tensor::whole(&[1, 2])], 2).unwrap();
    assert_eq!(
        (&parts[0].values[..], &parts[1].values[..]),
        (&[0.0, 3.0][..], &[1.0, 2.0, 4.0, 5.0][..])
    );
    assert_eq!(of("Split", &[("axis", &[1])], &[&x], 2).unwrap()[0].shape, [2, 2]);
}

#[test]
fn sums_run_along_axes() {
    let x = rows();
    assert_eq!(
        one("ReduceSum", &[], &[&x, &Tensor::whole(&[1])]),
        (vec![2, 1], vec![3.0, 12.0])
    );
    assert_eq!(
        one("ReduceMean", &[("axes", &[0]), ("keepdims", &[0])], &[&x]),
        (vec![3], vec![1.5, 2.5, 3.5])
    );
    assert_eq!(
        one("ReduceMax", &[("keepdims", &[0])], &[&x]),
        (vec![], vec![5.0])
    );
    assert_eq!(one("ReduceMin", &[("axes", &[-1])], &[&x]).1, [0.0, 3.0]);
    assert_eq!(
        one("ArgMax", &[("axis", &[1])], &[&x]),
        (vec![2, 1], vec![2.0, 2.0])
    );
    let shares = one(
        "Softmax",
        &[],
        &[&Tensor::new(ElementType::Double, vec![1, 2], vec![1e4, 1e4])],
    )
    .1;
    assert_eq!(shares, [0.5, 0.5]);
    let logs = one(
        "LogSoftmax",
        &[("axis", &[-1])],
        &[&Tensor::new(ElementType::Double, vec![1, 2], vec![0.0; 2])],
    )
    .1;
    assert!((logs[0] + std::f64::consts::LN_2).abs() < 1e-15);
    let (scale, bias) = (Tensor::whole(&[2, 2, 2]), Tensor::whole(&[1, 1, 1]));
    let normal = one("LayerNormalization", &[], &[&x, &scale, &bias]).1;
    assert!(
        (normal[0] + 1.449_471).abs() < 1e-5 && (normal[1] - 1.0).abs() < 1e-6,
        "{normal:?}"
    );
}

#[test]
fn products_are_those_of_matrices() {
    let (x, turned) = (
        rows(),
        Tensor::new(
            ElementType::Single,
            vec![2, 3],
            vec![1.0, 0.0, 2.0, 0.0, 1.0, 0.0],
        ),
    );
    let bias = Tensor::new(ElementType::Single, vec![2], vec![10.0, 20.0]);
    let layer = one("Gemm", &[("transB", &[1])], &[&x, &turned, &bias]);
    assert_eq!(layer, (vec![2, 2], vec![14.0, 21.0, 23.0, 24.0]));
    let vector = Tensor::new(ElementType::Single, vec![2], vec![1.0, 2.0]);
    assert_eq!(
        one("MatMul", &[], &[&vector, &x]),
        (vec![3], vec![6.0, 9.0, 12.0])
    );
    assert!(
        of("MatMul", &[], &[&x, &x], 1)
            .unwrap_err()
            .contains("3 is not 2")
    );
}

#[test]
fn faults_of_layouts_are_named() {
    let x = rows();
    for (operator, settings, input, why) in [
        ("Flatten", &[("axis", &[3][..])][..], None, "no axis 3 of 2"),
        ("Reshape", &[], Some(Tensor::whole(&[4])), "are none of [4]"),
        ("Reshape", &[], Some(Tensor::whole(&[-2])), "a length of -2"),
        ("Transpose", &[("perm", &[0, 0])], None, "is no order of 2 axes"),
        ("Gather", &[], Some(Tensor::whole(&[2])), "no axis 2 of 2"),
        (
            "Concat",
            &[],
            Some(Tensor::whole(&[2])),
            "do not stand beside each other",
        ),
        ("Unsqueeze", &[], None, "names no axes"),
        ("Expand", &[], Some(Tensor::whole(&[5])), "do not go together"),
    ] {
        let inputs: Vec<&Tensor> = [Some(&x), input.as_ref()].into_iter().flatten().collect();
        let told = of(operator, settings, &inputs, 1).unwrap_err();
        assert!(told.contains(why), "{operator}: {told}");
    }
    let huge = of("ConstantOfShape", &[], &[&Tensor::whole(&[1 << 40])], 1).unwrap_err();
    assert!(huge.contains("too large"), "{huge}");
    let parts = of("Split", &[("split", &[1, 2])], &[&x], 2).unwrap_err();
    assert!(parts.contains("[1, 2] are no 2 parts of 2"), "{parts}");
}
