//! `run --executor slurm`, `submit`, `cancel`, and what `status` says of submissions.

use super::{
    BAD_SPEC, Common, Failure, Format, INCOMPLETE, LimitOptions, NOTHING_SELECTED, OK, RunOptions, Selection,
    complain,
    compute::{Compute, has_paused, listen_for_signals},
    consent::{self, Consent},
    fitting::Machines,
    planned::{self, Planned},
    prepare::Ends,
    progress::Progress,
    say, settings,
};
use clap::{
    Args,
    builder::{PossibleValue, PossibleValuesParser},
};
use contract::{Registry, trial_end::is_missing};
use execution::{
    executor::{
        self, Dispatch, Error, Executor, Kind, Outcome, Stop, Task, View, Wanted, Watch, Way, Work, describe,
    },
    scheduler::{self, Event},
    store::{Store, write_durably},
};
use serde_json::json;
use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
    sync::{Arc, atomic::AtomicBool},
};

/// The executors that the program can run trials with, as values of an option.
pub(super) fn that_run() -> PossibleValuesParser {
    values(Kind::runs)
}

/// The executors that missing trials can be handed to.
fn that_take() -> PossibleValuesParser {
    values(Kind::takes)
}

fn values(which: impl Fn(&Kind) -> bool) -> PossibleValuesParser {
    let kinds = executor::all().into_iter().filter(which);
    kinds
        .map(|kind| PossibleValue::new(kind.name).help(kind.about))
        .collect::<Vec<_>>()
        .into()
}

#[derive(Debug, Clone, Args)]
pub(super) struct SubmitOptions {
    /// What they are handed to.
    #[arg(long, value_name = "NAME", value_parser = that_take())]
    executor: String,
    /// Print the script or manifest and submit nothing.
    #[arg(long, short = 'n')]
    dry_run: bool,
    /// With --dry-run: write it into this file instead.
    #[arg(long, short = 'o', value_name = "FILE", requires = "dry_run")]
    out: Option<PathBuf>,
    #[command(flatten)]
    consent: Consent,
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        let code = match &error {
            Error::NoProgram { .. } | Error::Refused { .. } | Error::Option { .. } => BAD_SPEC,
            _ => INCOMPLETE,
        };
        Self {
            code,
            text: format!("error: {error}"),
        }
    }
}

/// What was asked of an executor, for which studies.
pub(super) struct Asked<'a> {
    /// The executor.
    pub(super) kind: &'a Kind,
    /// The studies and their trials.
    pub(super) planned: &'a [Planned],
    /// As it was said on the command line.
    pub(super) selection: &'a Selection,
    pub(super) common: &'a Common,
    /// What computing means here.
    pub(super) how: &'a Compute<'a>,
}

/// Computes what is missing through a queue and waits for it. `None` where every trial has ended, else the
/// exit code.
pub(super) fn run(asked: &Asked<'_>, options: &RunOptions) -> Result<Option<u8>, Failure> {
    let executor = asked.how.settings.executor(asked.kind, options.jobs)?;
    let stop = Arc::new(AtomicBool::new(false));
    let dispatch = asked.dispatch(&*executor, Stop::on(&stop))?;
    set_aside_damaged(&dispatch.store)?;
    let ends = asked.how.prepare(asked.planned, &Store::at(&dispatch.store))?;
    let tasks = asked.how.tasks(asked.planned, &ends, |_| true);
    asked.refuse_unfit(&*executor, &tasks)?;
    if tasks.is_empty() {
        complain(&asked.how.nothing_runs(asked.planned, &ends));
        return Ok(None);
    }
    listen_for_signals(&stop)?;
    let mut watching = Watching::new(&tasks, &dispatch.store, asked.kind.title);
    if watching.missing().is_empty() {
        complain("what is missing is blocked: it takes what is not there; nothing runs");
        return Ok(None);
    }
    let view = match begin(&dispatch, &mut watching) {
        Err(error @ Error::Interrupted { .. }) => {
            drop(watching);
            return Ok(Some(leave(&format!("{error}; {}", asked.going_on()))));
        }
        begun => begun?,
    };
    if options.detach {
        complain(&asked.going_on());
        return Ok(Some(OK));
    }
    let outcome = dispatch.follow(view, &mut watching)?;
    drop(watching);
    match outcome {
        Outcome::Ended => Ok(None),
        Outcome::Stopped => Ok(Some(leave(&asked.going_on()))),
        Outcome::Cancelled => Ok(Some(leave(
            "the submission was cancelled; the same command submits what is missing",
        ))),
    }
}

