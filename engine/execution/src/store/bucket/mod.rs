//! A bucket of object storage as the store that machines without a common folder share.
//!
//! ```text
//! <prefix>/trials/<id>       a trial that has ended or paused: one line of JSON with the names and lengths of
//! its files,
//!                            and their bytes, the acknowledgement last
//!          leases/<id>       the owner that computes a trial now
//!          owners/<token>    a number that a living process counts up
//!          aside/<id>-<hash> an object that was to be a trial and is damaged
//! ```
//!
//! Every machine works in a store of its own, in an ordinary folder, and copies each ended trial into the bucket. A
//! trial that is in the bucket but not in the folder is fetched and compared with its acknowledgement before it is
//! used. An object appears completely or not at all, so a trial in the bucket has ended, or has reached a pause. A
//! damaged object affects only its trial: the trial counts as missing, and the machine that computes it sets the object
//! aside first.

mod lease;
mod objects;
#[cfg(test)]
mod pretended;

pub(crate) use lease::BucketLeases;
pub use objects::{Object, ObjectStorage, Objects, RegisterObjectStorage, WriteCondition};

use super::{Announcement, Bundle, BundleError, Claim, Leases, Store, bundle, index};
use contract::{
    Error, Registry, digest,
    trial_end::{TrialEnd, is_missing},
};
use std::{collections::BTreeSet, sync::Arc, time::Duration};

/// Time after which a process that fetches a trial counts as gone, if no process can see it.
const FETCHED_WITHIN: Duration = Duration::from_secs(300);

/// The message of a program without object storage.
const NO_STORAGE: &str =
    "this program was built without buckets; build it with `cargo build --release --features bucket`";

/// Part of a bucket that one or several studies share.
#[derive(Debug, Clone)]
pub struct Bucket {
    /// Address in the form that the user writes, `s3://bucket/prefix`.
    address: String,
    objects: Arc<dyn Objects>,
}

impl Bucket {
    /// The bucket at an address such as `s3://name/prefix`. No request is made yet. `variable` reads environment
    /// variables, which contain keys.
    ///
    /// # Errors
    /// [`Error::Bucket`] for a text that is no address, if keys are missing, or if no object storage is registered.
    pub fn at(
        address: &str,
        registry: &Registry,
        variable: &dyn Fn(&str) -> Option<String>,
    ) -> Result<Self, Error> {
        let opened = match registry.extensions::<ObjectStorage>().next() {
            Some(storage) => (storage.open)(address, variable),
            None => Err(NO_STORAGE.into()),
        };
        let objects = opened.map_err(|problem| Error::Bucket {
            doing: "use".into(),
            address: address.to_owned(),
            problem,
        })?;
        let address = address.to_owned();
        Ok(Self { address, objects })
    }

    /// Ids of the trials in the bucket.
    fn trials(&self) -> Result<BTreeSet<String>, Error> {
        let listed = self.objects.list("trials/");
        let keys = listed.map_err(|problem| self.error("list the trials in", problem))?;
        let ids = keys.iter().filter_map(|key| key.strip_prefix("trials/"));
        Ok(ids.map(str::to_owned).collect())
    }

    /// Copies a trial from the bucket into a store.
    fn fetch(&self, store: &Store, id: &str) -> Result<FetchOutcome, Error> {
        let found = self.objects.get(&key(id));
        let found = found.map_err(|problem| self.error(&format!("fetch trial {id} from"), problem))?;
        let Some(object) = found else {
            return Ok(FetchOutcome::Nothing);
        };
        let files = match bundle::from_bytes(id, &object.bytes) {
            Ok(files) => files,
            Err(problem) => return Ok(FetchOutcome::Damaged { object, problem }),
        };
        let earlier = store.earlier(id);
        if earlier.is_some() && end_in(&files) == earlier {
            return Ok(FetchOutcome::Nothing);
        }
        match store.take_in(id, &files) {
            Ok(true) => Ok(FetchOutcome::Taken),
            // The store already has the pause.
            Ok(false) => Ok(FetchOutcome::Nothing),
            Err(BundleError::Damaged(problem)) => Ok(FetchOutcome::Damaged { object, problem }),
            Err(BundleError::Here(error)) => Err(error),
        }
    }

