//! Why no study is made of a program or a sweep, and what would be one.

use contract::Error;
use std::path::PathBuf;

/// Why no study is made.
#[derive(Debug, thiserror::Error)]
pub enum NoStudy {
    /// The command has no word.
    #[error(
        "`--from` names no program: write its command, as `--from \"python train.py --seed 1\"`, or the file of a sweep"
    )]
    Nothing,
    /// A quote of the command has no end.
    #[error("`{0}` has a quote without an end")]
    OpenQuote(String),
    /// Only a shell understands a sign of the command.
    #[error(
        "`{sign}` in `{command}` is for a shell, and none reads the command of a study: write the lines into a script, \
         and name `sh SCRIPT`"
    )]
    Shell {
        /// The command.
        command: String,
        /// The sign.
        sign: char,
    },
    /// A file that is named is not there.
    #[error("`{file}`, {what}, is not in this folder: `new` writes the study beside the program")]
    NotHere {
        /// The file.
        file: String,
        /// Who names it.
        what: String,
    },
    /// A file is neither a sweep of W&B nor a config of Hydra.
    #[error(
        "`{0}` is no sweep that is read: a sweep of W&B has `parameters` and `method`, and a config of Hydra has \
         `hydra.sweeper.params`, or is the `multirun.yaml` of a multirun"
    )]
    NoSweep(PathBuf),
    /// A file is no YAML.
    #[error("{0}")]
    NoYaml(String),
    /// A sweep lacks what a study needs.
    #[error("`{file}`: {problem}")]
    Sweep {
        /// The file.
        file: PathBuf,
        /// The lack, and the remedy.
        problem: String,
    },
    /// The program did not run.
    #[error(
        "{problem}\nIt ran in a folder of its own, in which these files lay: {files}; `--source FILE` adds one"
    )]
    Failed {
        /// How it ended.
        problem: String,
        /// Its sources.
        files: String,
    },
    /// Nothing that it wrote can be read as a metric.
    #[error(
        "`{program}` {how}, and wrote nothing that is read as a metric; {there}. Let it print lines of JSON, as \
         `{{\"step\": 100, \"return\": 1.5}}`, or words `return=1.5`, or write CSV, JSON lines or TensorBoard's event \
         files into the folder in which it runs; `--seconds` waits longer"
    )]
    NoMetric {
        /// Its first words.
        program: String,
        /// How long it ran.
        how: String,
        /// The files that were there.
        there: String,
    },
    /// The engine could not do its part.
    #[error(transparent)]
    Engine(#[from] Error),
}
