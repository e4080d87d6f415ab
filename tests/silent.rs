//! The choice of a search follows from its study and the bits of its trials alone: whatever else the store holds,
//! whichever trials failed and were run again, wherever it was stopped, split, merged or packed. And where it
//! could not see a setting it says so, beside its choice and by its exit code.

use crate::program::{Answer, Bench, answer, trial_files};
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    time::Duration,
};

const STUDY: &str = "
study: tuned
environments: { cells: { battery: { cells: 2 } } }
agents:
  equal: { equal_split: {} }
  fickle: { fickle: {} }
protocol: { train_evaluate: { steps: 384, environments: 8, evaluate_every: 96, episodes: 1, final_episodes: 1, \
trace_episodes: 0 } }
seeds: 2
tune:
  rates:
    over: { fickle.rate: { uniform: { low: 0, high: 1 } } }
    metric: cycle_length
    settings: 6
    method: METHOD
tables:
  settings: { best_settings: { search: rates, best: 6 } }
  lengths: { comparison: { rows: agent, value: cycle_length } }
";

pub(crate) const HALVING: &str = "{ halving: { pauses: [96, 192], keep: 0.5 } }";

/// Every method.
const METHODS: [&str; 6] = [
    HALVING,
    "{ halving: { pauses: [96, 192], keep: 0.4, brackets: 2 } }",
    "{ population: { pauses: [96, 192], replace: 0.34, redraw: 0.25 } }",
    "{ tree_parzen: { startup: 3, batch: 2 } }",
    "{ cma_es: { population: 3 } }",
    "{ random: {} }",
];

/// The study with a method.
pub(crate) fn study(method: &str) -> String {
    STUDY.replace("METHOD", method)
}

/// A bench with the study, and what its search comes to in a store of its own.
fn settled(text: &str) -> (Bench, Found) {
    let bench = Bench::new();
    bench.write("tuned.yaml", text);
    run(&bench, "fresh", &[], 0);
    let found = Found::of(&bench);
    (bench, found)
}

fn ask(bench: &Bench, arguments: &[&str], environment: &[(&str, &str)]) -> Answer {
    let mut command = bench.misused(arguments);
    command.envs(environment.iter().copied());
    answer(&command.output().unwrap())
}

/// Runs the study in a store, with more arguments, and expects an exit code.
fn run(bench: &Bench, store: &str, more: &[&str], code: i32) -> Answer {
    let arguments = [&["run", "tuned.yaml", "-j", "2", "--store", store], more].concat();
    let answer = ask(bench, &arguments, &[]);
    assert_eq!(answer.code, code, "{arguments:?}\n{}\n{}", answer.out, answer.err);
    answer
}

/// Sentences of the report about the search, and the tables.
#[derive(Debug, Clone, PartialEq)]
struct Found {
    sentence: String,
    tables: Vec<String>,
}

impl Found {
    fn of(bench: &Bench) -> Self {
        let read = |name: &str| fs::read_to_string(bench.path(&format!("results/tuned/{name}"))).unwrap();
        let report = read("report.md");
        let sentence = report.lines().find(|line| line.starts_with("Seeds: ")).unwrap();
        Self {
            sentence: sentence.to_owned(),
            tables: ["settings", "lengths"]
                .map(|table| read(&format!("tables/{table}.csv")))
                .into(),
        }
    }
}

/// The file with what a trial had measured at its pause, in the trial's folder.
fn pause_in(folder: &Path) -> Option<PathBuf> {
    let files = fs::read_dir(folder).ok()?.map(|entry| entry.unwrap().path());
    let mut files = files.filter(|file| file.extension().is_some_and(|it| it == "parcel"));
    files.next()
}

/// The rates of the trials of a search in a store, those at their pauses among them.
fn rates(bench: &Bench, store: &str) -> BTreeSet<String> {
    let mut rates = BTreeSet::new();
    for folder in folders(&bench.path(store)) {
        for file in [Some(folder.join("trial.json")), pause_in(&folder)]
            .into_iter()
            .flatten()
        {
            let text = fs::read(file).unwrap_or_default();
            let text = String::from_utf8_lossy(&text);
            let rate = text
                .split("\"rate\":")
                .nth(1)
                .and_then(|rest| rest.split([',', '}']).next());
            rates.extend(
                rate.filter(|_| text.contains("\"seed\":1000000"))
                    .map(str::to_owned),
            );
        }
    }
    rates
}

