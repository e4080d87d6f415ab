//! Joint observations and actions of several seats in equations; the columns are those of [`JointLayout`].
//!
//! | paper | here | shape |
//! |---|---|---|
//! | s = (o_1, ..., o_N) | joint observation, the seats one after the other | `[batch, n_observed]` |
//! | a = (a_1, ..., a_N) | joint action, the seats one after the other | `[batch, n_acted]` |

use super::joint::JointLayout;
use plan::Expression;

impl JointLayout {
    /// Joint actions with the columns of one seat replaced by `action` `[batch, ..]`.
    #[must_use]
    pub fn exchanged<'e>(
        &self,
        joint: Expression<'e>,
        seat: usize,
        action: Expression<'e>,
    ) -> Expression<'e> {
        let part = |at| {
            if at == seat {
                action
            } else {
                joint.columns(self.acted(at))
            }
        };
        let parts: Vec<_> = (0..self.n_seats()).map(part).collect();
        joint.equations().join(&parts)
    }
}

#[cfg(test)]
mod tests {
    use super::super::coordination::interface;
    use super::*;
    use contract::Observation;
    use plan::{Equations, Processor, State};

    #[test]
    fn a_seat_is_exchanged() {
        let layout = JointLayout::new("x", &interface(&[1, 1, 1], &[1, 2, 1])).unwrap();
        let exchange = |seat, new: &[f64]| {
            let equations = Equations::new();
            let row = |entries: &[f64]| equations.constant([1, entries.len()], entries);
            equations.routine("exchange");
            let exchanged = layout.exchanged(row(&[1.0, 2.0, 3.0, 4.0]), seat, row(new));
            equations.output("exchanged", exchanged);
            let mut processor = Processor::<f32>::new(equations.into_graph());
            processor.run("exchange", &mut State::default());
            processor.entries("exchanged").to_vec()
        };
        assert_eq!(exchange(0, &[9.0]), [9.0, 2.0, 3.0, 4.0]);
        assert_eq!(exchange(1, &[8.0, 9.0]), [1.0, 8.0, 9.0, 4.0]);
        assert_eq!(exchange(2, &[9.0]), [1.0, 2.0, 3.0, 9.0]);
    }

    #[test]
    fn rows_are_the_seats_one_after_the_other() {
        let layout = JointLayout::new("x", &interface(&[2, 1], &[1, 1])).unwrap();
        let seen = |x: f64| Observation {
            seats: vec![vec![x, 2.0], vec![3.0]],
            state: Vec::new(),
        };
        assert_eq!(
            layout.observation_rows(&[seen(1.0), seen(7.0)]),
            [1.0, 2.0, 3.0, 7.0, 2.0, 3.0]
        );
    }
}
