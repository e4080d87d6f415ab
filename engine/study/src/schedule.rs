//! Schedules of settings, as populations find them. Each stretch is a cell of its own, whose protocol continues from
//! the checkpoint that the stretch before it left.

use super::search::LocatedSearch;
use document::Node;
use serde_json::{Value, json};

/// A part of a schedule, which begins at the first step or a checkpoint of another trial and ends at a pause or the
/// last step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct ScheduleStretch {
    /// The search, by its index.
    pub search: usize,
    /// Whether it continues from another stretch.
    pub goes_on: bool,
    /// The step at which it ends, if that is not the protocol's last.
    pub until: Option<u64>,
}

impl ScheduleStretch {
    /// The stretch of a setting of a population, by its place; `None` in other searches.
    pub(super) fn of(index: usize, searched: &LocatedSearch<'_>, place: usize) -> Option<Self> {
        let search = &searched.search;
        search.is_population().then(|| Self {
            search: index,
            goes_on: searched.parent(place).is_some(),
            until: search.compared_at(place),
        })
    }

    /// Writes the stretch into the config of a protocol.
    pub(super) fn assign(&self, name: &str, config: &mut Node) {
        let span = config.span;
        let mut set = |key: &str, value: Value| {
            if let Some(entry) = config.entry_or_insert(key, span) {
                entry.value = Node::from_value(span, &value);
            }
        };
        if self.goes_on {
            set("go_on_from", json!({ "from": name }));
        }
        if let Some(step) = self.until {
            set("steps", json!(step));
            set("leave_checkpoint", json!(true));
        }
    }
}
