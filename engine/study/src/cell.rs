//! The cells of a study: each combination of environment, agent and setting that is not left out, each entry of
//! `prepare`, and the settings that searches try. A study may have a million combinations, so a cell is made when it is
//! asked for.

use super::{
    grid::{self, Grid},
    part::ResolvedPart,
};
use contract::{
    artifact::{ArtifactKind, Taken},
    cast,
    part::Part,
    sweep_point::SweepPoint,
};
use serde_json::Value;
use std::{
    collections::{BTreeMap, HashSet},
    ops::Range,
    sync::Arc,
};

/// The common part of trials of different seeds.
#[derive(Debug, Clone)]
pub struct Cell {
    /// Place of the cell in the study.
    pub place: Place,
    /// The point of the sweep.
    pub point: SweepPoint,
    /// Environment, agent and protocol.
    pub parts: [Arc<ResolvedPart>; 3],
    /// Artifacts that the parts take from other cells.
    pub sources: Arc<[Source]>,
}

/// The place of a cell in its study.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// A combination of an environment and an agent, by their indices.
    Combination(usize, usize),
    /// The entry of `prepare` with this index.
    Prepared(usize),
    /// A setting that the search with this index tries.
    Tried(usize),
    /// A stretch of a schedule that leads an environment and an agent, by their indices, to its last setting.
    Leading(usize, usize),
}

/// An artifact that a cell takes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    /// The part of the cell that takes it: 0 the environment, 1 the agent, 2 the protocol.
    pub part: usize,
    /// Its place in the part's config, as a JSON pointer.
    pub pointer: String,
    /// Kind of the artifact.
    pub kind: ArtifactKind,
    /// Index of the cell whose trial leaves it.
    pub cell: usize,
    /// The seed whose artifact every seed takes; that of the same seed where absent.
    pub seed: Option<u64>,
}

impl Source {
    /// The seed of the trial that leaves the artifact for a trial with `seed`.
    #[must_use]
    pub fn seed_for(&self, seed: u64) -> u64 {
        self.seed.unwrap_or(seed)
    }
}

impl Place {
    /// Indices of environment and agent; `None` for a cell that is no combination.
    #[must_use]
    pub fn pair(self) -> Option<(usize, usize)> {
        match self {
            Self::Combination(environment, agent) => Some((environment, agent)),
            Self::Prepared(_) | Self::Tried(_) | Self::Leading(..) => None,
        }
    }
}

impl Cell {
    /// A cell that takes no artifact.
    #[must_use]
    pub fn new(place: Place, point: SweepPoint, parts: [Arc<ResolvedPart>; 3]) -> Self {
        Self {
            place,
            point,
            parts,
            sources: Arc::default(),
        }
    }

    /// Indices of environment and agent; `None` for a cell that is no combination.
    #[must_use]
    pub fn pair(&self) -> Option<(usize, usize)> {
        self.place.pair()
    }

    /// The search that tries the agent's setting, and the setting's place there.
    #[must_use]
    pub fn tried(&self) -> Option<(usize, usize)> {
        self.parts[1].given.tried
    }

    /// Whether the agent is the policy of another trial.
    #[must_use]
    pub fn is_policy(&self) -> bool {
        self.parts[1].part.plugin == cast::POLICY
    }

    /// The same cell, whose artifacts are named by cells: two parts with one config differ where they take from
    /// different cells.
    fn taking(mut self, sources: &Arc<[Source]>) -> Self {
        for (place, resolved) in self.parts.iter_mut().enumerate() {
            let named = |source: &Source| Taken {
                trial: format!("cell {} seed {:?}", source.cell, source.seed),
                kind: source.kind,
            };
            let of_part = sources.iter().filter(|source| source.part == place);
            let artifacts: BTreeMap<String, Taken> = of_part
                .map(|source| (source.pointer.clone(), named(source)))
                .collect();
            if !artifacts.is_empty() {
                let part = Part::clone(&resolved.part);
                *resolved = ResolvedPart::new(Part { artifacts, ..part }, resolved.given.clone()).into();
            }
        }
        self.sources = Arc::clone(sources);
        self
    }
}

/// A swept key as settings have it.
#[derive(Debug, Clone)]
pub(super) struct SettingKey {
    /// Index of its dimension in the sweep.
    pub(super) dimension: usize,
    /// Its name in settings.
    pub(super) name: Arc<str>,
    /// Its value at every point of the dimension.
    pub(super) values: Arc<[Value]>,
}

/// An environment and an agent at every point of the dimensions that concern them.
#[derive(Debug, Clone)]
pub(super) struct PairGrid {
    /// Environment and agent.
    pub(super) pair: (usize, usize),
    /// The dimensions, by their places in the sweep, with how many points each has.
    pub(super) dimensions: Vec<(usize, usize)>,
    /// The keys of its settings.
    pub(super) keys: Vec<SettingKey>,
    /// Environment, agent and protocol.
    pub(super) parts: [Arc<Grid>; 3],
}

impl PairGrid {
    fn n_cells(&self) -> usize {
        self.dimensions.iter().map(|(_, count)| count).product()
    }

