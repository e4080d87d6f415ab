//! Files of strangers that the program reads: files that once broke a reader, and the most different ones that a long
//! search came upon. `tests/fuzz/README.md` says how to search on.

#[path = "fuzz/targets.rs"]
mod targets;

use crate::program::repository;
use std::fs;

#[test]
fn readers_stand_what_strangers_hand_them() {
    for (name, target) in targets::ALL {
        let folder = repository().join("tests/fixtures/strangers").join(name);
        let files = fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
        let mut paths: Vec<_> = files.map(|file| file.unwrap().path()).collect();
        assert!(paths.len() >= 5, "{} holds too few examples", folder.display());
        paths.sort();
        for path in paths {
            let bytes = fs::read(&path).unwrap();
            let outcome = std::panic::catch_unwind(|| target(&bytes));
            assert!(outcome.is_ok(), "{} breaks it", path.display());
        }
    }
}
