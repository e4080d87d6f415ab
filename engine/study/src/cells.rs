//! The cells of a study: each combination of environment, agent and setting that is not left out, each entry of
//! `prepare`, and the settings that searches try. A study may have a million combinations, so a cell is made when it is
//! asked for.

use super::{
    cell::{Cell, Place, Source},
    checked_sections::Sections,
    parts::{Grid, PartCache, points_at},
    written::{NamedPart, PartKind, PreparedPart, PreparedTrial, Target},
};
use contract::sweep_point::SweepPoint;
use document::diagnostic::{Diagnostic, Span, suggest};
use presentation::vocabulary::SweptKey;
use std::{
    collections::{BTreeMap, BTreeSet, HashSet},
    ops::Range,
    sync::Arc,
};

/// All cells: combinations in the order of environments, agents and points, then all others.
#[derive(Debug, Clone, Default)]
pub struct Cells {
    /// Combinations, each with the index of its first cell.
    combinations: Vec<(usize, PairGrid)>,
    n_combinations: usize,
    others: Vec<Cell>,
    /// Artifacts, by index of the cell that takes them.
    sources: BTreeMap<usize, Arc<[Source]>>,
}

impl Cells {
    fn new(all: Vec<PairGrid>, others: Vec<Cell>) -> Self {
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

    /// The combination that a cell belongs to, and the cell's place in it.
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

    /// The first cell outside the combinations for which `holds` is true.
    pub fn other(&self, holds: impl Fn(&Cell) -> bool) -> Option<usize> {
        let place = self.others.iter().position(holds)?;
        Some(self.n_combinations + place)
    }

    /// The settings of combinations as texts, in order, each once.
    pub(super) fn settings(&self) -> Vec<Arc<str>> {
        let mut seen = HashSet::new();
        let settings = self.combinations.iter().flat_map(|(_, combination)| {
            let places = 0..combination.n_cells();
            places.map(|place| {
                combination
                    .setting(&points_at(&combination.dimensions, place))
                    .into_words()
            })
        });
        settings
            .filter(|setting| seen.insert(Arc::clone(setting)))
            .collect()
    }

    /// Places of the swept keys that stand together in one setting, each list once.
    pub(super) fn together(&self) -> BTreeSet<Vec<usize>> {
        let keys = |(_, it): &(usize, PairGrid)| it.keys.iter().map(|key| key.place).collect();
        self.combinations.iter().map(keys).collect()
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

impl Sections<'_> {
    /// All cells: combinations in the order of environments, agents and points, then the entries of
    /// `prepare`, then the settings that searches try.
    ///
    /// # Errors
    /// Configs that a plugin refuses, and names in `prepare` that the study does not have.
    pub fn cells(&self) -> Result<Cells, Vec<Diagnostic>> {
        let (mut combinations, mut others, mut found) = (Vec::new(), Vec::new(), Vec::new());
        let mut known = PartCache::new(self);
        for pair in self.pairs() {
            let targets = Target::of_pair(pair);
            match known.grids(targets, pair) {
                Ok(parts) => combinations.push(PairGrid {
                    pair,
                    dimensions: self.concerned(&targets),
                    keys: self.setting_keys(&targets),
                    parts,
                }),
                Err(errors) => found.extend(errors),
            }
        }
        let mut keep = |made: Result<Cell, Vec<Diagnostic>>| match made {
            Ok(cell) => others.push(cell),
            Err(errors) => found.extend(errors),
        };
        for (index, entry) in self.written.prepared.iter().enumerate() {
            let targets = self.parts_of(index, entry);
            keep(targets.and_then(|targets| known.prepared(index, targets)));
        }
        for (index, searched) in self.searches.iter().enumerate() {
            (0..searched.progress.points.len()).for_each(|point| keep(known.tried(index, point)));
        }
        for (environment, agent) in self.pairs() {
            match known.leading(environment, agent) {
                Ok(leading) => others.extend(leading),
                Err(errors) => found.extend(errors),
            }
        }
        if found.is_empty() {
            Ok(Cells::new(combinations, others))
        } else {
            Err(found)
        }
    }

    /// Targets of the parts of an entry of `prepare`.
    fn parts_of(&self, index: usize, entry: &PreparedTrial) -> Result<[Target; 3], Vec<Diagnostic>> {
        let mut found = Vec::new();
        let mut target =
            |kind, chosen: &PreparedPart, known: &[NamedPart], of_study: fn(usize) -> Target| match chosen {
                PreparedPart::Own(_) => Target::Prepared(index, kind),
                PreparedPart::OfStudy(name, span) => {
                    let place = known.iter().position(|it| it.name == *name);
                    if place.is_none() {
                        found.push(self.no_such(entry, kind, name, *span, known));
                    }
                    of_study(place.unwrap_or_default())
                }
            };
        let (environments, agents) = (&self.written.environments, &self.written.agents);
        let environment = target(
            PartKind::Environment,
            &entry.environment,
            environments,
            Target::Environment,
        );
        let agent = target(PartKind::Agent, &entry.agent, agents, Target::Agent);
        let protocol = match entry.protocol {
            Some(_) => Target::Prepared(index, PartKind::Protocol),
            None => Target::Protocol,
        };
        if found.is_empty() {
            Ok([environment, agent, protocol])
        } else {
            Err(found)
        }
    }

    fn no_such(
        &self,
        entry: &PreparedTrial,
        kind: PartKind,
        name: &str,
        span: Span,
        known: &[NamedPart],
    ) -> Diagnostic {
        let at = format!("prepare.{}.{}", entry.name, kind.name());
        let error = self
            .sources
            .error(span, &at, format!("no {} is named `{name}`", kind.name()));
        error.help(suggest(name, known.iter().map(|it| it.name.as_str())))
    }

    /// The keys of the settings of some parts.
    fn setting_keys(&self, targets: &[Target]) -> Vec<SettingKey> {
        let dimensions = self.dimensions.iter().enumerate();
        let keys = dimensions.flat_map(|(dimension, it)| it.keys.iter().map(move |key| (dimension, key)));
        keys.enumerate()
            .filter(|(_, (_, key))| targets.contains(&key.path.target))
            .map(|(place, (dimension, key))| SettingKey {
                place,
                dimension,
                swept: Arc::clone(&key.swept),
            })
            .collect()
    }
}

/// A swept key of a setting, with a value at every point of its dimension.
#[derive(Debug, Clone)]
struct SettingKey {
    /// Its place among all swept keys.
    place: usize,
    /// Index of its dimension in the sweep.
    dimension: usize,
    swept: Arc<SweptKey>,
}

/// An environment and an agent at every point of the dimensions that affect them.
#[derive(Debug, Clone)]
struct PairGrid {
    /// Environment and agent.
    pair: (usize, usize),
    /// The dimensions, by their places in the sweep, with the number of points of each.
    dimensions: Vec<(usize, usize)>,
    /// The keys of its settings.
    keys: Vec<SettingKey>,
    /// Environment, agent and protocol.
    parts: [Arc<Grid>; 3],
}

impl PairGrid {
    fn n_cells(&self) -> usize {
        self.dimensions.iter().map(|(_, count)| count).product()
    }

    /// The setting at a point.
    fn setting(&self, points: &[(usize, usize)]) -> SweepPoint {
        let value = |key: &SettingKey| {
            let (_, point) = points.iter().find(|(dimension, _)| *dimension == key.dimension)?;
            let SweptKey { key, values, .. } = &*key.swept;
            Some((Arc::clone(key), values[*point].clone()))
        };
        self.keys.iter().filter_map(value).collect()
    }

    /// The cell at a point, by its place among them.
    fn cell(&self, place: usize) -> Cell {
        let points = points_at(&self.dimensions, place);
        let parts = self.parts.each_ref().map(|grid| grid.at(&points));
        let place = Place::Combination(self.pair.0, self.pair.1);
        Cell::new(place, self.setting(&points), parts)
    }
}
