//! Times one update of soft actor-critic as a plan, on one core: `soft_actor_critic [SECONDS]`.
//!
//! 9 observations, 4 actions, two hidden layers of 256, batch 256, twin critics with targets, tuned temperature, no
//! clipping. Prints updates per second and the time of each kind of kernel.

use arithmetic::digests::{GOLDEN, mix};
use arithmetic::draws::normal;
use plan::{Activation, Graph, Number, Optimiser, Processor, Routine, Shape, Value, Work};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

const BATCH: usize = 256;
const SEEN: usize = 9;
const DONE: usize = 4;
const WIDTH: usize = 256;
const TAU: f64 = 0.005;
const DISCOUNT: f64 = 0.99;

/// Parameters of a network: weight and bias of each layer.
type Network = Vec<(Value, Value)>;

struct Plan {
    graph: Graph,
    policy: Network,
    critics: [Network; 2],
    targets: [Network; 2],
    ln_temperature: Value,
    rate: Number,
}

fn network(graph: &mut Graph, name: &str, inputs: usize, outputs: usize) -> Network {
    let widths = [inputs, WIDTH, WIDTH, outputs];
    let layer = |at: usize| {
        let [inputs, outputs] = [widths[at], widths[at + 1]];
        let weight = graph.parameter(&format!("{name}.{at}.weight"), [inputs, outputs]);
        (
            weight,
            graph.parameter(&format!("{name}.{at}.bias"), [1, outputs]),
        )
    };
    (0..3).map(layer).collect()
}

fn forward(graph: &mut Graph, network: &Network, x: Value) -> Value {
    let layers = network.iter().enumerate();
    layers.fold(x, |x, (at, (weight, bias))| {
        let activation = if at < 2 {
            Activation::Relu
        } else {
            Activation::Identity
        };
        graph.dense(x, *weight, *bias, activation)
    })
}

impl Plan {
    fn new() -> Self {
        let mut graph = Graph::new();
        let policy = network(&mut graph, "policy", SEEN, 2 * DONE);
        let mut twins = |name: &str| {
            ["first", "second"].map(|twin| network(&mut graph, &format!("{name}.{twin}"), SEEN + DONE, 1))
        };
        let (critics, targets) = (twins("critics"), twins("targets"));
        let ln_temperature = graph.parameter("ln temperature", [1, 1]);
        let rate = graph.number("learning rate", 3e-4);
        Self {
            graph,
            policy,
            critics,
            targets,
            ln_temperature,
            rate,
        }
    }

    /// Action and log density of the policy.
    fn sample(&mut self, seen: Value, noise: Value) -> (Value, Value) {
        let head = forward(&mut self.graph, &self.policy, seen);
        let graph = &mut self.graph;
        let (mean, log_sd) = (graph.columns(head, 0..DONE), graph.columns(head, DONE..2 * DONE));
        let log_sd = graph.clamp(log_sd, -20.0, 2.0);
        let sd = graph.exp(log_sd);
        let spread = graph.mul(sd, noise);
        let candidate = graph.add(mean, spread);
        let square = graph.square(noise);
        let half = graph.scale(square, -0.5);
        let density = graph.sub(half, log_sd);
        let density = graph.shift(density, -0.918_938_533_204_672_7);
        let twice = graph.scale(candidate, -2.0);
        let softplus = graph.softplus(twice);
        let sum = graph.add(candidate, softplus);
        let shifted = graph.shift(sum, -std::f64::consts::LN_2);
        let derivative = graph.scale(shifted, -2.0);
        let terms = graph.sub(density, derivative);
        (graph.tanh(candidate), graph.sum_columns(terms))
    }

    fn lower_critic(&mut self, critics: &[Network; 2], seen: Value, action: Value) -> Value {
        let joined = self.graph.join(&[seen, action]);
        let [first, second] = [0, 1].map(|at| forward(&mut self.graph, &critics[at], joined));
        self.graph.min(first, second)
    }

    fn descend(&mut self, loss: Value, parameters: &[Value]) {
        let gradients = self.graph.gradients(loss, parameters);
        for (parameter, gradient) in parameters.iter().zip(gradients) {
            self.graph.adam(*parameter, gradient, Optimiser::new(self.rate));
        }
    }

    fn update(&mut self) -> (Routine, Value) {
        let mut input = |name: &str, columns| self.graph.input(name, [BATCH, columns]);
        let (seen, done, reward) = (
            input("observations", SEEN),
            input("actions", DONE),
            input("rewards", 1),
        );
        let (next, continues) = (input("next observations", SEEN), input("continues", 1));
        let noises = [input("next noise", DONE), input("noise", DONE)];
        let routine = self.graph.routine("update");
        let temperature = self.graph.exp(self.ln_temperature);

        let (action, log_density) = self.sample(next, noises[0]);
        let value = self.lower_critic(&self.targets.clone(), next, action);
        let graph = &mut self.graph;
        let entropy = graph.mul(log_density, temperature);
        let soft = graph.sub(value, entropy);
        let soft = graph.mul(soft, continues);
        let soft = graph.scale(soft, DISCOUNT);
        let target = graph.add(soft, reward);
        let joined = graph.join(&[seen, done]);
        let losses = [0, 1].map(|at| {
            let value = forward(graph, &self.critics[at], joined);
            let error = graph.sub(value, target);
            let square = graph.square(error);
            let mean = graph.mean(square);
            graph.scale(mean, 0.5)
        });
        let critic_loss = graph.add(losses[0], losses[1]);
        self.descend(critic_loss, &flat(&self.critics));

        let (action, log_density) = self.sample(seen, noises[1]);
        let value = self.lower_critic(&self.critics.clone(), seen, action);
        let graph = &mut self.graph;
        let entropy = graph.mul(log_density, temperature);
        let loss = graph.sub(entropy, value);
        let policy_loss = graph.mean(loss);
        self.descend(policy_loss, &flat(std::slice::from_ref(&self.policy)));

        let mean = self.graph.mean(log_density);
        let excess = self.graph.shift(mean, -(DONE as f64));
        let excess = self.graph.neg(excess);
        let loss = self.graph.mul(self.ln_temperature, excess);
        self.descend(loss, &[self.ln_temperature]);
        for (target, source) in flat(&self.targets).into_iter().zip(flat(&self.critics)) {
            self.graph.follow(target, source, TAU);
        }
        self.graph.output("critic loss", critic_loss);
        (routine, critic_loss)
    }
}

