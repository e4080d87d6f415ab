//! Operators of policies, as ONNX defines them in opsets 7 to 21; those of layers and shapes have modules of
//! their own.

use super::{
    layouts, messages,
    sums::{self, Reduction},
    tensor::{ElementType, Tensor},
};
use arithmetic::{
    double::{exp, exp_m1, ln, ln_1p, tanh},
    power::pow,
    trigonometry,
};
use std::collections::BTreeMap;

/// Names of the supported operators, in alphabetical order.
pub(super) const KNOWN: [&str; 62] = [
    "Abs",
    "Add",
    "And",
    "ArgMax",
    "Atanh",
    "Cast",
    "Ceil",
    "Clip",
    "Concat",
    "Constant",
    "ConstantOfShape",
    "Cos",
    "Div",
    "Dropout",
    "Elu",
    "Equal",
    "Exp",
    "Expand",
    "Flatten",
    "Floor",
    "Gather",
    "Gemm",
    "Greater",
    "GreaterOrEqual",
    "Identity",
    "LayerNormalization",
    "LeakyRelu",
    "Less",
    "LessOrEqual",
    "Log",
    "LogSoftmax",
    "MatMul",
    "Max",
    "Min",
    "Mul",
    "Neg",
    "Not",
    "Or",
    "Pow",
    "Reciprocal",
    "ReduceMax",
    "ReduceMean",
    "ReduceMin",
    "ReduceSum",
    "Relu",
    "Reshape",
    "Selu",
    "Shape",
    "Sigmoid",
    "Sign",
    "Sin",
    "Slice",
    "Softmax",
    "Softplus",
    "Split",
    "Sqrt",
    "Squeeze",
    "Sub",
    "Tanh",
    "Transpose",
    "Unsqueeze",
    "Where",
];

/// Whether an operator is supported.
pub(super) fn is_known(operator: &str) -> bool {
    KNOWN.contains(&operator)
}

/// Settings of an operation by name.
#[derive(Debug, Clone, Default)]
pub(super) struct Settings {
    opset: i64,
    floats: BTreeMap<String, f64>,
    wholes: BTreeMap<String, Vec<i64>>,
    tensors: BTreeMap<String, Tensor>,
}

impl Settings {
    /// Reads the settings of a node.
    pub(super) fn of(node: &messages::Node, opset: i64) -> Result<Self, String> {
        let mut settings = Self {
            opset,
            ..Self::default()
        };
        for it in &node.attribute {
            let name = || it.name.clone();
            match (it.f, it.i, &it.t) {
                (Some(value), _, _) => drop(settings.floats.insert(name(), value.into())),
                (_, Some(value), _) => drop(settings.wholes.insert(name(), vec![value])),
                (_, _, Some(tensor)) => drop(settings.tensors.insert(name(), Tensor::of(tensor)?)),
                _ if !it.floats.is_empty() => {
                    let values: Vec<f64> = it.floats.iter().map(|value| f64::from(*value)).collect();
                    let tensor = Tensor::new(ElementType::Single, vec![values.len()], values);
                    drop(settings.tensors.insert(name(), tensor));
                }
                _ => drop(settings.wholes.insert(name(), it.ints.clone())),
            }
        }
        Ok(settings)
    }

    /// Real number of a setting, or `otherwise` if it is absent.
    pub(super) fn float(&self, name: &str, otherwise: f64) -> f64 {
        self.floats.get(name).copied().unwrap_or(otherwise)
    }

    /// Integer of a setting, or `otherwise` if it is absent.
    pub(super) fn whole(&self, name: &str, otherwise: i64) -> i64 {
        self.wholes
            .get(name)
            .and_then(|it| it.first().copied())
            .unwrap_or(otherwise)
    }

    /// Integers of a setting, which later opsets take as an input.
    pub(super) fn wholes(&self, name: &str, input: Option<&Tensor>) -> Option<Vec<i64>> {
        input
            .map(Tensor::numbers)
            .or_else(|| self.wholes.get(name).cloned())
    }

    /// Tensor of a constant.
    pub(super) fn value(&self) -> Option<&Tensor> {
        self.tensors.get("value")
    }

    /// Axis of the operators whose default changed from 1 to the last one with opset 13.
    fn axis_of_shares(&self) -> i64 {
        self.whole("axis", if self.opset < 13 { 1 } else { -1 })
    }
}

