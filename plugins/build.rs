//! Tells the program which source code it is built from: the commit, and whether files that the program is
//! made of had changed.
//!
//! It runs again when one of those files, the commit or the index changes, and only the program's own small
//! crate depends on it.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

/// Sources of the program. Studies, results, texts and tests are no part of it.
const SOURCES: [&str; 4] = ["Cargo.toml", "Cargo.lock", "engine", "plugins"];

#[allow(
    clippy::print_stdout,
    clippy::disallowed_methods,
    reason = "cargo reads it; a test that includes this file is no build script"
)]
fn main() {
    // Asked when it runs: checkouts that share a folder of build outputs share the script too.
    let folder = std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default();
    for line in told(Path::new(&folder)) {
        println!("{line}");
    }
}

/// Directives to cargo for the source code in a folder.
pub fn told(folder: &Path) -> Vec<String> {
    let commit = commit(folder);
    let changed = commit.is_some() && is_changed(folder);
    let watched = SOURCES.iter().map(PathBuf::from).chain(watched(folder));
    let mut lines: Vec<String> = watched
        .map(|path| format!("cargo::rerun-if-changed={}", path.display()))
        .collect();
    lines.push(format!(
        "cargo::rustc-env=REGIMEN_COMMIT={}",
        commit.unwrap_or_default()
    ));
    lines.push(format!("cargo::rustc-env=REGIMEN_CHANGED={changed}"));
    lines
}

/// The commit, where the repository around the folder holds this source code: what was unpacked somewhere
/// inside a stranger's repository has none.
fn commit(folder: &Path) -> Option<String> {
    git(
        folder,
        &[
            "ls-files",
            "--error-unmatch",
            "--",
            "plugins/build.rs",
            "Cargo.toml",
        ],
    )?;
    git(folder, &["rev-parse", "--short=12", "HEAD"])
}

fn is_changed(folder: &Path) -> bool {
    let arguments = ["status", "--porcelain", "--untracked-files=no", "--"];
    git(folder, &[&arguments[..], &SOURCES].concat()).is_none_or(|text| !text.is_empty())
}

/// Files of git that change with the commit and the index, also where it does not know the source code yet.
/// Cargo would run the script each time for one that is not there.
fn watched(folder: &Path) -> Vec<PathBuf> {
    let branch = git(folder, &["symbolic-ref", "--quiet", "HEAD"]);
    let names = ["HEAD", "logs/HEAD", "index", "packed-refs"]
        .into_iter()
        .chain(branch.as_deref());
    let paths = names.filter_map(|name| git(folder, &["rev-parse", "--git-path", name]));
    paths
        .map(|path| folder.join(path))
        .filter(|path| path.exists())
        .collect()
}

/// Answer of git; `None` where git is not there or refuses.
fn git(folder: &Path, arguments: &[&str]) -> Option<String> {
    let mut command = Command::new("git");
    // The folder says which repository is meant, also where a hook of git builds; and asking must not write
    // the index.
    for variable in ["GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"] {
        command.env_remove(variable);
    }
    let output = command
        .env("GIT_OPTIONAL_LOCKS", "0")
        .args(arguments)
        .current_dir(folder)
        .output()
        .ok()?;
    output
        .status
        .success()
        .then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}
