//! Datasets are read back bit by bit and written with the same bytes each time, and errors name the fault of damaged
//! ones.

use super::{Dataset, DatasetWriter, Episode, FOLDER};
use crate::{Channel, End, Error, Interface, Seat, Space};
use proptest::prelude::*;
use std::{
    fs,
    path::{Path, PathBuf},
};

fn interface(observation: Space, action: Space) -> Interface {
    Interface {
        seats: vec![Seat {
            name: String::new(),
            observation,
            action,
        }],
        state: vec![Channel::new("hidden", "V")],
    }
}

fn pack() -> Interface {
    let observed = vec![
        Channel::new("voltage", "V").typical(3.4, 0.2),
        Channel::new("demand", "W").within(0.0, f64::INFINITY),
    ];
    interface(
        Space::Box(observed),
        Space::Simplex(vec!["left".into(), "right".into()]),
    )
}

fn episode(n: usize, end: End) -> Episode {
    #[allow(clippy::cast_precision_loss, reason = "a few rows")]
    let number = |at: usize| at as f64 / 3.0;
    Episode {
        observations: (0..=n).map(|at| vec![number(at), -number(at)]).collect(),
        actions: (0..n)
            .map(|at| vec![1.0 / (number(at) + 1.0), 1.0 - 1.0 / (number(at) + 1.0)])
            .collect(),
        rewards: (0..n).map(|at| number(at) - 1.0).collect(),
        states: Vec::new(),
        end,
    }
}

fn write(trial: &Path, interface: &Interface, episodes: &[Episode]) {
    let mut writer = DatasetWriter::create(trial, interface).unwrap();
    episodes
        .iter()
        .for_each(|episode| writer.episode(episode).unwrap());
    writer.finish().unwrap();
}

fn files(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            found.push((path.clone(), fs::read(&path).unwrap()));
        }
    }
    found.sort();
    found
}

#[test]
fn the_files_are_minaris_and_the_bytes_the_same_each_time() {
    let trial = tempfile::tempdir().unwrap();
    let write = || {
        write(
            trial.path(),
            &pack(),
            &[episode(3, End::Terminated), episode(1, End::Truncated)],
        );
        files(trial.path())
    };
    let (first, second) = (write(), write());
    assert!(first == second);
    let names: Vec<_> = first
        .iter()
        .map(|(path, _)| path.strip_prefix(trial.path()).unwrap().to_str().unwrap())
        .collect();
    let expected = [
        "dataset/data/0/metadata.json",
        "dataset/data/0/part-0.parquet",
        "dataset/data/1/metadata.json",
        "dataset/data/1/part-0.parquet",
        "dataset/data/metadata.json",
        "dataset/interface.json",
    ];
    assert_eq!(names, expected);
    assert!(
        names
            .iter()
            .all(|name| crate::ArtifactKind::Dataset.has_file(name))
    );
}

#[test]
fn a_shorter_dataset_leaves_nothing_of_a_longer_one() {
    let trial = tempfile::tempdir().unwrap();
    write(
        trial.path(),
        &pack(),
        &[episode(3, End::Terminated), episode(2, End::Terminated)],
    );
    write(trial.path(), &pack(), &[episode(1, End::Truncated)]);
    assert_eq!(
        Dataset::read(trial.path()).unwrap().episodes,
        [episode(1, End::Truncated)]
    );
    assert!(!trial.path().join("dataset/data/1").exists());
    Dataset::write_empty(trial.path(), &pack()).unwrap();
    assert!(Dataset::read(trial.path()).unwrap().episodes.is_empty());
}

#[test]
fn transitions_are_the_decisions_in_order_and_only_the_last_ends() {
    let dataset = Dataset {
        interface: pack(),
        episodes: vec![episode(2, End::Truncated), episode(1, End::Terminated)],
    };
    let transitions = dataset.transitions().unwrap();
    assert_eq!(
        transitions.iter().map(|it| it.end).collect::<Vec<_>>(),
        [None, Some(End::Truncated), Some(End::Terminated)]
    );
    assert_eq!(transitions[0].next_observation, transitions[1].observation);
    assert_eq!(transitions[1].next_observation.seats, [[2.0 / 3.0, -2.0 / 3.0]]);
    assert_eq!(
        (transitions[1].rewards.clone(), transitions[2].action.clone()),
        (vec![1.0 / 3.0 - 1.0], vec![vec![1.0, 0.0]])
    );
}

