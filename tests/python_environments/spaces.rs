//! Values that pass between Python and a trial: spaces, observations, seats, and the same bits for any number
//! of workers.

use super::*;

#[test]
fn every_kind_of_space_passes_as_it_is_declared() {
    let Some(place) = Place::new() else { return };
    let tank = place.built("own.py:Tank", json!({}));
    let seat = &tank.seats()[0];
    let level = &channels(&seat.observation)[0];
    assert_eq!(
        (level.low, level.high, level.center, level.spread),
        (0.0, 4.0, 2.0, 2.0)
    );
    assert_eq!(channels(&seat.observation)[1].high, f64::INFINITY);
    assert_eq!(
        (names(&seat.observation), names(&seat.action)),
        (
            vec!["observation_0".into(), "observation_1".into()],
            vec!["action".into()],
        )
    );
    let mut valve = place.built("own.py:Valve", json!({}));
    let seat = valve.seats()[0].clone();
    let expected = [
        "level",
        "flows_0",
        "flows_1",
        "inner_mode_1",
        "inner_mode_2",
        "inner_mode_3",
    ];
    let mut seen = names(&seat.observation);
    seen.sort();
    let mut sorted = expected.map(String::from).to_vec();
    sorted.sort();
    assert_eq!(seen, sorted);
    assert_eq!(names(&seat.action), ["action.1", "action.2", "action.3"]);
    let mut rng = stream(&["valve"]);
    let start = valve.reset(&mut rng).unwrap();
    let value =
        |seen: &[f64], name: &str| seen[names(&seat.observation).iter().position(|it| it == name).unwrap()];
    assert_eq!(
        expected.map(|name| value(&start[0], name)),
        [3.0, 0.25, -0.25, 1.0, 0.0, 0.0]
    );
    let third = valve.step(&[vec![-1.0, 0.5, 0.6]], &mut rng).unwrap();
    assert_eq!((third.rewards[0], third.end), (3.0, None));
    assert_eq!(
        expected.map(|name| value(&third.observations[0], name))[3..],
        [0.0, 0.0, 1.0]
    );
    let second = valve.step(&[vec![-1.0, 0.9, 0.6]], &mut rng).unwrap();
    assert_eq!((second.rewards[0], second.end), (2.0, Some(End::Terminated)));
}

#[test]
fn the_pendulum_of_gymnasium_moves_as_the_native_one() {
    let Some(place) = Place::new() else { return };
    let mut single = place.built("gymnasium:Pendulum-v1", json!({}));
    let mut bare = place.built("own.py:BarePendulum", json!({}));
    let registry = plugins::registry();
    let entry = &registry.environments["pendulum"];
    let mut native = (entry.build)(&entry.about.defaults).unwrap();
    let mut rng = stream(&["pendulum"]);
    for episode in 0..3 {
        let mut same = rng.clone();
        let seen = single.reset(&mut rng).unwrap();
        let start = bare.reset(&mut same).unwrap();
        let motion = json!({ "angle": start[0][0], "speed": start[0][1], "torque": null, "steps": 0 });
        native.restore(&motion).unwrap();
        assert!(
            (seen[0][0] - start[0][0].cos()).abs() < 1e-7,
            "of one seed is one start"
        );
        for step in 0..200 {
            // Torques that single precision holds exactly.
            let action = vec![vec![f64::from((step * 37 + episode * 11) % 129 - 64) / 64.0]];
            let [ours, precise, theirs] =
                [&mut native, &mut bare, &mut single].map(|it| it.step(&action, &mut rng).unwrap());
            let place = format!("step {step} of episode {episode}");
            let off = |one: &[f64], other: &[f64]| {
                one.iter()
                    .zip(other)
                    .map(|(one, other)| (one - other).abs())
                    .fold(0.0, f64::max)
            };
            // The native angle is given within half a turn.
            let state = &precise.observations[0];
            assert!(
                off(&[state[0].cos(), state[0].sin(), state[1]], &ours.observations[0]) < 1e-9,
                "{place}"
            );
            assert!(off(&precise.rewards, &ours.rewards) < 1e-9, "{place}");
            assert!(off(&theirs.rewards, &ours.rewards) < 1e-9, "{place}");
            // Gymnasium rounds what it gives out to single precision, of numbers up to 8.
            assert!(
                off(&theirs.observations[0], &ours.observations[0]) < 5e-7,
                "{place}"
            );
            assert_eq!((theirs.end, precise.end), (ours.end, ours.end), "{place}");
        }
    }
}

