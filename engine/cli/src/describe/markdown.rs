//! Subjects as pages of the reference.

use super::{
    AgentFacts, Channels, EnvironmentFacts, FitOptions, Group, Key, Notation, ProtocolFacts, SpaceFacts,
    Subject, names, subject,
    text::{article, as_yaml, channels, facts, in_words, metric},
};
use contract::{Preset, Registry};
use std::fmt::Write;

/// One generated page of the reference.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Page {
    /// The file's name, `environments.md`.
    pub file: String,
    /// The whole text.
    pub text: String,
}

/// One page for each group, in the order of the groups.
#[must_use]
pub fn pages(registry: &Registry) -> Vec<Page> {
    Group::ALL
        .into_iter()
        .map(|group| page(registry, group))
        .collect()
}

fn page(registry: &Registry, group: Group) -> Page {
    let mut out = Lines::default();
    let title = group.word();
    out.line(&format!("# {}{}", title[..1].to_uppercase(), &title[1..]));
    out.line("");
    out.line("<!-- Written by the program from the schemas that `check` reads; not to be edited. -->");
    out.line("");
    out.line(introduction(group));
    let asked = FitOptions {
        fits: true,
        why: false,
    };
    for name in names(registry, group) {
        if let Some(subject) = subject(registry, group, &name, asked) {
            out.subject(&subject);
        }
    }
    Page {
        file: format!("{title}.md"),
        text: out.0,
    }
}

/// The topic of a page, and the section of a study that uses its names.
fn introduction(group: Group) -> &'static str {
    match group {
        Group::Sections => {
            "The keys at the top of a study. `study`, `environments`, `agents` and `protocol` have to be there. \
             Examples are of a study with the agents `rule`, `other` and `learner`, of which the last learns, and the \
             environments `short`, `long` and `pair`."
        }
        Group::Environments => {
            "Simulated systems. A study names one under `environments`, with a name of its own: `plant: { NAME: { KEY: \
             VALUE } }`. Keys that are left out have their defaults. What is said of seats and agents holds for the \
             defaults."
        }
        Group::Agents => {
            "Algorithms, rules and reference controllers. A study names one under `agents`, with a name of its own: \
             `mine: { NAME: { KEY: VALUE } }`."
        }
        Group::Protocols => {
            "How a trial runs, from the first step to the final measurement. A study has one."
        }
        Group::Tables => {
            "A table of a study has a name and exactly one kind. What may stand beside the kind is said under \
             [tables](sections.md#tables)."
        }
        Group::Figures => {
            "A figure of a study has a name and exactly one kind. What may stand beside the kind is said under \
             [figures](sections.md#figures)."
        }
        Group::Samplers => "How the values of a swept key are made. See [sweeps](../sweeps.md).",
        Group::Relations => "What a claim says of its two sides. See [claims](../claims.md).",
        Group::Aggregates => {
            "How a trial's measurements become one number in a claim, as in `auc(learner.return)`. See \
             [claims](../claims.md)."
        }
        Group::Artifacts => "What a trial leaves for others. See [artifacts](../artifacts.md).",
        Group::Executors => {
            "What runs trials. The keys are those of the table of its name in `regimen.toml`. See \
             [executors](../executors.md)."
        }
    }
}

#[derive(Default)]
struct Lines(String);

