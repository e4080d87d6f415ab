//! `run --executor slurm`, `submit`, `cancel`, and what `status` says of submissions.

use super::{
    BAD_SPEC, Common, Failure, Format, INCOMPLETE, LimitOptions, NOTHING_SELECTED, OK, RunOptions, Selection, complain,
    compute::{Compute, listen_for_signals},
    prepare::Ends,
    progress::Progress,
    say, settings,
    study::{self, Planned},
};
use crate::{
    Registry,
    executor::{
        Error, Submission, Work, kubernetes,
        slurm::{self, Outcome, Slurm, Task, View, Watch, describe},
    },
    scheduler::{self, Event},
    store::{Store, is_missing, write_durably},
};
use clap::{Args, ValueEnum};
use serde::Deserialize;
use serde_json::json;
use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

/// What runs the missing trials.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Executor {
    /// Worker processes on this machine.
    Local,
    /// Workers in Slurm job arrays.
    Slurm,
}

/// What missing trials can be handed to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Cluster {
    /// Slurm job arrays, submitted with sbatch.
    Slurm,
    /// A Kubernetes Indexed Job, written only.
    Kubernetes,
}

#[derive(Debug, Clone, Args)]
pub(super) struct SubmitOptions {
    /// Which kind of cluster.
    #[arg(long, value_enum)]
    executor: Cluster,
    /// Print the script or manifest and submit nothing.
    #[arg(long, short = 'n')]
    dry_run: bool,
    /// With --dry-run: write it into this file instead.
    #[arg(long, short = 'o', value_name = "FILE", requires = "dry_run")]
    out: Option<PathBuf>,
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        let code = match &error {
            Error::NoProgram { .. } | Error::Refused { .. } | Error::Option { .. } => BAD_SPEC,
            _ => INCOMPLETE,
        };
        Self { code, text: format!("error: {error}") }
    }
}

/// Computes what is missing through Slurm and waits for it. `None` where every trial has ended, else the exit code.
pub(super) fn run(
    planned: &[Planned],
    selection: &Selection,
    options: &RunOptions,
    how: &Compute<'_>,
    common: &Common,
) -> Result<Option<u8>, Failure> {
    let slurm = slurm_for(planned, selection, options.jobs, how, common)?;
    let ends = how.prepare(planned, &Store::at(&slurm.store))?;
    let tasks = how.tasks(planned, &ends, |_| true);
    if tasks.is_empty() {
        complain(&how.nothing_runs(planned, &ends));
        return Ok(None);
    }
    let stop = Arc::new(AtomicBool::new(false));
    listen_for_signals(&stop)?;
    let mut watching = Watching::new(&tasks, &slurm.store, stop);
    if watching.missing().is_empty() {
        complain("what is missing is blocked: it takes what is not there; nothing runs");
        return Ok(None);
    }
    let view = begin(&slurm, &mut watching)?;
    if options.detach {
        complain(&going_on(selection, common));
        return Ok(Some(OK));
    }
    let outcome = slurm.follow(view, &mut watching)?;
    drop(watching);
    match outcome {
        Outcome::Ended => Ok(None),
        Outcome::Stopped => Ok(Some(leave(&going_on(selection, common)))),
        Outcome::Cancelled => Ok(Some(leave("the submission was cancelled; the same command submits what is missing"))),
    }
}

fn leave(text: &str) -> u8 {
    complain(text);
    INCOMPLETE
}

/// Submits what lacks and says what is followed.
fn begin(slurm: &Slurm, watching: &mut Watching<'_>) -> Result<View, Failure> {
    let before: BTreeSet<String> = slurm::open(&slurm.store)?.into_iter().map(|submission| submission.id).collect();
    let missing = watching.missing();
    let view = slurm.begin(&missing, watching)?;
    for holding in &view.live {
        // What existed and lives is followed; what lives without having existed was submitted just now.
        let word = if before.contains(&holding.submission.id) && !holding.tasks.is_empty() { "following" } else { "submitted" };
        watching.say(&format!("{word} {}", describe(&holding.submission)));
    }
    Ok(view)
}

fn going_on(selection: &Selection, common: &Common) -> String {
    let run = selection.command("run", common, &["--executor", "slurm"]);
    let [status, cancel] = ["status", "cancel"].map(|verb| selection.command(verb, common, &[]));
    format!(
        "the jobs go on without this program: `{run}` follows them and writes the report, `{status}` shows them, `{cancel}` ends \
         them"
    )
}

