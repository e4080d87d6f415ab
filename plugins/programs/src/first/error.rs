//! Reasons why no study is made of a program or a sweep, each with a remedy.

use contract::Error;
use std::path::PathBuf;

/// The reason why no study is made.
#[derive(Debug, thiserror::Error)]
pub enum DraftRefusal {
    /// The command has no word.
    #[error(
        "`--from` names no program: write its command, as `--from \"python train.py --seed 1\"`, or the file of a sweep"
    )]
    Nothing,
    /// A quote of the command is not closed.
    #[error("`{0}` has a quote without an end")]
    OpenQuote(String),
    /// The command has a sign that only a shell understands.
    #[error(
        "`{sign}` in `{command}` is for a shell, and none reads the command of a study: write the lines into a script, \
         and name `sh SCRIPT`"
    )]
    Shell { command: String, sign: char },
    /// A named file does not exist.
    #[error("`{file}`, {what}, is not in this folder: `new` writes the study beside the program")]
    NotHere {
        file: String,
        /// The command or file that names it.
        what: String,
    },
    /// A file is neither a sweep of W&B nor a config of Hydra.
    #[error(
        "`{0}` is no sweep that is read: a sweep of W&B has `parameters` and `method`, and a config of Hydra has \
         `hydra.sweeper.params`, or is the `multirun.yaml` of a multirun"
    )]
    NoSweep(PathBuf),
    /// A file is not YAML.
    #[error("{0}")]
    NoYaml(String),
    /// A sweep lacks a part that a study needs.
    #[error("`{file}`: {problem}")]
    Sweep {
        file: PathBuf,
        /// The missing part, and the remedy.
        problem: String,
    },
    /// The program did not run.
    #[error(
        "{problem}\nIt ran in a folder of its own, in which these files lay: {files}; `--source FILE` adds one"
    )]
    Failed {
        /// End of the program, in words.
        problem: String,
        /// Files that lay in its folder.
        files: String,
    },
    /// The program wrote no metric that can be read.
    #[error(
        "`{program}` {how}, and wrote nothing that is read as a metric; {there}. Let it print lines of JSON, as \
         `{{\"step\": 100, \"return\": 1.5}}`, or words `return=1.5`, or write CSV, JSON lines or TensorBoard's event \
         files into the folder in which it runs; `--seconds` waits longer"
    )]
    NoMetric {
        /// First words of the command.
        program: String,
        /// Duration of the run, in words.
        how: String,
        /// Files that it wrote, in words.
        there: String,
    },
    /// The program wrote metrics, and none of them can be read as in a trial.
    #[error("`{program}` {how}, and none of its metrics can be read: `{key}` of `{from}` {problem}")]
    Unreadable {
        /// First words of the command.
        program: String,
        /// Duration of the run, in words.
        how: String,
        /// Key or column of the metric.
        key: String,
        /// A stream, or a pattern of files.
        from: String,
        /// The reason, in words.
        problem: String,
    },
    /// An error of the engine.
    #[error(transparent)]
    Engine(#[from] Error),
}
