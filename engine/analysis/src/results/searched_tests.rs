//! The choice of a search is a function of its study and of the bits of its trials. Other trials of the store, failures
//! that were tried again, and the pieces and the order in which trials ran do not change it.

use super::*;
use crate::search::{
    CmaEs, Direction, Failed, Halving, Method, NoOptions, Numbers, Population, Range, TreeParzen,
};
use contract::{
    Phase, Rng,
    cast::Actors,
    part::Part,
    random,
    recorder::Row,
    sweep_point::SweepPoint,
    trial::{Combination, Trial, TrialCell, TrialKey},
    trial_end::TrialEnd,
};
use proptest::prelude::*;
use rand::Rng as _;
use serde_json::Value;
use std::sync::Arc;

/// Steps of a trial, and steps between two measurements.
const END: u64 = 400;
const EVERY: u64 = 100;
const SEEDS: u64 = 2;

/// The stored results of a trial.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct StoredTrial {
    measured: u64,
    end: Option<EndState>,
}

/// A store, by the settings that lead to that of a trial, and by its seed.
type Store = BTreeMap<(String, u64), StoredTrial>;

/// A world whose trials have random but reproducible results.
struct World(u64);

impl World {
    fn draw(&self, what: &[&str]) -> f64 {
        let seed = self.0.to_string();
        random::stream(&[&[seed.as_str()], what].concat()).random()
    }

    fn value(&self, key: &str, seed: u64, step: u64) -> f64 {
        self.draw(&[key, &seed.to_string(), &step.to_string()])
    }

    /// The step at which the numbers of a trial are not finite any more.
    fn diverges_at(&self, key: &str, seed: u64) -> Option<u64> {
        let drawn = self.draw(&[key, &seed.to_string(), "diverges"]);
        (drawn < 0.15).then_some((drawn * 2000.0) as u64 + 1)
    }

    /// Runs a trial up to a step, or to its end if there is none.
    fn run(&self, key: &str, seed: u64, until: Option<u64>) -> StoredTrial {
        let to = until.unwrap_or(END);
        match self.diverges_at(key, seed).filter(|step| *step <= to) {
            Some(step) => StoredTrial {
                measured: (step - 1) / EVERY * EVERY,
                end: Some(EndState::Nan),
            },
            None => StoredTrial {
                measured: to,
                end: until.is_none().then_some(EndState::Ok),
            },
        }
    }
}

fn methods() -> Vec<Method> {
    let halving = |pauses: &[u64], keep, brackets| {
        Method::Halving(Halving {
            pauses: pauses.to_vec(),
            keep,
            brackets,
        })
    };
    vec![
        halving(&[100, 200], 0.5, 1),
        halving(&[100, 300], 0.4, 3),
        Method::Population(Population {
            pauses: vec![100, 200],
            replace: 0.3,
            redraw: 0.25,
        }),
        Method::TreeParzen(TreeParzen {
            startup: 3,
            batch: 2,
            candidates: 8,
        }),
        Method::CmaEs(CmaEs {
            population: Some(3),
            ..CmaEs::default()
        }),
        Method::Random(NoOptions {}),
    ]
}

fn search(method: Method) -> Search {
    let numbers = Numbers {
        low: 0.0,
        high: 1.0,
        log: false,
        integer: false,
    };
    Search {
        name: "rates".into(),
        environment: "e".into(),
        agent: "a".into(),
        plugin: "a".into(),
        keys: vec![("a.rate".into(), Range::Numbers(numbers))],
        metric: "return".into(),
        direction: Direction::Maximize,
        settings: 7,
        seeds: (0..SEEDS).collect(),
        method,
        failed: Failed::Wait,
    }
}

/// The settings that lead to one, joined into a word.
fn key(search: &Search, progress: &Progress, place: usize) -> String {
    if search.is_population() {
        let way = lineage(&progress.parents, place);
        return json!(way.iter().map(|at| &progress.points[*at]).collect::<Vec<_>>()).to_string();
    }
    json!(progress.points[place]).to_string()
}

