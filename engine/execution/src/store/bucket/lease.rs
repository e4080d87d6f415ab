//! Leases in a bucket, each of which names the machine that computes a trial now.
//!
//! A lease is an object that is written only if there is none (`If-None-Match: *`), so that only one of several
//! claimants gets it. A living process increments an object of its own. A process that has seen this object's tag
//! unchanged for as long as its owner declared that leases hold writes its own lease over the old one, but only if that
//! is still the same (`If-Match`). Only the watching process's own clock is read. As in folders, a lease saves work but
//! is not needed for correctness: two processes that compute one trial produce the same numbers.

use super::{Announcement, Bucket, WriteCondition};
use crate::{
    store::{Claim, Owner},
    world::clock,
};
use contract::Error;
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::{Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

/// The leases that this process takes in a bucket.
#[derive(Debug)]
pub(crate) struct BucketLeases {
    bucket: Bucket,
    announcement: Announcement,
    /// Number of times that this process has incremented its object.
    beats: Mutex<u64>,
    held: Mutex<BTreeSet<String>>,
    /// Tags of other processes' objects, by token, and the moment since which each is unchanged.
    seen: Mutex<BTreeMap<String, (String, Instant)>>,
}

impl BucketLeases {
    /// Announces this process to a bucket. Its leases count as dead once it has not incremented its object for
    /// `expiry`.
    pub(crate) fn open(bucket: &Bucket, expiry: Duration) -> Result<Self, Error> {
        Self::of(bucket, Owner::this_process(), expiry)
    }

    fn of(bucket: &Bucket, owner: Owner, expiry: Duration) -> Result<Self, Error> {
        let leases = Self {
            bucket: bucket.clone(),
            announcement: Announcement::new(owner, expiry),
            beats: Mutex::default(),
            held: Mutex::default(),
            seen: Mutex::default(),
        };
        leases.beat()?;
        Ok(leases)
    }

    /// Claims a trial.
    pub(crate) fn claim(&self, id: &str) -> Result<Claim, Error> {
        let said = serde_json::to_vec(&self.announcement)
            .map_err(|error| self.error("claim", id, error.to_string()))?;
        let claim = self.taken(&key(id), &said);
        let claim = claim.map_err(|problem| self.error("claim", id, problem))?;
        if claim == Claim::Mine {
            lock(&self.held).insert(id.to_owned());
        }
        Ok(claim)
    }

    fn taken(&self, key: &str, said: &[u8]) -> Result<Claim, String> {
        let objects = &self.bucket.objects;
        loop {
            if objects.put(key, said, WriteCondition::New)? {
                return Ok(Claim::Mine);
            }
            let Some(lease) = objects.get(key)? else { continue };
            let found: Option<Announcement> = serde_json::from_slice(&lease.bytes).ok();
            match found {
                // A request that was sent again found the object of its first attempt.
                Some(found) if found.owner == self.announcement.owner => return Ok(Claim::Mine),
                Some(found) if self.lives(&found)? => return Ok(Claim::Held(found.owner)),
                // A lease that cannot be read belongs to no process.
                found if objects.put(key, said, WriteCondition::Unchanged(&lease.tag))? => {
                    found.map_or(Ok(()), |dead| objects.delete(&of_owner(&dead.owner)))?;
                    return Ok(Claim::Mine);
                }
                _ => {}
            }
        }
    }

    fn lives(&self, found: &Announcement) -> Result<bool, String> {
        match found.owner.is_alive() {
            Some(alive) => Ok(alive),
            None => Ok(self.silence(&found.owner)? < found.expiry()),
        }
    }

    /// Time for which this process has seen the object of another one unchanged; the maximum if that has no object,
    /// since every living process has one.
    fn silence(&self, owner: &Owner) -> Result<Duration, String> {
        let Some(object) = self.bucket.objects.get(&of_owner(owner))? else {
            return Ok(Duration::MAX);
        };
        let (mut seen, tag) = (lock(&self.seen), object.tag);
        let last = seen
            .entry(owner.token())
            .or_insert_with(|| (tag.clone(), clock::now()));
        if last.0 != tag {
            *last = (tag, clock::now());
        }
        Ok(clock::since(last.1))
    }

    /// Releases a trial. A lease that was taken over while this process was suspended belongs to another process.
    pub(crate) fn release(&self, id: &str) -> Result<(), Error> {
        lock(&self.held).remove(id);
        let key = key(id);
        let released = self.bucket.objects.get(&key).and_then(|lease| {
            let found = lease.and_then(|lease| serde_json::from_slice::<Announcement>(&lease.bytes).ok());
            match found {
                Some(found) if found.owner == self.announcement.owner => self.bucket.objects.delete(&key),
                _ => Ok(()),
            }
        });
        released.map_err(|problem| self.error("give back", id, problem))
    }

    /// Shows that this process is alive by incrementing its object.
    pub(crate) fn beat(&self) -> Result<(), Error> {
        let mut beats = lock(&self.beats);
        *beats += 1;
        let key = of_owner(&self.announcement.owner);
        let put = self
            .bucket
            .objects
            .put(&key, beats.to_string().as_bytes(), WriteCondition::Always);
        put.map(drop)
            .map_err(|problem| self.bucket.error("renew the leases in", problem))
    }

    fn error(&self, doing: &str, id: &str, problem: String) -> Error {
        self.bucket.error(&format!("{doing} trial {id} in"), problem)
    }
}

impl Drop for BucketLeases {
    fn drop(&mut self) {
        // A lease that is left behind counts as dead after a long silence.
        let held = std::mem::take(&mut *lock(&self.held));
        for id in held {
            let _ = self.release(&id);
        }
        let _ = self.bucket.objects.delete(&of_owner(&self.announcement.owner));
    }
}

/// Key of the object that a living process increments.
fn of_owner(owner: &Owner) -> String {
    format!("owners/{}", owner.token())
}

fn key(id: &str) -> String {
    format!("leases/{id}")
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // The locked value is replaced as a whole, so that it is consistent after a panic elsewhere.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::{super::pretended::bucket, *};

    const EXPIRY: Duration = Duration::from_millis(60);

    /// A process on a machine that cannot be seen from here.
    fn on(bucket: &Bucket, host: &str) -> BucketLeases {
        let owner = Owner {
            host: host.into(),
            boot: format!("boot of {host}"),
            ..Owner::this_process()
        };
        BucketLeases::of(bucket, owner, EXPIRY).unwrap()
    }

    #[test]
    fn one_of_two_machines_gets_a_trial_until_it_gives_it_back() {
        let bucket = bucket();
        let (one, two) = (on(&bucket, "one"), on(&bucket, "two"));
        assert_eq!(one.claim("ab").unwrap(), Claim::Mine);
        assert!(matches!(two.claim("ab").unwrap(), Claim::Held(owner) if owner.host == "one"));
        assert_eq!(two.claim("cd").unwrap(), Claim::Mine);
        // The second process cannot release a lease that it does not have.
        two.release("ab").unwrap();
        assert!(matches!(two.claim("ab").unwrap(), Claim::Held(_)));
        one.release("ab").unwrap();
        assert_eq!(two.claim("ab").unwrap(), Claim::Mine);
    }

    #[test]
    fn the_lease_of_a_silent_machine_is_taken_over_and_that_of_a_living_one_is_not() {
        let bucket = bucket();
        let (dead, living, heir) = (on(&bucket, "dead"), on(&bucket, "living"), on(&bucket, "heir"));
        dead.claim("ab").unwrap();
        dead.claim("ef").unwrap();
        living.claim("cd").unwrap();
        let begun = clock::now();
        let mut taken = heir.claim("ab").unwrap();
        while taken != Claim::Mine {
            assert!(clock::since(begun) < Duration::from_secs(20));
            clock::sleep(EXPIRY / 6);
            living.beat().unwrap();
            assert!(matches!(heir.claim("cd").unwrap(), Claim::Held(_)));
            taken = heir.claim("ab").unwrap();
        }
        assert!(clock::since(begun) >= EXPIRY);
        // Its other leases no longer count.
        assert_eq!(living.claim("ef").unwrap(), Claim::Mine);
        // The dead process was only suspended: it does not remove the lease of its successor.
        dead.release("ab").unwrap();
        assert!(matches!(living.claim("ab").unwrap(), Claim::Held(owner) if owner.host == "heir"));
    }

    #[test]
    fn a_lease_that_nobody_can_read_is_nobodys() {
        let bucket = bucket();
        bucket
            .objects
            .put("leases/ab", b"{", WriteCondition::New)
            .unwrap();
        assert_eq!(on(&bucket, "one").claim("ab").unwrap(), Claim::Mine);
    }

    #[test]
    fn who_leaves_gives_everything_back() {
        let bucket = bucket();
        let one = on(&bucket, "one");
        one.claim("ab").unwrap();
        drop(one);
        assert_eq!(bucket.objects.list("").unwrap(), Vec::<String>::new());
    }
}
