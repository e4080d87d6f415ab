//! Why a trial is new: what sets it apart from the nearest trial in the store.
//!
//! The nearest stored trial is the one with the fewest differing leaves: values of the configs of
//! environment, agent and protocol, plugins and their versions, numerics version, device and seed. Names of a
//! study take no part in it. Seeds are not searched: what is compared are combinations of parts, each with
//! its seeds.

use super::leaves::{Catalogue, Difference, PartIndex};
use crate::{
    cast::{POLICY, Seating},
    results::{EndState, TrialEnd},
    trial::{Part, Purpose, Trial, TrialKey},
};
use std::{
    borrow::Borrow,
    collections::{BTreeMap, BTreeSet, HashMap},
    sync::Arc,
};

/// Comparisons of combinations in one search, over all cells; a search that would need more looks at a part
/// of the store only.
const MOST_COMPARISONS: usize = 4_000_000;

/// A stored combination of parts.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredCell {
    /// Key of one of its trials.
    pub key: TrialKey,
    /// The seeds of all of them.
    pub seeds: BTreeSet<u64>,
}

/// Why trials are not done.
#[derive(Debug, Clone, PartialEq)]
pub enum Reason {
    /// The parts are stored, with other seeds.
    NewSeed {
        /// Those seeds.
        stored: BTreeSet<u64>,
    },
    /// The nearest stored trial has other parts.
    Changed {
        /// What is different; never empty.
        differences: Vec<Difference>,
        /// The stored seeds, where the trial's is not among them.
        new_seed: Option<BTreeSet<u64>>,
    },
    /// What it takes from other trials is new, by the names of their entries.
    Takes(BTreeSet<String>),
    /// No stored trial shares at least two of the three plugins.
    NothingLikeIt,
    /// The worker process was killed from outside.
    Killed,
    /// It ended in this state, and would end so again.
    Failed(EndState),
}

/// Trials of one cell that are not done for one reason.
#[derive(Debug, Clone, PartialEq)]
pub struct Novelty {
    /// Name of the environment in the study.
    pub environment: String,
    /// Name of the agent in the study.
    pub agent: String,
    /// The point of the sweep.
    pub setting: String,
    /// The seeds, in the order of the study.
    pub seeds: Vec<u64>,
    /// Why.
    pub reason: Reason,
}

/// Why each trial that is not done is not done, by cell and reason, in the order of the plan; those of
/// cross-play are left out.
///
/// `ends` has one entry per trial.
#[must_use]
pub fn novelties(
    trials: &[impl Borrow<Trial>],
    ends: &[Option<TrialEnd>],
    stored: &[StoredCell],
) -> Vec<Novelty> {
    let pending = || {
        (trials.iter().zip(ends))
            .map(|(trial, end)| (trial.borrow(), end.as_ref().map(|end| end.state)))
            .filter(|(_, state)| *state != Some(EndState::Ok))
            // What plays a policy is new because the policy is.
            .filter(|(trial, _)| !matches!(trial.cell.purpose, Purpose::Play(_)))
    };
    let takes = pending().any(|(trial, _)| trial.key.takes());
    let new: HashMap<&str, &Trial> = pending()
        .filter(|_| takes)
        .map(|(trial, _)| (trial.id.as_str(), trial))
        .collect();
    let mut search = Search::new(stored, by_cell(pending()).count());
    by_cell(pending())
        .flat_map(|cell| of_cell(&cell, &new, &mut search))
        .collect()
}

/// A trial that is to run, and how it ended where it did.
type Pending<'a> = (&'a Trial, Option<EndState>);

/// Neighbours of one cell together, cell after cell: a plan may have a million trials, and few of one cell.
fn by_cell<'a>(pending: impl Iterator<Item = Pending<'a>>) -> impl Iterator<Item = Vec<Pending<'a>>> {
    let mut pending = pending.peekable();
    std::iter::from_fn(move || {
        let first = pending.next()?;
        let mut cell = vec![first];
        while let Some(next) = pending.next_if(|(trial, _)| is_of_cell(first.0, trial)) {
            cell.push(next);
        }
        Some(cell)
    })
}

