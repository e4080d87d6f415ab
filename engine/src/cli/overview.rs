//! `overview`: what the reports of studies wrote, gathered: their rows as one table, printed or put into a
//! document, and one page over all of them, which `run` and `report` of several studies write, too.

use super::{
    BAD_SPEC, Common, Failure, Format, NOTHING_SELECTED, OK, ReportOptions, Selection, folders, say,
    study::Planned,
};
use crate::{
    Error,
    report::{self, IndexEntry, Manifest, Verdicts},
    store::write_durably,
    world::fs,
};
use std::{
    io,
    path::{Path, PathBuf},
};

/// The file of a folder of results in which its verdicts stand.
const VERDICTS: &str = "verdicts.json";
/// The line of a document after which the table stands.
const BEGIN: &str = "<!-- results: begin -->";
/// The line before which it ends.
const END: &str = "<!-- results: end -->";
/// The head of the table.
const HEAD: &str = "| study | what | result |\n|---|---|---|\n";

/// What `overview` is asked for.
#[derive(Debug, clap::Args)]
pub(super) struct OverviewOptions {
    /// Folder with the folders of results in it.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Document to put the table into, between `<!-- results: begin -->` and `<!-- results: end -->`.
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

/// Prints the table of the studies whose results lie in a folder, or what they leave open, or puts the table into
/// a document in the place of the one that stands there; writes the page of all studies where it is asked for.
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
        Some(path) => put_into(path, &some_rows(&options.folder)?)?,
        None if common.format == Format::Json => {
            say(&as_json(&verdicts_within(&options.folder)?).to_string());
        }
        None if options.open => say(&open(&verdicts_within(&options.folder)?)),
        None => say(&some_rows(&options.folder)?),
    }
    Ok(OK)
}

