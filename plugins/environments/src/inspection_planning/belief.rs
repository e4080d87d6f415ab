//! Beliefs about the components: probabilities of crack sizes, with their changes by growth, repairs and
//! inspections.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | b_i(x given u) | `rows` of component i | `[n_factors, n_bins]` |
//! | alpha(u) | `weights` of the levels of the common factor | `[n_factors]` |
//! | b_i(x) = sum_u alpha(u) b_i(x given u) | [`Beliefs::marginal`] | `[n_bins]` |
//! | L_o(x) | probability of outcome o of an inspection, given the bin | `[n_bins]` |
//!
//! Given the factor u components are independent. Initial sizes depend on it by a Gaussian copula of one
//! factor, whose squared loading is rho: `P(d_0 <= e given u) = Phi((Phi^-1(1 - exp(-e)) - sqrt(rho) u) /
//! sqrt(1 - rho))`, and u is standard normal, here the middles of 80 equally likely slices. Uncorrelated
//! components have one level.
//!
//! Within a step, the rows of a component grow by its age, or become those of a new one after a repair; then
//! inspections are drawn, all with the weights from before the step, and their outcomes update the beliefs
//! component by component: `b_i(x given u) <- b_i(x given u) L_o(x) / l(u)`, `alpha(u) <- alpha(u) l(u) / sum`,
//! with `l(u) = sum_x b_i(x given u) L_o(x)`.

use super::crack_growth::{
    Belief, CrackGrowth, N_BINS, detection, edges_mm, first_size_cdf, first_sizes, masses,
};
use arithmetic::normal::{cdf, quantile};
use serde::{Deserialize, Serialize};
use std::sync::{Arc, OnceLock};

/// Levels of the common factor.
pub const N_FACTORS: usize = 80;
/// The squared loading in the published table of initial sizes.
const RHO: f64 = 0.826_656;
/// Probability below which an inspection finds nothing, as in the published program.
const IMPOSSIBLE: f64 = 1e-5;

/// Treatment of a component in a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Treatment {
    /// No treatment.
    Nothing,
    /// An inspection for a crack.
    Inspect,
    /// A repair, after which the component is as new.
    Repair,
}

impl Treatment {
    /// All treatments, in the order of the choices.
    pub const ALL: [Self; 3] = [Self::Nothing, Self::Inspect, Self::Repair];

    /// The name of the choice.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Nothing => "nothing",
            Self::Inspect => "inspect",
            Self::Repair => "repair",
        }
    }
}

/// Growth and repair of components, which all episodes share.
#[derive(Debug, Clone)]
pub struct Model {
    growth: Arc<CrackGrowth>,
    detection: Belief,
    /// Initial sizes of components by level of the factor.
    first: Vec<Belief>,
    repaired: Belief,
}

impl Model {
    /// Components with this crack growth, independent of each other or with a common factor.
    #[must_use]
    pub fn new(growth: Arc<CrackGrowth>, correlated: bool) -> Self {
        // A table from a file has initial sizes of its own, which are those of uncorrelated components.
        let (first, repaired) = if correlated {
            (first_sizes_by_factor(RHO), first_sizes())
        } else {
            (vec![growth.initial], growth.initial)
        };
        Self {
            growth,
            detection: detection(),
            first,
            repaired,
        }
    }

    /// Number of levels of the common factor; 1 without one.
    #[must_use]
    pub fn n_factors(&self) -> usize {
        self.first.len()
    }
}

/// Initial sizes given each level of the factor.
fn first_sizes_by_factor(rho: f64) -> Vec<Belief> {
    static COMPUTED: OnceLock<Vec<Belief>> = OnceLock::new();
    COMPUTED.get_or_init(|| by_factor(rho)).clone()
}

fn by_factor(rho: f64) -> Vec<Belief> {
    let below = edges_mm().map(|edge| quantile(first_size_cdf(edge)));
    #[allow(clippy::cast_precision_loss, reason = "a number of levels")]
    let level = |at: usize| quantile((at as f64 + 0.5) / N_FACTORS as f64);
    let given = |u: f64| masses(&below.map(|z| cdf((z - rho.sqrt() * u) / (1.0 - rho).sqrt())));
    (0..N_FACTORS).map(|at| given(level(at))).collect()
}

