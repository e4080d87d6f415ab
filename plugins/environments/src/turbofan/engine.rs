//! Two turbofans as data: the choices of their designers, in SI units.
//!
//! * `hbtf`: the separate-flow engine of pyCycle's high-bypass example (two spools, fixed nozzles).
//! * `agtf30`: the geared engine of NASA's AGTF30 (J. W. Chapman and J. S. Litt, AIAA 2017-4820), with a fan
//!   nozzle of variable area that holds the fan on a scheduled line, and a bleed behind the low-pressure
//!   compressor.

use super::map::{CompressorShape, Losses, Onset, TurbineShape};

/// A named engine.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize, schemars::JsonSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum EngineName {
    /// Two spools, no gear, fixed nozzles; 26 kN of net thrust at 10.7 km and Mach 0.8.
    #[default]
    Hbtf,
    /// Two spools, the fan behind a gear, variable fan nozzle; 24 kN at 10.7 km and Mach 0.8.
    Agtf30,
}

/// The design of an engine: its design point and its constants.
#[derive(Debug, Clone)]
pub(super) struct Design {
    pub altitude_m: f64,
    pub mach: f64,
    /// Air flow at the design point, kg/s.
    pub mass_flow: f64,
    pub bypass_ratio: f64,
    pub turbine_inlet_temperature_k: f64,
    /// Pressure ratio and isentropic efficiency of each compressor at the design point.
    pub fan: (f64, f64),
    pub lpc: (f64, f64),
    pub hpc: (f64, f64),
    /// Isentropic efficiencies of the turbines at the design point.
    pub hpt_efficiency: f64,
    pub lpt_efficiency: f64,
    /// Speeds of the shafts at the design point, rpm.
    pub n1_rpm: f64,
    pub n2_rpm: f64,
    /// Speed of the low-pressure shaft over that of the fan.
    pub gear_ratio: f64,
    pub shapes: Shapes,
    /// Total pressure behind the inlet over that before it, at rest and from Mach 1 on.
    pub ram_recovery: (f64, f64),
    pub ducts: Ducts,
    /// Whether losses of ducts grow with the square of their corrected flow.
    pub losses_with_flow: bool,
    pub bleeds: Bleeds,
    /// Heat of combustion, J/kg.
    pub fuel_heat: f64,
    pub burner_loss: f64,
    /// Velocity coefficients of the core and the bypass nozzle.
    pub velocity_coefficients: (f64, f64),
    /// Power taken from the high-pressure shaft, W.
    pub power_offtake: f64,
    /// Fraction of the low-pressure turbine's power that reaches the shaft.
    pub lp_mechanical_efficiency: f64,
    /// Moments of inertia of the shafts, kg m^2; that of the fan is referred to the low-pressure one.
    pub inertia: (f64, f64),
    /// The line of the fan at rest and at the design Mach number, where the fan nozzle holds it; `None` for
    /// fixed nozzles.
    pub fan_lines: Option<(f64, f64)>,
    /// The bleed behind the low-pressure compressor: the relative corrected fan speed above which it is shut,
    /// and the bled fraction of the flow per unit of speed below.
    pub low_speed_bleed: (f64, f64),
}

/// Constants of the component maps.
#[derive(Debug, Clone)]
pub(super) struct Shapes {
    pub fan: CompressorShape,
    pub lpc: CompressorShape,
    pub hpc: CompressorShape,
    pub hpt: TurbineShape,
    pub lpt: TurbineShape,
}

/// Relative losses of total pressure at the design point.
#[derive(Debug, Clone)]
pub(super) struct Ducts {
    /// Between splitter and low-pressure compressor.
    pub before_lpc: f64,
    /// Between the compressors.
    pub before_hpc: f64,
    /// Between the turbines.
    pub before_lpt: f64,
    /// Before the core nozzle.
    pub core: f64,
    /// Before the bypass nozzle.
    pub bypass: f64,
}

/// Bled air, as fractions of the passing flow.
#[derive(Debug, Clone)]
pub(super) struct Bleeds {
    /// From inside the high-pressure compressor, halfway through its work.
    pub hpc_to_lpt_inlet: f64,
    pub hpc_to_lpt_outlet: f64,
    pub hpc_to_customer: f64,
    /// From behind the high-pressure compressor.
    pub to_hpt_inlet: f64,
    pub to_hpt_outlet: f64,
    /// From the bypass duct, lost.
    pub bypass: f64,
}