/// `submit`: what is missing is handed over, or what would be is shown.
pub(super) fn submit(
    registry: &Registry,
    selection: &Selection,
    options: &SubmitOptions,
    common: &Common,
) -> Result<u8, Failure> {
    let settings = settings::read(common)?;
    let planned = study::load_with_looks(registry, selection, &Store::at(&settings.store))?;
    let limits = LimitOptions::default();
    let asked = (selection, common);
    let how = Compute { registry, asked, settings: &settings, limits: &limits, workers: 1, retry_failed: false, whole: false };
    match (options.executor, options.dry_run) {
        (Cluster::Slurm, false) => {
            let options = RunOptions { detach: true, ..RunOptions::default() };
            run(&planned, selection, &options, &how, common).map(|code| code.unwrap_or(OK))
        }
        (Cluster::Slurm, true) => show_or_write(&script(&planned, selection, &how, common)?, options),
        (Cluster::Kubernetes, true) => show_or_write(&manifest(&planned, selection, &how, common)?, options),
        (Cluster::Kubernetes, false) => {
            let text = "error: regimen writes the manifest and does not talk to Kubernetes: add --dry-run, and give what it \
                        prints to `kubectl apply -f -`";
            Err(Failure { code: BAD_SPEC, text: text.into() })
        }
    }
}

fn show_or_write(text: &str, options: &SubmitOptions) -> Result<u8, Failure> {
    match &options.out {
        Some(path) => write_durably(path, text.as_bytes())?,
        None => say(text),
    }
    Ok(OK)
}

/// The first script that would be submitted; Slurm is not asked.
fn script(planned: &[Planned], selection: &Selection, how: &Compute<'_>, common: &Common) -> Result<String, Failure> {
    const USUAL_MAX_ARRAY_SIZE: usize = 1001;
    let slurm = slurm_for(planned, selection, None, how, common)?;
    let missing = how.tasks(planned, &ends(planned, &slurm.store), |_| true);
    let tasks = missing.len().div_ceil(slurm.options.trials_per_task().get()).max(1);
    let arrays = slurm::divide(tasks, USUAL_MAX_ARRAY_SIZE, slurm.options.max_tasks());
    Ok(slurm::render(&Submission::sample(&slurm.store, &slurm.work, &slurm.options, arrays), 0))
}

fn manifest(planned: &[Planned], selection: &Selection, how: &Compute<'_>, common: &Common) -> Result<String, Failure> {
    let settings = how.settings;
    let trials = how.tasks(planned, &ends(planned, &settings.store), |_| true);
    let options = &settings.kubernetes;
    let study = planned.iter().map(|one| one.study.name.as_str()).collect::<Vec<_>>().join("-");
    // Paths stay as written: they are seen from the folder of the volume, not from here.
    let mut arguments = worker_arguments(&selection.specs, &settings.store, options.cpus_per_task().get(), selection, common);
    arguments.extend(how.limits.arguments());
    let workers = kubernetes::Workers { study, arguments, trials: trials.len() };
    let wrong = |error| Failure { code: BAD_SPEC, text: format!("error: regimen.toml: [kubernetes] {error}") };
    kubernetes::manifest(&workers, options).map_err(wrong)
}

/// How the trials have ended so far; nothing is touched.
fn ends(planned: &[Planned], store: &Path) -> Ends {
    planned.iter().map(|one| study::ends(&Store::at(store), &one.plan.trials)).collect()
}

/// `cancel`: ends what was submitted for the trials of these studies.
pub(super) fn cancel(registry: &Registry, selection: &Selection, common: &Common) -> Result<u8, Failure> {
    let store = absolute(&settings::read(common)?.store)?;
    let planned = study::load_with_looks(registry, selection, &Store::at(&store))?;
    let cancelled = slurm::cancel(&store, &ids(&planned))?;
    cancelled.iter().for_each(|submission| say(&format!("cancelled {}", describe(submission))));
    if cancelled.is_empty() {
        complain("nothing is submitted for these studies");
        return Ok(NOTHING_SELECTED);
    }
    Ok(OK)
}

