//! `selftest`: the same study computed in every way there is, and the digests of all trials compared.

use super::{Common, DIFFERS, Failure, OK, Selection, complain, say, study};
use crate::{
    Error, Registry,
    store::Store,
    trial::Trial,
    world::{
        clock, fs,
        process::{self, Child, Command, Stdio},
    },
};
use std::{collections::BTreeMap, os::unix::process::CommandExt, path::PathBuf, sync::Arc, time::Duration};

/// The name of the study inside the folder of the test.
const STUDY: &str = "selftest.yaml";
/// After so many kills the study may finish.
const KILLS: u32 = 8;

/// The options of the test.
#[derive(Debug, Clone, clap::Args)]
pub(super) struct SelftestOptions {
    /// Study to compute; a small one is built in.
    #[arg(value_name = "SPEC")]
    spec: Option<PathBuf>,
    /// Profile of the study.
    #[arg(long, short = 'P', value_name = "NAME")]
    profile: Option<String>,
    /// Folder to work in, which must be shared between the nodes for Slurm; a temporary one where absent.
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Compute it on Slurm too.
    #[arg(long)]
    slurm: bool,
}

/// Where the test works, and on what.
struct Bench {
    folder: PathBuf,
    trials: Vec<Arc<Trial>>,
    profile: Option<String>,
    /// The seeds of the first look, where looks are planned: which trials there are must not follow from
    /// results here.
    seeds: Option<u32>,
}

