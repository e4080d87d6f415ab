//! Machine-level settings from `regimen.toml`: they can never reach a result.
//!
//! ```toml
//! store = "store"
//! workers = 2
//! checkpoint_every_s = 60     # time between two checkpoints of a trial
//! lease_expiry_s = 30         # when leases of silent machines count as dead
//! executor = "local"          # or "slurm"
//!
//! [slurm]                     # how workers are asked for; see executor::slurm::Options
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

use super::{BAD_SPEC, Common, Failure, submit::Executor};
use crate::{
    executor::{kubernetes, slurm},
    limits::Limits,
};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::{collections::BTreeMap, path::PathBuf, time::Duration};

const FILE: &str = "regimen.toml";

/// What holds on this machine.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Settings {
    /// Folder of the store.
    pub(super) store: PathBuf,
    /// Worker processes.
    pub(super) workers: usize,
    /// Time between two checkpoints of a trial.
    pub(super) checkpoint_every: Duration,
    /// Leases of machines that are silent for this long count as dead.
    pub(super) lease_expiry: Duration,
    /// Limits that hold here, whatever the study says.
    pub(super) limits: Limits,
    /// What runs the missing trials.
    pub(super) executor: Executor,
    /// How Slurm is asked for workers.
    pub(super) slurm: slurm::Options,
    /// How a Kubernetes Job is written.
    pub(super) kubernetes: kubernetes::Options,
}

#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Table {
    store: Option<PathBuf>,
    workers: Option<usize>,
    checkpoint_every_s: Option<f64>,
    lease_expiry_s: Option<f64>,
    limits: Option<Limits>,
    executor: Option<Executor>,
    slurm: slurm::Options,
    kubernetes: kubernetes::Options,
}

#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Document {
    store: Option<PathBuf>,
    workers: Option<usize>,
    checkpoint_every_s: Option<f64>,
    lease_expiry_s: Option<f64>,
    limits: Option<Limits>,
    executor: Option<Executor>,
    slurm: slurm::Options,
    kubernetes: kubernetes::Options,
    profile: BTreeMap<String, Table>,
}

/// Reads `regimen.toml` of the current folder, where there is one.
pub(super) fn read(common: &Common) -> Result<Settings, Failure> {
    let text = match std::fs::read_to_string(FILE) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
        Err(error) => return Err(wrong(&error.to_string())),
    };
    combine(&text, common)
}

