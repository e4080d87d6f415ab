//! The routines of a plan as kernels for a card, in CUDA C++, for all members of a population at once.
//!
//! Every operation sums in the order of the processor, so that a member's bits are those of a trial alone: an entry of
//! a product is a chain of fused multiply-adds over `k`, computed by one thread, and depends neither on tiles nor on
//! the number of members. A block works for one member. No two threads add to the same number.
//!
//! | file | contents |
//! |---|---|
//! | `device.cuh`, `host.hpp` | the macros in which kernels are written, for a card and for a processor |
//! | [`arithmetic::cuda`] | the functions that they call |
//! | `product.cuh`, `operations.cuh` | operations of a plan |
//! | `parts` | operations of one routine as texts |
//! | `tiles` | sizes of the tiles of products |
//! | [`literal`] | the kernels on a processor, for tests |
//! | `layout` | places of values in a member's memory |
//!
//! The texts depend only on shapes. Operations without dependencies between them share a kernel, called a *wave*, whose
//! blocks are those of its operations one after the other.

mod layout;
pub mod literal;
mod parts;
mod tiles;

use crate::graph::{Graph, Routine};
use crate::operations::Operation;
use crate::state::State;
use crate::updates::Update;
use arithmetic::steps::Rates;
use layout::Layout;
use parts::{Part, parts};
use serde::{Deserialize, Serialize};
use std::fmt::Write;

pub use layout::{Leaf, Span, size};

/// Number of threads of a block of every kernel.
pub const THREADS: usize = 256;

const DEVICE: &str = include_str!("device.cuh");
const HOST: &str = include_str!("host.hpp");
const HOST_MAIN: &str = include_str!("host_main.hpp");
const POPULATION: &str = include_str!("population.cuh");
const PRODUCT: &str = include_str!("product.cuh");
const OPERATIONS: &str = include_str!("operations.cuh");

/// An operation that has no kernel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NoKernel {
    /// Name of the operation.
    pub operation: String,
}

impl std::fmt::Display for NoKernel {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "no kernel for a card computes {}", self.operation)
    }
}

impl std::error::Error for NoKernel {}

/// A kernel that a run of the routine launches.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Wave {
    /// Name of the function.
    pub name: String,
    /// Blocks for one member.
    pub blocks: usize,
}

/// A step of Adam, whose two rates a run must provide.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Descent {
    /// Name of the parameter, for which a state counts its steps.
    pub parameter: String,
    /// Name of the learning rate, and its first value.
    pub learning_rate: (String, f64),
    /// Decay rates of the moments.
    pub betas: [f64; 2],
}

/// Runs of one routine for some members of a population.
#[derive(Debug, Clone, Copy)]
pub struct Batch<'a> {
    /// The routine.
    pub kernels: &'a Kernels,
    /// Entries of a member's state.
    pub state_size: usize,
    /// First entry in a member's state of each tensor of the routine.
    pub tensors: &'a [u32],
    /// The member of each run. No member occurs twice.
    pub members: &'a [u32],
    /// Words of each run, of [`Kernels::prepare`].
    pub runs: &'a [&'a [u32]],
    /// Inputs of each run.
    pub inputs: &'a [&'a [f32]],
}

/// One routine as kernels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Kernels {
    /// Kernels that a run launches, in order.
    pub waves: Vec<Wave>,
    /// Steps of Adam in their order.
    pub descents: Vec<Descent>,
    /// Parameters and moments, in the order of their entries in `Population::tensors`.
    pub tensors: Vec<Leaf>,
    /// Inputs.
    pub inputs: Vec<Span>,
    /// Outputs.
    pub outputs: Vec<Span>,
    /// Entries of all other values of one run.
    pub value_size: usize,
    /// Bits of the entries that all members share.
    pub constants: Vec<u32>,
    text: String,
}

