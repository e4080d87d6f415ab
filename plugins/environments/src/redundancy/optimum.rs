//! The best design of a system within its budgets, by dynamic programming.
//!
//! V_i(c, w), the best reliability of subsystems 1 to i for at most cost c and weight w, is the largest
//! V_{i-1}(c - cost, w - weight) R_i over the fillings of subsystem i. The search is exact: a product of
//! doubles does not fall when a factor grows, so no design's rounded reliability exceeds the result.

use super::system::{Budget, Component, Counts, MOST_TYPES, Part};

/// The best design.
#[derive(Debug, Clone, PartialEq)]
pub struct Optimum {
    /// Reliability R of the system.
    pub reliability: f64,
    /// Components of every subsystem.
    pub counts: Vec<Counts>,
}

/// The best design with one to `places` components in each subsystem; `None` where no design is within the
/// budget.
#[must_use]
pub fn optimum(subsystems: &[&[Component]], places: usize, budget: Budget) -> Option<Optimum> {
    let tables = tables(subsystems, places, budget);
    // The last entry belongs to the whole budget.
    let reliability = tables.last()?.best.last().copied().filter(|best| *best > 0.0)?;
    Some(Optimum {
        reliability,
        counts: trace_back(&tables, budget),
    })
}

/// V_1, V_2 and so on, up to the whole budget.
fn tables(subsystems: &[&[Component]], places: usize, budget: Budget) -> Vec<ValueTable> {
    let nothing = vec![1.0; (budget.cost + 1) * (budget.weight + 1)];
    let mut tables: Vec<ValueTable> = Vec::with_capacity(subsystems.len());
    for types in subsystems {
        let before = tables.last().map_or(&nothing, |table| &table.best);
        tables.push(ValueTable::of(types, places, budget, before));
    }
    tables
}

/// V_i and the filling that attains it, by cost and weight.
struct ValueTable {
    ways: Vec<(Counts, Part)>,
    best: Vec<f64>,
    /// Index into `ways`; meaningless where `best` is 0.
    way: Vec<usize>,
}

impl ValueTable {
    fn of(types: &[Component], places: usize, budget: Budget, before: &[f64]) -> Self {
        let parts = fillings(types.len(), places)
            .into_iter()
            .map(|counts| (counts, Part::of(types, &counts)));
        let mut table = ValueTable {
            ways: parts.collect(),
            best: vec![0.0; before.len()],
            way: vec![0; before.len()],
        };
        for index in 0..table.ways.len() {
            table.offer(index, budget, before);
        }
        table
    }

    /// Takes a filling wherever it is better than those before it.
    fn offer(&mut self, index: usize, budget: Budget, before: &[f64]) {
        let part = self.ways[index].1;
        let width = budget.weight + 1;
        for cost in part.cost..=budget.cost {
            for weight in part.weight..=budget.weight {
                let reached = before[(cost - part.cost) * width + weight - part.weight] * part.reliability;
                let at = cost * width + weight;
                if reached > self.best[at] {
                    self.best[at] = reached;
                    self.way[at] = index;
                }
            }
        }
    }
}

fn trace_back(tables: &[ValueTable], budget: Budget) -> Vec<Counts> {
    let Budget { mut cost, mut weight } = budget;
    let mut counts = Vec::with_capacity(tables.len());
    for table in tables.iter().rev() {
        let (of_subsystem, part) = table.ways[table.way[cost * (budget.weight + 1) + weight]];
        counts.push(of_subsystem);
        cost -= part.cost;
        weight -= part.weight;
    }
    counts.reverse();
    counts
}

/// All combinations of one to `places` components of some types.
fn fillings(types: usize, places: usize) -> Vec<Counts> {
    let mut all = vec![Counts::default()];
    for of in 0..types.min(MOST_TYPES) {
        all = all
            .into_iter()
            .flat_map(|counts| with_more(counts, of, places))
            .collect();
    }
    all.retain(|counts| counts.iter().sum::<usize>() > 0);
    all
}

/// The same components with zero to all remaining places filled by one more type.
fn with_more(counts: Counts, of: usize, places: usize) -> impl Iterator<Item = Counts> {
    let left = places - counts.iter().sum::<usize>();
    (0..=left).map(move |count| {
        let mut more = counts;
        more[of] = count;
        more
    })
}

