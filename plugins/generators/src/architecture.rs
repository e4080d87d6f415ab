//! The space of generator architectures of AutoGAN and E2GAN: three cells, 373 248 architectures.
//!
//! Gong et al. 2019, "AutoGAN: neural architecture search for generative adversarial networks",
//! arXiv:1908.03835, section 3.1; Tian et al. 2020, "Off-policy reinforcement learning for efficient and
//! effective GAN architecture search", arXiv:2007.09180. A genotype is 14 integers as their programs write it:
//!
//! | place | meaning | values |
//! |---|---|---|
//! | 1 | order of a block | 0 convolution first, 1 normalisation first |
//! | 2 | normalisation | 0 none, 1 batch, 2 instance |
//! | 3 | upsampling | 0 bilinear, 1 nearest, 2 deconvolution |
//! | 4 | shortcut | 0 no, 1 yes |
//! | 5, from the second cell on | skips from earlier cells | binary, the lowest digit for the cell just before |
//!
//! It is written as `0 1 0 1 | 0 1 2 1 0 | 0 1 0 1 2`.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Number of cells of a generator.
pub const N_CELLS: usize = 3;
/// Number of architectures in the space.
pub const N_ARCHITECTURES: usize = 36 * 72 * 144;
/// Number of integers of a genotype.
pub const N_GENES: usize = 14;

/// Number of options of each gene, cell after cell.
const OPTIONS: [u8; N_GENES] = [2, 3, 3, 2, 2, 3, 3, 2, 2, 2, 3, 3, 2, 4];
/// Position of the first gene of each cell.
const BEGIN: [usize; N_CELLS] = [0, 4, 9];

/// Order of the operations in a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Order {
    /// Upsampling, convolution, normalisation, rectifier.
    ConvolutionFirst,
    /// Normalisation, rectifier, upsampling, convolution.
    NormalisationFirst,
}

/// Normalisation in a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Normalisation {
    /// No normalisation.
    None,
    /// Over the batch, with weights.
    Batch,
    /// Over each image, without weights.
    Instance,
}

/// Method by which a cell enlarges its maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Upsampling {
    /// Bilinear interpolation.
    Bilinear,
    /// Copies of the nearest pixel.
    Nearest,
    /// A learnt deconvolution.
    Deconvolution,
}

/// The options of one cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct CellArchitecture {
    /// Order of the operations in both blocks.
    pub order: Order,
    /// Normalisation of both blocks.
    pub normalisation: Normalisation,
    /// Enlargement in the first block, the shortcut and the skips.
    pub upsampling: Upsampling,
    /// Whether the enlarged input is added to the output.
    pub shortcut: bool,
    /// Whether the skip output of each earlier cell is added, first cell first; `false` for cells that are not
    /// earlier.
    pub skips: [bool; N_CELLS - 1],
}

/// One generator of the space.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Architecture {
    /// The cells, from the smallest map to the largest.
    pub cells: [CellArchitecture; N_CELLS],
}

/// Result of E2GAN's search (the genotype in its program, for CIFAR-10 and STL-10).
pub const E2GAN: Architecture = Architecture {
    cells: [
        found([0, 1, 0, 1], [false, false]),
        found([0, 1, 2, 1], [false, false]),
        found([0, 1, 0, 1], [true, false]),
    ],
};

/// Result of AutoGAN's search (the genotype in its program, for training from scratch).
pub const AUTOGAN: Architecture = Architecture {
    cells: [
        found([1, 0, 1, 1], [false, false]),
        found([1, 0, 0, 1], [true, false]),
        found([1, 0, 1, 0], [true, true]),
    ],
};

/// Reason why a text or a list is not a genotype.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum GenotypeError {
    /// The number of integers is not 14.
    #[error("a genotype is {N_GENES} integers, found {found}")]
    Length {
        /// Number of integers.
        found: usize,
    },
    /// An integer exceeds the options of its gene.
    #[error("integer {place} of a genotype is below {options}, found {found}")]
    Gene {
        /// Position of the gene, counted from 1.
        place: usize,
        /// Number of options of the gene.
        options: u8,
        /// Value of the integer.
        found: u8,
    },
    /// A word is not a small integer.
    #[error("`{word}` is no integer of a genotype")]
    Word {
        /// The word as it is written.
        word: String,
    },
}

impl Architecture {
    /// The architecture of a genotype.
    ///
    /// # Errors
    /// [`GenotypeError`] where an integer is beyond its options.
    pub fn from_genotype(genotype: &[u8]) -> Result<Self, GenotypeError> {
        if genotype.len() != N_GENES {
            return Err(GenotypeError::Length {
                found: genotype.len(),
            });
        }
        let wrong = (0..N_GENES).find(|at| genotype[*at] >= OPTIONS[*at]);
        if let Some(at) = wrong {
            return Err(GenotypeError::Gene {
                place: at + 1,
                options: OPTIONS[at],
                found: genotype[at],
            });
        }
        let cells = std::array::from_fn(|cell| {
            let genes = &genotype[BEGIN[cell]..];
            let skips = if cell == 0 { 0 } else { genes[4] };
            let from = |earlier: usize| earlier < cell && skips >> (cell - 1 - earlier) & 1 == 1;
            found(
                [genes[0], genes[1], genes[2], genes[3]],
                std::array::from_fn(from),
            )
        });
        Ok(Self { cells })
    }

