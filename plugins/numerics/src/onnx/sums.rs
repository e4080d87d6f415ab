//! Operators that sum numbers: layers, shares, reductions.

use super::{
    layouts::axis_of,
    operators::{Inputs, Settings},
    tensor::{ElementType, Tensor},
};
use arithmetic::products::{self, Matrix};

/// Operator `Gemm`: `alpha A B + beta C`, with optional transposition of A and B.
pub(super) fn gemm(settings: &Settings, inputs: &Inputs<'_>) -> Result<Tensor, String> {
    let turned = |place: usize, name: &str| {
        let matrix = inputs.at(place)?;
        if settings.whole(name, 0) == 0 {
            return Ok(matrix.clone());
        }
        transposed(matrix)
    };
    let (a, b) = (turned(0, "transA")?, turned(1, "transB")?);
    let (alpha, beta) = (settings.float("alpha", 1.0), settings.float("beta", 1.0));
    let mut product = product(&a, &b)?;
    product.values.iter_mut().for_each(|value| *value *= alpha);
    let product = match inputs.maybe(2) {
        Some(bias) => product.with(bias, ElementType::Double, |x, bias| x + beta * bias)?,
        None => product,
    };
    Ok(Tensor::new(a.kind, product.shape, product.values))
}

/// Product of two matrices. A vector counts as a row if it comes first and as a column if it comes second. Leading
/// dimensions of the first matrix count as rows.
pub(super) fn matmul(a: &Tensor, b: &Tensor) -> Result<Tensor, String> {
    let is_column = b.shape.len() == 1;
    let (before, inner) = match a.shape.split_last() {
        Some((inner, before)) => (before, *inner),
        None => return Err("a single number is no matrix".into()),
    };
    let rows = before.iter().product();
    let matrix = a.reshaped(vec![rows, inner])?;
    let b = if is_column {
        b.reshaped(vec![b.values.len(), 1])?
    } else {
        b.clone()
    };
    let found = product(&matrix, &b)?;
    let mut shape = before.to_vec();
    if !is_column {
        shape.push(found.shape[1]);
    }
    Ok(Tensor::new(a.kind, shape, found.values))
}

/// Product of two matrices, in double precision if one of them has it.
fn product(a: &Tensor, b: &Tensor) -> Result<Tensor, String> {
    let (&[rows, inner], &[other, columns]) = (&a.shape[..], &b.shape[..]) else {
        return Err(format!(
            "{:?} times {:?} is no product of two matrices",
            a.shape, b.shape
        ));
    };
    if inner != other {
        return Err(format!(
            "{:?} times {:?}: {inner} is not {other}",
            a.shape, b.shape
        ));
    }
    let values = if [a, b].iter().all(|it| it.kind == ElementType::Single) {
        let [singles, weights] = [a, b].map(singles);
        let (a, b) = (
            Matrix::new(&singles, rows, inner),
            Matrix::new(&weights, inner, columns),
        );
        products::product(a, b).into_iter().map(f64::from).collect()
    } else {
        product_in_double(&a.values, &b.values, [rows, inner, columns])
    };
    Ok(Tensor::new(ElementType::Double, vec![rows, columns], values))
}

#[allow(clippy::cast_possible_truncation, reason = "single precision holds them")]
fn singles(tensor: &Tensor) -> Vec<f32> {
    tensor.values.iter().map(|value| *value as f32).collect()
}

/// Each sum has its terms in order.
fn product_in_double(a: &[f64], b: &[f64], [rows, inner, columns]: [usize; 3]) -> Vec<f64> {
    let mut values = vec![0.0; rows * columns];
    for row in 0..rows {
        let sums = &mut values[row * columns..(row + 1) * columns];
        for (x, weights) in a[row * inner..(row + 1) * inner]
            .iter()
            .zip(b.chunks(columns.max(1)))
        {
            sums.iter_mut()
                .zip(weights)
                .for_each(|(sum, weight)| *sum += x * weight);
        }
    }
    values
}

fn transposed(matrix: &Tensor) -> Result<Tensor, String> {
    let &[rows, columns] = &matrix.shape[..] else {
        return Err(format!("{:?} is no matrix to transpose", matrix.shape));
    };
    let turned =
        (0..columns).flat_map(|column| (0..rows).map(move |row| matrix.values[row * columns + column]));
    Ok(Tensor::new(matrix.kind, vec![columns, rows], turned.collect()))
}

/// Lengths of a tensor before, along and behind one axis.
struct AxisLayout {
    before: usize,
    length: usize,
    behind: usize,
}

impl AxisLayout {
    fn axis(tensor: &Tensor, axis: i64) -> Result<(usize, Self), String> {
        let axis = axis_of(axis, tensor.shape.len())?;
        let along = Self {
            before: tensor.shape[..axis].iter().product(),
            length: tensor.shape[axis],
            behind: tensor.shape[axis + 1..].iter().product(),
        };
        Ok((axis, along))
    }

    /// Indices along the axis, for every combination of indices before and behind it.
    fn lines(&self) -> impl Iterator<Item = Vec<usize>> {
        let (length, behind) = (self.length, self.behind);
        let line = move |before, at| {
            (0..length)
                .map(|step| (before * length + step) * behind + at)
                .collect()
        };
        (0..self.before).flat_map(move |before| (0..behind).map(move |at| line(before, at)))
    }
}

