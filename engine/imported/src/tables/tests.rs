use super::{
    super::{columns::MetricColumns, content::content, mapping::SameStep},
    *,
};

fn mapping() -> Mapping {
    Mapping {
        metrics: [("return".to_owned(), "charts/episodic_return".into())].into(),
        step: Step::Column("global_step".into()),
        ..Mapping::default()
    }
}

fn monitor() -> Mapping {
    Mapping {
        metrics: [("return".to_owned(), "r".into())].into(),
        step: Step::sum_of("l"),
        ..Mapping::default()
    }
}

fn read(files: &[(&str, &str)], mapping: &Mapping) -> Result<RunCollection, String> {
    let contents: Vec<Content> = files.iter().map(|(name, text)| content(name, text)).collect();
    let formed: Vec<(&Content, LogFormat)> = contents.iter().map(|it| (it, it.form().unwrap())).collect();
    let mut found = RunCollection::default();
    runs(&formed, mapping, &mut found).map_err(|error| error.to_string())?;
    Ok(found)
}

fn refused(text: &str, mapping: &Mapping) -> String {
    read(&[("a.csv", text)], mapping).map(|_| ()).unwrap_err()
}

fn curve(found: &RunCollection, run: usize) -> &[(u64, f64)] {
    &found.runs[run].curves["return"]
}

fn names(found: &RunCollection) -> Vec<&str> {
    found.runs.iter().map(|run| run.name.as_str()).collect()
}

const LONG: &str =
    "global_step,seed,env,charts/episodic_return\n0,1,a,1.5\n100.0,1,a,\n200,1,a,2.5\n300,2,b,7\n400,3,a,4\n";

#[test]
fn a_file_is_a_run_unless_a_column_tells_runs_apart() {
    let both = [("a.csv", LONG), ("b.csv", LONG)];
    assert_eq!(names(&read(&both, &mapping()).unwrap()), ["`a.csv`", "`b.csv`"]);
    let by_seed = Mapping {
        seed: Some("seed".into()),
        ..mapping()
    };
    let found = read(&both[..1], &by_seed).unwrap();
    let seeds: Vec<_> = found.runs.iter().map(|run| run.seed).collect();
    assert_eq!(seeds, [Some(1), Some(2), Some(3)]);
    assert_eq!(curve(&found, 0), [(0, 1.5), (200, 2.5)]);
    let in_a = Mapping {
        only: [("env".to_owned(), "a".to_owned())].into(),
        ..by_seed
    };
    assert_eq!(read(&both[..1], &in_a).unwrap().runs.len(), 2);
}

#[test]
fn a_run_goes_on_in_another_file_and_does_not_begin_there_again() {
    let head = "global_step,seed,env,charts/episodic_return\n";
    let by = |run: Option<&str>, seed: Option<&str>| Mapping {
        run: run.map(Into::into),
        seed: seed.map(Into::into),
        ..mapping()
    };
    let later = format!("{head}900,1,a,3\n");
    for by in [by(Some("env"), None), by(None, Some("seed"))] {
        let found = read(&[("b.csv", &later), ("a.csv", LONG)], &by).unwrap();
        assert_eq!(
            curve(&found, 0).iter().map(|it| it.0).max(),
            Some(900),
            "in any order of the names"
        );
    }
    let by_seed = by(None, Some("seed"));
    for steps in [[0, 400], [100, 150], [0, 0], [200, 400]] {
        let again: String = steps.iter().map(|step| format!("{step},1,a,3\n")).collect();
        let told = read(&[("a.csv", LONG), ("c.csv", &format!("{head}{again}"))], &by_seed)
            .map(|_| ())
            .unwrap_err();
        assert!(
            told.contains("has steps that `") || told.contains("has a value already"),
            "{told}"
        );
    }
}

#[test]
fn files_of_a_folder_are_one_run_where_the_entry_says_so() {
    let (one, two) = (
        "global_step,charts/episodic_return\n0,1\n10,2\n",
        "global_step,charts/episodic_return\n20,3\n",
    );
    let files = [("a/1.csv", one), ("a/2.csv", two), ("b/1.csv", one)];
    let per_folder = Mapping {
        run_per: Some(RunPer::Folder),
        ..mapping()
    };
    let found = read(&files, &per_folder).unwrap();
    assert_eq!(names(&found), ["`a`", "`b`"]);
    assert_eq!(curve(&found, 0), [(0, 1.0), (10, 2.0), (20, 3.0)]);
    assert_eq!(read(&files, &mapping()).unwrap().runs.len(), 3);
}

