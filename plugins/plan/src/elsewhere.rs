//! Routines that another executor runs instead of the processor.

use crate::cuda::{Kernels, size};
use crate::executor::{Executor, or_panic};
use crate::graph::{Graph, Routine};
use crate::memory::Memory;
use crate::scalar::Scalar;
use crate::state::State;
use std::any::Any;
use std::sync::Arc;

/// Kernels by the routine's place; `None` inside if a routine has no kernels.
#[derive(Debug, Clone, Default)]
pub(crate) struct Elsewhere(Vec<Option<Option<Arc<Kernels>>>>);

impl Elsewhere {
    /// Runs a routine on an executor; false if it has no kernels, or the precision is not `f32`.
    pub(crate) fn run<T: Scalar>(
        &mut self,
        executor: &Arc<dyn Executor>,
        graph: &Graph,
        routine: Routine,
        memory: &mut Memory<T>,
        state: &mut State<T>,
        seed: u64,
    ) -> bool {
        let Some(state) = (state as &mut dyn Any).downcast_mut::<State<f32>>() else {
            return false;
        };
        self.0.resize(graph.routines.len(), None);
        let kernels =
            self.0[routine.0].get_or_insert_with(|| Kernels::new(graph, routine).ok().map(Arc::new));
        let Some(kernels) = kernels else {
            return false;
        };
        let words = kernels.prepare(state, seed);
        let places: Vec<usize> = kernels
            .tensors
            .iter()
            .map(|leaf| state.place(&leaf.name, leaf.shape, leaf.is_moment))
            .collect();
        let member = state.brought(executor, &places);
        let outputs = or_panic(member.run(kernels, &words, &inputs(kernels, graph, memory)));
        for (leaf, place) in kernels.tensors.iter().zip(places) {
            if leaf.is_changed {
                state.at_mut(place).has_changed_away();
            }
        }
        for span in &kernels.outputs {
            // Every span has the name of a value.
            let value = graph
                .named(&span.name)
                .unwrap_or_else(|| unreachable!("`{}`", span.name));
            let entries = memory.of_mut(value).iter_mut();
            for (to, from) in entries.zip(&outputs[span.range()]) {
                *to = T::of(f64::from(*from));
            }
        }
        true
    }
}

/// All inputs of a routine.
#[allow(clippy::cast_possible_truncation, reason = "the precision is f32")]
fn inputs<T: Scalar>(kernels: &Kernels, graph: &Graph, memory: &Memory<T>) -> Vec<f32> {
    let mut inputs = Vec::with_capacity(size(&kernels.inputs));
    for span in &kernels.inputs {
        let value = graph.named(&span.name);
        let entries = value.map_or(&[][..], |value| memory.of(value));
        inputs.extend(entries.iter().map(|entry| entry.wide() as f32));
    }
    inputs
}
