//! How good images are: scores of what a classifier says of them.
//!
//! | score | of | better |
//! |---|---|---|
//! | [`inception_score()`] | class probabilities `[images, classes]` | higher |
//! | [`frechet_distance()`] | features `[images, features]` of two sets | lower |
//!
//! Both depend on the number of images, so they compare only at equal numbers. The inception score of few images is
//! too low, since what is certain of each image is then taken for what is common to all of a split. The Fréchet
//! distance of few images is too high, about in inverse proportion to their number, since errors of the means and
//! the covariances only add to it; with fewer images than features the covariance misses whole directions, and the
//! distance between two draws of the same distribution is of the order of its variance.
//!
//! Scores of one network are in the units of that network: they compare generators, and compare with no published
//! value, which is that of an Inception network.

mod frechet_distance;
mod inception_score;

pub use frechet_distance::{FrechetDistance, MomentSums, Moments, frechet_distance};
pub use inception_score::{InceptionScore, class_probabilities, inception_score};

/// Why images have no score.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ScoreError {
    /// Fewer images than the score needs.
    #[error("found {found} images; expected {needed} or more")]
    TooFewImages {
        /// How many there are.
        found: usize,
        /// How many it takes.
        needed: usize,
    },
    /// Numbers that are no probabilities of the classes.
    #[error(
        "the probabilities of image {image} (the first is 0) are negative, or their sum, {sum}, is not 1"
    )]
    NoProbabilities {
        /// The first such image, from 0.
        image: usize,
        /// What they add up to; no number where one of them is none.
        sum: f64,
    },
    /// A feature that is no finite number.
    #[error("feature {feature} of image {image} (the first is 0) is {found}")]
    NotFinite {
        /// The first such image, from 0.
        image: usize,
        /// Which of its features, from 0.
        feature: usize,
        /// What it is.
        found: f32,
    },
    /// Moments of different features or of none, or a covariance that is no square.
    #[error("moments of {first} and {second} features, or with a covariance of another shape")]
    Shapes {
        /// Length of the first mean.
        first: usize,
        /// Length of the second.
        second: usize,
    },
    /// Moments that are not finite or whose products are not, or a covariance whose eigenvalues were not found.
    #[error("the moments of {features} features are not finite, or too large to be multiplied")]
    Moments {
        /// How many features there are.
        features: usize,
    },
}
