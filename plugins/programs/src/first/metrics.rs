//! Metrics in the files and output of a program: the keys and columns with values, the source of their steps,
//! and the one that is the return.

use super::probe::ProbeRun;
use crate::{
    ProgramConfig,
    config::{MetricSource, MetricText, StepText},
    metrics::Metrics,
    output::{LOG, STREAMS, noted},
    working_folder::{NOTES, WorkingFolder},
};
use contract::Error;
use imported::{SumOf, columns};
use std::path::{Path, PathBuf};

/// Columns with steps, in the order of preference.
const STEPS: [&str; 22] = [
    "global_step",
    "step",
    "steps",
    "_step",
    "total_timesteps",
    "time/total_timesteps",
    "timesteps",
    "num_timesteps",
    "timestep",
    "env_step",
    "env_steps",
    "total_steps",
    "num_env_steps",
    "frames",
    "iteration",
    "iterations",
    "iter",
    "update",
    "episode",
    "epoch",
    "batch",
    "t",
];
/// Most names per file or stream.
const MOST_NAMES: usize = 60;
/// Most files that are searched.
const MOST_FILES: usize = 50;
/// Depth of folders that are searched for logs.
const DEEPEST: usize = 6;

/// A metric that a program wrote.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundMetric {
    /// Key or column.
    pub key: String,
    /// Source of the values: a stream, or a pattern of files.
    pub from: String,
    /// Source of the steps.
    pub step: Option<StepText>,
    /// Values at their steps.
    pub values: Vec<(u64, f64)>,
}

/// A metric that a program wrote, and that no trial could read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RefusedMetric {
    /// Key or column.
    pub key: String,
    /// Source of the values: a stream, or a pattern of files.
    pub from: String,
    /// Rank by name, as of a metric that can be read.
    pub rank: usize,
    /// The reason, in words.
    pub problem: String,
}

/// A metric that can be read, or the reason why it cannot.
type ReadMetric = Result<FoundMetric, RefusedMetric>;

impl FoundMetric {
    /// The largest step.
    pub fn last_step(&self) -> u64 {
        self.values.iter().map(|(step, _)| *step).max().unwrap_or(0)
    }

    /// Whether lower values are better, judged by the name.
    pub fn lower_is_better(&self) -> bool {
        let key = self.key.to_lowercase();
        ["loss", "error", "cost", "regret", "perplexity"]
            .iter()
            .any(|word| key.contains(word))
    }

    /// Rank by name among candidates for the study's metric; 0 is the best.
    pub fn rank(&self) -> usize {
        rank(&self.key)
    }
}

/// Rank of a key by its name.
fn rank(key: &str) -> usize {
    const WORDS: [&str; 8] = [
        "return", "reward", "rew", "score", "success", "win", "acc", "loss",
    ];
    const OTHERS: [&str; 12] = [
        "std",
        "min",
        "max",
        "time",
        "fps",
        "sps",
        "learning_rate",
        "lr",
        "len",
        "length",
        "lengths",
        "seed",
    ];
    let key = key.to_lowercase();
    let words = || key.split(|it: char| !it.is_ascii_alphanumeric());
    if words().any(|word| OTHERS.contains(&word)) || key.contains("learning_rate") {
        return 2 * WORDS.len() + 2;
    }
    let place = WORDS.iter().position(|word| key.contains(word));
    let is_training = usize::from(!(key.contains("eval") || key.contains("test") || key.contains("val")));
    place.map_or(2 * WORDS.len() + 1, |place| 2 * place + is_training)
}

/// All metrics that a program wrote, the best candidates for the study's metric first, and those that no trial could
/// read, in the same order.
pub fn seen(
    place: &WorkingFolder,
    ran: &ProbeRun,
    sources: &[String],
) -> (Vec<FoundMetric>, Vec<RefusedMetric>) {
    let mut found = stream(place, LOG, ran);
    found.extend(stream(place, STREAMS[0], ran));
    for path in files(&place.folder, sources) {
        found.extend(file(place, &path));
    }
    found.extend(stream(place, STREAMS[1], ran));
    let (mut single, mut refused): (Vec<FoundMetric>, Vec<RefusedMetric>) = (Vec::new(), Vec::new());
    for seen in found {
        match seen {
            // Many programs write the same numbers into several files.
            Ok(seen) if single.iter().any(|other| other.key == seen.key) => {}
            Ok(seen) => single.push(seen),
            Err(seen) => refused.push(seen),
        }
    }
    refused.retain(|it| single.iter().all(|other| other.key != it.key));
    single.sort_by_key(FoundMetric::rank);
    refused.sort_by_key(|it| it.rank);
    (single, refused)
}

fn stream(place: &WorkingFolder, stream: &str, ran: &ProbeRun) -> Vec<ReadMetric> {
    let path = noted(&place.notes(), stream);
    if path.metadata().is_ok_and(|it| it.len() > 0) {
        // Lines without a step got a number; those of the log have one.
        let is_written = |name: &String| stream == LOG || ran.keys.contains(name);
        names(&path).map_or_else(Vec::new, |(names, _)| {
            let names: Vec<String> = names.into_iter().filter(is_written).collect();
            read(place, stream, &names, None)
        })
    } else {
        Vec::new()
    }
}

