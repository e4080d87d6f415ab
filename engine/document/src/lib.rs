//! Texts and files that users write: YAML with the line and column of every key, checks against schemas, and messages
//! with positions in the text.

pub mod count;
pub mod diagnostic;
mod fitting;
pub mod input_file;
pub mod lookalikes;
pub mod plain_text;
pub mod reach;
pub mod schema_check;
mod tree;

pub use fitting::{Fitting, FittingEntries, FittingItems};
pub use tree::{
    DEEPEST, Entry, MOST_BYTES, MOST_MISTAKES, MOST_NODES, Node, NodeKind, Scalar, decode, parse, parse_from,
    plain_number,
};
