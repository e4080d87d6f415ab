//! The study that `new` writes: one environment, an agent that learns beside a rule, a table, a claim and a learning
//! curve, every section with a comment. It passes `check` with each of its profiles.

mod budget;
mod error;
mod text;

pub use error::FirstStudyError;

use crate::describe::FitOptions;
use budget::{Budget, searching, training};
use contract::{
    Protocol, Registry,
    registry::{AgentEntry, ProtocolEntry},
};
use document::{
    diagnostic::{self, render},
    schema_check::{SLUG, mismatch},
};
use std::path::Path;
use study::{Options, fit};
use text::Pair;

/// An agent whose first update comes after more transitions is no first example.
const MOST_UNTRAINED: u64 = 1_000_000;

/// The text of a first study. Absent names are chosen: the registry's own pair if it fits, otherwise the first pair
/// that fits.
///
/// # Errors
/// A choice that does not exist or does not fit, with the choices that do.
pub fn write(
    registry: &Registry,
    name: &str,
    environment: Option<&str>,
    agent: Option<&str>,
) -> Result<String, FirstStudyError> {
    if mismatch(SLUG, name).is_some() {
        return Err(FirstStudyError::Name { name: name.into() });
    }
    known("environment", environment, registry.environments.keys())?;
    known("agent", agent, registry.agents.keys())?;
    let pair = choose(registry, environment, agent)?;
    let text = pair.text(name);
    for profile in [None, Some("smoke"), Some("paper")] {
        pair.check(registry, name, &text, profile)?;
    }
    Ok(text)
}

fn known<'a>(
    what: &'static str,
    name: Option<&str>,
    all: impl Iterator<Item = &'a &'static str>,
) -> Result<(), FirstStudyError> {
    let all: Vec<&str> = all.copied().collect();
    match name.filter(|name| !all.contains(name)) {
        None => Ok(()),
        Some(name) => Err(FirstStudyError::Unknown {
            what,
            name: name.into(),
            advice: in_python(name).unwrap_or_else(|| diagnostic::suggest(name, all)),
        }),
    }
}

/// The way to name a Python environment in a study; `None` if the name is not of that form.
fn in_python(name: &str) -> Option<String> {
    let made = name.contains(':') || name.contains(".py");
    made.then(|| {
        format!(
            "one in Python is written by hand: `environments: {{ task: {{ python: {{ make: \"{name}\", lock: {{ file: \
             requirements.txt }} }} }} }}`, and the page on environments in Python has a whole study"
        )
    })
}

fn choose<'a>(
    registry: &'a Registry,
    environment: Option<&'a str>,
    agent: Option<&'a str>,
) -> Result<Pair, FirstStudyError> {
    let own = registry.first_study.unzip();
    let environments = candidates(environment, own.0, registry.environments.keys());
    let agents = candidates(agent, own.1, registry.agents.keys());
    let mut problem = None;
    for environment in &environments {
        let place = EnvironmentFit::of(registry, environment);
        if agent.is_none() && place.fitting.learners.is_empty() {
            problem.get_or_insert(place.nobody("learns"));
        }
        for agent in agents.iter().filter(|name| place.is_worth_a_try(name, agent)) {
            match place.pair(agent) {
                Ok(pair) => return Ok(pair),
                Err(error) => drop(problem.get_or_insert(error)),
            }
        }
    }
    Err(problem.unwrap_or(FirstStudyError::Nobody {
        environment: environments.join(", "),
        lacking: "learns",
    }))
}

/// The requested name; without one, all names, the registry's own first.
fn candidates<'a>(
    asked: Option<&'a str>,
    own: Option<&'a str>,
    all: impl Iterator<Item = &'a &'static str>,
) -> Vec<&'a str> {
    let mut names: Vec<&str> = asked.or(own).into_iter().collect();
    for name in all {
        if asked.is_none() && own != Some(*name) {
            names.push(name);
        }
    }
    names
}

/// An environment with the agents that fit it.
struct EnvironmentFit<'a> {
    registry: &'a Registry,
    environment: &'a str,
    fitting: fit::Fitting,
}

impl<'a> EnvironmentFit<'a> {
    fn of(registry: &'a Registry, environment: &'a str) -> Self {
        let built = fit::environment(registry, environment);
        let fitting = built.map_or_else(fit::Fitting::default, |it| fit::agents(registry, &it.interface()));
        Self {
            registry,
            environment,
            fitting,
        }
    }

    /// Whether an agent is tried: every requested one, but otherwise only those that learn and fit.
    fn is_worth_a_try(&self, name: &str, asked: Option<&str>) -> bool {
        asked.is_some() || self.fitting.learners.iter().any(|it| it == name)
    }

    fn nobody(&self, lacking: &'static str) -> FirstStudyError {
        FirstStudyError::Nobody {
            environment: self.environment.into(),
            lacking,
        }
    }

    fn pair(&self, agent: &str) -> Result<Pair, FirstStudyError> {
        let entry = &self.registry.agents[agent];
        self.learns_here(agent, entry)?;
        let budget = self.budget(entry).ok_or_else(|| self.learns_otherwise(agent))?;
        Ok(Pair {
            environment: self.environment.into(),
            learner: agent.into(),
            rule: self.rule().ok_or_else(|| self.nobody("does not learn"))?,
            metrics: self.metrics(budget.protocol),
            budget,
        })
    }

