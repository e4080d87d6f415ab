//! Reads the data of a view. Ended trials are read once; of running ones, only logs that grew.

use super::{Curves, Left, Panel, RunningView, SeedLine, StudyView, View, metrics};
use contract::{
    Error, Phase,
    recorder::Row,
    trial::{Purpose, Trial},
    trial_end::{EndState, TrialEnd, is_missing},
    trial_result::TrialResult,
};
use execution::{
    pace::{Paces, steps},
    store::{Owner, Store, TrialValues, metric_log},
    world::fs,
};
use rayon::prelude::*;
use std::{
    collections::{BTreeMap, BTreeSet},
    path::PathBuf,
    sync::Arc,
};

/// A study to be watched.
#[derive(Debug, Clone)]
pub struct Watched<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its trials.
    pub trials: &'a [Arc<Trial>],
    /// Steps of each trial.
    pub costs: &'a [u64],
}

/// Reads a store repeatedly.
#[derive(Debug)]
pub struct Watcher {
    store: Store,
    /// Number of worker processes for an estimate while nothing runs.
    workers: usize,
    /// Metrics that are shown first.
    preferred: Vec<String>,
    /// Metrics for which lower values are better.
    less_is_better: BTreeSet<String>,
    /// Curves of trials that ended, by id.
    ended: BTreeMap<String, Arc<Curves>>,
    /// Logs of trials that run, by id.
    logs: BTreeMap<String, Log>,
}

/// A log as of its last reading.
#[derive(Debug, Clone, Default)]
struct Log {
    bytes: u64,
    curves: Arc<Curves>,
    step: u64,
    damaged: bool,
}

/// A trial of a study with its current state.
struct Seen<'a> {
    trial: &'a Trial,
    cost: u64,
    end: Option<TrialEnd>,
    owner: Option<Owner>,
    log: Log,
    curves: Arc<Curves>,
}

impl Watcher {
    /// A watcher of a store, which may not exist yet.
    #[must_use]
    pub fn new(
        store: Store,
        workers: usize,
        preferred: Vec<String>,
        less_is_better: BTreeSet<String>,
    ) -> Self {
        Self {
            store,
            workers: workers.max(1),
            preferred,
            less_is_better,
            ended: BTreeMap::new(),
            logs: BTreeMap::new(),
        }
    }

