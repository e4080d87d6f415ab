//! The five published components: deterioration, costs, and outcomes of replacements and inspections.

/// Damage states; the last one is failure.
pub const N_STATES: usize = 4;
/// The state of a failed component.
pub const FAILED: usize = N_STATES - 1;
/// Components of the published system.
pub const N_COMPONENTS: usize = 5;

/// Probabilities of the next state (columns) by state (rows).
pub type Matrix = [[f64; N_STATES]; N_STATES];

/// A component's deterioration, costs and accuracies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Component {
    /// Probabilities of deterioration within a step, from the working states; failed components stay failed.
    pub deterioration: [[f64; N_STATES]; FAILED],
    /// Cost of a replacement.
    pub replacement_cost: f64,
    /// Cost of an inspection.
    pub inspection_cost: f64,
    /// Probability that a replacement makes the component new; otherwise it stays as before.
    pub replacement_accuracy: f64,
    /// Probability q that an inspection shows the true state.
    pub inspection_accuracy: f64,
}

/// The components of "hard-k-of-5" in imprl.
pub const COMPONENTS: [Component; N_COMPONENTS] = [
    Component {
        deterioration: [
            [0.82, 0.13, 0.05, 0.0],
            [0.0, 0.87, 0.09, 0.04],
            [0.0, 0.0, 0.91, 0.09],
        ],
        replacement_cost: 30.0,
        inspection_cost: 20.0,
        replacement_accuracy: 1.0,
        inspection_accuracy: 0.8,
    },
    Component {
        deterioration: [
            [0.72, 0.19, 0.09, 0.0],
            [0.0, 0.78, 0.18, 0.04],
            [0.0, 0.0, 0.85, 0.15],
        ],
        replacement_cost: 90.0,
        inspection_cost: 40.0,
        replacement_accuracy: 0.9,
        inspection_accuracy: 0.85,
    },
    Component {
        deterioration: [
            [0.79, 0.17, 0.04, 0.0],
            [0.0, 0.85, 0.09, 0.06],
            [0.0, 0.0, 0.91, 0.09],
        ],
        replacement_cost: 80.0,
        inspection_cost: 25.0,
        replacement_accuracy: 0.95,
        inspection_accuracy: 0.9,
    },
    Component {
        deterioration: [
            [0.8, 0.12, 0.08, 0.0],
            [0.0, 0.83, 0.12, 0.05],
            [0.0, 0.0, 0.89, 0.11],
        ],
        replacement_cost: 250.0,
        inspection_cost: 50.0,
        replacement_accuracy: 0.85,
        inspection_accuracy: 0.95,
    },
    Component {
        deterioration: [
            [0.88, 0.12, 0.0, 0.0],
            [0.0, 0.9, 0.1, 0.0],
            [0.0, 0.0, 0.93, 0.07],
        ],
        replacement_cost: 350.0,
        inspection_cost: 100.0,
        replacement_accuracy: 0.8,
        inspection_accuracy: 0.8,
    },
];

/// The published components with `wear` times their probabilities of leaving a state.
///
/// `wear` is at most 3, so that probabilities stay below 1.
#[must_use]
pub fn worn(wear: f64) -> [Component; N_COMPONENTS] {
    COMPONENTS.map(|component| component.worn(wear))
}

impl Component {
    fn worn(self, wear: f64) -> Self {
        // The published numbers themselves, to the bit.
        if wear == 1.0 {
            return self;
        }
        let row = |from: usize| {
            let mut moves = self.deterioration[from].map(|p| p * wear);
            moves[from] = 0.0;
            moves[from] = 1.0 - moves.iter().sum::<f64>();
            moves
        };
        Self {
            deterioration: std::array::from_fn(row),
            ..self
        }
    }

    /// Probabilities of the state one step later, by the present state: `D`, and `R D` after a replacement.
    #[must_use]
    pub fn transition(&self, replaced: bool) -> Matrix {
        let [new, worn, bad] = self.deterioration;
        let d = [new, worn, bad, [0.0, 0.0, 0.0, 1.0]];
        if !replaced {
            return d;
        }
        let accuracy = self.replacement_accuracy;
        d.map(|row| std::array::from_fn(|to| accuracy * d[0][to] + (1.0 - accuracy) * row[to]))
    }

    /// Probability of each reading (columns) by state (rows) after a step. A failure always shows; for working
    /// components an inspection shows the state or a neighbour of it, and without an inspection the reading is
    /// uninformative.
    #[must_use]
    pub fn readings(&self, inspected: bool) -> Matrix {
        let failed = [0.0, 0.0, 0.0, 1.0];
        if !inspected {
            let nothing = [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0, 0.0];
            return [nothing, nothing, nothing, failed];
        }
        let q = self.inspection_accuracy;
        let half = (1.0 - q) / 2.0;
        [
            [q, 1.0 - q, 0.0, 0.0],
            [half, q, half, 0.0],
            [0.0, 1.0 - q, q, 0.0],
            failed,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    /// `tests/fixtures/component_replacement/imprl_tables.csv`: component, action (0 nothing, 1 replace, 2 inspect),
    /// state; next-state and reading probabilities.
    #[test]
    fn the_published_tables_are_met() {
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
            .join("../../tests/fixtures/component_replacement/imprl_tables.csv");
        let mut compared = 0;
        for record in csv::Reader::from_path(path).unwrap().records() {
            let row: Vec<f64> = record.unwrap().iter().map(|cell| cell.parse().unwrap()).collect();
            let at = |column: usize| row[column] as usize;
            let (component, action, state) = (&COMPONENTS[at(0)], at(1), at(2));
            let ours = [
                component.transition(action == 1)[state],
                component.readings(action == 2)[state],
            ]
            .concat();
            assert!(
                ours.iter().zip(&row[3..]).all(|(a, b)| (a - b).abs() < 1e-15),
                "{row:?} {ours:?}"
            );
            compared += 1;
        }
        assert_eq!(compared, 60);
    }

    #[test]
    fn wear_moves_what_leaves_a_state_and_nothing_else() {
        assert_eq!(worn(1.0), COMPONENTS);
        let [first, ..] = worn(2.0);
        let expected = [0.64, 0.26, 0.1, 0.0];
        assert!(
            first.deterioration[0]
                .iter()
                .zip(expected)
                .all(|(a, b)| (a - b).abs() < 1e-15)
        );
        assert_eq!(first.replacement_cost, COMPONENTS[0].replacement_cost);
        assert!(
            worn(0.0)
                .iter()
                .all(|one| one.deterioration[0] == [1.0, 0.0, 0.0, 0.0])
        );
    }

    #[test]
    fn every_row_is_a_distribution() {
        for component in COMPONENTS.iter().chain(&worn(3.0)).chain(&worn(0.4)) {
            for flag in [false, true] {
                let rows = [component.transition(flag), component.readings(flag)].concat();
                assert!(
                    rows.iter()
                        .all(|row| (row.iter().sum::<f64>() - 1.0).abs() < 1e-15),
                    "{rows:?}"
                );
            }
        }
    }
}
