//! Where numbers come from: programs, plugins, machine.

use super::study::Planned;
use crate::{Build, Registry, report::Provenance, store::StoredTrial, world::fs};
use std::{
    cmp::Reverse,
    collections::{BTreeMap, BTreeSet},
};

/// Facts about this program, the machine, a study and who computed its trials, of which `stored` is what the
/// store has.
#[expect(
    clippy::disallowed_methods,
    reason = "a date that the report shall carry is given by the environment; no result holds it"
)]
pub(super) fn of(registry: &Registry, one: &Planned, stored: &[Option<StoredTrial>]) -> Provenance {
    Provenance {
        build: registry.build.clone(),
        builds: builds(stored),
        program: format!("regimen {}", env!("CARGO_PKG_VERSION")),
        plugins: used(registry, one),
        cpu: cpu(),
        operating_system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
        seeds: one
            .plan
            .trials
            .iter()
            .map(|trial| trial.key.seed)
            .collect::<BTreeSet<_>>()
            .into_iter()
            .collect(),
        profile: one.study.profile.clone(),
        date: std::env::var("SOURCE_DATE_EPOCH").ok(),
    }
}

/// How many of the stored trials each build computed, most first.
fn builds(stored: &[Option<StoredTrial>]) -> Vec<(Option<Build>, usize)> {
    let mut counts: BTreeMap<Option<Build>, usize> = BTreeMap::new();
    for StoredTrial { build, .. } in stored.iter().flatten() {
        *counts.entry(build.clone()).or_default() += 1;
    }
    let mut builds: Vec<_> = counts.into_iter().collect();
    builds.sort_by_key(|(_, count)| Reverse(*count));
    builds
}

/// Name and version of every plugin that the study's trials use, in order.
fn used(registry: &Registry, one: &Planned) -> Vec<(String, u32)> {
    let mut names = BTreeMap::new();
    for key in one.plan.trials.iter().map(|trial| &trial.key) {
        let agents = key.agent.parts().into_iter().map(|part| ("agent", part));
        for (kind, part) in [("environment", &key.environment), ("protocol", &key.protocol)]
            .into_iter()
            .chain(agents)
        {
            names.insert(format!("{kind} {}", part.plugin), part.version);
        }
    }
    names.insert("numerics".into(), registry.numerics_version);
    names.into_iter().collect()
}

fn cpu() -> String {
    let text = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = text.lines().find_map(|line| {
        line.strip_prefix("model name")?
            .split_once(':')
            .map(|(_, name)| name.trim().to_owned())
    });
    name.unwrap_or_else(|| "unknown".into())
}
