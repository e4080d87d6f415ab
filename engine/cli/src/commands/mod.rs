//! The command line: commands, and the functions that carry them out.

mod against;
mod arguments;
mod cells;
mod check;
mod consent;
mod console;
mod describe;
mod export;
mod fsck;
mod import;
mod merge;
mod new;
mod overview;
mod pack;
mod plan;
mod progress;
mod report;
mod rollout;
mod run;
mod running;
mod shell;
mod submit;
mod submitted;
mod summaries;
mod verify;
mod watch;

use arguments::{Common, Format, LimitArgs, ReportArgs, RunArgs, Studies, WorkerArgs, one_or_more};
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use console::{Person, complain, say};
use contract::{Registry, panics};
use document::input_file;
use execution::{
    executor::{self, ExecutorKind},
    patience,
    scheduler::hosts::Relay,
};
use session::{Exit, Failure};
use std::{
    path::{Path, PathBuf},
    process::ExitCode,
    time::Duration,
};

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

#[derive(Debug, Subcommand)]
enum Verb {
    /// Check studies; no trial and no program runs, but environments and agents in Python are made and rehearsed. A
    /// study whose environment this machine cannot make is reported but is no error; exit code 3 if nothing else is
    /// wrong.
    Check(check::CheckOptions),
    /// Show the trials of a study, which of them are done, and the estimated cost of the rest; no trial runs.
    Plan(Studies),
    /// Run missing trials, then write tables, figures and the report.
    Run {
        #[command(flatten)]
        studies: Studies,
        #[command(flatten)]
        options: RunArgs,
        #[command(flatten)]
        report: ReportArgs,
        #[command(flatten)]
        summaries: summaries::Summaries,
    },
    /// Show end states, and missing and failed trials.
    Status {
        #[command(flatten)]
        studies: Studies,
        #[command(flatten)]
        summaries: summaries::Summaries,
    },
    /// Show running trials, learning curves so far, end states and the time left: in the terminal (q leaves), as a page
    /// that renews itself, or once as text; nothing in the store is changed.
    Watch(watch::WatchOptions),
    /// Write tables, figures and the report again from the store, or with `--recorded` from the files of an earlier
    /// report; nothing is trained.
    Report {
        #[command(flatten)]
        studies: Studies,
        #[command(flatten)]
        report: ReportArgs,
        /// Read the record in each folder of results instead of a store: trials as they were, judged by the current
        /// studies. Figures of single steps and drawings stay as they are.
        #[arg(long)]
        recorded: bool,
        #[command(flatten)]
        against: against::Against,
    },
    /// Print the answers of all studies by family, or the open verdicts.
    Overview(overview::OverviewOptions),
    /// Run missing trials from the store until none is left, without a report.
    Worker(WorkerArgs),
    /// Check every file of a store and set damaged files aside; their trials run again.
    Fsck {
        /// Folder of the store.
        #[arg(value_name = "STORE")]
        folder: Option<PathBuf>,
        /// Show what is wrong, and move nothing.
        #[arg(long, short = 'n')]
        dry_run: bool,
    },
    /// Put short trials of a store into one file, so that it has few files; every command reads them there.
    Pack(pack::PackOptions),
    /// Copy the trials of other stores into one: new trials are copied, equal trials stay, and different trials are
    /// reported (101) and left.
    Merge(merge::MergeOptions),
    /// Replaced by `report --against`.
    #[command(hide = true)]
    Compare {
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        rest: Vec<std::ffi::OsString>,
    },
    /// Write a study's numbers into a folder: tidy tables with every config key as a column, event files of
    /// TensorBoard, or a research object crate with the study, its report, metrics and the builds that computed them.
    /// Or export the policy of one stored trial as ONNX files, or its episodes as a Minari dataset.
    Export(export::ExportOptions),
    /// Read CSV and TensorBoard files of other programs and print the entry with which a study shows their runs beside
    /// its own, marked as imported.
    Import(import::ImportOptions),
    /// Compute stored trials again, beside the store, and compare digests of metrics and artifacts; exit code 101 if
    /// they differ, 106 if one could not be compared. It works in the system's temporary folder.
    Verify(verify::VerifyArgs),
    /// Submit missing trials to a cluster and return, or write the script or manifest.
    Submit {
        #[command(flatten)]
        studies: Studies,
        #[command(flatten)]
        options: submit::SubmitOptions,
    },
    /// Cancel submissions for these studies that have not ended.
    Cancel(Studies),
    /// Print the study with every default written out.
    Resolve(Studies),
    /// Run one environment with given actions, an agent or a stored policy and write its steps.
    Rollout(rollout::RolloutOptions),
    /// List the registered names.
    List {
        /// Group of names; all where absent.
        #[arg(value_enum)]
        group: Option<crate::describe::Group>,
    },
    /// Describe a name that a study may use: its keys with defaults, units and sources, and an example.
    Describe(describe::DescribeOptions),
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
    /// Print the manual page, for `man -l`.
    Man,
    /// Serve trials of another machine on standard input; started by `run --executor ssh`.
    #[command(hide = true)]
    Relay {
        /// The store of this machine that holds the trials until they have arrived there.
        folder: PathBuf,
        /// Time after which leases of silent programs count as dead.
        #[arg(long, value_name = "SECONDS")]
        lease_expiry_s: f64,
    },
}

