//! Scores of the quality of images, from the output of a classifier.
//!
//! | score | of | better |
//! |---|---|---|
//! | [`inception_score()`] | class probabilities `[images, classes]` | higher |
//! | [`frechet_distance()`] | features `[images, features]` of two sets | lower |
//!
//! Both depend on the number of images, so they compare only at equal numbers. The inception score of few
//! images is too low, since the certain classes of each image then count as common to its split. The Fréchet
//! distance of few images is too high, about in inverse proportion to their number, since errors of the means
//! and the covariances only add to it; with fewer images than features the covariance misses whole directions,
//! and the distance between two draws of the same distribution is of the order of its variance.
//!
//! Scores of one network are in the units of that network: they compare generators, but not with published
//! values, which are those of an Inception network.

mod frechet_distance;
mod inception_score;

pub use frechet_distance::{FrechetDistance, MomentSums, Moments, frechet_distance};
pub use inception_score::{InceptionScore, class_probabilities, inception_score};

/// Reason why images have no score.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ScoreError {
    /// Fewer images than the score needs.
    #[error("found {found} images; expected {needed} or more")]
    TooFewImages {
        /// Number of images.
        found: usize,
        /// Smallest number of images.
        needed: usize,
    },
    /// Numbers that are not probabilities of the classes.
    #[error(
        "the probabilities of image {image} (the first is 0) are negative, or their sum, {sum}, is not 1"
    )]
    NoProbabilities {
        /// Position of the first such image, from 0.
        image: usize,
        /// Sum of the probabilities; NaN where one of them is NaN.
        sum: f64,
    },
    /// A feature that is not finite.
    #[error("feature {feature} of image {image} (the first is 0) is {found}")]
    NotFinite {
        /// Position of the first such image, from 0.
        image: usize,
        /// Position of the feature, from 0.
        feature: usize,
        /// Value of the feature.
        found: f32,
    },
    /// Moments of different features or of none, or a covariance that is not square.
    #[error("moments of {first} and {second} features, or with a covariance of another shape")]
    Shapes {
        /// Length of the first mean.
        first: usize,
        /// Length of the second.
        second: usize,
    },
    /// Moments or products of moments that are not finite, or a covariance whose eigenvalues were not found.
    #[error("the moments of {features} features are not finite, or too large to be multiplied")]
    Moments {
        /// Number of features.
        features: usize,
    },
}
