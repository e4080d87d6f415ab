//! Training of a generator against a discriminator.
//!
//! Hinge losses (Lim and Ye 2017, arXiv:1705.02894), with `D` the discriminator, `G` the generator, `x` images
//! and `z` latent vectors:
//!
//! - a step of the critic descends `mean max(0, 1 - D(x)) + mean max(0, 1 + D(G(z)))`;
//! - a step of the generator descends `-mean D(G(z))`.
//!
//! Both use Adam. Each grown part has an optimiser of its own, so a new one begins with its own first step
//! while the earlier ones go on. A generator whose parameters are an exponential moving average follows the
//! generator step by step; it normalises by the running statistics of the generator itself.

use crate::architecture::CellArchitecture;
use crate::discriminator::Discriminator;
use crate::generator::Generator;
use crate::layers::PassMode;
use crate::memory::{self, StatefulModule};
use burn::module::Module;
use burn::tensor::{Device, Gradients, Tensor, activation};
use numerics::gaussian::standard_normal;
use numerics::network::{device, matrix, values};
use numerics::optimizer::{self, Adam};
use numerics::parameters::soft_update;
use numerics::tensor_file::{TensorFile, TensorFileError};
use rand::RngCore;

/// Hyper-parameters of the training of both networks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Training {
    /// Learning rate of both optimisers.
    pub learning_rate: f64,
    /// Decays of the first and second moments.
    pub betas: [f64; 2],
    /// Fraction of itself that the averaged generator keeps in each step of the generator.
    pub average_decay: f64,
}

impl Default for Training {
    /// The values of AutoGAN and E2GAN.
    fn default() -> Self {
        Self {
            learning_rate: 2e-4,
            betas: [0.0, 0.9],
            average_decay: 0.999,
        }
    }
}

/// A generator and a discriminator with their optimisers.
#[derive(Debug, Clone)]
pub struct Adversaries {
    generator: Generator,
    discriminator: Discriminator,
    average: Generator,
    of_generator: Optimiser,
    of_discriminator: Optimiser,
    training: Training,
}

impl Adversaries {
    /// Takes networks on the device with autodiff, see [`training_device`].
    #[must_use]
    pub fn new(generator: Generator, discriminator: Discriminator, training: Training) -> Self {
        let optimiser = |n_parts| Optimiser::new(n_parts, training);
        Self {
            average: generator.valid(),
            of_generator: optimiser(generator.cells.len()),
            of_discriminator: optimiser(discriminator.blocks.len()),
            generator,
            discriminator,
            training,
        }
    }

    /// Adds a cell to the generator and a block to the discriminator.
    pub fn grow(&mut self, architecture: &CellArchitecture, rng: &mut impl RngCore) {
        self.generator.grow(architecture, rng, &training_device());
        self.discriminator.grow(rng, &training_device());
        self.average.cells.extend(self.generator.valid().cells.pop());
        self.of_generator.grow(self.training);
        self.of_discriminator.grow(self.training);
    }

    /// One step of the discriminator with real images `[batch, side, side, 3]` and latent vectors `[batch,
    /// latent]`; returns the loss before it.
    pub fn critic_step(&mut self, real: Tensor<4>, latents: Tensor<2>) -> f32 {
        // A plain copy makes no graph; its updated running statistics go back.
        let mut copy = self.generator.valid();
        let fake = copy.forward(latents, PassMode::Training).images;
        self.generator.adopt(copy);
        let of_real = self.discriminator.forward(real, PassMode::Training);
        let of_fake = self.discriminator.forward(fake, PassMode::Training);
        let hinges = [of_real.neg() + 1.0, of_fake + 1.0].map(activation::relu);
        let before = hinges.iter().map(mean).sum();
        let [of_real, of_fake] = hinges.map(Tensor::mean);
        let loss = of_real + of_fake;
        let Discriminator {
            ending,
            blocks,
            n_channels,
        } = self.discriminator.clone();
        let (ending, blocks) = self.of_discriminator.step(ending, blocks, &mut loss.backward());
        self.discriminator = Discriminator {
            ending,
            blocks,
            n_channels,
        };
        before
    }

    /// One step of the generator with latent vectors `[batch, latent]`; returns the loss before it.
    pub fn generator_step(&mut self, latents: Tensor<2>) -> f32 {
        let images = self.generator.forward(latents, PassMode::Training).images;
        // A plain copy passes gradients on to its input and computes none of its own.
        let mut copy = self.discriminator.valid();
        let scores = copy.forward(images, PassMode::Training);
        let (before, loss) = (-mean(&scores), scores.mean().neg());
        self.discriminator.adopt(copy);
        let Generator { trunk, cells, sizes } = self.generator.clone();
        let (trunk, cells) = self.of_generator.step(trunk, cells, &mut loss.backward());
        self.generator = Generator { trunk, cells, sizes };
        let share = 1.0 - self.training.average_decay;
        self.average = soft_update(self.average.clone(), &self.generator.valid(), share);
        before
    }

