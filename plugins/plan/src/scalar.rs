//! The arithmetic that an executor needs of a number: `f32` with the bits that [`arithmetic`] defines, and `f64` for
//! tests of gradients, with plain loops.

use crate::extension::Extension;
use crate::operations::{Function, Pair};
use arithmetic::epilogue::Epilogue;
use arithmetic::products::{self, Matrix};
use arithmetic::slices::{self, widest};
use arithmetic::steps::{self, EPSILON, Rates};
use arithmetic::tiles::Multiplier;
use arithmetic::{double, gamma, power};
use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// A factor of a product: entries row by row, and whether it is transposed.
#[derive(Debug, Clone, Copy)]
pub struct Factor<'a, T> {
    /// Entries, `shape[0]` rows of `shape[1]`.
    pub entries: &'a [T],
    /// Shape as it lies in memory.
    pub shape: [usize; 2],
    /// Whether rows and columns are exchanged.
    pub is_transposed: bool,
}

/// A number of an executor.
pub trait Scalar:
    Copy
    + Debug
    + Default
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + 'static
{
    /// Memory of products.
    type Multiplier: Debug + Clone + Default;

    /// The nearest number.
    fn of(number: f64) -> Self;

    /// The number in `f64`.
    fn wide(self) -> f64;

    /// Square root, rounded once.
    fn root(self) -> Self;

    /// A transcendental function of each entry; other functions leave the entries unchanged.
    fn elementary(function: Function, entries: &mut [Self]);

    /// Product of two factors, each entry changed by the epilogue.
    fn multiply(
        memory: &mut Self::Multiplier,
        factors: [Factor<Self>; 2],
        product: &mut [Self],
        epilogue: Epilogue<Self>,
    );

    /// Sum of all entries in blocks.
    fn sum(entries: &[Self]) -> Self;

    /// Sum of the squares of all entries in blocks, in `f64`.
    fn sum_of_squares(entries: &[Self]) -> f64;

    /// Step `t = 1, 2, ...` of Adam with a learning rate and the decay rates of the moments.
    fn descend(
        t: u64,
        learning_rate: f64,
        betas: [f64; 2],
        x: &mut [Self],
        gradient: &[Self],
        moments: [&mut [Self]; 2],
    );

    /// Moves each entry: `target <- target + tau (source - target)`.
    fn follow(target: &mut [Self], source: &[Self], tau: Self);

    /// Computes an extension, with a memory for intermediate numbers.
    fn extend(extension: &dyn Extension, operands: &[&[Self]], result: &mut [Self], memory: &mut Vec<f32>);
}

impl<T: Copy> Factor<'_, T> {
    /// Shape of the factor in the product.
    fn turned(&self) -> [usize; 2] {
        let [rows, columns] = self.shape;
        if self.is_transposed {
            [columns, rows]
        } else {
            [rows, columns]
        }
    }

    fn at(&self, row: usize, column: usize) -> T {
        let width = self.shape[1];
        self.entries[if self.is_transposed {
            column * width + row
        } else {
            row * width + column
        }]
    }
}

fn matrix(factor: Factor<f32>) -> Matrix {
    let matrix = Matrix::new(factor.entries, factor.shape[0], factor.shape[1]);
    if factor.is_transposed {
        matrix.transposed()
    } else {
        matrix
    }
}

#[allow(clippy::cast_possible_truncation, reason = "the nearest f32 is meant")]
impl Scalar for f32 {
    type Multiplier = Multiplier;

    #[inline(always)]
    fn of(number: f64) -> Self {
        number as f32
    }

    #[inline(always)]
    fn wide(self) -> f64 {
        f64::from(self)
    }

    #[inline(always)]
    fn root(self) -> Self {
        self.sqrt()
    }

    fn elementary(function: Function, entries: &mut [Self]) {
        let in_double = |entries: &mut [Self], function: fn(f64) -> f64| {
            entries
                .iter_mut()
                .for_each(|x| *x = function(f64::from(*x)) as f32);
        };
        match function {
            Function::Tanh => slices::tanh(entries),
            Function::Exp => slices::exp(entries),
            Function::Ln => slices::ln(entries),
            Function::Ln1p => slices::ln_1p(entries),
            Function::Softplus => slices::softplus(entries),
            Function::Sigmoid => slices::sigmoid(entries),
            Function::LnGamma => in_double(entries, gamma::ln_gamma),
            Function::Digamma => in_double(entries, gamma::digamma),
            Function::Trigamma => in_double(entries, gamma::trigamma),
            _ => {}
        }
    }

