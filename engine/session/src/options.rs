//! Options of runs and reports.

use execution::limits::Limits;
use std::path::PathBuf;

/// How missing trials are computed.
#[derive(Debug, Clone, Default)]
pub struct RunOptions {
    /// Worker processes, or tasks of a queue at a time; as the machine says where absent.
    pub jobs: Option<usize>,
    /// Name of the executor; that of the machine where absent.
    pub executor: Option<String>,
    /// Name of the device of learners; that of the machine where absent.
    pub device: Option<String>,
    /// With a queue: leave after the submission.
    pub detach: bool,
    /// Run failed trials again.
    pub retry_failed: bool,
    /// Compute no trial of a program a second time to see whether it repeats.
    pub no_rehearsal: bool,
    /// Limits that replace those of study and machine.
    pub limits: Limits,
    /// Stop at the first trial that does not end `ok`.
    pub fail_fast: bool,
}

/// The share of a worker.
#[derive(Debug, Clone)]
pub struct WorkerOptions {
    /// Every so many-th trial alone, beginning with one: `(part, parts)`.
    pub part: (usize, usize),
    /// Worker processes.
    pub jobs: usize,
    /// Limits that replace those of study and machine.
    pub limits: Limits,
    /// Stop at the first trial that does not end `ok`.
    pub fail_fast: bool,
}

/// Where reports go, and what of them counts.
#[derive(Debug, Clone, Default)]
pub struct ReportOptions {
    /// Folder of the report, or of those of several studies, each in a folder of its name; `results/<study>` where
    /// absent.
    pub out: Option<PathBuf>,
    /// Whether a published value or a claim that differs is a failure.
    pub strict: bool,
}
