//! The score of a configuration of switches after faults, and the best configuration.

use super::config::GridReconfigurationConfig;
use super::feeder::{LOADS, N_BUSES, N_LINES, N_SECTIONS, N_TRUNK};
use super::power_flow::Tree;

/// Operation of the feeder in a configuration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Operation {
    /// Active load of the supplied buses, kW.
    pub load_kw: f64,
    /// Losses of all lines, kW.
    pub losses_kw: f64,
    /// Lowest voltage of a supplied bus, relative to the substation's.
    pub lowest_voltage_pu: f64,
    /// Largest current of a line, relative to its limit.
    pub largest_loading: f64,
}

/// Active load of all buses, kW.
#[must_use]
pub fn total_load_kw() -> f64 {
    LOADS.iter().map(|load| load[0]).sum()
}

/// The switches and limits of a config.
#[derive(Debug, Clone, PartialEq)]
pub struct Switchgear {
    /// Lines with a switch, by their numbers, in the order of the choices.
    pub switches: Vec<usize>,
    lowest_voltage_pu: f64,
    trunk_limit_a: f64,
    line_limit_a: f64,
    loss_weight: f64,
}

impl Switchgear {
    /// The switches of a config, and the ties.
    #[must_use]
    pub fn of(config: &GridReconfigurationConfig) -> Self {
        Self {
            switches: config
                .switches
                .iter()
                .copied()
                .chain(N_SECTIONS + 1..=N_LINES)
                .collect(),
            lowest_voltage_pu: config.lowest_voltage_pu,
            trunk_limit_a: config.trunk_limit_a,
            line_limit_a: config.line_limit_a,
            loss_weight: config.loss_weight,
        }
    }

    /// Whether each line is closed: it has not failed, and its switch, if it has one, is closed (one entry of
    /// `closed` per switch).
    #[must_use]
    pub fn closed_lines(&self, closed: &[bool], failed: &[usize]) -> [bool; N_LINES] {
        let mut lines = [true; N_LINES];
        for (number, closed) in self.switches.iter().zip(closed) {
            lines[number - 1] = *closed;
        }
        for number in failed {
            lines[number - 1] = false;
        }
        lines
    }

    /// Operation of the feeder with these switches closed; `None` where the substation feeds a loop or the
    /// voltage collapses.
    #[must_use]
    pub fn operate(&self, closed: &[bool], failed: &[usize]) -> Option<Operation> {
        let tree = Tree::of(&self.closed_lines(closed, failed))?;
        let flow = tree.flow()?;
        let voltages = tree.buses().map(|bus| flow.voltage_pu(bus));
        let loadings = (0..N_LINES).map(|line| flow.current_a(line) / self.limit_a(line));
        Some(Operation {
            load_kw: tree.load_kw(),
            losses_kw: flow.losses_kw(),
            lowest_voltage_pu: voltages.fold(1.0, f64::min),
            largest_loading: loadings.fold(0.0, f64::max),
        })
    }

    fn limit_a(&self, line: usize) -> f64 {
        if line < N_TRUNK {
            self.trunk_limit_a
        } else {
            self.line_limit_a
        }
    }

    /// Whether voltages and currents are within their limits.
    #[must_use]
    pub fn is_within_limits(&self, operation: &Operation) -> bool {
        operation.lowest_voltage_pu >= self.lowest_voltage_pu && operation.largest_loading <= 1.0
    }

    /// The supplied fraction of all load, less the weighted losses as a fraction of it; 0 for a configuration
    /// that cannot operate within the limits.
    #[must_use]
    pub fn score(&self, operation: Option<&Operation>) -> f64 {
        match operation {
            Some(one) if self.is_within_limits(one) => {
                (one.load_kw - self.loss_weight * one.losses_kw) / total_load_kw()
            }
            _ => 0.0,
        }
    }

    /// All positions of the switches.
    pub fn configurations(&self) -> impl Iterator<Item = Vec<bool>> {
        let n = self.switches.len();
        (0..1_usize << n).map(move |bits| (0..n).map(|at| bits >> at & 1 == 1).collect())
    }

    /// The best configuration and its score, found by trying all of them; the first of equals.
    #[must_use]
    pub fn best(&self, failed: &[usize]) -> (Vec<bool>, f64) {
        let mut best = (vec![false; self.switches.len()], 0.0);
        for closed in self.configurations() {
            let score = self.score(self.operate(&closed, failed).as_ref());
            if score > best.1 {
                best = (closed, score);
            }
        }
        best
    }
}

