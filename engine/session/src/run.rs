//! Runs: computes missing trials here, on hosts or through a queue, including those that looks and searches add.

use crate::{
    Exit, Failure, Planned, RunOptions, Session, WorkerOptions, compute::Compute, device, hosts, rehearse,
    searches, seen, submit::Submitting,
};
use contract::Registry;
use execution::executor::{self, ExecutorKind, Way};

/// The outcome of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Computed {
    /// All requested trials were attempted; reports can follow.
    Ended {
        /// The exit of the run.
        exit: Exit,
        /// Whether the trials ran without a queue.
        is_here: bool,
    },
    /// The command returns while a queue continues.
    Left(Exit),
}

impl Session<'_> {
    /// Computes the missing trials, look by look if looks are planned, and tests whether programs give the same values
    /// again. The studies come from [`load_with_looks`](Self::load_with_looks), and grow.
    ///
    /// # Errors
    /// Fails for trials that fit on no machine, executors that cannot be reached, and a store that cannot be written.
    pub fn run(&self, planned: &mut [Planned], options: &RunOptions) -> Result<Computed, Failure> {
        let store = self.store()?;
        self.warn(planned.iter().map(|one| &one.study));
        let mut how = Compute {
            limits: options.limits.clone(),
            fail_fast: options.fail_fast,
            retry_failed: options.retry_failed,
            ..Compute::of(self, options.jobs.unwrap_or(self.settings.workers))
        };
        let kind = place(&mut how, planned, options)?;
        let is_here = kind.is_none() && how.hosts.all.is_empty();
        how.device = device::choose(self, options.device.as_deref(), is_here)?;
        if let (Some(device), None) = (how.device, options.jobs) {
            how.workers *= device::workers_of_a_core(device.name);
        }
        seen::fix(self, planned, store)?;
        // Programs are computed again on the machine where their trials run.
        let candidates = match is_here && !options.no_rehearsal {
            true => rehearse::candidates(self.registry, planned, store),
            false => Vec::new(),
        };
        let computed = self.compute_all(&mut how, kind.as_ref(), planned, options)?;
        // A stopped run starts nothing more.
        if !matches!(
            computed,
            Computed::Ended {
                exit: Exit::Incomplete,
                ..
            } | Computed::Left(_)
        ) {
            rehearse::compute_again(&how, &candidates, store)?;
        }
        Ok(computed)
    }

    /// Computes the missing trials, look by look if looks are planned.
    fn compute_all(
        &self,
        how: &mut Compute<'_>,
        kind: Option<&ExecutorKind>,
        planned: &mut [Planned],
        options: &RunOptions,
    ) -> Result<Computed, Failure> {
        loop {
            let exit = match kind {
                None => how.run(planned, |_| true)?,
                Some(kind) => match (Submitting { kind, planned, how }).run(options)? {
                    Some(exit) => return Ok(Computed::Left(exit)),
                    None => Exit::Ok,
                },
            };
            if !goes_on(exit, how) || !self.grow(planned)? {
                return Ok(Computed::Ended {
                    exit: exit.max(searches::tell(self, planned)),
                    is_here: kind.is_none(),
                });
            }
            // A trial that fails now is not repeated at every look.
            how.retry_failed = false;
        }
    }

    /// Computes the missing trials of one part, and leaves trials that other programs run to them.
    ///
    /// # Errors
    /// Trials that do not fit the machine, and a store that cannot be written.
    pub fn work(&self, planned: &mut [Planned], options: &WorkerOptions) -> Result<Exit, Failure> {
        let mut how = Compute {
            limits: options.limits.clone(),
            fail_fast: options.fail_fast,
            whole: false,
            ..Compute::of(self, options.jobs)
        };
        how.device = device::choose(self, None, true)?;
        seen::fix(self, planned, self.store()?)?;
        let (part, parts) = options.part;
        let mut exit = Exit::Ok;
        loop {
            // A failure at one look remains a failure after the next.
            exit = exit.max(how.run(planned, |position| position % parts == part)?);
            if !goes_on(exit, &how) || !self.grow(planned)? {
                return Ok(exit.max(searches::tell(self, planned)));
            }
        }
    }
}

/// The queue for the trials, if there is one. Hosts are contacted, and become those of `how`.
fn place(
    how: &mut Compute<'_>,
    planned: &[Planned],
    options: &RunOptions,
) -> Result<Option<ExecutorKind>, Failure> {
    let settings = &how.session.settings;
    let mut kind = elsewhere(
        how.session.registry,
        options.executor.as_deref().unwrap_or(&settings.executor),
    );
    let on_hosts = kind.take_if(|kind| matches!(kind.way, Way::Hosts(_)));
    if kind.is_none() && options.detach {
        return Err(Failure::refusal(
            "--detach needs --executor slurm or another that has a queue",
        ));
    }
    if let Some(kind) = &on_hosts {
        let executor = settings.executor(kind, options.jobs)?;
        if let Some(access) = executor.access() {
            hosts::reach(how, planned, access)?;
        }
    }
    Ok(kind)
}

/// The executor with this name, if it starts workers on other machines.
fn elsewhere(registry: &Registry, name: &str) -> Option<ExecutorKind> {
    executor::find(registry, name).filter(|kind| kind.options().is_some())
}

/// Whether a further look may follow. It may not if trials are missing, since they would be missing then too.
fn goes_on(computed: Exit, how: &Compute<'_>) -> bool {
    computed != Exit::Incomplete && !(computed == Exit::TrialsFailed && how.fail_fast)
}
