//! The report of a study: tables, figures and claims with the trials behind them, as files and as one self-contained
//! page.
//!
//! Everything is a function of the arguments: no clock, no random number and no version control is read here, so that
//! the same results give the same bytes.

mod answered;
mod answers;
mod basis;
mod budgets;
mod by_seed;
mod claim_line;
mod claim_settings;
mod claims;
mod collapses;
pub mod compare;
mod confirmations;
mod contents;
mod differences;
mod effort;
pub mod export;
mod families;
mod files;
mod floors;
mod head;
mod index;
mod interactive;
mod junit;
mod kept;
mod legend;
mod manifest;
mod markdown;
mod notes;
mod on_paper;
mod open;
mod outcome;
mod page;
mod parts;
mod passed;
mod period;
mod profiles;
mod provenance;
pub mod record;
mod rounds;
mod sentence;
mod sheet;
mod stages;
mod study_info;
mod summary;
#[cfg(test)]
mod tests;
mod verdicts;

pub use answered::{answers_as_markdown, counts_as_markdown, items_as_markdown};
pub use basis::basis;
pub use budgets::told;
pub use claim_line::{ClaimLine, UNREAD};
pub use confirmations::Round;
pub use contents::{Contents, Counts, Open};
pub use effort::Effort;
pub use families::{Family, families, families_as_markdown, take_together};
pub(crate) use files::slug as file_slug;
pub use index::{IndexEntry, index};
pub use junit::junit;
pub use kept::{FigureFacts, KeptFigure};
pub use manifest::{Manifest, Replaced};
pub use open::{Decided, OpenVerdict, open_as_markdown, still_open};
pub use outcome::{MISSING, Outcome, outcomes_as_json};
pub use passed::Passed;
pub use period::Period;
pub use profiles::{ProfileState, ProfileTrials};
pub use provenance::Provenance;
pub use rounds::RoundVerdict;
pub use sentence::sentence;
pub use stages::{Stage, Take};
pub use study_info::StudyInfo;
pub use summary::{summary, tinted};
pub use verdicts::{AnswerLine, Verdicts, Word};

use analysis::results::{Ran, Results};
use contract::Error;
use parts::Parts;
use presentation::{figure, table};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

/// Name of the profile for trying a study out; its trials are no results.
pub const REHEARSAL: &str = "smoke";

/// Paths of a written report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReportPaths {
    /// Path of `index.html`.
    pub page: PathBuf,
    /// Path of `report.md`.
    pub markdown: PathBuf,
    /// Files of tables, figures and verdicts.
    pub files: Vec<PathBuf>,
}

/// Writes `tables/`, `figures/`, `report.md`, `index.html` and `verdicts.json` into a folder. Each file appears
/// whole or not at all.
///
/// # Errors
/// [`Error::File`] where a file cannot be written. A table or figure that could not be made is no error here: the
/// report states the reason. A figure whose drawing is refused becomes one of these in `contents`.
pub fn write(
    dir: &Path,
    study: &StudyInfo,
    results: &Results,
    contents: &mut Contents,
    provenance: &Provenance,
) -> Result<ReportPaths, Error> {
    let mut files = write_tables(&dir.join(files::TABLES), contents)?;
    let drawings = write_figures(&dir.join(files::FIGURES), contents, &mut files)?;
    let contents = &*contents;
    let verdicts = Verdicts::of(study, results, contents);
    files.push(write_verdicts(dir, &verdicts)?);
    let parts = Parts {
        study,
        results,
        contents,
        provenance,
        drawings: &drawings,
        sentence: sentence(study, contents),
        basis: basis(study, results, contents),
        answered: answered::of_study(&verdicts),
        answers: answers::sheet(contents).filter(|_| !study.is_rehearsal),
        head: head::lines(study, contents),
        claims: claims::sheet(contents),
        confirmed: confirmations::sheet(contents),
        budgets: budgets::sheet(study, results),
        ran: Ran::of(results),
        settings: differences::sheets(study, results),
    };
    let (markdown, page) = (dir.join("report.md"), dir.join("index.html"));
    files::write(&markdown, markdown::report(&parts).as_bytes())?;
    files::write(&page, page::page(&parts).as_bytes())?;
    Ok(ReportPaths {
        page,
        markdown,
        files,
    })
}

fn write_verdicts(dir: &Path, verdicts: &Verdicts) -> Result<PathBuf, Error> {
    let path = dir.join("verdicts.json");
    let text = serde_json::to_string_pretty(verdicts)
        .map_err(std::io::Error::from)
        .map_err(Error::file("write", &path))?;
    files::write(&path, (text + "\n").as_bytes())?;
    Ok(path)
}

fn write_tables(dir: &Path, contents: &Contents) -> Result<Vec<PathBuf>, Error> {
    let mut files = Vec::new();
    for (name, grid) in &contents.tables {
        if let Ok(grid) = grid {
            files.extend(write_table(dir, name, grid)?);
        }
    }
    Ok(files)
}

fn write_table(dir: &Path, name: &str, grid: &table::Grid) -> Result<[PathBuf; 5], Error> {
    let texts = [
        table::markdown(grid),
        table::latex(grid, name),
        table::csv(grid)?,
        page::document(name, &table::html(grid), &page::Extra::default()),
        by_seed::csv(grid)?,
    ];
    let paths = files::of_table(name).map(|file| dir.join(file));
    for (path, text) in paths.iter().zip(&texts) {
        files::write(path, text.as_bytes())?;
    }
    Ok(paths)
}

/// Writes the files of all figures and returns the SVG of each, by name. Where a drawing is refused, only that figure
/// lacks its drawing; its data are still written.
fn write_figures(
    dir: &Path,
    contents: &mut Contents,
    files: &mut Vec<PathBuf>,
) -> Result<BTreeMap<String, String>, Error> {
    let mut drawings = BTreeMap::new();
    for (name, made) in &mut contents.figures {
        let Ok(chart) = &*made else { continue };
        let [vector, pixels, data, page] = files::of_figure(name).map(|file| dir.join(file));
        files::write(&data, chart.csv()?.as_bytes())?;
        files.push(data);
        match write_drawing(&vector, &pixels, &page, chart) {
            Ok(svg) => {
                files.extend([vector, pixels, page]);
                drawings.insert(name.clone(), svg);
            }
            Err(unwritten @ Error::File { .. }) => return Err(unwritten),
            Err(refused) => {
                let file = files::name(name, "csv");
                *made = Err(format!("{refused}; its data are in `{}/{file}`", files::FIGURES));
            }
        }
    }
    Ok(drawings)
}

/// Writes the drawing of a figure as SVG, PNG and PDF, and returns the SVG. No file is written where one of them is
/// refused.
fn write_drawing(vector: &Path, pixels: &Path, page: &Path, chart: &figure::Chart) -> Result<String, Error> {
    let svg = figure::svg(chart)?;
    let pdf = figure::pdf(&svg)?;
    files::write_with(pixels, |path| figure::png(chart, path))?;
    files::write(vector, svg.as_bytes())?;
    files::write(page, &pdf)?;
    Ok(svg)
}
