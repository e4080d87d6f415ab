//! Entries of a parameter or a moment, which are stored here, with a member of an executor, or in both places.

use crate::executor::{Member, or_panic};
use crate::graph::Shape;
use crate::scalar::Scalar;
use std::sync::{Arc, OnceLock};

/// A parameter or a moment.
#[derive(Debug)]
pub(crate) struct Tensor<T> {
    pub(crate) name: String,
    pub(crate) shape: Shape,
    here: OnceLock<Vec<T>>,
    /// The member that has the newest entries.
    away: Option<Arc<dyn Member>>,
}

impl<T: Scalar> Tensor<T> {
    pub(crate) fn new(name: String, shape: Shape, entries: Vec<T>) -> Self {
        Self {
            name,
            shape,
            here: OnceLock::from(entries),
            away: None,
        }
    }

    /// Entries, which are fetched if they are not here.
    pub(crate) fn entries(&self) -> &[T] {
        self.here.get_or_init(|| {
            // Without a member the entries are here.
            let read = self.away.as_ref().map(|member| member.read(&self.name));
            let entries = or_panic(read.unwrap_or_else(|| Ok(Vec::new())));
            entries.into_iter().map(|entry| T::of(f64::from(entry))).collect()
        })
    }

    /// The memory here, which has the newest entries from now on.
    pub(crate) fn buffer(&mut self) -> &mut Vec<T> {
        let _ = self.entries();
        self.away = None;
        // The line above filled it.
        self.here
            .get_mut()
            .unwrap_or_else(|| unreachable!("entries of `{}`", self.name))
    }

    /// Writes the entries to a member that does not have them.
    #[allow(clippy::cast_possible_truncation, reason = "states of members are f32")]
    pub(crate) fn bring(&mut self, member: &Arc<dyn Member>) {
        if self.away.is_none() {
            let entries: Vec<f32> = self.entries().iter().map(|entry| entry.wide() as f32).collect();
            or_panic(member.write(&self.name, &entries));
            self.away = Some(Arc::clone(member));
        }
    }

    /// Notes that the member has changed the entries.
    pub(crate) fn has_changed_away(&mut self) {
        self.here = OnceLock::new();
    }
}

/// A copy is stored here, and does not belong to the member.
impl<T: Scalar> Clone for Tensor<T> {
    fn clone(&self) -> Self {
        Self {
            name: self.name.clone(),
            shape: self.shape,
            here: OnceLock::from(self.entries().to_vec()),
            away: None,
        }
    }
}
