//! Config of the `grid_reconfiguration` environment.

use super::feeder::{N_LINES, N_SECTIONS};
use contract::{Error, Preset, Rng};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

/// Most sectionalising switches: with the ties 2^13 configurations.
const MOST_SWITCHES: usize = 8;
/// Most faults that are drawn.
const MOST_DRAWN: usize = 4;

/// Settings of the `grid_reconfiguration` environment. Lines have the numbers of the paper: 1 to 32, ties 33 to
/// 37.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GridReconfigurationConfig {
    /// Lines that have failed in every episode, from 2 to 37.
    pub failed_lines: Vec<usize>,
    /// Number of further lines that fail, drawn for each episode among the intact lines 2 to 32, with equal
    /// probability for each set.
    #[schemars(range(min = 0, max = 4))]
    pub drawn_faults: usize,
    /// Lines from 2 to 32 that have a switch, at most eight; the five ties always have one.
    pub switches: Vec<usize>,
    /// Lowest voltage of a supplied bus, relative to the substation's.
    #[schemars(
        range(min = 0.5, max = 1.0),
        extend("x-unit" = "p.u.", "x-source" = "MATPOWER, case33bw")
    )]
    pub lowest_voltage_pu: f64,
    /// The largest current of the lines 1 to 5, which carry the whole feeder. The paper gives none; the base
    /// Largest current of the lines 1 to 5, which carry the whole feeder. The paper gives none; the base
    /// configuration has 210 A.
    #[schemars(range(min = 1.0, max = 10000.0), extend("x-unit" = "A"))]
    pub trunk_limit_a: f64,
    /// Largest current of all other lines. The paper gives none; the base configuration has 65 A.
    #[schemars(range(min = 1.0, max = 10000.0), extend("x-unit" = "A"))]
    pub line_limit_a: f64,
    /// Weight of a kW of losses relative to a kW of supplied load. With 0.1, losses decide only between
    /// configurations that supply the same load.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub loss_weight: f64,
}

impl Default for GridReconfigurationConfig {
    fn default() -> Self {
        Self {
            failed_lines: vec![3, 12],
            drawn_faults: 0,
            switches: vec![7, 9, 14, 24, 28, 30, 32],
            lowest_voltage_pu: 0.9,
            trunk_limit_a: 250.0,
            line_limit_a: 100.0,
            loss_weight: 0.1,
        }
    }
}

impl contract::Config for GridReconfigurationConfig {
    fn presets() -> Vec<Preset> {
        let preset = |name, about, values| Preset { name, about, values };
        vec![
            preset(
                "lines_3_12",
                "two lines failed (the defaults): 1480 of 3715 kW remain, one of 4096 designs supplies 3655 kW",
                json!({}),
            ),
            preset(
                "line_22",
                "one line failed; one of 4096 designs supplies all load",
                json!({ "failed_lines": [22] }),
            ),
            preset(
                "line_2",
                "a line failed behind which most load lies; at most 1755 kW can be supplied",
                json!({ "failed_lines": [2] }),
            ),
            preset(
                "one_drawn",
                "one line of 31 fails, drawn anew for every episode",
                json!({ "failed_lines": [], "drawn_faults": 1 }),
            ),
            preset(
                "two_drawn",
                "two lines fail, of 465 pairs, drawn anew for every episode",
                json!({ "failed_lines": [], "drawn_faults": 2 }),
            ),
            preset(
                "least_losses",
                "the paper's problem: no fault, all load with the least losses; best known with 7, 9, 14, 32 and 37 \
                 open",
                json!({ "failed_lines": [], "loss_weight": 1.0 }),
            ),
        ]
    }
}

impl GridReconfigurationConfig {
    /// Checks lines and limits.
    ///
    /// # Errors
    /// [`Error::Config`] for a line that does not exist, may not be named there or is named twice, for too many
    /// switches or faults, and for a limit outside its range.
    pub fn check(&self) -> Result<(), Error> {
        check_lines("failed_lines", &self.failed_lines, N_LINES)?;
        check_lines("switches", &self.switches, N_SECTIONS)?;
        if self.switches.len() > MOST_SWITCHES {
            let problem = format!("{} switches; name at most {MOST_SWITCHES}", self.switches.len());
            return Err(Error::config("switches", problem));
        }
        if self.drawn_faults > MOST_DRAWN {
            let problem = format!("{} faults; draw at most {MOST_DRAWN}", self.drawn_faults);
            return Err(Error::config("drawn_faults", problem));
        }
        if self.whole_sections().len() < self.drawn_faults {
            return Err(Error::config(
                "drawn_faults",
                "more faults than lines 2 to 32 that are whole",
            ));
        }
        self.check_limits()
    }

