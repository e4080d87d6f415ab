//! Everything that determines the numbers of a program is in its trials' identity, and a study of programs is a
//! study like any other.

use super::*;

fn study(rate: &str) -> String {
    let program = |rate: &str| {
        format!(
            "{{ program: {{ run: [sh, train.sh, \"{{rate}}\", \"{{seed}}\", \"{{steps}}\"], parameters: {{ rate: {rate} }}, \
             sources: [train.sh], lock: none, reads: {{ step: global_step }}, metrics: {{ return: charts/return }} }} }}"
        )
    };
    format!(
        "study: walk\nenvironments:\n  task: {{ named: {{ id: Walk-v0 }} }}\nagents:\n  quick: {}\n  slow: {}\nprotocol: {{ \
         train_evaluate: {{ steps: 1000, evaluate_every: 200 }} }}\nseeds: 3\nclaims:\n  - {{ claim: quick.return > \
         slow.return, why: any difference counts }}\ntables:\n  returns: {{ comparison: {{ rows: agent, value: return }} \
         }}\nfigures:\n  curve: {{ learning_curve: {{ metric: return }} }}\n",
        program(rate),
        program("0.2")
    )
}

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("train.sh", WALKER);
    bench.write("study.yaml", &study("1.0"));
    bench
}

#[test]
fn two_programs_come_to_a_table_a_curve_and_a_verdict_and_run_once() {
    let bench = bench();
    bench.ok(&["check", "study.yaml"]);
    bench.ok(&["run", "study.yaml", "--yes"]);
    let before = bench.digests("store");
    assert_eq!(before.len(), 6);
    let table = fs::read_to_string(bench.path("results/walk/tables/returns.md")).unwrap();
    assert!(table.contains("quick") && table.contains("slow"), "{table}");
    let page = fs::read_to_string(bench.path("results/walk/index.html")).unwrap();
    assert!(
        page.contains("SUPPORTED") && !page.contains("NOT TRAINED"),
        "{page}"
    );
    assert!(bench.path("results/walk/figures/curve.svg").is_file());
    let again = bench.run(&["run", "study.yaml", "--yes"]);
    assert!(
        again.code == 0 && bench.digests("store") == before,
        "{}",
        again.err
    );
    bench.ok(&["verify", "study.yaml", "--yes"]);
    bench.ok(&["fsck", "store"]);
}

#[test]
fn another_byte_of_a_source_is_another_trial_and_plan_says_which() {
    let bench = bench();
    bench.ok(&["run", "study.yaml", "--yes"]);
    bench.write("train.sh", &WALKER.replace("7919", "7907"));
    let plan = bench.ok(&["plan", "study.yaml"]);
    assert!(plan.contains("train.sh"), "{plan}");
    bench.ok(&["run", "study.yaml", "--yes"]);
    assert_eq!(bench.digests("store").len(), 12);
    bench.write("train.sh", WALKER);
    bench.ok(&["run", "study.yaml", "--yes"]);
    assert_eq!(bench.digests("store").len(), 12, "what was there is there");
}

#[test]
fn what_shows_a_metric_and_what_starts_and_ends_a_program_determine_nothing() {
    let bench = bench();
    bench.ok(&["run", "study.yaml", "--yes"]);
    let more = "lock: none, interpreter: /bin/sh, stop: { grace_s: 1 }, inherit: [MORE], shown: { return: { unit: m } }";
    bench.write(
        "study.yaml",
        &study("1.0")
            .replace("lock: none", more)
            .replace("quick:", "fast:")
            .replace("quick.", "fast."),
    );
    let plan: Value = serde_json::from_str(&bench.ok(&["plan", "study.yaml", "--format", "json"])).unwrap();
    let missing: u64 = plan["cells"]
        .as_array()
        .unwrap()
        .iter()
        .map(|it| it["missing"].as_u64().unwrap())
        .sum();
    assert_eq!(missing, 0, "{plan}");
}

#[test]
fn a_sweep_of_a_parameter_makes_a_trial_of_each_value() {
    let bench = bench();
    let swept = study("1.0") + "sweep:\n  quick.parameters.rate: { grid: [0.5, 1.0, 2.0] }\n";
    let swept = swept.replace(
        "quick.return > slow.return",
        "\"quick[rate=2.0].return > slow.return\"",
    );
    bench.write("study.yaml", &swept);
    bench.ok(&["run", "study.yaml", "--yes"]);
    assert_eq!(bench.digests("store").len(), 12);
}

