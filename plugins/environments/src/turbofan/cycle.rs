//! The thermodynamic cycle: the operation of an engine at guessed speeds and positions on maps, and the
//! residuals of the balances between its components.
//!
//! | unknown | index | residual |
//! |---|---|---|
//! | relative speeds of the shafts | 0, 1 | power of each shaft over that of its turbine |
//! | position on the fan's line, or the area of the fan nozzle over its design | 2 | bypass nozzle |
//! | positions on the lines of both compressors | 3, 4 | their corrected flows |
//! | bypass ratio | 5 | core nozzle |
//! | pressure ratios of both turbines | 6, 7 | their corrected flows |
//! | fuel-air ratio of the burner | 8 | the held quantity, e.g. the turbine inlet temperature |
//!
//! All residuals are relative. The fan has none: its map gives the flow.

use super::atmosphere::Air;
use super::component::{Compressor, Flow, Throat, Turbine, burn};
use super::engine::Design;
use super::number::Number;
use serde::{Deserialize, Serialize};

/// Number of unknowns.
pub(super) const N: usize = 9;
/// Positions of the relative speeds of the shafts among the unknowns and of their powers among the residuals.
pub(super) const SPEEDS: [usize; 2] = [0, 1];
/// Position of the fuel-air ratio, and of the held quantity.
pub(super) const FUEL: usize = 8;

/// Relative changes of efficiency and flow of a component; 0 is healthy.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Wear {
    pub efficiency: f64,
    pub flow: f64,
}

impl Wear {
    fn pair(self) -> (f64, f64) {
        (self.efficiency, self.flow)
    }
}

/// The health of all five rotating components.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Health {
    pub fan: Wear,
    pub lpc: Wear,
    pub hpc: Wear,
    pub hpt: Wear,
    pub lpt: Wear,
}

impl Health {
    /// Interpolates between this health and `other`.
    pub(super) fn towards(&self, other: &Self, part: f64) -> Self {
        let between = |from: Wear, to: Wear| Wear {
            efficiency: from.efficiency + part * (to.efficiency - from.efficiency),
            flow: from.flow + part * (to.flow - from.flow),
        };
        Self {
            fan: between(self.fan, other.fan),
            lpc: between(self.lpc, other.lpc),
            hpc: between(self.hpc, other.hpc),
            hpt: between(self.hpt, other.hpt),
            lpt: between(self.lpt, other.lpt),
        }
    }
}

/// An engine, with the scales that its design point fixes.
#[derive(Debug, Clone)]
pub(super) struct Engine {
    pub design: Design,
    pub fan: Compressor,
    pub lpc: Compressor,
    pub hpc: Compressor,
    pub hpt: Turbine,
    pub lpt: Turbine,
    /// Corrected flows of the ducts at the design point, kg/s, in the order of [`super::engine::Ducts`].
    pub duct_flows: [f64; 5],
    /// Areas of the core and the bypass nozzle, m^2; for a variable one at the design point.
    pub areas: (f64, f64),
    /// The unknowns at the design point.
    pub unknowns: [f64; N],
}

/// The operation of an engine at given unknowns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point<T> {
    pub fan: Flow<T>,
    pub lpc: Flow<T>,
    pub hpc: Flow<T>,
    pub burner: Flow<T>,
    pub hpt: Flow<T>,
    pub lpt: Flow<T>,
    /// Flow that reaches the bypass nozzle.
    pub bypass: Flow<T>,
    pub inlet: Flow<T>,
    /// Fuel flow, kg/s.
    pub fuel_flow: T,
    /// Net thrust, N.
    pub thrust: T,
    /// Gross thrust of both nozzles, N.
    pub gross_thrust: T,
    pub bypass_ratio: T,
    /// Power that accelerates each shaft, W.
    pub surplus_power: [T; 2],
    /// Area of the bypass nozzle, m^2.
    pub bypass_area: T,
    /// Residuals of the balances; that of the held quantity is 0 here.
    pub residuals: [T; N],
}

