//! Workers as a Kubernetes Indexed Job: the manifest, and nothing else.
//!
//! The manifest is checked against the schema of `batch/v1` and was not tried on a cluster. Every index is a worker that pulls
//! missing trials from the store, which lies on a volume that all pods share.
//!
//! | a worker leaves with | what the Job does |
//! |---|---|
//! | 0: nothing is left to do | the index is complete |
//! | 2: the spec is wrong, 100: trials failed | the index has failed; a second try would end the same |
//! | 106: handed back early, or killed | another try of the index, up to `retries` |
//! | its pod is disrupted (drain, preemption) | another try that is not counted |

use super::{Error, tasks_for};
use serde::{Deserialize, Serialize};
use std::{
    fmt::Write,
    num::{NonZeroU32, NonZeroUsize},
};

/// The table `[kubernetes]` in `regimen.toml`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// Container image with the program; needed.
    pub image: Option<String>,
    /// The program inside the image; `regimen`.
    pub program: Option<String>,
    /// Namespace; the current one of `kubectl`.
    pub namespace: Option<String>,
    /// PersistentVolumeClaim (`ReadWriteMany`) with the store and the studies; needed.
    pub claim: Option<String>,
    /// Where the claim is mounted, and the folder that workers run in; `/work`.
    pub folder: Option<String>,
    /// Cores of a worker, each with a worker process; 1.
    pub cpus_per_task: Option<NonZeroUsize>,
    /// Memory of a worker in megabytes; no limit.
    pub memory_mb: Option<NonZeroU32>,
    /// Pods that may run at a time; 100.
    pub max_tasks: Option<NonZeroUsize>,
    /// How many missing trials are worth a pod; 4 for each of its cores.
    pub trials_per_task: Option<NonZeroUsize>,
    /// Tries of an index after the first; 6.
    pub retries: Option<u32>,
    /// Seconds that a pod has to hand back what it has when it is told to leave; 120.
    pub grace_s: Option<u32>,
}

/// What a manifest is made for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Workers {
    /// Name of the study, or names.
    pub study: String,
    /// Arguments of the program, with paths as they are inside the container.
    pub arguments: Vec<String>,
    /// Number of missing trials.
    pub trials: usize,
}

impl Options {
    /// Cores of a worker.
    #[must_use]
    pub fn cpus_per_task(&self) -> NonZeroUsize {
        self.cpus_per_task.unwrap_or(NonZeroUsize::MIN)
    }

    fn tasks(&self, trials: usize) -> usize {
        let per_task =
            self.trials_per_task.unwrap_or_else(|| self.cpus_per_task().saturating_mul(NonZeroUsize::MIN.saturating_add(3)));
        tasks_for(trials, per_task).max(1)
    }
}

/// The manifest of the Job, in YAML.
///
/// # Errors
/// [`Error::Option`] where the image or the claim is missing.
pub fn manifest(workers: &Workers, options: &Options) -> Result<String, Error> {
    let namespace = options.namespace.as_ref().map_or_else(String::new, |name| format!("\n  namespace: {}", text(name)));
    let completions = options.tasks(workers.trials);
    let head = format!(
        r#"# Workers of regimen that pull missing trials from the store. Not tried on a cluster; checked against the schema of batch/v1.
apiVersion: batch/v1
kind: Job
metadata:
  name: {name}{namespace}
  labels:
    app.kubernetes.io/name: regimen
    app.kubernetes.io/component: worker
spec:
  completionMode: Indexed
  completions: {completions}
  parallelism: {parallelism}
  backoffLimitPerIndex: {retries}
  maxFailedIndexes: {completions}
  podFailurePolicy:
    rules:
      # Trials failed or the spec is wrong: trying again would end the same.
      - action: FailIndex
        onExitCodes:
          containerName: worker
          operator: In
          values: [2, 100]
      # The pod was drained or preempted: this is not the worker's fault.
      - action: Ignore
        onPodConditions:
          - type: DisruptionTarget
            status: "True"
"#,
        name = job_name(&workers.study),
        parallelism = completions.min(options.max_tasks.map_or(100, NonZeroUsize::get)),
        retries = options.retries.unwrap_or(6),
    );
    Ok(head + &pod(workers, options)?)
}

