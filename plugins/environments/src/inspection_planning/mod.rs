//! Inspections and repairs of a system of cracking components, of which at least k of n must work.
//!
//! The `struct` environments of P. Leroy, P. G. Morato, J. Pisane, A. Kolios and D. Ernst, "IMP-MARL: a suite
//! of environments for large-scale infrastructure management planning via MARL", NeurIPS 2023,
//! arXiv:2306.11551. A step is a year, a seat a component. The knowledge of a component is a belief over bins
//! of crack sizes ([`belief`]); cracks grow by the Paris law ([`crack_growth`]). There is no hidden truth:
//! inspections are drawn from the beliefs, and failures are paid for by their probability.
//!
//! | symbol | here | shape, range |
//! |---|---|---|
//! | b_i(x) | `belief_0` .. `belief_28`, `failure_probability` | `[30]`, sums to 1 |
//! | alpha(u) | `factor_0` .. `factor_79`, correlated systems only | `[80]`, sums to 1 |
//! | t / T | `time`, the elapsed fraction of the episode | in [0, 1] |
//! | r_i | `age`, years since the component was new | |
//! | F | probability that fewer than k components work | |
//! | c | costs of the step: an inspection 1, a repair 20 (campaign: 0.2, 20, and 5 for a step with either) | |
//! | gamma | `discount` | |
//!
//! Every seat earns `gamma^t (-c - 10000 r)`, with the risk `r = F' - F`, or F' where F' is below F. F is
//! computed from the beliefs before the step, F' from those after it, without the findings of a component's own
//! inspection.
//!
//! A seat observes its own belief, the time, and alpha. The full state has the beliefs, ages and last findings
//! of all seats, the step and alpha. Departure: the published state has the time once for every seat, and
//! findings (`detected`) are not part of it but given to the published heuristic separately.
//!
//! Metrics, sums over an episode, discounted: `inspection_cost`, `repair_cost`, `campaign_cost` and `risk_cost`, which
//! add up to minus the return; and plain counts of `inspections` and `repairs`.
//!
//! For the constants of the crack growth and the table of the published program see [`crack_growth`]. That
//! table was counted from samples; `crack_growth: { file: .. }` uses it instead of the quadrature.

pub mod belief;
mod config;
pub mod crack_growth;

pub use config::{Growth, InspectionPlanningConfig};

use crate::choices;
use arithmetic::power::powi;
use belief::{Beliefs, Model, Treatment, system_failure};
use contract::{Channel, End, Environment, Error, Metric, Rng, Seat, Space, Step};
use crack_growth::{Belief, FAILED};
use rand::Rng as _;
use serde::{Deserialize, Serialize};

const INSPECTION_COST: f64 = 1.0;
const CAMPAIGN_INSPECTION_COST: f64 = 0.2;
const REPAIR_COST: f64 = 20.0;
const CAMPAIGN_COST: f64 = 5.0;
const FAILURE_COST: f64 = 10_000.0;

/// The `inspection_planning` environment.
#[derive(Debug)]
pub struct InspectionPlanning {
    config: InspectionPlanningConfig,
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    model: Model,
    progress: Progress,
    /// Marginals of the beliefs.
    marginals: Vec<Belief>,
}

/// State of an episode.
#[derive(Debug, Serialize, Deserialize)]
struct Progress {
    step: usize,
    beliefs: Beliefs,
}

/// Costs of a step, undiscounted.
#[derive(Debug, Clone, Copy, Default)]
struct Costs {
    inspection: f64,
    repair: f64,
    campaign: f64,
    risk: f64,
}

/// Builds the environment; registered as `inspection_planning`.
///
/// # Errors
/// [`Error::Config`] for a number outside its range, and the errors of a table from a file.
pub fn build(config: InspectionPlanningConfig) -> Result<Box<dyn Environment>, Error> {
    Ok(Box::new(InspectionPlanning::new(config)?))
}

impl InspectionPlanning {
    fn new(config: InspectionPlanningConfig) -> Result<Self, Error> {
        config.check()?;
        let model = Model::new(config.growth()?, config.correlated);
        let beliefs = Beliefs::new(&model, config.components);
        Ok(Self {
            seats: seats(&config, model.n_factors()),
            metrics: metrics(),
            marginals: beliefs.marginals(),
            progress: Progress { step: 0, beliefs },
            model,
            config,
        })
    }

    fn failure_probability(&self, marginals: &[Belief]) -> f64 {
        system_failure(
            marginals.iter().map(|belief| belief[FAILED]),
            self.config.n_required(),
        )
    }

