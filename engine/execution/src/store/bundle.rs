//! Trials in transit to another machine: the files that the acknowledgement of a trial names, compared with their
//! hashes at both ends; for a paused trial, its record up to the pause.

use super::{Merge, Store, inside::read_in, merge::acknowledged_files, partial};
use crate::world::fs;
use contract::{
    Error,
    digest::of_bytes as hash,
    trial_end::{EndState, is_missing},
};
use serde::{Deserialize, Serialize};
use std::{
    io::{self, BufRead, Read},
    path::Path,
};

/// Files of an ended trial by their names inside its folder, the acknowledgement last.
pub(crate) type Bundle = Vec<(String, Vec<u8>)>;

/// The file that comes last.
const LAST: &str = "trial.json";

impl Store {
    /// The files of a trial; `None` if it has neither ended nor paused.
    ///
    /// # Errors
    /// [`Error::Damaged`] for a file that differs from the acknowledged one.
    pub(crate) fn bundle(&self, id: &str) -> Result<Option<Bundle>, Error> {
        let Some(file) = self.sound(id)?.filter(|file| !is_missing(Some(&file.end))) else {
            let paused = self.partial_bytes(id)?;
            return Ok(paused.map(|(bytes, _)| vec![(partial::NAME.to_owned(), bytes)]));
        };
        let folder = self.folder(id);
        let mut bundle = Bundle::new();
        for (name, digest) in acknowledged_files(&file) {
            let bytes = match read_in(&folder, &name)? {
                None if name == "metrics.parquet" => self.metrics_in_pack(id, &digest)?,
                bytes => bytes,
            };
            let bytes = bytes.filter(|bytes| hash(bytes) == digest);
            let changed = || damaged(&folder.join(&name), "it changed while it was read");
            bundle.push((name.clone(), bytes.ok_or_else(changed)?));
        }
        if file.end.state != EndState::Ok
            && let Some((bytes, _)) = self.partial_bytes(id)?
        {
            bundle.push((partial::NAME.to_owned(), bytes));
        }
        let acknowledgement = self.acknowledged(id)?.map(|(text, _)| text);
        Ok(acknowledgement.map(|text| {
            bundle.push((LAST.to_owned(), text));
            bundle
        }))
    }

    /// Writes a [`bundle`](Self::bundle) of another machine into the store; false if a pause is already known here. The
    /// caller holds the trial's lease.
    ///
    /// # Errors
    /// [`BundleError`].
    pub(crate) fn take_in(&self, id: &str, bundle: &[(String, Vec<u8>)]) -> Result<bool, BundleError> {
        let made = tempfile::Builder::new().prefix("regimen-bundle-").tempdir();
        let dir = made.map_err(Error::file("make a folder in", &std::env::temp_dir()))?;
        let unpacked = self.unpack(id, bundle, dir.path());
        unpacked.map_err(|error| BundleError::of(error, dir.path()))
    }

    fn unpack(&self, id: &str, bundle: &[(String, Vec<u8>)], dir: &Path) -> Result<bool, Error> {
        let arrived = Self::at(dir);
        let folder = arrived.folder(id);
        for (name, bytes) in bundle {
            let path = folder.join(name);
            if !fs::is_inside(Path::new(name)) {
                return Err(damaged(&path, "a file of a trial lies in the trial's folder"));
            }
            let parent = path.parent().unwrap_or(&folder);
            fs::create_dir_all(parent).map_err(Error::file("create", parent))?;
            fs::write(&path, bytes).map_err(Error::file("write", &path))?;
        }
        let merge = Merge::new(self, None)?;
        if let Some(file) = arrived.sound(id)? {
            return merge.bring_under_own_lease(id, &arrived, &file).map(|()| true);
        }
        let unfinished = || damaged(&folder, "the trial has neither ended nor paused");
        let (bytes, there) = arrived.partial_bytes(id)?.ok_or_else(unfinished)?;
        merge.pause_under_own_lease(id, &bytes, &there)
    }
}

/// Reason why a bundle was refused.
#[derive(Debug, thiserror::Error)]
pub(crate) enum BundleError {
    /// The bundle differs from the acknowledgement of the other machine, for this reason.
    #[error("it is not what was acknowledged: {0}")]
    Damaged(String),
    /// This store cannot be written, or has other files of this trial.
    #[error(transparent)]
    Here(#[from] Error),
}

impl BundleError {
    /// An error about the unpacked files is reported as one of the bundle, since those files no longer exist then.
    fn of(error: Error, unpacked: &Path) -> Self {
        match error {
            Error::Damaged { path, problem } if path.starts_with(unpacked) => {
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                Self::Damaged(format!("`{name}`: {problem}"))
            }
            other => Self::Here(other),
        }
    }
}

/// Length of the longest file in bytes; a greater length is refused.
const MOST_BYTES: u64 = 1 << 36;

/// Names and lengths of the files of a trial, whose bytes follow in this order.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Manifest {
    /// Id of the trial.
    pub(crate) trial: String,
    /// Names inside its folder with their lengths in bytes.
    pub(crate) files: Vec<(String, u64)>,
}

impl Manifest {
    /// The manifest of a bundle.
    pub(crate) fn of(trial: &str, bundle: &[(String, Vec<u8>)]) -> Self {
        let length = |(name, bytes): &(String, Vec<u8>)| (name.clone(), bytes.len() as u64);
        Self {
            trial: trial.to_owned(),
            files: bundle.iter().map(length).collect(),
        }
    }

    /// Reads the files that follow.
    pub(crate) fn read(&self, input: &mut impl Read) -> io::Result<Bundle> {
        let file = |(name, length): &(String, u64)| Ok((name.clone(), read_bytes(input, *length)?));
        self.files.iter().map(file).collect()
    }
}

