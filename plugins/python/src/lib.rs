//! Environments that are written in Python: those of Gymnasium, of `PettingZoo`'s parallel interface, and a
//! person's own; and rules and learners of a person's own.
//!
//! The environments of a trial live in one Python process ([`server.py`](../src/server.py)), which this crate
//! starts, asks and ends. Numbers pass through memory that both share, and one byte each way says that they are
//! there; environments that are stepped together are asked together. An agent has a process of the same server.
//!
//! What determines numbers is in a trial's id: the text of a person's own files, and that of a lock file, against
//! which the installed packages are held whenever Python starts. Which Python runs it is not.

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

/// How an environment of a package is called there, for programs that make it themselves.
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
        contract::AgentTraits {
            learns: true,
            datasets: contract::UseOfDatasets::Also,
            by_config: Some(agent_config::said_of),
            ..contract::AgentTraits::default()
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
