//! Rehearsal of an agent in Python, before any trial runs: it acts and learns for some steps in two
//! environments, twice, and continues from its saved state.

use crate::agent::PythonAgent;
use contract::{
    Action, Agent, Environment, Error, Mode, Observation, Recorder, Rng, Transition, protocol::observe,
    random::stream,
};
use execution::patience::Watch;

/// Steps of a rehearsal, each of all environments.
const STEPS: usize = 5;
/// Number of environments of a rehearsal, if the agent can act in several at a time.
const ENVIRONMENTS: usize = 2;

/// Builds an environment of the trial.
type EnvironmentFactory<'a> = &'a dyn Fn() -> Result<Box<dyn Environment>, Error>;

/// Refuses an agent that fails, that acts differently the second time, or that does not continue identically from its
/// saved state.
///
/// # Errors
/// [`Error::Config`] at the key `make`.
pub fn rehearse(agent: &mut PythonAgent, make: EnvironmentFactory<'_>) -> Result<(), Error> {
    let (mut again, mut after) = (agent.again()?, agent.again()?);
    let watches = [&*agent, &again, &after].map(PythonAgent::watch);
    let tried = tried(agent, &mut again, &mut after, make);
    // All watches end, whichever of them ended a process.
    let reasons = watches.map(Watch::end);
    match reasons.into_iter().flatten().next() {
        Some(reason) => Err(Error::config("make", reason)),
        None => tried.map_err(of_code),
    }
}

/// The error, attributed to the code that `make` names.
fn of_code(error: Error) -> Error {
    match error {
        Error::Model { problem, .. } => Error::config("make", problem),
        Error::NotFinite { what, value, .. } => {
            Error::config("make", format!("{what} is {value}, which is no finite number"))
        }
        Error::Checkpoint { problem, .. } => Error::config("make", format!("`load` fails: {problem}")),
        other => other,
    }
}

fn tried(
    agent: &mut PythonAgent,
    again: &mut PythonAgent,
    after: &mut PythonAgent,
    make: EnvironmentFactory<'_>,
) -> Result<(), Error> {
    let mut first = Stage::set(agent, make)?;
    let mut second = Stage::set(again, make)?;
    for step in 1..=STEPS {
        if let Some(difference) = difference(&first.step(agent)?, &second.step(again)?) {
            let problem = format!(
                "the same seed does not give the same actions the second time: at step {step}, {difference}. All that \
                 it draws must come from `rng`, which its methods may take as an argument, or from a generator made of the \
                 `seed` that it is made with"
            );
            return Err(Error::config("make", problem));
        }
    }
    if agent.saves() {
        goes_on(agent, after, &first)?;
    }
    Ok(())
}

/// Compares an agent with a copy that restored its saved state.
fn goes_on(agent: &mut PythonAgent, after: &mut PythonAgent, stage: &Stage) -> Result<(), Error> {
    let folder = tempfile::tempdir().map_err(Error::file("create", &std::env::temp_dir()))?;
    agent.save(folder.path())?;
    after.load(folder.path())?;
    for when in ["", " and learning once more"] {
        if let Some(difference) = difference(&stage.shown(agent)?, &stage.shown(after)?) {
            let problem = format!(
                "what `load` took up of `save` does not go on alike: after it{when}, {difference}. All that decides on \
                 actions, and on what is learned, must be in what `save` returns"
            );
            return Err(Error::config("make", problem));
        }
        stage.learn_again(agent)?;
        stage.learn_again(after)?;
    }
    Ok(())
}

/// The environments of a rehearsal.
struct Stage {
    environments: Vec<(Box<dyn Environment>, Rng)>,
    seen: Vec<Observation>,
    transitions: Vec<Transition>,
}

impl Stage {
    fn set(agent: &mut PythonAgent, make: EnvironmentFactory<'_>) -> Result<Self, Error> {
        let rows = if agent.remembers() { 1 } else { ENVIRONMENTS };
        let mut stage = Self {
            environments: Vec::new(),
            seen: Vec::new(),
            transitions: Vec::new(),
        };
        for row in 0..rows {
            let (mut environment, mut rng) = (make()?, stream(&["rehearse", &row.to_string()]));
            let seats = environment.reset(&mut rng)?;
            stage.seen.push(observe(&*agent, &*environment, seats));
            stage.environments.push((environment, rng));
        }
        agent.restart();
        Ok(stage)
    }

    /// Lets an agent act in all environments and learn from the step.
    fn step(&mut self, agent: &mut PythonAgent) -> Result<Vec<Action>, Error> {
        let mode = if agent.learns() {
            Mode::Train
        } else {
            Mode::Evaluate
        };
        let actions = agent.act(&self.seen, mode, &mut stream(&["rehearse", "act"]))?;
        self.transitions.clear();
        for (((environment, rng), seen), action) in
            self.environments.iter_mut().zip(&mut self.seen).zip(&actions)
        {
            let step = environment.step(action, rng)?;
            let next_observation = observe(&*agent, &**environment, step.observations);
            let observation = std::mem::replace(seen, next_observation.clone());
            if step.end.is_some() {
                let seats = environment.reset(rng)?;
                *seen = observe(&*agent, &**environment, seats);
                agent.restart();
            }
            self.transitions.push(Transition {
                observation,
                action: action.clone(),
                rewards: step.rewards,
                next_observation,
                end: step.end,
            });
        }
        self.learn_again(agent)?;
        Ok(actions)
    }

    /// Evaluation actions at the current observations.
    fn shown(&self, agent: &mut PythonAgent) -> Result<Vec<Action>, Error> {
        agent.act(&self.seen, Mode::Evaluate, &mut stream(&["rehearse", "shown"]))
    }

    /// Lets an agent learn from the last step once more.
    fn learn_again(&self, agent: &mut PythonAgent) -> Result<(), Error> {
        let mut record = Recorder::default();
        agent.learn(
            &self.transitions,
            &mut stream(&["rehearse", "learn"]),
            &mut record,
        )?;
        record.all_finite()
    }
}

/// Describes the difference between actions; `None` where they are equal.
fn difference(one: &[Action], other: &[Action]) -> Option<String> {
    let bits = |action: &Action| action.concat().iter().map(|it| it.to_bits()).collect::<Vec<_>>();
    let differ = |(one, other): &(&Action, &Action)| bits(one) != bits(other);
    let (one, other) = one.iter().zip(other).find(differ)?;
    Some(format!("the action is {one:?} and then {other:?}"))
}
