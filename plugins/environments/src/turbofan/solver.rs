//! Newton's method for the unknowns of a cycle, with exact derivatives.

use super::atmosphere::Air;
use super::cycle::{Engine, FUEL, Health, N, Point, SPEEDS};
use super::flight::FlightPoint;
use super::number::Number;
use nalgebra::{SMatrix, SVector};
use num_dual::{Derivative, DualSVec64};
use serde::{Deserialize, Serialize};

/// The quantity that is held at a point, besides the flight condition.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum HeldQuantity {
    /// Turbine inlet temperature, K.
    TurbineInletTemperature(f64),
    /// Net thrust, N.
    Thrust(f64),
    /// Fuel flow, kg/s.
    FuelFlow(f64),
}

/// A problem for the solver: flight condition, wear and the held quantity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Operation {
    pub air: Air,
    pub health: Health,
    pub held: HeldQuantity,
    /// The relative speeds of the shafts where they are given, as in a transient; `None` for speeds without
    /// acceleration.
    pub speeds: Option<[f64; 2]>,
}

/// Residuals of a search that found no operating point.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ConvergenceFailure {
    /// The largest relative residual at the end of the search.
    pub residual: f64,
    /// All residuals, in the order of [`super::cycle`].
    pub residuals: [f64; N],
    pub iterations: usize,
}

/// Relative residual that counts as zero.
const TOLERANCE: f64 = 1e-9;
const MOST_ITERATIONS: usize = 40;
/// Number of times that a step is halved if it increases the residuals.
const MOST_HALVINGS: usize = 5;
/// Largest change of an unknown in one step: in its own unit, and relative from the fifth on.
const LARGEST_STEP: [f64; N] = [0.05, 0.05, 0.3, 0.4, 0.4, 0.1, 0.1, 0.1, 0.15];
/// Smallest fraction of the way that a search in steps takes at once.
const SMALLEST_PART: f64 = 1.0 / 256.0;

impl Engine {
    /// The point of an operation: from `start`, or if that fails from the design point in steps. `start`
    /// becomes the unknowns of the point.
    ///
    /// # Errors
    /// [`ConvergenceFailure`] where the residuals do not vanish; `start` is then unchanged.
    pub(super) fn solve(
        &self,
        operation: &Operation,
        start: &mut [f64; N],
    ) -> Result<Point<f64>, ConvergenceFailure> {
        let (point, unknowns) = self
            .search(operation, *start)
            .or_else(|failed| self.walk(operation).map_err(|_| failed))?;
        *start = unknowns;
        Ok(point)
    }

    /// The point of an operation whose shafts have given speeds, from a solved point: directly or in steps.
    ///
    /// # Errors
    /// The errors of [`Engine::solve`].
    pub(super) fn solve_from(
        &self,
        from: &Operation,
        operation: &Operation,
        start: &mut [f64; N],
    ) -> Result<Point<f64>, ConvergenceFailure> {
        let (point, unknowns) = self.search(operation, *start).or_else(|failed| {
            let path = |part| from.towards(operation, part);
            self.follow(*start, &path).map_err(|_| failed)
        })?;
        *start = unknowns;
        Ok(point)
    }

    /// Newton's method from one start. A linearisation is kept as long as it reduces the residuals to a tenth,
    /// since it costs twice as much as they do.
    fn search(
        &self,
        operation: &Operation,
        mut unknowns: [f64; N],
    ) -> Result<(Point<f64>, [f64; N]), ConvergenceFailure> {
        let (mut values, jacobian) = self.linearised(&unknowns, operation);
        let mut factors = jacobian.lu();
        for iterations in 1..=MOST_ITERATIONS {
            let step = factors.solve(&-values);
            let Some(step) = step.filter(|step| step.iter().all(|x| x.is_finite())) else {
                return Err(ConvergenceFailure::of(&values, iterations));
            };
            let before = values.norm();
            let mut part = largest_part(&unknowns, &step);
            for halving in 0..=MOST_HALVINGS {
                let there = moved(&unknowns, &step, part);
                let (point, residuals) = self.residuals(&there, operation);
                values = SVector::from(residuals);
                if values.amax() < TOLERANCE {
                    return Ok((point, there));
                }
                // A step may increase the residuals a little on the way around a bend of a map.
                if values.norm() < 1.5 * before || halving == MOST_HALVINGS {
                    unknowns = there;
                    break;
                }
                part /= 2.0;
            }
            if part < 1.0 || values.norm() > 0.1 * before {
                let (anew, jacobian) = self.linearised(&unknowns, operation);
                (values, factors) = (anew, jacobian.lu());
            }
        }
        Err(ConvergenceFailure::of(&values, MOST_ITERATIONS))
    }

