//! Sources of imported runs.

/// The source of imported runs, to be named wherever they are shown.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Origin {
    /// Name in the study, as if it were an agent.
    pub name: String,
    /// Description of the runs, in a sentence.
    pub sentence: String,
    /// Their files as the study names them, with the SHA-256 of each.
    pub files: Vec<(String, String)>,
}
