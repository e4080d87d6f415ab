//! Errors of the engine and of plugins, as one enum. Mistakes in a study are diagnostics instead.

use crate::ending::{Ending, signal_name};
use document::{plain_text, reach};
use std::{
    borrow::Cow,
    path::{Path, PathBuf},
    time::Duration,
};

/// An error of the engine or of a plugin.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read or written.
    #[error("cannot {doing} `{}`: {source}", path.display())]
    File {
        /// The action that failed, such as "read".
        doing: &'static str,
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A value of a plugin's config is wrong in a way that its schema cannot express.
    #[error("`{key}`: {problem}")]
    Config {
        /// The key inside the plugin's config, dotted.
        key: String,
        /// The mistake, and what to write instead.
        problem: String,
    },
    /// This machine lacks something that a plugin needs, or has another version of it. The config may be right.
    #[error("`{key}`: {problem}")]
    Unavailable {
        /// The key inside the plugin's config that names the missing thing, dotted.
        key: String,
        /// The missing thing, and instructions to get it.
        problem: String,
    },
    /// An agent cannot be used with an environment.
    #[error("agent `{agent}` cannot be used here: {problem}")]
    Mismatch {
        /// Name of the agent.
        agent: &'static str,
        /// The property that is missing.
        problem: String,
    },
    /// A data file changed after its content had become part of the trial's id.
    #[error(
        "the data file `{}` does not hold what this trial's id names; restore it and run with \
         --retry-failed, or run again as it \
         is: the changed content makes new trials",
        path.display()
    )]
    DataFileChanged {
        /// Path of the file.
        path: PathBuf,
    },
    /// A number that must be finite is not.
    #[error("{what} is not finite at step {step}: {value}")]
    NotFinite {
        /// Meaning of the number.
        what: String,
        /// Step of the trial.
        step: u64,
        /// The value that is not finite.
        value: f64,
    },
    /// An action lies outside its space.
    #[error("action outside its space: {problem}")]
    Action {
        /// The entry, its value and the limit.
        problem: String,
    },
    /// A step of an environment did not record each of the environment's metrics once.
    #[error("the environment recorded {recorded} at a step; its metrics are {declared}")]
    Recorded {
        /// Names that the step recorded, joined.
        recorded: String,
        /// Names that the environment declares, joined.
        declared: String,
    },
    /// A model's equations cannot be continued.
    #[error("{model}: {problem}")]
    Model {
        /// Name of the model.
        model: &'static str,
        /// The failure, with time and values.
        problem: String,
    },
    /// A checkpoint or snapshot does not fit.
    #[error("checkpoint of {what} does not fit: {problem}")]
    Checkpoint {
        /// Owner of the checkpoint.
        what: &'static str,
        /// The part that does not fit.
        problem: String,
    },
    /// An artifact that another trial left for this one cannot be used.
    #[error("what trial {trial} left cannot be used: {problem}")]
    Source {
        /// Id of the trial that leaves it.
        trial: String,
        /// The fault in the artifact.
        problem: String,
    },
    /// The policy that a trial left has no form that can be exported to other runtimes.
    #[error(
        "what trial {trial} of `{agent}` left as its policy acts on no observation in a form that is known here: {}",
        known.join(", ")
    )]
    NoPortablePolicy {
        /// Id of the trial.
        trial: String,
        /// Agent of this trial.
        agent: String,
        /// Names of the forms that are known.
        known: Vec<&'static str>,
    },
    /// A dataset was gathered in an environment whose seats have other observations or actions.
    #[error("the dataset was gathered in another environment: {what} is {found} there and {expected} here")]
    OtherInterface {
        /// The property that differs, such as "observed channel 3".
        what: String,
        /// Its value in the dataset.
        found: String,
        /// Its value in this environment.
        expected: String,
    },
    /// Designs cannot be proposed in an environment that does not have exactly one seat.
    #[error("a search proposes the designs of one seat; this environment has {seats} seats")]
    ManySeats {
        /// Number of seats of the environment.
        seats: usize,
    },
    /// A dataset cannot be made if some seats choose and others do not.
    #[error(
        "a dataset holds {what} of one kind; in this environment those of some seats are choices and those of others \
         are not"
    )]
    MixedSeats {
        /// The vectors of two kinds, such as "actions".
        what: &'static str,
    },
    /// A dataset cannot be made of an environment without seats.
    #[error("a dataset holds what seats saw and did; this environment has none")]
    NoSeats,
    /// A device on which learners compute cannot be used, or was lost while a trial ran; the trial is not at fault.
    #[error("{problem}")]
    Device {
        /// The problem, as a sentence without its full stop.
        problem: String,
    },
    /// A process that computes for the trial was ended from outside; the trial is not at fault.
    #[error("{what} was ended by signal {signal}")]
    Ended {
        /// Name of the process.
        what: &'static str,
        /// Number of the signal.
        signal: i32,
    },
    /// A program that trains an agent ended with an error of its own.
    #[error("`{program}` {}{}", ending(*how), last_words(said))]
    Program {
        /// First words of its command.
        program: String,
        /// Ending of the process.
        how: Ending,
        /// Its last lines on standard error.
        said: String,
    },
    /// A training gave no output for longer than the study allows.
    #[error("nothing was heard of it for the limit of {} s", limit.as_secs_f64())]
    Silent {
        /// Longest time without output that is allowed.
        limit: Duration,
    },
    /// A plugin panicked.
    #[error("it stopped with `{said}`, which is a mistake of its code")]
    Panicked {
        /// Message of the panic, and its place in the source code.
        said: String,
    },
    /// The trial stopped before its end on request; its state is saved.
    #[error("the trial was asked to stop; it continues from its checkpoint")]
    Stopped,
    /// A file from the user is not valid.
    #[error("`{}`{}: {}", path.display(), place(*line, column.as_deref()), said(path, problem))]
    Input {
        /// Path of the file.
        path: PathBuf,
        /// The line, from 1, if one is at fault.
        line: Option<u64>,
        /// The name of the column, if one is at fault.
        column: Option<String>,
        /// The mistake at this place.
        problem: String,
    },
    /// A bucket of object storage cannot be used.
    #[error("cannot {doing} `{address}`: {problem}")]
    Bucket {
        /// The action that failed, such as "list the trials in".
        doing: String,
        /// The bucket, as `s3://bucket/prefix`.
        address: String,
        /// Error of the service, or the missing setting.
        problem: String,
    },
    /// A stored file is damaged.
    #[error("`{}` is damaged: {}", path.display(), said(path, problem))]
    Damaged {
        /// Path of the file.
        path: PathBuf,
        /// The fault in its content.
        problem: String,
    },
    /// A stored file was written by a later version of the program; it is not changed.
    #[error("`{}` was written by a newer program ({problem}) and is left as it is: use that program", path.display())]
    Newer {
        /// Path of the file.
        path: PathBuf,
        /// The entry that shows the later version.
        problem: String,
    },
    /// A file in a folder of results differs from the one that its report wrote, so that no report can be made from it.
    #[error(
        "`{}` {problem}: take back the folder as it was committed (`git checkout`), or write it again from a store by \
         `regimen report` without `--recorded`",
        path.display()
    )]
    Record {
        /// Path of the file.
        path: PathBuf,
        /// The fault in its content.
        problem: String,
    },
    /// An environment returned a drawing that cannot be drawn.
    #[error(transparent)]
    Drawing(#[from] DrawingError),
    /// A table, figure or claim could not be made from the stored trials.
    #[error("{what}: {problem}")]
    Render {
        /// Name of the table, figure or claim.
        what: String,
        /// The missing thing.
        problem: String,
    },
    /// The store cannot be written: a full disk, or missing permissions.
    #[error("the store cannot be written: {problem}")]
    Store {
        /// The action, the path, and the error of the operating system.
        problem: String,
    },
    /// A worker process misbehaved.
    #[error("worker process: {problem}")]
    Worker {
        /// Description of the fault.
        problem: String,
    },
}

