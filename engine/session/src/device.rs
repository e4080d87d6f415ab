//! The device on which the learners of a run compute.

use crate::{Failure, compute::Compute};
use execution::device::{self, DeviceKind, Server};

/// Worker processes for each core: eight with a device, so that while it computes for one the environment of another goes
/// on.
pub(crate) fn workers_of_a_core(device: &str) -> usize {
    if device == device::PROCESSOR { 1 } else { 8 }
}

/// Notes the device that a run wants: the one of this name, else that of the machine. Nothing is opened yet.
pub(crate) fn choose(
    how: &mut Compute<'_>,
    name: Option<&str>,
    jobs: Option<usize>,
    is_here: bool,
) -> Result<(), Failure> {
    let session = how.session;
    if !is_here {
        let said = name.filter(|name| *name != device::PROCESSOR);
        // Workers elsewhere read `regimen.toml` themselves.
        return said.map_or(Ok(()), |name| {
            Err(Failure::refusal(format!(
                "--device {name} is about this machine, and an executor computes the trials on others: write `device = \
                 \"{name}\"` in the regimen.toml that they read"
            )))
        });
    }
    let name = name.unwrap_or(&session.settings.device);
    if name != device::PROCESSOR {
        how.device = Some(device::find(session.registry, name)?);
    }
    if jobs.is_none() {
        how.workers *= workers_of_a_core(name);
    }
    Ok(())
}

/// Opens a device: on every card of this machine, where it has cards.
pub(crate) fn open(kind: &DeviceKind, cards: &[String]) -> Result<Vec<Server>, Failure> {
    let start = |card: Option<&str>| {
        Server::start(kind, card).map_err(|error| {
            let name = kind.name;
            let on_cores = format!("without `--device {name}` the trials run on cores, with the same bits");
            Failure::refusal(format!("--device {name}: {error}; {on_cores}"))
        })
    };
    match cards {
        [] => Ok(vec![start(None)?]),
        cards => cards.iter().map(|card| start(Some(card))).collect(),
    }
}
