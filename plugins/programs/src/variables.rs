//! The machine's environment variables that a program sees: a fixed list, since every other variable would be
//! an undeclared input.

use crate::{ProgramConfig, output, working_folder::WorkingFolder};
use contract::resources::Share;
use std::{collections::BTreeMap, ffi::OsString};

/// Variables that are passed on unchanged; a `*` at the end stands for any letters.
const PASSED: [&str; 23] = [
    "CONDA_*",
    "CUDA_*",
    "HOME",
    "LANG",
    "LC_*",
    "LD_LIBRARY_PATH",
    "LOGNAME",
    "NVIDIA_*",
    "OPENBLAS_*",
    "PATH",
    "SHELL",
    "SSL_*",
    "TMPDIR",
    "TZ",
    "USER",
    "UV_*",
    "VIRTUAL_ENV",
    "XDG_*",
    "XLA_*",
    "HF_HOME",
    "JAVA_HOME",
    "JULIA_*",
    "RUSTUP_HOME",
];
/// Variables that are set in every trial: fixed hashes, no compiled files, unbuffered output, no windows, no uploads to
/// a service.
const SET: [(&str, &str); 6] = [
    ("PYTHONHASHSEED", "0"),
    ("PYTHONDONTWRITEBYTECODE", "1"),
    ("PYTHONUNBUFFERED", "1"),
    ("MPLBACKEND", "Agg"),
    ("WANDB_MODE", "offline"),
    ("TERM", "dumb"),
];
/// Libraries that would use all cores of a machine; a trial uses only the cores of its share.
const THREADS: [&str; 4] = ["OMP", "OPENBLAS", "MKL", "NUMEXPR"];

/// The variables of a program: those of the machine that are passed on, those that are set in every trial, those of the
/// study, and those with which the program finds its trial's files.
pub fn given(config: &ProgramConfig, place: &WorkingFolder, share: &Share) -> BTreeMap<String, String> {
    #[expect(
        clippy::disallowed_methods,
        reason = "a program is found by the variables of its machine; the study declares all others"
    )]
    let machine = std::env::vars_os();
    let mut all = chosen(machine, &config.inherit);
    all.extend(of_share(share));
    all.extend(config.variables.clone());
    all.extend(of_trial(place, all.get("PYTHONPATH")));
    all
}

/// The variables of a trial. The folder of the trial's module comes after the study's own `PYTHONPATH`.
fn of_trial(place: &WorkingFolder, python_path: Option<&String>) -> [(String, String); 3] {
    let log = output::noted(&place.notes(), output::LOG);
    let trial = place.trial().display().to_string();
    let modules = place.python().display().to_string();
    let modules = python_path.map_or(modules.clone(), |before| format!("{before}:{modules}"));
    [
        ("REGIMEN_LOG".to_owned(), log.display().to_string()),
        ("REGIMEN_TRIAL".to_owned(), trial),
        ("PYTHONPATH".to_owned(), modules),
    ]
}

/// The variables that limit libraries to a share of the machine.
fn of_share(share: &Share) -> BTreeMap<String, String> {
    let threads = THREADS.map(|library| (format!("{library}_NUM_THREADS"), share.cores.to_string()));
    let cards = share.gpus.as_ref();
    let cards = cards.map(|names| ("CUDA_VISIBLE_DEVICES".to_owned(), names.join(",")));
    threads.into_iter().chain(cards).collect()
}

fn chosen(
    machine: impl Iterator<Item = (OsString, OsString)>,
    inherit: &[String],
) -> BTreeMap<String, String> {
    let passed = |name: &str| {
        let is_passed = |pattern: &&str| match pattern.strip_suffix('*') {
            Some(before) => name.starts_with(before),
            None => name == *pattern,
        };
        PASSED.iter().any(is_passed) || inherit.iter().any(|it| it == name)
    };
    let text =
        |(name, value): (OsString, OsString)| Some((name.into_string().ok()?, value.into_string().ok()?));
    let mut all: BTreeMap<String, String> = machine
        .filter_map(text)
        .filter(|(name, _)| passed(name))
        .collect();
    all.extend(SET.map(|(name, value)| (name.to_owned(), value.to_owned())));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_passed_on_that_is_not_listed_or_asked_for() {
        let machine = [
            ("PATH", "/bin"),
            ("LC_ALL", "C"),
            ("PYTHONPATH", "/lib"),
            ("SLURM_NTASKS", "4"),
            ("KEY", "s"),
        ];
        let machine = machine.map(|(name, value)| (OsString::from(name), OsString::from(value)));
        let all = chosen(machine.into_iter(), &["KEY".to_owned()]);
        let value = |name: &str| all.get(name).map(String::as_str);
        assert_eq!(
            (value("PATH"), value("LC_ALL"), value("KEY")),
            (Some("/bin"), Some("C"), Some("s"))
        );
        assert_eq!((value("PYTHONPATH"), value("SLURM_NTASKS")), (None, None));
        let place = WorkingFolder::at(std::path::Path::new("folder"), &ProgramConfig::default());
        let of_trial = |before: Option<&String>| BTreeMap::from(of_trial(&place, before));
        let own = "own".to_owned();
        assert_eq!(of_trial(None)["PYTHONPATH"], "folder/.regimen/python");
        assert_eq!(of_trial(Some(&own))["PYTHONPATH"], "own:folder/.regimen/python");
        assert_eq!(of_trial(None)["REGIMEN_LOG"], "folder/.regimen/log.jsonl");
        assert_eq!(
            (value("PYTHONHASHSEED"), value("MPLBACKEND")),
            (Some("0"), Some("Agg"))
        );
    }

    #[test]
    fn libraries_are_told_the_share_of_the_machine() {
        let told = |cores, gpus: Option<&[&str]>| {
            let gpus = gpus.map(|names| names.iter().map(ToString::to_string).collect());
            of_share(&Share { cores, gpus })
        };
        let two = told(3, Some(&["0", "GPU-7"]));
        assert_eq!(
            (
                two["MKL_NUM_THREADS"].as_str(),
                two["CUDA_VISIBLE_DEVICES"].as_str()
            ),
            ("3", "0,GPU-7")
        );
        assert_eq!(told(1, Some(&[]))["CUDA_VISIBLE_DEVICES"], "");
        assert!(!told(1, None).contains_key("CUDA_VISIBLE_DEVICES"));
    }
}
