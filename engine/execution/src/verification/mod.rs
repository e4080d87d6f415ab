//! Recomputation of stored trials: the choice and order of trials, whether this program can compute them, and
//! the receipt.

mod receipt;

pub use receipt::{Receipt, ReceiptEntry, VerificationOutcome};

use contract::{
    Registry,
    part::Part,
    plugin::About,
    trial::{Trial, TrialKey},
};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

/// Ids of `size` of the trials; all of them if it is absent or larger. The choice depends only on the seed and on the
/// ids: each id gets a number from both, and the ids with the smallest numbers are taken, so that a larger sample
/// contains a smaller one.
#[must_use]
pub fn sample<'a>(ids: &BTreeSet<&'a str>, size: Option<usize>, seed: u64) -> BTreeSet<&'a str> {
    let number = |id: &str| *blake3::hash(format!("verify {seed} {id}").as_bytes()).as_bytes();
    let mut drawn: Vec<&str> = ids.iter().copied().collect();
    drawn.sort_by_cached_key(|id| number(id));
    drawn.truncate(size.unwrap_or(usize::MAX));
    drawn.into_iter().collect()
}

/// The trials in rounds. None takes from another trial of its own round, so that each is computed from stored artifacts
/// instead of those that were just computed. The rounds contain places in `trials`.
#[must_use]
pub fn rounds(trials: &[&Trial]) -> Vec<Vec<usize>> {
    let mut left: BTreeMap<&str, usize> = trials
        .iter()
        .enumerate()
        .map(|(place, trial)| (trial.id.as_str(), place))
        .collect();
    let mut rounds = Vec::new();
    while !left.is_empty() {
        let waits = |place: &usize| {
            trials[*place]
                .key
                .sources()
                .iter()
                .any(|source| left.contains_key(source.as_str()))
        };
        let mut round: Vec<usize> = left.values().copied().filter(|place| !waits(place)).collect();
        if round.is_empty() {
            // A circle cannot be stored, since an id is a hash that includes those of its sources.
            round = left.values().copied().collect();
        }
        round.sort_unstable();
        left.retain(|_, place| !round.contains(place));
        rounds.push(round);
    }
    rounds
}

/// Reason why this program may not reach the same numbers; `None` if it must.
#[must_use]
pub fn cannot(key: &TrialKey, registry: &Registry) -> Option<String> {
    let agents = key.agent.parts().into_iter().map(|part| ("agent", part));
    let all = [("environment", &*key.environment), ("protocol", &*key.protocol)];
    let other = all
        .into_iter()
        .chain(agents)
        .find_map(|(kind, part)| of_another_version(kind, part, registry));
    other.or_else(|| {
        let own = registry.numerics_version;
        (key.numerics != own).then(|| {
            format!(
                "version {} of the shared numerical code computed it, this program has version {own}",
                key.numerics
            )
        })
    })
}

fn of_another_version(kind: &str, part: &Part, registry: &Registry) -> Option<String> {
    let Part { plugin, version, .. } = part;
    match version_of(kind, plugin, registry) {
        None => Some(format!("this program has no {kind} `{plugin}`")),
        Some(own) if own == *version => None,
        Some(own) => Some(format!(
            "version {version} of {kind} `{plugin}` computed it, this program has version {own}"
        )),
    }
}

fn version_of(kind: &str, plugin: &str, registry: &Registry) -> Option<u32> {
    let about: Option<&About> = match kind {
        "environment" => registry.environments.get(plugin).map(|entry| &entry.about),
        "protocol" => registry.protocols.get(plugin).map(|entry| &entry.about),
        _ => registry.agents.get(plugin).map(|entry| &entry.about),
    };
    about.map(|about| about.version)
}

