//! Environments that are written in Python (of Gymnasium, of `PettingZoo`'s parallel interface, or a user's own), and a
//! user's own rules and learners.
//!
//! The environments of a trial live in one Python process ([`server.py`](../src/server.py)), which this crate starts,
//! asks and ends. Numbers pass through shared memory, and one byte in each direction announces them. Environments that
//! are stepped together are asked together. An agent has a process of the same server.
//!
//! A trial's id holds everything that determines numbers: the text of a user's files and that of a lock file, with
//! which the installed packages are compared at every start of Python. The interpreter's location is not part of the
//! id.

use contract::{AgentTraits, Feed};
mod agent;
mod agent_config;
mod config;
mod environment;
mod interface;
mod making;
mod process;
mod rehearsal;
mod seats;
mod server;

pub use agent_config::AgentConfig;
pub use config::PythonConfig;

use serde_json::Value;

/// The name of a package's environment in that package, for programs that make the environment themselves.
fn names(config: &Value) -> Vec<(&'static str, String)> {
    let word = config.get("make").and_then(Value::as_str);
    let name = word
        .and_then(|word| word.split_once(':'))
        .map(|(_, name)| name.to_owned());
    name.map(|name| ("id", name)).into_iter().collect()
}

/// Registers the environment and the agent `python`.
pub fn register(registry: &mut contract::Registry) {
    registry.environment(
        "python",
        1,
        "an environment written in Python: of Gymnasium, of PettingZoo's parallel interface, or of your own",
        environment::build,
    );
    registry.environment_names("python", names);
    registry.agent(
        "python",
        1,
        "a rule or a learner of your own, written in Python",
        AgentTraits {
            learns_from: vec![Feed::Decisions, Feed::Dataset],
            by_config: Some(agent_config::said_of),
            ..AgentTraits::default()
        },
        agent::build,
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn an_environment_of_a_package_has_the_name_that_it_has_there() {
        let named = |make: Value| names(&json!({ "make": make }));
        assert_eq!(
            named(json!("gymnasium:CartPole-v1")),
            [("id", "CartPole-v1".to_owned())]
        );
        assert_eq!(
            named(json!("gymnasium:ale_py:ALE/Pong-v5")),
            [("id", "ale_py:ALE/Pong-v5".to_owned())]
        );
        assert_eq!(named(json!({ "file": "tank.py", "call": "make" })), []);
    }
}
