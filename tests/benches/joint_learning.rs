//! Median time of one update of all seats of an agent, on one thread.
//!
//! usage: joint_learning AGENT SECONDS [CONFIG]
//!
//! The sizes are those of cooperative navigation: three seats with 18 observations and 2 actions each. Seats of
//! `value_decomposition` have 5 choices in their place and a state of 54 entries; `clac` has one seat. The config is the
//! agent's default with one update for each step and the JSON object CONFIG on top. The agent is built through the
//! registry and driven through `learn`, so replay sampling and the copies in between are paid for. Prints one line of
//! JSON.

#![expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]

use contract::{Agent, Channel, Interface, Observation, Recorder, Rng, Seat, Space, agent::Transition};
use rand::Rng as _;
use std::time::Instant;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const OBSERVED: usize = 18;
const ACTED: usize = 2;
const CHOICES: u32 = 5;

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
    config["updates_per_step"] = 1.0.into();
    let task = Task {
        n_seats: if name == "clac" { 1 } else { 3 },
        chooses: name == "value_decomposition",
    };
    let registry = plugins::registry();
    let entry = &registry.agents[name];
    let mut rng = contract::random::stream(&["benchmark"]);
    let mut agent = (entry.build)(
        &(entry.about.resolve)(&config).unwrap(),
        &task.interface(),
        &mut rng,
    )
    .unwrap();
    // Step by step, as one environment makes them: some agents store a step with the one before it.
    for _ in 0..2047 {
        task.update(&mut *agent, &mut rng);
    }
    assert_eq!(agent.updates().unwrap().made, 0, "the buffer is filled first");
    for _ in 0..3 {
        task.update(&mut *agent, &mut rng);
    }
    let made = |agent: &dyn Agent| agent.updates().unwrap().made;
    let (before, mut updates, until) = (made(&*agent), Vec::new(), Instant::now());
    while until.elapsed().as_secs() < seconds {
        updates.push(task.update(&mut *agent, &mut rng));
    }
    assert_eq!(
        made(&*agent) - before,
        updates.len() as u64,
        "an update for each step"
    );
    updates.sort_by(f64::total_cmp);
    let (median_s, fastest_s) = (updates[updates.len() / 2], updates[0]);
    let who = format!("Regimen {name}");
    println!(
        "{}",
        serde_json::json!({ "who": who, "median_s": median_s, "fastest_s": fastest_s, "runs": updates.len() })
    );
}

/// Seats of the agent that is timed.
struct Task {
    n_seats: usize,
    /// Whether each seat takes one of several choices, and there is a full state.
    chooses: bool,
}

impl Task {
    fn update(&self, agent: &mut dyn Agent, rng: &mut Rng) -> f64 {
        let (one, start) = ([self.transition(rng)], Instant::now());
        agent.learn(&one, rng, &mut Recorder::default()).unwrap();
        start.elapsed().as_secs_f64()
    }

    fn interface(&self) -> Interface {
        let channels = |word: &str, n: usize| -> Vec<Channel> {
            (0..n)
                .map(|i| Channel::new(format!("{word}_{i}"), "").within(-1.0, 1.0))
                .collect()
        };
        let seat = |i| Seat {
            name: format!("agent_{i}"),
            observation: Space::Box(channels("see", OBSERVED)),
            action: if self.chooses {
                Space::Discrete((0..CHOICES).map(|i| format!("choice_{i}")).collect())
            } else {
                Space::Box(channels("act", ACTED))
            },
        };
        Interface {
            seats: (0..self.n_seats).map(seat).collect(),
            state: channels("state", self.n_state()),
        }
    }

    fn n_state(&self) -> usize {
        if self.chooses { self.n_seats * OBSERVED } else { 0 }
    }

    fn transition(&self, rng: &mut Rng) -> Transition {
        let row = |n: usize, rng: &mut Rng| (0..n).map(|_| rng.random_range(-1.0..1.0)).collect::<Vec<f64>>();
        let observe = |rng: &mut Rng| Observation {
            seats: (0..self.n_seats).map(|_| row(OBSERVED, rng)).collect(),
            state: row(self.n_state(), rng),
        };
        let act = |rng: &mut Rng| match self.chooses {
            true => vec![f64::from(rng.random_range(0..CHOICES))],
            false => row(ACTED, rng),
        };
        Transition {
            observation: observe(rng),
            action: (0..self.n_seats).map(|_| act(rng)).collect(),
            rewards: (0..self.n_seats).map(|_| rng.random_range(-2.0..0.0)).collect(),
            next_observation: observe(rng),
            end: None,
        }
    }
}
