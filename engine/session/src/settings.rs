//! Machine-level settings from `regimen.toml`: they can never reach a result.
//!
//! ```toml
//! store = "store"
//! bucket = "s3://lab/team"    # shares the store with machines that see another folder
//! workers = 2                 # cores for trials
//! gpus = 2                    # graphics cards for trials, or their names: ["0", "3"]
//! checkpoint_every_s = 60     # time between two checkpoints of a trial
//! lease_expiry_s = 30         # when leases of silent machines count as dead
//! executor = "local"          # or "slurm"
//! device = "processor"        # or "cuda": learners of many trials compute on a card at once
//!
//! [slurm]                     # options of an executor; every executor of `regimen list` has such a table
//! time = "4:00:00"
//!
//! [limits]                    # the tighter of these and the study's holds
//! wall_time_s = 3600
//! memory_mb = 4000
//! retries = 2
//!
//! [profile.big]               # chosen by --machine big or REGIMEN_MACHINE=big
//! workers = 16
//!
//! [profile.big.slurm]         # key by key over [slurm]
//! partition = "long"
//! ```

use crate::{Failure, MachineOptions};
use contract::Registry;
use document::reach;
use execution::{
    device::PROCESSOR,
    executor::{self, Executor, ExecutorKind, LOCAL},
    limits::Limits,
    store::{Bucket, LONGEST_EXPIRY, Store},
    world::fs,
};
use serde::Deserialize;
use serde_json::{Value, json};
use std::{
    collections::BTreeMap,
    num::NonZeroUsize,
    path::{Path, PathBuf},
    time::Duration,
};
use toml::{
    Spanned,
    de::{DeTable, DeValue, Deserializer, ValueDeserializer},
};

const FILE: &str = reach::PROJECT;

/// The settings of this machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Folder of the store.
    pub store: PathBuf,
    /// The bucket by which the store is shared with other machines, as `s3://bucket/prefix`.
    pub bucket: Option<String>,
    /// Worker processes.
    pub workers: usize,
    /// Graphics cards for trials, as `CUDA_VISIBLE_DEVICES` names them.
    pub gpus: Vec<String>,
    /// Time between two checkpoints of a trial.
    pub checkpoint_every: Duration,
    /// Leases of machines that are silent for this long count as dead.
    pub lease_expiry: Duration,
    /// Limits of this machine, which apply whatever the study says.
    pub limits: Limits,
    /// Name of the executor of missing trials.
    pub executor: String,
    /// Name of the device on which learners compute.
    pub device: String,
    /// The options of every executor, by its name.
    executors: Tables,
}

/// Options of executors by name; a missing key is null.
type Tables = BTreeMap<&'static str, Value>;

/// The keys outside the tables of executors, at the top or in a profile.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct ProfileTable {
    store: Option<PathBuf>,
    bucket: Option<String>,
    workers: Option<usize>,
    gpus: Option<Cards>,
    checkpoint_every_s: Option<f64>,
    lease_expiry_s: Option<f64>,
    limits: Option<Limits>,
    executor: Option<Spanned<String>>,
    device: Option<String>,
}

/// Graphics cards for trials.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(untagged, expecting = "a number of graphics cards, or a list of their names")]
enum Cards {
    /// The first cards of those visible to this process.
    Number(usize),
    /// Cards with these names.
    Names(Vec<String>),
}

impl Cards {
    /// The configured cards, restricted to those that this process may see.
    #[expect(
        clippy::disallowed_methods,
        reason = "a batch system says by a variable which cards a job has, and none reaches a result"
    )]
    fn visible(said: Option<Self>) -> Vec<String> {
        let seen = std::env::var("CUDA_VISIBLE_DEVICES").ok();
        Self::among(said, seen.as_deref(), || {
            fs::read_dir("/proc/driver/nvidia/gpus").map_or(0, Iterator::count)
        })
    }

    /// Like [`visible`](Self::visible): `seen` is the variable that lists the visible cards, and `installed` counts the
    /// cards of the machine.
    fn among(said: Option<Self>, seen: Option<&str>, installed: impl FnOnce() -> usize) -> Vec<String> {
        let numbered = |number: usize| (0..number).map(|card| card.to_string()).collect();
        let seen: Option<Vec<String>> = seen.map(|text| {
            let names = text.split(',').map(|name| name.trim().to_owned());
            // An invalid name hides all names after it, as in CUDA.
            names
                .take_while(|name| !["", "-1", "NoDevFiles"].contains(&name.as_str()))
                .collect()
        });
        match (said, seen) {
            (None, None) => numbered(installed()),
            (None, Some(seen)) => seen,
            (Some(Self::Number(number)), None) => numbered(number),
            (Some(Self::Number(number)), Some(mut seen)) => {
                seen.truncate(number);
                seen
            }
            (Some(Self::Names(names)), None) => names,
            (Some(Self::Names(names)), Some(seen)) => {
                names.into_iter().filter(|it| seen.contains(it)).collect()
            }
        }
    }
}

