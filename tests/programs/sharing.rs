//! Programs share the cores and the graphics cards of a machine: what each says that it needs is what it is given.

use super::*;
use std::collections::BTreeSet;

/// A study of so many seeds of a program that notes, in `notes` beside the study, what it was given and when it ran.
fn noting(needs: &str, seeds: u32) -> Place {
    let place = Place::new("", "{ return: r }", &format!("      needs: {needs}"));
    let notes = place.bench.path("notes");
    let program = format!(
        "exec 3>>'{notes}'\necho \"begins cards=$CUDA_VISIBLE_DEVICES threads=$OMP_NUM_THREADS\" >&3\n\
         sleep 0.5\necho ends >&3\necho r=1\n",
        notes = notes.display()
    );
    place.bench.write("a.sh", &program);
    // Nothing is measured before the end, so that no trial runs a second time to see whether it repeats.
    place.edit("evaluate_every: 200", "evaluate_every: 0");
    place.edit("seeds: 1", &format!("seeds: {seeds}"));
    place
}

/// The cards and threads of the programs of a study, and how many of them ran at a time.
fn noted(place: &Place) -> (Vec<String>, usize) {
    let (mut given, mut now, mut most) = (Vec::new(), 0_usize, 0);
    for line in fs::read_to_string(place.bench.path("notes")).unwrap().lines() {
        match line.strip_prefix("begins ") {
            Some(what) => {
                given.push(what.to_owned());
                now += 1;
                most = most.max(now);
            }
            None => now -= 1,
        }
    }
    (given, most)
}

#[test]
fn cores_are_counted_and_told_to_libraries() {
    let place = noting("{ cores: 2 }", 4);
    let answer = place.bench.run(&["run", "study.yaml", "-j", "5", "--yes"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    let (given, most) = noted(&place);
    assert_eq!(given, vec!["cards= threads=2"; 4]);
    assert_eq!(most, 2, "two trials of two cores fit into five");
}

#[test]
fn each_program_sees_its_cards_and_shares_of_one_stand_beside_each_other() {
    let place = noting("{ gpus: 0.5 }", 6);
    place
        .bench
        .write("regimen.toml", "workers = 6\ngpus = [\"3\", \"GPU-5\"]\n");
    let answer = place.bench.run(&["run", "study.yaml", "--yes"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    let (given, most) = noted(&place);
    let cards: BTreeSet<&str> = given.iter().map(String::as_str).collect();
    assert_eq!(cards, ["cards=3 threads=1", "cards=GPU-5 threads=1"].into());
    assert_eq!(most, 4, "two halves of each of two cards");
}

#[test]
fn a_program_that_needs_no_card_sees_none_and_one_that_says_nothing_sees_what_the_machine_shows() {
    for (needs, cards) in [("{ gpus: 0 }", "cards= threads=1"), ("{}", "cards=7 threads=1")] {
        let place = noting(needs, 1);
        let mut run = place.bench.command(&["run", "study.yaml", "--yes"]);
        assert!(
            run.env("CUDA_VISIBLE_DEVICES", "7")
                .output()
                .unwrap()
                .status
                .success()
        );
        assert_eq!(noted(&place).0, [cards]);
    }
}

#[test]
fn a_trial_that_fits_nowhere_is_refused_before_anything_runs() {
    let place = noting("{ cores: 2, gpus: 1 }", 1);
    place.bench.write("regimen.toml", "workers = 2\ngpus = 0\n");
    for command in [&["check", "study.yaml"][..], &["run", "study.yaml", "--yes"]] {
        let answer = place.bench.run(command);
        assert_eq!(answer.code, 2, "{}", answer.out);
        let says = "a trial of `sh a.sh` needs 2 cores and 1 GPU, and this machine has 2 cores and no GPU";
        assert!(answer.err.contains(says), "{}", answer.err);
        assert!(answer.err.contains("`gpus` of regimen.toml"), "{}", answer.err);
    }
    place.bench.write("regimen.toml", "gpus = 1\n");
    let answer = place.bench.run(&["run", "study.yaml", "-j", "1", "--yes"]);
    assert!(
        answer.err.contains("this machine has 1 core and 1 GPU"),
        "{}",
        answer.err
    );
    assert!(!place.bench.path("notes").exists());

    place.bench.write(
        "regimen.toml",
        "executor = \"slurm\"\n[slurm]\ncpus_per_task = 2\n",
    );
    for command in [&["check", "study.yaml"][..], &["run", "study.yaml", "--yes"]] {
        let answer = place.bench.run(command);
        assert_eq!(answer.code, 2, "{}", answer.out);
        let says = "a task has 2 cores and no GPU";
        assert!(
            answer.err.contains(says) && answer.err.contains("`gpus_per_task` in [slurm]"),
            "{}",
            answer.err
        );
    }
}

#[test]
fn what_no_machine_gives_is_refused_at_its_key() {
    for (needs, says) in [
        (
            "{ gpus: 1.5 }",
            "1.5 is neither a whole number of cards nor a share of one",
        ),
        ("{ cores: 0 }", "cores"),
        ("{ memory: 3 }", "memory"),
    ] {
        let answer = noting(needs, 1).bench.run(&["check", "study.yaml"]);
        assert_eq!(answer.code, 2, "{needs}: {}", answer.out);
        assert!(answer.err.contains(says), "{needs}: {}", answer.err);
    }
}

#[test]
fn what_a_trial_needs_is_no_part_of_it() {
    let place = noting("{ cores: 2 }", 2);
    assert_eq!(
        place.bench.run(&["run", "study.yaml", "-j", "2", "--yes"]).code,
        0
    );
    place.edit("{ cores: 2 }", "{ cores: 1, gpus: 0 }");
    let answer = place.run(&[]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(
        answer.err.contains("every trial is in the store already"),
        "{}",
        answer.err
    );
}
