//! Schedules of settings, as populations find them: every stretch of one is a cell of its own, whose protocol
//! goes on from the checkpoint that the stretch before left.

use super::search::LocatedSearch;
use document::Node;
use serde_json::{Value, json};

/// A part of a schedule: from the checkpoint of another trial, or the first step, to a pause or the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct ScheduleStretch {
    /// The search, by its index.
    pub search: usize,
    /// Whether it goes on from another one.
    pub goes_on: bool,
    /// The step at which it ends, where that is not the protocol's last.
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
