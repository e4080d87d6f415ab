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

/// An operation as the text of a function. Operations of one kind and shape share it.
pub(super) struct Part {
    pub(super) blocks: usize,
    pub(super) text: String,
    /// Parameters of the function, such as `const float *a`, and the addresses that it is called with.
    pub(super) parameters: Vec<(String, String)>,
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
            // Only the processor joins products and gates.
            Kernel::Gated(gated) => unreachable!("{gated:?}"),
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
    /// A parameter of entries that are read, by the name of a value.
    fn read(&self, name: &str, value: Value) -> (String, String) {
        (format!("const float *{name}"), self.layout.address(value.0))
    }

    /// A parameter of entries that are written.
    fn written(&self, name: &str, value: Value) -> (String, String) {
        (format!("float *{name}"), self.layout.address(value.0))
    }

    /// Adds a text with one thread per entry, in which the first two operands are `a` and `b` and the result is `c`.
    fn add_entries(&mut self, n: usize, reads: &[Value], result: Value, text: &str) -> &mut Part {
        let mut parameters = vec![self.written("c", result)];
        parameters.extend(
            ["a", "b"]
                .iter()
                .zip(reads)
                .map(|(name, value)| self.read(name, *value)),
        );
        let at = self.parts.len();
        self.parts.push(Part {
            blocks: n.div_ceil(THREADS),
            text: format!("EACH_THREAD {{\n    ENTRY(i, {n})\n    {text}\n}}\n"),
            parameters,
            reads: reads.iter().map(|value| value.0).collect(),
            writes: vec![result.0],
        });
        &mut self.parts[at]
    }

    fn add_loop(&mut self, entrywise: &Loop) {
        let [rows, columns] = entrywise.shape();
        let operands = entrywise.operands(self.graph);
        let of = |value: &Value| {
            operands
                .iter()
                .position(|other| other == value)
                .unwrap_or_default()
        };
        let source = |source: &Source| match source {
            Source::Result(at) => format!("x{at}"),
            Source::Whole(value) => format!("a{}[i]", of(value)),
            Source::Repeated(value, [1, 1]) => format!("a{}[0]", of(value)),
            Source::Repeated(value, [1, _]) => format!("a{}[i % {columns}]", of(value)),
            Source::Repeated(value, _) => format!("a{}[i / {columns}]", of(value)),
        };
        let mut text = String::new();
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
        for (at, _) in entrywise.kept() {
            let _ = writeln!(text, "    c{at}[i] = x{at};");
        }
        let n = rows * columns;
        let reads = operands.iter().enumerate();
        let reads = reads.map(|(at, value)| self.read(&format!("a{at}"), *value));
        let results = entrywise.kept();
        let results = results.map(|(at, value)| self.written(&format!("c{at}"), value));
        let part = Part {
            blocks: n.div_ceil(THREADS),
            text: format!("EACH_THREAD {{\n    ENTRY(i, {n})\n{text}}}\n"),
            parameters: reads.chain(results).collect(),
            reads: operands.iter().map(|value| value.0).collect(),
            writes: entrywise.kept().map(|(_, value)| value.0).collect(),
        };
        self.parts.push(part);
    }

    fn add_single(&mut self, value: Value) -> Result<(), NoKernel> {
        let graph = self.graph;
        match &graph.nodes[value.0].operation {
            Operation::Rows(function) => self.add_rows(*function, value),
            Operation::Dense(activation) => self.add_product(value, [false; 2], Some(*activation)),
            Operation::Product { transposed } => self.add_product(value, *transposed, None),
            Operation::Sum => self.add_sum(value),
            Operation::ClipScale { largest } => self.add_clip_scale(value, *largest),
            Operation::Join => self.add_join(value),
            Operation::Extension(extension) => {
                return Err(NoKernel {
                    operation: extension.0.name(),
                });
            }
            _ => {
                let node = &graph.nodes[value.0];
                let text = self.drawn_or_moved(value);
                self.add_entries(node.shape[0] * node.shape[1], &node.operands, value, &text);
            }
        }
        Ok(())
    }