    /// From the design point to an operation in steps: first the flight condition and the wear at a constant
    /// ratio of turbine inlet and ambient total temperature, then the held quantity.
    fn walk(&self, operation: &Operation) -> Result<(Point<f64>, [f64; N]), ConvergenceFailure> {
        let design = self.design_operation();
        let ratio = self.design_ratio();
        let (point, unknowns) = self.follow(self.unknowns, &|part| {
            let there = design.towards(operation, part);
            Operation {
                held: HeldQuantity::TurbineInletTemperature(ratio * there.air.total_temperature),
                ..there
            }
        })?;
        let from = operation.held.with(operation.held.like(&point));
        self.follow(unknowns, &|part| Operation {
            held: from.towards(operation.held, part),
            ..*operation
        })
    }

    /// Follows a path of operations, from 0, where `unknowns` solve it nearly, to 1, in steps as long as the
    /// search converges.
    fn follow(
        &self,
        mut unknowns: [f64; N],
        path: &dyn Fn(f64) -> Operation,
    ) -> Result<(Point<f64>, [f64; N]), ConvergenceFailure> {
        let (mut done, mut step) = (0.0, 0.25);
        loop {
            let next = f64::min(done + step, 1.0);
            match self.search(&path(next), unknowns) {
                Ok((point, found)) if next >= 1.0 => return Ok((point, found)),
                Ok((_, found)) => {
                    (unknowns, done) = (found, next);
                    step *= 1.5;
                }
                Err(error) if step < SMALLEST_PART => return Err(error),
                Err(_) => step /= 2.0,
            }
        }
    }

    /// Ratio of turbine inlet and ambient total temperature at the design point.
    pub(super) fn design_ratio(&self) -> f64 {
        self.design.turbine_inlet_temperature_k / self.design_operation().air.total_temperature
    }

    fn design_operation(&self) -> Operation {
        Operation {
            air: Air::at(self.design.altitude_m, self.design.mach, 0.0),
            health: Health::default(),
            held: HeldQuantity::TurbineInletTemperature(self.design.turbine_inlet_temperature_k),
            speeds: None,
        }
    }

    /// The cycle at the unknowns, and the residuals of its balances and of the held quantity.
    fn residuals<T: Number>(&self, unknowns: &[T; N], operation: &Operation) -> (Point<T>, [T; N]) {
        let point = self.at(unknowns, &operation.air, &operation.health);
        let mut residuals = point.residuals;
        if let Some(speeds) = operation.speeds {
            for (place, speed) in SPEEDS.into_iter().zip(speeds) {
                residuals[place] = unknowns[place] - speed;
            }
        }
        residuals[FUEL] = match operation.held {
            HeldQuantity::TurbineInletTemperature(kelvin) => point.burner.temperature / kelvin - 1.0,
            HeldQuantity::Thrust(newton) => (point.thrust - newton) / point.gross_thrust.re(),
            HeldQuantity::FuelFlow(flow) => point.fuel_flow / flow - 1.0,
        };
        (point, residuals)
    }

    /// The residuals and their derivatives by the unknowns.
    pub(super) fn linearised(
        &self,
        unknowns: &[f64; N],
        operation: &Operation,
    ) -> (SVector<f64, N>, SMatrix<f64, N, N>) {
        let mut variables = unknowns.map(DualSVec64::<N>::from);
        for (place, variable) in variables.iter_mut().enumerate() {
            variable.eps = Derivative::derivative_generic(nalgebra::Const::<N>, nalgebra::U1, place);
        }
        let (_, residuals) = self.residuals(&variables, operation);
        let derivatives = residuals.map(|it| it.eps.unwrap_generic(nalgebra::Const::<N>, nalgebra::U1));
        let jacobian = SMatrix::from_fn(|row, column| derivatives[row][column]);
        (SVector::from(residuals.map(|it| it.re)), jacobian)
    }
}