/// Reads the command line and carries it out.
#[must_use]
pub fn main(registry: impl Fn() -> Registry) -> ExitCode {
    if let Some(served) = session::serve_if_asked(&registry) {
        return served.unwrap_or_else(|failure| failed(&failure));
    }
    let registry = &registry();
    panics::print_no_caught_ones();
    let Command { verb, common } = parse(registry);
    common.input_mb.into_iter().for_each(input_file::allow);
    patience::say_by(complain);
    let answered = answer(registry, verb, &common).and_then(console::if_said);
    answered.map_or_else(|failure| failed(&failure), |exit| ExitCode::from(exit.code()))
}

/// Prints why a command was not carried out.
fn failed(failure: &Failure) -> ExitCode {
    complain(&failure.text);
    ExitCode::from(failure.exit.code())
}

/// The command line with the names of the registered executors.
fn command(registry: &Registry) -> clap::Command {
    let kinds = executor::all(registry);
    let named = |of: &'static str, which: fn(&ExecutorKind) -> bool| {
        let values = submit::values(&kinds, which);
        move |command: clap::Command| command.mut_arg(of, |argument| argument.value_parser(values))
    };
    <Command as CommandFactory>::command()
        .mut_subcommand("run", named("executor", ExecutorKind::runs))
        .mut_subcommand("submit", named("executor", ExecutorKind::takes))
}

fn parse(registry: &Registry) -> Command {
    let version = contract::build::version(registry.build.as_ref());
    let matches = command(registry).version(version).get_matches();
    Command::from_arg_matches(&matches).unwrap_or_else(|error| error.exit())
}

fn answer(registry: &Registry, verb: Verb, common: &Common) -> Result<Exit, Failure> {
    match verb {
        Verb::Check(options) => check::check(registry, &options, common),
        Verb::Plan(studies) => plan::plan(registry, &studies, common),
        Verb::Run {
            studies,
            options,
            report,
            summaries,
        } => summaries.after(registry, &studies, common, || {
            run::run(registry, &studies, &options, &report, common)
        }),
        Verb::Status { studies, summaries } => summaries.after(registry, &studies, common, || {
            plan::status(registry, &studies, common)
        }),
        Verb::Watch(options) => watch::watch(registry, &options, common),
        Verb::Report {
            studies,
            report,
            recorded,
            against,
        } => match &against.against {
            Some(earlier) => {
                let (what, other) = ((&studies, report.strict), (&**earlier, &against));
                against::report(registry, what, other, common)
            }
            None if recorded => report::recorded(registry, &studies, &report, common),
            None => report::report(registry, &studies, &report, common),
        },
        Verb::Overview(options) => overview::overview(&options, common),
        Verb::Fsck { folder, dry_run } => fsck::fsck(registry, folder, dry_run, common),
        Verb::Pack(options) => pack::pack(registry, &options, common),
        Verb::Merge(options) => merge::merge(registry, &options, common),
        Verb::Compare { .. } => Err(Failure::refusal("`compare A B` is `report B --against A`")),
        Verb::Export(options) => export::export(registry, &options, common),
        Verb::Import(options) => import::import(&options, common),
        Verb::Verify(options) => verify::verify(registry, &options, common),
        Verb::Worker(options) => options.summaries.after(registry, &options.studies, common, || {
            run::worker(registry, &options, common)
        }),
        Verb::Submit { studies, options } => submit::submit(registry, &studies, &options, common),
        Verb::Cancel(studies) => submit::cancel(registry, &studies, common),
        Verb::Resolve(studies) => check::resolve(registry, &studies, common),
        Verb::Rollout(options) => rollout::rollout(registry, &options, common),
        Verb::List { group } => describe::list(registry, group, common),
        Verb::Describe(options) => describe::answer(registry, &options, common),
        Verb::New(options) => new::new(registry, &options),
        Verb::Schema => describe::schema(registry),
        Verb::Completions { shell } => shell::completions(registry, shell),
        Verb::Man => shell::manual(registry),
        Verb::Relay {
            folder,
            lease_expiry_s,
        } => relay(registry, &folder, lease_expiry_s),
    }
}

fn relay(registry: &Registry, folder: &Path, lease_expiry_s: f64) -> Result<Exit, Failure> {
    let expiry = Duration::try_from_secs_f64(lease_expiry_s).unwrap_or(Duration::from_secs(30));
    let input = std::io::BufReader::new(std::io::stdin());
    let output = std::io::BufWriter::new(std::io::stdout());
    Relay::open(folder, expiry)?.serve(registry.build.as_ref(), input, output)?;
    Ok(Exit::Ok)
}
