//! Named `f32` tensors and one JSON header in a safetensors file, written and read bit by bit.
//!
//! The header is stored as one metadata entry, `header`, so that the same content always has the same bytes.

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const HEADER: &str = "header";

/// Reason why a file of tensors could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum TensorFileError {
    /// The operating system refused.
    #[error("cannot {doing} `{}`: {source}", path.display())]
    File {
        /// Attempted action, as a phrase.
        doing: &'static str,
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The file is no safetensors file with `f32` tensors and a header.
    #[error("not a file of f32 tensors: {problem}")]
    Format {
        /// The fault, as a phrase.
        problem: String,
    },
    /// A tensor or an entry of the header is missing.
    #[error("there is no `{name}`")]
    Missing {
        /// Name of the tensor or entry.
        name: String,
    },
    /// Tensors have other names or shapes than their destination.
    #[error("expected {expected}, found {found}")]
    Shape {
        /// Required names and shapes.
        expected: String,
        /// Names and shapes in the file.
        found: String,
    },
    /// One of these faults, in a file with a path.
    #[error("`{}`: {problem}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The fault.
        problem: Box<TensorFileError>,
    },
}

impl TensorFileError {
    /// The same error with the path of its file.
    #[must_use]
    pub fn in_file(self, path: &Path) -> Self {
        match self {
            named @ (Self::File { .. } | Self::Damaged { .. }) => named,
            problem => Self::Damaged {
                path: path.into(),
                problem: Box::new(problem),
            },
        }
    }
}

/// Numbers with a shape.
#[derive(Debug, Clone, PartialEq)]
pub struct HostTensor {
    /// Length of each dimension.
    pub shape: Vec<usize>,
    /// Entries, the last dimension running fastest.
    pub values: Vec<f32>,
}

/// Tensors by name, and a JSON header.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TensorFile {
    tensors: BTreeMap<String, HostTensor>,
    /// Everything besides `f32` tensors: counters, layer sizes, names.
    pub header: Value,
}

impl TensorFile {
    /// Adds a tensor, or replaces the one of this name.
    ///
    /// # Panics
    /// If the number of entries is not the product of the shape.
    pub fn insert(&mut self, name: impl Into<String>, tensor: HostTensor) {
        assert_eq!(
            tensor.shape.iter().product::<usize>(),
            tensor.values.len(),
            "entries of shape {:?}",
            tensor.shape
        );
        self.tensors.insert(name.into(), tensor);
    }

    /// Adds a vector, or replaces the one of this name.
    pub fn insert_vector(&mut self, name: impl Into<String>, values: Vec<f32>) {
        self.insert(
            name,
            HostTensor {
                shape: vec![values.len()],
                values,
            },
        );
    }

    /// Tensor called `name`.
    ///
    /// # Errors
    /// [`TensorFileError::Missing`] for an unknown name.
    pub fn get(&self, name: &str) -> Result<&HostTensor, TensorFileError> {
        self.tensors
            .get(name)
            .ok_or_else(|| TensorFileError::Missing { name: name.into() })
    }

    /// Writes the file; replaces an existing one.
    ///
    /// # Errors
    /// [`TensorFileError::File`] if the operating system refuses.
    pub fn write(&self, path: &Path) -> Result<(), TensorFileError> {
        let bytes = self.to_bytes()?;
        std::fs::write(path, bytes).map_err(|source| TensorFileError::File {
            doing: "write",
            path: path.into(),
            source,
        })
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`TensorFileError::File`] if the operating system refuses; [`TensorFileError::Damaged`] for other content.
    pub fn read(path: &Path) -> Result<Self, TensorFileError> {
        let bytes = std::fs::read(path).map_err(|source| TensorFileError::File {
            doing: "read",
            path: path.into(),
            source,
        })?;
        Self::from_bytes(&bytes).map_err(|problem| problem.in_file(path))
    }

    fn to_bytes(&self) -> Result<Vec<u8>, TensorFileError> {
        let le_bytes = |tensor: &HostTensor| {
            tensor
                .values
                .iter()
                .flat_map(|value| value.to_le_bytes())
                .collect::<Vec<u8>>()
        };
        let data: Vec<(&str, Vec<u8>)> = self
            .tensors
            .iter()
            .map(|(name, tensor)| (name.as_str(), le_bytes(tensor)))
            .collect();
        let views = data
            .iter()
            .zip(self.tensors.values())
            .map(|((name, bytes), tensor)| {
                Ok((
                    *name,
                    TensorView::new(Dtype::F32, tensor.shape.clone(), bytes).map_err(format_error)?,
                ))
            });
        let views = views.collect::<Result<Vec<_>, TensorFileError>>()?;
        let header = [(HEADER.to_string(), self.header.to_string())]
            .into_iter()
            .collect();
        safetensors::serialize(views, Some(header)).map_err(format_error)
    }

