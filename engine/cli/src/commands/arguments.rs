//! Options that several commands share, and the settings made of them.

use super::{Person, consent::Consent, summaries::Summaries};
use clap::{Args, ValueEnum};
use contract::{Registry, trial_end::EndState};
use execution::limits::Limits;
use session::{Failure, MachineOptions, ReportOptions, Selection, Session};
use std::path::PathBuf;

/// Options of every command.
#[derive(Debug, Clone, Args)]
pub(super) struct Common {
    /// Folder of the store; `store` in regimen.toml, else `store`.
    #[arg(long, global = true, env = "REGIMEN_STORE", value_name = "DIR")]
    pub(super) store: Option<PathBuf>,
    /// Bucket of object storage by which machines without a common folder share their stores, as
    /// `s3://bucket/prefix`; `bucket` in regimen.toml.
    #[arg(long, global = true, env = "REGIMEN_BUCKET", value_name = "URL")]
    pub(super) bucket: Option<String>,
    /// Profile of regimen.toml to use.
    #[arg(long, global = true, env = "REGIMEN_MACHINE", value_name = "NAME")]
    pub(super) machine: Option<String>,
    /// Largest file, in megabytes, that is read as a study, data, curves or imported runs; by default 10 MB for a
    /// study, 256 MB for other text and 16 GB for other binary files.
    #[arg(long, global = true, env = "REGIMEN_INPUT_MB", value_name = "MB", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    pub(super) input_mb: Option<u64>,
    /// Output format: text for people, or JSON.
    #[arg(long, global = true, value_enum, default_value_t = Format::Text)]
    pub(super) format: Format,
}

impl Common {
    /// The options of the machine.
    pub(super) fn machine(&self) -> MachineOptions {
        MachineOptions {
            store: self.store.clone(),
            bucket: self.bucket.clone(),
            machine: self.machine.clone(),
            input_mb: self.input_mb,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Format {
    Text,
    Json,
}

/// Selected studies, with their budget and the trials to keep.
#[derive(Debug, Clone, Args)]
pub(super) struct Studies {
    /// Study files.
    #[arg(required = true, value_name = "SPEC")]
    pub(super) specs: Vec<PathBuf>,
    /// Profile of the study (a named budget).
    #[arg(long, short = 'P', value_name = "NAME")]
    pub(super) profile: Option<String>,
    /// Replace one value, as in `--set dsac.discount=0.999`.
    #[arg(long = "set", short = 'S', value_name = "PATH=VALUE")]
    pub(super) sets: Vec<String>,
    /// Number of seeds, instead of the study's.
    #[arg(long, value_name = "N")]
    pub(super) seeds: Option<u64>,
    /// Only trials of these environments and agents (names of the study).
    #[arg(long, value_name = "NAME")]
    pub(super) only: Vec<String>,
}

impl Studies {
    /// Opens a session with these studies.
    pub(super) fn open<'a>(&self, registry: &'a Registry, common: &Common) -> Result<Session<'a>, Failure> {
        let selection = Selection {
            specs: self.specs.clone(),
            profile: self.profile.clone(),
            sets: self.sets.clone(),
            seeds: self.seeds,
            only: self.only.clone(),
        };
        Session::open(registry, selection, common.machine(), &Person)
    }

    /// The same for a command that uses the local store as it is, and fetches nothing from a bucket.
    pub(super) fn open_here<'a>(
        &self,
        registry: &'a Registry,
        common: &Common,
    ) -> Result<Session<'a>, Failure> {
        let mut session = self.open(registry, common)?;
        session.settings.bucket = None;
        Ok(session)
    }
}

#[derive(Debug, Clone, Default, Args)]
pub(super) struct RunArgs {
    /// Worker processes; `workers` in regimen.toml, else the number of cores. With a queue: tasks at a time;
    /// `max_tasks`.
    #[arg(long, short = 'j', env = "REGIMEN_JOBS", value_name = "N", value_parser = one_or_more)]
    pub(super) jobs: Option<usize>,
    /// Executor that runs the trials; `executor` in regimen.toml, else this machine.
    #[arg(long, value_name = "NAME")]
    pub(super) executor: Option<String>,
    /// Device on which learners compute: `cuda`, many trials at a time on a card, or `processor`; `device` in
    /// regimen.toml, else the processor.
    #[arg(long, value_name = "NAME")]
    pub(super) device: Option<String>,
    /// With a queue: return after the submission; a later `run` follows it.
    #[arg(long)]
    pub(super) detach: bool,
    /// Show what would run, and run nothing.
    #[arg(long, short = 'n')]
    pub(super) dry_run: bool,
    /// Run failed trials again.
    #[arg(long)]
    pub(super) retry_failed: bool,
    /// Compute no trial of a program a second time to test whether it gives the same values.
    #[arg(long)]
    pub(super) no_rehearsal: bool,
    #[command(flatten)]
    pub(super) limits: LimitArgs,
    #[command(flatten)]
    pub(super) consent: Consent,
}