    /// The setting at a point.
    fn setting(&self, points: &[(usize, usize)]) -> SweepPoint {
        let value = |key: &SettingKey| {
            let (_, point) = points.iter().find(|(dimension, _)| *dimension == key.dimension)?;
            Some((Arc::clone(&key.name), key.values[*point].clone()))
        };
        self.keys.iter().filter_map(value).collect()
    }

    /// The cell at a point, by its place among them.
    fn cell(&self, place: usize) -> Cell {
        let points = grid::points(&self.dimensions, place);
        let parts = self.parts.each_ref().map(|grid| grid.at(&points));
        let place = Place::Combination(self.pair.0, self.pair.1);
        Cell::new(place, self.setting(&points), parts)
    }
}

/// All cells: combinations in the order of environments, agents and points, then all others.
#[derive(Debug, Clone, Default)]
pub struct Cells {
    /// Each with the index of its first cell.
    combinations: Vec<(usize, PairGrid)>,
    n_combinations: usize,
    others: Vec<Cell>,
    /// By index of a cell that takes an artifact.
    sources: BTreeMap<usize, Arc<[Source]>>,
}

impl Cells {
    pub(super) fn new(all: Vec<PairGrid>, others: Vec<Cell>) -> Self {
        let mut cells = Self {
            others,
            ..Self::default()
        };
        for combination in all {
            let first = cells.n_combinations;
            cells.n_combinations += combination.n_cells();
            cells.combinations.push((first, combination));
        }
        cells
    }

    /// Number of cells.
    #[must_use]
    pub fn len(&self) -> usize {
        self.n_combinations + self.others.len()
    }

    /// Number of combinations among the cells; these come first.
    #[must_use]
    pub fn n_combinations(&self) -> usize {
        self.n_combinations
    }

    /// The combination with a cell, and the cell's place in it.
    fn combination(&self, index: usize) -> Option<(&PairGrid, usize)> {
        let after = self.combinations.partition_point(|(first, _)| *first <= index);
        let (first, combination) = &self.combinations[..after].last()?;
        (index < self.n_combinations).then_some((combination, index - first))
    }

    /// The cell with an index below [`len`](Self::len).
    #[must_use]
    pub fn at(&self, index: usize) -> Cell {
        let cell = match self.combination(index) {
            Some((combination, place)) => combination.cell(place),
            None => self.others[index - self.n_combinations].clone(),
        };
        match self.sources.get(&index) {
            Some(sources) => cell.taking(sources),
            None => cell,
        }
    }

    /// All cells, one after the other.
    pub fn iter(&self) -> impl Iterator<Item = Cell> {
        (0..self.len()).map(|index| self.at(index))
    }

    /// Place in the study of the cell with an index.
    #[must_use]
    pub fn place(&self, index: usize) -> Place {
        match self.combination(index) {
            Some((PairGrid { pair, .. }, _)) => Place::Combination(pair.0, pair.1),
            None => self.others[index - self.n_combinations].place,
        }
    }

    /// The indices of the cells of an environment and an agent.
    #[must_use]
    pub fn of_pair(&self, pair: (usize, usize)) -> Range<usize> {
        let found = self.combinations.iter().find(|(_, it)| it.pair == pair);
        found.map_or(0..0, |(first, it)| *first..first + it.n_cells())
    }

    /// The first cell that is no combination and for which `holds` is true.
    pub fn other(&self, holds: impl Fn(&Cell) -> bool) -> Option<usize> {
        let place = self.others.iter().position(holds)?;
        Some(self.n_combinations + place)
    }

    /// The settings of combinations in words, in order, each once.
    pub(super) fn settings(&self) -> Vec<Arc<str>> {
        let (mut seen, mut settings) = (HashSet::new(), Vec::new());
        for (_, combination) in &self.combinations {
            for place in 0..combination.n_cells() {
                let points = grid::points(&combination.dimensions, place);
                let setting: Arc<str> = combination.setting(&points).to_string().into();
                if seen.insert(Arc::clone(&setting)) {
                    settings.push(setting);
                }
            }
        }
        settings
    }

    /// Artifacts that the cell with an index takes.
    #[must_use]
    pub fn sources(&self, index: usize) -> &[Source] {
        self.sources.get(&index).map_or(&[], |sources| &**sources)
    }

    /// The cells whose configs name an artifact.
    pub(super) fn naming(&self) -> impl Iterator<Item = usize> {
        let names = |(_, it): &&(usize, PairGrid)| it.parts.iter().any(|grid| grid.names_artifacts);
        let combinations = self.combinations.iter().filter(names);
        combinations
            .flat_map(|(first, it)| *first..first + it.n_cells())
            .chain(self.n_combinations..self.len())
    }

    /// Number of parts and changes in memory for combinations.
    #[cfg(test)]
    pub(super) fn n_kept(&self) -> usize {
        let grids = self.combinations.iter().flat_map(|(_, it)| &it.parts);
        grids.map(|grid| grid.n_kept()).sum()
    }

    /// The same cells with the artifacts that they take.
    pub(super) fn taking(self, sources: BTreeMap<usize, Arc<[Source]>>) -> Self {
        Self { sources, ..self }
    }
}
