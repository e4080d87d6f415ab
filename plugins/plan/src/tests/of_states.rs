//! A state apart from processors: processors of other shapes that share it, copies, errors, and what is refused.

use super::of_plans::{digest, filled, regression};
use super::*;
use crate::StateError;

/// The routine `act` of [`regression`] for another number of rows, and with a factor that is transposed.
fn actor(rows: usize) -> Processor<f32> {
    let mut graph = Graph::new();
    let x = graph.input("x", [rows, 3]);
    let (target, b) = (graph.parameter("target", [3, 2]), graph.parameter("b", [1, 2]));
    let _ = graph.routine("act");
    let action = graph.dense(x, target, b, Activation::Relu);
    let back = graph.product(action, target, [false, true]);
    graph.output("action", action);
    graph.output("back", back);
    let mut processor = Processor::new(graph);
    processor.write("x", &singles(3 * rows, 77));
    processor
}

fn act(processor: &mut Processor<f32>, state: &mut State<f32>) -> [Vec<u32>; 2] {
    processor.run("act", state);
    ["action", "back"].map(|name| bits(processor.entries(name)))
}

#[test]
fn processors_of_other_shapes_share_a_state() {
    let graph = regression(true);
    let (mut learner, mut state) = filled(&graph);
    let (mut alone, mut own) = filled(&graph);
    let (mut three, mut one) = (actor(3), actor(1));
    let mut seen = Vec::new();
    for _ in 0..5 {
        learner.run("update", &mut state);
        alone.run("update", &mut own);
        let found = act(&mut three, &mut state);
        assert_eq!(
            found,
            act(&mut actor(3), &mut state.clone()),
            "as a fresh processor"
        );
        assert_eq!(found, act(&mut three, &mut state), "no change without an update");
        act(&mut one, &mut state);
        assert!(!seen.contains(&found), "new parameters");
        seen.push(found);
    }
    for (processor, state) in [(&mut learner, &mut state), (&mut alone, &mut own)] {
        processor.run("act", state);
    }
    assert_eq!(digest(&learner, &state), digest(&alone, &own));
}

#[test]
fn clones_continue_to_the_same_bits_in_one_processor() {
    let (mut processor, mut one) = filled(&regression(true));
    (0..3).for_each(|_| processor.run("update", &mut one));
    let mut other = one.clone();
    let mut steps = |state: &mut State<f32>| {
        processor.run("update", state);
        processor.run("act", state);
        digest(&processor, state)
    };
    for round in 0..3 {
        assert_eq!(steps(&mut one), steps(&mut other), "round {round}");
    }
    // The other clone is three steps ahead while this one follows.
    let ahead: Vec<_> = (0..3).map(|_| steps(&mut one)).collect();
    let behind: Vec<_> = (0..3).map(|_| steps(&mut other)).collect();
    assert_eq!(ahead, behind);
    assert_eq!([&one, &other].map(|state| state.steps("w")), [9, 9]);
}

#[test]
fn clones_that_part_mix_no_entries_in_one_processor() {
    let graph = regression(true);
    let (mut processor, mut one) = filled(&graph);
    processor.run("update", &mut one);
    let mut other = one.clone();
    other.set_number("rate", 0.02);
    for round in 0..3 {
        for state in [&mut one, &mut other] {
            let (mut fresh, mut own) = (filled(&graph).0, state.clone());
            for (processor, state) in [(&mut processor, &mut *state), (&mut fresh, &mut own)] {
                processor.run("update", state);
                processor.run("act", state);
            }
            assert_eq!(digest(&processor, state), digest(&fresh, &own), "round {round}");
        }
        assert_ne!(bits(one.entries("w")), bits(other.entries("w")));
    }
}

#[test]
fn a_cloned_processor_goes_its_own_way() {
    let (mut one, mut state) = filled(&regression(true));
    one.run("update", &mut state);
    let (mut other, mut own) = (one.clone(), state.clone());
    other.write("x", &singles(18, 123));
    other.run("update", &mut own);
    one.run("update", &mut state);
    one.run("act", &mut state);
    let (mut alone, mut expected) = filled(&regression(true));
    (0..2).for_each(|_| alone.run("update", &mut expected));
    alone.run("act", &mut expected);
    assert_eq!(digest(&one, &state), digest(&alone, &expected));
    assert_ne!(bits(own.entries("w")), bits(state.entries("w")));
}

#[test]
fn a_restored_plan_continues_to_the_same_bits() {
    let graph = regression(true);
    let (mut one, mut state) = filled(&graph);
    (0..3).for_each(|_| one.run("update", &mut state));
    // Moments are there after the first update of another state.
    let (mut other, mut restored) = filled(&graph);
    other.run("update", &mut restored);
    for name in ["x", "y"] {
        other.write(name, one.entries(name));
    }
    for (name, shape, entries) in state.tensors() {
        restored.replace(name, &shape, entries.to_vec()).unwrap();
    }
    restored.set_counts(state.counts().clone());
    for (processor, state) in [(&mut one, &mut state), (&mut other, &mut restored)] {
        processor.run("update", state);
        processor.run("act", state);
    }
    assert_eq!(digest(&one, &state), digest(&other, &restored));
    assert_eq!(restored.steps("w"), 4);
    // A state may also be composed of the parts of another one.
    let mut third = State::default();
    for (name, shape, entries) in state.tensors() {
        third.insert(name, shape, entries.to_vec());
    }
    third.set_counts(state.counts().clone());
    for state in [&mut state, &mut third] {
        one.run("update", state);
    }
    assert_eq!(digest(&one, &state), digest(&one, &third));
}