/// Flows and powers of the compressors.
struct Compression<T> {
    inlet: Flow<T>,
    fan: Flow<T>,
    core_fraction: T,
    lpc: Flow<T>,
    /// Flow behind the high-pressure compressor, for the burner and for cooling behind it.
    hpc: Flow<T>,
    /// Cooling air for the low-pressure turbine, at its inlet and its outlet.
    cooling: [Flow<T>; 2],
    /// Power for the compressors on the low-pressure and the high-pressure shaft, W.
    work: [T; 2],
}

impl Engine {
    /// The cycle at the given unknowns.
    pub(super) fn at<T: Number>(&self, unknowns: &[T; N], air: &Air, health: &Health) -> Point<T> {
        let mut residuals = [T::from(0.0); N];
        let design = &self.design;
        let compression = self.compress(unknowns, air, health, &mut residuals);
        let Compression { inlet, fan, hpc, .. } = compression;

        let bleeds = &design.bleeds;
        let cooled = |fraction: f64| hpc.part(T::from(fraction));
        let burner_inlet = cooled(1.0 - bleeds.to_hpt_inlet - bleeds.to_hpt_outlet);
        let burner = burn(burner_inlet, unknowns[FUEL], design.fuel_heat, design.burner_loss);
        let cooling = [cooled(bleeds.to_hpt_inlet), cooled(bleeds.to_hpt_outlet)];
        let hpt = self
            .hpt
            .expand(burner, &cooling, unknowns[1], unknowns[6], health.hpt.pair());
        residuals[6] = burner.corrected() / hpt.corrected_flow - 1.0;
        let lpt_inlet = self.duct(2, hpt.outlet, design.ducts.before_lpt);
        let cooling = &compression.cooling;
        let lpt = self
            .lpt
            .expand(lpt_inlet, cooling, unknowns[0], unknowns[7], health.lpt.pair());
        residuals[7] = lpt_inlet.corrected() / lpt.corrected_flow - 1.0;

        let core = self.duct(3, lpt.outlet, design.ducts.core);
        let bypass = fan.part((T::from(1.0) - compression.core_fraction) * (1.0 - bleeds.bypass));
        let bypass = self.duct(4, bypass, design.ducts.bypass);
        let bypass_area = self.bypass_area(unknowns);
        let (core_thrust, core_residual) = nozzle(
            &core,
            T::from(self.areas.0),
            design.velocity_coefficients.0,
            air.pressure,
        );
        let (bypass_thrust, bypass_residual) =
            nozzle(&bypass, bypass_area, design.velocity_coefficients.1, air.pressure);
        (residuals[5], residuals[2]) = (core_residual, bypass_residual);

        let surplus_power = [
            lpt.power * design.lp_mechanical_efficiency - compression.work[0],
            hpt.power - compression.work[1] - design.power_offtake,
        ];
        residuals[SPEEDS[0]] = surplus_power[0] / lpt.power;
        residuals[SPEEDS[1]] = surplus_power[1] / hpt.power;
        let gross_thrust = core_thrust + bypass_thrust;
        Point {
            inlet,
            fan,
            lpc: compression.lpc,
            hpc,
            burner,
            hpt: hpt.outlet,
            lpt: lpt.outlet,
            bypass,
            fuel_flow: burner_inlet.mass_flow * unknowns[FUEL],
            thrust: gross_thrust - inlet.mass_flow * air.speed,
            gross_thrust,
            bypass_ratio: unknowns[5],
            surplus_power,
            bypass_area,
            residuals,
        }
    }

