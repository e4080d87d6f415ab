//! The device on which the learners of a run compute.

use crate::{Failure, Session};
use execution::device::{self, DeviceKind, Server};

/// Worker processes for each core. With a device there are eight: while the device computes for one, the environments
/// of others continue.
pub(crate) fn workers_of_a_core(device: &str) -> usize {
    if device == device::PROCESSOR { 1 } else { 8 }
}

/// Finds the device of a run: the device of this name, or that of the machine without a name. `None` if learners
/// compute in the worker processes. The device is not opened yet.
pub(crate) fn choose<'a>(
    session: &Session<'a>,
    name: Option<&str>,
    is_here: bool,
) -> Result<Option<&'a DeviceKind>, Failure> {
    let name = match name {
        // Workers on other machines read `regimen.toml` themselves.
        None if !is_here => device::PROCESSOR,
        None => &session.settings.device,
        Some(name) => name,
    };
    if name == device::PROCESSOR {
        return Ok(None);
    }
    if !is_here {
        return Err(Failure::refusal(format!(
            "--device {name} is about this machine, and an executor computes the trials on others: write `device = \
             \"{name}\"` in the regimen.toml that they read"
        )));
    }
    Ok(Some(device::find(session.registry, name)?))
}

/// Opens a device on every card of `cards`; once, without a card, if the list is empty.
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
