//! The origin of numbers: programs, plugins, machine.

use crate::Planned;
use contract::{Build, Registry};
use execution::world::fs;
use report::Provenance;
use std::{
    cmp::Reverse,
    collections::{BTreeMap, BTreeSet},
};

/// Facts about this program, the machine and a study; `builds` holds the number of trials that each build computed.
#[expect(
    clippy::disallowed_methods,
    reason = "a date that the report shall carry is given by the environment; no result holds it"
)]
pub(crate) fn of(registry: &Registry, one: &Planned, builds: BTreeMap<Option<Build>, usize>) -> Provenance {
    Provenance {
        build: registry.build.clone(),
        builds: most_first(builds),
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

fn most_first(counts: BTreeMap<Option<Build>, usize>) -> Vec<(Option<Build>, usize)> {
    let mut builds: Vec<_> = counts.into_iter().collect();
    builds.sort_by_key(|(_, count)| Reverse(*count));
    builds
}

/// Name and version of every plugin that the study's trials use, in order.
fn used(registry: &Registry, one: &Planned) -> Vec<(String, u32)> {
    let mut names = BTreeMap::new();
    for key in one.plan.trials.iter().map(|trial| &trial.key) {
        let agents = key.agent.parts().into_iter().map(|part| ("agent", part));
        for (kind, part) in [("environment", &*key.environment), ("protocol", &*key.protocol)]
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
