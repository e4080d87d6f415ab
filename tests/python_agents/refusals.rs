//! Refusals before anything runs: where, what, and what instead.

use super::*;

/// The words of `check` about an agent that it refuses with this code.
fn said(place: &Place, code: i32, task: &str, agent: &str) -> String {
    study(place, task, &[("mine", agent)], SHORT);
    let answer = place.bench.run(&["check", "study.yaml"]);
    let words = words(&answer);
    assert_eq!(answer.code, code, "{agent}: {words}");
    words
}

/// A maker of a rule in the tank, and the words of its refusal.
const RULES: &[(&str, &str, &str)] = &[
    (
        "rules.py:no_such_class",
        "",
        "has no function `no_such_class`; it has `Broken`",
    ),
    (
        "rules.py:Rul",
        "",
        "has no function `Rul`; did you mean `Rule`? it has",
    ),
    (
        "rules.py:number",
        "",
        "what it makes is of type int, which has neither `act` nor `act_batch`",
    ),
    ("rules.py:Lazy", "", "of type Lazy, which has neither"),
    ("absent.py:Rule", "", "`make` names a file that cannot be read"),
    (
        "rules",
        "",
        "`rules` names nothing that makes an agent: write `FILE.py:CLASS`",
    ),
    ("rules.py:Rule", "hight: 3", "unexpected keyword argument 'hight'"),
    (
        "rules.py:Told",
        "seed: 3",
        "`seed` is what every agent can ask for: give this argument another name",
    ),
    (
        "rules.py:Failing",
        "",
        "in pressure: return observation[9] rules.py, line",
    ),
    ("rules.py:Failing", "", "IndexError: index 9 is out of bounds"),
    (
        "rules.py:Returns",
        "how: none",
        "`act` of `Returns` (rules.py, line",
    ),
    (
        "rules.py:Returns",
        "how: none",
        "returned None (NoneType) in place of a number",
    ),
    (
        "rules.py:Returns",
        "how: text",
        "returned 'high' (str) in place of a number",
    ),
    (
        "rules.py:Returns",
        "how: two",
        "returned a list of 2 in place of a number",
    ),
    (
        "rules.py:Returns",
        "how: ragged",
        "returned a list of 2 in place of a number",
    ),
    (
        "rules.py:Returns",
        "how: outside",
        "returned 1.7 for `action`, outside 0 to 1",
    ),
    (
        "rules.py:Returns",
        "how: nan",
        "`make`: the action of `rules.py:Returns` (counted in its decisions) is NaN",
    ),
    (
        "rules.py:Rows",
        "",
        "returned 0.5 (float) in place of an array of shape (2, 1), a row for each observation: a number in each",
    ),
    (
        "rules.py:Random",
        "",
        "the same seed does not give the same actions the second time: at step 1, the action is",
    ),
    (
        "rules.py:Random",
        "",
        "must come from `rng`, which its methods may take as an argument",
    ),
    (
        "rules.py:Learner",
        "",
        "`learns`: `Learner` has a `learn`, which nobody calls: write `learns: true`",
    ),
    ("rules.py:SaveAlone", "", "`SaveAlone` has `save` and no `load`"),
];

#[test]
fn rules_that_cannot_be_used_are_refused_with_what_to_do() {
    let Some(place) = Place::new() else { return };
    let tank = environment(&place, "own.py:Tank");
    for (make, arguments, expected) in RULES {
        let found = said(&place, 2, &tank, &rule(&place, make, arguments));
        assert!(found.contains(expected), "{make} {arguments}: {found}");
    }
}

#[test]
fn actions_of_other_kinds_are_refused_with_what_there_is() {
    let Some(place) = Place::new() else { return };
    for (task, how, expected) in [
        (
            "allocation_bandit: {}",
            "negative",
            "returned the share -0.5: shares are not negative",
        ),
        (
            "allocation_bandit: {}",
            "sum",
            "returned shares that sum to 1.5: they sum to 1",
        ),
        (
            "allocation_bandit: {}",
            "shares",
            "returned a list of 2 in place of 3 shares that sum to 1",
        ),
        (
            "inspection_planning: {}",
            "half",
            "returned 0.5 (float) in place of a dictionary with 'component_0', 'component_1'",
        ),
    ] {
        let found = said(
            &place,
            2,
            task,
            &rule(&place, "rules.py:Returns", &format!("how: {how}")),
        );
        assert!(found.contains(expected), "{task} {how}: {found}");
    }
    let unknown = rule(&place, "rules.py:ByName", "option: mend");
    let found = said(&place, 2, "inspection_planning: {}", &unknown);
    let expected = "returned 'mend' (str) for `choice` for seat `component_0`; its options are 0 (nothing), 1 \
                    (inspect), 2 (repair)";
    assert!(found.contains(expected), "{found}");
    let valve = environment(&place, "own.py:Valve");
    for how in ["half", "option"] {
        let found = said(
            &place,
            2,
            &valve,
            &rule(&place, "rules.py:Returns", &format!("how: {how}")),
        );
        assert!(
            found.contains("for `action`; its options are 1, 2, 3"),
            "{how}: {found}"
        );
    }
    let pair = environment(&place, "own.py:Pair");
    let found = said(
        &place,
        2,
        &pair,
        &rule(&place, "rules.py:Returns", "how: dictionary"),
    );
    let expected = "returned a dictionary with 'filler' in place of a dictionary with 'filler', 'drainer'";
    assert!(found.contains(expected), "{found}");
}

