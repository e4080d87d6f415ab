//! Writes the study of a program as text.

use super::{
    ProgramDraft,
    metrics::FoundMetric,
    sweep::{Range, Search},
    written::{comment, plain, quoted, value, wrapped},
};
use crate::config::StepText;
use serde_json::Value;
use std::collections::BTreeMap;

/// Most metrics that are listed besides that of the study.
const MOST_METRICS: usize = 12;
/// Most options that are listed.
const MOST_OPTIONS: usize = 20;
/// Numbers of measurements in a training, the preferred ones first.
const MEASUREMENTS: [u64; 12] = [10, 8, 12, 5, 20, 16, 6, 15, 4, 7, 3, 2];

/// Writer of a study of a program.
pub(super) struct Text<'a>(pub(super) &'a ProgramDraft);

impl Text<'_> {
    /// The study, in YAML with comments.
    pub(super) fn study(&self, name: &str) -> String {
        [
            self.head(name),
            self.program(),
            self.settings(),
            self.how(),
            self.what(),
        ]
        .concat()
    }

    fn head(&self, name: &str) -> String {
        let Self(made) = self;
        let notes = match &made.notes[..] {
            [] => String::new(),
            notes => {
                let lines = notes.iter().map(|note| comment("", &format!("- {note}"), "  "));
                format!("#\n# Look at:\n{}", lines.collect::<String>())
            }
        };
        let from = comment("", &format!("Made from {}: {}", self.origin(), made.from), "  ");
        let task = made.command.task.as_ref().map_or(name, |(_, task)| task.as_str());
        format!(
            "{from}#\n#   regimen check {name}.yaml            nothing runs; it says which program `run` starts\n#   regimen run \
             {name}.yaml -P smoke     a short run: does all of it work?\n#   regimen run {name}.yaml              then open \
             results/{name}/index.html\n{notes}\nstudy: {name}\n\n# The task, which the program alone knows: its values are part \
             of what a trial is.\nenvironments:\n  task: {{ named: {{ id: {} }} }}\n\n",
            quoted(task)
        )
    }

    fn origin(&self) -> &'static str {
        self.0.sweep.what
    }

    fn program(&self) -> String {
        let Self(made) = self;
        let words: Vec<String> = made
            .command
            .words
            .iter()
            .map(|word| quoted(&word.written))
            .collect();
        let run = wrapped("      run: [", &words, "            ");
        let interpreter = match made.command.interpreter.as_str() {
            "" => String::new(),
            path => format!(
                "      # Of this machine, and no part of what a trial is.\n      interpreter: {}\n",
                quoted(path)
            ),
        };
        format!(
            "agents:\n  mine:\n    program:\n{}{run}{interpreter}{}{}{}{}{}",
            self.about_words(),
            self.parameters(),
            self.variables(),
            self.files(),
            self.reads(),
            self.metrics(),
        )
    }

    fn about_words(&self) -> String {
        let command = &self.0.command;
        let mut about = vec!["No shell reads these words.".to_owned()];
        if let Some(seed) = &command.seed {
            about.push(format!("`{seed}` is the seed of a trial."));
        }
        if let Some((steps, _)) = &command.steps {
            about.push(format!(
                "`{steps}` is how long it trains: `protocol.steps` below."
            ));
        }
        if let Some((task, _)) = &command.task {
            about.push(format!("`{task}` is the task: `id` above."));
        }
        comment("      ", &about.join(" "), "")
    }

    fn parameters(&self) -> String {
        let Self(made) = self;
        let lines: Vec<String> = made
            .command
            .parameters
            .iter()
            .map(|it| format!("        {}: {}\n", quoted(&it.name), value(&it.value)))
            .collect();
        let mut text = match lines.is_empty() {
            true => String::new(),
            false => {
                let about =
                    "Values that a sweep, a search, a profile and `--set` may change, as `mine.NAME`.";
                format!("      # {about}\n      parameters:\n{}", lines.concat())
            }
        };
        let option = |it: &super::HelpOption| match &it.default {
            Some(default) => format!("{} ({default})", it.name()),
            None => it.name().to_owned(),
        };
        let others: Vec<String> = made.others.iter().take(MOST_OPTIONS).map(option).collect();
        if !others.is_empty() {
            let more = if made.others.len() > MOST_OPTIONS {
                ", …"
            } else {
                ""
            };
            let others = format!(
                "Options that stay with their defaults: {}{more}.",
                others.join(", ")
            );
            text += &comment("      ", &others, "");
        }
        text
    }

    fn variables(&self) -> String {
        let entry = |(name, value): (&String, &String)| format!("{}: {}", quoted(name), quoted(value));
        let entries: Vec<String> = self.0.variables.iter().map(entry).collect();
        match entries.is_empty() {
            true => String::new(),
            false => format!(
                "      # Of the program's environment; no sweep changes them.\n      variables: {{ {} }}\n",
                entries.join(", ")
            ),
        }
    }

    fn files(&self) -> String {
        let Self(made) = self;
        let names: Vec<String> = made.sources.iter().map(|name| quoted(name)).collect();
        let sources = match names.is_empty() {
            true => "      # No file of this folder is part of the program.\n".to_owned(),
            false => {
                let about = "The files of the program: their content is part of what a trial is, and no other file lies \
                             beside it when it runs. Found by what it imports and names.";
                comment("      ", about, "") + &wrapped("      sources: [", &names, "                ")
            }
        };
        let lock = match made.lock {
            Some(name) => format!("      lock: {{ file: {} }}\n", quoted(name)),
            None => "      # For packages write their lock file, as `lock: { file: uv.lock }`.\n      lock: none\n".into(),
        };
        sources + &lock
    }

    fn reads(&self) -> String {
        let Some(first) = self.0.seen.first() else {
            return String::new();
        };
        format!("      reads: {}\n", place(first))
    }

    fn metrics(&self) -> String {
        let Self(made) = self;
        let Some(first) = made.seen.first() else {
            return String::new();
        };
        let entry = |name: &str, seen: &FoundMetric| {
            let is_same = seen.from == first.from && seen.step == first.step;
            match is_same {
                true => format!("{name}: {}", quoted(&seen.key)),
                false => format!("{name}: {{ key: {}, {}", quoted(&seen.key), &place(seen)[2..]),
            }
        };
        let name = self.metric();
        let mut text = format!("      metrics:\n        {}\n", entry(&name, first));
        let others: Vec<&FoundMetric> = made.seen.iter().skip(1).take(MOST_METRICS).collect();
        if !others.is_empty() {
            text += "        # What it wrote besides; a metric has to have a value in every trial.\n";
        }
        let mut names = BTreeMap::from([(name.clone(), 1)]);
        for seen in others {
            let count = names.entry(plain(&seen.key)).or_insert(0);
            *count += 1;
            let name = match *count {
                1 => plain(&seen.key),
                count => format!("{}_{count}", plain(&seen.key)),
            };
            text += &format!("        # {}\n", entry(&name, seen));
        }
        if self.lower_is_better() {
            text += &format!("      shown: {{ {name}: {{ lower_is_better: true }} }}\n");
        }
        text + "\n"
    }

    fn lower_is_better(&self) -> bool {
        let seen = self.0.seen.first().is_some_and(FoundMetric::lower_is_better);
        self.0.sweep.lower_is_better.unwrap_or(seen)
    }

    /// Name of the metric that tables show.
    fn metric(&self) -> String {
        let key = self.0.seen.first().map_or("return", |seen| seen.key.as_str());
        plain(key)
    }

    /// The section `sweep` or `search`.
    fn settings(&self) -> String {
        let sweep = &self.0.sweep;
        let name = |option: &String| {
            let mut parameters = self.0.command.parameters.iter();
            parameters
                .find(|it| it.option == *option)
                .map(|it| it.name.clone())
        };
        let keys = sweep
            .swept
            .iter()
            .filter_map(|(option, range)| Some((name(option)?, range)));
        let keys: Vec<(String, &Range)> = keys.collect();
        match &sweep.search {
            _ if keys.is_empty() => String::new(),
            None => {
                let line = |(name, range): &(String, &Range)| {
                    format!("  {}: {{ grid: {} }}\n", key(name), listed(range))
                };
                let lines: String = keys.iter().map(line).collect();
                format!("# Every value with every other one.\nsweep:\n{lines}\n")
            }
            Some(search) => self.search(search, &keys),
        }
    }

    fn search(&self, search: &Search, keys: &[(String, &Range)]) -> String {
        let line = |(name, range): &(String, &Range)| {
            let range = match range {
                Range::List(_) => format!("choice: {}", listed(range)),
                Range::Uniform(low, high) => format!("uniform: {}", limits(*low, *high)),
                Range::LogUniform(low, high) => format!("log_uniform: {}", limits(*low, *high)),
            };
            format!("      {}: {{ {range} }}\n", key(name))
        };
        let lines: String = keys.iter().map(line).collect();
        let direction = if self.lower_is_better() {
            "    direction: minimize\n"
        } else {
            ""
        };
        let (settings, method) = (self.0.sweep.settings, search.method);
        format!(
            "# The best setting is measured on the seeds of the study, which the search has not seen.\ntune:\n  tuned:\n    \
             over:\n{lines}    metric: {}\n{direction}    settings: {settings}\n    method: {method}\n\n",
            self.metric()
        )
    }

    fn how(&self) -> String {
        let Self(made) = self;
        let (length, seeds) = (made.length, made.sweep.seeds.unwrap_or(3));
        let every = every_of(length.steps);
        let mut smoke = Vec::new();
        if length.smoke != length.steps {
            smoke.push(format!(
                "protocol.steps: {}, protocol.evaluate_every: {}",
                length.smoke,
                every_of(length.smoke)
            ));
        }
        if seeds > 2 {
            smoke.push("seeds: 2".into());
        }
        if made.sweep.search.is_some() {
            smoke.push(format!("tune.tuned.settings: {}", made.sweep.settings.min(4)));
        }
        if smoke.is_empty() {
            smoke.push(format!("protocol.steps: {}", length.smoke));
        }
        format!(
            "# How long a trial is, and how often a point of its curve is taken.\nprotocol: {{ train_evaluate: {{ steps: {}, \
             evaluate_every: {every} }} }}\n\n# Replicates; intervals are over them.\nseeds: {seeds}\n\nprofiles:\n  smoke: {{ {} \
             }}\n\n",
            length.steps,
            smoke.join(", ")
        )
    }

    fn what(&self) -> String {
        let metric = self.metric();
        let sweep = &self.0.sweep;
        let is_grid = sweep.search.is_none() && !sweep.swept.is_empty();
        let rows = if is_grid { "setting" } else { "agent" };
        format!(
            "tables:\n  final: {{ comparison: {{ rows: {rows}, value: {metric} }} }}\n\nfigures:\n  curve: {{ learning_curve: {{ \
             metric: {metric} }} }}\n\n# What the results are to support or refute, once there are two settings or two \
             programs:\n# claims:\n#   - {{ claim: mine.{metric} > other.{metric}, why: any difference counts }}\n"
        )
    }
}

