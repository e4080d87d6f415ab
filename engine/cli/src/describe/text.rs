//! Subjects as text for a terminal.

use super::{
    AgentFacts, Channels, EnvironmentFacts, Group, Key, MetricFacts, Notation, ProtocolFacts, SpaceFacts,
    Subject, Unfit, interface::short, names,
};
use contract::{Preset, Registry};
use presentation::table::wrap;
use serde_json::Value;
use std::fmt::Write;

const WIDTH: usize = 110;

/// All names that can be described, by groups.
#[must_use]
pub fn overview(registry: &Registry) -> String {
    let mut out = Lines::default();
    out.line(
        0,
        "`regimen describe NAME` says what it is, its keys and how it is used. NAME is one of these:",
    );
    for group in Group::ALL {
        out.line(0, "");
        out.line(0, &format!("{} ({})", group.word(), group.one()));
        out.prose(1, &names(registry, group).join(", "));
    }
    out.0
}

/// Subjects one after the other.
#[must_use]
pub fn write(subjects: &[Subject]) -> String {
    let mut out = Lines::default();
    for (index, subject) in subjects.iter().enumerate() {
        if index > 0 {
            out.line(0, "");
        }
        out.subject(subject);
    }
    out.0
}

#[derive(Default)]
struct Lines(String);