fn result(
    world: &World,
    search: &Search,
    point: &Point,
    key: &str,
    seed: u64,
    stored: StoredTrial,
) -> TrialResult {
    let part = || Part::new("x", 1, Value::Null);
    let values = search
        .keys
        .iter()
        .map(|(name, _)| name.clone())
        .zip(point.clone());
    let trial = Trial {
        id: format!("{key} {seed}"),
        cell: TrialCell {
            combination: Combination {
                point: SweepPoint::from_iter(values),
                ..TrialCell::of("e", "a").combination
            },
            purpose: Purpose::Tried(search.name.clone()),
        }
        .into(),
        key: TrialKey {
            environment: part().into(),
            agent: Actors::Agent(part()).into(),
            protocol: part().into(),
            seed,
            numerics: 1,
        },
    };
    let row = |phase, step| Row {
        phase,
        step,
        episode: 0,
        seat: 0,
        metric: 0,
        value: world.value(key, seed, step),
    };
    let steps = (1..=stored.measured / EVERY).map(|number| row(Phase::Evaluate, number * EVERY));
    let last = (stored.end == Some(EndState::Ok)).then(|| row(Phase::Final, END));
    let end = stored.end.map(|state| TrialEnd {
        state,
        reason: String::new(),
        wall_s: 1.0,
        decision_s: None,
        device: None,
        digest: String::new(),
    });
    TrialResult {
        trial: Arc::new(trial),
        end: end.map(Box::new),
        names: vec!["return".into()].into(),
        rows: steps.chain(last).collect(),
    }
}

fn results(world: &World, search: &Search, progress: &Progress, store: &Store) -> SearchResult {
    let mut trials = Vec::new();
    for (place, point) in progress.points.iter().enumerate() {
        let key = key(search, progress, place);
        for seed in 0..SEEDS {
            let stored = store.get(&(key.clone(), seed)).copied().unwrap_or_default();
            trials.push(result(world, search, point, &key, seed, stored));
        }
    }
    SearchResult::of(search, progress, &trials)
}

/// Advances a search as far as the stored trials allow.
fn grown(world: &World, search: &Search, store: &Store) -> (Progress, SearchResult) {
    let mut progress = Progress::default();
    loop {
        let result = results(world, search, &progress, store);
        let known = result.known();
        let parents = search.parents(&known);
        let (points, stops, chosen) = match search.next(&known) {
            Next::Try(points, stops) => (points, stops, None),
            Next::Chosen(chosen, stops) => (known.iter().map(|it| it.point.clone()).collect(), stops, chosen),
        };
        let next = Progress {
            points,
            stops,
            parents,
            chosen,
        };
        if next == progress {
            return (progress, result);
        }
        progress = next;
    }
}

/// The trials that a search asks for and that are not stored so far, each with the step up to which it asks.
fn missing(search: &Search, progress: &Progress, store: &Store) -> Vec<(String, u64, Option<u64>)> {
    let mut missing = Vec::new();
    for place in 0..progress.points.len() {
        let until = progress.stops.get(place).copied().flatten();
        let key = key(search, progress, place);
        for seed in 0..SEEDS {
            let stored = store.get(&(key.clone(), seed)).copied().unwrap_or_default();
            let is_there = stored.end.is_some() || until.is_some_and(|until| stored.measured >= until);
            if !is_there {
                missing.push((key.clone(), seed, until));
            }
        }
    }
    missing
}

/// The result of a search, without the values known beyond its pauses.
#[derive(Debug, PartialEq)]
struct SearchEnd {
    progress: Progress,
    ranked: Vec<Point>,
    words: String,
}

