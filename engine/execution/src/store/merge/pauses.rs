//! Merges trials that have paused: copies them, and compares them with those of the destination.

use super::{
    super::{Claim, Fingerprint, Partial, Store, TrialFile},
    Fate, Merge, Side, first_of, look,
};
use contract::{Error, trial_end::EndState};

impl Merge<'_> {
    /// Fate of a trial that has ended in the source and has paused in the destination: a conflict if the values up to
    /// the pause differ.
    pub(super) fn held_against_pause(
        &self,
        id: &str,
        file: &TrialFile,
        source: &Store,
    ) -> Result<Option<Fate>, Error> {
        let (Some(here), EndState::Ok) = (self.into.partial(id)?, file.end.state) else {
            return Ok(None);
        };
        let there = Partial {
            file: file.clone(),
            table: source.recorded(id, &file.end)?,
        };
        let conflict = || Fate::Conflict {
            source: Fingerprint::of(file, source),
            destination: Fingerprint::of(&here.file, self.into),
        };
        Ok((!here.begins(&there)).then(conflict))
    }

    /// Fate of a trial that has not ended in the source: its record at a pause is copied.
    pub(super) fn paused(&self, id: &str, source: &Store) -> Result<Fate, Error> {
        let Some((bytes, there)) = source.partial_bytes(id)? else {
            return Ok(Fate::Unfinished);
        };
        if let Some(fate) = self.known_of(id, &there, source)? {
            return Ok(fate);
        }
        let Some(leases) = self.leases else {
            return Ok(Fate::Taken);
        };
        leases.beat()?;
        if let Claim::Held(owner) = leases.claim(id)? {
            let side = Side::Destination;
            return Ok(Fate::Running { side, owner });
        }
        // Another program may have continued it before the lease was taken.
        let fate = match self.known_of(id, &there, source) {
            Ok(None) => self.into.write_partial(id, &bytes, &there).map(|()| Fate::Taken),
            Ok(Some(fate)) => Ok(fate),
            Err(error) => Err(error),
        };
        leases.release(id)?;
        fate
    }

    /// Fate of a trial that has paused in the source, if the destination knows as much or more, or has other values;
    /// `None` if it knows less.
    pub(super) fn known_of(&self, id: &str, there: &Partial, source: &Store) -> Result<Option<Fate>, Error> {
        let here = match look(self.into, id)? {
            Err(findings) => {
                let side = Side::Destination;
                return Ok(Some(Fate::Damaged { side, findings }));
            }
            Ok(Some(file)) if file.end.state == EndState::Ok => Some(Partial {
                table: self.into.recorded(id, &file.end)?,
                file,
            }),
            Ok(_) => self.into.partial(id)?,
        };
        let Some(here) = here else { return Ok(None) };
        if there.begins(&here) {
            return Ok(Some(Fate::Same));
        }
        let conflict = || Fate::Conflict {
            source: Fingerprint::of(&there.file, source),
            destination: Fingerprint::of(&here.file, self.into),
        };
        Ok((!here.begins(there)).then(conflict))
    }

    /// Copies the record of one trial at a pause, under its lease, which the caller already holds; false if it is known
    /// here.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the destination has other values, and errors of reading or writing it.
    pub(in crate::store) fn pause_under_own_lease(
        &self,
        id: &str,
        bytes: &[u8],
        there: &Partial,
    ) -> Result<bool, Error> {
        // Only the wording of a conflict depends on the store, and it is not used here.
        match self.known_of(id, there, self.into)? {
            None => self.into.write_partial(id, bytes, there).map(|()| true),
            Some(Fate::Same) => Ok(false),
            Some(Fate::Damaged { findings, .. }) => Err(first_of(self.into, findings)),
            Some(_) => Err(Error::Damaged {
                path: self.into.folder(id),
                problem: "what the trial had recorded at a pause elsewhere has other numbers".into(),
            }),
        }
    }
}