impl Kernels {
    /// Writes the kernels of a routine.
    ///
    /// # Errors
    /// [`NoKernel`] if the routine has an operation of another crate.
    pub fn new(graph: &Graph, routine: Routine) -> Result<Self, NoKernel> {
        let kernels = crate::kernels::kernels(graph, routine.0);
        let mut layout = Layout::new(graph, &kernels);
        let parts = parts(graph, &kernels, &mut layout)?;
        let (waves, text) = waves(parts, layout.cells());
        Ok(Self {
            waves,
            descents: descents(graph, routine),
            tensors: layout.tensors,
            inputs: layout.inputs,
            outputs: layout.outputs,
            value_size: layout.value_size,
            constants: layout.constants.iter().map(|entry| entry.to_bits()).collect(),
            text,
        })
    }

    /// Words of a run.
    #[must_use]
    pub fn run_size(&self) -> usize {
        2 + 2 * self.descents.len()
    }

    /// Adds moments that a state lacks, counts its steps, and returns the words of a run.
    ///
    /// # Panics
    /// If the state lacks a parameter or has another shape of it.
    pub fn prepare(&self, state: &mut State<f32>, seed: u64) -> Vec<u32> {
        self.add_moments(state);
        let halves = [seed & 0xffff_ffff, seed >> 32].map(|half| u32::try_from(half).unwrap_or(0));
        let mut words = halves.to_vec();
        for Descent {
            parameter,
            learning_rate: (name, first),
            betas,
        } in &self.descents
        {
            let rate = state.number(name).unwrap_or(*first);
            let rates = Rates::at(state.count_step(parameter), rate, *betas);
            words.extend(rates.parts().map(f32::to_bits));
        }
        words
    }

    /// Adds moments that a state lacks, as zeros.
    ///
    /// # Panics
    /// If the state lacks a parameter or has another shape of it.
    pub fn add_moments(&self, state: &mut State<f32>) {
        for leaf in &self.tensors {
            state.place(&leaf.name, leaf.shape, leaf.is_moment);
        }
    }

    /// The kernels in CUDA C++.
    #[must_use]
    pub fn source(&self) -> String {
        [DEVICE, &self.body()].concat()
    }

    /// A program in C++ that runs the kernels literally on a processor; `host_main.hpp` documents its input and output.
    #[must_use]
    pub fn host_program(&self) -> String {
        let mut run = String::from("\nstatic void run_all(const Population p) {\n");
        for Wave { name, blocks } in &self.waves {
            let _ = writeln!(run, "    RUN({name}, {blocks});");
        }
        run += "}\n\n";
        let _ = writeln!(run, "#define RUN_SIZE {}", self.run_size());
        let _ = writeln!(run, "#define INPUT_SIZE {}", size(&self.inputs));
        let _ = writeln!(run, "#define OUTPUT_SIZE {}", size(&self.outputs));
        let _ = writeln!(run, "#define VALUE_SIZE {}", self.value_size);
        let _ = writeln!(run, "#define N_TENSORS {}", self.tensors.len());
        let _ = writeln!(run, "#define N_CONSTANTS {}\n", self.constants.len());
        [HOST, RUN, &self.body(), &run, HOST_MAIN].concat()
    }

    fn body(&self) -> String {
        let arithmetic = arithmetic::cuda::source();
        [POPULATION, &arithmetic, OPERATIONS, PRODUCT, &self.text].concat()
    }
}

/// All blocks of a kernel for all members.
const RUN: &str = "#define RUN(kernel, blocks) \\
    for (PLACE = 0; PLACE < (int)p.members[0]; PLACE++) \\
        for (BLOCK = 0; BLOCK < (blocks); BLOCK++) kernel(p)\n\n";

