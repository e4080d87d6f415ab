//! The 33-bus test feeder: M. E. Baran and F. F. Wu, "Network reconfiguration in distribution systems for loss
//! reduction and load balancing", IEEE Transactions on Power Delivery 4 (1989) 1401-1407.
//!
//! One substation at bus 1 feeds 32 loads over lines 1 to 32, which form a tree; five tie lines, 33 to 37, are
//! open in the paper's first configuration. Loads draw constant power. Numbers are those in wide use (for
//! example in MATPOWER's `case33bw`), where line 7 from bus 7 to 8 has 0.7114 + j 0.2351 ohm.

/// Voltage between phases at the substation, in kV.
pub const VOLTAGE_KV: f64 = 12.66;
/// Number of buses; bus 1, the substation, has index 0.
pub const N_BUSES: usize = 33;
/// Number of lines, ties included; line 1 has index 0.
pub const N_LINES: usize = 37;
/// Number of lines that form the tree; the ties follow.
pub const N_SECTIONS: usize = 32;
/// Lines from the substation to the first fork behind bus 6, which carry the whole feeder but its short laterals.
pub const N_TRUNK: usize = 5;

/// A line between two buses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Buses at both ends, counted from 1 as in the paper.
    pub buses: [usize; 2],
    /// Resistance of a phase.
    pub resistance_ohm: f64,
    /// Reactance of a phase.
    pub reactance_ohm: f64,
}

const fn line(from: usize, to: usize, resistance_ohm: f64, reactance_ohm: f64) -> Line {
    Line {
        buses: [from, to],
        resistance_ohm,
        reactance_ohm,
    }
}

/// Lines 1 to 32 in order, then the ties 33 to 37.
pub const LINES: [Line; N_LINES] = [
    line(1, 2, 0.0922, 0.0470),
    line(2, 3, 0.4930, 0.2511),
    line(3, 4, 0.3660, 0.1864),
    line(4, 5, 0.3811, 0.1941),
    line(5, 6, 0.8190, 0.7070),
    line(6, 7, 0.1872, 0.6188),
    line(7, 8, 0.7114, 0.2351),
    line(8, 9, 1.0300, 0.7400),
    line(9, 10, 1.0440, 0.7400),
    line(10, 11, 0.1966, 0.0650),
    line(11, 12, 0.3744, 0.1238),
    line(12, 13, 1.4680, 1.1550),
    line(13, 14, 0.5416, 0.7129),
    line(14, 15, 0.5910, 0.5260),
    line(15, 16, 0.7463, 0.5450),
    line(16, 17, 1.2890, 1.7210),
    line(17, 18, 0.7320, 0.5740),
    line(2, 19, 0.1640, 0.1565),
    line(19, 20, 1.5042, 1.3554),
    line(20, 21, 0.4095, 0.4784),
    line(21, 22, 0.7089, 0.9373),
    line(3, 23, 0.4512, 0.3083),
    line(23, 24, 0.8980, 0.7091),
    line(24, 25, 0.8960, 0.7011),
    line(6, 26, 0.2030, 0.1034),
    line(26, 27, 0.2842, 0.1447),
    line(27, 28, 1.0590, 0.9337),
    line(28, 29, 0.8042, 0.7006),
    line(29, 30, 0.5075, 0.2585),
    line(30, 31, 0.9744, 0.9630),
    line(31, 32, 0.3105, 0.3619),
    line(32, 33, 0.3410, 0.5302),
    line(21, 8, 2.0000, 2.0000),
    line(9, 15, 2.0000, 2.0000),
    line(12, 22, 2.0000, 2.0000),
    line(18, 33, 0.5000, 0.5000),
    line(25, 29, 0.5000, 0.5000),
];

/// Active and reactive load of every bus, in kW and kvar.
pub const LOADS: [[f64; 2]; N_BUSES] = [
    [0.0, 0.0],
    [100.0, 60.0],
    [90.0, 40.0],
    [120.0, 80.0],
    [60.0, 30.0],
    [60.0, 20.0],
    [200.0, 100.0],
    [200.0, 100.0],
    [60.0, 20.0],
    [60.0, 20.0],
    [45.0, 30.0],
    [60.0, 35.0],
    [60.0, 35.0],
    [120.0, 80.0],
    [60.0, 10.0],
    [60.0, 20.0],
    [60.0, 20.0],
    [90.0, 40.0],
    [90.0, 40.0],
    [90.0, 40.0],
    [90.0, 40.0],
    [90.0, 40.0],
    [90.0, 50.0],
    [420.0, 200.0],
    [420.0, 200.0],
    [60.0, 25.0],
    [60.0, 25.0],
    [60.0, 20.0],
    [120.0, 70.0],
    [200.0, 600.0],
    [150.0, 70.0],
    [210.0, 100.0],
    [60.0, 40.0],
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_loads_sum_to_the_published_total() {
        let total = LOADS
            .iter()
            .fold([0.0, 0.0], |sum, load| [sum[0] + load[0], sum[1] + load[1]]);
        assert_eq!(total, [3715.0, 2300.0]);
    }
}
