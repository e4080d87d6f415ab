//! Which trial is next: of those whose sources have ended, the one that begins the longest remaining path of
//! trials that take from each other; then those whose retry is due and those that other programs may have
//! left.

use super::Task;
use crate::{
    pace::{Paces, steps},
    results::TrialEnd,
    world::clock,
};
use std::{
    cmp::Reverse,
    collections::{BTreeSet, HashMap},
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
    /// Tasks that take from a trial, by its id.
    takers: HashMap<&'a str, Vec<usize>>,
    state: Mutex<State<'a>>,
}

struct State<'a> {
    /// Seconds per step of the agents of which a trial has ended, by environment.
    paces: Paces<'a>,
    /// Microseconds of the longest path that begins with a task, the task included.
    paths: Vec<u64>,
    /// Tasks whose sources have ended, longest path first.
    ready: BTreeSet<(Reverse<u64>, usize)>,
    /// How many of a task's sources this program has still to run, or is running.
    awaited: Vec<usize>,
    later: Vec<Later>,
    /// Trials that some slot works on: one of them may come back as a retry, or be what another one waits
    /// for.
    busy: usize,
}

struct Later {
    due: Instant,
    turn: Turn,
}

impl<'a> Queue<'a> {
    /// All tasks; each trial is a task once.
    pub(super) fn new(tasks: &'a [Task<'a>]) -> Self {
        let by_id: HashMap<&str, usize> = tasks
            .iter()
            .enumerate()
            .map(|(index, task)| (task.trial.id.as_str(), index))
            .collect();
        let mut takers: HashMap<&'a str, Vec<usize>> = HashMap::new();
        let mut awaited = vec![0; tasks.len()];
        for (index, task) in tasks.iter().enumerate() {
            for source in task.after.iter().filter_map(|id| by_id.get(id.as_str())) {
                takers
                    .entry(tasks[*source].trial.id.as_str())
                    .or_default()
                    .push(index);
                awaited[index] += 1;
            }
        }
        let mut paces = Paces::default();
        for (task, pace_s) in tasks.iter().filter_map(|task| Some((task, task.pace_s?))) {
            paces.add(&task.trial.cell, task.cost, pace_s * steps(task.cost));
        }
        let paths = longest_paths(tasks, &takers, &paces);
        let ready = (0..tasks.len())
            .filter(|&index| awaited[index] == 0)
            .map(|index| (Reverse(paths[index]), index))
            .collect();
        let state = State {
            paces,
            paths,
            ready,
            awaited,
            later: Vec::new(),
            busy: 0,
        };
        Self {
            tasks,
            takers,
            state: Mutex::new(state),
        }
    }

    /// A trial took this long: once for each agent in an environment, the order of what is left is made anew from it.
    pub(super) fn note_pace(&self, task: usize, wall_s: f64) {
        let Task { trial, cost, .. } = &self.tasks[task];
        let mut state = self.lock();
        if state.paces.of(&trial.cell).is_some() {
            return;
        }
        state.paces.add(&trial.cell, *cost, wall_s);
        state.paths = longest_paths(self.tasks, &self.takers, &state.paces);
        let ready: Vec<usize> = state.ready.iter().map(|(_, task)| *task).collect();
        state.ready = ready
            .into_iter()
            .map(|task| (Reverse(state.paths[task]), task))
            .collect();
    }

    /// The next trial; whoever gets one says [`Queue::done`], [`Queue::retry`] or [`Queue::held`] about it.
    pub(super) fn next(&self) -> Next {
        let mut state = self.lock();
        let now = clock::now();
        if let Some(position) = state.later.iter().position(|later| later.due <= now) {
            let Later { turn, .. } = state.later.swap_remove(position);
            state.busy += 1;
            return Next::Try(turn);
        }
        if let Some((_, task)) = state.ready.pop_first() {
            state.busy += 1;
            return Next::Try(Turn {
                task,
                attempt: 1,
                before: self.tasks[task].before.clone(),
            });
        }
        match state.later.iter().map(|later| later.due).min() {
            Some(due) => Next::Wait(due.saturating_duration_since(now)),
            None if state.busy > 0 => Next::Wait(Duration::from_millis(50)),
            None => Next::Done,
        }
    }

    /// The trial with this id needs nothing more, however it ended: what takes from it is looked at.
    pub(super) fn done(&self, id: &str) {
        let mut state = self.lock();
        state.busy -= 1;
        for &taker in self.takers.get(id).into_iter().flatten() {
            state.awaited[taker] -= 1;
            if state.awaited[taker] == 0 {
                let path = state.paths[taker];
                state.ready.insert((Reverse(path), taker));
            }
        }
    }

    /// The trial is to be tried again after a wait.
    pub(super) fn retry(&self, turn: Turn, wait: Duration) {
        let mut state = self.lock();
        state.busy -= 1;
        state.later.push(Later {
            due: clock::now() + wait,
            turn,
        });
    }

    /// The trial cannot begin yet: another program has it, or has what it takes.
    pub(super) fn held(&self, turn: Turn) {
        self.retry(turn, HELD_FOR);
    }

    fn lock(&self) -> MutexGuard<'_, State<'a>> {
        // No operation above can panic half-way, so that a poisoned queue is still whole.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Microseconds of the longest path that begins with each task. A plan has no circles, so that every path
/// ends. An agent of which nothing is known in an environment counts as in the environment where it is slowest, and
/// one of which nothing is known at all as the slowest known one: they begin early, so that they become known.
fn longest_paths(tasks: &[Task<'_>], takers: &HashMap<&str, Vec<usize>>, paces: &Paces<'_>) -> Vec<u64> {
    let slowest = paces.slowest().unwrap_or_default().max(1e-6);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a duration, saturating"
    )]
    let microseconds = |task: &Task<'_>| {
        let cell = &task.trial.cell;
        let elsewhere = || paces.slowest_of_agent(&cell.agent);
        let pace = paces.of(cell).or_else(elsewhere).unwrap_or(slowest);
        (steps(task.cost) * pace * 1e6).ceil() as u64
    };
    let mut paths: Vec<Option<u64>> = vec![None; tasks.len()];
    let mut open: Vec<usize> = (0..tasks.len()).collect();
    while let Some(&index) = open.last() {
        let below = takers
            .get(tasks[index].trial.id.as_str())
            .map_or(&[][..], Vec::as_slice);
        let unknown: Vec<usize> = below
            .iter()
            .copied()
            .filter(|taker| paths[*taker].is_none())
            .collect();
        if paths[index].is_some() || unknown.is_empty() {
            let longest = below.iter().filter_map(|taker| paths[*taker]).max().unwrap_or(0);
            paths[index].get_or_insert(longest.saturating_add(microseconds(&tasks[index])));
            open.pop();
        } else {
            open.extend(unknown);
        }
    }
    paths.into_iter().map(Option::unwrap_or_default).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        cast::Seating,
        trial::{Part, Trial, TrialCell, TrialKey},
    };

    fn trial(id: &str) -> Trial {
        let part = || Part::new("x", 1, serde_json::Value::Null);
        let (environment, agent, protocol) = (part(), Seating::Agent(part()), part());
        let key = TrialKey {
            environment: environment.into(),
            agent: agent.into(),
            protocol: protocol.into(),
            seed: 0,
            numerics: 1,
            device: "cpu".into(),
        };
        Trial {
            id: id.into(),
            cell: TrialCell::of("e", "a").into(),
            key,
        }
    }

    fn task<'a>(trial: &'a Trial, cost: u64, after: &[&str]) -> Task<'a> {
        let after = after.iter().map(ToString::to_string).collect();
        Task {
            trial,
            cost,
            pace_s: None,
            limits: Default::default(),
            before: None,
            after,
            until: None,
        }
    }

    fn next(queue: &Queue<'_>) -> Option<usize> {
        match queue.next() {
            Next::Try(turn) => Some(turn.task),
            Next::Wait(_) | Next::Done => None,
        }
    }

    #[test]
    fn the_longest_remaining_path_comes_first_and_takers_come_after_their_sources() {
        let trials = ["short", "long", "source", "taker", "last"].map(trial);
        let [short, long, source, taker, last] = &trials;
        let tasks = [
            task(short, 1, &[]),
            task(long, 100, &[]),
            task(source, 2, &["elsewhere"]),
            task(taker, 70, &["source", "short"]),
            task(last, 60, &["taker"]),
        ];
        let queue = Queue::new(&tasks);
        assert_eq!(
            [next(&queue), next(&queue), next(&queue), next(&queue)],
            [Some(2), Some(0), Some(1), None]
        );
        queue.done("source");
        assert!(
            matches!(queue.next(), Next::Wait(_)),
            "what is running may be waited for"
        );
        queue.done("short");
        assert_eq!([next(&queue), next(&queue)], [Some(3), None]);
        queue.done("long");
        queue.done("taker");
        assert_eq!(next(&queue), Some(4));
        queue.done("last");
        assert!(matches!(queue.next(), Next::Done));
    }

    #[test]
    fn a_long_chain_is_measured_without_recursion() {
        let trials: Vec<Trial> = (0..20_000).map(|index| trial(&index.to_string())).collect();
        let after = |index: usize| index.checked_sub(1).map(|before| before.to_string());
        let tasks: Vec<Task<'_>> = trials
            .iter()
            .enumerate()
            .map(|(index, it)| {
                task(
                    it,
                    1,
                    &after(index).iter().map(String::as_str).collect::<Vec<_>>(),
                )
            })
            .collect();
        let queue = Queue::new(&tasks);
        let paths = queue.lock().paths.clone();
        assert_eq!((paths[0], paths[19_999], next(&queue)), (40_000, 2, Some(0)));
    }

    #[test]
    fn what_is_known_of_an_agents_pace_orders_the_rest() {
        let mut trials = ["fast", "slow", "fast again", "slow again"].map(trial);
        trials.iter_mut().for_each(|trial| {
            trial.cell_mut().agent = trial.id.split(' ').next().unwrap_or_default().to_owned();
        });
        let [fast, slow, fast_again, slow_again] = &trials;
        let known = Task {
            pace_s: Some(0.001),
            ..task(fast, 999, &[])
        };
        let tasks = [
            known,
            task(slow, 99, &[]),
            task(fast_again, 499, &[]),
            task(slow_again, 99, &[]),
        ];
        let queue = Queue::new(&tasks);
        // As slow as the slowest known one, 100 steps take less than 500 of the known agent.
        assert_eq!([next(&queue), next(&queue)], [Some(0), Some(2)]);
        let queue = Queue::new(&tasks);
        queue.note_pace(1, 50.0);
        assert_eq!(
            [next(&queue), next(&queue), next(&queue)],
            [Some(1), Some(3), Some(0)]
        );
    }
}
