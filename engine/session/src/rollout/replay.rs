//! An episode of a stored trial's final measurement, played again as it was scored.
//!
//! The measurement itself runs again with all episodes of a block side by side, because the network of a program may
//! round differently for another number of rows. One environment is watched, so its actions are equal to the scored
//! ones to the bit.

use super::columns::Columns;
use contract::{
    Agent, Channel, Environment, Error, Interface, Metric, NoKeeper, Phase, Recorder, Registry, Rng, Seat,
    StaticTrace, Step,
    artifact::FindArtifact,
    cast::{Actors, take_up},
    protocol::{Run, replay_measurement},
    random::Streams,
    trial::TrialKey,
    trial_result::TrialResult,
};
use std::sync::mpsc::{Sender, channel};

/// Header and rows of episode `episode` of the final measurement of a trial.
///
/// # Errors
/// [`Error::Source`] if the trial measured no such episode, was made by other versions of its plugins, or left no
/// usable policy.
pub fn replay(
    trial: &TrialResult,
    episode: u64,
    registry: &Registry,
    find: FindArtifact<'_>,
) -> Result<Vec<Vec<String>>, Error> {
    let key = &trial.trial.key;
    let unusable = |problem: String| Error::Source {
        trial: key.id(),
        problem,
    };
    let (step, episodes) = measured(trial)
        .ok_or_else(|| unusable("it measured no episodes at its end; give `--seed`".into()))?;
    if episode >= episodes {
        return Err(unusable(format!(
            "its final measurement has the episodes 0 to {}",
            episodes - 1
        )));
    }
    if let Some(other) = other_version(key, registry) {
        return Err(unusable(format!(
            "{other}: what was scored cannot be played again; give `--seed` for a new episode"
        )));
    }
    let entry = registry.environments.get(key.environment.plugin.as_str());
    let entry = entry.ok_or_else(|| {
        unusable(format!(
            "the environment `{}` is not registered",
            key.environment.plugin
        ))
    })?;
    let streams = Streams::new(&key.id(), &key.environment.stream_id(&entry.about), key.seed);
    let (sender, rows) = channel();
    let start = streams.environment(Phase::Final.name(), episode);
    let config = key.environment.loaded(find)?;
    let make_environment = || -> Result<Box<dyn Environment>, Error> {
        let inner = (entry.build)(&config)?;
        Ok(Box::new(Watched {
            inner,
            start: start.clone(),
            watched: None,
            sender: sender.clone(),
        }))
    };
    let agent = trained_agent(key, registry, &make_environment()?.interface(), &streams, find)?;
    let record = Recorder::default();
    let mut run = Run {
        make_environment: &make_environment,
        agent,
        streams,
        record,
        progress: &mut |_, _| {},
        assignment: Default::default(),
        keeper: &mut NoKeeper,
        folder: None,
    };
    replay_measurement(&mut run, step, episodes, episode)?;
    Ok(rows.try_iter().collect())
}

/// The agent as a trial left it: built again, with the acknowledged policy if it learns.
///
/// # Errors
/// [`Error::Source`] if the policy is missing, damaged or of another form, and the errors of the agent's constructor.
pub fn trained_agent(
    key: &TrialKey,
    registry: &Registry,
    interface: &Interface,
    streams: &Streams,
    find: FindArtifact<'_>,
) -> Result<Box<dyn Agent>, Error> {
    let mut agent = key.build_agent(registry, interface, streams, find)?;
    if let Actors::Agent(part) = &*key.agent
        && registry
            .agents
            .get(part.plugin.as_str())
            .is_some_and(|entry| entry.learns_with(&part.config))
    {
        take_up(&mut *agent, &part.plugin, &key.id(), find)?;
    }
    Ok(agent)
}

/// Training steps before the final measurement, and its number of episodes; `None` if no episodes were measured.
fn measured(trial: &TrialResult) -> Option<(u64, u64)> {
    let rows = || trial.select(Phase::Final, "return");
    Some((rows().next()?.step, rows().map(|row| row.episode + 1).max()?))
}

/// The first part of a trial that another version of this program made.
fn other_version(key: &TrialKey, registry: &Registry) -> Option<String> {
    let (environment, protocol) = (&key.environment, &key.protocol);
    let parts = [
        (
            environment,
            registry
                .environments
                .get(environment.plugin.as_str())
                .map(|entry| entry.about.version),
        ),
        (
            protocol,
            registry
                .protocols
                .get(protocol.plugin.as_str())
                .map(|entry| entry.about.version),
        ),
    ];
    let agents = key.agent.parts().into_iter();
    let agents = agents.map(|agent| {
        (
            agent,
            registry
                .agents
                .get(agent.plugin.as_str())
                .map(|entry| entry.about.version),
        )
    });
    let other = parts
        .into_iter()
        .map(|(part, now)| (&**part, now))
        .chain(agents)
        .find_map(|(part, now)| now.filter(|now| *now != part.version).map(|now| (part, now)));
    if let Some((part, now)) = other {
        return Some(format!(
            "it was made by version {} of `{}`, this program has {now}",
            part.version, part.plugin
        ));
    }
    let (then, now) = (key.numerics, registry.numerics_version);
    (then != now).then(|| format!("it was made by version {then} of the numerics, this program has {now}"))
}

/// An environment that sends the rows of one episode: the one that begins with the state `start` of the random numbers.
struct Watched {
    inner: Box<dyn Environment>,
    start: Rng,
    /// Columns and number of decisions so far, while it plays that episode.
    watched: Option<(Columns, u64)>,
    sender: Sender<Vec<String>>,
}

impl Watched {
    fn send(&self, row: Vec<String>) {
        // The receiver lives until the measurement ends.
        let _ = self.sender.send(row);
    }
}

impl Environment for Watched {
    fn seats(&self) -> &[Seat] {
        self.inner.seats()
    }

    fn metrics(&self) -> &[Metric] {
        self.inner.metrics()
    }

    fn reset(&mut self, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        self.reset_to(0, rng)
    }

    fn reset_to(&mut self, episode: u64, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        let begins = *rng == self.start;
        let seats = self.inner.reset_to(episode, rng)?;
        self.watched = begins.then(|| (Columns::of(&*self.inner), 0));
        if let Some((columns, _)) = &self.watched {
            self.send(columns.header());
            columns
                .start(&*self.inner, &seats)
                .into_iter()
                .for_each(|row| self.send(row));
        }
        Ok(seats)
    }

    fn step(&mut self, actions: &[Vec<f64>], rng: &mut Rng) -> Result<Step, Error> {
        let step = self.inner.step(actions, rng)?;
        if let Some((columns, decision)) = &mut self.watched {
            *decision += 1;
            let row = columns.row(
                &*self.inner,
                &step.observations,
                *decision,
                Some((actions, &step)),
            );
            self.send(row);
        }
        Ok(step)
    }

    fn state_channels(&self) -> Vec<Channel> {
        self.inner.state_channels()
    }

    fn state(&self) -> Vec<f64> {
        self.inner.state()
    }

    fn trace_channels(&self) -> Vec<Channel> {
        self.inner.trace_channels()
    }

    fn trace(&self) -> Vec<f64> {
        self.inner.trace()
    }

    fn static_trace(&self) -> Option<StaticTrace> {
        self.inner.static_trace()
    }

    fn snapshot(&self) -> serde_json::Value {
        self.inner.snapshot()
    }

    fn restore(&mut self, snapshot: &serde_json::Value) -> Result<(), Error> {
        self.inner.restore(snapshot)
    }
}