/// Largest fraction of a step that changes no unknown by more than its largest step.
fn largest_part(unknowns: &[f64; N], step: &SVector<f64, N>) -> f64 {
    let largest = |place: usize| match place {
        5.. => LARGEST_STEP[place] * unknowns[place].abs(),
        _ => LARGEST_STEP[place],
    };
    (0..N).fold(1.0, |part: f64, place| {
        part.min(largest(place) / step[place].abs())
    })
}

/// The unknowns after a fraction of a step; turbines stay turbines.
fn moved(unknowns: &[f64; N], step: &SVector<f64, N>, part: f64) -> [f64; N] {
    let mut moved: [f64; N] = std::array::from_fn(|place| unknowns[place] + part * step[place]);
    for ratio in &mut moved[6..8] {
        *ratio = ratio.max(1.02);
    }
    moved
}

impl HeldQuantity {
    /// Names of the quantities that can be held, with units.
    pub(super) const NAMES: [&'static str; 3] = ["turbine_inlet_temperature_k", "thrust_n", "fuel_flow_kg_s"];

    /// The held quantity of this name.
    pub(super) fn named(name: &str, value: f64) -> Self {
        match name {
            "thrust_n" => Self::Thrust(value),
            "fuel_flow_kg_s" => Self::FuelFlow(value),
            _ => Self::TurbineInletTemperature(value),
        }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::TurbineInletTemperature(_) => Self::NAMES[0],
            Self::Thrust(_) => Self::NAMES[1],
            Self::FuelFlow(_) => Self::NAMES[2],
        }
    }

    pub(super) fn value(self) -> f64 {
        match self {
            Self::TurbineInletTemperature(value) | Self::Thrust(value) | Self::FuelFlow(value) => value,
        }
    }

    /// The value of the same quantity at a point.
    fn like(self, point: &Point<f64>) -> f64 {
        match self {
            Self::TurbineInletTemperature(_) => point.burner.temperature,
            Self::Thrust(_) => point.thrust,
            Self::FuelFlow(_) => point.fuel_flow,
        }
    }

    /// The same quantity with another value.
    fn with(self, value: f64) -> Self {
        Self::named(self.name(), value)
    }

    /// Interpolates between this value and `other`; jumps to `other` where that is another quantity.
    fn towards(self, other: Self, part: f64) -> Self {
        if self.name() == other.name() {
            self.with(self.value() + part * (other.value() - self.value()))
        } else {
            other
        }
    }
}

impl Operation {
    /// A steady point of a flight.
    pub(super) fn at(point: &FlightPoint, health: Health) -> Self {
        Self {
            air: point.air(),
            health,
            held: point.held,
            speeds: None,
        }
    }

    /// Interpolates between this operation and `other`, whose speeds it takes.
    fn towards(&self, other: &Self, part: f64) -> Self {
        Self {
            air: self.air.towards(&other.air, part),
            health: self.health.towards(&other.health, part),
            held: self.held.towards(other.held, part),
            speeds: other.speeds,
        }
    }
}

impl ConvergenceFailure {
    /// Names the balances whose residual exceeds a hundredth of the worst.
    pub(super) fn in_words(&self) -> String {
        const PARTS: [&str; N] = [
            "low-pressure shaft",
            "high-pressure shaft",
            "bypass nozzle",
            "low-pressure compressor",
            "high-pressure compressor",
            "core nozzle",
            "high-pressure turbine",
            "low-pressure turbine",
            "what is held",
        ];
        let parts = PARTS.iter().zip(self.residuals);
        let worst = parts.filter(|(_, x)| !x.is_finite() || x.abs() > 0.01 * self.residual);
        worst
            .map(|(part, x)| format!("{part} {x:.1e}"))
            .collect::<Vec<_>>()
            .join(", ")
    }

    fn of(values: &SVector<f64, N>, iterations: usize) -> Self {
        Self {
            residual: values.iter().fold(0.0, |most: f64, x| most.max(x.abs())),
            residuals: (*values).into(),
            iterations,
        }
    }
}
