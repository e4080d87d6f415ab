//! Order of the trials. First come trials whose sources have ended, by the longest remaining path of trials that take
//! from each other. Then come trials whose retry is due and trials that other programs may have left. A trial begins if
//! its machine has enough free cores and cards.

use super::Task;
use crate::{
    pace::{Paces, steps},
    world::clock,
};
use contract::{
    resources::{Capacity, Pool, Share},
    trial_end::TrialEnd,
};
use std::{
    cmp::Reverse,
    collections::{BTreeMap, BTreeSet, HashMap},
    sync::{Condvar, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

/// Time after which a waiting slot looks for a stop request.
const LONGEST_WAIT: Duration = Duration::from_millis(50);

/// Time for which a trial that another program has is left alone.
const HELD_FOR: Duration = Duration::from_millis(300);

/// The next step of a slot.
pub(super) enum NextStep {
    /// Try this trial.
    Try(TrialAttempt),
    /// Ask again: the wait for a trial is over.
    Wait,
    /// Exit: no trial is left.
    Done,
}

/// An attempt at a trial, with its share of a machine.
#[derive(Debug, Clone)]
pub(super) struct TrialAttempt {
    /// Index of the trial in the list of tasks.
    pub(super) task: usize,
    /// Number of the attempt, from 1.
    pub(super) attempt: u32,
    /// Stored end of the trial that does not keep it from running.
    pub(super) before: Option<TrialEnd>,
    /// Share of the machine that the attempt has.
    pub(super) share: Share,
}

/// The remaining trials.
pub(super) struct Queue<'a> {
    tasks: &'a [Task<'a>],
    /// Tasks that take from a trial, by the id of that trial.
    takers: HashMap<&'a str, Vec<usize>>,
    state: Mutex<QueueState<'a>>,
    /// Notified when a slot gives its trial back.
    changed: Condvar,
}

struct QueueState<'a> {
    /// Paces of agents with an ended trial, by environment.
    paces: Paces<'a>,
    /// Length in microseconds of the longest path that begins with a task, the task included.
    paths: Vec<u64>,
    /// Tasks whose sources have ended, longest path first.
    ready: BTreeSet<(Reverse<u64>, usize)>,
    /// Number of a task's sources that this program is running or has yet to run.
    awaited: Vec<usize>,
    later: Vec<Deferral>,
    /// Free cores and cards of each machine.
    pools: Vec<Pool>,
    /// Trials that slots work on, each with its machine and its share. One of them may return as a retry, or be the
    /// source of another.
    busy: BTreeMap<usize, (usize, Share)>,
}

struct Deferral {
    due: Instant,
    turn: TrialAttempt,
}