/// Puts the table into a document.
fn put_into(path: &Path, table: &str) -> Result<(), Failure> {
    let text = fs::read_to_string(path).map_err(Error::file("read", path))?;
    let text = replaced(&text, table).map_err(|problem| Failure {
        code: BAD_SPEC,
        text: format!("error: {}: {problem}", path.display()),
    })?;
    Ok(write_durably(path, text.as_bytes())?)
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

/// The verdicts of all studies whose results lie in a folder.
fn verdicts_within(folder: &Path) -> Result<Vec<Verdicts>, Error> {
    let read = |place: PathBuf| verdicts(&place).transpose();
    let places = within(folder)?.into_iter().filter(|place| is_as_written(place));
    let mut studies: Vec<Verdicts> = places.filter_map(read).collect::<Result<_, _>>()?;
    report::take_together(&mut studies);
    Ok(studies)
}

/// False for results of a study under options of the command line, which are not those of the study as it is written.
fn is_as_written(place: &Path) -> bool {
    Manifest::read(place).is_none_or(|manifest| manifest.options.is_empty())
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

/// The table; refused where no study has a row.
fn some_rows(folder: &Path) -> Result<String, Failure> {
    let table = table(folder)?;
    if table.is_empty() {
        return Err(Failure {
            code: NOTHING_SELECTED,
            text: format!(
                "error: no folder in `{}` has a row: name the folder that has the folders of results in it, of studies with a \
                 `summary`",
                folder.display()
            ),
        });
    }
    Ok(table)
}

/// The table; empty where no study has a row.
fn table(folder: &Path) -> Result<String, Error> {
    let rows: Vec<String> = rows(folder)?;
    if rows.is_empty() {
        return Ok(String::new());
    }
    let families = report::families_as_markdown(&report::families(&verdicts_within(folder)?));
    let families = if families.is_empty() {
        families
    } else {
        format!("{families}\n\n")
    };
    Ok(format!("{families}{HEAD}{}\n", rows.join("\n")))
}

/// The rows in the order of their folders' names.
fn rows(folder: &Path) -> Result<Vec<String>, Error> {
    let mut rows = Vec::new();
    for folder in within(folder)? {
        // A study without a sentence has no row.
        rows.extend(read(&folder, "summary.md")?.map(|row| row.trim_end().to_owned()));
    }
    Ok(rows)
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
    let (mut entries, mut unread) = (Vec::new(), Vec::new());
    for place in within(folder)?.into_iter().filter(|place| fs::is_folder(place)) {
        let Some(manifest) = Manifest::read(&place) else {
            continue;
        };
        if manifest.options == options {
            let name = place
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned();
            match entry(&place, &name, &manifest)? {
                Some(entry) => entries.push(entry),
                None => unread.push(name),
            }
        }
    }
    let mut verdicts: Vec<Verdicts> = entries.iter().map(|entry| entry.verdicts.clone()).collect();
    report::take_together(&mut verdicts);
    for (entry, verdicts) in entries.iter_mut().zip(verdicts) {
        entry.verdicts = verdicts;
    }
    let path = folder.join(format!("index{name}.html"));
    write_durably(&path, report::index(&entries, options, &unread).as_bytes())?;
    Ok(path)
}

/// A study of the index; `None` where its report wrote no verdicts.
fn entry(place: &Path, name: &str, manifest: &Manifest) -> Result<Option<IndexEntry>, Error> {
    let Some(verdicts) = verdicts(place)? else {
        return Ok(None);
    };
    let is_drawing = |file: &&String| file.starts_with("figures/") && file.ends_with(".svg");
    Ok(Some(IndexEntry {
        folder: name.into(),
        verdicts,
        drawings: manifest.files.keys().filter(is_drawing).cloned().collect(),
    }))
}

fn is_absence(error: &io::Error) -> bool {
    [io::ErrorKind::NotFound, io::ErrorKind::NotADirectory].contains(&error.kind())
}

/// A document with the table between its two lines; what is missing where it has not both, once each and in
/// their order.
fn replaced(document: &str, table: &str) -> Result<String, String> {
    let (begin, end) = (line(document, BEGIN)?, line(document, END)?);
    if end < begin {
        return Err(format!("the line `{END}` stands before `{BEGIN}`"));
    }
    let (before, after) = (&document[..begin + BEGIN.len()], &document[end..]);
    let block = if table.is_empty() {
        String::new()
    } else {
        format!("\n{table}\n")
    };
    Ok(format!("{before}\n{block}{after}"))
}

/// The byte at which the one line that reads so begins.
fn line(document: &str, wanted: &str) -> Result<usize, String> {
    let lines = document.split_inclusive('\n').scan(0, |start, line| {
        let at = *start;
        *start += line.len();
        Some((at, line))
    });
    let found: Vec<usize> = lines
        .filter(|(_, line)| line.trim_end() == wanted)
        .map(|(at, _)| at)
        .collect();
    match found.as_slice() {
        [at] => Ok(*at),
        [] => Err(format!(
            "no line reads `{wanted}`: write it and its pair, `{BEGIN}` and `{END}`, where the table shall \
             stand"
        )),
        several => Err(format!("{} lines read `{wanted}`: leave one", several.len())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stands_between_the_lines_is_replaced_and_nothing_else() {
        let document = format!("# Title\n\n{BEGIN}\nold\n{END}\nafter `{BEGIN}`\n");
        let once = replaced(&document, "| a |\n").unwrap();
        assert_eq!(
            once,
            format!("# Title\n\n{BEGIN}\n\n| a |\n\n{END}\nafter `{BEGIN}`\n")
        );
        assert_eq!(replaced(&once, "| a |\n").unwrap(), once);
        assert_eq!(replaced(&once, "").unwrap(), document.replace("old\n", ""));
    }

    #[test]
    fn a_document_without_both_lines_is_refused() {
        let wrong = |document: &str| replaced(document, "").unwrap_err();
        assert!(wrong(BEGIN).starts_with(&format!("no line reads `{END}`")));
        assert!(wrong(END).starts_with(&format!("no line reads `{BEGIN}`")));
        assert!(wrong(&format!("{END}\n{BEGIN}\n")).contains("stands before"));
        assert!(wrong(&format!("{BEGIN}\n{BEGIN}\n{END}\n")).starts_with("2 lines read"));
    }

    #[test]
    fn rows_stand_in_the_order_of_their_folders() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(table(dir.path()).unwrap(), "");
        for (name, row) in [("b", "| second |\n"), ("a", "| first |\n")] {
            fs::create_dir(dir.path().join(name)).unwrap();
            fs::write(dir.path().join(name).join("summary.md"), row).unwrap();
        }
        fs::create_dir(dir.path().join("silent")).unwrap();
        fs::write(dir.path().join("file"), "").unwrap();
        assert_eq!(
            table(dir.path()).unwrap(),
            format!("{HEAD}| first |\n| second |\n")
        );
        assert!(table(&dir.path().join("nowhere")).is_err());
    }
}
