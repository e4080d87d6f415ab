//! An upper bound on the decisions that any controller survives in an episode: `cycle_length_bound`.
//!
//! The bound rests on three facts about a pack whose cells are only discharged. S_t is the power that the
//! pack delivers in decision t, at least the demand; a decision lasts T seconds.
//!
//! 1. **Power.** Cell k survives a decision only with a power below `pi_k(w_k)`, the least power that is
//!    fatal to the [`IdealCell`] with its stored energy `w_k`, the energy that the cell would give at rest,
//!    without losses, until its voltage at rest is at the end of discharge. So `S_t < sum_k pi_k(w_k)`.
//! 2. **Energy.** A terminal voltage is the voltage at rest of the charge that is left, less the ohmic drop,
//!    less terms that only lower it. Multiplied by the current and summed over steps: stored energy falls by at
//!    least the delivered energy and the loss in the ohmic drop.
//! 3. **Losses.** The ohmic drop is the resistance times the current's recent past, forgotten with a time
//!    constant of 6 s, so the loss is a quadratic form in the powers of the decisions. Where that form is
//!    convex, the loss of a pack is least when all decisions are shared in one fixed proportion, so it is at
//!    least `r` times the form of S, with `1 / r = sum_k U_k^2 / R_k`: a current is at least the power over
//!    the voltage U_k at rest at the start of the episode.
//!
//! Facts 2 and 3 bound the stored energy that is gone before decision t from below. Its distribution over the
//! cells is the controller's choice, so the greatest right-hand side of 1 is taken: each `pi_k` is replaced by
//! a concave function above it, and energy is taken where a joule costs the least power. The bound is the
//! number of decisions before the first whose demand exceeds that. It depends only on the start of an episode
//! and its demands, so it is the same for all agents.
//!
//! The bound need not be attained: it lets every cell rest before every decision, neglects the overpotentials
//! of the surfaces and lets the controller empty cells in any order. There is no bound where the facts do not
//! hold: cells that warm up or wear, noise in the states, starts given state by state, loads in ampere, from a
//! file or of 0 W, a surface that counts as full before its voltage is at the end of discharge.

use super::cell::Cell;
use super::config::BatteryConfig;
use super::ideal_cell::{Decisions, IdealCell};
use super::load::LoadSource;
use super::model::{resting_energy, resting_voltage};
use super::parameters::{CellParameters, MOLE_FRACTION_N_MAX, TIME_OHMIC_S};
use super::start::Start;
use crate::simplex::SUM_TOLERANCE;
use arithmetic::power::pow;

/// Number of charges at which the fatal power of a cell is computed.
const GRID: usize = 128;

/// The bound for the packs of one config.
#[derive(Debug, Clone)]
pub struct LifeBound {
    decisions: Decisions,
    limit: Option<u64>,
    cells: Vec<IdealCell>,
    /// Kind of each cell: equal cells share their pieces.
    kinds: Vec<usize>,
    /// Power of all cells without stored energy, W: the beginning of the concave functions.
    floor_w: f64,
    /// Largest power of one cell, W.
    greatest_w: f64,
    /// Pieces of the concave functions of all kinds, by rising slope.
    pieces: Vec<Piece>,
    /// Voltage at the end of discharge, V: stored energy per charge below it does not count.
    lost_v: f64,
    memory: OhmicMemory,
}

/// A straight piece of the concave function over the fatal power of one kind of cell.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Piece {
    kind: usize,
    /// Stored energy at its ends, J.
    from_j: f64,
    to_j: f64,
    /// Power per stored energy, W/J.
    slope: f64,
}

