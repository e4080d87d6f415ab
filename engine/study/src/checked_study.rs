//! A study that was read and checked.

use super::{cells::Cells, confirmations::Confirmation, repeats::Repeats, resolved};
use ::imported::Imported;
use analysis::{
    results::PaperBudget,
    search::{Progress, Search},
};
use contract::{Metric, trial_result::Success};
use document::diagnostic::Diagnostic;
use execution::limits::Limits;
use presentation::{
    answers::Answer,
    claim_spec::{ClaimSpec, Relevance},
    figure::FigureSpec,
    summary::Summary,
    table::TableSpec,
    vocabulary::Play,
};
use serde_json::Value;
use statistics::spending::SequentialDesign;
use std::{collections::BTreeMap, path::PathBuf};

/// A study that passed every check.
#[derive(Debug, Clone)]
pub struct Study {
    /// Name of the study and of its folder of results.
    pub name: String,
    /// Subject of the study, as a heading; empty where absent.
    pub title: String,
    /// Source of the published numbers; empty where absent.
    pub source: String,
    /// Name of the family of studies whose verdicts are read together; the study is a family of its own if absent.
    pub family: Option<String>,
    /// Summary of the results, with placeholders; `None` if absent.
    pub summary: Option<Summary>,
    /// Its lines in the answers of all studies.
    pub answers: Vec<Answer>,
    /// Deviations from the source, one sentence each.
    pub deviations: Vec<String>,
    /// Names of the environments, in order.
    pub environments: Vec<String>,
    /// Names of the agents, in order.
    pub agents: Vec<String>,
    /// All seeds that the study may use.
    pub seeds: Vec<u64>,
    /// The looks at which seeds are added until everything that is judged is decided; `None` if the number of seeds is
    /// fixed.
    pub design: Option<SequentialDesign>,
    /// The criterion by which a seed counts as a success.
    pub success: Option<Success>,
    /// Length of the source's training.
    pub paper_budget: Option<PaperBudget>,
    /// Floors: a trained agent has learned if it is better than all of them.
    pub floors: Vec<String>,
    /// The difference that matters for claims that name none.
    pub relevance: Option<Relevance>,
    /// The profile that was used.
    pub profile: Option<String>,
    /// Names of all its profiles, in order.
    pub profiles: Vec<String>,
    /// Tables by name, in order.
    pub tables: Vec<(String, TableSpec)>,
    /// Figures by name, in order.
    pub figures: Vec<(String, FigureSpec)>,
    /// Claims, in order.
    pub claims: Vec<ClaimSpec>,
    /// Plays, in order.
    pub plays: Vec<Play>,
    /// Runs of other programs, in order; their names are among those of the agents.
    pub imported: Vec<Imported>,
    /// Limits of one trial.
    pub limits: Limits,
    /// Whether an environment was not tried out, since its announcement is known.
    pub is_recalled: bool,
    /// Announcements of external environments that were tried out, by id.
    pub announced: BTreeMap<String, Value>,
    /// Doubts: settings that can be run but are probably not intended, sorted by position.
    pub warnings: Vec<Diagnostic>,
    /// Every metric that the trials record, by name. If parts share a name, the metric of the protocol takes
    /// precedence, then that of environments, then that of agents.
    pub metrics: Vec<Metric>,
    /// Names of the entries of `prepare`, in order.
    pub prepared: Vec<String>,
    /// Units of everything that the trials record and trace, by name.
    pub units: BTreeMap<String, String>,
    /// Samples of its sweep, if several of them gave the same setting.
    pub repeats: Option<Repeats>,
    /// Searches for settings, in order, with their progress.
    pub searches: Vec<(Search, Progress)>,
    /// Combinations of environment, agent and setting, then the entries of `prepare`, then the settings that
    /// searches try.
    pub(crate) cells: Cells,
    /// Indices of the cells, each after those from which it takes artifacts.
    pub(crate) order: Vec<usize>,
    /// Version of the shared numerical code.
    pub(crate) numerics: u32,
    /// The sections from which trials are made, with all defaults.
    pub(crate) resolved: Vec<(String, resolved::Section)>,
    /// Folder relative to which data files are found.
    pub(crate) folder: PathBuf,
    /// The files that it includes, in the order in which they were read.
    pub included: Vec<PathBuf>,
    /// Rounds of claims and published values on further seeds, in order; none under a profile and options of the
    /// command line.
    pub confirm: Vec<Confirmation>,
}

impl Study {
    /// The study as which a confirmation is computed: the same combinations with its seeds, its claims and the
    /// published values of its tables. Its name is that of the folder inside the results of this study.
    #[must_use]
    pub fn confirmation(&self, index: usize) -> Self {
        let it = &self.confirm[index];
        let claims = it.claims.iter().filter_map(|claim| self.claims.get(*claim));
        let tables = self.tables.iter().filter(|(name, _)| it.tables.contains(name));
        let tables = tables.map(|(name, spec)| (name.clone(), it.table(spec)));
        Self {
            name: format!("{}/confirm-{}", self.name, index + 1),
            seeds: it.seeds.clone(),
            design: it.design.clone(),
            claims: claims.map(|claim| it.claim(claim)).collect(),
            tables: tables.collect(),
            figures: Vec::new(),
            summary: None,
            answers: Vec::new(),
            confirm: Vec::new(),
            warnings: Vec::new(),
            repeats: None,
            ..self.clone()
        }
    }
}