/// Steps between two measurements.
fn every_of(steps: u64) -> u64 {
    let n = MEASUREMENTS.into_iter().find(|n| steps.is_multiple_of(*n));
    (steps / n.unwrap_or(1)).max(1)
}

fn key(name: &str) -> String {
    quoted(&format!("mine.{name}"))
}

fn listed(range: &Range) -> String {
    match range {
        Range::List(values) => format!("[{}]", values.iter().map(value).collect::<Vec<_>>().join(", ")),
        _ => "[]".into(),
    }
}

fn limits(low: f64, high: f64) -> String {
    format!("{{ low: {}, high: {} }}", Value::from(low), Value::from(high))
}

/// Source of a metric, as in `reads`.
fn place(seen: &FoundMetric) -> String {
    let step = match &seen.step {
        Some(StepText::Column(name)) => format!(", step: {}", quoted(name)),
        Some(StepText::Sum(of)) => format!(", step: {{ sum: {} }}", quoted(&of.sum)),
        None => String::new(),
    };
    format!("{{ from: {}{step} }}", quoted(&seen.from))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_a_curve_divide_the_steps() {
        assert_eq!(
            (every_of(500_000), every_of(81), every_of(13), every_of(1)),
            (50_000, 27, 13, 1)
        );
    }
}
