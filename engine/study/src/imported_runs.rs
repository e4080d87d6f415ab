//! The section `imported`: runs of other programs, which are shown beside the study's own agents.

use super::{checked_sections::Sections, relative_path::name_written_out, sections::Parts, seeds::SeedPlan};
use analysis::results::Origin;
use contract::Metric;
use document::{
    Entry, Node,
    diagnostic::{Diagnostic, Span, suggest},
    reach::{Outside, Reach},
};
use imported::{FIRST_SEED, Imported, ImportedText, PatternError, RunCollection, matching, read};
use presentation::vocabulary::Vocabulary;
use serde_json::{Value, json};
use std::{
    path::{Path, PathBuf},
    slice,
};

/// Reads the section and adds the metrics of the runs for tables, figures and claims.
pub(super) fn resolve(
    root: &Node,
    sections: &Sections<'_>,
    plan: &SeedPlan,
    vocabulary: &mut Vocabulary,
) -> Result<Vec<Imported>, Vec<Diagnostic>> {
    let Some(section) = root.entry("imported") else {
        return Ok(Vec::new());
    };
    let mut reader = ImportReader {
        sections,
        vocabulary,
        found: Vec::new(),
    };
    reader.seeds(section, plan);
    let entries = section.value.entries().iter().zip(0..);
    let read: Vec<Imported> = entries
        .filter_map(|(entry, block)| reader.entry(sections.text.imported.get(&entry.key)?, entry, block))
        .collect();
    if reader.found.is_empty() {
        Ok(read)
    } else {
        Err(reader.found)
    }
}

struct ImportReader<'a> {
    sections: &'a Sections<'a>,
    vocabulary: &'a mut Vocabulary,
    found: Vec<Diagnostic>,
}

impl ImportReader<'_> {
    fn say(&mut self, span: Span, at: &str, message: impl Into<String>, help: impl Into<String>) {
        let (error, help) = (self.sections.sources.error(span, at, message), help.into());
        self.found
            .push(if help.is_empty() { error } else { error.help(help) });
    }

    /// Refuses seeds that do not fit imported runs: their number is fixed, and their seeds are above all seeds of the
    /// study.
    fn seeds(&mut self, section: &Entry, plan: &SeedPlan) {
        if plan.design.is_some() {
            let message = "seeds of this study are added look by look, and runs of others cannot be";
            self.say(
                section.key_span,
                "imported",
                message,
                "write a fixed number of `seeds`",
            );
        }
        if let Some(seed) = plan.seeds.iter().find(|seed| **seed >= FIRST_SEED) {
            let message =
                format!("seeds from {FIRST_SEED} on stand for imported runs, and this study has {seed}");
            self.say(section.key_span, "imported", message, "use smaller seeds");
        }
    }

    /// Reads an entry of one or several parts.
    fn entry(&mut self, parts: &Parts, entry: &Entry, block: u64) -> Option<Imported> {
        let at = format!("imported.{}", entry.key);
        if self.is_taken(&entry.key) {
            let message = format!("`{}` names something else in this study, too", entry.key);
            self.say(
                entry.key_span,
                &at,
                message,
                "rename one of the two: tables and claims speak of them by name",
            );
            return None;
        }
        let agent = self.vocabulary.agents.len();
        self.vocabulary.agents.push(entry.key.clone());
        let (parts, nodes) = match parts {
            Parts::One(part) => (slice::from_ref(&**part), slice::from_ref(&entry.value)),
            Parts::Several(parts) => (&parts[..], entry.value.items()),
        };
        let mut whole = Imported {
            origin: Origin {
                name: entry.key.clone(),
                ..Origin::default()
            },
            trials: Vec::new(),
        };
        let (mut words, before) = (Vec::new(), self.found.len());
        for (place, (text, node)) in parts.iter().zip(nodes).enumerate() {
            let at = if parts.len() > 1 {
                format!("{at}[{place}]")
            } else {
                at.clone()
            };
            let Some(found) = self.part(text, (node, entry, &at), (agent, block), &mut whole) else {
                continue;
            };
            words.push(self.seen_from_folder(&sentence(text, &found)));
            let seen_from = |path: &Path| {
                path.strip_prefix(self.sections.folder)
                    .unwrap_or(path)
                    .display()
                    .to_string()
            };
            whole.origin.files.extend(
                found
                    .files
                    .into_iter()
                    .map(|(path, digest)| (seen_from(&path), digest)),
            );
        }
        whole.origin.sentence = format!(
            "{} is imported and was not run here: {}.",
            entry.key,
            words.join("; ")
        );
        (self.found.len() == before).then_some(whole)
    }

    /// A sentence with its files named relative to the study's folder.
    fn seen_from_folder(&self, sentence: &str) -> String {
        let folder = self.sections.folder.display().to_string();
        let plain = sentence.replace('`', "");
        match folder.as_str() {
            "" => plain,
            folder => plain.replace(&format!("{}/", folder.trim_end_matches('/')), ""),
        }
    }

    fn is_taken(&self, name: &str) -> bool {
        let written = self.sections.written;
        let prepared = written.prepared.iter().map(|entry| entry.name.as_str());
        let plays = written.plays.iter().map(|play| play.name.as_str());
        let own = self
            .vocabulary
            .agents
            .iter()
            .chain(&self.vocabulary.environments)
            .map(String::as_str);
        own.chain(prepared).chain(plays).any(|other| other == name)
    }

    /// Reads the runs in one environment.
    fn part(
        &mut self,
        text: &ImportedText,
        (node, entry, at): (&Node, &Entry, &str),
        (agent, block): (usize, u64),
        whole: &mut Imported,
    ) -> Option<RunCollection> {
        let environment = self.environment(text, node, entry, at)?;
        if self.vocabulary.recorded.contains_key(&(environment, agent)) {
            let message = format!(
                "`{}` has runs in `{}` already",
                entry.key, self.vocabulary.environments[environment]
            );
            self.say(
                node.span,
                at,
                message,
                "name all files of an environment under one `from`, and several columns as a list or a pattern under `metrics`",
            );
            return None;
        }
        let files = self.files(text, node, at)?;
        let mapping = text.mapping();
        let name = self.vocabulary.environments[environment].clone();
        let read = read(&files, &mapping).map_err(|error| error.to_string());
        let trials = read.and_then(|found| Ok((found.trials(&entry.key, &name, block, &mapping)?, found)));
        let (trials, found) = match trials {
            Ok(trials) => trials,
            Err(problem) => {
                self.say(span_of(node, "from"), &format!("{at}.from"), problem, "");
                return None;
            }
        };
        whole.trials.extend(trials);
        let recorded = self.vocabulary.recorded.entry((environment, agent)).or_default();
        recorded.extend(text.metrics.keys().cloned());
        for metric in text.metrics.keys() {
            if !self.vocabulary.metrics.iter().any(|known| known.name == *metric) {
                self.vocabulary
                    .metrics
                    .push(Metric::new(metric, "", "recorded by imported runs"));
            }
        }
        Some(found)
    }

    fn environment(&mut self, text: &ImportedText, node: &Node, entry: &Entry, at: &str) -> Option<usize> {
        let known = self.vocabulary.environments.clone();
        let Some(name) = &text.environment else {
            if known.len() == 1 {
                return Some(0);
            }
            let message = "it does not say which environment of the study the runs are of";
            self.say(
                entry.key_span,
                at,
                message,
                format!("write `environment:` and one of {}", known.join(", ")),
            );
            return None;
        };
        let place = known.iter().position(|other| other == name);
        if place.is_none() {
            let help = suggest(name, known.iter().map(String::as_str));
            let at = format!("{at}.environment");
            self.say(
                span_of(node, "environment"),
                &at,
                format!("no environment is named `{name}`"),
                help,
            );
        }
        place
    }

    fn files(&mut self, text: &ImportedText, node: &Node, at: &str) -> Option<Vec<PathBuf>> {
        let (span, at) = (span_of(node, "from"), format!("{at}.from"));
        let mut files: Vec<PathBuf> = Vec::new();
        let reach = Reach::of(self.sections.folder);
        for pattern in text.from.all() {
            match matching(&reach, self.sections.folder, pattern) {
                Ok(found) if found.is_empty() => {
                    let message = format!(
                        "there is no file `{}`",
                        self.sections.folder.join(pattern).display()
                    );
                    self.say(span, &at, message, "name files as seen from the study's folder");
                    return None;
                }
                Ok(found) => files.extend(found),
                Err(error) => {
                    let help = if matches!(error, PatternError::Outside(_)) {
                        Outside::HELP
                    } else {
                        ""
                    };
                    self.say(span, &at, error.to_string(), help);
                    return None;
                }
            }
        }
        files.sort();
        files.dedup();
        Some(files)
    }
}