/// Limits and retries of a trial; each replaces that of the study and of regimen.toml.
#[derive(Debug, Clone, Default, Args)]
pub(super) struct LimitArgs {
    /// Stop at the first trial that does not end `ok`; the running ones save a checkpoint.
    #[arg(long, conflicts_with = "keep_going")]
    pub(super) fail_fast: bool,
    /// Continue after trials that fail (the default).
    #[arg(long)]
    pub(super) keep_going: bool,
    /// Number of retries of a trial that was killed from outside.
    #[arg(long, value_name = "N", value_parser = retries)]
    pub(super) retries: Option<u32>,
    /// End states after which a trial is tried again, instead of `killed`.
    #[arg(long, value_name = "STATE", value_delimiter = ',', value_parser = end_state)]
    pub(super) retry_on: Vec<EndState>,
    /// Wait before the first retry; it doubles with each further retry.
    #[arg(long, value_name = "SECONDS", allow_hyphen_values = true, value_parser = retry_delay_s)]
    pub(super) retry_delay_s: Option<f64>,
    /// Longest time of one attempt at a trial.
    #[arg(long, value_name = "SECONDS", allow_hyphen_values = true, value_parser = wall_time_s)]
    pub(super) wall_time_s: Option<f64>,
    /// Longest time without output of a program that trains itself.
    #[arg(long, value_name = "SECONDS", allow_hyphen_values = true, value_parser = stalled_after_s)]
    pub(super) stalled_after_s: Option<f64>,
    /// Maximum memory of a trial's process.
    #[arg(long, value_name = "MB", value_parser = memory_mb)]
    pub(super) memory_mb: Option<u64>,
}

/// A number of processes.
pub(super) fn one_or_more(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(0) => Err("no process computes nothing: write 1 or more, or leave it out for one per core".into()),
        Ok(number) => Ok(number),
        Err(error) => Err(format!("{error}")),
    }
}

impl LimitArgs {
    /// The limits given on the command line.
    pub(super) fn limits(&self) -> Limits {
        Limits {
            wall_time_s: self.wall_time_s,
            stalled_after_s: self.stalled_after_s,
            memory_mb: self.memory_mb,
            retries: self.retries,
            retry_on: (!self.retry_on.is_empty()).then(|| self.retry_on.clone()),
            retry_delay_s: self.retry_delay_s,
        }
    }
}

fn wall_time_s(text: &str) -> Result<f64, String> {
    limit(text, |value| Limits {
        wall_time_s: Some(value),
        ..Limits::default()
    })
}

fn stalled_after_s(text: &str) -> Result<f64, String> {
    limit(text, |value| Limits {
        stalled_after_s: Some(value),
        ..Limits::default()
    })
}

fn memory_mb(text: &str) -> Result<u64, String> {
    limit(text, |value| Limits {
        memory_mb: Some(value),
        ..Limits::default()
    })
}

fn retries(text: &str) -> Result<u32, String> {
    limit(text, |value| Limits {
        retries: Some(value),
        ..Limits::default()
    })
}

fn retry_delay_s(text: &str) -> Result<f64, String> {
    limit(text, |value| Limits {
        retry_delay_s: Some(value),
        ..Limits::default()
    })
}

/// A valid limit; the check is the one for all limits.
fn limit<T>(text: &str, limits: impl Fn(T) -> Limits) -> Result<T, String>
where
    T: std::str::FromStr<Err: std::fmt::Display> + Copy,
{
    let value: T = text.parse().map_err(|error: T::Err| error.to_string())?;
    let checked = limits(value).check();
    checked.map(|()| value).map_err(|error| error.instead.to_owned())
}

/// An end state by its word.
fn end_state(word: &str) -> Result<EndState, String> {
    let known = || {
        EndState::FAILURES
            .iter()
            .map(|state| state.name())
            .collect::<Vec<_>>()
            .join(", ")
    };
    EndState::FAILURES
        .into_iter()
        .find(|state| state.name() == word)
        .ok_or_else(|| format!("known: {}", known()))
}

/// The trials that `worker` runs, and its limits.
#[derive(Debug, Args)]
pub(super) struct WorkerArgs {
    #[command(flatten)]
    pub(super) studies: Studies,
    /// Only every Nth trial, beginning with the Ith (from 0).
    #[arg(long, value_name = "I/N")]
    pub(super) index: Option<String>,
    /// Worker processes.
    #[arg(long, short = 'j', default_value_t = 1, value_parser = one_or_more)]
    pub(super) jobs: usize,
    /// The submission that started it: nothing runs once it is cancelled.
    #[arg(long, value_name = "ID", hide = true)]
    pub(super) submission: Option<String>,
    #[command(flatten)]
    pub(super) limits: LimitArgs,
    #[command(flatten)]
    pub(super) consent: Consent,
    #[command(flatten)]
    pub(super) summaries: Summaries,
}

#[derive(Debug, Clone, Args)]
pub(super) struct ReportArgs {
    /// Folder for tables, figures and the report; with several studies, the folder that contains one folder for each.
    /// Without it `results/<study>`, followed by `-<profile>` and `+<options>` if the study does not run as written.
    /// Several studies also get a common page: `index.html` beside their folders.
    #[arg(long, short = 'o', value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
    /// Exit with 101 if a published value or a claim differs.
    #[arg(long)]
    pub(super) strict: bool,
    /// Print every table and claim, instead of only the answers and the first table.
    #[arg(long, short = 'v')]
    pub(super) verbose: bool,
}

impl ReportArgs {
    /// Destination of reports, and the results that count as failures.
    pub(super) fn options(&self) -> ReportOptions {
        ReportOptions {
            out: self.out.clone(),
            strict: self.strict,
        }
    }
}
