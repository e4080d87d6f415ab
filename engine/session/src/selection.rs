//! Selected studies and trials, and the command lines that select them.

use execution::executor::quoted;
use std::path::PathBuf;

/// Selected studies, with their budget and the trials to keep.
#[derive(Debug, Clone, Default)]
pub struct Selection {
    /// Study files.
    pub specs: Vec<PathBuf>,
    /// Profile of the study; its own values where absent.
    pub profile: Option<String>,
    /// Values that replace the study's, as `dsac.discount=0.999`.
    pub sets: Vec<String>,
    /// Number of seeds; the study's where absent.
    pub seeds: Option<u64>,
    /// Names of environments and agents whose trials are selected; all where empty.
    pub only: Vec<String>,
}

impl Selection {
    /// Selects a whole study as it is written.
    pub fn of(study: impl Into<PathBuf>) -> Self {
        Self {
            specs: vec![study.into()],
            ..Self::default()
        }
    }

    /// True if the whole study is selected, with its own budget.
    pub(crate) fn is_whole(&self) -> bool {
        self.profile.is_none() && self.only.is_empty()
    }

    /// True if one study is named.
    pub(crate) fn is_one(&self) -> bool {
        self.specs.len() == 1
    }

    /// The options that select among the trials of the studies, as words of a command line.
    pub(crate) fn options(&self) -> Vec<String> {
        let mut all = Vec::new();
        let mut with = |name: &str, value: &str| all.extend([name.to_owned(), value.to_owned()]);
        self.profile.iter().for_each(|profile| with("--profile", profile));
        self.sets.iter().for_each(|set| with("--set", set));
        self.seeds
            .iter()
            .for_each(|seeds| with("--seeds", &seeds.to_string()));
        self.only.iter().for_each(|name| with("--only", name));
        all
    }
}

/// Options of the machine that replace those of `regimen.toml`.
#[derive(Debug, Clone, Default)]
pub struct MachineOptions {
    /// Folder of the store.
    pub store: Option<PathBuf>,
    /// Bucket by which stores are shared, as `s3://bucket/prefix`.
    pub bucket: Option<String>,
    /// Profile of `regimen.toml`.
    pub machine: Option<String>,
    /// Largest file that is read, in megabytes.
    pub input_mb: Option<u64>,
}

impl MachineOptions {
    /// The same as words of a command line, without the store.
    pub(crate) fn words(&self) -> impl Iterator<Item = String> {
        let machine = self.machine.iter().map(|name| ("--machine", name.clone()));
        let input = self.input_mb.iter().map(|size| ("--input-mb", size.to_string()));
        let bucket = self.bucket.iter().map(|url| ("--bucket", url.clone()));
        machine
            .chain(input)
            .chain(bucket)
            .flat_map(|(option, value)| [option.to_owned(), value])
    }
}

/// The command `verb` for a selection, with `more` words at its end, ready to be pasted.
pub(crate) fn command(selection: &Selection, machine: &MachineOptions, verb: &str, more: &[&str]) -> String {
    let specs = selection.specs.iter().map(|path| path.display().to_string());
    let store = machine
        .store
        .iter()
        .flat_map(|store| ["--store".to_owned(), store.display().to_string()]);
    let words = ["regimen".to_owned(), verb.to_owned()]
        .into_iter()
        .chain(specs)
        .chain(selection.options())
        .chain(store)
        .chain(machine.words())
        .chain(more.iter().map(|&word| word.to_owned()));
    words.map(|word| quoted(&word)).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shown_command_says_what_the_given_one_said() {
        let selection = Selection {
            specs: vec!["a b.yaml".into()],
            profile: Some("smoke".into()),
            sets: vec!["dsac.weights=[1, 2]".into(), "x.y='".into()],
            seeds: Some(2),
            only: vec!["dsac".into()],
        };
        let machine = MachineOptions {
            store: Some("else/where".into()),
            ..MachineOptions::default()
        };
        assert_eq!(
            command(&selection, &machine, "run", &["--retry-failed"]),
            "regimen run 'a b.yaml' --profile smoke --set 'dsac.weights=[1, 2]' --set 'x.y='\\''' --seeds 2 \
             --only dsac \
             --store else/where --retry-failed"
        );
    }
}
