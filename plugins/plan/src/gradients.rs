//! Reverse mode: the operations that compute the gradients of a loss.
//!
//! Operations are visited from the loss backward, and only those that the loss reaches and that depend on a wanted
//! value. The gradients of one value are added in this order. At kinks, a clamp passes the gradient on its limits, a
//! rectifier has its lower slope at 0, and the first of two equal numbers gets the gradient.

use crate::graph::{Graph, Shape, Step, Value};
use crate::operations::{Function, Operation, Pair, RowFunction};

impl Graph {
    /// Gradients of `loss` `[1, 1]`, one per wanted value (a parameter, an input or a computed value), in their order.
    ///
    /// # Panics
    /// If the loss is no single number or does not depend on a wanted value, if a parameter from which the loss was
    /// computed has been updated since, or if the loss depends on a wanted value through `Trigamma`, the slope of a
    /// log-gamma draw, or the slope of a Dirichlet density or entropy.
    #[must_use]
    pub fn gradients(&mut self, loss: Value, wanted: &[Value]) -> Vec<Value> {
        assert_eq!(self.shape(loss), [1, 1], "the gradient of {}", self.shown(loss));
        let depends = self.dependents(loss, wanted);
        let mut found: Vec<Option<Value>> = vec![None; loss.0 + 1];
        found[loss.0] = Some(self.constant([1, 1], &[1.0]));
        for at in (0..=loss.0).rev() {
            let (true, Some(gradient)) = (depends[at], found[at]) else {
                continue;
            };
            let value = Value(at);
            if !self.nodes[at].operands.iter().any(|operand| depends[operand.0]) {
                continue;
            }
            self.check_freshness(value);
            for (operand, part) in self.backward(value, gradient, &depends) {
                let sum = found[operand.0].map_or(part, |sum| self.add(sum, part));
                found[operand.0] = Some(sum);
            }
        }
        let of = |value: &Value| found.get(value.0).copied().flatten();
        let missing =
            |value: &Value| format!("{} does not depend on {}", self.shown(loss), self.shown(*value));
        wanted
            .iter()
            .map(|value| of(value).unwrap_or_else(|| panic!("{}", missing(value))))
            .collect()
    }

    /// Whether each value up to the loss depends on a wanted one.
    fn dependents(&self, loss: Value, wanted: &[Value]) -> Vec<bool> {
        let mut depends = vec![false; loss.0 + 1];
        for at in 0..=loss.0 {
            let node = &self.nodes[at];
            let passes = !matches!(
                node.operation,
                Operation::Map(Function::Stop)
                    | Operation::LargestOfColumns
                    | Operation::PlaceOfLargest
                    | Operation::Ranked { .. }
                    | Operation::ClipScale { .. }
            );
            let passes_from = |operand: usize| match &node.operation {
                Operation::Extension(extension) => extension.0.passes(operand),
                _ => passes,
            };
            let mut operands = node.operands.iter().enumerate();
            let of_operands = operands.any(|(at, operand)| depends[operand.0] && passes_from(at));
            depends[at] = wanted.contains(&Value(at)) || of_operands;
        }
        depends
    }

    /// Panics if an operand of a computed value has been updated after the value was computed.
    fn check_freshness(&self, value: Value) {
        let Some(list) = self.nodes[value.0].routine.map(|routine| &self.routines[routine]) else {
            return;
        };
        let is_before = |step: &&Step| !matches!(step, Step::Compute(other) if *other == value);
        for step in list.steps.iter().rev().take_while(is_before) {
            if let Step::Update(update) = step {
                assert!(
                    !self.nodes[value.0].operands.contains(&update.target()),
                    "the gradient through {}: {} has been updated since",
                    self.shown(value),
                    self.shown(update.target())
                );
            }
        }
    }

