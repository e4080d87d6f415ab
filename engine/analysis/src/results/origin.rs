//! Where imported runs come from.

/// Where imported runs come from, to be said wherever they are shown.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Origin {
    /// Name in the study, where that of an agent would stand.
    pub name: String,
    /// What they are, in a sentence.
    pub sentence: String,
    /// Their files as the study names them, with the SHA-256 of each.
    pub files: Vec<(String, String)>,
}