/// Beliefs about all components at one time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Beliefs {
    /// Years since each component was new.
    pub ages: Vec<usize>,
    /// Whether the last step inspected each component and found a crack.
    pub detected: Vec<bool>,
    /// Weights of the levels of the factor.
    pub weights: Vec<f64>,
    /// Bins by component and level.
    rows: Vec<Vec<Belief>>,
}

impl Beliefs {
    /// Beliefs about new components.
    #[must_use]
    pub fn new(model: &Model, n_components: usize) -> Self {
        let n = model.n_factors();
        #[allow(clippy::cast_precision_loss, reason = "a number of levels")]
        let weight = 1.0 / n as f64;
        Self {
            ages: vec![0; n_components],
            detected: vec![false; n_components],
            weights: vec![weight; n],
            rows: vec![model.first.clone(); n_components],
        }
    }

    /// Whether these beliefs have that many components and levels.
    #[must_use]
    pub fn fits(&self, n_components: usize, n_factors: usize) -> bool {
        let rows = |rows: &Vec<Belief>| rows.len() == n_factors;
        self.rows.len() == n_components
            && self.ages.len() == n_components
            && self.detected.len() == n_components
            && self.weights.len() == n_factors
            && self.rows.iter().all(rows)
    }

    /// Probabilities of the bins of a component.
    #[must_use]
    pub fn marginal(&self, component: usize) -> Belief {
        let mut sum = [0.0; N_BINS];
        for (row, weight) in self.rows[component].iter().zip(&self.weights) {
            sum.iter_mut().zip(row).for_each(|(sum, p)| *sum += weight * p);
        }
        sum
    }

    /// The marginals of all components.
    #[must_use]
    pub fn marginals(&self) -> Vec<Belief> {
        (0..self.rows.len())
            .map(|component| self.marginal(component))
            .collect()
    }

    /// Takes a step: growth and repairs, then inspections. `finds` decides, in the order of the components and
    /// for every inspected one, whether the inspection finds a crack, given the probability of a finding.
    /// Returns the marginals without the evidence of a component's own inspection, from which penalties are
    /// computed.
    pub fn advance(
        &mut self,
        model: &Model,
        treatments: &[Treatment],
        mut finds: impl FnMut(usize, f64) -> bool,
    ) -> Vec<Belief> {
        for (component, treatment) in treatments.iter().enumerate() {
            self.grow_or_renew(model, component, *treatment);
        }
        let inspected: Vec<usize> = (0..treatments.len())
            .filter(|component| treatments[*component] == Treatment::Inspect)
            .collect();
        let before: Vec<Belief> = inspected
            .iter()
            .map(|component| self.marginal(*component))
            .collect();
        let found: Vec<bool> = inspected
            .iter()
            .zip(&before)
            .map(|(component, marginal)| {
                let p = expected(marginal, &model.detection);
                finds(*component, p) && p >= IMPOSSIBLE
            })
            .collect();
        self.detected.fill(false);
        for (component, found) in inspected.iter().zip(found) {
            self.take_up(model, *component, found);
        }
        let mut without_evidence = self.marginals();
        for (component, marginal) in inspected.into_iter().zip(before) {
            without_evidence[component] = marginal;
        }
        without_evidence
    }

    fn grow_or_renew(&mut self, model: &Model, component: usize, treatment: Treatment) {
        let age = &mut self.ages[component];
        for row in &mut self.rows[component] {
            *row = match treatment {
                Treatment::Repair => model.repaired,
                _ => model.growth.grow(*age, row),
            };
        }
        *age = if treatment == Treatment::Repair {
            0
        } else {
            *age + 1
        };
    }

