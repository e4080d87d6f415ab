//! Operators that change the layout of numbers but not their values.

use super::{
    operators::{Inputs, Settings},
    tensor::{Broadcast, ElementType, Tensor, common, count},
};

/// Axis of a number, which counts from the last axis if it is negative.
pub(super) fn axis_of(axis: i64, rank: usize) -> Result<usize, String> {
    let count = i64::try_from(rank).unwrap_or(i64::MAX);
    let found = if axis < 0 { axis + count } else { axis };
    usize::try_from(found)
        .ok()
        .filter(|axis| *axis < rank)
        .ok_or_else(|| format!("there is no axis {axis} of {rank}"))
}

pub(super) fn laid_out(operator: &str, settings: &Settings, inputs: &Inputs<'_>) -> Result<Tensor, String> {
    match operator {
        "Reshape" => reshape(settings, inputs.at(0)?, inputs.at(1)?),
        "Flatten" => flatten(settings, inputs.at(0)?),
        "Squeeze" => squeeze(settings, inputs),
        "Unsqueeze" => unsqueeze(settings, inputs),
        "Transpose" => transpose(settings, inputs.at(0)?),
        "Concat" => concat(settings, inputs),
        "Slice" => slice(settings, inputs),
        "Gather" => gather(settings, inputs),
        "Expand" => expand(inputs.at(0)?, inputs.at(1)?),
        "Shape" => Ok(shape_of(settings, inputs.at(0)?)),
        "ConstantOfShape" => constant_of_shape(settings, inputs.at(0)?),
        other => Err(format!("`{other}` is not known")),
    }
}

/// Lengths from integers.
fn lengths(numbers: &[i64]) -> Result<Vec<usize>, String> {
    let length = |number: &i64| usize::try_from(*number).map_err(|_| format!("a length of {number}"));
    numbers.iter().map(length).collect()
}

/// Lengths of the axes in a range.
fn shape_of(settings: &Settings, tensor: &Tensor) -> Tensor {
    let lengths = tensor
        .shape
        .iter()
        .map(|length| i64::try_from(*length).unwrap_or(i64::MAX));
    let lengths: Vec<i64> = lengths.collect();
    let rank = i64::try_from(lengths.len()).unwrap_or(i64::MAX);
    let counted = |axis: i64| if axis < 0 { axis.saturating_add(rank) } else { axis }.clamp(0, rank);
    let [from, to] = [settings.whole("start", 0), settings.whole("end", rank)].map(counted);
    let [from, to] = [from, to.max(from)].map(|axis| usize::try_from(axis).unwrap_or(0));
    Tensor::whole(&lengths[from..to])
}

/// Reshapes a tensor: 0 keeps a length, and -1 takes the remaining one.
fn reshape(settings: &Settings, tensor: &Tensor, to: &Tensor) -> Result<Tensor, String> {
    let mut numbers = to.numbers();
    for (at, number) in numbers.iter_mut().enumerate() {
        if *number == 0 && settings.whole("allowzero", 0) == 0 {
            let own = tensor
                .shape
                .get(at)
                .ok_or("a length of 0 stands beyond the shape that was there")?;
            *number = i64::try_from(*own).unwrap_or(i64::MAX);
        }
    }
    let open = numbers.iter().position(|number| *number == -1);
    if let Some(open) = open {
        numbers[open] = 1;
        let others: usize = lengths(&numbers)?.iter().product();
        numbers[open] = i64::try_from(tensor.values.len() / others.max(1)).unwrap_or(i64::MAX);
    }
    tensor.reshaped(lengths(&numbers)?)
}

fn flatten(settings: &Settings, tensor: &Tensor) -> Result<Tensor, String> {
    let (axis, rank) = (settings.whole("axis", 1), tensor.shape.len());
    let behind_last = i64::try_from(rank) == Ok(axis);
    let axis = if behind_last { rank } else { axis_of(axis, rank)? };
    let rows = tensor.shape[..axis].iter().product();
    let columns = tensor.shape[axis..].iter().product();
    tensor.reshaped(vec![rows, columns])
}

