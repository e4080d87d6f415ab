//! The components of an engine, each a function from the entering flow to the leaving one.
//!
//! Corrected flow is `W sqrt(T / 288.15 K) / (p / 101325 Pa)`, corrected speed `n / sqrt(T / 288.15 K)`, with
//! total values; those of turbines are referred to their inlet in the same way.

use super::atmosphere::SEA_LEVEL;
use super::gas::{
    GAS_CONSTANT, enthalpy, entropy_function, sonic_temperature, temperature_after, temperature_of_enthalpy,
};
use super::map::{CompressorShape, TurbineShape};
use super::number::{Number, exp, ln};

/// Gas at a station.
#[derive(Debug, Clone, Copy)]
pub(super) struct Flow<T> {
    /// Mass flow, kg/s.
    pub mass_flow: T,
    /// Burnt fuel per mass of gas.
    pub fuel_fraction: T,
    /// Total temperature, K.
    pub temperature: T,
    /// Total enthalpy, J/kg.
    pub enthalpy: T,
    /// Total pressure, Pa.
    pub pressure: T,
}

impl<T: Number> Flow<T> {
    /// Gas at a total temperature.
    pub(super) fn at(mass_flow: T, fuel_fraction: T, temperature: T, pressure: T) -> Self {
        Self {
            mass_flow,
            fuel_fraction,
            temperature,
            enthalpy: enthalpy(temperature, fuel_fraction),
            pressure,
        }
    }

    fn of_enthalpy(mass_flow: T, fuel_fraction: T, enthalpy: T, pressure: T) -> Self {
        Self {
            mass_flow,
            fuel_fraction,
            temperature: temperature_of_enthalpy(enthalpy, fuel_fraction),
            enthalpy,
            pressure,
        }
    }

    /// sqrt(T / 288.15 K).
    pub(super) fn root_theta(&self) -> T {
        (self.temperature / SEA_LEVEL.0).sqrt()
    }

    /// Mass flow per corrected mass flow.
    pub(super) fn per_corrected(&self) -> T {
        self.pressure / SEA_LEVEL.1 / self.root_theta()
    }

    /// Corrected mass flow, kg/s.
    pub(super) fn corrected(&self) -> T {
        self.mass_flow / self.per_corrected()
    }

    /// A fraction of the flow.
    pub(super) fn part(self, fraction: T) -> Self {
        Self {
            mass_flow: self.mass_flow * fraction,
            ..self
        }
    }

    /// The flow after a loss of total pressure.
    pub(super) fn after_loss(self, loss: T) -> Self {
        Self {
            pressure: self.pressure * (T::from(1.0) - loss),
            ..self
        }
    }

    /// Power that brings this flow to the enthalpy of `outlet`, W.
    pub(super) fn work_to(&self, outlet: &Self) -> T {
        self.mass_flow * (outlet.enthalpy - self.enthalpy)
    }

    /// Gas with half of the work between this flow and `outlet`. Its pressure has no effect, since bleed air is
    /// throttled.
    pub(super) fn halfway(&self, outlet: &Self) -> Self {
        let enthalpy = (self.enthalpy + outlet.enthalpy) * 0.5;
        Self::of_enthalpy(self.mass_flow, self.fuel_fraction, enthalpy, self.pressure)
    }

    /// This flow after mixing with others and the removal of `power`, W, at a new pressure.
    fn mixed_less(self, others: &[Self], power: T, pressure: T) -> Self {
        let sum = |of: fn(&Self) -> T| others.iter().fold(of(&self), |sum, other| sum + of(other));
        let mass_flow = sum(|flow| flow.mass_flow);
        let fuel = sum(|flow| flow.mass_flow * flow.fuel_fraction);
        let energy = sum(|flow| flow.mass_flow * flow.enthalpy) - power;
        Self::of_enthalpy(mass_flow, fuel / mass_flow, energy / mass_flow, pressure)
    }
}

/// A compressor: its map, and the scales that its design point fixes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Compressor {
    pub shape: CompressorShape,
    /// Corrected flow at the design point, kg/s.
    pub flow: f64,
    /// PR - 1 at the design point.
    pub pressure_rise: f64,
    /// Polytropic efficiency that, with the map, gives the efficiency at the design point.
    pub efficiency: f64,
    /// sqrt(T / 288.15 K) at the inlet at the design point.
    pub root_theta: f64,
}

/// Outlet of a compressor.
#[derive(Debug, Clone, Copy)]
pub(super) struct CompressorOutput<T> {
    /// The whole flow; the caller takes bleeds from it.
    pub outlet: Flow<T>,
    /// Corrected flow by the map, kg/s.
    pub corrected_flow: T,
}

