//! The command line: what can be said, and which function answers.

mod absent;
mod against;
mod command_line;
mod compute;
mod confirmations;
mod consent;
mod cost;
mod describe;
mod export;
mod export_dataset;
mod export_policy;
mod fitting;
mod folders;
mod fsck;
mod hosts;
mod import;
mod looks;
mod merge;
mod new;
mod one_trial;
mod overview;
mod pack;
mod planned;
mod prepare;
mod profiles;
mod progress;
mod provenance;
mod recorded;
mod rehearse;
mod reports;
mod rollout;
mod run;
mod running;
mod searches;
mod settings;
mod shell;
mod stages;
mod submit;
mod submitted;
mod summaries;
mod verify;
mod waiting;
mod watch;

use clap::{Args, CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};
use contract::{Registry, panics};
use document::{input_file, plain_text, reach};
use execution::{guard, limits::Limits, patience, scheduler::hosts::Relay};
use std::{
    io::IsTerminal,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::OnceLock,
    time::Duration,
};

/// Everything went well.
pub const OK: u8 = 0;
/// The command line or a spec is wrong.
pub const BAD_SPEC: u8 = 2;
/// This machine lacks what studies need, so that they could not be checked; nothing else is wrong.
pub const UNCHECKED: u8 = 3;
/// Nothing matched what was selected.
pub const NOTHING_SELECTED: u8 = 4;
/// Some trials failed.
pub const TRIALS_FAILED: u8 = 100;
/// A published value or claim differs, under `--strict`, or stored numbers differ that should not.
pub const DIFFERS: u8 = 101;
/// A table or figure of a report could not be made.
pub const NOT_MADE: u8 = 102;
/// Trials are missing.
pub const INCOMPLETE: u8 = 106;

/// A declarative experiment-pipeline engine for reinforcement learning in prescriptive maintenance and
/// operation.
#[derive(Debug, Parser)]
#[command(name = "regimen", version, arg_required_else_help = true, after_help = EXIT_CODES)]
struct Command {
    #[command(subcommand)]
    verb: Verb,
    #[command(flatten)]
    common: Common,
}

const EXIT_CODES: &str = "Exit codes: 0 ok, 2 bad usage or spec, 3 a study cannot be checked for want of \
 something that this machine lacks (check), 4 nothing selected, 100 some trials failed, \
101 a published value or claim differs or moved under --strict, or stored numbers differ (merge, verify), \
102 a table or figure could not be made, 106 incomplete, 128+n signal n.";

/// What every command understands.
#[derive(Debug, Clone, Args)]
struct Common {
    /// Folder of the store; `store` in regimen.toml, else `store`.
    #[arg(long, global = true, env = "REGIMEN_STORE", value_name = "DIR")]
    store: Option<PathBuf>,
    /// Bucket of object storage by which machines without a common folder share their stores, as
    /// `s3://bucket/prefix`; `bucket` in regimen.toml.
    #[arg(long, global = true, env = "REGIMEN_BUCKET", value_name = "URL")]
    bucket: Option<String>,
    /// Profile of regimen.toml to use.
    #[arg(long, global = true, env = "REGIMEN_MACHINE", value_name = "NAME")]
    machine: Option<String>,
    /// Largest file, in megabytes, that is read as a study, data, curves or runs of others; usually 10 MB of a
    /// study, 256 MB of other text and 16 GB of other bytes.
    #[arg(long, global = true, env = "REGIMEN_INPUT_MB", value_name = "MB", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    input_mb: Option<u64>,
    /// How to print: for people or as JSON.
    #[arg(long, global = true, value_enum, default_value_t = Format::Text)]
    format: Format,
}

