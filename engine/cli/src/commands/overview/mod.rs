//! `overview`: what the reports of studies wrote, gathered: their answers, printed or put into a document, and one
//! page over all of them, which `run` and `report` of several studies write, too.

mod blocks;

use super::{
    BAD_SPEC, Common, Failure, Format, NOTHING_SELECTED, OK, ReportOptions, Selection, folders,
    planned::Planned, say,
};
use blocks::Block;
use contract::Error;
use execution::{store::write_durably, world::fs};
use report::{IndexEntry, Manifest, Verdicts};
use std::{
    io,
    path::{Path, PathBuf},
};
use study::{along, way};

/// The file of a folder of results in which its verdicts stand.
const VERDICTS: &str = "verdicts.json";

/// So deep lie folders of results below the one that is named.
const DEEPEST: usize = 3;

/// The options of `overview`.
#[derive(Debug, clap::Args)]
pub(super) struct OverviewOptions {
    /// Folder with the folders of results in it.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Document whose blocks are written anew: what stands between `<!-- overview: summary -->`, `<!-- overview:
    /// families -->`, `<!-- overview: items -->` or `<!-- overview: answers FAMILY -->` and `<!-- overview: end -->`.
    #[arg(long, value_name = "FILE")]
    into: Option<PathBuf>,
    /// Write one page over all studies, too: `index.html` in that folder.
    #[arg(long)]
    page: bool,
    /// Print what is judged and open instead, what is cheapest to decide first, with about how many fresh seeds
    /// and how much time would decide it.
    #[arg(long, conflicts_with = "into")]
    open: bool,
}

/// Prints what the studies whose results lie in a folder found, or what they leave open, or writes the blocks of a
/// document anew; writes the page of all studies where it is asked for.
pub(super) fn overview(options: &OverviewOptions, common: &Common) -> Result<u8, Failure> {
    if !fs::is_folder(&options.folder) {
        let folder = options.folder.display();
        return Err(Failure {
            code: BAD_SPEC,
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
    Ok(OK)
}

/// A study with its folder of results.
struct Studied {
    place: PathBuf,
    manifest: Manifest,
    verdicts: Verdicts,
}

/// Writes the blocks of a document anew.
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
        code: BAD_SPEC,
        text: format!("error: {}: {problem}", path.display()),
    })?;
    Ok(write_durably(path, written.as_bytes())?)
}

impl Studied {
    fn report(&self) -> PathBuf {
        self.place.join("report.md")
    }

    /// The study file.
    fn file(&self) -> PathBuf {
        along(&self.place, Path::new(&self.manifest.spec))
    }
}

/// Studies with the way to a file of each.
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

/// What is open, for people.
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

/// The studies as they are written whose results lie in a folder.
fn studies_within(folder: &Path) -> Result<Vec<Studied>, Error> {
    Ok(asked_with(folder, &[])?.0)
}

/// The studies whose results lie in a folder and were asked for with these options, with the verdicts of each family
/// taken together; and the folders whose reports left nothing to read.
fn asked_with(folder: &Path, options: &[String]) -> Result<(Vec<Studied>, Vec<PathBuf>), Error> {
    let (mut studies, mut unread) = (Vec::new(), Vec::new());
    for place in places(folder, DEEPEST)? {
        let manifest = Manifest::read(&place).unwrap_or_default();
        if manifest.options != options {
            continue;
        }
        match verdicts(&place)? {
            Some(verdicts) => studies.push(Studied {
                place,
                manifest,
                verdicts,
            }),
            None => unread.push(place),
        }
    }
    let mut together: Vec<Verdicts> = studies.iter().map(|it| it.verdicts.clone()).collect();
    report::take_together(&mut together);
    for (study, verdicts) in studies.iter_mut().zip(together) {
        study.verdicts = verdicts;
    }
    Ok((studies, unread))
}

fn verdicts_of(studies: Vec<Studied>) -> Vec<Verdicts> {
    studies.into_iter().map(|it| it.verdicts).collect()
}

