//! The search as an environment, with generators of two channels.

use super::*;
use contract::random::stream;

fn small() -> Config {
    Config {
        images: serde_json::from_value(json!({ "shapes": { "count": 60 } })).unwrap(),
        size: 8,
        critic_steps: 5,
        batch: 4,
        generator_batch: 4,
        generator_channels: 4,
        discriminator_channels: 4,
        latent: 6,
        scored_images: 40,
        reference_images: 60,
        splits: 2,
        ..Config::default()
    }
}

fn action(taken: [usize; 6]) -> Vec<Vec<f64>> {
    vec![choice::vector(&choices(), &taken)]
}

/// Builds a whole design; its first observation and its steps.
fn built(search: &mut GeneratorSearch, cells: [[usize; 6]; 3], rng: &mut Rng) -> (Vec<f64>, Vec<Step>) {
    let start = search.reset(rng).unwrap().remove(0);
    let steps = cells.map(|cell| search.step(&action(cell), rng).unwrap());
    (start, steps.to_vec())
}

const PUBLISHED: [[usize; 6]; 3] = [[0, 1, 0, 1, 0, 0], [0, 1, 2, 1, 0, 0], [0, 1, 0, 1, 0, 1]];

#[test]
fn rewards_add_up_to_what_the_scores_gained() {
    let (mut search, mut rng) = (GeneratorSearch::new(small()).unwrap(), stream(&["gain"]));
    let (start, steps) = built(&mut search, PUBLISHED, &mut rng);
    assert_eq!(start.len(), 3 + 4);
    let gained: f64 = steps.iter().map(|step| step.rewards[0]).sum();
    let last = &steps[2];
    assert!((gained - (last.metric("score").unwrap() - (start[1] - start[2]))).abs() < 1e-9);
    assert!(
        (last.metric("score").unwrap()
            - (last.metric("inception_score").unwrap() - 0.01 * last.metric("frechet_distance").unwrap()))
        .abs()
            < 1e-9
    );
    assert_eq!(
        last.observations[0][..3],
        [
            3.0,
            last.metric("inception_score").unwrap(),
            0.01 * last.metric("frechet_distance").unwrap()
        ]
    );
    assert_eq!(last.end, Some(End::Terminated));
    assert!(steps.iter().all(|step| step.metric("not_finite").unwrap() == 0.0));
    assert!(search.step(&action([0; 6]), &mut rng).is_err());
}

#[test]
fn a_design_goes_on_from_a_snapshot_to_the_same_bits() {
    let (mut search, mut rng) = (GeneratorSearch::new(small()).unwrap(), stream(&["again"]));
    search.reset(&mut rng).unwrap();
    search.step(&action(PUBLISHED[0]), &mut rng).unwrap();
    let text = search.snapshot().to_string();
    let mut other = GeneratorSearch::new(small()).unwrap();
    other.reset(&mut stream(&["another"])).unwrap();
    other.restore(&serde_json::from_str(&text).unwrap()).unwrap();
    for cell in &PUBLISHED[1..] {
        let one = search.step(&action(*cell), &mut rng).unwrap();
        let two = other.step(&action(*cell), &mut stream(&["unused"])).unwrap();
        assert_eq!(one, two);
    }
}

#[test]
fn a_whole_design_is_trained_once_and_scored_once() {
    let config = Config {
        schedule: Schedule::WholeDesign,
        average_decay: Some(0.9),
        ..small()
    };
    let (mut search, mut rng) = (GeneratorSearch::new(config).unwrap(), stream(&["whole"]));
    let (start, steps) = built(&mut search, PUBLISHED, &mut rng);
    assert_eq!((steps[0].rewards[0], steps[1].rewards[0]), (0.0, 0.0));
    assert_eq!(steps[1].observations[0][1..], start[1..]);
    assert!(steps[2].rewards[0] != 0.0);
}

#[test]
fn designs_leave_a_graph_and_images() {
    let (mut search, mut rng) = (GeneratorSearch::new(small()).unwrap(), stream(&["left"]));
    search.reset(&mut rng).unwrap();
    assert!(search.graph().is_none() && search.images().unwrap().is_empty());
    built(&mut search, PUBLISHED, &mut rng);
    search.graph().unwrap().check().unwrap();
    let images = search.images().unwrap();
    assert_eq!(
        (images.len(), images[0].width, images[0].pixels.len()),
        (64, 8, 8 * 8 * 3)
    );
}

#[test]
fn every_option_can_be_built() {
    let mut rng = stream(&["options"]);
    let config = Config {
        critic_steps: 1,
        ..small()
    };
    let mut search = GeneratorSearch::new(config).unwrap();
    for norm in 0..3 {
        for upsampling in 0..3 {
            let flags = (norm + upsampling) % 2;
            let cell = [flags, norm, upsampling, 1 - flags, 1, flags];
            let (_, steps) = built(&mut search, [cell; 3], &mut rng);
            assert!(steps[2].metrics.iter().all(|(_, value)| value.is_finite()));
        }
    }
}

#[test]
fn sizes_that_three_cells_cannot_make_are_refused() {
    let config = Config { size: 12, ..small() };
    let text = GeneratorSearch::new(config).err().unwrap().to_string();
    assert!(text.contains("`size`: three cells double a side each"), "{text}");
}

#[test]
fn missing_images_and_networks_are_refused_before_a_design_begins() {
    let problem = |config: Config| GeneratorSearch::new(config).err().unwrap().to_string();
    let text = problem(Config {
        reference_images: 61,
        ..small()
    });
    assert!(
        text.contains("`reference_images`: 61 images are to be compared with, and there are 60"),
        "{text}"
    );
    let sight = serde_json::from_value(json!({ "inception_v3": { "file": "nowhere.safetensors" } })).unwrap();
    let text = problem(Config { sight, ..small() });
    assert!(text.contains("cannot find `nowhere.safetensors`"), "{text}");
}

#[test]
fn the_number_of_scored_images_does_not_touch_the_training() {
    let losses = |scored_images| {
        let config = Config {
            scored_images,
            ..small()
        };
        let (mut search, mut rng) = (GeneratorSearch::new(config).unwrap(), stream(&["looks"]));
        let (_, steps) = built(&mut search, PUBLISHED, &mut rng);
        let of = |step: &Step| {
            [
                step.metric("discriminator_loss").unwrap(),
                step.metric("generator_loss").unwrap(),
            ]
        };
        (
            steps.iter().map(of).collect::<Vec<_>>(),
            steps[2].metric("frechet_distance").unwrap(),
        )
    };
    let ((few, distance), (many, other_distance)) = (losses(20), losses(40));
    assert_eq!(few, many);
    assert!((distance - other_distance).abs() > 1e-6);
}

#[test]
fn the_number_of_scored_images_is_in_the_identity_and_not_in_the_random_streams() {
    let mut registry = Registry::default();
    register(&mut registry);
    let about = &registry.environments[NAME].about;
    let of = |key: &str, value: usize| {
        let mut config = about.defaults.clone();
        config[key] = json!(value);
        let environment = contract::part::Part::new(NAME, about.version, config);
        (environment.id(), environment.stream_id(about))
    };
    let ((id, streams), (other_id, other_streams)) = (of("scored_images", 20), of("scored_images", 40));
    assert_ne!(id, other_id);
    assert_eq!(streams, other_streams);
    assert_ne!(streams, of("critic_steps", 20).1);
}
