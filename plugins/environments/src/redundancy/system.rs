//! The 14 subsystems in series of D. E. Fyffe, W. W. Hines and N. K. Lee, "System reliability allocation and a
//! computational algorithm", IEEE Transactions on Reliability R-17 (1968) 64-69, and the reliability, cost and
//! weight of designs.
//!
//! Subsystem i works while one of its components does, the system while all its subsystems do:
//!
//! R_i = 1 - prod_j (1 - r_ij)^(n_ij), R = prod_i R_i.
//!
//! | symbol | here |
//! |---|---|
//! | r_ij | `reliability` of a component of type j for subsystem i |
//! | n_ij | number of such components |
//! | R_i, R | `reliability` of a [`Part`], of a [`Total`] |

use arithmetic::double::ln;

/// A type of component.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Component {
    /// Probability that the component works.
    pub reliability: f64,
    /// Cost of one component, in units of the paper.
    pub cost: usize,
    /// Weight of one component, in units of the paper.
    pub weight: usize,
}

/// Largest number of types of a subsystem.
pub const MOST_TYPES: usize = 4;

const fn component(reliability: f64, cost: usize, weight: usize) -> Component {
    Component {
        reliability,
        cost,
        weight,
    }
}

/// Types of components of every subsystem.
pub const SUBSYSTEMS: [&[Component]; 14] = [
    &[
        component(0.90, 1, 3),
        component(0.93, 1, 4),
        component(0.91, 2, 2),
        component(0.95, 2, 5),
    ],
    &[
        component(0.95, 2, 8),
        component(0.94, 1, 10),
        component(0.93, 1, 9),
    ],
    &[
        component(0.85, 2, 7),
        component(0.90, 3, 5),
        component(0.87, 1, 6),
        component(0.92, 4, 4),
    ],
    &[
        component(0.83, 3, 5),
        component(0.87, 4, 6),
        component(0.85, 5, 4),
    ],
    &[
        component(0.94, 2, 4),
        component(0.93, 2, 3),
        component(0.95, 3, 5),
    ],
    &[
        component(0.99, 3, 5),
        component(0.98, 3, 4),
        component(0.97, 2, 5),
        component(0.96, 2, 4),
    ],
    &[
        component(0.91, 4, 7),
        component(0.92, 4, 8),
        component(0.94, 5, 9),
    ],
    &[
        component(0.81, 3, 4),
        component(0.90, 5, 7),
        component(0.91, 6, 6),
    ],
    &[
        component(0.97, 2, 8),
        component(0.99, 3, 9),
        component(0.96, 4, 7),
        component(0.91, 3, 8),
    ],
    &[
        component(0.83, 4, 6),
        component(0.85, 4, 5),
        component(0.90, 5, 6),
    ],
    &[
        component(0.94, 3, 5),
        component(0.95, 4, 6),
        component(0.96, 5, 6),
    ],
    &[
        component(0.79, 2, 4),
        component(0.82, 3, 5),
        component(0.85, 4, 6),
        component(0.90, 5, 7),
    ],
    &[
        component(0.98, 2, 5),
        component(0.99, 3, 5),
        component(0.97, 2, 6),
    ],
    &[
        component(0.90, 4, 6),
        component(0.92, 4, 7),
        component(0.95, 5, 6),
        component(0.99, 6, 9),
    ],
];

/// Number of components of each type in a subsystem; entries beyond its types are ignored.
pub type Counts = [usize; MOST_TYPES];

/// Reliability, cost and weight of one subsystem.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// R_i; 0 without components.
    pub reliability: f64,
    /// Cost of all its components.
    pub cost: usize,
    /// Weight of all its components.
    pub weight: usize,
}

impl Part {
    /// The subsystem with these numbers of components of each type.
    #[must_use]
    pub fn of(types: &[Component], counts: &Counts) -> Self {
        let mut part = Part {
            reliability: 0.0,
            cost: 0,
            weight: 0,
        };
        let mut unreliability = 1.0;
        for (one, &count) in types.iter().zip(counts) {
            part.cost += count * one.cost;
            part.weight += count * one.weight;
            for _ in 0..count {
                unreliability *= 1.0 - one.reliability;
            }
        }
        part.reliability = 1.0 - unreliability;
        part
    }
}

/// One component of the lightest type, the cheapest of equally light ones, which a subsystem has before it is
/// designed.
#[must_use]
pub fn starter(types: &[Component]) -> Counts {
    let lightest = (0..types.len()).min_by_key(|&at| (types[at].weight, types[at].cost));
    let mut counts = Counts::default();
    counts[lightest.unwrap_or(0)] = 1;
    counts
}

