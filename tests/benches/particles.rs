//! Steps per second of the particles environment on one core. usage: particles SCENARIO SECONDS
//!
//! mpe2's rules, random starts, episodes of 25 steps of one joint action, through the registered environment,
//! so that observations, rewards and metrics are paid for too. A step moves all agents. Prints one line of
//! JSON.

#![expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]

use std::time::Instant;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

#[expect(clippy::print_stdout, reason = "a benchmark prints its figure")]
fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| word != "--bench")
        .collect();
    let scenario = words.first().map_or("cooperative_navigation", String::as_str);
    let seconds: f64 = words.get(1).and_then(|word| word.parse().ok()).unwrap_or(3.0);
    let registry = plugins::registry();
    let entry = &registry.environments["particles"];
    let config = serde_json::json!({"scenario": scenario, "variant": "mpe2"});
    let mut environment = (entry.build)(&(entry.about.resolve)(&config).unwrap()).unwrap();
    let mut rng = contract::random::stream(&["benchmark"]);
    let action = vec![vec![0.1, -0.2]; environment.seats().len()];
    let (mut steps, start) = (0u64, Instant::now());
    while start.elapsed().as_secs_f64() < seconds {
        for _ in 0..100 {
            environment.reset(&mut rng).unwrap();
            let mut end = None;
            while end.is_none() {
                end = environment.step(&action, &mut rng).unwrap().end;
                steps += 1;
            }
        }
    }
    let rate = steps as f64 / start.elapsed().as_secs_f64();
    println!("{}", serde_json::json!({"who": "Regimen", "steps_per_s": rate}));
}
