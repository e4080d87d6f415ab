//! Which trial is next: longest first, those that play the policies of others last, then those whose retry is due and those
//! that other programs may have left.

use super::Task;
use crate::results::TrialEnd;
use std::{
    cmp::Reverse,
    collections::{BTreeSet, VecDeque},
    sync::{Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

/// How long a trial that another program has is left alone before it is looked after again.
const HELD_FOR: Duration = Duration::from_millis(300);

/// What a slot should do next.
pub(super) enum Next {
    /// Try this trial.
    Try(Turn),
    /// Nothing is due yet.
    Wait(Duration),
    /// Nothing is left.
    Done,
}

/// One attempt at a trial.
#[derive(Debug, Clone)]
pub(super) struct Turn {
    /// Index into the list of tasks.
    pub(super) task: usize,
    /// Number of the attempt, from 1.
    pub(super) attempt: u32,
    /// The stored end that is no reason not to try.
    pub(super) before: Option<TrialEnd>,
}

/// The trials that are left.
pub(super) struct Queue<'a> {
    tasks: &'a [Task<'a>],
    state: Mutex<State<'a>>,
}

struct State<'a> {
    ready: VecDeque<usize>,
    later: Vec<Later>,
    /// Trials that some slot works on: one of them may come back as a retry.
    busy: usize,
    /// Ids of the trials that this program has still to run, or is running.
    left: BTreeSet<&'a str>,
}

struct Later {
    due: Instant,
    turn: Turn,
}

impl<'a> Queue<'a> {
    /// All tasks, longest first.
    pub(super) fn new(tasks: &'a [Task<'a>]) -> Self {
        let mut order: Vec<usize> = (0..tasks.len()).collect();
        order.sort_by_key(|&index| (!tasks[index].after.is_empty(), Reverse(tasks[index].cost)));
        let left = tasks.iter().map(|task| task.trial.id.as_str()).collect();
        Self { tasks, state: Mutex::new(State { ready: order.into(), later: Vec::new(), busy: 0, left }) }
    }

    /// The next trial; whoever gets one says [`Queue::done`], [`Queue::retry`] or [`Queue::held`] about it.
    pub(super) fn next(&self) -> Next {
        let mut state = self.lock();
        let now = now();
        if let Some(position) = state.later.iter().position(|later| later.due <= now) {
            let Later { turn, .. } = state.later.swap_remove(position);
            state.busy += 1;
            return Next::Try(turn);
        }
        if let Some(task) = state.ready.pop_front() {
            state.busy += 1;
            return Next::Try(Turn { task, attempt: 1, before: self.tasks[task].before.clone() });
        }
        match state.later.iter().map(|later| later.due).min() {
            Some(due) => Next::Wait(due.saturating_duration_since(now)),
            None if state.busy > 0 => Next::Wait(Duration::from_millis(50)),
            None => Next::Done,
        }
    }

    /// The trial with this id needs nothing more.
    pub(super) fn done(&self, id: &str) {
        let mut state = self.lock();
        state.busy -= 1;
        state.left.remove(id);
    }

    /// True while the trial with this id is still to be run, or running, in this program.
    pub(super) fn has_left(&self, id: &str) -> bool {
        self.lock().left.contains(id)
    }

    /// The trial is to be tried again after a wait.
    pub(super) fn retry(&self, turn: Turn, wait: Duration) {
        let mut state = self.lock();
        state.busy -= 1;
        state.later.push(Later { due: now() + wait, turn });
    }

    /// The trial cannot begin yet: another program has it, or it plays a policy that is still to come.
    pub(super) fn held(&self, turn: Turn) {
        self.retry(turn, HELD_FOR);
    }

    fn lock(&self) -> MutexGuard<'_, State<'a>> {
        // No operation above can panic half-way, so that a poisoned queue is still whole.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[expect(clippy::disallowed_methods, reason = "it decides when a trial runs, which reaches no result")]
pub(super) fn now() -> Instant {
    Instant::now()
}
