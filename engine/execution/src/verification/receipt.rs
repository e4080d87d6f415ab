//! Receipt of a recomputation of stored trials.

use crate::store::{Difference, Fingerprint};
use contract::Build;
use serde::Serialize;
use std::{fmt::Write, path::PathBuf};

/// Largest number of lines of each kind about trials that were not computed again.
const MOST_LINES: usize = 20;

/// The trials that were computed again, the program, and the outcomes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Receipt {
    /// Version of this form.
    pub schema: u32,
    /// The program that computed the trials again.
    pub program: String,
    /// Source code of that program, if it is known.
    pub build: Option<Build>,
    /// Folder of the store.
    pub store: PathBuf,
    /// Names of the studies; empty for the whole store.
    pub studies: Vec<String>,
    /// Number of trials that could have been computed again.
    pub eligible: usize,
    /// Size of the sample that was requested; all trials if absent.
    pub sample: Option<usize>,
    /// The seed of the sample.
    pub seed: u64,
    /// Number of trials of the studies that are not in the store.
    pub missing: usize,
    /// Number of trials that did not end `ok` and leave nothing to compare.
    pub not_ok: usize,
    /// One entry per trial.
    pub trials: Vec<ReceiptEntry>,
}

/// Entry of one trial.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReceiptEntry {
    /// Id of the trial.
    pub trial: String,
    /// Name of the environment.
    pub environment: String,
    /// Name of the agent.
    pub agent: String,
    /// The point of the sweep; empty without one.
    pub setting: String,
    /// The replicate.
    pub seed: u64,
    /// Fingerprint of the stored trial; `None` if it cannot be read.
    pub stored: Option<Fingerprint>,
    /// Fingerprint of the new computation; `None` if there was none.
    pub now: Option<Fingerprint>,
    /// Result of the comparison.
    #[serde(flatten)]
    pub outcome: VerificationOutcome,
}

/// Result of the comparison of a trial.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(tag = "outcome", rename_all = "snake_case")]
pub enum VerificationOutcome {
    /// Both have the same bytes.
    Same,
    /// The bytes differ.
    Different {
        /// The differences: the stored values first, the new ones second.
        differences: Vec<Difference>,
    },
    /// The stored files differ from the acknowledged ones.
    Damaged {
        /// The fault.
        problem: String,
    },
    /// The trial was not computed to its end.
    NotComputed {
        /// The reason.
        problem: String,
    },
    /// This program differs from the one that computed the trial.
    CannotVerify {
        /// The difference.
        problem: String,
    },
}

impl VerificationOutcome {
    /// Displayed name of the outcome.
    #[must_use]
    pub fn word(&self) -> &'static str {
        match self {
            Self::Same => "same",
            Self::Different { .. } => "DIFFERENT",
            Self::Damaged { .. } => "damaged",
            Self::NotComputed { .. } => "not computed",
            Self::CannotVerify { .. } => "cannot be verified",
        }
    }
}

impl ReceiptEntry {
    /// The outcome for a stored trial and its new computation.
    #[must_use]
    pub fn compared(self, now: Fingerprint) -> Self {
        let differences = self
            .stored
            .as_ref()
            .map_or_else(Vec::new, |stored| stored.differences(&now));
        let outcome = if differences.is_empty() {
            VerificationOutcome::Same
        } else {
            VerificationOutcome::Different { differences }
        };
        Self {
            now: Some(now),
            outcome,
            ..self
        }
    }

    fn title(&self) -> String {
        let Self {
            environment,
            agent,
            setting,
            seed,
            ..
        } = self;
        let setting = if setting.is_empty() {
            String::new()
        } else {
            format!(" [{setting}]")
        };
        format!("{environment} {agent}{setting} seed {seed}")
    }

    fn problem(&self) -> Option<&str> {
        match &self.outcome {
            VerificationOutcome::Same | VerificationOutcome::Different { .. } => None,
            VerificationOutcome::Damaged { problem }
            | VerificationOutcome::NotComputed { problem }
            | VerificationOutcome::CannotVerify { problem } => Some(problem),
        }
    }
}