fn leave(text: &str) -> u8 {
    complain(text);
    INCOMPLETE
}

/// Submits what lacks and says what is followed.
fn begin(dispatch: &Dispatch<'_>, watching: &mut Watching<'_>) -> Result<View, Error> {
    let before = executor::open(&dispatch.store)?;
    let before: BTreeSet<String> = before.into_iter().map(|submission| submission.id).collect();
    let view = dispatch.begin(&watching.missing(), watching)?;
    for holding in &view.live {
        // What existed and lives is followed; what lives without having existed was submitted just now.
        let existed = before.contains(&holding.submission.id) && !holding.tasks.is_empty();
        let word = if existed { "following" } else { "submitted" };
        watching.say(&format!("{word} {}", describe(&holding.submission)));
    }
    Ok(view)
}

impl Asked<'_> {
    fn going_on(&self) -> String {
        let run = self
            .selection
            .command("run", self.common, &["--executor", self.kind.name]);
        let [status, cancel] =
            ["status", "cancel"].map(|verb| self.selection.command(verb, self.common, &[]));
        format!(
            "the jobs go on without this program: `{run}` follows them and writes the report, `{status}` \
             shows them, \
             `{cancel}` ends them"
        )
    }

    fn dispatch<'e>(&self, executor: &'e dyn Executor, stop: Stop) -> Result<Dispatch<'e>, Failure> {
        let name = self.kind.name;
        let none = || Failure {
            code: BAD_SPEC,
            text: format!("error: `{name}` takes no submissions"),
        };
        let queue = executor.queue().ok_or_else(none)?;
        let (store, work) = self.work(executor)?;
        let trials_per_task = executor.trials_per_task();
        Ok(Dispatch {
            store,
            work,
            queue,
            trials_per_task,
            trials: ids(self.planned),
            stop,
        })
    }

    /// Refuses trials that fit no task.
    fn refuse_unfit(&self, executor: &dyn Executor, tasks: &[scheduler::Task<'_>]) -> Result<(), Failure> {
        let agents = tasks.iter().filter_map(|task| task.trial.key.agent.agent());
        Machines::tasks(executor, self.kind.name).refuse_unfit(self.how.registry, agents)
    }

    /// What a worker runs, and the store as it finds it. Where workers see other paths than those of this
    /// machine, paths stay as they were written.
    fn work(&self, executor: &dyn Executor) -> Result<(PathBuf, Work), Failure> {
        let path = |path: &Path| {
            if executor.shares_paths() {
                absolute(path)
            } else {
                Ok(path.to_path_buf())
            }
        };
        let store = path(&self.how.settings.store)?;
        let specs = self
            .selection
            .specs
            .iter()
            .map(|spec| path(spec))
            .collect::<Result<Vec<_>, _>>()?;
        let cores = executor.cpus_per_task().get();
        let mut arguments = worker_arguments(&specs, &store, cores, self.selection, self.common);
        arguments.extend(self.how.limits.arguments());
        // Who hands programs over has agreed to them.
        let starts = |one: &Planned| consent::has_programs(self.how.registry, &one.plan);
        arguments.extend(self.planned.iter().any(starts).then(|| "--yes".to_owned()));
        let program = std::env::current_exe().map_err(|source| Error::NoProgram {
            program: "regimen",
            source,
        })?;
        let (specs, folder) = (self.selection.specs.clone(), absolute(Path::new("."))?);
        Ok((
            store,
            Work {
                specs,
                program,
                arguments,
                folder,
            },
        ))
    }

    /// What would be handed over for the trials that are missing now; nobody is asked and nothing is touched.
    fn written(&self) -> Result<String, Failure> {
        let executor = self.how.settings.executor(self.kind, None)?;
        let (store, work) = self.work(&*executor)?;
        let ends: Ends = self
            .planned
            .iter()
            .map(|one| planned::ends(&Store::at(&store), &one.plan.trials))
            .collect();
        let tasks = self.how.tasks(self.planned, &ends, |_| true);
        self.refuse_unfit(&*executor, &tasks)?;
        let study = self
            .planned
            .iter()
            .map(|one| one.study.name.as_str())
            .collect::<Vec<_>>()
            .join("-");
        let name = self.kind.name;
        let wrong = |error| Failure {
            code: BAD_SPEC,
            text: format!("error: regimen.toml: [{name}] {error}"),
        };
        executor
            .written(&Wanted {
                study: &study,
                store: &store,
                work: &work,
                trials: tasks.len(),
            })
            .map_err(wrong)
    }
}