#[test]
fn only_takes_lines_by_text_or_number_and_files_without_such_are_passed_over() {
    let of = |seed: &str| Mapping {
        only: [("seed".to_owned(), seed.to_owned())].into(),
        ..mapping()
    };
    assert_eq!(
        curve(&read(&[("a.csv", LONG)], &of("2.0")).unwrap(), 0),
        [(300, 7.0)]
    );
    let other = LONG.replace(",2,b", ",9,b");
    let found = read(&[("a.csv", LONG), ("b.csv", &other)], &of("9")).unwrap();
    assert_eq!(names(&found), ["`b.csv`"]);
    let told = read(&[("a.csv", LONG), ("b.csv", LONG)], &of("9"))
        .map(|_| ())
        .unwrap_err();
    assert!(
        told.contains("no line of 2 files has the values of `only` (seed: 9)"),
        "{told}"
    );
}

#[test]
fn two_runs_in_a_file_are_told_apart_or_refused() {
    let text = "global_step,charts/episodic_return\n0,1\n5,2\n0,3\n5,4\n";
    let told = refused(text, &mapping());
    assert!(
        told.contains("line 4: step 0 comes after step 5 (line 3)"),
        "{told}"
    );
    let new_run = Mapping {
        restart: Some(Restart::NewRun),
        ..mapping()
    };
    let found = read(&[("a.csv", text)], &new_run).unwrap();
    assert_eq!(names(&found), ["`a.csv`", "`a.csv` from line 4"]);
    assert_eq!(
        (found.restarted, curve(&found, 1)),
        (1, &[(0, 3.0), (5, 4.0)][..])
    );
    let beside = "global_step,charts/episodic_return\n0,1\n0,3\n5,2\n5,4\n";
    assert!(refused(beside, &mapping()).contains("line 3: step 0 has a value already (line 2)"));
    let last = Mapping {
        same_step: Some(SameStep::Last),
        ..mapping()
    };
    assert_eq!(
        curve(&read(&[("a.csv", beside)], &last).unwrap(), 0),
        [(0, 3.0), (5, 4.0)]
    );
}

#[test]
fn metrics_that_are_logged_on_lines_of_their_own_do_not_go_back() {
    let two = Mapping {
        metrics: [("return".to_owned(), "x".into()), ("loss".to_owned(), "y".into())].into(),
        step: Step::Column("step".into()),
        ..Mapping::default()
    };
    let found = read(&[("a.csv", "step,x,y\n10,1,\n10,,5\n5,,\n20,2,\n15,,6\n")], &two);
    let found = found.unwrap();
    assert_eq!(curve(&found, 0), [(10, 1.0), (20, 2.0)]);
    assert_eq!(found.runs[0].curves["loss"], [(10, 5.0), (15, 6.0)]);
}

const MONITOR: &str = "#{\"t_start\": 100.0, \"env_id\": \"a\"}\nr,l,t\n-5,10,0.5\n-4,20,1.5\n";

#[test]
fn steps_of_a_monitor_are_the_running_sum_of_lengths() {
    let found = read(&[("monitor.csv", MONITOR)], &monitor()).unwrap();
    assert_eq!(curve(&found, 0), [(10, -5.0), (30, -4.0)]);
    for step in ["step", "l", "t"] {
        let told = refused(
            MONITOR,
            &Mapping {
                step: Step::Column(step.into()),
                ..monitor()
            },
        );
        assert!(
            told.contains("line 2") && told.contains("write `step: { sum: l }`"),
            "{told}"
        );
    }
}

#[test]
fn a_second_monitor_in_the_file_is_told_apart_or_goes_on() {
    for (more, line) in [
        ("r,l,t\n-3,7,0.1\n", 6),
        ("#{}\n-3,7,9.5\n", 6),
        ("-3,7,0.1\n", 5),
    ] {
        let text = format!("{MONITOR}{more}");
        let told = refused(&text, &monitor());
        assert!(
            told.contains(&format!("line {line}")) && told.contains("`restart: new_run`"),
            "{told}"
        );
        let new_run = read(
            &[("monitor.csv", &text)],
            &Mapping {
                restart: Some(Restart::NewRun),
                ..monitor()
            },
        )
        .unwrap();
        assert_eq!((new_run.runs.len(), curve(&new_run, 1)), (2, &[(7, -3.0)][..]));
        let resumed = read(
            &[("monitor.csv", &text)],
            &Mapping {
                restart: Some(Restart::Resume),
                ..monitor()
            },
        )
        .unwrap();
        assert_eq!(curve(&resumed, 0).last(), Some(&(37, -3.0)));
    }
}

