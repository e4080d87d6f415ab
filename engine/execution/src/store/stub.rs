//! A trial for tests of the store.

use contract::{
    cast::Actors,
    part::Part,
    trial::{Trial, TrialCell, TrialKey},
};
use serde_json::json;

/// A trial of an environment with `cells` cells.
pub(super) fn trial(cells: u32, seed: u64) -> Trial {
    let part = |plugin: &str| Part::new(plugin, 1, json!({ "cells": cells }));
    let key = TrialKey {
        environment: part("battery").into(),
        agent: Actors::Agent(part("equal")).into(),
        protocol: part("evaluate").into(),
        seed,
        numerics: 1,
    };
    Trial {
        id: key.id(),
        cell: TrialCell::of("four", "equal").into(),
        key,
    }
}
