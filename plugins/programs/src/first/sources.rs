//! The files of a program: its script, the modules beside it that the script imports, the configs that it
//! names, and its lock file. The result is a proposal for the user to check.

use std::{
    collections::BTreeSet,
    fs,
    path::{Component, Path, PathBuf},
};

/// Names of lock files, the most precise first.
const LOCKS: [&str; 12] = [
    "uv.lock",
    "poetry.lock",
    "pdm.lock",
    "pixi.lock",
    "conda-lock.yml",
    "Pipfile.lock",
    "requirements.lock",
    "requirements.txt",
    "Cargo.lock",
    "package-lock.json",
    "renv.lock",
    "Manifest.toml",
];
/// Extensions of files that a program may name in its text: other programs and configs.
const NAMED: [&str; 16] = [
    "py", "sh", "awk", "r", "jl", "js", "lua", "pl", "rb", "toml", "yaml", "yml", "ini", "cfg", "json", "so",
];
/// Largest size of a script, bytes.
const LONGEST: u64 = 1 << 20;
/// Most files of a script and its modules; more are a library.
const MOST: usize = 500;

/// The lock file of a folder.
pub fn lock(folder: &Path) -> Option<&'static str> {
    LOCKS.into_iter().find(|name| folder.join(name).is_file())
}

/// The path of a file relative to the folder; `None` for a file that does not exist or lies outside.
pub fn inside(folder: &Path, name: &str) -> Option<String> {
    let mut parts = Vec::new();
    for part in Path::new(name).components() {
        match part {
            Component::Normal(part) => parts.push(part.to_str()?),
            Component::CurDir => {}
            Component::ParentDir => drop(parts.pop()?),
            _ => return None,
        }
    }
    let path = parts.join("/");
    (!path.is_empty() && folder.join(&path).is_file()).then_some(path)
}

/// The first files and all files that they lead to, ordered by name.
pub fn of(folder: &Path, first: &[String]) -> Vec<String> {
    let mut found: BTreeSet<String> = BTreeSet::new();
    let mut open: Vec<String> = first.to_vec();
    while let Some(name) = open.pop() {
        if found.len() >= MOST || !found.insert(name.clone()) {
            continue;
        }
        let Some(text) = text(&folder.join(&name)) else {
            continue;
        };
        open.extend(named(folder, &text));
        if name.ends_with(".py") {
            open.extend(imported(folder, &name, &text));
            open.extend(configs(folder, &name, &text));
        }
    }
    found.into_iter().collect()
}

fn text(path: &Path) -> Option<String> {
    let is_short = path.metadata().is_ok_and(|it| it.len() <= LONGEST);
    is_short.then(|| fs::read_to_string(path).ok()).flatten()
}

/// Programs and configs in the folder that a text names.
fn named(folder: &Path, text: &str) -> Vec<String> {
    let ends = |letter: char| letter.is_whitespace() || "\"'`()[]{}=,;:<>|&$".contains(letter);
    let is_kind = |word: &&str| {
        let end = Path::new(word).extension().and_then(|end| end.to_str());
        end.is_some_and(|end| NAMED.contains(&end.to_ascii_lowercase().as_str()))
    };
    let words = text.split(ends).filter(is_kind);
    words.filter_map(|word| inside(folder, word)).collect()
}

/// Modules in the folder that a Python text imports.
fn imported(folder: &Path, name: &str, text: &str) -> Vec<String> {
    let own = Path::new(name).parent().unwrap_or(Path::new(""));
    let mut found = Vec::new();
    for line in text.lines().map(str::trim) {
        if let Some(names) = line.strip_prefix("import ") {
            for name in names.split(',').filter_map(|it| it.split_whitespace().next()) {
                found.extend(modules(folder, own, name, &[]));
            }
        } else if let Some((module, names)) =
            line.strip_prefix("from ").and_then(|it| it.split_once(" import"))
        {
            let names = names.split([',', '(', ')', ' ']).filter(|it| !it.is_empty());
            found.extend(modules(folder, own, module.trim(), &names.collect::<Vec<_>>()));
        }
    }
    found
}

/// The files of a module, and of those of its names that are modules, relative to the folder of the importing
/// file and to the folder of the study.
fn modules(folder: &Path, own: &Path, module: &str, names: &[&str]) -> Vec<String> {
    let plain = module.trim_start_matches('.');
    let up = module.len() - plain.len();
    let base = own.ancestors().nth(up.saturating_sub(1)).unwrap_or(Path::new(""));
    let bases = if up == 0 {
        vec![own, Path::new("")]
    } else {
        vec![base]
    };
    let mut found = Vec::new();
    if up > 0 {
        found.extend(packages(folder, base));
    }
    for base in bases {
        let mut place = base.to_owned();
        for part in plain.split('.').filter(|it| !it.is_empty()) {
            place.push(part);
            found.extend(module_at(folder, &place));
        }
        found.extend(names.iter().flat_map(|name| module_at(folder, &place.join(name))));
    }
    found
}