    /// Fetches a trial that is to be computed here, unless it has already ended here. The caller holds its lease in the
    /// bucket, since a damaged object is set aside there.
    pub(crate) fn fetch_missing(&self, store: &Store, id: &str) -> Result<(), Error> {
        if !store.lacks(id) {
            return Ok(());
        }
        let FetchOutcome::Damaged { object, .. } = self.fetch(store, id)? else {
            return Ok(());
        };
        let aside = format!("aside/{id}-{}", &digest::of_bytes(&object.bytes)[..16]);
        let moved = self.objects.put(&aside, &object.bytes, WriteCondition::Always);
        let moved = moved.and_then(|_| self.objects.delete(&key(id)));
        moved.map_err(|problem| self.error(&format!("set trial {id} aside in"), problem))
    }

    /// Copies a trial of a store into the bucket, if it has ended or paused.
    pub(crate) fn bring(&self, store: &Store, id: &str) -> Result<(), Error> {
        let Some(files) = store.bundle(id)? else {
            return Ok(());
        };
        let bytes = bundle::to_bytes(id, &files);
        let put = self.objects.put(&key(id), &bytes, WriteCondition::Always);
        put.map(drop)
            .map_err(|problem| self.error(&format!("bring trial {id} into"), problem))
    }

    fn error(&self, doing: &str, problem: String) -> Error {
        Error::Bucket {
            doing: doing.to_owned(),
            address: self.address.clone(),
            problem,
        }
    }
}

/// Result of fetching a trial.
enum FetchOutcome {
    /// The trial is in the store now.
    Taken,
    /// The trial is not in the bucket, or has the end there after which it is to be tried again here.
    Nothing,
    /// The object of its name is not the trial, for this reason.
    Damaged { object: Object, problem: String },
}

/// Result of fetching trials from the bucket.
#[derive(Debug, Default)]
pub struct FetchReport {
    /// Number of trials that are new in the store.
    pub taken: usize,
    /// Damaged objects of the bucket, as sentences; their trials are missing.
    pub damaged: Vec<String>,
}

/// Key of the object of a trial.
fn key(id: &str) -> String {
    format!("trials/{id}")
}

/// The end of the trial of a bundle; `None` if it cannot be read.
fn end_in(bundle: &Bundle) -> Option<TrialEnd> {
    let (_, acknowledgement) = bundle.iter().find(|(name, _)| name == "trial.json")?;
    Some(index::parse(acknowledgement).ok()?.end)
}

impl Store {
    /// The same store, with its trials shared through a bucket.
    #[must_use]
    pub fn sharing(self, bucket: Option<Bucket>) -> Self {
        Self { bucket, ..self }
    }

    /// The bucket through which the trials of the store are shared.
    pub fn bucket(&self) -> Option<&Bucket> {
        self.bucket.as_ref()
    }

