//! Weights of the network, from a published file.

use safetensors::Dtype;
use safetensors::tensor::{Metadata, TensorInfo};
use std::path::{Path, PathBuf};

/// Term that is added to a variance under its root.
const EPSILON: f64 = 1e-3;
/// Bytes before the header, which hold its length.
const LENGTH: usize = 8;

/// Reason why a file does not hold the weights of the network.
#[derive(Debug, thiserror::Error)]
pub enum InceptionError {
    /// The file cannot be read.
    #[error("cannot read `{}`: {source}", path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// The file is not a safetensors file.
    #[error("`{}` is no safetensors file: {problem}", path.display())]
    Format {
        /// Path of the file.
        path: PathBuf,
        /// Description of the problem.
        problem: String,
    },
    /// A tensor is missing.
    #[error("there is no tensor `{name}`")]
    Missing {
        /// Name of the tensor.
        name: String,
    },
    /// A tensor has a wrong shape.
    #[error("the tensor `{name}` is {found:?}; expected {expected:?}")]
    Shape {
        /// Name of the tensor.
        name: String,
        /// Required shape.
        expected: Vec<usize>,
        /// Shape in the file.
        found: Vec<usize>,
    },
    /// A tensor has numbers of an unsupported type.
    #[error("the tensor `{name}` holds {found}; expected F32 or F16")]
    Type {
        /// Name of the tensor.
        name: String,
        /// Type in the file's notation.
        found: String,
    },
    /// The number of bytes of a tensor does not match its shape.
    #[error("the tensor `{name}` has {found} bytes; its shape needs {expected}")]
    Length {
        /// Name of the tensor.
        name: String,
        /// Number of bytes for its shape.
        expected: usize,
        /// Number of bytes in the file.
        found: usize,
    },
    /// The file ends before or inside a tensor.
    #[error("the file ends before the end of the tensor `{name}`")]
    CutOff {
        /// Name of the tensor.
        name: String,
    },
    /// A number is infinite or NaN, or a variance is negative.
    #[error("the tensor `{name}` has {found} at entry {at} (the first is 0)")]
    Value {
        /// Name of the tensor.
        name: String,
        /// Position of the first such number, from 0.
        at: usize,
        /// The number.
        found: f32,
    },
}

/// Returns the numbers of a tensor with this name and shape.
pub(super) type Lookup<'a> = &'a dyn Fn(&str, &[usize]) -> Result<Vec<f32>, InceptionError>;

/// The content of a file of tensors.
pub(super) struct WeightFile {
    tensors: Metadata,
    /// Bytes behind the header.
    data: Vec<u8>,
}

impl WeightFile {
    /// Reads the file; also an incomplete one, for which the error then names the first incomplete tensor.
    pub(super) fn read(path: &Path) -> Result<Self, InceptionError> {
        let mut bytes = std::fs::read(path).map_err(|source| InceptionError::File {
            path: path.into(),
            source,
        })?;
        let format = |problem: String| InceptionError::Format {
            path: path.into(),
            problem,
        };
        let header = header(&bytes).ok_or_else(|| format("it ends in its header".into()))?;
        let tensors = serde_json::from_slice(header).map_err(|error| format(error.to_string()))?;
        let end = LENGTH + header.len();
        bytes.drain(..end);
        Ok(Self { tensors, data: bytes })
    }

