//! The parts of a trial's id, and commands that need no Python.

use super::*;

fn count(place: &Place) -> usize {
    place.bench.ok(&["run", "study.yaml", "-j", "1"]);
    place.bench.digests("store").len()
}

#[test]
fn the_content_of_files_is_in_the_id_and_neither_their_paths_nor_the_interpreter_are() {
    let Some(place) = Place::new() else { return };
    let with = |make: &str, more: &str| {
        let agent = agent(&place, make, more);
        study(
            &place,
            "pendulum: {}",
            &[("rule", &agent)],
            "{ steps: 0, final_episodes: 2 }",
        );
    };
    let constant = |number: &str| {
        format!(
            "import half\n\n\nclass Rule:\n    def act(self, observation):\n        return half.of({number})\n"
        )
    };
    let sources = "sources: [{ file: half.py }],";
    place.bench.write("rule.py", &constant("0.5"));
    place
        .bench
        .write("half.py", "def of(number):\n    return number / 2\n");
    with("rule.py:Rule", sources);
    assert_eq!(count(&place), 1);
    place.bench.write("elsewhere.py", &constant("0.5"));
    with("elsewhere.py:Rule", sources);
    assert_eq!(
        count(&place),
        1,
        "what a file holds is in the id, its name is not"
    );
    place.bench.write("rule.py", &constant("0.7"));
    with("rule.py:Rule", sources);
    assert_eq!(count(&place), 2, "the file is in the id");
    place
        .bench
        .write("half.py", "def of(number):\n    return number / 4\n");
    assert_eq!(count(&place), 3, "what it imports is in the id");
    with("rule.py:Rule", &format!("{sources} arguments: {{}},"));
    assert_eq!(count(&place), 3);
}

#[test]
fn what_is_computed_needs_no_python_again() {
    let Some(place) = Place::new() else { return };
    let known = rule(&place, "rules.py:Rule", "");
    let task = environment(&place, "own.py:Tank");
    study(
        &place,
        &task,
        &[("rule", &known)],
        "{ steps: 0, final_episodes: 2 }",
    );
    assert_eq!(count(&place), 1);
    let text = fs::read_to_string(place.bench.path("study.yaml")).unwrap();
    let absent = text.replace(
        &format!("interpreter: {}", place.interpreter),
        "interpreter: no-such-python",
    );
    place.bench.write("study.yaml", &absent);
    assert_eq!(count(&place), 1);
    // Whoever checks believes no record.
    let answer = place.bench.run(&["check", "study.yaml"]);
    assert_eq!(answer.code, 3, "{}", answer.err);
}
