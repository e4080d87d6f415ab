//! The record of a study's results: files in its folder of results. From them its report can be made again, and judged
//! by other rules, without the store.
//!
//! | file | what |
//! |---|---|
//! | `evaluations.parquet` | measurements as means over their episodes (`evaluations`) |
//! | `record.json` | everything else that a report says of trials: this module and `cells` |
//! | `manifest.json` | hashes of both; nothing is read that does not have its hash |
//!
//! Tables, claims, published values and texts are not recorded: they come from the study file when a report is made.

mod cells;
mod evaluations;

pub use cells::{RecordedCell, RecordedTrial, ResultIndex, TrialRole, forget_success};
pub use evaluations::{Asks, Block, Blocks, decode, encode};

use crate::{FigureFacts, Manifest, Period, ProfileState, Provenance};
use analysis::{
    results::{SearchResult, Told, TriedSetting},
    search::{Progress, Search},
};
use contract::{
    Error,
    form_version::form_version,
    trial::{Combination, Trial},
};
use execution::store::{SeenVerdicts, write_durably};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::{collections::BTreeMap, path::Path};

/// File name of the record in a folder of results.
pub const FILE: &str = "record.json";
/// File name of the measurements.
pub const EVALUATIONS: &str = "evaluations.parquet";
/// Version of the form of the record.
const SCHEMA: u32 = 1;

/// A record, without its measurements.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// Version of the form of the record.
    pub schema: u32,
    /// Name of the study.
    pub study: String,
    /// The trials that ended, by environment, agent and setting.
    pub cells: Vec<RecordedCell>,
    /// Facts on all trials together, such as their cost.
    pub told: Told,
    /// Programs, plugins and machine behind the results.
    pub provenance: Provenance,
    /// The profiles of the study when a report was made from the store.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub profiles: Vec<ProfileState>,
    /// Period in which the trials ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ended: Option<Period>,
    /// The results of searches, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub searches: BTreeMap<String, Searched>,
    /// The verdicts that were seen, by table and cell, or by claim and place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seen: Option<SeenVerdicts>,
    /// Facts on figures that cannot be drawn from the record.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub figures: BTreeMap<String, FigureFacts>,
    /// Announcements of environments that are not the program's own, by id.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub announced: BTreeMap<String, Value>,
    /// Values of final measurements that have no row in the file of measurements.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub measured: Vec<FinalValue>,
}

/// A value of a trial's final measurement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FinalValue {
    /// Environment of the trial.
    pub environment: String,
    /// Agent of the trial.
    pub agent: String,
    /// Setting of the trial.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub setting: String,
    /// Seed of the trial.
    pub seed: u64,
    /// The metric, as in `rms(error)`.
    pub metric: String,
    /// Value of the metric, a mean over episodes or their root mean square.
    pub value: f64,
}

/// A search, with all facts that its report needs.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Searched {
    /// Progress of the search, which determines the plan.
    pub progress: Progress,
    /// The settings that it tried.
    pub tried: Vec<TriedSetting>,
}

impl Searched {
    /// The search as a result.
    #[must_use]
    pub fn result(&self, search: &Search) -> SearchResult {
        SearchResult {
            search: search.clone(),
            tried: self.tried.clone(),
            chosen: self.progress.chosen,
        }
    }
}

impl Record {
    /// An empty record of the current version.
    #[must_use]
    pub fn of(study: &str) -> Self {
        Self {
            schema: SCHEMA,
            study: study.into(),
            ..Self::default()
        }
    }

    /// Reads the record of a folder, checked against the folder's manifest.
    ///
    /// # Errors
    /// [`Error::Record`] where its hash differs from that of its report, [`Error::Newer`] where a later program wrote
    /// it.
    pub fn read(folder: &Path, manifest: &Manifest) -> Result<Self, Error> {
        Self::parse(&manifest.checked(folder, FILE)?, &folder.join(FILE))
    }

    fn parse(bytes: &[u8], path: &Path) -> Result<Self, Error> {
        let wrong = |source: serde_json::Error| Error::Record {
            path: path.into(),
            problem: format!("holds no record: {source}"),
        };
        let schema = form_version(bytes).map_err(wrong)?;
        if schema > SCHEMA {
            return Err(Error::Newer {
                path: path.into(),
                problem: format!("version {schema} of its form"),
            });
        }
        serde_json::from_slice(bytes).map_err(wrong)
    }

    /// Writes it into a folder.
    ///
    /// # Errors
    /// [`Error::File`] where it cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), Error> {
        let path = folder.join(FILE);
        let text = serde_json::to_string(self)
            .map_err(std::io::Error::from)
            .map_err(Error::file("write", &path))?;
        write_durably(&path, (text + "\n").as_bytes())
    }

    /// Progress of the searches, by name.
    #[must_use]
    pub fn progress(&self) -> BTreeMap<String, Progress> {
        let searches = self.searches.iter();
        searches
            .map(|(name, searched)| (name.clone(), searched.progress.clone()))
            .collect()
    }

    /// Number of seeds, ended or planned, by combination and meeting.
    #[must_use]
    pub fn seeds(&self) -> BTreeMap<Combination, u32> {
        let shown = self.cells.iter().filter(|cell| cell.part == TrialRole::Shown);
        shown.map(|cell| (cell.name(), cell.seeds())).collect()
    }

    /// Whether the record has the time of each trial of a combination, instead of their mean.
    #[must_use]
    pub fn has_times(&self, trial: &Trial) -> bool {
        let cell = self
            .cells
            .iter()
            .find(|cell| cell.name() == trial.cell.combination);
        cell.is_some_and(|cell| cell.mean_wall_s.is_none())
    }

    /// Plugins whose version in the record differs from the current one, as in `environment battery 1, now 2`.
    #[must_use]
    pub fn earlier_versions(&self, now: &[(String, u32)]) -> Vec<String> {
        let was: BTreeMap<&str, u32> = self
            .provenance
            .plugins
            .iter()
            .map(|(name, version)| (name.as_str(), *version))
            .collect();
        let differs = |(name, version): &(String, u32)| {
            let earlier = was.get(name.as_str()).filter(|earlier| *earlier != version)?;
            Some(format!("{name} {earlier}, now {version}"))
        };
        now.iter().filter_map(differs).collect()
    }
}