impl Compressor {
    /// Flow and outlet at a speed relative to the design point's and a position on the speed line; `health`
    /// holds the relative changes of efficiency and flow.
    pub(super) fn compress<T: Number>(
        &self,
        inlet: Flow<T>,
        speed: T,
        line: T,
        health: (f64, f64),
    ) -> CompressorOutput<T> {
        let corrected_speed = speed * self.root_theta / inlet.root_theta();
        let on_map = self.shape.at(corrected_speed, line);
        let ratio = on_map.pressure_rise * self.pressure_rise + 1.0;
        let change = ln(ratio) * GAS_CONSTANT / (on_map.efficiency * self.efficiency);
        let unworn = temperature_after(inlet.temperature, inlet.fuel_fraction, change);
        let pressure = inlet.pressure * ratio;
        let unworn = Flow::at(inlet.mass_flow, inlet.fuel_fraction, unworn, pressure);
        let outlet = if health.0 == 0.0 {
            unworn
        } else {
            let work = (unworn.enthalpy - inlet.enthalpy) / (health.0 + 1.0);
            Flow::of_enthalpy(
                inlet.mass_flow,
                inlet.fuel_fraction,
                inlet.enthalpy + work,
                pressure,
            )
        };
        CompressorOutput {
            outlet,
            corrected_flow: on_map.flow * self.flow * (health.1 + 1.0),
        }
    }
}

/// A turbine: its map, and the scales that its design point fixes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turbine {
    pub shape: TurbineShape,
    /// Corrected flow at the design point before any cooling air, kg/s.
    pub flow: f64,
    /// Pressure ratio at the design point.
    pub pressure_ratio: f64,
    /// Isentropic efficiency at the design point.
    pub efficiency: f64,
    /// sqrt(T / 288.15 K) at the inlet at the design point.
    pub root_theta: f64,
}

/// Outlet and power of a turbine.
#[derive(Debug, Clone, Copy)]
pub(super) struct TurbineOutput<T> {
    /// Leaving flow, with all cooling air.
    pub outlet: Flow<T>,
    /// Power, W.
    pub power: T,
    /// Corrected flow by the map, kg/s.
    pub corrected_flow: T,
}

impl Turbine {
    /// Outlet and power at a pressure ratio and a speed relative to the design point's. Of the two streams of
    /// cooling air, the first expands beside the main one, from its pressure and with its efficiency, before
    /// the two mix; the second mixes in at the outlet.
    pub(super) fn expand<T: Number>(
        &self,
        inlet: Flow<T>,
        cooling: &[Flow<T>; 2],
        speed: T,
        pressure_ratio: T,
        health: (f64, f64),
    ) -> TurbineOutput<T> {
        let corrected_speed = speed * self.root_theta / inlet.root_theta();
        let relative_flow = self.shape.flow(corrected_speed);
        let relative_ratio = pressure_ratio / self.pressure_ratio;
        let efficiency = self.shape.efficiency(corrected_speed, relative_ratio) * self.efficiency;
        let efficiency = efficiency * (health.0 + 1.0);
        let change = -ln(pressure_ratio) * GAS_CONSTANT;
        let work = |flow: &Flow<T>| {
            let ideal = temperature_after(flow.temperature, flow.fuel_fraction, change);
            flow.mass_flow * (flow.enthalpy - enthalpy(ideal, flow.fuel_fraction)) * efficiency
        };
        let power = work(&inlet) + work(&cooling[0]);
        TurbineOutput {
            outlet: inlet.mixed_less(cooling, power, inlet.pressure / pressure_ratio),
            power,
            corrected_flow: relative_flow * self.flow * (health.1 + 1.0),
        }
    }
}

/// Burns `fuel_air_ratio` times the entering air; `heat` is the heat of combustion, J/kg.
pub(super) fn burn<T: Number>(inlet: Flow<T>, fuel_air_ratio: T, heat: f64, loss: f64) -> Flow<T> {
    let fuel = inlet.mass_flow * fuel_air_ratio;
    let mass_flow = inlet.mass_flow + fuel;
    let energy = inlet.mass_flow * inlet.enthalpy + fuel * heat;
    Flow::of_enthalpy(
        mass_flow,
        fuel / mass_flow,
        energy / mass_flow,
        inlet.pressure * (1.0 - loss),
    )
}

/// Gas in the throat of a convergent nozzle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Throat<T> {
    /// Mass flow per area, kg/(s m^2).
    pub flux: T,
    /// Ideal velocity, m/s.
    pub velocity: T,
    /// Static pressure, Pa.
    pub pressure: T,
}

impl<T: Number> Throat<T> {
    /// Isentropic flow to the ambient pressure, or to the speed of sound where that comes first.
    pub(super) fn of(flow: &Flow<T>, ambient: f64) -> Self {
        let fuel = flow.fuel_fraction;
        let sonic = sonic_temperature(flow.temperature, fuel);
        let fall = entropy_function(sonic, fuel) - entropy_function(flow.temperature, fuel);
        let sonic_pressure = flow.pressure * exp(fall / GAS_CONSTANT);
        let (temperature, pressure) = if sonic_pressure.re() >= ambient {
            (sonic, sonic_pressure)
        } else {
            let change = ln(T::from(ambient) / flow.pressure) * GAS_CONSTANT;
            (
                temperature_after(flow.temperature, fuel, change),
                T::from(ambient),
            )
        };
        let velocity = ((flow.enthalpy - enthalpy(temperature, fuel)) * 2.0).sqrt();
        Self {
            flux: pressure / (temperature * GAS_CONSTANT) * velocity,
            velocity,
            pressure,
        }
    }

    /// Gross thrust of `mass_flow` through `area`, N.
    pub(super) fn thrust(&self, mass_flow: T, area: T, velocity_coefficient: f64, ambient: f64) -> T {
        mass_flow * self.velocity * velocity_coefficient + (self.pressure - ambient) * area
    }
}
