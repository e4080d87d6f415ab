//! Agents that earlier loads of a study built.

use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, PoisonError},
};

/// Agents that earlier loads of a study built without fault. A search loads its study again with every setting that it
/// adds, and building networks takes time.
#[derive(Debug, Clone, Default)]
pub struct KnownAgents {
    /// Steps after which each agent learns, by its hash and that of its environment.
    learns_after: Arc<Mutex<BTreeMap<String, u64>>>,
}

/// All are equal, since they change no study.
impl PartialEq for KnownAgents {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Eq for KnownAgents {}

impl KnownAgents {
    pub(crate) fn learns_after(&self, key: &str) -> Option<u64> {
        let known = self.learns_after.lock().unwrap_or_else(PoisonError::into_inner);
        known.get(key).copied()
    }

    pub(crate) fn add(&self, key: String, learns_after: u64) {
        let mut known = self.learns_after.lock().unwrap_or_else(PoisonError::into_inner);
        known.insert(key, learns_after);
    }
}

#[cfg(test)]
mod tests {
    use crate::{Options, load_text};
    use std::path::Path;
    use std::sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    };
    use testing::toys::toys;

    #[test]
    fn an_agent_is_built_once_in_all_loads_with_the_same_options() {
        let (mut registry, n_built) = (toys(), Arc::new(AtomicUsize::new(0)));
        let entry = registry.agents.get_mut("q_learning").unwrap();
        let counter = Arc::clone(&n_built);
        let build = toys().agents.remove("q_learning").unwrap().build;
        entry.build = Box::new(move |config, interface, rng| {
            counter.fetch_add(1, Ordering::Relaxed);
            build(config, interface, rng)
        });
        let options = Options::default();
        let built_for = |discounts: &str| {
            let text = format!(
                "study: walk\nenvironments: {{ short: {{ corridor: {{}} }} }}\nagents: {{ learner: {{ q_learning: {{}} \
                 }} }}\nprotocol: {{ train_evaluate: {{ steps: 1000 }} }}\nsweep: {{ learner.discount: {{ grid: \
                 {discounts} }} }}"
            );
            let before = n_built.load(Ordering::Relaxed);
            let loaded = load_text(&text, "a.yaml", Path::new(""), &registry, &options);
            assert!(loaded.is_ok());
            n_built.load(Ordering::Relaxed) - before
        };
        assert_eq!(built_for("[0.8, 0.9]"), 2);
        assert_eq!(built_for("[0.8, 0.9]"), 0);
        assert_eq!(built_for("[0.7, 0.8, 0.9]"), 1);
    }
}
