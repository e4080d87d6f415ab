//! Trials that are submitted to a queue and followed there.

use crate::{
    Exit, Failure, Follower, Planned, RunOptions, Session,
    compute::{Compute, Ends, has_paused},
    device::workers_of_a_core,
    fitting::Machines,
    programs,
};
use contract::trial_end::is_missing;
use execution::{
    executor::{
        self, Dispatch, Error, Executor, ExecutorKind, Holding, Stop, Submission, Task, View, WaitEnd,
        Wanted, Watch, Way, Work, describe,
    },
    limits::Limits,
    scheduler::{self, Event},
    store::Store,
};
use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        let exit = match &error {
            Error::NoProgram { .. } | Error::Refused { .. } | Error::Option { .. } => Exit::BadStudy,
            _ => Exit::Incomplete,
        };
        Self {
            exit,
            text: format!("error: {error}"),
        }
    }
}

/// Studies to be submitted to a queue.
pub(crate) struct Submitting<'a> {
    /// The executor with the queue.
    pub(crate) kind: &'a ExecutorKind,
    /// The studies and their trials.
    pub(crate) planned: &'a [Planned],
    /// The settings of the computation.
    pub(crate) how: &'a Compute<'a>,
}

impl Session<'_> {
    /// Submits the missing trials to an executor and returns.
    ///
    /// # Errors
    /// An executor that cannot be reached or accepts no submissions.
    pub fn submit(&self, planned: &[Planned], kind: &ExecutorKind) -> Result<Exit, Failure> {
        if let Way::Written(_, command) = &kind.way {
            let title = kind.title;
            return Err(Failure::refusal(format!(
                "regimen writes what {title} needs and does not talk to it: add --dry-run, and give what it prints to \
                 `{command}`"
            )));
        }
        let how = self.of_parts();
        let options = RunOptions {
            detach: true,
            ..RunOptions::default()
        };
        let submitting = Submitting {
            kind,
            planned,
            how: &how,
        };
        Ok(submitting.run(&options)?.unwrap_or(Exit::Ok))
    }

    /// The script or manifest for the trials that are missing now. It does not contact the queue and changes nothing.
    ///
    /// # Errors
    /// Invalid options of the executor, and trials that fit in no task.
    pub fn written(&self, planned: &[Planned], kind: &ExecutorKind) -> Result<String, Failure> {
        let how = self.of_parts();
        let submitting = Submitting {
            kind,
            planned,
            how: &how,
        };
        submitting.written()
    }

    fn of_parts(&self) -> Compute<'_> {
        Compute {
            whole: false,
            ..Compute::of(self, 1)
        }
    }

    /// Cancels the submissions with trials of these studies, and returns them.
    ///
    /// # Errors
    /// A queue that does not answer.
    pub fn cancel(&self, planned: &[Planned]) -> Result<Vec<Submission>, Failure> {
        let store = absolute(&self.settings.store)?;
        set_aside_damaged(self, &store)?;
        let mut say = |text: &str| self.notice(text);
        Ok(executor::cancel(
            self.registry,
            &store,
            &ids(planned),
            &Stop::default(),
            &mut say,
        )?)
    }

    /// The submissions of this store that are still in a queue.
    ///
    /// # Errors
    /// A queue that does not answer.
    pub fn holdings(&self) -> Result<Vec<Holding>, Failure> {
        let store = absolute(&self.settings.store)?;
        let holdings = set_aside_damaged(self, &store)
            .and_then(|()| executor::holdings(self.registry, &store, &Stop::default()));
        holdings.map_err(|error| Failure {
            exit: Exit::Incomplete,
            text: format!("warning: nobody can be asked about this store's submissions: {error}"),
        })
    }
}

