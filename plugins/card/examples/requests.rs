//! Counts the runs a second that the host's side of a population carries, with a device that takes no time:
//! `requests [WORKERS] [SECONDS]`.
//!
//! Each worker is a thread with a connection of its own, and asks for updates with the inputs of soft actor-critic: a
//! batch of 256 transitions with 9 observations and 4 actions.

use card::backend::Backend;
use card::population::Population;
use card::socket::{Remote, serve};
use plan::cuda::{Batch, Kernels, size};
use plan::executor::{Executor, Lost};
use plan::{Equations, Shape};
use std::collections::VecDeque;
use std::ops::Range;
use std::os::unix::net::UnixListener;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

/// A device that computes nothing.
#[derive(Default)]
struct Idle {
    outputs: VecDeque<usize>,
    batches: u64,
    runs: u64,
}

impl Backend for Idle {
    fn reserve(&mut self, _: usize, _: usize, _: usize) -> Result<(), Lost> {
        Ok(())
    }

    fn write(&mut self, _: usize, _: u32, _: usize, _: &[f32]) -> Result<(), Lost> {
        Ok(())
    }

    fn read(&mut self, _: usize, _: u32, entries: Range<usize>) -> Result<Vec<f32>, Lost> {
        // The mean size of a batch, for the report.
        Ok(vec![self.runs as f32 / self.batches.max(1) as f32; entries.len()])
    }

    fn start(&mut self, _: usize, _: usize, batch: &Batch<'_>) -> Result<(), Lost> {
        self.outputs
            .push_back(batch.members.len() * size(&batch.kernels.outputs));
        std::hint::black_box(batch.inputs.concat());
        (self.batches, self.runs) = (self.batches + 1, self.runs + batch.members.len() as u64);
        Ok(())
    }

    fn finish(&mut self) -> Result<Vec<f32>, Lost> {
        Ok(vec![0.0; self.outputs.pop_front().unwrap_or_default()])
    }
}

fn update() -> Kernels {
    let equations = Equations::new();
    let shapes: [(&str, Shape); 5] = [
        ("seen", [256, 9]),
        ("done", [256, 4]),
        ("next", [256, 9]),
        ("reward", [256, 1]),
        ("continues", [256, 1]),
    ];
    let inputs = shapes.map(|(name, shape)| equations.input(name, shape));
    let weight = equations.parameter("weight", [24, 1]);
    let routine = equations.routine("update");
    let joined = equations.join(&inputs);
    equations.output("loss", joined.product(weight, [false; 2]).sum());
    Kernels::new(&equations.into_graph(), routine).expect("no operation of another crate")
}

#[allow(
    clippy::print_stdout,
    clippy::disallowed_methods,
    reason = "the program measures time and prints its results"
)]
fn main() {
    let argument = |at: usize| std::env::args().nth(at).and_then(|word| word.parse::<u64>().ok());
    let (n_workers, seconds) = (argument(1).unwrap_or(16), argument(2).unwrap_or(3));
    let socket = std::env::temp_dir().join(format!("regimen-requests-{}", std::process::id()));
    let listener = UnixListener::bind(&socket).expect("a new socket");
    let population = Population::new(|| Ok(Idle::default())).expect("a device that is always there");
    let executor: Arc<dyn Executor> = Arc::new(population);
    thread::spawn(move || serve(&listener, &executor));
    let kernels = update();
    let (words, inputs) = (vec![0; kernels.run_size()], vec![0.5; size(&kernels.inputs)]);
    let length = Duration::from_secs(seconds);
    let (socket, kernels, words, inputs) = (&socket, &kernels, &words, &inputs);
    let work = move || -> Result<(u64, f32), Lost> {
        let remote = Remote::new(socket).expect("the process itself answers");
        let member = remote.admit(&[("weight", [24, 1])])?;
        let (kernels, start, mut runs) = (Arc::new(kernels.clone()), Instant::now(), 0);
        while start.elapsed() < length {
            member.run(&kernels, words, inputs)?;
            runs += 1;
        }
        Ok((runs, member.read("weight")?[0]))
    };
    let workers: Vec<_> = thread::scope(|scope| {
        let threads: Vec<_> = (0..n_workers).map(|_| scope.spawn(work)).collect();
        threads
            .into_iter()
            .map(|thread| thread.join().expect("no panic").expect("no loss"))
            .collect()
    });
    let runs: u64 = workers.iter().map(|(runs, _)| runs).sum();
    println!(
        "{n_workers} workers: {:.0} runs a second, {:.1} in a batch",
        runs as f64 / length.as_secs_f64(),
        workers[0].1
    );
    let _ = std::fs::remove_file(socket);
}
