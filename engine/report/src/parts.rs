//! The input of the renderers of a report.

use super::{contents::Contents, head::Line, provenance::Provenance, sheet::Sheet, study_info::StudyInfo};
use analysis::results::{Ran, Results};
use std::collections::BTreeMap;

/// What the renderers of the report read.
pub(super) struct Parts<'a> {
    pub(super) study: &'a StudyInfo,
    pub(super) results: &'a Results,
    pub(super) contents: &'a Contents,
    pub(super) provenance: &'a Provenance,
    /// SVG of each figure, by name.
    pub(super) drawings: &'a BTreeMap<String, String>,
    /// What the study came to.
    pub(super) sentence: Option<String>,
    /// Seeds and what was exploratory.
    pub(super) basis: String,
    /// The lines of its `answers`.
    pub(super) answered: Option<Sheet>,
    /// Every published value and claim with its verdict.
    pub(super) answers: Option<Sheet>,
    /// The counts at the head.
    pub(super) head: Vec<Line>,
    pub(super) claims: Option<Sheet>,
    pub(super) confirmed: Option<Sheet>,
    pub(super) budgets: Option<Sheet>,
    /// How the trials ended.
    pub(super) ran: Ran,
    /// The settings that differ, a table per plugin.
    pub(super) settings: Vec<Sheet>,
}