/// Reason why something cannot be drawn.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DrawingError {
    /// A graph has no node.
    #[error("the graph has no node")]
    NoNode,
    /// An edge leads from or to a node that does not exist.
    #[error("edge {edge} names node {node}, but the nodes are 0 to {last}", last = nodes - 1)]
    NoSuchNode {
        /// Number of the edge, from 0.
        edge: usize,
        /// Number of the missing node.
        node: usize,
        /// Number of nodes in the graph.
        nodes: usize,
    },
    /// An edge does not lead along the flow.
    #[error("edge {edge} leads from column {from} to column {to}, which is not along the flow")]
    AgainstTheFlow {
        /// Number of the edge, from 0.
        edge: usize,
        /// Column of the node where it begins.
        from: u32,
        /// Column of the node where it ends.
        to: u32,
    },
    /// Two nodes have the same place.
    #[error("nodes {one} and {other} both stand in column {column}, lane {lane}")]
    SamePlace {
        /// Number of a node, from 0.
        one: usize,
        /// Number of the other one.
        other: usize,
        /// Column of both.
        column: u32,
        /// Lane of both.
        lane: i32,
    },
    /// The number of pixels differs from the size.
    #[error("an image of {width} x {height} pixels has {expected} bytes, but {found} are given")]
    Pixels {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
        /// Number of bytes of an image of this size.
        expected: u64,
        /// Number of bytes of this image.
        found: usize,
    },
    /// An image is not square, or of another size than the first.
    #[error("image {number} has {width} x {height} pixels, but all must have {side} x {side}")]
    Size {
        /// Number of the image, from 0.
        number: usize,
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
        /// Side of all images: the first one's width.
        side: u32,
    },
    /// There is no image, or the images have no pixels.
    #[error("there is no pixel to draw")]
    NoPixel,
    /// There are more pixels than fit into one file.
    #[error("{images} images of {side} x {side} pixels are too many for one file")]
    TooMany {
        /// Number of images.
        images: usize,
        /// Side of each, in pixels.
        side: u32,
    },
    /// The encoder of the file refused the image.
    #[error("the images cannot be encoded: {problem}")]
    Encoder {
        /// Error of the encoder.
        problem: String,
    },
}