    fn multiply(
        memory: &mut Multiplier,
        factors: [Factor<Self>; 2],
        product: &mut [Self],
        epilogue: Epilogue,
    ) {
        let [a, b] = factors.map(matrix);
        memory.product(a, b, product, epilogue);
    }

    fn sum(entries: &[Self]) -> Self {
        products::sum(entries)
    }

    fn sum_of_squares(entries: &[Self]) -> f64 {
        products::sum_of_squares(entries)
    }

    fn descend(
        t: u64,
        rate: f64,
        betas: [f64; 2],
        x: &mut [f32],
        gradient: &[f32],
        moments: [&mut [f32]; 2],
    ) {
        let [first, second] = moments;
        Rates::at(t, rate, betas).descend(x, gradient, first, second);
    }

    fn follow(target: &mut [Self], source: &[Self], tau: Self) {
        steps::follow(target, source, tau);
    }

    fn extend(extension: &dyn Extension, operands: &[&[f32]], result: &mut [f32], memory: &mut Vec<f32>) {
        extension.compute(operands, result, memory);
    }
}

impl Scalar for f64 {
    type Multiplier = ();

    fn of(number: f64) -> Self {
        number
    }

    fn wide(self) -> f64 {
        self
    }

    fn root(self) -> Self {
        self.sqrt()
    }

    fn elementary(function: Function, entries: &mut [Self]) {
        let function: fn(f64) -> f64 = match function {
            Function::Tanh => double::tanh,
            Function::Exp => double::exp,
            Function::Ln => double::ln,
            Function::Ln1p => double::ln_1p,
            Function::Softplus => |x| x.max(0.0) + double::ln_1p(double::exp(-x.abs())),
            Function::Sigmoid => |x| 1.0 / (1.0 + double::exp(-x)),
            Function::LnGamma => gamma::ln_gamma,
            Function::Digamma => gamma::digamma,
            Function::Trigamma => gamma::trigamma,
            _ => return,
        };
        entries.iter_mut().for_each(|x| *x = function(*x));
    }

    fn multiply((): &mut (), [a, b]: [Factor<Self>; 2], product: &mut [Self], epilogue: Epilogue<Self>) {
        let [inner, columns] = b.turned();
        for (row, entries) in product.chunks_exact_mut(columns).enumerate() {
            for (column, entry) in entries.iter_mut().enumerate() {
                let sum = [(0..inner).map(|k| a.at(row, k) * b.at(k, column)).sum()];
                let place = row * columns + column;
                let entry = std::slice::from_mut(entry);
                epilogue.write_row(&sum, entry, place..place + 1, column..column + 1);
            }
        }
    }

    fn sum(entries: &[Self]) -> Self {
        products::sum_f64(entries)
    }

    fn sum_of_squares(entries: &[Self]) -> f64 {
        entries.iter().map(|x| x * x).sum()
    }

    fn descend(
        t: u64,
        rate: f64,
        betas: [f64; 2],
        x: &mut [f64],
        gradient: &[f64],
        moments: [&mut [f64]; 2],
    ) {
        let [bias_1, bias_2] = betas.map(|beta| 1.0 - power::pow(beta, t as f64));
        let [first, second] = moments;
        for (((x, g), m), v) in x.iter_mut().zip(gradient).zip(first).zip(second) {
            *m = betas[0] * *m + (1.0 - betas[0]) * g;
            *v = betas[1] * *v + (1.0 - betas[1]) * g * g;
            *x -= rate / bias_1 * *m / ((*v / bias_2).sqrt() + EPSILON);
        }
    }

    fn follow(target: &mut [Self], source: &[Self], tau: Self) {
        for (t, s) in target.iter_mut().zip(source) {
            *t += tau * (s - *t);
        }
    }