/// `submit`: what is missing is handed over, or what would be is shown.
pub(super) fn submit(
    registry: &Registry,
    selection: &Selection,
    options: &SubmitOptions,
    common: &Common,
) -> Result<u8, Failure> {
    let settings = settings::read(common)?;
    let store = settings.open()?;
    let planned = planned::load_with_looks(registry, selection, &store)?;
    if !options.dry_run {
        options.consent.ask(registry, &planned, &store)?;
    }
    let limits = LimitOptions::default();
    let said = (selection, common);
    let how = Compute {
        registry,
        asked: said,
        settings: &settings,
        limits: &limits,
        workers: 1,
        hosts: Default::default(),
        retry_failed: false,
        whole: false,
    };
    // The command line takes names of the list alone.
    let Some(kind) = executor::find(&options.executor) else {
        return Ok(BAD_SPEC);
    };
    let asked = Asked {
        kind: &kind,
        planned: &planned,
        selection,
        common,
        how: &how,
    };
    if options.dry_run {
        return show_or_write(&asked.written()?, options);
    }
    if let Way::Written(_, command) = &kind.way {
        let title = kind.title;
        let text = format!(
            "error: regimen writes what {title} needs and does not talk to it: add --dry-run, and give what \
             it prints to \
             `{command}`"
        );
        return Err(Failure { code: BAD_SPEC, text });
    }
    let options = RunOptions {
        detach: true,
        ..RunOptions::default()
    };
    run(&asked, &options).map(|code| code.unwrap_or(OK))
}

fn show_or_write(text: &str, options: &SubmitOptions) -> Result<u8, Failure> {
    match &options.out {
        Some(path) => write_durably(path, text.as_bytes())?,
        None => say(text),
    }
    Ok(OK)
}

/// `cancel`: ends what was submitted for the trials of these studies.
pub(super) fn cancel(registry: &Registry, selection: &Selection, common: &Common) -> Result<u8, Failure> {
    let store = absolute(&settings::read(common)?.store)?;
    let planned = planned::load_with_looks(registry, selection, &Store::at(&store))?;
    set_aside_damaged(&store)?;
    let cancelled = executor::cancel(&store, &ids(&planned), &Stop::default(), &mut complain)?;
    cancelled
        .iter()
        .for_each(|submission| say(&format!("cancelled {}", describe(submission))));
    if cancelled.is_empty() {
        complain("nothing is submitted for these studies");
        return Ok(NOTHING_SELECTED);
    }
    Ok(OK)
}

/// What queues hold of this store's submissions; nothing where there is none.
pub(super) fn show(store: &Path, format: Format) {
    let holdings = absolute(store).map(|store| {
        set_aside_damaged(&store)?;
        executor::holdings(&store, &Stop::default())
    });
    let holdings = match holdings {
        Ok(Ok(holdings)) => holdings,
        Ok(Err(error)) => {
            return complain(&format!(
                "warning: nobody can be asked about this store's submissions: {error}"
            ));
        }
        Err(failure) => return complain(&failure.text),
    };
    let live: Vec<_> = holdings.iter().filter(|holding| holding.alive() > 0).collect();
    if live.is_empty() {
        return;
    }
    if format == Format::Json {
        let rows = live.iter().map(|holding| {
            let jobs: Vec<_> = holding.submission.arrays.iter().map(|array| &array.job).collect();
            json!({"id": holding.submission.id, "jobs": jobs, "tasks": executor::counts(&holding.tasks)})
        });
        return say(&json!({"submissions": rows.collect::<Vec<_>>()}).to_string());
    }
    for holding in live {
        let title = executor::find(&holding.submission.executor).map_or("", |kind| kind.title);
        say(&format!(
            "  {title}: {}: {}",
            describe(&holding.submission),
            executor::summary(&holding.tasks)
        ));
    }
}