fn file(place: &WorkingFolder, path: &Path) -> Vec<ReadMetric> {
    let Some(pattern) = path.strip_prefix(&place.folder).ok().map(pattern) else {
        return Vec::new();
    };
    let Some((names, is_monitor)) = names(path) else {
        return Vec::new();
    };
    let sum = is_monitor.then(|| StepText::Sum(SumOf { sum: "l".into() }));
    read(place, &pattern, &names, sum)
}

/// Names of the columns, and whether the file is one of a monitor.
fn names(path: &Path) -> Option<(Vec<String>, bool)> {
    let mut found = columns(&[path.to_owned()]).ok()?;
    found.names.truncate(MOST_NAMES);
    Some((found.names, found.is_monitor))
}

/// The names that have values, each read in the same way as in a trial.
fn read(place: &WorkingFolder, from: &str, names: &[String], sum: Option<StepText>) -> Vec<ReadMetric> {
    let column = STEPS
        .iter()
        .find_map(|step| names.iter().find(|name| name.to_lowercase() == **step));
    let step = sum.or_else(|| column.map(|name| StepText::Column(name.clone())));
    let is_step = |name: &&String| STEPS.contains(&name.to_lowercase().as_str());
    let others = names.iter().filter(|name| !is_step(name) && !name.contains('*'));
    let source = MetricSource {
        from: from.to_owned(),
        step,
    };
    others.filter_map(|key| read_one(place, &source, key)).collect()
}

/// The problem without its remedies, which are those of imported files.
fn steps_alone(problem: &str) -> String {
    let problem = problem.split(": ").next().unwrap_or(problem);
    format!("is not in the order of its steps, as in a trial it has to be ({problem})")
}

/// A metric; `None` for a column without numbers.
fn read_one(place: &WorkingFolder, source: &MetricSource, key: &str) -> Option<ReadMetric> {
    let config = ProgramConfig {
        reads: source.clone(),
        metrics: [("x".to_owned(), MetricText::Key(key.to_owned()))].into(),
        ..ProgramConfig::default()
    };
    let mut metrics = Metrics::of(&config, &place.folder, &place.notes(), false);
    let values = match metrics.last(&[]) {
        Ok(curves) => Ok(curves.first()?.values.clone()),
        // A problem of a column is that it has no numbers.
        Err(Error::Input {
            column: None,
            problem,
            ..
        }) => Err(steps_alone(&problem)),
        Err(_) => return None,
    };
    let all_finite = |values: Vec<(u64, f64)>| match values.iter().find(|(_, value)| !value.is_finite()) {
        None => Ok(values),
        Some((step, value)) => Err(format!(
            "is {value} at step {step}, and a trial ends where its metric is no finite number"
        )),
    };
    let MetricSource { from, step } = source.clone();
    Some(match values.and_then(all_finite) {
        Ok(values) => Ok(FoundMetric {
            key: key.to_owned(),
            from,
            step,
            values,
        }),
        Err(problem) => Err(RefusedMetric {
            key: key.to_owned(),
            from,
            rank: rank(key),
            problem,
        }),
    })
}

/// Files that may hold metrics, without the program's sources.
fn files(folder: &Path, sources: &[String]) -> Vec<PathBuf> {
    let (mut found, mut open) = (Vec::new(), vec![(folder.to_owned(), 0)]);
    while let Some((place, depth)) = open.pop() {
        let Ok(names) = std::fs::read_dir(&place) else {
            continue;
        };
        for entry in names.flatten() {
            let (path, name) = (entry.path(), entry.file_name().to_string_lossy().into_owned());
            let is_source = path
                .strip_prefix(folder)
                .is_ok_and(|it| sources.iter().any(|name| Path::new(name) == it));
            if name.starts_with('.') || name == NOTES || is_source {
                continue;
            }
            match entry.file_type() {
                Ok(kind) if kind.is_dir() && depth < DEEPEST => open.push((path, depth + 1)),
                Ok(kind) if kind.is_file() && is_log(&name) => found.push(path),
                _ => {}
            }
        }
    }
    found.sort();
    found.truncate(MOST_FILES);
    found
}

fn is_log(name: &str) -> bool {
    const ENDS: [&str; 7] = [".csv", ".tsv", ".jsonl", ".ndjson", ".json", ".parquet", ".npz"];
    name.contains("tfevents") || ENDS.iter().any(|end| name.trim_end_matches(".gz").ends_with(end))
}

/// The path as a pattern, with stars for the parts that differ between runs.
fn pattern(path: &Path) -> String {
    let parts: Vec<&str> = path.iter().filter_map(|part| part.to_str()).collect();
    let last = parts.len().saturating_sub(1);
    let part = |(place, part): (usize, &&str)| match part {
        part if part.contains("tfevents") => "*tfevents*".to_owned(),
        part if place < last && part.contains(|it: char| it.is_ascii_digit()) => "*".to_owned(),
        part if place == last => without_digits(part),
        part => (*part).to_owned(),
    };
    parts.iter().enumerate().map(part).collect::<Vec<_>>().join("/")
}

