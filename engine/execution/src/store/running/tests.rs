use super::*;
use contract::{Action, Mode, Observation, Phase, Rng};
use serde_json::json;

/// An agent that is one number.
struct Counter(u64);

impl Agent for Counter {
    fn act(&mut self, observations: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        Ok(observations.iter().map(|_| Vec::new()).collect())
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        let path = dir.join("count");
        fs::write(&path, self.0.to_string()).map_err(Error::file("write", &path))
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        let path = dir.join("count");
        let text = fs::read_to_string(&path).map_err(Error::file("read", &path))?;
        self.0 = text.parse().map_err(|_| Error::Checkpoint {
            what: "counter",
            problem: text,
        })?;
        Ok(())
    }
}

struct Bench {
    folder: tempfile::TempDir,
    record: Recorder,
}

impl Bench {
    fn new() -> Self {
        Self {
            folder: tempfile::tempdir().unwrap(),
            record: Recorder::default(),
        }
    }

    fn keeper(&self) -> RunningTrial {
        RunningTrial::open(self.folder.path(), "trial", Duration::ZERO, Arc::default())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join("running").join(name)
    }

    /// Records a row and saves with the agent at `count`.
    fn save(&mut self, keeper: &mut RunningTrial, count: u64) {
        self.record.add(Phase::Train, count, 0, 0, "loss", count as f64);
        self.record.mean("mean", f64::INFINITY);
        keeper
            .save(json!({ "step": count }), &Counter(count), &mut self.record)
            .unwrap();
    }

    /// State from which a new process continues: the protocol's state, the agent and the number of rows.
    fn load(&self) -> Option<(Value, u64, usize)> {
        let (mut agent, mut record) = (Counter(0), Recorder::default());
        let state = self.keeper().load(&mut agent, &mut record).unwrap();
        state.map(|state| (state, agent.0, record.rows().len()))
    }

    /// Takes a copy of a checkpoint, which is removed by the next save.
    fn set_aside(&self, name: &str) -> PathBuf {
        let copy = self.folder.path().join(name);
        fs::create_dir_all(copy.join("agent")).unwrap();
        for file in ["manifest.json", "state.json", "agent/count"] {
            fs::copy(self.path(name).join(file), copy.join(file)).unwrap();
        }
        copy
    }
}

#[test]
fn a_fresh_process_continues_from_the_newest() {
    let mut bench = Bench::new();
    assert_eq!(bench.load(), None);
    let mut keeper = bench.keeper();
    bench.save(&mut keeper, 1);
    bench.save(&mut keeper, 2);
    assert_eq!(bench.load(), Some((json!({ "step": 2 }), 2, 2)));
    assert_eq!(
        names(&bench.path("")).unwrap().into_iter().collect::<Vec<_>>(),
        ["checkpoint-2", "metrics.log"]
    );
    let (mut agent, mut record) = (Counter(0), Recorder::default());
    let mut keeper = bench.keeper();
    keeper.load(&mut agent, &mut record).unwrap();
    assert_eq!(record.running(), bench.record.running());
    bench.save(&mut keeper, 3);
    assert_eq!(bench.load(), Some((json!({ "step": 3 }), 3, 3)));
    RunningTrial::discard(bench.folder.path()).unwrap();
    assert_eq!(bench.load(), None);
    RunningTrial::discard(bench.folder.path()).unwrap();
}

#[test]
fn what_is_not_whole_is_passed_over() {
    for file in ["manifest.json", "state.json", "agent/count"] {
        for damage in [
            |path: &Path| fs::remove_file(path).unwrap(),
            |path: &Path| fs::write(path, "7").unwrap(),
        ] {
            let mut bench = Bench::new();
            let mut keeper = bench.keeper();
            bench.save(&mut keeper, 1);
            let older = bench.set_aside("checkpoint-1");
            bench.save(&mut keeper, 2);
            fs::rename(older, bench.path("checkpoint-1")).unwrap();
            assert_eq!(bench.load().unwrap().1, 2);
            damage(&bench.path("checkpoint-2").join(file));
            assert_eq!(
                bench.load(),
                Some((json!({ "step": 1 }), 1, 1)),
                "{file}: the older one"
            );
            damage(&bench.path("checkpoint-1").join(file));
            assert_eq!(bench.load(), None, "{file}: none is left");
            let mut keeper = bench.keeper();
            keeper.load(&mut Counter(0), &mut Recorder::default()).unwrap();
            bench.record = Recorder::default();
            bench.save(&mut keeper, 5);
            assert_eq!(
                bench.load(),
                Some((json!({ "step": 5 }), 5, 1)),
                "{file}: a fresh start"
            );
            assert_eq!(names(&bench.path("")).unwrap().len(), 2);
        }
    }
}

#[test]
fn a_checkpoint_without_its_rows_or_of_another_trial_is_passed_over() {
    let mut bench = Bench::new();
    let mut keeper = bench.keeper();
    bench.save(&mut keeper, 1);
    let mut other = RunningTrial::open(bench.folder.path(), "other", Duration::ZERO, Arc::default());
    assert_eq!(
        other.load(&mut Counter(0), &mut Recorder::default()).unwrap(),
        None
    );
    let mut log = fs::read(bench.path("metrics.log")).unwrap();
    log.push(0);
    fs::write(bench.path("metrics.log"), &log).unwrap();
    assert!(bench.load().is_some(), "a torn end is cut off");
    log[30] ^= 1;
    fs::write(bench.path("metrics.log"), &log).unwrap();
    assert_eq!(bench.load(), None);
}