/// Inputs of an operator, by position.
pub(super) struct Inputs<'a>(&'a [Option<&'a Tensor>]);

impl<'a> Inputs<'a> {
    /// Input that is required.
    pub(super) fn at(&self, place: usize) -> Result<&'a Tensor, String> {
        self.maybe(place)
            .ok_or_else(|| format!("its input {place} is left out"))
    }

    /// Input that is optional.
    pub(super) fn maybe(&self, place: usize) -> Option<&'a Tensor> {
        self.0.get(place).copied().flatten()
    }

    /// All inputs that are given.
    pub(super) fn all(&self) -> impl Iterator<Item = &'a Tensor> {
        self.0.iter().copied().flatten()
    }
}

/// Computes the outputs of an operator.
pub(super) fn computed(
    operator: &str,
    settings: &Settings,
    inputs: &[Option<&Tensor>],
    n_outputs: usize,
) -> Result<Vec<Tensor>, String> {
    let inputs = Inputs(inputs);
    if operator == "Split" {
        return layouts::split(settings, &inputs, n_outputs);
    }
    // Further outputs of these two are for training; an operator that reads one is refused as not computed.
    if n_outputs != 1 && !["Dropout", "LayerNormalization"].contains(&operator) {
        return Err(format!(
            "it gives {n_outputs} things, and only its first one is known"
        ));
    }
    let found = match operator {
        "Identity" => Ok(inputs.at(0)?.clone()),
        "Dropout" => dropout(&inputs),
        "Constant" => constant(settings),
        "Cast" => cast(settings, inputs.at(0)?),
        "Gemm" => sums::gemm(settings, &inputs),
        "MatMul" => sums::matmul(inputs.at(0)?, inputs.at(1)?),
        "Softmax" => sums::shares(inputs.at(0)?, settings.axis_of_shares(), exp, |x, total| {
            exp(x) / total
        }),
        "LogSoftmax" => sums::shares(inputs.at(0)?, settings.axis_of_shares(), exp, |x, total| {
            x - ln(total)
        }),
        "LayerNormalization" => sums::layer_normalised(settings, &inputs),
        "ReduceSum" => sums::reduced(settings, &inputs, Reduction::Sum),
        "ReduceMean" => sums::reduced(settings, &inputs, Reduction::Mean),
        "ReduceMax" => sums::reduced(settings, &inputs, Reduction::Max),
        "ReduceMin" => sums::reduced(settings, &inputs, Reduction::Min),
        "ArgMax" => sums::argmax(settings, inputs.at(0)?),
        "Clip" => clip(settings, &inputs),
        "Where" => chosen(&inputs),
        "Max" => folded(&inputs, f64::max),
        "Min" => folded(&inputs, f64::min),
        "Not" => Ok(inputs.at(0)?.map(|x| f64::from(x == 0.0))),
        _ => match one_to_one(operator, settings) {
            Some(change) => Ok(inputs.at(0)?.map(change)),
            None => match two_to_one(operator) {
                Some((together, is_truth)) => pair(&inputs, together, is_truth),
                None => layouts::laid_out(operator, settings, &inputs),
            },
        },
    };
    found.map(|tensor| vec![tensor])
}

/// Function of an operator on single numbers.
fn one_to_one(operator: &str, settings: &Settings) -> Option<Box<dyn Fn(f64) -> f64>> {
    /// Default constants of `Selu`.
    const SELU: (f64, f64) = (1.673_263_2, 1.050_701);
    let alpha = |otherwise| settings.float("alpha", otherwise);
    Some(match operator {
        "Abs" => Box::new(f64::abs),
        "Atanh" => Box::new(|x| 0.5 * (ln_1p(x) - ln_1p(-x))),
        "Ceil" => Box::new(f64::ceil),
        "Cos" => Box::new(trigonometry::cos),
        "Exp" => Box::new(exp),
        "Floor" => Box::new(f64::floor),
        "Log" => Box::new(ln),
        "Neg" => Box::new(|x| -x),
        "Reciprocal" => Box::new(f64::recip),
        "Relu" => Box::new(|x| if x < 0.0 { 0.0 } else { x }),
        "Sigmoid" => Box::new(|x| 1.0 / (1.0 + exp(-x))),
        "Sign" => Box::new(|x| if x == 0.0 { 0.0 } else { x.signum() }),
        "Sin" => Box::new(trigonometry::sin),
        "Softplus" => Box::new(crate::policy_file::softplus),
        "Sqrt" => Box::new(f64::sqrt),
        "Tanh" => Box::new(tanh),
        "LeakyRelu" => {
            let alpha = alpha(0.01);
            Box::new(move |x| if x < 0.0 { alpha * x } else { x })
        }
        "Elu" => {
            let alpha = alpha(1.0);
            Box::new(move |x| if x < 0.0 { alpha * exp_m1(x) } else { x })
        }
        "Selu" => {
            let (alpha, gamma) = (alpha(SELU.0), settings.float("gamma", SELU.1));
            Box::new(move |x| gamma * if x < 0.0 { alpha * exp_m1(x) } else { x })
        }
        _ => return None,
    })
}

