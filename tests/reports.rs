//! What the report of a study says besides its tables.

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
    let said = bench.ok(&["run", "small.yaml"]);
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

#[test]
fn a_study_says_in_a_sentence_what_it_came_to() {
    let (bench, said) = two_sentences();
    let row = read(&bench, "results/one/summary.md");
    let rest = row.strip_prefix(
        "| [one](results/one/report.md) | Two rules, 3 seeds, in sample | An equal split lives ",
    );
    let rest = rest.unwrap_or_else(|| panic!("{row}"));
    let (value, words) = rest.split_once(' ').unwrap();
    assert_eq!(words, "\\| 1.5 decisions; SUPPORTED, REFUTED |\n");
    let report = read(&bench, "results/one/report.md");
    assert!(
        report.contains(&format!("| equal | {value} [")),
        "{value}: {report}"
    );
    let sentence = format!("An equal split lives {value} | 1.5 decisions; SUPPORTED, REFUTED");
    assert!(said.contains(&sentence) && read(&bench, "results/one/index.html").contains(&sentence));
    let verdicts: serde_json::Value =
        serde_json::from_str(&read(&bench, "results/one/verdicts.json")).unwrap();
    let counts = ["judged", "decided", "differing", "exploratory"].map(|key| verdicts[key].as_u64().unwrap());
    // What was calibrated and differs all the same is judged.
    assert_eq!(counts, [3, 3, 2, 0], "{verdicts}");
    assert_eq!(verdicts["verdicts"][0]["verdict"], "DIFFERS");
    assert!(report.contains("DIFFERS, in spite of calibration"), "{report}");
    // Another profile is no result of the study as it is written.
    bench.ok(&["run", "one.yaml", "--profile", "short"]);
    assert!(!bench.path("results/one-short/summary.md").exists());
}

#[test]
fn the_sentences_of_studies_are_the_rows_of_the_overview() {
    let (bench, _) = two_sentences();
    let row = read(&bench, "results/one/summary.md");
    let table = bench.ok(&["overview", "results"]);
    let rows: Vec<&str> = table.lines().collect();
    assert_eq!(rows[..2], ["| study | what | result |", "|---|---|---|"]);
    assert_eq!((rows.len(), rows[2]), (4, row.trim_end()));
    let marked = "before\n<!-- results: begin -->\n<!-- results: end -->\nafter\n";
    bench.write("README.md", marked);
    bench.ok(&["overview", "results", "--into", "README.md"]);
    let text = read(&bench, "README.md");
    assert!(text.contains(&table) && text.starts_with("before\n") && text.ends_with("-->\nafter\n"));
    bench.write("README.md", "before\n");
    let refused = bench.run(&["overview", "results", "--into", "README.md"]);
    let message = "README.md: no line reads `<!-- results: begin -->`";
    assert!(
        refused.code == 2 && refused.err.contains(message),
        "{}",
        refused.err
    );
    assert_eq!(read(&bench, "README.md"), "before\n");
    // A folder without any row is the wrong one.
    bench.write("README.md", marked);
    for wrong in [
        &["overview", "results/one", "--into", "README.md"][..],
        &["overview", "results/one"],
    ] {
        let refused = bench.run(wrong);
        assert!(
            refused.code == 4 && refused.err.contains("has a row"),
            "{}",
            refused.err
        );
    }
    assert_eq!(read(&bench, "README.md"), marked);
    let nowhere = bench.run(&["overview", "nowhere"]);
    assert!(
        nowhere.code == 2 && nowhere.err.contains("there is no folder `nowhere`"),
        "{}",
        nowhere.err
    );
    // A study whose sentence went loses its row.
    bench.write("one.yaml", &with_sentence("one").replace(SENTENCE, ""));
    bench.ok(&["report", "one.yaml"]);
    assert_eq!(bench.ok(&["overview", "results"]).lines().count(), 3);
}

#[test]
fn the_overview_says_what_is_open_and_what_would_decide_it() {
    let bench = Bench::new();
    let claims = "claims:\n  - { claim: dsac.cycle_length > equal.cycle_length, why: a floor }\n  \
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

#[test]
fn what_a_later_study_decides_on_other_seeds_is_counted_once() {
    let bench = Bench::new();
    let claims = "claims:\n  - { claim: equal.cycle_length > 0.5, why: a floor }\n  - { claim: equal.cycle_length > 1, why: another }\n";
    bench.write("small.yaml", &format!("{STUDY}{claims}"));
    bench.ok(&["run", "small.yaml"]);
    let again = format!("study: again\ninclude: small.yaml\nconfirms: small.yaml\nseeds: 100-101\n{claims}");
    bench.write("again.yaml", &again);
    bench.ok(&["run", "again.yaml"]);
    let report = read(&bench, "results/again/report.md");
    assert!(
        report.contains("Confirms small, on seeds that it has not seen."),
        "{report}"
    );
    let verdicts: serde_json::Value =
        serde_json::from_str(&read(&bench, "results/again/verdicts.json")).unwrap();
    assert_eq!(verdicts["confirms"], serde_json::json!(["small"]));
    // The file with all defaults says so, too, from its own folder.
    let resolved = read(&bench, "results/again/resolved.yaml");
    assert!(resolved.contains("confirms: [../../small.yaml]"), "{resolved}");
    bench.ok(&["check", "results/again/resolved.yaml"]);
    // What is open is made so and what is decided is made so: the words are those of the reports.
    let words = |first: &str, second: &str| {
        for (study, word) in [("small", first), ("again", second)] {
            let path = format!("results/{study}/verdicts.json");
            let mut verdicts: serde_json::Value = serde_json::from_str(&read(&bench, &path)).unwrap();
            for one in verdicts["verdicts"].as_array_mut().unwrap() {
                one["verdict"] = word.into();
            }
            bench.write(&path, &verdicts.to_string());
        }
        let text = bench.ok(&["overview", "results", "--open"]);
        text.lines().next().unwrap().to_owned()
    };
    assert_eq!(
        words("INCONCLUSIVE", "SUPPORTED"),
        "2 of 2 values and claims that are judged are decided (100 %), 2 of them by a later study, on seeds that the first one \
         had not seen."
    );
    let open = "0 of 2 values and claims that are judged are decided (0 %).";
    assert_eq!(words("INCONCLUSIVE", "INCONCLUSIVE"), open);
    let decided = "4 of 4 values and claims that are judged are decided (100 %).";
    assert_eq!(words("SUPPORTED", "REFUTED"), decided);
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
