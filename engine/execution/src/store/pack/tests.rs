//! Packs in a store, intact and damaged.

mod damage;

use super::*;
use crate::store::{Fault, Leases, Merge, Packing, stub};
use contract::{Phase, Recorder, trial::Trial, trial_result::TrialResult};
use std::{fs, time::Duration};

fn trial(seed: u64) -> Trial {
    stub::trial(4, seed)
}

/// A store in a temporary folder.
pub(super) struct Bench {
    folder: tempfile::TempDir,
    pub(super) store: Store,
}

impl Bench {
    pub(super) fn finished(seeds: u64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path().join("store"));
        let bench = Self { folder, store };
        (0..seeds).for_each(|seed| bench.finish(seed));
        bench
    }

    pub(super) fn finish(&self, seed: u64) {
        self.finish_in(seed, 1.0);
    }

    fn finish_in(&self, seed: u64, wall_s: f64) {
        let mut record = Recorder::default();
        record.add(Phase::Final, 10, 0, 0, "return", seed as f64);
        self.store.finish(&trial(seed), &record, wall_s).unwrap();
    }

    fn packed(seeds: u64) -> Self {
        let bench = Self::finished(seeds);
        bench.pack();
        bench
    }

    fn pack(&self) -> Packing {
        let leases = Leases::open(&self.store, Duration::from_secs(30)).unwrap();
        self.store.pack(&leases, Duration::ZERO).unwrap()
    }

    /// The only pack.
    fn file(&self) -> PathBuf {
        let all = names(&self.store.root.join(FOLDER)).unwrap();
        assert_eq!(all.len(), 1, "{all:?}");
        self.store.root.join(FOLDER).join(&all[0])
    }

    /// The value that a trial recorded, read through a newly opened store.
    fn value(&self, seed: u64) -> Option<f64> {
        let result = Store::at(&self.store.root).load(&trial(seed).into()).unwrap();
        result.rows.first().map(|row| row.value)
    }

    /// Changes the metrics of a trial.
    fn damage(&self, seed: u64) {
        self.damage_at(seed, |entry| entry.acknowledgement as usize + 20);
    }

    fn damage_acknowledgement(&self, seed: u64) {
        self.damage_at(seed, |_| 20);
    }

    fn damage_at(&self, seed: u64, place: impl Fn(&PackEntry) -> usize) {
        let pack = Pack::open(&self.file()).unwrap().unwrap();
        let entry = *pack.entry(&trial(seed).id).unwrap();
        let mut bytes = fs::read(self.file()).unwrap();
        bytes[entry.at as usize + place(&entry)] ^= 1;
        fs::write(self.file(), bytes).unwrap();
    }
}

#[test]
fn packed_trials_are_read_as_before_and_have_no_folders() {
    let bench = Bench::finished(20);
    let before: Vec<_> = (0..20)
        .map(|seed| bench.store.file(&trial(seed).id).unwrap())
        .collect();
    let done = bench.pack();
    assert_eq!((done.packed, done.removed, done.kept), (20, 20, 0));
    assert!(bench.store.ids_with_folders().is_empty());
    let store = Store::at(&bench.store.root);
    let trials: Vec<Trial> = (0..21).map(trial).collect();
    let found = store.ends(&trials);
    assert!(found.unreadable.is_empty() && found.all[20].is_none());
    for seed in 0..20 {
        assert_eq!(bench.value(seed), Some(seed as f64));
        assert_eq!(store.file(&trial(seed).id).unwrap(), before[seed as usize]);
        assert_eq!(found.all[seed as usize], store.end(&trial(seed).id).unwrap());
    }
    assert_eq!(store.ids().len(), 20);
    assert_eq!(store.check(false, Vec::new()).unwrap().whole, 20);
    assert_eq!(bench.pack(), Packing::default(), "nothing is new");
}

#[test]
fn a_store_that_was_open_sees_what_another_process_packed() {
    let bench = Bench::finished(3);
    let other = Store::at(&bench.store.root);
    assert!(other.end(&trial(0).id).unwrap().is_some());
    bench.pack();
    assert!(other.end(&trial(0).id).unwrap().is_some());
    bench.finish(3);
    assert_eq!(bench.pack().packed, 1);
    assert_eq!(other.load(&trial(3).into()).unwrap().rows.len(), 1);
}

