//! Changes of parameters: Adam, moving averages, assignments; clipping of gradients before them.
//!
//! Updates take place in the order of their routine: an operation added after an update reads the new entries.

use crate::graph::{Graph, Number, Value};
use crate::operations::Operation;

/// Settings of Adam (Kingma and Ba 2015), with the epsilon of the paper, 1e-8.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Optimiser {
    /// Step size, a number that a caller may change between runs.
    pub learning_rate: Number,
    /// Decay rates of the two moments.
    pub betas: [f64; 2],
}

impl Optimiser {
    /// Settings with a learning rate and the decay rates of the paper, 0.9 and 0.999.
    #[must_use]
    pub fn new(learning_rate: Number) -> Self {
        Self {
            learning_rate,
            betas: [0.9, 0.999],
        }
    }
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Update {
    Adam {
        parameter: Value,
        gradient: Value,
        moments: [Value; 2],
        settings: Optimiser,
    },
    Follow {
        target: Value,
        source: Value,
        tau: f64,
    },
    Assign {
        target: Value,
        source: Value,
    },
}

impl Update {
    /// The parameter that changes.
    pub(crate) fn target(&self) -> Value {
        match self {
            Update::Adam { parameter, .. } => *parameter,
            Update::Follow { target, .. } | Update::Assign { target, .. } => *target,
        }
    }

    /// The value that is read.
    pub(crate) fn source(&self) -> Value {
        match self {
            Update::Adam { gradient, .. } => *gradient,
            Update::Follow { source, .. } | Update::Assign { source, .. } => *source,
        }
    }

    pub(crate) fn operands(&self) -> Vec<Value> {
        vec![self.target(), self.source()]
    }

    /// The moments that change with the parameter.
    pub(crate) fn moments(&self) -> Vec<Value> {
        match self {
            Update::Adam { moments, .. } => moments.to_vec(),
            Update::Follow { .. } | Update::Assign { .. } => Vec::new(),
        }
    }
}

impl Graph {
    /// One step of Adam, as defined in `arithmetic::steps`. The moments belong to the parameter and are named after it,
    /// `NAME.first` and `NAME.second`; the state counts its steps. Several steps of one parameter share them.
    ///
    /// # Panics
    /// If `parameter` is no parameter, the gradient has another shape or is the parameter itself, or another value has
    /// the name of a moment.
    pub fn adam(&mut self, parameter: Value, gradient: Value, settings: Optimiser) {
        let name = self.check_update("Adam", parameter, gradient);
        let shape = self.shape(parameter);
        let moments = ["first", "second"].map(|moment| {
            let name = format!("{name}.{moment}");
            let is_moment = |value: &Value| self.nodes[value.0].operation == Operation::State;
            let same = self.named(&name).filter(is_moment);
            same.unwrap_or_else(|| self.leaf(Operation::State, &name, shape))
        });
        self.update(Update::Adam {
            parameter,
            gradient,
            moments,
            settings,
        });
    }

    /// Moves a parameter: `target <- target + tau (source - target)`.
    ///
    /// # Panics
    /// If `target` is no parameter, or the source has another shape or is the target itself.
    pub fn follow(&mut self, target: Value, source: Value, tau: f64) {
        self.check_update("Follow", target, source);
        self.update(Update::Follow { target, source, tau });
    }

    /// Copies a value to a parameter.
    ///
    /// # Panics
    /// If `target` is no parameter, or the source has another shape or is the target itself.
    pub fn assign(&mut self, target: Value, source: Value) {
        self.check_update("Assign", target, source);
        self.update(Update::Assign { target, source });
    }

    /// Gradients scaled down to a joint Euclidean norm of at most `largest`, each multiplied by `largest / norm`,
    /// computed in `f64` and rounded, or by 1. No gradient passes through the factor.
    #[must_use]
    pub fn clip_norm(&mut self, gradients: &[Value], largest: f64) -> Vec<Value> {
        let scale = self.compute(Operation::ClipScale { largest }, gradients.to_vec(), [1, 1]);
        gradients
            .iter()
            .map(|gradient| self.mul(*gradient, scale))
            .collect()
    }

    /// Checks an update and returns the name of the parameter that it changes.
    fn check_update(&self, update: &str, target: Value, source: Value) -> String {
        let node = &self.nodes[target.0];
        assert!(
            node.operation == Operation::Parameter && node.shape == self.shape(source) && target != source,
            "{update} of {} by {}",
            self.shown(target),
            self.shown(source)
        );
        // Leaves have names.
        node.name.clone().unwrap_or_default()
    }
}