fn span_of(node: &Node, key: &str) -> Span {
    node.entry(key).map_or(node.span, |entry| entry.value.span)
}

/// Description of the runs of a part, as in `3 runs of runs/*.csv, final values are means of the last 10`.
fn sentence(text: &ImportedText, found: &RunCollection) -> String {
    let runs = match found.runs.len() {
        1 => "1 run".to_owned(),
        n => format!("{n} runs"),
    };
    let about = if text.about.is_empty() {
        String::new()
    } else {
        format!(" ({})", text.about)
    };
    let last = match text.last {
        1 => "final values are the last ones".to_owned(),
        n => format!("final values are means of the last {n}"),
    };
    let only = text.mapping().only;
    let lines = only.iter().map(|(column, value)| format!("{column} {value}"));
    let lines = match lines.collect::<Vec<_>>().join(" and ") {
        none if none.is_empty() => none,
        values => format!(" with {values}"),
    };
    let whole = format!("{runs} of {}{lines}{about}, {last}", text.from.all().join(", "));
    std::iter::once(whole)
        .chain(found.said(&text.mapping()))
        .collect::<Vec<_>>()
        .join(", ")
}

/// An entry of the section as it is stored in `folder`, with files named relative to that folder instead of `from`.
pub(super) fn relocated(entry: Value, from: &Path, folder: &Path) -> Value {
    let seen = |pattern: &Value| {
        json!(name_written_out(
            folder,
            &from.join(pattern.as_str().unwrap_or_default())
        ))
    };
    match entry {
        Value::Array(parts) => parts
            .into_iter()
            .map(|part| relocated(part, from, folder))
            .collect(),
        mut part => {
            part["from"] = match &part["from"] {
                Value::Array(patterns) => patterns.iter().map(seen).collect(),
                pattern => seen(pattern),
            };
            part
        }
    }
}