    /// The progress at this moment; `at` is the displayed time.
    pub fn look(&mut self, studies: &[Watched<'_>], at: String) -> View {
        let somebody = !self.store.owners().is_empty();
        let studies: Vec<StudyView> = studies.iter().map(|study| self.study(study, somebody)).collect();
        let metrics = metrics(&self.preferred, studies.iter().flat_map(|study| &study.panels));
        View {
            at,
            studies,
            metrics,
            less_is_better: self.less_is_better.clone(),
        }
    }

    fn study(&mut self, study: &Watched<'_>, somebody: bool) -> StudyView {
        let mut notes = Vec::new();
        let TrialValues { all, unreadable } = self.store.outcomes(study.trials);
        notes.extend(
            unreadable
                .iter()
                .map(|(_, error)| format!("{error}; the trial counts as missing")),
        );
        self.read_ended(study.trials, &all, &mut notes);
        let trials = study.trials.iter().zip(study.costs).zip(all);
        let mut seen = Vec::with_capacity(study.trials.len());
        for ((trial, cost), end) in trials {
            let end = end.filter(|end| !is_missing(Some(end)));
            seen.push(self.trial(trial, *cost, end, somebody, &mut notes));
        }
        let running: Vec<&Seen<'_>> = seen.iter().filter(|it| it.owner.is_some()).collect();
        StudyView {
            name: study.name.into(),
            trials: seen.len(),
            ended: ended(&seen),
            missing: seen
                .iter()
                .filter(|it| it.end.is_none() && it.owner.is_none())
                .count(),
            left: left(
                &seen,
                if running.is_empty() {
                    self.workers
                } else {
                    running.len()
                },
            ),
            running: running.into_iter().map(Seen::running).collect(),
            panels: panels(&seen),
            notes,
        }
    }

    fn trial<'a>(
        &mut self,
        trial: &'a Arc<Trial>,
        cost: u64,
        end: Option<TrialEnd>,
        somebody: bool,
        notes: &mut Vec<String>,
    ) -> Seen<'a> {
        let mut seen = Seen {
            trial,
            cost,
            end,
            owner: None,
            log: Log::default(),
            curves: Arc::default(),
        };
        if seen.end.as_ref().is_some_and(|end| end.state == EndState::Ok) {
            self.logs.remove(&trial.id);
            seen.curves = self.ended.get(&trial.id).cloned().unwrap_or_default();
        } else if seen.end.is_none() {
            self.ended.remove(&trial.id);
            seen.owner = somebody.then(|| self.store.running(&trial.id)).flatten();
            seen.log = self.logged(&trial.id);
            seen.curves = std::mem::take(&mut seen.log.curves);
            if seen.log.damaged {
                notes.push(format!(
                    "the log of {} is damaged; what stands before is shown",
                    trial.title()
                ));
            }
        }
        seen
    }

    /// Reads the curves of trials that ended `ok`, each once, on all cores.
    fn read_ended(&mut self, trials: &[Arc<Trial>], ends: &[Option<TrialEnd>], notes: &mut Vec<String>) {
        let is_new = |(trial, end): &(&Arc<Trial>, &Option<TrialEnd>)| {
            end.as_ref().is_some_and(|end| end.state == EndState::Ok) && !self.ended.contains_key(&trial.id)
        };
        let new: Vec<&Arc<Trial>> = trials
            .iter()
            .zip(ends)
            .filter(is_new)
            .map(|(trial, _)| trial)
            .collect();
        let read = |trial: &&Arc<Trial>| {
            let TrialResult { names, rows, .. } = self.store.load(trial)?;
            Ok(Arc::new(curves(&names, &rows)))
        };
        let found: Vec<Result<Arc<Curves>, Error>> = new.par_iter().map(read).collect();
        for (trial, found) in new.into_iter().zip(found) {
            match found {
                Ok(curves) => drop(self.ended.insert(trial.id.clone(), curves)),
                Err(error) => notes.push(error.to_string()),
            }
        }
    }

    /// Content of a trial's log; empty if there is none.
    fn logged(&mut self, id: &str) -> Log {
        let path = self.log_path(id);
        let Ok(bytes) = fs::metadata(&path).map(|found| found.len()) else {
            self.logs.remove(id);
            return Log::default();
        };
        if let Some(log) = self.logs.get(id).filter(|log| log.bytes == bytes) {
            return log.clone();
        }
        let Ok(found) = metric_log::read(&path) else {
            return Log::default();
        };
        let log = Log {
            bytes,
            step: found.table.rows.iter().map(|row| row.step).max().unwrap_or(0),
            curves: Arc::new(curves(&found.table.names, &found.table.rows)),
            damaged: matches!(found.end, metric_log::LogEnd::Damaged { .. }),
        };
        self.logs.insert(id.to_owned(), log.clone());
        log
    }

    fn log_path(&self, id: &str) -> PathBuf {
        self.store.folder(id).join("running").join("metrics.log")
    }
}

/// The mean over episodes and seats of every metric at every measurement. For a trial that was measured only at its
/// end, that is the one point.
fn curves(names: &[String], rows: &[Row]) -> Curves {
    let of_phase = |phase: Phase| {
        let mut sums: BTreeMap<u16, BTreeMap<u64, (f64, u32)>> = BTreeMap::new();
        for row in rows.iter().filter(|row| row.phase == phase) {
            let sum = sums.entry(row.metric).or_default().entry(row.step).or_default();
            *sum = (sum.0 + row.value, sum.1 + 1);
        }
        let mean = |(step, (sum, count)): (u64, (f64, u32))| (step, sum / f64::from(count));
        let named = |(metric, points): (u16, BTreeMap<u64, (f64, u32)>)| {
            let name = names.get(usize::from(metric))?;
            Some((name.clone(), points.into_iter().map(mean).collect()))
        };
        sums.into_iter().filter_map(named).collect::<Curves>()
    };
    let while_learning = of_phase(Phase::Evaluate);
    if while_learning.is_empty() {
        of_phase(Phase::Final)
    } else {
        while_learning
    }
}

