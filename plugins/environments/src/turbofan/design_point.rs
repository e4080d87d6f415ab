//! The quantities that the design point fixes: scales of the maps, areas of the nozzles, and the unknowns
//! there.

use super::atmosphere::Air;
use super::component::{Compressor, Flow, Throat, Turbine, burn};
use super::cycle::{Engine, N};
use super::engine::Design;
use super::gas::{GAS_CONSTANT, enthalpy, entropy_function, temperature_after, temperature_of_enthalpy};
use super::map::{CompressorShape, TurbineShape};
use arithmetic::double::{exp, ln};

impl Engine {
    /// The engine of a design.
    pub(super) fn of(design: Design) -> Self {
        let air = Air::at(design.altitude_m, design.mach, 0.0);
        let inlet = Flow::at(
            design.mass_flow,
            0.0,
            air.total_temperature,
            air.total_pressure * design.recovery(air.mach),
        );
        let (bleeds, ducts) = (&design.bleeds, &design.ducts);
        let mut duct_flows = [0.0; 5];
        let mut duct = |place: usize, flow: Flow<f64>, loss: f64| {
            duct_flows[place] = flow.corrected();
            flow.after_loss(loss)
        };

        let (fan, behind_fan) = compressor(design.shapes.fan, inlet, design.fan);
        let core_fraction = 1.0 / (1.0 + design.bypass_ratio);
        let lpc_inlet = duct(0, behind_fan.part(core_fraction), ducts.before_lpc);
        let (lpc, behind_lpc) = compressor(design.shapes.lpc, lpc_inlet, design.lpc);
        let hpc_inlet = duct(1, behind_lpc, ducts.before_hpc);
        let (hpc, hpc_all) = compressor(design.shapes.hpc, hpc_inlet, design.hpc);
        let inside = bleeds.inside();
        let behind_hpc = hpc_all.part(1.0 - inside);
        let halfway = hpc_inlet.halfway(&hpc_all);
        let lp_work = inlet.work_to(&behind_fan) + lpc_inlet.work_to(&behind_lpc);
        let hp_work = hpc_inlet.work_to(&hpc_all) * (1.0 - inside / 2.0);

        let burner_inlet = behind_hpc.part(1.0 - bleeds.to_hpt_inlet - bleeds.to_hpt_outlet);
        let far = fuel_for(&design, burner_inlet);
        let burner = burn(burner_inlet, far, design.fuel_heat, design.burner_loss);
        let (hpt, behind_hpt) = turbine(
            design.shapes.hpt,
            burner,
            [bleeds.to_hpt_inlet, bleeds.to_hpt_outlet].map(|part| behind_hpc.part(part)),
            design.hpt_efficiency,
            hp_work + design.power_offtake,
        );
        let lpt_inlet = duct(2, behind_hpt, ducts.before_lpt);
        let (lpt, behind_lpt) = turbine(
            design.shapes.lpt,
            lpt_inlet,
            [bleeds.hpc_to_lpt_inlet, bleeds.hpc_to_lpt_outlet].map(|part| halfway.part(part)),
            design.lpt_efficiency,
            lp_work / design.lp_mechanical_efficiency,
        );
        let core = duct(3, behind_lpt, ducts.core);
        let bypass = behind_fan.part((1.0 - core_fraction) * (1.0 - bleeds.bypass));
        let bypass = duct(4, bypass, ducts.bypass);
        let area = |flow: &Flow<f64>| flow.mass_flow / Throat::of(flow, air.pressure).flux;
        Self {
            areas: (area(&core), area(&bypass)),
            unknowns: unknowns(&design, (hpt.pressure_ratio, lpt.pressure_ratio), far),
            design,
            fan,
            lpc,
            hpc,
            hpt,
            lpt,
            duct_flows,
        }
    }
}

/// The unknowns at the design point, from the pressure ratios of the turbines and the fuel-air ratio.
fn unknowns(design: &Design, (hpt, lpt): (f64, f64), far: f64) -> [f64; N] {
    let third = if design.fan_lines.is_some() { 1.0 } else { 0.0 };
    [1.0, 1.0, third, 0.0, 0.0, design.bypass_ratio, hpt, lpt, far]
}

/// A compressor with a pressure ratio and an isentropic efficiency at its design point, and its outlet there.
fn compressor(
    shape: CompressorShape,
    inlet: Flow<f64>,
    (ratio, efficiency): (f64, f64),
) -> (Compressor, Flow<f64>) {
    let ideal = temperature_after(inlet.temperature, 0.0, GAS_CONSTANT * ln(ratio));
    let outlet = inlet.enthalpy + (enthalpy(ideal, 0.0) - inlet.enthalpy) / efficiency;
    let temperature = temperature_of_enthalpy(outlet, 0.0);
    let change: f64 = entropy_function(temperature, 0.0) - entropy_function(inlet.temperature, 0.0);
    let polytropic = GAS_CONSTANT * ln(ratio) / change;
    let compressor = Compressor {
        shape,
        flow: inlet.corrected(),
        pressure_rise: ratio - 1.0,
        efficiency: polytropic / shape.at(1.0, 0.0).efficiency,
        root_theta: inlet.root_theta(),
    };
    let outlet = Flow::at(inlet.mass_flow, 0.0, temperature, inlet.pressure * ratio);
    (compressor, outlet)
}

/// The fuel-air ratio for the design's turbine inlet temperature.
fn fuel_for(design: &Design, inlet: Flow<f64>) -> f64 {
    // Burnt fuel changes the enthalpy of the gas, so the ratio is found by iteration, which converges like the
    // fuel's share of the gas.
    let mut far = 0.0;
    for _ in 0..60 {
        let hot = enthalpy(design.turbine_inlet_temperature_k, far / (1.0 + far));
        far = (hot - inlet.enthalpy) / (design.fuel_heat - hot);
    }
    far
}

/// A turbine with an isentropic efficiency that gives `power` (W) at its design point, and its outlet there.
fn turbine(
    shape: TurbineShape,
    inlet: Flow<f64>,
    cooling: [Flow<f64>; 2],
    efficiency: f64,
    power: f64,
) -> (Turbine, Flow<f64>) {
    // The pressure ratio for this power, by bisection of its logarithm.
    let turbine_of = |ratio: f64| Turbine {
        shape,
        flow: inlet.corrected(),
        pressure_ratio: ratio,
        efficiency,
        root_theta: inlet.root_theta(),
    };
    let expanded = |ratio: f64| turbine_of(ratio).expand(inlet, &cooling, 1.0, ratio, (0.0, 0.0));
    let (mut low, mut high) = (0.0_f64, 4.0_f64);
    for _ in 0..64 {
        let middle = (low + high) / 2.0;
        if expanded(exp(middle)).power < power {
            low = middle;
        } else {
            high = middle;
        }
    }
    let ratio = exp(high);
    (turbine_of(ratio), expanded(ratio).outlet)
}
