//! Options of runs and reports.

use execution::limits::Limits;
use std::path::PathBuf;

/// Options for computing missing trials.
#[derive(Debug, Clone, Default)]
pub struct RunOptions {
    /// Number of worker processes, or of concurrent tasks of a queue; the machine's setting where absent.
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

/// Options of a worker, including its share of the trials.
#[derive(Debug, Clone)]
pub struct WorkerOptions {
    /// `(part, parts)`: computes every `parts`-th trial, starting with number `part`.
    pub part: (usize, usize),
    /// Worker processes.
    pub jobs: usize,
    /// Limits that replace those of study and machine.
    pub limits: Limits,
    /// Stop at the first trial that does not end `ok`.
    pub fail_fast: bool,
}

/// Destination of reports, and the results that count as failures.
#[derive(Debug, Clone, Default)]
pub struct ReportOptions {
    /// Folder of the report; with several studies, the folder that contains one folder for each. `results/<study>`
    /// where absent.
    pub out: Option<PathBuf>,
    /// Whether a published value or a claim that differs is a failure.
    pub strict: bool,
}
