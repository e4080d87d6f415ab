//! What a command line selected, as words of another one.

use super::Selection;

impl Selection {
    /// What selects among the trials of the studies, as words of a command line.
    pub(super) fn options(&self) -> Vec<String> {
        let mut all = Vec::new();
        let mut with = |name: &str, value: &str| all.extend([name.to_owned(), value.to_owned()]);
        self.profile.iter().for_each(|profile| with("--profile", profile));
        self.sets.iter().for_each(|set| with("--set", set));
        self.seeds.iter().for_each(|seeds| with("--seeds", &seeds.to_string()));
        self.only.iter().for_each(|name| with("--only", name));
        all
    }
}
