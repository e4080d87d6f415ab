//! Kinds of operations, and the result of each.
//!
//! Functions of one and of two numbers act entry by entry; an operand with one row, one column or both is repeated over
//! the others. The result for a NaN is a NaN, except for slopes and comparisons.

use crate::extension::Shared;
use crate::graph::Shape;

/// Activation after a dense layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Activation {
    /// `x`.
    #[default]
    Identity,
    /// `max(x, 0)`.
    Relu,
    /// `x` above zero, `0.01 x` below (Maas et al. 2013).
    LeakyRelu,
    /// Hyperbolic tangent.
    Tanh,
}

impl Activation {
    /// The activation as a function of one number.
    pub(crate) fn function(self) -> Option<Function> {
        match self {
            Activation::Identity => None,
            Activation::Relu => Some(Function::Rectify(0.0)),
            Activation::LeakyRelu => Some(Function::Rectify(LEAKY_SLOPE)),
            Activation::Tanh => Some(Function::Tanh),
        }
    }
}

/// Slope of the leaky rectifier below zero.
pub const LEAKY_SLOPE: f64 = 0.01;

/// A function of one number `x`. Constants are rounded to the executor's precision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Function {
    /// `x` repeated over rows or columns.
    Repeat,
    /// `x`, through which no gradient passes.
    Stop,
    /// `-x`.
    Negate,
    /// `x` above zero, the given multiple of it elsewhere.
    Rectify(f64),
    /// 1 for `x > 0`, the given slope elsewhere.
    RectifierSlope(f64),
    /// Hyperbolic tangent.
    Tanh,
    /// `1 - x^2`, with the square rounded first.
    OneLessSquare,
    /// `e^x`.
    Exp,
    /// Natural logarithm.
    Ln,
    /// `ln(1 + x)`.
    Ln1p,
    /// `ln(1 + e^x)`.
    Softplus,
    /// `1 / (1 + e^-x)`.
    Sigmoid,
    /// `|x|`.
    Absolute,
    /// 1 for `x > 0`, -1 for `x < 0`, otherwise 0.
    Sign,
    /// `x^2`.
    Square,
    /// Square root.
    Sqrt,
    /// `c x`.
    Scale(f64),
    /// `x + c`.
    Shift(f64),
    /// `x` within the two limits, otherwise the nearer limit.
    Clamp(f64, f64),
    /// 1 within the two limits and on them, otherwise 0.
    Within(f64, f64),
    /// `ln Gamma(x)` for `x > 0`, in `f64` and then rounded.
    LnGamma,
    /// Derivative of `ln Gamma`, for `x > 0`, in `f64` and then rounded.
    Digamma,
    /// Second derivative of `ln Gamma`, for `x > 0`, in `f64` and then rounded.
    Trigamma,
}

/// A function of two numbers `a` and `b`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pair {
    /// `a + b`.
    Add,
    /// `a - b`.
    Subtract,
    /// `a b`.
    Multiply,
    /// `a / b`.
    Divide,
    /// The smaller number; `a` if both are equal, a NaN if one is a NaN.
    Smaller,
    /// The larger number; `a` if both are equal, a NaN if one is a NaN.
    Larger,
    /// 1 for `a > b`, otherwise 0.
    Exceeds,
    /// 0 for `a > b`, otherwise 1.
    AtMost,
}

/// A function of a row of concentrations `alpha` of a Dirichlet distribution with the sum `A`, and for some also of the
/// logarithm `ln a` of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RowFunction {
    /// `ln Gamma(A) - sum ln Gamma(alpha_i) + sum (alpha_i - 1) ln a_i`, one number a row.
    DirichletDensity,
    /// Derivative of the density with respect to each `alpha_i`: `digamma(A) - digamma(alpha_i) + ln a_i`.
    DirichletScore,
    /// Differential entropy, one number a row.
    DirichletEntropy,
    /// Derivative of the entropy with respect to each `alpha_i`: `(A - n) trigamma(A) - (alpha_i - 1)
    /// trigamma(alpha_i)`.
    DirichletEntropySlope,
}