/// `share` of each number and the sum of all weights along the axis, after subtraction of the largest number.
pub(super) fn shares(
    tensor: &Tensor,
    axis: i64,
    weight: impl Fn(f64) -> f64,
    share: impl Fn(f64, f64) -> f64,
) -> Result<Tensor, String> {
    let (_, along) = AxisLayout::axis(tensor, axis)?;
    let mut values = tensor.values.clone();
    for line in along.lines() {
        let largest = line
            .iter()
            .map(|at| values[*at])
            .fold(f64::NEG_INFINITY, f64::max);
        let total: f64 = line.iter().map(|at| weight(values[*at] - largest)).sum();
        line.iter()
            .for_each(|at| values[*at] = share(values[*at] - largest, total));
    }
    Ok(Tensor::new(tensor.kind, tensor.shape.clone(), values))
}

/// Reduction of all numbers along axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Reduction {
    Sum,
    Mean,
    Max,
    Min,
}

impl Reduction {
    #[allow(clippy::cast_precision_loss, reason = "lengths are far below 2^52")]
    fn of(self, values: impl ExactSizeIterator<Item = f64>) -> f64 {
        let count = values.len() as f64;
        match self {
            Self::Sum => values.sum(),
            Self::Mean => values.sum::<f64>() / count,
            Self::Max => values.fold(f64::NEG_INFINITY, f64::max),
            Self::Min => values.fold(f64::INFINITY, f64::min),
        }
    }
}

pub(super) fn reduced(settings: &Settings, inputs: &Inputs<'_>, by: Reduction) -> Result<Tensor, String> {
    let tensor = inputs.at(0)?;
    let rank = tensor.shape.len();
    let axes = settings
        .wholes("axes", inputs.maybe(1))
        .filter(|axes| !axes.is_empty());
    if axes.is_none() && settings.whole("noop_with_empty_axes", 0) != 0 {
        return Ok(tensor.clone());
    }
    let mut axes: Vec<usize> = match axes {
        Some(axes) => axes
            .iter()
            .map(|axis| axis_of(*axis, rank))
            .collect::<Result<_, _>>()?,
        None => (0..rank).collect(),
    };
    axes.sort_unstable();
    // The axes are reduced one after the other from the last one on, so that their numbers stay valid.
    let mut found = Tensor {
        kind: ElementType::Double,
        ..tensor.clone()
    };
    for axis in axes.iter().rev() {
        let (axis, along) = AxisLayout::axis(&found, i64::try_from(*axis).unwrap_or(i64::MAX))?;
        let values = along
            .lines()
            .map(|line| by.of(line.into_iter().map(|at| found.values[at])))
            .collect();
        let mut shape = found.shape.clone();
        shape[axis] = 1;
        found = Tensor::new(ElementType::Double, shape, values);
    }
    let mut shape = found.shape;
    if settings.whole("keepdims", 1) == 0 {
        for axis in axes.iter().rev() {
            shape.remove(*axis);
        }
    }
    Ok(Tensor::new(tensor.kind, shape, found.values))
}

/// Index of the largest number along an axis, the first of equals.
#[allow(clippy::cast_precision_loss, reason = "lengths are far below 2^52")]
pub(super) fn argmax(settings: &Settings, tensor: &Tensor) -> Result<Tensor, String> {
    if settings.whole("select_last_index", 0) != 0 {
        return Err("the last of equals is not known".into());
    }
    let (axis, along) = AxisLayout::axis(tensor, settings.whole("axis", 0))?;
    let best = |line: Vec<usize>| {
        let larger = |best: usize, at: usize| {
            if tensor.values[line[at]] > tensor.values[line[best]] {
                at
            } else {
                best
            }
        };
        (0..line.len()).fold(0, larger) as f64
    };
    let mut shape = tensor.shape.clone();
    if settings.whole("keepdims", 1) == 0 {
        shape.remove(axis);
    } else {
        shape[axis] = 1;
    }
    Ok(Tensor::new(
        ElementType::Whole,
        shape,
        along.lines().map(best).collect(),
    ))
}

/// Operator `LayerNormalization`: each row from the axis on, minus its mean, divided by its deviation, scaled and
/// shifted.
#[allow(clippy::cast_precision_loss, reason = "lengths are far below 2^52")]
pub(super) fn layer_normalised(settings: &Settings, inputs: &Inputs<'_>) -> Result<Tensor, String> {
    let (tensor, epsilon) = (inputs.at(0)?, settings.float("epsilon", 1e-5));
    let axis = axis_of(settings.whole("axis", -1), tensor.shape.len())?;
    let length: usize = tensor.shape[axis..].iter().product();
    let mut values = tensor.values.clone();
    for row in values.chunks_mut(length.max(1)) {
        let mean = row.iter().sum::<f64>() / length as f64;
        let variance = row.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / length as f64;
        let deviation = (variance + epsilon).sqrt();
        row.iter_mut().for_each(|x| *x = (*x - mean) / deviation);
    }
    let plain = Tensor {
        kind: ElementType::Double,
        shape: tensor.shape.clone(),
        values,
    };
    let scaled = plain.with(inputs.at(1)?, ElementType::Double, |x, scale| x * scale)?;
    match inputs.maybe(2) {
        Some(bias) => scaled.with(bias, tensor.kind, |x, bias| x + bias),
        None => Ok(Tensor::new(tensor.kind, scaled.shape, scaled.values)),
    }
}