    #[allow(clippy::cast_possible_truncation, reason = "an extension computes in f32")]
    fn extend(extension: &dyn Extension, operands: &[&[f64]], result: &mut [f64], memory: &mut Vec<f32>) {
        let narrow = |entries: &&[f64]| entries.iter().map(|x| *x as f32).collect::<Vec<f32>>();
        let operands: Vec<Vec<f32>> = operands.iter().map(narrow).collect();
        let operands: Vec<&[f32]> = operands.iter().map(Vec::as_slice).collect();
        let mut found = vec![0.0; result.len()];
        extension.compute(&operands, &mut found, memory);
        result
            .iter_mut()
            .zip(found)
            .for_each(|(to, from)| *to = f64::from(from));
    }
}

/// Replaces each entry `x` by an expression of it. The expression is no closure, because a closure might not be inlined
/// into the wide vectors. Captured values are moved, so that no store of an entry can change them and the loop is
/// vectorised.
macro_rules! each {
    ($entries:expr, |$x:ident| $value:expr) => {
        widest(
            #[inline(always)]
            move || {
                for entry in $entries.iter_mut() {
                    let $x = *entry;
                    *entry = $value;
                }
            },
        )
    };
}

/// Replaces each entry `a` of the first slice by an expression of it and the entry `b` of the second one.
macro_rules! both {
    ($first:expr, $second:expr, |$a:ident, $b:ident| $value:expr) => {
        widest(
            #[inline(always)]
            move || {
                for (entry, other) in $first.iter_mut().zip($second) {
                    let ($a, $b) = (*entry, *other);
                    *entry = $value;
                }
            },
        )
    };
}

/// Replaces each entry by a function of it.
pub(crate) fn map<T: Scalar>(function: Function, entries: &mut [T]) {
    let (zero, one) = (T::of(0.0), T::of(1.0));
    match function {
        Function::Repeat | Function::Stop => {}
        Function::Negate => each!(entries, |x| -x),
        Function::Rectify(below) => {
            let below = T::of(below);
            each!(entries, |x| if x <= zero { below * x } else { x });
        }
        Function::RectifierSlope(below) => {
            let below = T::of(below);
            each!(entries, |x| if x > zero { one } else { below });
        }
        Function::OneLessSquare => each!(entries, |x| one - x * x),
        Function::Absolute => each!(entries, |x| if x <= zero { zero - x } else { x }),
        Function::Sign => each!(entries, |x| if x > zero {
            one
        } else if x < zero {
            -one
        } else {
            x
        }),
        Function::Square => each!(entries, |x| x * x),
        Function::Sqrt => each!(entries, |x| x.root()),
        Function::Scale(factor) => {
            let factor = T::of(factor);
            each!(entries, |x| factor * x);
        }
        Function::Shift(summand) => {
            let summand = T::of(summand);
            each!(entries, |x| x + summand);
        }
        Function::Clamp(low, high) => {
            let (low, high) = (T::of(low), T::of(high));
            each!(entries, |x| {
                let x = if x < low { low } else { x };
                if x > high { high } else { x }
            });
        }
        Function::Within(low, high) => {
            let (low, high) = (T::of(low), T::of(high));
            each!(entries, |x| if (low <= x) & (x <= high) { one } else { zero });
        }
        elementary => T::elementary(elementary, entries),
    }
}

/// Replaces each entry of `a` by a function of it and the entry of `b`.
#[allow(clippy::eq_op, reason = "a NaN differs from itself")]
pub(crate) fn combine<T: Scalar>(pair: Pair, a: &mut [T], b: &[T]) {
    let (zero, one) = (T::of(0.0), T::of(1.0));
    match pair {
        Pair::Add => both!(a, b, |a, b| a + b),
        Pair::Subtract => both!(a, b, |a, b| a - b),
        Pair::Multiply => both!(a, b, |a, b| a * b),
        Pair::Divide => both!(a, b, |a, b| a / b),
        Pair::Smaller => both!(a, b, |a, b| if (b < a) | (b != b) { b } else { a }),
        Pair::Larger => both!(a, b, |a, b| if (b > a) | (b != b) { b } else { a }),
        Pair::Exceeds => both!(a, b, |a, b| if a > b { one } else { zero }),
        Pair::AtMost => both!(a, b, |a, b| if a > b { zero } else { one }),
    }
}
