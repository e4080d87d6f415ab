//! `overview`: the rows that the reports of studies wrote as one table, printed or put into a document.

use super::{BAD_SPEC, Failure, OK, say};
use crate::{Error, store::write_durably};
use std::{
    fs, io,
    path::{Path, PathBuf},
};

/// The line of a document after which the table stands.
const BEGIN: &str = "<!-- results: begin -->";
/// The line before which it ends.
const END: &str = "<!-- results: end -->";
/// The head of the table.
const HEAD: &str = "| study | what | result |\n|---|---|---|\n";

/// Prints the table of the studies whose results lie in `folder`, or puts it into a document in the place of
/// the one that stands there.
pub(super) fn overview(folder: &Path, into: Option<&Path>) -> Result<u8, Failure> {
    let table = table(folder)?;
    match into {
        None => say(&table),
        Some(path) => {
            let text = fs::read_to_string(path).map_err(Error::file("read", path))?;
            let text = replaced(&text, &table).map_err(|problem| Failure {
                code: BAD_SPEC,
                text: format!("error: {}: {problem}", path.display()),
            })?;
            write_durably(path, text.as_bytes())?;
        }
    }
    Ok(OK)
}

/// The table; empty where no study has a row.
fn table(folder: &Path) -> Result<String, Error> {
    let rows: Vec<String> = rows(folder)?;
    Ok(if rows.is_empty() {
        String::new()
    } else {
        format!("{HEAD}{}\n", rows.join("\n"))
    })
}

/// The rows in the order of their folders' names.
fn rows(folder: &Path) -> Result<Vec<String>, Error> {
    let folders = fs::read_dir(folder).and_then(|entries| {
        entries
            .map(|entry| entry.map(|it| it.path()))
            .collect::<io::Result<Vec<PathBuf>>>()
    });
    let mut folders = folders.map_err(Error::file("read", folder))?;
    folders.sort_unstable();
    let mut rows = Vec::new();
    for path in folders.iter().map(|folder| folder.join("summary.md")) {
        match fs::read_to_string(&path) {
            Ok(row) => rows.push(row.trim_end().to_owned()),
            // A study without a sentence has no row, and other files have none either.
            Err(error) if is_absence(&error) => {}
            Err(error) => return Err(Error::file("read", &path)(error)),
        }
    }
    Ok(rows)
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
