//! Sentences of a study's report besides its tables.

use crate::program::{Bench, trial_files};

const STUDY: &str = "
study: small
environments:
  cells: { battery: { cells: 2 } }
agents:
  equal: { equal_split: {} }
  dsac: { dirichlet_sac: { width: 16, batch_size: 16, learning_starts: 64 } }
protocol: { train_evaluate: { steps: 256, environments: 8, evaluate_every: 128, episodes: 2, \
final_episodes: 6 } }
seeds: 2
profiles:
  short: { protocol.steps: 128 }
  long: { protocol.steps: 512 }
  wide: { dsac.width: 32 }
tables:
  lengths: { comparison: { value: cycle_length } }
";

#[test]
fn a_report_tells_budgets_settings_profiles_and_dates() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.ok(&["run", "small.yaml", "--profile", "short"]);
    let said = bench.ok(&["run", "small.yaml", "--verbose"]);
    assert!(
        said.contains("long: 0 of 4 trials are stored: never run"),
        "{said}"
    );
    let report = std::fs::read_to_string(bench.path("results/small/report.md")).unwrap();
    for line in [
        "- default: all 4 trials are stored: this report",
        "- short: all 4 trials are stored",
        "- wide: 2 of 4 trials are stored, all of them shared with other profiles: never run itself",
        "| width | 256 | 16 |",
        "| steps | 60000 | 256 |",
        "- lengths: [tables/lengths-seeds.csv](tables/lengths-seeds.csv)",
        "- trials ended: ",
    ] {
        assert!(report.contains(line), "{line}\n{report}");
    }
    let row = report
        .lines()
        .find(|line| line.starts_with("| dsac | 2 | "))
        .expect(&report);
    assert!(
        row.contains(" | 6 | "),
        "episodes of the final measurement: {row}"
    );
    let seeds = std::fs::read_to_string(bench.path("results/small/tables/lengths-seeds.csv")).unwrap();
    assert_eq!(seeds.lines().count(), 5, "{seeds}");
}

const SENTENCE: &str = "summary: \"An equal split lives {lengths: equal} | {lengths: equal published} decisions; {claim 1}, {claim 2}\"\n";

/// A study of one rule with a sentence on its result.
fn with_sentence(name: &str) -> String {
    let learner = "  dsac: { dirichlet_sac: { width: 16, batch_size: 16, learning_starts: 64 } }\n";
    let published =
        "rows: agent, value: cycle_length }, published: { equal: { value: 1.5, calibrated_on: the load } } }";
    let study = STUDY
        .replace("study: small", &format!("study: {name}"))
        .replace(learner, "")
        .replace("  wide: { dsac.width: 32 }\n", "")
        .replace("seeds: 2", "seeds: 3")
        .replace("value: cycle_length } }", published);
    format!(
        "{study}{SENTENCE}title: Two rules\nclaims:\n  - equal.cycle_length > 0\n  - equal.cycle_length < 0\n"
    )
}

/// Two such studies, run, and what was said.
fn two_sentences() -> (Bench, String) {
    let bench = Bench::new();
    for name in ["two", "one"] {
        bench.write(&format!("{name}.yaml"), &with_sentence(name));
    }
    let said = bench.ok(&["run", "two.yaml", "one.yaml"]);
    (bench, said)
}

fn read(bench: &Bench, name: &str) -> String {
    std::fs::read_to_string(bench.path(name)).unwrap()
}

/// The value of `equal` in the table of a report.
fn value_of_equal(report: &str) -> &str {
    let mut rows = report.lines().filter_map(|line| line.strip_prefix("| equal | "));
    let row = rows.find(|row| row.contains('[')).unwrap();
    row.split(' ').next().unwrap()
}