/// The folder of every trial of a store.
fn folders(store: &Path) -> Vec<PathBuf> {
    let entries = |folder: PathBuf| fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries(store.join("trials")).flat_map(entries).collect()
}

/// A sweep over the same values, and a search that pauses them later, on the seed of the search.
fn others(rates: &BTreeSet<String>) -> [String; 2] {
    let values: Vec<&str> = rates.iter().map(String::as_str).collect();
    let head = STUDY.split("tune:").next().unwrap();
    let listed = values.join(", ");
    let sweep = head
        .replace("study: tuned", "study: sweep")
        .replace("seeds: 2", "seeds: [1000000]");
    let later = study("{ halving: { pauses: [288], keep: 0.2 } }").replace("study: tuned", "study: later");
    let later = later
        .replace(
            "{ uniform: { low: 0, high: 1 } }",
            &format!("{{ choice: [{listed}] }}"),
        )
        .replace("settings: 6", &format!("settings: {}", values.len()));
    [
        format!("{sweep}sweep: {{ fickle.rate: {{ grid: [{listed}] }} }}\n"),
        later,
    ]
}

#[test]
fn what_a_search_chooses_does_not_depend_on_what_else_the_store_holds() {
    for method in METHODS {
        let (bench, found) = settled(&study(method));
        let [sweep, later] = others(&rates(&bench, "fresh"));
        bench.write("sweep.yaml", &sweep);
        bench.write("later.yaml", &later);
        for (store, before) in [("swept", "sweep.yaml"), ("later", "later.yaml")] {
            let answer = ask(&bench, &["run", before, "-j", "2", "--store", store], &[]);
            assert_eq!(answer.code, 0, "{}", answer.err);
            run(&bench, store, &[], 0);
            assert_eq!(Found::of(&bench), found, "{method} after {before}");
        }
    }
}

/// Numbers that are not finite are the trial's own: a setting ranks last by them from the step on at which they came,
/// whether its trial paused before or ran through in a sweep.
#[test]
fn a_setting_whose_numbers_are_not_finite_ranks_last_wherever_its_trial_ran() {
    for method in &METHODS[..4] {
        let text = study(method).replace(
            "fickle: { fickle: {} }",
            "fickle: { fickle: { diverges_from: 0.2 } }",
        );
        let bench = Bench::new();
        bench.write("tuned.yaml", &text);
        let answer = run(&bench, "fresh", &[], 100);
        let found = Found::of(&bench);
        assert!(
            found.sentence.contains("without a value: rate="),
            "{method}: {}",
            found.sentence
        );
        assert!(
            answer.err.contains("rank") && answer.err.contains("(nan)"),
            "{}",
            answer.err
        );
        // It is said every time, and by the exit code.
        run(&bench, "fresh", &[], 100);
        for command in ["status", "report"] {
            assert_eq!(
                ask(&bench, &[command, "tuned.yaml", "--store", "fresh"], &[]).code,
                100
            );
        }
        let [sweep, _] = others(&rates(&bench, "fresh"));
        let diverging = sweep.replace(
            "fickle: { fickle: {} }",
            "fickle: { fickle: { diverges_from: 0.2 } }",
        );
        bench.write("sweep.yaml", &diverging);
        ask(&bench, &["run", "sweep.yaml", "-j", "2", "--store", "swept"], &[]);
        run(&bench, "swept", &[], 100);
        assert_eq!(Found::of(&bench).tables, found.tables, "{method}");
    }
}

