//! The state of a study: the ends of its trials, the reasons why missing trials wait, and their estimated duration.

use crate::{Failure, Planned, Session, device::workers_of_a_core, planned::total_steps, waiting::Waiting};
use contract::{
    Registry,
    trial::Trial,
    trial_end::{TrialEnd, is_missing},
};
use execution::store::StoredCell;
use serde::Serialize;
use std::{collections::BTreeSet, sync::Arc};
use study::plan::{self, Estimate, Novelty};

/// Maximum number of stored trials that are searched for the one nearest to a missing trial.
const MOST_STORED: usize = 500_000;

/// The state of a study.
pub struct StudyState {
    /// The ends of its trials; `None` if a trial is missing.
    pub ends: Vec<Option<TrialEnd>>,
    /// The reasons why missing trials are not stored, if they were requested.
    pub novelties: Vec<Novelty>,
    /// The missing trials that take what others leave.
    pub waiting: Waiting,
    /// Estimated duration of the missing trials.
    pub estimate: Estimate,
    /// The same for each device that computed stored trials.
    pub on_devices: Vec<DeviceEstimate>,
}

/// Estimated duration of missing trials on a device.
#[derive(Debug, Clone, Serialize)]
pub struct DeviceEstimate {
    /// Name of the device.
    pub device: String,
    /// Worker processes of a run on it.
    pub workers: usize,
    /// The time.
    #[serde(flatten)]
    pub estimate: Estimate,
}

impl Session<'_> {
    /// The state of a study. Repeated trials are removed from its plan. `explained` requests the reasons why missing
    /// trials are not stored.
    ///
    /// # Errors
    /// A store that cannot be opened.
    pub fn state(&self, one: &mut Planned, explained: bool) -> Result<StudyState, Failure> {
        let store = self.store()?;
        one.plan.keep_once();
        let (ends, is_damaged) = self.ends_and_damage(store, one);
        let trials = &one.plan.trials;
        if is_damaged {
            self.notice(&format!(
                "`{}` sets aside what is damaged and runs it again",
                self.command("run", &[])
            ));
        }
        let known = known(trials, &ends);
        // If every trial is stored, the rest of the store is not read.
        let cells = match explained {
            true if known.len() == trials.len() => Vec::new(),
            true => store.cells(&known, MOST_STORED),
            false => store.cells(&known, 0),
        };
        let waiting = Waiting::of(trials, &ends, store);
        let estimate = |device: Option<&str>| estimate(self.registry, (one, &ends), &waiting, device, &cells);
        let devices: BTreeSet<&String> = cells.iter().filter_map(|cell| cell.device.as_ref()).collect();
        let on_device = |device: &String| DeviceEstimate {
            device: device.clone(),
            workers: self.settings.workers * workers_of_a_core(device),
            estimate: estimate(Some(device)),
        };
        Ok(StudyState {
            novelties: match explained {
                true => plan::novelties(trials, &ends, &cells),
                false => Vec::new(),
            },
            estimate: estimate(None),
            on_devices: devices.into_iter().map(on_device).collect(),
            waiting,
            ends,
        })
    }
}

/// The trials that have ended, with their ends.
fn known<'a>(trials: &'a [Arc<Trial>], ends: &'a [Option<TrialEnd>]) -> Vec<(&'a Trial, &'a TrialEnd)> {
    let known = trials.iter().zip(ends);
    known
        .filter_map(|(trial, end)| Some((&**trial, end.as_ref()?)))
        .collect()
}

/// An estimate for the trials that are missing and not blocked, from trials that a device computed.
fn estimate(
    registry: &Registry,
    (one, ends): (&Planned, &[Option<TrialEnd>]),
    waiting: &Waiting,
    device: Option<&str>,
    stored: &[StoredCell],
) -> Estimate {
    let trials = one.plan.trials.iter().zip(&one.costs).zip(ends).enumerate();
    let missing = trials
        .filter(|(index, (_, end))| is_missing(end.as_ref()) && !waiting.is_blocked(*index))
        .map(|(_, ((trial, cost), _))| (&**trial, *cost));
    plan::estimate(missing, device, stored, |key| {
        total_steps(registry, key).unwrap_or(0)
    })
}