/// Runs a search to its end in a store that may already hold trials. With `dice`, trials fail and run in pieces. Failed
/// trials are tried again when nothing else is left.
fn settled(world: &World, search: &Search, mut store: Store, mut dice: Option<Rng>) -> (SearchEnd, Store) {
    for _ in 0..10_000 {
        let (progress, result) = grown(world, search, &store);
        let open = missing(search, &progress, &store);
        let failed: Vec<_> = store
            .iter()
            .filter(|(_, stored)| stored.end == Some(EndState::Timeout))
            .map(|(id, _)| id.clone())
            .collect();
        if open.is_empty() && failed.is_empty() {
            assert!(!result.found_nothing() || progress.chosen.is_none());
            let words = crate::results::search_in_words(&result);
            assert!(!words.contains("waits"), "{words}");
            let ranked = result.ranked().iter().map(|it| it.point.clone()).collect();
            return (
                SearchEnd {
                    progress,
                    ranked,
                    words,
                },
                store,
            );
        }
        if open.is_empty() {
            assert!(progress.chosen.is_none() || result.seen_so(Sight::Failed).is_empty());
            for id in failed {
                store.entry(id).or_default().end = None;
            }
        }
        for (key, seed, until) in open {
            let luck: f64 = dice.as_mut().map_or(1.0, rand::Rng::random);
            let stored = store.entry((key.clone(), seed)).or_default();
            match luck {
                luck if luck < 0.3 => {}
                luck if luck < 0.5 => stored.end = Some(EndState::Timeout),
                // A value that an earlier run measured is kept.
                _ => {
                    let ran = world.run(&key, seed, until);
                    stored.end = ran.end;
                    stored.measured = stored.measured.max(ran.measured);
                }
            }
        }
    }
    panic!("it never ends")
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]
    #[test]
    fn a_choice_is_a_function_of_the_bits_of_the_trials(method in 0usize..6, seed: u64) {
        let (world, search) = (World(seed), search(methods().swap_remove(method)));
        let (expected, whole) = settled(&world, &search, Store::new(), None);
        let mut dice = random::stream(&["what else is stored", &seed.to_string()]);
        for _ in 0..4 {
            // Trials that ran to their ends in a sweep, or to a later pause of another search.
            let mut before = Store::new();
            for (key, seed) in whole.keys() {
                let until = [None, Some(100), Some(200), Some(300)][dice.random_range(0..4)];
                if dice.random_bool(0.5) {
                    before.insert((key.clone(), *seed), world.run(key, *seed, until));
                }
            }
            let luck = random::stream(&["luck", &dice.random::<u64>().to_string()]);
            let (found, _) = settled(&world, &search, before, Some(luck));
            prop_assert_eq!(&found, &expected);
        }
    }

    #[test]
    fn two_halves_of_what_is_stored_are_gone_on_with_as_one(method in 0usize..6, seed: u64) {
        let (world, search) = (World(seed), search(methods().swap_remove(method)));
        let (expected, whole) = settled(&world, &search, Store::new(), None);
        let mut dice = random::stream(&["halves", &seed.to_string()]);
        // After an interruption a store holds some of the trials, each up to some step.
        let part = |dice: &mut Rng| -> Store {
            let there = whole.iter().filter(|_| dice.random_bool(0.6));
            there.map(|(id, stored)| (id.clone(), *stored)).collect()
        };
        let mut both = part(&mut dice);
        both.extend(part(&mut dice));
        prop_assert_eq!(settled(&world, &search, both, None).0, expected);
    }
}

#[test]
fn a_failed_trial_is_waited_for_or_ranks_last_and_is_named_either_way() {
    let world = World(3);
    let mut own = search(Method::Random(NoOptions {}));
    let (progress, _) = grown(&world, &own, &Store::new());
    let ended = |end| StoredTrial {
        measured: END,
        end: Some(end),
    };
    let mut store = Store::new();
    for place in 0..progress.points.len() {
        for seed in 0..SEEDS {
            store.insert((key(&own, &progress, place), seed), ended(EndState::Ok));
        }
    }
    store.insert((key(&own, &progress, 2), 1), ended(EndState::Oom));
    let (waiting, result) = grown(&world, &own, &store);
    assert_eq!((waiting.chosen, result.seen_so(Sight::Failed).len()), (None, 1));
    let words = crate::results::search_in_words(&result);
    assert!(
        words.contains("it waits for 1 setting whose trials failed"),
        "{words}"
    );
    assert!(words.contains("(oom)"), "{words}");
    own.failed = Failed::RankLast;
    let (chosen, result) = grown(&world, &own, &store);
    assert!(chosen.chosen.is_some_and(|place| place != 2));
    let words = crate::results::search_in_words(&result);
    assert!(words.contains("1 setting ranks last without a value"), "{words}");
}
