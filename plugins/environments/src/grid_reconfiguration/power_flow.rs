//! Power flow of the supplied part of the feeder, by backward and forward sweeps.
//!
//! | symbol | here | unit |
//! |---|---|---|
//! | S_i | load of bus i, all phases | MVA |
//! | V_i | voltage of bus i between phases | kV |
//! | Z | impedance of a line | ohm |
//! | J | sqrt(3) times the current of a phase of a line | kA |
//!
//! Backward, from the leaves: J of the line that feeds bus i is conj(S_i / V_i) plus J of all lines that leave
//! bus i. Forward, from the substation: V_i = V_parent - Z J. Both are repeated until no voltage moves by more
//! than 1e-12 of that of the substation. With this J, S = V conj(J), and a line loses Re(Z) |J|^2 in its three
//! phases together.

use super::feeder::{LINES, LOADS, N_BUSES, N_LINES, VOLTAGE_KV};
use nalgebra::Complex;

/// Largest change of a voltage at which sweeps end, relative to the voltage of the substation.
const TOLERANCE: f64 = 1e-12;
/// Number of sweeps after which the voltage counts as collapsed.
const MOST_SWEEPS: usize = 200;

/// A line that feeds a bus; all indices count from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Feed {
    line: usize,
    parent: usize,
    bus: usize,
}

/// The supplied buses as a tree.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tree {
    /// Lines in an order in which every bus comes after the one that feeds it.
    feeds: Vec<Feed>,
}

/// Voltages and currents of a tree.
#[derive(Debug, Clone, PartialEq)]
pub struct Flow {
    voltages_kv: [Complex<f64>; N_BUSES],
    /// J of every line; 0 where none flows.
    currents: [Complex<f64>; N_LINES],
}

impl Tree {
    /// The tree that these closed lines (one entry per line) span from the substation; `None` where they close
    /// a supplied loop. Loops without supply carry no current and do not matter.
    #[must_use]
    pub fn of(closed: &[bool; N_LINES]) -> Option<Self> {
        let mut feeds: Vec<Feed> = Vec::with_capacity(N_BUSES);
        let mut is_fed = [false; N_BUSES];
        is_fed[0] = true;
        let (mut bus, mut fed_by) = (0, None);
        for next in 0.. {
            for (line, other) in neighbours(closed, bus).filter(|(line, _)| Some(*line) != fed_by) {
                if std::mem::replace(&mut is_fed[other], true) {
                    return None;
                }
                feeds.push(Feed {
                    line,
                    parent: bus,
                    bus: other,
                });
            }
            let Some(feed) = feeds.get(next) else { break };
            (bus, fed_by) = (feed.bus, Some(feed.line));
        }
        Some(Self { feeds })
    }

    /// Active load of the supplied buses, kW.
    #[must_use]
    pub fn load_kw(&self) -> f64 {
        self.feeds.iter().map(|feed| LOADS[feed.bus][0]).sum()
    }

    /// The supplied buses, the substation first.
    pub fn buses(&self) -> impl Iterator<Item = usize> {
        [0].into_iter().chain(self.feeds.iter().map(|feed| feed.bus))
    }

    /// Voltages and currents; `None` where the voltage collapses.
    #[must_use]
    pub fn flow(&self) -> Option<Flow> {
        let mut flow = Flow {
            voltages_kv: [Complex::new(VOLTAGE_KV, 0.0); N_BUSES],
            currents: [Complex::new(0.0, 0.0); N_LINES],
        };
        for _ in 0..MOST_SWEEPS {
            self.sweep_backward(&mut flow);
            if self.sweep_forward(&mut flow) <= TOLERANCE {
                return Some(flow);
            }
        }
        None
    }

    fn sweep_backward(&self, flow: &mut Flow) {
        let mut leaving = [Complex::new(0.0, 0.0); N_BUSES];
        for feed in self.feeds.iter().rev() {
            let drawn = (load_mva(feed.bus) / flow.voltages_kv[feed.bus]).conj();
            flow.currents[feed.line] = drawn + leaving[feed.bus];
            leaving[feed.parent] += flow.currents[feed.line];
        }
    }

