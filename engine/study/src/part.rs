//! The parts of a cell: plugins with their complete configs, and the origin of each config.

use super::{schedule::ScheduleStretch, written::Target};
use contract::{own_training::Measured, part::Part};
use std::sync::{Arc, OnceLock};

/// A plugin with its complete config.
#[derive(Debug)]
pub struct ResolvedPart {
    /// The plugin with its complete config.
    pub part: Arc<Part>,
    /// Hash of the part, computed on the first request.
    id: OnceLock<String>,
    /// Origin of the config, to find the place of a mistake.
    pub given: ConfigOrigin,
}

impl ResolvedPart {
    /// A part with the origin of its config.
    #[must_use]
    pub fn new(part: Part, given: ConfigOrigin) -> Self {
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

/// The origin of a part's config: everything that changes it, other than its own section.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct ConfigOrigin {
    /// Target under which the study names the part.
    pub target: Target,
    /// Overrides that apply, by index.
    pub overrides: Vec<usize>,
    /// Dimensions of the sweep, each with the chosen point.
    pub points: Vec<(usize, usize)>,
    /// The search and the place of the setting that it tries.
    pub tried: Option<(usize, usize)>,
    /// The part of a schedule that a protocol takes.
    pub stretch: Option<ScheduleStretch>,
    /// The form in which a protocol is given to an agent.
    pub form: Form,
}

/// The training of an agent, which decides the keys of a protocol that concern it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Form {
    /// The protocol trains it. All parts but protocols have this form.
    Trained,
    /// The agent does not learn.
    Alone,
    /// It trains itself, and is measured in this way.
    Own(Option<Measured>),
}