#[test]
fn what_a_killed_process_left_unfinished_is_no_checkpoint() {
    let mut bench = Bench::new();
    fs::create_dir_all(bench.path(".checkpoint-1.0/agent")).unwrap();
    assert_eq!(bench.load(), None);
    let mut keeper = bench.keeper();
    bench.save(&mut keeper, 1);
    assert_eq!(
        names(&bench.path("")).unwrap().into_iter().collect::<Vec<_>>(),
        ["checkpoint-1", "metrics.log"]
    );
}

#[test]
fn what_an_agent_does_not_take_is_not_offered_again() {
    let mut bench = Bench::new();
    let mut keeper = bench.keeper();
    bench.save(&mut keeper, 1);
    let older = bench.set_aside("checkpoint-1");
    struct UnreadableAgent;
    impl Agent for UnreadableAgent {
        fn act(&mut self, _: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
            Ok(Vec::new())
        }
        fn save(&self, dir: &Path) -> Result<(), Error> {
            fs::write(dir.join("count"), "no number").map_err(Error::file("write", dir))
        }
    }
    keeper
        .save(json!(2), &UnreadableAgent, &mut bench.record)
        .unwrap();
    fs::rename(older, bench.path("checkpoint-1")).unwrap();
    let (mut agent, mut record) = (Counter(0), Recorder::default());
    let mut keeper = bench.keeper();
    assert!(!keeper.refuse(), "nothing was taken up");
    assert!(matches!(
        keeper.load(&mut agent, &mut record),
        Err(Error::Checkpoint { .. })
    ));
    assert!(keeper.refuse());
    assert_eq!(
        keeper.load(&mut agent, &mut record).unwrap(),
        Some(json!({ "step": 1 }))
    );
    assert!(keeper.refuse());
    assert_eq!(keeper.load(&mut agent, &mut record).unwrap(), None);
}

#[test]
fn a_short_trial_leaves_nothing_on_disk() {
    let mut bench = Bench::new();
    let mut keeper = RunningTrial::open(
        bench.folder.path(),
        "trial",
        Duration::from_secs(60),
        Arc::default(),
    );
    assert_eq!(keeper.load(&mut Counter(0), &mut bench.record).unwrap(), None);
    bench.record.add(Phase::Train, 1, 0, 0, "loss", 1.0);
    assert!(!keeper.due() && !keeper.stopping());
    keeper.note(&bench.record).unwrap();
    assert!(!bench.path("").exists());
}

#[test]
fn a_request_to_stop_makes_a_save_due_and_old_rows_reach_the_log_alone() {
    let mut bench = Bench::new();
    let stop = Arc::new(AtomicBool::new(false));
    let mut keeper = RunningTrial::open(
        bench.folder.path(),
        "trial",
        Duration::from_secs(60),
        stop.clone(),
    );
    bench.record.add(Phase::Train, 1, 0, 0, "loss", 1.0);
    keeper.noted -= NOTE_EVERY;
    keeper.note(&bench.record).unwrap();
    assert_eq!(
        super::super::metric_log::read(&bench.path("metrics.log"))
            .unwrap()
            .table
            .rows,
        bench.record.rows()
    );
    assert!(!keeper.due());
    stop.store(true, Ordering::Relaxed);
    assert!(keeper.due() && keeper.stopping());
}

#[test]
fn what_earlier_processes_spent_is_counted() {
    let mut bench = Bench::new();
    let mut keeper = bench.keeper();
    keeper.earlier_s = 100.0;
    bench.save(&mut keeper, 1);
    let mut next = bench.keeper();
    assert!(next.wall_s() < 100.0, "nothing is taken up yet");
    next.load(&mut Counter(0), &mut Recorder::default()).unwrap();
    assert!(next.wall_s() >= 100.0);
}

#[test]
fn a_checkpoint_whose_rows_are_cut_off_is_a_fault_and_an_older_one_is_none() {
    let mut bench = Bench::new();
    let mut keeper = bench.keeper();
    bench.save(&mut keeper, 1);
    let older = bench.set_aside("checkpoint-1");
    let log = bench.path("metrics.log");
    let length = fs::metadata(&log).unwrap().len();
    bench.save(&mut keeper, 2);
    fs::rename(older, bench.path("checkpoint-1")).unwrap();
    let found = || faults(&bench.path(""), "trial").unwrap();
    assert_eq!(found(), []);
    fs::OpenOptions::new()
        .write(true)
        .open(&log)
        .unwrap()
        .set_len(length)
        .unwrap();
    let lacks = "`metrics.log` lacks rows that it goes on from";
    assert_eq!(found(), [("checkpoint-2".to_owned(), lacks)]);
    fs::remove_file(&log).unwrap();
    let both = ["checkpoint-1", "checkpoint-2"].map(|name| (name.to_owned(), lacks));
    assert_eq!(found(), both);
}
