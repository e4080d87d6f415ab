//! Ring buffer of rows of numbers: a full buffer replaces its oldest row.

use numerics::tensor_file::{HostTensor, TensorFile, TensorFileError};

/// Rows of one length in a buffer of bounded size.
#[derive(Debug, Clone, PartialEq)]
pub struct Ring {
    capacity: usize,
    width: usize,
    rows: Vec<f32>,
    oldest: usize,
}

impl Ring {
    /// Creates an empty buffer for at most `capacity` rows, at least one, of `width` numbers.
    #[must_use]
    pub fn new(capacity: usize, width: usize) -> Self {
        Self {
            capacity: capacity.max(1),
            width,
            rows: Vec::new(),
            oldest: 0,
        }
    }

    /// Number of stored rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows.len() / self.width
    }

    /// Whether no row is stored.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Number of entries of a row.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Index of the row that is replaced next; 0 until the buffer is full.
    #[must_use]
    pub fn oldest(&self) -> usize {
        self.oldest
    }

    /// Row at index `at`, `[width]`.
    ///
    /// # Panics
    /// Where no row is stored at `at`.
    #[must_use]
    pub fn row(&self, at: usize) -> &[f32] {
        &self.rows[at * self.width..(at + 1) * self.width]
    }

    /// All rows in the order of their indices, each `[width]`.
    pub fn rows(&self) -> impl Iterator<Item = &[f32]> {
        self.rows.chunks(self.width)
    }

    /// Adds a row; returns the row that it replaced.
    ///
    /// # Panics
    /// Where the row has another length.
    pub fn push(&mut self, row: &[f32]) -> Option<Vec<f32>> {
        assert_eq!(row.len(), self.width, "entries of a row");
        if self.len() < self.capacity {
            self.rows.extend(row);
            return None;
        }
        let place = self.oldest * self.width..(self.oldest + 1) * self.width;
        let left = self.rows[place.clone()].to_vec();
        self.rows[place].copy_from_slice(row);
        self.oldest = (self.oldest + 1) % self.capacity;
        Some(left)
    }

    /// Stores the rows under `name` in a file and its header.
    pub fn store(&self, name: &str, file: &mut TensorFile) {
        let tensor = HostTensor {
            shape: vec![self.len(), self.width],
            values: self.rows.clone(),
        };
        file.insert(name, tensor);
        file.header[name]["oldest"] = serde_json::json!(self.oldest);
    }

    /// Restores the rows that [`Ring::store`] wrote.
    ///
    /// # Errors
    /// [`TensorFileError`] where the file does not contain such rows or they have another shape.
    pub fn restore(&mut self, name: &str, file: &TensorFile) -> Result<(), TensorFileError> {
        let stored = file.get(name)?;
        let oldest = file.header[name]["oldest"].as_u64();
        let oldest = oldest
            .and_then(|oldest| usize::try_from(oldest).ok())
            .ok_or_else(|| TensorFileError::Missing {
                name: format!("{name}.oldest"),
            })?;
        let fits = stored.shape.len() == 2
            && stored.shape[1] == self.width
            && stored.shape[0] <= self.capacity
            && oldest < self.capacity;
        if !fits {
            return Err(TensorFileError::Shape {
                expected: format!("at most {} rows of {} numbers", self.capacity, self.width),
                found: format!("{:?}", stored.shape),
            });
        }
        (self.rows, self.oldest) = (stored.values.clone(), oldest);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(rows: u8) -> Ring {
        let mut ring = Ring::new(3, 2);
        for row in 0..rows {
            let left = ring.push(&[f32::from(row), -1.0]);
            // From the fourth row on, each replaces the third one before it.
            let expected = row.checked_sub(3).map(|gone| vec![f32::from(gone), -1.0]);
            assert_eq!(left, expected);
        }
        ring
    }

    #[test]
    fn the_oldest_row_gives_way() {
        assert!(filled(0).is_empty());
        assert_eq!((filled(2).len(), filled(2).oldest()), (2, 0));
        let ring = filled(5);
        let firsts: Vec<f32> = ring.rows().map(|row| row[0]).collect();
        assert_eq!((firsts, ring.oldest()), (vec![3.0, 4.0, 2.0], 2));
        assert_eq!((ring.row(1), ring.len(), ring.width()), (&[4.0, -1.0][..], 3, 2));
    }

    #[test]
    fn a_restored_ring_continues_and_another_shape_is_refused() {
        let mut file = TensorFile::default();
        let mut ring = filled(5);
        ring.store("rows", &mut file);
        let mut again = Ring::new(3, 2);
        again.restore("rows", &file).unwrap();
        assert_eq!(again, ring);
        assert_eq!(ring.push(&[9.0, 9.0]), again.push(&[9.0, 9.0]));
        for mut other in [Ring::new(3, 3), Ring::new(2, 2)] {
            assert!(matches!(
                other.restore("rows", &file),
                Err(TensorFileError::Shape { .. })
            ));
        }
        assert!(matches!(
            again.restore("memory", &file),
            Err(TensorFileError::Missing { .. })
        ));
    }
}
