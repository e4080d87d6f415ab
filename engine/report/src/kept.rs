//! Figures of an earlier report that are kept where their data are absent: their drawings lie in the folder, and the
//! record holds the facts on them.

use super::files;
use crate::Manifest;
use contract::Error;
use execution::world::fs;
use presentation::figure::{Chart, Shades, is_wide};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Endings of the files of a figure, in the order of links on pages.
pub(super) const ENDINGS: [&str; 4] = ["svg", "pdf", "png", "csv"];

/// Facts on a figure that a page needs besides the drawing and the study.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FigureFacts {
    /// A description for readers who cannot see the figure.
    pub words: String,
    /// Sentences under the figure.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Whether it is as wide as two columns of a paper.
    pub is_wide: bool,
    /// Colours on a dark page.
    pub shades: Shades,
}

impl FigureFacts {
    /// Facts on a chart.
    #[must_use]
    pub fn of(chart: &Chart) -> Self {
        Self {
            words: chart.in_words(),
            notes: chart.notes.clone(),
            is_wide: is_wide(chart),
            shades: Shades::of(chart),
        }
    }
}

/// A figure of an earlier report.
#[derive(Debug, Clone)]
pub struct KeptFigure {
    /// Facts on the figure.
    pub facts: FigureFacts,
    /// Its drawing, as SVG.
    pub svg: String,
    /// Endings of its files that exist.
    pub endings: Vec<&'static str>,
}

impl KeptFigure {
    /// The figure of this name in a folder; `None` where the report there drew none.
    ///
    /// # Errors
    /// [`Error::Record`] where the drawing does not have the hash of its report.
    pub fn read(
        folder: &Path,
        manifest: &Manifest,
        name: &str,
        facts: &FigureFacts,
    ) -> Result<Option<Self>, Error> {
        let file = format!("{}/{}", files::FIGURES, files::name(name, "svg"));
        if !manifest.names(&file) {
            return Ok(None);
        }
        let bytes = manifest.checked(folder, &file)?;
        let svg = String::from_utf8(bytes).map_err(|_| Error::Record {
            path: folder.join(&file),
            problem: "holds no text".into(),
        })?;
        let is_there = |ending: &&str| {
            let file = format!("{}/{}", files::FIGURES, files::name(name, ending));
            manifest.names(&file) && fs::is_file(&folder.join(file))
        };
        Ok(Some(Self {
            facts: facts.clone(),
            svg,
            endings: ENDINGS.into_iter().filter(is_there).collect(),
        }))
    }
}
