//! Measurement of a policy: whole episodes, each with its own random numbers.

use super::{
    Run, leave_drawings,
    position::{Blocks, Position, restored},
};
use crate::{
    Action, End, Environment, Error, Metric, Mode, Observation, Phase, Rng, agent::Agent, clock, dataset,
    episode_metrics::EpisodeMetrics, standard_metrics::EPISODE_LENGTH,
};
use serde::Serialize;
use serde_json::Value;
use std::{cell::RefCell, collections::BTreeMap};

/// Number of episodes that are stepped together, so that the policy gets many rows at a time.
const ROWS: u64 = 256;

/// The size of a measurement, and the name under which it is stored.
#[derive(Debug, Clone, PartialEq)]
pub struct Measurement {
    /// Phase of the rows: `Evaluate` or `Final`.
    phase: Phase,
    /// Training steps done so far.
    pub step: u64,
    /// Number of episodes of the measurement.
    episodes: u64,
    /// Number of its first episodes that are recorded step by step.
    traced: u64,
    /// Name of the random streams of its episodes. Measurements with the same name have the same episodes, independent
    /// of the agent.
    stream: String,
    /// Mode of the agent's actions.
    mode: Mode,
    /// Whether episodes are played one after the other, by every agent.
    one_by_one: bool,
    /// Whether the environment's drawings of the last episode are stored.
    drawn: bool,
}

impl Measurement {
    /// The measurement number `index`, from 0, of those during learning. Each has episodes of its own, so that a curve
    /// does not depend on the luck of one set of starts.
    #[must_use]
    pub fn while_learning(index: u64, step: u64, episodes: u64) -> Self {
        Self {
            phase: Phase::Evaluate,
            step,
            episodes,
            traced: 0,
            stream: format!("evaluate {index}"),
            mode: Mode::Evaluate,
            one_by_one: false,
            drawn: false,
        }
    }

    /// The measurement at the end, with its first `traced` episodes recorded step by step.
    #[must_use]
    pub fn at_the_end(step: u64, episodes: u64, traced: u64) -> Self {
        Self {
            phase: Phase::Final,
            step,
            episodes,
            traced,
            stream: "final".into(),
            mode: Mode::Evaluate,
            one_by_one: false,
            drawn: false,
        }
    }

    /// The measurement at the end of a trial that follows episodes one after the other.
    #[must_use]
    pub fn one_by_one(episodes: u64, traced: u64) -> Self {
        Self {
            one_by_one: true,
            ..Self::at_the_end(0, episodes, traced)
        }
    }

    /// The same measurement, which also stores the environment's drawings of its last episode.
    #[must_use]
    pub fn with_drawings(self) -> Self {
        Self { drawn: true, ..self }
    }

    /// Number of episodes that an agent steps together: one, if it remembers.
    fn together(&self, agent: &dyn Agent) -> u64 {
        if self.one_by_one || agent.remembers() {
            1
        } else {
            ROWS
        }
    }

    /// Episodes to learn from, on streams of their own: none of them occurs again in a measurement.
    #[must_use]
    pub fn to_gather(episodes: u64, mode: Mode) -> Self {
        Self {
            phase: Phase::Final,
            step: 0,
            episodes,
            traced: 0,
            stream: "gather".into(),
            mode,
            one_by_one: false,
            drawn: false,
        }
    }
}

/// One episode that has not ended.
struct Episode {
    slot: usize,
    index: u64,
    environment: Box<dyn Environment>,
    rng: Rng,
    observation: Observation,
    decisions: u64,
    returns: Vec<f64>,
    metrics: EpisodeMetrics,
    assessed: Vec<f64>,
    gathered: Option<dataset::Episode>,
}

/// Whole episodes that are kept, by number.
pub type Kept = RefCell<BTreeMap<u64, dataset::Episode>>;

