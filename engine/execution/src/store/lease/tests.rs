//! Tests of the owner and the end of a lease.

#![expect(clippy::disallowed_methods, reason = "leases are as old as the test says")]

use super::*;

const ID: &str = "0123456789abcdef0123456789abcdef";

fn leases(store: &Store) -> Leases {
    Leases::open(store, Duration::from_secs(30)).unwrap()
}

/// Leaves the lease of another process behind, which holds for 30 s.
fn lease_of(store: &Store, owner: &Owner) {
    lease_for(store, owner, 30.0);
}

fn lease_for(store: &Store, owner: &Owner, lease_expiry_s: f64) {
    fs::create_dir_all(store.folder(ID)).unwrap();
    let said = Announcement {
        owner: owner.clone(),
        lease_expiry_s,
    };
    fs::write(store.folder(ID).join("lease"), serde_json::to_vec(&said).unwrap()).unwrap();
}

/// A process that cannot be seen from here.
fn elsewhere() -> Owner {
    Owner {
        host: "another-host".into(),
        ..Owner::this_process()
    }
}

fn set_renewed(path: &Path, time: SystemTime) {
    std::fs::OpenOptions::new()
        .write(true)
        .open(path)
        .unwrap()
        .set_modified(time)
        .unwrap();
}

#[test]
fn a_lease_is_exclusive_until_it_is_given_back() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path());
    let leases = leases(&store);
    assert_eq!(leases.claim(ID).unwrap(), Claim::Mine);
    assert!(matches!(leases.claim(ID).unwrap(), Claim::Held(owner) if owner == Owner::this_process()));
    assert_eq!(store.running(ID), Some(Owner::this_process()));
    leases.release(ID).unwrap();
    assert_eq!(store.running(ID), None);
    assert_eq!(leases.claim(ID).unwrap(), Claim::Mine);
}

#[test]
fn many_threads_ask_and_one_gets_it() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path());
    let leases = leases(&store);
    // The lease of a dead process is in the way.
    lease_of(
        &store,
        &Owner {
            started_ticks: 1,
            ..Owner::this_process()
        },
    );
    let won = std::thread::scope(|scope| {
        let asked: Vec<_> = (0..16)
            .map(|_| scope.spawn(|| leases.claim(ID).unwrap()))
            .collect();
        asked
            .into_iter()
            .map(|thread| thread.join().unwrap())
            .filter(|claim| *claim == Claim::Mine)
            .count()
    });
    assert_eq!(won, 1);
}

#[test]
fn a_lease_dies_with_its_process() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path());
    let this = Owner::this_process();
    lease_of(
        &store,
        &Owner {
            started_ticks: this.started_ticks + 1,
            ..this
        },
    );
    assert_eq!(store.running(ID), None);
    assert_eq!(leases(&store).claim(ID).unwrap(), Claim::Mine);
}

#[test]
fn a_lease_of_a_process_that_cannot_be_seen_dies_of_its_silence() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path());
    let this = Owner::this_process();
    let (boot, _) = this.boot.split_once(' ').unwrap();
    let unseen = [
        elsewhere(),
        Owner {
            boot: "another boot".into(),
            ..this.clone()
        },
        Owner {
            boot: format!("{boot} pid:[1]"),
            ..this.clone()
        },
    ];
    for owner in unseen {
        lease_of(&store, &owner);
        assert_eq!(store.running(ID), Some(owner.clone()));
        assert_eq!(leases(&store).claim(ID).unwrap(), Claim::Held(owner.clone()));
        lease_for(&store, &owner, 0.0);
        let leases = leases(&store);
        assert_eq!(leases.claim(ID).unwrap(), Claim::Mine);
        leases.release(ID).unwrap();
    }
    lease_of(&store, &elsewhere());
    set_renewed(
        &store.folder(ID).join("lease"),
        SystemTime::now() - Duration::from_secs(3600),
    );
    assert_eq!(store.running(ID), None, "it was silent for an hour");
}

