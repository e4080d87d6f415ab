//! State that a plan keeps between runs, by name: parameters, moments, numbers of steps, and numbers such as learning
//! rates. One state serves every processor whose graph has its names and shapes, for any number of rows.

use crate::executor::{Executor, Member, or_panic};
use crate::graph::Shape;
use crate::scalar::Scalar;
use crate::tensor::Tensor;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// A state that does not fit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum StateError {
    /// No parameter or moment has this name.
    Missing {
        /// Name that was looked up.
        name: String,
    },
    /// Another shape.
    Shape {
        /// Name of the parameter or moment.
        name: String,
        /// Shape in the state.
        expected: Shape,
        /// Given shape.
        found: Vec<usize>,
    },
}

impl std::fmt::Display for StateError {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            StateError::Missing { name } => write!(f, "there is no `{name}`"),
            StateError::Shape {
                name,
                expected,
                found,
            } => write!(f, "`{name}` has the shape {found:?}, not {expected:?}"),
        }
    }
}

impl std::error::Error for StateError {}

/// Parameters, moments and counts of one learner.
#[derive(Debug)]
pub struct State<T> {
    tensors: Vec<Tensor<T>>,
    /// Steps of each parameter's optimiser.
    counts: BTreeMap<String, u64>,
    /// Numbers that differ from those of the graph.
    numbers: BTreeMap<String, f64>,
    /// The state in the memory of an executor.
    member: Option<Arc<dyn Member>>,
}

impl<T> Default for State<T> {
    fn default() -> Self {
        Self {
            tensors: Vec::new(),
            counts: BTreeMap::new(),
            numbers: BTreeMap::new(),
            member: None,
        }
    }
}

/// A copy is no member of an executor.
impl<T: Scalar> Clone for State<T> {
    fn clone(&self) -> Self {
        Self {
            tensors: self.tensors.clone(),
            counts: self.counts.clone(),
            numbers: self.numbers.clone(),
            member: None,
        }
    }
}

impl<T: Scalar> State<T> {
    /// Adds a parameter, or replaces it.
    ///
    /// # Panics
    /// If the number of entries is not that of the shape.
    pub fn insert(&mut self, name: impl Into<String>, shape: Shape, entries: Vec<T>) {
        let name = name.into();
        assert_eq!(
            entries.len(),
            shape[0] * shape[1],
            "entries of `{name}` {shape:?}"
        );
        self.tensors.retain(|tensor| tensor.name != name);
        self.tensors.push(Tensor::new(name, shape, entries));
    }

    /// Adds copies of all parameters and moments whose names begin with `from` and a dot, with `to` in place of `from`,
    /// and of the numbers of their steps.
    pub fn copy(&mut self, from: &str, to: &str) {
        let rest = |name: &str| Some(name.strip_prefix(from)?.strip_prefix('.')?.to_owned());
        let copies: Vec<_> = self
            .tensors
            .iter()
            .filter_map(|tensor| Some((rest(&tensor.name)?, tensor.shape, tensor.entries().to_vec())))
            .collect();
        for (rest, shape, entries) in copies {
            self.insert(format!("{to}.{rest}"), shape, entries);
        }
        let counts = self.counts.iter();
        let counts: Vec<_> = counts
            .filter_map(|(name, count)| Some((rest(name)?, *count)))
            .collect();
        for (rest, count) in counts {
            self.counts.insert(format!("{to}.{rest}"), count);
        }
    }

    /// Name, shape and entries of every parameter and moment.
    pub fn tensors(&self) -> impl Iterator<Item = (&str, Shape, &[T])> {
        let tensors = self.tensors.iter();
        tensors.map(|tensor| (tensor.name.as_str(), tensor.shape, tensor.entries()))
    }

    /// Shape and entries of a parameter or moment.
    #[must_use]
    pub fn tensor(&self, name: &str) -> Option<(Shape, &[T])> {
        let found = self.tensors.iter().find(|tensor| tensor.name == name)?;
        Some((found.shape, found.entries()))
    }

    /// Entries of a parameter or moment.
    ///
    /// # Panics
    /// If there is none with that name.
    #[must_use]
    pub fn entries(&self, name: &str) -> &[T] {
        let found = self.tensor(name);
        found.unwrap_or_else(|| panic!("no parameter `{name}`")).1
    }

    /// Entries of a parameter or moment, for modification.
    ///
    /// # Panics
    /// If there is none with that name.
    pub fn entries_mut(&mut self, name: &str) -> &mut [T] {
        let found = self.tensors.iter_mut().find(|tensor| tensor.name == name);
        let tensor = found.unwrap_or_else(|| panic!("no parameter `{name}`"));
        tensor.buffer()
    }