fn combine(text: &str, common: &Common) -> Result<Settings, Failure> {
    let document: Document = toml::from_str(text).map_err(|error| wrong(&error.to_string()))?;
    let profile = match &common.machine {
        None => Table::default(),
        Some(name) => document.profile.get(name).cloned().ok_or_else(|| {
            let known = document.profile.keys().cloned().collect::<Vec<_>>().join(", ");
            wrong(&format!("there is no [profile.{name}]; known: {known}"))
        })?,
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let checkpoint_every_s = profile.checkpoint_every_s.or(document.checkpoint_every_s).unwrap_or(60.0);
    let lease_expiry_s = profile.lease_expiry_s.or(document.lease_expiry_s).unwrap_or(30.0);
    let slurm: slurm::Options = overlay(&document.slurm, &profile.slurm);
    slurm.check().map_err(|error| wrong(&format!("[slurm] {error}")))?;
    Ok(Settings {
        store: common.store.clone().or(profile.store).or(document.store).unwrap_or_else(|| "store".into()),
        workers: profile.workers.or(document.workers).unwrap_or(cores).max(1),
        checkpoint_every: seconds("checkpoint_every_s", checkpoint_every_s)?,
        lease_expiry: seconds("lease_expiry_s", lease_expiry_s)?,
        limits: profile.limits.or(document.limits).unwrap_or_default(),
        executor: profile.executor.or(document.executor).unwrap_or(Executor::Local),
        slurm,
        kubernetes: overlay(&document.kubernetes, &profile.kubernetes),
    })
}

fn seconds(key: &str, value: f64) -> Result<Duration, Failure> {
    Duration::try_from_secs_f64(value).map_err(|_| wrong(&format!("{key} = {value}: a time in seconds, at least 0")))
}

/// One table over another one, key by key; a key that is not given is null.
fn overlay<T: Serialize + DeserializeOwned + Clone>(below: &T, above: &T) -> T {
    let values = (serde_json::to_value(below), serde_json::to_value(above));
    let (Ok(serde_json::Value::Object(mut all)), Ok(serde_json::Value::Object(over))) = values else { return below.clone() };
    all.extend(over.into_iter().filter(|(_, value)| !value.is_null()));
    // Every value comes from a table of this type.
    serde_json::from_value(all.into()).unwrap_or_else(|_| below.clone())
}

fn wrong(problem: &str) -> Failure {
    Failure { code: BAD_SPEC, text: format!("error: {FILE}: {problem}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::Format;

    fn common(machine: Option<&str>) -> Common {
        Common { store: None, machine: machine.map(Into::into), format: Format::Text }
    }

    #[test]
    fn a_profile_overrides_the_top() {
        let text = "store = \"a\"\nworkers = 2\n[limits]\nretries = 1\n[profile.big]\nworkers = 16\nlimits = { memory_mb = 5 }\n";
        let settings = combine(text, &common(Some("big"))).ok().unwrap();
        assert_eq!((settings.store, settings.workers), (PathBuf::from("a"), 16));
        assert_eq!(settings.limits, Limits { memory_mb: Some(5), ..Limits::default() });
        assert_eq!(settings.checkpoint_every, Duration::from_secs(60));
    }

    #[test]
    fn an_executors_table_is_laid_over_key_by_key() {
        let text = "executor = \"slurm\"\n[slurm]\npartition = \"short\"\nmemory_mb = 2000\n\
                    [profile.big.slurm]\npartition = \"long\"\nmax_tasks = 8\n[kubernetes]\nimage = \"a\"\n";
        let settings = combine(text, &common(Some("big"))).ok().unwrap();
        assert_eq!(settings.executor, Executor::Slurm);
        let expected = "partition = \"long\"\nmemory_mb = 2000\nmax_tasks = 8\n";
        assert_eq!(settings.slurm, toml::from_str(expected).unwrap());
        assert_eq!(settings.kubernetes.image.as_deref(), Some("a"));
        assert_eq!(combine(text, &common(None)).ok().unwrap().slurm.partition.as_deref(), Some("short"));
    }

    #[test]
    fn mistakes_in_an_executors_table_name_file_and_key() {
        let text = |text: &str| combine(text, &common(None)).err().unwrap().text;
        let unknown = text("[slurm]\npartion = \"long\"\n");
        assert!(unknown.contains("regimen.toml") && unknown.contains("partion") && unknown.contains("line 2"), "{unknown}");
        assert!(text("[slurm]\nmax_tasks = 0\n").contains("max_tasks"));
        assert!(text("[slurm]\ntime = \"soon\"\n").contains("regimen.toml: [slurm] `time`: `soon`"));
        assert!(text("executor = \"kubernetes\"\n").contains("`local` or `slurm`"));
        assert!(text("[profile.big.kubernetes]\nimages = 1\n").contains("images"));
    }

    #[test]
    fn unknown_keys_profiles_and_times_are_refused() {
        assert!(combine("wrokers = 2\n", &common(None)).err().unwrap().text.contains("wrokers"));
        assert!(combine("", &common(Some("big"))).err().unwrap().text.contains("[profile.big]"));
        assert!(combine("checkpoint_every_s = -1\n", &common(None)).err().unwrap().text.contains("checkpoint_every_s"));
        assert!(combine("[limits]\nwall_time = 1\n", &common(None)).err().unwrap().text.contains("wall_time"));
    }
}
