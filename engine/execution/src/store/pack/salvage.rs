//! Salvages a damaged pack: intact trials are written into a new one, and the old one is set aside.

use super::{ENDING, FOLDER, Pack, ShortTrial, form::id_of, is_pack};
use crate::{
    store::{
        Store,
        fsck::{Check, Fault},
        inside, remove,
    },
    world::fs::{self, File},
};
use contract::{Error, digest};
use std::{
    io::ErrorKind,
    path::{Path, PathBuf},
};

impl Store {
    /// Sets a damaged pack aside as `to` and writes its intact trials into a new one, which has the name of the old one
    /// if all are intact. A pack that is gone is skipped.
    ///
    /// # Errors
    /// [`Error::File`] if a pack cannot be read or written.
    pub(in crate::store) fn salvage(&self, path: &Path, to: &Path) -> Result<(), Error> {
        let old = self.root.join(path);
        let Some(pack) = Pack::open(&old)? else {
            return Ok(());
        };
        match fs::hard_link(&old, to) {
            Err(source) if source.kind() != ErrorKind::AlreadyExists => {
                return Err(Error::file("set aside as", to)(source));
            }
            _ => {}
        }
        let mut whole = pack.whole().peekable();
        let new = match whole.peek() {
            Some(_) => self.new_pack(&mut whole)?.pack,
            None => None,
        };
        // Opened packs are cached by their names.
        self.forget_pack(path);
        if new.as_deref() == Some(path) {
            Ok(())
        } else {
            remove(&old)
        }
    }
}

impl Pack {
    /// The intact trials of the pack, in the order of their ids, each once.
    fn whole(&self) -> impl Iterator<Item = (u128, ShortTrial)> {
        let mut last = None;
        self.index.entries.iter().filter_map(move |entry| {
            let trial = self.trial_at(entry).ok()?;
            let is_new = last != Some(entry.id) && trial.is_whole(&id_of(entry.id));
            is_new.then(|| {
                last = Some(entry.id);
                (entry.id, trial)
            })
        })
    }

    fn lost(&self) -> impl Iterator<Item = String> {
        let is_whole = |id: &String| {
            let trial = self.trial(id);
            trial.is_ok_and(|trial| trial.is_some_and(|trial| trial.is_whole(id)))
        };
        self.ids().filter(move |id| !is_whole(id))
    }
}

impl Check<'_> {
    /// Checks every pack.
    pub(in crate::store) fn packs(&mut self) {
        for name in self.names(Path::new(FOLDER)) {
            let path = Path::new(FOLDER).join(&name);
            if name.starts_with('.') && name.ends_with(".tmp") {
                self.note(path, Fault::Left, "its writing was never finished", None);
            } else if !is_pack(&name) || !inside::is_file(&self.store.root.join(&path)) {
                self.foreign(path, "the folder of packs has no such file");
            } else if let Err(error) = self.pack(&name, path.clone()) {
                self.unreadable(&path, &error);
            }
        }
    }

    fn pack(&mut self, name: &str, path: PathBuf) -> Result<(), Error> {
        let whole_path = self.store.root.join(&path);
        let digest = File::open(&whole_path).and_then(digest::of_file);
        let digest = digest.map_err(Error::file("read", &whole_path))?;
        let Some(pack) = Pack::open(&whole_path)? else {
            return Ok(());
        };
        let has_folder = |store: &Store, id: &str| fs::is_taken(&store.folder(id).join("trial.json"));
        let packed = pack.ids().filter(|id| !has_folder(self.store, id)).count();
        if name.strip_suffix(ENDING) == Some(&digest) {
            self.found.whole += packed;
            return Ok(());
        }
        // Another pack, or a folder, may have the trial that is lost here.
        let is_lost = |id: &String| !matches!(self.store.sound(id), Ok(Some(_)));
        let lost: Vec<String> = pack.lost().filter(is_lost).collect();
        self.found.whole += packed.saturating_sub(lost.len());
        let problem = if pack.index.is_whole {
            "its hash is not the one that names it"
        } else {
            "its end is not what was written, so that trials of which no other file knows may be lost; they run again"
        };
        self.note(path.clone(), Fault::Damaged, problem, None);
        for id in lost {
            self.note_trial(&path, "a trial in it is not what was packed", &id);
        }
        Ok(())
    }
}