    /// Bayes' rule for one inspection.
    fn take_up(&mut self, model: &Model, component: usize, found: bool) {
        let likelihood = model.detection.map(|p| if found { p } else { 1.0 - p });
        for (row, weight) in self.rows[component].iter_mut().zip(&mut self.weights) {
            let evidence = expected(row, &likelihood);
            *weight *= evidence;
            // Detection is certain in no bin and possible in all, so evidence is above 0 where the row is.
            row.iter_mut()
                .zip(likelihood)
                .for_each(|(p, l)| *p *= l / evidence);
        }
        let sum: f64 = self.weights.iter().sum();
        self.weights.iter_mut().for_each(|weight| *weight /= sum);
        self.detected[component] = found;
    }
}

fn expected(belief: &Belief, values: &Belief) -> f64 {
    belief.iter().zip(values).map(|(p, value)| p * value).sum()
}

/// Probability that fewer than `required` independent components work, given their failure probabilities.
#[must_use]
pub fn system_failure(failure: impl IntoIterator<Item = f64>, required: usize) -> f64 {
    // Entry j: the probability that j components work; the last one counts `required` and more.
    let mut working = vec![0.0; required + 1];
    working[0] = 1.0;
    for p in failure {
        working[required] += working[required - 1] * (1.0 - p);
        for count in (1..required).rev() {
            working[count] = working[count] * p + working[count - 1] * (1.0 - p);
        }
        working[0] *= p;
    }
    working[..required].iter().sum()
}

#[cfg(test)]
mod tests {
    use super::super::crack_growth::FAILED;
    use super::*;
    use proptest::prelude::*;

    fn model(correlated: bool) -> Model {
        Model::new(CrackGrowth::of_paris_law(), correlated)
    }

    /// The probability by enumeration of all cases.
    fn by_enumeration(failure: &[f64], required: usize) -> f64 {
        let probability = |set: u32| {
            let of = |(at, p): (usize, &f64)| if (set >> at) & 1 == 1 { 1.0 - p } else { *p };
            failure.iter().enumerate().map(of).product::<f64>()
        };
        let fails = |set: &u32| (set.count_ones() as usize) < required;
        (0..1 << failure.len()).filter(fails).map(probability).sum()
    }

