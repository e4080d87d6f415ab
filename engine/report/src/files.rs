//! Files that are written whole or not at all.

use contract::Error;
use execution::world::{fs, process};
use std::path::Path;

/// Writes a file, after creating its folder.
pub(super) fn write(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    write_with(path, |temporary| {
        fs::write(temporary, bytes).map_err(Error::file("write", temporary))
    })
}

/// Lets `fill` write a temporary file beside `path` and renames it. The temporary name has the same ending, since a
/// writer may choose its format by the ending.
pub(super) fn write_with(path: &Path, fill: impl FnOnce(&Path) -> Result<(), Error>) -> Result<(), Error> {
    let dir = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(dir).map_err(Error::file("create", dir))?;
    let file_name = path.file_name().unwrap_or_default().to_string_lossy();
    let temporary = dir.join(format!(".{}-{file_name}", process::id()));
    let filled =
        fill(&temporary).and_then(|()| fs::rename(&temporary, path).map_err(Error::file("write", path)));
    if filled.is_err() {
        // The first error is the one to report; the temporary file is hidden and harmless.
        let _ = fs::remove_file(&temporary);
    }
    filled
}

/// The folder of tables in that of a report.
pub(super) const TABLES: &str = "tables";
/// The folder of figures in that of a report.
pub(super) const FIGURES: &str = "figures";

/// A file name for a table or figure.
pub(super) fn name(name: &str, extension: &str) -> String {
    format!("{}.{extension}", slug(name))
}

/// Name of the file with the values by seed of a table.
pub(super) fn by_seed(name: &str) -> String {
    format!("{}-seeds.csv", slug(name))
}

/// Names of the files of a table: Markdown, LaTeX, CSV, HTML, and its values by seed.
pub(super) fn of_table(table: &str) -> [String; 5] {
    let [md, tex, csv, html] = ["md", "tex", "csv", "html"].map(|extension| name(table, extension));
    [md, tex, csv, html, by_seed(table)]
}

/// Names of the files of a figure: SVG, PNG, CSV and PDF.
pub(super) fn of_figure(figure: &str) -> [String; 4] {
    ["svg", "png", "csv", "pdf"].map(|extension| name(figure, extension))
}

/// The files of a table by their names inside the folder of the report.
pub(super) fn paths_of_table(table: &str) -> Vec<String> {
    of_table(table).map(|file| format!("{TABLES}/{file}")).into()
}

/// The files of a figure by their names inside the folder of the report.
pub(super) fn paths_of_figure(figure: &str) -> Vec<String> {
    of_figure(figure).map(|file| format!("{FIGURES}/{file}")).into()
}

/// A name with everything but letters, digits, `.`, `_` and `-` replaced.
pub(crate) fn slug(name: &str) -> String {
    let keep = |c: char| c.is_ascii_alphanumeric() || "._-".contains(c);
    let slug: String = name.chars().map(|c| if keep(c) { c } else { '-' }).collect();
    slug.trim_start_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_leave_the_folder() {
        assert_eq!(name("../table 3.2/x", "md"), "-table-3.2-x.md");
        assert_eq!(name("table-3.2", "csv"), "table-3.2.csv");
    }

    #[test]
    fn a_failed_write_leaves_the_old_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("deep/file.txt");
        write(&path, b"old").unwrap();
        let failed = write_with(&path, |temporary| {
            fs::write(temporary, b"half").unwrap();
            Err(Error::config("x", "y"))
        });
        assert!(failed.is_err());
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
    }
}
