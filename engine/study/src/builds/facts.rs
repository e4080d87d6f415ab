//! Facts on the environments of a study. An environment is made and tried out, unless its announcement is known.

use super::{BuildResult, Builder, built};
use crate::cell::Cell;
use contract::{Environment, Error, Interface, Metric};
use execution::patience;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

/// Facts on a built environment.
#[derive(Serialize, Deserialize)]
pub(super) struct Facts {
    pub(super) interface: Interface,
    pub(super) metrics: Vec<Metric>,
    pub(super) traced: BTreeSet<String>,
    /// Units of trace channels, by name.
    pub(super) units: BTreeMap<String, String>,
}

impl Facts {
    fn of(environment: &dyn Environment) -> Self {
        let channels = environment.trace_channels().into_iter();
        Self {
            traced: traced(environment),
            units: channels.map(|channel| (channel.name, channel.unit)).collect(),
            metrics: environment.metrics().to_vec(),
            interface: environment.interface(),
        }
    }
}

impl Builder<'_> {
    /// Makes the environment of a cell and tries it out, once.
    ///
    /// # Errors
    /// Errors of the environment.
    pub(super) fn environment(&mut self, cell: &Cell) -> BuildResult<()> {
        let resolved = &cell.parts[0];
        if self.environments.contains_key(resolved.id()) {
            return Ok(());
        }
        let known = self.sections.announced;
        if let Some(facts) = known.and_then(|known| known.recall::<Facts>(resolved.id())) {
            self.is_recalled = true;
            self.announced.insert(resolved.id().to_owned(), json!(facts));
            self.environments
                .insert(resolved.id().to_owned(), Some(Arc::new(facts)));
            return Ok(());
        }
        let entry = &self.sections.registry.environments[resolved.part.plugin.as_str()];
        let tried = || {
            let mut environment = (entry.build)(&self.config(cell, 0)?)?;
            let doubts = environment.rehearse()?;
            Ok((environment, doubts))
        };
        let (facts, refusal) = match patience::under(self.sections.limits, || built(tried)) {
            Ok((environment, doubts)) => {
                let facts = Facts::of(&*environment);
                if doubts.is_some() {
                    self.announced.insert(resolved.id().to_owned(), json!(facts));
                }
                let warning = |doubt: &Error| self.refused(resolved, doubt).as_warning();
                let doubts: Vec<_> = doubts.iter().flatten().map(warning).collect();
                self.doubts.extend(doubts);
                (Some(Arc::new(facts)), None)
            }
            Err(error) => (None, Some(Box::new(self.refused(resolved, &error)))),
        };
        self.environments.insert(resolved.id().to_owned(), facts);
        refusal.map_or(Ok(()), Err)
    }

    /// Facts on the environment of a cell, if it could be built.
    pub(super) fn facts(&self, cell: &Cell) -> Option<Arc<Facts>> {
        self.environments.get(cell.parts[0].id())?.clone()
    }
}

/// Names of the values that an environment traces.
fn traced(environment: &dyn Environment) -> BTreeSet<String> {
    let channels = environment
        .trace_channels()
        .into_iter()
        .map(|channel| channel.name);
    channels
        .chain(
            environment
                .static_trace()
                .into_iter()
                .flat_map(|trace| trace.names),
        )
        .collect()
}