/// Reads `length` bytes.
pub(crate) fn read_bytes(input: &mut impl Read, length: u64) -> io::Result<Vec<u8>> {
    if length > MOST_BYTES {
        return Err(io::Error::new(
            io::ErrorKind::InvalidData,
            format!("a file of {length} bytes is announced"),
        ));
    }
    let mut bytes = Vec::new();
    input.take(length).read_to_end(&mut bytes)?;
    if bytes.len() as u64 == length {
        Ok(bytes)
    } else {
        Err(io::ErrorKind::UnexpectedEof.into())
    }
}

/// A bundle as one object: a line of JSON, and the bytes of the files.
pub(super) fn to_bytes(id: &str, bundle: &[(String, Vec<u8>)]) -> Vec<u8> {
    // Names and numbers are JSON.
    let mut bytes = serde_json::to_vec(&Manifest::of(id, bundle)).expect("a manifest is JSON");
    bytes.push(b'\n');
    bundle.iter().for_each(|(_, file)| bytes.extend(file));
    bytes
}

/// The bundle of the trial `id` that [`to_bytes`] wrote; the error is the reason why the bytes are something else.
pub(super) fn from_bytes(id: &str, mut bytes: &[u8]) -> Result<Bundle, String> {
    let mut line = Vec::new();
    // Reading from memory does not fail.
    let _ = bytes.read_until(b'\n', &mut line);
    let manifest: Option<Manifest> = serde_json::from_slice(&line).ok();
    let manifest = manifest.filter(|manifest| manifest.trial == id);
    let manifest = manifest.ok_or("what lies there is not this trial")?;
    let bundle = manifest
        .read(&mut bytes)
        .map_err(|error| format!("the trial is not whole there: {error}"))?;
    if bytes.is_empty() {
        Ok(bundle)
    } else {
        Err("more lies there than the trial".into())
    }
}

fn damaged(path: &Path, problem: &str) -> Error {
    Error::Damaged {
        path: path.to_owned(),
        problem: problem.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::stub::trial;
    use contract::{Phase, Recorder, trial_end::EndState};

    /// Stores a trial that has ended; returns its id and its bundle.
    fn left(store: &Store) -> (String, Bundle) {
        let trial = trial(4, 0);
        let mut record = Recorder::default();
        record.add(Phase::Final, 10, 0, 0, "return", 3.5);
        store.finish(&trial, &record, 1.0).unwrap();
        let bundle = store.bundle(&trial.id).unwrap().unwrap();
        (trial.id, bundle)
    }

    fn stores() -> (tempfile::TempDir, Store, Store) {
        let dir = tempfile::tempdir().unwrap();
        let [here, there] = ["here", "there"].map(|name| Store::at(dir.path().join(name)));
        (dir, here, there)
    }

    #[test]
    fn a_trial_arrives_with_the_bytes_that_it_had() {
        let (_dir, here, there) = stores();
        let (id, bundle) = left(&there);
        let names: Vec<&str> = bundle.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["metrics.parquet", "trial.json"]);
        assert!(here.bundle(&id).unwrap().is_none());
        here.take_in(&id, &bundle).unwrap();
        assert_eq!(here.end(&id).unwrap().unwrap().state, EndState::Ok);
        assert_eq!(here.bundle(&id).unwrap().unwrap(), bundle);
    }

    #[test]
    fn what_is_not_as_it_was_acknowledged_is_not_taken_in() {
        let (_dir, here, there) = stores();
        let (id, bundle) = left(&there);
        let changed = |change: fn(&mut Bundle)| {
            let mut bundle = bundle.clone();
            change(&mut bundle);
            here.take_in(&id, &bundle).unwrap_err()
        };
        let wrong = [
            changed(|bundle| bundle[0].1[0] ^= 1),
            changed(|bundle| drop(bundle.remove(0))),
            changed(|bundle| drop(bundle.pop())),
            changed(|bundle| bundle[0].0 = "../metrics.parquet".into()),
        ];
        for error in wrong {
            assert!(matches!(error, BundleError::Damaged(_)), "{error}");
        }
        // The bundle of another trial, under this one's name.
        assert!(here.take_in("00000000000000000000000000000000", &bundle).is_err());
        assert!(here.end(&id).unwrap().is_none());
    }

    #[test]
    fn a_parcel_is_read_back_from_one_object_or_refused() {
        let (_dir, _, there) = stores();
        let (id, bundle) = left(&there);
        let bytes = to_bytes(&id, &bundle);
        assert_eq!(from_bytes(&id, &bytes).unwrap(), bundle);
        assert!(
            from_bytes("of another", &bytes)
                .unwrap_err()
                .contains("not this trial")
        );
        assert!(from_bytes(&id, b"").is_err() && from_bytes(&id, b"{}\n").is_err());
        assert!(
            from_bytes(&id, &bytes[..bytes.len() - 1])
                .unwrap_err()
                .contains("not whole")
        );
        let longer = [&bytes[..], b"."].concat();
        assert!(from_bytes(&id, &longer).unwrap_err().contains("more"));
    }

    #[test]
    fn what_is_cut_off_or_has_no_length_is_an_error() {
        let short = Manifest {
            trial: "ab".into(),
            files: vec![("a".into(), 5)],
        };
        assert!(short.read(&mut &b"1234"[..]).is_err());
        let long = Manifest {
            files: vec![("a".into(), u64::MAX)],
            ..short
        };
        assert!(
            long.read(&mut &b"1234"[..])
                .unwrap_err()
                .to_string()
                .contains("announced")
        );
    }
}
