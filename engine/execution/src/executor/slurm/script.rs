//! The script of each array, which `sbatch` reads.

use super::SlurmOptions;
use crate::executor::{Array, Submission, quoted};

/// The script of one array of a submission.
#[must_use]
pub fn render(submission: &Submission, array: usize, options: &SlurmOptions) -> String {
    let work = &submission.work;
    let mut lines = vec!["#!/usr/bin/env bash".to_owned()];
    lines.push(format!(
        "# Submission {} of regimen: workers that pull missing trials from the store.",
        submission.id
    ));
    lines.extend(
        directives(submission, array, options)
            .into_iter()
            .map(|directive| format!("#SBATCH {directive}")),
    );
    lines.extend(options.setup.iter().flatten().cloned());
    // `exec` makes the worker the batch process itself, which alone receives the early signal.
    lines.push(format!("exec {}", work.command()));
    lines.join("\n") + "\n"
}

fn directives(submission: &Submission, array: usize, options: &SlurmOptions) -> Vec<String> {
    let Array { tasks, at_once, .. } = submission.arrays[array];
    let log = submission.folder().join(format!("array-{array}-task-"));
    // `%a` is the task's index; any other percent sign of the path is doubled.
    let log = log.to_string_lossy().replace('%', "%%") + "%a.log";
    let mut all = vec![
        format!("--job-name={}", submission.job_name()),
        format!("--comment=regimen:{}:{array}", submission.id),
        format!("--array=0-{}%{at_once}", tasks - 1),
        format!(
            "--chdir={}",
            in_double_quotes(&submission.work.folder.to_string_lossy())
        ),
        format!("--output={}", in_double_quotes(&log)),
        "--open-mode=append".into(),
        "--requeue".into(),
        "--ntasks=1".into(),
        format!("--cpus-per-task={}", options.cpus_per_task()),
        format!("--signal=B:USR1@{}", options.signal_lead_s()),
    ];
    all.extend(options.gpus_per_task.map(|gpus| format!("--gres=gpu:{gpus}")));
    let given = [
        ("partition", &options.partition),
        ("account", &options.account),
        ("time", &options.time),
    ];
    all.extend(
        given
            .iter()
            .filter_map(|(name, value)| Some(format!("--{name}={}", in_double_quotes(value.as_ref()?)))),
    );
    all.extend(options.memory_mb.map(|memory_mb| format!("--mem={memory_mb}M")));
    all.extend(
        options
            .arguments
            .iter()
            .flatten()
            .map(|argument| in_double_quotes(argument)),
    );
    all
}

/// A word as `sbatch` reads it after `#SBATCH`: in a shell's double quotes, without expansions.
fn in_double_quotes(word: &str) -> String {
    if quoted(word) == word {
        word.into()
    } else {
        format!("\"{}\"", word.replace('\\', r"\\").replace('"', "\\\""))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::executor::{Work, slurm::Slurm};
    use std::path::Path;

    fn submission(options: &SlurmOptions) -> Submission {
        let work = Work {
            specs: vec!["table.yaml".into()],
            program: "/opt/regimen/bin/regimen".into(),
            arguments: [
                "worker",
                "/shared/my studies/table.yaml",
                "--store",
                "/shared/store",
                "-j",
                "2",
            ]
            .map(Into::into)
            .to_vec(),
            folder: "/shared/my studies".into(),
        };
        let slurm = Slurm {
            options: options.clone(),
        };
        Submission::sample(
            Path::new("/shared/store"),
            &work,
            &slurm,
            Array::divide(12, 1001, 4),
        )
    }

    #[test]
    fn a_script_says_who_it_is_and_becomes_the_worker() {
        let options: SlurmOptions = toml::from_str(
            "partition = \"long\"\naccount = \"rl\"\ntime = \"4:00:00\"\ncpus_per_task = 2\ngpus_per_task = 1\nmemory_mb = \
             4000\n\
             arguments = [\"--qos=high\", \"--constraint=a b\"]\nsetup = [\"module load regimen\"]",
        )
        .unwrap();
        insta::assert_snapshot!("script", render(&submission(&options), 0, &options));
    }

    #[test]
    fn a_script_needs_no_option() {
        let options = SlurmOptions::default();
        insta::assert_snapshot!(
            "script_without_options",
            render(&submission(&options), 0, &options)
        );
    }
}