impl Common {
    /// The options of the machine as words of a command line; the store is named by who writes it.
    fn of_the_machine(&self) -> impl Iterator<Item = String> {
        let machine = self.machine.iter().map(|name| ("--machine", name.clone()));
        let input = self.input_mb.iter().map(|size| ("--input-mb", size.to_string()));
        let bucket = self.bucket.iter().map(|url| ("--bucket", url.clone()));
        machine
            .chain(input)
            .chain(bucket)
            .flat_map(|(option, value)| [option.to_owned(), value])
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    Text,
    Json,
}

/// Which studies, and with which budget.
#[derive(Debug, Clone, Args)]
struct Selection {
    /// Study files.
    #[arg(required = true, value_name = "SPEC")]
    specs: Vec<PathBuf>,
    /// Profile of the study (a named budget).
    #[arg(long, short = 'P', value_name = "NAME")]
    profile: Option<String>,
    /// Replace one value, as in `--set dsac.discount=0.999`.
    #[arg(long = "set", short = 'S', value_name = "PATH=VALUE")]
    sets: Vec<String>,
    /// Number of seeds, in place of the study's.
    #[arg(long, value_name = "N")]
    seeds: Option<u64>,
    /// Only trials of these environments and agents (names of the study).
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
}

#[derive(Debug, Clone, Default, Args)]
struct RunOptions {
    /// Worker processes; `workers` in regimen.toml, else the number of cores. With a queue: tasks at a time;
    /// `max_tasks`.
    #[arg(long, short = 'j', env = "REGIMEN_JOBS", value_name = "N", value_parser = one_or_more)]
    jobs: Option<usize>,
    /// What runs the trials; `executor` in regimen.toml, else this machine.
    #[arg(long, value_name = "NAME", value_parser = submit::that_run())]
    executor: Option<String>,
    /// With a queue: leave after the submission; a later `run` follows it.
    #[arg(long)]
    detach: bool,
    /// Say what would run, and run nothing.
    #[arg(long, short = 'n')]
    dry_run: bool,
    /// Run failed trials again.
    #[arg(long)]
    retry_failed: bool,
    /// Compute no trial of a program a second time to see whether it repeats.
    #[arg(long)]
    no_rehearsal: bool,
    #[command(flatten)]
    limits: LimitOptions,
    #[command(flatten)]
    consent: consent::Consent,
}

/// What one trial may use, and what is tried again; each in place of what the study and regimen.toml say.
#[derive(Debug, Clone, Default, Args)]
struct LimitOptions {
    /// Stop at the first trial that does not end `ok`; the running ones save a checkpoint.
    #[arg(long, conflicts_with = "keep_going")]
    fail_fast: bool,
    /// Go on after trials that fail (the default).
    #[arg(long)]
    keep_going: bool,
    /// How often a trial that was killed from outside is tried again.
    #[arg(long, value_name = "N", value_parser = retries)]
    retries: Option<u32>,
    /// End states after which a trial is tried again, in place of `killed`.
    #[arg(long, value_name = "STATE", value_delimiter = ',', value_parser = end_state)]
    retry_on: Vec<contract::trial_end::EndState>,
    /// Wait before the first retry; it doubles with each further one.
    #[arg(long, value_name = "SECONDS", allow_hyphen_values = true, value_parser = retry_delay_s)]
    retry_delay_s: Option<f64>,
    /// Longest time of an attempt at a trial.
    #[arg(long, value_name = "SECONDS", allow_hyphen_values = true, value_parser = wall_time_s)]
    wall_time_s: Option<f64>,
    /// Longest time for which nothing may be heard of a program that trains itself.
    #[arg(long, value_name = "SECONDS", allow_hyphen_values = true, value_parser = stalled_after_s)]
    stalled_after_s: Option<f64>,
    /// Most memory of a trial's process.
    #[arg(long, value_name = "MB", value_parser = memory_mb)]
    memory_mb: Option<u64>,
}

/// A number of processes.
fn one_or_more(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(0) => Err("no process computes nothing: write 1 or more, or leave it out for one per core".into()),
        Ok(number) => Ok(number),
        Err(error) => Err(format!("{error}")),
    }
}

