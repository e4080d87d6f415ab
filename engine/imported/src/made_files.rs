//! Folders whose files are made by this program or by Python, and are no sources of a program.
//!
//! They are known by their content and not by their place: a store or a folder of results may lie anywhere, and the
//! ids of trials must not depend on the options that name it.

use execution::{
    store::{is_store, names},
    world::fs,
};
use serde_json::Value;
use std::path::Path;

/// The file that a report writes into a folder of results, and the keys by which it is known.
const REPORTED: (&str, [&str; 3]) = ("manifest.json", ["study", "spec", "files"]);
/// Maximum depth of folders of results in the folder that holds them.
const DEEPEST: usize = 4;

/// Whether a folder is a store, a folder of results, a virtual environment of Python or its folder of compiled files.
pub(crate) fn is_made(folder: &Path) -> bool {
    let is_compiled = folder.file_name().is_some_and(|name| name == "__pycache__");
    let is_environment = || fs::is_file(&folder.join("pyvenv.cfg"));
    fs::is_folder(folder)
        && (is_compiled || is_environment() || is_store(folder) || has_only_results(folder, DEEPEST))
}

/// Whether a folder holds the results of a study, or nothing but such folders and their index.
fn has_only_results(folder: &Path, deepest: usize) -> bool {
    if is_reported(folder) {
        return true;
    }
    // A folder that cannot be read holds no results.
    let all = names(folder).unwrap_or_default();
    let (folders, files): (Vec<_>, Vec<_>) = all
        .into_iter()
        .filter(|name| !name.starts_with('.'))
        .partition(|name| fs::is_folder(&folder.join(name)));
    let is_index =
        |name: &String| name == "README.md" || name.starts_with("index") && name.ends_with(".html");
    deepest > 0
        && !folders.is_empty()
        && files.iter().all(is_index)
        && folders
            .iter()
            .all(|name| has_only_results(&folder.join(name), deepest - 1))
}

fn is_reported(folder: &Path) -> bool {
    let (name, keys) = REPORTED;
    let text = fs::read(folder.join(name)).ok();
    let manifest = text.and_then(|text| serde_json::from_slice::<Value>(&text).ok());
    manifest.is_some_and(|manifest| keys.iter().all(|key| manifest.get(key).is_some()))
}