/// A name with a star for every number.
fn without_digits(name: &str) -> String {
    let mut plain = String::new();
    for letter in name.chars() {
        let letter = if letter.is_ascii_digit() { '*' } else { letter };
        if letter != '*' || !plain.ends_with('*') {
            plain.push(letter);
        }
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn look(files: &[(&str, &str)], keys: &[&str]) -> Vec<FoundMetric> {
        look_at(files, keys).0
    }

    fn look_at(files: &[(&str, impl AsRef<[u8]>)], keys: &[&str]) -> (Vec<FoundMetric>, Vec<RefusedMetric>) {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        let place = WorkingFolder::at(folder.path(), &ProgramConfig::default());
        let keys = keys.iter().map(|it| (*it).to_owned()).collect();
        let ran = ProbeRun {
            has_ended: true,
            keys,
        };
        seen(&place, &ran, &["data.csv".into()])
    }

    fn shown(seen: &[FoundMetric]) -> Vec<(&str, &str, u64)> {
        seen.iter()
            .map(|it| (it.key.as_str(), it.from.as_str(), it.last_step()))
            .collect()
    }

    #[test]
    fn values_are_found_wherever_they_stand_and_the_return_comes_first() {
        let found = look(
            &[
                (
                    ".regimen/stdout.jsonl",
                    "{\"step\":1,\"loss\":\"2\",\"t\":\"5\"}\n{\"step\":2,\"loss\":\"1\",\"t\":\"9\"}\n",
                ),
                (
                    "runs/ppo__1__1790000000/progress.csv",
                    "timesteps,rollout/ep_rew_mean,fps\n10,1.5,3\n20,2.5,3\n",
                ),
                ("data.csv", "step,reward\n1,2\n"),
                (".hidden/a.csv", "step,reward\n1,2\n"),
                ("notes.txt", "step,reward\n1,2\n"),
                ("config.json", "{\"lr\": \"a\"}"),
            ],
            &["loss", "t"],
        );
        assert_eq!(
            shown(&found),
            [
                ("rollout/ep_rew_mean", "runs/*/progress.csv", 20),
                ("loss", "stdout", 9),
                ("fps", "runs/*/progress.csv", 20),
            ]
        );
        assert!(found[1].lower_is_better() && !found[0].lower_is_better());
    }

    #[test]
    fn lines_without_a_step_are_numbered_and_monitors_are_summed() {
        let found = look(
            &[
                (
                    ".regimen/stdout.jsonl",
                    "{\"step\":1,\"x\":\"2\"}\n{\"step\":2,\"x\":\"3\"}\n",
                ),
                (
                    "logs/0.monitor.csv",
                    "#{\"t_start\": 1.0, \"env_id\": \"a\"}\nr,l,t\n1.0,10,0.1\n2.0,5,0.2\n",
                ),
            ],
            &["x"],
        );
        assert!(shown(&found).contains(&("x", "stdout", 2)), "{found:?}");
        assert!(
            shown(&found).contains(&("r", "logs/*.monitor.csv", 15)),
            "{found:?}"
        );
    }

    /// The evaluation callback of Stable-Baselines3 writes no other file.
    #[test]
    fn arrays_are_found_and_so_are_lines_of_the_log() {
        let arrays = include_bytes!("../../../../engine/imported/src/fixtures/evaluations.npz");
        let (found, _) = look_at(&[("logs/evaluations.npz", arrays)], &[]);
        assert_eq!(
            shown(&found),
            [
                ("results", "logs/evaluations.npz", 3000),
                ("ep_lengths", "logs/evaluations.npz", 3000)
            ]
        );
        let log = "{\"step\":5,\"ret\":2.0}\n{\"step\":9,\"ret\":3.0}\n";
        let found = look(&[(".regimen/log.jsonl", log)], &[]);
        assert_eq!(shown(&found), [("ret", "log", 9)]);
    }

    #[test]
    fn a_metric_that_no_trial_could_read_has_its_reason() {
        let log = "step,return,loss,name\n1,5,1,a\n2,nan,2,b\n";
        let (found, refused) = look_at(&[("log.csv", log)], &[]);
        assert_eq!(shown(&found), [("loss", "log.csv", 2)]);
        let problem = refused.iter().find(|it| it.key == "return");
        let problem = problem.map_or("", |it| it.problem.as_str());
        assert!(problem.starts_with("is NaN at step 2"), "{refused:?}");
        let (found, refused) = look_at(&[("log.csv", "step,loss\n1,5\n2,4\n1,3\n2,2\n")], &[]);
        assert!(found.is_empty(), "{found:?}");
        assert!(refused[0].problem.contains("comes after step 2"), "{refused:?}");
    }

    #[test]
    fn numbers_in_paths_are_stars() {
        for (path, told) in [
            ("runs/a__1/events.out.tfevents.179.host.5.0", "runs/*/*tfevents*"),
            ("logs/progress.csv", "logs/progress.csv"),
            ("log_12.csv", "log_*.csv"),
        ] {
            assert_eq!(pattern(Path::new(path)), told);
        }
    }
}