/// A function of two numbers.
type BinaryFunction = fn(f64, f64) -> f64;

/// Function of an operator on pairs of numbers, and whether its result is a truth value.
fn two_to_one(operator: &str) -> Option<(BinaryFunction, bool)> {
    Some(match operator {
        "Add" => (|a, b| a + b, false),
        "Sub" => (|a, b| a - b, false),
        "Mul" => (|a, b| a * b, false),
        "Div" => (|a, b| a / b, false),
        "Pow" => (pow, false),
        "And" => (|a, b| f64::from(a != 0.0 && b != 0.0), true),
        "Or" => (|a, b| f64::from(a != 0.0 || b != 0.0), true),
        "Equal" => (|a, b| f64::from(a == b), true),
        "Greater" => (|a, b| f64::from(a > b), true),
        "GreaterOrEqual" => (|a, b| f64::from(a >= b), true),
        "Less" => (|a, b| f64::from(a < b), true),
        "LessOrEqual" => (|a, b| f64::from(a <= b), true),
        _ => return None,
    })
}

fn pair(inputs: &Inputs<'_>, together: BinaryFunction, is_truth: bool) -> Result<Tensor, String> {
    let (one, two) = (inputs.at(0)?, inputs.at(1)?);
    let kind = if is_truth { ElementType::Truth } else { one.kind };
    one.with(two, kind, together)
}

/// Operators `Max` and `Min` of any number of tensors; a NaN stays one.
fn folded(inputs: &Inputs<'_>, better: BinaryFunction) -> Result<Tensor, String> {
    let mut found = inputs.at(0)?.clone();
    for next in inputs.all().skip(1) {
        let kind = found.kind;
        found = found.with(next, kind, |a, b| {
            if a.is_nan() || b.is_nan() {
                f64::NAN
            } else {
                better(a, b)
            }
        })?;
    }
    Ok(found)
}

fn constant(settings: &Settings) -> Result<Tensor, String> {
    let of_tensor = settings.value().or_else(|| settings.tensors.get("value_floats"));
    if let Some(tensor) = of_tensor {
        return Ok(tensor.clone());
    }
    if let Some(value) = settings.floats.get("value_float") {
        return Ok(Tensor::new(ElementType::Single, Vec::new(), vec![*value]));
    }
    if let Some(values) = settings.wholes.get("value_ints") {
        return Ok(Tensor::whole(values));
    }
    match settings.wholes.get("value_int") {
        Some(value) => Tensor::whole(value).reshaped(Vec::new()),
        None => Err("it holds no numbers".into()),
    }
}

/// Dropout drops nothing when a policy acts.
fn dropout(inputs: &Inputs<'_>) -> Result<Tensor, String> {
    match inputs.maybe(2) {
        Some(trains) if trains.values != [0.0] => {
            Err("it drops at random: export the policy for acting".into())
        }
        _ => Ok(inputs.at(0)?.clone()),
    }
}

fn cast(settings: &Settings, tensor: &Tensor) -> Result<Tensor, String> {
    let kind = settings.whole("to", 0);
    let kind = ElementType::of(i32::try_from(kind).unwrap_or(0))?;
    Ok(Tensor::new(kind, tensor.shape.clone(), tensor.values.clone()))
}

/// Operator `Clip`: limits are inputs since opset 11, and settings before.
fn clip(settings: &Settings, inputs: &Inputs<'_>) -> Result<Tensor, String> {
    let limit = |name: &str, place: usize, otherwise: f64| match inputs.maybe(place) {
        Some(tensor) => tensor.values.first().copied().unwrap_or(otherwise),
        None => settings.float(name, otherwise),
    };
    let low = limit("min", 1, f64::NEG_INFINITY);
    let high = limit("max", 2, f64::INFINITY);
    Ok(inputs
        .at(0)?
        .map(|x| if x.is_nan() { x } else { x.max(low).min(high) }))
}