    /// The architecture as integers.
    #[must_use]
    pub fn genotype(&self) -> [u8; N_GENES] {
        let mut genotype = [0; N_GENES];
        for (cell, architecture) in self.cells.iter().enumerate() {
            let genes = &mut genotype[BEGIN[cell]..];
            genes[0] = architecture.order as u8;
            genes[1] = architecture.normalisation as u8;
            genes[2] = architecture.upsampling as u8;
            genes[3] = u8::from(architecture.shortcut);
            if cell > 0 {
                let digits = architecture.skips[..cell].iter();
                genes[4] = digits.fold(0, |number, skip| 2 * number + u8::from(*skip));
            }
        }
        genotype
    }

    /// The architecture of a number below [`N_ARCHITECTURES`]; the last integer of the genotype runs fastest.
    #[must_use]
    pub fn from_index(index: usize) -> Option<Self> {
        let (mut left, mut genotype) = (index, [0; N_GENES]);
        for (gene, options) in genotype.iter_mut().zip(OPTIONS).rev() {
            // A remainder of at most 3.
            *gene = (left % usize::from(options)) as u8;
            left /= usize::from(options);
        }
        (left == 0).then(|| Self::from_genotype(&genotype).ok()).flatten()
    }

    /// The number that [`Architecture::from_index`] turns into this architecture.
    #[must_use]
    pub fn index(&self) -> usize {
        let genes = self.genotype().into_iter().zip(OPTIONS);
        genes.fold(0, |index, (gene, options)| {
            index * usize::from(options) + usize::from(gene)
        })
    }
}

/// A cell from genes that are within their options.
const fn found([order, normalisation, upsampling, shortcut]: [u8; 4], skips: [bool; 2]) -> CellArchitecture {
    CellArchitecture {
        order: if order == 0 {
            Order::ConvolutionFirst
        } else {
            Order::NormalisationFirst
        },
        normalisation: match normalisation {
            0 => Normalisation::None,
            1 => Normalisation::Batch,
            _ => Normalisation::Instance,
        },
        upsampling: match upsampling {
            0 => Upsampling::Bilinear,
            1 => Upsampling::Nearest,
            _ => Upsampling::Deconvolution,
        },
        shortcut: shortcut == 1,
        skips,
    }
}

impl fmt::Display for Architecture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (at, gene) in self.genotype().iter().enumerate() {
            let before = match at {
                0 => "",
                _ if BEGIN.contains(&at) => " | ",
                _ => " ",
            };
            write!(f, "{before}{gene}")?;
        }
        Ok(())
    }
}

impl FromStr for Architecture {
    type Err = GenotypeError;

    /// Integers between spaces; bars are read as spaces.
    fn from_str(text: &str) -> Result<Self, GenotypeError> {
        let words = text
            .split(|c: char| c.is_whitespace() || c == '|')
            .filter(|word| !word.is_empty());
        let genes = words.map(|word| {
            word.parse()
                .map_err(|_| GenotypeError::Word { word: word.into() })
        });
        Self::from_genotype(&genes.collect::<Result<Vec<u8>, _>>()?)
    }
}

impl TryFrom<String> for Architecture {
    type Error = GenotypeError;

    fn try_from(text: String) -> Result<Self, GenotypeError> {
        text.parse()
    }
}

impl From<Architecture> for String {
    fn from(architecture: Architecture) -> Self {
        architecture.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn every_architecture_comes_back_and_is_another_one() {
        let mut seen = HashSet::new();
        for index in 0..N_ARCHITECTURES {
            let architecture = Architecture::from_index(index).unwrap();
            assert_eq!(architecture.index(), index);
            assert_eq!(
                Architecture::from_genotype(&architecture.genotype()),
                Ok(architecture)
            );
            assert!(seen.insert(architecture));
        }
        assert_eq!(Architecture::from_index(N_ARCHITECTURES), None);
        assert_eq!(seen.len(), 373_248);
    }

    #[test]
    fn published_genotypes() {
        assert_eq!(E2GAN.to_string(), "0 1 0 1 | 0 1 2 1 0 | 0 1 0 1 2");
        assert_eq!(AUTOGAN.to_string(), "1 0 1 1 | 1 0 0 1 1 | 1 0 1 0 3");
        for architecture in [E2GAN, AUTOGAN] {
            assert_eq!(architecture.to_string().parse(), Ok(architecture));
            let json = serde_json::to_string(&architecture).unwrap();
            assert_eq!(serde_json::from_str::<Architecture>(&json).unwrap(), architecture);
        }
    }

    #[test]
    fn the_lowest_digit_is_the_cell_just_before() {
        let skips = |gene: u8| {
            let mut genotype = E2GAN.genotype();
            genotype[13] = gene;
            Architecture::from_genotype(&genotype).unwrap().cells[2].skips
        };
        assert_eq!(skips(1), [false, true]);
        assert_eq!(skips(2), [true, false]);
        let mut genotype = E2GAN.genotype();
        genotype[8] = 1;
        assert_eq!(
            Architecture::from_genotype(&genotype).unwrap().cells[1].skips,
            [true, false]
        );
    }

    #[test]
    fn mistakes_say_where_they_are() {
        let error = |text: &str| text.parse::<Architecture>().unwrap_err().to_string();
        assert_eq!(error("0 1 0 1"), "a genotype is 14 integers, found 4");
        assert_eq!(
            error("0 1 0 1 | 0 1 3 1 0 | 0 1 0 1 2"),
            "integer 7 of a genotype is below 3, found 3"
        );
        assert_eq!(
            error("0 1 0 -1 | 0 1 2 1 0 | 0 1 0 1 2"),
            "`-1` is no integer of a genotype"
        );
    }
}
