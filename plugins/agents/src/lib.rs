//! Agents: rules, reference controllers and learning algorithms, one file each, readable beside its paper.
//!
//! Invariants
//! 1. No agent names an environment: it reads the seats, spaces and channel names of an [`engine::Interface`].
//! 2. All randomness comes from the `rng` arguments; no thread, no clock, no order of a hash map reaches a number.
//! 3. A saved and loaded agent continues to the same bits.

pub mod allocation;
pub mod asset_network;
#[cfg(test)]
mod bandit;
pub mod checkpoint;
#[cfg(test)]
mod coordination;
pub mod ddpg;
pub mod dirichlet_gradient;
pub mod dirichlet_regression;
pub mod dirichlet_sac;
pub mod equal_split;
pub mod exploration;
pub mod gaussian_softmax_gradient;
pub mod gaussian_softmax_regression;
pub mod gaussian_softmax_sac;
mod gradient_moments;
pub mod independent_sac;
pub mod joint;
pub mod joint_replay;
pub mod maddpg;
pub mod masql;
pub mod opponent_gradients;
pub mod opponent_modelling;
pub mod pr2;
pub mod random_action;
pub mod random_allocation;
pub mod rank_rule;
pub mod replay;
pub mod rommeo;
pub mod scaling;
pub mod schedule;
pub mod seat;
pub mod seat_network;
pub mod targets;
pub mod tdom_ac;
pub mod water_filling;
pub mod zero_action;

use engine::{AgentTraits, Registry};

/// Registers every agent of this crate.
pub fn register(registry: &mut Registry) {
    let rule = AgentTraits::default;
    registry.agent("equal_split", 1, "every asset gets the same share", rule(), equal_split::build);
    registry.agent("random_action", 1, "every seat acts uniformly at random", rule(), random_action::build);
    registry.agent("random_allocation", 1, "shares drawn uniformly from the simplex", rule(), random_allocation::build);
    registry.agent("rank_rule", 1, "fixed shares by the rank of the observed voltage", rule(), rank_rule::build);
    let about = "equal terminal voltages, from what is observed: a reference controller";
    registry.agent("water_filling", 1, about, rule(), water_filling::build);
    registry.agent(
        "water_filling_true_state",
        1,
        "equal terminal voltages, from the true state: a reference controller",
        rule(),
        water_filling::build_true_state,
    );
    registry.agent("zero_action", 1, "every seat does nothing", rule(), zero_action::build);
    let name = "dirichlet_gradient";
    let about = "policy gradient of a Dirichlet policy on a bandit, estimated and exact";
    registry.agent(name, 1, about, dirichlet_gradient::traits(), dirichlet_gradient::build);
    let name = "gaussian_softmax_gradient";
    let about = "policy gradient of a Gaussian-softmax policy on a bandit, estimated and exact";
    registry.agent(name, 1, about, gaussian_softmax_gradient::traits(), gaussian_softmax_gradient::build);
    let learner = |metrics| AgentTraits { learns: true, metrics, ..AgentTraits::default() };
    let about = "soft actor-critic with a Dirichlet policy";
    registry.agent("dirichlet_sac", 1, about, learner(dirichlet_sac::metrics()), dirichlet_sac::build);
    let about = "soft actor-critic with a Gaussian-softmax policy";
    registry.agent("gaussian_softmax_sac", 1, about, learner(gaussian_softmax_sac::metrics()), gaussian_softmax_sac::build);
    let about = "deep deterministic policy gradient with a softmax output";
    registry.agent("ddpg", 1, about, learner(ddpg::metrics()), ddpg::build);
    let about = "multi-agent deep deterministic policy gradient: critics of the joint action";
    registry.agent("maddpg", 1, about, learner(maddpg::metrics()), maddpg::build);
    let about = "multi-agent soft Q-learning: joint actions drawn by a Stein sampler";
    registry.agent("masql", 1, about, learner(masql::metrics()), masql::build);
    let about = "soft actor-critic in every seat, each for itself";
    registry.agent("independent_sac", 1, about, learner(independent_sac::metrics()), independent_sac::build);
    let fitted = |metrics| AgentTraits { learns_from_examples: true, ..learner(metrics) };
    let about = "regression onto a simplex with a Dirichlet distribution";
    registry.agent("dirichlet_regression", 1, about, fitted(dirichlet_regression::metrics()), dirichlet_regression::build);
    let about = "regression onto a simplex with a Gaussian-softmax distribution";
    let metrics = gaussian_softmax_regression::metrics();
    registry.agent("gaussian_softmax_regression", 1, about, fitted(metrics), gaussian_softmax_regression::build);
    let about = "actor-critic for several seats whose opponent models follow the others' improvement";
    registry.agent("tdom_ac", 1, about, learner(tdom_ac::metrics()), tdom_ac::build);
    let about = "actor-critic for several seats with opponent models regularised by what the others did";
    registry.agent("rommeo", 1, about, learner(rommeo::metrics()), rommeo::build);
    let about = "actor-critic for several seats that reasons through the others' answers to its own action";
    registry.agent("pr2", 1, about, learner(pr2::metrics()), pr2::build);
    let about = "takes the gradient of the opponent models of TDOM-AC apart into the critics' part and the entropy's";
    registry.agent("opponent_gradients", 1, about, opponent_gradients::traits(), opponent_gradients::build);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_and_presets_resolve_to_themselves() {
        let mut registry = Registry::default();
        register(&mut registry);
        assert_eq!(registry.agents.len(), 21);
        for (name, entry) in &registry.agents {
            assert_eq!((entry.about.resolve)(&entry.about.defaults).unwrap(), entry.about.defaults, "{name}");
            assert!(entry.about.presets.iter().all(|preset| (entry.about.resolve)(&preset.values).is_ok()), "{name}");
            assert_eq!(entry.learns, !entry.metrics.is_empty(), "{name}");
        }
    }
}
