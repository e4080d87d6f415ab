//! The text of a first study.

use super::budget::Budget;
use presentation::table::wrap;

/// What a first study is made of.
pub(super) struct Pair {
    /// The environment.
    pub(super) environment: String,
    /// The agent that learns.
    pub(super) learner: String,
    /// The agent that does not.
    pub(super) rule: String,
    /// What their trials record.
    pub(super) metrics: Vec<String>,
    /// How long they run.
    pub(super) budget: Budget,
}

impl Pair {
    /// The study, in YAML with comments.
    pub(super) fn text(&self, name: &str) -> String {
        [self.who(name), self.how(), self.what()].concat()
    }

    /// What is studied: environments and agents.
    fn who(&self, name: &str) -> String {
        let Self {
            environment,
            learner,
            rule,
            ..
        } = self;
        let commands = commands(name);
        format!(
            "\
# What {learner} learns in {environment}, beside {rule}, which does not learn.
#
{commands}
study: {name}
title: What {learner} learns in {environment}

# Simulated systems, under names of your own. `regimen describe {environment}` says what may stand between the
# inner braces; a second line here is a second environment in every table.
environments:
  plant: {{ {environment}: {{}} }}

# Who acts. `regimen describe {learner}` says what can be set; `regimen describe {environment}` says who else fits.
agents:
  learner: {{ {learner}: {{}} }}
  rule: {{ {rule}: {{}} }}

"
        )
    }

    /// How trials run, how often and for how long.
    fn how(&self) -> String {
        let Budget {
            protocol,
            lines,
            smoke,
            paper,
            seeds,
        } = &self.budget;
        let lines = lines.join("\n    ");
        format!(
            "\
# How each trial runs. Agents that do not learn are measured at the same steps.
protocol:
  {protocol}:
    {lines}

# Replicates. Intervals are over seeds; a design, as in `seeds: {{ min: 5, max: 30, looks: 6 }}`, adds them until
# everything judged is decided.
seeds: {seeds}

# Named budgets, chosen by `-P NAME`: values that replace those above. A key is a dotted path; that of an agent or
# environment begins with its name here.
profiles:
  smoke: {{ {smoke} }}
  paper: {{ {paper} }}

"
        )
    }

    /// What is shown of them: a table, a claim, a figure.
    fn what(&self) -> String {
        let Self {
            learner,
            rule,
            metrics,
            ..
        } = self;
        let metrics =
            wrap(&format!("Metrics of these trials: {}.", metrics.join(", ")), 108).replace('\n', "\n# ");
        format!(
            "\
# {metrics}
tables:
  final:
    caption: Return of the final measurement
    comparison: {{ rows: agent, value: return }}

# What the results are to support or refute: SUPPORTED, REFUTED or INCONCLUSIVE, by an interval over seeds.
claims:
  - learner.return > rule.return

figures:
  learning-curve:
    caption: Return during learning
    learning_curve: {{ metric: return }}
    labels: {{ learner: {learner}, rule: {rule} }}
"
        )
    }
}

/// The commands that a study is for, a line of a comment each.
fn commands(name: &str) -> String {
    let of_study = |command: &str| command.replace("NAME", &format!("{name}.yaml"));
    let lines = [
        (
            of_study("regimen check NAME"),
            "nothing runs; every name, key and range is looked at".to_owned(),
        ),
        (
            of_study("regimen plan NAME"),
            "which trials there are, and how long they take".to_owned(),
        ),
        (
            of_study("regimen run NAME -P smoke"),
            "a short run: does all of it work?".to_owned(),
        ),
        (
            of_study("regimen run NAME"),
            format!("then open results/{name}/index.html"),
        ),
        (
            of_study("regimen run NAME -P paper"),
            "longer, and with more seeds".to_owned(),
        ),
        (
            "regimen describe".to_owned(),
            "what else can be written here".to_owned(),
        ),
    ];
    let line = |(words, about): &(String, String)| format!("#   {words:<w$}  {about}", w = name.len() + 27);
    lines.iter().map(line).collect::<Vec<_>>().join("\n")
}