/// Limits of cost and weight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Budget {
    /// The largest cost of a system.
    pub cost: usize,
    /// The largest weight of a system.
    pub weight: usize,
}

/// Reliability, cost and weight of subsystems in series.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Total {
    /// R of the subsystems; 1 without any.
    pub reliability: f64,
    /// Cost of all components.
    pub cost: usize,
    /// Weight of all components.
    pub weight: usize,
}

impl Total {
    /// Adds up subsystems in series, in order.
    pub fn of(parts: impl Iterator<Item = Part>) -> Self {
        let nothing = Self {
            reliability: 1.0,
            cost: 0,
            weight: 0,
        };
        parts.fold(nothing, |total, part| Self {
            reliability: total.reliability * part.reliability,
            cost: total.cost + part.cost,
            weight: total.weight + part.weight,
        })
    }

    /// Whether cost and weight are within the budget.
    #[must_use]
    pub fn is_within(&self, budget: Budget) -> bool {
        self.cost <= budget.cost && self.weight <= budget.weight
    }

    /// -ln(1 - R), at least 0, within the budgets; beyond them minus the relative excesses. So every design
    /// within the budgets has a higher score than any beyond them, and of two beyond them the nearer one is
    /// higher (the comparison of K. Deb, "An efficient constraint handling method for genetic algorithms",
    /// Computer Methods in Applied Mechanics and Engineering 186 (2000) 311-338).
    #[must_use]
    #[allow(clippy::cast_precision_loss, reason = "costs and weights are far below 2^52")]
    pub fn score(&self, budget: Budget) -> f64 {
        if self.is_within(budget) {
            return -ln(1.0 - self.reliability);
        }
        let beyond = |spent: usize, limit: usize| spent.saturating_sub(limit) as f64 / limit as f64;
        -(beyond(self.cost, budget.cost) + beyond(self.weight, budget.weight))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Two of 0.90 and one of 0.95: 1 - 0.1 * 0.1 * 0.05.
    #[test]
    fn a_subsystem_by_hand() {
        let part = Part::of(SUBSYSTEMS[0], &[2, 0, 0, 1]);
        assert!((part.reliability - 0.9995).abs() < 1e-15);
        assert_eq!((part.cost, part.weight), (4, 11));
        let empty = Part::of(SUBSYSTEMS[1], &[0, 0, 0, 3]);
        assert_eq!((empty.reliability, empty.cost, empty.weight), (0.0, 0, 0));
        assert_eq!(starter(SUBSYSTEMS[0]), [0, 0, 1, 0]);
    }

    #[test]
    fn scores_by_hand() {
        let total = |reliability, cost, weight| Total {
            reliability,
            cost,
            weight,
        };
        let budget = Budget {
            cost: 100,
            weight: 50,
        };
        assert!((total(0.9, 100, 50).score(budget) - 10.0_f64.ln()).abs() < 1e-12);
        assert_eq!(total(0.0, 0, 0).score(budget), 0.0);
        assert!((total(0.999, 110, 50).score(budget) + 0.1).abs() < 1e-15);
        assert!((total(0.999, 110, 60).score(budget) + 0.3).abs() < 1e-15);
    }

    fn any_counts() -> impl Strategy<Value = Vec<Counts>> {
        prop::collection::vec(prop::array::uniform4(0_usize..5), 14)
    }

    fn total(counts: &[Counts]) -> Total {
        Total::of(
            SUBSYSTEMS
                .iter()
                .zip(counts)
                .map(|(types, counts)| Part::of(types, counts)),
        )
    }

    proptest! {
        #[test]
        fn a_component_more_never_harms_and_is_paid_for(mut counts in any_counts(), at in 0_usize..14, of in 0_usize..4) {
            let before = total(&counts);
            counts[at][of] += 1;
            let after = total(&counts);
            prop_assert!(after.reliability >= before.reliability && after.reliability <= 1.0);
            let (cost, weight) = SUBSYSTEMS[at].get(of).map_or((0, 0), |one| (one.cost, one.weight));
            prop_assert_eq!((after.cost, after.weight), (before.cost + cost, before.weight + weight));
        }

        #[test]
        fn within_the_budgets_is_worth_more_than_beyond(counts in any_counts(), cost in 1_usize..900, weight in 1_usize..1500) {
            let (total, budget) = (total(&counts), Budget { cost, weight });
            let score = total.score(budget);
            prop_assert!(score.is_finite() && total.is_within(budget) == (score >= 0.0));
        }
    }
}
