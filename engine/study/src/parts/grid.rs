//! The configs of one part at every point of the dimensions that affect it. A sweep may have a million points. Each is
//! resolved once, on all cores, and only the parts that do not follow from the dimensions one by one are kept.

use crate::{
    checked_sections::Sections,
    config::{Files, Plugin},
    part::{ConfigOrigin, ResolvedPart},
};
use contract::{
    artifact::named_in,
    complete_config::{Change, CompleteConfig, changes},
    part::Part,
};
use document::diagnostic::Diagnostic;
use rayon::prelude::*;
use std::{
    collections::BTreeMap,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

/// Number of points up to which every part is kept; larger numbers are also divided among the cores.
const MANY: usize = 2000;
/// Number of points that are resolved between two checks for mistakes.
const AT_ONCE: usize = 20 * MANY;
/// Number of mistakes of one part that are shown; those of a sweep mostly come from one key.
const MOST_MISTAKES: usize = 100;

/// The changes that one point of one dimension makes to the first point's config; `None` if there are other
/// differences.
type PointChanges = Option<Box<[Arc<Change>]>>;

/// A part at every point of some dimensions.
#[derive(Debug)]
pub(crate) struct Grid {
    /// The dimensions, by their places in the sweep, with the number of points of each; the first changes slowest.
    dimensions: Vec<(usize, usize)>,
    /// The part at the first point.
    first: Arc<ResolvedPart>,
    /// Changes by dimension and point. A part that is not kept has the changes of all its points combined.
    single: Vec<Vec<PointChanges>>,
    /// Parts that are kept, by their place among all points.
    kept: BTreeMap<usize, Arc<ResolvedPart>>,
    /// Whether some config names an artifact of another trial.
    pub(crate) names_artifacts: bool,
}

impl Grid {
    /// Resolves the part that `given` describes at every point of some dimensions; `first` is the part at the first of
    /// them.
    ///
    /// # Errors
    /// Mistakes that keep points from being resolved.
    pub(super) fn resolve(
        sections: &Sections<'_>,
        files: &Files<'_>,
        (given, first): (&ConfigOrigin, Result<Arc<ResolvedPart>, Vec<Diagnostic>>),
        dimensions: Vec<(usize, usize)>,
    ) -> Result<Self, Vec<Diagnostic>> {
        let maker = GridBuilder {
            sections,
            files,
            plugin: sections.plugin(given.target).ok_or_else(Vec::new)?,
            given,
            first: first.as_deref().ok(),
            names_artifacts: AtomicBool::new(false),
        };
        let single = maker.single(&dimensions);
        let mut mistakes = first.as_ref().err().cloned().unwrap_or_default();
        let kept = maker.kept(&dimensions, &single, &mut mistakes);
        let names_artifacts = maker.names_artifacts.into_inner();
        match first {
            Ok(first) if mistakes.is_empty() => Ok(Self {
                names_artifacts: names_artifacts || !named_in(&first.part.config).is_empty(),
                dimensions,
                first,
                single,
                kept,
            }),
            _ => Err(mistakes),
        }
    }

    /// The part at a point of all dimensions of a combination.
    pub(crate) fn at(&self, points: &[(usize, usize)]) -> Arc<ResolvedPart> {
        let is_own = |(index, _): &&(usize, usize)| self.dimensions.iter().any(|(own, _)| own == index);
        let points: Vec<(usize, usize)> = points.iter().filter(is_own).copied().collect();
        let counts = self.dimensions.iter().map(|(_, count)| count);
        let place = counts
            .zip(&points)
            .fold(0, |place, (count, (_, point))| place * count + point);
        if place == 0 {
            return Arc::clone(&self.first);
        }
        if let Some(kept) = self.kept.get(&place) {
            return Arc::clone(kept);
        }
        let changes = together(&self.single, &points).unwrap_or_default();
        let changes = changes.into_iter().cloned().collect();
        let part = Part {
            config: CompleteConfig::changed(&self.first.part.config, changes),
            ..Part::clone(&self.first.part)
        };
        let given = self.first.given.clone();
        ResolvedPart::new(part, ConfigOrigin { points, ..given }).into()
    }

    /// Number of parts and changes in memory.
    #[cfg(test)]
    pub(crate) fn n_kept(&self) -> usize {
        self.kept.len() + self.single.iter().map(Vec::len).sum::<usize>()
    }
}

/// The point at a place, where the first dimension changes slowest.
pub(crate) fn points_at(dimensions: &[(usize, usize)], mut place: usize) -> Vec<(usize, usize)> {
    let mut points: Vec<(usize, usize)> = Vec::with_capacity(dimensions.len());
    for (dimension, count) in dimensions.iter().rev() {
        points.push((*dimension, place % count));
        place /= count;
    }
    points.reverse();
    points
}

/// The combined changes of all points; `None` if those of one are not all that differs.
fn together<'a>(single: &'a [Vec<PointChanges>], points: &[(usize, usize)]) -> Option<Vec<&'a Arc<Change>>> {
    let mut all = Vec::new();
    for (changes, (_, point)) in single.iter().zip(points).filter(|(_, (_, point))| *point > 0) {
        all.extend(changes.get(point - 1)?.as_deref()?);
    }
    Some(all)
}

