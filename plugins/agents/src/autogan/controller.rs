//! The controller: an LSTM that decides one choice after the other, each given the earlier ones.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | x | embedding of the latest option; zeros before the first one | `[1, width]` |
//! | h, c | output and cell state of the LSTM | `[1, width]` each |
//! | i, f, g, o | gates, the four parts of `x W + h U + b` | `[1, width]` each |
//! | z | outputs of a choice, `h V + d` | `[1, options]` |
//!
//! `c' = sigmoid(f) c + sigmoid(i) tanh(g)`, `h' = sigmoid(o) tanh(c')`. All parameters are uniform in -0.1..0.1, as
//! in the released code; the biases too.

use numerics::equations::{network::Network, state_file};
use numerics::tensor_file::{TensorFile, TensorFileError};
use plan::{Descent, Equations, Expression, Plans, Processor, State};
use rand::{Rng, RngCore};

/// Bound of the uniform distribution of initial parameters.
const BOUND: f32 = 0.1;
/// Name of the embedding, one row per option of every choice, `[options, width]`.
const EMBEDDING: &str = "embedding";
/// Inputs of a choice: x, h and c.
const PLACE: [&str; 3] = ["input", "hidden", "cell"];

/// The controller with its parameters.
#[derive(Debug, Clone)]
pub(super) struct Controller {
    layers: Layers,
    learning_rate: f64,
    state: State<f32>,
    acting: Plans,
    /// Plans by the number of steps of a design.
    learning: Plans,
}

/// Layers, and the equations by which they decide and learn.
#[derive(Debug, Clone)]
pub(super) struct Layers {
    /// Number of options of each choice.
    sizes: Vec<usize>,
    width: usize,
    /// Gates `[width, 4 width]`: one layer for the input, one for the state.
    gates: [Network; 2],
    /// Output layers, one per choice.
    outputs: Vec<Network>,
}

/// State of the LSTM between two choices.
#[derive(Clone, Copy)]
struct Memory<'e> {
    hidden: Expression<'e>,
    cell: Expression<'e>,
}

impl Controller {
    /// Creates a controller for choices with these numbers of options.
    pub(super) fn new(sizes: &[usize], width: usize, learning_rate: f64, rng: &mut impl RngCore) -> Self {
        let mut state = State::default();
        let shape = [sizes.iter().sum(), width];
        state.insert(EMBEDDING, shape, uniform(shape, rng));
        let mut layer = |name: String, outputs| {
            let network = Network::new(name, &[width, outputs], &[]);
            let shapes = [[width, outputs], [1, outputs]];
            for (name, shape) in network.parameter_names().into_iter().zip(shapes) {
                state.insert(name, shape, uniform(shape, rng));
            }
            network
        };
        let layers = Layers {
            gates: ["input", "state"].map(|of| layer(format!("gates.{of}"), 4 * width)),
            outputs: sizes
                .iter()
                .enumerate()
                .map(|(choice, size)| layer(format!("outputs.{choice}"), *size))
                .collect(),
            sizes: sizes.to_vec(),
            width,
        };
        Self {
            layers,
            learning_rate,
            state,
            acting: Plans::default(),
            learning: Plans::default(),
        }
    }

    /// Options of the next step of a design; `pick` selects each from its probabilities.
    pub(super) fn decide(
        &mut self,
        so_far: &[Vec<usize>],
        pick: &mut dyn FnMut(&[f32]) -> usize,
    ) -> Vec<usize> {
        let (layers, state) = (&self.layers, &mut self.state);
        let plan = self.acting.of_rows(1, |equations| layers.decide(equations));
        let mut place = PLACE.map(|_| vec![0.0; layers.width]);
        let mut take = |choice: usize, pick: &mut dyn FnMut(&[f32]) -> usize| {
            for (name, numbers) in PLACE.iter().zip(&place) {
                plan.write(name, numbers);
            }
            plan.run(&routine(choice), state);
            let after = |what: &str| plan.entries(&of_choice(choice, what));
            let taken = pick(after("probabilities"));
            let row = layers.first_row(choice) + taken;
            let embedded = &state.entries(EMBEDDING)[row * layers.width..(row + 1) * layers.width];
            place = [embedded, after("hidden"), after("cell")].map(<[f32]>::to_vec);
            taken
        };
        for (choice, taken) in so_far.iter().flat_map(|step| step.iter().enumerate()) {
            take(choice, &mut |_| *taken);
        }
        (0..layers.sizes.len())
            .map(|choice| take(choice, &mut *pick))
            .collect()
    }

