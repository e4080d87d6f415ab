//! Members whose states have one shape. A tensor lies at the same offset in the state of each member, followed by space
//! for its moments.

use plan::Shape;
use plan::cuda::Kernels;
use plan::executor::Lost;
use std::collections::BTreeMap;
use std::ops::Range;

/// Tensors begin at multiples of this number of entries, 128 bytes.
const ALIGNMENT: usize = 32;

/// Suffixes of the names of a parameter's moments.
const MOMENTS: [&str; 2] = [".first", ".second"];

/// Members whose states have one shape.
#[derive(Debug)]
pub struct Cohort {
    parameters: Vec<(String, Shape)>,
    places: BTreeMap<String, Range<usize>>,
    state_size: usize,
    /// Numbers of members that have left.
    free: Vec<u32>,
    n_members: u32,
}

impl Cohort {
    /// A cohort without members for states with these tensors.
    #[must_use]
    pub fn new(tensors: &[(String, Shape)]) -> Self {
        let parameters = parameters(tensors);
        let (mut places, mut state_size) = (BTreeMap::new(), 0);
        for (name, [rows, columns]) in &parameters {
            for end in ["", MOMENTS[0], MOMENTS[1]] {
                let length = rows * columns;
                places.insert(format!("{name}{end}"), state_size..state_size + length);
                state_size += length.next_multiple_of(ALIGNMENT);
            }
        }
        Self {
            parameters,
            places,
            state_size,
            free: Vec::new(),
            n_members: 0,
        }
    }

    /// Whether states with these tensors belong to it. Moments may be present or absent.
    #[must_use]
    pub fn takes(&self, tensors: &[(String, Shape)]) -> bool {
        parameters(tensors) == self.parameters
    }

    /// A new member's number: the lowest free one, or one more than the largest.
    pub fn admit(&mut self) -> u32 {
        self.free.pop().unwrap_or_else(|| {
            self.n_members += 1;
            self.n_members - 1
        })
    }

    /// Frees the number of a member.
    pub fn dismiss(&mut self, member: u32) {
        self.free.push(member);
        self.free.sort_unstable_by(|a, b| b.cmp(a));
    }

    /// Entries of a member's state.
    #[must_use]
    pub fn state_size(&self) -> usize {
        self.state_size
    }

    /// Number of present members.
    #[must_use]
    pub fn n_members(&self) -> usize {
        self.n_members as usize - self.free.len()
    }

    /// Number of members with a place, including those that have left.
    #[must_use]
    pub fn n_places(&self) -> usize {
        self.n_members as usize
    }

    /// Entries of a tensor in a member's state.
    ///
    /// # Errors
    /// [`Lost`] if no state of the cohort has it.
    pub fn tensor(&self, name: &str) -> Result<Range<usize>, Lost> {
        let found = self.places.get(name).cloned();
        found.ok_or_else(|| Lost {
            reason: format!("the learner's state has no tensor `{name}`"),
        })
    }

    /// First entry of each tensor of a routine.
    ///
    /// # Errors
    /// [`Lost`] if no state of the cohort has it.
    pub fn tensors(&self, kernels: &Kernels) -> Result<Vec<u32>, Lost> {
        let first = |name: &str| {
            let first = self.tensor(name)?.start;
            u32::try_from(first).map_err(|_| Lost {
                reason: format!("a learner's state of {} numbers is too large", self.state_size),
            })
        };
        kernels.tensors.iter().map(|leaf| first(&leaf.name)).collect()
    }
}

/// All tensors by name, without the moments of others.
fn parameters(tensors: &[(String, Shape)]) -> Vec<(String, Shape)> {
    let is_there = |name: &str| tensors.iter().any(|(other, _)| other == name);
    let is_moment = |name: &str| {
        MOMENTS
            .iter()
            .any(|end| name.strip_suffix(end).is_some_and(is_there))
    };
    let mut parameters: Vec<_> = tensors
        .iter()
        .filter(|(name, _)| !is_moment(name))
        .cloned()
        .collect();
    parameters.sort();
    parameters
}