    fn check_limits(&self) -> Result<(), Error> {
        let ranges = [
            ("lowest_voltage_pu", self.lowest_voltage_pu, 0.5, 1.0),
            ("trunk_limit_a", self.trunk_limit_a, 1.0, 10_000.0),
            ("line_limit_a", self.line_limit_a, 1.0, 10_000.0),
            ("loss_weight", self.loss_weight, 0.0, 1.0),
        ];
        for (key, value, least, most) in ranges {
            if !(least..=most).contains(&value) {
                return Err(Error::config(key, format!("{value} is not in {least} to {most}")));
            }
        }
        Ok(())
    }

    /// The lines that fail in an episode, in order.
    pub(super) fn draw_faults(&self, rng: &mut Rng) -> Vec<usize> {
        let mut whole = self.whole_sections();
        let mut failed = self.failed_lines.clone();
        for _ in 0..self.drawn_faults {
            failed.push(whole.swap_remove(rng.random_range(0..whole.len())));
        }
        failed.sort_unstable();
        failed
    }

    fn whole_sections(&self) -> Vec<usize> {
        (2..=N_SECTIONS)
            .filter(|line| !self.failed_lines.contains(line))
            .collect()
    }
}

fn check_lines(key: &str, lines: &[usize], last: usize) -> Result<(), Error> {
    for (index, line) in lines.iter().enumerate() {
        let key = format!("{key}[{index}]");
        if !(2..=last).contains(line) {
            return Err(Error::config(
                key,
                format!("{line} is not one of the lines 2 to {last}"),
            ));
        }
        if lines[..index].contains(line) {
            return Err(Error::config(key, format!("line {line} is named twice")));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(values: serde_json::Value) -> GridReconfigurationConfig {
        serde_json::from_value(values).unwrap()
    }

    #[test]
    fn impossible_configs_are_refused() {
        for (values, text) in [
            (
                json!({ "failed_lines": [1] }),
                "`failed_lines[0]`: 1 is not one of the lines 2 to 37",
            ),
            (
                json!({ "failed_lines": [4, 5, 4] }),
                "`failed_lines[2]`: line 4 is named twice",
            ),
            (
                json!({ "switches": [33] }),
                "`switches[0]`: 33 is not one of the lines 2 to 32",
            ),
            (
                json!({ "switches": [2, 3, 4, 5, 6, 7, 8, 9, 10] }),
                "9 switches; name at most 8",
            ),
            (json!({ "drawn_faults": 5 }), "5 faults; draw at most 4"),
            (
                json!({ "failed_lines": (2..=32).collect::<Vec<usize>>(), "drawn_faults": 1 }),
                "more faults than lines",
            ),
            (
                json!({ "lowest_voltage_pu": 1.1 }),
                "`lowest_voltage_pu`: 1.1 is not in 0.5 to 1",
            ),
            (
                json!({ "line_limit_a": 0.0 }),
                "`line_limit_a`: 0 is not in 1 to 10000",
            ),
        ] {
            let refusal = config(values).check().unwrap_err().to_string();
            assert!(refusal.contains(text), "{refusal}");
        }
    }

    #[test]
    fn faults_are_drawn_among_whole_lines_and_all_of_them_occur() {
        let two = config(json!({ "failed_lines": [9, 36], "drawn_faults": 2 }));
        let mut rng = contract::random::stream(&["faults"]);
        let mut seen = [0; N_LINES + 1];
        for _ in 0..2000 {
            let failed = two.draw_faults(&mut rng);
            assert!(
                failed.len() == 4 && failed.is_sorted_by(|a, b| a < b),
                "{failed:?}"
            );
            failed.iter().for_each(|line| seen[*line] += 1);
        }
        assert_eq!((seen[1], seen[9], seen[36], seen[33]), (0, 2000, 2000, 0));
        // Each of 30 lines is expected 133 times, with a standard deviation of 11.
        assert!(
            (2..=32)
                .filter(|line| *line != 9)
                .all(|line| (80..200).contains(&seen[line]))
        );
    }
}
