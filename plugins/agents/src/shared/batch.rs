//! Batches of transitions, as rows on the host and as inputs of equations.

use plan::{Equations, Expression, Plans, Processor};

/// Columns of each part of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BatchWidths {
    /// Entries of the joint observation.
    pub observed: usize,
    /// Entries of the joint action.
    pub acted: usize,
    /// Number of seats.
    pub seats: usize,
}

/// Transitions, each part row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Batch {
    /// Number of transitions.
    pub n_rows: usize,
    /// Observations of all seats.
    pub observations: Vec<f32>,
    /// Actions of all seats.
    pub actions: Vec<f32>,
    /// Rewards of each seat.
    pub rewards: Vec<f32>,
    /// Next observations of all seats.
    pub next_observations: Vec<f32>,
    /// 0 after a terminal step, else 1.
    pub continues: Vec<f32>,
}

impl Batch {
    /// Writes the inputs that [`BatchInputs::new`] has added.
    pub fn write(&self, processor: &mut Processor<f32>) {
        self.write_named("", processor);
    }

    /// Writes the inputs that [`BatchInputs::named`] has added.
    pub fn write_named(&self, prefix: &str, processor: &mut Processor<f32>) {
        for (name, entries) in [
            ("observations", &self.observations),
            ("actions", &self.actions),
            ("rewards", &self.rewards),
            ("next_observations", &self.next_observations),
            ("continues", &self.continues),
        ] {
            processor.write(&format!("{prefix}{name}"), entries);
        }
    }
}

/// A batch in equations.
#[derive(Debug, Clone, Copy)]
pub struct BatchInputs<'e> {
    /// Observations of all seats, `[rows, observed]`.
    pub observations: Expression<'e>,
    /// Actions of all seats, `[rows, acted]`.
    pub actions: Expression<'e>,
    /// Rewards of each seat, `[rows, seats]`.
    pub rewards: Expression<'e>,
    /// Next observations of all seats, `[rows, observed]`.
    pub next_observations: Expression<'e>,
    /// 0 after a terminal step, else 1, `[rows, 1]`.
    pub continues: Expression<'e>,
}

impl<'e> BatchInputs<'e> {
    /// Adds the inputs of a batch.
    #[must_use]
    pub fn new(equations: &'e Equations, rows: usize, widths: BatchWidths) -> Self {
        Self::named("", equations, rows, widths)
    }

    /// Adds the inputs of one batch of several, with names that begin with `prefix`.
    #[must_use]
    pub fn named(prefix: &str, equations: &'e Equations, rows: usize, widths: BatchWidths) -> Self {
        let input = |name: &str, columns: usize| equations.input(&format!("{prefix}{name}"), [rows, columns]);
        Self {
            observations: input("observations", widths.observed),
            actions: input("actions", widths.acted),
            rewards: input("rewards", widths.seats),
            next_observations: input("next_observations", widths.observed),
            continues: input("continues", 1),
        }
    }
}

/// The plan for a batch of so many rows, with the equations that `write` writes where they are not compiled yet.
pub fn plan_of(
    plans: &mut Plans,
    n_rows: usize,
    widths: BatchWidths,
    write: impl FnOnce(BatchInputs<'_>),
) -> &mut Processor<f32> {
    plans.of_rows(n_rows, |equations| {
        write(BatchInputs::new(equations, n_rows, widths));
    })
}
