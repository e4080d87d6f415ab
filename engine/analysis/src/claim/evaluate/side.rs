//! The two sides of a claim in numbers.

use crate::claim::{Operand, Quantity};
use contract::standard_metrics::SUCCESS;
use statistics::{MeanEstimate, comparison::by_seed, estimators::mean};
use std::collections::BTreeMap;

/// The origin of the numbers of an operand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NumberOrigin {
    /// The engine measured them.
    Measured,
    /// A program reported them of itself.
    Reported,
    /// They are imported runs, to which no seed can be added.
    Imported,
}

/// One side of a claim in numbers.
pub(super) enum Side {
    Number(f64),
    BySeed {
        values: BTreeMap<u64, f64>,
        kind: NumberKind,
    },
}

/// The kind of the numbers of a side.
#[derive(Debug, Clone, Copy)]
pub(super) struct NumberKind {
    /// Whether they are successes, 0 or 1 by seed.
    pub(super) is_share: bool,
    /// Whether they are whole numbers before the factor, as counts are.
    pub(super) is_whole: bool,
    origin: NumberOrigin,
}

impl Side {
    /// `None` if the metric is not known.
    pub(super) fn of(
        quantity: &Quantity,
        values: &dyn Fn(&Operand) -> Option<Vec<(u64, f64)>>,
        origin: &dyn Fn(&Operand) -> NumberOrigin,
    ) -> Option<Self> {
        match quantity {
            Quantity::Number(number) => Some(Side::Number(*number)),
            Quantity::Measured { factor, operand } => {
                let values = by_seed(&values(operand)?);
                let kind = NumberKind {
                    is_share: operand.metric == SUCCESS && *factor == 1.0,
                    is_whole: values.values().all(|value| value.fract() == 0.0),
                    origin: origin(operand),
                };
                Some(Side::BySeed { values, kind }.times(*factor))
            }
        }
    }

    pub(super) fn times(&self, factor: f64) -> Self {
        match self {
            Side::Number(number) => Side::Number(factor * number),
            Side::BySeed { values, kind } => Side::BySeed {
                values: values
                    .iter()
                    .map(|(seed, value)| (*seed, factor * value))
                    .collect(),
                kind: *kind,
            },
        }
    }

    /// The side with the seeds below a number.
    pub(super) fn below(&self, limit: u64) -> Self {
        match self {
            Side::Number(number) => Side::Number(*number),
            Side::BySeed { values, kind } => Side::BySeed {
                values: values
                    .range(..limit)
                    .map(|(seed, value)| (*seed, *value))
                    .collect(),
                kind: *kind,
            },
        }
    }

    pub(super) fn mean(&self) -> f64 {
        match self {
            Side::Number(number) => *number,
            Side::BySeed { values, .. } => mean(&values_of(values)),
        }
    }

    /// Whether at least two seeds all gave the same number. Equal successes, and equal counts, say little about the
    /// next seed.
    pub(super) fn has_no_spread(&self) -> bool {
        match self {
            Side::Number(_) => true,
            Side::BySeed { values, kind } => {
                !kind.is_share && !kind.is_whole && MeanEstimate::of(&values_of(values)).has_no_spread()
            }
        }
    }

    /// Whether seeds gave numbers that cannot be counts, so that equal differences do not come about by chance.
    pub(super) fn is_fractional(&self) -> bool {
        matches!(self, Side::BySeed { kind, .. } if !kind.is_share && !kind.is_whole)
    }

    pub(super) fn has_run(&self) -> bool {
        !matches!(self, Side::BySeed { values, .. } if values.is_empty())
    }

    pub(super) fn is_share(&self) -> bool {
        matches!(self, Side::BySeed { kind, .. } if kind.is_share)
    }

    pub(super) fn is_of(&self, origin: NumberOrigin) -> bool {
        matches!(self, Side::BySeed { kind, .. } if kind.origin == origin)
    }
}

pub(super) fn values_of(seeds: &BTreeMap<u64, f64>) -> Vec<f64> {
    seeds.values().copied().collect()
}
