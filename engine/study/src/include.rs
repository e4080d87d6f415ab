//! `include`: other files whose sections a study takes over.

use super::{
    first_texts::FirstTexts,
    overlay::overlay,
    relative_path::{along, name_from, way},
    sections::{Files, StudyText},
};
use document::{
    Entry, Node, NodeKind,
    diagnostic::{Diagnostic, Sources, Span},
    reach::{Outside, Reach},
    schema_check::View,
};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Largest number of files that a study includes, counting those that its files include.
const MOST_FILES: usize = 64;

/// A study with the sections of the files that it includes.
pub struct MergedStudy {
    /// Sections of the study and of the files.
    pub root: Node,
    /// The files, in the order in which they were read.
    pub files: Vec<PathBuf>,
}

/// Reads the files that the study in `file` includes and overlays them with its own sections. Later files override
/// earlier ones. Names of data files in them are rewritten relative to the study's folder.
///
/// # Errors
/// Files that cannot be read, are wrong as YAML or no mapping, include themselves, or are too many.
pub fn read(
    root: Node,
    file: &Path,
    schema: &Value,
    sources: &mut Sources,
    texts: &FirstTexts,
) -> Result<MergedStudy, Vec<Diagnostic>> {
    let mut reader = IncludeReader {
        study: file.parent().unwrap_or(Path::new("")),
        reach: Reach::of(file.parent().unwrap_or(Path::new(""))),
        schema: View::new(schema, schema),
        sources,
        texts,
        open: vec![along(Path::new(""), file)],
        files: Vec::new(),
        found: Vec::new(),
    };
    let root = reader.with_included(root, reader.study);
    if reader.found.is_empty() {
        let files = reader.files;
        Ok(MergedStudy { root, files })
    } else {
        Err(reader.found)
    }
}

struct IncludeReader<'a> {
    /// Folder of the study.
    study: &'a Path,
    /// Folders from which the study may read files.
    reach: Reach,
    schema: View<'a>,
    sources: &'a mut Sources,
    texts: &'a FirstTexts,
    /// The files whose includes are being read; none of them may be included again.
    open: Vec<PathBuf>,
    files: Vec<PathBuf>,
    found: Vec<Diagnostic>,
}

