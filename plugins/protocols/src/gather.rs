//! Protocol `gather`: whole episodes of an agent that does not learn, kept as a dataset from which others
//! learn.
//!
//! Episode `k` has random numbers of its own, which no measurement uses. The episodes gathered so far are part
//! of the trial's state, so a trial that was stopped ends with the same bytes.

use contract::{
    ArtifactKind, Config, Error, Interface, Metric, Mode, Protocol, Registry,
    dataset::{self, Dataset, DatasetWriter, Episode},
    protocol::{self, Kept, Measurement, Position, Run, measure_and_keep},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{cell::RefCell, collections::BTreeMap, path::Path};

/// Settings of the `gather` protocol.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct EpisodeGathering {
    /// Episodes of the dataset.
    #[schemars(range(min = 1))]
    pub episodes: u64,
    /// Mode in which the agent acts.
    pub mode: GatherMode,
}

/// Mode in which an agent acts while its episodes are kept.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GatherMode {
    /// As during training: policies that sample their actions explore.
    #[default]
    Train,
    /// As in an evaluation.
    Evaluate,
}

impl Default for EpisodeGathering {
    fn default() -> Self {
        Self {
            episodes: 200,
            mode: GatherMode::default(),
        }
    }
}

impl Config for EpisodeGathering {}

pub(super) fn register(registry: &mut Registry) {
    registry.protocol(
        "gather",
        1,
        "Keep whole episodes of an agent as a dataset; nothing is learned.",
        |config: EpisodeGathering| config,
        |config| Ok(Box::new(config)),
    );
}

impl Protocol for EpisodeGathering {
    fn metrics(&self) -> Vec<Metric> {
        protocol::measurement_metrics()
    }

    fn accepts(&self, interface: &Interface, _: &[Metric]) -> Result<(), Error> {
        dataset::can_hold(interface)
    }

    fn leaves(&self) -> Vec<ArtifactKind> {
        vec![ArtifactKind::Dataset]
    }

    fn write_stub(&self, interface: &Interface, folder: &Path) -> Result<(), Error> {
        Dataset::write_empty(folder, interface)
    }

    fn total_steps(&self) -> u64 {
        self.episodes
    }

    fn experience(&self) -> u64 {
        0
    }

    fn run(&self, run: &mut Run<'_>) -> Result<(), Error> {
        let environment = (run.make_environment)()?;
        let interface = environment.interface();
        self.accepts(&interface, environment.metrics())?;
        let position: Option<Position<Vec<Episode>>> = run.resume()?;
        let (before, blocks) =
            position.map_or((None, None), |position| (position.learning, position.measuring));
        let kept: Kept = RefCell::new((0..).zip(before.unwrap_or_default()).collect());
        // Between blocks all earlier episodes have ended.
        let so_far = || Some(kept.borrow().values().cloned().collect::<Vec<Episode>>());
        measure_and_keep(run, &self.episodes_to_keep(), blocks, so_far, Some(&kept))?;
        (run.progress)(self.episodes, self.episodes);
        run.folder
            .map_or(Ok(()), |folder| write(folder, &interface, &kept.borrow()))
    }
}

impl EpisodeGathering {
    fn episodes_to_keep(&self) -> Measurement {
        let mode = match self.mode {
            GatherMode::Train => Mode::Train,
            GatherMode::Evaluate => Mode::Evaluate,
        };
        Measurement::to_gather(self.episodes, mode)
    }
}

fn write(folder: &Path, interface: &Interface, kept: &BTreeMap<u64, Episode>) -> Result<(), Error> {
    let mut writer = DatasetWriter::create(folder, interface).map_err(Error::of_store)?;
    for episode in kept.values() {
        writer.episode(episode).map_err(Error::of_store)?;
    }
    writer.finish().map_err(Error::of_store)
}
