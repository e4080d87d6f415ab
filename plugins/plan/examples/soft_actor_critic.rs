//! Times one update of soft actor-critic as a plan, on one core: `soft_actor_critic [SECONDS]`. `soft_actor_critic
//! kernels` prints its kernels for a card instead.
//!
//! 9 observations, 4 actions, two hidden layers of 256, batch 256, twin critics with targets, tuned temperature, no
//! clipping. Prints updates per second and the time of each kind of kernel.

use arithmetic::draws::{GOLDEN, mix, normal};
use plan::cuda::Kernels;
use plan::equations::Descent;
use plan::{Activation, Equations, Expression, Processor, Routine, Shape, State, Work};
use std::collections::BTreeMap;
use std::f64::consts::{LN_2, TAU};
use std::time::{Duration, Instant};

/// That of the program: its buffers begin at cache lines, which the allocator of the C library does not ensure.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const BATCH: usize = 256;
const SEEN: usize = 9;
const DONE: usize = 4;
const WIDTH: usize = 256;
const FOLLOWING: f64 = 0.005;
const DISCOUNT: f64 = 0.99;

/// Weight and bias of each layer.
type Network<'e> = Vec<[Expression<'e>; 2]>;

/// Adds a network to the equations and its first parameters to the state.
fn network<'e>(
    equations: &'e Equations,
    state: &mut State<f32>,
    name: &str,
    [inputs, outputs]: [usize; 2],
) -> Network<'e> {
    let widths = [inputs, WIDTH, WIDTH, outputs];
    let mut parameter = |name: String, shape: Shape, sd| {
        state.insert(&name, shape, draws(&name, shape[0] * shape[1], sd));
        equations.parameter(&name, shape)
    };
    let layer = |at: usize| {
        let [inputs, outputs] = [widths[at], widths[at + 1]];
        let sd = (1.0 / inputs as f64).sqrt();
        let weight = parameter(format!("{name}.{at}.weight"), [inputs, outputs], sd);
        [weight, parameter(format!("{name}.{at}.bias"), [1, outputs], 0.01)]
    };
    (0..3).map(layer).collect()
}

fn forward<'e>(network: &Network<'e>, x: Expression<'e>) -> Expression<'e> {
    let activations = [Activation::Relu, Activation::Relu, Activation::Identity];
    let layers = network.iter().zip(activations);
    layers.fold(x, |x, ([weight, bias], activation)| {
        x.dense(*weight, *bias, activation)
    })
}

/// Action and log density of the policy, whose normal numbers are those of the run.
fn sample<'e>(policy: &Network<'e>, seen: Expression<'e>) -> (Expression<'e>, Expression<'e>) {
    let noise = seen.equations().normal([BATCH, DONE]);
    let head = forward(policy, seen);
    let log_sd = head.columns(DONE..2 * DONE).clamp(-20.0, 2.0);
    let candidate = head.columns(0..DONE) + log_sd.exp() * noise;
    let density = noise.square() * -0.5 - log_sd - 0.5 * TAU.ln();
    // ln(1 - tanh(x)^2)
    let derivative = (candidate + (candidate * -2.0).softplus() - LN_2) * -2.0;
    (candidate.tanh(), (density - derivative).sum_columns())
}

/// Values of actions by both critics.
fn values<'e>(
    critics: &[Network<'e>; 2],
    seen: Expression<'e>,
    action: Expression<'e>,
) -> [Expression<'e>; 2] {
    let joined = seen.equations().join(&[seen, action]);
    [0, 1].map(|at| forward(&critics[at], joined))
}

fn flat<'e>(networks: &[Network<'e>]) -> Vec<Expression<'e>> {
    networks.iter().flatten().flatten().copied().collect()
}