impl Receipt {
    /// Number of trials with an outcome.
    #[must_use]
    pub fn count(&self, is: impl Fn(&VerificationOutcome) -> bool) -> usize {
        self.trials.iter().filter(|entry| is(&entry.outcome)).count()
    }

    /// The receipt as text for users.
    #[must_use]
    pub fn text(&self) -> String {
        let mut out = self.head();
        let compared = self.trials.iter().filter(|entry| entry.problem().is_none());
        compared.for_each(|entry| entry.write(&mut out));
        let kinds = ["damaged", "not computed", "cannot be verified"];
        kinds.iter().for_each(|word| self.unknown(word, &mut out));
        out + &self.conclusion()
    }

    fn head(&self) -> String {
        let build = self
            .build
            .as_ref()
            .map_or_else(|| "unknown source code".into(), ToString::to_string);
        let what = if self.studies.is_empty() {
            "all studies".into()
        } else {
            self.studies.join(", ")
        };
        let sample = self.sample.map_or_else(
            || format!("all {} trials", self.eligible),
            |size| {
                format!(
                    "{} of {} trials, seed {}",
                    size.min(self.eligible),
                    self.eligible,
                    self.seed
                )
            },
        );
        let Self { program, store, .. } = self;
        format!(
            "{program} ({build}) computed again, from `{}`, {what}: {sample}\n",
            store.display()
        )
    }

    /// Writes lines about trials without a new computation.
    fn unknown(&self, word: &str, out: &mut String) {
        let all: Vec<&ReceiptEntry> = self
            .trials
            .iter()
            .filter(|entry| entry.outcome.word() == word)
            .collect();
        for entry in all.iter().take(MOST_LINES) {
            let problem = entry.problem().unwrap_or_default();
            // Writing to a string cannot fail.
            let _ = writeln!(out, "{word:<9} {}  {}: {problem}", entry.trial, entry.title());
        }
        if all.len() > MOST_LINES {
            let _ = writeln!(out, "{word:<9} {} more", all.len() - MOST_LINES);
        }
    }

    fn conclusion(&self) -> String {
        let mut text = format!(
            "{} the same, {} different",
            self.count(|it| *it == VerificationOutcome::Same),
            self.count(|it| matches!(it, VerificationOutcome::Different { .. }))
        );
        let others = [
            (
                "damaged",
                self.count(|it| matches!(it, VerificationOutcome::Damaged { .. })),
            ),
            (
                "not computed",
                self.count(|it| matches!(it, VerificationOutcome::NotComputed { .. })),
            ),
            (
                "of another version, which cannot be verified",
                self.count(|it| matches!(it, VerificationOutcome::CannotVerify { .. })),
            ),
            ("that did not end ok", self.not_ok),
            ("not stored", self.missing),
        ];
        for (word, count) in others.into_iter().filter(|(_, count)| *count > 0) {
            let _ = write!(text, ", {count} {word}");
        }
        text
    }
}

impl ReceiptEntry {
    fn write(&self, out: &mut String) {
        let digest = |fingerprint: &Option<Fingerprint>| {
            fingerprint.as_ref().map_or("none", |it| &it.digest).to_owned()
        };
        let by = |fingerprint: &Option<Fingerprint>| {
            fingerprint.as_ref().map_or_else(String::new, Fingerprint::by)
        };
        let _ = writeln!(
            out,
            "{:<9} {}  {}: stored {} by {}, now {} by {}",
            self.outcome.word(),
            self.trial,
            self.title(),
            digest(&self.stored),
            by(&self.stored),
            digest(&self.now),
            by(&self.now)
        );
        let VerificationOutcome::Different { differences } = &self.outcome else {
            return;
        };
        for Difference { what, first, second } in differences {
            let or_none = |text: &str| {
                if text.is_empty() {
                    "none".to_owned()
                } else {
                    text.to_owned()
                }
            };
            let _ = writeln!(
                out,
                "          {what}: stored {}, now {}",
                or_none(first),
                or_none(second)
            );
        }
    }
}