fn squeeze(settings: &Settings, inputs: &Inputs<'_>) -> Result<Tensor, String> {
    let tensor = inputs.at(0)?;
    let rank = tensor.shape.len();
    let axes = settings.wholes("axes", inputs.maybe(1));
    let axes: Vec<usize> = match axes {
        Some(axes) => axes
            .iter()
            .map(|axis| axis_of(*axis, rank))
            .collect::<Result<_, _>>()?,
        None => (0..rank).filter(|axis| tensor.shape[*axis] == 1).collect(),
    };
    let kept = tensor
        .shape
        .iter()
        .enumerate()
        .filter(|(axis, _)| !axes.contains(axis));
    tensor.reshaped(kept.map(|(_, length)| *length).collect())
}

fn unsqueeze(settings: &Settings, inputs: &Inputs<'_>) -> Result<Tensor, String> {
    let tensor = inputs.at(0)?;
    let axes = settings
        .wholes("axes", inputs.maybe(1))
        .ok_or("it names no axes")?;
    let rank = tensor.shape.len() + axes.len();
    let axes: Vec<usize> = axes
        .iter()
        .map(|axis| axis_of(*axis, rank))
        .collect::<Result<_, _>>()?;
    let mut own = tensor.shape.iter();
    let length = |axis: usize| {
        if axes.contains(&axis) {
            Some(1)
        } else {
            own.next().copied()
        }
    };
    let shape: Option<Vec<usize>> = (0..rank).map(length).collect();
    tensor.reshaped(shape.ok_or("an axis is named twice")?)
}

/// Numbers at the indices that `place` returns for each position of a shape.
fn picked(tensor: &Tensor, shape: Vec<usize>, place: impl Fn(&[usize]) -> usize) -> Tensor {
    let count: usize = shape.iter().product();
    let mut at = vec![0; shape.len()];
    let mut values = Vec::with_capacity(count);
    for _ in 0..count {
        values.push(tensor.values[place(&at)]);
        for (position, length) in at.iter_mut().zip(&shape).rev() {
            *position += 1;
            if *position < *length {
                break;
            }
            *position = 0;
        }
    }
    Tensor::new(tensor.kind, shape, values)
}

/// Index of the entry at a position.
fn place_of(position: impl Iterator<Item = usize>, shape: &[usize]) -> usize {
    position
        .zip(shape)
        .fold(0, |place, (at, length)| place * length + at)
}

fn transpose(settings: &Settings, tensor: &Tensor) -> Result<Tensor, String> {
    let rank = tensor.shape.len();
    let order: Vec<usize> = match settings.wholes("perm", None) {
        Some(order) => order
            .iter()
            .map(|axis| axis_of(*axis, rank))
            .collect::<Result<_, _>>()?,
        None => (0..rank).rev().collect(),
    };
    let mut sorted = order.clone();
    sorted.sort_unstable();
    if sorted != (0..rank).collect::<Vec<_>>() {
        return Err(format!("{order:?} is no order of {rank} axes"));
    }
    let shape = order.iter().map(|axis| tensor.shape[*axis]).collect();
    let back = |axis| order.iter().position(|it| *it == axis).unwrap_or(0);
    Ok(picked(tensor, shape, |at| {
        place_of((0..rank).map(|axis| at[back(axis)]), &tensor.shape)
    }))
}

fn concat(settings: &Settings, inputs: &Inputs<'_>) -> Result<Tensor, String> {
    let parts: Vec<&Tensor> = inputs.all().collect();
    let first = inputs.at(0)?;
    let axis = axis_of(settings.whole("axis", 0), first.shape.len())?;
    let is_fitting = |part: &&&Tensor| {
        let mut shape = part.shape.clone();
        shape.len() == first.shape.len() && {
            shape[axis] = first.shape[axis];
            shape == first.shape
        }
    };
    if let Some(other) = parts.iter().find(|part| !is_fitting(part)) {
        return Err(format!(
            "{:?} and {:?} do not stand beside each other",
            first.shape, other.shape
        ));
    }
    let before: usize = first.shape[..axis].iter().product();
    let mut values = Vec::new();
    for row in 0..before {
        for part in &parts {
            let width: usize = part.shape[axis..].iter().product();
            values.extend(&part.values[row * width..(row + 1) * width]);
        }
    }
    let mut shape = first.shape.clone();
    shape[axis] = parts.iter().map(|part| part.shape[axis]).sum();
    Ok(Tensor::new(first.kind, shape, values))
}

/// Part of an axis of the given length, from entry `from` on.
fn part_of(tensor: &Tensor, axis: usize, from: usize, length: usize) -> Tensor {
    let mut shape = tensor.shape.clone();
    shape[axis] = length;
    let shifted = |at: &[usize]| {
        let position = at
            .iter()
            .enumerate()
            .map(|(it, position)| if it == axis { position + from } else { *position });
        place_of(position, &tensor.shape)
    };
    picked(tensor, shape, shifted)
}

