//! Operations of a routine as texts in C. A text runs in `blocks` blocks, and reads and writes memories by number.

use super::layout::Layout;
use super::tiles::product_of;
use super::{NoKernel, THREADS, single};
use crate::fusion::{Entrywise, Loop, Source};
use crate::graph::{Graph, Value};
use crate::kernels::Kernel;
use crate::operations::{Activation, Function, Operation, Pair, RowFunction};
use crate::updates::Update;
use arithmetic::products::SUM_BLOCK;
use std::fmt::Write;

/// An operation as a text.
pub(super) struct Part {
    pub(super) blocks: usize,
    pub(super) text: String,
    /// Entries of `f32` that the threads of a block share.
    pub(super) shared: usize,
    pub(super) reads: Vec<usize>,
    pub(super) writes: Vec<usize>,
}

/// Texts of kernels, with memory for partial sums.
pub(super) fn parts(graph: &Graph, kernels: &[Kernel], layout: &mut Layout) -> Result<Vec<Part>, NoKernel> {
    let mut writer = Writer {
        graph,
        layout,
        parts: Vec::new(),
        n_descents: 0,
    };
    for kernel in kernels {
        match kernel {
            Kernel::Loop(entrywise) => writer.add_loop(entrywise),
            Kernel::Single(value) => writer.add_single(*value)?,
            Kernel::Update(update) => writer.add_update(update),
        }
    }
    Ok(writer.parts)
}

struct Writer<'a> {
    graph: &'a Graph,
    layout: &'a mut Layout,
    parts: Vec<Part>,
    n_descents: usize,
}