/// An operation with one result.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Operation {
    /// Leaf that a caller writes.
    Input,
    /// Leaf that updates change.
    Parameter,
    /// Leaf that belongs to an optimiser.
    State,
    /// Leaf with fixed entries.
    Constant(Vec<f64>),
    /// `f(x W + b)` of x, W and b: a chain per entry, then one sum, then the activation.
    Dense(Activation),
    /// Product of two factors, each transposed or not: a chain per entry.
    Product { transposed: [bool; 2] },
    /// A function of one number.
    Map(Function),
    /// A function of two numbers.
    Combine(Pair),
    /// Sum of each column over the rows, the chain of a product with a row of ones.
    SumRows,
    /// Sum of each row over the columns, the chain of a product with a column of ones.
    SumColumns,
    /// Sum of all entries in blocks, as defined in `arithmetic::products`.
    Sum,
    /// Largest entry of each row, through which no gradient passes.
    LargestOfColumns,
    /// Column of the largest entry of each row, the first one of equals, through which no gradient passes.
    PlaceOfLargest,
    /// Entry of each row with a rank in ascending order, through which no gradient passes.
    Ranked { rank: usize },
    /// Matrices of equal rows side by side.
    Join,
    /// Columns of the operand from a first one on, as many as the result has.
    Columns { first: usize },
    /// The operand's columns, placed in a matrix of zeros from column `first` on.
    Place { first: usize },
    /// Entry of each row in the column that a second operand `[rows, 1]` names.
    Gather,
    /// Each row's number in the column that a second operand names, and zeros elsewhere.
    Scatter,
    /// The same entries in another shape.
    Reshape,
    /// Each row a number of times, one after the other.
    RepeatRows { times: usize },
    /// Sums of consecutive rows, in their order.
    SumGroups { size: usize },
    /// Standard normal numbers, draw `index` of the routine.
    Normal { index: usize },
    /// Uniform numbers strictly between 0 and 1, draw `index` of the routine.
    Uniform { index: usize },
    /// `ln x` of `x ~ Gamma(shape, 1)` for each shape, draw `index` of the routine, in `f64` and then rounded.
    LogGamma { index: usize },
    /// Derivative of a log-gamma draw with respect to its shape at a fixed probability, computed from the shape and the
    /// draw.
    LogGammaSlope,
    /// A function of the rows of one or two operands, in `f64` and then rounded.
    Rows(RowFunction),
    /// 1, or if the joint norm of all operands exceeds `largest`, the quotient of both.
    ClipScale { largest: f64 },
    /// An operation of another crate.
    Extension(Shared),
}

impl Operation {
    pub(crate) fn is_elementwise(&self) -> bool {
        matches!(self, Operation::Map(_) | Operation::Combine(_))
    }

    /// Number of terms of an entry of a product or a dense layer.
    pub(crate) fn n_terms(&self, first_factor: Shape) -> usize {
        match self {
            Operation::Product {
                transposed: [true, _],
            } => first_factor[0],
            _ => first_factor[1],
        }
    }

    /// Floating-point operations: two per term of a product, one per entry and function or summand, none for moves.
    pub(crate) fn flops(&self, operands: &[Shape], result: Shape) -> u64 {
        let n = |shape: Shape| shape[0] as u64 * shape[1] as u64;
        let all: u64 = operands.iter().map(|shape| n(*shape)).sum();
        match self {
            Operation::Dense(activation) => {
                let per_entry =
                    2 * self.n_terms(operands[0]) as u64 + 1 + u64::from(activation.function().is_some());
                per_entry * n(result)
            }
            Operation::Product { .. } => 2 * self.n_terms(operands[0]) as u64 * n(result),
            Operation::Map(Function::Repeat | Function::Stop) => 0,
            Operation::Map(_) | Operation::Combine(_) => n(result),
            Operation::SumRows | Operation::SumColumns | Operation::Sum | Operation::LargestOfColumns => all,
            Operation::SumGroups { .. } | Operation::PlaceOfLargest | Operation::Ranked { .. } => all,
            Operation::Normal { .. } | Operation::Uniform { .. } => n(result),
            Operation::LogGamma { .. } | Operation::LogGammaSlope | Operation::Rows(_) => all,
            Operation::ClipScale { .. } => 2 * all,
            Operation::Extension(extension) => extension.0.flops(operands, result),
            _ => 0,
        }
    }
}

impl std::fmt::Display for Operation {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Operation::Constant(_) => write!(f, "Constant"),
            Operation::Product { transposed } => {
                let letter = |is_transposed| if is_transposed { 't' } else { 'n' };
                write!(f, "Product {}{}", letter(transposed[0]), letter(transposed[1]))
            }
            Operation::Map(function) => write!(f, "{function:?}"),
            Operation::Combine(pair) => write!(f, "{pair:?}"),
            Operation::Extension(extension) => write!(f, "{}", extension.0.name()),
            other => write!(f, "{other:?}"),
        }
    }
}

/// Shape of two operands combined entry by entry; one with a single row or column is repeated.
pub(crate) fn common_shape(a: Shape, b: Shape) -> Option<Shape> {
    let side = |a: usize, b: usize| (a == b || a == 1 || b == 1).then(|| a.max(b));
    Some([side(a[0], b[0])?, side(a[1], b[1])?])
}