    proptest! {
        #[test]
        fn the_failure_probability_is_that_of_all_cases(failure in prop::collection::vec(0.0..1.0f64, 1..9), part in 0.0..1.0f64) {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss, reason = "a few components")]
            let required = 1 + (part * failure.len() as f64) as usize;
            let (ours, theirs) = (system_failure(failure.clone(), required), by_enumeration(&failure, required));
            prop_assert!((ours - theirs).abs() < 1e-14, "{ours} {theirs}");
        }

        /// Any sequence of treatments and outcomes, compared with Bayes' rule over the joint distribution of
        /// the factor and both components.
        #[test]
        fn beliefs_are_those_of_the_joint_distribution(steps in prop::collection::vec((0usize..3, 0usize..3, any::<bool>(), any::<bool>()), 1..4)) {
            let model = model(true);
            let (mut beliefs, mut joint) = (Beliefs::new(&model, 2), Joint::new(&model));
            for (first, second, one, two) in steps {
                let treatments = [Treatment::ALL[first], Treatment::ALL[second]];
                beliefs.advance(&model, &treatments, |component, _| [one, two][component]);
                joint.advance(&model, treatments, [one, two]);
                for component in 0..2 {
                    let theirs = joint.marginal(component);
                    let ours = beliefs.marginal(component);
                    prop_assert!((0..N_BINS).all(|bin| (ours[bin] - theirs[bin]).abs() < 1e-12), "{ours:?} {theirs:?}");
                }
            }
            prop_assert!((beliefs.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
    }

    /// P(u, x_1, x_2), without any use of independence.
    struct Joint {
        cells: Vec<[[f64; N_BINS]; N_BINS]>,
        ages: [usize; 2],
    }

    impl Joint {
        fn new(model: &Model) -> Self {
            let of = |row: &Belief| row.map(|a| row.map(|b| a * b / 80.0));
            Self {
                cells: model.first.iter().map(of).collect(),
                ages: [0; 2],
            }
        }

        fn advance(&mut self, model: &Model, treatments: [Treatment; 2], found: [bool; 2]) {
            let row = |component: usize, from: usize| match treatments[component] {
                Treatment::Repair => model.repaired,
                _ => model.growth.grow(
                    self.ages[component],
                    &std::array::from_fn(|bin| f64::from(u8::from(bin == from))),
                ),
            };
            let outcome = |component: usize, to: usize| match (treatments[component], found[component]) {
                (Treatment::Inspect, true) => model.detection[to],
                (Treatment::Inspect, false) => 1.0 - model.detection[to],
                _ => 1.0,
            };
            let rows: Vec<Vec<Belief>> = (0..2)
                .map(|c| (0..N_BINS).map(|from| row(c, from)).collect())
                .collect();
            for cells in &mut self.cells {
                let half: Vec<Belief> = (0..N_BINS)
                    .map(|a| std::array::from_fn(|y| (0..N_BINS).map(|b| cells[a][b] * rows[1][b][y]).sum()))
                    .collect();
                *cells = std::array::from_fn(|x| {
                    std::array::from_fn(|y| {
                        let moved: f64 = (0..N_BINS).map(|a| half[a][y] * rows[0][a][x]).sum();
                        moved * outcome(0, x) * outcome(1, y)
                    })
                });
            }
            let sum: f64 = self.cells.iter().flatten().flatten().sum();
            self.cells.iter_mut().flatten().flatten().for_each(|p| *p /= sum);
            for (age, treatment) in self.ages.iter_mut().zip(treatments) {
                *age = if treatment == Treatment::Repair {
                    0
                } else {
                    *age + 1
                };
            }
        }

        fn marginal(&self, component: usize) -> Belief {
            let mut sum = [0.0; N_BINS];
            for cells in &self.cells {
                for (x, row) in cells.iter().enumerate() {
                    row.iter()
                        .enumerate()
                        .for_each(|(y, p)| sum[[x, y][component]] += p);
                }
            }
            sum
        }
    }

    #[test]
    fn without_correlation_every_level_has_the_sizes_of_new_components() {
        let independent = by_factor(0.0);
        for row in &independent {
            assert!(
                row.iter().zip(first_sizes()).all(|(a, b)| (a - b).abs() < 1e-14),
                "{row:?}"
            );
        }
        let mut correlated = model(true);
        correlated.first = independent;
        let plain = model(false);
        let (mut one, mut other) = (Beliefs::new(&correlated, 3), Beliefs::new(&plain, 3));
        for (step, found) in [true, false, true, false].into_iter().enumerate() {
            let treatments: Vec<Treatment> = (0..3).map(|c| Treatment::ALL[(c + step) % 3]).collect();
            one.advance(&correlated, &treatments, |_, _| found);
            other.advance(&plain, &treatments, |_, _| found);
            for (a, b) in one.marginals().iter().zip(other.marginals()) {
                assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-13));
            }
        }
    }

    #[test]
    fn a_finding_in_one_component_changes_the_beliefs_about_correlated_ones() {
        for (correlated, speaks) in [(true, true), (false, false)] {
            let model = model(correlated);
            let mut beliefs = Beliefs::new(&model, 2);
            let treatments = [Treatment::Inspect, Treatment::Nothing];
            let without = beliefs.advance(&model, &treatments, |_, _| true);
            let other = beliefs.marginal(1)[FAILED];
            let grown = Model::new(CrackGrowth::of_paris_law(), correlated);
            let mut alone = Beliefs::new(&grown, 2);
            alone.advance(&grown, &[Treatment::Nothing; 2], |_, _| false);
            assert_eq!(other > alone.marginal(1)[FAILED], speaks);
            // Penalties count the inspected component without its own evidence.
            assert!((without[0][FAILED] - alone.marginal(0)[FAILED]).abs() < 1e-16);
            assert!((without[1][FAILED] - other).abs() < 1e-18);
        }
    }
}
