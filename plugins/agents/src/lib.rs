//! Agents: algorithms, rules, reference controllers and measurements, one module each, readable beside its
//! paper. Components that agents share lie in [`shared`].
//!
//! To add one, write a module with a config, an [`contract::Agent`] and a `register`, and one line in
//! [`register`].
//!
//! "The thesis" is everywhere: Y. Tian, "Prescriptive Maintenance and Operation with Deep Reinforcement
//! Learning", dissertation. It collects four published articles; those that agents here come from:
//! - chapter 2, `clac` and `lac`: Y. Tian, M. Arias Chao, C. Kulkarni, K. Goebel and O. Fink, "Real-time
//!   model calibration with deep reinforcement learning", Mechanical Systems and Signal Processing 165 (2022)
//!   108284;
//! - chapter 3, `dirichlet_sac` and its baselines: Y. Tian, M. Han, C. Kulkarni and O. Fink, "A
//!   prescriptive Dirichlet power allocation policy with deep reinforcement learning", Reliability
//!   Engineering and System Safety 224 (2022) 108529;
//! - chapter 4, `tdom_ac` and its baselines: Y. Tian, K.-R. Kladny, Q. Wang, Z. Huang and O. Fink,
//!   "Multi-agent actor-critic with time dynamical opponent model", Neurocomputing 517 (2023) 165-172.
//!
//! Invariants
//! 1. No agent names an environment: it reads the seats, spaces and channel names of an
//!    [`contract::Interface`].
//! 2. All randomness comes from the `rng` arguments; no thread, no clock, no order of a hash map reaches a
//!    number.
//! 3. A saved and loaded agent continues to the same bits.

pub mod autogan;
pub mod behaviour_cloning;
pub mod condition_based_replacement;
pub mod constant_choice;
pub mod ddpg;
pub mod dirichlet_gradient;
pub mod dirichlet_regression;
pub mod dirichlet_sac;
pub mod e2gan;
pub mod equal_split;
pub mod gaussian_softmax_gradient;
pub mod gaussian_softmax_regression;
pub mod gaussian_softmax_sac;
pub mod given_design;
pub mod independent_sac;
pub mod interval_inspection;
pub mod lac;
pub mod maddpg;
pub mod masql;
pub mod network_regression;
pub mod opponent_gradients;
pub mod pr2;
pub mod random_action;
pub mod random_allocation;
pub mod rank_rule;
pub mod regularised_evolution;
pub mod rommeo;
pub mod shared;
pub mod soft_actor_critic;
pub mod td3_bc;
pub mod tdom_ac;
pub mod threshold_maintenance;
pub mod tree_parzen;
pub mod value_decomposition;
pub mod water_filling;
pub mod zero_action;

use contract::Registry;

/// Registers every agent of this crate, with its version, and the forms of the policies that they leave.
pub fn register(registry: &mut Registry) {
    shared::policy_forms::register(registry);
    autogan::register(registry, 1);
    behaviour_cloning::register(registry, 1);
    condition_based_replacement::register(registry, 1);
    constant_choice::register(registry, 1);
    ddpg::register(registry, 1);
    dirichlet_gradient::register(registry, 1);
    dirichlet_regression::register(registry, 1);
    dirichlet_sac::register(registry, 1);
    e2gan::register(registry, 1);
    equal_split::register(registry, 1);
    gaussian_softmax_gradient::register(registry, 2);
    gaussian_softmax_regression::register(registry, 1);
    gaussian_softmax_sac::register(registry, 1);
    given_design::register(registry, 1);
    independent_sac::register(registry, 1);
    interval_inspection::register(registry, 1);
    lac::register(registry, 1);
    lac::register_constrained(registry, 1);
    maddpg::register(registry, 1);
    masql::register(registry, 1);
    network_regression::register(registry, 1);
    opponent_gradients::register(registry, 1);
    pr2::register(registry, 1);
    random_action::register(registry, 1);
    random_allocation::register(registry, 1);
    rank_rule::register(registry, 1);
    regularised_evolution::register(registry, 1);
    rommeo::register(registry, 1);
    soft_actor_critic::register(registry, 1);
    td3_bc::register(registry, 1);
    tdom_ac::register(registry, 1);
    threshold_maintenance::register(registry, 1);
    tree_parzen::register(registry, 1);
    value_decomposition::register(registry, 1);
    water_filling::register(registry, 1);
    water_filling::register_true_state(registry, 1);
    zero_action::register(registry, 1);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn registry() -> Registry {
        let mut registry = Registry::default();
        register(&mut registry);
        registry
    }

    #[test]
    fn defaults_and_presets_resolve_to_themselves() {
        for (name, entry) in &registry().agents {
            assert_eq!(
                (entry.about.resolve)(&entry.about.defaults).unwrap(),
                entry.about.defaults,
                "{name}"
            );
            assert!(
                entry
                    .about
                    .presets
                    .iter()
                    .all(|preset| (entry.about.resolve)(&preset.values).is_ok()),
                "{name}"
            );
            assert_eq!(entry.traits.learns(), !entry.traits.metrics.is_empty(), "{name}");
        }
    }

    /// Holds the list above to the modules: every module is an agent of its name, except the shared ones.
    #[test]
    fn every_module_beside_the_shared_ones_is_an_agent_of_its_name() {
        let registry = registry();
        let modules = include_str!("lib.rs")
            .lines()
            .filter_map(|line| line.strip_prefix("pub mod ")?.strip_suffix(';'));
        let strangers: Vec<_> = modules
            .filter(|name| *name != "shared" && !registry.agents.contains_key(name))
            .collect();
        assert!(strangers.is_empty(), "{strangers:?}");
    }
}