fn descents(graph: &Graph, routine: Routine) -> Vec<Descent> {
    let steps = graph.live_steps(routine.0).into_iter();
    let updates = steps.filter_map(|step| match step {
        crate::graph::Step::Update(update) => Some(update),
        crate::graph::Step::Compute(_) => None,
    });
    let descents = updates.filter_map(|update| match update {
        Update::Adam {
            parameter, settings, ..
        } => Some(Descent {
            parameter: graph.nodes[parameter.0].name.clone().unwrap_or_default(),
            learning_rate: graph.numbers[settings.learning_rate.0].clone(),
            betas: settings.betas,
        }),
        _ => None,
    });
    descents.collect()
}

/// Assigns each operation to the first wave in which its operands are computed and no other operation reads or writes
/// its results.
fn waves(parts: Vec<Part>, cells: usize) -> (Vec<Wave>, String) {
    let (mut written, mut read) = (vec![0; cells], vec![0; cells]);
    let mut of_waves: Vec<Vec<Part>> = Vec::new();
    for part in parts {
        let after_writes = part.reads.iter().map(|cell| written[*cell]);
        let after_all = part.writes.iter().map(|cell| read[*cell].max(written[*cell]));
        let wave: usize = after_writes.chain(after_all).max().unwrap_or(0);
        // A cell's number is that of the first wave in which it is free.
        part.reads
            .iter()
            .for_each(|cell| read[*cell] = read[*cell].max(wave + 1));
        part.writes.iter().for_each(|cell| written[*cell] = wave + 1);
        of_waves.resize_with(of_waves.len().max(wave + 1), Vec::new);
        of_waves[wave].push(part);
    }
    let mut functions = Functions::default();
    let mut text = String::new();
    let waves = of_waves.iter().enumerate().map(|(at, parts)| {
        let name = format!("wave_{at}");
        write_wave(&mut text, &name, parts, &mut functions);
        Wave {
            name,
            blocks: parts.iter().map(|part| part.blocks).sum(),
        }
    });
    let waves = waves.collect();
    (waves, functions.text + &text)
}

/// Operations as functions, each text once.
#[derive(Default)]
struct Functions {
    known: Vec<String>,
    text: String,
}

impl Functions {
    fn name(&mut self, part: &Part) -> String {
        let parameters: Vec<&str> = part.parameters.iter().map(|(it, _)| it.as_str()).collect();
        let parameters = parameters.join(", ");
        let body = format!("({parameters}, const unsigned *run, const int block) {{\n");
        let lines = part.text.lines().map(|line| format!("    {line}\n"));
        let text = body + &lines.collect::<String>() + "}\n";
        let found = self.known.iter().position(|it| *it == text);
        let at = found.unwrap_or_else(|| {
            let _ = write!(
                self.text,
                "\nSHARED_TEXT void operation_{}{text}",
                self.known.len()
            );
            self.known.push(text);
            self.known.len() - 1
        });
        format!("operation_{at}")
    }
}

fn write_wave(text: &mut String, name: &str, parts: &[Part], functions: &mut Functions) {
    let _ = writeln!(text, "\nKERNEL({name}) {{");
    *text += "    MEMBER\n";
    let mut first = 0;
    for part in parts {
        let end = first + part.blocks;
        let addresses: Vec<&str> = part.parameters.iter().map(|(_, it)| it.as_str()).collect();
        let (function, addresses) = (functions.name(part), addresses.join(", "));
        let _ = writeln!(text, "    if (BLOCK >= {first} && BLOCK < {end}) {{");
        let _ = writeln!(text, "        {function}({addresses}, run, BLOCK - {first});");
        *text += "    }\n";
        first = end;
    }
    *text += "}\n";
}

/// A number in `f32` as written in C.
fn single(number: f64) -> String {
    #[allow(clippy::cast_possible_truncation, reason = "the nearest f32 is meant")]
    let number = number as f32;
    if number.is_finite() {
        format!("{number:?}f")
    } else {
        format!("from_bits(0x{:08x}u)", number.to_bits())
    }
}

/// Whether an operation is a leaf of a state.
fn is_of_state(operation: &Operation) -> bool {
    matches!(operation, Operation::Parameter | Operation::State)
}