    /// Returns the largest change of a voltage relative to the substation's; `NaN` once any is.
    fn sweep_forward(&self, flow: &mut Flow) -> f64 {
        let mut largest = 0.0;
        for feed in &self.feeds {
            let voltage = flow.voltages_kv[feed.parent] - impedance_ohm(feed.line) * flow.currents[feed.line];
            let moved = size(voltage - flow.voltages_kv[feed.bus]) / VOLTAGE_KV;
            // `f64::max` would ignore NaN.
            if moved > largest || moved.is_nan() {
                largest = moved;
            }
            flow.voltages_kv[feed.bus] = voltage;
        }
        largest
    }
}

/// The closed lines at a bus, each with the bus at its other end.
fn neighbours(closed: &[bool; N_LINES], bus: usize) -> impl Iterator<Item = (usize, usize)> {
    let other_end = move |line: usize| {
        let [one, two] = LINES[line].buses.map(|number| number - 1);
        match bus {
            _ if bus == one => Some((line, two)),
            _ if bus == two => Some((line, one)),
            _ => None,
        }
    };
    (0..N_LINES).filter(|&line| closed[line]).filter_map(other_end)
}

fn load_mva(bus: usize) -> Complex<f64> {
    let [active_kw, reactive_kvar] = LOADS[bus];
    Complex::new(active_kw / 1000.0, reactive_kvar / 1000.0)
}

fn impedance_ohm(line: usize) -> Complex<f64> {
    Complex::new(LINES[line].resistance_ohm, LINES[line].reactance_ohm)
}

/// Not `Complex::norm`, which calls `hypot` of the C library.
fn size(number: Complex<f64>) -> f64 {
    number.norm_sqr().sqrt()
}

impl Flow {
    /// Magnitude of the voltage of a bus, relative to the substation's.
    #[must_use]
    pub fn voltage_pu(&self, bus: usize) -> f64 {
        size(self.voltages_kv[bus]) / VOLTAGE_KV
    }

    /// Current of a phase of a line, A.
    #[must_use]
    pub fn current_a(&self, line: usize) -> f64 {
        1000.0 * (self.currents[line].norm_sqr() / 3.0).sqrt()
    }