    fn from_bytes(bytes: &[u8]) -> Result<Self, TensorFileError> {
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(format_error)?;
        let header = metadata
            .metadata()
            .as_ref()
            .and_then(|entries| entries.get(HEADER));
        let header = header.ok_or_else(|| TensorFileError::Missing { name: HEADER.into() })?;
        let header = serde_json::from_str(header).map_err(format_error)?;
        let file = SafeTensors::deserialize(bytes).map_err(format_error)?;
        let tensors = file
            .iter()
            .map(|(name, view)| Ok((name.to_string(), host_tensor(&view)?)));
        Ok(Self {
            tensors: tensors.collect::<Result<_, TensorFileError>>()?,
            header,
        })
    }
}

fn host_tensor(view: &TensorView<'_>) -> Result<HostTensor, TensorFileError> {
    if view.dtype() != Dtype::F32 {
        return Err(TensorFileError::Format {
            problem: format!("a tensor holds {:?}", view.dtype()),
        });
    }
    // Chunks of four bytes are four bytes long.
    let values = view
        .data()
        .chunks_exact(4)
        .map(|four| f32::from_le_bytes([four[0], four[1], four[2], four[3]]))
        .collect();
    Ok(HostTensor {
        shape: view.shape().to_vec(),
        values,
    })
}

fn format_error(source: impl std::fmt::Display) -> TensorFileError {
    TensorFileError::Format {
        problem: source.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn example() -> TensorFile {
        let mut file = TensorFile {
            header: json!({"count": 3, "rate": 0.1}),
            ..TensorFile::default()
        };
        let values = vec![
            f32::MIN_POSITIVE / 2.0,
            -0.0,
            f32::NAN,
            f32::INFINITY,
            0.1,
            1.0 / 3.0,
        ];
        file.insert(
            "b",
            HostTensor {
                shape: vec![2, 3],
                values,
            },
        );
        file.insert_vector("a", vec![]);
        file
    }

    #[test]
    fn bits_and_bytes_survive() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x.safetensors");
        example().write(&path).unwrap();
        let back = TensorFile::read(&path).unwrap();
        let bits = |file: &TensorFile| {
            file.get("b")
                .unwrap()
                .values
                .iter()
                .map(|v| v.to_bits())
                .collect::<Vec<_>>()
        };
        assert_eq!(bits(&back), bits(&example()));
        assert_eq!(back.header, example().header);
        assert_eq!(back.to_bytes().unwrap(), example().to_bytes().unwrap());
    }

    #[test]
    fn damage_is_an_error() {
        let bytes = example().to_bytes().unwrap();
        assert!(TensorFile::from_bytes(&bytes[..bytes.len() - 1]).is_err());
        assert!(TensorFile::from_bytes(b"nonsense").is_err());
        assert!(matches!(example().get("c"), Err(TensorFileError::Missing { .. })));
    }

    /// Number of values in the file, which bounds the memory by the file's size.
    fn n_values(file: &TensorFile) -> usize {
        file.tensors.values().map(|tensor| tensor.values.len()).sum()
    }

    #[test]
    fn a_flipped_bit_is_refused_or_harmless_and_a_truncated_file_is_refused() {
        let bytes = example().to_bytes().unwrap();
        for place in 0..bytes.len() {
            assert!(TensorFile::from_bytes(&bytes[..place]).is_err(), "cut at {place}");
            for bit in 0..8 {
                let mut changed = bytes.clone();
                changed[place] ^= 1 << bit;
                if let Ok(file) = TensorFile::from_bytes(&changed) {
                    assert!(n_values(&file) * 4 <= bytes.len(), "bit {bit} of byte {place}");
                    let again = TensorFile::from_bytes(&file.to_bytes().unwrap()).unwrap();
                    assert_eq!(again.to_bytes().unwrap(), file.to_bytes().unwrap());
                }
            }
        }
    }

    #[test]
    fn a_damaged_file_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x.safetensors");
        let mut bytes = example().to_bytes().unwrap();
        bytes.pop();
        std::fs::write(&path, bytes).unwrap();
        let error = TensorFile::read(&path).unwrap_err().to_string();
        assert!(error.contains(&*path.to_string_lossy()), "{error}");
    }
}
