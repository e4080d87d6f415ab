//! Searched keys that something else sets as well, and choices that a search would try twice.

use super::{overrides::Override, search::LocatedSearch, sweep::comparable};
use analysis::search::Range;
use document::diagnostic::{Diagnostic, Sources};

/// Keys that a search has twice or an override sets as well, and values that a choice has twice.
pub fn overlaps(
    searches: &[LocatedSearch<'_>],
    overrides: &[Override<'_>],
    sources: &Sources,
) -> Vec<Diagnostic> {
    let mut found = Vec::new();
    for searched in searches {
        let keys = searched.search.keys.iter().zip(&searched.paths);
        for (index, ((key, range), path)) in keys.enumerate() {
            let at = format!("tune.{}.over.{key}", searched.search.name);
            let error = |message: String| sources.error(path.span, &at, message);
            let earlier = &searched.paths[..index];
            if let Some(other) = earlier.iter().find(|other| other.overlaps(path)) {
                let error = error(format!("`{key}` is searched twice"));
                found.push(error.note("it is searched first here", sources.place(other.span)));
            }
            let mut set = overrides.iter().flat_map(|it| &it.set);
            if let Some((_, other, _)) = set.find(|(_, other, _)| other.overlaps(path)) {
                let error = error(format!("`{key}` is searched and overridden"));
                let note = error.note("it is overridden here", sources.place(other.span));
                found.push(note.help("leave one of the two out"));
            }
            if let Some(value) = chosen_twice(range) {
                let error = error(format!("`{key}` has the choice {value} twice"));
                found.push(error.help("write it once: its trials would be the same ones"));
            }
        }
    }
    found
}

/// The first value that a choice has a second time, with 1 and 1.0 as one value.
fn chosen_twice(range: &Range) -> Option<&serde_json::Value> {
    let Range::Choice(values) = range else {
        return None;
    };
    let same = |value: &serde_json::Value| comparable(value.clone());
    values
        .iter()
        .enumerate()
        .find(|(at, value)| values[..*at].iter().any(|earlier| same(earlier) == same(value)))
        .map(|(_, value)| value)
}
