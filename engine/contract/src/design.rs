//! Designs that a search chose: the content of `choice.json` of its trial, which other trials build again.

use crate::{Error, Space};
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, fs, path::Path};

/// The file of chosen designs inside a trial's folder.
pub const FILE: &str = "choice.json";

/// One design: the actions at each step of an episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Design {
    /// Place among the candidates of the search, from 0.
    pub candidate: u64,
    /// Return when the search tried it.
    pub observed_return: f64,
    /// The metric by which it was chosen; absent if that is the return.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chosen_by: Option<Observed>,
    /// The action of the only seat, step by step.
    pub actions: Vec<Vec<f64>>,
    /// The same as names, if the actions are choices: the option by the name of its choice, step by step.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub options: Vec<BTreeMap<String, String>>,
}

/// A metric of the environment, as a search observed it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Observed {
    /// Name of the metric.
    pub metric: String,
    /// Value over the episode.
    pub value: f64,
}

/// The best designs of a search, the best one first; no two of them have the same options.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Designs {
    /// The designs, the best one first.
    pub designs: Vec<Design>,
}

impl Designs {
    /// Reads the designs that a search left in the folder of its trial.
    ///
    /// # Errors
    /// [`Error::File`] if the file is missing, [`Error::Damaged`] if it has other content.
    pub fn read(folder: &Path) -> Result<Self, Error> {
        let path = folder.join(FILE);
        let bytes = fs::read(&path).map_err(Error::file("read", &path))?;
        serde_json::from_slice(&bytes).map_err(|error| Error::Damaged {
            path,
            problem: format!("these are no designs: {error}"),
        })
    }

    /// Writes the designs into the folder of a trial.
    ///
    /// # Errors
    /// [`Error::File`] if the file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), Error> {
        let path = folder.join(FILE);
        // Numbers, strings and lists can always be written as JSON. Returns are finite, which the record checks.
        let text = serde_json::to_vec_pretty(self).expect("designs serialise");
        fs::write(&path, text).map_err(Error::file("write", &path))
    }
}

/// The options that actions select, by the names of their choices; empty for actions of another kind.
///
/// # Errors
/// [`Error::Action`] for an action outside this space.
pub fn in_words(space: &Space, actions: &[Vec<f64>]) -> Result<Vec<BTreeMap<String, String>>, Error> {
    let Space::Choices(choices) = space else {
        return Ok(Vec::new());
    };
    let named = |action: &Vec<f64>| {
        let taken = crate::choice::taken(choices, action)?;
        let pairs = choices.iter().zip(taken);
        Ok(pairs
            .map(|(choice, at)| (choice.name.clone(), choice.options[at].clone()))
            .collect())
    };
    actions.iter().map(named).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Choice;

    #[test]
    fn designs_are_read_back_and_another_file_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let space = Space::Choices(vec![Choice::new("norm", &["none", "batch"])]);
        let actions = vec![vec![-0.5, 0.25], vec![1.0, -1.0]];
        let options = in_words(&space, &actions).unwrap();
        assert_eq!(options[0]["norm"], "batch");
        assert_eq!(options[1]["norm"], "none");
        let design = Design {
            candidate: 7,
            observed_return: 1.5,
            chosen_by: None,
            actions,
            options,
        };
        let designs = Designs {
            designs: vec![design],
        };
        designs.write(folder.path()).unwrap();
        assert_eq!(Designs::read(folder.path()).unwrap(), designs);
        fs::write(folder.path().join(FILE), "{\"designs\": 3}").unwrap();
        let text = Designs::read(folder.path()).unwrap_err().to_string();
        assert!(
            text.contains("these are no designs") && text.contains(FILE),
            "{text}"
        );
        assert!(matches!(
            Designs::read(&folder.path().join("none")),
            Err(Error::File { .. })
        ));
        assert_eq!(in_words(&Space::Discrete(Vec::new()), &[]).unwrap(), []);
    }
}
