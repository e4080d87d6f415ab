//! Tests of logs whose steps go back.

use super::{super::content::content, *};

fn log(files: &[&[(u64, f64)]]) -> Log {
    let mut log = Log::default();
    for (file, values) in files.iter().enumerate() {
        for ((step, value), line) in values.iter().zip(2..) {
            log.entries.push(LogValue {
                place: (file, line),
                step: *step,
                slot: 0,
                value: *value,
            });
        }
    }
    log
}

fn read(
    files: &[&[(u64, f64)]],
    restart: Option<Restart>,
    same_step: Option<SameStep>,
) -> Result<Vec<SeparatedRun>, String> {
    let mapping = Mapping {
        restart,
        same_step,
        ..Mapping::default()
    };
    let contents: Vec<Content> = (0..files.len())
        .map(|it| content(&format!("{it}.csv"), ""))
        .collect();
    let contents: Vec<&Content> = contents.iter().collect();
    let passes = Rules::of_tables(&mapping).told_apart(log(files), 1, &contents);
    passes.map_err(|error| error.to_string())
}

fn values(passes: &[SeparatedRun]) -> Vec<Vec<(u64, f64)>> {
    let of = |pass: &SeparatedRun| {
        pass.entries
            .iter()
            .map(|entry| (entry.step, entry.value))
            .collect()
    };
    passes.iter().map(of).collect()
}

const AGAIN: &[(u64, f64)] = &[(0, 1.0), (10, 2.0), (20, 3.0), (10, 4.0), (30, 5.0)];

#[test]
fn steps_that_go_back_are_refused_with_their_line_or_told_apart() {
    let told = read(&[AGAIN], None, None).unwrap_err();
    assert!(
        told.contains("`0.csv`, line 5: step 10 comes after step 20 (line 4)"),
        "{told}"
    );
    assert!(
        told.contains("`restart: new_run`") && told.contains("`restart: resume`") && told.contains("`run`")
    );
    let runs = read(&[AGAIN], Some(Restart::NewRun), None).unwrap();
    assert_eq!(
        values(&runs),
        [vec![(0, 1.0), (10, 2.0), (20, 3.0)], vec![(10, 4.0), (30, 5.0)]]
    );
    assert_eq!(runs[1].from, Some((0, 5)));
    let one = read(&[AGAIN], Some(Restart::Resume), None).unwrap();
    assert_eq!(values(&one), [vec![(0, 1.0), (10, 4.0), (30, 5.0)]]);
    assert_eq!(one[0].purged, 2);
}

/// An entry of `imported` has keys that separate runs; a program has none.
#[test]
fn advice_for_an_own_trial_names_no_key_of_imported_runs() {
    let mapping = Mapping {
        is_own: true,
        ..Mapping::default()
    };
    let contents = ["0.csv", "1.csv"].map(|name| content(name, ""));
    let told = |files: &[&[(u64, f64)]]| {
        let contents: Vec<&Content> = contents.iter().collect();
        let told = Rules::of_tables(&mapping).told_apart(log(files), 1, &contents);
        told.unwrap_err().to_string()
    };
    let (back, both) = (told(&[AGAIN]), told(&[&[(0, 1.0)], &[(0, 2.0)]]));
    assert!(back.contains("print a running total"), "{back}");
    assert!(both.contains("name one file under `from`"), "{both}");
    for key in ["restart", "`run`", "`seed`"] {
        assert!(!back.contains(key) && !both.contains(key), "{back} {both}");
    }
}

#[test]
fn steps_that_repeat_are_refused_averaged_or_replaced() {
    let twice: &[(u64, f64)] = &[(0, 1.0), (0, 3.0), (5, 2.0)];
    let told = read(&[twice], None, None).unwrap_err();
    assert!(
        told.contains("line 3: step 0 has a value already (line 2)") && told.contains("`same_step: mean`"),
        "{told}"
    );
    let both = read(&[twice], None, Some(SameStep::Mean)).unwrap();
    assert_eq!((values(&both)[0].len(), both[0].repeated), (3, 1));
    let last = read(&[twice], None, Some(SameStep::Last)).unwrap();
    assert_eq!(values(&last), [vec![(0, 3.0), (5, 2.0)]]);
}

