//! The command of a worker.

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A command that is started on another machine: a program with arguments, in a folder that both machines see
/// under the same path.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Work {
    /// The studies, as written on the command line.
    pub specs: Vec<PathBuf>,
    /// Path of this program.
    pub program: PathBuf,
    /// The verb `worker`, the studies, and the options that narrow them.
    pub arguments: Vec<String>,
    /// Folder in which the command runs.
    pub folder: PathBuf,
}

impl Work {
    /// The command for a shell.
    #[must_use]
    pub fn command(&self) -> String {
        let program = self.program.to_string_lossy();
        let words = std::iter::once(program.as_ref()).chain(self.arguments.iter().map(String::as_str));
        words.map(quoted).collect::<Vec<_>>().join(" ")
    }
}

/// A word for a POSIX shell, in quotes if it needs them.
#[must_use]
pub fn quoted(word: &str) -> String {
    let plain = |letter: char| letter.is_ascii_alphanumeric() || "_-./=:@%+,".contains(letter);
    if !word.is_empty() && word.chars().all(plain) {
        word.into()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_come_back_from_a_shell_as_they_were() {
        for word in [
            "plain",
            "",
            "two words",
            "it's",
            "$HOME `id` \"x\"",
            "a\\b",
            "dsac.discount=0.9",
        ] {
            let output = std::process::Command::new("sh")
                .args(["-c", &format!("printf %s {}", quoted(word))])
                .output()
                .unwrap();
            assert_eq!(String::from_utf8(output.stdout).unwrap(), word);
        }
    }

    #[test]
    fn a_command_is_its_program_and_arguments() {
        let work = Work {
            specs: vec!["a b.yaml".into()],
            program: "/opt/regimen".into(),
            arguments: ["worker", "a b.yaml", "-j", "1"].map(Into::into).to_vec(),
            folder: "/work".into(),
        };
        assert_eq!(work.command(), "/opt/regimen worker 'a b.yaml' -j 1");
    }
}