/// One way to compute the study: its name, and how often a trial was executed in it.
type Way = (&'static str, fn(&Bench, &str) -> Result<Executions, Error>);

/// How often trials were executed.
struct Executions {
    /// Ends of trials that programs said they computed.
    ended: usize,
    /// Ends that a killed program may have stored and not said.
    unsaid: usize,
}

/// 101 where two ways differ.
pub(super) fn selftest(
    registry: &Registry,
    embedded: &str,
    options: &SelftestOptions,
    common: &Common,
) -> Result<u8, Failure> {
    let bench = Bench::prepare(registry, embedded, options)?;
    let mut ways: Vec<Way> = vec![
        ("one worker", Bench::one_worker),
        ("two workers", Bench::two_workers),
        ("two programs at once", Bench::two_programs),
        ("killed and resumed", Bench::killed),
        ("three shards", Bench::shards),
    ];
    if options.slurm {
        ways.push(("Slurm", Bench::slurm));
    }
    let mut reference: Option<BTreeMap<String, String>> = None;
    let mut code = OK;
    let mut rows = Vec::new();
    for (number, (name, compute)) in ways.iter().enumerate() {
        complain(&format!("{name} ..."));
        let store = format!("store-{number}");
        let executions = compute(&bench, &store)?;
        let digests = bench.digests(&store)?;
        let equal =
            *reference.get_or_insert_with(|| digests.clone()) == digests && digests.len() == bench.distinct();
        let once =
            executions.ended <= bench.distinct() && executions.ended + executions.unsaid >= bench.distinct();
        if !equal || !once {
            code = DIFFERS;
        }
        rows.push((*name, digests.len(), executions.ended, equal, once));
    }
    show(&rows, bench.distinct(), common);
    if options.folder.is_none() {
        // Only temporary files are left behind where it fails.
        let _ = fs::remove_dir_all(&bench.folder);
    }
    Ok(code)
}

fn show(rows: &[(&str, usize, usize, bool, bool)], trials: usize, common: &Common) {
    if common.format == super::Format::Json {
        let rows: Vec<_> = rows
            .iter()
            .map(|(way, stored, executed, equal, once)| {
                serde_json::json!({"way": way, "stored": stored, "executed": executed, "equal": equal,
                    "executed_once": once})
            })
            .collect();
        return say(&serde_json::json!({"trials": trials, "ways": rows}).to_string());
    }
    let mut lines = vec![format!("{:<22} {:>7} {:>9}  digests", "", "stored", "executed")];
    for (way, stored, executed, equal, once) in rows {
        let verdict = match (equal, once) {
            (true, true) => "equal",
            (true, false) => "equal, but a trial ran again without need",
            (false, _) => "DIFFERENT",
        };
        lines.push(format!("{way:<22} {stored:>7} {executed:>9}  {verdict}"));
    }
    say(&lines.join("\n"));
}

impl Bench {
    fn prepare(registry: &Registry, embedded: &str, options: &SelftestOptions) -> Result<Self, Failure> {
        let temporary = || std::env::temp_dir().join(format!("regimen-selftest-{}", process::id()));
        let folder = options.folder.clone().unwrap_or_else(temporary);
        fs::create_dir_all(&folder).map_err(Error::file("create", &folder))?;
        let folder = fs::canonicalize(&folder).map_err(Error::file("find", &folder))?;
        let (text, profile) = match &options.spec {
            Some(path) => (
                fs::read_to_string(path).map_err(Error::file("read", path))?,
                options.profile.clone(),
            ),
            None => (
                embedded.to_owned(),
                Some(options.profile.clone().unwrap_or_else(|| "smoke".into())),
            ),
        };
        let path = folder.join(STUDY);
        fs::write(&path, text).map_err(Error::file("write", &path))?;
        // Often enough that a killed trial has something to continue from.
        let settings = folder.join("regimen.toml");
        let kept = if fs::exists(&settings) {
            fs::read_to_string(&settings).unwrap_or_default()
        } else {
            String::new()
        };
        if !kept.contains("checkpoint_every_s") {
            fs::write(&settings, format!("checkpoint_every_s = 0.02\n{kept}"))
                .map_err(Error::file("write", &settings))?;
        }
        let selection = Selection {
            specs: vec![path],
            profile: profile.clone(),
            sets: Vec::new(),
            seeds: None,
            only: Vec::new(),
        };
        let planned = study::load(registry, &selection, None)?;
        let seeds = planned
            .iter()
            .find_map(|one| one.study.design.as_ref()?.looks().first().copied());
        let trials: Vec<Arc<Trial>> = planned.into_iter().flat_map(|one| one.plan.trials).collect();
        Ok(Self {
            folder,
            trials,
            profile,
            seeds,
        })
    }

    /// Trials with an id of their own.
    fn distinct(&self) -> usize {
        self.trials
            .iter()
            .map(|trial| &trial.id)
            .collect::<std::collections::BTreeSet<_>>()
            .len()
    }

    fn digests(&self, store: &str) -> Result<BTreeMap<String, String>, Error> {
        let store = Store::at(self.folder.join(store));
        let mut digests = BTreeMap::new();
        for trial in &self.trials {
            if let Some(end) = store.end(&trial.id)? {
                digests.insert(trial.id.clone(), format!("{} {}", end.state.name(), end.digest));
            }
        }
        Ok(digests)
    }

    /// Starts the program in the folder, with what it says going to `log`.
    fn start(&self, arguments: &[&str], store: &str, log: &str) -> Result<Child, Error> {
        let broken = |source: std::io::Error| Error::Worker {
            problem: format!("cannot start the program: {source}"),
        };
        let path = self.folder.join(log);
        let file = fs::OpenOptions::new()
            .create(true)
            .append(true)
            .open(&path)
            .map_err(Error::file("write", &path))?;
        let mut command = Command::new(std::env::current_exe().map_err(broken)?);
        command
            .args(arguments)
            .args([STUDY, "--store", store])
            .current_dir(&self.folder)
            .process_group(0);
        if let Some(profile) = &self.profile {
            command.args(["--profile", profile]);
        }
        if let Some(seeds) = self.seeds {
            command.args(["--seeds", &seeds.to_string()]);
        }
        command
            .env_remove("REGIMEN_STORE")
            .env_remove("REGIMEN_JOBS")
            .env_remove("REGIMEN_MACHINE");
        command.stdout(Stdio::null()).stderr(file).spawn().map_err(broken)
    }

    /// Runs the program several times at once, to the end of all.
    fn together(&self, commands: &[&[&str]], store: &str) -> Result<Executions, Error> {
        let log = format!("{store}.log");
        let mut children = Vec::new();
        for arguments in commands {
            children.push(self.start(arguments, store, &log)?);
        }
        for mut child in children {
            child.wait().map_err(|source| Error::Worker {
                problem: source.to_string(),
            })?;
        }
        Ok(Executions {
            ended: self.ended(&log),
            unsaid: 0,
        })
    }

    /// Trials that the program says it has run to their end.
    fn ended(&self, log: &str) -> usize {
        let text = fs::read_to_string(self.folder.join(log)).unwrap_or_default();
        text.lines()
            .filter(|line| line.starts_with('[') && !line.contains("by another program"))
            .count()
    }

    fn one_worker(&self, store: &str) -> Result<Executions, Error> {
        self.together(&[&["worker", "-j", "1"]], store)
    }

    fn two_workers(&self, store: &str) -> Result<Executions, Error> {
        self.together(&[&["worker", "-j", "2"]], store)
    }

    fn two_programs(&self, store: &str) -> Result<Executions, Error> {
        let run = |out: &'static str| ["run", "--executor", "local", "-j", "1", "--out", out];
        self.together(&[&run("one"), &run("two")], store)
    }

    fn shards(&self, store: &str) -> Result<Executions, Error> {
        let shards = ["0/3", "1/3", "2/3"].map(|index| ["worker", "-j", "1", "--index", index]);
        self.together(&shards.each_ref().map(|arguments| &arguments[..]), store)
    }

    fn slurm(&self, store: &str) -> Result<Executions, Error> {
        let mut child = self.start(
            &["run", "--executor", "slurm", "--out", "slurm"],
            store,
            &format!("{store}.log"),
        )?;
        child.wait().map_err(|source| Error::Worker {
            problem: source.to_string(),
        })?;
        // The workers write their own logs; what they executed is what is stored.
        Ok(Executions {
            ended: self.digests(store)?.len(),
            unsaid: 0,
        })
    }

    /// Kills the whole program again and again, each time a little later, and then lets it finish.
    fn killed(&self, store: &str) -> Result<Executions, Error> {
        let log = format!("{store}.log");
        for kill in 1..=KILLS {
            let mut child = self.start(&["worker", "-j", "2"], store, &log)?;
            clock::sleep(Duration::from_millis(u64::from(kill) * 60));
            end_group(&mut child)?;
        }
        // A trial that was being computed when its program died runs again, but only its last execution ends.
        let finished = self.together(&[&["worker", "-j", "2"]], store)?;
        Ok(Executions {
            unsaid: 2 * KILLS as usize,
            ..finished
        })
    }
}

fn end_group(child: &mut Child) -> Result<(), Error> {
    let broken = |source: std::io::Error| Error::Worker {
        problem: format!("cannot end the program: {source}"),
    };
    let group = format!("-{}", child.id());
    Command::new("kill")
        .args(["-KILL", "--", &group])
        .stderr(Stdio::null())
        .status()
        .map_err(broken)?;
    child.wait().map(drop).map_err(broken)
}