/// The id that a trial would have if this program computed it: that of its key with this program's versions.
#[must_use]
pub fn id_here(key: &TrialKey, registry: &Registry) -> String {
    let mut key = key.clone();
    let renew = |kind: &str, part: &mut Part| {
        part.version = version_of(kind, &part.plugin, registry).unwrap_or(part.version);
    };
    renew("environment", Arc::make_mut(&mut key.environment));
    renew("protocol", Arc::make_mut(&mut key.protocol));
    Arc::make_mut(&mut key.agent).each_part(|part| renew("agent", part));
    key.numerics = registry.numerics_version;
    key.id()
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::{ArtifactKind, artifact::Taken, cast::Actors, trial::TrialCell};
    use proptest::prelude::*;
    use serde_json::json;
    use testing::toys::toys;

    fn trial(seed: u64, sources: &[&str]) -> Trial {
        let part = || Part::new("x", 1, json!({}));
        let mut agent = part();
        for (number, source) in sources.iter().enumerate() {
            let taken = Taken {
                trial: (*source).into(),
                kind: ArtifactKind::Policy,
            };
            agent.artifacts.insert(format!("/{number}"), taken);
        }
        let key = TrialKey {
            environment: part().into(),
            agent: Actors::Agent(agent).into(),
            protocol: part().into(),
            seed,
            numerics: 1,
        };
        Trial {
            id: format!("t{seed}"),
            cell: TrialCell::of("e", "a").into(),
            key,
        }
    }

    proptest! {
        #[test]
        fn a_sample_depends_on_seed_and_ids_alone_and_grows(seed: u64, size in 0usize..30) {
            let names: Vec<String> = (0..20).map(|number| number.to_string()).collect();
            let ids: BTreeSet<&str> = names.iter().map(String::as_str).collect();
            let chosen = sample(&ids, Some(size), seed);
            prop_assert_eq!(chosen.len(), size.min(20));
            prop_assert!(chosen.is_subset(&sample(&ids, Some(size + 1), seed)));
            // An id that is not chosen does not affect the choice.
            let mut fewer = ids.clone();
            fewer.retain(|id| chosen.contains(id) || id.len() > 1);
            let among_fewer = sample(&fewer, Some(size), seed);
            prop_assert!(chosen.is_subset(&among_fewer));
        }
    }

    #[test]
    fn samples_of_other_seeds_are_others() {
        let names: Vec<String> = (0..100).map(|number| number.to_string()).collect();
        let ids: BTreeSet<&str> = names.iter().map(String::as_str).collect();
        assert_ne!(sample(&ids, Some(10), 0), sample(&ids, Some(10), 1));
        assert_eq!(sample(&ids, None, 3), ids);
    }

    #[test]
    fn what_takes_from_a_chosen_trial_comes_in_a_later_round() {
        let trials = [
            trial(0, &["t1", "elsewhere"]),
            trial(1, &["t2"]),
            trial(2, &[]),
            trial(3, &["elsewhere"]),
        ];
        let all: Vec<&Trial> = trials.iter().collect();
        assert_eq!(rounds(&all), [vec![2, 3], vec![1], vec![0]]);
    }

    #[test]
    fn another_version_is_said_and_known_by_the_id_that_it_would_have_here() {
        let registry = toys();
        let (environment, agent, protocol) = (
            *registry.environments.keys().next().unwrap(),
            *registry.agents.keys().next().unwrap(),
            *registry.protocols.keys().next().unwrap(),
        );
        let here = TrialKey {
            environment: Part::new(
                environment,
                registry.environments[environment].about.version,
                json!({}),
            )
            .into(),
            agent: Actors::Agent(Part::new(agent, registry.agents[agent].about.version, json!({}))).into(),
            protocol: Part::new(protocol, registry.protocols[protocol].about.version, json!({})).into(),
            seed: 1,
            numerics: registry.numerics_version,
        };
        assert_eq!(cannot(&here, &registry), None);
        let mut older = here.clone();
        Arc::make_mut(&mut older.agent).each_part(|part| part.version += 7);
        assert!(
            cannot(&older, &registry)
                .unwrap()
                .contains(&format!("of agent `{agent}` computed it"))
        );
        assert_ne!(older.id(), here.id());
        assert_eq!(id_here(&older, &registry), here.id());
        older.numerics += 1;
        assert_eq!(id_here(&older, &registry), here.id());
        let mut foreign = here;
        Arc::make_mut(&mut foreign.environment).plugin = "of somebody else".into();
        assert_eq!(
            cannot(&foreign, &registry).unwrap(),
            "this program has no environment `of somebody else`"
        );
    }
}