fn flat(networks: &[Network]) -> Vec<Value> {
    networks
        .iter()
        .flatten()
        .flat_map(|(weight, bias)| [*weight, *bias])
        .collect()
}

/// Normal numbers with a standard deviation.
#[allow(clippy::cast_possible_truncation, reason = "the plan computes in f32")]
fn draw(processor: &mut Processor<f32>, value: Value, sd: f64) {
    let seed = format!("{value:?}")
        .bytes()
        .fold(7_u64, |seed, byte| mix(seed ^ u64::from(byte)));
    let entries = processor.entries_mut(value).iter_mut().enumerate();
    entries.for_each(|(i, x)| *x = (sd * normal(mix(seed.wrapping_add(i as u64 * GOLDEN)))) as f32);
}

#[allow(
    clippy::print_stdout,
    clippy::disallowed_methods,
    reason = "the program measures time and prints its results"
)]
fn main() {
    let seconds = std::env::args()
        .nth(1)
        .and_then(|word| word.parse().ok())
        .unwrap_or(3.0);
    let mut plan = Plan::new();
    let (routine, loss) = plan.update();
    let graph = &plan.graph;
    let mut processor = Processor::<f32>::new(graph);
    for (weight, bias) in plan
        .critics
        .iter()
        .chain(&plan.targets)
        .chain([&plan.policy])
        .flatten()
    {
        draw(
            &mut processor,
            *weight,
            (1.0 / graph.shape(*weight)[0] as f64).sqrt(),
        );
        draw(&mut processor, *bias, 0.01);
    }
    let data = [
        "observations",
        "actions",
        "rewards",
        "next observations",
        "next noise",
        "noise",
    ];
    for value in data.into_iter().filter_map(|name| graph.named(name)) {
        draw(&mut processor, value, 0.5);
    }
    processor.run(routine);
    let (start, mut updates) = (Instant::now(), 0);
    let mut best = Duration::MAX;
    while start.elapsed().as_secs_f64() < seconds {
        let start = Instant::now();
        processor.run(routine);
        best = best.min(start.elapsed());
        updates += 1;
    }
    let mean = start.elapsed() / updates;
    let gigaflops = graph.flops(routine) as f64 / best.as_secs_f64() / 1e9;
    println!(
        "{} flops, {} bytes an update",
        graph.flops(routine),
        graph.bytes(routine)
    );
    println!(
        "mean {mean:?}, best {best:?}: {:.0} updates/s, {gigaflops:.0} GFLOP/s",
        1.0 / best.as_secs_f64()
    );
    println!(
        "critic loss after {updates} updates: {}",
        processor.entries(loss)[0]
    );
    kernels(&mut processor, routine);
}

/// Prints the time of kernels by kind and shape: of 100 runs the fastest one of each kernel.
#[allow(
    clippy::print_stdout,
    clippy::disallowed_methods,
    reason = "the program measures time and prints its results"
)]
fn kernels(processor: &mut Processor<f32>, routine: Routine) {
    let mut fastest: Vec<(Work, Shape, Duration)> = Vec::new();
    for _ in 0..100 {
        let (mut last, mut at) = (Instant::now(), 0);
        processor.run_observed(routine, |work, shape| {
            let took = last.elapsed();
            match fastest.get_mut(at) {
                Some(kernel) => kernel.2 = kernel.2.min(took),
                None => fastest.push((work, shape, took)),
            }
            (last, at) = (Instant::now(), at + 1);
        });
    }
    let mut by_kind: BTreeMap<(Work, Shape), (u32, Duration)> = BTreeMap::new();
    for (work, shape, took) in &fastest {
        let entry = by_kind.entry((*work, *shape)).or_default();
        *entry = (entry.0 + 1, entry.1 + *took);
    }
    let total: Duration = fastest.iter().map(|kernel| kernel.2).sum();
    let of_products = fastest
        .iter()
        .filter(|kernel| matches!(kernel.0, Work::Product { .. }));
    let products: Duration = of_products.map(|kernel| kernel.2).sum();
    for ((work, shape), (n, took)) in by_kind {
        let each = took.as_secs_f64() / f64::from(n);
        let speed = match work {
            Work::Product { inner, .. } => {
                let gigaflops = (2 * inner * shape[0] * shape[1]) as f64 / each / 1e9;
                format!(", {gigaflops:.0} GFLOP/s")
            }
            _ => String::new(),
        };
        println!("{n:3} x {work:?} {shape:?}: {:.0} us each{speed}", each * 1e6);
    }
    let share = products.as_secs_f64() / total.as_secs_f64();
    println!(
        "kernels {total:?}, of which products {products:?}, {:.0} %",
        100.0 * share
    );
}