#[test]
fn a_search_waits_for_trials_that_failed_and_chooses_as_if_they_had_not() {
    let failures = [
        ("0.3-0.8@3:fail", &[][..]),
        ("0.0-0.5@20:panic", &[]),
        ("0.5-1.0@30:hang", &["--wall-time-s", "2"]),
    ];
    for (number, method) in METHODS.into_iter().enumerate() {
        let (bench, found) = settled(&study(method));
        let (fails, limits) = failures[number % failures.len()];
        let arguments = [&["run", "tuned.yaml", "-j", "2", "--store", "failed"], limits].concat();
        let answer = ask(&bench, &arguments, &[("REGIMEN_TEST_FAILS", fails)]);
        assert_eq!(answer.code, 100, "{method}: {}", answer.err);
        let said = &answer.err;
        assert!(
            said.contains("it waits for") && said.contains("rate="),
            "{method}: {said}"
        );
        assert!(said.contains("--retry-failed"), "{method}: {said}");
        // Nothing is chosen meanwhile, however often it is asked.
        let again = run(&bench, "failed", &[], 100);
        assert!(again.err.contains("it waits for"), "{method}: {}", again.err);
        let report = fs::read_to_string(bench.path("results/tuned/report.md")).unwrap();
        assert!(report.contains("Nothing of fickle is shown before"), "{report}");
        for command in ["status", "report", "worker"] {
            let code = ask(&bench, &[command, "tuned.yaml", "--store", "failed"], &[]).code;
            assert_eq!(code, 100, "{method}: {command}");
        }
        run(&bench, "failed", &["--retry-failed"], 0);
        assert_eq!(Found::of(&bench), found, "{method} after {fails}");
        assert_eq!(bench.digests("failed"), bench.digests("fresh"), "{method}");
    }
}

#[test]
fn a_search_that_is_told_to_goes_on_without_what_failed_and_names_it() {
    let bench = Bench::new();
    let text = study("{ random: {} }").replace(
        "    metric: cycle_length",
        "    failed: rank_last\n    metric: cycle_length",
    );
    bench.write("tuned.yaml", &text);
    let fails = [("REGIMEN_TEST_FAILS", "0.3-0.8@3:fail")];
    let answer = ask(&bench, &["run", "tuned.yaml", "--store", "s"], &fails);
    assert_eq!(answer.code, 100, "{}", answer.err);
    let sentence = Found::of(&bench).sentence;
    assert!(sentence.contains("its setting was chosen among 6"), "{sentence}");
    assert!(
        sentence.contains("last without a value: rate=") && sentence.contains("(failed)"),
        "{sentence}"
    );
    assert_eq!(run(&bench, "s", &[], 100).code, 100, "it is said again");
    let bench_of_all = settled(&text).1;
    run(&bench, "s", &["--retry-failed"], 0);
    assert_eq!(Found::of(&bench), bench_of_all);
}

#[test]
fn a_search_split_over_two_stores_and_merged_chooses_as_in_one() {
    for method in METHODS {
        let (bench, found) = settled(&study(method));
        for (store, part) in [("one", "0/2"), ("two", "1/2")] {
            ask(
                &bench,
                &["worker", "tuned.yaml", "--index", part, "--store", store],
                &[],
            );
        }
        let merged = ask(&bench, &["merge", "one", "two", "--into", "both"], &[]);
        assert_eq!(merged.code, 0, "{}", merged.err);
        run(&bench, "both", &[], 0);
        assert_eq!(Found::of(&bench), found, "{method}");
        assert_eq!(bench.digests("both"), bench.digests("fresh"), "{method}");
    }
}

