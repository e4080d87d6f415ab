//! The decisions on each cell of a generator, as choices among options.
//!
//! The space is that of Gong et al. 2019 (AutoGAN), as in the thesis: three cells of 36, 72 and 144 forms.
//! Every step decides one cell with the same choices. Skips that a cell cannot have (the first has none, the
//! second has one) are decided all the same and have no effect, as in the released code of E2GAN.

pub use crate::architecture::N_CELLS;
use contract::Choice;

/// The choices of a step, in the order of the released code's heads.
#[must_use]
pub fn choices() -> Vec<Choice> {
    vec![
        Choice::new("convolution", &["post", "pre"]),
        Choice::new("norm", &["none", "batch", "instance"]),
        Choice::new("upsampling", &["bilinear", "nearest", "deconvolution"]),
        Choice::new("shortcut", &["no", "yes"]),
        Choice::new("skip_from_last", &["no", "yes"]),
        Choice::new("skip_from_first", &["no", "yes"]),
    ]
}

/// Options of one cell, in the order of [`choices`].
pub type CellOptions = [usize; 6];

/// Number of effective options of each choice of the cell at `step`, from 0: 1 for a choice without effect.
#[must_use]
pub fn n_options(step: usize) -> CellOptions {
    [
        2,
        3,
        3,
        2,
        if step > 0 { 2 } else { 1 },
        if step > 1 { 2 } else { 1 },
    ]
}

/// The options of a cell, with the first one for choices without effect.
///
/// # Panics
/// Where there are not six.
#[must_use]
pub fn effective(step: usize, taken: &[usize]) -> CellOptions {
    let sizes = n_options(step);
    std::array::from_fn(|choice| if sizes[choice] > 1 { taken[choice] } else { 0 })
}

/// Every form that the cell at `step` can have.
pub fn all_cells(step: usize) -> impl Iterator<Item = CellOptions> {
    let sizes = n_options(step);
    (0..sizes.iter().product::<usize>()).map(move |number| {
        let mut rest = number;
        let mut digit = |size: usize| {
            let digit = rest % size;
            rest /= size;
            digit
        };
        sizes.map(&mut digit)
    })
}

/// The genotype of the released code: convolution, norm, upsampling and shortcut of each cell, then its skips as one
/// number whose lowest bit is the latest cell before it; the first cell has none.
#[must_use]
pub fn genotype(cells: &[CellOptions]) -> Vec<u8> {
    let of_cell = |(step, cell): (usize, &CellOptions)| {
        let skips = (step > 0).then_some(cell[4] + 2 * cell[5]);
        let numbers: Vec<u8> = cell[..4]
            .iter()
            .copied()
            .chain(skips)
            .map(|number| number as u8)
            .collect();
        numbers
    };
    cells.iter().enumerate().flat_map(of_cell).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::architecture::{Architecture, E2GAN, N_ARCHITECTURES};
    use std::collections::BTreeSet;

    #[test]
    fn there_are_as_many_architectures_as_published() {
        let counts: Vec<usize> = (0..N_CELLS)
            .map(|step| all_cells(step).collect::<BTreeSet<_>>().len())
            .collect();
        assert_eq!(counts, [36, 72, 144]);
        assert_eq!(counts.iter().product::<usize>(), N_ARCHITECTURES);
        assert_eq!(contract::choice::n_options(&choices()), 14);
    }

    /// The published architecture: post, batch and bilinear with a shortcut; the same with a deconvolution; the same
    /// as the first with a skip from cell 1.
    #[test]
    fn the_published_genotype() {
        let cells = [[0, 1, 0, 1, 0, 0], [0, 1, 2, 1, 0, 0], [0, 1, 0, 1, 0, 1]];
        assert_eq!(genotype(&cells), [0, 1, 0, 1, 0, 1, 2, 1, 0, 0, 1, 0, 1, 2]);
        assert_eq!(Architecture::from_genotype(&genotype(&cells)), Ok(E2GAN));
    }

    #[test]
    fn skips_that_a_cell_cannot_have_count_for_nothing() {
        assert_eq!(effective(0, &[1, 2, 2, 1, 1, 1]), [1, 2, 2, 1, 0, 0]);
        assert_eq!(effective(1, &[1, 2, 2, 1, 1, 1]), [1, 2, 2, 1, 1, 0]);
        assert_eq!(effective(2, &[1, 2, 2, 1, 1, 1]), [1, 2, 2, 1, 1, 1]);
    }
}