impl LifeBound {
    /// The bound for a pack; `None` where its facts do not hold.
    #[must_use]
    pub fn new(
        config: &BatteryConfig,
        parameters: &[CellParameters],
        load: &LoadSource,
        steps: usize,
    ) -> Option<Self> {
        let (end_v, empty) = (config.end_of_discharge_v, config.mole_fraction_margin);
        let decisions = Decisions {
            step_s: config.step_s,
            steps,
            end_v,
            empty,
        };
        let is_steady = !config.thermal && !config.process_noise && config.ageing.is_none();
        let is_known = !matches!(config.start, Start::States(_))
            && load.least_power_w().is_some_and(|power_w| power_w > 0.0);
        let has_end = resting_voltage(empty) <= end_v && resting_voltage(MOLE_FRACTION_N_MAX) > end_v;
        if !(is_steady && is_known && has_end) {
            return None;
        }
        let cells = parameters
            .iter()
            .map(|one| IdealCell::new(one, decisions))
            .collect::<Option<Vec<_>>>()?;
        let kinds: Vec<usize> = cells
            .iter()
            .map(|cell| cells.iter().position(|other| other == cell).unwrap_or(0))
            .collect();
        let least = mole_fraction_at(end_v, empty);
        let mut bound = Self {
            decisions,
            limit: config.episode_limit,
            floor_w: 0.0,
            greatest_w: 0.0,
            pieces: Vec::new(),
            lost_v: resting_energy(least),
            memory: OhmicMemory::new(decisions),
            cells,
            kinds,
        };
        bound.add_pieces(least);
        Some(bound)
    }

    /// Computes the concave functions.
    fn add_pieces(&mut self, least: f64) {
        for (kind, cell) in self
            .cells
            .iter()
            .enumerate()
            .filter(|(index, _)| self.kinds[*index] == *index)
        {
            let corners = concave(&capability(cell, least, self.lost_v));
            let alike = self.kinds.iter().filter(|other| **other == kind).count();
            self.floor_w += alike as f64 * corners[0].1;
            self.greatest_w = self.greatest_w.max(corners[corners.len() - 1].1);
            self.pieces.extend(corners.windows(2).map(|ends| {
                let [(from_j, low_w), (to_j, high_w)] = [ends[0], ends[1]];
                Piece {
                    kind,
                    from_j,
                    to_j,
                    slope: (high_w - low_w) / (to_j - from_j),
                }
            }));
        }
        self.pieces.sort_by(|a, b| a.slope.total_cmp(&b.slope));
    }

    /// Upper bound on the decisions from this start of an episode with these demands of its decisions, W.
    pub fn decisions(&self, cells: &[Cell], demands_w: impl Iterator<Item = f64>) -> u64 {
        let filled: Vec<f64> = cells
            .iter()
            .zip(&self.cells)
            .map(|(cell, ideal)| self.mean_fraction(cell, ideal))
            .collect();
        let mut reserve = Reserve::new(self, &filled);
        let conductance: f64 = filled
            .iter()
            .zip(&self.cells)
            .map(|(x, cell)| (resting_voltage(*x), cell))
            .map(|(voltage, cell)| voltage * voltage / cell.r_ohm())
            .sum();
        let (mut recent_w, mut survived) = (0.0, 0);
        for demand_w in demands_w {
            // Allocations may sum to less than one by a rounding error.
            let power_w = (1.0 - SUM_TOLERANCE) * demand_w;
            if power_w > reserve.power_w || Some(survived) == self.limit {
                break;
            }
            survived += 1;
            let delivered_j = power_w * self.decisions.step_s * self.decisions.steps as f64;
            reserve.drain(delivered_j + self.memory.loss_j(power_w, &mut recent_w) / conductance);
        }
        survived
    }

    /// Mean mole fraction of the negative electrode, at least that of an empty one.
    fn mean_fraction(&self, cell: &Cell, ideal: &IdealCell) -> f64 {
        (cell.state().charge_c() * ideal.fraction_per_c()).max(self.decisions.empty)
    }

    /// An explicit Euler step delivers at the voltage of its start, so a sum over steps exceeds the integral
    /// over the charge: by at most the charge of the largest step times the fall of the voltage at rest.
    fn credit_j(&self, filled: &[f64]) -> f64 {
        let largest_step_c = self.greatest_w / self.decisions.end_v * self.decisions.step_s;
        filled
            .iter()
            .map(|x| (resting_voltage(*x) - self.decisions.end_v).max(0.0) * largest_step_c)
            .sum()
    }
}