    /// The generator, tracked for gradients.
    #[must_use]
    pub fn generator(&self) -> &Generator {
        &self.generator
    }

    /// The discriminator, tracked for gradients.
    #[must_use]
    pub fn discriminator(&self) -> &Discriminator {
        &self.discriminator
    }

    /// The generator with averaged parameters and the running statistics of the trained one, without gradients.
    #[must_use]
    pub fn averaged_generator(&self) -> Generator {
        let mut average = self.average.clone();
        average.adopt(self.generator.clone());
        average
    }

    /// Writes networks and optimisers under `prefix` into a file.
    pub fn store(&self, prefix: &str, file: &mut TensorFile) {
        memory::store(&self.generator, &format!("{prefix}.generator"), file);
        memory::store(&self.average, &format!("{prefix}.average"), file);
        memory::store(&self.discriminator, &format!("{prefix}.discriminator"), file);
        self.of_generator.store(&format!("{prefix}.of_generator"), file);
        self.of_discriminator
            .store(&format!("{prefix}.of_discriminator"), file);
    }

    /// Continues from a file of [`Adversaries::store`] under `prefix`; the networks must have grown by the same
    /// cells.
    ///
    /// # Errors
    /// [`TensorFileError`] where the file does not fit; the networks then stay unchanged.
    pub fn restore(&mut self, prefix: &str, file: &TensorFile) -> Result<(), TensorFileError> {
        let mut restored = self.clone();
        restored.generator = memory::restore(restored.generator, &format!("{prefix}.generator"), file)?;
        restored.average = memory::restore(restored.average, &format!("{prefix}.average"), file)?;
        restored.discriminator =
            memory::restore(restored.discriminator, &format!("{prefix}.discriminator"), file)?;
        restored
            .of_generator
            .restore(&format!("{prefix}.of_generator"), file)?;
        restored
            .of_discriminator
            .restore(&format!("{prefix}.of_discriminator"), file)?;
        *self = restored;
        Ok(())
    }
}

/// The device on which networks are trained: the processor, with autodiff.
#[must_use]
pub fn training_device() -> Device {
    device().autodiff()
}

/// `n` latent vectors `[n, latent]` of independent standard normal numbers.
pub fn latents(n: usize, latent: usize, rng: &mut impl RngCore) -> Tensor<2> {
    #[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
    let drawn = (0..n * latent).map(|_| standard_normal(rng) as f32).collect();
    matrix(drawn, latent)
}

/// The mean in the order of the rows, which is the same on every processor; no gradient depends on a mean of
/// the tensor library.
#[allow(
    clippy::cast_precision_loss,
    reason = "a batch has far fewer than 2^24 images"
)]
fn mean(scores: &Tensor<2>) -> f32 {
    let scores = values(scores.clone());
    scores.iter().sum::<f32>() / scores.len() as f32
}

/// Adam for the parameters that all stages share, and one for each grown part.
#[derive(Debug, Clone)]
struct Optimiser {
    shared: Adam,
    parts: Vec<Adam>,
}

impl Optimiser {
    fn new(n_parts: usize, training: Training) -> Self {
        let adam = Adam::with_betas(training.learning_rate, training.betas);
        Self {
            parts: vec![adam.clone(); n_parts],
            shared: adam,
        }
    }

    fn grow(&mut self, training: Training) {
        self.parts
            .push(Adam::with_betas(training.learning_rate, training.betas));
    }

    fn step<S: Module, P: Module>(
        &mut self,
        shared: S,
        parts: Vec<P>,
        loss_gradients: &mut Gradients,
    ) -> (S, Vec<P>) {
        let gradients = optimizer::gradients(&shared, loss_gradients);
        let shared = self.shared.step_against(shared, &gradients);
        let parts = parts.into_iter().zip(&mut self.parts).map(|(part, adam)| {
            let gradients = optimizer::gradients(&part, loss_gradients);
            adam.step_against(part, &gradients)
        });
        (shared, parts.collect())
    }

    fn store(&self, prefix: &str, file: &mut TensorFile) {
        self.shared.store(&format!("{prefix}.shared"), file);
        for (at, adam) in self.parts.iter().enumerate() {
            adam.store(&format!("{prefix}.parts.{at}"), file);
        }
    }

    fn restore(&mut self, prefix: &str, file: &TensorFile) -> Result<(), TensorFileError> {
        self.shared.restore(&format!("{prefix}.shared"), file)?;
        let mut parts = self.parts.iter_mut().enumerate();
        parts.try_for_each(|(at, adam)| adam.restore(&format!("{prefix}.parts.{at}"), file))
    }
}

#[cfg(test)]
mod tests;
