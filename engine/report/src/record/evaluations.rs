//! `evaluations.parquet`: the measurements of a study's trials, as means over the episodes of every measurement.
//!
//! | column | type | meaning |
//! |---|---|---|
//! | `environment`, `agent`, `setting` | text | names of the study |
//! | `seed` | u64 | seed |
//! | `phase` | text | `final`, `evaluate` (while learning), `train` (recorded by the agent, where it was never measured) |
//! | `step` | u64 | when it was measured |
//! | `metric` | text | name; `rms(name)` for the root of the mean square over episodes |
//! | `value` | f64 | mean over the episodes |
//!
//! The final measurement has every metric; earlier ones have those that a table, figure, claim or search of the study
//! names. The rows of a trial are together; meetings of a play that share names and seed come in the order of the
//! plan.

use analysis::results::Results;
use contract::{
    Error, panics,
    parquet::{self, ParquetTable, Values},
    recorder::{Phase, Row, intern},
    standard_metrics::root_of_squares,
    trial::{Combination, Trial},
    trial_result::TrialResult,
};
use serde::Serialize;
use std::{
    cell::RefCell,
    collections::{BTreeMap, VecDeque},
    path::Path,
    sync::Arc,
};

/// The metrics that a study names.
pub struct Asks {
    text: String,
    known: RefCell<BTreeMap<String, bool>>,
}

impl Asks {
    /// The metrics that some parts of a study name.
    #[must_use]
    pub fn of(parts: &impl Serialize) -> Self {
        Self {
            // A part without a form as JSON names no metric.
            text: serde_json::to_string(parts).unwrap_or_default(),
            known: RefCell::default(),
        }
    }

    fn has(&self, metric: &str) -> bool {
        if let Some(known) = self.known.borrow().get(metric) {
            return *known;
        }
        let found = self.text.contains(metric);
        self.known.borrow_mut().insert(metric.into(), found);
        found
    }

    /// Whether a part uses the root of a mean square.
    fn squares(&self) -> bool {
        self.text.contains("rms(") || self.text.contains("\"root_mean_square\":true")
    }
}

/// A row: trial, phase, step, metric, mean over the episodes.
type MeanRow<'a> = (&'a Trial, Phase, u64, String, f64);

/// The bytes of the file; `path` is named in errors.
///
/// # Errors
/// [`Error`] where the rows cannot be encoded.
pub fn encode(path: &Path, results: &Results, asks: &Asks) -> Result<Vec<u8>, Error> {
    let squares = asks.squares();
    let mut rows: Vec<MeanRow<'_>> = Vec::new();
    for result in results.trials.iter().filter(|result| result.is_ok()) {
        for metric in result.names.iter() {
            rows.extend(curve(result, Phase::Final, metric));
        }
        for metric in result.names.iter().filter(|metric| asks.has(metric)) {
            rows.extend(root(result, metric).filter(|_| squares));
            let measured = rows.len();
            rows.extend(curve(result, Phase::Evaluate, metric));
            if rows.len() == measured {
                rows.extend(curve(result, Phase::Train, metric));
            }
        }
    }
    let text = |of: for<'r> fn(&'r MeanRow<'_>) -> &'r str| Values::Text(rows.iter().map(of).collect());
    let columns = vec![
        ("environment", text(|row| &row.0.cell.environment)),
        ("agent", text(|row| &row.0.cell.agent)),
        ("setting", text(|row| row.0.cell.point.words())),
        (
            "seed",
            Values::U64(rows.iter().map(|row| row.0.key.seed).collect()),
        ),
        ("phase", text(|row| row.1.name())),
        ("step", Values::U64(rows.iter().map(|row| row.2).collect())),
        ("metric", text(|row| &row.3)),
        ("value", Values::F64(rows.iter().map(|row| row.4).collect())),
    ];
    parquet::encode(path, columns, &[])
}

fn curve<'a>(result: &'a TrialResult, phase: Phase, metric: &str) -> impl Iterator<Item = MeanRow<'a>> {
    let points = result.curve(phase, metric).into_iter();
    points.map(move |(step, value)| (&*result.trial, phase, step, metric.to_owned(), value))
}

/// The row of the root of the mean square in the final measurement; `None` where the trial has none.
fn root<'a>(result: &'a TrialResult, metric: &str) -> Option<MeanRow<'a>> {
    let value = result.root_mean_square(Phase::Final, metric)?;
    let step = result.select(Phase::Final, metric).last()?.step;
    Some((&*result.trial, Phase::Final, step, root_of_squares(metric), value))
}

/// The measurements of one trial.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Block {
    /// Metric names that `rows` point into; trials with the same ones share them.
    pub names: Arc<Vec<String>>,
    /// The rows, one for each mean.
    pub rows: Vec<Row>,
}

/// Measurements of trials, by their names and seed.
#[derive(Debug, Default)]
pub struct Blocks(BTreeMap<(Combination, u64), VecDeque<Block>>);

impl Blocks {
    /// The next block of these names and this seed.
    pub fn take(&mut self, cell: &Combination, seed: u64) -> Option<Block> {
        self.0.get_mut(&(cell.clone(), seed))?.pop_front()
    }

    /// The number of trials by names and seed.
    pub fn numbers(&self) -> impl Iterator<Item = (&Combination, u64, usize)> {
        self.0
            .iter()
            .map(|((cell, seed), blocks)| (cell, *seed, blocks.len()))
    }
}

