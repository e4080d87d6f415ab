//! The parts of a cell: plugins with their complete configs, and the origin of each config.

use super::{schedule::Stretch, written::Target};
use contract::{own_training::Measured, part::Part};
use std::sync::{Arc, OnceLock};

/// A plugin with its complete config.
#[derive(Debug)]
pub struct Resolved {
    /// The plugin with its complete config.
    pub part: Arc<Part>,
    /// Hash of the part, once it was asked for.
    id: OnceLock<String>,
    /// Origin of the config, to find the place of a mistake.
    pub given: Given,
}

impl Resolved {
    /// A part with the origin of its config.
    #[must_use]
    pub fn new(part: Part, given: Given) -> Self {
        Self {
            part: part.into(),
            id: OnceLock::new(),
            given,
        }
    }

    /// The hash of the part.
    #[must_use]
    pub fn id(&self) -> &str {
        self.id.get_or_init(|| self.part.id())
    }
}

/// The origin of a part's config: all that changes it besides its own section.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Given {
    /// The part.
    pub target: Target,
    /// Overrides that apply, by index.
    pub overrides: Vec<usize>,
    /// Dimensions of the sweep with the point taken.
    pub points: Vec<(usize, usize)>,
    /// A search with the setting taken.
    pub tried: Option<(usize, usize)>,
    /// The part of a schedule that a protocol takes.
    pub stretch: Option<Stretch>,
    /// The form in which a protocol is given to an agent.
    pub form: Form,
}

/// How an agent comes to its policy, which decides the keys of a protocol that concern it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Form {
    /// The protocol trains it. All parts but protocols have this form.
    Trained,
    /// It does not learn.
    Alone,
    /// It trains itself, and is measured in this way.
    Own(Option<Measured>),
}
