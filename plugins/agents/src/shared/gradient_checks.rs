//! Gradients of losses in the equations of learners against central differences in `f64`, for tests.

use super::batch::Batch;
use numerics::equations::network::Network;
use plan::{Equations, Expression, State, differences::largest_error};

/// Asserts that the gradients of the output `loss` of the routine `loss` in all parameters of some networks agree with
/// central differences. `write` writes the inputs of a batch, the routine and the output.
pub fn assert_gradient(
    networks: &[&Network],
    state: &State<f32>,
    batch: &Batch,
    write: impl FnOnce(&Equations),
) {
    let networks = networks.iter();
    let names: Vec<String> = networks.flat_map(|network| network.parameter_names()).collect();
    assert_gradient_in(&names, state, batch, write);
}

/// As [`assert_gradient`], in the parameters of these names.
pub fn assert_gradient_in(
    names: &[String],
    state: &State<f32>,
    batch: &Batch,
    write: impl FnOnce(&Equations),
) {
    let equations = Equations::new();
    write(&equations);
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let wide = |entries: &[f32]| entries.iter().map(|x| f64::from(*x)).collect::<Vec<f64>>();
    let graph = equations.into_graph();
    let inputs = [
        ("observations", wide(&batch.observations)),
        ("actions", wide(&batch.actions)),
        ("rewards", wide(&batch.rewards)),
        ("next_observations", wide(&batch.next_observations)),
        ("continues", wide(&batch.continues)),
    ];
    let error = largest_error(graph, ["loss", "loss"], &names, &state.widened(), &inputs, 3);
    assert!(error < 1e-6, "{names:?}: {error:e}");
}

/// Outputs of a routine of equations that are written for a batch.
pub fn outputs<const N: usize>(
    names: [&str; N],
    state: &State<f32>,
    batch: &Batch,
    write: impl FnOnce(&Equations),
) -> [Vec<f32>; N] {
    let equations = Equations::new();
    write(&equations);
    let mut processor = plan::Processor::<f32>::new(equations.into_graph());
    batch.write(&mut processor);
    processor.run_seeded("loss", &mut state.clone(), 3);
    names.map(|name| processor.entries(name).to_vec())
}

/// Entries of an expression without inputs and parameters.
pub fn computed(write: impl for<'e> FnOnce(&'e Equations) -> Expression<'e>) -> Vec<f32> {
    let equations = Equations::new();
    equations.routine("computed");
    // The expression may be a leaf.
    equations.output("computed", write(&equations) * 1.0);
    let mut processor = plan::Processor::<f32>::new(equations.into_graph());
    processor.run_seeded("computed", &mut State::default(), 3);
    processor.entries("computed").to_vec()
}
