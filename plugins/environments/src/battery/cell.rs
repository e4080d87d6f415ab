//! One cell of a pack: parameters, wear, state, and the quantities measured at its terminals.

use super::ageing::AgeingRates;
use super::model::{Model, Physics, State};
use super::parameters::CellParameters;

/// Below this voltage a power load draws no further current; every such cell is far past the end of its
/// discharge. Without the limit, a collapsed cell's voltage would change sign and the load would charge it.
pub(super) const LOWEST_SUPPLY_V: f64 = 0.1;

/// A cell that is being discharged.
#[derive(Debug, Clone)]
pub struct Cell {
    model: Model,
    physics: Physics,
    parameters: CellParameters,
    state: State,
    voltage_v: f64,
    current_a: f64,
}

impl Cell {
    /// A full, rested cell.
    #[must_use]
    pub fn new(parameters: CellParameters, physics: Physics) -> Self {
        let (model, state) = (Model::new(&parameters, physics), State::rested(&parameters, 1.0));
        Self {
            voltage_v: model.voltage(&state),
            model,
            physics,
            parameters,
            state,
            current_a: 0.0,
        }
    }

    /// Sets the state; `current_a` is the current that led to it.
    pub fn place(&mut self, state: State, current_a: f64) {
        (self.state, self.current_a) = (state, current_a);
        self.voltage_v = self.model.voltage(&self.state);
    }

    /// Sets the parameters; the charges stay.
    pub fn set_parameters(&mut self, parameters: CellParameters) {
        (self.parameters, self.model) = (parameters, Model::new(&parameters, self.physics));
        self.voltage_v = self.model.voltage(&self.state);
    }

    /// Draws `power_w` for `step_s`: the current follows from the voltage at the start of the step.
    #[inline]
    pub fn draw_power(&mut self, power_w: f64, step_s: f64) {
        self.draw_current(power_w / self.voltage_v.max(LOWEST_SUPPLY_V), step_s);
    }

    /// Draws `current_a` for `step_s`.
    #[inline]
    pub fn draw_current(&mut self, current_a: f64, step_s: f64) {
        self.state = self
            .state
            .advanced(&self.model.derivative(&self.state, current_a), step_s);
        self.voltage_v = self.model.voltage(&self.state);
        self.current_a = current_a;
    }

    /// Wears the parameters by the current of the last step.
    pub fn wear(&mut self, ageing: &AgeingRates, step_s: f64) {
        self.set_parameters(ageing.worn(&self.parameters, self.current_a, step_s));
    }

    /// Present parameters.
    #[must_use]
    pub fn parameters(&self) -> &CellParameters {
        &self.parameters
    }

    /// Present state.
    #[must_use]
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Terminal voltage, V.
    #[must_use]
    pub fn voltage_v(&self) -> f64 {
        self.voltage_v
    }

    /// Current of the last step, A; positive while discharging.
    #[must_use]
    pub fn current_a(&self) -> f64 {
        self.current_a
    }

    /// Open-circuit voltage less the slow overpotentials, V.
    #[must_use]
    pub fn effective_voltage_v(&self) -> f64 {
        self.model.effective_voltage(&self.state)
    }
}