/// Adds the routine `update` to the equations and the first parameters to the state.
fn add_update(equations: &Equations, state: &mut State<f32>) {
    let input = |name: &str, columns| equations.input(name, [BATCH, columns]);
    let (seen, done, next) = (
        input("observations", SEEN),
        input("actions", DONE),
        input("next observations", SEEN),
    );
    let (reward, continues) = (input("rewards", 1), input("continues", 1));
    let policy = network(equations, state, "policy", [SEEN, 2 * DONE]);
    let mut twins = |name: &str| {
        [0, 1].map(|twin| network(equations, state, &format!("{name}.{twin}"), [SEEN + DONE, 1]))
    };
    let (critics, targets) = (twins("critics"), twins("targets"));
    state.insert("ln temperature", [1, 1], vec![0.0]);
    let ln_temperature = equations.parameter("ln temperature", [1, 1]);
    let descent = Descent::adam("learning rate", 3e-4, None);

    let _ = equations.routine("update");
    let temperature = ln_temperature.exp();
    let (action, log_density) = sample(&policy, next);
    let [first, second] = values(&targets, next, action);
    let soft = first.min(second) - log_density * temperature;
    let target = soft * continues * DISCOUNT + reward;
    let losses = values(&critics, seen, done).map(|value| (value - target).square().mean() * 0.5);
    let critic_loss = losses[0] + losses[1];
    equations.output("critic loss", critic_loss);
    equations.descend(critic_loss, &flat(&critics), &descent);

    let (action, log_density) = sample(&policy, seen);
    let [first, second] = values(&critics, seen, action);
    let policy_loss = (log_density * temperature - first.min(second)).mean();
    equations.descend(policy_loss, &flat(&[policy]), &descent);

    let loss = ln_temperature * -(log_density.mean() - DONE as f64);
    equations.descend(loss, &[ln_temperature], &descent);
    equations.follow(&flat(&targets), &flat(&critics), FOLLOWING);
}

/// Normal numbers with a standard deviation.
#[allow(clippy::cast_possible_truncation, reason = "the plan computes in f32")]
fn draws(name: &str, n: usize, sd: f64) -> Vec<f32> {
    let seed = name.bytes().fold(7, |seed, byte| mix(seed ^ u64::from(byte)));
    let draw = |i: u64| (sd * normal(mix(seed.wrapping_add(i.wrapping_mul(GOLDEN))))) as f32;
    (0..n as u64).map(draw).collect()
}

#[allow(
    clippy::print_stdout,
    clippy::disallowed_methods,
    reason = "the program measures time and prints its results"
)]
fn main() {
    let argument = std::env::args().nth(1).unwrap_or_default();
    let seconds = argument.parse().unwrap_or(3.0);
    let (equations, mut state) = (Equations::new(), State::default());
    add_update(&equations, &mut state);
    let graph = equations.into_graph();
    let routine = graph.routine_named("update").expect("the routine that was added");
    if argument == "kernels" {
        let kernels = Kernels::new(&graph, routine).expect("no operation of another crate");
        print!("{}", kernels.source());
        return;
    }
    let (flops, bytes) = (graph.flops(routine), graph.bytes(routine));
    let mut processor = Processor::<f32>::new(graph);
    for name in ["observations", "actions", "rewards", "next observations"] {
        let entries = draws(name, processor.entries(name).len(), 0.5);
        processor.write(name, &entries);
    }
    processor.input("continues").fill(1.0);
    processor.run_seeded("update", &mut state, 0);
    let (start, mut updates) = (Instant::now(), 0);
    let mut best = Duration::MAX;
    while start.elapsed().as_secs_f64() < seconds {
        let start = Instant::now();
        updates += 1;
        processor.run_seeded("update", &mut state, u64::from(updates));
        best = best.min(start.elapsed());
    }
    let mean = start.elapsed() / updates;
    let gigaflops = flops as f64 / best.as_secs_f64() / 1e9;
    println!("{flops} flops, {bytes} bytes an update");
    println!(
        "mean {mean:?}, best {best:?}: {:.0} updates/s, {gigaflops:.0} GFLOP/s",
        1.0 / best.as_secs_f64()
    );
    println!(
        "critic loss after {updates} updates: {}",
        processor.entries("critic loss")[0]
    );
    kernels(&mut processor, &mut state, routine);
}

/// Prints the time of kernels by kind and shape: of 100 runs the fastest one of each kernel.
#[allow(
    clippy::print_stdout,
    clippy::disallowed_methods,
    reason = "the program measures time and prints its results"
)]
fn kernels(processor: &mut Processor<f32>, state: &mut State<f32>, routine: Routine) {
    let mut fastest: Vec<(Work, Shape, Duration)> = Vec::new();
    for _ in 0..100 {
        let (mut last, mut at) = (Instant::now(), 0);
        processor.run_observed(routine, state, 0, |work, shape| {
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