    pub(super) fn tensor(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, InceptionError> {
        let info = self
            .tensors
            .info(name)
            .ok_or_else(|| InceptionError::Missing { name: name.into() })?;
        if info.shape != shape {
            return Err(InceptionError::Shape {
                name: name.into(),
                expected: shape.into(),
                found: info.shape.clone(),
            });
        }
        finite(name, self.values(name, info)?)
    }

    fn values(&self, name: &str, info: &TensorInfo) -> Result<Vec<f32>, InceptionError> {
        match info.dtype {
            Dtype::F32 => Ok(entries(self.bytes(name, info, 4)?, f32::from_le_bytes)),
            Dtype::F16 => Ok(entries(self.bytes(name, info, 2)?, |two| {
                widened(u16::from_le_bytes(two))
            })),
            other => Err(InceptionError::Type {
                name: name.into(),
                found: format!("{other:?}"),
            }),
        }
    }

    /// The bytes of a tensor whose entries have `width` bytes; its shape was checked before.
    fn bytes(&self, name: &str, info: &TensorInfo, width: usize) -> Result<&[u8], InceptionError> {
        let (start, end) = info.data_offsets;
        let (expected, found) = (
            info.shape.iter().product::<usize>() * width,
            end.saturating_sub(start),
        );
        if expected != found {
            return Err(InceptionError::Length {
                name: name.into(),
                expected,
                found,
            });
        }
        let bytes = self.data.get(start..end);
        bytes.ok_or_else(|| InceptionError::CutOff { name: name.into() })
    }
}

/// The bytes of the header; `None` where the file ends before.
fn header(bytes: &[u8]) -> Option<&[u8]> {
    let (length, rest) = bytes.split_first_chunk::<LENGTH>()?;
    rest.get(..usize::try_from(u64::from_le_bytes(*length)).ok()?)
}

fn entries<const N: usize>(bytes: &[u8], entry: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    bytes.as_chunks().0.iter().map(|bytes| entry(*bytes)).collect()
}

/// The number of the bits of an `f16`, by IEEE 754.
pub(super) fn widened(bits: u16) -> f32 {
    let (exponent, fraction) = (bits >> 10 & 0x1F, bits & 0x3FF);
    let size = match exponent {
        // Multiples of 2^-24, which are exact.
        0 => f32::from(fraction) / 16_777_216.0,
        0x1F if fraction == 0 => f32::INFINITY,
        0x1F => f32::NAN,
        // The bias of the exponent is 15 here and 127 there.
        _ => f32::from_bits((u32::from(exponent) + 112) << 23 | u32::from(fraction) << 13),
    };
    if bits >> 15 == 1 { -size } else { size }
}

fn finite(name: &str, values: Vec<f32>) -> Result<Vec<f32>, InceptionError> {
    let variance = name.ends_with("running_var");
    let wrong = |value: &f32| !value.is_finite() || (variance && *value < 0.0);
    match values.iter().position(wrong) {
        None => Ok(values),
        Some(at) => Err(InceptionError::Value {
            name: name.into(),
            at,
            found: values[at],
        }),
    }
}

/// Weight and bias of a convolution that includes the normalisation after it: with the gain `g`, the shift `b`,
/// the mean `m` and the variance `v` of an output, `w g / sqrt(v + 0.001)` and `b - m g / sqrt(v + 0.001)`.
#[allow(clippy::cast_possible_truncation, reason = "rounded to f32 once")]
pub(super) fn folded(
    layer: &str,
    shape: [usize; 4],
    lookup: Lookup,
) -> Result<(Vec<f32>, Vec<f32>), InceptionError> {
    let mut weight = lookup(&format!("{layer}.conv.weight"), &shape)?;
    let of_output = |part: &str| lookup(&format!("{layer}.bn.{part}"), &shape[..1]);
    let (gain, shift) = (of_output("weight")?, of_output("bias")?);
    let (mean, variance) = (of_output("running_mean")?, of_output("running_var")?);
    let mut bias = Vec::with_capacity(shape[0]);
    for (at, weights) in weight
        .chunks_exact_mut(shape[1] * shape[2] * shape[3])
        .enumerate()
    {
        let factor = f64::from(gain[at]) / (f64::from(variance[at]) + EPSILON).sqrt();
        for weight in weights {
            *weight = (f64::from(*weight) * factor) as f32;
        }
        bias.push((f64::from(shift[at]) - f64::from(mean[at]) * factor) as f32);
    }
    Ok((weight, bias))
}
