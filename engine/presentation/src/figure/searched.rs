//! Settings of a search that were completed, as places in their ranges, for figures.

use super::build::{Context, problem};
use crate::vocabulary::Vocabulary;
use analysis::results::{SearchResult, TriedSetting};
use contract::Error;

/// Settings that were trained to the end.
pub(super) struct CompletedSettings<'a> {
    pub(super) result: &'a SearchResult,
    /// Number of each setting in the order of trials.
    pub(super) places: Vec<usize>,
    /// Places of the values of each setting between the ends of their ranges, from 0 to 1, `[setting][key]`.
    pub(super) shares: Vec<Vec<f64>>,
    /// The mean over seeds of each setting.
    pub(super) values: Vec<f64>,
}

impl<'a> CompletedSettings<'a> {
    /// The completed settings of the search with this name.
    ///
    /// # Errors
    /// [`Error::Render`] if there is no such search, or no setting was completed.
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

    /// The keys by their last words, or in full if last words are not unique.
    pub(super) fn keys(&self) -> Vec<&'a str> {
        self.result.search.key_names()
    }
}

/// The names of the keys of a search, which labels may replace.
pub(super) fn key_names(search: &str, vocabulary: &Vocabulary) -> Vec<String> {
    let known = vocabulary.searches.iter().find(|it| it.name == search);
    known.map_or_else(Vec::new, |known| known.keys.clone())
}

fn shares(result: &SearchResult, tried: &TriedSetting) -> Option<Vec<f64>> {
    let pairs = result.search.keys.iter().zip(&tried.point);
    pairs.map(|((_, range), value)| range.share_of(value)).collect()
}