/// What Slurm holds of this store's submissions; nothing where there is none.
pub(super) fn show(store: &Path, format: Format) {
    let holdings = match absolute(store).map(|store| slurm::holdings(&store)) {
        Ok(Ok(holdings)) => holdings,
        Ok(Err(error)) => return complain(&format!("warning: Slurm cannot be asked about this store's submissions: {error}")),
        Err(failure) => return complain(&failure.text),
    };
    let live: Vec<_> = holdings.iter().filter(|holding| holding.alive() > 0).collect();
    if live.is_empty() {
        return;
    }
    if format == Format::Json {
        let rows = live.iter().map(|holding| {
            let jobs: Vec<_> = holding.submission.arrays.iter().map(|array| &array.job).collect();
            json!({"id": holding.submission.id, "jobs": jobs, "tasks": slurm::counts(&holding.tasks)})
        });
        return say(&json!({"submissions": rows.collect::<Vec<_>>()}).to_string());
    }
    for holding in live {
        say(&format!("  Slurm: {}: {}", describe(&holding.submission), slurm::summary(&holding.tasks)));
    }
}

fn slurm_for(
    planned: &[Planned],
    selection: &Selection,
    jobs: Option<usize>,
    how: &Compute<'_>,
    common: &Common,
) -> Result<Slurm, Failure> {
    let settings = how.settings;
    let mut options = settings.slurm.clone();
    options.max_tasks = jobs.and_then(std::num::NonZeroUsize::new).or(options.max_tasks);
    let store = absolute(&settings.store)?;
    let specs = selection.specs.iter().map(|path| absolute(path)).collect::<Result<Vec<_>, _>>()?;
    let mut arguments = worker_arguments(&specs, &store, options.cpus_per_task().get(), selection, common);
    arguments.extend(how.limits.arguments());
    let program = std::env::current_exe().map_err(|source| Error::NoProgram { program: "regimen", source })?;
    let work = Work { specs: selection.specs.clone(), program, arguments, folder: absolute(Path::new("."))? };
    Ok(Slurm { store, work, options, trials: ids(planned) })
}

fn worker_arguments(specs: &[PathBuf], store: &Path, jobs: usize, selection: &Selection, common: &Common) -> Vec<String> {
    let text = |path: &Path| path.to_string_lossy().into_owned();
    let mut all = vec!["worker".to_owned()];
    all.extend(specs.iter().map(|path| text(path)));
    all.extend(["--store".into(), text(store), "-j".into(), jobs.to_string()]);
    all.extend(selection.options());
    all.extend(common.machine.iter().flat_map(|name| ["--machine".to_owned(), name.clone()]));
    all
}

fn ids(planned: &[Planned]) -> BTreeSet<String> {
    planned.iter().flat_map(|one| one.plan.trials.iter().map(|trial| trial.id.clone())).collect()
}

/// The path from the root, since a worker on another machine knows nothing of this folder. Links stay as they are: what they
/// point to may lie elsewhere there.
fn absolute(path: &Path) -> Result<PathBuf, Failure> {
    std::path::absolute(path).map_err(|source| Failure::from(crate::Error::file("find", path)(source)))
}

/// Shows trials as they end in the store, and Slurm's queue as it changes.
struct Watching<'a> {
    tasks: &'a [scheduler::Task<'a>],
    left: BTreeSet<usize>,
    store: Store,
    stop: Arc<AtomicBool>,
    progress: Progress<'a>,
    queue: String,
}

impl<'a> Watching<'a> {
    fn new(tasks: &'a [scheduler::Task<'a>], store: &Path, stop: Arc<AtomicBool>) -> Self {
        let (left, progress) = ((0..tasks.len()).collect(), Progress::new(tasks, 0));
        Self { tasks, left, store: Store::at(store), stop, progress, queue: String::new() }
    }
}

impl Watch for Watching<'_> {
    fn missing(&mut self) -> BTreeSet<String> {
        let (tasks, store, progress) = (self.tasks, &self.store, &mut self.progress);
        self.left.retain(|&trial| match store.end(&tasks[trial].trial.id).unwrap_or(None) {
            Some(end) if !is_missing(Some(&end)) => {
                progress.show(&Event::Ended { slot: 0, trial, end });
                false
            }
            _ => true,
        });
        // What takes from trials that are still to come needs no worker yet, and none at all where they never end well.
        let ready = self.left.iter().filter(|&&trial| scheduler::is_ready(&tasks[trial].after, store));
        ready.map(|&trial| tasks[trial].trial.id.clone()).collect()
    }

    fn saved(&mut self) -> u64 {
        self.left.iter().map(|&trial| self.store.checkpoints(&self.tasks[trial].trial.id)).sum()
    }

    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::SeqCst)
    }

    fn queue(&mut self, tasks: &[Task]) {
        let summary = slurm::summary(tasks);
        if summary != self.queue {
            self.progress.line(&format!("Slurm: {summary}"));
            self.queue = summary;
        }
    }

    fn say(&mut self, text: &str) {
        self.progress.line(text);
    }
}