fn is_of_cell(one: &Trial, other: &Trial) -> bool {
    Arc::ptr_eq(&one.cell, &other.cell) || names(one) == names(other)
}

fn names(trial: &Trial) -> (&str, &str, &str) {
    (&trial.cell.environment, &trial.cell.agent, &trial.cell.setting)
}

/// The entries that a trial takes from and that are new themselves.
fn new_sources(trial: &Trial, new: &HashMap<&str, &Trial>) -> BTreeSet<String> {
    let taken = trial.key.taken_by_name();
    taken
        .iter()
        .filter_map(|taken| new.get(taken.trial.as_str()))
        .map(|source| entry(source))
        .collect()
}

fn entry(trial: &Trial) -> String {
    match trial.cell.purpose {
        Purpose::Prepared => trial.cell.environment.clone(),
        _ => format!("{} in {}", trial.cell.agent, trial.cell.environment),
    }
}

fn of_cell(cell: &[Pending<'_>], new: &HashMap<&str, &Trial>, search: &mut Search) -> Vec<Novelty> {
    let mut reasons: Vec<(Reason, Vec<u64>)> = Vec::new();
    let mut add = |reason: Reason, seed: u64| match reasons.iter_mut().find(|(known, _)| *known == reason) {
        Some((_, seeds)) => seeds.push(seed),
        None => reasons.push((reason, vec![seed])),
    };
    let mut absent = Vec::new();
    for (trial, state) in cell {
        match state {
            None => match new_sources(trial, new) {
                none if none.is_empty() => absent.push(trial.key.seed),
                sources => add(Reason::Takes(sources), trial.key.seed),
            },
            Some(EndState::Killed) => add(Reason::Killed, trial.key.seed),
            Some(state) => add(Reason::Failed(*state), trial.key.seed),
        }
    }
    let first = cell[0].0;
    reasons.extend(search.reasons(&first.key, &absent));
    let (environment, agent, setting) = (
        first.cell.environment.clone(),
        first.cell.agent.clone(),
        first.cell.setting.clone(),
    );
    let named = |(reason, seeds)| Novelty {
        environment: environment.clone(),
        agent: agent.clone(),
        setting: setting.clone(),
        seeds,
        reason,
    };
    reasons.into_iter().map(named).collect()
}

/// A combination of parts as indices of the catalogue, so that equal parts are found equal at once.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
struct Combination {
    parts: [PartIndex; 3],
    numerics: u32,
    device: String,
}

/// The stored combinations, to be searched for the nearest.
struct Search {
    catalogue: Catalogue,
    stored: Vec<(Combination, BTreeSet<u64>)>,
    by_combination: HashMap<Combination, usize>,
    /// Combinations by two of their parts; the position that is left out makes the third number.
    by_two_parts: HashMap<(PartIndex, PartIndex, usize), Vec<usize>>,
    most: usize,
}

impl Search {
    fn new(stored: &[StoredCell], n_cells: usize) -> Self {
        let mut catalogue = Catalogue::default();
        let mut combinations: BTreeMap<Combination, BTreeSet<u64>> = BTreeMap::new();
        // In the order of their content, so that among equally near ones always the same is found.
        let mut ordered: Vec<&StoredCell> = stored.iter().collect();
        ordered.sort_by_cached_key(|cell| serde_json::to_string(&cell.key).unwrap_or_default());
        for cell in ordered {
            combinations
                .entry(catalogue.combination(&cell.key))
                .or_default()
                .extend(&cell.seeds);
        }
        let stored: Vec<_> = combinations.into_iter().collect();
        let (mut by_combination, mut by_two_parts) = (HashMap::new(), HashMap::<_, Vec<usize>>::new());
        for (index, (combination, _)) in stored.iter().enumerate() {
            by_combination.insert(combination.clone(), index);
            for pair in combination.pairs() {
                by_two_parts.entry(pair).or_default().push(index);
            }
        }
        Self {
            catalogue,
            stored,
            by_combination,
            by_two_parts,
            most: (MOST_COMPARISONS / n_cells.max(1)).max(16),
        }
    }

    /// Why these seeds of a combination are not stored.
    fn reasons(&mut self, key: &TrialKey, seeds: &[u64]) -> Vec<(Reason, Vec<u64>)> {
        if seeds.is_empty() {
            return Vec::new();
        }
        let planned = self.catalogue.combination(key);
        if let Some(&same) = self.by_combination.get(&planned) {
            return vec![(
                Reason::NewSeed {
                    stored: self.stored[same].1.clone(),
                },
                seeds.to_vec(),
            )];
        }
        let nearest = self.nearest(&planned, seeds);
        let Some(&first) = nearest.first() else {
            return vec![(Reason::NothingLikeIt, seeds.to_vec())];
        };
        let mut by_stored: BTreeMap<(bool, usize), Vec<u64>> = BTreeMap::new();
        for &seed in seeds {
            let with_seed = nearest
                .iter()
                .copied()
                .find(|&index| self.stored[index].1.contains(&seed));
            by_stored
                .entry((with_seed.is_none(), with_seed.unwrap_or(first)))
                .or_default()
                .push(seed);
        }
        let changed = |((new_seed, index), seeds): ((bool, usize), Vec<u64>)| {
            let (stored, known) = &self.stored[index];
            let differences = self
                .catalogue
                .differences(&stored.as_tuple(), &planned.as_tuple());
            (
                Reason::Changed {
                    differences,
                    new_seed: new_seed.then(|| known.clone()),
                },
                seeds,
            )
        };
        let mut reasons: Vec<_> = by_stored.into_iter().map(changed).collect();
        reasons.sort_by_key(|(_, seeds)| seeds.first().copied());
        reasons
    }

    /// The stored combinations with the fewest differing leaves; none where nothing is like it.
    fn nearest(&self, planned: &Combination, seeds: &[u64]) -> Vec<usize> {
        let related = planned
            .pairs()
            .into_iter()
            .filter_map(|pair| self.by_two_parts.get(&pair))
            .flatten()
            .copied();
        let (mut least, mut nearest) = (usize::MAX, Vec::new());
        for index in related.chain(0..self.stored.len()).take(self.most) {
            let (stored, known) = &self.stored[index];
            let distance = self.distance(stored, planned, least);
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
        nearest.retain(|&index| {
            self.catalogue
                .same_plugins(&self.stored[index].0.parts, &planned.parts)
                >= 2
        });
        nearest
    }

    /// Number of differing leaves; counting stops above `enough`.
    fn distance(&self, one: &Combination, other: &Combination, enough: usize) -> usize {
        let mut sum = usize::from(one.numerics != other.numerics) + usize::from(one.device != other.device);
        for (one, other) in one.parts.iter().zip(&other.parts) {
            if sum > enough {
                break;
            }
            sum += self.catalogue.distance(*one, *other);
        }
        sum
    }
}

impl Combination {
    fn pairs(&self) -> [(PartIndex, PartIndex, usize); 3] {
        let [environment, agent, protocol] = self.parts;
        [
            (environment, agent, 2),
            (environment, protocol, 1),
            (agent, protocol, 0),
        ]
    }

    fn as_tuple(&self) -> ([PartIndex; 3], u32, &str) {
        (self.parts, self.numerics, &self.device)
    }
}

impl Catalogue {
    fn combination(&mut self, key: &TrialKey) -> Combination {
        let agent = match &*key.agent {
            Seating::Agent(part) => part.clone(),
            Seating::Cast(cast) => Part::new(POLICY, 0, serde_json::json!(cast)),
        };
        let parts = [&*key.environment, &agent, &*key.protocol].map(|part| self.index(part));
        Combination {
            parts,
            numerics: key.numerics,
            device: key.device.to_string(),
        }
    }
}
