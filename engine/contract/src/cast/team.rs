//! Agents that play one environment together, each the seats of its role.

use super::Cast;
use crate::{
    Action, Agent, Error, Interface, Metric, Mode, Observation, Registry, Rng,
    artifact::{ArtifactKind, FindArtifact, Taken},
    random::Streams,
};

/// Several agents as one. Each is built for all seats, as in its training, and only the actions of its own seats count.
pub struct Team {
    members: Vec<Member>,
    n_seats: usize,
}

struct Member {
    seats: Vec<usize>,
    agent: Box<dyn Agent>,
}

impl Team {
    /// Builds the agents of a cast and loads their policies, which `find` looks up.
    ///
    /// # Errors
    /// [`Error::Source`] if a policy is missing, damaged or of another form, and the errors of the agents'
    /// constructors.
    pub fn assemble(
        cast: &Cast,
        registry: &Registry,
        interface: &Interface,
        streams: &Streams,
        find: FindArtifact<'_>,
    ) -> Result<Self, Error> {
        let seat = |name: &String| {
            let found = interface.seats.iter().position(|seat| seat.name == *name);
            found.ok_or_else(|| Error::config("roles", format!("the environment has no seat `{name}`")))
        };
        let mut members = Vec::with_capacity(cast.roles.len());
        for (role, member) in &cast.roles {
            let name = &member.agent.plugin;
            let entry = registry.agents.get(name.as_str());
            let entry = entry.ok_or_else(|| {
                Error::config("agent", format!("`{name}` is not registered in this program"))
            })?;
            let mut rng = streams.agent(&format!("initialise {role}"));
            let mut agent = (entry.build)(&member.agent.loaded(find)?, interface, &mut rng)?;
            if let Some(trial) = &member.trial {
                take_up(&mut *agent, name, trial, find)?;
            }
            let seats = match member.seats.as_slice() {
                [] => (0..interface.seats.len()).collect(),
                names => names.iter().map(seat).collect::<Result<_, _>>()?,
            };
            members.push(Member { seats, agent });
        }
        Ok(Self {
            members,
            n_seats: interface.seats.len(),
        })
    }

    /// The agent that plays all seats; `None` for several agents, whose decisions cannot be attributed to seats.
    fn alone(&self) -> Option<&dyn Agent> {
        match self.members.as_slice() {
            [only] => Some(&*only.agent),
            _ => None,
        }
    }
}

/// Loads the policy that a trial left into an agent.
///
/// # Errors
/// [`Error::Source`] if the policy is missing, damaged or of another form.
pub fn take_up(agent: &mut dyn Agent, name: &str, trial: &str, find: FindArtifact<'_>) -> Result<(), Error> {
    let unusable = |problem: String| Error::Source {
        trial: trial.into(),
        problem,
    };
    match agent.import(&find(&Taken {
        trial: trial.into(),
        kind: ArtifactKind::Policy,
    })?) {
        Ok(true) => Ok(()),
        Ok(false) => Err(unusable(format!("the agent `{name}` takes up no stored policy"))),
        Err(error) => Err(unusable(error.to_string())),
    }
}

impl Agent for Team {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let mut joint: Vec<Action> = vec![vec![Vec::new(); self.n_seats]; observations.len()];
        for Member { seats, agent } in &mut self.members {
            for (row, mut action) in joint.iter_mut().zip(agent.act(observations, mode, rng)?) {
                seats
                    .iter()
                    .for_each(|&seat| row[seat] = std::mem::take(&mut action[seat]));
            }
        }
        Ok(joint)
    }

    fn decision_metrics(&self) -> Vec<Metric> {
        self.alone()
            .map_or_else(Vec::new, super::super::agent::Agent::decision_metrics)
    }

    fn assess(&mut self, observations: &[Observation], actions: &[Action]) -> Result<Vec<Vec<f64>>, Error> {
        match self.members.as_mut_slice() {
            [only] => only.agent.assess(observations, actions),
            _ => Ok(Vec::new()),
        }
    }

    fn reads_state(&self) -> bool {
        self.members.iter().any(|member| member.agent.reads_state())
    }
}