    /// Log probability of the options in the last step of a design, given the earlier steps, and the sum of
    /// the entropies of their distributions.
    pub(super) fn judge(&mut self, design: &[Vec<usize>]) -> (f64, f64) {
        let plan = written(&self.layers, &mut self.learning, design, self.learning_rate);
        plan.run("judge", &mut self.state);
        (plan.number("log_probability"), plan.number("entropy"))
    }

    /// Takes one step of Adam against the log probability of [`Controller::judge`] times a weight.
    #[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
    pub(super) fn descend(&mut self, design: &[Vec<usize>], weight: f64) {
        let plan = written(&self.layers, &mut self.learning, design, self.learning_rate);
        plan.write("weight", &[weight as f32]);
        plan.run("improve", &mut self.state);
    }

    /// The operations of an update by a design with so many steps.
    pub(super) fn plan(&mut self, n_steps: usize) -> String {
        let plan = plan_of(&self.layers, &mut self.learning, n_steps, self.learning_rate);
        plan.graph().to_string()
    }

    /// Stores parameters and moments.
    pub(super) fn store(&self, file: &mut TensorFile) {
        state_file::store(&self.state, file);
    }

    /// Restores what [`Controller::store`] wrote.
    ///
    /// # Errors
    /// [`TensorFileError`] where a parameter is missing or has another shape.
    pub(super) fn restore(&mut self, file: &TensorFile) -> Result<(), TensorFileError> {
        state_file::restore(&mut self.state, file)
    }
}

/// The plan for designs with this number of steps.
fn plan_of<'p>(
    layers: &Layers,
    plans: &'p mut Plans,
    n_steps: usize,
    learning_rate: f64,
) -> &'p mut Processor<f32> {
    plans.of_rows(n_steps, |equations| {
        layers.learn(equations, n_steps, learning_rate);
    })
}

/// The plan for designs with as many steps as this one, which is written to its inputs.
fn written<'p>(
    layers: &Layers,
    plans: &'p mut Plans,
    design: &[Vec<usize>],
    learning_rate: f64,
) -> &'p mut Processor<f32> {
    let plan = plan_of(layers, plans, design.len(), learning_rate);
    let (before, taken) = layers.inputs(design);
    plan.write("before", &before);
    plan.write("taken", &taken);
    plan
}

impl Layers {
    /// One routine per choice, from the state before it to its probabilities and the state after it.
    fn decide(&self, equations: &Equations) {
        let [input, hidden, cell] = PLACE.map(|name| equations.input(name, [1, self.width]));
        for choice in 0..self.sizes.len() {
            equations.routine(&routine(choice));
            let (next, logs) = self.advance(input, Memory { hidden, cell }, choice);
            let named = [
                ("hidden", next.hidden),
                ("cell", next.cell),
                ("probabilities", logs.exp()),
            ];
            for (name, value) in named {
                equations.output(&of_choice(choice, name), value);
            }
        }
    }

    /// The routines that judge the last step of a design, and that improve the parameters.
    fn learn(&self, equations: &Equations, n_steps: usize, learning_rate: f64) {
        let (before, taken) = self.design(equations, n_steps);
        let weight = equations.input("weight", [1, 1]);
        equations.routine("judge");
        let (log_probability, entropy) = self.judged(before, taken);
        equations.output("log_probability", log_probability);
        equations.output("entropy", entropy);
        equations.routine("improve");
        let loss = self.judged(before, taken).0 * weight;
        let descent = Descent {
            betas: [0.0, 0.9],
            ..Descent::adam("learning_rate", learning_rate, None)
        };
        equations.descend(loss, &self.parameters(equations), &descent);
    }

