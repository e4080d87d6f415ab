//! The working gas: air with burnt kerosene as a thermally perfect gas, whose heat capacity is a polynomial of
//! temperature and fuel (P. P. Walsh and P. Fletcher, "Gas turbine performance", 2nd edition 2004, chapter 3).
//!
//! | symbol | here | unit |
//! |---|---|---|
//! | T | `temperature` | K |
//! | F = f / (1 + f), f the fuel-air ratio | `fuel_fraction`, burnt fuel per mass of gas | - |
//! | c_p(T, F) = sum (a_i + F b_i) z^i, z = T / 1000 K | heat capacity | J/(kg K) |
//! | h(T, F) = integral of c_p dT | [`enthalpy`] | J/kg |
//! | phi(T, F) = integral of c_p / T dT | [`entropy_function`] | J/(kg K) |
//!
//! Both include the nitric oxide in hot air at equilibrium, half N2 + half O2 = NO: its fraction of the
//! molecules, `K(T) sqrt(x_N2 x_O2)` with `K = 4.44 exp(-theta / T)`, takes 90.3 kJ/mol. At 1590 K that is 4.6
//! kJ/kg, 0.3 % of the enthalpy, which programs with chemical equilibrium include and polynomials do not.
//!
//! An isentropic change of pressure obeys `phi(T2) - phi(T1) = R ln(p2 / p1)`. The change of R by fuel, 0.0099
//! f J/(kg K), is below a millionth of R and neglected. No dissociation, no humidity.
//!
//! Functions take plain or dual numbers. Values and partial derivatives are computed with plain numbers and
//! joined by [`lift`], which costs less than dual arithmetic inside the polynomials.

use super::number::Number;
use arithmetic::double::{exp, ln};

/// Specific gas constant of air, J/(kg K).
pub(super) const GAS_CONSTANT: f64 = 287.05;

/// Coefficients a_i of air, J/(kg K).
const AIR: [f64; 9] = [
    992.313, 236.688, -1852.148, 6083.152, -8893.933, 7097.112, -3234.725, 794.571, -81.873,
];
/// Coefficients b_i of burnt fuel, J/(kg K).
const FUEL: [f64; 9] = [
    -718.874, 8747.481, -15863.157, 17254.096, -10233.795, 3081.778, -361.112, -3.919, 0.0,
];
/// Heat of formation of nitric oxide over the gas constant, K, the factor of its equilibrium constant, and the
/// conversion from its fraction of the molecules to J/kg.
const OXIDE: (f64, f64, f64) = (10_860.0, 4.44, 90_290.0 / 0.028_96);
/// Fractions of the molecules: nitrogen, and oxygen in air with its decrease by burnt fuel.
const NITROGEN: f64 = 0.78;
const OXYGEN: (f64, f64) = (0.2095, 3.3);
/// Range of the polynomials, K; beyond it the heat capacity is that of the nearer end.
const RANGE: (f64, f64) = (150.0, 2400.0);
/// Most steps of Newton's method for an inverse function; two are usual.
const MOST_STEPS: usize = 30;

/// A function's value as a number with the derivatives of its arguments: `changes` holds each argument and the
/// partial derivative by it.
pub(super) fn lift<T: Number>(value: f64, changes: &[(T, f64)]) -> T {
    let change = |total: T, (argument, slope): &(T, f64)| total + (*argument - argument.re()) * *slope;
    changes.iter().fold(T::from(value), change)
}

/// Specific enthalpy, J/kg.
pub(super) fn enthalpy<T: Number>(temperature: T, fuel_fraction: T) -> T {
    let (t, gas) = (temperature.re(), Gas::with(fuel_fraction.re()));
    let (h, cp) = gas.enthalpy(t);
    lift(h, &[(temperature, cp), (fuel_fraction, gas.enthalpy_of_fuel(t))])
}

/// Heat capacity at constant pressure, J/(kg K).
pub(super) fn heat_capacity(temperature: f64, fuel_fraction: f64) -> f64 {
    Gas::with(fuel_fraction).enthalpy(temperature).1
}

/// The integral of `c_p / T`, J/(kg K).
pub(super) fn entropy_function<T: Number>(temperature: T, fuel_fraction: T) -> T {
    let (t, gas) = (temperature.re(), Gas::with(fuel_fraction.re()));
    let (phi, cp) = gas.entropy(t);
    lift(
        phi,
        &[(temperature, cp / t), (fuel_fraction, gas.entropy_of_fuel(t))],
    )
}