    fn learns_here(&self, agent: &str, entry: &AgentEntry) -> Result<(), FirstStudyError> {
        if !entry.traits.learns() {
            return Err(FirstStudyError::DoesNotLearn {
                agent: agent.into(),
                fitting: self.fitting.learners.clone(),
            });
        }
        let Some(unfit) = self.fitting.unfit.iter().find(|it| it.name == agent) else {
            return Ok(());
        };
        let asked = FitOptions {
            fits: true,
            why: false,
        };
        let facts = crate::describe::subject(self.registry, crate::describe::Group::Agents, agent, asked);
        Err(FirstStudyError::DoesNotFit {
            agent: agent.into(),
            environment: self.environment.into(),
            problem: unfit.reason.clone(),
            fitting: self.fitting.learners.clone(),
            environments: facts
                .and_then(|it| it.agent)
                .map_or_else(Vec::new, |it| it.environments),
        })
    }

    fn learns_otherwise(&self, agent: &str) -> FirstStudyError {
        let budgeted = |name: &&String| self.budget(&self.registry.agents[name.as_str()]).is_some();
        FirstStudyError::LearnsOtherwise {
            agent: agent.into(),
            environment: self.environment.into(),
            fitting: self.fitting.learners.iter().filter(budgeted).cloned().collect(),
        }
    }

    /// The first agent that does not learn, and that decides from its current observations alone.
    fn rule(&self) -> Option<String> {
        let built = fit::environment(self.registry, self.environment)?;
        let face = built.interface();
        let is_plain = |name: &&String| {
            let entry = &self.registry.agents[name.as_str()];
            fit::agent(entry, &face).is_ok_and(|agent| !agent.reads_state() && !agent.remembers())
        };
        self.fitting.rules.iter().find(is_plain).cloned()
    }

    fn metrics(&self, protocol: &str) -> Vec<String> {
        let built = self.protocol(protocol).map(|it| it.metrics()).unwrap_or_default();
        let environment = fit::environment(self.registry, self.environment);
        let of_environment = environment.map_or_else(Vec::new, |it| it.metrics().to_vec());
        built
            .into_iter()
            .chain(of_environment)
            .map(|it| it.name)
            .collect()
    }

    fn protocol(&self, name: &str) -> Option<Box<dyn Protocol>> {
        let ProtocolEntry { about, build, .. } = self.registry.protocols.get(name)?;
        build(&about.defaults).ok()
    }

    /// The first protocol with a feed for the agent, long enough for updates.
    fn budget(&self, entry: &AgentEntry) -> Option<Budget> {
        let built = fit::environment(self.registry, self.environment)?;
        let learner = fit::agent(entry, &built.interface()).ok()?;
        let first_update = learner.updates().map_or(0, |updates| updates.first_after);
        [
            ("train_evaluate", training as fn(u64) -> Budget),
            ("search", searching),
        ]
        .into_iter()
        .filter(|(name, _)| {
            let protocol = self.protocol(name);
            protocol.is_some_and(|protocol| {
                protocol.accepts(&built.interface(), built.metrics()).is_ok()
                    && study::can_learn(entry, protocol)
            })
        })
        .map(|(_, budget)| budget(first_update))
        .find(|_| first_update < MOST_UNTRAINED)
    }
}

impl Pair {
    fn check(
        &self,
        registry: &Registry,
        name: &str,
        text: &str,
        profile: Option<&str>,
    ) -> Result<(), FirstStudyError> {
        let options = Options {
            profile: profile.map(Into::into),
            ..Options::default()
        };
        let study = study::load_text(text, &format!("{name}.yaml"), Path::new(""), registry, &options);
        study.map(drop).map_err(|found| FirstStudyError::Refused {
            agent: self.learner.clone(),
            environment: self.environment.clone(),
            found: render(&found, false),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::toys;

    /// Toy plugins with the engine's own protocols.
    fn toys() -> Registry {
        let mut registry = toys::toys();
        registry.protocols.clear();
        protocols::register(&mut registry);
        registry
    }

    #[test]
    fn what_is_written_passes_and_has_what_was_asked_for() {
        let text = write(&toys(), "first", Some("corridor"), Some("q_learning")).unwrap();
        for part in [
            "study: first\n",
            "plant: { corridor: {} }",
            "learner: { q_learning: {} }",
            "rule: { walker: {} }",
        ] {
            assert!(text.contains(part), "{part}:\n{text}");
        }
        assert_eq!(write(&toys(), "first", None, None).unwrap(), text);
        assert!(text.lines().all(|line| line.len() < 130), "{text}");
    }

    #[test]
    fn the_pair_of_the_registry_comes_first() {
        let all = ["a", "b", "c"];
        assert_eq!(candidates(None, Some("b"), all.iter()), ["b", "a", "c"]);
        assert_eq!(candidates(Some("c"), Some("b"), all.iter()), ["c"]);
        assert_eq!(candidates(None, None, all.iter()), all);
    }

    #[test]
    fn what_cannot_be_written_is_said_with_what_can() {
        let asked = |name, environment, agent| write(&toys(), name, environment, agent).unwrap_err();
        assert!(matches!(
            asked("Two words", None, None),
            FirstStudyError::Name { .. }
        ));
        let error = asked("a", Some("coridor"), None);
        assert!(error.to_string().contains("did you mean `corridor`?"), "{error}");
        let FirstStudyError::DoesNotLearn { agent, fitting } = asked("a", Some("corridor"), Some("walker"))
        else {
            panic!("another error")
        };
        assert_eq!(
            (agent.as_str(), fitting),
            ("walker", vec!["q_learning".to_owned()])
        );
    }
}