impl IncludeReader<'_> {
    fn with_included(&mut self, root: Node, folder: &Path) -> Node {
        let mut whole = Node::empty_mapping(root.span);
        for (name, span) in named(&root) {
            match self.file(&name, span, folder) {
                Ok(node) => overlay(&mut whole, node, Some(&self.schema)),
                Err(errors) => self.found.extend(errors),
            }
        }
        // A document that is no mapping has no sections to merge: the check reports it.
        overlay(&mut whole, root, Some(&self.schema));
        whole
    }

    /// The sections of one file, which may include others itself.
    fn file(&mut self, name: &str, span: Span, folder: &Path) -> Result<Node, Vec<Diagnostic>> {
        let found = self.reach_from(folder).find(folder, name);
        let path = found.map_err(|outside| {
            let error = self.sources.error(span, "include", outside.to_string());
            vec![error.help(Outside::HELP)]
        })?;
        self.admit(name, span, &path)?;
        let shown = path.display().to_string();
        let bytes = self.texts.read(&path).map_err(|error| {
            let message = format!("the included file `{name}` cannot be read: {error}");
            let help = format!("files are sought from the folder of the file that includes them: `{shown}`");
            vec![self.sources.error(span, "include", message).help(help)]
        })?;
        let text = document::decode(&shown, &bytes)?;
        let source = self.sources.add_file(&shown, &text);
        let root = self.sections(document::parse(self.sources, source, &text)?)?;
        self.files.push(path.clone());
        self.open.push(along(Path::new(""), &path));
        let below = path.parent().unwrap_or(Path::new(""));
        let mut node = self.with_included(root, below);
        self.open.pop();
        forget(&mut node, &["study", "include", "confirm"]);
        Ok(node)
    }

    /// The reach of the files that are named in a file of `folder`: that of the study, or that of an absolute name.
    fn reach_from(&self, folder: &Path) -> Reach {
        if self.reach.holds(folder) {
            self.reach.clone()
        } else {
            Reach::of(folder)
        }
    }

    /// Refuses a file that is already being read, and any file beyond the largest number.
    fn admit(&self, name: &str, span: Span, path: &Path) -> Result<(), Vec<Diagnostic>> {
        let error =
            |message: String, help: &str| Err(vec![self.sources.error(span, "include", message).help(help)]);
        if self.open.contains(&along(Path::new(""), path)) {
            return error(
                format!("`{name}` includes itself"),
                "remove it here, or move what both need into a third file",
            );
        }
        if self.files.len() >= MOST_FILES {
            return error(
                format!("a study includes at most {MOST_FILES} files"),
                "join some of them",
            );
        }
        Ok(())
    }

    /// The sections of an included file, with data files named relative to the study's folder.
    fn sections(&self, mut root: Node) -> Result<Node, Vec<Diagnostic>> {
        if !matches!(root.kind, NodeKind::Mapping(_)) {
            let message = "an included file is a mapping of sections";
            return Err(vec![
                self.sources
                    .error(root.span, "", message)
                    .help("write sections as in a study: `agents: { NAME: ... }`"),
            ]);
        }
        let name = self.sources.place(root.span).file;
        let folder = Path::new(&name).parent().unwrap_or(Path::new(""));
        if along(Path::new(""), folder) != along(Path::new(""), self.study) {
            let NodeKind::Mapping(entries) = &mut root.kind else {
                return Ok(root);
            };
            for Entry { key, value, .. } in entries {
                let names_files = if key == "imported" { "from" } else { "file" };
                relocate(
                    value,
                    key,
                    names_files,
                    (folder, self.study),
                    &self.reach_from(folder),
                );
            }
        }
        Ok(root)
    }
}

/// The files that a study includes, with their places; the check reports values that are no names.
fn named(root: &Node) -> Vec<(String, Span)> {
    let Some(node) = root.get("include") else {
        return Vec::new();
    };
    match StudyText::read(root).include.0 {
        None => Vec::new(),
        Some(Files::One(name)) => vec![(name, node.span)],
        Some(Files::Several(names)) => {
            let names = names.into_iter().zip(node.items());
            names
                .filter_map(|(name, item)| Some((name.0?, item.span)))
                .collect()
        }
    }
}

fn forget(node: &mut Node, keys: &[&str]) {
    if let NodeKind::Mapping(entries) = &mut node.kind {
        entries.retain(|entry| !keys.contains(&entry.key.as_str()));
    }
}

/// Rewrites the names of files, which stand under a key and in lists for it, relative to another folder.
fn relocate(node: &mut Node, key: &str, names_files: &str, (from, to): (&Path, &Path), reach: &Reach) {
    let is_file = key.rsplit('.').next() == Some(names_files);
    match &mut node.kind {
        NodeKind::Scalar(_) => {
            if let Some(text) = node.as_str().filter(|text| is_file && !text.is_empty()) {
                // A name that leads outside stays relative, and is refused when its file is read.
                let path = match reach.find(from, text) {
                    Ok(path) => name_from(to, &path),
                    Err(_) => way(to, &from.join(text)),
                };
                *node = Node::scalar(node.span, path.display().to_string().into());
            }
        }
        NodeKind::Sequence(items) => items
            .iter_mut()
            .for_each(|item| relocate(item, key, names_files, (from, to), reach)),
        NodeKind::Mapping(entries) => {
            for Entry {
                key: below, value, ..
            } in entries
            {
                let is_list_of_files = is_file && !matches!(value.kind, NodeKind::Scalar(_));
                let key = if is_list_of_files { key } else { below };
                relocate(value, key, names_files, (from, to), reach);
            }
        }
    }
}