/// The temperature at which the gas has this enthalpy, K.
pub(super) fn temperature_of_enthalpy<T: Number>(enthalpy: T, fuel_fraction: T) -> T {
    let (h, f) = (enthalpy.re(), fuel_fraction.re());
    let gas = Gas::with(f);
    let mut t = guess(h, f);
    let mut slope = 1.0;
    for _ in 0..MOST_STEPS {
        let (value, cp) = gas.enthalpy(t);
        let step = (h - value) / cp;
        (t, slope) = (t + step, 1.0 / cp);
        // The error after a step of Newton's method is of the order of its square.
        if step.abs() < 1e-3 {
            break;
        }
    }
    lift(
        t,
        &[
            (enthalpy, slope),
            (fuel_fraction, -slope * gas.enthalpy_of_fuel(t)),
        ],
    )
}

/// A start within 7 K of the temperature between 180 and 2200 K: a cubic that was fitted to the enthalpy of
/// air, less a fit to that of fuel.
fn guess(enthalpy: f64, fuel_fraction: f64) -> f64 {
    let h = enthalpy / 1e6;
    let air = -9.3 + h * (1062.7 + h * (-106.1 + h * 11.81));
    (air - fuel_fraction * h * (751.0 + 125.0 * h)).max(100.0)
}

/// The temperature after an isentropic change from `temperature` that adds `change` to the entropy function, K.
pub(super) fn temperature_after<T: Number>(temperature: T, fuel_fraction: T, change: T) -> T {
    let (start, gas) = (temperature.re(), Gas::with(fuel_fraction.re()));
    let (phi, cp) = gas.entropy(start);
    let goal = phi + change.re();
    // With a constant heat capacity the logarithm of the temperature is linear in the entropy function; the
    // value halfway is nearly right.
    let halfway = start * exp(0.5 * change.re() / cp);
    let mut t = start * exp(change.re() / gas.enthalpy(halfway).1);
    let mut cp_there = cp;
    for _ in 0..MOST_STEPS {
        let (value, cp) = gas.entropy(t);
        let step = (goal - value) / cp;
        t *= 1.0 + step * (1.0 + 0.5 * step);
        cp_there = cp;
        if step.abs() < 1e-6 {
            break;
        }
    }
    let slope = t / cp_there;
    let of_fuel = gas.entropy_of_fuel(start) - gas.entropy_of_fuel(t);
    let changes = [
        (temperature, slope * cp / start),
        (change, slope),
        (fuel_fraction, slope * of_fuel),
    ];
    lift(t, &changes)
}

/// The static temperature at which gas with this total temperature moves at the speed of sound, K.
pub(super) fn sonic_temperature<T: Number>(total_temperature: T, fuel_fraction: T) -> T {
    let total = enthalpy(total_temperature, fuel_fraction);
    let (h, gas) = (total.re(), Gas::with(fuel_fraction.re()));
    let mut t = total_temperature.re() / 1.18;
    let mut slopes = (0.0, 0.0);
    for _ in 0..MOST_STEPS {
        let (value, cp) = gas.enthalpy(t);
        let gamma = cp / (cp - GAS_CONSTANT);
        let excess = 2.0 * (h - value) - gamma * GAS_CONSTANT * t;
        // d gamma / d c_p = -R / (c_p - R)^2.
        let cv = cp - GAS_CONSTANT;
        let of_cp = -GAS_CONSTANT / (cv * cv) * GAS_CONSTANT * t;
        let by_t = -2.0 * cp - gamma * GAS_CONSTANT - of_cp * gas.heat_capacity_slope(t);
        let by_f = -2.0 * gas.enthalpy_of_fuel(t) - of_cp * gas.heat_capacity_of_fuel(t);
        slopes = (-2.0 / by_t, -by_f / by_t);
        let step = -excess / by_t;
        t += step;
        if step.abs() < 1e-4 {
            break;
        }
    }
    lift(t, &[(total, slopes.0), (fuel_fraction, slopes.1)])
}

/// Gas of one composition.
struct Gas {
    /// Coefficients of its heat capacity.
    coefficients: [f64; 9],
    /// Factor of the heat in nitric oxide, J/kg, and its relative change with fuel.
    oxide: (f64, f64),
}

impl Gas {
    fn with(fuel_fraction: f64) -> Self {
        let (_, factor, joule_per_kg) = OXIDE;
        // Fuel beyond the available oxygen does not burn; no engine comes near that limit.
        let oxygen = (OXYGEN.0 - OXYGEN.1 * fuel_fraction).max(1e-3);
        let oxide = factor * joule_per_kg * (NITROGEN * oxygen).sqrt();
        let coefficients = if fuel_fraction == 0.0 {
            AIR
        } else {
            std::array::from_fn(|i| AIR[i] + fuel_fraction * FUEL[i])
        };
        Self {
            coefficients,
            oxide: (oxide, -OXYGEN.1 / (2.0 * oxygen)),
        }
    }

