//! The source code from which a program was built, according to the program itself.

use serde::{Deserialize, Serialize};
use std::fmt::{self, Display, Formatter};

/// The state of the source code from which a program was built.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Build {
    /// Hash of the commit, in hexadecimal digits.
    pub commit: String,
    /// Whether files of the program differed from the commit.
    pub changed: bool,
}

impl Build {
    /// The build that a build script passed to the compiler; `None` if it knew no commit.
    #[must_use]
    pub fn told(commit: &str, changed: &str) -> Option<Self> {
        (!commit.is_empty()).then(|| Self {
            commit: commit.into(),
            changed: changed == "true",
        })
    }
}

impl Display for Build {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        write!(
            out,
            "{}{}",
            self.commit,
            if self.changed { ", with changed files" } else { "" }
        )
    }
}

/// A program's version and build.
#[must_use]
pub fn version(build: Option<&Build>) -> String {
    let build = build.map_or_else(|| "from unknown source code".into(), ToString::to_string);
    format!("{} ({build})", env!("CARGO_PKG_VERSION"))
}

/// The number of trials that each program computed, as text.
#[must_use]
pub fn tally(builds: &[(Option<Build>, usize)]) -> String {
    let words = builds.iter().enumerate().map(|(place, (build, count))| {
        let noun = match (place, count) {
            (0, 1) => " trial",
            (0, _) => " trials",
            _ => "",
        };
        let build = build
            .as_ref()
            .map_or_else(|| "a program that did not say".into(), ToString::to_string);
        format!("{count}{noun} by {build}")
    });
    words.collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn builds_are_counted_in_words() {
        let (clean, changed) = (
            Build::told("ffa07ec12345", "false"),
            Build::told("0123456789ab", "true"),
        );
        let builds = [(clean.clone(), 57), (changed, 3), (Build::told("", "false"), 2)];
        let words = "57 trials by ffa07ec12345; 3 by 0123456789ab, with changed files; 2 by a program that \
                     did not say";
        assert_eq!(tally(&builds), words);
        assert_eq!(tally(&[(clean, 1)]), "1 trial by ffa07ec12345");
        assert_eq!(tally(&[]), "");
    }

    #[test]
    fn a_program_says_what_it_was_built_from() {
        let number = env!("CARGO_PKG_VERSION");
        let build = Build::told("ffa07ec12345", "true");
        assert_eq!(
            version(build.as_ref()),
            format!("{number} (ffa07ec12345, with changed files)")
        );
        assert_eq!(version(None), format!("{number} (from unknown source code)"));
    }
}