    /// Gradients of the operands that depend on a wanted value.
    fn backward(&mut self, value: Value, gradient: Value, depends: &[bool]) -> Vec<(Value, Value)> {
        let node = &self.nodes[value.0];
        let (operation, operands) = (node.operation.clone(), node.operands.clone());
        let is_needed = |at: usize| operands.get(at).is_some_and(|operand| depends[operand.0]);
        let (x, shape) = (operands[0], self.shape(operands[0]));
        match operation {
            Operation::Dense(activation) => {
                let gradient = match activation.function() {
                    None => gradient,
                    Some(function) => self.through_activation(function, value, gradient),
                };
                let mut parts = Vec::new();
                if is_needed(2) {
                    parts.push((operands[2], self.sum_rows(gradient)));
                }
                parts.extend(self.through_product([false; 2], [x, operands[1]], gradient, depends));
                parts
            }
            Operation::Product { transposed } => {
                self.through_product(transposed, [x, operands[1]], gradient, depends)
            }
            Operation::Map(function) => vec![(x, self.through_function(function, x, value, gradient))],
            Operation::Combine(pair) => (0..2)
                .filter(|at| is_needed(*at))
                .map(|at| {
                    let part = self.through_pair(pair, [x, operands[1]], value, gradient, at);
                    (operands[at], self.reduced(part, self.shape(operands[at])))
                })
                .collect(),
            Operation::SumRows | Operation::SumColumns | Operation::Sum => {
                vec![(
                    x,
                    self.compute(Operation::Map(Function::Repeat), vec![gradient], shape),
                )]
            }
            Operation::LogGamma { .. } => {
                let slope = self.compute(Operation::LogGammaSlope, vec![x, value], shape);
                vec![(x, self.mul(gradient, slope))]
            }
            Operation::Rows(function) => self.through_rows(function, &operands, gradient, depends),
            Operation::Extension(extension) => {
                self.through_extension(&extension, &operands, [value, gradient], depends)
            }
            Operation::LogGammaSlope => panic!("no gradient passes through {}", self.shown(value)),
            _ => self.through_move(&operation, &operands, gradient, depends),
        }
    }

    /// Gradients of the operands of an operation that moves entries; none for all others.
    fn through_move(
        &mut self,
        operation: &Operation,
        operands: &[Value],
        gradient: Value,
        depends: &[bool],
    ) -> Vec<(Value, Value)> {
        let (x, shape) = (operands[0], self.shape(operands[0]));
        match *operation {
            Operation::Join => self.through_join(operands, gradient, depends),
            Operation::Columns { first } => {
                vec![(x, self.compute(Operation::Place { first }, vec![gradient], shape))]
            }
            Operation::Place { first } => vec![(x, self.columns(gradient, first..first + shape[1]))],
            Operation::Gather if depends[x.0] => {
                vec![(
                    x,
                    self.compute(Operation::Scatter, vec![gradient, operands[1]], shape),
                )]
            }
            Operation::Scatter if depends[x.0] => vec![(x, self.gather(gradient, operands[1]))],
            Operation::Reshape => vec![(x, self.reshape(gradient, shape))],
            Operation::RepeatRows { times } => vec![(x, self.sum_groups(gradient, times))],
            Operation::SumGroups { size } => vec![(x, self.repeat_rows(gradient, size))],
            // Leaves have no operands, and no gradient passes through the others.
            _ => Vec::new(),
        }
    }

    fn through_product(
        &mut self,
        [turn_a, turn_b]: [bool; 2],
        [a, b]: [Value; 2],
        gradient: Value,
        depends: &[bool],
    ) -> Vec<(Value, Value)> {
        let mut parts = Vec::new();
        // The gradient of a weight comes first: it is the last reader of a layer's input, which the gradient of the
        // input then replaces.
        if depends[b.0] {
            let part = if turn_b {
                self.product(gradient, a, [true, turn_a])
            } else {
                self.product(a, gradient, [!turn_a, false])
            };
            parts.push((b, part));
        }
        if depends[a.0] {
            let part = if turn_a {
                self.product(b, gradient, [turn_b, true])
            } else {
                self.product(gradient, b, [false, !turn_b])
            };
            parts.push((a, part));
        }
        parts
    }

    fn through_join(&mut self, parts: &[Value], gradient: Value, depends: &[bool]) -> Vec<(Value, Value)> {
        let mut first = 0;
        let mut found = Vec::new();
        for part in parts {
            let end = first + self.shape(*part)[1];
            if depends[part.0] {
                found.push((*part, self.columns(gradient, first..end)));
            }
            first = end;
        }
        found
    }

