//! The methods of [`Graph`] that add operations. Each panics if shapes do not fit, with the operands' names and shapes,
//! and if an operand belongs to another routine.

use crate::graph::{Graph, Shape, Value};
use crate::operations::{Activation, Function, Operation, Pair, RowFunction, common_shape};

macro_rules! functions {
    ($($(#[$text:meta])* $name:ident($($constant:ident),*) => $function:expr;)*) => {
        impl Graph {
            $($(#[$text])*
            #[must_use]
            pub fn $name(&mut self, x: Value $(, $constant: f64)*) -> Value {
                self.map($function, x)
            })*
        }
    };
}

macro_rules! pairs {
    ($($(#[$text:meta])* $name:ident => $pair:expr;)*) => {
        impl Graph {
            $($(#[$text])*
            #[must_use]
            pub fn $name(&mut self, a: Value, b: Value) -> Value {
                self.combine($pair, a, b)
            })*
        }
    };
}

functions! {
    /// `-x`.
    neg() => Function::Negate;
    /// `max(x, 0)`.
    relu() => Function::Rectify(0.0);
    /// `x` above zero, the given multiple of it below.
    leaky_relu(slope) => Function::Rectify(slope);
    /// Hyperbolic tangent.
    tanh() => Function::Tanh;
    /// `e^x`.
    exp() => Function::Exp;
    /// Natural logarithm.
    ln() => Function::Ln;
    /// `ln(1 + x)`.
    ln_1p() => Function::Ln1p;
    /// `ln(1 + e^x)`.
    softplus() => Function::Softplus;
    /// `1 / (1 + e^-x)`.
    sigmoid() => Function::Sigmoid;
    /// `x^2`.
    square() => Function::Square;
    /// `|x|`; its gradient is 0 at 0.
    abs() => Function::Absolute;
    /// Square root.
    sqrt() => Function::Sqrt;
    /// `factor x`.
    scale(factor) => Function::Scale(factor);
    /// `x + summand`.
    shift(summand) => Function::Shift(summand);
    /// `x` within two limits, otherwise the nearer limit; its gradient passes within the limits and on them.
    clamp(low, high) => Function::Clamp(low, high);
    /// `ln Gamma(x)` for `x > 0`.
    ln_gamma() => Function::LnGamma;
    /// Derivative of `ln Gamma`, for `x > 0`.
    digamma() => Function::Digamma;
    /// `x`, through which no gradient passes.
    stop_gradient() => Function::Stop;
}

pairs! {
    /// `a + b`.
    add => Pair::Add;
    /// `a - b`.
    sub => Pair::Subtract;
    /// `a b`, entry by entry.
    mul => Pair::Multiply;
    /// `a / b`.
    div => Pair::Divide;
    /// The smaller number; its gradient passes to `a` if both are equal.
    min => Pair::Smaller;
    /// The larger number; its gradient passes to `a` if both are equal.
    max => Pair::Larger;
}

impl Graph {
    pub(crate) fn map(&mut self, function: Function, x: Value) -> Value {
        let shape = self.shape(x);
        self.compute(Operation::Map(function), vec![x], shape)
    }

    pub(crate) fn combine(&mut self, pair: Pair, a: Value, b: Value) -> Value {
        let shape = common_shape(self.shape(a), self.shape(b));
        let shape = shape.unwrap_or_else(|| panic!("{pair:?} of {} and {}", self.shown(a), self.shown(b)));
        self.compute(Operation::Combine(pair), vec![a, b], shape)
    }

    /// Dense layer `f(x weight + bias)` of `x` `[rows, inputs]`, `weight` `[inputs, outputs]` and `bias`
    /// `[1, outputs]`.
    #[must_use]
    pub fn dense(&mut self, x: Value, weight: Value, bias: Value, activation: Activation) -> Value {
        let ([rows, inputs], [height, outputs]) = (self.shape(x), self.shape(weight));
        assert!(
            inputs == height && self.shape(bias) == [1, outputs],
            "Dense of {} with weight {} and bias {}",
            self.shown(x),
            self.shown(weight),
            self.shown(bias)
        );
        self.compute(
            Operation::Dense(activation),
            vec![x, weight, bias],
            [rows, outputs],
        )
    }

    /// Product of two factors, each of which may be transposed first.
    #[must_use]
    pub fn product(&mut self, a: Value, b: Value, transposed: [bool; 2]) -> Value {
        let turned = |[rows, columns]: Shape, turn| if turn { [columns, rows] } else { [rows, columns] };
        let [rows, inner] = turned(self.shape(a), transposed[0]);
        let [height, columns] = turned(self.shape(b), transposed[1]);
        assert_eq!(
            inner,
            height,
            "Product of {} and {}, transposed {transposed:?}",
            self.shown(a),
            self.shown(b)
        );
        self.compute(Operation::Product { transposed }, vec![a, b], [rows, columns])
    }

    /// Sum of each column over the rows, `[1, columns]`.
    #[must_use]
    pub fn sum_rows(&mut self, x: Value) -> Value {
        let shape = [1, self.shape(x)[1]];
        self.compute(Operation::SumRows, vec![x], shape)
    }

    /// Sum of each row over the columns, `[rows, 1]`.
    #[must_use]
    pub fn sum_columns(&mut self, x: Value) -> Value {
        let shape = [self.shape(x)[0], 1];
        self.compute(Operation::SumColumns, vec![x], shape)
    }

    /// Sum of all entries, `[1, 1]`.
    #[must_use]
    pub fn sum(&mut self, x: Value) -> Value {
        self.compute(Operation::Sum, vec![x], [1, 1])
    }

    /// Mean of all entries: their sum times the rounded inverse of their number.
    #[must_use]
    pub fn mean(&mut self, x: Value) -> Value {
        let [rows, columns] = self.shape(x);
        let sum = self.sum(x);
        self.scale(sum, 1.0 / (rows * columns) as f64)
    }

    /// Mean of each column over the rows, `[1, columns]`, computed like [`Graph::mean`].
    #[must_use]
    pub fn mean_rows(&mut self, x: Value) -> Value {
        let (sum, n) = (self.sum_rows(x), self.shape(x)[0]);
        self.scale(sum, 1.0 / n as f64)
    }

    /// Mean of each row over the columns, `[rows, 1]`, computed like [`Graph::mean`].
    #[must_use]
    pub fn mean_columns(&mut self, x: Value) -> Value {
        let (sum, n) = (self.sum_columns(x), self.shape(x)[1]);
        self.scale(sum, 1.0 / n as f64)
    }

    /// Matrices of equal rows side by side.
    #[must_use]
    pub fn join(&mut self, parts: &[Value]) -> Value {
        let rows = parts.first().map_or(0, |part| self.shape(*part)[0]);
        for part in parts {
            assert_eq!(
                self.shape(*part)[0],
                rows,
                "Join of {} with {rows} rows",
                self.shown(*part)
            );
        }
        let columns = parts.iter().map(|part| self.shape(*part)[1]).sum();
        self.compute(Operation::Join, parts.to_vec(), [rows, columns])
    }

    /// Columns `range` of a matrix.
    #[must_use]
    pub fn columns(&mut self, x: Value, range: std::ops::Range<usize>) -> Value {
        let [rows, columns] = self.shape(x);
        assert!(
            range.start < range.end && range.end <= columns,
            "columns {range:?} of {}",
            self.shown(x)
        );
        let first = range.start;
        self.compute(Operation::Columns { first }, vec![x], [rows, range.len()])
    }

    /// Entry of each row of `x` in the column that `index` `[rows, 1]` names, `[rows, 1]`. An index is a whole number
    /// from 0 on; a run panics at any other and at one that is too large.
    #[must_use]
    pub fn gather(&mut self, x: Value, index: Value) -> Value {
        let shape = [self.shape(x)[0], 1];
        assert_eq!(
            self.shape(index),
            shape,
            "Gather of {} by {}",
            self.shown(x),
            self.shown(index)
        );
        self.compute(Operation::Gather, vec![x, index], shape)
    }

    /// Softmax of each row over its columns, with the row's largest entry subtracted first.
    #[must_use]
    pub fn softmax(&mut self, x: Value) -> Value {
        let shifted = self.less_largest(x);
        let powers = self.exp(shifted);
        let sums = self.sum_columns(powers);
        self.div(powers, sums)
    }

    /// Logarithm of the softmax of each row over its columns.
    #[must_use]
    pub fn log_softmax(&mut self, x: Value) -> Value {
        let shifted = self.less_largest(x);
        let powers = self.exp(shifted);
        let sums = self.sum_columns(powers);
        let logarithms = self.ln(sums);
        self.sub(shifted, logarithms)
    }

    /// Largest entry of each row, `[rows, 1]`, through which no gradient passes.
    #[must_use]
    pub fn largest_of_columns(&mut self, x: Value) -> Value {
        let shape = [self.shape(x)[0], 1];
        self.compute(Operation::LargestOfColumns, vec![x], shape)
    }

    /// Column of the largest entry of each row, the first one of equals, `[rows, 1]`, through which no gradient passes.
    /// A NaN is never larger than a number, and no number is larger than it.
    #[must_use]
    pub fn place_of_largest(&mut self, x: Value) -> Value {
        let shape = [self.shape(x)[0], 1];
        self.compute(Operation::PlaceOfLargest, vec![x], shape)
    }

    /// Entry of each row with the given rank in ascending order, 0 for the smallest one, `[rows, 1]`, through which no
    /// gradient passes. The order is the total one of IEEE 754.
    #[must_use]
    pub fn ranked(&mut self, x: Value, rank: usize) -> Value {
        let [rows, columns] = self.shape(x);
        assert!(rank < columns, "rank {rank} of {}", self.shown(x));
        self.compute(Operation::Ranked { rank }, vec![x], [rows, 1])
    }

    /// The same entries, row by row, in another shape.
    #[must_use]
    pub fn reshape(&mut self, x: Value, shape: Shape) -> Value {
        let [rows, columns] = self.shape(x);
        assert_eq!(
            rows * columns,
            shape[0] * shape[1],
            "Reshape of {} to {shape:?}",
            self.shown(x)
        );
        self.compute(Operation::Reshape, vec![x], shape)
    }

    /// Each row `times` times, one after the other, `[times rows, columns]`.
    #[must_use]
    pub fn repeat_rows(&mut self, x: Value, times: usize) -> Value {
        let [rows, columns] = self.shape(x);
        self.compute(Operation::RepeatRows { times }, vec![x], [times * rows, columns])
    }

    /// Sums of each `size` consecutive rows, `[rows / size, columns]`.
    #[must_use]
    pub fn sum_groups(&mut self, x: Value, size: usize) -> Value {
        let [rows, columns] = self.shape(x);
        assert!(
            size > 0 && rows.is_multiple_of(size),
            "groups of {size} rows of {}",
            self.shown(x)
        );
        self.compute(Operation::SumGroups { size }, vec![x], [rows / size, columns])
    }

    /// Standard normal numbers. Entry `i` depends only on the seed of the run, on the place of the draw among those of
    /// its routine, and on `i`.
    #[must_use]
    pub fn normal(&mut self, shape: Shape) -> Value {
        let index = self.next_draw();
        self.compute(Operation::Normal { index }, Vec::new(), shape)
    }

    /// Uniform numbers strictly between 0 and 1, drawn like [`Graph::normal`].
    #[must_use]
    pub fn uniform(&mut self, shape: Shape) -> Value {
        let index = self.next_draw();
        self.compute(Operation::Uniform { index }, Vec::new(), shape)
    }

    /// `ln x` of `x ~ Gamma(shape, 1)` for each shape, drawn like [`Graph::normal`]. Its gradient with respect to the
    /// shape is that of the draw at a fixed probability (Figurnov et al. 2018).
    #[must_use]
    pub fn log_gamma_draw(&mut self, shapes: Value) -> Value {
        let index = self.next_draw();
        let shape = self.shape(shapes);
        self.compute(Operation::LogGamma { index }, vec![shapes], shape)
    }

    /// Log density `[rows, 1]` of points with the logarithms `log_points` under Dirichlet distributions.
    #[must_use]
    pub fn dirichlet_density(&mut self, concentrations: Value, log_points: Value) -> Value {
        let shape = self.shape(concentrations);
        assert_eq!(
            shape,
            self.shape(log_points),
            "Dirichlet density of {} at {}",
            self.shown(concentrations),
            self.shown(log_points)
        );
        let function = Operation::Rows(RowFunction::DirichletDensity);
        self.compute(function, vec![concentrations, log_points], [shape[0], 1])
    }

    /// Differential entropy `[rows, 1]` of Dirichlet distributions.
    #[must_use]
    pub fn dirichlet_entropy(&mut self, concentrations: Value) -> Value {
        let rows = self.shape(concentrations)[0];
        let function = Operation::Rows(RowFunction::DirichletEntropy);
        self.compute(function, vec![concentrations], [rows, 1])
    }

    /// Each row minus its largest entry. A shift of a row changes no softmax, so no gradient passes through the largest
    /// entry.
    fn less_largest(&mut self, x: Value) -> Value {
        let largest = self.largest_of_columns(x);
        self.sub(x, largest)
    }
}