#[test]
fn a_pack_that_was_interrupted_is_ended_by_the_next_one() {
    let bench = Bench::finished(4);
    let folder = bench.store.folder(&trial(1).id);
    let left = fs::read(folder.join("metrics.parquet")).unwrap();
    bench.pack();
    // As if the process was killed before it removed the second file of a trial.
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("metrics.parquet"), left).unwrap();
    fs::write(bench.store.root.join(FOLDER).join(".host-1-ab.tmp"), "half").unwrap();
    let found = bench.store.check(false, Vec::new()).unwrap();
    assert_eq!(found.whole, 4);
    assert!(
        found
            .findings
            .iter()
            .all(|it| it.fault == Fault::Left && it.trial.is_none())
    );
    assert_eq!(found.findings.len(), 2);
    let done = bench.pack();
    assert_eq!((done.packed, done.removed), (0, 1));
    assert!(!folder.exists());
}

#[test]
fn a_folder_with_other_bytes_than_its_pack_stays_and_counts() {
    let bench = Bench::packed(2);
    bench.finish_in(1, 2.0);
    let other = bench.store.file(&trial(1).id).unwrap();
    let text = fs::read(bench.store.folder(&trial(1).id).join("trial.json")).unwrap();
    let packed = Pack::open(&bench.file())
        .unwrap()
        .unwrap()
        .trial(&trial(1).id)
        .unwrap()
        .unwrap();
    assert_ne!(text, packed.acknowledgement, "each says how long it took");
    assert_eq!(bench.store.file(&trial(1).id).unwrap(), other);
    let done = bench.pack();
    assert_eq!(
        (done.packed, done.removed),
        (1, 1),
        "a second pack has the later one"
    );
    assert_eq!(bench.value(1), Some(1.0));
}

#[test]
fn a_damaged_trial_costs_itself_and_the_others_move_into_a_new_pack() {
    let bench = Bench::packed(8);
    let old = bench.file();
    bench.damage(5);
    let store = Store::at(&bench.store.root);
    let found = store.check(true, Vec::new()).unwrap();
    let lost: Vec<_> = found.findings.iter().filter_map(|it| it.trial.clone()).collect();
    assert_eq!((found.whole, lost), (7, vec![trial(5).id]));
    assert_ne!(bench.file(), old);
    let aside = store.root.join(found.aside.unwrap());
    assert!(
        aside.join(FOLDER).join(old.file_name().unwrap()).exists(),
        "nothing is thrown away"
    );
    assert_eq!(bench.value(5), None, "it runs again");
    assert!(
        (0..8)
            .filter(|seed| *seed != 5)
            .all(|seed| bench.value(seed) == Some(seed as f64))
    );
    assert_eq!(Store::at(&store.root).check(false, Vec::new()).unwrap().whole, 7);
}

#[test]
fn before_a_run_a_damaged_trial_of_a_pack_is_made_missing() {
    let bench = Bench::packed(4);
    bench.damage(2);
    let store = Store::at(&bench.store.root);
    let id = trial(2).id;
    let end = store.end(&id).unwrap().unwrap();
    assert_eq!(store.with_damaged_metrics(&[(&id, &end)]), [&id]);
    let leases = Leases::open(&store, Duration::from_secs(30)).unwrap();
    store.heal(&[&id], &leases).unwrap();
    assert_eq!(store.end(&id).unwrap(), None);
    assert!([0, 1, 3].iter().all(|seed| bench.value(*seed).is_some()));
    bench.finish(2);
    assert_eq!(bench.value(2), Some(2.0));
}

#[test]
fn a_pack_without_its_end_still_gives_its_trials() {
    let bench = Bench::packed(6);
    let bytes = fs::read(bench.file()).unwrap();
    fs::write(bench.file(), &bytes[..bytes.len() - 100]).unwrap();
    assert!((0..6).all(|seed| bench.value(seed) == Some(seed as f64)));
    let found = bench.store.check(true, Vec::new()).unwrap();
    assert_eq!((found.whole, found.findings.len()), (6, 1));
    assert!((0..6).all(|seed| bench.value(seed) == Some(seed as f64)));
    assert!(
        Store::at(&bench.store.root)
            .check(false, Vec::new())
            .unwrap()
            .findings
            .is_empty()
    );
}

#[test]
fn strangers_in_the_folder_of_packs_are_set_aside() {
    let bench = Bench::packed(2);
    let folder = bench.store.root.join(FOLDER);
    fs::write(folder.join("notes.txt"), "mine").unwrap();
    fs::create_dir(folder.join(format!("{}.pack", "0".repeat(32)))).unwrap();
    let found = bench.store.check(true, Vec::new()).unwrap();
    assert_eq!(found.whole, 2);
    assert!(found.findings.iter().all(|it| it.fault == Fault::Foreign));
    assert_eq!(names(&folder).unwrap().len(), 1);
}