    /// Enthalpy and heat capacity.
    fn enthalpy(&self, temperature: f64) -> (f64, f64) {
        let (h, cp) = integral(&self.coefficients, temperature);
        let heat = self.oxide_heat(temperature);
        (h + heat, cp + heat * growth(temperature))
    }

    /// Entropy function and heat capacity.
    fn entropy(&self, temperature: f64) -> (f64, f64) {
        let (phi, cp) = logarithmic_integral(&self.coefficients, temperature);
        let heat = self.oxide_heat(temperature);
        // The integral of a theta / T^3 exp(-theta / T) is a (1 / theta + 1 / T) exp(-theta / T).
        let of_oxide = heat * (1.0 / OXIDE.0 + 1.0 / temperature);
        (phi + of_oxide, cp + heat * growth(temperature))
    }

    fn heat_capacity_slope(&self, temperature: f64) -> f64 {
        let held = temperature.clamp(RANGE.0, RANGE.1);
        let z = held / 1000.0;
        let slope = (1..9).rev().fold(0.0, |sum, i| {
            #[allow(clippy::cast_precision_loss, reason = "a degree")]
            let degree = i as f64;
            sum * z + degree * self.coefficients[i]
        });
        let of_polynomial = if temperature == held { slope / 1000.0 } else { 0.0 };
        let growth = growth(temperature);
        of_polynomial + self.oxide_heat(temperature) * growth * (growth - 2.0 / temperature)
    }

    fn enthalpy_of_fuel(&self, temperature: f64) -> f64 {
        integral(&FUEL, temperature).0 + self.oxide.1 * self.oxide_heat(temperature)
    }

    fn heat_capacity_of_fuel(&self, temperature: f64) -> f64 {
        integral(&FUEL, temperature).1 + self.oxide.1 * self.oxide_heat(temperature) * growth(temperature)
    }

    fn entropy_of_fuel(&self, temperature: f64) -> f64 {
        let of_oxide = self.oxide.1 * self.oxide_heat(temperature) * (1.0 / OXIDE.0 + 1.0 / temperature);
        logarithmic_integral(&FUEL, temperature).0 + of_oxide
    }

    /// Heat in nitric oxide, J/kg; below 450 K it is less than a billionth of the enthalpy.
    fn oxide_heat(&self, temperature: f64) -> f64 {
        if temperature < 450.0 {
            return 0.0;
        }
        self.oxide.0 * exp(-OXIDE.0 / temperature)
    }
}

/// Derivative of exp(-theta / T) by T, relative to its value.
fn growth(temperature: f64) -> f64 {
    OXIDE.0 / (temperature * temperature)
}

/// The integral of a heat capacity from 0 K, and the heat capacity.
fn integral(coefficients: &[f64; 9], temperature: f64) -> (f64, f64) {
    /// 1 / (i + 1).
    const INVERSE: [f64; 9] = [
        1.0,
        1.0 / 2.0,
        1.0 / 3.0,
        1.0 / 4.0,
        1.0 / 5.0,
        1.0 / 6.0,
        1.0 / 7.0,
        1.0 / 8.0,
        1.0 / 9.0,
    ];
    let held = temperature.clamp(RANGE.0, RANGE.1);
    let z = held / 1000.0;
    let (mut value, mut sum) = (0.0, 0.0);
    for (a, inverse) in coefficients.iter().zip(INVERSE).rev() {
        value = value * z + a;
        sum = sum * z + a * inverse;
    }
    (sum * held + value * (temperature - held), value)
}

/// The integral of a heat capacity over the temperature, and the heat capacity.
fn logarithmic_integral(coefficients: &[f64; 9], temperature: f64) -> (f64, f64) {
    /// 1 / i.
    const INVERSE: [f64; 9] = [
        0.0,
        1.0,
        1.0 / 2.0,
        1.0 / 3.0,
        1.0 / 4.0,
        1.0 / 5.0,
        1.0 / 6.0,
        1.0 / 7.0,
        1.0 / 8.0,
    ];
    let held = temperature.clamp(RANGE.0, RANGE.1);
    let z = held / 1000.0;
    let (mut value, mut sum) = (0.0, 0.0);
    for (a, inverse) in coefficients.iter().zip(INVERSE).rev() {
        value = value * z + a;
        sum = sum * z + a * inverse;
    }
    let beyond = if temperature == held {
        0.0
    } else {
        value * ln(temperature / held)
    };
    (sum + coefficients[0] * ln(held) + beyond, value)
}