/// Refuses the name of an executor that runs no trials.
fn refuse_idle(executor: &Spanned<String>, kinds: &[ExecutorKind], text: &str) -> Result<(), Failure> {
    let names: Vec<&str> = kinds
        .iter()
        .filter(|kind| kind.runs())
        .map(|kind| kind.name)
        .collect();
    let name = executor.get_ref();
    if names.contains(&name.as_str()) {
        return Ok(());
    }
    let line = 1 + text[..executor.span().start].matches('\n').count();
    let known = names.iter().map(|name| format!("`{name}`"));
    let known = known.collect::<Vec<_>>().join(" or ");
    Err(wrong(&format!(
        "executor (line {line}): `{name}` runs no trials, expected {known}"
    )))
}

/// One level of the file: the top, or a profile.
#[derive(Debug, Clone, Default)]
struct Level {
    table: ProfileTable,
    executors: Tables,
}

impl Settings {
    /// Reads `regimen.toml` of the current folder, or of the nearest folder above that has one. A relative path of the
    /// store starts at the folder of the file.
    ///
    /// # Errors
    /// A mistake in the file.
    pub fn read(registry: &Registry, machine: &MachineOptions) -> Result<Self, Failure> {
        let here = std::env::current_dir().unwrap_or_default();
        let kinds = executor::all(registry);
        let mut folder = PathBuf::new();
        for _ in here.ancestors() {
            match fs::read_to_string(folder.join(FILE)) {
                Ok(text) => return combine(&text, &folder, machine, &kinds),
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => folder.push(".."),
                Err(error) => return Err(wrong(&format!("{}: {error}", folder.display()))),
            }
        }
        combine("", Path::new(""), machine, &kinds)
    }

    /// The store, with the bucket by which it is shared.
    ///
    /// # Errors
    /// A bucket whose address or keys are wrong.
    #[expect(
        clippy::disallowed_methods,
        reason = "keys of a service are in the environment, and reach no result"
    )]
    pub fn open(&self, registry: &Registry) -> Result<Store, Failure> {
        let bucket = self.bucket.as_deref();
        let bucket = bucket.map(|address| Bucket::at(address, registry, &|name| std::env::var(name).ok()));
        Ok(Store::at(&self.store).sharing(bucket.transpose()?))
    }

    /// An executor with its options; `tasks` replaces the maximum number of tasks at a time.
    pub(crate) fn executor(
        &self,
        kind: &ExecutorKind,
        tasks: Option<usize>,
    ) -> Result<Box<dyn Executor>, Failure> {
        let name = kind.name;
        let options = kind
            .options()
            .ok_or_else(|| wrong(&format!("`{name}` hands nothing over")))?;
        let mut values = self.executors.get(name).cloned().unwrap_or_else(|| json!({}));
        if let Some(tasks) = tasks.and_then(NonZeroUsize::new) {
            values[kind.key_of_jobs()] = tasks.get().into();
        }
        options
            .build(&values)
            .map_err(|error| wrong(&format!("[{name}] {error}")))
    }
}