impl Writer<'_> {
    /// Adds a text of one thread an entry, in which the first two memories are `a` and `b` and the result is `c`.
    fn add_entries(&mut self, n: usize, reads: &[Value], result: Value, text: &str) {
        let mut declarations = String::new();
        for (name, value) in ["a", "b"].iter().zip(reads) {
            let address = self.layout.address(value.0);
            let _ = writeln!(declarations, "const float *const {name} = {address};");
        }
        let address = self.layout.address(result.0);
        let _ = writeln!(declarations, "float *const c = {address};");
        self.parts.push(Part {
            blocks: n.div_ceil(THREADS),
            text: format!("{declarations}EACH_THREAD {{\n    ENTRY(i, {n})\n    {text}\n}}\n"),
            shared: 0,
            reads: reads.iter().map(|value| value.0).collect(),
            writes: vec![result.0],
        });
    }

    fn add_loop(&mut self, entrywise: &Loop) {
        let [rows, columns] = entrywise.shape();
        let mut text = String::new();
        let source = |source: &Source| match source {
            Source::Result(at) => format!("x{at}"),
            Source::Whole(value) => format!("{}[i]", self.layout.address(value.0)),
            Source::Repeated(value, [1, 1]) => format!("{}[0]", self.layout.address(value.0)),
            Source::Repeated(value, [1, _]) => format!("{}[i % {columns}]", self.layout.address(value.0)),
            Source::Repeated(value, _) => format!("{}[i / {columns}]", self.layout.address(value.0)),
        };
        for (at, operation) in entrywise.operations().iter().enumerate() {
            let expression = match operation {
                Entrywise::Map(function, x) => {
                    let _ = writeln!(text, "    const float of_{at} = {};", source(x));
                    map(*function, &format!("of_{at}"))
                }
                Entrywise::Combine(pair, a, b) => combine(*pair, &source(a), &source(b)),
            };
            let _ = writeln!(text, "    const float x{at} = {expression};");
        }
        for (at, value) in entrywise.kept() {
            let _ = writeln!(text, "    {}[i] = x{at};", self.layout.address(value.0));
        }
        let n = rows * columns;
        let part = Part {
            blocks: n.div_ceil(THREADS),
            text: format!("EACH_THREAD {{\n    ENTRY(i, {n})\n{text}}}\n"),
            shared: 0,
            reads: entrywise
                .operands(self.graph)
                .iter()
                .map(|value| value.0)
                .collect(),
            writes: entrywise.kept().map(|(_, value)| value.0).collect(),
        };
        self.parts.push(part);
    }

    fn add_single(&mut self, value: Value) -> Result<(), NoKernel> {
        let node = &self.graph.nodes[value.0];
        let n = node.shape[0] * node.shape[1];
        let operands = node.operands.clone();
        let draw = |function: &str, index| {
            format!("u64 words = stream_of(run[0] | (u64)run[1] << 32, {index}, i);\n    c[i] = {function};")
        };
        let text = match &node.operation {
            Operation::Normal { index } => draw("(float)normal(word(&words))", index),
            Operation::Uniform { index } => draw("uniform_f(word(&words))", index),
            Operation::LogGamma { index } => draw("(float)log_gamma_draw((double)a[i], words)", index),
            Operation::LogGammaSlope => "c[i] = (float)log_gamma_slope((double)a[i], (double)b[i]);".into(),
            Operation::Rows(function) => return self.add_rows(*function, value),
            Operation::Dense(activation) => return self.add_product(value, [false; 2], Some(*activation)),
            Operation::Product { transposed } => return self.add_product(value, *transposed, None),
            Operation::Sum => return self.add_sum(value),
            Operation::ClipScale { largest } => return self.add_clip_scale(value, *largest),
            Operation::Join => self.joined(value),
            Operation::Extension(extension) => {
                return Err(NoKernel {
                    operation: extension.0.name(),
                });
            }
            _ => self.moved_or_summed(value),
        };
        self.add_entries(n, &operands, value, &text);
        Ok(())
    }

    /// Sums and moves of one thread an entry.
    fn moved_or_summed(&self, value: Value) -> String {
        let node = &self.graph.nodes[value.0];
        let columns = node.shape[1];
        let [rows, width] = self.graph.shape(node.operands[0]);
        match node.operation {
            Operation::SumRows => format!("c[i] = sum_of_chains(a + i, {rows}, {columns});"),
            Operation::SumColumns => format!("c[i] = sum_of_chains(a + i * {width}, {width}, 1);"),
            Operation::SumGroups { size } => {
                let first = format!("i / {width} * {} + i % {width}", size * width);
                format!("c[i] = sum_of_chains(a + {first}, {size}, {width});")
            }
            Operation::LargestOfColumns => format!("c[i] = largest_of(a + i * {width}, {width});"),
            Operation::PlaceOfLargest => format!("c[i] = place_of_largest(a + i * {width}, {width});"),
            Operation::Ranked { rank } => format!("c[i] = ranked(a + i * {width}, {width}, {rank});"),
            Operation::Columns { first } => {
                format!("c[i] = a[i / {columns} * {width} + {first} + i % {columns}];")
            }
            Operation::Place { first } => format!(
                "const int at = i % {columns} - {first};\n    c[i] = at >= 0 && at < {width} ? a[i / {columns} * {width} + at] : 0.0f;"
            ),
            Operation::Gather => format!(
                "const int at = named_column(b[i], {width});\n    c[i] = at < {width} ? a[i * {width} + at] : NOT_A_NUMBER;"
            ),
            Operation::Scatter => format!(
                "const int at = named_column(b[i / {columns}], {columns});\n    \
                 c[i] = at == i % {columns} ? a[i / {columns}] : at < {columns} ? 0.0f : NOT_A_NUMBER;"
            ),
            Operation::RepeatRows { times } => {
                format!("c[i] = a[i / {} * {width} + i % {width}];", times * width)
            }
            Operation::Reshape => "c[i] = a[i];".into(),
            ref other => unreachable!("{other} has a kernel of its own"),
        }
    }

    fn joined(&self, value: Value) -> String {
        let node = &self.graph.nodes[value.0];
        let columns = node.shape[1];
        let mut text = format!("const int row = i / {columns}, column = i % {columns};\n    c[i] = ");
        let mut first = 0;
        for (at, operand) in node.operands.iter().enumerate() {
            let width = self.graph.shape(*operand)[1];
            let entry = format!(
                "{}[row * {width} + column - {first}]",
                self.layout.address(operand.0)
            );
            first += width;
            let _ = if at + 1 == node.operands.len() {
                write!(text, "{entry};")
            } else {
                write!(text, "column < {first} ? {entry} : ")
            };
        }
        text
    }

    fn add_rows(&mut self, function: RowFunction, value: Value) -> Result<(), NoKernel> {
        let node = &self.graph.nodes[value.0];
        let (rows, width) = (node.shape[0], node.shape[1]);
        let operands = node.operands.clone();
        let n = self.graph.shape(operands[0])[1];
        let text = match function {
            RowFunction::DirichletDensity => {
                format!("dirichlet_density(a + i * {n}, b + i * {n}, {n}, c + i * {width});")
            }
            RowFunction::DirichletScore => {
                format!("dirichlet_score(a + i * {n}, b + i * {n}, {n}, c + i * {width});")
            }
            RowFunction::DirichletEntropy => format!("dirichlet_entropy(a + i * {n}, {n}, c + i * {width});"),
            RowFunction::DirichletEntropySlope => {
                format!("dirichlet_entropy_slope(a + i * {n}, {n}, c + i * {width});")
            }
        };
        self.add_entries(rows, &operands, value, &text);
        Ok(())
    }

    fn add_product(
        &mut self,
        value: Value,
        turned: [bool; 2],
        activation: Option<Activation>,
    ) -> Result<(), NoKernel> {
        let node = &self.graph.nodes[value.0];
        let [rows, columns] = node.shape;
        let inner = self.graph.shape(node.operands[0])[usize::from(!turned[0])];
        let (function, blocks, shared) = product_of(node.shape);
        let address = |value: &Value| self.layout.address(value.0);
        let bias = activation.map_or_else(|| "0".to_owned(), |_| address(&node.operands[2]));
        let code = match activation.unwrap_or_default() {
            Activation::Identity => 0,
            Activation::Relu => 1,
            Activation::LeakyRelu => 2,
            Activation::Tanh => 3,
        };
        let [a, b] = [0, 1].map(|at| address(&node.operands[at]));
        let turned = turned.map(u8::from);
        let text = format!(
            "{function}({a}, {b}, {}, {bias}, {code}, {rows}, {columns}, {inner}, {}, {}, block, shared);\n",
            address(&value),
            turned[0],
            turned[1]
        );
        self.parts.push(Part {
            blocks,
            text,
            shared,
            reads: node.operands.iter().map(|value| value.0).collect(),
            writes: vec![value.0],
        });
        Ok(())
    }

    fn add_sum(&mut self, value: Value) -> Result<(), NoKernel> {
        let x = self.graph.nodes[value.0].operands[0];
        let [rows, columns] = self.graph.shape(x);
        self.add_sums(
            ["sum_of_blocks", "sum_of_blocks"],
            x.0,
            rows * columns,
            Some(value.0),
        );
        Ok(())
    }

    /// Adds sums of blocks until one is left, which is written to a memory or to one of its own; its number.
    fn add_sums(
        &mut self,
        [mut function, others]: [&str; 2],
        x: usize,
        n: usize,
        last: Option<usize>,
    ) -> usize {
        let is_wide = others.starts_with("wide");
        let (mut from, mut left) = (x, n);
        loop {
            let sums = left.div_ceil(SUM_BLOCK);
            let to = match last {
                Some(last) if sums == 1 => last,
                _ => self.layout.add_partial(sums * if is_wide { 2 } else { 1 }),
            };
            let [source, target] = [from, to].map(|cell| self.layout.address(cell));
            let read = if function.starts_with("wide") {
                "const double"
            } else {
                "const float"
            };
            let written = if is_wide { "double" } else { "float" };
            self.parts.push(Part {
                blocks: sums.div_ceil(THREADS / 32),
                text: format!(
                    "{function}(({read} *){source}, {left}, ({written} *){target}, block, shared);\n"
                ),
                shared: THREADS * if is_wide { 2 } else { 1 },
                reads: vec![from],
                writes: vec![to],
            });
            if sums == 1 {
                return to;
            }
            (from, left, function) = (to, sums, others);
        }
    }

    fn add_clip_scale(&mut self, value: Value, largest: f64) -> Result<(), NoKernel> {
        let mut squares = Vec::new();
        for operand in self.graph.nodes[value.0].operands.clone() {
            let [rows, columns] = self.graph.shape(operand);
            let functions = ["squares_of_blocks", "wide_sum_of_blocks"];
            squares.push(self.add_sums(functions, operand.0, rows * columns, None));
        }
        let mut text = String::from("double squares = 0.0;\n");
        for cell in &squares {
            let _ = writeln!(
                text,
                "    squares += *(const double *){};",
                self.layout.address(*cell)
            );
        }
        text += "    const double norm = sqrt(squares);\n";
        let _ = write!(
            text,
            "    c[i] = norm > {largest:?} ? (float)({largest:?} / norm) : 1.0f;"
        );
        self.add_entries(1, &[], value, &text);
        if let Some(part) = self.parts.last_mut() {
            part.reads = squares;
        }
        Ok(())
    }

    fn add_update(&mut self, update: &Update) {
        let target = update.target();
        let [rows, columns] = self.graph.shape(target);
        let (text, moments) = match update {
            Update::Adam {
                moments, settings, ..
            } => {
                let rate = 2 + 2 * self.n_descents;
                self.n_descents += 1;
                let [first, second] = moments.map(|moment| self.layout.address(moment.0));
                let [beta_1, beta_2] = settings.betas.map(single);
                let rates = format!("float_of(run[{rate}]), float_of(run[{}])", rate + 1);
                let text =
                    format!("descend(c + i, a[i], {first} + i, {second} + i, {rates}, {beta_1}, {beta_2});");
                (text, moments.to_vec())
            }
            Update::Follow { tau, .. } => (format!("c[i] += {} * (a[i] - c[i]);", single(*tau)), Vec::new()),
            Update::Assign { .. } => ("c[i] = a[i];".to_owned(), Vec::new()),
        };
        self.add_entries(rows * columns, &[update.source()], target, &text);
        if let Some(part) = self.parts.last_mut() {
            part.writes.extend(moments.iter().map(|moment| moment.0));
        }
    }
}

