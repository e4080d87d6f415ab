//! Figures of an earlier report that stay where their data are not at hand: their drawings lie in the folder, and
//! a record tells the rest.

use super::files;
use crate::Manifest;
use contract::Error;
use execution::world::fs;
use presentation::figure::{Chart, Shades, is_wide};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The endings of the files of a figure, as pages name them.
pub(super) const ENDINGS: [&str; 4] = ["svg", "pdf", "png", "csv"];

/// The facts on a figure that a page needs besides its drawing and what the study says of it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FigureFacts {
    /// A description for those who cannot see it.
    pub words: String,
    /// Sentences under it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// True where it is as wide as two columns of a paper.
    pub is_wide: bool,
    /// The treatment of its colours on a dark page.
    pub shades: Shades,
}

impl FigureFacts {
    /// Those of a chart.
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

/// A figure that stays.
#[derive(Debug, Clone)]
pub struct KeptFigure {
    /// The facts on it.
    pub facts: FigureFacts,
    /// Its drawing.
    pub svg: String,
    /// The endings of its files, as far as there are some.
    pub endings: Vec<&'static str>,
}

impl KeptFigure {
    /// The figure of a name in a folder; `None` where its report drew none.
    ///
    /// # Errors
    /// [`Error::Record`] where the drawing is not as its report wrote it.
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
