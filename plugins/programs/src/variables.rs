//! The environment variables of the machine that a program sees: a list, since each of them is an input that nobody
//! declared.

use std::{collections::BTreeMap, ffi::OsString};

/// Passed on as they are; a `*` at the end stands for any letters.
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
/// Decided for every trial: the same hashes, no files of compiled code, output that arrives at once, no windows,
/// nothing sent to a service.
const SET: [(&str, &str); 6] = [
    ("PYTHONHASHSEED", "0"),
    ("PYTHONDONTWRITEBYTECODE", "1"),
    ("PYTHONUNBUFFERED", "1"),
    ("MPLBACKEND", "Agg"),
    ("WANDB_MODE", "offline"),
    ("TERM", "dumb"),
];
/// Libraries that would take all processors of a machine; a trial has one.
const THREADS: [&str; 4] = ["OMP", "OPENBLAS", "MKL", "NUMEXPR"];

/// The variables of a program: those of the machine that are passed on, those that are set for every trial, and
/// those of the study.
pub fn given(inherit: &[String], own: &BTreeMap<String, String>) -> BTreeMap<String, String> {
    #[expect(
        clippy::disallowed_methods,
        reason = "a program is found by the variables of its machine; the study declares all others"
    )]
    let machine = std::env::vars_os();
    chosen(machine, inherit, own)
}

fn chosen(
    machine: impl Iterator<Item = (OsString, OsString)>,
    inherit: &[String],
    own: &BTreeMap<String, String>,
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
    all.extend(THREADS.map(|library| (format!("{library}_NUM_THREADS"), "1".to_owned())));
    all.extend(own.clone());
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
        let own = [("PYTHONHASHSEED".to_owned(), "5".to_owned())].into();
        let all = chosen(machine.into_iter(), &["KEY".to_owned()], &own);
        let value = |name: &str| all.get(name).map(String::as_str);
        assert_eq!(
            (value("PATH"), value("LC_ALL"), value("KEY")),
            (Some("/bin"), Some("C"), Some("s"))
        );
        assert_eq!((value("PYTHONPATH"), value("SLURM_NTASKS")), (None, None));
        assert_eq!(
            (value("OMP_NUM_THREADS"), value("PYTHONHASHSEED")),
            (Some("1"), Some("5"))
        );
    }
}