/// The measurements at pauses are acknowledged as everything else: they are taken by `merge`, kept by `pack`, known to
/// `fsck`, computed again by `verify`, and written by `export`.
#[test]
fn what_was_measured_at_a_pause_is_kept_as_all_other_results_are() {
    let (bench, found) = settled(&study(HALVING));
    let paused = |store: &str| {
        let is_paused = |folder: &&PathBuf| pause_in(folder).is_some();
        folders(&bench.path(store)).iter().filter(is_paused).count()
    };
    let n_paused = paused("fresh");
    assert!(n_paused >= 3, "{n_paused}");
    let said = ask(&bench, &["merge", "fresh", "--into", "merged"], &[]);
    assert!(said.code == 0 && !said.out.contains("unfinished"), "{}", said.out);
    assert_eq!(paused("merged"), n_paused);
    let again = ask(&bench, &["merge", "fresh", "--into", "merged"], &[]);
    assert!(again.out.contains(" 0 trials were taken"), "{}", again.out);
    let checked = ask(&bench, &["fsck", "merged"], &[]);
    assert!(
        checked.code == 0 && checked.out.contains(&format!("{n_paused} have paused")),
        "{}",
        checked.out
    );
    let packed = ask(&bench, &["pack", "merged", "--settle-s", "0"], &[]);
    assert_eq!(packed.code, 0, "{}", packed.err);
    assert_eq!(paused("merged"), 0, "{}", packed.out);
    for command in ["status", "report", "run"] {
        let answer = ask(&bench, &[command, "tuned.yaml", "--store", "merged"], &[]);
        assert_eq!(answer.code, 0, "{command}: {}\n{}", answer.out, answer.err);
    }
    assert_eq!(Found::of(&bench), found);
    // From the packs into another store, and from there.
    let said = ask(&bench, &["merge", "merged", "--into", "third"], &[]);
    assert_eq!((said.code, paused("third")), (0, n_paused), "{}", said.out);
    for (store, trials) in [("third", &["tuned.yaml"][..]), ("merged", &[])] {
        let arguments = [&["verify", "--store", store, "-j", "2"], trials].concat();
        let verified = ask(&bench, &arguments, &[]);
        assert_eq!(verified.code, 0, "{}\n{}", verified.out, verified.err);
        let same = bench.digests("fresh").len() + n_paused;
        assert!(
            verified.out.contains(&format!("{same} the same")),
            "{}",
            verified.out
        );
    }
    let exported = ask(
        &bench,
        &[
            "export",
            "tuned.yaml",
            "--as",
            "csv",
            "-o",
            "out",
            "--store",
            "third",
        ],
        &[],
    );
    assert_eq!(exported.code, 0, "{}", exported.err);
    let table = fs::read_to_string(bench.path("out/trials.csv")).unwrap();
    assert_eq!(table.matches(",paused,").count(), n_paused, "{table}");
    let evaluations = fs::read_to_string(bench.path("out/evaluations.csv")).unwrap();
    assert!(evaluations.lines().count() > table.lines().count());
}

#[test]
fn a_damaged_measurement_at_a_pause_is_found_set_aside_and_made_again() {
    let (bench, found) = settled(&study(HALVING));
    let paused = folders(&bench.path("fresh"));
    let file = paused.iter().filter_map(|folder| pause_in(folder)).min().unwrap();
    let whole = fs::read(&file).unwrap();
    let mut damaged = whole.clone();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 4;
    fs::write(&file, &damaged).unwrap();
    let checked = ask(&bench, &["fsck", "-n", "fresh"], &[]);
    assert!(
        checked.code == 106 && checked.out.contains("partial-"),
        "{}",
        checked.out
    );
    let merged = ask(&bench, &["merge", "fresh", "--into", "merged"], &[]);
    assert!(
        merged.code == 106 && merged.out.contains("damaged"),
        "{}",
        merged.out
    );
    let verified = ask(&bench, &["verify", "tuned.yaml", "--store", "fresh"], &[]);
    assert_eq!(verified.code, 106, "{}", verified.out);
    let again = run(&bench, "fresh", &[], 0);
    assert!(
        again.err.contains("partial-") && again.err.contains("set aside"),
        "{}",
        again.err
    );
    assert_eq!(Found::of(&bench), found);
    let now = fs::read(&file).unwrap();
    // The acknowledgement behind the metrics says how long it took.
    let length = whole.len().min(now.len()) / 3;
    let metrics = |bytes: &[u8]| {
        let begin = bytes.iter().position(|byte| *byte == b'\n').unwrap();
        bytes[begin..begin + length].to_vec()
    };
    assert_eq!(metrics(&now), metrics(&whole), "the same bits");
}

/// A store of an earlier program, which kept what was measured at a pause in the log of the trial alone.
#[test]
fn pauses_of_an_earlier_program_are_read_and_sealed_by_the_next_run() {
    let (bench, found) = settled(&study(HALVING));
    let mut removed = 0;
    for folder in folders(&bench.path("fresh")) {
        removed += usize::from(pause_in(&folder).is_some_and(|file| fs::remove_file(file).is_ok()));
    }
    assert!(removed > 2);
    for command in ["status", "report"] {
        let answer = ask(&bench, &[command, "tuned.yaml", "--store", "fresh"], &[]);
        assert_eq!(answer.code, 0, "{}\n{}", answer.out, answer.err);
    }
    assert_eq!(Found::of(&bench), found);
    run(&bench, "fresh", &[], 0);
    let said = ask(&bench, &["merge", "fresh", "--into", "merged"], &[]);
    assert!(!said.out.contains("unfinished"), "{}", said.out);
    run(&bench, "merged", &[], 0);
    assert_eq!(Found::of(&bench), found);
}