/// The mole fraction at rest of a voltage that lies between those of `empty` and of a full cell.
fn mole_fraction_at(voltage_v: f64, empty: f64) -> f64 {
    let (mut low, mut high) = (empty, MOLE_FRACTION_N_MAX);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if resting_voltage(middle) > voltage_v {
            high = middle;
        } else {
            low = middle;
        }
    }
    low
}

/// Pairs of stored energy, J, and a power that is fatal to every cell with less energy than the next pair:
/// steps above the true function.
fn capability(cell: &IdealCell, least: f64, lost_v: f64) -> Vec<(f64, f64)> {
    let at = |index: usize| {
        let part = index as f64 / GRID as f64;
        least + (MOLE_FRACTION_N_MAX - least) * part * part
    };
    let mut fatal_w = 0.0;
    let fatal: Vec<f64> = (1..=GRID)
        .map(|index| {
            fatal_w = cell.fatal_power_w(at(index), fatal_w);
            fatal_w
        })
        .collect();
    let energy_j = |index: usize| (resting_energy(at(index)) - lost_v) / cell.fraction_per_c();
    (0..=GRID)
        .map(|index| (energy_j(index), fatal[index.min(GRID - 1)]))
        .collect()
}

/// Corners of the least concave function above some points, which are sorted by their first entries.
fn concave(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut corners: Vec<(f64, f64)> = Vec::new();
    for &point in points {
        while let [.., before, last] = corners[..] {
            let lies_above =
                (last.1 - before.1) * (point.0 - before.0) > (point.1 - before.1) * (last.0 - before.0);
            if lies_above {
                break;
            }
            corners.pop();
        }
        corners.push(point);
    }
    corners
}

/// Energy left in the cells, drained where a joule costs the least power.
struct Reserve<'a> {
    bound: &'a LifeBound,
    stored_j: Vec<f64>,
    /// Energy that may be drained without loss of power, J.
    credit_j: f64,
    /// The piece that is being drained, and its remaining energy.
    piece: usize,
    left_j: f64,
    /// Largest power that the cells can deliver, W; below 0 without energy.
    power_w: f64,
}

impl<'a> Reserve<'a> {
    fn new(bound: &'a LifeBound, filled: &[f64]) -> Self {
        let cells = || filled.iter().zip(&bound.cells);
        let stored = |(x, cell): (&f64, &IdealCell)| {
            (resting_energy(*x) - bound.lost_v).max(0.0) / cell.fraction_per_c()
        };
        let mut reserve = Self {
            bound,
            stored_j: cells().map(stored).collect(),
            credit_j: bound.credit_j(filled),
            piece: 0,
            left_j: 0.0,
            power_w: bound.floor_w,
        };
        reserve.power_w += bound
            .pieces
            .iter()
            .map(|piece| piece.slope * reserve.length_j(piece))
            .sum::<f64>();
        reserve.left_j = bound.pieces.first().map_or(0.0, |piece| reserve.length_j(piece));
        reserve
    }

    /// Energy of all cells on a piece, J.
    fn length_j(&self, piece: &Piece) -> f64 {
        let alike = self
            .stored_j
            .iter()
            .zip(&self.bound.kinds)
            .filter(|(_, kind)| **kind == piece.kind);
        alike
            .map(|(stored_j, _)| (stored_j - piece.from_j).clamp(0.0, piece.to_j - piece.from_j))
            .sum()
    }

