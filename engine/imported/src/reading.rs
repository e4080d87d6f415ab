//! Reading of files of other programs: their runs and their columns.

use super::{
    columns::{is_bound, named},
    content::{Content, LogFormat, without_copies},
    event_files,
    found::RunCollection,
    mapping::Mapping,
    tables,
};
use contract::Error;
use std::path::PathBuf;

/// Reads files: TensorBoard's event files, and tables in JSON, Parquet or separated text, also packed by gzip; archives
/// of NumPy and offline runs of W&B. Other kinds of files are recognised by their first bytes and refused.
///
/// # Errors
/// [`Error::File`] if a file cannot be read, [`Error::Input`] with file, line and column if a file does not match
/// `mapping`.
pub fn read(files: &[PathBuf], mapping: &Mapping) -> Result<RunCollection, Error> {
    let contents: Vec<Content> = files
        .iter()
        .map(|path| Content::read(path))
        .collect::<Result<_, Error>>()?;
    let (contents, note) = match mapping.copies {
        Some(_) => (contents, None),
        None => without_copies(contents),
    };
    let (mut events, mut others) = (Vec::new(), Vec::new());
    for file in &contents {
        match file.form()? {
            LogFormat::Events => events.push(file),
            form => others.push((file, form)),
        }
    }
    let mut found = RunCollection {
        notes: note.into_iter().collect(),
        ..RunCollection::default()
    };
    tables::runs(&others, mapping, &mut found)?;
    event_files::runs(&events, mapping, &mut found)?;
    found.files = contents
        .iter()
        .map(|it| (it.path.clone(), it.sha256.clone()))
        .collect();
    found.complete(mapping)?;
    found.compare();
    Ok(found)
}

/// The columns and tags of some files, from which metrics can be chosen.
#[derive(Debug, Default)]
pub struct Columns {
    /// Their names, in the order of the files.
    pub names: Vec<String>,
    /// Whether one of the files is an event file.
    pub has_tags: bool,
    /// Whether one of the files has a value or a row.
    pub has_rows: bool,
    /// Whether one of the files is a log of the Monitor of Stable-Baselines3, whose steps are the sum of a column.
    pub is_monitor: bool,
}

/// The columns and tags of some files.
///
/// # Errors
/// [`Error::File`] where one cannot be read, [`Error::Input`] where one is neither a table nor an event file.
pub fn columns(files: &[PathBuf]) -> Result<Columns, Error> {
    let mut all = Columns::default();
    for path in files {
        let file = Content::read(path)?;
        let names = match file.form()? {
            LogFormat::Events => {
                all.has_tags = true;
                let tags = event_files::tags(&file)?;
                all.has_rows |= !tags.is_empty();
                tags
            }
            form => {
                let table = tables::table(&file, form)?;
                table.has_names()?;
                all.is_monitor |= table.is_monitor();
                all.has_rows |= !table.lines.is_empty();
                table.names
            }
        };
        for name in names.iter().filter(|name| !is_bound(name, &names)) {
            if !all.names.contains(name) {
                all.names.push(name.clone());
            }
        }
    }
    Ok(all)
}

