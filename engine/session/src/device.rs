//! The device on which the learners of a run compute.

use crate::{Failure, compute::Compute};
use execution::device::{self, Server};

/// Worker processes for each core: eight with a device, so that while it computes for one the environment of another goes
/// on.
pub(crate) fn workers_of_a_core(device: &str) -> usize {
    if device == device::PROCESSOR { 1 } else { 8 }
}

/// Opens the device of learners, where one is wanted: on every card of this machine, where it has cards.
pub(crate) fn open(
    how: &mut Compute<'_>,
    name: Option<&str>,
    jobs: Option<usize>,
    is_here: bool,
) -> Result<(), Failure> {
    let settings = &how.session.settings;
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
    let name = name.unwrap_or(&settings.device);
    if name == device::PROCESSOR {
        return Ok(());
    }
    let kind = device::find(how.session.registry, name)?;
    let start = |card: Option<&str>| {
        Server::start(kind, card).map_err(|error| {
            let on_cores = format!("without `--device {name}` the trials run on cores, with the same bits");
            Failure::refusal(format!("--device {name}: {error}; {on_cores}"))
        })
    };
    how.devices = match &settings.gpus[..] {
        [] => vec![start(None)?],
        cards => cards
            .iter()
            .map(|card| start(Some(card)))
            .collect::<Result<_, _>>()?,
    };
    if jobs.is_none() {
        how.workers *= workers_of_a_core(name);
    }
    Ok(())
}