impl Lines {
    fn line(&mut self, level: usize, text: &str) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.0, "{}", format!("{}{text}", "  ".repeat(level)).trim_end());
    }

    /// Paragraphs, each wrapped.
    fn prose(&mut self, level: usize, text: &str) {
        for paragraph in text.split("\n\n").filter(|it| !it.trim().is_empty()) {
            let wrapped = wrap(paragraph, WIDTH - 2 * level);
            wrapped.lines().for_each(|line| self.line(level, line));
        }
    }

    fn heading(&mut self, text: &str) {
        self.line(0, "");
        self.line(0, text);
    }

    fn subject(&mut self, subject: &Subject) {
        let version = subject
            .version
            .map_or_else(String::new, |it| format!(", version {it}"));
        self.line(0, &format!("{} ({}{version})", subject.name, subject.group.one()));
        self.prose(0, &subject.about);
        self.examples(&subject.examples);
        if !subject.grammar.is_empty() {
            self.heading("Grammar");
            subject.grammar.lines().for_each(|line| self.line(1, line));
        }
        if !subject.forms.is_empty() {
            self.heading("Forms");
            subject.forms.iter().for_each(|form| self.claim_form(form));
        }
        if let Some(value) = &subject.value {
            self.heading("Value");
            self.line(1, &facts(value));
            self.inside(1, value);
        }
        if !subject.choice.is_empty() {
            self.heading("May stand there, each described under its name");
            self.prose(1, &subject.choice.join(", "));
        }
        if has_keys(subject) {
            self.heading("Keys");
            if subject.keys.is_empty() {
                self.line(1, "none");
            }
            subject.keys.iter().for_each(|key| self.key(1, key));
        }
        self.presets(&subject.presets);
        self.metrics(&subject.metrics);
        subject
            .environment
            .iter()
            .for_each(|facts| self.environment(facts));
        subject.agent.iter().for_each(|facts| self.agent(facts));
        subject.protocol.iter().for_each(|facts| self.protocol(facts));
    }

    fn examples(&mut self, examples: &[Notation]) {
        if !examples.is_empty() {
            self.heading("In a study");
        }
        for example in examples {
            if !example.written.is_empty() {
                self.prose(1, &format!("# {}", example.written));
            }
            example.example.lines().for_each(|line| self.line(1, line));
        }
    }

    fn claim_form(&mut self, form: &Notation) {
        self.line(1, &form.written);
        self.prose(2, &form.about);
        if !form.example.is_empty() {
            self.line(2, &format!("- {}", form.example));
        }
    }

    fn key(&mut self, level: usize, key: &Key) {
        self.line(level, &format!("{}: {}", key.name, facts(key)));
        self.prose(level + 1, &key.about);
        if !key.source.is_empty() {
            self.prose(level + 1, &format!("source: {}", key.source));
        }
        self.inside(level, key);
    }

    fn inside(&mut self, level: usize, key: &Key) {
        key.keys.iter().for_each(|key| self.key(level + 1, key));
        key.forms.iter().for_each(|form| self.form(level + 1, form));
        self.entries(level + 1, key.entries.as_deref());
    }

    fn form(&mut self, level: usize, form: &Notation) {
        let about = form.about.split_whitespace().collect::<Vec<_>>().join(" ");
        let text = if about.is_empty() {
            format!("- {}", form.written)
        } else {
            format!("- {}: {about}", form.written)
        };
        self.prose(level, &text);
        form.keys.iter().for_each(|key| self.key(level + 1, key));
        self.entries(level + 1, form.entries.as_deref());
    }

    fn entries(&mut self, level: usize, entries: Option<&Key>) {
        if let Some(entry) = entries {
            self.line(level, &format!("each entry: {}", facts(entry)));
            self.prose(level + 1, &entry.about);
            self.inside(level, entry);
        }
    }

    fn presets(&mut self, presets: &[Preset]) {
        if !presets.is_empty() {
            self.heading("Presets, as in `preset: NAME`");
        }
        for preset in presets {
            self.line(1, &format!("{}: {}", preset.name, preset.about));
            for (key, value) in preset.values.as_object().into_iter().flatten() {
                self.prose(2, &format!("{key}: {}", as_yaml(value)));
            }
        }
    }

    fn metrics(&mut self, metrics: &[MetricFacts]) {
        if !metrics.is_empty() {
            self.heading("Records");
        }
        metrics.iter().for_each(|it| self.prose(1, &metric(it)));
    }

    fn environment(&mut self, facts: &EnvironmentFacts) {
        self.heading("Seats");
        for seats in &facts.seats {
            let names = seats.names.join(", ");
            let names = if names.is_empty() { "one" } else { &names };
            self.prose(1, names);
            self.space("observes", &seats.observes);
            self.space("does", &seats.does);
        }
        self.heading("Traces, for trajectory figures and `rollout`");
        facts.traces.iter().for_each(|it| self.line(1, &channels(it)));
        if !facts.state.is_empty() {
            self.heading("Full state, which only agents that say so read");
            facts.state.iter().for_each(|it| self.line(1, &channels(it)));
        }
        if !facts.learners.is_empty() || !facts.rules.is_empty() {
            self.heading("Agents that fit, with the defaults of both");
            self.named("learn", &facts.learners);
            self.named("do not learn", &facts.rules);
        }
        self.unfit("Agents that do not fit", &facts.unfit);
    }

    fn space(&mut self, verb: &str, space: &SpaceFacts) {
        self.line(2, &format!("{verb} {}", in_words(space)));
        space.channels.iter().for_each(|it| self.line(3, &channels(it)));
        for options in &space.options {
            let choice = if options.choice.is_empty() {
                String::new()
            } else {
                format!("{}: ", options.choice)
            };
            self.prose(3, &format!("{choice}{}", options.among.join(", ")));
        }
    }

    fn agent(&mut self, facts: &AgentFacts) {
        self.heading("Use");
        let learns = if facts.learns {
            "learns, with the protocols:"
        } else {
            "does not learn; protocols measure it alone"
        };
        self.prose(1, &format!("{learns} {}", facts.protocols.join(", ")));
        if facts.reads_state {
            self.line(1, "reads the full state of the environment");
        }
        for takes in &facts.takes {
            self.line(
                1,
                &format!("takes: {} at `{}`", article(&takes.artifact), takes.key),
            );
        }
        self.named("leaves", &facts.leaves);
        self.named(
            "environments that it fits, with the defaults of both",
            &facts.environments,
        );
        self.unfit("Environments that it does not fit", &facts.unfit);
    }

    fn protocol(&mut self, facts: &ProtocolFacts) {
        self.heading("Use");
        self.line(1, &format!("gives agents that learn: {}", facts.gives));
        self.named("leaves besides what the agent leaves", &facts.leaves);
    }

    fn named(&mut self, what: &str, names: &[String]) {
        if !names.is_empty() {
            self.prose(1, &format!("{what}: {}", names.join(", ")));
        }
    }

    fn unfit(&mut self, what: &str, unfit: &[Unfit]) {
        if !unfit.is_empty() {
            self.heading(what);
        }
        for Unfit { name, reason } in unfit {
            self.prose(1, &format!("{name}: {reason}"));
        }
    }
}