#[test]
fn parts_that_do_not_fit_are_errors() {
    let (_, mut state) = filled(&regression(true));
    let before = bits(state.entries("w"));
    let missing = StateError::Missing { name: "x".into() };
    assert_eq!(state.replace("x", &[], Vec::new()), Err(missing.clone()));
    assert_eq!(missing.to_string(), "there is no `x`");
    let error = state.replace("w", &[1, 1], vec![1.0]).unwrap_err();
    let expected = StateError::Shape {
        name: "w".into(),
        expected: [3, 2],
        found: vec![1, 1],
    };
    assert_eq!(error, expected);
    assert_eq!(error.to_string(), "`w` has the shape [1, 1], not [3, 2]");
    assert!(state.replace("w", &[2, 3], vec![1.0; 6]).is_err());
    assert_eq!(bits(state.entries("w")), before);
    assert_eq!(state.replace("w", &[3, 2], vec![1.0; 6]), Ok(()));
    assert_eq!(state.entries("w"), [1.0; 6]);
    let refused = panic_of(|| _ = state.replace("w", &[3, 2], vec![1.0]));
    assert!(refused.contains("entries of `w` [3, 2]"), "{refused}");
    let refused = panic_of(|| state.insert("w", [3, 2], vec![1.0]));
    assert!(refused.contains("entries of `w` [3, 2]"), "{refused}");
    assert_eq!(panic_of(|| _ = state.entries("x")), "no parameter `x`");
    assert_eq!(panic_of(|| _ = state.entries_mut("x")), "no parameter `x`");
    assert_eq!(state.tensor("x"), None);
}

#[test]
fn runs_that_do_not_fit_a_state_are_refused() {
    let (mut processor, mut state) = filled(&regression(true));
    processor.run("act", &mut state);
    let expected = digest(&processor, &state);
    let mut without = State::default();
    for (name, shape, entries) in state.tensors().filter(|(name, ..)| *name != "w") {
        without.insert(name, shape, entries.to_vec());
    }
    let refused = panic_of(|| processor.run("update", &mut without));
    assert_eq!(refused, "no parameter `w`");
    assert_eq!(without.entries("target"), state.entries("target"));
    let mut other = state.clone();
    // It has the place that the processor knows.
    other.insert("target", [2, 3], state.entries("target").to_vec());
    let refused = panic_of(|| processor.run("act", &mut other));
    assert!(
        refused.contains("`target` of the state and of the graph"),
        "{refused}"
    );
    assert!(
        refused.contains("[2, 3]") && refused.contains("[3, 2]"),
        "{refused}"
    );
    processor.run("act", &mut state);
    assert_eq!(digest(&processor, &state), expected);
}

#[test]
fn names_that_a_plan_lacks_are_refused() {
    let (mut processor, mut state) = filled(&regression(true));
    for (expected, refused) in [
        (
            "the plan has no routine `play`",
            panic_of(|| processor.run("play", &mut state)),
        ),
        (
            "the plan has no value `z`",
            panic_of(|| processor.write("z", &[])),
        ),
        (
            "`w` [3, 2] is no input",
            panic_of(|| processor.write("w", &[0.0; 6])),
        ),
        ("`w` [3, 2] is no output", panic_of(|| _ = processor.entries("w"))),
        (
            "entries of the input `x`",
            panic_of(|| processor.write("x", &[0.0])),
        ),
        ("numbers of `action`", panic_of(|| _ = processor.number("action"))),
    ] {
        assert!(refused.contains(expected), "{expected}: {refused}");
    }
}

#[test]
fn a_number_of_the_state_replaces_that_of_the_graph() {
    let (mut processor, mut state) = filled(&regression(true));
    let before = bits(state.entries("w"));
    assert_eq!(state.number("rate"), None);
    state.set_number("rate", 0.0);
    processor.run("update", &mut state);
    assert_eq!(bits(state.entries("w")), before);
    assert_eq!((state.number("rate"), state.steps("w")), (Some(0.0), 1));
    let (_, mut other) = filled(&regression(true));
    state.set_number("rate", 0.1);
    processor.run("update", &mut state);
    assert_ne!(bits(state.entries("w")), before);
    // The number in the graph is the same.
    let [mut with, mut without] = [other.clone(), other.clone()];
    with.set_number("rate", 0.1);
    other.set_number("rate", 0.05);
    for state in [&mut with, &mut without, &mut other] {
        processor.run("update", state);
    }
    assert_eq!(bits(with.entries("w")), bits(without.entries("w")));
    assert_ne!(bits(with.entries("w")), bits(other.entries("w")));
}

#[test]
fn copies_have_the_parameters_moments_and_steps_of_a_name() {
    let mut state = state_of::<f32>(&[("net.w", &[1.0]), ("net.w.first", &[2.0]), ("network.w", &[3.0])]);
    state.set_counts([("net.w".to_owned(), 5), ("network.w".to_owned(), 6)].into());
    state.copy("net", "copy");
    let names: Vec<_> = state.tensors().map(|(name, ..)| name).collect();
    assert_eq!(
        names,
        ["net.w", "net.w.first", "network.w", "copy.w", "copy.w.first"]
    );
    assert_eq!(
        [state.entries("copy.w"), state.entries("copy.w.first")],
        [[1.0], [2.0]]
    );
    assert_eq!((state.steps("copy.w"), state.counts().len()), (5, 3));
    state.entries_mut("net.w")[0] = 9.0;
    assert_eq!(state.entries("copy.w"), [1.0]);
    let wide = state.widened();
    assert_eq!((wide.entries("net.w"), wide.steps("net.w")), (&[9.0][..], 5));
}