    /// Fetches those of the trials that are shared and not here. Does nothing without a bucket.
    ///
    /// # Errors
    /// [`Error::Bucket`] if the bucket cannot be read, and the errors of leases and of writing a trial.
    pub fn fetch<'a>(&self, ids: impl IntoIterator<Item = &'a str>) -> Result<FetchReport, Error> {
        let mut fetched = FetchReport::default();
        let Some(bucket) = &self.bucket else {
            return Ok(fetched);
        };
        let shared = bucket.trials()?;
        let wanted: Vec<&str> = ids
            .into_iter()
            .filter(|id| shared.contains(*id) && self.lacks(id))
            .collect();
        if wanted.is_empty() {
            return Ok(fetched);
        }
        let leases = Leases::open(self, FETCHED_WITHIN)?;
        for id in wanted {
            // A trial that another program here computes will arrive without the bucket.
            if leases.claim(id)? == Claim::Mine {
                let outcome = bucket.fetch(self, id);
                leases.release(id)?;
                match outcome? {
                    FetchOutcome::Taken => fetched.taken += 1,
                    FetchOutcome::Nothing => {}
                    FetchOutcome::Damaged { problem, .. } => {
                        let object = format!("{}/{}", bucket.address.trim_end_matches('/'), key(id));
                        fetched.damaged.push(format!("`{object}` is damaged: {problem}"));
                    }
                }
            }
        }
        Ok(fetched)
    }

    /// Copies those of the trials into the bucket that have ended or paused here and are not shared yet;
    /// returns their number. Does nothing without a bucket.
    ///
    /// # Errors
    /// The errors of [`fetch`](Self::fetch).
    pub fn bring<'a>(&self, ids: impl IntoIterator<Item = &'a str>) -> Result<usize, Error> {
        let Some(bucket) = &self.bucket else { return Ok(0) };
        let shared = bucket.trials()?;
        let mut brought = 0;
        for id in ids
            .into_iter()
            .filter(|id| !shared.contains(*id) && (!self.lacks(id) || self.measured_until(id).is_some()))
        {
            bucket.bring(self, id)?;
            brought += 1;
        }
        Ok(brought)
    }

    /// Whether a trial has not ended here. A trial that cannot be read does not count as absent: it is reported and
    /// repaired here.
    fn lacks(&self, id: &str) -> bool {
        self.end(id).is_ok_and(|end| is_missing(end.as_ref()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::stub::trial;
    use contract::{Phase, Recorder, trial_end::EndState};

    /// A bucket and the stores of two machines that share it.
    fn two_machines() -> (tempfile::TempDir, Bucket, [Store; 2]) {
        let dir = tempfile::tempdir().unwrap();
        let bucket = pretended::bucket();
        let stores =
            ["one", "two"].map(|name| Store::at(dir.path().join(name)).sharing(Some(bucket.clone())));
        (dir, bucket, stores)
    }

    #[test]
    fn a_trial_goes_from_one_machine_to_another_and_only_once() {
        let (_dir, _, [one, two]) = two_machines();
        let trial = trial(4, 0);
        let ids = || [trial.id.as_str(), "00000000000000000000000000000000"];
        assert_eq!(
            (one.bring(ids()).unwrap(), two.fetch(ids()).unwrap().taken),
            (0, 0)
        );
        let mut record = Recorder::default();
        record.add(Phase::Final, 10, 0, 0, "return", 3.5);
        one.finish(&trial, &record, 1.0).unwrap();
        assert_eq!((one.bring(ids()).unwrap(), one.bring(ids()).unwrap()), (1, 0));
        let fetched = || two.fetch(ids()).unwrap().taken;
        assert_eq!((fetched(), fetched()), (1, 0));
        assert_eq!(two.end(&trial.id).unwrap().unwrap().state, EndState::Ok);
        assert_eq!(two.bundle(&trial.id).unwrap(), one.bundle(&trial.id).unwrap());
    }

    #[test]
    fn what_was_changed_in_the_bucket_is_not_taken_in() {
        let (_dir, bucket, [one, two]) = two_machines();
        let trial = trial(4, 0);
        one.finish(&trial, &Recorder::default(), 1.0).unwrap();
        one.bring([trial.id.as_str()]).unwrap();
        let key = format!("trials/{}", trial.id);
        let mut bytes = bucket.objects.get(&key).unwrap().unwrap().bytes;
        let place = bytes.iter().position(|byte| *byte == b'\n').unwrap() + 9;
        bytes[place] ^= 1;
        bucket.objects.put(&key, &bytes, WriteCondition::Always).unwrap();
        // Another trial is still fetched.
        let beside = crate::store::stub::trial(4, 1);
        one.finish(&beside, &Recorder::default(), 1.0).unwrap();
        one.bring([beside.id.as_str()]).unwrap();
        let ids = || [trial.id.as_str(), beside.id.as_str()];
        let fetched = two.fetch(ids()).unwrap();
        assert_eq!((fetched.taken, fetched.damaged.len()), (1, 1));
        let named = format!("`s3://pretended/{key}` is damaged");
        assert!(fetched.damaged[0].starts_with(&named), "{:?}", fetched.damaged);
        assert!(
            !fetched.damaged[0].contains("regimen-bundle"),
            "{:?}",
            fetched.damaged
        );
        bucket
            .objects
            .put(&key, &bytes[..place], WriteCondition::Always)
            .unwrap();
        let cut_off = two.fetch(ids()).unwrap();
        assert!(
            cut_off.taken == 0 && cut_off.damaged[0].contains(&key),
            "{cut_off:?}"
        );
        assert!(two.end(&trial.id).unwrap().is_none());
        // The machine that computes the trial keeps the earlier object, and stores the trial again.
        bucket.fetch_missing(&two, &trial.id).unwrap();
        assert_eq!(bucket.objects.list("aside/").unwrap().len(), 1);
        assert!(bucket.objects.get(&key).unwrap().is_none());
        two.finish(&trial, &Recorder::default(), 1.0).unwrap();
        assert_eq!(two.bring(ids()).unwrap(), 1);
        assert!(two.fetch(ids()).unwrap().damaged.is_empty());
    }

    #[test]
    fn a_failure_that_is_to_be_tried_again_does_not_come_back_and_a_newer_end_does() {
        let (_dir, bucket, [one, two]) = two_machines();
        let trial = trial(4, 0);
        let ids = [trial.id.as_str()];
        let failed = |wall_s| TrialEnd {
            state: EndState::Failed,
            reason: "told".into(),
            wall_s,
            decision_s: None,
            device: None,
            digest: String::new(),
        };
        one.acknowledge(&trial, failed(1.0)).unwrap();
        one.bring(ids).unwrap();
        assert_eq!(two.fetch(ids).unwrap().taken, 1);
        two.try_again(&trial.id).unwrap();
        assert_eq!(two.fetch(ids).unwrap().taken, 0);
        assert!(two.end(&trial.id).unwrap().is_none());
        one.try_again(&trial.id).unwrap();
        one.acknowledge(&trial, failed(2.0)).unwrap();
        bucket.bring(&one, &trial.id).unwrap();
        assert_eq!(two.fetch(ids).unwrap().taken, 1);
        assert_eq!(two.end(&trial.id).unwrap().unwrap().wall_s, 2.0);
    }

    /// A machine that finds a pause in the bucket compares settings by it and does not compute it again.
    #[test]
    fn a_pause_goes_to_the_other_machine_once_and_a_later_one_after_it() {
        let (_dir, bucket, [one, two]) = two_machines();
        let trial = trial(4, 0);
        let ids = [trial.id.as_str()];
        let paused = TrialEnd {
            state: EndState::Paused,
            reason: String::new(),
            wall_s: 1.0,
            decision_s: None,
            device: None,
            digest: String::new(),
        };
        let mut record = Recorder::default();
        for step in [100, 200] {
            record.add(Phase::Evaluate, step, 0, 0, "return", 0.5);
            one.keep_partial(&trial, paused.clone(), &record).unwrap();
            bucket.bring(&one, &trial.id).unwrap();
            assert_eq!(
                (two.fetch(ids).unwrap().taken, two.fetch(ids).unwrap().taken),
                (1, 0)
            );
            assert_eq!(two.measured_until(&trial.id), Some(step));
        }
        assert!(two.end(&trial.id).unwrap().is_none());
        one.finish(&trial, &record, 1.0).unwrap();
        bucket.bring(&one, &trial.id).unwrap();
        assert_eq!(
            (two.fetch(ids).unwrap().taken, two.partial(&trial.id).unwrap()),
            (1, None)
        );
    }

    #[test]
    fn a_program_without_object_storage_says_how_to_build_one_with_it() {
        let error = Bucket::at("s3://lab/a", &Registry::default(), &|_| None).unwrap_err();
        assert!(error.to_string().contains("--features bucket"), "{error}");
    }

    #[test]
    fn a_store_without_a_bucket_shares_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::at(dir.path());
        assert_eq!(
            (store.fetch(["ab"]).unwrap().taken, store.bring(["ab"]).unwrap()),
            (0, 0)
        );
    }
}