    fn through_rows(
        &mut self,
        function: RowFunction,
        operands: &[Value],
        gradient: Value,
        depends: &[bool],
    ) -> Vec<(Value, Value)> {
        let (alpha, shape) = (operands[0], self.shape(operands[0]));
        let slope = match function {
            RowFunction::DirichletDensity => RowFunction::DirichletScore,
            RowFunction::DirichletEntropy => RowFunction::DirichletEntropySlope,
            _ => panic!("no gradient passes through {function:?}"),
        };
        let mut parts = Vec::new();
        if depends[alpha.0] {
            let slope = self.compute(Operation::Rows(slope), operands.to_vec(), shape);
            parts.push((alpha, self.mul(gradient, slope)));
        }
        if let Some(log_point) = operands.get(1).filter(|value| depends[value.0]) {
            let slope = self.shift(alpha, -1.0);
            parts.push((*log_point, self.mul(gradient, slope)));
        }
        parts
    }

    /// Gradient before an activation, from its output `y`.
    fn through_activation(&mut self, function: Function, y: Value, gradient: Value) -> Value {
        let slope = match function {
            Function::Rectify(below) => Function::RectifierSlope(below),
            _ => Function::OneLessSquare,
        };
        let slope = self.map(slope, y);
        self.mul(gradient, slope)
    }

    /// Gradient with respect to the argument `x` of a function with the result `y`.
    fn through_function(&mut self, function: Function, x: Value, y: Value, gradient: Value) -> Value {
        let slope = match function {
            Function::Repeat => return self.reduced(gradient, self.shape(x)),
            Function::Negate => return self.neg(gradient),
            Function::Scale(factor) => return self.scale(gradient, factor),
            Function::Shift(_) => return gradient,
            Function::Ln => return self.div(gradient, x),
            Function::Ln1p => {
                let denominator = self.shift(x, 1.0);
                return self.div(gradient, denominator);
            }
            Function::Sqrt => {
                let half = self.scale(gradient, 0.5);
                return self.div(half, y);
            }
            Function::Rectify(below) => self.map(Function::RectifierSlope(below), x),
            Function::Tanh => self.map(Function::OneLessSquare, y),
            Function::OneLessSquare => self.scale(x, -2.0),
            Function::Exp => y,
            Function::Softplus => self.sigmoid(x),
            Function::Sigmoid => {
                // y (1 - y)
                let square = self.square(y);
                self.sub(y, square)
            }
            Function::Square => self.scale(x, 2.0),
            Function::Absolute => self.map(Function::Sign, x),
            Function::Clamp(low, high) => self.map(Function::Within(low, high), x),
            Function::LnGamma => self.digamma(x),
            Function::Digamma => self.map(Function::Trigamma, x),
            Function::RectifierSlope(_) | Function::Within(..) | Function::Sign => self.scale(x, 0.0),
            Function::Trigamma | Function::Stop => panic!("no gradient passes through {}", self.shown(y)),
        };
        self.mul(gradient, slope)
    }

    /// Gradient with respect to operand `at` of two with the result `y`, before the sum over repeated entries.
    fn through_pair(
        &mut self,
        pair: Pair,
        [a, b]: [Value; 2],
        y: Value,
        gradient: Value,
        at: usize,
    ) -> Value {
        let mask = match (pair, at) {
            (Pair::Add, _) | (Pair::Subtract, 0) => return gradient,
            (Pair::Subtract, _) => return self.neg(gradient),
            (Pair::Multiply, 0) => return self.mul(gradient, b),
            (Pair::Multiply, _) => return self.mul(gradient, a),
            (Pair::Divide, 0) => return self.div(gradient, b),
            (Pair::Divide, _) => {
                // -g (a / b) / b
                let part = self.mul(gradient, y);
                let part = self.div(part, b);
                return self.neg(part);
            }
            (Pair::Smaller, 0) => self.combine(Pair::AtMost, a, b),
            (Pair::Smaller, _) => self.combine(Pair::Exceeds, a, b),
            (Pair::Larger, 0) => self.combine(Pair::AtMost, b, a),
            (Pair::Larger, _) => self.combine(Pair::Exceeds, b, a),
            (Pair::Exceeds | Pair::AtMost, _) => return self.scale(gradient, 0.0),
        };
        self.mul(gradient, mask)
    }

    /// Sum over the rows and columns over which an operand of the given shape was repeated.
    fn reduced(&mut self, gradient: Value, shape: Shape) -> Value {
        let [rows, columns] = self.shape(gradient);
        match [shape[0] < rows, shape[1] < columns] {
            [false, false] => gradient,
            [true, false] => self.sum_rows(gradient),
            [false, true] => self.sum_columns(gradient),
            [true, true] => self.sum(gradient),
        }
    }
}
