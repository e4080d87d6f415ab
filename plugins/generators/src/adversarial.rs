//! Training of a generator against a discriminator.
//!
//! Hinge losses (Lim and Ye 2017, arXiv:1705.02894), with `D` the discriminator, `G` the generator, `x` images
//! and `z` latent vectors:
//!
//! - a step of the critic descends `mean max(0, 1 - D(x)) + mean max(0, 1 + D(G(z)))`;
//! - a step of the generator descends `-mean D(G(z))`.
//!
//! Both use Adam. The optimiser of each parameter counts its own steps, so a grown part begins with its own first step
//! while the earlier ones go on. A generator whose parameters are an exponential moving average follows the
//! generator step by step; it normalises by the running statistics of the generator itself.

use crate::architecture::CellArchitecture;
use crate::discriminator::Discriminator;
use crate::generator::{self, FinishedGenerator, Generator, GeneratorSizes, IMAGE_CHANNELS};
use crate::image::Image;
use crate::layers::{Parameter, PassMode, expressions};
use numerics::equations::state_file;
use numerics::gaussian::standard_normal;
use numerics::tensor_file::{TensorFile, TensorFileError};
use plan::{Descent, Equations, Expression, Plans, Processor, State};
use rand::RngCore;

/// Beginning of the names of averaged parameters.
const AVERAGE: &str = "average";

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

impl Training {
    fn descent(&self) -> Descent<'static> {
        Descent {
            rate: "learning_rate",
            first_rate: self.learning_rate,
            betas: self.betas,
            largest_norm: None,
        }
    }
}

/// A generator and a discriminator that are trained, with all their numbers.
#[derive(Debug, Clone)]
pub struct Adversaries {
    generator: Generator,
    discriminator: Discriminator,
    training: Training,
    state: State<f32>,
    /// Steps of both networks by the size of a batch.
    plans: Plans,
}

impl Adversaries {
    /// A generator without cells and a discriminator for maps with `n_channels`, with random numbers.
    #[must_use]
    pub fn new(sizes: GeneratorSizes, n_channels: usize, training: Training, rng: &mut impl RngCore) -> Self {
        let mut state = State::default();
        let generator = Generator::new(sizes, &mut state, rng);
        let discriminator = Discriminator::new(n_channels, &mut state, rng);
        average(generator.parameters(), &mut state);
        Self {
            generator,
            discriminator,
            training,
            state,
            plans: Plans::default(),
        }
    }

    /// Adds a cell to the generator and a block to the discriminator.
    pub fn grow(&mut self, architecture: &CellArchitecture, rng: &mut impl RngCore) {
        let n_known = self.generator.parameters().len();
        self.generator.grow(architecture, &mut self.state, rng);
        self.discriminator.grow(&mut self.state, rng);
        average(&self.generator.parameters()[n_known..], &mut self.state);
        self.plans = Plans::default();
    }

    /// One step of the discriminator with real images `[batch, side, side, 3]` and latent vectors `[batch,
    /// latent]`; returns the loss before it.
    ///
    /// # Panics
    /// Where there are not as many images as latent vectors.
    pub fn critic_step(&mut self, real: &[f32], latents: &[f32]) -> f64 {
        let (plan, state) = self.plan(latents);
        plan.write("real", real);
        plan.write("latents", latents);
        plan.run("critic", state);
        plan.number("critic_loss")
    }

    /// One step of the generator with latent vectors `[batch, latent]`; returns the loss before it.
    ///
    /// # Panics
    /// Where the numbers are no whole number of latent vectors.
    pub fn generator_step(&mut self, latents: &[f32]) -> f64 {
        let (plan, state) = self.plan(latents);
        plan.write("latents", latents);
        plan.run("generator", state);
        plan.number("generator_loss")
    }

    fn plan(&mut self, latents: &[f32]) -> (&mut Processor<f32>, &mut State<f32>) {
        let networks = Networks {
            generator: &self.generator,
            discriminator: &self.discriminator,
            training: self.training,
        };
        let n_images = latents.len() / self.generator.sizes().latent;
        let plan = self
            .plans
            .of_rows(n_images, |equations| networks.write(equations, n_images));
        (plan, &mut self.state)
    }

    /// The form of the generator.
    #[must_use]
    pub fn generator(&self) -> &Generator {
        &self.generator
    }

