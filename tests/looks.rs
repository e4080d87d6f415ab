//! Seeds that are added look by look, and verdicts that were seen before.

use crate::program::Bench;
use std::collections::BTreeMap;

pub(crate) const STUDY: &str = "
study: looks
environments:
  cells: { battery: { cells: 2 } }
agents:
  equal: { equal_split: {} }
  random: { random_allocation: {} }
  observed: { water_filling: {} }
  known: { water_filling_true_state: {} }
protocol: { train_evaluate: { steps: 0, final_episodes: 2, trace_episodes: 0 } }
seeds: { min: 3, max: 9, looks: 3 }
tables:
  improvement:
    improvement: { rows: agent, value: cycle_length, relative_to: equal, agents: [random, equal] }
    published: { random: -90, equal: 0 }
    margin: { absolute: 30, why: a third of the scale }
claims:
  - equal.cycle_length > random.cycle_length
  - known.cycle_length > 1.1 * observed.cycle_length
  - observed.cycle_length > 158
";

/// Seeds that ended `ok`, by agent.
fn seeds(bench: &Bench, store: &str) -> BTreeMap<String, u64> {
    let status: serde_json::Value =
        serde_json::from_str(&bench.ok(&["status", "looks.yaml", "--store", store, "--format", "json"]))
            .unwrap();
    let cells = status["cells"].as_array().unwrap().iter();
    cells
        .map(|cell| {
            (
                cell["agent"].as_str().unwrap().to_owned(),
                cell["ok"].as_u64().unwrap(),
            )
        })
        .collect()
}

fn report(bench: &Bench) -> String {
    std::fs::read_to_string(bench.path("results/looks/report.md")).unwrap()
}

#[test]
fn a_difference_too_small_to_matter_is_decided_and_costs_no_more_seeds() {
    // Open after nine seeds where any difference matters.
    let bench = Bench::new();
    let open = "  - observed.cycle_length > 158\n";
    let alike = "  - { claim: observed.cycle_length > 158, min_effect: 60, why: a third of a cycle }\n";
    assert!(STUDY.contains(open));
    bench.write("looks.yaml", &STUDY.replace(open, alike));
    let said = bench.ok(&["run", "looks.yaml", "-j", "2", "--store", "one", "--verbose"]);
    let expected =
        [("equal", 6), ("known", 3), ("observed", 6), ("random", 6)].map(|(agent, n)| (agent.to_owned(), n));
    assert_eq!(seeds(&bench, "one"), BTreeMap::from(expected));
    let report = report(&bench);
    for text in [&said, &report] {
        assert!(text.contains("EQUIVALENT"), "{text}");
    }
    let verdicts = std::fs::read_to_string(bench.path("results/looks/verdicts.json")).unwrap();
    let verdicts: serde_json::Value = serde_json::from_str(&verdicts).unwrap();
    assert_eq!(verdicts["judged"], verdicts["decided"], "{verdicts}");
    let overview = bench.ok(&["overview", "results", "--open"]);
    assert!(!overview.contains("observed.cycle_length"), "{overview}");
}

#[test]
fn what_is_decided_stops_costing_and_what_is_open_goes_on() {
    let bench = Bench::new();
    bench.write("looks.yaml", STUDY);
    let said = bench.ok(&["run", "looks.yaml", "-j", "2", "--store", "one", "--verbose"]);
    let expected =
        [("equal", 6), ("known", 3), ("observed", 9), ("random", 6)].map(|(agent, n)| (agent.to_owned(), n));
    assert_eq!(seeds(&bench, "one"), BTreeMap::from(expected));
    let report = report(&bench);
    let basis =
        "Seeds: a design of 3, 6 or 9; 1 combination used 3, 2 used 6, 1 used 9. Nothing was exploratory.";
    let page = std::fs::read_to_string(bench.path("results/looks/index.html")).unwrap();
    let json = bench.ok(&["report", "looks.yaml", "--store", "one", "--format", "json"]);
    for text in [&said, &report, &page, &json] {
        assert!(text.contains(basis), "{text}");
    }
    assert!(
        report.contains("decided at look 1 of 3, with 3 seeds"),
        "{report}"
    );
    assert!(report.contains("open after the last of 3 looks"), "{report}");
    assert!(
        report.contains("NOT JUDGED") && report.contains("repeated confidence interval"),
        "{report}"
    );
    let again = bench.run(&["run", "looks.yaml", "--store", "one"]);
    assert!(again.err.contains("nothing runs"), "{}", again.err);
    // One worker, stopped after the first look and gone on with by another command, comes to the same trials.
    bench.ok(&["run", "looks.yaml", "-j", "1", "--store", "two", "--seeds", "3"]);
    bench.ok(&["worker", "looks.yaml", "--store", "two"]);
    assert_eq!(bench.digests("one"), bench.digests("two"));
}