/// Operator `Split` in equal parts, or in parts of given lengths.
pub(super) fn split(settings: &Settings, inputs: &Inputs<'_>, parts: usize) -> Result<Vec<Tensor>, String> {
    let tensor = inputs.at(0)?;
    let axis = axis_of(settings.whole("axis", 0), tensor.shape.len())?;
    let whole = tensor.shape[axis];
    let wanted = match settings.wholes("split", inputs.maybe(1)) {
        Some(given) => lengths(&given)?,
        None => {
            let each = whole.div_ceil(parts.max(1));
            (0..parts)
                .map(|part| whole.saturating_sub(part * each).min(each))
                .collect()
        }
    };
    if wanted.len() != parts || wanted.iter().sum::<usize>() != whole {
        return Err(format!("{wanted:?} are no {parts} parts of {whole}"));
    }
    let mut from = 0;
    let next = |length: &usize| {
        from += length;
        part_of(tensor, axis, from - length, *length)
    };
    Ok(wanted.iter().map(next).collect())
}

/// Operator `Slice`: start, end and step of each axis.
fn slice(settings: &Settings, inputs: &Inputs<'_>) -> Result<Tensor, String> {
    let mut tensor = inputs.at(0)?.clone();
    let starts = settings
        .wholes("starts", inputs.maybe(1))
        .ok_or("it does not say where it begins")?;
    let ends = settings
        .wholes("ends", inputs.maybe(2))
        .ok_or("it does not say where it ends")?;
    let axes = settings.wholes("axes", inputs.maybe(3));
    let axes = axes.unwrap_or_else(|| (0..).take(starts.len()).collect());
    let steps = inputs
        .maybe(4)
        .map_or_else(|| vec![1; starts.len()], Tensor::numbers);
    for (((start, end), axis), step) in starts.iter().zip(&ends).zip(&axes).zip(&steps) {
        if *step != 1 {
            return Err(format!("steps of {step} are not known"));
        }
        let axis = axis_of(*axis, tensor.shape.len())?;
        let length = i64::try_from(tensor.shape[axis]).unwrap_or(i64::MAX);
        let counted = |at: i64| if at < 0 { at.saturating_add(length) } else { at }.clamp(0, length);
        let (from, to) = (counted(*start), counted(*end));
        let [from, length] = [from, (to - from).max(0)].map(|it| usize::try_from(it).unwrap_or(0));
        tensor = part_of(&tensor, axis, from, length);
    }
    Ok(tensor)
}

fn gather(settings: &Settings, inputs: &Inputs<'_>) -> Result<Tensor, String> {
    let (tensor, wanted) = (inputs.at(0)?, inputs.at(1)?);
    let axis = axis_of(settings.whole("axis", 0), tensor.shape.len())?;
    let at = |number: &i64| axis_of(*number, tensor.shape[axis]);
    let places: Vec<usize> = wanted.numbers().iter().map(at).collect::<Result<_, _>>()?;
    let mut flat = tensor.shape.clone();
    flat[axis] = places.len();
    let taken = |at: &[usize]| {
        let position = at
            .iter()
            .enumerate()
            .map(|(it, position)| if it == axis { places[*position] } else { *position });
        place_of(position, &tensor.shape)
    };
    let found = picked(tensor, flat, taken);
    found.reshaped([&tensor.shape[..axis], &wanted.shape, &tensor.shape[axis + 1..]].concat())
}

fn expand(tensor: &Tensor, to: &Tensor) -> Result<Tensor, String> {
    let shape = common(&tensor.shape, &lengths(&to.numbers())?)?;
    let spread = Broadcast::over(&tensor.shape, &shape);
    let count = shape.iter().product();
    let values = (0..count).map(|at| tensor.values[spread.at(at)]).collect();
    Ok(Tensor::new(tensor.kind, shape, values))
}

fn constant_of_shape(settings: &Settings, shape: &Tensor) -> Result<Tensor, String> {
    let shape = lengths(&shape.numbers())?;
    let count = count(&shape)?;
    let (kind, value) = settings.value().map_or((ElementType::Single, 0.0), |it| {
        (it.kind, it.values.first().copied().unwrap_or(0.0))
    });
    Ok(Tensor::new(kind, shape, vec![value; count]))
}
