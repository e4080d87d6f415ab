//! `overview`: gathers what reports of studies wrote. It prints their answers or puts them into a document, and writes
//! one page over all of them, as `run` and `report` of several studies also do.

mod blocks;

use super::{Common, Format, say};
use blocks::Block;
use contract::Error;
use execution::{store::write_durably, world::fs};
use report::Verdicts;
use session::{Exit, Failure, Studied, studies_within, write_index};
use std::path::{Path, PathBuf};
use study::way;

/// The options of `overview`.
#[derive(Debug, clap::Args)]
pub(super) struct OverviewOptions {
    /// Folder that contains the folders of results.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Document whose blocks are written again: the text between `<!-- overview: summary -->`, `<!-- overview: families
    /// -->`, `<!-- overview: items -->` or `<!-- overview: answers FAMILY -->` and `<!-- overview: end -->`.
    #[arg(long, value_name = "FILE")]
    into: Option<PathBuf>,
    /// Also write one page over all studies: `index.html` in that folder.
    #[arg(long)]
    page: bool,
    /// Print open verdicts instead, the cheapest to decide first, with the approximate number of fresh seeds and the
    /// time that would decide them.
    #[arg(long, conflicts_with = "into")]
    open: bool,
}

/// Prints the answers or the open verdicts of the studies whose results lie in a folder, or writes the blocks of a
/// document again; also writes the page of all studies if it was requested.
pub(super) fn overview(options: &OverviewOptions, common: &Common) -> Result<Exit, Failure> {
    if !fs::is_folder(&options.folder) {
        let folder = options.folder.display();
        return Err(Failure {
            exit: Exit::BadStudy,
            text: format!(
                "error: there is no folder `{folder}`: name the one that has the folders of results in it"
            ),
        });
    }
    if options.page {
        write_index(&options.folder, "", &[])?;
    }
    match &options.into {
        Some(path) => put_into(path, &some_studies(&options.folder)?)?,
        None if common.format == Format::Json => {
            say(&as_json(&verdicts_of(studies_within(&options.folder)?)).to_string());
        }
        None if options.open => say(&open(&verdicts_of(studies_within(&options.folder)?))),
        None => say(&in_words(&some_studies(&options.folder)?)),
    }
    Ok(Exit::Ok)
}

/// Writes the blocks of a document again.
fn put_into(path: &Path, studies: &[Studied]) -> Result<(), Failure> {
    let text = fs::read_to_string(path).map_err(Error::file("read", path))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let written = blocks::written(&text, &|block| match block {
        Block::Families => {
            let verdicts: Vec<Verdicts> = studies.iter().map(|it| it.verdicts.clone()).collect();
            Ok(report::families_as_markdown(&report::families(&verdicts)))
        }
        Block::Summary => Ok(report::counts_as_markdown(studies.iter().map(|it| &it.verdicts))),
        Block::Items => Ok(report::items_as_markdown(&ways(studies, &|it| {
            way(folder, &it.file())
        }))),
        Block::Answers(family) => {
            let answers = report::answers_as_markdown(&ways(studies, &|it| way(folder, &it.report())));
            let known: Vec<String> = answers.iter().map(|(family, _)| format!("`{family}`")).collect();
            let found = answers.into_iter().find(|(known, _)| known == family);
            let none = || {
                format!(
                    "no study of the family `{family}` has answers: write one of {}",
                    known.join(", ")
                )
            };
            found.map(|(_, table)| table).ok_or_else(none)
        }
    });
    let written = written.map_err(|problem| Failure {
        exit: Exit::BadStudy,
        text: format!("error: {}: {problem}", path.display()),
    })?;
    Ok(write_durably(path, written.as_bytes())?)
}

/// Studies, each with the path to one of its files.
fn ways<'a>(studies: &'a [Studied], way: &dyn Fn(&Studied) -> PathBuf) -> Vec<(String, &'a Verdicts)> {
    let with = |it: &'a Studied| (way(it).display().to_string(), &it.verdicts);
    studies.iter().map(with).collect()
}

/// The answers by family after the counts of all families.
fn in_words(studies: &[Studied]) -> String {
    let verdicts: Vec<Verdicts> = studies.iter().map(|it| it.verdicts.clone()).collect();
    let here = Path::new("");
    let answers = report::answers_as_markdown(&ways(studies, &|it| way(here, &it.report())));
    let answers = answers.into_iter().map(|(family, table)| match family.as_str() {
        "" => table,
        family => format!("## {family}\n\n{table}"),
    });
    let families = Some(report::families_as_markdown(&report::families(&verdicts)));
    let families = families.filter(|table| !table.is_empty());
    families
        .into_iter()
        .chain(answers)
        .collect::<Vec<_>>()
        .join("\n\n")
}

/// The open verdicts, for people.
fn open(studies: &[Verdicts]) -> String {
    let decided = report::Decided::of(studies).in_words();
    let table = report::open_as_markdown(&report::still_open(studies));
    format!("{decided}\n\n{table}").trim_end().to_owned()
}

/// All verdicts by study, and what is open.
fn as_json(studies: &[Verdicts]) -> serde_json::Value {
    serde_json::json!({
        "families": report::families(studies), "studies": studies, "open": report::still_open(studies),
    })
}

fn verdicts_of(studies: Vec<Studied>) -> Vec<Verdicts> {
    studies.into_iter().map(|it| it.verdicts).collect()
}

/// The studies in a folder; an error if there is none.
fn some_studies(folder: &Path) -> Result<Vec<Studied>, Failure> {
    let studies = studies_within(folder)?;
    if studies.is_empty() {
        return Err(Failure {
            exit: Exit::NothingSelected,
            text: format!(
                "error: no folder in `{}` has verdicts: name the folder that has the folders of results in it",
                folder.display()
            ),
        });
    }
    Ok(studies)
}