fn ended(seen: &[Seen<'_>]) -> BTreeMap<EndState, usize> {
    let mut counts = BTreeMap::new();
    for state in seen.iter().filter_map(|it| Some(it.end.as_ref()?.state)) {
        *counts.entry(state).or_default() += 1;
    }
    counts
}

/// The remaining time: the remaining steps, at the pace of the agent's stored trials in the environment.
fn left(seen: &[Seen<'_>], workers: usize) -> Left {
    let paces = Paces::of_ended(seen.iter().map(|it| (&*it.trial.cell, it.cost, it.end.as_ref())));
    let (mut wall_s, mut known, mut unknown) = (0.0, false, 0);
    for it in seen.iter().filter(|it| it.end.is_none()) {
        match paces.of(&it.trial.cell) {
            Some(pace) => {
                known = true;
                wall_s += pace * steps(it.cost.saturating_sub(it.log.step));
            }
            None => unknown += 1,
        }
    }
    let workers = u32::try_from(workers.max(1)).unwrap_or(u32::MAX);
    Left {
        wall_s: known.then(|| wall_s / f64::from(workers)),
        unknown,
    }
}

/// A panel for each environment, and for each search in it, in the order of the plan.
fn panels(seen: &[Seen<'_>]) -> Vec<Panel> {
    let mut panels: Vec<Panel> = Vec::new();
    for it in seen {
        let (environment, agent) = (&it.trial.cell.environment, agent(it.trial));
        let search = match &it.trial.cell.purpose {
            Purpose::Tried(search) => Some(search),
            _ => None,
        };
        let is_of = |panel: &Panel| panel.environment == *environment && panel.search.as_ref() == search;
        let place = panels.iter().position(is_of);
        let place = place.unwrap_or_else(|| {
            panels.push(Panel {
                environment: environment.clone(),
                search: search.cloned(),
                ..Panel::default()
            });
            panels.len() - 1
        });
        let panel = &mut panels[place];
        let known = panel.agents.iter().position(|name| *name == agent);
        let agent = known.unwrap_or_else(|| {
            panel.agents.push(agent);
            panel.agents.len() - 1
        });
        if !it.curves.is_empty() {
            panel.lines.push(SeedLine {
                agent,
                seed: it.trial.key.seed,
                open: it.end.is_none(),
                curves: it.curves.clone(),
            });
        }
    }
    panels
}

/// The agent with its setting, if it has one.
fn agent(trial: &Trial) -> String {
    if trial.cell.point.is_empty() {
        trial.cell.agent.clone()
    } else {
        format!("{} {}", trial.cell.agent, trial.cell.point)
    }
}

/// A metric with the last of its values.
fn last((metric, points): (&String, &Vec<(u64, f64)>)) -> Option<(String, f64)> {
    points.last().map(|(_, value)| (metric.clone(), *value))
}

impl Seen<'_> {
    fn running(&self) -> RunningView {
        let by = self.owner.as_ref().map_or_else(String::new, |owner| {
            let job = owner.slurm_job.iter().map(|job| format!(", Slurm job {job}"));
            format!(
                "process {} on {}{}",
                owner.pid,
                owner.host,
                job.collect::<String>()
            )
        });
        RunningView {
            title: self.trial.title(),
            environment: self.trial.cell.environment.clone(),
            agent: agent(self.trial),
            seed: self.trial.key.seed,
            values: self.curves.iter().filter_map(last).collect(),
            step: self.log.step,
            steps: self.cost,
            by,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::Recorder;
    use testing::synthetic::trial as made;

    fn recorded(values: &[(u64, f64)]) -> Recorder {
        let mut record = Recorder::default();
        for (step, value) in values {
            record.add(Phase::Evaluate, *step, 0, 0, "return", *value);
            record.add(Phase::Evaluate, *step, 1, 0, "return", value + 2.0);
        }
        record
    }

    fn trials() -> Vec<Arc<Trial>> {
        let made = (0..3).map(|seed| made("cells", "dsac", "", seed, &Vec::new()).trial);
        let with_id = |trial: Arc<Trial>| {
            let id = trial.key.id();
            Arc::new(Trial {
                id,
                ..Trial::clone(&trial)
            })
        };
        made.map(with_id).collect()
    }

    fn log_of(store: &Store, trial: &Trial) -> PathBuf {
        let folder = store.folder(&trial.id).join("running");
        fs::create_dir_all(&folder).unwrap();
        folder.join("metrics.log")
    }

    /// Every file below a folder with its bytes.
    fn bytes(folder: &std::path::Path) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut found = BTreeMap::new();
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                found.extend(bytes(&path));
            } else {
                found.insert(path.clone(), fs::read(&path).unwrap());
            }
        }
        found
    }

    #[test]
    fn what_ended_and_what_is_logged_is_seen_and_nothing_is_written() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::at(dir.path());
        let (trials, costs) = (trials(), [400, 400, 400]);
        store
            .finish(&trials[0], &recorded(&[(0, 1.0), (400, 3.0)]), 8.02)
            .unwrap();
        let path = log_of(&store, &trials[1]);
        let mut log = metric_log::MetricLog::create(&path, &trials[1].id).unwrap();
        log.append(&recorded(&[(0, 1.0), (200, 2.0)])).unwrap();
        let before = bytes(dir.path());
        let mut watcher = Watcher::new(store.clone(), 2, vec!["return".into()], BTreeSet::new());
        let watched = Watched {
            name: "small",
            trials: &trials,
            costs: &costs,
        };
        let study = |watcher: &mut Watcher| {
            watcher
                .look(std::slice::from_ref(&watched), String::new())
                .studies
                .remove(0)
        };
        let seen = study(&mut watcher);
        assert_eq!(
            (seen.ended.get(&EndState::Ok), seen.missing, seen.trials),
            (Some(&1), 2, 3)
        );
        // 0.02 s a step: 201 and 401 steps on two workers.
        assert!(
            (seen.left.wall_s.unwrap() - 0.01 * 602.0).abs() < 1e-9,
            "{:?}",
            seen.left
        );
        let lines = &seen.panels[0].lines;
        assert_eq!(lines.len(), 2);
        assert_eq!(lines[1].curves["return"], [(0, 2.0), (200, 3.0)]);
        assert!(lines[1].open && !lines[0].open);
        // Appended lines are read, but earlier ones are not read again.
        drop(log);
        fs::remove_file(&path).unwrap();
        let mut log = metric_log::MetricLog::create(&path, &trials[1].id).unwrap();
        log.append(&recorded(&[(0, 1.0), (200, 2.0), (300, 4.0)]))
            .unwrap();
        assert_eq!(study(&mut watcher).panels[0].lines[1].curves["return"].len(), 3);
        fs::remove_file(&path).unwrap();
        assert_eq!(study(&mut watcher).panels[0].lines.len(), 1);
        let mut log = metric_log::MetricLog::create(&path, &trials[1].id).unwrap();
        log.append(&recorded(&[(0, 1.0), (200, 2.0)])).unwrap();
        study(&mut watcher);
        assert_eq!(bytes(dir.path()), before);
    }

    #[test]
    fn damage_is_said_and_what_vanishes_is_missing() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::at(dir.path());
        let (trials, costs) = (trials(), [400, 400, 400]);
        let watched = Watched {
            name: "small",
            trials: &trials,
            costs: &costs,
        };
        let mut watcher = Watcher::new(store.clone(), 2, Vec::new(), BTreeSet::new());
        let mut study = || {
            watcher
                .look(std::slice::from_ref(&watched), String::new())
                .studies
                .remove(0)
        };
        let nothing = study();
        assert_eq!(
            (nothing.missing, nothing.left.unknown, nothing.left.wall_s),
            (3, 3, None)
        );
        let path = log_of(&store, &trials[1]);
        let mut log = metric_log::MetricLog::create(&path, &trials[1].id).unwrap();
        for until in 1..4 {
            let points: Vec<(u64, f64)> = (0..until).map(|k| (k, 1.0)).collect();
            log.append(&recorded(&points)).unwrap();
        }
        let mut damaged = fs::read(&path).unwrap();
        let middle = damaged.len() / 2;
        damaged[middle] ^= 1;
        fs::write(&path, damaged).unwrap();
        let seen = study();
        assert!(seen.notes[0].contains("seed 1 is damaged"), "{:?}", seen.notes);
        store.finish(&trials[0], &recorded(&[(0, 1.0)]), 1.0).unwrap();
        assert_eq!(study().missing, 2);
        fs::write(store.folder(&trials[0].id).join("trial.json"), "{").unwrap();
        let seen = study();
        assert!(seen.missing == 3 && seen.notes.iter().any(|note| note.contains("counts as missing")));
        fs::remove_dir_all(dir.path().join("trials")).unwrap();
        let seen = study();
        assert_eq!(
            (seen.missing, seen.notes.len(), seen.panels[0].lines.len()),
            (3, 0, 0)
        );
    }

    #[test]
    fn what_is_measured_at_the_end_alone_is_one_point() {
        let mut record = Recorder::default();
        record.add(Phase::Train, 5, 0, 0, "loss", 1.0);
        record.add(Phase::Final, 8, 0, 0, "return", 3.0);
        let found = curves(record.names(), record.rows());
        assert_eq!(found, [("return".to_owned(), vec![(8, 3.0)])].into());
    }
}