    /// Text of draws, sums and moves with one thread per entry.
    fn drawn_or_moved(&self, value: Value) -> String {
        let node = &self.graph.nodes[value.0];
        let columns = node.shape[1];
        // Only draws have no operands.
        let operand = node.operands.first().copied().unwrap_or(value);
        let [rows, width] = self.graph.shape(operand);
        match node.operation {
            Operation::Normal { index } => format!("c[i] = normal_of(stream_of(run, {index}, i));"),
            Operation::Uniform { index } => format!("c[i] = uniform_of(stream_of(run, {index}, i));"),
            Operation::LogGamma { index } => {
                format!("c[i] = log_gamma_of(a[i], stream_of(run, {index}, i));")
            }
            Operation::LogGammaSlope => "c[i] = (float)log_gamma_slope((double)a[i], (double)b[i]);".into(),
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
                "const int at = named_column(b[i], {width});\n    c[i] = at < {width} ? a[i * {width} + at] : ARITHMETIC_NAN_F;"
            ),
            Operation::Scatter => format!(
                "const int at = named_column(b[i / {columns}], {columns});\n    \
                 c[i] = at == i % {columns} ? a[i / {columns}] : at < {columns} ? 0.0f : ARITHMETIC_NAN_F;"
            ),
            Operation::RepeatRows { times } => {
                format!("c[i] = a[i / {} * {width} + i % {width}];", times * width)
            }
            Operation::Reshape => "c[i] = a[i];".into(),
            ref other => unreachable!("{other} has a kernel of its own"),
        }
    }

    fn add_join(&mut self, value: Value) {
        let node = &self.graph.nodes[value.0];
        let [rows, columns] = node.shape;
        let operands = node.operands.clone();
        let mut text = format!("const int row = i / {columns}, column = i % {columns};\n    c[i] = ");
        let mut first = 0;
        for (at, operand) in operands.iter().enumerate() {
            let width = self.graph.shape(*operand)[1];
            let entry = format!("a{at}[row * {width} + column - {first}]");
            first += width;
            let _ = if at + 1 == operands.len() {
                write!(text, "{entry};")
            } else {
                write!(text, "column < {first} ? {entry} : ")
            };
        }
        let parts = operands.iter().enumerate();
        let parts: Vec<_> = parts
            .map(|(at, part)| self.read(&format!("a{at}"), *part))
            .collect();
        let part = self.add_entries(rows * columns, &[], value, &text);
        part.parameters.extend(parts);
        part.reads = operands.iter().map(|value| value.0).collect();
    }

    fn add_rows(&mut self, function: RowFunction, value: Value) {
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
    }

    fn add_product(&mut self, value: Value, turned: [bool; 2], activation: Option<Activation>) {
        let node = &self.graph.nodes[value.0];
        let [rows, columns] = node.shape;
        let inner = self.graph.shape(node.operands[0])[usize::from(!turned[0])];
        let (function, blocks) = product_of(node.shape);
        let code = match activation.unwrap_or_default() {
            Activation::Identity => 0,
            Activation::Relu => 1,
            Activation::LeakyRelu => 2,
            Activation::Tanh => 3,
        };
        let bias = if activation.is_some() { "bias" } else { "0" };
        let [a_turned, b_turned] = turned.map(u8::from);
        let names = ["a", "b", "bias"].iter().zip(&node.operands);
        let mut parameters: Vec<_> = names.map(|(name, value)| self.read(name, *value)).collect();
        parameters.push(self.written("c", value));
        self.parts.push(Part {
            blocks,
            text: format!(
                "{function}(a, b, c, {bias}, {code}, {rows}, {columns}, {inner}, {a_turned}, {b_turned}, block);\n"
            ),
            parameters,
            reads: node.operands.iter().map(|value| value.0).collect(),
            writes: vec![value.0],
        });
    }

    fn add_sum(&mut self, value: Value) {
        let x = self.graph.nodes[value.0].operands[0];
        let [rows, columns] = self.graph.shape(x);
        self.add_sums(
            ["sum_of_blocks", "sum_of_blocks"],
            x.0,
            rows * columns,
            Some(value.0),
        );
    }

    /// Adds sums of blocks until one is left, which is written to the given memory or to a new one; returns its number.
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
                "double"
            } else {
                "float"
            };
            let written = if is_wide { "double" } else { "float" };
            self.parts.push(Part {
                blocks: sums.div_ceil(THREADS / 32),
                text: format!("{function}(a, {left}, c, block);\n"),
                parameters: vec![
                    (format!("const {read} *a"), format!("(const {read} *){source}")),
                    (format!("{written} *c"), format!("({written} *){target}")),
                ],
                reads: vec![from],
                writes: vec![to],
            });
            if sums == 1 {
                return to;
            }
            (from, left, function) = (to, sums, others);
        }
    }

    fn add_clip_scale(&mut self, value: Value, largest: f64) {
        let mut squares = Vec::new();
        for operand in self.graph.nodes[value.0].operands.clone() {
            let [rows, columns] = self.graph.shape(operand);
            let functions = ["squares_of_blocks", "wide_sum_of_blocks"];
            squares.push(self.add_sums(functions, operand.0, rows * columns, None));
        }
        let mut text = String::from("double squares = 0.0;\n");
        for at in 0..squares.len() {
            let _ = writeln!(text, "    squares += *a{at};");
        }
        text += "    const double norm = sqrt(squares);\n";
        let _ = write!(
            text,
            "    c[i] = norm > {largest:?} ? (float)({largest:?} / norm) : 1.0f;"
        );
        let address = |(at, cell): (usize, &usize)| {
            let address = format!("(const double *){}", self.layout.address(*cell));
            (format!("const double *a{at}"), address)
        };
        let sums: Vec<_> = squares.iter().enumerate().map(address).collect();
        let part = self.add_entries(1, &[], value, &text);
        part.parameters.extend(sums);
        part.reads = squares;
    }

    fn add_update(&mut self, update: &Update) {
        let target = update.target();
        let [rows, columns] = self.graph.shape(target);
        let text = match update {
            Update::Adam { settings, .. } => {
                let [beta_1, beta_2] = settings.betas.map(single);
                let rates = "from_bits(rates[0]), from_bits(rates[1])";
                format!("adam(c[i], a[i], first[i], second[i], {beta_1}, {beta_2}, {rates});")
            }
            Update::Follow { tau, .. } => format!("c[i] = followed(c[i], a[i], {});", single(*tau)),
            Update::Assign { .. } => "c[i] = a[i];".to_owned(),
        };
        let moments = update.moments();
        let names = ["first", "second"].iter().zip(&moments);
        let mut parameters: Vec<_> = names.map(|(name, value)| self.written(name, *value)).collect();
        if let Update::Adam { .. } = update {
            let rates = format!("(run + {})", 2 + 2 * self.n_descents);
            parameters.push(("const unsigned *rates".to_owned(), rates));
            self.n_descents += 1;
        }
        let part = self.add_entries(rows * columns, &[update.source()], target, &text);
        part.parameters.extend(parameters);
        part.writes.extend(moments.iter().map(|moment| moment.0));
    }
}

/// A function of an expression, as text.
fn map(function: Function, x: &str) -> String {
    match function {
        Function::Repeat | Function::Stop => x.into(),
        Function::Negate => format!("-{x}"),
        Function::Rectify(below) => format!("rectified({x}, {})", single(below)),
        Function::RectifierSlope(below) => format!("{x} > 0.0f ? 1.0f : {}", single(below)),
        Function::Tanh => format!("single::tanh({x})"),
        Function::OneLessSquare => format!("1.0f - {x} * {x}"),
        Function::Exp => format!("single::exp({x})"),
        Function::Ln => format!("single::ln({x})"),
        Function::Ln1p => format!("single::ln_1p({x})"),
        Function::Softplus => format!("single::softplus({x})"),
        Function::Sigmoid => format!("single::sigmoid({x})"),
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

/// A function of two expressions, as text.
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
