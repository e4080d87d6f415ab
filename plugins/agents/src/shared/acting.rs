//! Actions of a plan that has the routines `draw` and `choose`.

use contract::{Mode, Rng};
use plan::{Processor, State};
use rand::RngCore;

/// Entries of the output `drawn` in training, of the output `chosen` in evaluation, row by row.
///
/// # Panics
/// Where the plan lacks the routine or its output.
pub fn actions<'p>(
    plan: &'p mut Processor<f32>,
    mode: Mode,
    state: &mut State<f32>,
    rng: &mut Rng,
) -> &'p [f32] {
    match mode {
        Mode::Train => {
            plan.run_seeded("draw", state, rng.next_u64());
            plan.entries("drawn")
        }
        Mode::Evaluate => {
            plan.run("choose", state);
            plan.entries("chosen")
        }
    }
}
