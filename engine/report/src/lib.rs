//! The report of a study: tables, figures and claims with what they rest on, as files and as one
//! self-contained page.
//!
//! Everything is a function of what is passed in: no clock, no random number and no version control is read
//! here, so that the same results give the same bytes.

mod answered;
mod answers;
mod basis;
mod budgets;
mod by_seed;
mod claims;
mod collapses;
pub mod compare;
mod confirmations;
mod contents;
mod differences;
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
mod on_paper;
mod open;
mod outcome;
mod page;
mod period;
mod profiles;
pub mod record;
mod sentence;
mod sheet;
mod stages;
mod summary;
#[cfg(test)]
mod tests;
mod verdicts;

pub use answered::{Answered, Word, answers_as_markdown, counts_as_markdown, items_as_markdown};
pub use basis::basis;
pub use budgets::told;
pub use confirmations::{Alone, Round};
pub use contents::{ClaimLine, Contents, Counts, Open, UNREAD};
pub use families::{Family, families, families_as_markdown, take_together};
pub(crate) use files::slug as file_slug;
pub use index::{IndexEntry, index};
pub use junit::junit;
pub use kept::{FigureFacts, Kept};
pub use manifest::{Manifest, Replaced};
pub use open::{Decided, Effort, StillOpen, open_as_markdown, still_open};
pub use outcome::{MISSING, Outcome, outcomes_as_json};
pub use period::Period;
pub use profiles::{ProfileState, ProfileTrials};
pub use sentence::sentence;
pub use stages::{Stage, Take};
pub use summary::{summary, tinted};
pub use verdicts::{Passed, Verdicts};

use analysis::results::{Ran, Results};
use contract::{Better, Build, Error};
use presentation::{
    answers::Answer,
    claim_spec::{ClaimSpec, Relevance},
    figure::{self, FigureSpec},
    summary::Summary,
    table::{self, TableSpec},
};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sheet::Sheet;
use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};
use study::{Confirmation, Repeats};

/// The profile that tries a study out: nothing that is computed under it is a result.
pub const REHEARSAL: &str = "smoke";

/// What a report must know of a study besides its results.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StudyInfo {
    /// Its name, which is the name of its folder.
    pub name: String,
    /// Its title.
    pub title: String,
    /// What it reproduces.
    pub source: String,
    /// What it came to, with placeholders.
    pub summary: Option<Summary>,
    /// Its lines in the answers of all studies.
    pub answers: Vec<Answer>,
    /// The verdicts that are read together with those of this study, such as `chapter 3`; its own alone where absent.
    pub family: Option<String>,
    /// Where it departs from that.
    pub departures: Vec<String>,
    /// Samples of its sweep, where several came to the same setting.
    pub repeats: Option<Repeats>,
    /// Tables by name, in order.
    pub tables: Vec<(String, TableSpec)>,
    /// Figures by name, in order.
    pub figures: Vec<(String, FigureSpec)>,
    /// Claims.
    pub claims: Vec<ClaimSpec>,
    /// Rounds of claims and published values on further seeds.
    pub confirm: Vec<Confirmation>,
    /// Agents in the study's order, which gives them their colours.
    pub agents: Vec<String>,
    /// Environments in the study's order.
    pub environments: Vec<String>,
    /// The entries of a study whose trials take from each other; empty where none does.
    pub stages: Vec<Stage>,
    /// True under the profile that tries a study out: what it computes is no result.
    pub is_rehearsal: bool,
    /// Agents that a trained one must be better than to have learned.
    pub floors: Vec<String>,
    /// Which difference matters for claims that do not say it.
    pub relevance: Option<Relevance>,
    /// The better direction by metric.
    pub better: BTreeMap<String, Better>,
    /// Units by metric.
    pub units: BTreeMap<String, String>,
    /// Agents that learn.
    pub learners: BTreeSet<String>,
    /// Configs with every default, by kind and name of the plugin, as in `agent dsac`.
    pub defaults: BTreeMap<String, Value>,
    /// The study without a profile and with each of its profiles; empty where it has none.
    pub profiles: Vec<ProfileState>,
    /// When its trials ended, where the store knows.
    pub ended: Option<Period>,
    /// Options of the command line that make the results differ from the study as it is written, as `--set
    /// dsac.discount=0.9`.
    pub options: Vec<String>,
    /// Plugins of which the trials have an earlier version than the program, as in `environment battery 1, now 2`.
    pub earlier_versions: Vec<String>,
    /// Keys of the study that had other values when the trials ran.
    pub changed_settings: Vec<String>,
}

