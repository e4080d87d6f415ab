//! What figures read of a search: the settings that went to their ends, as places in their ranges.

use super::build::{Context, problem};
use analysis::{
    results::{SearchResult, TriedSetting},
    search::Range,
};
use contract::Error;

/// Settings that went to their ends.
pub(super) struct Searched<'a> {
    pub(super) result: &'a SearchResult,
    /// The place of each setting in the order in which they were tried.
    pub(super) places: Vec<usize>,
    /// Where the values of each setting lie between the ends of their ranges, from 0 to 1 `[setting][key]`.
    pub(super) shares: Vec<Vec<f64>>,
    /// The mean over seeds of each setting.
    pub(super) values: Vec<f64>,
}

impl<'a> Searched<'a> {
    /// The search of this name.
    ///
    /// # Errors
    /// [`Error::Render`] where there is none, or no setting went to its end.
    pub(super) fn of(name: &str, context: Context<'a>) -> Result<Self, Error> {
        let all = &context.results.searches;
        let result = all
            .iter()
            .find(|it| it.search.name == name)
            .ok_or_else(|| problem(&format!("there is no search `{name}`")))?;
        let mut searched = Self {
            result,
            places: Vec::new(),
            shares: Vec::new(),
            values: Vec::new(),
        };
        let to_their_ends = result
            .tried
            .iter()
            .enumerate()
            .filter(|(_, tried)| tried.stop.is_none());
        for (place, tried) in to_their_ends {
            if let (Some(shares), Some(value)) = (shares(result, tried), tried.value()) {
                searched.places.push(place);
                searched.shares.push(shares);
                searched.values.push(value);
            }
        }
        if searched.values.is_empty() {
            return Err(problem("no setting of the search has gone to its end"));
        }
        Ok(searched)
    }

    /// The keys by their last words, or as a whole where these are not unique.
    pub(super) fn keys(&self) -> Vec<&'a str> {
        let all = &self.result.search.keys;
        let last = |key: &'a str| key.rsplit('.').next().unwrap_or_default();
        let is_unique = |key: &'a str| all.iter().filter(|(other, _)| last(other) == last(key)).count() == 1;
        let short = |(key, _): &'a (String, Range)| if is_unique(key) { last(key) } else { key.as_str() };
        all.iter().map(short).collect()
    }
}

fn shares(result: &SearchResult, tried: &TriedSetting) -> Option<Vec<f64>> {
    let pairs = result.search.keys.iter().zip(&tried.point);
    pairs.map(|((_, range), value)| range.share_of(value)).collect()
}