impl<'a> Queue<'a> {
    /// A queue of all tasks, each trial once, for these machines.
    pub(super) fn new(tasks: &'a [Task<'a>], machines: impl IntoIterator<Item = Capacity>) -> Self {
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
        let state = QueueState {
            paces,
            paths,
            ready,
            awaited,
            later: Vec::new(),
            pools: machines.into_iter().map(Pool::of).collect(),
            busy: BTreeMap::new(),
        };
        Self {
            tasks,
            takers,
            state: Mutex::new(state),
            changed: Condvar::new(),
        }
    }

    /// Records the time of a trial. The first trial of an agent in an environment changes the order of the remaining
    /// ones.
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

    /// The next step of a slot of a machine; the slot reports on its trial by [`Queue::done`],
    /// [`Queue::retry`] or [`Queue::held`]. If no trial is due, it waits until one may be.
    pub(super) fn next(&self, machine: usize) -> NextStep {
        let mut state = self.lock();
        let now = clock::now();
        let due = state.due(self.tasks, machine, now);
        let next = due.or_else(|| state.first_that_fits(self.tasks, machine));
        if let Some(turn) = next {
            state.busy.insert(turn.task, (machine, turn.share.clone()));
            return NextStep::Try(turn);
        }
        let could_fit = |task: usize| state.pools[machine].could_fit(&self.tasks[task].needs);
        let later = state.later.iter().filter(|later| could_fit(later.turn.task));
        let wait = match later.map(|later| later.due).min() {
            Some(due) if due > now => due.saturating_duration_since(now).min(LONGEST_WAIT),
            None if state.busy.is_empty() => return NextStep::Done,
            _ => LONGEST_WAIT,
        };
        clock::wait_for(&self.changed, state, wait);
        NextStep::Wait
    }

    /// Ends a trial that needs no further attempt; trials that take from it may become ready.
    pub(super) fn done(&self, task: usize) {
        let mut state = self.lock();
        state.give_back(self.tasks, task);
        let id = self.tasks[task].trial.id.as_str();
        for &taker in self.takers.get(id).into_iter().flatten() {
            state.awaited[taker] -= 1;
            if state.awaited[taker] == 0 {
                let path = state.paths[taker];
                state.ready.insert((Reverse(path), taker));
            }
        }
        self.changed.notify_all();
    }

    /// Puts a trial back for another attempt after a wait.
    pub(super) fn retry(&self, turn: TrialAttempt, wait: Duration) {
        let mut state = self.lock();
        state.give_back(self.tasks, turn.task);
        state.later.push(Deferral {
            due: clock::now() + wait,
            turn,
        });
        self.changed.notify_all();
    }

    /// Puts back a trial that cannot begin yet, because another program has it or its source.
    pub(super) fn held(&self, turn: TrialAttempt) {
        self.retry(turn, HELD_FOR);
    }

    fn lock(&self) -> MutexGuard<'_, QueueState<'a>> {
        // No operation above can panic half-way, so a poisoned queue is still consistent.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl QueueState<'_> {
    /// A trial whose wait is over, if it fits the machine.
    fn due(&mut self, tasks: &[Task<'_>], machine: usize, now: Instant) -> Option<TrialAttempt> {
        let pool = &mut self.pools[machine];
        let mut due = self
            .later
            .iter()
            .enumerate()
            .filter(|(_, later)| later.due <= now);
        let (place, share) =
            due.find_map(|(place, later)| Some((place, pool.take(&tasks[later.turn.task].needs)?)))?;
        let Deferral { turn, .. } = self.later.swap_remove(place);
        Some(TrialAttempt { share, ..turn })
    }

    /// The first trial in order that fits the free cores and cards. Earlier trials reserve the cores that they wait for
    /// against later ones.
    fn first_that_fits(&mut self, tasks: &[Task<'_>], machine: usize) -> Option<TrialAttempt> {
        let mut free = self.pools[machine].clone();
        let mut fitting = None;
        for &(path, task) in &self.ready {
            let needs = &tasks[task].needs;
            if free.is_full() {
                return None;
            }
            if free.take(needs).is_some() {
                fitting = Some((path, task));
                break;
            }
            if free.could_fit(needs) {
                free.reserve(needs);
            }
        }
        let (path, task) = fitting?;
        let share = self.pools[machine].take(&tasks[task].needs)?;
        self.ready.remove(&(path, task));
        Some(TrialAttempt {
            task,
            attempt: 1,
            before: tasks[task].before.clone(),
            share,
        })
    }

    /// Frees the share of a trial that no slot works on any more.
    fn give_back(&mut self, tasks: &[Task<'_>], task: usize) {
        if let Some((machine, share)) = self.busy.remove(&task) {
            self.pools[machine].give_back(&tasks[task].needs, &share);
        }
    }
}

/// Length in microseconds of the longest path that begins with each task. A plan has no cycles, so every path ends. An
/// agent without a known pace in an environment counts with its slowest known environment, and an agent without any
/// known pace counts with the slowest known one: such agents begin early, so that their paces become known.
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
pub(super) mod tests {
    use super::*;
    use contract::{
        cast::Actors,
        part::Part,
        resources::Needs,
        trial::{Trial, TrialCell, TrialKey},
    };

    pub(in crate::scheduler) fn trial(id: &str) -> Trial {
        let part = || Part::new("x", 1, serde_json::Value::Null);
        let (environment, agent, protocol) = (part(), Actors::Agent(part()), part());
        let key = TrialKey {
            environment: environment.into(),
            agent: agent.into(),
            protocol: protocol.into(),
            seed: 0,
            numerics: 1,
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
            needs: Needs::default(),
        }
    }

    /// A machine with this number of cores.
    fn machine(cores: usize) -> [Capacity; 1] {
        let gpus = Vec::new();
        [Capacity { cores, gpus }]
    }

    fn next(queue: &Queue<'_>) -> Option<usize> {
        match queue.next(0) {
            NextStep::Try(turn) => Some(turn.task),
            NextStep::Wait | NextStep::Done => None,
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
        let queue = Queue::new(&tasks, machine(8));
        assert_eq!(
            [next(&queue), next(&queue), next(&queue), next(&queue)],
            [Some(2), Some(0), Some(1), None]
        );
        queue.done(2);
        assert!(
            matches!(queue.next(0), NextStep::Wait),
            "what is running may be waited for"
        );
        queue.done(0);
        assert_eq!([next(&queue), next(&queue)], [Some(3), None]);
        queue.done(1);
        queue.done(3);
        assert_eq!(next(&queue), Some(4));
        queue.done(4);
        assert!(matches!(queue.next(0), NextStep::Done));
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
        let queue = Queue::new(&tasks, machine(8));
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
        let queue = Queue::new(&tasks, machine(8));
        // At the pace of the slowest known agent, 100 steps take less than 500 of the known one.
        assert_eq!([next(&queue), next(&queue)], [Some(0), Some(2)]);
        let queue = Queue::new(&tasks, machine(8));
        queue.note_pace(1, 50.0);
        assert_eq!(
            [next(&queue), next(&queue), next(&queue)],
            [Some(1), Some(3), Some(0)]
        );
    }

    fn needing(trial: &Trial, cost: u64, cores: u32, gpus: impl Into<Option<f64>>) -> Task<'_> {
        let gpus = gpus.into();
        Task {
            needs: Needs { cores, gpus },
            ..task(trial, cost, &[])
        }
    }

    #[test]
    fn a_wide_trial_is_not_passed_by_narrow_ones_for_ever() {
        let trials = ["wide", "one", "two", "three"].map(trial);
        let [wide, one, two, three] = &trials;
        let tasks = [
            needing(wide, 50, 2, None),
            needing(one, 100, 1, None),
            needing(two, 40, 1, None),
            needing(three, 30, 1, None),
        ];
        let queue = Queue::new(&tasks, machine(2));
        assert_eq!(
            [next(&queue), next(&queue)],
            [Some(1), None],
            "a core is kept for the wide one"
        );
        queue.done(1);
        assert_eq!([next(&queue), next(&queue)], [Some(0), None]);
        queue.done(0);
        assert_eq!([next(&queue), next(&queue)], [Some(2), Some(3)]);
    }

    #[test]
    fn cores_that_no_card_is_left_for_work_meanwhile() {
        let trials = ["card", "another", "core"].map(trial);
        let [card, another, core] = &trials;
        let tasks = [
            needing(card, 100, 1, 1.0),
            needing(another, 90, 1, 0.5),
            needing(core, 10, 1, None),
        ];
        let gpus = vec!["7".to_owned()];
        let queue = Queue::new(&tasks, [Capacity { cores: 2, gpus }]);
        let NextStep::Try(turn) = queue.next(0) else {
            panic!()
        };
        assert_eq!(turn.share.gpus, Some(vec!["7".into()]));
        assert_eq!([next(&queue), next(&queue)], [Some(2), None]);
        queue.retry(turn, Duration::from_secs(100));
        assert_eq!(next(&queue), Some(1), "a trial that waits holds no card");
    }

    #[test]
    fn each_machine_takes_what_fits_it_and_leaves_when_nothing_will() {
        let trials = ["wide", "narrow"].map(trial);
        let tasks = [needing(&trials[0], 100, 4, None), needing(&trials[1], 1, 1, None)];
        let gpus = Vec::new;
        let machines = [1, 4].map(|cores| Capacity { cores, gpus: gpus() });
        let queue = Queue::new(&tasks, machines);
        assert_eq!(next(&queue), Some(1));
        assert!(
            matches!(queue.next(0), NextStep::Wait),
            "what runs may be tried again"
        );
        queue.done(1);
        assert!(matches!(queue.next(0), NextStep::Done));
        assert!(matches!(
            queue.next(1),
            NextStep::Try(TrialAttempt { task: 0, .. })
        ));
    }
}