#[test]
fn a_study_says_in_a_sentence_what_it_came_to() {
    let (bench, said) = two_sentences();
    let report = read(&bench, "results/one/report.md");
    let value = value_of_equal(&report);
    let sentence = format!("An equal split lives {value} | 1.5 decisions; SUPPORTED, REFUTED");
    assert!(said.contains(&sentence) && read(&bench, "results/one/index.html").contains(&sentence));
    let verdicts: serde_json::Value =
        serde_json::from_str(&read(&bench, "results/one/verdicts.json")).unwrap();
    let counts = ["judged", "decided", "differing", "exploratory"].map(|key| verdicts[key].as_u64().unwrap());
    // A calibrated value that differs all the same is judged.
    assert_eq!(counts, [3, 3, 2, 0], "{verdicts}");
    assert_eq!(verdicts["verdicts"][0]["verdict"], "DIFFERS");
    assert!(report.contains("DIFFERS, in spite of calibration"), "{report}");
}

/// A study with answers below `experiments`, run.
fn answered() -> Bench {
    let bench = Bench::new();
    let answers = "family: chapter 1\nanswers:\n  - { item: table 2, printed: an equal split lives, here: \"{lengths: equal}\", by: \
                   [claim 1] }\n  - { item: table 10, printed: it does not, by: [claim 2, \"lengths: equal\"], system: another }\n  \
                   - { item: figure 1, printed: drawn }\n";
    std::fs::create_dir_all(bench.path("experiments/first")).unwrap();
    let study = format!("{}{answers}", with_sentence("one"));
    bench.write("experiments/first/one.yaml", &study);
    bench.ok(&["run", "experiments/first/one.yaml"]);
    bench
}

#[test]
fn the_answers_of_studies_stand_in_the_overview_and_in_the_blocks_of_a_document() {
    let bench = answered();
    let report = read(&bench, "results/first/one/report.md");
    let value = value_of_equal(&report);
    let rows = |folder: &str| {
        let study = format!("[one]({folder}first/one/report.md)");
        [
            format!("| table 2 | an equal split lives | {value} | yes | yes | {study} |"),
            format!("| table 10 | it does not | – | another | no | {study} |"),
        ]
        .join("\n")
    };
    let said = bench.ok(&["overview", "results"]);
    assert!(
        said.contains("## chapter 1\n") && said.contains(&rows("results/")),
        "{said}"
    );
    let document = "before\n<!-- overview: answers chapter 1 -->\n<!-- overview: end -->\n\
                    <!-- overview: items -->\nold\n<!-- overview: end -->\nafter\n";
    bench.write("results/README.md", document);
    bench.ok(&["overview", "results", "--into", "results/README.md"]);
    let text = read(&bench, "results/README.md");
    assert!(
        text.starts_with("before\n") && text.ends_with("-->\nafter\n"),
        "{text}"
    );
    let items = [
        "| table 10 | [one](../experiments/first/one.yaml) |",
        "| figure 1 |",
    ];
    assert!(
        text.contains(&rows("")) && items.iter().all(|item| text.contains(item)),
        "{text}"
    );
    assert!(!text.contains("old"), "{text}");
}

#[test]
fn an_overview_of_nothing_and_a_document_without_a_block_are_refused() {
    let bench = answered();
    let unknown = "<!-- overview: answers chapter 2 -->\n<!-- overview: end -->\n";
    for (document, message) in [
        ("before\n", "it has no block"),
        (unknown, "write one of `chapter 1`"),
    ] {
        bench.write("README.md", document);
        let refused = bench.run(&["overview", "results", "--into", "README.md"]);
        assert!(
            refused.code == 2 && refused.err.contains(message),
            "{}",
            refused.err
        );
        assert_eq!(read(&bench, "README.md"), document);
    }
    for (wrong, code, message) in [
        ("results/first/one", 4, "has verdicts"),
        ("nowhere", 2, "there is no folder `nowhere`"),
    ] {
        let refused = bench.run(&["overview", wrong]);
        assert!(
            refused.code == code && refused.err.contains(message),
            "{}",
            refused.err
        );
    }
}