/// The same; refused where there is none.
fn some_studies(folder: &Path) -> Result<Vec<Studied>, Failure> {
    let studies = studies_within(folder)?;
    if studies.is_empty() {
        return Err(Failure {
            code: NOTHING_SELECTED,
            text: format!(
                "error: no folder in `{}` has verdicts: name the folder that has the folders of results in it",
                folder.display()
            ),
        });
    }
    Ok(studies)
}

/// The verdicts of a folder of results; `None` where its report wrote none.
fn verdicts(place: &Path) -> Result<Option<Verdicts>, Error> {
    let Some(text) = read(place, VERDICTS)? else {
        return Ok(None);
    };
    let path = place.join(VERDICTS);
    let verdicts = serde_json::from_str(&text)
        .map_err(io::Error::from)
        .map_err(Error::file("read", &path))?;
    Ok(Some(verdicts))
}

/// The folders of results in a folder and in its subfolders down to a depth, by name. Links are not followed.
fn places(folder: &Path, depth: usize) -> Result<Vec<PathBuf>, Error> {
    let is_folder = |path: &PathBuf| fs::symlink_metadata(path).is_ok_and(|data| data.is_dir());
    let mut places = Vec::new();
    for path in within(folder)?.into_iter().filter(is_folder) {
        if fs::is_file(&path.join(VERDICTS)) || Manifest::read(&path).is_some() {
            places.push(path);
        } else if depth > 1 {
            places.extend(self::places(&path, depth - 1)?);
        }
    }
    Ok(places)
}

/// Everything in a folder, by name.
fn within(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let entries = fs::read_dir(folder).and_then(|entries| {
        entries
            .map(|entry| entry.map(|it| it.path()))
            .collect::<io::Result<Vec<PathBuf>>>()
    });
    let mut entries = entries.map_err(Error::file("read", folder))?;
    entries.sort_unstable();
    Ok(entries)
}

/// A file of a folder of results; `None` where the report wrote none, and of what is no folder.
fn read(folder: &Path, name: &str) -> Result<Option<String>, Error> {
    let path = folder.join(name);
    match fs::read_to_string(&path) {
        Ok(text) => Ok(Some(text)),
        Err(error) if is_absence(&error) => Ok(None),
        Err(error) => Err(Error::file("read", &path)(error)),
    }
}

/// Writes the page over all studies whose reports lie beside those of several that were asked for; nothing for
/// one study.
pub(super) fn index(
    planned: &[Planned],
    selection: &Selection,
    reporting: &ReportOptions,
    common: &Common,
) -> Result<(), Failure> {
    if planned.iter().filter(|one| one.confirms.is_none()).count() < 2 {
        return Ok(());
    }
    // In a folder of its own nothing lies beside what was asked for.
    let name = reporting
        .out
        .as_ref()
        .map_or_else(|| folders::asked(selection), |_| String::new());
    let path = write_index(&folders::around(reporting), &name, &folders::options(selection))?;
    if common.format == Format::Text {
        say(&format!("All studies: {}", path.display()));
    }
    Ok(())
}

/// Writes `index<name>.html` over the reports in a folder that were asked for with these options.
fn write_index(folder: &Path, name: &str, options: &[String]) -> Result<PathBuf, Error> {
    let (studies, unread) = asked_with(folder, options)?;
    let name_of = |place: &Path| place.strip_prefix(folder).unwrap_or(place).display().to_string();
    let is_drawing = |file: &&String| file.starts_with("figures/") && file.ends_with(".svg");
    let entry = |study: Studied| IndexEntry {
        folder: name_of(&study.place),
        drawings: study.manifest.files.keys().filter(is_drawing).cloned().collect(),
        verdicts: study.verdicts,
    };
    let entries: Vec<IndexEntry> = studies.into_iter().map(entry).collect();
    let unread: Vec<String> = unread.iter().map(|place| name_of(place)).collect();
    let path = folder.join(format!("index{name}.html"));
    write_durably(&path, report::index(&entries, options, &unread).as_bytes())?;
    Ok(path)
}

fn is_absence(error: &io::Error) -> bool {
    [io::ErrorKind::NotFound, io::ErrorKind::NotADirectory].contains(&error.kind())
}
