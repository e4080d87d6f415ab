//! A study as a research object crate: a folder with a description in linked data.
//!
//! RO-Crate 1.2 (<https://w3id.org/ro/crate/1.2>): the metadata file describes itself and the root, which has a name,
//! a description, a date of publication, a licence and its parts. Authorship follows the profile Process Run Crate
//! 0.5 (<https://w3id.org/ro/wfrun/process/0.5>): one action per build of the program, from the study to the metrics
//! of the trials that it computed.

use super::{Subject, pretty};
use contract::{Build, Error};
use execution::{
    store::{StoredTrial, rfc_3339_of, seconds_of, write_durably},
    world::fs,
};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

const SPECIFICATION: &str = "https://w3id.org/ro/crate/1.2";
const PROFILE: &str = "https://w3id.org/ro/wfrun/process/0.5";
const METADATA: &str = "ro-crate-metadata.json";

/// A file of the crate with its description.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Piece {
    /// Its path inside the crate, with slashes.
    pub path: String,
    /// Description in one line.
    pub about: String,
    /// The trial that recorded it; `None` for files of the study.
    pub trial: Option<String>,
}

/// Contents and metadata of a crate.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Crate {
    /// Folder of the crate, with the pieces in it.
    pub folder: PathBuf,
    /// Files of the crate, without its description.
    pub pieces: Vec<Piece>,
    /// Path of the study file among the pieces.
    pub study: String,
    /// Licence of the results: an SPDX id or an address.
    pub license: String,
    /// Date of publication, as in `2026-11-22`.
    pub date: String,
}

impl Crate {
    /// Writes the description, the last file of the crate.
    ///
    /// # Errors
    /// [`Error::File`] where a piece cannot be read or the description cannot be written.
    pub fn describe(&self, subject: &Subject<'_>) -> Result<(), Error> {
        let mut graph = vec![descriptor(), self.root(subject), self.license(), profile()];
        for piece in &self.pieces {
            graph.push(self.file(piece)?);
        }
        graph.extend(self.trials(subject));
        graph.extend(self.actions(subject));
        let context = json!([
            format!("{SPECIFICATION}/context"),
            // The term is defined here, since some versions of the context lack it.
            {"sha256": "https://schema.org/sha256"}
        ]);
        let described = json!({"@context": context, "@graph": graph});
        write_durably(&self.folder.join(METADATA), pretty(&described).as_bytes())
    }

    fn root(&self, subject: &Subject<'_>) -> Value {
        let name = if subject.title.is_empty() {
            subject.name
        } else {
            subject.title
        };
        let trials = subject.trials.iter().filter(|(result, _)| result.is_ok()).count();
        let source = if subject.source.is_empty() {
            String::new()
        } else {
            format!(" Published numbers are from: {}.", subject.source)
        };
        let description = format!(
            "Study `{}`: its file, what {trials} trials recorded, tidy tables of it, and its report where one was \
             written.{source}",
            subject.name
        );
        let parts = self
            .pieces
            .iter()
            .filter(|piece| piece.trial.is_none())
            .map(|piece| iri(&piece.path));
        let parts: Vec<Value> = parts
            .chain(self.by_trial().keys().map(|id| trial_folder(id)))
            .map(reference)
            .collect();
        let mentions: Vec<Value> = self
            .builds(subject)
            .keys()
            .map(|build| reference(action_id(build.as_ref())))
            .collect();
        json!({"@id": "./", "@type": "Dataset", "name": name, "description": description,
            "datePublished": self.date, "license": reference(self.license_id()),
            "conformsTo": reference(PROFILE.into()),
            "hasPart": parts, "mentions": mentions})
    }

    /// The address of the licence.
    fn license_id(&self) -> String {
        if self.license.contains("://") {
            self.license.clone()
        } else {
            format!("https://spdx.org/licenses/{}", self.license)
        }
    }

    fn license(&self) -> Value {
        json!({"@id": self.license_id(), "@type": "CreativeWork", "name": self.license,
            "description": "licence of the results"})
    }

    fn file(&self, piece: &Piece) -> Result<Value, Error> {
        let path = self.folder.join(&piece.path);
        let bytes = fs::read(&path).map_err(Error::file("read", &path))?;
        let mut sha256 = String::new();
        for byte in Sha256::digest(&bytes) {
            sha256.push_str(&format!("{byte:02x}"));
        }
        Ok(
            json!({"@id": iri(&piece.path), "@type": "File", "name": piece.path,
            "description": piece.about, "encodingFormat": media_type(&piece.path),
            "contentSize": bytes.len().to_string(), "sha256": sha256}),
        )
    }

    /// Paths of the pieces of every trial.
    fn by_trial(&self) -> BTreeMap<&str, Vec<&str>> {
        let mut by_trial: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for piece in &self.pieces {
            if let Some(trial) = &piece.trial {
                by_trial.entry(trial).or_default().push(&piece.path);
            }
        }
        by_trial
    }