#[test]
fn the_overview_says_what_is_open_and_what_would_decide_it() {
    let bench = Bench::new();
    // The first claim is open: three seeds leave a mean of 119 between 79 and 160.
    let claims = "claims:\n  - { claim: dsac.cycle_length > 120, why: a floor }\n  \
                  - { claim: dsac.cycle_length > 0.5, why: it lives }\n  \
                  - { claim: equal.cycle_length > dsac.cycle_length, why: x, exploratory: true }\n";
    let study = STUDY.replace("seeds: 2", "seeds: 3");
    bench.write("small.yaml", &format!("{study}{claims}"));
    bench.ok(&["run", "small.yaml"]);
    let text = bench.ok(&["overview", "results", "--open"]);
    let json: serde_json::Value =
        serde_json::from_str(&bench.ok(&["overview", "results", "--format", "json"])).unwrap();
    let verdicts = json["studies"][0]["verdicts"].as_array().unwrap();
    let open = json["open"].as_array().unwrap();
    assert_eq!(json["studies"][0]["study"], "small");
    let is_open = |it: &&serde_json::Value| it["verdict"] == "INCONCLUSIVE" && it["exploratory"] == false;
    assert_eq!(verdicts.iter().filter(is_open).count(), open.len(), "{json}");
    assert!(!open.is_empty(), "{json}");
    for it in open {
        let seeds = it["would_decide"]["seeds"]
            .as_u64()
            .map_or("–".into(), |n| n.to_string());
        let row = format!("| small | `{}` | {seeds} |", it["about"].as_str().unwrap());
        assert!(text.contains(&row), "{row}\n{text}");
    }
    // Results under options are not those of the study as it is written.
    bench.ok(&["run", "small.yaml", "--seeds", "2"]);
    assert_eq!(bench.ok(&["overview", "results", "--open"]), text);
    let refused = bench.run(&["overview", "results", "--open", "--into", "README.md"]);
    assert!(
        refused.code == 2 && refused.err.contains("--into"),
        "{}",
        refused.err
    );
}

/// A study with a claim on both agents and one on `equal`, of which rounds follow on further seeds.
fn confirmed() -> String {
    let claims = "claims:\n  - { claim: dsac.cycle_length > equal.cycle_length, why: a floor }\n  \
                  - { claim: equal.cycle_length > 0.5, why: it lives, exploratory: true }\n";
    let confirm = "confirm:\n  - { claims: [2], seeds: 100-102, why: three more }\n  \
                   - { claims: [1, 2], seeds: { first: 200, min: 3, max: 6 }, min_effect: 0.25 }\n";
    format!("{STUDY}{claims}{confirm}")
}

fn json(bench: &Bench, path: &str) -> serde_json::Value {
    serde_json::from_str(&read(bench, path)).unwrap()
}

#[test]
fn the_last_word_is_that_of_all_rounds() {
    let bench = Bench::new();
    bench.write("small.yaml", &confirmed());
    let planned = bench.ok(&["plan", "small.yaml"]);
    let of_round = |name: &str| {
        let at = planned.find(&format!("small/confirm-{name}: ")).unwrap();
        planned[at..].split("missing").next().unwrap().to_owned()
    };
    // A round has the combinations that its claims need.
    assert!(of_round("1").contains("confirm-1: 3 trials"), "{planned}");
    assert!(planned.contains("looks at 3, 6 seeds"), "{planned}");
    bench.ok(&["run", "small.yaml"]);
    let verdicts = json(&bench, "results/small/verdicts.json");
    let seeds = |claim: usize| -> Vec<String> {
        let rounds = verdicts["verdicts"][claim]["rounds"].as_array().unwrap();
        rounds
            .iter()
            .map(|it| it["seeds"].as_str().unwrap().to_owned())
            .collect()
    };
    assert_eq!(seeds(0)[0], "0-1");
    assert!(seeds(0)[1].starts_with("200-20"), "{verdicts}");
    // The seeds by which a claim was found are no round of it.
    assert_eq!(seeds(1)[0], "100-102");
    assert_eq!((seeds(0).len(), seeds(1).len()), (2, 2));
    assert_eq!(verdicts["verdicts"][1]["exploratory"], false);
    let report = read(&bench, "results/small/report.md");
    for part in [
        "## Confirmations",
        "| 100-102 | ",
        "all: 0-1, 200-20",
        "2 confirmations on further seeds.",
        "seeds of 2 rounds, whose",
        "`confirm-1` was fixed on 20",
        ", before its first trial (hash ",
    ] {
        assert!(report.contains(part), "{part}\n{report}");
    }
    assert!(bench.run(&["run", "small.yaml"]).err.contains("nothing runs"));
    // The record of the rounds is enough for the same report.
    bench.ok(&["report", "small.yaml", "--recorded"]);
    assert_eq!(json(&bench, "results/small/verdicts.json"), verdicts);
    assert_eq!(read(&bench, "results/small/report.md"), report);
    // A round that asks something else than it did before its first trial says so.
    bench.write(
        "small.yaml",
        &confirmed().replace("min_effect: 0.25", "min_effect: 0.5"),
    );
    bench.ok(&["report", "small.yaml"]);
    let report = read(&bench, "results/small/report.md");
    assert_eq!(report.matches("; it was changed since.").count(), 1, "{report}");
    let text = bench.ok(&["overview", "results", "--open"]);
    assert!(
        text.contains("values and claims that are judged are decided"),
        "{text}"
    );
}

