//! Heads of policies, which compute an action from the outputs of a network, and the graph of a whole policy
//! file.

use super::{Dense, Graph, Setting, Value, dense_layers};
use crate::policy_file::{Head, PREFIX, Policy, PolicyHeader};
use crate::tensor_file::TensorFileError;

impl Policy {
    /// Graph of the policy, from an observation in the units of the channels to an action in its units.
    ///
    /// # Errors
    /// [`TensorFileError`] for a network without layers.
    pub fn graph(&self) -> Result<Graph, TensorFileError> {
        let PolicyHeader {
            activations,
            center,
            spread,
            outputs,
            head,
            action_center,
            action_spread,
            ..
        } = &self.header;
        let layers = with_first_outputs(dense_layers(self.parameters(), PREFIX)?, outputs.len());
        let n_acted = head.n_entries(outputs.len());
        let (mut graph, observation) = Graph::of_observation(center.len());
        let x = graph.scaled(&observation, center, spread);
        let x = graph.network(&x, &layers, activations);
        let action = graph.head(&x, *head);
        // An index has one entry, in the first of the units; [`Policy::act`] does the same.
        let units = |numbers: &[f64]| numbers[..n_acted.min(numbers.len())].to_vec();
        let action = graph.in_units(&action, &units(action_center), &units(action_spread));
        Ok(graph.acting(&action, n_acted))
    }
}

/// The layers, the last of which keeps only its first `n` outputs.
#[must_use]
pub fn with_first_outputs(mut layers: Vec<Dense>, n: usize) -> Vec<Dense> {
    if let Some(last) = layers.last_mut() {
        *last = last.first_outputs(n);
    }
    layers
}

impl Head {
    /// Number of entries of the action for `n` outputs.
    #[must_use]
    pub fn n_entries(self, n: usize) -> usize {
        if self == Head::Argmax { 1 } else { n }
    }
}

impl Graph {
    /// Action `[batch, m]` from outputs `[batch, n]`.
    pub fn head(&mut self, x: &Value, head: Head) -> Value {
        match head {
            Head::DirichletMean => {
                let softplus = self.softplus(x);
                let one = self.constant("one", &[1], &[1.0]);
                let alpha = self.node("Add", &[&softplus, &one], &[]);
                self.shares(&alpha)
            }
            Head::DirichletMode => {
                let softplus = self.softplus(x);
                self.shares(&softplus)
            }
            Head::SoftmaxMean => self.node("Softmax", &[x], &[("axis", Setting::Int(1))]),
            Head::Tanh => self.node("Tanh", &[x], &[]),
            Head::Argmax => {
                let settings = [("axis", Setting::Int(1)), ("keepdims", Setting::Int(1))];
                let index = self.node("ArgMax", &[x], &settings);
                self.node("Cast", &[&index], &[("to", Setting::Int(super::FLOAT.into()))])
            }
            Head::Identity => x.clone(),
        }
    }

    /// Softplus `ln(1 + e^x)` as `max(x, 0) + 2 artanh(t / (2 + t))` with `t = e^-|x|`.
    fn softplus(&mut self, x: &Value) -> Value {
        let magnitude = self.node("Abs", &[x], &[]);
        let negative = self.node("Neg", &[&magnitude], &[]);
        let t = self.node("Exp", &[&negative], &[]);
        let two = self.constant("two", &[1], &[2.0]);
        let below = self.node("Add", &[&t, &two], &[]);
        let ratio = self.node("Div", &[&t, &below], &[]);
        let half = self.node("Atanh", &[&ratio], &[]);
        let logarithm = self.node("Mul", &[&half, &two], &[]);
        let positive = self.node("Relu", &[x], &[]);
        self.node("Add", &[&positive, &logarithm], &[])
    }

    /// Each entry divided by the sum of its row.
    fn shares(&mut self, x: &Value) -> Value {
        let columns = self.positions("columns", &[1], &[1]);
        let total = self.node("ReduceSum", &[x, &columns], &[("keepdims", Setting::Int(1))]);
        self.node("Div", &[x, &total], &[])
    }
}
