//! Generative adversarial networks and the space of their architectures: images, networks, scores, and the search
//! of chapter 5 of the thesis as an environment.
//!
//! Images are `[batch, height, width, 3]` in [-1, 1], channels last, everywhere: the kernels of
//! [`image`] read whole pixels at once, which is faster than planes.

pub mod adversarial;
pub mod architecture;
mod cache;
pub mod classifier;
pub mod discriminator;
pub mod feature_network;
pub mod generator;
pub mod image;
pub mod images;
pub mod inception;
pub mod layers;
// The check that the learners of `agents` pass, too.
#[cfg(test)]
#[path = "../../agents/src/shared/population.rs"]
mod population;
#[cfg(test)]
mod reference;
pub mod samples;
pub mod scores;
pub mod search;
pub mod search_space;
pub mod source;
pub mod tabular;

use contract::Registry;

/// Registers the environments and agents of this crate.
pub fn register(registry: &mut Registry) {
    samples::register(registry);
    classifier::register(registry);
    search::register(registry);
    tabular::register(registry);
}
