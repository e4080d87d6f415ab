//! A cell of a study: the common part of trials of different seeds.

use super::part::ResolvedPart;
use contract::{
    artifact::{ArtifactKind, Taken},
    cast,
    part::Part,
    sweep_point::SweepPoint,
};
use std::{collections::BTreeMap, sync::Arc};

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
    /// The seed whose artifact every seed takes; each seed takes the artifact of the same seed if absent.
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

    /// The same cell with its artifacts named by cells, so that two parts with one config differ if they take from
    /// different cells.
    pub(super) fn taking(mut self, sources: &Arc<[Source]>) -> Self {
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
