//! Workers as a Kubernetes Indexed Job; only the manifest is written.
//!
//! The manifest is checked against the schema of `batch/v1` and was not tried on a cluster. Every index is a
//! worker that pulls missing trials from the store, which lies on a volume that all pods share.
//!
//! | exit of a worker | effect on the Job |
//! |---|---|
//! | 0: nothing is left to do | the index is complete |
//! | 2: the spec is wrong, 100: trials failed | the index has failed; a second try would end the same |
//! | 106: handed back early, or killed | another try of the index, up to `retries` |
//! | its pod is disrupted (drain, preemption) | another try that is not counted |

use super::{Error, Executor, ExecutorKind, Wanted, Way, four_each, kind, tasks_for};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{
    fmt::Write,
    num::{NonZeroU32, NonZeroUsize},
};

/// The table `[kubernetes]` in `regimen.toml`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table of options")]
pub struct KubernetesOptions {
    /// Container image with the program; needed.
    pub image: Option<String>,
    /// The program inside the image; `regimen`.
    pub program: Option<String>,
    /// Namespace; the current one of `kubectl`.
    pub namespace: Option<String>,
    /// PersistentVolumeClaim (`ReadWriteMany`) with the store and the studies; needed.
    pub claim: Option<String>,
    /// Mount path of the claim, and the folder in which workers run; `/work`.
    pub folder: Option<String>,
    /// Cores of a worker, each with a worker process; 1.
    pub cpus_per_task: Option<NonZeroUsize>,
    /// Memory of a worker in megabytes; no limit.
    pub memory_mb: Option<NonZeroU32>,
    /// Pods that may run at a time; 100.
    pub max_tasks: Option<NonZeroUsize>,
    /// Number of missing trials for each pod; 4 for each of its cores.
    pub trials_per_task: Option<NonZeroUsize>,
    /// Tries of an index after the first; 6.
    pub retries: Option<u32>,
    /// Seconds that a pod has to save its work when it is told to exit; 120.
    pub grace_s: Option<u32>,
}

/// Kubernetes, with the options of `[kubernetes]`.
#[derive(Debug, Clone, Default)]
pub struct Kubernetes {
    /// The table `[kubernetes]`.
    pub options: KubernetesOptions,
}

/// Entry of the executor in the list of executors.
#[must_use]
pub fn kind() -> ExecutorKind {
    let options =
        kind::ExecutorOptions::of(|options: KubernetesOptions| Ok(Box::new(Kubernetes { options })));
    let about = "workers in a Kubernetes Indexed Job, whose manifest is written and not applied";
    ExecutorKind {
        name: "kubernetes",
        title: "Kubernetes",
        about,
        way: Way::Written(options, "kubectl apply -f -"),
    }
}

impl Executor for Kubernetes {
    fn cpus_per_task(&self) -> NonZeroUsize {
        self.options.cpus_per_task.unwrap_or(NonZeroUsize::MIN)
    }

    fn trials_per_task(&self) -> NonZeroUsize {
        self.options
            .trials_per_task
            .unwrap_or_else(|| four_each(self.cpus_per_task()))
    }

    /// Paths are relative to the folder of the volume, not to this machine.
    fn shares_paths(&self) -> bool {
        false
    }

    /// The manifest of the Job, in YAML.
    fn written(&self, wanted: &Wanted<'_>) -> Result<String, Error> {
        let completions = tasks_for(wanted.trials, self.trials_per_task()).max(1);
        Ok(self.job(wanted, completions) + &self.pod(wanted)?)
    }
}

impl Kubernetes {
    fn job(&self, wanted: &Wanted<'_>, completions: usize) -> String {
        let options = &self.options;
        let namespace = options
            .namespace
            .as_ref()
            .map_or_else(String::new, |name| format!("\n  namespace: {}", text(name)));
        format!(
            r#"# Workers of regimen that pull missing trials from the store.
# Not tried on a cluster; checked against the schema of batch/v1.
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
            name = job_name(wanted.study),
            parallelism = completions.min(options.max_tasks.map_or(100, NonZeroUsize::get)),
            retries = options.retries.unwrap_or(6),
        )
    }

