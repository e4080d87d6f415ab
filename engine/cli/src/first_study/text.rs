//! The text of a first study: the commented file `study.yaml`, with names and budgets for its `<words>`.

use super::budget::Budget;
use presentation::table::wrap;

/// The commented file.
const STUDY: &str = include_str!("study.yaml");

/// Parts of a first study.
pub(super) struct Pair {
    /// The environment.
    pub(super) environment: String,
    /// The agent that learns.
    pub(super) learner: String,
    /// The agent that does not.
    pub(super) rule: String,
    /// Metrics that the trials record.
    pub(super) metrics: Vec<String>,
    /// Duration of the trials.
    pub(super) budget: Budget,
}

impl Pair {
    /// The study, in YAML with comments.
    pub(super) fn text(&self, name: &str) -> String {
        let budget = &self.budget;
        let metrics = format!("Metrics of these trials: {}.", self.metrics.join(", "));
        let words = [
            ("<environment>", self.environment.clone()),
            ("<learner>", self.learner.clone()),
            ("<rule>", self.rule.clone()),
            ("<metrics>", wrap(&metrics, 108).replace('\n', "\n# ")),
            ("<protocol>", budget.protocol.to_owned()),
            ("<lines>", budget.lines.join("\n    ")),
            ("<seeds>", budget.seeds.to_string()),
            ("<smoke>", budget.smoke.clone()),
            ("<paper>", budget.paper.clone()),
            ("<file>", format!("{name}.yaml")),
            ("<name>", name.to_owned()),
        ];
        let fill = |text: String, (word, value): &(&str, String)| text.replace(word, value);
        words.iter().fold(STUDY.to_owned(), fill)
    }
}
