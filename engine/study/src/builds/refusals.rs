//! Errors and warnings on parts that cannot be built or used together, at their places in the study.

use super::Builder;
use crate::{config::locate, fit, part::ResolvedPart, written::Target};
use contract::{Error, Feed, Interface, recorder::MOST_METRICS, registry::AgentEntry};
use document::diagnostic::Diagnostic;

impl Builder<'_> {
    /// A refusal, placed at the key that the plugin names if the study gives that key.
    pub(super) fn refused(&self, resolved: &ResolvedPart, error: &Error) -> Diagnostic {
        let (sections, target) = (self.sections, resolved.given.target);
        let plugin = sections.plugin(target);
        let (at, plugin_span) = plugin.map_or_else(Default::default, |plugin| (plugin.at, plugin.span));
        match error {
            Error::Unavailable { key, problem } => {
                let given = locate(&sections.assigned(&resolved.given), key);
                let (span, at) = (given.unwrap_or(plugin_span), format!("{at}.{key}"));
                let error = sections.sources.error(span, &at, problem.clone());
                error.as_unavailable()
            }
            Error::Config { key, problem } => {
                let given = locate(&sections.assigned(&resolved.given), key);
                let span = given.unwrap_or(plugin_span);
                let error =
                    sections
                        .sources
                        .error(span, &format!("{at}.{key}"), format!("`{key}`: {problem}"));
                let default = resolved
                    .part
                    .config
                    .pointer(&format!("/{}", key.replace('.', "/")));
                match default.filter(|_| given.is_none()) {
                    Some(value) => error.help(format!("`{key}` is not given here; its value is {value}")),
                    None => error,
                }
            }
            Error::Mismatch { problem, .. } => {
                let named = sections.written.part(target).map_or("", |named| &named.name);
                let what = if matches!(target, Target::Agent(_)) {
                    "agent"
                } else {
                    "part"
                };
                sections.sources.error(
                    plugin_span,
                    &at,
                    format!("the {what} `{named}` cannot be used here: {problem}"),
                )
            }
            other => sections.sources.error(plugin_span, &at, other.to_string()),
        }
    }

    pub(super) fn records_too_much(&self, environment: &ResolvedPart, metrics: usize) -> Diagnostic {
        let named = self.sections.written.part(environment.given.target);
        let (name, span) = named.map_or_else(Default::default, |it| (it.name.as_str(), it.name_span));
        let message = format!(
            "a trial of `{name}` records {metrics} metrics, but at most {MOST_METRICS} are told apart"
        );
        let error = self
            .sections
            .sources
            .error(span, &format!("environments.{name}"), message);
        error.help("make the environment smaller: its metrics follow from its size")
    }

    /// The agents that fit the interface of an environment, in words.
    pub(super) fn fitting(&self, interface: &Interface) -> String {
        let fitting = fit::agents(self.sections.registry, interface);
        let named = |names: Vec<String>, what: &str| {
            let names: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
            (!names.is_empty()).then(|| format!("{what}: {}", names.join(", ")))
        };
        let of = [
            named(fitting.learners, "agents that fit and learn"),
            named(fitting.rules, "agents that fit and do not learn"),
        ];
        let of: Vec<String> = of.into_iter().flatten().collect();
        if of.is_empty() {
            return "no agent with its default settings fits this environment".into();
        }
        of.join("; ")
    }

    pub(super) fn learns_nothing(&self, agent: &ResolvedPart, learns_after: u64, steps: u64) -> Diagnostic {
        let named = self.sections.written.part(agent.given.target);
        let (name, span) =
            named.map_or_else(Default::default, |named| (named.name.as_str(), named.name_span));
        let (why, instead) = match learns_after {
            u64::MAX => (
                "it never learns with these settings".to_owned(),
                "let it update, or ",
            ),
            _ => {
                let why = format!(
                    "it learns from step {learns_after} on, and the protocol ends after {steps} steps"
                );
                (
                    why,
                    "give the protocol more steps, let the agent learn from an earlier one, or ",
                )
            }
        };
        let message = format!("`{name}` makes no update: {why}");
        let help = format!("{instead}call its results those of an agent that was not trained");
        self.sections
            .sources
            .warning(span, &format!("agents.{name}"), message)
            .help(help)
    }

    /// The error of an agent that learns from another feed than that of its protocol.
    pub(super) fn learns_otherwise(
        &self,
        agent: &ResolvedPart,
        entry: &AgentEntry,
        (protocol, given): (&str, Feed),
    ) -> Diagnostic {
        let (sections, target) = (self.sections, agent.given.target);
        let (at, span) = sections
            .plugin(target)
            .map_or_else(Default::default, |plugin| (plugin.at, plugin.span));
        let named = sections.written.part(target).map_or("", |named| &named.name);
        let taken = entry.traits.learns_from.first().copied();
        let (why, help) = match (taken.unwrap_or(Feed::Decisions), given) {
            _ if entry.traits.trains_itself => (
                format!("by itself; `{protocol}` trains agents, or measures them"),
                "the protocol `train_evaluate` lets it train, and takes in what it measures".into(),
            ),
            (Feed::Decisions, Feed::Examples) => (
                format!("from its decisions and their rewards; `{protocol}` gives examples alone"),
                self.decisions_or(given),
            ),
            (Feed::Decisions, _) => (
                format!("from its own decisions; `{protocol}` gives those of others"),
                self.decisions_or(given),
            ),
            (Feed::Examples, _) => (
                format!("from examples; `{protocol}` gives {}", given.name()),
                "the protocol `supervised_fit` gives it examples".into(),
            ),
            (Feed::Dataset, _) => (
                format!("from datasets; `{protocol}` gives none"),
                "the protocol `offline_fit` gives it what trials with the protocol `gather` left".into(),
            ),
            (Feed::Designs, _) => (
                format!("from whole designs that it proposes; `{protocol}` asks for none"),
                "the protocol `search` asks for one design after the other".into(),
            ),
        };
        sections
            .sources
            .error(span, &at, format!("the agent `{named}` learns {why}"))
            .help(help)
    }

    /// Advice to use an agent that learns from its own decisions, or one of the agents that learn from `given`.
    fn decisions_or(&self, given: Feed) -> String {
        let others = self
            .sections
            .registry
            .agents
            .iter()
            .filter(|(_, entry)| entry.traits.learns_from.contains(&given));
        let others: Vec<String> = others.map(|(name, _)| format!("`{name}`")).collect();
        let instead = if others.is_empty() {
            String::new()
        } else {
            format!("; agents that learn from {}: {}", given.name(), others.join(", "))
        };
        format!("the protocol `train_evaluate` gives it decisions{instead}")
    }
}
