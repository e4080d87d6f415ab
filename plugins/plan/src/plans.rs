//! Processors of one set of equations, by the number of rows for which they were compiled.

use crate::equations::Equations;
use crate::processor::Processor;

/// Largest number of processors that are kept.
const KEPT: usize = 4;

/// Processors for numbers of rows, the most recently used one at the end.
#[derive(Debug, Clone, Default)]
pub struct Plans(Vec<(usize, Processor<f32>)>);

impl Plans {
    /// The processor for a number of rows. `write` writes its equations if there is none yet.
    pub fn of_rows(&mut self, rows: usize, write: impl FnOnce(&Equations)) -> &mut Processor<f32> {
        let found = self.0.iter().position(|(others, _)| *others == rows);
        let last = found.map_or_else(
            || {
                let equations = Equations::new();
                write(&equations);
                (rows, Processor::new(equations.into_graph()))
            },
            |at| self.0.remove(at),
        );
        if self.0.len() == KEPT {
            self.0.remove(0);
        }
        self.0.push(last);
        let at = self.0.len() - 1;
        &mut self.0[at].1
    }
}