/// Runs the episodes and records return, length, the environment's metrics and those of the agent's decisions
/// of each.
///
/// Episode `k` of a measurement starts and continues with the same random numbers for every agent. The trial can be
/// stopped before every block of episodes. `learning` then gives the state that learning needs, and the [`Position`] of
/// the checkpoint gives the `blocks` from which to continue; `None` begins the measurement.
///
/// # Errors
/// [`Error::Stopped`] between two blocks, and errors of the environment and the agent.
pub fn measure<L: Serialize>(
    run: &mut Run<'_>,
    what: &Measurement,
    blocks: Option<Blocks>,
    learning: impl Fn() -> Option<L>,
) -> Result<(), Error> {
    measure_and_keep(run, what, blocks, learning, None)
}

/// Like [`measure`]; every episode is also added to `kept` when it ends.
///
/// # Errors
/// The errors of [`measure`].
pub fn measure_and_keep<L: Serialize>(
    run: &mut Run<'_>,
    what: &Measurement,
    blocks: Option<Blocks>,
    learning: impl Fn() -> Option<L>,
    kept: Option<&Kept>,
) -> Result<(), Error> {
    let begin = || Blocks {
        first: 0,
        rng: run.streams.agent(&format!("{} {}", what.phase.name(), what.step)),
        pool: Vec::new(),
    };
    let Blocks {
        mut first,
        mut rng,
        pool,
    } = blocks.unwrap_or_else(begin);
    let together = what.together(&*run.agent);
    let rows = what.episodes.min(together);
    let mut pool = open_pool(run, rows, &pool)?;
    while first < what.episodes {
        let blocks = || Blocks {
            first,
            rng: rng.clone(),
            pool: snapshots(first, &pool),
        };
        run.checkpoint(|| Position {
            learning: learning(),
            measuring: Some(blocks()),
        })?;
        let mut active = Vec::with_capacity(pool.len());
        for (slot, index) in (first..what.episodes.min(first + rows)).enumerate() {
            if let Some(environment) = pool[slot].take() {
                let mut episode = start(run, what, slot, index, environment)?;
                if kept.is_some() {
                    let mut gathered = dataset::Episode::default();
                    gathered.see(&*episode.environment, &episode.observation.seats);
                    episode.gathered = Some(gathered);
                }
                active.push(episode);
            }
        }
        while !active.is_empty() {
            active = advance(run, what, active, &mut rng, &mut pool, kept)?;
        }
        first += together;
    }
    Ok(())
}

/// Measures an agent that does not learn, at every step at which a learning agent is measured. `episodes` is the number
/// of episodes of all measurements together, for progress. It must be called first, and resumes from a checkpoint by
/// itself.
///
/// # Errors
/// The errors of [`measure`].
pub fn measure_alone(
    run: &mut Run<'_>,
    measurements: impl Iterator<Item = Measurement>,
    episodes: u64,
) -> Result<(), Error> {
    let position: Option<Position<usize>> = run.resume()?;
    let (first, mut blocks) = position.map_or((0, None), |position| {
        (position.learning.unwrap_or(0), position.measuring)
    });
    let mut done = 0;
    for (place, what) in measurements.enumerate() {
        done += what.episodes;
        if place >= first {
            measure(run, &what, blocks.take(), || Some(place))?;
            (run.progress)(done, episodes);
        }
    }
    Ok(())
}

/// Repeats the measurement at the end of a trial that made `step` training steps, until the block of episodes with
/// `episode` is done.
///
/// # Errors
/// The error of the environment or the agent.
pub fn replay(run: &mut Run<'_>, step: u64, episodes: u64, episode: u64) -> Result<(), Error> {
    let what = Measurement::at_the_end(step, episodes, 0);
    let together = what.together(&*run.agent);
    let until = (episode / together + 1) * together;
    let what = Measurement {
        episodes: episodes.min(until),
        ..what
    };
    measure(run, &what, None, || None::<()>)
}

/// Environments; each is free while it plays no episode.
type Pool = Vec<Option<Box<dyn Environment>>>;