#[test]
fn trials_of_packs_are_merged_bit_by_bit() {
    let bench = Bench::packed(3);
    let into = Store::at(bench.folder.path().join("into"));
    let leases = Leases::open(&into, Duration::from_secs(30)).unwrap();
    let mut merge = Merge::new(&into, Some(&leases)).unwrap();
    let mut count = 0;
    merge.take(&bench.store, &mut |_| count += 1).unwrap();
    assert_eq!(count, 3);
    for seed in 0..3 {
        let id = trial(seed).id;
        assert_eq!(into.files(&id).unwrap(), bench.store.files(&id).unwrap());
    }
    drop(leases);
    let mut fates = Vec::new();
    Merge::new(&bench.store, None)
        .unwrap()
        .take(&into, &mut |merged| fates.push(merged.fate))
        .unwrap();
    assert!(
        fates.iter().all(|fate| *fate == crate::store::Fate::Same),
        "{fates:?}"
    );
}

/// Seeds whose trials share a group of folders, which is then listed.
fn seeds_of_one_group(count: usize) -> Vec<u64> {
    let is_there = |seed: &u64| trial(*seed).id.starts_with("00");
    (0..).filter(is_there).take(count).collect()
}

#[test]
fn many_trials_at_once_are_the_trials_one_by_one() {
    let bench = Bench::finished(0);
    let seeds = seeds_of_one_group(12);
    seeds[..8].iter().for_each(|&seed| bench.finish(seed));
    bench.pack();
    bench.damage(seeds[1]);
    seeds[8..10].iter().for_each(|&seed| bench.finish(seed));
    let trials: Vec<Arc<Trial>> = seeds.iter().map(|&seed| trial(seed).into()).collect();
    let store = Store::at(&bench.store.root);
    let (all, unreadable) = store.load_all(&trials.iter().collect::<Vec<_>>());
    for (loaded, trial) in all.iter().zip(&trials) {
        let one = store
            .load(trial)
            .unwrap_or(TrialResult::missing(Arc::clone(trial)));
        assert_eq!((&loaded.trial.id, &loaded.end), (&one.trial.id, &one.end));
        assert_eq!((&loaded.names, &loaded.rows), (&one.names, &one.rows));
    }
    let rows: Vec<usize> = all.iter().map(|it| it.rows.len()).collect();
    assert_eq!(rows, [1, 0, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0]);
    let [(1, error)] = &unreadable[..] else {
        panic!("one trial is damaged: {unreadable:?}")
    };
    assert_eq!(error.to_string(), store.load(&trials[1]).unwrap_err().to_string());
}

#[test]
fn ends_are_told_without_the_trials_and_a_run_looks_at_them() {
    let bench = Bench::finished(0);
    let seeds = seeds_of_one_group(6);
    seeds.iter().for_each(|&seed| bench.finish(seed));
    bench.pack();
    let trials: Vec<Trial> = seeds.iter().map(|&seed| trial(seed)).collect();
    let whole = Store::at(&bench.store.root).ends(&trials).all;
    assert!(whole.iter().all(Option::is_some));
    let told = |store: &Store| store.stored_of(&trials, |it| it).all;
    for (trial, told) in trials.iter().zip(told(&Store::at(&bench.store.root))) {
        assert_eq!(told, bench.store.stored(&trial.id).unwrap());
    }
    bench.damage_acknowledgement(seeds[2]);
    let store = Store::at(&bench.store.root);
    assert!(told(&store).iter().all(Option::is_some), "the pack tells them");
    let looked_at: Vec<bool> = store.ends(&trials).all.iter().map(Option::is_some).collect();
    assert_eq!(looked_at, [true, true, false, true, true, true]);
}

#[test]
fn a_pack_without_outlines_is_read_trial_by_trial() {
    let bench = Bench::finished(0);
    let seeds = seeds_of_one_group(5);
    seeds.iter().for_each(|&seed| bench.finish(seed));
    bench.pack();
    let bytes = fs::read(bench.file()).unwrap();
    let line = bytes.windows(9).rposition(|it| it == b"outlines ").unwrap();
    let mut changed = bytes.clone();
    changed[line] = b'O';
    fs::write(bench.file(), changed).unwrap();
    let trials: Vec<Trial> = seeds.iter().map(|&seed| trial(seed)).collect();
    let store = Store::at(&bench.store.root);
    let told = store.stored_of(&trials, |it| it.end).all;
    assert_eq!(told, store.ends(&trials).all);
    assert!(told.iter().all(Option::is_some));
}