#[test]
fn what_is_not_declared_is_not_there_and_edits_during_a_run_poison_nothing() {
    let place = Place::new(
        "[ -e other.txt ] && exit 9; echo r=1; touch started; sleep 1; sh b.sh\n",
        "{ return: r }",
        "",
    );
    place.bench.write("other.txt", "not declared");
    place.bench.write("b.sh", "echo r=2\n");
    let mut child = place
        .bench
        .command(&["run", "study.yaml", "--yes"])
        .spawn()
        .unwrap();
    until("it runs", || {
        place.bench.path("store/trials").is_dir() && place.work().join("started").is_file()
    });
    place.bench.write("b.sh", "exit 7\n");
    assert!(child.wait().unwrap().success());
    assert_eq!(place.trial()["end"]["state"], "ok");
}

#[test]
fn wrong_files_and_words_are_told_by_check_at_their_place() {
    assert_refused(&[
        (
            "\"{seed}\"",
            "\"{sed}\"",
            "`{sed}` stands for nothing here; these do: `{rate}`, `{seed}`",
        ),
        (
            "sources: [train.sh]",
            "sources: [train.py]",
            "no file is named by `train.py`",
        ),
        (
            "sources: [train.sh]",
            "sources: [\"../*.sh\"]",
            "leads out of the folder of the study",
        ),
        (
            "sources: [train.sh]",
            "sources: [../a.sh]",
            "as `sources: { a.sh: { file: /PATH/a.sh } }`",
        ),
        (
            "sources: [train.sh]",
            "sources: [lib/]",
            "`lib/**/*` names all files in that folder and below",
        ),
        (
            "sources: [train.sh]",
            "sources: [\"**\"]",
            "`**/*` names all files in that folder and below",
        ),
        (
            "lock: none",
            "lock: uv.lock",
            "a file is written as `lock: { file: uv.lock }`",
        ),
        (
            "lock: none",
            "lock: { file: uv.lock }",
            "there is no data file `uv.lock`",
        ),
        (
            ", lock: none",
            "",
            "names no file, so that nothing says which packages",
        ),
    ]);
}

#[test]
fn wrong_metrics_environments_and_protocols_are_told_by_check_at_their_place() {
    assert_refused(&[
        (
            "return: charts/return",
            "wall_time: charts/return",
            "is recorded of every trial",
        ),
        ("id: Walk-v0", "name: Walk-v0", "`id`: names no task"),
        (
            "\"{steps}\"",
            "\"{environment.size}\"",
            "the environment has no value `size`; it has `id`",
        ),
        (
            "slow: {",
            "random: { random_allocation: {} }\n  slow: {",
            "the environment is named alone",
        ),
        (
            "train_evaluate: { steps: 1000, evaluate_every: 200 }",
            "track: {}",
            "lets it train",
        ),
    ]);
}

/// Replaces a part of a good study by another one, and looks for the sentence of the refusal.
fn assert_refused(mistakes: &[(&str, &str, &str)]) {
    let good = study("1.0");
    for (what, instead, told) in mistakes {
        let bench = bench();
        fs::create_dir(bench.path("lib")).unwrap();
        assert!(good.contains(what), "{what}");
        bench.write("study.yaml", &good.replace(what, instead));
        let answer = bench.run(&["check", "study.yaml"]);
        assert_eq!(answer.code, 2, "{instead}: {}", answer.err);
        assert!(answer.err.contains(told), "{instead}: {}", answer.err);
    }
}

#[test]
fn a_parameter_that_no_word_has_is_doubted() {
    let bench = bench();
    bench.write(
        "study.yaml",
        &study("1.0").replace("rate: 1.0", "rate: 1.0, gamma: 0.99"),
    );
    let answer = bench.run(&["check", "study.yaml"]);
    assert!(
        answer.code == 0 && answer.err.contains("no word of the program has `{gamma}`"),
        "{}",
        answer.err
    );
}

#[test]
fn several_seeds_of_a_program_that_does_not_know_them_are_doubted() {
    let bench = Bench::new();
    bench.write("a.sh", "");
    let doubted = |run: &str, more: &str, seeds: &str| {
        let study = study_of(run, "{ return: r }", more).replace("seeds: 1", seeds);
        bench.write("study.yaml", &study);
        let answer = bench.run(&["check", "study.yaml"]);
        assert_eq!(answer.code, 0, "{}", answer.err);
        answer.err.contains("no word of it has `{seed}`")
    };
    assert!(doubted("[sh, a.sh]", "", "seeds: 2"));
    assert!(!doubted("[sh, a.sh]", "", "seeds: 1"));
    assert!(!doubted("[sh, a.sh, \"{seed}\"]", "", "seeds: 2"));
    assert!(!doubted("[sh, a.sh]", "      resume: [\"{seed}\"]", "seeds: 2"));
}