/// A maker of a learner in the tank, and the words of its refusal.
const LEARNERS: &[(&str, &str, &str)] = &[
    (
        "rules.py:Rule",
        LEARNS,
        "`learns`: it is true, and `Rule` has no `learn`",
    ),
    (
        "rules.py:Rule",
        "metrics: [loss],",
        "`metrics`: are those that `learn` returns",
    ),
    (
        "rules.py:Learner",
        "learns: true, metrics: [return],",
        "`return` is recorded of every environment; take what `learn` returns with another name",
    ),
    (
        "rules.py:Undeclared",
        LEARNS,
        "returned `loss`, which the study does not name: write `metrics: [loss, mean_reward]`",
    ),
    (
        "rules.py:Returned",
        LEARNS,
        "returned 0.5 (float) in place of None or a dictionary of numbers by name",
    ),
    (
        "rules.py:LossText",
        LEARNS,
        "is 'high' (str) in place of a number",
    ),
    (
        "rules.py:Broken",
        LEARNS,
        "RuntimeError: the gradient is lost rules.py, line",
    ),
    (
        "rules.py:Forgetful",
        LEARNS,
        "what `load` took up of `save` does not go on alike: after it, the action is",
    ),
    (
        "rules.py:Torn",
        LEARNS,
        "`load` fails: EOFError: half of it is missing",
    ),
    (
        "rules.py:Text",
        LEARNS,
        "returned 'weights' (str) in place of bytes, as pickle.dumps makes them",
    ),
    (
        "rules.py:Remembering",
        LEARNS,
        "`Remembering` has `restart`, and learns",
    ),
];

#[test]
fn learners_that_cannot_be_trained_are_refused_with_what_to_do() {
    let Some(place) = Place::new() else { return };
    let tank = environment(&place, "own.py:Tank");
    for (make, more, expected) in LEARNERS {
        let found = said(&place, 2, &tank, &agent(&place, make, more));
        assert!(found.contains(expected), "{make}: {found}");
    }
}

#[test]
fn whether_it_learns_is_said_in_the_agent_itself() {
    let Some(place) = Place::new() else { return };
    let learner = agent(&place, "rules.py:Learner", "learns: true,");
    study(
        &place,
        &environment(&place, "own.py:Tank"),
        &[("mine", &learner)],
        SHORT,
    );
    let text = fs::read_to_string(place.bench.path("study.yaml")).unwrap();
    place.bench.write(
        "study.yaml",
        &(text + "sweep: { mine.learns: { grid: [true, false] } }\n"),
    );
    let answer = place.bench.run(&["check", "study.yaml"]);
    let words = words(&answer);
    assert!(
        answer.code == 2 && words.contains("`learns`: it is said in the agent itself"),
        "{words}"
    );
}

#[test]
fn the_lock_file_pins_what_an_agent_is_handed() {
    let Some(place) = Place::new() else { return };
    let lock = fs::read_to_string(place.bench.path("requirements.txt")).unwrap();
    let numpy = lock.lines().find(|line| line.starts_with("numpy")).unwrap();
    place.bench.write("requirements.txt", &format!("{numpy}\n"));
    // A rule needs arrays alone; spaces are Gymnasium's.
    said(
        &place,
        0,
        "pendulum: {}",
        &rule(&place, "rules.py:Numbered", "number: 0"),
    );
    let told = said(&place, 2, "pendulum: {}", &rule(&place, "rules.py:Told", ""));
    assert!(
        told.contains("`requirements.txt` pins no version of gymnasium"),
        "{told}"
    );
    place
        .bench
        .write("requirements.txt", "gymnasium==0.1\nnumpy==0.1\n");
    let other = said(
        &place,
        3,
        "pendulum: {}",
        &rule(&place, "rules.py:Numbered", "number: 0"),
    );
    assert!(
        other.contains("installed is not what `requirements.txt` says"),
        "{other}"
    );
    place.bench.write("requirements.txt", "# nothing\n");
    let silent = said(
        &place,
        2,
        "pendulum: {}",
        &rule(&place, "rules.py:Numbered", "number: 0"),
    );
    assert!(silent.contains("pins no version of numpy"), "{silent}");
}

#[test]
fn an_agent_that_says_nothing_is_ended_by_check_within_the_limit() {
    let Some(place) = Place::new() else { return };
    let silent = rule(&place, "rules.py:Silent", "");
    study(
        &place,
        &environment(&place, "own.py:Tank"),
        &[("mine", &silent)],
        SHORT,
    );
    let text = fs::read_to_string(place.bench.path("study.yaml")).unwrap();
    place
        .bench
        .write("study.yaml", &(text + "limits: { wall_time_s: 4 }\n"));
    let answer = place.bench.run(&["check", "study.yaml"]);
    let words = words(&answer);
    let expected = "`make`: the rehearsal of the agent with `";
    assert!(
        answer.code == 2 && words.contains(expected) && words.contains("longer than the limit of 4 s"),
        "{words}"
    );
    until("Python is gone", || processes_of(&place).is_empty());
}