impl Columns {
    /// The names for a message, and the first one that may be a metric.
    #[must_use]
    pub fn for_a_question(&self) -> (String, Option<&str>) {
        const OTHERS: [&str; 8] = ["", "epoch", "iteration", "l", "name", "run", "seed", "t"];
        let is_measured = |name: &&String| {
            let lower = name.to_lowercase();
            !lower.contains("step") && !lower.contains("time") && !OTHERS.contains(&lower.as_str())
        };
        let example = self.names.iter().find(is_measured).or(self.names.first());
        // A file with one column may not be a table at all.
        match example {
            Some(tag) if self.has_tags && self.names.len() == 1 => (tag.clone(), Some(tag)),
            _ => (
                named(&self.names),
                example.filter(|_| self.names.len() > 1).map(String::as_str),
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::LeftOut;

    fn written(files: &[(&str, &str)]) -> (tempfile::TempDir, Vec<PathBuf>) {
        let folder = tempfile::tempdir().unwrap();
        let write = |(name, text): &(&str, &str)| {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, text).unwrap();
            path
        };
        let paths = files.iter().map(write).collect();
        (folder, paths)
    }

    fn mapping() -> Mapping {
        Mapping {
            metrics: [("return".to_owned(), "x".into())].into(),
            ..Mapping::default()
        }
    }

    #[test]
    fn an_archive_without_the_column_is_refused_by_its_name_whichever_bit_was_changed_and_wherever_it_ends() {
        let npz = include_bytes!("../../../tests/fixtures/imported/steps.npz");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("steps.npz");
        let refusal = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            let text = read(std::slice::from_ref(&path), &mapping())
                .unwrap_err()
                .to_string();
            assert!(text.contains("steps.npz"), "{text}");
            text
        };
        assert!(refusal(npz).contains("there is no such column"));
        for place in 0..npz.len() {
            refusal(&npz[..place]);
            for bit in 0..8 {
                let mut changed = npz.to_vec();
                changed[place] ^= 1 << bit;
                refusal(&changed);
            }
        }
    }

    #[test]
    fn a_run_without_a_value_is_named_or_left_out() {
        let (_folder, files) = written(&[
            ("a.csv", "step,x\n0,1\n"),
            ("b.csv", "step,x\n"),
            ("c.csv", ""),
            ("d.csv", "step,x\n0,\n"),
        ]);
        let told = read(&files, &mapping()).unwrap_err().to_string();
        assert!(
            told.contains(
                "b.csv`: `b.csv` has no value of `x`, which is to be `return`, and neither have 2 other runs"
            ),
            "{told}"
        );
        assert!(told.contains("`leave_out: [empty]`"), "{told}");
        let leave_out = Mapping {
            leave_out: [LeftOut::Empty].into(),
            ..mapping()
        };
        let found = read(&files, &leave_out).unwrap();
        assert_eq!(found.runs.len(), 1);
        assert_eq!(
            found.said(&leave_out),
            ["3 runs without a value are left out (`b.csv`, `c.csv`, `d.csv`)"]
        );
        assert!(
            read(&files[1..], &leave_out).is_err(),
            "one run has to have values"
        );
    }

    #[test]
    fn copies_are_counted_once_and_equal_values_are_told() {
        let (folder, mut files) = written(&[
            ("a.csv", "step,x\n0,1\n5,2\n"),
            ("b.csv", "step,x\n0,1\n5,2\n"),
            ("c.csv", "step,x\n0,1.0\n5,2.0\n"),
        ]);
        let link = folder.path().join("latest.csv");
        std::os::unix::fs::symlink("a.csv", &link).unwrap();
        files.push(link);
        let found = read(&files, &mapping()).unwrap();
        assert_eq!((found.runs.len(), found.files.len()), (2, 2));
        let said = found.said(&mapping());
        assert!(
            said[0].contains("2 files are copies") && said[0].contains("latest.csv` of `"),
            "{said:?}"
        );
        assert_eq!(said[1], "some runs have equal values (`a.csv` and `c.csv`)");
        let counted = Mapping {
            copies: Some(super::super::Copies::Count),
            ..mapping()
        };
        assert_eq!(read(&files, &counted).unwrap().runs.len(), 4);
    }

    #[test]
    fn what_was_done_with_values_is_said() {
        let (_folder, files) = written(&[("a.csv", "step,x\n0,1\n5,nan\n10,2\n5,3\n5,4\n")]);
        let all = Mapping {
            restart: Some(super::super::Restart::Resume),
            same_step: Some(super::super::SameStep::Mean),
            leave_out: [LeftOut::NotFinite].into(),
            ..mapping()
        };
        let found = read(&files, &all).unwrap();
        assert_eq!(found.runs[0].curves["return"], [(0, 1.0), (5, 3.0), (5, 4.0)]);
        assert_eq!(
            found.said(&all),
            [
                "1 value is purged, because the run went on from an earlier step",
                "1 value stands at a step with another one, where their mean is shown",
                "1 value that is not finite is left out",
            ]
        );
    }
}