    /// The folders of trials, each with its names in the study.
    fn trials(&self, subject: &Subject<'_>) -> Vec<Value> {
        let mut titles: BTreeMap<&str, String> = BTreeMap::new();
        for (result, _) in &subject.trials {
            titles
                .entry(&result.trial.id)
                .or_insert_with(|| result.trial.title());
        }
        let folder = |(id, paths): (&str, Vec<&str>)| {
            let parts: Vec<Value> = paths.into_iter().map(|path| reference(iri(path))).collect();
            json!({"@id": trial_folder(id), "@type": "Dataset", "name": titles.get(id),
                "description": "a trial: what it recorded, and how it was acknowledged",
                "identifier": id, "hasPart": parts})
        };
        self.by_trial().into_iter().map(folder).collect()
    }

    /// The trials of the crate by the build of the program that computed them.
    fn builds<'a>(
        &self,
        subject: &Subject<'a>,
    ) -> BTreeMap<Option<Build>, BTreeMap<&'a str, &'a StoredTrial>> {
        let own = self.by_trial();
        let mut builds: BTreeMap<Option<Build>, BTreeMap<&str, &StoredTrial>> = BTreeMap::new();
        for (result, stored) in &subject.trials {
            if let Some(stored) = stored.filter(|_| own.contains_key(result.trial.id.as_str())) {
                builds
                    .entry(stored.build.clone())
                    .or_default()
                    .insert(&result.trial.id, stored);
            }
        }
        builds
    }

    fn actions(&self, subject: &Subject<'_>) -> Vec<Value> {
        let (mut described, own) = (Vec::new(), self.by_trial());
        for (build, trials) in self.builds(subject) {
            let build = build.as_ref();
            described.push(program(build));
            let metrics = trials.keys().flat_map(|id| own[id].iter());
            let results: Vec<Value> = metrics
                .filter(|path| path.ends_with(".parquet"))
                .map(|path| reference(iri(path)))
                .collect();
            let mut action = json!({"@id": action_id(build), "@type": "CreateAction",
                "name": format!("{} trials of `{}`", trials.len(), subject.name),
                "description": "The start is that of the trial whose end less its wall-clock time is the earliest.",
                "instrument": reference(program_id(build)), "object": [reference(iri(&self.study))],
                "actionStatus": reference("http://schema.org/CompletedActionStatus".into()),
                "result": results});
            if let Some((start, end)) = period(trials.values()) {
                action["startTime"] = rfc_3339_of(start).into();
                action["endTime"] = rfc_3339_of(end).into();
            }
            described.push(action);
        }
        described
    }
}

/// The earliest start and the latest end of trials, in seconds since 1970; `None` where the store has no end.
fn period<'a>(trials: impl Iterator<Item = &'a &'a StoredTrial>) -> Option<(u64, u64)> {
    let mut whole: Option<(u64, u64)> = None;
    for trial in trials {
        let Some(end) = trial.ended_at.as_deref().and_then(seconds_of) else {
            continue;
        };
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a duration, saturating"
        )]
        let start = end.saturating_sub(trial.end.wall_s.ceil() as u64);
        let (first, last) = whole.unwrap_or((start, end));
        whole = Some((first.min(start), last.max(end)));
    }
    whole
}

/// The metadata file, which describes itself.
fn descriptor() -> Value {
    json!({"@id": METADATA, "@type": "CreativeWork", "about": reference("./".into()),
        "conformsTo": reference(SPECIFICATION.into())})
}

/// The profile that the crate follows.
fn profile() -> Value {
    json!({"@id": PROFILE, "@type": "CreativeWork", "name": "Process Run Crate", "version": "0.5"})
}

fn program(build: Option<&Build>) -> Value {
    let version = build.map_or_else(|| "unknown source code".into(), ToString::to_string);
    json!({"@id": program_id(build), "@type": "SoftwareApplication", "name": "regimen",
        "description": "an experiment-pipeline engine for reinforcement learning, at this commit",
        "softwareVersion": version})
}

fn program_id(build: Option<&Build>) -> String {
    format!("#regimen-{}", short(build))
}

fn action_id(build: Option<&Build>) -> String {
    format!("#computed-by-{}", short(build))
}

fn short(build: Option<&Build>) -> String {
    build.map_or_else(
        || "unknown".into(),
        |build| {
            let changed = if build.changed { "-changed" } else { "" };
            format!("{}{changed}", build.commit)
        },
    )
}

fn trial_folder(id: &str) -> String {
    format!("trials/{id}/")
}

fn reference(id: String) -> Value {
    json!({ "@id": id })
}

/// A path as a relative address.
fn iri(path: &str) -> String {
    let mut out = String::new();
    for byte in path.bytes() {
        if byte.is_ascii_alphanumeric() || b"-._~/+=".contains(&byte) {
            out.push(char::from(byte));
        } else {
            out.push_str(&format!("%{byte:02X}"));
        }
    }
    out
}

fn media_type(path: &str) -> &'static str {
    match Path::new(path)
        .extension()
        .and_then(|it| it.to_str())
        .unwrap_or_default()
    {
        "json" => "application/json",
        "yaml" | "yml" => "application/yaml",
        "parquet" => "application/vnd.apache.parquet",
        "csv" => "text/csv",
        "md" => "text/markdown",
        "tex" => "application/x-tex",
        "html" => "text/html",
        "svg" => "image/svg+xml",
        "png" => "image/png",
        _ => "application/octet-stream",
    }
}
