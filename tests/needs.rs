//! Needs of tests that a machine with Rust and a C compiler may lack: programs, packages of Python, rights.
//!
//! Each function gives what was asked for, or says in one line that the test is skipped and how to get what is missing
//! ([`skip`]):
//!
//! ```text
//! let Some(python) = needs::python("polars, numpy") else { return };
//! let Some(pdftotext) = needs::program("pdftotext") else { return };
//! ```

pub(crate) use crate::skipped::{skip, skip_part};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    process::Command,
    sync::{Mutex, PoisonError},
};

/// Pythons that are asked, the one on the path last: `.ci/run` makes the others.
const PYTHONS: [&str; 5] = [
    concat!(env!("CARGO_MANIFEST_DIR"), "/target/python/bin/python"),
    concat!(env!("CARGO_MANIFEST_DIR"), "/target/stable-baselines3/bin/python"),
    concat!(env!("CARGO_MANIFEST_DIR"), "/target/jax/bin/python"),
    concat!(env!("CARGO_MANIFEST_DIR"), "/target/pymarlzooplus/bin/python"),
    "python3",
];

/// Prints the modules among the arguments that cannot be imported.
const MISSING: &str = "import importlib, sys
missing = []
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
    except Exception:
        missing.append(name)
print(', '.join(missing))";

/// Prints what an interpreter has in place of what a lock file pins, package by package.
const PINNED: &str = "import sys
from importlib.metadata import PackageNotFoundError, version
other, missing = [], []
for line in open(sys.argv[1]):
    name, wanted = line.strip().split('==')
    try:
        if version(name) != wanted:
            other.append(f'{name} {version(name)} in place of {wanted}')
    except PackageNotFoundError:
        missing.append(f'{name} {wanted}')
print(' and '.join(other + ['no ' + ', '.join(missing)] * bool(missing)))";

/// Programs by the package of Debian that has each, where its name is another one.
const PACKAGES: [(&str, &str); 13] = [
    ("c++", "g++"),
    ("pdftotext", "poppler-utils"),
    ("pdflatex", "texlive-latex-recommended"),
    ("python3", "python3 python3-venv"),
    ("ssh", "openssh-client"),
    ("ssh-keygen", "openssh-client"),
    ("sshd", "openssh-server"),
    ("sbatch", "slurm-client"),
    ("munged", "munge"),
    ("kill", "procps"),
    ("mkfifo", "coreutils"),
    ("unshare", "util-linux"),
    ("qemu-x86_64", "qemu-user"),
];

/// A Python with these modules, as in `"polars, numpy"`; `None`, after a line, where no Python here has them all.
#[track_caller]
pub(crate) fn python(modules: &str) -> Option<&'static str> {
    static ASKED: Mutex<BTreeMap<String, Result<&str, String>>> = Mutex::new(BTreeMap::new());
    let found = {
        let mut asked = ASKED.lock().unwrap_or_else(PoisonError::into_inner);
        let known = asked.entry(modules.to_owned());
        known.or_insert_with(|| python_among(&PYTHONS, modules)).clone()
    };
    match found {
        Ok(python) => Some(python),
        Err(missing) => {
            skip(&missing, &remedy_for(&missing));
            None
        }
    }
}