#[test]
fn a_plan_begins_with_the_first_look() {
    let bench = Bench::new();
    bench.write("looks.yaml", STUDY);
    let plan = bench.ok(&["plan", "looks.yaml"]);
    assert!(
        plan.contains("looks: 12 trials") && plan.contains("looks at 3, 6, 9 seeds"),
        "{plan}"
    );
}

#[test]
fn a_verdict_that_was_seen_without_a_plan_is_marked() {
    let bench = Bench::new();
    let fixed = |n: u32| STUDY.replace("{ min: 3, max: 9, looks: 3 }", &n.to_string());
    bench.write("looks.yaml", &fixed(3));
    bench.ok(&["run", "looks.yaml"]);
    assert!(!report(&bench).contains("unplanned look"));
    assert!(report(&bench).contains("\nSeeds: 3, fixed before the first trial. Nothing was exploratory.\n"));
    // The same number of seeds again is no other look.
    bench.ok(&["report", "looks.yaml"]);
    assert!(!report(&bench).contains("unplanned look"));
    bench.write("looks.yaml", &fixed(5));
    bench.ok(&["run", "looks.yaml"]);
    let text = report(&bench);
    assert!(
        text.contains(
            "random: unplanned look: the verdict was seen with 3 seeds before, so its level is not held"
        ),
        "{text}"
    );
    assert_eq!(text.matches("unplanned look").count(), 4, "{text}");
    assert!(
        text.contains("Seeds: 5, not fixed before the first trial: verdicts were seen with 3 before."),
        "{text}"
    );
    // Trials that are computed in another way are another experiment.
    bench.write(
        "looks.yaml",
        &fixed(6).replace("final_episodes: 2", "final_episodes: 3"),
    );
    bench.ok(&["run", "looks.yaml"]);
    assert!(!report(&bench).contains("unplanned look"));
    // Verdicts that were seen of the first experiment are not forgotten over the second.
    bench.write("looks.yaml", &fixed(6));
    bench.ok(&["run", "looks.yaml"]);
    assert!(report(&bench).contains("the verdict was seen with 3 seeds before"));
}

/// A design whose first look has been seen already, when the number of seeds was fixed, holds its level no more; one
/// that was there before does.
#[test]
fn a_design_that_came_after_its_first_look_is_marked() {
    let bench = Bench::new();
    let fixed = STUDY.replace("{ min: 3, max: 9, looks: 3 }", "3");
    bench.write("looks.yaml", &fixed);
    bench.ok(&["run", "looks.yaml"]);
    bench.write("looks.yaml", STUDY);
    bench.ok(&["run", "looks.yaml"]);
    let text = report(&bench);
    assert!(
        text.contains("the verdict was seen with 3 seeds before"),
        "{text}"
    );
    assert!(text.contains("planned after verdicts were seen with 3"), "{text}");
    let planned = Bench::new();
    planned.write("looks.yaml", STUDY);
    planned.ok(&["run", "looks.yaml"]);
    planned.ok(&["report", "looks.yaml"]);
    assert!(!report(&planned).contains("unplanned look"));
}

/// Whoever saw more seeds chooses by showing fewer.
#[test]
fn fewer_seeds_than_were_seen_are_marked() {
    let bench = Bench::new();
    let fixed = |n: u32| STUDY.replace("{ min: 3, max: 9, looks: 3 }", &n.to_string());
    bench.write("looks.yaml", &fixed(5));
    bench.ok(&["run", "looks.yaml"]);
    bench.write("looks.yaml", &fixed(3));
    bench.ok(&["report", "looks.yaml"]);
    let text = report(&bench);
    assert!(
        text.contains("the verdict was seen with 5 seeds before"),
        "{text}"
    );
    assert!(
        text.contains("Seeds: 3, not fixed before the first trial"),
        "{text}"
    );
}

#[test]
fn a_margin_that_is_changed_after_its_verdict_was_seen_makes_it_exploratory() {
    let bench = Bench::new();
    let study = STUDY.replace("{ min: 3, max: 9, looks: 3 }", "3");
    bench.write("looks.yaml", &study);
    bench.ok(&["run", "looks.yaml"]);
    let verdicts = |bench: &Bench| -> serde_json::Value {
        let text = std::fs::read_to_string(bench.path("results/looks/verdicts.json")).unwrap();
        serde_json::from_str(&text).unwrap()
    };
    let before = verdicts(&bench);
    assert_eq!(
        (&before["judged"], &before["exploratory"]),
        (&4.into(), &0.into())
    );
    // A wider margin, and a difference that is said to matter, both with results in view.
    let open = "  - observed.cycle_length > 158\n";
    let alike = "  - { claim: observed.cycle_length > 158, min_effect: 60, why: a third of a cycle }\n";
    let changed = study.replace("absolute: 30", "absolute: 60").replace(open, alike);
    bench.write("looks.yaml", &changed);
    bench.ok(&["report", "looks.yaml"]);
    let text = report(&bench);
    for sentence in [
        "2 verdicts are exploratory, since their margins were changed after they were seen.",
        "exploratory: judged by a band from -120 to -60 when the verdict was first seen, which was changed afterwards",
        "exploratory: judged by any difference when the verdict was first seen, which was changed afterwards",
    ] {
        assert!(text.contains(sentence), "{sentence}: {text}");
    }
    let after = verdicts(&bench);
    assert_eq!(
        (&after["judged"], &after["exploratory"]),
        (&2.into(), &2.into()),
        "{after}"
    );
    // As it was first, it counts as it did.
    bench.write("looks.yaml", &study);
    bench.ok(&["report", "looks.yaml"]);
    assert_eq!(verdicts(&bench), before);
    // Trials of other seeds know nothing of it.
    bench.write("looks.yaml", &changed.replace("seeds: 3", "seeds: 10-12"));
    bench.ok(&["run", "looks.yaml"]);
    assert!(!report(&bench).contains("when the verdict was first seen"));
}

