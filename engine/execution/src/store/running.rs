//! Files of a running trial, from which it continues after its process is gone.
//!
//! ```text
//! <trial's folder>/running/metrics.log      every row so far
//!                          checkpoint-<n>/  state.json, agent/, manifest.json
//!                          output.gz        output of the trial
//!                          work/            working folder of an agent that trains itself
//! ```
//!
//! A checkpoint is written into a folder of another name, flushed to the disk and renamed; older ones are then removed.
//! An incomplete checkpoint, or one whose rows are not in the log, is skipped: the trial continues from an older one or
//! starts again, and ends with the same numbers either way.
//!
//! No file here is acknowledged; the measurements at a pause are stored separately, see [`Partial`](super::Partial).

use super::{
    OUTPUT, absent_is_fine, boundary,
    inside::is_file,
    metric_log::{self, LogEnd, LogPosition, MetricLog},
    names,
    partial::{first_rows, rows_until},
    remove,
    sealed_folder::{flush, flush_way_to, is_whole, seal},
    write_durably,
};
use crate::world::{clock, fs};
use contract::{
    Agent, Error, Keeper, Phase, Recorder, digest::of_bytes as hash, metrics_file::MetricsTable,
    own_training::TrainingAllocation, recorder::Running, resources::Share,
};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::{
    collections::BTreeSet,
    io,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

/// Time for which rows wait before they are logged, so that a short trial writes no log.
const NOTE_EVERY: Duration = Duration::from_secs(1);
/// Least interval between two saves, as a multiple of the duration of the last one.
const WORK_PER_SAVE: u32 = 20;
const PREFIX: &str = "checkpoint-";
/// Working folder of an agent that trains itself.
const WORK: &str = "work";

/// Keeps a running trial in its folder of the store. Only one process may run a trial at a time.
#[derive(Debug)]
pub struct RunningTrial {
    folder: PathBuf,
    trial: String,
    every: Duration,
    stop: Arc<AtomicBool>,
    /// The step at which the trial pauses after the measurement there.
    until: Option<u64>,
    /// Allowed silence of an agent that trains itself.
    patience: Option<Duration>,
    /// Share of the machine that such an agent has.
    share: Share,
    /// Record up to the pause, once the trial has reached it.
    paused: Option<Recorder>,
    /// Number of rows that were all finite when they were checked, or saved by an earlier process.
    looked_at: usize,
    /// Record of these rows, once the trial has ended with an error.
    failed: Recorder,
    log: Option<MetricLog>,
    begun: Instant,
    /// Seconds that earlier processes spent up to the checkpoint from which the trial continues.
    earlier_s: f64,
    noted: Instant,
    saved: Instant,
    cost: Duration,
    /// Number of the checkpoint that was loaded last.
    taken_up: Option<u64>,
    refused: BTreeSet<u64>,
}

/// Content of `state.json`.
#[derive(Debug, Serialize, Deserialize)]
struct TrialCheckpoint {
    protocol: Value,
    running: Running,
    log: LogPosition,
    /// Seconds that were spent on the trial so far; 0 in checkpoints of programs that did not record them.
    #[serde(default)]
    wall_s: f64,
}

impl RunningTrial {
    /// The keeper of the trial `trial` whose folder in the store is `folder`. It saves after `every` (each time if that
    /// is zero) and when `stop` is set. No folder is created before the first save.
    #[must_use]
    pub fn open(folder: &Path, trial: &str, every: Duration, stop: Arc<AtomicBool>) -> Self {
        Self {
            folder: running(folder),
            trial: trial.into(),
            every,
            stop,
            until: None,
            patience: None,
            share: Share::default(),
            paused: None,
            looked_at: 0,
            failed: Recorder::default(),
            log: None,
            begun: clock::now(),
            earlier_s: 0.0,
            noted: clock::now(),
            saved: clock::now(),
            cost: Duration::ZERO,
            taken_up: None,
            refused: BTreeSet::new(),
        }
    }

    /// The same keeper, for a trial that pauses at a step after the measurement there.
    #[must_use]
    pub fn until(mut self, step: Option<u64>) -> Self {
        self.until = step;
        self
    }

    /// The same keeper, for a trial that ends after this time without output of its training.
    #[must_use]
    pub fn patient(mut self, patience: Option<Duration>) -> Self {
        self.patience = patience;
        self
    }

    /// The same keeper, for a trial with a share of the machine other than one core.
    #[must_use]
    pub fn sharing(mut self, share: Share) -> Self {
        self.share = share;
        self
    }

    /// Record of the trial up to its pause; `None` if it has not reached it.
    #[must_use]
    pub fn at_pause(&self) -> Option<&Recorder> {
        self.paused.as_ref()
    }

    /// Finite record of a trial that ended with an error.
    #[must_use]
    pub fn before_error(&self) -> &Recorder {
        &self.failed
    }

    /// Wall-clock seconds that were spent on the trial's present rows, in this process and in those from which it
    /// continues.
    #[must_use]
    pub fn wall_s(&self) -> f64 {
        self.earlier_s + clock::since(self.begun).as_secs_f64()
    }

    /// Removes the files that are kept for an ended trial; there may be none.
    ///
    /// # Errors
    /// [`Error::File`] if a file cannot be removed.
    pub fn discard(folder: &Path) -> Result<(), Error> {
        let running = running(folder);
        absent_is_fine(fs::remove_dir_all(&running)).map_err(Error::file("remove", &running))
    }

    /// Numbers of the existing checkpoints, complete or not, in order.
    fn numbers(&self) -> Result<BTreeSet<u64>, Error> {
        let names = names(&self.folder)?;
        Ok(names
            .iter()
            .filter_map(|name| name.strip_prefix(PREFIX)?.parse().ok())
            .collect())
    }

    fn checkpoint(&self, number: u64) -> PathBuf {
        self.folder.join(format!("{PREFIX}{number}"))
    }

    /// State, log and rows of a checkpoint; `None` if it is incomplete.
    fn read(&self, number: u64) -> Result<Option<(TrialCheckpoint, MetricLog, MetricsTable)>, Error> {
        let folder = self.checkpoint(number);
        if !is_whole(&folder, &self.trial) {
            return Ok(None);
        }
        let state = fs::read(folder.join("state.json"))
            .ok()
            .and_then(|text| serde_json::from_slice::<TrialCheckpoint>(&text).ok());
        let Some(state) = state else { return Ok(None) };
        let resumed = MetricLog::resume(&self.log_path(), &self.trial, &state.log)?;
        Ok(resumed.map(|(log, table)| (state, log, table)))
    }

    fn write(&self, number: u64, state: &TrialCheckpoint, agent: &dyn Agent) -> Result<(), Error> {
        boundary::pass("before a checkpoint", &self.checkpoint(number));
        let unfinished = self.unfinished(number)?;
        let agent_folder = unfinished.join("agent");
        fs::create_dir(&agent_folder).map_err(Error::file("create", &agent_folder))?;
        agent.save(&agent_folder)?;
        let path = unfinished.join("state.json");
        let text = serde_json::to_vec(state)
            .map_err(io::Error::from)
            .map_err(Error::file("write", &path))?;
        fs::write(&path, text).map_err(Error::file("write", &path))?;
        boundary::pass("before a checkpoint is sealed", &self.checkpoint(number));
        seal(&unfinished, &self.trial)?;
        let finished = self.checkpoint(number);
        fs::rename(&unfinished, &finished).map_err(Error::file("rename to", &finished))?;
        boundary::pass("after a checkpoint is renamed", &finished);
        flush(&self.folder).map_err(Error::file("flush", &self.folder))
    }

    /// A new folder under a name that no other process uses, since files of two processes must never mix.
    fn unfinished(&self, number: u64) -> Result<PathBuf, Error> {
        let mut attempt = 0;
        loop {
            let folder = self.folder.join(format!(".{PREFIX}{number}.{attempt}"));
            match fs::create_dir(&folder) {
                Err(source) if source.kind() == io::ErrorKind::AlreadyExists => attempt += 1,
                outcome => {
                    return outcome
                        .map(|()| folder.clone())
                        .map_err(Error::file("create", &folder));
                }
            }
        }
    }

    /// Removes older checkpoints, and unfinished ones of processes that are gone.
    fn remove_all_but(&self, number: u64) -> Result<(), Error> {
        let kept = format!("{PREFIX}{number}");
        for name in names(&self.folder)? {
            if name.trim_start_matches('.').starts_with(PREFIX) && name != kept {
                let old = self.folder.join(name);
                absent_is_fine(fs::remove_dir_all(&old)).map_err(Error::file("remove", &old))?;
            }
        }
        Ok(())
    }

    fn log(&mut self) -> Result<&mut MetricLog, Error> {
        let path = self.log_path();
        let log = match self.log.take() {
            Some(log) => log,
            None => {
                fs::create_dir_all(&self.folder).map_err(Error::file("create", &self.folder))?;
                MetricLog::create(&path, &self.trial)?
            }
        };
        Ok(self.log.insert(log))
    }

    fn log_path(&self) -> PathBuf {
        self.folder.join("metrics.log")
    }
}

impl Keeper for RunningTrial {
    fn due(&mut self) -> bool {
        self.stopping()
            || self.every.is_zero()
            || clock::since(self.saved) >= self.every.max(self.cost * WORK_PER_SAVE)
    }

    fn stopping(&self) -> bool {
        self.paused.is_some() || self.stop.load(Ordering::Relaxed)
    }

    fn look(&mut self, record: &Recorder) {
        self.looked_at = record.rows().len();
        let Some(until) = self.until.filter(|_| self.paused.is_none()) else {
            return;
        };
        let mut rows = record.rows().iter().rev();
        let last = rows.find(|row| row.phase == Phase::Evaluate);
        if last.is_some_and(|row| row.step >= until) {
            self.paused = Some(first_rows(record, rows_until(record, until)));
        }
    }

    fn fails(&mut self, record: &Recorder) {
        self.failed = first_rows(record, self.looked_at);
    }

    fn save(&mut self, state: Value, agent: &dyn Agent, record: &mut Recorder) -> Result<(), Error> {
        let started = clock::now();
        let log = self.log()?;
        log.append(record)?;
        boundary::pass("after rows are appended", &self.log_path());
        self.log()?.flush()?;
        let log = self.log()?;
        let (running, log) = (record.running().clone(), log.position());
        let state = TrialCheckpoint {
            protocol: state,
            running,
            log,
            wall_s: self.wall_s(),
        };
        let number = self.numbers()?.last().map_or(1, |last| last + 1);
        if number == 1 {
            flush_with_way(&self.folder)?;
        }
        self.write(number, &state, agent)?;
        self.remove_all_but(number)?;
        self.saved = clock::now();
        (self.noted, self.cost) = (self.saved, self.saved - started);
        Ok(())
    }

    fn load(&mut self, agent: &mut dyn Agent, record: &mut Recorder) -> Result<Option<Value>, Error> {
        (self.log, self.taken_up, self.earlier_s, self.looked_at) = (None, None, 0.0, 0);
        for number in self
            .numbers()?
            .into_iter()
            .rev()
            .filter(|number| !self.refused.contains(number))
        {
            let Some((state, log, table)) = self.read(number)? else {
                continue;
            };
            (self.log, self.taken_up, self.earlier_s) = (Some(log), Some(number), state.wall_s);
            let misfit = |source: Error| Error::Checkpoint {
                what: "the agent",
                problem: source.to_string(),
            };
            agent
                .load(&self.checkpoint(number).join("agent"))
                .map_err(misfit)?;
            self.looked_at = table.rows.len();
            *record = Recorder::resumed(table.names, table.rows, state.running);
            return Ok(Some(state.protocol));
        }
        Ok(None)
    }

    fn note(&mut self, record: &Recorder) -> Result<(), Error> {
        let written = self.log.as_ref().map_or(0, MetricLog::rows);
        if record.rows().len() > written && clock::since(self.noted) >= NOTE_EVERY {
            self.log()?.append(record)?;
            self.noted = clock::now();
        }
        Ok(())
    }

    fn place(&mut self) -> Result<Option<TrainingAllocation>, Error> {
        let work = self.folder.join(WORK);
        fs::create_dir_all(&work).map_err(Error::file("create", &work))?;
        let folder = fs::canonicalize(&work).map_err(Error::file("find", &work))?;
        Ok(Some(TrainingAllocation {
            folder,
            until: self.until,
            patience: self.patience,
            share: self.share.clone(),
        }))
    }

    fn patience(&self) -> Option<Duration> {
        self.patience
    }

    fn keep_output(&mut self, said: &[u8]) -> Result<(), Error> {
        use std::io::Write as _;
        let path = self.folder.join(OUTPUT);
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        let packed = packed.write_all(said).and_then(|()| packed.finish());
        fs::create_dir_all(&self.folder).map_err(Error::file("create", &self.folder))?;
        packed
            .and_then(|packed| fs::write(&path, packed))
            .map_err(Error::file("write", &path))
    }

    fn begin_anew(&mut self) {
        (self.log, self.looked_at) = (None, 0);
    }

    fn refuse(&mut self) -> bool {
        self.taken_up
            .take()
            .is_some_and(|number| self.refused.insert(number))
    }
}

/// Folder in which an agent of a trial trains itself.
pub(crate) fn work(folder: &Path) -> PathBuf {
    running(folder).join(WORK)
}

/// Whether an agent that trains itself works, or worked, in a trial whose files have not been removed yet.
pub(super) fn has_work(folder: &Path) -> bool {
    fs::is_folder(&work(folder))
}

/// Moves the last output of a trial into its folder, to be acknowledged with the trial's end; returns its hash, if
/// output is kept.
pub(super) fn settle_output(folder: &Path) -> Result<Option<String>, Error> {
    let (from, to) = (running(folder).join(OUTPUT), folder.join(OUTPUT));
    match fs::read(&from) {
        Ok(bytes) => write_durably(&to, &bytes).map(|()| Some(hash(&bytes))),
        Err(source) if source.kind() == io::ErrorKind::NotFound => remove(&to).map(|()| None),
        Err(source) => Err(Error::file("read", &from)(source)),
    }
}

impl super::Store {
    /// Number of checkpoints that a trial has saved so far, while it has not ended.
    #[must_use]
    pub fn checkpoints(&self, id: &str) -> u64 {
        let names = names(&running(&self.folder(id))).unwrap_or_default();
        names
            .iter()
            .filter_map(|name| name.strip_prefix(PREFIX)?.parse().ok())
            .max()
            .unwrap_or(0)
    }
}

/// Faults among the files of the trial `trial` in `running`: names, each with the fault.
pub(super) fn faults(running: &Path, trial: &str) -> Result<Vec<(String, &'static str)>, Error> {
    let mut faults = Vec::new();
    for name in names(running)? {
        let path = running.join(&name);
        if name.starts_with(PREFIX) && !is_whole(&path, trial) {
            faults.push((name, "it is not what was saved"));
        } else if name.starts_with(PREFIX) && !has_its_rows(&path, running) {
            faults.push((name, "`metrics.log` lacks rows that it goes on from"));
        } else if name.starts_with('.') {
            faults.push((name, "its writing was never finished"));
        } else if name == "metrics.log" && is_damaged(&path, trial) {
            faults.push((name, "a frame before its end is damaged"));
        } else if !name.starts_with(PREFIX) && ![WORK, OUTPUT, "metrics.log"].contains(&name.as_str()) {
            faults.push((name, "a running trial has no such file"));
        }
    }
    Ok(faults)
}

/// Whether the log still has the rows that a complete checkpoint needs.
fn has_its_rows(checkpoint: &Path, running: &Path) -> bool {
    let state = fs::read(checkpoint.join("state.json")).ok();
    let state = state.and_then(|text| serde_json::from_slice::<TrialCheckpoint>(&text).ok());
    state.is_none_or(|state| metric_log::holds(&running.join("metrics.log"), &state.log))
}

fn is_damaged(log: &Path, trial: &str) -> bool {
    !is_file(log)
        || metric_log::read(log).map_or(true, |log| {
            matches!(log.end, LogEnd::Damaged { .. }) || log.trial != trial
        })
}

fn running(folder: &Path) -> PathBuf {
    folder.join("running")
}

/// Flushes the name of a new folder of a trial, and the folders that lead to it, to the disk.
fn flush_with_way(folder: &Path) -> Result<(), Error> {
    for path in folder.ancestors().take(2) {
        flush(path).map_err(Error::file("flush", path))?;
    }
    flush_way_to(folder.parent().unwrap_or(folder))
}

#[cfg(test)]
mod tests;