fn ending(how: Ending) -> String {
    match how {
        Ending::Code(code) => format!("left with exit code {code}"),
        Ending::Signal(signal) => format!("was ended by {}", signal_name(signal)),
    }
}

fn last_words(said: &str) -> String {
    if said.is_empty() {
        "; it said nothing on standard error".into()
    } else {
        format!("; it said last: {}", plain_text::last_words(said))
    }
}

/// A position inside a file, as in `, line 3, column `x``.
fn place(line: Option<u64>, column: Option<&str>) -> String {
    let line = line.map_or(String::new(), |line| format!(", line {line}"));
    line + &column.map_or(String::new(), |column| format!(", column `{column}`"))
}

/// A problem with a file, without quoting the content of a file outside the study's folder.
fn said<'a>(path: &Path, problem: &'a str) -> Cow<'a, str> {
    if reach::is_foreign(path) {
        Cow::Owned(reach::without_words(problem))
    } else {
        Cow::Borrowed(problem)
    }
}

impl Error {
    /// An error about a file, to be used with `map_err`.
    pub fn file(doing: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::File { doing, path, source }
    }

    /// The same error for a file of the store, for which the trial is not to blame.
    pub fn of_store(self) -> Self {
        match self {
            Self::File { .. } => Self::Store {
                problem: self.to_string(),
            },
            other => other,
        }
    }

    /// An error about one key of a plugin's config.
    pub fn config(key: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Config {
            key: key.into(),
            problem: problem.into(),
        }
    }
}