/// The `__init__.py` of a package and of all packages around it, which Python runs before their modules.
pub fn packages(folder: &Path, package: &Path) -> Vec<String> {
    let packages = package.ancestors().filter(|it| !it.as_os_str().is_empty());
    packages
        .filter_map(|it| inside(folder, it.join("__init__.py").to_str()?))
        .collect()
}

fn module_at(folder: &Path, place: &Path) -> Vec<String> {
    let files = [place.with_extension("py"), place.join("__init__.py")];
    let name = |path: &PathBuf| inside(folder, path.to_str()?);
    files.iter().filter_map(name).collect()
}

/// The folder of configs that a Hydra program names, as a pattern.
fn configs(folder: &Path, name: &str, text: &str) -> Option<String> {
    let after = text
        .split("config_path")
        .nth(1)?
        .trim_start()
        .strip_prefix('=')?
        .trim_start();
    let quote = after.chars().next().filter(|letter| "\"'".contains(*letter))?;
    let path = after[1..].split(quote).next()?;
    let place = Path::new(name).parent()?.join(path);
    let has_names =
        folder.join(&place).is_dir() && place.components().all(|it| !matches!(it, Component::ParentDir));
    let plain: PathBuf = place.components().filter(|it| *it != Component::CurDir).collect();
    let plain = plain.to_str()?;
    (has_names && !plain.is_empty()).then(|| format!("{plain}/**/*.yaml"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        folder
    }

    #[test]
    fn a_script_leads_to_what_it_imports_and_names() {
        let text = "import os, helper as h\nfrom lib.a import b\nfrom . import beside\nopen('tasks.toml')\n";
        let files = [
            ("train.py", text),
            ("helper.py", "import numpy\nfrom lib import c\n"),
            ("beside.py", ""),
            ("tasks.toml", ""),
            ("unused.py", ""),
            ("results.csv", ""),
            ("lib/__init__.py", ""),
            ("lib/a.py", "from .d import e\nfrom ..helper import f\n"),
            ("lib/c.py", ""),
            ("lib/d.py", "import train\n"),
        ];
        let folder = folder(&files);
        let found = of(folder.path(), &["train.py".into()]);
        let all = [
            "beside.py",
            "helper.py",
            "lib/__init__.py",
            "lib/a.py",
            "lib/c.py",
            "lib/d.py",
            "tasks.toml",
            "train.py",
        ];
        assert_eq!(found, all);
    }

    #[test]
    fn a_relative_import_runs_the_packages_around_it() {
        let files = [
            ("a/__init__.py", ""),
            ("a/b/__init__.py", "X = 1\n"),
            ("a/b/train.py", "from . import X\n"),
        ];
        let folder = folder(&files);
        let found = of(folder.path(), &["a/b/train.py".into()]);
        assert_eq!(found, ["a/__init__.py", "a/b/__init__.py", "a/b/train.py"]);
    }

    #[test]
    fn a_shell_script_leads_to_the_programs_that_it_names() {
        let folder = folder(&[
            ("a.sh", "awk -f walk.awk \"$1\"\n. ./common.sh\n"),
            ("walk.awk", ""),
            ("common.sh", ""),
        ]);
        assert_eq!(
            of(folder.path(), &["a.sh".into()]),
            ["a.sh", "common.sh", "walk.awk"]
        );
    }

    #[test]
    fn the_configs_of_hydra_are_a_pattern() {
        let text = "@hydra.main(version_base=None, config_path=\"conf\", config_name=\"config\")\n";
        let folder = folder(&[("src/train.py", text), ("src/conf/config.yaml", "lr: 1\n")]);
        assert_eq!(
            of(folder.path(), &["src/train.py".into()]),
            ["src/conf/**/*.yaml", "src/train.py"]
        );
    }

    #[test]
    fn names_that_lead_out_are_no_files_of_the_program() {
        let folder = folder(&[("a/b.py", "")]);
        assert_eq!(inside(folder.path(), "./a/../a/b.py").as_deref(), Some("a/b.py"));
        for name in ["../b.py", "/etc/passwd", "a", "", "c.py"] {
            assert_eq!(inside(folder.path(), name), None, "{name}");
        }
    }

    #[test]
    fn the_lock_file_that_says_most_is_taken() {
        let folder = folder(&[("requirements.txt", "")]);
        assert_eq!(lock(folder.path()), Some("requirements.txt"));
        fs::write(folder.path().join("uv.lock"), "").unwrap();
        assert_eq!(lock(folder.path()), Some("uv.lock"));
    }
}