    /// Takes a step; `finds` decides each inspection from the component and the probability of a finding.
    fn advance(&mut self, treatments: &[Treatment], finds: impl FnMut(usize, f64) -> bool) -> Step {
        let before = self.failure_probability(&self.marginals);
        let without_evidence = self.progress.beliefs.advance(&self.model, treatments, finds);
        let after = self.failure_probability(&without_evidence);
        self.marginals = self.progress.beliefs.marginals();
        let costs = self.costs(treatments, before, after);
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_possible_wrap,
            reason = "at most 30 steps"
        )]
        let discount = powi(self.config.discount, self.progress.step as i32);
        self.progress.step += 1;
        let end = self.progress.step >= self.config.horizon;
        let reward = -discount * costs.sum();
        let end = end.then_some(End::Terminated);
        Step::new(self.observe(), vec![reward; treatments.len()], end)
            .record("inspection_cost", discount * costs.inspection)
            .record("repair_cost", discount * costs.repair)
            .record("campaign_cost", discount * costs.campaign)
            .record("risk_cost", discount * costs.risk)
            .record("inspections", count(treatments, Treatment::Inspect))
            .record("repairs", count(treatments, Treatment::Repair))
    }

    fn costs(&self, treatments: &[Treatment], before: f64, after: f64) -> Costs {
        let (inspections, repairs) = (
            count(treatments, Treatment::Inspect),
            count(treatments, Treatment::Repair),
        );
        let risk = if after >= before { after - before } else { after };
        let acts = inspections + repairs > 0.0;
        let (per_inspection, campaign) = if self.config.campaign {
            (CAMPAIGN_INSPECTION_COST, if acts { CAMPAIGN_COST } else { 0.0 })
        } else {
            (INSPECTION_COST, 0.0)
        };
        Costs {
            inspection: per_inspection * inspections,
            repair: REPAIR_COST * repairs,
            campaign,
            risk: FAILURE_COST * risk,
        }
    }

    fn observe(&self) -> Vec<Vec<f64>> {
        let time = part(self.progress.step, self.config.horizon);
        let own = |belief: &Belief| {
            let alpha = self.factors().iter().copied();
            belief.iter().copied().chain([time]).chain(alpha).collect()
        };
        self.marginals.iter().map(own).collect()
    }

    /// Weights of the common factor; empty without such a factor.
    fn factors(&self) -> &[f64] {
        let weights = &self.progress.beliefs.weights;
        if self.config.correlated { weights } else { &[] }
    }
}

impl Costs {
    fn sum(self) -> f64 {
        self.inspection + self.repair + self.campaign + self.risk
    }
}

#[allow(clippy::cast_precision_loss, reason = "at most a hundred components")]
fn count(treatments: &[Treatment], of: Treatment) -> f64 {
    treatments.iter().filter(|treatment| **treatment == of).count() as f64
}

#[allow(clippy::cast_precision_loss, reason = "at most 30 steps")]
fn part(step: usize, horizon: usize) -> f64 {
    step as f64 / horizon as f64
}

fn metrics() -> Vec<Metric> {
    let cost = |name, about| Metric::new(name, "", about).lower_is_better();
    vec![
        cost("inspection_cost", "discounted costs of inspections"),
        cost("repair_cost", "discounted costs of repairs"),
        cost(
            "campaign_cost",
            "discounted costs of steps with an inspection or a repair",
        ),
        cost(
            "risk_cost",
            "discounted costs of the probability that the system fails",
        ),
        cost("inspections", "inspections in an episode"),
        cost("repairs", "repairs in an episode"),
    ]
}

fn seats(config: &InspectionPlanningConfig, n_factors: usize) -> Vec<Seat> {
    let time = Channel::new("time", "").within(0.0, 1.0).typical(0.5, 0.3);
    let factors = if config.correlated {
        factor_channels(n_factors)
    } else {
        Vec::new()
    };
    let observation: Vec<Channel> = belief_channels()
        .into_iter()
        .chain([time])
        .chain(factors)
        .collect();
    let seat = |component: usize| Seat {
        name: name(component),
        observation: Space::Box(observation.clone()),
        action: Space::Discrete(Treatment::ALL.map(|treatment| treatment.name().into()).to_vec()),
    };
    (0..config.components).map(seat).collect()
}

fn name(component: usize) -> String {
    format!("component_{component}")
}

/// The limits leave room for the rounding of sums.
fn probability(name: String) -> Channel {
    Channel::new(name, "").within(0.0, 1.0 + 1e-9).typical(0.0, 0.1)
}