/// Whether a subject has keys in principle, even if it has none at present.
fn has_keys(subject: &Subject) -> bool {
    !subject.keys.is_empty() || subject.version.is_some() || subject.group == Group::Executors
}

pub(super) fn article(artifact: &str) -> String {
    match artifact {
        "networks" | "images" => artifact.into(),
        other => format!("a {other}"),
    }
}

pub(super) fn metric(metric: &MetricFacts) -> String {
    let unit = bracketed(&metric.unit);
    let better = if metric.better == "less" {
        "; less is better"
    } else {
        ""
    };
    format!("{}{unit}: {}{better}", metric.name, metric.about)
}

fn bracketed(unit: &str) -> String {
    if unit.is_empty() {
        String::new()
    } else {
        format!(" [{unit}]")
    }
}

/// Names, unit and limits of channels.
pub(super) fn channels(it: &Channels) -> String {
    let names = if it.count == 1 {
        it.first.clone()
    } else {
        format!("{} to {} ({})", it.first, it.last, it.count)
    };
    let limits = match (it.low.map(short), it.high.map(short)) {
        (Some(low), Some(high)) => format!(", from {low} to {high}"),
        (Some(low), None) => format!(", at least {low}"),
        (None, Some(high)) => format!(", at most {high}"),
        (None, None) => String::new(),
    };
    format!("{names}{}{limits}", bracketed(&it.unit))
}

pub(super) fn in_words(space: &SpaceFacts) -> String {
    let n = space.entries;
    match space.kind {
        "simplex" => format!("{n} shares that sum to 1"),
        "discrete" => "one option of".into(),
        "choices" => format!(
            "{} choices at once, by the largest of {n} numbers",
            space.options.len()
        ),
        _ if n == 1 => "1 number".into(),
        _ => format!("{n} numbers"),
    }
}

/// Type, range, unit and default in one line.
pub(super) fn facts(key: &Key) -> String {
    let range = [key.expected.as_str(), key.range.as_str()].join(" ");
    let unit = (!key.unit.is_empty()).then(|| format!("in {}", key.unit));
    [Some(range.trim().to_owned()), unit, default(key)]
        .into_iter()
        .flatten()
        .collect::<Vec<_>>()
        .join(", ")
}

fn default(key: &Key) -> Option<String> {
    match &key.default {
        _ if key.required => Some("required".into()),
        None => None,
        Some(Value::Null) => Some("default none".into()),
        Some(Value::Object(_)) if !key.keys.is_empty() => None,
        Some(Value::Object(map)) if map.is_empty() => None,
        Some(value) => Some(format!("default {}", as_yaml(value))),
    }
}

/// A value as a study writes it, in one line.
pub(super) fn as_yaml(value: &Value) -> String {
    match value {
        Value::Object(map) if map.is_empty() => "{}".into(),
        Value::Object(map) => {
            let entries = map
                .iter()
                .map(|(key, value)| format!("{key}: {}", as_yaml(value)));
            format!("{{ {} }}", entries.collect::<Vec<_>>().join(", "))
        }
        Value::Array(items) => {
            let items: Vec<String> = items.iter().map(as_yaml).collect();
            format!("[{}]", items.join(", "))
        }
        Value::String(text) if is_plain(text) => text.clone(),
        other => other.to_string(),
    }
}

/// True for a word that YAML reads as a text without quotes.
fn is_plain(text: &str) -> bool {
    text.starts_with(|first: char| first.is_ascii_alphabetic())
        && text
            .chars()
            .all(|letter| letter.is_ascii_alphanumeric() || letter == '_')
        && !["true", "false", "null", "yes", "no", "on", "off", "y", "n"]
            .contains(&text.to_lowercase().as_str())
}