/// A record that cannot be read hides no other one: it is set aside, and that is said.
fn set_aside_damaged(store: &Path) -> Result<(), Error> {
    let found = executor::heal(store)?;
    let aside = found.aside.unwrap_or_default();
    for finding in &found.findings {
        let (path, problem) = (finding.path.display(), &finding.problem);
        complain(&format!(
            "warning: `{path}` of the store is damaged and was set aside in `{}`: {problem}",
            aside.display()
        ));
    }
    Ok(())
}

fn worker_arguments(
    specs: &[PathBuf],
    store: &Path,
    jobs: usize,
    selection: &Selection,
    common: &Common,
) -> Vec<String> {
    let text = |path: &Path| path.to_string_lossy().into_owned();
    let mut all = vec!["worker".to_owned()];
    all.extend(specs.iter().map(|path| text(path)));
    all.extend(["--store".into(), text(store), "-j".into(), jobs.to_string()]);
    all.extend(selection.options());
    all.extend(common.of_the_machine());
    all
}

fn ids(planned: &[Planned]) -> BTreeSet<String> {
    planned
        .iter()
        .flat_map(|one| one.plan.trials.iter().map(|trial| trial.id.clone()))
        .collect()
}

/// The path from the root, since a worker on another machine knows nothing of this folder. Links stay as they
/// are: what they point to may lie elsewhere there.
fn absolute(path: &Path) -> Result<PathBuf, Failure> {
    std::path::absolute(path).map_err(|source| Failure::from(contract::Error::file("find", path)(source)))
}

/// Shows trials as they end in the store, and the queue as it changes.
struct Watching<'a> {
    tasks: &'a [scheduler::Task<'a>],
    left: BTreeSet<usize>,
    store: Store,
    progress: Progress<'a>,
    /// What the queue is called, and what was last said of it.
    title: &'static str,
    queue: String,
}

impl<'a> Watching<'a> {
    fn new(tasks: &'a [scheduler::Task<'a>], store: &Path, title: &'static str) -> Self {
        let (left, progress) = ((0..tasks.len()).collect(), Progress::new(tasks, 0));
        Self {
            tasks,
            left,
            store: Store::at(store),
            progress,
            title,
            queue: String::new(),
        }
    }
}

impl Watch for Watching<'_> {
    fn missing(&mut self) -> BTreeSet<String> {
        let (tasks, store, progress) = (self.tasks, &self.store, &mut self.progress);
        self.left
            .retain(|&trial| match store.end(&tasks[trial].trial.id).unwrap_or(None) {
                Some(end) if !is_missing(Some(&end)) => {
                    progress.show(&Event::Ended { slot: 0, trial, end });
                    false
                }
                // A trial that came to its pause, and was left there, waits for what the others come to.
                _ if has_paused(&tasks[trial], store) && store.running(&tasks[trial].trial.id).is_none() => {
                    progress.show(&Event::Paused { slot: 0, trial });
                    false
                }
                _ => true,
            });
        // What takes from trials that are still to come needs no worker yet, and none at all where they never
        // end well.
        let ready = self
            .left
            .iter()
            .filter(|&&trial| scheduler::is_ready(&tasks[trial].after, store));
        ready.map(|&trial| tasks[trial].trial.id.clone()).collect()
    }

    fn saved(&mut self) -> u64 {
        self.left
            .iter()
            .map(|&trial| self.store.checkpoints(&self.tasks[trial].trial.id))
            .sum()
    }

    fn queue(&mut self, tasks: &[Task]) {
        let summary = executor::summary(tasks);
        if summary != self.queue {
            self.progress.line(&format!("{}: {summary}", self.title));
            self.queue = summary;
        }
    }

    fn say(&mut self, text: &str) {
        self.progress.line(text);
    }
}