#[test]
fn patterns_of_sources_do_not_find_files_of_the_engine() {
    let bench = Bench::new();
    fs::create_dir(bench.path("lib")).unwrap();
    bench.write("lib/a.sh", "echo step=1000 r=1\n");
    let study = study_of("[sh, a.sh]", "{ return: r }", "").replace("[\"*.sh\"]", "[\"**/*\"]");
    bench.write("lib/study.yaml", &study);
    let places = ["--store", "lib/kept", "-o", "lib/out/one"];
    let run = || bench.run(&[&["run", "lib/study.yaml", "-j", "1", "--yes"], &places[..]].concat());
    let first = run();
    assert_eq!(first.code, 0, "{}", first.err);
    let again = run();
    assert!(again.err.contains("nothing runs"), "{}", again.err);
}

#[test]
fn values_and_environments_without_an_argument_are_told_at_their_lines() {
    let (good, bench) = (study("1.0"), bench());
    let refusal = |text: &str| {
        bench.write("study.yaml", text);
        let answer = bench.run(&["check", "study.yaml"]);
        assert_eq!(answer.code, 2, "{}", answer.err);
        answer.err
    };
    let line = |text: &str, part: &str| text.lines().position(|line| line.contains(part)).unwrap() + 1;
    let swept = good.clone() + "sweep:\n  quick.rate: { grid: [0.5, \"--all\"] }\n";
    let told = refusal(&swept);
    let place = format!("study.yaml:{}:", line(&swept, "--all"));
    assert!(
        told.contains("which a program would take for an option") && told.contains(&place),
        "{told}"
    );
    let other = good
        .replace(
            "{ named: { id: Walk-v0 } }",
            "{ named: { id: Walk-v0, size: 3 } }\n  other: { named: { id: Run-v0 } }",
        )
        .replace("\"{steps}\"", "\"{environment.size}\"");
    let told = refusal(&other);
    let place = format!("study.yaml:{}:", line(&other, "Run-v0"));
    assert!(
        told.contains("with this environment") && told.contains(&place),
        "{told}"
    );
}

#[test]
fn a_parameter_is_a_key_of_its_agent() {
    let bench = bench();
    let swept = study("1.0")
        + "sweep:\n  quick.rate: { grid: [0.5, 2.0] }\nprofiles:\n  smoke: { protocol.steps: 500, slow.rate: 0.1 }\n";
    let swept = swept.replace(
        "quick.return > slow.return",
        "\"quick[rate=2.0].return > slow.return\"",
    );
    bench.write("study.yaml", &swept);
    bench.ok(&["run", "study.yaml", "--yes"]);
    assert_eq!(bench.digests("store").len(), 9);
    bench.ok(&["run", "study.yaml", "--profile", "smoke", "--yes"]);
    let answer = bench.run(&["check", "study.yaml", "--set", "quick.rat=1"]);
    assert!(
        answer.code == 2 && answer.err.contains("`program` has no key `rat`"),
        "{}",
        answer.err
    );
    assert!(
        answer.err.contains("did you mean `rate`") || answer.err.contains("`rate`"),
        "{}",
        answer.err
    );
}

#[test]
fn of_runs_that_do_not_repeat_the_first_that_was_stored_stays() {
    let place = Place::new("echo r=$(cat ../../../../../../luck)\n", "{ return: r }", "");
    for (store, luck) in [("one", "1"), ("two", "2")] {
        place.bench.write("luck", luck);
        place.bench.ok(&["run", "study.yaml", "--yes", "--store", store]);
    }
    let answer = place.bench.run(&["merge", "two", "--into", "one"]);
    assert_eq!(answer.code, 0, "{}\n{}", answer.out, answer.err);
    let told = answer.out + &answer.err;
    assert!(
        told.contains("1 other runs") && told.contains("what was stored first counts"),
        "{told}"
    );
    place.bench.ok(&["fsck", "one"]);
}

#[test]
fn the_study_of_the_book_comes_to_what_it_shows() {
    let page = fs::read_to_string(crate::program::repository().join("docs/src/programs.md")).unwrap();
    let bench = Bench::new();
    bench.write("study.yaml", &blocks(&page, "yaml")[0]);
    let shown = blocks(&page, "text");
    let program = shown.iter().find(|block| block.starts_with("awk")).unwrap();
    bench.write("train.sh", program);
    bench.ok(&["run", "study.yaml", "--yes"]);
    let page = fs::read_to_string(bench.path("results/walk/index.html")).unwrap();
    assert!(page.contains("SUPPORTED"), "{page}");
}