impl Bleeds {
    /// Fraction of all bleeds from inside the high-pressure compressor.
    pub(super) fn inside(&self) -> f64 {
        self.hpc_to_lpt_inlet + self.hpc_to_lpt_outlet + self.hpc_to_customer
    }
}

impl Design {
    /// Total pressure behind the inlet over that before it.
    pub(super) fn recovery(&self, mach: f64) -> f64 {
        let (at_rest, at_one) = self.ram_recovery;
        at_rest + (at_one - at_rest) * mach.min(1.0)
    }
}

const POUND: f64 = 0.453_592_37;
const RANKINE: f64 = 1.0 / 1.8;
const FOOT: f64 = 0.3048;
const HORSEPOWER: f64 = 745.699_872;
/// One slug ft^2 in kg m^2.
const SLUG_FOOT_2: f64 = 1.355_817_948;

/// Maps of `hbtf`, fitted to operating points of pyCycle's example.
const HBTF_FAN: CompressorShape = CompressorShape {
    rise_of_flow: 3.1498,
    flow_of_speed: 0.95754,
    line_rise: 0.04068,
    line_flow: 0.02274,
    choking: (
        0.73072,
        Onset {
            begin: 0.96384,
            width: 0.01687,
        },
    ),
    losses: Losses {
        speed: (
            0.57712,
            Onset {
                begin: 0.91011,
                width: 0.0561,
            },
        ),
        tilt: -0.00257,
        bend: 0.0359,
        off_speed: 0.05,
    },
};
const HBTF_LPC: CompressorShape = CompressorShape {
    rise_of_flow: 2.80549,
    flow_of_speed: 1.19283,
    line_rise: 0.02918,
    line_flow: 0.00463,
    choking: (
        0.49211,
        Onset {
            begin: 1.00729,
            width: 0.008,
        },
    ),
    losses: Losses {
        speed: (
            2.0,
            Onset {
                begin: 1.04386,
                width: 0.02552,
            },
        ),
        tilt: 0.008,
        bend: 0.01479,
        off_speed: 0.09389,
    },
};
const HBTF_HPC: CompressorShape = CompressorShape {
    rise_of_flow: 1.85103,
    flow_of_speed: 3.90913,
    line_rise: 0.03641,
    line_flow: 0.00402,
    choking: (
        0.05706,
        Onset {
            begin: 1.00487,
            width: 0.008,
        },
    ),
    losses: Losses {
        speed: (
            0.24976,
            Onset {
                begin: 0.98778,
                width: 0.00881,
            },
        ),
        tilt: 0.00732,
        bend: 0.01251,
        off_speed: 0.29588,
    },
};
/// Maps of `agtf30`, whose spines pass through the sea-level point of pyCycle's N+3 engine, its parent.
const AGTF30_FAN: CompressorShape = CompressorShape {
    rise_of_flow: 3.23,
    flow_of_speed: 0.8,
    line_rise: 0.03087,
    line_flow: 0.03087,
    choking: (
        0.0,
        Onset {
            begin: 1.0,
            width: 0.05,
        },
    ),
    losses: Losses {
        speed: (
            0.0,
            Onset {
                begin: 1.0,
                width: 0.05,
            },
        ),
        tilt: 0.0,
        bend: 0.02,
        off_speed: 0.2,
    },
};
const AGTF30_LPC: CompressorShape = CompressorShape {
    rise_of_flow: 1.325,
    flow_of_speed: 1.12,
    line_rise: 0.029,
    line_flow: 0.005,
    choking: (
        0.0,
        Onset {
            begin: 1.0,
            width: 0.05,
        },
    ),
    losses: Losses {
        speed: (
            0.18,
            Onset {
                begin: 0.8,
                width: 0.05,
            },
        ),
        tilt: 0.008,
        bend: 0.015,
        off_speed: 0.1,
    },
};
const AGTF30_HPC: CompressorShape = CompressorShape {
    rise_of_flow: 1.85,
    flow_of_speed: 3.67,
    line_rise: 0.036,
    line_flow: 0.004,
    choking: (
        0.0,
        Onset {
            begin: 1.0,
            width: 0.05,
        },
    ),
    losses: Losses {
        speed: (
            0.2,
            Onset {
                begin: 0.985,
                width: 0.01,
            },
        ),
        tilt: 0.007,
        bend: 0.0125,
        off_speed: 0.3,
    },
};
const HPT: TurbineShape = TurbineShape {
    flow_by_speed: 0.0,
    efficiency_by_speed: 0.084,
    bend: 0.8,
    efficiency_by_ratio: -0.105,
};
const LPT: TurbineShape = TurbineShape {
    flow_by_speed: -0.079,
    efficiency_by_speed: 0.08,
    bend: 0.3,
    efficiency_by_ratio: -0.005,
};

