//! Soft actor-critic as an agent: [`SoftActorCritic`] with updates at the steps of the environment.
//!
//! Haarnoja et al. 2018, "Soft actor-critic algorithms and applications", arXiv:1812.05905. Equations,
//! departures and metrics stand with the algorithm, on which other agents are built, too.

use crate::shared::soft_actor_critic::{Config, SoftActorCritic, metrics};
use contract::{Agent, AgentTraits, Error, Feed, Interface, Registry, Rng};

const NAME: &str = "soft_actor_critic";

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "soft actor-critic for one seat that acts in a box";
    // Off-policy: the replay buffer takes decisions of any policy.
    let traits = AgentTraits::learner([Feed::Decisions, Feed::Dataset], metrics());
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the agent for one seat that observes a box and acts in a box with limits -1 and 1.
///
/// # Errors
/// [`Error::Mismatch`] for any other seat, [`Error::Config`] for settings that contradict each other.
fn build(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(SoftActorCritic::new(config, interface, rng)?))
}
