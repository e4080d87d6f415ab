//! Squares that are turned in registers: none on this kind of processor.

use crate::panel::PANEL;
use crate::products::Matrix;

/// Copies nothing.
pub(crate) fn turn(_: &mut [[f32; PANEL]], _: &[f32]) -> [usize; 2] {
    [0; 2]
}

/// Writes nothing.
pub(crate) fn multiply_column(_: Matrix, _: &[f32], _: &mut [f32]) -> usize {
    0
}