/// A stop reaches the whole group of processes, as Ctrl-C does, at any instant.
#[test]
fn a_stop_is_no_failure_of_a_trial_and_the_search_chooses_the_same() {
    let (bench, found) = settled(&study(HALVING));
    for signal in ["INT", "TERM", "USR1"] {
        for round in 0..8u64 {
            let mut command = bench.misused(&["run", "tuned.yaml", "-j", "2", "--store", "stopped"]);
            stop_after(&mut command, signal, Duration::from_millis(15 * round));
        }
        for file in trial_files_if_any(&bench.path("stopped")) {
            let trial: serde_json::Value = serde_json::from_slice(&fs::read(&file).unwrap()).unwrap();
            assert_eq!(trial["end"]["state"], "ok", "{signal}: {trial}");
        }
    }
    run(&bench, "stopped", &[], 0);
    assert_eq!(Found::of(&bench), found);
    assert_eq!(bench.digests("stopped"), bench.digests("fresh"));
}

fn trial_files_if_any(store: &Path) -> Vec<PathBuf> {
    if store.join("trials").exists() {
        trial_files(store)
    } else {
        Vec::new()
    }
}

fn stop_after(command: &mut Command, signal: &str, wait: Duration) {
    use std::os::unix::process::CommandExt;
    let quiet = command
        .process_group(0)
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let mut child = quiet.spawn().unwrap();
    std::thread::sleep(wait);
    let group = format!("-{}", child.id());
    let sent = Command::new("kill")
        .args(["-s", signal, "--", &group])
        .stderr(Stdio::null())
        .status();
    sent.unwrap();
    child.wait().unwrap();
}

#[test]
fn a_report_of_an_unfinished_search_says_so_and_removes_no_table() {
    for method in [HALVING, METHODS[2]] {
        // The agents that are searched are the only ones, so that there is no table before the choice.
        let text = study(method).replace("  equal: { equal_split: {} }\n", "");
        let (bench, _) = settled(&text);
        let tables = || {
            let names = fs::read_dir(bench.path("results/tuned/tables")).unwrap();
            let read = |entry: fs::DirEntry| (entry.file_name(), fs::read(entry.path()).unwrap());
            names
                .map(|entry| read(entry.unwrap()))
                .collect::<BTreeMap<_, _>>()
        };
        let before = tables();
        let of_search = |folder: &&PathBuf| {
            let text = fs::read_to_string(folder.join("trial.json")).unwrap_or_default();
            text.contains("\"seed\":1000000")
        };
        let trial = folders(&bench.path("fresh"))
            .iter()
            .find(of_search)
            .unwrap()
            .clone();
        fs::remove_dir_all(trial).unwrap();
        let codes = ["status", "report"].map(|command| {
            let answer = ask(&bench, &[command, "tuned.yaml", "--store", "fresh"], &[]);
            assert!(!answer.err.contains("removed"), "{}", answer.err);
            answer.code
        });
        assert_eq!(codes, [106, 106], "{method}");
        let lengths = |tables: &BTreeMap<std::ffi::OsString, Vec<u8>>| {
            let named = tables
                .iter()
                .filter(|(name, _)| name.to_string_lossy().starts_with("lengths"));
            named
                .map(|(name, bytes)| (name.clone(), bytes.clone()))
                .collect::<Vec<_>>()
        };
        assert_eq!(lengths(&tables()), lengths(&before), "{method}");
        let page = fs::read_to_string(bench.path("results/tuned/report.md")).unwrap();
        assert!(
            page.contains("its files are those of an earlier report"),
            "{page}"
        );
        // A trial that is not in another store takes nothing away either.
        let whole = fs::read(bench.path("results/tuned/index.html")).unwrap();
        let answer = ask(
            &bench,
            &["report", "tuned.yaml", "--store", "of-another-name"],
            &[],
        );
        assert_eq!(answer.code, 106, "{}", answer.err);
        assert!(answer.err.contains("stays as it was"), "{}", answer.err);
        assert_eq!(fs::read(bench.path("results/tuned/index.html")).unwrap(), whole);
        run(&bench, "fresh", &[], 0);
        assert_eq!(tables(), before, "{method}");
        let manifest = fs::read_to_string(bench.path("results/tuned/manifest.json")).unwrap_or_default();
        assert!(!manifest.contains("\"earlier\""), "{manifest}");
    }
}
