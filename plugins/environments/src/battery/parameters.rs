//! Constants of the lithium-ion cell (type 18650, about 2.1 Ah), each with its unit.
//!
//! Source of all values: M. Daigle and C. Kulkarni, "Electrochemistry-based battery modeling for
//! prognostics", PHM 2013, as published in NASA's `progpy` 1.9.0 (`BatteryElectroChemEOD`).

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Universal gas constant R, J/(K mol).
pub const GAS_CONSTANT: f64 = 8.314_462_1;
/// Faraday constant F, C/mol.
pub const FARADAY: f64 = 96_487.0;

/// Largest mole fraction of lithium in the negative electrode; the smallest is 0.
pub const MOLE_FRACTION_N_MAX: f64 = 0.6;
/// Smallest mole fraction of lithium in the positive electrode; the largest is 1.
pub const MOLE_FRACTION_P_MIN: f64 = 0.4;
/// Electrode volume, m3.
pub const VOLUME: f64 = 2e-5;
/// Fraction of an electrode's volume that is its surface layer.
pub const SURFACE_FRACTION: f64 = 0.1;

/// Surface area of the negative electrode Sn, m2.
pub const SURFACE_AREA_N: f64 = 4.375_45e-4;
/// Surface area of the positive electrode Sp, m2.
pub const SURFACE_AREA_P: f64 = 3.0962e-4;
/// Butler-Volmer exchange constant of the negative electrode kn, A/m2.
pub const EXCHANGE_N: f64 = 2120.96;
/// Butler-Volmer exchange constant of the positive electrode kp, A/m2.
pub const EXCHANGE_P: f64 = 248_898.0;
/// Charge transfer coefficient. The model uses square roots in place of powers because it is one half.
pub const TRANSFER_COEFFICIENT: f64 = 0.5;

/// Time constant of the ohmic drop, s.
pub const TIME_OHMIC_S: f64 = 6.08671;
/// Time constant of the negative electrode's surface overpotential, s.
pub const TIME_SURFACE_N_S: f64 = 1001.38;
/// Time constant of the positive electrode's surface overpotential, s.
pub const TIME_SURFACE_P_S: f64 = 46.4311;

/// Reference potential of the negative electrode, V.
pub const REFERENCE_N_V: f64 = 0.01;
/// Reference potential of the positive electrode, V.
pub const REFERENCE_P_V: f64 = 4.03;
/// Redlich-Kister coefficient of the negative electrode, J/mol; its other twelve are zero.
pub const REDLICH_KISTER_N: f64 = 86.19;
/// Redlich-Kister coefficients of the positive electrode, J/mol.
pub const REDLICH_KISTER_P: [f64; 13] = [
    -31_593.7,
    0.106_747,
    24_606.4,
    -78_561.9,
    13_317.9,
    307_387.0,
    84_916.1,
    -1.074_69e6,
    2285.04,
    990_894.0,
    283_920.0,
    -161_513.0,
    -469_218.0,
];

/// Ambient and initial temperature, K.
pub const AMBIENT_K: f64 = 292.1;
/// Heat capacity of the cell mC, J/K.
pub const HEAT_CAPACITY: f64 = 37.04;
/// Time constant of the exchange of heat with the surroundings, s.
pub const TIME_THERMAL_S: f64 = 100.0;

/// Terminal voltage at which a cell counts as discharged, V.
pub const END_OF_DISCHARGE_V: f64 = 3.0;

/// The parameters that differ between cells and that ageing changes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CellParameters {
    /// Mobile lithium charge qMobile, the capacity; every charge limit scales with it.
    #[schemars(range(min = 100.0, max = 1e6), extend("x-unit" = "C",
        "x-source" = "Daigle and Kulkarni 2013"))]
    pub q_mobile_c: f64,
    /// Lumped ohmic resistance Ro.
    #[schemars(range(min = 1e-6, max = 10.0), extend("x-unit" = "ohm",
        "x-source" = "Daigle and Kulkarni 2013"))]
    pub r_ohm: f64,
    /// Resistance D to diffusion between bulk and surface: the difference of their charge concentrations (C/m3)
    /// over D is the charge that flows per second. The source calls it a diffusion constant, though a larger
    /// one means slower diffusion.
    #[schemars(range(min = 1e4, max = 1e12), extend("x-unit" = "s/m3",
        "x-source" = "Daigle and Kulkarni 2013"))]
    pub t_diffusion: f64,
}

impl CellParameters {
    /// A new cell.
    pub const FRESH: Self = Self {
        q_mobile_c: 7600.0,
        r_ohm: 0.117_215,
        t_diffusion: 7e6,
    };

    /// A cell with less capacity and more resistance, but with the diffusion of a new one.
    #[must_use]
    pub const fn aged(q_mobile_c: f64, r_ohm: f64) -> Self {
        Self {
            q_mobile_c,
            r_ohm,
            t_diffusion: Self::FRESH.t_diffusion,
        }
    }
}

impl Default for CellParameters {
    fn default() -> Self {
        Self::FRESH
    }
}

/// Four cells of a second-life pack, each with less capacity and more resistance than the one before. The
/// thesis gives no values; these leave room for its reported gain of 151 % over an equal split.
pub const SECOND_LIFE: [CellParameters; 4] = [
    CellParameters::aged(7000.0, 0.125),
    CellParameters::aged(6600.0, 0.135),
    CellParameters::aged(6200.0, 0.15),
    CellParameters::aged(5800.0, 0.165),
];