fn belief_channels() -> Vec<Channel> {
    let bins = (0..FAILED).map(|bin| format!("belief_{bin}"));
    bins.chain(["failure_probability".into()])
        .map(probability)
        .collect()
}

fn factor_channels(n_factors: usize) -> Vec<Channel> {
    (0..n_factors)
        .map(|at| probability(format!("factor_{at}")))
        .collect()
}

impl Environment for InspectionPlanning {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    fn reset(&mut self, _rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        let beliefs = Beliefs::new(&self.model, self.config.components);
        self.marginals = beliefs.marginals();
        self.progress = Progress { step: 0, beliefs };
        Ok(self.observe())
    }

    fn step(&mut self, actions: &[Vec<f64>], rng: &mut Rng) -> Result<Step, Error> {
        let chosen = choices::taken(&self.seats, actions)?;
        let treatments: Vec<Treatment> = chosen.into_iter().map(|choice| Treatment::ALL[choice]).collect();
        // One number for every component, inspected or not, so that the choices of a policy do not change later
        // draws.
        let draws: Vec<f64> = treatments.iter().map(|_| rng.random()).collect();
        Ok(self.advance(&treatments, |component, p| draws[component] < p))
    }

    fn state_channels(&self) -> Vec<Channel> {
        let of = |component: usize| {
            let name = name(component);
            let age = Channel::new("age", "yr").within(0.0, 30.0).typical(10.0, 10.0);
            let detected = Channel::new("detected", "").within(0.0, 1.0);
            belief_channels()
                .into_iter()
                .chain([age, detected])
                .map(move |channel| Channel {
                    name: format!("{name}.{}", channel.name),
                    ..channel
                })
        };
        (0..self.config.components)
            .flat_map(of)
            .chain([Channel::new("step", "").within(0.0, 30.0).typical(15.0, 9.0)])
            .chain(factor_channels(self.factors().len()))
            .collect()
    }

    #[allow(clippy::cast_precision_loss, reason = "ages and steps of at most 30")]
    fn state(&self) -> Vec<f64> {
        let beliefs = &self.progress.beliefs;
        let of = |(component, marginal): (usize, &Belief)| {
            let age = beliefs.ages[component] as f64;
            let detected = f64::from(u8::from(beliefs.detected[component]));
            marginal
                .iter()
                .copied()
                .chain([age, detected])
                .collect::<Vec<_>>()
        };
        self.marginals
            .iter()
            .enumerate()
            .flat_map(of)
            .chain([self.progress.step as f64])
            .chain(self.factors().iter().copied())
            .collect()
    }

    fn trace_channels(&self) -> Vec<Channel> {
        let of = |component: usize| {
            ["failure_probability", "age", "detected"]
                .map(|channel| Channel::new(format!("{}.{channel}", name(component)), ""))
        };
        let system = ["t", "system_failure_probability"].map(|name| Channel::new(name, ""));
        system
            .into_iter()
            .chain((0..self.config.components).flat_map(of))
            .collect()
    }

    #[allow(clippy::cast_precision_loss, reason = "ages and steps of at most 30")]
    fn trace(&self) -> Vec<f64> {
        let Progress { step, beliefs } = &self.progress;
        let of = |component: usize| {
            let (age, detected) = (beliefs.ages[component] as f64, beliefs.detected[component]);
            [
                self.marginals[component][FAILED],
                age,
                f64::from(u8::from(detected)),
            ]
        };
        [*step as f64, self.failure_probability(&self.marginals)]
            .into_iter()
            .chain((0..self.config.components).flat_map(of))
            .collect()
    }

    fn snapshot(&self) -> serde_json::Value {
        // Plain structs of numbers: serde_json refuses only maps whose keys are no strings.
        serde_json::to_value(&self.progress).expect("a snapshot serialises")
    }

    fn restore(&mut self, snapshot: &serde_json::Value) -> Result<(), Error> {
        let misfit = |problem: String| Error::Checkpoint {
            what: "inspection_planning",
            problem,
        };
        let progress = Progress::deserialize(snapshot).map_err(|source| misfit(source.to_string()))?;
        let (components, factors) = (self.config.components, self.model.n_factors());
        if !progress.beliefs.fits(components, factors) {
            return Err(misfit(format!(
                "beliefs that are not of {components} components and {factors} levels"
            )));
        }
        self.marginals = progress.beliefs.marginals();
        self.progress = progress;
        Ok(())
    }
}

#[cfg(test)]
mod environment_tests;
#[cfg(test)]
mod oracle_tests;