/// Resolves points.
struct GridBuilder<'a> {
    sections: &'a Sections<'a>,
    files: &'a Files<'a>,
    plugin: Plugin<'a>,
    given: &'a ConfigOrigin,
    /// `None` if the part at the first point was refused.
    first: Option<&'a ResolvedPart>,
    names_artifacts: AtomicBool,
}

impl GridBuilder<'_> {
    fn resolve(
        &self,
        points: Vec<(usize, usize)>,
        files: &mut Files<'_>,
    ) -> Result<ResolvedPart, Vec<Diagnostic>> {
        let given = ConfigOrigin {
            points,
            ..self.given.clone()
        };
        let resolved = self.sections.resolve(&self.plugin, given, files)?;
        if !named_in(&resolved.part.config).is_empty() {
            self.names_artifacts.store(true, Ordering::Relaxed);
        }
        Ok(resolved)
    }

    /// The changes of each point of each dimension alone. A grid of few points keeps all parts instead.
    fn single(&self, dimensions: &[(usize, usize)]) -> Vec<Vec<PointChanges>> {
        let count: usize = dimensions.iter().map(|(_, count)| count).product();
        if count <= MANY {
            return Vec::new();
        }
        let of_dimension = |place: usize| {
            let changed = |files: &mut Files<'_>, point: usize| {
                let mut points = points_at(dimensions, 0);
                points[place].1 = point;
                // The mistake is found again when all points are resolved.
                let part = self.resolve(points, files).ok()?.part;
                let first = &self.first?.part;
                let changes = changes(&first.config, &part.config).into_iter().map(Arc::new);
                (first.files == part.files).then(|| changes.collect())
            };
            let all = (1..dimensions[place].1).into_par_iter();
            all.map_with(self.files.clone(), changed).collect()
        };
        (0..dimensions.len()).map(of_dimension).collect()
    }

    /// The parts that differ from the combined changes of their points; stops early once there are many mistakes.
    fn kept(
        &self,
        dimensions: &[(usize, usize)],
        single: &[Vec<PointChanges>],
        mistakes: &mut Vec<Diagnostic>,
    ) -> BTreeMap<usize, Arc<ResolvedPart>> {
        let count: usize = dimensions.iter().map(|(_, count)| count).product();
        let mut kept = BTreeMap::new();
        for begin in (1..count).step_by(AT_ONCE) {
            let places = (begin..count.min(begin + AT_ONCE))
                .into_par_iter()
                .with_min_len(MANY);
            let found: Vec<_> = places
                .map_with(self.files.clone(), |files, place| {
                    let outcome = self.to_keep(points_at(dimensions, place), single, files);
                    outcome.transpose().map(|outcome| (place, outcome))
                })
                .flatten_iter()
                .collect();
            for (place, outcome) in found {
                match outcome {
                    Ok(part) => drop(kept.insert(place, part)),
                    Err(errors) if mistakes.len() < MOST_MISTAKES => mistakes.extend(errors),
                    Err(_) => return kept,
                }
            }
        }
        kept
    }

    /// The part at some points, unless it equals the combined changes of the points.
    fn to_keep(
        &self,
        points: Vec<(usize, usize)>,
        single: &[Vec<PointChanges>],
        files: &mut Files<'_>,
    ) -> Result<Option<Arc<ResolvedPart>>, Vec<Diagnostic>> {
        let expected = together(single, &points).filter(|_| !single.is_empty());
        let is_single = points.iter().filter(|(_, point)| *point > 0).count() == 1;
        if is_single && expected.is_some() {
            return Ok(None);
        }
        let mut resolved = self.resolve(points, files)?;
        let Some(first) = self.first else { return Ok(None) };
        let found = changes(&first.part.config, &resolved.part.config);
        let is_expected = |expected: Vec<&Arc<Change>>| {
            let is_there = |change: &Change| expected.iter().any(|it| ***it == *change);
            expected.len() == found.len() && found.iter().all(is_there)
        };
        if first.part.files == resolved.part.files && expected.is_some_and(is_expected) {
            return Ok(None);
        }
        let changes = found.into_iter().map(Arc::new).collect();
        let config = &mut Arc::make_mut(&mut resolved.part).config;
        config.rebase(&first.part.config, changes);
        Ok(Some(resolved.into()))
    }
}