impl Lines {
    fn line(&mut self, text: &str) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.0, "{}", text.trim_end());
    }

    /// Adds an empty line unless there is one.
    fn gap(&mut self) {
        if !self.0.ends_with("\n\n") {
            self.line("");
        }
    }

    fn item(&mut self, level: usize, text: &str) {
        self.line(&format!("{}- {text}", "  ".repeat(level)));
    }

    fn heading(&mut self, text: &str) {
        self.gap();
        self.line(text);
        self.line("");
    }

    fn code(&mut self, language: &str, text: &str) {
        self.line(&format!("```{language}"));
        self.line(text);
        self.line("```");
        self.line("");
    }

    fn subject(&mut self, subject: &Subject) {
        self.heading(&format!("## {}", prose(&subject.name)));
        let version = subject
            .version
            .map_or_else(String::new, |it| format!(" Version {it}."));
        self.line(&sentence(&subject.about, &version));
        self.line("");
        self.examples(&subject.examples);
        if !subject.grammar.is_empty() {
            self.code("text", subject.grammar);
        }
        subject.forms.iter().for_each(|form| self.claim_form(form));
        if let Some(value) = &subject.value {
            self.heading(&format!("Value: {}.", prose(&facts(value))));
            self.inside(0, value);
        }
        if !subject.choice.is_empty() {
            self.choice(subject);
        }
        if !subject.keys.is_empty() {
            self.heading("Keys:");
            subject.keys.iter().for_each(|key| self.key(0, key));
        }
        self.presets(&subject.presets);
        if !subject.metrics.is_empty() {
            self.heading("Records:");
        }
        subject
            .metrics
            .iter()
            .for_each(|it| self.item(0, &prose(&metric(it))));
        subject
            .environment
            .iter()
            .for_each(|facts| self.environment(facts));
        subject.agent.iter().for_each(|facts| self.agent(facts));
        subject.protocol.iter().for_each(|facts| self.protocol(facts));
    }

    fn examples(&mut self, examples: &[Notation]) {
        for example in examples {
            let comment = if example.written.is_empty() {
                String::new()
            } else {
                format!("# {}\n", example.written)
            };
            self.code("yaml", &format!("{comment}{}", example.example));
        }
    }

    fn choice(&mut self, subject: &Subject) {
        let page = match subject.name.as_str() {
            "protocol" => "protocols",
            name => name,
        };
        let links = subject
            .choice
            .iter()
            .map(|name| format!("[{name}]({page}.md#{name})"));
        self.heading(&format!(
            "May stand there: {}.",
            links.collect::<Vec<_>>().join(", ")
        ));
    }

    fn claim_form(&mut self, form: &Notation) {
        let example = if form.example.is_empty() {
            String::new()
        } else {
            format!(" `{}`", form.example)
        };
        self.item(0, &format!("`{}`: {}{example}", form.written, prose(&form.about)));
    }

    fn key(&mut self, level: usize, key: &Key) {
        let mut text = format!("**`{}`**: {}.", key.name, prose(&facts(key)));
        if !key.about.is_empty() {
            let _ = write!(text, " {}", prose(&key.about));
        }
        if !key.source.is_empty() {
            let _ = write!(text, " Source: {}.", prose(key.source.trim_end_matches('.')));
        }
        self.item(level, &text);
        self.inside(level + 1, key);
    }

    fn inside(&mut self, level: usize, key: &Key) {
        key.keys.iter().for_each(|key| self.key(level, key));
        key.forms.iter().for_each(|form| self.form(level, form));
        self.entries(level, key.entries.as_deref());
    }

    fn form(&mut self, level: usize, form: &Notation) {
        let about = prose(&form.about);
        let text = if about.is_empty() {
            prose(&form.written)
        } else {
            format!("{}: {about}", prose(&form.written))
        };
        self.item(level, &text);
        form.keys.iter().for_each(|key| self.key(level + 1, key));
        self.entries(level + 1, form.entries.as_deref());
    }

    fn entries(&mut self, level: usize, entries: Option<&Key>) {
        if let Some(entry) = entries {
            let about = prose(&entry.about);
            self.item(
                level,
                format!("each entry: {}. {about}", prose(&facts(entry))).trim_end(),
            );
            self.inside(level + 1, entry);
        }
    }

    fn presets(&mut self, presets: &[Preset]) {
        if !presets.is_empty() {
            self.heading("Presets, as in `preset: NAME`:");
        }
        for preset in presets {
            self.item(0, &format!("`{}`: {}", preset.name, prose(preset.about)));
            for (key, value) in preset.values.as_object().into_iter().flatten() {
                self.item(1, &format!("`{key}: {}`", as_yaml(value)));
            }
        }
    }

    fn environment(&mut self, facts: &EnvironmentFacts) {
        self.heading("Seats:");
        for seats in &facts.seats {
            let names = seats.names.join(", ");
            self.item(0, if names.is_empty() { "one" } else { &names });
            self.space("observes", &seats.observes);
            self.space("does", &seats.does);
        }
        self.channels("Traces, for trajectory figures and `rollout`:", &facts.traces);
        self.channels("Full state, which only agents that say so read:", &facts.state);
        if !facts.learners.is_empty() || !facts.rules.is_empty() {
            self.heading("Agents that fit:");
            self.linked("learn", "agents", &facts.learners);
            self.linked("do not learn", "agents", &facts.rules);
        }
    }

    fn channels(&mut self, heading: &str, list: &[Channels]) {
        if !list.is_empty() {
            self.heading(heading);
        }
        list.iter().for_each(|it| self.item(0, &prose(&channels(it))));
    }

    fn space(&mut self, verb: &str, space: &SpaceFacts) {
        self.item(1, &format!("{verb} {}", in_words(space)));
        space
            .channels
            .iter()
            .for_each(|it| self.item(2, &prose(&channels(it))));
        for options in &space.options {
            let among = options.among.join(", ");
            let choice = [options.choice.as_str(), among.as_str()]
                .into_iter()
                .filter(|it| !it.is_empty());
            self.item(2, &prose(&choice.collect::<Vec<_>>().join(": ")));
        }
    }

    fn agent(&mut self, facts: &AgentFacts) {
        self.heading("Use:");
        if facts.learns {
            self.linked("learns, with the protocols", "protocols", &facts.protocols);
        } else {
            self.item(0, "does not learn; protocols measure it alone");
        }
        if facts.reads_state {
            self.item(0, "reads the full state of the environment");
        }
        for takes in &facts.takes {
            self.item(
                0,
                &format!("takes {} at `{}`", article(&takes.artifact), takes.key),
            );
        }
        self.linked("leaves", "artifacts", &facts.leaves);
        self.linked("environments that it fits", "environments", &facts.environments);
    }

    fn protocol(&mut self, facts: &ProtocolFacts) {
        self.heading("Use:");
        self.item(0, &format!("gives agents that learn: {}", facts.gives));
        self.linked("leaves besides what the agent leaves", "artifacts", &facts.leaves);
    }

    fn linked(&mut self, what: &str, page: &str, names: &[String]) {
        if !names.is_empty() {
            let links = names.iter().map(|name| format!("[{name}]({page}.md#{name})"));
            self.item(0, &format!("{what}: {}", links.collect::<Vec<_>>().join(", ")));
        }
    }
}

fn sentence(about: &str, rest: &str) -> String {
    let about = prose(about);
    let mut letters = about.chars();
    let first = letters
        .next()
        .map(|letter| letter.to_uppercase().to_string())
        .unwrap_or_default();
    let end = if about.ends_with('.') || about.is_empty() {
        ""
    } else {
        "."
    };
    format!("{first}{}{end}{rest}", letters.as_str())
}

/// Prose in one line, with characters of Markdown's syntax escaped outside of code.
fn prose(text: &str) -> String {
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let parts = text.split('`').enumerate();
    let escaped = parts.map(|(index, part)| {
        if index % 2 == 1 {
            part.to_owned()
        } else {
            part.replace('\\', "\\\\")
                .replace('<', "&lt;")
                .replace('>', "&gt;")
                .replace('*', "\\*")
                .replace('[', "\\[")
        }
    });
    escaped.collect::<Vec<_>>().join("`")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_escaped_outside_of_code() {
        assert_eq!(
            prose("a * b\n of `x[1] * y` < [z]"),
            "a \\* b of `x[1] * y` &lt; \\[z]"
        );
        assert_eq!(
            sentence("share a load", " Version 2."),
            "Share a load. Version 2."
        );
    }
}