    fn drain(&mut self, energy_j: f64) {
        let free_j = energy_j.min(self.credit_j);
        self.credit_j -= free_j;
        let mut due_j = energy_j - free_j;
        while let Some(piece) = self.bound.pieces.get(self.piece) {
            let taken_j = due_j.min(self.left_j);
            self.power_w -= piece.slope * taken_j;
            self.left_j -= taken_j;
            due_j -= taken_j;
            if due_j <= 0.0 {
                return;
            }
            self.piece += 1;
            self.left_j = self
                .bound
                .pieces
                .get(self.piece)
                .map_or(0.0, |piece| self.length_j(piece));
        }
        self.power_w = f64::NEG_INFINITY;
    }
}

/// The quadratic form of the ohmic loss in the powers of the decisions.
#[derive(Debug, Clone, Copy, PartialEq)]
struct OhmicMemory {
    /// Weight of a decision's own power.
    own_s: f64,
    /// Weight of the powers before it.
    carried_s: f64,
    /// Fraction of the past that remains after a decision.
    kept: f64,
}

impl OhmicMemory {
    /// With `a` the fraction of the drop that settles in a step and `g` in a decision of n steps, the form has
    /// `n - g / a` on its diagonal and `(g / a) g (1 - g)^(t - s - 1)` below it. Its symmetric part is positive
    /// semidefinite, the form convex, where the diagonal is at least `g^2 / (a (2 - g))`; otherwise the loss is
    /// taken as 0, which is a lower bound.
    fn new(decisions: Decisions) -> Self {
        let (steps, settling) = (decisions.steps as f64, decisions.step_s / TIME_OHMIC_S);
        let kept = pow(1.0 - settling, steps);
        let carried = (1.0 - kept) / settling;
        let own = steps - carried;
        let is_convex = own * (1.0 + kept) >= carried * (1.0 - kept);
        let scale = if is_convex { decisions.step_s } else { 0.0 };
        Self {
            own_s: own * scale,
            carried_s: carried * scale,
            kept,
        }
    }

    /// Increment of the form by the next decision; `recent_w` is the faded sum of the powers before it.
    fn loss_j(&self, power_w: f64, recent_w: &mut f64) -> f64 {
        let loss = power_w * (self.own_s * power_w + self.carried_s * *recent_w);
        *recent_w = self.kept * *recent_w + (1.0 - self.kept) * power_w;
        loss
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_concave_function_lies_above_its_points_and_touches_its_corners() {
        let points = [
            (0.0, 1.0),
            (1.0, 4.0),
            (2.0, 3.0),
            (3.0, 3.5),
            (4.0, 5.0),
            (6.0, 5.5),
        ];
        assert_eq!(concave(&points), [(0.0, 1.0), (1.0, 4.0), (4.0, 5.0), (6.0, 5.5)]);
    }

    /// The form is the sum of current times ohmic drop of an explicit Euler scheme, for a source of one volt
    /// behind one ohm.
    #[test]
    fn the_form_is_the_ohmic_loss() {
        let decisions = Decisions {
            step_s: 1.0,
            steps: 10,
            end_v: 3.0,
            empty: 1e-3,
        };
        let (memory, powers_w) = (OhmicMemory::new(decisions), [2.0, 0.0, 5.0, 1.0]);
        let mut recent_w = 0.0;
        let form: f64 = powers_w
            .iter()
            .map(|power_w| memory.loss_j(*power_w, &mut recent_w))
            .sum();
        let (mut drop_v, mut lost_j) = (0.0, 0.0);
        for current_a in powers_w.iter().flat_map(|power_w| [*power_w; 10]) {
            lost_j += current_a * drop_v;
            drop_v += (current_a - drop_v) / TIME_OHMIC_S;
        }
        assert!((form - lost_j).abs() < 1e-9, "{form} {lost_j}");
    }

    /// With one step per decision, alternating between two sources would lose less than sharing: the loss
    /// counts as 0.
    #[test]
    fn a_form_that_is_not_convex_counts_nothing() {
        let memory = OhmicMemory::new(Decisions {
            step_s: 1.0,
            steps: 1,
            end_v: 3.0,
            empty: 1e-3,
        });
        assert_eq!(memory.loss_j(3.0, &mut 2.0), 0.0);
    }
}