#[test]
fn rounds_are_of_the_study_as_it_is_written() {
    let bench = Bench::new();
    bench.write("small.yaml", &confirmed());
    let planned = bench.ok(&["plan", "small.yaml", "--seeds", "2"]);
    assert!(!planned.contains("confirm-1"), "{planned}");
    bench.ok(&["run", "small.yaml", "--seeds", "2"]);
    assert!(!bench.path("results/small+seeds=2/confirm-1").exists());
    // Other seeds may reach into those of a round.
    bench.ok(&["check", "small.yaml", "--seeds", "150"]);
    assert_eq!(
        bench
            .ok(&["resolve", "small.yaml"])
            .matches("study: small")
            .count(),
        1
    );
    bench.ok(&["check", "small.yaml"]);
    bench.ok(&["run", "small.yaml"]);
    bench.ok(&["check", "results/small/resolved.yaml"]);
    let resolved = read(&bench, "results/small/resolved.yaml");
    assert!(resolved.contains("confirm:"), "{resolved}");
    // The content of a damaged record is not guessed.
    bench.write("results/small/confirm-1/record.json", "{}");
    let refused = bench.run(&["report", "small.yaml", "--recorded"]);
    assert!(
        refused.code != 0 && refused.err.contains("confirm-1/record.json"),
        "{}",
        refused.err
    );
}

#[test]
fn studies_of_a_family_are_taken_together() {
    let bench = Bench::new();
    let claims = "family: chapter 1\nclaims:\n  - { claim: equal.cycle_length > 0.5, why: it lives }\n";
    for name in ["one", "two"] {
        let study = STUDY.replace("study: small", &format!("study: {name}"));
        bench.write(&format!("{name}.yaml"), &format!("{study}{claims}"));
    }
    bench.ok(&["run", "one.yaml", "two.yaml"]);
    let told: serde_json::Value =
        serde_json::from_str(&bench.ok(&["overview", "results", "--format", "json"])).unwrap();
    assert_eq!(told["families"][0]["family"], "chapter 1");
    assert_eq!(told["families"][0]["judged"], 2);
    let page = read(&bench, "results/index.html");
    assert!(
        page.contains("<h2>Counts by family</h2>") && page.contains("chapter 1"),
        "{page}"
    );
    let report = read(&bench, "results/one/report.md");
    assert!(
        report.contains("the overview takes those of chapter 1 together (Holm)"),
        "{report}"
    );
}

#[test]
fn the_date_of_a_trial_is_stored_and_is_no_part_of_what_is_compared() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    let dates = |store: &str| -> Vec<String> {
        bench.ok(&["run", "small.yaml", "--store", store, "--only", "equal"]);
        let date = |file: &std::path::PathBuf| {
            let trial: serde_json::Value =
                serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
            trial["ended_at"].as_str().unwrap().to_owned()
        };
        trial_files(&bench.path(store)).iter().map(date).collect()
    };
    let one = dates("one");
    // Dates have the resolution of a second.
    std::thread::sleep(std::time::Duration::from_millis(1100));
    let two = dates("two");
    assert!(one.iter().max() < two.iter().min(), "{one:?} {two:?}");
    assert_eq!(bench.digests("one"), bench.digests("two"));
    bench.ok(&["fsck", "two"]);
}