/// Bytes that fall out of a record of verdicts, or are changed, take its word from nothing: it is set aside with
/// them, and every later report says that what was seen before is not known.
#[test]
fn a_damaged_record_of_verdicts_is_set_aside_and_no_report_calls_itself_planned() {
    let bench = Bench::new();
    let study = STUDY.replace("{ min: 3, max: 9, looks: 3 }", "3");
    bench.write("looks.yaml", &study);
    bench.ok(&["run", "looks.yaml"]);
    let file = bench.path("store/looks/looks.json");
    let whole = std::fs::read(&file).unwrap();
    assert!(whole.ends_with(b"\"}"), "it has a check");
    bench.write("looks.yaml", &study.replace("absolute: 30", "absolute: 60"));
    let mut changed = whole.clone();
    changed[whole.len() / 2] ^= 1;
    for (number, damaged) in [&whole[..whole.len() / 2], &changed, b""].into_iter().enumerate() {
        std::fs::write(&file, damaged).unwrap();
        let checked = bench.run(&["fsck", "-n", "store"]);
        assert!(
            checked.code == 106 && checked.out.contains("looks/looks.json"),
            "{}",
            checked.out
        );
        let answer = bench.run(&["report", "looks.yaml"]);
        assert!(answer.err.contains("set aside"), "{}", answer.err);
        let aside = bench.path(&format!("store/aside/{}/looks/looks.json", number + 1));
        assert_eq!(std::fs::read(aside).unwrap(), damaged);
        for _ in 0..2 {
            bench.ok(&["report", "looks.yaml"]);
            let text = report(&bench);
            assert!(
                !text.contains("Nothing was exploratory") && !text.contains("fixed before"),
                "{text}"
            );
            assert!(
                text.contains("is not known: the record of it was damaged"),
                "{text}"
            );
        }
    }
    // As it was, it says what it said.
    std::fs::write(&file, &whole).unwrap();
    bench.ok(&["report", "looks.yaml"]);
    assert!(
        report(&bench).contains("1 verdict is exploratory"),
        "{}",
        report(&bench)
    );
    assert!(bench.ok(&["fsck", "store"]).contains("0 files are wrong"));
}

/// Records of programs that gave them no check are believed and get one.
#[test]
fn a_record_of_an_earlier_program_is_read_and_sealed() {
    let bench = Bench::new();
    let study = STUDY.replace("{ min: 3, max: 9, looks: 3 }", "3");
    bench.write("looks.yaml", &study);
    bench.ok(&["run", "looks.yaml"]);
    let file = bench.path("store/looks/looks.json");
    let mut record: serde_json::Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    let fields = record.as_object_mut().unwrap();
    assert!(fields.remove("check").is_some() && fields.remove("schema").is_some());
    std::fs::write(&file, record.to_string()).unwrap();
    assert!(bench.ok(&["fsck", "store"]).contains("0 files are wrong"));
    bench.write("looks.yaml", &study.replace("absolute: 30", "absolute: 60"));
    let answer = bench.run(&["report", "looks.yaml"]);
    assert!(
        answer.code == 0 && !answer.err.contains("warning"),
        "{}",
        answer.err
    );
    assert!(
        report(&bench).contains("1 verdict is exploratory"),
        "{}",
        report(&bench)
    );
    assert!(std::fs::read_to_string(&file).unwrap().contains("\"check\":"));
}

#[test]
fn merging_takes_no_damaged_record_and_says_so() {
    let bench = Bench::new();
    bench.write("looks.yaml", &STUDY.replace("{ min: 3, max: 9, looks: 3 }", "3"));
    bench.ok(&["run", "looks.yaml"]);
    let file = bench.path("store/looks/looks.json");
    let mut bytes = std::fs::read(&file).unwrap();
    bytes[20] ^= 2;
    std::fs::write(&file, &bytes).unwrap();
    let merged = bench.run(&["merge", "store", "--into", "other"]);
    assert!(
        merged.code == 106 && merged.err.contains("are not taken"),
        "{}",
        merged.err
    );
    assert_eq!(
        std::fs::read(&file).unwrap(),
        bytes,
        "nothing of the source is changed"
    );
    assert!(!bench.path("other/looks/looks.json").exists());
}
