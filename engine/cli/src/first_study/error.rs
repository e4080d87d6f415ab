//! The reasons why no first study can be written, with alternatives.

/// The reason why no study is written.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FirstStudyError {
    /// The name of the study cannot be the name of a file and of a folder.
    #[error(
        "`{name}` cannot name a study: write small letters, digits, `.`, `_` and `-`, as in `first-look`"
    )]
    Name {
        /// The name as it was written.
        name: String,
    },
    /// There is no environment or agent of this name.
    #[error("there is no {what} `{name}`; {advice}")]
    Unknown {
        /// `environment` or `agent`.
        what: &'static str,
        /// The name as it was written.
        name: String,
        /// The names that exist.
        advice: String,
    },
    /// The agent does not learn, but a first study shows an agent that learns.
    #[error(
        "the agent `{agent}` does not learn; agents that learn and fit here: {}",
        listed(fitting)
    )]
    DoesNotLearn {
        /// The agent.
        agent: String,
        /// Agents that learn and fit.
        fitting: Vec<String>,
    },
    /// The agent cannot be used in the environment.
    #[error(
        "the agent `{agent}` does not fit the environment `{environment}`: {problem}; agents that learn and fit \
         `{environment}`: {}; environments that `{agent}` fits: {}",
        listed(fitting),
        listed(environments)
    )]
    DoesNotFit {
        /// The agent.
        agent: String,
        /// The environment.
        environment: String,
        /// The property that the agent needs.
        problem: String,
        /// Agents that learn and fit the environment.
        fitting: Vec<String>,
        /// Environments that the agent fits.
        environments: Vec<String>,
    },
    /// No protocol lets the agent learn without parts that a first study does not have.
    #[error(
        "no first study is made of `{agent}` in `{environment}`: it learns neither from its own decisions nor by \
         proposing designs there; agents that do: {}",
        listed(fitting)
    )]
    LearnsOtherwise {
        /// The agent.
        agent: String,
        /// The environment.
        environment: String,
        /// Agents with which a first study is possible.
        fitting: Vec<String>,
    },
    /// No agent that learns, or none that does not learn, fits the environment.
    #[error("no first study is made of `{environment}`: no agent that {lacking} fits it with its defaults")]
    Nobody {
        /// The environment.
        environment: String,
        /// The missing kind of agent.
        lacking: &'static str,
    },
    /// The study does not pass `check`.
    #[error("the study of `{agent}` in `{environment}` does not pass `check`:\n{found}")]
    Refused {
        /// The agent.
        agent: String,
        /// The environment.
        environment: String,
        /// The errors of `check`.
        found: String,
    },
}

fn listed(names: &[String]) -> String {
    if names.is_empty() {
        return "none".into();
    }
    let quoted = names.iter().map(|name| format!("`{name}`"));
    quoted.collect::<Vec<_>>().join(", ")
}