impl EngineName {
    /// The design of the engine.
    pub(super) fn design(self) -> Design {
        match self {
            Self::Hbtf => hbtf(),
            Self::Agtf30 => agtf30(),
        }
    }
}

fn hbtf() -> Design {
    Design {
        altitude_m: 35_000.0 * FOOT,
        mach: 0.8,
        mass_flow: 344.303_136_577 * POUND,
        bypass_ratio: 5.105,
        turbine_inlet_temperature_k: 2857.0 * RANKINE,
        fan: (1.685, 0.8948),
        lpc: (1.935, 0.9243),
        hpc: (9.369, 0.8707),
        hpt_efficiency: 0.8888,
        lpt_efficiency: 0.8996,
        n1_rpm: 4666.1,
        n2_rpm: 14_705.7,
        gear_ratio: 1.0,
        shapes: Shapes {
            fan: HBTF_FAN,
            lpc: HBTF_LPC,
            hpc: HBTF_HPC,
            hpt: HPT,
            lpt: LPT,
        },
        ram_recovery: (0.999, 0.999),
        ducts: Ducts {
            before_lpc: 0.0048,
            before_hpc: 0.0101,
            before_lpt: 0.0051,
            core: 0.0107,
            bypass: 0.0149,
        },
        losses_with_flow: false,
        bleeds: Bleeds {
            hpc_to_lpt_inlet: 0.050_708,
            hpc_to_lpt_outlet: 0.020_274,
            hpc_to_customer: 0.0445,
            to_hpt_inlet: 0.067_214,
            to_hpt_outlet: 0.101_256,
            bypass: 0.005,
        },
        fuel_heat: 45.17e6,
        burner_loss: 0.054,
        velocity_coefficients: (0.9933, 0.9939),
        power_offtake: 250.0 * HORSEPOWER,
        lp_mechanical_efficiency: 1.0,
        inertia: (60.0, 30.0),
        fan_lines: None,
        low_speed_bleed: (0.0, 0.0),
    }
}

fn agtf30() -> Design {
    Design {
        altitude_m: 35_000.0 * FOOT,
        mach: 0.8,
        mass_flow: 815.48 * POUND,
        bypass_ratio: 23.2,
        turbine_inlet_temperature_k: 3150.0 * RANKINE,
        fan: (1.30, 0.9689),
        lpc: (3.00, 0.8894),
        hpc: (14.103, 0.8469),
        hpt_efficiency: 0.9313,
        lpt_efficiency: 0.9409,
        n1_rpm: 6772.0,
        n2_rpm: 20_796.0,
        gear_ratio: 3.1,
        shapes: Shapes {
            fan: AGTF30_FAN,
            lpc: AGTF30_LPC,
            hpc: AGTF30_HPC,
            hpt: HPT,
            lpt: LPT,
        },
        ram_recovery: (0.995, 0.998),
        ducts: Ducts {
            before_lpc: 0.01,
            before_hpc: 0.015,
            before_lpt: 0.005,
            core: 0.01,
            bypass: 0.015,
        },
        losses_with_flow: true,
        bleeds: Bleeds {
            hpc_to_lpt_inlet: 0.0,
            hpc_to_lpt_outlet: 0.02,
            hpc_to_customer: 0.0,
            to_hpt_inlet: 0.0693,
            to_hpt_outlet: 0.0625,
            bypass: 0.0,
        },
        fuel_heat: 18_400.0 * 2326.0 * 0.999,
        burner_loss: 0.04,
        velocity_coefficients: (0.9999, 0.9975),
        power_offtake: 350.0 * HORSEPOWER,
        lp_mechanical_efficiency: 0.99,
        inertia: (17.4 * SLUG_FOOT_2, 1.86 * SLUG_FOOT_2),
        fan_lines: Some((-0.11, 0.0)),
        low_speed_bleed: (0.7, 0.3),
    }
}
