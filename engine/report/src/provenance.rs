//! The programs, the plugins and the machine that made the results of a report.

use contract::Build;
use serde::{Deserialize, Serialize};

/// Programs, plugins and machine behind the results.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// The source code of the program that made the report; `None` where the program does not know it.
    pub build: Option<Build>,
    /// The source code of the programs that computed the trials, where they recorded it, each with its number of
    /// trials.
    pub builds: Vec<(Option<Build>, usize)>,
    /// The program and its version.
    pub program: String,
    /// Plugins by kind and name, with their versions.
    pub plugins: Vec<(String, u32)>,
    /// Kind of processor that the report was made on.
    pub cpu: String,
    /// Operating system that the report was made on.
    pub operating_system: String,
    /// The seeds of the study.
    pub seeds: Vec<u64>,
    /// Name of the profile, where one was chosen.
    pub profile: Option<String>,
    /// Date of the report; `None` where the report has none.
    pub date: Option<String>,
}