    /// The form of the discriminator.
    #[must_use]
    pub fn discriminator(&self) -> &Discriminator {
        &self.discriminator
    }

    /// All numbers of both networks, their optimisers and the average.
    #[must_use]
    pub fn state(&self) -> &State<f32> {
        &self.state
    }

    /// A copy of the generator as it is trained.
    #[must_use]
    pub fn trained_generator(&self) -> FinishedGenerator {
        FinishedGenerator::new(self.generator.clone(), self.state.clone())
    }

    /// The generator with averaged parameters and the running statistics of the trained one.
    #[must_use]
    pub fn averaged_generator(&self) -> FinishedGenerator {
        let mut state = self.state.clone();
        for parameter in self.generator.parameters() {
            let averaged = self.state.entries(&averaged(&parameter.name));
            state.entries_mut(&parameter.name).copy_from_slice(averaged);
        }
        FinishedGenerator::new(self.generator.clone(), state)
    }

    /// Writes all numbers into a file.
    pub fn store(&self, file: &mut TensorFile) {
        state_file::store(&self.state, file);
    }

    /// Continues from a file of [`Adversaries::store`]; the networks must have grown by the same cells.
    ///
    /// # Errors
    /// [`TensorFileError`] where the file does not fit; the networks then stay unchanged.
    pub fn restore(&mut self, file: &TensorFile) -> Result<(), TensorFileError> {
        let mut restored = self.state.clone();
        state_file::restore(&mut restored, file)?;
        self.state = restored;
        Ok(())
    }
}

/// Name of the average of a parameter of the generator.
fn averaged(name: &str) -> String {
    let rest = name.strip_prefix(generator::PREFIX).unwrap_or(name);
    format!("{AVERAGE}{rest}")
}

/// Begins the averages of parameters.
fn average(parameters: &[Parameter], state: &mut State<f32>) {
    for Parameter { name, shape } in parameters {
        let entries = state.entries(name).to_vec();
        state.insert(averaged(name), *shape, entries);
    }
}

/// Both networks, and how they are trained.
#[derive(Debug, Clone, Copy)]
struct Networks<'a> {
    generator: &'a Generator,
    discriminator: &'a Discriminator,
    training: Training,
}

impl Networks<'_> {
    /// One step of each network for a batch of `n_images`.
    fn write(&self, equations: &Equations, n_images: usize) {
        let side = self.generator.side();
        let latents = equations.input("latents", [n_images, self.generator.sizes().latent]);
        let real = equations.input("real", [n_images * side * side, IMAGE_CHANNELS]);
        equations.routine("critic");
        self.critic_step(Image::new(real, [side; 2]), latents);
        equations.routine("generator");
        self.generator_step(latents);
    }

    fn critic_step<'e>(&self, real: Image<'e>, latents: Expression<'e>) {
        let equations = latents.equations();
        let fake = self.generator.apply(latents, PassMode::Training).images;
        let of_real = self.discriminator.apply(real, PassMode::Training);
        let of_fake = self.discriminator.apply(fake, PassMode::Training);
        let loss = (1.0 - of_real).relu().mean() + (1.0 + of_fake).relu().mean();
        equations.output("critic_loss", loss);
        let parameters = expressions(self.discriminator.parameters(), equations);
        equations.descend(loss, &parameters, &self.training.descent());
    }

    fn generator_step(&self, latents: Expression<'_>) {
        let equations = latents.equations();
        let images = self.generator.apply(latents, PassMode::Training).images;
        let loss = -self.discriminator.apply(images, PassMode::Training).mean();
        equations.output("generator_loss", loss);
        let parameters = self.generator.parameters();
        let trained = expressions(parameters, equations);
        equations.descend(loss, &trained, &self.training.descent());
        let average = parameters
            .iter()
            .map(|it| equations.parameter(&averaged(&it.name), it.shape));
        let average: Vec<Expression<'_>> = average.collect();
        equations.follow(&average, &trained, 1.0 - self.training.average_decay);
    }
}

/// `n` latent vectors `[n, latent]` of independent standard normal numbers.
pub fn latents(n: usize, latent: usize, rng: &mut impl RngCore) -> Vec<f32> {
    #[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
    (0..n * latent).map(|_| standard_normal(rng) as f32).collect()
}

#[cfg(test)]
mod tests;