/// The pod of one index: the worker, with the shared volume.
fn pod(workers: &Workers, options: &Options) -> Result<String, Error> {
    Ok(format!(
        r#"  template:
    metadata:
      labels:
        app.kubernetes.io/name: regimen
        app.kubernetes.io/component: worker
    spec:
      restartPolicy: Never
      terminationGracePeriodSeconds: {grace_s}
      containers:
        - name: worker
          image: {image}
          workingDir: {folder}
          command:
            - {program}
          args:{arguments}
          resources:{resources}
          volumeMounts:
            - name: work
              mountPath: {folder}
      volumes:
        - name: work
          persistentVolumeClaim:
            claimName: {claim}
"#,
        grace_s = options.grace_s.unwrap_or(120),
        image = needed("image", options.image.as_deref(), "name the container image that holds regimen")?,
        claim = needed("claim", options.claim.as_deref(), "name the PersistentVolumeClaim that holds the store")?,
        folder = text(options.folder.as_deref().unwrap_or("/work")),
        program = text(options.program.as_deref().unwrap_or("regimen")),
        arguments = arguments(workers),
        resources = resources(options),
    ))
}

fn arguments(workers: &Workers) -> String {
    workers.arguments.iter().fold(String::new(), |mut all, argument| {
        // `$(NAME)` would be replaced by a variable.
        let _ = write!(all, "\n            - {}", text(&argument.replace("$(", "$$(")));
        all
    })
}

fn needed(key: &'static str, value: Option<&str>, problem: &str) -> Result<String, Error> {
    value.filter(|value| !value.is_empty()).map(text).ok_or_else(|| Error::Option { key, problem: problem.into() })
}

/// Requests and limits are the same, so that a worker gets what it counts on.
fn resources(options: &Options) -> String {
    let memory = options.memory_mb.map_or_else(String::new, |memory_mb| format!("\n              memory: \"{memory_mb}M\""));
    let amounts = format!("\n              cpu: \"{}\"{memory}", options.cpus_per_task());
    format!("\n            requests:{amounts}\n            limits:{amounts}")
}

/// A name that Kubernetes takes: at most 52 characters, since pods append their index and a suffix.
fn job_name(study: &str) -> String {
    let plain: String =
        study.to_lowercase().chars().map(|letter| if letter.is_ascii_alphanumeric() { letter } else { '-' }).collect();
    let name = format!("regimen-{plain}");
    name.chars().take(52).collect::<String>().trim_end_matches('-').to_owned()
}

/// Any text as a YAML scalar: JSON strings are YAML.
fn text(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn workers(trials: usize) -> Workers {
        let arguments = ["worker", "experiments/table-3.3.yaml", "--set", "agent.note=$(HOSTNAME)", "--store", "store"];
        Workers { study: "table-3.3".into(), arguments: arguments.map(Into::into).to_vec(), trials }
    }

    fn options() -> Options {
        toml::from_str(
            "image = \"registry.example/regimen:1\"\nclaim = \"shared\"\nnamespace = \"rl\"\nmemory_mb = 4000\nmax_tasks = 2",
        )
        .unwrap()
    }

    #[test]
    fn a_manifest_is_an_indexed_job_of_workers() {
        insta::assert_snapshot!("manifest", manifest(&workers(35), &options()).unwrap());
    }

    #[test]
    fn what_only_a_person_knows_is_asked_for() {
        let problem = manifest(&workers(1), &Options::default()).unwrap_err().to_string();
        assert!(problem.starts_with("`image`: name the container image"), "{problem}");
        let problem = manifest(&workers(1), &Options { claim: None, ..options() }).unwrap_err().to_string();
        assert!(problem.starts_with("`claim`: name the PersistentVolumeClaim"), "{problem}");
    }

    #[test]
    fn names_fit_kubernetes() {
        assert_eq!(job_name("table-3.3"), "regimen-table-3-3");
        let long = job_name(&"A study_".repeat(20));
        assert!(long.len() <= 52 && !long.ends_with('-'), "{long}");
    }
}
