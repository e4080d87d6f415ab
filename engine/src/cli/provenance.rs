//! Where numbers come from: program, commit, machine.

use crate::{Registry, report::Provenance, spec::Study};
use std::process::Command;

/// Facts about this program, machine and study, read once for a report.
pub(super) fn of(registry: &Registry, study: &Study) -> Provenance {
    Provenance {
        commit: git(&["rev-parse", "--short=12", "HEAD"]),
        dirty: git(&["status", "--porcelain", "--untracked-files=no"]).is_some_and(|text| !text.is_empty()),
        program: format!("regimen {}", env!("CARGO_PKG_VERSION")),
        plugins: used(registry, study),
        cpu: cpu(),
        operating_system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
        seeds: study.seeds.clone(),
        profile: study.profile.clone(),
        date: std::env::var("SOURCE_DATE_EPOCH").ok(),
    }
}

/// Name and version of every plugin that the study's trials use, in order.
fn used(registry: &Registry, study: &Study) -> Vec<(String, u32)> {
    let mut names = std::collections::BTreeMap::new();
    for trial in study.plan().trials {
        let key = trial.key;
        for (kind, part) in [("environment", key.environment), ("agent", key.agent), ("protocol", key.protocol)] {
            names.insert(format!("{kind} {}", part.plugin), part.version);
        }
    }
    names.insert("numerics".into(), registry.numerics_version);
    names.into_iter().collect()
}

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

fn cpu() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name =
        text.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':').map(|(_, name)| name.trim().to_owned()));
    name.unwrap_or_else(|| "unknown".into())
}