/// The first of these Pythons that has the modules, or what the last of them lacks.
fn python_among(pythons: &[&'static str], modules: &str) -> Result<&'static str, String> {
    let names: Vec<&str> = modules.split(", ").collect();
    let mut lacks = "no `python3` is on the path".to_owned();
    for python in pythons {
        match said(python, MISSING, &names) {
            Some(missing) if missing.is_empty() => return Ok(python),
            Some(missing) => lacks = format!("`{python}` has no {missing}"),
            None => {}
        }
    }
    Err(lacks)
}

/// How to get what a Python lacks.
fn remedy_for(missing: &str) -> String {
    let (_, names) = missing.split_once(" has no ").unwrap_or_default();
    let of_the_lists = names
        .split(", ")
        .any(|name| !name.is_empty() && name != "regimen");
    let of_ci = ["stable_baselines3", "rejax", "pymarlzooplus"];
    let command = match (names.contains("regimen"), of_the_lists) {
        _ if of_ci.iter().any(|name| names.contains(name)) => ".ci/run",
        (false, false) => "apt-get install python3 python3-venv",
        (true, false) => "python3 -m pip install ./wheel",
        (false, true) => "python3 -m pip install -r tests/python/requirements.txt",
        (true, true) => "python3 -m pip install -r tests/python/requirements.txt ./wheel",
    };
    format!("`{command}` installs it")
}

/// The first Python here, whatever packages it has; the one on the path where there is none.
pub(crate) fn any_python() -> &'static str {
    let mut pythons = PYTHONS.into_iter();
    let found = pythons.find(|python| said(python, "", &[]).is_some());
    found.unwrap_or("python3")
}

/// Packages of a Python that differ from those that a lock file pins, in words; `None` where none does.
pub(crate) fn differs_from_lock(python: &str, lock: &Path) -> Option<String> {
    let lock = lock.to_string_lossy();
    let differs = said(python, PINNED, &[&lock]);
    differs.map_or_else(
        || Some(format!("there is no `{python}`")),
        |differs| (!differs.is_empty()).then(|| format!("`{python}` has {differs}")),
    )
}

/// The last line that a few lines of Python print; `None` where there is no such Python.
fn said(python: &str, lines: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(python).args(["-c", lines]).args(arguments).output();
    let output = output.ok().filter(|output| output.status.success())?;
    let text = String::from_utf8_lossy(&output.stdout);
    // Some packages greet whoever imports them.
    let lines = text.strip_suffix('\n').unwrap_or(&text);
    lines.rsplit('\n').next().map(str::to_owned)
}

/// A program on the path; `None`, after a line, where there is none of this name.
#[track_caller]
pub(crate) fn program(name: &str) -> Option<PathBuf> {
    one_of(&[name])
}

/// The first of these programs that is on the path.
#[track_caller]
pub(crate) fn one_of(names: &[&str]) -> Option<PathBuf> {
    let found = names.iter().find_map(|name| on_path(name));
    if found.is_none() {
        skip_program(names[0]);
    }
    found
}

/// The places of all these programs, in their order.
#[track_caller]
pub(crate) fn programs<const N: usize>(names: [&str; N]) -> Option<[PathBuf; N]> {
    let found = names.map(on_path);
    if let Some(at) = found.iter().position(Option::is_none) {
        skip_program(names[at]);
        return None;
    }
    Some(found.map(Option::unwrap))
}

#[track_caller]
fn skip_program(name: &str) {
    let package = PACKAGES.iter().find(|(program, _)| *program == name);
    let package = package.map_or(name, |(_, package)| package);
    skip(
        &format!("`{name}` is not on the path"),
        &format!("`apt-get install {package}` installs it"),
    );
}

/// Where a program is: in a folder of the path, or in the `sbin` beside one, where daemons are.
fn on_path(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    let folders = std::env::split_paths(&path).flat_map(|folder| [folder.with_file_name("sbin"), folder]);
    folders
        .map(|folder| folder.join(name))
        .find(|file| file.is_file())
}

/// The rights of the administrator, for what a test does with the machine itself.
#[track_caller]
pub(crate) fn root(to: &str) -> Option<()> {
    let asked = Command::new("id").arg("-u").output();
    let is_root = asked.is_ok_and(|output| output.stdout == b"0\n");
    if !is_root {
        skip(&format!("only root can {to}"), "run the tests as root");
    }
    is_root.then_some(())
}

/// A command that the machine must let the tests give; `to` says what it is for.
#[track_caller]
pub(crate) fn right(to: &str, command: &mut Command) -> Option<()> {
    let given = command.output();
    let refused = match given {
        Ok(output) if output.status.success() => return Some(()),
        Ok(output) => String::from_utf8_lossy(&output.stderr).trim().to_owned(),
        Err(error) => error.to_string(),
    };
    let missing = format!("this machine lets nobody {to} ({refused})");
    skip(
        &missing,
        "run the tests as root, outside of a container that forbids it",
    );
    None
}

/// The program in `tests/tract`, which computes exported policies.
#[track_caller]
pub(crate) fn tract() -> Option<PathBuf> {
    built_apart("tract/release/run-with-tract", |target| {
        format!("cargo build --release --manifest-path tests/tract/Cargo.toml --target-dir {target}/tract")
    })
}

/// The program in `tests/run_pins`, which computes pins on an aarch64.
#[track_caller]
pub(crate) fn run_pins() -> Option<PathBuf> {
    built_apart("aarch64/aarch64-unknown-linux-gnu/release/run-pins", |target| {
        format!("tests/run_pins/build {target}/aarch64")
    })
}

/// A program that is built apart from the tests, beside their target folder's profile.
#[track_caller]
fn built_apart(program: &str, command: impl FnOnce(std::path::Display<'_>) -> String) -> Option<PathBuf> {
    let target = Path::new(env!("CARGO_BIN_EXE_regimen")).parent()?.parent()?;
    let program = target.join(program);
    if !program.is_file() {
        let command = command(target.display());
        skip(
            &format!("`{}` is not built", program.display()),
            &format!("`{command}` builds it"),
        );
        return None;
    }
    Some(program)
}