impl LimitOptions {
    /// The same options as words of a command line.
    fn arguments(&self) -> Vec<String> {
        let mut all = Vec::new();
        let mut with = |name: &str, value: Option<String>| {
            all.extend(value.into_iter().flat_map(|value| [name.to_owned(), value]));
        };
        with("--retries", self.retries.map(|value| value.to_string()));
        with(
            "--retry-delay-s",
            self.retry_delay_s.map(|value| value.to_string()),
        );
        with("--wall-time-s", self.wall_time_s.map(|value| value.to_string()));
        with(
            "--stalled-after-s",
            self.stalled_after_s.map(|value| value.to_string()),
        );
        with("--memory-mb", self.memory_mb.map(|value| value.to_string()));
        let states: Vec<&str> = self.retry_on.iter().map(|state| state.name()).collect();
        with("--retry-on", (!states.is_empty()).then(|| states.join(",")));
        if self.fail_fast {
            all.push("--fail-fast".into());
        }
        all
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

/// A limit that holds, of the same check as everywhere.
fn limit<T>(text: &str, limits: impl Fn(T) -> Limits) -> Result<T, String>
where
    T: std::str::FromStr<Err: std::fmt::Display> + Copy,
{
    let value: T = text.parse().map_err(|error: T::Err| error.to_string())?;
    let checked = limits(value).check();
    checked.map(|()| value).map_err(|error| error.instead.to_owned())
}

/// An end state by its word.
fn end_state(word: &str) -> Result<contract::trial_end::EndState, String> {
    use contract::trial_end::EndState;
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
struct WorkerOptions {
    #[command(flatten)]
    selection: Selection,
    /// Only every Nth trial, beginning with the Ith (from 0).
    #[arg(long, value_name = "I/N")]
    index: Option<String>,
    /// Worker processes.
    #[arg(long, short = 'j', default_value_t = 1, value_parser = one_or_more)]
    jobs: usize,
    /// The submission that it belongs to: nothing runs once nobody waits for it.
    #[arg(long, value_name = "ID", hide = true)]
    submission: Option<String>,
    #[command(flatten)]
    limits: LimitOptions,
    #[command(flatten)]
    consent: consent::Consent,
    #[command(flatten)]
    summaries: summaries::Summaries,
}

#[derive(Debug, Clone, Args)]
struct ReportOptions {
    /// Folder for tables, figures and the report, or for those of several studies, each in a folder of its name;
    /// `results/<study>`, with `-<profile>` and with `+<options>` behind it where the study is not run as it is
    /// written. Several studies have one page over all of them, too: `index.html` around their folders.
    #[arg(long, short = 'o', value_name = "DIR")]
    out: Option<PathBuf>,
    /// Leave with 101 where a published value or a claim differs.
    #[arg(long)]
    strict: bool,
    /// Print every table and claim, not the answers and the first table alone.
    #[arg(long, short = 'v')]
    verbose: bool,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Check studies; nothing runs. A study whose environment this machine cannot make is named, and no error; 3 where
    /// nothing else is wrong.
    Check(rehearse::CheckOptions),
    /// Say which trials a study has, which are done and what the rest will cost; nothing runs.
    Plan(Selection),
    /// Run what is missing, then write tables, figures and the report.
    Run {
        #[command(flatten)]
        selection: Selection,
        #[command(flatten)]
        options: RunOptions,
        #[command(flatten)]
        report: ReportOptions,
        #[command(flatten)]
        summaries: summaries::Summaries,
    },
    /// Show end states, and what is missing or failed.
    Status {
        #[command(flatten)]
        selection: Selection,
        #[command(flatten)]
        summaries: summaries::Summaries,
    },
    /// Show running trials, learning curves as they come, end states and the time left, in the terminal (q leaves), as
    /// a page that renews itself, or once as text; nothing in the store is changed.
    Watch(watch::WatchOptions),
    /// Write tables, figures and the report again from the store, or with `--recorded` from what an earlier
    /// report left; nothing is trained.
    Report {
        #[command(flatten)]
        selection: Selection,
        #[command(flatten)]
        report: ReportOptions,
        /// Read the record in each folder of results in the place of a store: trials as they were, judged by the
        /// studies as they are now. Figures of single steps and drawings stay as they are.
        #[arg(long)]
        recorded: bool,
        #[command(flatten)]
        against: against::Against,
    },
    /// Print the answers of all studies by family; or what is open.
    Overview(overview::OverviewOptions),
    /// Run missing trials from the store until none is left, without a report.
    Worker(WorkerOptions),
    /// Check every file of a store and set aside what is wrong; what it held runs again.
    Fsck {
        /// Folder of the store.
        #[arg(value_name = "STORE")]
        folder: Option<PathBuf>,
        /// Say what is wrong, and move nothing.
        #[arg(long, short = 'n')]
        dry_run: bool,
    },
    /// Put short trials of a store into one file, so that it has few files; every command reads them there.
    Pack(pack::PackOptions),
    /// Take the trials of other stores into one: what is new is taken, what is the same stays, and what differs is
    /// reported (101) and left.
    Merge(merge::MergeOptions),
    /// Folded into `report`.
    #[command(hide = true)]
    Compare {
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        rest: Vec<std::ffi::OsString>,
    },
    /// Write a study's numbers into a folder: tidy tables with every config key as a column, event files of
    /// TensorBoard, or a research object crate with the study, its report, metrics and who computed them. Or take away
    /// the policy of one stored trial as ONNX files, or its episodes as a Minari dataset.
    Export(export::ExportOptions),
    /// Look into CSV and TensorBoard files of other programs and print the entry under which a study shows their runs
    /// beside its own, marked as imported.
    Import(import::ImportOptions),
    /// Compute stored trials again, beside the store, and compare digests of metrics and products; 101 where they
    /// differ, 106 where one could not be compared. It works in the system's temporary folder.
    Verify(verify::VerifyOptions),
    /// Hand what is missing to a cluster and leave, or write what would be handed over.
    Submit {
        #[command(flatten)]
        selection: Selection,
        #[command(flatten)]
        options: submit::SubmitOptions,
    },
    /// Cancel what was submitted for these studies and has not ended.
    Cancel(Selection),
    /// Print the study with every default written out.
    Resolve(Selection),
    /// Drive one environment with given actions, an agent or a stored policy and write what happens.
    Rollout(rollout::RolloutOptions),
    /// List what is registered.
    List {
        /// What to list; everything where absent.
        #[arg(value_enum)]
        group: Option<crate::describe::Group>,
    },
    /// Say what something is that a study may name: its keys with defaults, units and sources, and an example.
    Describe {
        /// An environment, agent, protocol, kind of table or figure, section of a study, sampler, relation,
        /// aggregate, product or executor; what there is, where absent.
        name: Option<String>,
        /// Say besides which agents or environments do not fit, and why.
        #[arg(long)]
        why: bool,
    },
    /// Write a first study with comments, to be changed.
    New(new::NewOptions),
    /// Print the JSON Schema of a study, with the parameters of all plugins.
    Schema,
    /// Print a script that completes this command line in a shell.
    Completions {
        /// The shell.
        #[arg(value_enum)]
        shell: clap_complete::Shell,
    },
    /// Print the manual page, to be read by `man -l`.
    Man,
    /// Serve trials on standard input; started by `run`.
    #[command(hide = true)]
    TrialWorker,
    /// Serve trials of another machine on standard input; started by `run --executor ssh`.
    #[command(hide = true)]
    Relay {
        /// The store of this machine in which they lie until they have arrived there.
        folder: PathBuf,
        /// When leases of silent programs count as dead.
        #[arg(long, value_name = "SECONDS")]
        lease_expiry_s: f64,
    },
}

/// Reads the command line and does what it says.
#[must_use]
pub fn main(registry: impl FnOnce() -> Registry) -> ExitCode {
    // Once for every trial of a program, before anything is built.
    if let Some(code) = guard::serve_if_asked() {
        return code;
    }
    let registry = &registry();
    panics::print_no_caught_ones();
    let Command { verb, common } = parse(registry);
    common.input_mb.into_iter().for_each(input_file::allow);
    patience::say_by(complain);
    let answered = answer(registry, verb, &common);
    ExitCode::from(match answered.and_then(if_said) {
        Ok(code) => code,
        Err(failure) => {
            complain(&failure.text);
            failure.code
        }
    })
}

fn parse(registry: &Registry) -> Command {
    let version = contract::build::version(registry.build.as_ref());
    let matches = <Command as CommandFactory>::command()
        .version(version)
        .get_matches();
    Command::from_arg_matches(&matches).unwrap_or_else(|error| error.exit())
}

fn answer(registry: &Registry, verb: Verb, common: &Common) -> Result<u8, Failure> {
    match verb {
        Verb::Check(options) => rehearse::check(registry, &options, common),
        Verb::Plan(selection) => planned::plan(registry, &selection, common),
        Verb::Run {
            selection,
            options,
            report,
            summaries,
        } => summaries.after(registry, &selection, common, || {
            run::run(registry, &selection, &options, &report, common)
        }),
        Verb::Status { selection, summaries } => summaries.after(registry, &selection, common, || {
            planned::status(registry, &selection, common)
        }),
        Verb::Watch(options) => watch::watch(registry, &options, common),
        Verb::Report {
            selection,
            report,
            recorded,
            against,
        } => match &against.against {
            Some(earlier) => {
                let (what, other) = ((&selection, report.strict), (&**earlier, &against));
                against::report(registry, what, other, common)
            }
            None if recorded => recorded::report(registry, &selection, &report, common),
            None => reports::report(registry, &selection, &report, common),
        },
        Verb::Overview(options) => overview::overview(&options, common),
        Verb::Fsck { folder, dry_run } => fsck::fsck(folder, dry_run, common),
        Verb::Pack(options) => pack::pack(&options, common),
        Verb::Merge(options) => merge::merge(&options, common),
        Verb::Compare { .. } => Err(Failure {
            code: BAD_SPEC,
            text: "error: `compare A B` is `report B --against A`".into(),
        }),
        Verb::Export(options) => export::export(registry, &options, common),
        Verb::Import(options) => import::import(&options, common),
        Verb::Verify(options) => verify::verify(registry, &options, common),
        Verb::Worker(options) => worker(registry, &options, common),
        Verb::Submit { selection, options } => submit::submit(registry, &selection, &options, common),
        Verb::Cancel(selection) => submit::cancel(registry, &selection, common),
        Verb::Resolve(selection) => planned::resolve(registry, &selection),
        Verb::Rollout(options) => rollout::rollout(registry, &options, common),
        Verb::List { group } => describe::list(registry, group, common),
        Verb::Describe { name, why } => describe::describe(registry, name.as_deref(), why, common),
        Verb::New(options) => new::new(registry, &options),
        Verb::Schema => describe::schema(registry),
        Verb::Completions { shell } => shell::completions(shell),
        Verb::Man => shell::manual(),
        Verb::TrialWorker => serve(registry),
        Verb::Relay {
            folder,
            lease_expiry_s,
        } => relay(registry, &folder, lease_expiry_s),
    }
}

fn worker(registry: &Registry, options: &WorkerOptions, common: &Common) -> Result<u8, Failure> {
    let selection = &options.selection;
    options.summaries.after(registry, selection, common, || {
        match submitted::is_wanted(options.submission.as_deref(), common)? {
            true => run::worker(registry, options, common),
            false => Ok(OK),
        }
    })
}

fn serve(registry: &Registry) -> Result<u8, Failure> {
    reach::quote_nothing();
    execution::scheduler::serve(
        registry,
        std::io::BufReader::new(std::io::stdin()),
        std::io::stdout(),
    )?;
    Ok(OK)
}

fn relay(registry: &Registry, folder: &Path, lease_expiry_s: f64) -> Result<u8, Failure> {
    let expiry = Duration::try_from_secs_f64(lease_expiry_s).unwrap_or(Duration::from_secs(30));
    let input = std::io::BufReader::new(std::io::stdin());
    let output = std::io::BufWriter::new(std::io::stdout());
    Relay::open(folder, expiry)?.serve(registry.build.as_ref(), input, output)?;
    Ok(OK)
}

/// A command that could not be carried out: what to print and the exit code.
struct Failure {
    code: u8,
    text: String,
}

impl From<contract::Error> for Failure {
    fn from(error: contract::Error) -> Self {
        let code = if matches!(
            error,
            contract::Error::File { .. } | contract::Error::Store { .. }
        ) {
            INCOMPLETE
        } else {
            BAD_SPEC
        };
        Self {
            code,
            text: format!("error: {error}"),
        }
    }
}

/// Why something that was to be said was not, as on a full disk.
static UNSAID: OnceLock<String> = OnceLock::new();

/// Standard output is for results.
fn say(text: &str) {
    put(&plain_text::printable(text.trim_end_matches('\n')));
}

/// The same with verdicts in colour, on a terminal.
fn say_summary(text: &str) {
    let text = plain_text::printable(text.trim_end_matches('\n'));
    if colour_on(&std::io::stdout()) {
        put(&report::tinted(&text));
    } else {
        put(&text);
    }
}

fn put(text: &str) {
    use std::io::Write;
    let written = writeln!(std::io::stdout(), "{text}");
    // A reader that closed the pipe (`| head`) has what it wanted.
    if let Some(error) = written
        .err()
        .filter(|it| it.kind() != std::io::ErrorKind::BrokenPipe)
    {
        let _ = UNSAID.set(error.to_string());
    }
}

/// A command whose results nobody can read did not end well.
fn if_said(code: u8) -> Result<u8, Failure> {
    match UNSAID.get() {
        Some(problem) => Err(Failure {
            code: if code == OK { INCOMPLETE } else { code },
            text: format!("error: standard output could not be written: {problem}"),
        }),
        None => Ok(code),
    }
}

/// Standard error is for progress and complaints.
fn complain(text: &str) {
    use std::io::Write;
    // One write a message: programs that share a log do not mix their lines.
    let message = format!("{}\n", shown(text.trim_end_matches('\n')));
    let _ = std::io::stderr().write_all(message.as_bytes());
}

/// A message as a terminal gets it.
fn shown(text: &str) -> String {
    let message = plain_text::message(text);
    if colour() {
        plain_text::coloured(&message)
    } else {
        message.into_owned()
    }
}

fn colour() -> bool {
    colour_on(&std::io::stderr())
}

/// Colour on a terminal, unless `NO_COLOR` is set.
#[expect(
    clippy::disallowed_methods,
    reason = "it colours what is shown, and reaches no result"
)]
fn colour_on(stream: &impl IsTerminal) -> bool {
    stream.is_terminal() && std::env::var_os("NO_COLOR").is_none()
}
