//! Runs trials in worker processes on this machine.

use super::{
    idle::{IdleWorker, IdleWorkers},
    process::{Replies, WorkerProcess},
    slot::{RequestOutcome, Runner},
    worker::{Message, Reply, Request},
};
use crate::{
    device, guard,
    limits::Limits,
    store::{Store, work},
    world::{
        clock,
        process::{Command, ExitStatus},
    },
};
use contract::{Error, trial_end::EndState};
use document::input_file;
use std::{io::BufRead, path::Path, sync::Arc, time::Duration};

/// Time in which a signal to a run reaches the process that schedules, once it reached one that computes.
const TOLD: Duration = Duration::from_millis(300);

/// Runs the trials of one slot in a process, which is replaced when it dies.
pub(super) struct Local<'a> {
    program: &'a Path,
    device: Option<&'a str>,
    process: &'a WorkerProcess,
    replies: Option<Replies>,
    idle: &'a IdleWorkers,
}

impl<'a> Local<'a> {
    /// A runner without a process yet. It takes one of `idle`, or starts `program`, with a device for its learners.
    pub(super) fn new(
        program: &'a Path,
        device: Option<&'a str>,
        process: &'a WorkerProcess,
        idle: &'a IdleWorkers,
    ) -> Self {
        Self {
            program,
            device,
            process,
            replies: None,
            idle,
        }
    }

    /// The reader of the messages of a process without a trial.
    fn replies(&mut self) -> Result<Replies, Error> {
        if let Some(replies) = self.replies.take() {
            return Ok(replies);
        }
        if let Some(IdleWorker { process, replies, .. }) = self.idle.take(self.device) {
            self.process.adopt(process);
            return Ok(replies);
        }
        self.process.start(&mut worker(self.program, self.device), None)
    }
}

impl Runner for Local<'_> {
    fn run(
        &mut self,
        request: Request,
        limits: &Arc<Limits>,
        progress: &mut dyn FnMut(u64, u64),
    ) -> Result<RequestOutcome, Error> {
        let place = work(&Store::at(&request.store).folder(&request.trial.id));
        let notes = place.join(guard::NOTES);
        let message = serde_json::to_string(&Message::Run(Box::new(request)));
        let message = message.map_err(|source| Error::Worker {
            problem: source.to_string(),
        })?;
        let mut replies = self.replies()?;
        // An earlier run may have been killed. The wait for its program does not count towards the limits.
        guard::end_leftover(&notes);
        self.process.begin(&message, limits);
        let Some(reply) = listen(&mut replies, progress) else {
            let (status, exceeded) = self.process.bury();
            let by_limit = exceeded.is_some();
            // A program outlives its worker by its grace at most; the trial ends with it.
            guard::end_leftover(&notes);
            if is_stop(status) {
                // A signal that stops all processes of a run also reaches the scheduling one, which decides what
                // follows.
                clock::sleep(TOLD);
            }
            let (state, reason) = exceeded.unwrap_or_else(|| explain(status));
            return Ok(RequestOutcome::Died {
                state,
                reason,
                by_limit,
            });
        };
        // A process whose trial panicked exits after reporting it; one whose trial was stopped by a signal does, too.
        let panicked = matches!(&reply, Reply::Ended { end } if end.state == EndState::Panicked);
        if panicked || matches!(reply, Reply::Stopped) {
            self.process.dismiss();
        } else if self.process.end() {
            self.replies = Some(replies);
        }
        Ok(RequestOutcome::Said(reply))
    }

    fn dismiss(&mut self) {
        if let Some(replies) = self.replies.take()
            && let Some(process) = self.process.release()
        {
            self.idle.keep(IdleWorker {
                device: self.device.map(str::to_owned),
                process,
                replies,
            });
        }
    }
}

/// The command of a worker process.
fn worker(program: &Path, device: Option<&str>) -> Command {
    let mut command = Command::new(program);
    command
        .arg(super::WORKER)
        .envs(input_file::asked().map(|size| (input_file::VARIABLE, size.to_string())))
        .envs(device.map(|address| (device::VARIABLE, address)));
    command
}

