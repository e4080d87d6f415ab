//! What `sbatch` is given: how many arrays of which size, and the script of each.

use super::Options;
use crate::executor::{Array, Submission, quoted};

/// Divides `tasks` into job arrays of at most `max_array_size` tasks, of which `at_once` in all may run at a time.
///
/// Every array is allowed at least one running task, so there are at most `at_once` of them. Tasks beyond that are left out: a
/// worker pulls trials until none is left, and whoever follows submits again where that was not enough.
#[must_use]
pub fn divide(tasks: usize, max_array_size: usize, at_once: usize) -> Vec<Array> {
    let (largest, at_once) = (max_array_size.max(1), at_once.max(1));
    let arrays = tasks.div_ceil(largest).min(at_once);
    let tasks = tasks.min(arrays * largest);
    let share = |of: usize, position: usize| of / arrays + usize::from(position < of % arrays);
    (0..arrays)
        .map(|position| {
            let tasks = share(tasks, position);
            Array { tasks, at_once: share(at_once, position).min(tasks), job: None }
        })
        .collect()
}

/// The script of one array of a submission.
#[must_use]
pub fn render(submission: &Submission, array: usize) -> String {
    let Submission { options, work, .. } = submission;
    let mut lines = vec!["#!/usr/bin/env bash".to_owned()];
    lines.push(format!("# Submission {} of regimen: workers that pull missing trials from the store.", submission.id));
    lines.extend(directives(submission, array, options).into_iter().map(|directive| format!("#SBATCH {directive}")));
    lines.extend(options.setup.iter().flatten().cloned());
    // `exec` makes the worker the batch process itself: the early signal is sent to that one only.
    lines.push(format!("exec {}", work.command()));
    lines.join("\n") + "\n"
}

fn directives(submission: &Submission, array: usize, options: &Options) -> Vec<String> {
    let Array { tasks, at_once, .. } = submission.arrays[array];
    let log = submission.folder().join(format!("array-{array}-task-"));
    // `%a` is the task's index; any other percent sign of the path is doubled.
    let log = log.to_string_lossy().replace('%', "%%") + "%a.log";
    let mut all = vec![
        format!("--job-name={}", submission.job_name()),
        format!("--comment=regimen:{}:{array}", submission.id),
        format!("--array=0-{}%{at_once}", tasks - 1),
        format!("--chdir={}", in_double_quotes(&submission.work.folder.to_string_lossy())),
        format!("--output={}", in_double_quotes(&log)),
        "--open-mode=append".into(),
        "--requeue".into(),
        "--ntasks=1".into(),
        format!("--cpus-per-task={}", options.cpus_per_task()),
        format!("--signal=B:USR1@{}", options.signal_lead_s()),
    ];
    let given = [("partition", &options.partition), ("account", &options.account), ("time", &options.time)];
    all.extend(given.iter().filter_map(|(name, value)| Some(format!("--{name}={}", in_double_quotes(value.as_ref()?)))));
    all.extend(options.memory_mb.map(|memory_mb| format!("--mem={memory_mb}M")));
    all.extend(options.arguments.iter().flatten().map(|argument| in_double_quotes(argument)));
    all
}

/// A word as `sbatch` reads it behind `#SBATCH`: a shell's double quotes, without expansions.
fn in_double_quotes(word: &str) -> String {
    if quoted(word) == word { word.into() } else { format!("\"{}\"", word.replace('\\', r"\\").replace('"', "\\\"")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::executor::Work;
    use proptest::prelude::*;
    use std::path::Path;

    fn submission(options: &Options) -> Submission {
        let work = Work {
            specs: vec!["table.yaml".into()],
            program: "/opt/regimen/bin/regimen".into(),
            arguments: ["worker", "/shared/my studies/table.yaml", "--store", "/shared/store", "-j", "2"]
                .map(Into::into)
                .to_vec(),
            folder: "/shared/my studies".into(),
        };
        Submission::sample(Path::new("/shared/store"), &work, options, divide(12, 1001, 4))
    }

    #[test]
    fn a_script_says_who_it_is_and_becomes_the_worker() {
        let options: Options = toml::from_str(
            "partition = \"long\"\naccount = \"rl\"\ntime = \"4:00:00\"\ncpus_per_task = 2\nmemory_mb = 4000\n\
             arguments = [\"--qos=high\", \"--constraint=a b\"]\nsetup = [\"module load regimen\"]",
        )
        .unwrap();
        insta::assert_snapshot!("script", render(&submission(&options), 0));
    }

    #[test]
    fn a_script_needs_no_option() {
        insta::assert_snapshot!("script_without_options", render(&submission(&Options::default()), 0));
    }

    #[test]
    fn large_arrays_are_divided() {
        let sizes = |tasks, largest, at_once| -> Vec<(usize, usize)> {
            divide(tasks, largest, at_once).iter().map(|array| (array.tasks, array.at_once)).collect()
        };
        assert_eq!(sizes(5, 1001, 100), [(5, 5)]);
        assert_eq!(sizes(2500, 1001, 16), [(834, 6), (833, 5), (833, 5)]);
        assert_eq!(sizes(2500, 1001, 2), [(1001, 1), (1001, 1)]);
        assert_eq!(sizes(0, 1001, 2), []);
    }

    proptest! {
        #[test]
        fn no_array_is_empty_too_large_or_too_wide(tasks in 0usize..5000, largest in 1usize..2000, at_once in 1usize..300) {
            let arrays = divide(tasks, largest, at_once);
            prop_assert!(arrays.iter().all(|array| (1..=largest).contains(&array.tasks)));
            prop_assert!(arrays.iter().all(|array| (1..=array.tasks).contains(&array.at_once)));
            prop_assert!(arrays.iter().map(|array| array.at_once).sum::<usize>() <= at_once);
            let all: usize = arrays.iter().map(|array| array.tasks).sum();
            prop_assert!(all == tasks || arrays.len() == at_once);
        }
    }
}