// A tree has at most one line per bus but the substation.
const _: () = assert!(N_SECTIONS + 1 == N_BUSES);

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde_json::json;

    fn switchgear(values: serde_json::Value) -> Switchgear {
        Switchgear::of(&serde_json::from_value(values).unwrap())
    }

    fn open(gear: &Switchgear, closed: &[bool]) -> Vec<usize> {
        let pairs = gear.switches.iter().zip(closed);
        pairs
            .filter(|(_, closed)| !**closed)
            .map(|(number, _)| *number)
            .collect()
    }

    /// The problem of the paper: without faults the search over 1024 configurations ends at the best known one.
    #[test]
    fn without_faults_the_best_known_configuration_is_found() {
        let gear = switchgear(json!({ "switches": [7, 9, 14, 28, 32] }));
        let (closed, score) = gear.best(&[]);
        assert_eq!(open(&gear, &closed), [7, 9, 14, 32, 37]);
        assert!((score - (1.0 - 0.1 * 139.55 / 3715.0)).abs() < 1e-6, "{score}");
    }

    /// For every fault of one line and for that of the defaults: no configuration within the limits supplies
    /// more than the one with the best score, so that losses decide between equals only, and the base
    /// configuration is not better.
    #[test]
    fn the_best_score_supplies_the_most() {
        let gear = switchgear(json!({}));
        let base: Vec<bool> = gear.switches.iter().map(|number| *number <= N_SECTIONS).collect();
        for failed in (2..=N_SECTIONS).map(|line| vec![line]).chain([vec![3, 12]]) {
            let (closed, score) = gear.best(&failed);
            let supplied = gear.operate(&closed, &failed).unwrap().load_kw;
            let within = gear
                .configurations()
                .filter_map(|closed| gear.operate(&closed, &failed))
                .filter(|one| gear.is_within_limits(one));
            assert_eq!(
                supplied,
                within.map(|one| one.load_kw).fold(0.0, f64::max),
                "{failed:?}"
            );
            assert!(
                gear.score(gear.operate(&base, &failed).as_ref()) <= score,
                "{failed:?}"
            );
        }
    }

    /// Line 16 fails: buses 17 and 18 are supplied by tie 36 only, and every other tie stays open.
    #[test]
    fn one_fault_by_hand() {
        let gear = switchgear(json!({ "switches": [] }));
        let (closed, _) = gear.best(&[16]);
        assert_eq!(gear.switches, [33, 34, 35, 36, 37]);
        assert!(closed[3]);
        assert_eq!(gear.operate(&closed, &[16]).unwrap().load_kw, 3715.0);
        assert_eq!(gear.operate(&[false; 5], &[16]).unwrap().load_kw, 3715.0 - 150.0);
        assert_eq!(
            gear.operate(&[true, false, false, false, false], &[16]),
            None,
            "a loop"
        );
    }

    #[test]
    fn a_configuration_beyond_a_limit_scores_zero() {
        let base = |values: serde_json::Value| {
            let gear = switchgear(values);
            let closed: Vec<bool> = gear.switches.iter().map(|number| *number <= N_SECTIONS).collect();
            gear.score(gear.operate(&closed, &[]).as_ref())
        };
        assert!((base(json!({})) - (1.0 - 0.1 * 202.677 / 3715.0)).abs() < 1e-6);
        assert!(base(json!({ "lowest_voltage_pu": 0.913 })) > 0.9);
        assert_eq!(base(json!({ "lowest_voltage_pu": 0.9132 })), 0.0);
        // The first line carries 210.4 A, line 25 carries 65.4 A.
        assert!(base(json!({ "trunk_limit_a": 210.5, "line_limit_a": 65.5 })) > 0.9);
        assert_eq!(base(json!({ "trunk_limit_a": 210.0 })), 0.0);
        assert_eq!(base(json!({ "line_limit_a": 65.0 })), 0.0);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn no_more_than_all_is_supplied(bits in 0_usize..4096, failed in prop::collection::vec(1_usize..38, 0..4)) {
            let gear = switchgear(json!({}));
            let closed: Vec<bool> = (0..12).map(|at| bits >> at & 1 == 1).collect();
            let operation = gear.operate(&closed, &failed);
            let score = gear.score(operation.as_ref());
            prop_assert!((0.0..=1.0).contains(&score));
            if let Some(one) = operation {
                prop_assert!(one.load_kw <= total_load_kw() && one.losses_kw >= 0.0);
                prop_assert!(one.lowest_voltage_pu <= 1.0 && one.largest_loading >= 0.0);
            }
        }
    }
}