/// Slot r plays episodes r, r + rows, r + 2 rows, ...: environments are made once, and one whose state wears does so in
/// the same way, independently of other slots.
fn open_pool(run: &Run<'_>, rows: u64, snapshots: &[Value]) -> Result<Pool, Error> {
    if snapshots.is_empty() {
        return (0..rows).map(|_| (run.make_environment)().map(Some)).collect();
    }
    if snapshots.len() as u64 != rows {
        let problem = format!("{} environments stored, {rows} needed", snapshots.len());
        return Err(Error::Checkpoint {
            what: "a measurement",
            problem,
        });
    }
    snapshots
        .iter()
        .map(|snapshot| restored(run.make_environment, snapshot).map(Some))
        .collect()
}

/// States of the environments: empty before the first block. Between blocks all of them are free.
fn snapshots(first: u64, pool: &Pool) -> Vec<Value> {
    if first == 0 {
        Vec::new()
    } else {
        pool.iter()
            .flatten()
            .map(|environment| environment.snapshot())
            .collect()
    }
}

fn start(
    run: &mut Run<'_>,
    what: &Measurement,
    slot: usize,
    index: u64,
    mut environment: Box<dyn Environment>,
) -> Result<Episode, Error> {
    let mut rng = run.streams.environment(&what.stream, index);
    let seats = environment.reset_to(index, &mut rng)?;
    run.agent.restart();
    let observation = observe(&*run.agent, &*environment, seats);
    let returns = vec![0.0; environment.seats().len()];
    let metrics = EpisodeMetrics::new(environment.metrics());
    let (decisions, assessed) = (0, Vec::new());
    let episode = Episode {
        slot,
        index,
        environment,
        rng,
        observation,
        decisions,
        returns,
        metrics,
        assessed,
        gathered: None,
    };
    trace(run, what, &episode);
    Ok(episode)
}

/// Steps every active episode once; returns those that continue, and returns the environments of the others to the
/// pool.
fn advance(
    run: &mut Run<'_>,
    what: &Measurement,
    mut active: Vec<Episode>,
    rng: &mut Rng,
    pool: &mut Pool,
    kept: Option<&Kept>,
) -> Result<Vec<Episode>, Error> {
    let observations: Vec<Observation> = active.iter().map(|episode| episode.observation.clone()).collect();
    let actions = decide(run, what, &observations, rng)?;
    for (episode, values) in active.iter_mut().zip(run.agent.assess(&observations, &actions)?) {
        episode.assessed.resize(values.len(), 0.0);
        add(&mut episode.assessed, &values);
    }
    for (episode, action) in active.iter_mut().zip(&actions) {
        episode.environment.begin_step(action)?;
    }
    let mut going_on = Vec::with_capacity(active.len());
    for (mut episode, action) in active.into_iter().zip(actions) {
        let end = step(run, &mut episode, &action)?;
        trace(run, what, &episode);
        match end {
            None => going_on.push(episode),
            Some(end) => {
                leave(run, what, &mut episode, (end, kept))?;
                pool[episode.slot] = Some(episode.environment);
            }
        }
    }
    Ok(going_on)
}

/// Steps the environment of an episode once and adds its results; returns the end of the episode, if it ended.
fn step(run: &Run<'_>, episode: &mut Episode, action: &Action) -> Result<Option<End>, Error> {
    let step = episode.environment.step(action, &mut episode.rng)?;
    episode.decisions += 1;
    add(&mut episode.returns, &step.rewards);
    episode.metrics.add(episode.environment.metrics(), &step)?;
    if let Some(gathered) = &mut episode.gathered {
        gathered.take(action, &step.rewards);
        gathered.see(&*episode.environment, &step.observations);
    }
    episode.observation = observe(&*run.agent, &*episode.environment, step.observations);
    Ok(step.end)
}

