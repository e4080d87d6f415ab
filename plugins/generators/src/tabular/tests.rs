//! The table as an environment.

use super::*;
use contract::{
    dataset::{DatasetWriter, Episode},
    random::stream,
};
use serde_json::json;

fn environment(config: serde_json::Value) -> Result<Box<dyn Environment>, Error> {
    build(serde_json::from_value(config).unwrap())
}

fn action(taken: [usize; 6]) -> Vec<Vec<f64>> {
    vec![choice::vector(&choices(), &taken)]
}

/// Builds a design and returns its rewards and its last step.
fn built(search: &mut dyn Environment, cells: &[[usize; 6]], rng: &mut Rng) -> (Vec<f64>, Step) {
    search.reset(rng).unwrap();
    let mut rewards = Vec::new();
    for cell in cells {
        let step = search.step(&action(*cell), rng).unwrap();
        rewards.push(step.rewards[0]);
        if step.end.is_some() {
            return (rewards, step);
        }
    }
    panic!("the design does not end")
}

#[test]
fn the_return_is_the_score_less_that_of_the_start() {
    let mut search = environment(json!({ "noise": false })).unwrap();
    let mut rng = stream(&["return"]);
    let start = search.reset(&mut rng).unwrap().remove(0);
    let (rewards, last) = built(&mut *search, &[[1, 1, 0, 1, 0, 0]; 3], &mut rng);
    let of = |metric| last.metric(metric).unwrap();
    let returned: f64 = rewards.iter().sum();
    assert!((returned - (of("score") - (start[1] - start[2]))).abs() < 1e-12);
    assert!((of("score") - (of("inception_score") - 0.01 * of("frechet_distance"))).abs() < 1e-12);
    assert!(
        of("regret") > 0.0,
        "a design that nobody searched is not the best one"
    );
    assert!(search.step(&action([0; 6]), &mut rng).is_err());
}

#[test]
fn nothing_is_better_than_the_best() {
    let mut search = environment(json!({ "noise": false })).unwrap();
    let mut rng = stream(&["best"]);
    let lowest = (0..400)
        .map(|_| {
            let cells =
                [0, 1, 2].map(|_| [2u32, 3, 3, 2, 2, 2].map(|size| rng.random_range(0..size) as usize));
            built(&mut *search, &cells, &mut rng).1.metric("regret").unwrap()
        })
        .fold(f64::INFINITY, f64::min);
    assert!(lowest >= 0.0, "{lowest}");
    let table = ScoreTable::of(&Config::default()).unwrap();
    let (_, best) = table.fitted().surrogate.best(0.01);
    assert_eq!(built(&mut *search, &best, &mut rng).1.metric("regret"), Some(0.0));
    let quality = table.fitted().quality;
    assert!(quality.rank_correlation > 0.9, "{quality:?}");
}

#[test]
fn noise_is_seen_and_not_measured() {
    let mut search = environment(json!({ "noise": true })).unwrap();
    let mut rng = stream(&["noise"]);
    let (one, of_one) = built(&mut *search, &[[0, 1, 1, 1, 1, 0]; 3], &mut rng);
    let (two, of_two) = built(&mut *search, &[[0, 1, 1, 1, 1, 0]; 3], &mut rng);
    assert_ne!(one, two);
    assert_eq!(of_one.metrics, of_two.metrics);
}

#[test]
fn scores_of_earlier_searches_are_looked_up() {
    let folder = tempfile::tempdir().unwrap();
    let interface = environment(json!({})).unwrap().interface();
    let mut writer = DatasetWriter::create(folder.path(), &interface).unwrap();
    for one in surrogate::tests::made_up(300, 0.01) {
        let row = |(n, seen): (usize, &Vec<f64>)| vec![n as f64, seen[0], 0.01 * seen[1], seen[2]];
        let episode = Episode {
            observations: one.seen.iter().enumerate().map(row).collect(),
            actions: one
                .cells
                .iter()
                .map(|cell| choice::vector(&choices(), cell))
                .collect(),
            rewards: vec![0.0; N_CELLS],
            states: Vec::new(),
            end: End::Terminated,
        };
        writer.episode(&episode).unwrap();
    }
    writer.finish().unwrap();
    let product = json!({ "from": "search", "folder": folder.path() });
    let config = json!({ "landscape": { "measured": { "datasets": [product] } }, "noise": false });
    let mut search = environment(config).unwrap();
    let cells = [[1, 2, 0, 1, 0, 0], [0, 2, 0, 1, 0, 0], [0, 2, 0, 1, 0, 1]];
    let (_, last) = built(&mut *search, &cells, &mut stream(&[]));
    let of = |metric| last.metric(metric).unwrap();
    assert!(
        (of("inception_score") - surrogate::tests::truth(&cells)).abs() < 0.1,
        "{last:?}"
    );
    assert!(
        of("regret") < 0.1 && of("surrogate_rank_correlation") > 0.9,
        "{last:?}"
    );
}

#[test]
fn designs_of_something_else_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut interface = environment(json!({})).unwrap().interface();
    interface.seats[0].action = Space::Choices(vec![contract::Choice::new("switch", &["open", "closed"])]);
    Dataset::write_empty(folder.path(), &interface).unwrap();
    let product = json!({ "from": "grid", "folder": folder.path() });
    let text = environment(json!({ "landscape": { "measured": { "datasets": [product] } } }))
        .err()
        .unwrap()
        .to_string();
    assert!(text.contains("`grid` left no designs of generators"), "{text}");
}