    /// Losses of all lines, kW.
    #[must_use]
    pub fn losses_kw(&self) -> f64 {
        let lost_mw = |line: usize| LINES[line].resistance_ohm * self.currents[line].norm_sqr();
        1000.0 * (0..N_LINES).map(lost_mw).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn all_but(open: &[usize]) -> [bool; N_LINES] {
        std::array::from_fn(|line| !open.contains(&(line + 1)))
    }

    fn tree(open: &[usize]) -> Tree {
        Tree::of(&all_but(open)).unwrap()
    }

    fn lowest(flow: &Flow) -> (usize, f64) {
        let voltages = (0..N_BUSES).map(|bus| (bus + 1, flow.voltage_pu(bus)));
        voltages.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap()
    }

    /// Losses of 202.68 kW, and 0.9131 at bus 18 as the lowest voltage.
    #[test]
    fn the_first_configuration_loses_what_is_published() {
        let ties = tree(&[33, 34, 35, 36, 37]);
        let flow = ties.flow().unwrap();
        assert_eq!(ties.load_kw(), 3715.0);
        assert!((flow.losses_kw() - 202.68).abs() < 0.005, "{}", flow.losses_kw());
        let (bus, voltage) = lowest(&flow);
        assert_eq!(bus, 18);
        assert!((voltage - 0.9131).abs() < 0.00005, "{voltage}");
    }

    /// The least known losses of any configuration: 139.55 kW, with a lowest voltage of 0.9378.
    #[test]
    fn the_best_known_configuration_loses_what_is_published() {
        let flow = tree(&[7, 9, 14, 32, 37]).flow().unwrap();
        assert!((flow.losses_kw() - 139.55).abs() < 0.005, "{}", flow.losses_kw());
        let (bus, voltage) = lowest(&flow);
        assert_eq!(bus, 32);
        assert!((voltage - 0.9378).abs() < 0.00005, "{voltage}");
    }

    #[test]
    fn loops_are_found_where_they_are_fed() {
        assert_eq!(Tree::of(&[true; N_LINES]), None);
        assert_eq!(
            Tree::of(&all_but(&[33, 34, 36, 37])),
            None,
            "tie 35 closes a loop"
        );
        // Lines 9 to 14 and tie 34 form a loop; without lines 8, 33, 35 and 15 it has no supply.
        let dark = tree(&[8, 15, 33, 35, 36, 37]);
        assert!(dark.buses().all(|bus| !(8..15).contains(&bus)));
        let nothing = tree(&[1]);
        assert_eq!((nothing.load_kw(), nothing.buses().count()), (0.0, 1));
    }

    /// The line to bus 2 alone, 0.0922 + j 0.047 ohm with 100 kW and 60 kvar: the exact solution of
    /// |V|^4 + (2 Re(conj(Z) S) - V_0^2) |V|^2 + |Z S|^2 = 0.
    #[test]
    fn one_line_by_hand() {
        let flow = tree(&[2, 18]).flow().unwrap();
        let half = (VOLTAGE_KV * VOLTAGE_KV - 2.0 * (0.0922 * 0.1 + 0.047 * 0.06)) / 2.0;
        let squared =
            half + (half * half - (0.0922_f64.powi(2) + 0.047_f64.powi(2)) * (0.01 + 0.0036)).sqrt();
        assert!((flow.voltage_pu(1) - squared.sqrt() / VOLTAGE_KV).abs() < 1e-13);
        let amperes = 1000.0 * (0.0136 / squared / 3.0).sqrt();
        assert!((flow.current_a(0) - amperes).abs() < 1e-9, "{amperes}");
    }

    /// The first `count` lines in this order that close no loop.
    fn without_loops(order: &[usize], count: usize) -> [bool; N_LINES] {
        let mut parts: [usize; N_BUSES] = std::array::from_fn(|bus| bus);
        let mut closed = [false; N_LINES];
        let mut left = count;
        for &line in order {
            let [one, two] = LINES[line].buses.map(|number| parts[number - 1]);
            if one != two && left > 0 {
                parts
                    .iter_mut()
                    .filter(|part| **part == two)
                    .for_each(|part| *part = one);
                closed[line] = true;
                left -= 1;
            }
        }
        closed
    }

    proptest! {
        /// The power of the substation equals loads plus losses, active and reactive, in any tree.
        #[test]
        fn power_is_balanced(
            order in Just((0..N_LINES).collect::<Vec<_>>()).prop_shuffle(),
            count in 20_usize..33,
        ) {
            let tree = Tree::of(&without_loops(&order, count)).unwrap();
            let flow = tree.flow();
            prop_assume!(flow.is_some());
            let flow = flow.unwrap();
            let given: Complex<f64> = tree
                .feeds
                .iter()
                .filter(|feed| feed.parent == 0)
                .map(|feed| flow.voltages_kv[0] * flow.currents[feed.line].conj())
                .sum();
            let drawn: Complex<f64> = tree.feeds.iter().map(|feed| load_mva(feed.bus)).sum();
            let lost: Complex<f64> = tree
                .feeds
                .iter()
                .map(|feed| impedance_ohm(feed.line) * flow.currents[feed.line].norm_sqr())
                .sum();
            prop_assert!(size(given - drawn - lost) < 1e-9, "{} MVA", size(given - drawn - lost));
            prop_assert!((lost.re * 1000.0 - flow.losses_kw()).abs() < 1e-9);
            prop_assert!((drawn.re * 1000.0 - tree.load_kw()).abs() < 1e-9);
            prop_assert!(tree.buses().all(|bus| flow.voltage_pu(bus) <= 1.0));
        }
    }
}