#[test]
fn a_lease_that_was_renewed_in_the_future_is_neither_dead_at_once_nor_immortal() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path());
    let ahead = |hours: u64| SystemTime::now() + Duration::from_secs(3600 * hours);
    lease_for(&store, &elsewhere(), 0.2);
    let (lease, leases) = (store.folder(ID).join("lease"), leases(&store));
    for hours in [2, 3] {
        // Its owner renews it, even if only according to its own clock.
        set_renewed(&lease, ahead(hours));
        assert_eq!(leases.claim(ID).unwrap(), Claim::Held(elsewhere()));
        std::thread::sleep(Duration::from_millis(150));
        assert_eq!(leases.claim(ID).unwrap(), Claim::Held(elsewhere()), "{hours}");
    }
    std::thread::sleep(Duration::from_millis(250));
    assert_eq!(leases.claim(ID).unwrap(), Claim::Mine);
}

#[test]
fn an_owner_whose_file_was_removed_writes_it_again_and_renews_its_leases_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path());
    let leases = leases(&store);
    assert_eq!(leases.claim(ID).unwrap(), Claim::Mine);
    let lease = store.folder(ID).join("lease");
    fs::remove_file(&leases.file).unwrap();
    set_renewed(&lease, SystemTime::now() - Duration::from_secs(60));
    leases.beat().unwrap();
    assert!(
        modified(&lease).unwrap().elapsed().unwrap() < Duration::from_secs(30),
        "the lease is renewed"
    );
    fs::remove_file(&leases.file).unwrap();
    leases.release(ID).unwrap();
    assert!(!lease.exists(), "what is ours is known by what it says");
    fs::remove_dir_all(store.root().join("owners")).unwrap();
    assert_eq!(leases.claim(ID).unwrap(), Claim::Mine);
    assert_eq!(store.owners(), [Owner::this_process()]);
}

#[test]
fn a_living_owner_that_cannot_be_seen_keeps_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path());
    let namespace = Owner {
        boot: "another boot".into(),
        ..Owner::this_process()
    };
    let file = store.root().join("owners").join("other.json");
    fs::create_dir_all(file.parent().unwrap()).unwrap();
    fs::write(
        &file,
        serde_json::to_vec(&Announcement {
            owner: namespace,
            lease_expiry_s: 30.0,
        })
        .unwrap(),
    )
    .unwrap();
    drop(leases(&store));
    assert!(file.exists());
    set_renewed(&file, SystemTime::now() - Duration::from_secs(3600));
    drop(leases(&store));
    assert!(!file.exists(), "it was silent for an hour");
}

#[test]
fn a_beat_renews_every_lease_and_changes_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path());
    let leases = leases(&store);
    leases.claim(ID).unwrap();
    let lease = store.folder(ID).join("lease");
    let (text, before) = (fs::read(&lease).unwrap(), modified(&lease).unwrap());
    std::thread::sleep(Duration::from_millis(20));
    leases.beat().unwrap();
    assert_eq!(fs::read(&lease).unwrap(), text);
    assert!(modified(&lease).unwrap() > before);
}

#[test]
fn a_damaged_lease_holds_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path());
    fs::create_dir_all(store.folder(ID)).unwrap();
    fs::write(store.folder(ID).join("lease"), "{\"host\": ").unwrap();
    assert_eq!(leases(&store).claim(ID).unwrap(), Claim::Mine);
}

/// An owner may announce any expiry, because of a fault or a wrong clock; no process waits for an absurd one.
#[test]
fn an_expiry_that_nobody_could_wait_for_is_not_believed() {
    for said in [1e18, 86_401.0, f64::INFINITY, -1.0] {
        let announcement = Announcement {
            owner: elsewhere(),
            lease_expiry_s: said,
        };
        assert_eq!(announcement.expiry(), Duration::from_secs(30), "{said}");
    }
    assert_eq!(
        Announcement::new(elsewhere(), LONGEST_EXPIRY).expiry(),
        LONGEST_EXPIRY
    );
}
