//! Median time of one step of the critic and one of the generator of E2GAN's published architecture, on one
//! thread.
//!
//! usage: adversaries CHANNELS BOTTOM CELLS BATCH SECONDS
//!
//! Both networks have CHANNELS channels, latent vectors 128 numbers. Drawing them and averaging the generator's
//! parameters is paid for. Prints one line of JSON.

#![expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]

use generators::adversarial::{Adversaries, Training, latents};
use generators::architecture::E2GAN;
use generators::generator::GeneratorSizes;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use std::time::Instant;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const LATENT: usize = 128;

#[expect(clippy::print_stdout, reason = "a benchmark prints its figure")]
fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| word != "--bench")
        .collect();
    let number = |at: usize, otherwise: usize| words.get(at).map_or(otherwise, |word| word.parse().unwrap());
    let [channels, bottom, cells, batch] = [number(0, 16), number(1, 4), number(2, 3), number(3, 32)];
    let (seconds, mut rng) = (number(4, 5) as f64, ChaCha8Rng::seed_from_u64(1));
    let sizes = GeneratorSizes {
        bottom,
        channels,
        latent: LATENT,
    };
    let mut trained = Adversaries::new(sizes, channels, Training::default(), &mut rng);
    E2GAN.cells[..cells]
        .iter()
        .for_each(|cell| trained.grow(cell, &mut rng));
    let side = trained.generator().side();
    let real: Vec<f32> = (0..batch * side * side * 3)
        .map(|i| (i as f32 * 12.9898).sin())
        .collect();
    let (mut of_critic, mut of_generator, begin) = (Vec::new(), Vec::new(), Instant::now());
    while of_critic.len() < 8 || begin.elapsed().as_secs_f64() < seconds {
        let start = Instant::now();
        trained.critic_step(&real, &latents(batch, LATENT, &mut rng));
        of_critic.push(start.elapsed().as_secs_f64());
        let start = Instant::now();
        trained.generator_step(&latents(batch, LATENT, &mut rng));
        of_generator.push(start.elapsed().as_secs_f64());
    }
    let (critic_s, generator_s) = (median(of_critic), median(of_generator));
    println!(
        "{}",
        serde_json::json!({ "who": "Regimen", "critic_s": critic_s, "generator_s": generator_s, "median_s": critic_s + generator_s })
    );
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}