/// Records an episode that ended, and stores the drawings of the last one and the transitions that are kept.
fn leave(
    run: &mut Run<'_>,
    what: &Measurement,
    episode: &mut Episode,
    (end, kept): (End, Option<&Kept>),
) -> Result<(), Error> {
    finish(run, what, episode);
    let is_drawn = what.drawn && episode.index + 1 == what.episodes;
    if let Some(folder) = run.folder.filter(|_| is_drawn) {
        leave_drawings(&mut *episode.environment, folder)?;
    }
    if let (Some(kept), Some(mut gathered)) = (kept, episode.gathered.take()) {
        gathered.end = end;
        kept.borrow_mut().insert(episode.index, gathered);
    }
    Ok(())
}

fn add(sums: &mut [f64], values: &[f64]) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
}

/// The agent's actions. The time of those of the final measurement is kept beside the rows.
fn decide(
    run: &mut Run<'_>,
    what: &Measurement,
    observations: &[Observation],
    rng: &mut Rng,
) -> Result<Vec<Action>, Error> {
    let asked = clock::now();
    let actions = run.agent.act(observations, what.mode, rng)?;
    if what.phase == Phase::Final {
        run.record.decided(actions.len(), clock::since(asked));
    }
    Ok(actions)
}

/// The observation of an agent whose seats observe `seats`, with the environment's full state if the agent reads it.
pub fn observe(agent: &dyn Agent, environment: &dyn Environment, seats: Vec<Vec<f64>>) -> Observation {
    let state = if agent.reads_state() {
        environment.state()
    } else {
        Vec::new()
    };
    Observation { seats, state }
}

fn finish(run: &mut Run<'_>, what: &Measurement, episode: &Episode) {
    let Episode { index, decisions, .. } = *episode;
    #[allow(
        clippy::cast_precision_loss,
        reason = "an episode has far fewer than 2^52 decisions"
    )]
    let length = decisions as f64;
    for (seat, value) in episode.returns.iter().enumerate() {
        run.record
            .add(what.phase, what.step, index, seat, "return", *value);
    }
    run.record
        .add(what.phase, what.step, index, 0, EPISODE_LENGTH, length);
    let metrics = episode.environment.metrics();
    for (metric, value) in metrics.iter().zip(episode.metrics.of_episode(metrics)) {
        run.record
            .add(what.phase, what.step, index, 0, &metric.name, value);
    }
    let n_seats = episode.returns.len();
    for (metric, sums) in run
        .agent
        .decision_metrics()
        .iter()
        .zip(episode.assessed.chunks(n_seats))
    {
        for (seat, sum) in sums.iter().enumerate() {
            run.record
                .add(what.phase, what.step, index, seat, &metric.name, sum / length);
        }
    }
}

fn trace(run: &mut Run<'_>, what: &Measurement, episode: &Episode) {
    if what.phase != Phase::Final || episode.index >= what.traced {
        return;
    }
    let channels = episode.environment.trace_channels();
    for (channel, value) in channels.iter().zip(episode.environment.trace()) {
        // There is no value yet, for instance for an action before the first decision.
        if !value.is_nan() {
            run.record.add(
                Phase::Trace,
                episode.decisions,
                episode.index,
                0,
                &channel.name,
                value,
            );
        }
    }
}

/// Records the environment's static trace, if it has one: a point per episode, all at step 0.
///
/// # Errors
/// The environment cannot be made.
pub fn record_static_trace(run: &mut Run<'_>) -> Result<(), Error> {
    let Some(trace) = (run.make_environment)()?.static_trace() else {
        return Ok(());
    };
    for (index, point) in (0..).zip(&trace.points) {
        for (name, value) in trace.names.iter().zip(point) {
            run.record.add(Phase::Trace, 0, index, 0, name, *value);
        }
    }
    Ok(())
}

/// Metrics that every protocol which measures episodes records besides those of environment and agent.
#[must_use]
pub fn metrics() -> Vec<Metric> {
    vec![
        Metric::new("return", "", "sum of the rewards of an episode, per seat"),
        Metric::new(EPISODE_LENGTH, "decisions", "decisions until the episode ended"),
    ]
}
