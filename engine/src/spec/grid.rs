//! The configs of one part at every point of the dimensions that concern it. A sweep may have a million points: each is
//! resolved once, on all cores, and of its config only that is kept in which it differs from the first point's.

use super::{
    cells::{Given, Known, Outcome, Resolved},
    config::Files,
};
use crate::{
    complete_config::{Change, CompleteConfig, changes},
    diagnostic::Diagnostic,
};
use rayon::prelude::*;
use std::{collections::BTreeMap, sync::Arc};

/// From so many points on they are shared out among the cores.
const MANY: usize = 2000;
/// So many mistakes of one part are told; those of a sweep mostly come from one key.
const MOST_MISTAKES: usize = 100;

/// A part at every point of some dimensions.
pub(super) struct Grid {
    /// The dimensions, by their places in the sweep, with how many points each has.
    dimensions: Vec<(usize, usize)>,
    /// The parts; the first dimension changes slowest.
    parts: Vec<Arc<Resolved>>,
    /// What keeps points from being resolved.
    pub(super) mistakes: Vec<Diagnostic>,
}

impl Grid {
    /// The part at a point of all dimensions of a combination.
    pub(super) fn at(&self, points: &[(usize, usize)]) -> Option<&Arc<Resolved>> {
        let mut place = 0;
        for (dimension, count) in &self.dimensions {
            let (_, point) = points.iter().find(|(index, _)| index == dimension)?;
            place = place * count + point;
        }
        self.parts.get(place)
    }

    /// Resolves what `given` says at every point of some dimensions.
    pub(super) fn resolve(known: &mut Known<'_>, given: &Given, dimensions: Vec<(usize, usize)>) -> Self {
        let count: usize = dimensions.iter().map(|(_, count)| count).product();
        let at = |place: usize| Given {
            points: points(&dimensions, place),
            ..given.clone()
        };
        let first = known.part(at(0));
        let outcomes: Vec<Outcome> = match &first {
            Ok(base) if count > 1 => {
                let shared = Changes::of(known, base, given, &dimensions);
                let resolve = |files: &mut Files<'_>, place: usize| {
                    let part = known.sections.resolve(at(place), files)?;
                    Ok(Arc::new(shared.only_changes(part)))
                };
                let files = known.files.clone();
                let rest: Vec<Outcome> = if count > MANY {
                    (1..count).into_par_iter().map_with(files, resolve).collect()
                } else {
                    let mut files = files;
                    (1..count).map(|place| resolve(&mut files, place)).collect()
                };
                std::iter::once(first).chain(rest).collect()
            }
            _ => (1..count).fold(vec![first], |mut all, place| {
                all.push(known.part(at(place)));
                all
            }),
        };
        let (mut parts, mut mistakes) = (Vec::with_capacity(count), Vec::new());
        for outcome in outcomes {
            match outcome {
                Ok(part) => parts.push(part),
                Err(errors) if mistakes.len() < MOST_MISTAKES => mistakes.extend(errors),
                Err(_) => {}
            }
        }
        Self {
            dimensions,
            parts,
            mistakes,
        }
    }
}

/// The point at a place, where the first dimension changes slowest.
pub(super) fn points(dimensions: &[(usize, usize)], mut place: usize) -> Vec<(usize, usize)> {
    let mut points: Vec<(usize, usize)> = Vec::with_capacity(dimensions.len());
    for (dimension, count) in dimensions.iter().rev() {
        points.push((*dimension, place % count));
        place /= count;
    }
    points.reverse();
    points
}

/// What single dimensions change of the first point's config: points share these.
struct Changes {
    base: CompleteConfig,
    /// By pointer and by the text of the value.
    single: BTreeMap<String, BTreeMap<String, Arc<Change>>>,
}

impl Changes {
    fn of(known: &mut Known<'_>, base: &Resolved, given: &Given, dimensions: &[(usize, usize)]) -> Self {
        let base = base.part.config.clone();
        let mut single: BTreeMap<String, BTreeMap<String, Arc<Change>>> = BTreeMap::new();
        for (place, (_, count)) in dimensions.iter().enumerate() {
            for point in 1..*count {
                let mut points: Vec<(usize, usize)> =
                    dimensions.iter().map(|(index, _)| (*index, 0)).collect();
                points[place].1 = point;
                let given = Given {
                    points,
                    ..given.clone()
                };
                let Ok(part) = known.sections.resolve(given, &mut known.files) else {
                    continue;
                };
                for change in changes(&base, &part.part.config.whole()) {
                    let of_place = single.entry(change.pointer.clone()).or_default();
                    of_place.insert(change.value.to_string(), Arc::new(change));
                }
            }
        }
        Self { base, single }
    }

    /// The same part, with a config that holds what differs from the first point's.
    fn only_changes(&self, mut resolved: Resolved) -> Resolved {
        let found = changes(&self.base, &resolved.part.config);
        let shared = found.into_iter().map(|change| self.shared(change)).collect();
        let part = Arc::make_mut(&mut resolved.part);
        part.config = CompleteConfig::changed(&self.base, shared);
        resolved
    }

    fn shared(&self, change: Change) -> Arc<Change> {
        let of_place = self.single.get(&change.pointer);
        let known = of_place.and_then(|all| all.get(&change.value.to_string()));
        known.map_or_else(|| Arc::new(change), Arc::clone)
    }
}