#[test]
fn monitors_of_several_environments_are_one_run_by_time() {
    let other = "#{\"t_start\": 99.0, \"env_id\": \"a\"}\nr,l,t\n-9,3,0.2\n-8,4,2.0\n";
    let files = [("a/0.monitor.csv", MONITOR), ("a/1.monitor.csv", other)];
    let told = read(&files, &monitor()).map(|_| ()).unwrap_err();
    assert!(
        told.contains("`run_per: folder`") && told.contains("`run_per: file`"),
        "{told}"
    );
    let found = read(
        &files,
        &Mapping {
            run_per: Some(RunPer::Folder),
            ..monitor()
        },
    )
    .unwrap();
    assert_eq!(curve(&found, 0), [(3, -9.0), (13, -5.0), (17, -8.0), (37, -4.0)]);
    assert_eq!(
        found.notes,
        ["the 2 logs in `a` are of one run, in the order of time"]
    );
    assert_eq!(
        read(
            &files,
            &Mapping {
                run_per: Some(RunPer::File),
                ..monitor()
            }
        )
        .unwrap()
        .runs
        .len(),
        2
    );
}

#[test]
fn several_columns_are_runs_of_one_metric() {
    let text = "Step,ppo__1 - x,ppo__1 - x__MIN,ppo__2 - x\n0,1,0,\n10,2,0,5\n";
    let columns = |columns: crate::Patterns| Mapping {
        metrics: [("return".to_owned(), columns)].into(),
        step: Step::Column("Step".into()),
        ..Mapping::default()
    };
    let found = read(&[("wandb.csv", text)], &columns("ppo__* - x".into())).unwrap();
    assert_eq!(
        names(&found),
        [
            "`wandb.csv`, column `ppo__1 - x`",
            "`wandb.csv`, column `ppo__2 - x`"
        ]
    );
    assert_eq!(
        (curve(&found, 0), curve(&found, 1)),
        (&[(0, 1.0), (10, 2.0)][..], &[(10, 5.0)][..])
    );
    let by_seed = Mapping {
        seed: Some("Step".into()),
        ..columns("ppo__* - x".into())
    };
    assert!(refused(text, &by_seed).contains("leave `seed` and `run` out"));
    let known: Vec<String> = text.lines().next().unwrap().split(',').map(Into::into).collect();
    assert_eq!(
        MetricColumns::of(&known, &columns("ppo__* - x".into()))
            .unwrap()
            .runs
            .len(),
        2
    );
}

#[test]
fn what_is_wrong_is_named_with_its_place() {
    let head = "global_step,charts/episodic_return\n";
    for (text, part) in [
        (
            "global_step,episodic_return\n0,1\n".to_owned(),
            "column `charts/episodic_return`: there is no such column; did you mean",
        ),
        (
            format!("{head}0,1\n5,high\n"),
            "`a.csv`, line 3, column `charts/episodic_return`: `high` is no number",
        ),
        (
            format!("{head}-1,1\n"),
            "line 2, column `global_step`: `-1` is no whole number",
        ),
        (
            format!("{head}0,1\n,2\n"),
            "line 3, column `global_step`: the cell is empty, and the line has values",
        ),
        (format!("{head}0.5,1\n"), "`0.5` is no whole number"),
        (
            format!("{head}1,NaN\n"),
            "`NaN` is not finite: write `leave_out: [not_finite]`",
        ),
        (format!("{head}1,-inf\n"), "is not finite"),
        (
            format!("{head}1,\"1,5\"\n"),
            "`1,5` is no number: write a decimal point",
        ),
        (format!("{head}1,2,3\n"), "line 2: the line has 3 cells"),
        (
            "global_step,charts/episodic_return,charts/episodic_return\n0,1,2\n".to_owned(),
            "two columns have this name",
        ),
        (
            "0,1\n5,2\n".to_owned(),
            "numbers stand where the names of the columns are expected",
        ),
    ] {
        let told = refused(&text, &mapping());
        assert!(told.contains(part), "{part}\n{told}");
    }
}
