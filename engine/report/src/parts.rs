//! The input of the renderers of a report.

use super::{
    contents::Contents, head::CountLine, provenance::Provenance, sheet::Sheet, study_info::StudyInfo,
};
use analysis::results::{Ran, Results};
use std::collections::BTreeMap;

/// Inputs of the renderers.
pub(super) struct Parts<'a> {
    pub(super) study: &'a StudyInfo,
    pub(super) results: &'a Results,
    pub(super) contents: &'a Contents,
    pub(super) provenance: &'a Provenance,
    /// SVG of each figure, by name.
    pub(super) drawings: &'a BTreeMap<String, String>,
    /// Summary of the study, in its own sentence.
    pub(super) sentence: Option<String>,
    /// Line on seeds and exploratory parts.
    pub(super) basis: String,
    /// The lines of its `answers`.
    pub(super) answered: Option<Sheet>,
    /// Every published value and claim with its verdict.
    pub(super) answers: Option<Sheet>,
    /// Counted words at the head of the report.
    pub(super) head: Vec<CountLine>,
    pub(super) claims: Option<Sheet>,
    pub(super) confirmed: Option<Sheet>,
    pub(super) budgets: Option<Sheet>,
    /// Ends of the trials.
    pub(super) ran: Ran,
    /// Differing settings, a table per plugin.
    pub(super) settings: Vec<Sheet>,
}
