//! Median time of one update of all seats of an agent for Markov games, on one thread.
//!
//! usage: joint_learning AGENT SECONDS [CONFIG]
//!
//! The sizes are those of cooperative navigation: three seats with 18 observations and 2 actions each; the
//! config is the agent's default (width 256, batch 256) with the JSON object CONFIG on top. The agent is
//! built through the registry and driven through `learn`, so replay sampling and the copies in between are
//! paid for. Prints one line of JSON.

#![expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]

use contract::{Agent, Channel, Interface, Observation, Recorder, Rng, Seat, Space, agent::Transition};
use rand::Rng as _;
use std::time::Instant;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const SEATS: usize = 3;
const OBSERVED: usize = 18;
const ACTED: usize = 2;

#[expect(clippy::print_stdout, reason = "a benchmark prints its figure")]
fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| word != "--bench")
        .collect();
    let name = words.first().map_or("tdom_ac", String::as_str);
    let seconds = words.get(1).and_then(|word| word.parse().ok()).unwrap_or(5);
    let mut config: serde_json::Value =
        serde_json::from_str(words.get(2).map_or("{}", String::as_str)).unwrap();
    config["learning_starts"] = 2048.into();
    let registry = plugins::registry();
    let entry = &registry.agents[name];
    let mut rng = contract::random::stream(&["benchmark"]);
    let mut agent = (entry.build)(&(entry.about.resolve)(&config).unwrap(), &interface(), &mut rng).unwrap();
    let filling: Vec<Transition> = (0..2047).map(|_| transition(&mut rng)).collect();
    agent.learn(&filling, &mut rng, &mut Recorder::default()).unwrap();
    for _ in 0..3 {
        update(&mut *agent, &mut rng);
    }
    let (mut updates, until) = (Vec::new(), Instant::now());
    while until.elapsed().as_secs() < seconds {
        updates.push(update(&mut *agent, &mut rng));
    }
    updates.sort_by(f64::total_cmp);
    let (median_s, fastest_s) = (updates[updates.len() / 2], updates[0]);
    let who = format!("Regimen {name}");
    println!(
        "{}",
        serde_json::json!({ "who": who, "median_s": median_s, "fastest_s": fastest_s, "runs": updates.len() })
    );
}

fn update(agent: &mut dyn Agent, rng: &mut Rng) -> f64 {
    let (one, start) = ([transition(rng)], Instant::now());
    agent.learn(&one, rng, &mut Recorder::default()).unwrap();
    start.elapsed().as_secs_f64()
}

fn interface() -> Interface {
    let space = |word: &str, n: usize| {
        Space::Box(
            (0..n)
                .map(|i| Channel::new(format!("{word}_{i}"), "").within(-1.0, 1.0))
                .collect(),
        )
    };
    let seat = |i| Seat {
        name: format!("agent_{i}"),
        observation: space("see", OBSERVED),
        action: space("act", ACTED),
    };
    Interface {
        seats: (0..SEATS).map(seat).collect(),
        state: Vec::new(),
    }
}

fn transition(rng: &mut Rng) -> Transition {
    let mut rows = |n: usize| {
        (0..SEATS)
            .map(|_| (0..n).map(|_| rng.random_range(-1.0..1.0)).collect())
            .collect::<Vec<Vec<f64>>>()
    };
    let (seen, action, following) = (rows(OBSERVED), rows(ACTED), rows(OBSERVED));
    let observe = |seats| Observation {
        seats,
        state: Vec::new(),
    };
    let rewards = (0..SEATS).map(|_| rng.random_range(-2.0..0.0)).collect();
    Transition {
        observation: observe(seen),
        action,
        rewards,
        next_observation: observe(following),
        end: None,
    }
}