#[test]
fn environments_that_are_stepped_together_give_what_each_gives_alone() {
    let Some(place) = Place::new() else { return };
    let run = |together: bool| {
        let mut tanks: Vec<_> = (0..3).map(|_| place.built("own.py:Tank", json!({}))).collect();
        let mut streams: Vec<_> = ["a", "b", "c"].map(|name| stream(&[name])).into();
        let mut all = Vec::new();
        for (tank, rng) in tanks.iter_mut().zip(&mut streams) {
            all.push(tank.reset(rng).unwrap().concat());
        }
        for step in 0..20 {
            let action = vec![vec![f64::from(step) / 20.0]];
            if together {
                tanks
                    .iter_mut()
                    .for_each(|tank| tank.begin_step(&action).unwrap());
            }
            for (tank, rng) in tanks.iter_mut().zip(&mut streams) {
                all.push(tank.step(&action, rng).unwrap().observations.concat());
            }
        }
        all
    };
    assert_eq!(run(true), run(false));
}

#[test]
fn agents_of_the_parallel_interface_are_seats() {
    let Some(place) = Place::new() else { return };
    let mut pair = place.built("own.py:Pair", json!({}));
    let seats: Vec<(String, usize)> = pair
        .seats()
        .iter()
        .map(|seat| (seat.name.clone(), seat.observation.len()))
        .collect();
    assert_eq!(seats, [("filler".into(), 1), ("drainer".into(), 2)]);
    let traced: Vec<String> = pair
        .trace_channels()
        .into_iter()
        .map(|channel| channel.name)
        .collect();
    assert_eq!(
        traced,
        [
            "filler_observation",
            "drainer_observation_0",
            "drainer_observation_1"
        ]
    );
    let mut rng = stream(&["pair"]);
    let level = pair.reset(&mut rng).unwrap()[0][0];
    let step = pair.step(&[vec![1.0], vec![0.5]], &mut rng).unwrap();
    let expected = (level + 0.5 - 0.5).clamp(0.0, 4.0);
    assert_eq!(step.rewards, [expected, -expected]);
    assert_eq!(step.observations, [vec![expected], vec![expected, 1.0 / 3.0]]);
    for (left, end) in [
        (json!(null), End::Truncated),
        (json!("terminated"), End::Terminated),
    ] {
        let mut pair = place.built("own.py:Pair", json!({ "left": left }));
        pair.reset(&mut rng).unwrap();
        let ends: Vec<_> = (0..12)
            .map(|_| pair.step(&[vec![0.0], vec![0.0]], &mut rng).unwrap().end)
            .collect();
        assert_eq!((&ends[..11], ends[11]), (&[None; 11][..], Some(end)));
    }
    let mut pair = place.built("own.py:Pair", json!({ "left": "early" }));
    pair.reset(&mut rng).unwrap();
    let told = (0..3)
        .find_map(|_| pair.step(&[vec![0.0], vec![0.0]], &mut rng).err())
        .unwrap();
    assert!(
        told.to_string()
            .contains("filler left before the others, which is not supported"),
        "{told}"
    );
}

#[test]
fn a_learner_trains_in_python_and_two_workers_give_the_same_bits_as_one() {
    let Some(place) = Place::new() else { return };
    let python = place.with("gymnasium:Pendulum-v1", "g: 9.81");
    let own = place.with("own.py:Tank", "");
    let valve = place.with("own.py:Valve", "");
    place.bench.write(
        "study.yaml",
        &format!(
            "study: own\nenvironments:\n  pendulum: {{ python: {python} }}\n  tank: {{ python: {own} }}\n  valve: {{ \
             python: {valve} }}\nagents:\n  sac: {{ {LEARNER} }}\n  random: {{ {RULE} }}\nprotocol: {{ train_evaluate: \
             {{ steps: 120, environments: 4, evaluate_every: 60, episodes: 2, final_episodes: 3 }} }}\nseeds: 2\ntables:\
             \n  returns: {{ comparison: {{ rows: agent, value: return }} }}\n"
        ),
    );
    place
        .bench
        .ok(&["run", "study.yaml", "-j", "1", "--store", "one"]);
    let answer = place
        .bench
        .run(&["run", "study.yaml", "-j", "2", "--store", "two"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert_eq!(place.bench.digests("one").len(), 12);
    assert_eq!(place.bench.digests("one"), place.bench.digests("two"));
    assert!(answer.out.contains("sac"), "{}", answer.out);
}

#[test]
fn a_pair_of_agents_learns() {
    let Some(place) = Place::new() else { return };
    place.short(
        "own.py:Pair",
        "",
        "maddpg: { width: 8, batch_size: 8, learning_starts: 16 }",
    );
    let answer = place.bench.run(&["run", "study.yaml", "-j", "1"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
}

#[test]
fn what_an_environment_prints_and_reads_meets_nobody() {
    let Some(place) = Place::new() else { return };
    place.short("own.py:Chatty", "", RULE);
    let answer = place.bench.run(&["run", "study.yaml", "-j", "1"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(
        !answer.err.contains("ssss") && !answer.out.contains("ssss"),
        "{}",
        answer.err
    );
}
