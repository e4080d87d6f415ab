//! Tensors of a network that is read: numbers of every kind as `f64`, rounded to the kind after each
//! operation.
//!
//! Products of `float32` are those of [`arithmetic::products`], so that a policy of an agent has the same sums here as
//! in the agent. The order of terms is fixed, so that a row has the same bits in every batch.

use super::messages;

/// Type of the elements of a tensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ElementType {
    /// `float32`.
    Single,
    /// `float64`.
    Double,
    /// Integers of 32 or 64 bits.
    Whole,
    /// Truth values, 0 or 1.
    Truth,
}

impl ElementType {
    /// Type of a `TensorProto.DataType`.
    pub(super) fn of(data_type: i32) -> Result<Self, String> {
        match data_type {
            messages::FLOAT => Ok(Self::Single),
            messages::DOUBLE => Ok(Self::Double),
            messages::INT32 | messages::INT64 => Ok(Self::Whole),
            messages::BOOL => Ok(Self::Truth),
            other => Err(format!(
                "numbers of the kind {other} are not known; float32, float64, int32, int64 and bool are"
            )),
        }
    }

    #[allow(clippy::cast_possible_truncation, reason = "rounding is what is asked for")]
    fn rounded(self, value: f64) -> f64 {
        match self {
            Self::Single => f64::from(value as f32),
            Self::Double => value,
            Self::Whole => value.trunc(),
            Self::Truth => f64::from(value != 0.0),
        }
    }
}

/// Numbers with a shape, the last dimension running fastest.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tensor {
    pub(super) kind: ElementType,
    pub(super) shape: Vec<usize>,
    pub(super) values: Vec<f64>,
}

impl Tensor {
    /// Creates a tensor with numbers rounded to `kind`.
    pub(super) fn new(kind: ElementType, shape: Vec<usize>, mut values: Vec<f64>) -> Self {
        debug_assert_eq!(shape.iter().product::<usize>(), values.len());
        values.iter_mut().for_each(|value| *value = kind.rounded(*value));
        Self { kind, shape, values }
    }

    /// Vector of integers.
    #[allow(
        clippy::cast_precision_loss,
        reason = "lengths and positions are far below 2^52"
    )]
    pub(super) fn whole(numbers: &[i64]) -> Self {
        let values = numbers.iter().map(|number| *number as f64).collect();
        Self::new(ElementType::Whole, vec![numbers.len()], values)
    }

    /// Numbers as integers.
    #[allow(
        clippy::cast_possible_truncation,
        reason = "they are whole numbers already, or are cut to such"
    )]
    pub(super) fn numbers(&self) -> Vec<i64> {
        self.values.iter().map(|value| *value as i64).collect()
    }

    /// The same numbers in another shape.
    pub(super) fn reshaped(&self, shape: Vec<usize>) -> Result<Self, String> {
        if count(&shape)? != self.values.len() {
            return Err(format!(
                "{} numbers of the shape {:?} are none of {shape:?}",
                self.values.len(),
                self.shape
            ));
        }
        Ok(Self {
            shape,
            ..self.clone()
        })
    }

    /// Applies `change` to each number.
    pub(super) fn map(&self, change: impl Fn(f64) -> f64) -> Self {
        let values = self.values.iter().map(|value| change(*value)).collect();
        Self::new(self.kind, self.shape.clone(), values)
    }

    /// Combines two tensors entry by entry; a dimension of 1 is broadcast to the length of the other tensor.
    pub(super) fn with(
        &self,
        other: &Self,
        kind: ElementType,
        together: impl Fn(f64, f64) -> f64,
    ) -> Result<Self, String> {
        let shape = common(&self.shape, &other.shape)?;
        let (own, theirs) = (
            Broadcast::over(&self.shape, &shape),
            Broadcast::over(&other.shape, &shape),
        );
        let count = shape.iter().product();
        let entry = |at| together(self.values[own.at(at)], other.values[theirs.at(at)]);
        Ok(Self::new(kind, shape.clone(), (0..count).map(entry).collect()))
    }

    /// Reads a constant of a file.
    pub(super) fn of(message: &messages::Tensor) -> Result<Self, String> {
        if message.data_location != 0 {
            return Err("its numbers lie in another file: save the model as one file".into());
        }
        let kind = ElementType::of(message.data_type)?;
        let length = |dim: &i64| usize::try_from(*dim).map_err(|_| format!("a length of {dim}"));
        let shape: Vec<usize> = message.dims.iter().map(length).collect::<Result<_, _>>()?;
        let values = if message.raw_data.is_empty() {
            typed(message)
        } else {
            raw(message.data_type, &message.raw_data)
        };
        if count(&shape)? != values.len() {
            return Err(format!("{} numbers for the shape {shape:?}", values.len()));
        }
        Ok(Self::new(kind, shape, values))
    }
}