impl Submitting<'_> {
    /// Computes the missing trials through a queue and waits for it. `None` if every trial has ended, otherwise the
    /// exit of the command.
    pub(crate) fn run(&self, options: &RunOptions) -> Result<Option<Exit>, Failure> {
        let session = self.how.session;
        let executor = session.settings.executor(self.kind, options.jobs)?;
        let stop = session.observer.stop()?;
        let dispatch = self.dispatch(&*executor, Stop::on(&stop))?;
        set_aside_damaged(session, &dispatch.store)?;
        let ends = self.how.prepare(self.planned, &Store::at(&dispatch.store))?;
        let tasks = self.how.tasks(self.planned, &ends, |_| true);
        self.refuse_unfit(&*executor, &tasks)?;
        if tasks.is_empty() {
            session.notice(&self.how.nothing_runs(self.planned, &ends));
            return Ok(None);
        }
        let mut watching = Watching::new(session, &tasks, &dispatch.store, self.kind.title);
        if watching.missing().is_empty() {
            session.notice("what is missing is blocked: it takes what is not there; nothing runs");
            return Ok(None);
        }
        let leave = |text: &str| {
            session.notice(text);
            Ok(Some(Exit::Incomplete))
        };
        let view = match begin(&dispatch, &mut watching) {
            Err(error @ Error::Interrupted { .. }) => {
                drop(watching);
                return leave(&format!("{error}; {}", self.going_on()));
            }
            begun => begun?,
        };
        if options.detach {
            session.notice(&self.going_on());
            return Ok(Some(Exit::Ok));
        }
        let outcome = dispatch.follow(view, &mut watching)?;
        drop(watching);
        match outcome {
            WaitEnd::Ended => Ok(None),
            WaitEnd::Stopped => leave(&self.going_on()),
            WaitEnd::Cancelled => {
                leave("the submission was cancelled; the same command submits what is missing")
            }
        }
    }

    fn going_on(&self) -> String {
        let session = self.how.session;
        let run = session.command("run", &["--executor", self.kind.name]);
        let [status, cancel] = ["status", "cancel"].map(|verb| session.command(verb, &[]));
        format!(
            "the jobs go on without this program: `{run}` follows them and writes the report, `{status}` \
             shows them, \
             `{cancel}` ends them"
        )
    }

    fn dispatch<'e>(&'e self, executor: &'e dyn Executor, stop: Stop) -> Result<Dispatch<'e>, Failure> {
        let name = self.kind.name;
        let none = || Failure::refusal(format!("`{name}` takes no submissions"));
        let queue = executor.queue().ok_or_else(none)?;
        let (store, work) = self.work(executor)?;
        let trials_per_task = executor.trials_per_task();
        Ok(Dispatch {
            registry: self.how.session.registry,
            store,
            work,
            queue,
            trials_per_task,
            trials: ids(self.planned),
            stop,
        })
    }

    /// Refuses trials that fit in no task.
    fn refuse_unfit(&self, executor: &dyn Executor, tasks: &[scheduler::Task<'_>]) -> Result<(), Failure> {
        let agents = tasks.iter().filter_map(|task| task.trial.key.agent.agent());
        Machines::tasks(executor, self.kind.name).refuse_unfit(self.how.session.registry, agents)
    }

    /// The command of a worker, and the path of its store. If workers see other paths than this machine, paths stay as
    /// they were written.
    fn work(&self, executor: &dyn Executor) -> Result<(PathBuf, Work), Failure> {
        let path = |path: &Path| {
            if executor.shares_paths() {
                absolute(path)
            } else {
                Ok(path.to_path_buf())
            }
        };
        let store = path(&self.how.session.settings.store)?;
        let session = self.how.session;
        let specs = session
            .selection
            .specs
            .iter()
            .map(|spec| path(spec))
            .collect::<Result<Vec<_>, _>>()?;
        let cores = executor.cpus_per_task().get();
        let workers = cores * workers_of_a_core(&session.settings.device);
        let mut arguments = worker_arguments(session, &specs, &store, workers);
        arguments.extend(words(&self.how.limits, self.how.fail_fast));
        // The person who submits programs has consented to them.
        let starts = |one: &Planned| programs::has_programs(self.how.session.registry, &one.plan);
        arguments.extend(self.planned.iter().any(starts).then(|| "--yes".to_owned()));
        let program = std::env::current_exe().map_err(|source| Error::NoProgram {
            program: "regimen",
            source,
        })?;
        let (specs, folder) = (session.selection.specs.clone(), absolute(Path::new("."))?);
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

    /// The script or manifest for the trials that are missing now. It does not contact the queue and changes nothing.
    fn written(&self) -> Result<String, Failure> {
        let executor = self.how.session.settings.executor(self.kind, None)?;
        let (store, work) = self.work(&*executor)?;
        let ends: Ends = self
            .planned
            .iter()
            .map(|one| self.how.session.ends(&Store::at(&store), one))
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
        let wrong = |error| Failure::refusal(format!("regimen.toml: [{name}] {error}"));
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

/// Submits the trials that no task holds, and reports the submissions that are followed.
fn begin(dispatch: &Dispatch<'_>, watching: &mut Watching<'_>) -> Result<View, Error> {
    let before = executor::open(&dispatch.store)?;
    let before: BTreeSet<String> = before.into_iter().map(|submission| submission.id).collect();
    let view = dispatch.begin(&watching.missing(), watching)?;
    for holding in &view.live {
        // A live submission that existed before is followed; a new one was submitted just now.
        let existed = before.contains(&holding.submission.id) && !holding.tasks.is_empty();
        let word = if existed { "following" } else { "submitted" };
        watching.say(&format!("{word} {}", describe(&holding.submission)));
    }
    Ok(view)
}

/// Sets aside unreadable records with a warning, so that they hide no other record.
fn set_aside_damaged(session: &Session<'_>, store: &Path) -> Result<(), Error> {
    let found = executor::heal(store)?;
    let aside = found.aside.unwrap_or_default();
    for finding in &found.findings {
        let (path, problem) = (finding.path.display(), &finding.problem);
        session.notice(&format!(
            "warning: `{path}` of the store is damaged and was set aside in `{}`: {problem}",
            aside.display()
        ));
    }
    Ok(())
}

/// The arguments with which a queue starts a worker.
fn worker_arguments(session: &Session<'_>, specs: &[PathBuf], store: &Path, jobs: usize) -> Vec<String> {
    let text = |path: &Path| path.to_string_lossy().into_owned();
    let mut all = vec!["worker".to_owned()];
    all.extend(specs.iter().map(|path| text(path)));
    all.extend(["--store".into(), text(store), "-j".into(), jobs.to_string()]);
    all.extend(session.selection.options());
    all.extend(session.machine.words());
    all
}

/// Limits as words of a command line.
fn words(limits: &Limits, fail_fast: bool) -> Vec<String> {
    let mut all = Vec::new();
    let mut with = |name: &str, value: Option<String>| {
        all.extend(value.into_iter().flat_map(|value| [name.to_owned(), value]));
    };
    let number = |value: Option<f64>| value.map(|value| value.to_string());
    with("--retries", limits.retries.map(|value| value.to_string()));
    with("--retry-delay-s", number(limits.retry_delay_s));
    with("--wall-time-s", number(limits.wall_time_s));
    with("--stalled-after-s", number(limits.stalled_after_s));
    with("--memory-mb", limits.memory_mb.map(|value| value.to_string()));
    let states = limits.retry_on.iter().flatten().map(|state| state.name());
    let states: Vec<&str> = states.collect();
    with("--retry-on", (!states.is_empty()).then(|| states.join(",")));
    all.extend(fail_fast.then(|| "--fail-fast".to_owned()));
    all
}

fn ids(planned: &[Planned]) -> BTreeSet<String> {
    planned
        .iter()
        .flat_map(|one| one.plan.trials.iter().map(|trial| trial.id.clone()))
        .collect()
}

/// The absolute path, since a worker on another machine does not know the current folder. Links are not resolved,
/// because their targets may lie elsewhere there.
fn absolute(path: &Path) -> Result<PathBuf, Failure> {
    std::path::absolute(path).map_err(|source| Failure::from(contract::Error::file("find", path)(source)))
}

/// Reports trials as they end in the store, and changes of the queue.
struct Watching<'a> {
    tasks: &'a [scheduler::Task<'a>],
    left: BTreeSet<usize>,
    store: Store,
    follower: Box<dyn Follower + 'a>,
    /// The name of the queue. `queue` holds its last summary.
    title: &'static str,
    queue: String,
}

impl<'a> Watching<'a> {
    fn new(
        session: &Session<'_>,
        tasks: &'a [scheduler::Task<'a>],
        store: &Path,
        title: &'static str,
    ) -> Self {
        Self {
            tasks,
            left: (0..tasks.len()).collect(),
            store: Store::at(store),
            follower: session.observer.follow(tasks, 0),
            title,
            queue: String::new(),
        }
    }
}

impl Watch for Watching<'_> {
    fn missing(&mut self) -> BTreeSet<String> {
        let (tasks, store, follower) = (self.tasks, &self.store, &mut self.follower);
        self.left
            .retain(|&trial| match store.end(&tasks[trial].trial.id).unwrap_or(None) {
                Some(end) if !is_missing(Some(&end)) => {
                    follower.hear(&Event::Ended { slot: 0, trial, end });
                    false
                }
                // A trial that was left at its pause waits for the results of the others.
                _ if has_paused(&tasks[trial], store) && store.running(&tasks[trial].trial.id).is_none() => {
                    follower.hear(&Event::Paused { slot: 0, trial });
                    false
                }
                _ => true,
            });
        // A trial whose sources are missing needs no worker yet, and never needs one if a source fails.
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
            self.follower.line(&format!("{}: {summary}", self.title));
            self.queue = summary;
        }
    }

    fn say(&mut self, text: &str) {
        self.follower.line(text);
    }
}
