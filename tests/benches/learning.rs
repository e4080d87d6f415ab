//! Median time of one update of the original soft actor-critic, and of one decision of its policy, on one
//! thread.
//!
//! usage: learning BATCH CRITIC_LAYERS POLICY_LAYERS SECONDS [AGENT]
//!
//! The agent is built through the registry and driven through `learn` and `act`, so replay sampling and the
//! copies in between are paid for. 9 observations, 4 actions. Prints one line of JSON.

#![expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]

use contract::{Agent, Channel, Interface, Mode, Observation, Recorder, Seat, Space, agent::Transition};
use rand::Rng as _;
use std::time::Instant;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

#[expect(clippy::print_stdout, reason = "a benchmark prints its figure")]
fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| word != "--bench")
        .collect();
    let number = |index: usize, otherwise: usize| {
        words
            .get(index)
            .and_then(|word| word.parse().ok())
            .unwrap_or(otherwise)
    };
    let (batch, critic_layers, policy_layers, seconds) =
        (number(0, 256), number(1, 2), number(2, 2), number(3, 5));
    let name = words.get(4).map_or("gaussian_softmax_sac", String::as_str);
    let registry = plugins::registry();
    let config = serde_json::json!({
        "batch_size": batch, "critic_layers": critic_layers, "policy_layers": policy_layers,
        "updates_per_step": 1.0, "learning_starts": 2048, "replay_capacity": 4096,
    });
    let entry = &registry.agents[name];
    let mut rng = contract::random::stream(&["benchmark"]);
    let mut agent = (entry.build)(&(entry.about.resolve)(&config).unwrap(), &interface(), &mut rng).unwrap();
    let mut record = Recorder::default();
    let filling: Vec<Transition> = (0..2047).map(|_| transition(&mut rng)).collect();
    agent.learn(&filling, &mut rng, &mut record).unwrap();
    for _ in 0..15 {
        agent
            .learn(&[transition(&mut rng)], &mut rng, &mut record)
            .unwrap();
    }
    let (mut updates, until) = (Vec::new(), Instant::now());
    while until.elapsed().as_secs() < seconds as u64 {
        let one = [transition(&mut rng)];
        let start = Instant::now();
        agent.learn(&one, &mut rng, &mut record).unwrap();
        updates.push(start.elapsed().as_secs_f64());
    }
    let decisions = decisions(&mut *agent, &mut rng);
    println!(
        "{}",
        serde_json::json!({
            "who": format!("Regimen {name}"), "median_s": quantile(&mut updates, 0.5), "runs": updates.len(),
            "decision_median_s": quantile(&mut decisions.clone(), 0.5),
            "decision_p99_s": quantile(&mut decisions.clone(), 0.99),
        })
    );
}

fn interface() -> Interface {
    let names = (1..=4)
        .map(|i| format!("voltage_{i}"))
        .chain((1..=4).map(|i| format!("current_{i}")))
        .chain(["power_demand_w".into()]);
    let observation = Space::Box(names.map(|name| Channel::new(name, "")).collect());
    let action = Space::Simplex((1..=4).map(|i| format!("weight_{i}")).collect());
    Interface {
        seats: vec![Seat {
            name: String::new(),
            observation,
            action,
        }],
        state: Vec::new(),
    }
}

fn observation(rng: &mut contract::Rng) -> Observation {
    Observation {
        seats: vec![(0..9).map(|_| rng.random::<f64>() * 2.0 - 1.0).collect()],
        state: Vec::new(),
    }
}

fn transition(rng: &mut contract::Rng) -> Transition {
    Transition {
        observation: observation(rng),
        action: vec![vec![0.1, 0.2, 0.3, 0.4]],
        rewards: vec![rng.random()],
        next_observation: observation(rng),
        end: None,
    }
}

fn decisions(agent: &mut dyn Agent, rng: &mut contract::Rng) -> Vec<f64> {
    (0..2000)
        .map(|_| {
            let one = [observation(rng)];
            let start = Instant::now();
            agent.act(&one, Mode::Evaluate, rng).unwrap();
            start.elapsed().as_secs_f64()
        })
        .collect()
}

fn quantile(values: &mut [f64], probability: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * probability) as usize]
}