impl StudyInfo {
    /// What the reader must know first: the options of the command line, where there are some.
    fn asked_with(&self) -> Option<String> {
        (!self.options.is_empty()).then(|| format!("Computed with {}.", self.options.join(", ")))
    }

    /// That nothing here is a result, where that is so.
    fn rehearsal(&self) -> Option<&'static str> {
        self.is_rehearsal.then_some(
            "This is no result: the profile `smoke` only tries the study out, with budgets from which nothing follows. \
             Nothing is judged, and what the study says of budgets is said of another one.",
        )
    }

    /// Sentences on trials that are not those which the study has now.
    fn outdated(&self) -> Vec<String> {
        let sentence = |what: &str, names: &[String]| {
            (!names.is_empty()).then(|| format!("{what}: {}.", names.join("; ")))
        };
        let versions = sentence("Of an earlier version", &self.earlier_versions);
        let settings = sentence("Of other settings than the study has now", &self.changed_settings);
        versions.into_iter().chain(settings).collect()
    }
}

/// What made the results.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// The source code of the program that made the report, where it knows.
    pub build: Option<Build>,
    /// The source code of the programs that computed the trials, where they said it, each with the number of
    /// its trials.
    pub builds: Vec<(Option<Build>, usize)>,
    /// The program and its version.
    pub program: String,
    /// Plugins by kind and name, with their versions.
    pub plugins: Vec<(String, u32)>,
    /// Kind of processor.
    pub cpu: String,
    /// Operating system.
    pub operating_system: String,
    /// The seeds of the study.
    pub seeds: Vec<u64>,
    /// Name of the profile, where one was chosen.
    pub profile: Option<String>,
    /// When the report was made, where it shall say so.
    pub date: Option<String>,
}

/// Where a report was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReportPaths {
    /// The page.
    pub page: PathBuf,
    /// The report in Markdown.
    pub markdown: PathBuf,
    /// Files of tables, figures and verdicts.
    pub files: Vec<PathBuf>,
}

/// Writes `tables/`, `figures/`, `report.md`, `index.html` and `verdicts.json` into a folder. Each file appears
/// whole or not at all.
///
/// # Errors
/// [`Error::File`] where a file cannot be written. A table or figure that could not be made is no error here: the
/// report says why. A figure whose drawing is refused becomes one of these in `contents`.
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

/// What the renderers of the report read.
struct Parts<'a> {
    study: &'a StudyInfo,
    results: &'a Results,
    contents: &'a Contents,
    provenance: &'a Provenance,
    /// SVG of each figure, by name.
    drawings: &'a BTreeMap<String, String>,
    /// What the study came to.
    sentence: Option<String>,
    /// Seeds and what was exploratory.
    basis: String,
    /// The lines of its `answers`.
    answered: Option<Sheet>,
    /// Every published value and claim with its verdict.
    answers: Option<Sheet>,
    /// The counts at the head.
    head: Vec<head::Line>,
    claims: Option<Sheet>,
    confirmed: Option<Sheet>,
    budgets: Option<Sheet>,
    /// How the trials ended.
    ran: Ran,
    /// The settings that differ, a table per plugin.
    settings: Vec<Sheet>,
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

/// Writes the files of all figures and returns the SVG of each, by name. A drawing that is refused costs that figure
/// alone, whose data are written all the same.
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

/// Writes the drawing of a figure, as SVG, which is returned too, PNG and PDF: all of them, or none where one is
/// refused.
fn write_drawing(vector: &Path, pixels: &Path, page: &Path, chart: &figure::Chart) -> Result<String, Error> {
    let svg = figure::svg(chart)?;
    let pdf = figure::pdf(&svg)?;
    files::write_with(pixels, |path| figure::png(chart, path))?;
    files::write(vector, svg.as_bytes())?;
    files::write(page, &pdf)?;
    Ok(svg)
}