#[allow(
    clippy::cast_precision_loss,
    reason = "whole numbers of a policy are lengths and positions"
)]
fn typed(message: &messages::Tensor) -> Vec<f64> {
    let singles = message.float_data.iter().map(|value| f64::from(*value));
    let small = message.int32_data.iter().map(|value| f64::from(*value));
    let whole = message.int64_data.iter().map(|value| *value as f64);
    let doubles = message.double_data.iter().copied();
    singles.chain(small).chain(whole).chain(doubles).collect()
}

#[allow(
    clippy::cast_precision_loss,
    reason = "whole numbers of a policy are lengths and positions"
)]
fn raw(data_type: i32, bytes: &[u8]) -> Vec<f64> {
    let four = || bytes.as_chunks::<4>().0.iter();
    let eight = || bytes.as_chunks::<8>().0.iter();
    match data_type {
        messages::FLOAT => four().map(|it| f64::from(f32::from_le_bytes(*it))).collect(),
        messages::INT32 => four().map(|it| f64::from(i32::from_le_bytes(*it))).collect(),
        messages::INT64 => eight().map(|it| i64::from_le_bytes(*it) as f64).collect(),
        messages::DOUBLE => eight().map(|it| f64::from_le_bytes(*it)).collect(),
        _ => bytes.iter().map(|byte| f64::from(*byte)).collect(),
    }
}

/// Largest accepted number of entries of a tensor. Policies are far smaller, and a damaged file may ask for any number.
const MOST_ENTRIES: usize = 1 << 26;

/// Number of entries of a shape.
pub(super) fn count(shape: &[usize]) -> Result<usize, String> {
    let product = shape
        .iter()
        .try_fold(1usize, |count, length| count.checked_mul(*length));
    let product = product.filter(|count| *count <= MOST_ENTRIES);
    product.ok_or_else(|| format!("the shape {shape:?} is too large"))
}

/// Common shape to which two shapes are broadcast.
pub(super) fn common(one: &[usize], two: &[usize]) -> Result<Vec<usize>, String> {
    let rank = one.len().max(two.len());
    let length = |shape: &[usize], at: usize| (at + shape.len()).checked_sub(rank).map_or(1, |at| shape[at]);
    let both = (0..rank).map(|at| match (length(one, at), length(two, at)) {
        (a, b) if a == b || b == 1 => Ok(a),
        (1, b) => Ok(b),
        _ => Err(format!("shapes {one:?} and {two:?} do not go together")),
    });
    let shape: Vec<usize> = both.collect::<Result<_, _>>()?;
    count(&shape)?;
    Ok(shape)
}

/// Map from the entries of a larger shape to those of a tensor that is broadcast to it.
pub(super) struct Broadcast {
    /// Length of each dimension of the large shape, from the last on, and the stride of its entries in the
    /// tensor.
    steps: Vec<(usize, usize)>,
}

impl Broadcast {
    pub(super) fn over(shape: &[usize], large: &[usize]) -> Self {
        let mut stride = 1;
        let mut steps = Vec::with_capacity(large.len());
        for (back, length) in large.iter().rev().enumerate() {
            let own = shape.len().checked_sub(back + 1).map_or(1, |at| shape[at]);
            steps.push((*length, if own == 1 { 0 } else { stride }));
            stride *= own;
        }
        Self { steps }
    }

    /// Index in the tensor for an index in the large shape.
    pub(super) fn at(&self, mut place: usize) -> usize {
        let mut found = 0;
        for (length, stride) in &self.steps {
            found += place % length * stride;
            place /= length;
        }
        found
    }
}
