//! Environment steps per second in Python on one core. usage: python_environments INTERPRETER ID ENVIRONMENTS SECONDS
//!
//! As many environments as named are stepped together, each by an action in the middle of its space, as a
//! protocol steps them: told first, stepped one after the other, started anew where an episode ends. The lock
//! file is written for what is installed. Prints one line of JSON.

#![expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]

use contract::{Environment, Space};
use std::{process::Command, time::Instant};

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

#[expect(clippy::print_stdout, reason = "a benchmark prints its figure")]
fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| word != "--bench")
        .collect();
    let word = |place: usize, absent: &str| words.get(place).cloned().unwrap_or_else(|| absent.into());
    let (interpreter, id) = (word(0, "python3"), word(1, "Pendulum-v1"));
    let (count, seconds) = (
        word(2, "1").parse().unwrap_or(1),
        word(3, "3").parse().unwrap_or(3.0),
    );
    let lock = tempfile::NamedTempFile::new().unwrap();
    let version = "import gymnasium; print(f'gymnasium=={gymnasium.__version__}')";
    let installed = Command::new(&interpreter)
        .args(["-c", version])
        .output()
        .unwrap()
        .stdout;
    std::fs::write(lock.path(), installed).unwrap();
    let config = serde_json::json!({
        "make": format!("gymnasium:{id}"), "lock": { "file": lock.path() }, "interpreter": interpreter,
    });
    let entry = &plugins::registry().environments["python"];
    let config = (entry.about.resolve)(&config).unwrap();
    let mut environments: Vec<Box<dyn Environment>> =
        (0..count).map(|_| (entry.build)(&config).unwrap()).collect();
    let mut rng = contract::random::stream(&["benchmark"]);
    for environment in &mut environments {
        environment.reset(&mut rng).unwrap();
    }
    let action = vec![match &environments[0].seats()[0].action {
        Space::Choices(choices) => vec![0.0; contract::choice::n_options(choices)],
        space => vec![0.0; space.len()],
    }];
    let (mut steps, start) = (0u64, Instant::now());
    while start.elapsed().as_secs_f64() < seconds {
        for environment in &mut environments {
            environment.begin_step(&action).unwrap();
        }
        for environment in &mut environments {
            if environment.step(&action, &mut rng).unwrap().end.is_some() {
                environment.reset(&mut rng).unwrap();
            }
            steps += 1;
        }
    }
    let rate = steps as f64 / start.elapsed().as_secs_f64();
    println!(
        "{}",
        serde_json::json!({ "who": "Regimen", "steps_per_s": rate, "environments": count })
    );
}
