//! Power of a rotary-wing UAV in straight, level flight.
//!
//! Y. Zeng, J. Xu and R. Zhang, "Energy minimization for wireless communication with rotary-wing UAV", IEEE
//! Transactions on Wireless Communications 18 (2019) 2329-2345, arXiv:1804.02238, equation 12 with the UAV of its
//! table I (20 N, one rotor disc of 0.503 m2):
//!
//! `P(V) = P_0 (1 + 3 V^2 / U_tip^2) + P_i (sqrt(1 + V^4 / (4 v_0^4)) - V^2 / (2 v_0^2))^(1/2) + d_0 rho s A V^3 / 2`,
//!
//! the power of the blades' drag, of the lift, and of the fuselage's drag. Range of validity: still air around
//! the UAV, V up to about 30 m/s. A climb costs the potential energy over an efficiency; a descent returns no
//! energy.
//!
//! | paper | here | value |
//! |---|---|---|
//! | P_0, P_i | [`BLADE_W`], [`INDUCED_W`]: blade and induced power in hover | 79.86, 88.63 W |
//! | U_tip | [`TIP_M_PER_S`] | 120 m/s |
//! | v_0 | [`INDUCED_M_PER_S`]: mean induced velocity in hover | 4.03 m/s |
//! | d_0, rho, s, A | [`DRAG_RATIO`], [`AIR_KG_PER_M3`], [`SOLIDITY`], [`DISC_M2`] | 0.6, 1.225 kg/m3, 0.05, 0.503 m2 |
//! | W | [`WEIGHT_N`] | 20 N |

/// Power of the blades' drag in hover, W.
pub const BLADE_W: f64 = 79.86;
/// Power of the lift in hover, W.
pub const INDUCED_W: f64 = 88.63;
/// Speed of the tips of the blades, m/s.
pub const TIP_M_PER_S: f64 = 120.0;
/// Mean velocity that the rotor induces in hover, m/s.
pub const INDUCED_M_PER_S: f64 = 4.03;
/// Drag area of the fuselage over the area of the blades.
pub const DRAG_RATIO: f64 = 0.6;
/// Density of air at sea level, kg/m3.
pub const AIR_KG_PER_M3: f64 = 1.225;
/// Fraction of the rotor disc that blades cover.
pub const SOLIDITY: f64 = 0.05;
/// Area of the rotor disc, m2.
pub const DISC_M2: f64 = 0.503;
/// Weight of the UAV, N.
pub const WEIGHT_N: f64 = 20.0;
/// Potential energy over the electrical energy of a climb; own choice, typical of the efficiencies of motor and
/// propeller.
pub const CLIMB_EFFICIENCY: f64 = 0.7;

/// Electrical power in level flight at an airspeed, W.
#[must_use]
pub fn level_w(airspeed_m_per_s: f64) -> f64 {
    let v2 = airspeed_m_per_s * airspeed_m_per_s;
    let blade_w = BLADE_W * (1.0 + 3.0 * v2 / (TIP_M_PER_S * TIP_M_PER_S));
    let x = v2 / (2.0 * INDUCED_M_PER_S * INDUCED_M_PER_S);
    // The difference of two nearly equal numbers in another form: sqrt(1 + x^2) - x = 1 / (sqrt(1 + x^2) + x).
    let induced_w = INDUCED_W / ((1.0 + x * x).sqrt() + x).sqrt();
    let drag_w = 0.5 * DRAG_RATIO * AIR_KG_PER_M3 * SOLIDITY * DISC_M2 * v2 * airspeed_m_per_s;
    blade_w + induced_w + drag_w
}

/// Electrical energy of a climb by `height_m`, J; 0 for a descent.
#[must_use]
pub fn climb_j(height_m: f64) -> f64 {
    WEIGHT_N * height_m.max(0.0) / CLIMB_EFFICIENCY
}

#[cfg(test)]
mod tests {
    use super::*;

    /// P_0 and P_i follow from the rotor of table I: profile drag 0.012, 300 rad/s, radius 0.4 m, excess of the
    /// induced power 0.1; v_0 = sqrt(W / (2 rho A)).
    #[test]
    fn the_constants_are_those_of_the_rotor() {
        let (omega, radius) = (300.0_f64, 0.4_f64);
        let blade = 0.012 / 8.0 * AIR_KG_PER_M3 * SOLIDITY * DISC_M2 * omega.powi(3) * radius.powi(3);
        assert!((blade - BLADE_W).abs() < 0.02, "{blade}");
        let disc = 2.0 * AIR_KG_PER_M3 * DISC_M2;
        let induced = 1.1 * WEIGHT_N.powf(1.5) / disc.sqrt();
        assert!((induced - INDUCED_W).abs() < 0.02, "{induced}");
        assert!(((WEIGHT_N / disc).sqrt() - INDUCED_M_PER_S).abs() < 0.005);
        assert!((omega * radius - TIP_M_PER_S).abs() < 1e-9);
    }

    /// At 10 m/s: 79.86 (1 + 300 / 14400) = 81.52375; x = 100 / 32.4818 = 3.078647,
    /// 88.63 (sqrt(10.478067) - 3.078647)^(1/2) = 35.2955; 0.5 0.6 1.225 0.05 0.503 1000 = 9.242625.
    #[test]
    fn powers_by_hand() {
        assert!((level_w(0.0) - 168.49).abs() < 1e-12);
        let x: f64 = 100.0 / 32.4818;
        let induced = 88.63 * ((1.0 + x * x).sqrt() - x).sqrt();
        assert!((level_w(10.0) - (81.52375 + induced + 9.242625)).abs() < 1e-9);
        assert!((level_w(10.0) - 126.1).abs() < 0.2, "{}", level_w(10.0));
        assert!((climb_j(70.0) - 2000.0).abs() < 1e-9 && climb_j(-5.0) == 0.0);
    }

    /// The paper's figure 2: least power near 10 m/s, least energy per distance near 18 m/s.
    #[test]
    fn endurance_and_range_have_their_speeds() {
        let tenths = || (1..400).map(|tenth| f64::from(tenth) * 0.1);
        let least = |of: fn(f64) -> f64| tenths().min_by(|a, b| of(*a).total_cmp(&of(*b))).unwrap();
        assert!((least(level_w) - 10.2).abs() < 0.4, "{}", least(level_w));
        let range = least(|v| level_w(v) / v);
        assert!((range - 18.3).abs() < 0.4, "{range}");
    }
}
