//! Commands that are shown, to be typed as they stand.

use super::{Common, Selection};

impl Selection {
    /// True where the whole study is selected, with its own budget.
    pub(super) fn is_whole(&self) -> bool {
        self.profile.is_none() && self.only.is_empty()
    }

    /// What selects among the trials of the studies, as words of a command line.
    pub(super) fn options(&self) -> Vec<String> {
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

    /// The command `verb` for the same selection, with more words at its end.
    pub(super) fn command(&self, verb: &str, common: &Common, more: &[&str]) -> String {
        let specs = self.specs.iter().map(|path| path.display().to_string());
        let store = common
            .store
            .iter()
            .flat_map(|store| ["--store".to_owned(), store.display().to_string()]);
        let words = ["regimen".to_owned(), verb.to_owned()]
            .into_iter()
            .chain(specs)
            .chain(self.options());
        let words = words
            .chain(store)
            .chain(common.of_the_machine())
            .chain(more.iter().map(|&word| word.to_owned()));
        words.map(|word| quoted(&word)).collect::<Vec<_>>().join(" ")
    }
}

/// A word as a shell reads it.
fn quoted(word: &str) -> String {
    let plain = |letter: char| letter.is_alphanumeric() || "-_./=:,+@%".contains(letter);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::Format;

    #[test]
    fn a_shown_command_says_what_the_given_one_said() {
        let selection = Selection {
            specs: vec!["a b.yaml".into()],
            profile: Some("smoke".into()),
            sets: vec!["dsac.weights=[1, 2]".into(), "x.y='".into()],
            seeds: Some(2),
            only: vec!["dsac".into()],
        };
        let common = Common {
            store: Some("else/where".into()),
            bucket: None,
            machine: None,
            input_mb: None,
            format: Format::Text,
        };
        assert_eq!(
            selection.command("run", &common, &["--retry-failed"]),
            "regimen run 'a b.yaml' --profile smoke --set 'dsac.weights=[1, 2]' --set 'x.y='\\''' --seeds 2 \
             --only dsac \
             --store else/where --retry-failed"
        );
    }
}