fn refusal(trial: &Path, here: &Interface) -> String {
    match Dataset::read_for(trial, here) {
        Err(error @ Error::OtherInterface { .. }) => error.to_string().split(": ").nth(1).unwrap().to_owned(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_dataset_of_another_environment_is_refused_and_says_what_differs() {
    let trial = tempfile::tempdir().unwrap();
    write(trial.path(), &pack(), &[episode(1, End::Terminated)]);
    let changed = |change: &dyn Fn(&mut Interface)| {
        let mut here = pack();
        change(&mut here);
        here
    };
    let observed = |here: &mut Interface, change: &dyn Fn(&mut Vec<Channel>)| {
        if let Space::Box(channels) = &mut here.seats[0].observation {
            change(channels);
        }
    };
    let cases: [(&dyn Fn(&mut Interface), &str); 5] = [
        (
            &|here| observed(here, &|channels| channels[1].name = "load".into()),
            "entry 2 of the observation is `demand` in W there and `load` in W here",
        ),
        (
            &|here| observed(here, &|channels| channels[0].unit = String::new()),
            "entry 1 of the observation is `voltage` in V there and `voltage` without unit here",
        ),
        (
            &|here| observed(here, &|channels| channels.truncate(1)),
            "the length of the observation is 2 there and 1 here",
        ),
        (
            &|here| here.seats[0].action = Space::Box(vec![Channel::new("left", "")]),
            "the action is a simplex there and a box here",
        ),
        (
            &|here| here.seats.push(pack().seats.remove(0)),
            "the number of seats is 1 there and 2 here",
        ),
    ];
    for (change, expected) in cases {
        assert!(
            refusal(trial.path(), &changed(change)).ends_with(expected),
            "{expected}"
        );
    }
    let typical = changed(&|here| {
        observed(here, &|channels| {
            channels[0] = channels[0].clone().typical(0.0, 9.0);
        });
    });
    assert_eq!(
        Dataset::read_for(trial.path(), &typical).unwrap().episodes.len(),
        1
    );
}

#[test]
fn limits_of_actions_count() {
    let limited = |high| {
        interface(
            Space::Box(vec![]),
            Space::Box(vec![Channel::new("force", "N").within(-1.0, high)]),
        )
    };
    let trial = tempfile::tempdir().unwrap();
    Dataset::write_empty(trial.path(), &limited(1.0)).unwrap();
    let text = refusal(trial.path(), &limited(2.0));
    assert!(
        text.ends_with("`force` in N within -1 and 1 there and `force` in N within -1 and 2 here"),
        "{text}"
    );
}

#[test]
fn what_is_missing_or_damaged_is_named() {
    let trial = tempfile::tempdir().unwrap();
    let whole = || {
        write(
            trial.path(),
            &pack(),
            &[episode(2, End::Terminated), episode(1, End::Truncated)],
        );
    };
    let path = |name: &str| trial.path().join(FOLDER).join(name);
    for name in ["interface.json", "data/metadata.json", "data/1/part-0.parquet"] {
        whole();
        fs::remove_file(path(name)).unwrap();
        assert!(
            matches!(Dataset::read(trial.path()), Err(Error::File { path: named,
                .. }) if named == path(name)),
            "{name}"
        );
        whole();
        fs::write(path(name), "nonsense").unwrap();
        assert!(
            matches!(Dataset::read(trial.path()), Err(Error::Damaged { path: named,
                .. }) if named == path(name)),
            "{name}"
        );
    }
    whole();
    fs::copy(path("data/0/part-0.parquet"), path("data/1/part-0.parquet")).unwrap();
    let text = Dataset::read(trial.path()).unwrap_err().to_string();
    assert!(
        text.contains("it says 3 steps, and the episodes have 4"),
        "{text}"
    );
}

#[test]
fn what_is_no_whole_episode_is_not_written() {
    let trial = tempfile::tempdir().unwrap();
    let mut mixed = pack();
    mixed.seats.push(Seat {
        action: Space::Discrete(vec!["on".into(), "off".into()]),
        ..mixed.seats[0].clone()
    });
    let refused = DatasetWriter::create(trial.path(), &mixed)
        .unwrap_err()
        .to_string();
    assert_eq!(
        refused,
        "a dataset holds actions of one kind; in this environment those of some seats are choices and those of \
         others are not"
    );
    mixed.seats.clear();
    assert!(matches!(
        DatasetWriter::create(trial.path(), &mixed),
        Err(Error::NoSeats)
    ));
    let mut writer = DatasetWriter::create(trial.path(), &pack()).unwrap();
    let mut refused = |change: &dyn Fn(&mut Episode), expected: &str| {
        let mut changed = episode(2, End::Truncated);
        change(&mut changed);
        let text = writer.episode(&changed).unwrap_err().to_string();
        assert!(text.contains(expected), "{text}");
    };
    refused(&|it| it.actions.clear(), "an episode has no decision");
    refused(
        &|it| drop(it.observations.pop()),
        "2 decisions have 2 observations and 2 rewards",
    );
    refused(
        &|it| it.actions[1].push(0.0),
        "an action has 3 entries instead of 2",
    );
    refused(
        &|it| it.observations[2].clear(),
        "an observation has 0 entries instead of 2",
    );
}

#[test]
fn a_choice_is_a_whole_number() {
    let choice = || Space::Discrete(vec!["on".into(), "off".into()]);
    let trial = tempfile::tempdir().unwrap();
    let mut writer = DatasetWriter::create(trial.path(), &interface(choice(), choice())).unwrap();
    let mut episode = Episode {
        observations: vec![vec![0.0], vec![1.0]],
        actions: vec![vec![0.5]],
        rewards: vec![1.0],
        states: Vec::new(),
        end: End::Truncated,
    };
    let text = writer.episode(&episode).unwrap_err().to_string();
    assert!(text.contains("a choice is 0.5, which is no index"), "{text}");
    episode.actions = vec![vec![1.0]];
    write(
        trial.path(),
        &interface(choice(), choice()),
        std::slice::from_ref(&episode),
    );
    assert_eq!(Dataset::read(trial.path()).unwrap().episodes, [episode]);
}

fn spaces() -> impl Strategy<Value = Space> {
    let limit = prop_oneof![Just(f64::INFINITY), 0.0..1e6f64];
    let channel = (
        "[a-z]{1,6}",
        "[A-Z]{0,2}",
        limit.clone(),
        limit,
        -5.0..5.0f64,
        0.1..9.0f64,
    );
    let channel = channel.prop_map(|(name, unit, low, high, center, spread)| {
        Channel::new(name, &unit)
            .within(-low, high)
            .typical(center, spread)
    });
    let names = || proptest::collection::vec("[a-z]{1,6}", 1..5);
    prop_oneof![
        proptest::collection::vec(channel, 1..5).prop_map(Space::Box),
        names().prop_map(Space::Simplex),
        names().prop_map(Space::Discrete),
    ]
}

/// Any vectors of a space: any finite bits, or an index.
fn vectors(space: &Space, count: usize) -> BoxedStrategy<Vec<Vec<f64>>> {
    let entry = match space {
        Space::Discrete(names) => (0..u32::try_from(names.len()).unwrap())
            .prop_map(f64::from)
            .boxed(),
        _ => any::<u64>()
            .prop_map(f64::from_bits)
            .prop_filter("finite", |value| value.is_finite())
            .boxed(),
    };
    proptest::collection::vec(proptest::collection::vec(entry, space.len()), count).boxed()
}

/// One to three seats, with a full state; either all of them choose or none does.
fn interfaces() -> impl Strategy<Value = Interface> {
    let alike = |spaces: &Vec<Space>| {
        let choices = spaces.iter().filter(|space| matches!(space, Space::Discrete(_)));
        [0, spaces.len()].contains(&choices.count())
    };
    (1usize..4).prop_flat_map(move |n| {
        let of_seats = || proptest::collection::vec(spaces(), n).prop_filter("alike", alike);
        (of_seats(), of_seats()).prop_map(|(seen, done)| {
            let seat = |(observation, action)| Seat {
                name: String::new(),
                observation,
                action,
            };
            Interface {
                seats: seen.into_iter().zip(done).map(seat).collect(),
                state: vec![Channel::new("hidden", "V")],
            }
        })
    })
}

/// Vectors of several spaces, one after the other.
fn joined(spaces: Vec<&Space>, count: usize) -> BoxedStrategy<Vec<Vec<f64>>> {
    let of_seats: Vec<_> = spaces.into_iter().map(|space| vectors(space, count)).collect();
    of_seats
        .prop_map(move |of_seats| {
            let at = |row: usize| of_seats.iter().flat_map(|rows| rows[row].clone()).collect();
            (0..count).map(at).collect()
        })
        .boxed()
}

fn datasets() -> impl Strategy<Value = Dataset> {
    let lengths = proptest::collection::vec((1usize..5, any::<bool>()), 0..4);
    (interfaces(), lengths).prop_flat_map(|(interface, lengths)| {
        let n_seats = interface.seats.len();
        let episodes: Vec<_> = lengths
            .into_iter()
            .map(|(n, terminated)| {
                let rewards = proptest::collection::vec(-1e3..1e3f64, n * n_seats);
                let states = vectors(
                    &Space::Box(interface.state.clone()),
                    if n_seats > 1 { n + 1 } else { 0 },
                );
                let end = if terminated {
                    End::Terminated
                } else {
                    End::Truncated
                };
                let seen = interface.seats.iter().map(|seat| &seat.observation).collect();
                let done = interface.seats.iter().map(|seat| &seat.action).collect();
                (joined(seen, n + 1), joined(done, n), rewards, states).prop_map(
                    move |(observations, actions, rewards, states)| Episode {
                        observations,
                        actions,
                        rewards,
                        states,
                        end,
                    },
                )
            })
            .collect();
        episodes.prop_map(move |episodes| Dataset {
            interface: interface.clone(),
            episodes,
        })
    })
}

#[test]
fn decisions_of_several_seats_come_apart_again() {
    let trial = tempfile::tempdir().unwrap();
    let mut two = pack();
    two.seats[0].action = Space::Discrete(vec!["on".into(), "off".into()]);
    two.seats.push(two.seats[0].clone());
    let episode = Episode {
        observations: vec![vec![1.0, 2.0, 3.0, 4.0], vec![5.0, 6.0, 7.0, 8.0]],
        actions: vec![vec![0.0, 1.0]],
        rewards: vec![-1.0, 4.0],
        states: vec![vec![0.5], vec![0.25]],
        end: End::Terminated,
    };
    write(trial.path(), &two, std::slice::from_ref(&episode));
    let read = Dataset::read_for(trial.path(), &two).unwrap();
    let transitions = read.transitions().unwrap();
    let [one] = transitions.as_slice() else {
        panic!("{transitions:?}");
    };
    assert_eq!(one.observation.seats, [[1.0, 2.0], [3.0, 4.0]]);
    assert_eq!(one.next_observation.seats, [[5.0, 6.0], [7.0, 8.0]]);
    assert_eq!(
        (&one.observation.state, &one.next_observation.state),
        (&vec![0.5], &vec![0.25])
    );
    assert_eq!(one.action, [[0.0], [1.0]]);
    assert_eq!(
        (one.rewards.as_slice(), one.end),
        (&[-1.0, 4.0][..], Some(End::Terminated))
    );

    let mut writer = DatasetWriter::create(trial.path(), &two).unwrap();
    let stateless = Episode {
        states: Vec::new(),
        ..episode
    };
    let text = writer.episode(&stateless).unwrap_err().to_string();
    assert!(text.contains("1 decisions have 0 states instead of 2"), "{text}");
    let mut other = two.clone();
    other.state = vec![Channel::new("hidden", "A")];
    DatasetWriter::create(trial.path(), &two)
        .unwrap()
        .finish()
        .unwrap();
    assert!(refusal(trial.path(), &other).contains("entry 1 of the full state"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_dataset_comes_back_and_fits_its_own_interface(dataset in datasets()) {
        let trial = tempfile::tempdir().unwrap();
        write(trial.path(), &dataset.interface, &dataset.episodes);
        let read = Dataset::read_for(trial.path(), &dataset.interface).unwrap();
        // Debug text distinguishes -0 from 0.
        prop_assert_eq!(format!("{read:?}"), format!("{dataset:?}"));
    }
}
