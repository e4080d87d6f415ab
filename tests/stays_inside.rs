//! A study names files of its folder and its project, and whatever else it names is quoted by no message.

use crate::program::{Answer, Bench, answer};
use std::{fs, os::unix::fs::symlink};

const SECRET: &str = "s3cr3t";

/// A study in `lab/studies` with these lines, beside files of somebody else that hold secrets.
fn bench() -> Bench {
    let bench = Bench::new();
    for folder in ["lab/studies", "lab/data", "other"] {
        fs::create_dir_all(bench.path(folder)).unwrap();
    }
    bench.write(
        "other/credentials",
        &format!("token: {SECRET}\nkey_{SECRET}: {SECRET}\n"),
    );
    bench.write("other/passwd", &format!("root:{SECRET}:0:0\n{SECRET}: [a, b\n"));
    bench.write("other/x.csv", &format!("user,{SECRET}\n1,{SECRET}\n{SECRET},2\n"));
    bench.write("other/load.csv", &format!("t_s,power_w\n0,1\n{SECRET},2\n"));
    bench.write("lab/data/load.csv", "t_s,power_w\n0,1\n1,2\n");
    bench
}

/// Output of `check` for the study with one section written so.
fn check(bench: &Bench, load: &str, lines: &str) -> Answer {
    let text = format!(
        "study: small\nenvironments: {{ cells: {{ battery: {{ cells: 2, load: {load} }} }} }}\n\
         agents: {{ equal: {{ equal_split: {{}} }} }}\n\
         protocol: {{ train_evaluate: {{ steps: 64, evaluate_every: 64, episodes: 1, final_episodes: 1 }} }}\n{lines}\n"
    );
    bench.write("lab/studies/small.yaml", &text);
    let inside = bench
        .command(&["check", "small.yaml"])
        .current_dir(bench.path("lab/studies"))
        .output();
    let outside = bench.run(&["check", "lab/studies/small.yaml"]);
    let inside = answer(&inside.unwrap());
    assert_eq!(inside.code, outside.code, "{}{}", inside.err, outside.err);
    assert!(
        !inside.err.contains(SECRET) || outside.err.contains(SECRET),
        "{}",
        inside.err
    );
    outside
}

/// Every key that names a file, with the name written into it: the load of the battery, and lines of the study.
fn keys(name: &str, imported: &str) -> Vec<(String, String)> {
    let curve = format!("{{ label: old, file: {name}, step: step, value: reward }}");
    let lines = [
        format!("include: {name}"),
        format!(
            "imported: {{ them: {{ from: \"{imported}\", step: step, metrics: {{ return: reward }} }} }}"
        ),
        format!("figures: {{ f: {{ learning_curve: {{ metric: return, published: [{curve}] }} }} }}"),
    ];
    let all = lines.into_iter().map(|line| ("thesis".to_owned(), line));
    all.chain([(format!("{{ file: {name} }}"), String::new())])
        .collect()
}

#[test]
fn names_that_lead_out_are_refused_for_every_key_and_nothing_is_quoted() {
    let bench = bench();
    let studies = bench.path("lab/studies");
    symlink(bench.path("other/x.csv"), studies.join("link.csv")).unwrap();
    symlink(bench.path("other"), studies.join("away")).unwrap();
    let names = [
        ("../../other/x.csv", "../../other/*"),
        ("../data/load.csv", "../data/*.csv"),
        ("link.csv", "*.csv"),
        ("away/x.csv", "away/*"),
        ("away/../../../other/x.csv", "away/../../other/*.csv"),
    ];
    for (name, pattern) in names {
        for (load, lines) in keys(name, pattern) {
            let told = check(&bench, &load, &lines);
            assert_eq!(told.code, 2, "{lines} {load}: {}{}", told.out, told.err);
            assert!(
                told.err.contains("leads out of the folder of the study"),
                "{lines} {load}: {}",
                told.err
            );
            assert!(
                told.err.contains("regimen.toml") && !told.err.contains(SECRET),
                "{}",
                told.err
            );
        }
    }
}

#[test]
fn of_files_that_are_named_absolutely_place_and_kind_of_a_mistake_are_said_and_no_word() {
    let bench = bench();
    for file in ["credentials", "passwd", "x.csv", "load.csv"] {
        let name = bench.path(&format!("other/{file}")).display().to_string();
        for (load, lines) in keys(&name, &name) {
            let told = check(&bench, &load, &lines);
            assert_eq!(told.code, 2, "{lines} {load}: {}{}", told.out, told.err);
            assert!(
                !told.err.contains(SECRET) && !told.out.contains(SECRET),
                "{lines} {load}: {}",
                told.err
            );
        }
    }
    let told = check(
        &bench,
        "thesis",
        &format!("include: {}", bench.path("other/credentials").display()),
    );
    assert!(
        told.err.contains("unknown key `…`") && told.err.contains("credentials:1:1"),
        "{}",
        told.err
    );
    assert!(told.err.contains("its text is not shown"), "{}", told.err);
    let load = format!("{{ file: {} }}", bench.path("other/load.csv").display());
    let told = check(&bench, &load, "");
    assert!(
        told.err.contains("line 3") && told.err.contains("is no number"),
        "{}",
        told.err
    );
    // One's own file is quoted.
    fs::copy(bench.path("other/load.csv"), bench.path("lab/studies/load.csv")).unwrap();
    assert!(
        check(&bench, "{ file: load.csv }", "")
            .err
            .contains(&format!("`{SECRET}` is no number"))
    );
}

#[test]
fn files_of_a_project_are_shared_by_its_studies() {
    let bench = bench();
    bench.write("lab/regimen.toml", "");
    let told = check(&bench, "{ file: ../data/load.csv }", "");
    assert_eq!(told.code, 0, "{}", told.err);
    let told = check(&bench, "{ file: ../../other/load.csv }", "");
    assert!(told.code == 2 && told.err.contains("leads out"), "{}", told.err);
}

#[test]
fn what_the_system_makes_as_it_is_read_is_not_waited_for() {
    let bench = bench();
    for name in ["/proc/kmsg", "/dev/zero", "/dev/stdin"] {
        for (load, lines) in keys(name, name) {
            let told = check(&bench, &load, &lines);
            assert_eq!(told.code, 2, "{lines} {load}: {}{}", told.out, told.err);
        }
    }
}
