//! The stored trials that are most similar to one of a plan, cell by cell.
//!
//! The distance between two combinations of parts is the number of their differing leaves: values of the configs of
//! environment, agent and protocol, plugins and their versions, and numerics version. Seeds and the names of a study do
//! not count.

use super::leaves::{Catalogue, Difference, PartIndex};
use contract::{
    cast::{Actors, POLICY},
    part::Part,
    trial::TrialKey,
};
use execution::store::{StoredCell, Took};
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Largest number of comparisons in one search over all cells; a search that would need more examines only a part of
/// the store.
const MOST_COMPARISONS: usize = 4_000_000;

/// A combination of parts as indices of the catalogue, so that equal parts are found equal at once.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) struct IndexedParts {
    parts: [PartIndex; 3],
    numerics: u32,
}

/// The stored trials of a combination.
pub(super) struct StoredParts<'a> {
    combination: IndexedParts,
    /// Key of one of its trials.
    pub(super) key: &'a TrialKey,
    /// The seeds of all its trials.
    pub(super) seeds: BTreeSet<u64>,
    /// Times of those that ended successfully.
    pub(super) took: Took,
}

/// The stored combinations, to be searched for the nearest.
pub(super) struct Search<'a> {
    catalogue: Catalogue,
    known: Vec<StoredParts<'a>>,
    by_combination: HashMap<IndexedParts, usize>,
    /// Combinations by two of their parts; the third number is the position that is left out.
    by_two_parts: HashMap<(PartIndex, PartIndex, usize), Vec<usize>>,
    most: usize,
}

impl<'a> Search<'a> {
    pub(super) fn new(stored: impl IntoIterator<Item = &'a StoredCell>, n_cells: usize) -> Self {
        let mut catalogue = Catalogue::default();
        let mut combinations: BTreeMap<IndexedParts, StoredParts<'a>> = BTreeMap::new();
        // Sorting by content makes the choice among equally near combinations deterministic.
        let mut ordered: Vec<&StoredCell> = stored.into_iter().collect();
        ordered.sort_by_cached_key(|cell| serde_json::to_string(&cell.key).unwrap_or_default());
        for cell in ordered {
            let combination = catalogue.combination(&cell.key);
            let known = combinations
                .entry(combination.clone())
                .or_insert_with(|| StoredParts {
                    combination,
                    key: &cell.key,
                    seeds: BTreeSet::new(),
                    took: Took::default(),
                });
            known.seeds.extend(&cell.seeds);
            known.took.add(cell.took);
        }
        let known: Vec<_> = combinations.into_values().collect();
        let (mut by_combination, mut by_two_parts) = (HashMap::new(), HashMap::<_, Vec<usize>>::new());
        for (index, StoredParts { combination, .. }) in known.iter().enumerate() {
            by_combination.insert(combination.clone(), index);
            for pair in combination.pairs() {
                by_two_parts.entry(pair).or_default().push(index);
            }
        }
        Self {
            catalogue,
            known,
            by_combination,
            by_two_parts,
            most: (MOST_COMPARISONS / n_cells.max(1)).max(16),
        }
    }

    /// The stored combination at a place.
    pub(super) fn at(&self, index: usize) -> &StoredParts<'a> {
        &self.known[index]
    }

    /// The combination of the parts of a key.
    pub(super) fn combination(&mut self, key: &TrialKey) -> IndexedParts {
        self.catalogue.combination(key)
    }

    /// The place of the stored combination with the same parts.
    pub(super) fn same(&self, planned: &IndexedParts) -> Option<usize> {
        self.by_combination.get(planned).copied()
    }

    /// The leaves in which a planned combination differs from the stored one at this place.
    pub(super) fn differences(&self, index: usize, planned: &IndexedParts) -> Vec<Difference> {
        let stored = &self.known[index].combination;
        self.catalogue
            .differences(&stored.as_tuple(), &planned.as_tuple())
    }

    /// The stored combinations with the fewest differing leaves; none if nothing is similar.
    pub(super) fn nearest(&self, planned: &IndexedParts, seeds: &[u64]) -> Vec<usize> {
        let related = planned
            .pairs()
            .into_iter()
            .filter_map(|pair| self.by_two_parts.get(&pair))
            .flatten()
            .copied();
        let (mut least, mut nearest) = (usize::MAX, Vec::new());
        for index in related.chain(0..self.known.len()).take(self.most) {
            let StoredParts {
                combination,
                seeds: known,
                ..
            } = &self.known[index];
            let distance = self.distance(combination, planned, least);
            if distance < least {
                (least, nearest) = (distance, Vec::new());
            }
            if distance == least && !nearest.contains(&index) && nearest.len() < 16 {
                nearest.push(index);
            }
            if least == 1 && seeds.iter().all(|seed| known.contains(seed)) {
                break;
            }
        }
        nearest.retain(|&index| self.same_plugins(index, planned) >= 2);
        nearest
    }

    /// The nearest combination with times: one with the same parts, or at least the same three plugins.
    pub(super) fn nearest_timed(&self, planned: &IndexedParts) -> Option<usize> {
        let is_timed = |index: &usize| self.known[*index].took.trials > 0;
        if let Some(same) = self.same(planned).filter(is_timed) {
            return Some(same);
        }
        let distance = |index: &usize| self.distance(&self.known[*index].combination, planned, usize::MAX);
        (0..self.known.len())
            .filter(is_timed)
            .filter(|index| self.same_plugins(*index, planned) == 3)
            .take(self.most)
            .min_by_key(distance)
    }

    /// Number of plugins that two combinations have in common.
    fn same_plugins(&self, index: usize, planned: &IndexedParts) -> usize {
        self.catalogue
            .same_plugins(&self.known[index].combination.parts, &planned.parts)
    }

    /// Number of differing leaves; counting stops above `enough`.
    fn distance(&self, one: &IndexedParts, other: &IndexedParts, enough: usize) -> usize {
        let mut sum = usize::from(one.numerics != other.numerics);
        for (one, other) in one.parts.iter().zip(&other.parts) {
            if sum > enough {
                break;
            }
            sum += self.catalogue.distance(*one, *other);
        }
        sum
    }
}

impl IndexedParts {
    fn pairs(&self) -> [(PartIndex, PartIndex, usize); 3] {
        let [environment, agent, protocol] = self.parts;
        [
            (environment, agent, 2),
            (environment, protocol, 1),
            (agent, protocol, 0),
        ]
    }

    fn as_tuple(&self) -> ([PartIndex; 3], u32) {
        (self.parts, self.numerics)
    }
}

impl Catalogue {
    fn combination(&mut self, key: &TrialKey) -> IndexedParts {
        let agent = match &*key.agent {
            Actors::Agent(part) => part.clone(),
            Actors::Cast(cast) => Part::new(POLICY, 0, serde_json::json!(cast)),
        };
        let parts = [&*key.environment, &agent, &*key.protocol].map(|part| self.index(part));
        IndexedParts {
            parts,
            numerics: key.numerics,
        }
    }
}