    /// The pod of one index: the worker, with the shared volume.
    fn pod(&self, wanted: &Wanted<'_>) -> Result<String, Error> {
        let options = &self.options;
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
            image = needed(
                "image",
                options.image.as_deref(),
                "name the container image that holds regimen"
            )?,
            claim = needed(
                "claim",
                options.claim.as_deref(),
                "name the PersistentVolumeClaim that holds the store"
            )?,
            folder = text(options.folder.as_deref().unwrap_or("/work")),
            program = text(options.program.as_deref().unwrap_or("regimen")),
            arguments = arguments(&wanted.work.arguments),
            resources = self.resources(),
        ))
    }

    /// Requests and limits are equal, so that a worker gets the resources that it expects.
    fn resources(&self) -> String {
        let memory = self.options.memory_mb;
        let memory = memory.map_or_else(String::new, |memory_mb| {
            format!("\n              memory: \"{memory_mb}M\"")
        });
        let amounts = format!("\n              cpu: \"{}\"{memory}", self.cpus_per_task());
        format!("\n            requests:{amounts}\n            limits:{amounts}")
    }
}

fn arguments(arguments: &[String]) -> String {
    arguments.iter().fold(String::new(), |mut all, argument| {
        // `$(NAME)` would be replaced by the value of a variable.
        let _ = write!(all, "\n            - {}", text(&argument.replace("$(", "$$(")));
        all
    })
}

fn needed(key: &'static str, value: Option<&str>, problem: &str) -> Result<String, Error> {
    value
        .filter(|value| !value.is_empty())
        .map(text)
        .ok_or_else(|| Error::Option {
            key,
            problem: problem.into(),
        })
}

/// A name that Kubernetes accepts: at most 52 characters, since pods append their index and a suffix.
fn job_name(study: &str) -> String {
    let plain: String = study
        .to_lowercase()
        .chars()
        .map(|letter| {
            if letter.is_ascii_alphanumeric() {
                letter
            } else {
                '-'
            }
        })
        .collect();
    let name = format!("regimen-{plain}");
    name.chars()
        .take(52)
        .collect::<String>()
        .trim_end_matches('-')
        .to_owned()
}

/// Any text as a YAML scalar: JSON strings are YAML.
fn text(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::executor::Work;
    use std::path::Path;

    fn manifest(trials: usize, options: KubernetesOptions) -> Result<String, Error> {
        let arguments = [
            "worker",
            "experiments/table-3.3.yaml",
            "--set",
            "agent.note=$(HOSTNAME)",
            "--store",
            "store",
        ];
        let work = Work {
            specs: Vec::new(),
            program: "/opt/regimen".into(),
            arguments: arguments.map(Into::into).to_vec(),
            folder: "/home".into(),
        };
        let wanted = Wanted {
            study: "table-3.3",
            store: Path::new("store"),
            work: &work,
            trials,
        };
        Kubernetes { options }.written(&wanted)
    }

    fn options() -> KubernetesOptions {
        toml::from_str(
            "image = \"registry.example/regimen:1\"\nclaim = \"shared\"\nnamespace = \"rl\"\nmemory_mb = \
             4000\nmax_tasks = 2",
        )
        .unwrap()
    }

    #[test]
    fn a_manifest_is_an_indexed_job_of_workers() {
        insta::assert_snapshot!("manifest", manifest(35, options()).unwrap());
    }

    #[test]
    fn what_only_a_person_knows_is_asked_for() {
        let problem = manifest(1, KubernetesOptions::default()).unwrap_err().to_string();
        assert!(
            problem.starts_with("`image`: name the container image"),
            "{problem}"
        );
        let problem = manifest(
            1,
            KubernetesOptions {
                claim: None,
                ..options()
            },
        )
        .unwrap_err()
        .to_string();
        assert!(
            problem.starts_with("`claim`: name the PersistentVolumeClaim"),
            "{problem}"
        );
    }

    #[test]
    fn names_fit_kubernetes() {
        assert_eq!(job_name("table-3.3"), "regimen-table-3-3");
        let long = job_name(&"A study_".repeat(20));
        assert!(long.len() <= 52 && !long.ends_with('-'), "{long}");
    }
}
