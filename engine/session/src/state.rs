//! How far a study is: how its trials ended, what the missing ones wait for, and what they will cost.

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

/// Stored trials among which the nearest to a missing one is looked for.
const MOST_STORED: usize = 500_000;

/// How far a study is.
pub struct StudyState {
    /// How its trials ended; `None` where one is missing.
    pub ends: Vec<Option<TrialEnd>>,
    /// Why missing trials are not stored, where that was asked for.
    pub novelties: Vec<Novelty>,
    /// The missing trials that take what others leave.
    pub waiting: Waiting,
    /// About how long the missing trials take.
    pub estimate: Estimate,
    /// The same on each device on which stored trials were computed.
    pub on_devices: Vec<DeviceEstimate>,
}

/// About how long missing trials take on a device.
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
    /// How far a study is; its trials are each in the plan once then. `explained` asks why missing trials are not
    /// stored.
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
        // Where every trial is there, nothing else of the store is looked at.
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

/// The trials that have ended, and how.
fn known<'a>(trials: &'a [Arc<Trial>], ends: &'a [Option<TrialEnd>]) -> Vec<(&'a Trial, &'a TrialEnd)> {
    let known = trials.iter().zip(ends);
    known
        .filter_map(|(trial, end)| Some((&**trial, end.as_ref()?)))
        .collect()
}

/// An estimate for the trials that are missing and not blocked, from stored ones of a device.
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