fn combine(
    text: &str,
    folder: &Path,
    machine: &MachineOptions,
    kinds: &[ExecutorKind],
) -> Result<Settings, Failure> {
    let (top, mut profiles) = levels(text, kinds).map_err(|error| unreadable(error, text, kinds))?;
    // A mistake in a profile is an error whichever profile is chosen.
    let named = std::iter::once(&top).chain(profiles.values());
    let mut executors = named.filter_map(|level| level.table.executor.as_ref());
    executors.try_for_each(|name| refuse_idle(name, kinds, text))?;
    let profile = match &machine.machine {
        None => Level::default(),
        Some(name) => profiles.remove(name).ok_or_else(|| {
            let known = profiles.keys().cloned().collect::<Vec<_>>().join(", ");
            wrong(&format!("there is no [profile.{name}]; known: {known}"))
        })?,
    };
    let executors = overlay(top.executors, profile.executors);
    let (top, profile) = (top.table, profile.table);
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let checkpoint_every_s = profile
        .checkpoint_every_s
        .or(top.checkpoint_every_s)
        .unwrap_or(60.0);
    let lease_expiry_s = profile.lease_expiry_s.or(top.lease_expiry_s).unwrap_or(30.0);
    for limits in [&top.limits, &profile.limits].into_iter().flatten() {
        limits
            .check()
            .map_err(|error| wrong(&format!("[limits] {error}")))?;
    }
    let executor = profile.executor.or(top.executor);
    let settings = Settings {
        store: machine
            .store
            .clone()
            .or_else(|| profile.store.or(top.store).map(|store| folder.join(store)))
            .unwrap_or_else(|| "store".into()),
        bucket: machine.bucket.clone().or(profile.bucket).or(top.bucket),
        workers: some(profile.workers.or(top.workers), "workers")?.unwrap_or(cores),
        gpus: Cards::visible(profile.gpus.or(top.gpus)),
        checkpoint_every: seconds("checkpoint_every_s", checkpoint_every_s)?,
        lease_expiry: some_time("lease_expiry_s", lease_expiry_s)?,
        limits: profile.limits.or(top.limits).unwrap_or_default(),
        executor: executor.map_or_else(|| LOCAL.into(), Spanned::into_inner),
        device: profile.device.or(top.device).unwrap_or_else(|| PROCESSOR.into()),
        executors,
    };
    // Worker processes receive the path in JSON.
    if settings.store.to_str().is_none() {
        let store = settings.store.display();
        return Err(Failure::refusal(format!(
            "the store's path `{store}` is no UTF-8 text: name another folder"
        )));
    }
    // Invalid options of an executor are an error even if another executor runs the trials.
    for kind in kinds.iter().filter(|kind| kind.options().is_some()) {
        settings.executor(kind, None)?;
    }
    Ok(settings)
}

/// The failure for a text that does not parse as settings.
fn unreadable(mut error: toml::de::Error, text: &str, kinds: &[ExecutorKind]) -> Failure {
    error.set_input(Some(text));
    let tables = if error.message().starts_with("unknown field `trusted`") {
        TRUSTED.to_owned()
    } else if error.message().starts_with("unknown field") {
        known_tables(kinds)
    } else {
        String::new()
    };
    wrong(&format!("{error}{tables}"))
}

/// The message for trust in a project's own file.
const TRUSTED: &str = "a project cannot say that its own programs are trusted: `trusted = [\"/FOLDER\"]` belongs into your \
                       own file, `regimen/regimen.toml` in $XDG_CONFIG_HOME or ~/.config\n";

/// The tables that a file may have in addition to its keys.
fn known_tables(kinds: &[ExecutorKind]) -> String {
    let names = kinds
        .iter()
        .filter(|kind| kind.options().is_some())
        .map(|kind| kind.name);
    format!(
        "tables of executors are {}\n",
        names
            .map(|name| format!("[{name}]"))
            .collect::<Vec<_>>()
            .join(" and ")
    )
}

/// The top of the file, and its profiles by name.
fn levels(text: &str, kinds: &[ExecutorKind]) -> Result<(Level, BTreeMap<String, Level>), toml::de::Error> {
    let mut top = DeTable::parse(text)?;
    let profiles = top.get_mut().remove("profile");
    let mut named = BTreeMap::new();
    for (name, profile) in profiles.map_or_else(|| Ok(DeTable::new()), table)? {
        let span = profile.span();
        named.insert(
            name.into_inner().into_owned(),
            level(Spanned::new(span, table(profile)?), kinds)?,
        );
    }
    Ok((level(top, kinds)?, named))
}

