//! A lower bound on the cost of every policy: the cost of the best policy that observes all states.
//!
//! Backward induction over the joint states (4^5) and the sets of components that are replaced (2^5): `V_t(s) =
//! min_a c(s, a) + gamma sum_s' P(s' given s, a) V_(t+1)(s')`, `V_T = 0`. A policy that observes the states
//! needs no inspection; any other policy knows less and pays the same costs, so its expected cost is at least
//! `V_0(all new)`.

use super::components::{COMPONENTS, FAILED, Matrix, N_COMPONENTS, N_STATES, worn};

/// Factor of each component's state in the joint state, a number in base 4.
const STRIDES: [usize; N_COMPONENTS] = [1, 4, 16, 64, 256];
const N_JOINT: usize = 1024;

/// The parameters of the bound.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Problem {
    /// Components that must work.
    pub required: usize,
    /// Steps of an episode.
    pub horizon: usize,
    /// Discount of a step.
    pub discount: f64,
    /// Cost of a step in which fewer work.
    pub failure_cost: f64,
    /// Factor of the published probabilities that a component leaves a state within a step, 0 to 3.
    pub wear: f64,
}

/// The smallest expected cost of an episode for a policy that sees all states.
#[must_use]
pub fn least_cost(problem: &Problem) -> f64 {
    let transitions =
        worn(problem.wear).map(|component| [false, true].map(|replaced| component.transition(replaced)));
    let mut values = vec![0.0; N_JOINT];
    for _ in 0..problem.horizon {
        let failed: Vec<f64> = (0..N_JOINT).map(|state| failure_cost(problem, state)).collect();
        let mut best = vec![f64::INFINITY; N_JOINT];
        for replaced in 0..1 << N_COMPONENTS {
            let ahead = expected(&values, &transitions, replaced);
            let cost = replacement_cost(replaced);
            best.iter_mut()
                .zip(&failed)
                .zip(ahead)
                .for_each(|((best, failed), ahead)| {
                    *best = best.min(cost + failed + problem.discount * ahead);
                });
        }
        values = best;
    }
    values[0]
}

fn state_of(joint: usize, component: usize) -> usize {
    joint / STRIDES[component] % N_STATES
}

fn is_replaced(set: usize, component: usize) -> bool {
    (set >> component) & 1 == 1
}

fn failure_cost(problem: &Problem, joint: usize) -> f64 {
    let working = (0..N_COMPONENTS)
        .filter(|component| state_of(joint, *component) != FAILED)
        .count();
    if working < problem.required {
        problem.failure_cost
    } else {
        0.0
    }
}

fn replacement_cost(set: usize) -> f64 {
    let costs = COMPONENTS
        .iter()
        .enumerate()
        .filter(|(component, _)| is_replaced(set, *component));
    costs.map(|(_, component)| component.replacement_cost).sum()
}

/// Values one step ahead by joint state, averaged over one component's next state after the other.
fn expected(values: &[f64], transitions: &[[Matrix; 2]; N_COMPONENTS], set: usize) -> Vec<f64> {
    let mut values = values.to_vec();
    for (component, of) in transitions.iter().enumerate() {
        let matrix = &of[usize::from(is_replaced(set, component))];
        let stride = STRIDES[component];
        let averaged = |joint: usize| {
            let state = state_of(joint, component);
            let first = joint - state * stride;
            matrix[state]
                .iter()
                .enumerate()
                .map(|(to, p)| p * values[first + to * stride])
                .sum()
        };
        values = (0..N_JOINT).map(averaged).collect();
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problem(required: usize, horizon: usize, failure_cost: f64) -> Problem {
        Problem {
            required,
            horizon,
            discount: 0.99,
            failure_cost,
            wear: 1.0,
        }
    }

    /// New components need two steps to fail, and where a failure costs less than any replacement, none is
    /// replaced: the third step costs a failure with the probability that some component has failed by then.
    #[test]
    fn a_short_horizon_by_hand() {
        assert_eq!(least_cost(&problem(5, 2, 2400.0)), 0.0);
        let fails = |component: &super::super::components::Component| {
            let d = component.transition(false);
            (0..N_STATES).map(|via| d[0][via] * d[via][FAILED]).sum::<f64>()
        };
        let all_work: f64 = COMPONENTS
            .iter()
            .map(|component| 1.0 - fails(component))
            .product();
        let left_alone = 0.99_f64.powi(2) * (1.0 - all_work);
        assert!((least_cost(&problem(5, 3, 10.0)) - 10.0 * left_alone).abs() < 1e-12);
        // Where a failure costs more, replacements pay.
        assert!(least_cost(&problem(5, 3, 2400.0)) < 0.9 * 2400.0 * left_alone);
    }

    #[test]
    fn more_wear_costs_more() {
        let with = |wear: f64| {
            least_cost(&Problem {
                wear,
                ..problem(4, 20, 2400.0)
            })
        };
        assert!(with(0.5) < 0.8 * with(1.0) && with(1.5) > 1.2 * with(1.0));
        assert_eq!(with(0.0), 0.0);
    }

    #[test]
    fn expectations_are_sums_over_all_joint_states() {
        let transitions =
            COMPONENTS.map(|component| [false, true].map(|replaced| component.transition(replaced)));
        #[allow(clippy::cast_precision_loss, reason = "a thousand states")]
        let values: Vec<f64> = (0..N_JOINT).map(|joint| (joint as f64 * 0.37).sin()).collect();
        for (set, from) in [(0, 0), (0b10110, 123), (0b11111, 1023), (0b01001, 682)] {
            let probability = |to: usize| -> f64 {
                let of = |component: usize| {
                    let matrix = &transitions[component][usize::from(is_replaced(set, component))];
                    matrix[state_of(from, component)][state_of(to, component)]
                };
                (0..N_COMPONENTS).map(of).product()
            };
            let sum: f64 = (0..N_JOINT).map(|to| probability(to) * values[to]).sum();
            assert!(
                (expected(&values, &transitions, set)[from] - sum).abs() < 1e-13,
                "{set} {from}"
            );
        }
    }

    #[test]
    fn more_is_paid_where_more_must_work_and_never_more_than_the_published_policies_pay() {
        let bounds: Vec<f64> = (1..=5)
            .map(|required| least_cost(&problem(required, 50, 2400.0)))
            .collect();
        assert!(bounds.is_sorted(), "{bounds:?}");
        for (bound, published) in bounds.iter().zip([1485.74, 1498.8, 1654.19, 3998.41, 19728.42]) {
            assert!(*bound > 0.0 && *bound < published, "{bound} {published}");
        }
    }
}