    /// Inputs of a design: `before`, the option before each choice as a row of noughts and a one, `[steps choices,
    /// options]`, with noughts before the first choice; and `taken`, the options of the last step, `[1, choices]`.
    pub(super) fn design<'e>(
        &self,
        equations: &'e Equations,
        n_steps: usize,
    ) -> (Expression<'e>, Expression<'e>) {
        let n = self.sizes.len();
        let before = equations.input("before", [n_steps * n, self.first_row(n)]);
        (before, equations.input("taken", [1, n]))
    }

    /// Entries of the inputs of [`Layers::design`].
    #[allow(clippy::cast_precision_loss, reason = "an option is far below 2^24")]
    pub(super) fn inputs(&self, design: &[Vec<usize>]) -> (Vec<f32>, Vec<f32>) {
        let (n, n_rows) = (self.sizes.len(), self.first_row(self.sizes.len()));
        let mut before = vec![0.0; design.len() * n * n_rows];
        for (at, taken) in design.iter().flatten().enumerate().take(design.len() * n - 1) {
            before[(at + 1) * n_rows + self.first_row(at % n) + taken] = 1.0;
        }
        let last = design.last().into_iter().flatten();
        (before, last.map(|taken| *taken as f32).collect())
    }

    /// Log probability of the options in the last step of a design, given the earlier steps, and the sum of
    /// the entropies of their distributions; `[1, 1]` each.
    pub(super) fn judged<'e>(
        &self,
        before: Expression<'e>,
        taken: Expression<'e>,
    ) -> (Expression<'e>, Expression<'e>) {
        let (equations, n, n_choices) = (before.equations(), self.sizes.len(), before.n_rows());
        let embedding = equations.parameter(EMBEDDING, [self.first_row(n), self.width]);
        let embedded = before
            .product(embedding, [false; 2])
            .reshape([1, n_choices * self.width]);
        let zeros = equations.constant([1, self.width], &vec![0.0; self.width]);
        let mut memory = Memory {
            hidden: zeros,
            cell: zeros,
        };
        let (mut log_probabilities, mut entropies) = (Vec::new(), Vec::new());
        for at in 0..n_choices {
            let input = embedded.columns(at * self.width..(at + 1) * self.width);
            let (next, logs) = self.advance(input, memory, at % n);
            memory = next;
            if at + n >= n_choices {
                log_probabilities.push(logs.gather(taken.columns(at % n..at % n + 1)));
                entropies.push(-(logs.exp() * logs).sum());
            }
        }
        let [log_probability, entropy] = [log_probabilities, entropies].map(|all| equations.join(&all).sum());
        (log_probability, entropy)
    }

    /// State after a choice, and the log probabilities of its options.
    fn advance<'e>(
        &self,
        input: Expression<'e>,
        memory: Memory<'e>,
        choice: usize,
    ) -> (Memory<'e>, Expression<'e>) {
        let sum = self.gates[0].apply(input) + self.gates[1].apply(memory.hidden);
        let gate = |at: usize| sum.columns(at * self.width..(at + 1) * self.width);
        let cell = gate(1).sigmoid() * memory.cell + gate(0).sigmoid() * gate(2).tanh();
        let hidden = gate(3).sigmoid() * cell.tanh();
        let logs = self.outputs[choice].apply(hidden).log_softmax();
        (Memory { hidden, cell }, logs)
    }

    fn parameters<'e>(&self, equations: &'e Equations) -> Vec<Expression<'e>> {
        let embedding = equations.parameter(EMBEDDING, [self.first_row(self.sizes.len()), self.width]);
        let layers = self.gates.iter().chain(&self.outputs);
        let of_layers = layers.flat_map(|layer| layer.parameters(equations));
        std::iter::once(embedding).chain(of_layers).collect()
    }

    /// Row of the embedding with the first option of a choice; the number of rows for the number of choices.
    fn first_row(&self, choice: usize) -> usize {
        self.sizes[..choice].iter().sum()
    }
}

fn routine(choice: usize) -> String {
    format!("choice_{choice}")
}

/// Name of an output of a choice's routine.
fn of_choice(choice: usize, what: &str) -> String {
    format!("choice_{choice}.{what}")
}

fn uniform(shape: [usize; 2], rng: &mut impl RngCore) -> Vec<f32> {
    (0..shape[0] * shape[1])
        .map(|_| rng.random_range(-BOUND..BOUND))
        .collect()
}

#[cfg(test)]
impl Controller {
    /// Layers and parameters.
    pub(super) fn parts(&self) -> (&Layers, &State<f32>) {
        (&self.layers, &self.state)
    }

    pub(super) fn learning(&mut self) -> &mut Plans {
        &mut self.learning
    }
}