/// A table that stands under a key.
fn table(value: Spanned<DeValue<'_>>) -> Result<DeTable<'_>, toml::de::Error> {
    match value.into_inner() {
        DeValue::Table(table) => Ok(table),
        other => Err(serde::de::Error::custom(format!(
            "`profile` holds tables by name, not a {}",
            other.type_str()
        ))),
    }
}

/// Reads the tables of executors in the form that each executor defines, then the remaining keys.
fn level(mut keys: Spanned<DeTable<'_>>, kinds: &[ExecutorKind]) -> Result<Level, toml::de::Error> {
    let mut executors = Tables::new();
    for kind in kinds {
        if let Some((options, table)) = kind.options().zip(keys.get_mut().remove(kind.name)) {
            executors.insert(kind.name, options.read(ValueDeserializer::from(table))?);
        }
    }
    Ok(Level {
        table: ProfileTable::deserialize(Deserializer::from(keys))?,
        executors,
    })
}

fn seconds(key: &str, value: f64) -> Result<Duration, Failure> {
    Duration::try_from_secs_f64(value)
        .map_err(|_| wrong(&format!("{key} = {value}: a time in seconds, at least 0")))
}

/// A time that is not zero.
fn some_time(key: &str, value: f64) -> Result<Duration, Failure> {
    match seconds(key, value)? {
        longer if longer > LONGEST_EXPIRY => {
            Err(wrong(&format!("{key} = {value}: a day (86400) is the most")))
        }
        Duration::ZERO => Err(wrong(&format!("{key} = {value}: a time in seconds, above 0"))),
        time => Ok(time),
    }
}

/// A number of processes that is not zero.
fn some(number: Option<usize>, key: &str) -> Result<Option<usize>, Failure> {
    match number {
        Some(0) => Err(wrong(&format!(
            "{key} = 0: write 1 or more, or leave it out for one per core"
        ))),
        number => Ok(number),
    }
}

/// The tables of a profile merged over those of the top, key by key.
fn overlay(mut below: Tables, above: Tables) -> Tables {
    for (name, values) in above {
        let given = values
            .as_object()
            .into_iter()
            .flatten()
            .filter(|(_, value)| !value.is_null());
        let given: Vec<_> = given.map(|(key, value)| (key.clone(), value.clone())).collect();
        match below.get_mut(name).and_then(Value::as_object_mut) {
            Some(table) => table.extend(given),
            None => drop(below.insert(name, values)),
        }
    }
    below
}

fn wrong(problem: &str) -> Failure {
    Failure::refusal(format!("{FILE}: {problem}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Exit;

    fn settings_of(text: &str, folder: &Path, machine: &MachineOptions) -> Result<Settings, Failure> {
        combine(text, folder, machine, &executor::all(&Registry::default()))
    }

    fn machine(machine: Option<&str>) -> MachineOptions {
        MachineOptions {
            machine: machine.map(Into::into),
            ..MachineOptions::default()
        }
    }

    #[test]
    fn a_profile_overrides_the_top() {
        let text = "store = \"a\"\nworkers = 2\n[limits]\nretries = 1\n[profile.big]\nworkers = 16\nlimits \
                    = { memory_mb = 5 }\n";
        let settings = settings_of(text, Path::new(""), &machine(Some("big")))
            .ok()
            .unwrap();
        assert_eq!((settings.store, settings.workers), (PathBuf::from("a"), 16));
        assert_eq!(
            settings.limits,
            Limits {
                memory_mb: Some(5),
                ..Limits::default()
            }
        );
        assert_eq!(settings.checkpoint_every, Duration::from_secs(60));
    }

    #[test]
    fn cards_are_those_that_are_said_of_those_that_are_seen() {
        let names = |names: &[&str]| names.iter().map(ToString::to_string).collect::<Vec<_>>();
        let of = |said: Option<&str>, seen: Option<&str>| {
            let table: ProfileTable = toml::from_str(said.unwrap_or_default()).unwrap();
            Cards::among(table.gpus, seen, || 3)
        };
        assert_eq!(of(None, None), names(&["0", "1", "2"]));
        assert_eq!(of(None, Some("4,GPU-5")), names(&["4", "GPU-5"]));
        assert_eq!(of(None, Some("")), names(&[]));
        assert_eq!(of(None, Some("1,-1,2")), names(&["1"]));
        assert_eq!(of(Some("gpus = 2"), None), names(&["0", "1"]));
        assert_eq!(of(Some("gpus = 2"), Some("7")), names(&["7"]));
        assert_eq!(of(Some("gpus = [\"0\", \"7\"]"), Some("7,8")), names(&["7"]));
        let wrong = settings_of("gpus = \"all\"", Path::new(""), &machine(None))
            .err()
            .unwrap()
            .text;
        assert!(wrong.contains("a number of graphics cards"), "{wrong}");
    }

    #[test]
    fn an_executors_table_is_laid_over_key_by_key() {
        let text = "executor = \"slurm\"\n[slurm]\npartition = \"short\"\nmemory_mb = 2000\n\
                    [profile.big.slurm]\npartition = \"long\"\nmax_tasks = 8\n[kubernetes]\nimage = \"a\"\n";
        let settings = settings_of(text, Path::new(""), &machine(Some("big")))
            .ok()
            .unwrap();
        assert_eq!(settings.executor, "slurm");
        let slurm = |settings: &Settings, tasks| {
            let kind = executor::find(&Registry::default(), "slurm").unwrap();
            let options = settings
                .executor(&kind, tasks)
                .ok()
                .unwrap()
                .queue()
                .unwrap()
                .options();
            ["partition", "memory_mb", "max_tasks", "time"].map(|key| options[key].clone())
        };
        assert_eq!(
            slurm(&settings, None),
            ["long".into(), 2000.into(), 8.into(), Value::Null]
        );
        assert_eq!(slurm(&settings, Some(3))[2], 3);
        assert_eq!(settings.executors["kubernetes"]["image"], "a");
        assert_eq!(
            slurm(
                &settings_of(text, Path::new(""), &machine(None)).ok().unwrap(),
                None
            )[0],
            "short"
        );
    }

    #[test]
    fn the_most_tasks_at_a_time_can_be_given_where_no_table_is() {
        let settings = settings_of("", Path::new(""), &machine(None)).ok().unwrap();
        let slurm = settings
            .executor(&executor::find(&Registry::default(), "slurm").unwrap(), Some(3))
            .ok()
            .unwrap();
        assert_eq!(slurm.queue().unwrap().max_tasks(), 3);
    }

    #[test]
    fn mistakes_in_an_executors_table_name_file_and_key() {
        let text = |text: &str| {
            settings_of(text, Path::new(""), &machine(None))
                .err()
                .unwrap()
                .text
        };
        let unknown = text("[slurm]\npartion = \"long\"\n");
        assert!(
            unknown.contains("regimen.toml") && unknown.contains("partion") && unknown.contains("line 2"),
            "{unknown}"
        );
        assert!(text("[slurm]\nmax_tasks = 0\n").contains("max_tasks"));
        assert!(text("[slurm]\ntime = \"soon\"\n").contains("regimen.toml: [slurm] `time`: `soon`"));
        let written = text("executor = \"kubernetes\"\n");
        assert!(
            written.contains("`local` or `ssh` or `slurm` or `hyperqueue`") && written.contains("line 1"),
            "{written}"
        );
        let unchosen = text("executor = \"local\"\n[profile.big]\nexecutor = \"nomad\"\n");
        assert!(
            unchosen.contains("line 3") && unchosen.contains("`nomad` runs no trials"),
            "{unchosen}"
        );
        assert!(text("[profile.big.kubernetes]\nimages = 1\n").contains("images"));
        assert!(
            text("[slrum]\ntime = \"1\"\n")
                .contains("tables of executors are [ssh] and [slurm] and [hyperqueue] and [kubernetes]")
        );
        assert!(text("profile = 1\n").contains("`profile` holds tables"));
    }

    #[test]
    fn limits_that_limit_nothing_or_everything_are_refused_at_the_top_and_in_a_profile() {
        for (key, value) in [
            ("wall_time_s", "-1.0"),
            ("wall_time_s", "nan"),
            ("wall_time_s", "inf"),
            ("memory_mb", "0"),
            ("retries", "101"),
            ("retry_delay_s", "-inf"),
            ("retry_on", "[\"ok\"]"),
        ] {
            for (text, name) in [
                (format!("[limits]\n{key} = {value}\n"), None),
                (format!("[profile.big.limits]\n{key} = {value}\n"), Some("big")),
            ] {
                let told = settings_of(&text, Path::new(""), &machine(name)).err().unwrap();
                let expected = format!("regimen.toml: [limits] `{key}` is ");
                assert!(told.text.contains(&expected), "{}", told.text);
                assert_eq!(told.exit, Exit::BadStudy);
            }
        }
        let told = settings_of("lease_expiry_s = 0\n", Path::new(""), &machine(None))
            .err()
            .unwrap();
        assert!(
            told.text
                .contains("lease_expiry_s = 0: a time in seconds, above 0")
        );
    }

    #[test]
    fn unknown_keys_profiles_and_times_are_refused() {
        assert!(
            settings_of("wrokers = 2\n", Path::new(""), &machine(None))
                .err()
                .unwrap()
                .text
                .contains("wrokers")
        );
        assert!(
            settings_of("", Path::new(""), &machine(Some("big")))
                .err()
                .unwrap()
                .text
                .contains("[profile.big]")
        );
        assert!(
            settings_of("checkpoint_every_s = -1\n", Path::new(""), &machine(None))
                .err()
                .unwrap()
                .text
                .contains("checkpoint_every_s")
        );
        assert!(
            settings_of("[limits]\nwall_time = 1\n", Path::new(""), &machine(None))
                .err()
                .unwrap()
                .text
                .contains("wall_time")
        );
    }
}
