//! Packs with any bit changed, and packs truncated anywhere: a trial that is read is correct, or it is not read.

use super::{super::form, Bench, trial};
use crate::store::{Store, StoredTrial, pack::ShortTrial};
use contract::Error;
use std::{fs, io::Cursor, path::Path};

/// Number of trials in the packs.
const COUNT: u64 = 3;

/// The intact trials in the bytes of a pack, by place.
fn held(bytes: &[u8]) -> Vec<Option<ShortTrial>> {
    let index = form::index(&mut Cursor::new(bytes)).unwrap();
    let slice = |at: u64, length: u32| {
        let at = usize::try_from(at).unwrap();
        bytes[at..at + length as usize].to_vec()
    };
    let mut found = vec![None; usize::try_from(COUNT).unwrap()];
    for entry in &index.entries {
        let short = ShortTrial {
            acknowledgement: slice(entry.at, entry.acknowledgement),
            metrics: slice(entry.at + u64::from(entry.acknowledgement), entry.metrics),
        };
        let id = form::id_of(entry.id);
        let place = (0..COUNT).position(|seed| trial(seed).id == id);
        if let Some(place) = place.filter(|_| short.is_whole(&id)) {
            found[place] = Some(short);
        }
    }
    found
}

/// Asserts that every trial that is found is correct, and returns their number.
fn n_true(found: &[Option<ShortTrial>], whole: &[Option<ShortTrial>], place: usize) -> usize {
    for (one, other) in found.iter().zip(whole) {
        assert!(one.is_none() || one == other, "other content at byte {place}");
    }
    found.iter().flatten().count()
}

#[test]
fn a_changed_bit_costs_one_trial_at_most_and_a_cut_those_that_it_takes_away() {
    let bench = Bench::packed(COUNT);
    let bytes = fs::read(bench.file()).unwrap();
    let whole = held(&bytes);
    assert!(whole.iter().all(Option::is_some));
    let entries = form::index(&mut Cursor::new(&bytes)).unwrap().entries;
    // Metrics are compared with a single hash, whichever of their bits changes, so one bit of each byte is enough.
    let is_metrics = |place: u64| {
        let metrics =
            |entry: &form::PackEntry| entry.at + u64::from(entry.acknowledgement)..entry.at + entry.length();
        entries.iter().any(|entry| metrics(entry).contains(&place))
    };
    for place in 0..bytes.len() {
        let kept = entries
            .iter()
            .filter(|entry| entry.at + entry.length() <= place as u64);
        assert_eq!(
            n_true(&held(&bytes[..place]), &whole, place),
            kept.count(),
            "cut at {place}"
        );
        for bit in (0..8).filter(|bit| *bit == place % 8 || !is_metrics(place as u64)) {
            let mut changed = bytes.clone();
            changed[place] ^= 1 << bit;
            let left = n_true(&held(&changed), &whole, place);
            assert!(left + 1 >= whole.len(), "bit {bit} of byte {place}");
        }
    }
}

/// Asserts that a store with a pack of these bytes reports each trial correctly, as missing, or as damaged.
fn holds(root: &Path, pack: &Path, bytes: &[u8], truth: &[StoredTrial]) {
    fs::write(pack, bytes).unwrap();
    let store = Store::at(root);
    let trials: Vec<_> = (0..COUNT).map(trial).collect();
    assert!(store.ends(&trials).unreadable.is_empty());
    for (told, truth) in store.stored_of(&trials, |it| it).all.iter().zip(truth) {
        assert!(told.as_ref().is_none_or(|told| told == truth));
    }
    for (seed, trial) in trials.into_iter().enumerate() {
        match store.load(&trial.into()) {
            Ok(result) => assert!(
                result
                    .rows
                    .iter()
                    .all(|row| row.value.to_bits() == (seed as f64).to_bits())
            ),
            Err(Error::Damaged { path, .. }) => assert_eq!(path, pack),
            Err(error) => panic!("{error}"),
        }
    }
    let found = store.check(false, Vec::new()).unwrap();
    let is_named = found.findings.iter().any(|it| root.join(&it.path) == pack);
    assert!(is_named, "fsck says nothing of the pack: {found:?}");
}

#[test]
fn a_store_with_a_damaged_pack_says_nothing_that_is_not_true_and_names_the_pack() {
    let bench = Bench::packed(COUNT);
    let (root, pack) = (bench.store.root.clone(), bench.file());
    let bytes = fs::read(&pack).unwrap();
    let truth: Vec<StoredTrial> = (0..COUNT)
        .map(|seed| bench.store.stored(&trial(seed).id).unwrap().unwrap())
        .collect();
    // The step shares no factor with the lengths of a pack's parts.
    for place in (0..bytes.len()).step_by(23) {
        let mut changed = bytes.clone();
        changed[place] ^= 1 << (place % 8);
        holds(&root, &pack, &changed, &truth);
        holds(&root, &pack, &bytes[..place], &truth);
    }
}