/// Reads the file.
///
/// # Errors
/// [`Error::Damaged`] where the bytes are no such file.
pub fn decode(bytes: Vec<u8>, path: &Path) -> Result<Blocks, Error> {
    let whole = || {
        let table = ParquetTable::decode(bytes, path)?;
        blocks(&table)
    };
    let unknown = || Error::Damaged {
        path: path.into(),
        problem: "a cell is empty, a phase is unknown, or there are more than 65535 names of metrics".into(),
    };
    panics::or_damaged(path, whole)?.ok_or_else(unknown)
}

/// Collector of the rows of one trial.
#[derive(Default)]
struct BlockReader {
    blocks: Vec<Block>,
    /// For each phase and metric its index in the block, and its last step there.
    last: BTreeMap<(Phase, u16), (usize, u64)>,
}

impl BlockReader {
    /// Adds a row. A step that does not exceed the last one belongs to the next trial of the same names.
    fn add(
        &mut self,
        names: &mut Vec<String>,
        phase: Phase,
        step: u64,
        metric: &str,
        value: f64,
    ) -> Option<()> {
        if names.len() >= usize::from(u16::MAX) && !names.iter().any(|known| known == metric) {
            return None;
        }
        let metric = intern(names, metric);
        let place = match self.last.get(&(phase, metric)) {
            None => 0,
            Some((place, last)) => place + usize::from(step <= *last),
        };
        self.last.insert((phase, metric), (place, step));
        if place >= self.blocks.len() {
            self.blocks.resize_with(place + 1, Block::default);
        }
        self.blocks[place].rows.push(Row {
            phase,
            step,
            episode: 0,
            seat: 0,
            metric,
            value,
        });
        Some(())
    }
}

fn blocks(table: &ParquetTable<'_>) -> Result<Option<Blocks>, Error> {
    let (environments, agents) = (table.texts("environment")?, table.texts("agent")?);
    let (settings, seeds) = (table.texts("setting")?, table.u64s("seed")?);
    let (phases, steps) = (table.texts("phase")?, table.u64s("step")?);
    let (metrics, values) = (table.texts("metric")?, table.f64s("value")?);
    let mut names: Vec<String> = Vec::new();
    let mut trials: BTreeMap<(Combination, u64), BlockReader> = BTreeMap::new();
    let cells = environments.zip(agents).zip(settings).zip(seeds);
    let mut now: Option<((&str, &str, &str, u64), BlockReader)> = None;
    for ((((cell, phase), step), metric), value) in cells.zip(phases).zip(steps).zip(metrics).zip(values) {
        let (((Some(environment), Some(agent)), Some(setting)), Some(seed)) = cell else {
            return Ok(None);
        };
        let (Some(phase), Some(step), Some(metric), Some(value)) =
            (phase.and_then(phase_named), step, metric, value)
        else {
            return Ok(None);
        };
        let key = (environment, agent, setting, seed);
        if now.as_ref().is_none_or(|(known, _)| *known != key) {
            put(&mut trials, now.take());
            let reading = trials.remove(&owned(key)).unwrap_or_default();
            now = Some((key, reading));
        }
        let Some((_, reading)) = &mut now else {
            return Ok(None);
        };
        if reading.add(&mut names, phase, step, metric, value).is_none() {
            return Ok(None);
        }
    }
    put(&mut trials, now);
    let mut shared: Vec<Arc<Vec<String>>> = Vec::new();
    let mut own = |reading: BlockReader| {
        let blocks = reading.blocks.into_iter();
        blocks
            .map(|block| with_own_names(block, &names, &mut shared))
            .collect()
    };
    Ok(Some(Blocks(
        trials
            .into_iter()
            .map(|(key, reading)| (key, own(reading)))
            .collect(),
    )))
}

fn owned((environment, agent, setting, seed): (&str, &str, &str, u64)) -> (Combination, u64) {
    (Combination::of_words(environment, agent, setting), seed)
}

fn put(
    trials: &mut BTreeMap<(Combination, u64), BlockReader>,
    read: Option<((&str, &str, &str, u64), BlockReader)>,
) {
    if let Some((key, reading)) = read {
        trials.insert(owned(key), reading);
    }
}

/// A block with only the names that it uses, in the order of its rows.
fn with_own_names(mut block: Block, names: &[String], shared: &mut Vec<Arc<Vec<String>>>) -> Block {
    let mut own: Vec<u16> = Vec::new();
    for row in &mut block.rows {
        let place = own.iter().position(|metric| *metric == row.metric);
        let place = place.unwrap_or_else(|| {
            own.push(row.metric);
            own.len() - 1
        });
        // A block has at most as many names as the file.
        row.metric = u16::try_from(place).unwrap_or(u16::MAX);
    }
    let own: Vec<String> = own
        .into_iter()
        .map(|metric| names[usize::from(metric)].clone())
        .collect();
    let known = shared.iter().find(|known| ***known == own).cloned();
    block.names = known.unwrap_or_else(|| {
        let new = Arc::new(own);
        shared.push(Arc::clone(&new));
        new
    });
    block
}

fn phase_named(name: &str) -> Option<Phase> {
    Phase::ALL.into_iter().find(|phase| phase.name() == name)
}
