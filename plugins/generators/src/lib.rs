//! Generative adversarial networks whose generator is built from an architecture that can be searched:
//! the space of AutoGAN and E2GAN, the networks, and their training.

pub mod adversarial;
pub mod architecture;
pub mod discriminator;
pub mod generator;
pub mod layers;
pub mod memory;

#[cfg(test)]
mod reference;
