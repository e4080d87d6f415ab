//! Where numbers come from: program, commit, machine.

use crate::Registry;
use std::process::Command;

/// Facts about this program and machine, read once for a report.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Machine {
    /// Commit of the folder the command was given in, with `-dirty` where files differ from it; empty outside a repository.
    pub(super) commit: String,
    /// True where files differ from the commit.
    pub(super) dirty: bool,
    /// Name and version of this program.
    pub(super) program: String,
    /// Processor.
    pub(super) cpu: String,
    /// Operating system.
    pub(super) system: String,
}

/// Reads the facts.
pub(super) fn read() -> Machine {
    let dirty = git(&["status", "--porcelain", "--untracked-files=no"]).is_some_and(|text| !text.is_empty());
    Machine {
        commit: git(&["rev-parse", "--short=12", "HEAD"]).unwrap_or_default(),
        dirty,
        program: format!("regimen {}", env!("CARGO_PKG_VERSION")),
        cpu: cpu(),
        system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
    }
}

/// Name and version of every plugin, in order.
pub(super) fn plugin_versions(registry: &Registry) -> Vec<(String, u32)> {
    let environments = registry.environments.iter().map(|(name, entry)| ((*name).to_owned(), entry.about.version));
    let agents = registry.agents.iter().map(|(name, entry)| ((*name).to_owned(), entry.about.version));
    let protocols = registry.protocols.iter().map(|(name, entry)| ((*name).to_owned(), entry.about.version));
    environments.chain(agents).chain(protocols).collect()
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