    /// Inlet, fan, compressors and their bleeds.
    fn compress<T: Number>(
        &self,
        unknowns: &[T; N],
        air: &Air,
        health: &Health,
        residuals: &mut [T; N],
    ) -> Compression<T> {
        let (one, design) = (T::from(1.0), &self.design);
        let unit = self.inlet(air);
        let fan = self
            .fan
            .compress(unit, unknowns[0], self.fan_line(unknowns, air), health.fan.pair());
        // The fan's mass flow follows from its map.
        let mass_flow = fan.corrected_flow * unit.per_corrected();
        let (inlet, fan) = (unit.part(mass_flow), fan.outlet.part(mass_flow));
        let core_fraction = one / (unknowns[5] + 1.0);
        let lpc_inlet = self.duct(0, fan.part(core_fraction), design.ducts.before_lpc);
        let lpc = self
            .lpc
            .compress(lpc_inlet, unknowns[0], unknowns[3], health.lpc.pair());
        residuals[3] = lpc_inlet.corrected() / lpc.corrected_flow - 1.0;
        let opened = self.low_speed_bleed(unknowns[0] * self.fan.root_theta / unit.root_theta());
        let hpc_inlet = self.duct(1, lpc.outlet.part(one - opened), design.ducts.before_hpc);
        let hpc = self
            .hpc
            .compress(hpc_inlet, unknowns[1], unknowns[4], health.hpc.pair());
        residuals[4] = hpc_inlet.corrected() / hpc.corrected_flow - 1.0;

        let bleeds = &design.bleeds;
        let halfway = hpc_inlet.halfway(&hpc.outlet);
        let inside = bleeds.inside();
        let lp_work = inlet.work_to(&fan) + lpc_inlet.work_to(&lpc.outlet);
        Compression {
            inlet,
            fan,
            core_fraction,
            lpc: lpc.outlet,
            hpc: hpc.outlet.part(T::from(1.0 - inside)),
            cooling: [bleeds.hpc_to_lpt_inlet, bleeds.hpc_to_lpt_outlet]
                .map(|part| halfway.part(T::from(part))),
            work: [lp_work, hpc_inlet.work_to(&hpc.outlet) * (1.0 - 0.5 * inside)],
        }
    }

    /// Air behind the inlet, for a mass flow of 1 kg/s.
    pub(super) fn inlet<T: Number>(&self, air: &Air) -> Flow<T> {
        Flow::at(
            T::from(1.0),
            T::from(0.0),
            T::from(air.total_temperature),
            T::from(air.total_pressure * self.design.recovery(air.mach)),
        )
    }

    /// The position on the fan's line: an unknown, or the value that the variable nozzle holds.
    fn fan_line<T: Number>(&self, unknowns: &[T; N], air: &Air) -> T {
        self.design.fan_lines.map_or(unknowns[2], |(at_rest, at_design)| {
            T::from(at_rest + (at_design - at_rest) * (air.mach / self.design.mach).min(1.0))
        })
    }

    /// Area of the bypass nozzle, m^2.
    fn bypass_area<T: Number>(&self, unknowns: &[T; N]) -> T {
        match self.design.fan_lines {
            Some(_) => unknowns[2] * self.areas.1,
            None => T::from(self.areas.1),
        }
    }

    /// Fraction of the air that leaves through the bleed behind the low-pressure compressor.
    fn low_speed_bleed<T: Number>(&self, fan_speed: T) -> T {
        let (threshold, slope) = self.design.low_speed_bleed;
        if fan_speed.re() < threshold {
            (-fan_speed + threshold) * slope
        } else {
            T::from(0.0)
        }
    }

    fn duct<T: Number>(&self, place: usize, flow: Flow<T>, loss: f64) -> Flow<T> {
        if self.design.losses_with_flow {
            let relative = flow.corrected() / self.duct_flows[place];
            flow.after_loss(relative * relative * loss)
        } else {
            flow.after_loss(T::from(loss))
        }
    }
}

/// Gross thrust, N, and the relative excess of the flow that the area passes.
fn nozzle<T: Number>(flow: &Flow<T>, area: T, velocity_coefficient: f64, ambient: f64) -> (T, T) {
    let throat = Throat::of(flow, ambient);
    let thrust = throat.thrust(flow.mass_flow, area, velocity_coefficient, ambient);
    (thrust, throat.flux * area / flow.mass_flow - 1.0)
}