    /// Replaces the entries of an existing parameter or moment.
    ///
    /// # Errors
    /// [`StateError`] if the name or the shape does not fit.
    ///
    /// # Panics
    /// If the number of entries is not that of the shape.
    pub fn replace(&mut self, name: &str, shape: &[usize], entries: Vec<T>) -> Result<(), StateError> {
        let Some((expected, _)) = self.tensor(name) else {
            return Err(StateError::Missing { name: name.into() });
        };
        if shape != expected {
            return Err(StateError::Shape {
                name: name.into(),
                expected,
                found: shape.to_vec(),
            });
        }
        assert_eq!(
            entries.len(),
            expected[0] * expected[1],
            "entries of `{name}` {expected:?}"
        );
        self.entries_mut(name).copy_from_slice(&entries);
        Ok(())
    }

    /// Number of steps that the optimiser of a parameter has made.
    #[must_use]
    pub fn steps(&self, parameter: &str) -> u64 {
        self.counts.get(parameter).copied().unwrap_or(0)
    }

    /// Parameters with the numbers of steps of their optimisers.
    #[must_use]
    pub fn counts(&self) -> &BTreeMap<String, u64> {
        &self.counts
    }

    /// Removes all optimisers: their moments and their numbers of steps.
    pub fn forget_optimisers(&mut self) {
        let moments: BTreeSet<String> = self
            .counts
            .keys()
            .flat_map(|parameter| [format!("{parameter}.first"), format!("{parameter}.second")])
            .collect();
        self.tensors.retain(|tensor| !moments.contains(&tensor.name));
        self.counts.clear();
    }

    /// Replaces the numbers of steps.
    pub fn set_counts(&mut self, counts: BTreeMap<String, u64>) {
        self.counts = counts;
    }

    /// Changes a number of the graph for the following runs.
    pub fn set_number(&mut self, name: &str, to: f64) {
        self.numbers.insert(name.to_owned(), to);
    }

    /// A number that [`State::set_number`] has changed.
    #[must_use]
    pub fn number(&self, name: &str) -> Option<f64> {
        self.numbers.get(name).copied()
    }

    /// The state in `f64`, for comparisons of gradients with finite differences.
    #[must_use]
    pub fn widened(&self) -> State<f64> {
        let wide = |tensor: &Tensor<T>| {
            let entries = tensor.entries().iter().map(|entry| entry.wide()).collect();
            Tensor::new(tensor.name.clone(), tensor.shape, entries)
        };
        State {
            tensors: self.tensors.iter().map(wide).collect(),
            counts: self.counts.clone(),
            numbers: self.numbers.clone(),
            member: None,
        }
    }

    /// The state as a member of an executor, with the newest entries of the tensors at some places.
    pub(crate) fn brought(&mut self, executor: &Arc<dyn Executor>, places: &[usize]) -> Arc<dyn Member> {
        let tensors = &self.tensors;
        let member = self.member.get_or_insert_with(|| {
            let shapes: Vec<_> = tensors.iter().map(|it| (it.name.as_str(), it.shape)).collect();
            or_panic(executor.admit(&shapes))
        });
        for place in places {
            self.tensors[*place].bring(member);
        }
        Arc::clone(member)
    }

    /// Place of a parameter, or of a moment, which is added as zeros if it is missing.
    pub(crate) fn place(&mut self, name: &str, shape: Shape, is_moment: bool) -> usize {
        let found = self.tensors.iter().position(|tensor| tensor.name == name);
        let place = found.unwrap_or_else(|| {
            assert!(is_moment, "no parameter `{name}`");
            self.insert(name, shape, vec![T::default(); shape[0] * shape[1]]);
            self.tensors.len() - 1
        });
        let there = self.tensors[place].shape;
        assert_eq!(there, shape, "`{name}` of the state and of the graph");
        place
    }

    /// Whether a place holds a tensor of this name and shape.
    pub(crate) fn is_at(&self, place: usize, name: &str, shape: Shape) -> bool {
        let tensor = self.tensors.get(place);
        tensor.is_some_and(|tensor| tensor.name == name && tensor.shape == shape)
    }

    pub(crate) fn at_mut(&mut self, place: usize) -> &mut Tensor<T> {
        &mut self.tensors[place]
    }

    pub(crate) fn count_step(&mut self, parameter: &str) -> u64 {
        if let Some(count) = self.counts.get_mut(parameter) {
            *count += 1;
            return *count;
        }
        self.counts.insert(parameter.to_owned(), 1);
        1
    }
}