#[cfg(test)]
mod tests {
    use super::super::system::{SUBSYSTEMS, Total};
    use super::*;
    use proptest::prelude::*;

    const PUBLISHED_COST: usize = 130;

    fn of_weight(weight: usize, places: usize) -> Optimum {
        let budget = Budget {
            cost: PUBLISHED_COST,
            weight,
        };
        optimum(&SUBSYSTEMS, places, budget).unwrap()
    }

    /// The best values in the literature for mixed components and at most eight in a subsystem, to the six
    /// digits in the tests of the Python package `repyability`.
    #[test]
    fn published_optima_are_found() {
        for (weight, published) in [
            (191, 0.986_811),
            (190, 0.986_416),
            (189, 0.985_922),
            (159, 0.954_565),
        ] {
            for places in [4, 8] {
                let found = of_weight(weight, places).reliability;
                assert!((found - published).abs() <= 0.5e-6, "{weight} {places}: {found}");
            }
        }
    }

    /// The optimum for weights 0 to 191, from one run.
    fn by_weight(places: usize) -> Vec<f64> {
        let budget = Budget {
            cost: PUBLISHED_COST,
            weight: 191,
        };
        let mut best = tables(&SUBSYSTEMS, places, budget).pop().unwrap().best;
        best.split_off(PUBLISHED_COST * 192)
    }

    /// All 33 problems of Nakagawa and Miyazaki: four places lose nothing compared with the eight that they
    /// allow.
    #[test]
    fn four_places_hold_every_published_optimum_and_three_do_not() {
        let [three, four, eight] = [3, 4, 8].map(by_weight);
        for weight in 159..=191 {
            assert_eq!(four[weight], eight[weight], "{weight}");
            assert!(three[weight] < four[weight], "{weight}");
            assert_eq!(four[weight], of_weight(weight, 4).reliability, "{weight}");
        }
    }

    #[test]
    fn the_design_is_worth_what_it_is_said_to_be() {
        for weight in 159..=191 {
            let found = of_weight(weight, 4);
            let parts = SUBSYSTEMS
                .iter()
                .zip(&found.counts)
                .map(|(types, counts)| Part::of(types, counts));
            let total = Total::of(parts);
            assert_eq!(total.reliability, found.reliability);
            assert!(total.cost <= PUBLISHED_COST && total.weight <= weight);
        }
    }

    #[test]
    fn without_a_design_there_is_no_optimum() {
        let is_possible = |cost, weight| optimum(&SUBSYSTEMS, 4, Budget { cost, weight }).is_some();
        // One of the lightest type each weighs 68, one of the cheapest each costs 34.
        assert!(!is_possible(1000, 67) && is_possible(1000, 68));
        assert!(!is_possible(33, 1000) && is_possible(34, 1000));
    }

    #[test]
    fn fillings_are_counted() {
        // Multisets of up to 4 of 4 types, without the empty one: 8 choose 4, less 1.
        assert_eq!(fillings(4, 4).len(), 69);
        assert_eq!(fillings(3, 2).len(), 9);
    }

    /// The best of all designs, tried one by one.
    fn by_brute_force(subsystems: &[&[Component]], places: usize, budget: Budget) -> Option<f64> {
        let mut designs = vec![vec![]];
        for types in subsystems {
            let ways = fillings(types.len(), places);
            let longer = |design: Vec<Part>| {
                ways.iter().map(move |counts| {
                    let part = Part::of(types, counts);
                    design.iter().copied().chain([part]).collect::<Vec<_>>()
                })
            };
            designs = designs.into_iter().flat_map(longer).collect();
        }
        let totals = designs.into_iter().map(|design| Total::of(design.into_iter()));
        let within = totals.filter(|total| total.is_within(budget));
        within.map(|total| total.reliability).max_by(f64::total_cmp)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn brute_force_finds_the_same(first in 0_usize..12, places in 1_usize..4, cost in 3_usize..40, weight in 6_usize..60) {
            let (subsystems, budget) = (&SUBSYSTEMS[first..first + 3], Budget { cost, weight });
            let found = optimum(subsystems, places, budget).map(|best| best.reliability);
            prop_assert_eq!(found, by_brute_force(subsystems, places, budget));
        }
    }
}