#[test]
fn files_go_on_in_the_order_of_their_steps_and_do_not_begin_again() {
    let (early, late): (&[(u64, f64)], &[(u64, f64)]) = (&[(0, 1.0), (10, 2.0)], &[(20, 3.0)]);
    assert_eq!(
        values(&read(&[late, early], None, None).unwrap()),
        [vec![(0, 1.0), (10, 2.0), (20, 3.0)]]
    );
    for steps in [
        &[(10, 9.0), (20, 9.0)],
        &[(0, 9.0), (5, 9.0)],
        &[(5, 9.0), (40, 9.0)],
    ] {
        let told = read(&[early, steps], None, None).unwrap_err();
        assert!(
            told.contains("it has steps that `") && told.contains("`restart: resume`"),
            "{told}"
        );
        assert_eq!(
            read(&[early, steps], Some(Restart::NewRun), None).unwrap().len(),
            2
        );
    }
    let resumed = read(&[early, &[(10, 9.0), (20, 9.0)]], Some(Restart::Resume), None).unwrap();
    assert_eq!(values(&resumed), [vec![(0, 1.0), (10, 9.0), (20, 9.0)]]);
}

#[test]
fn a_log_in_another_order_is_no_log_of_restarts() {
    let down: Vec<(u64, f64)> = (0..200).rev().map(|step| (step, 0.0)).collect();
    let told = read(&[&down], Some(Restart::NewRun), None).unwrap_err();
    assert!(
        told.contains("go back more than 100 times: sort it by step"),
        "{told}"
    );
}

#[test]
fn a_line_of_several_values_stays_together() {
    let entry = |line, step, slot| LogValue {
        place: (0, line),
        step,
        slot,
        value: 0.0,
    };
    // The second slot goes back in a line where the first one does not.
    let log = Log {
        entries: vec![entry(2, 5, 1), entry(3, 1, 0), entry(3, 1, 1)],
        ..Log::default()
    };
    let file = content("a.csv", "");
    let mapping = Mapping {
        restart: Some(Restart::NewRun),
        ..Mapping::default()
    };
    let runs = Rules::of_tables(&mapping).told_apart(log, 2, &[&file]).unwrap();
    assert_eq!((runs[0].entries.len(), runs[1].entries.len()), (1, 2));
}

proptest::proptest! {
    /// No value is lost if runs are separated, and a resumed run has the values of a naive purge.
    #[test]
    fn steps_never_go_back_in_what_is_read(steps in proptest::collection::vec(0_u64..20, 1..60)) {
        let logged: Vec<(u64, f64)> = steps.iter().zip(0_u32..).map(|(step, at)| (*step, f64::from(at))).collect();
        let runs = values(&read(&[&logged], Some(Restart::NewRun), Some(SameStep::Mean)).unwrap());
        proptest::prop_assert_eq!(runs.concat(), logged.clone());
        proptest::prop_assert!(runs.iter().all(|run| run.is_sorted_by_key(|(step, _)| *step)));
        let mut purged: Vec<(u64, f64)> = Vec::new();
        for (step, value) in logged.clone() {
            if purged.last().is_some_and(|(last, _)| *last > step) {
                purged.retain(|(other, _)| *other < step);
            }
            purged.push((step, value));
        }
        let resumed = values(&read(&[&logged], Some(Restart::Resume), Some(SameStep::Mean)).unwrap());
        proptest::prop_assert_eq!(&resumed[..], &[purged][..]);
        let told = read(&[&logged], None, Some(SameStep::Mean));
        proptest::prop_assert_eq!(told.is_ok(), runs.len() == 1);
    }
}