/// A function of a name.
fn map(function: Function, x: &str) -> String {
    match function {
        Function::Repeat | Function::Stop => x.into(),
        Function::Negate => format!("-{x}"),
        Function::Rectify(below) => format!("rectified({x}, {})", single(below)),
        Function::RectifierSlope(below) => format!("{x} > 0.0f ? 1.0f : {}", single(below)),
        Function::Tanh => format!("tanh_f({x})"),
        Function::OneLessSquare => format!("1.0f - {x} * {x}"),
        Function::Exp => format!("exp_f({x})"),
        Function::Ln => format!("ln_f({x})"),
        Function::Ln1p => format!("ln_1p_f({x})"),
        Function::Softplus => format!("softplus_f({x})"),
        Function::Sigmoid => format!("sigmoid_f({x})"),
        Function::Absolute => format!("absolute({x})"),
        Function::Sign => format!("sign({x})"),
        Function::Square => format!("{x} * {x}"),
        Function::Sqrt => format!("sqrtf({x})"),
        Function::Scale(factor) => format!("{} * {x}", single(factor)),
        Function::Shift(summand) => format!("{x} + {}", single(summand)),
        Function::Clamp(low, high) => format!("held({x}, {}, {})", single(low), single(high)),
        Function::Within(low, high) => {
            format!("{} <= {x} && {x} <= {} ? 1.0f : 0.0f", single(low), single(high))
        }
        Function::LnGamma => format!("(float)ln_gamma((double){x})"),
        Function::Digamma => format!("(float)digamma((double){x})"),
        Function::Trigamma => format!("(float)trigamma((double){x})"),
    }
}

/// A function of two expressions.
fn combine(pair: Pair, a: &str, b: &str) -> String {
    match pair {
        Pair::Add => format!("{a} + {b}"),
        Pair::Subtract => format!("{a} - {b}"),
        Pair::Multiply => format!("{a} * {b}"),
        Pair::Divide => format!("{a} / {b}"),
        Pair::Smaller => format!("smaller({a}, {b})"),
        Pair::Larger => format!("larger({a}, {b})"),
        Pair::Exceeds => format!("{a} > {b} ? 1.0f : 0.0f"),
        Pair::AtMost => format!("{a} > {b} ? 0.0f : 1.0f"),
    }
}