fn chosen(inputs: &Inputs<'_>) -> Result<Tensor, String> {
    let (condition, one, two) = (inputs.at(0)?, inputs.at(1)?, inputs.at(2)?);
    // The condition replaces entries that are not chosen by 0, even if they are not finite.
    let first = condition.with(one, one.kind, |is, x| if is != 0.0 { x } else { 0.0 })?;
    let second = condition.with(two, two.kind, |is, x| if is != 0.0 { 0.0 } else { x })?;
    first.with(&second, one.kind, |a, b| a + b)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(values: &[f64]) -> Tensor {
        Tensor::new(ElementType::Single, vec![1, values.len()], values.to_vec())
    }

    fn of(operator: &str, inputs: &[&Tensor]) -> Vec<f64> {
        let inputs: Vec<Option<&Tensor>> = inputs.iter().copied().map(Some).collect();
        let found = computed(operator, &Settings::default(), &inputs, 1);
        found.unwrap().remove(0).values
    }

    #[test]
    fn numbers_are_rounded_to_their_kind() {
        let third = f64::from(1.0f32 / 3.0);
        assert_eq!(of("Div", &[&row(&[1.0]), &row(&[3.0])]), [third]);
        let whole = Tensor::whole(&[7, -7]);
        assert_eq!(of("Div", &[&whole, &Tensor::whole(&[2])]), [3.0, -3.0]);
    }

    #[test]
    fn activations_are_as_they_are_defined() {
        let x = row(&[-2.0, 0.0, 1.5]);
        let near = |operator: &str, expected: [f64; 3]| {
            let found = of(operator, &[&x]);
            assert!(
                found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6),
                "{operator}: {found:?}"
            );
        };
        near("Relu", [0.0, 0.0, 1.5]);
        near("LeakyRelu", [-0.02, 0.0, 1.5]);
        near("Elu", [-0.864_664_7, 0.0, 1.5]);
        near("Selu", [-1.520_166_6, 0.0, 1.576_051_5]);
        near("Sigmoid", [0.119_202_9, 0.5, 0.817_574_5]);
        near("Softplus", [0.126_928, std::f64::consts::LN_2, 1.701_413_3]);
        near("Tanh", [-0.964_027_6, 0.0, 0.905_148_3]);
        near("Sign", [-1.0, 0.0, 1.0]);
    }

    #[test]
    fn entries_are_spread_over_rows_and_columns() {
        let column = Tensor::new(ElementType::Single, vec![2, 1], vec![10.0, 20.0]);
        assert_eq!(of("Add", &[&row(&[1.0, 2.0]), &column]), [11.0, 12.0, 21.0, 22.0]);
        assert_eq!(of("Greater", &[&row(&[1.0, 3.0]), &row(&[2.0])]), [0.0, 1.0]);
        let truth = of(
            "Where",
            &[
                &row(&[1.0, 0.0]),
                &row(&[5.0, f64::INFINITY]),
                &row(&[f64::NAN, 6.0]),
            ],
        );
        assert_eq!(truth, [5.0, 6.0]);
        assert_eq!(
            of("Max", &[&row(&[1.0, 4.0]), &row(&[2.0]), &row(&[3.0])]),
            [3.0, 4.0]
        );
        assert!(of("Min", &[&row(&[f64::NAN]), &row(&[2.0])])[0].is_nan());
        assert_eq!(
            of("Clip", &[&row(&[-3.0, 0.5, 3.0]), &row(&[-1.0]), &row(&[1.0])]),
            [-1.0, 0.5, 1.0]
        );
    }

    #[test]
    fn unfit_inputs_are_refused() {
        let (two, three) = (row(&[1.0, 2.0]), row(&[1.0, 2.0, 3.0]));
        let inputs = [Some(&two), Some(&three)];
        let told = computed("Add", &Settings::default(), &inputs, 1).unwrap_err();
        assert!(told.contains("[1, 2] and [1, 3] do not go together"), "{told}");
        let told = computed("Add", &Settings::default(), &inputs[..1], 1).unwrap_err();
        assert!(told.contains("its input 1 is left out"), "{told}");
        assert!(computed("ArgMax", &Settings::default(), &inputs[..1], 2).is_err());
        let training = [Some(&two), None, Some(&two)];
        let told = computed("Dropout", &Settings::default(), &training, 1).unwrap_err();
        assert!(told.contains("drops at random"), "{told}");
        assert!(computed("Dropout", &Settings::default(), &training[..1], 2).is_ok());
        assert!(KNOWN.is_sorted());
    }
}