/// Passes on the messages of the process until its last one; `None` if it died without one.
fn listen(replies: &mut Replies, progress: &mut dyn FnMut(u64, u64)) -> Option<Reply> {
    loop {
        let mut line = String::new();
        if replies.read_line(&mut line).unwrap_or(0) == 0 {
            return None;
        }
        match serde_json::from_str(&line) {
            Ok(Reply::Progress { done, total }) => progress(done, total),
            Ok(last) => return Some(last),
            // Other output of a plugin on standard output is skipped.
            Err(_) => {}
        }
    }
}

/// Whether a process was ended by a signal with which users, terminals and batch systems stop programs.
fn is_stop(status: Option<ExitStatus>) -> bool {
    use std::os::unix::process::ExitStatusExt;
    status
        .and_then(|status| status.signal())
        .is_some_and(|signal| [1, 2, 10, 15].contains(&signal))
}

fn explain(status: Option<ExitStatus>) -> (EndState, String) {
    use std::os::unix::process::ExitStatusExt;
    let Some(status) = status else {
        return (EndState::Killed, "the worker process vanished".into());
    };
    match (status.signal(), status.code()) {
        // A Rust program that cannot unwind ends itself by SIGABRT.
        (Some(6), _) => (EndState::Panicked, "the worker process aborted".into()),
        (Some(signal), _) => (
            EndState::Killed,
            format!("the worker process was ended by signal {signal}"),
        ),
        (None, code) => (
            EndState::Killed,
            format!("the worker process left with exit code {}", code.unwrap_or(-1)),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scheduler::queue::tests::trial;
    use std::fs;

    /// A worker that refuses every trial and gives its process id as the reason.
    const REFUSING: &str =
        "#!/bin/sh\nwhile read -r request; do echo '{\"unready\":{\"reason\":\"'$$'\"}}'; done\n";

    /// The id of the process that a slot with this device gets, after its last trial.
    fn process_of_slot(folder: &Path, device: Option<&str>, idle: &IdleWorkers) -> u32 {
        let request = Request {
            trial: trial("1"),
            store: folder.to_path_buf(),
            checkpoint_every_s: 1.0,
            until: None,
            stalled_after_s: None,
            share: Default::default(),
        };
        let (program, process) = (folder.join("worker"), WorkerProcess::default());
        let mut slot = Local::new(&program, device, &process, idle);
        let outcome = slot.run(request, &Default::default(), &mut |_, _| {}).unwrap();
        slot.dismiss();
        let RequestOutcome::Said(Reply::Unready { reason }) = outcome else {
            panic!("the worker answers every request");
        };
        reason.parse().unwrap()
    }

    #[test]
    fn slots_of_later_runs_take_over_living_processes_with_their_device() {
        let folder = tempfile::tempdir().unwrap();
        // A file that this process wrote could not be started while a test beside this one starts a process.
        let write = r#"printf %s "$1" > "$0" && chmod 755 "$0""#;
        let written = Command::new("sh")
            .args(["-c", write])
            .args([folder.path().join("worker").as_os_str(), REFUSING.as_ref()])
            .status();
        assert!(written.unwrap().success());
        let idle = IdleWorkers::default();
        let process_of = |device| process_of_slot(folder.path(), device, &idle);

        let (first, with_device) = (process_of(None), process_of(Some("card 0")));
        assert_ne!(first, with_device);
        assert_eq!(
            [process_of(None), process_of(Some("card 0"))],
            [first, with_device]
        );
        crate::world::process::signal(first, crate::world::process::Signal::Kill);
        let lives =
            |pid: u32| fs::read_to_string(format!("/proc/{pid}/stat")).is_ok_and(|it| !it.contains(") Z"));
        while lives(first) {
            clock::sleep(Duration::from_millis(2));
        }
        let replacement = process_of(None);
        assert_ne!(
            replacement, first,
            "a process that died without a trial is no trial's end"
        );
        drop(idle);
        assert!(!lives(replacement) && !lives(with_device));
    }
}
