//! Running a trial: its parts are built from a registry, and its protocol is run.

use crate::{
    Agent, Error, Interface, Keeper, Recorder, Registry,
    artifact::{FindArtifact, no_artifact},
    cast::{Actors, Team},
    own_training::{Assignment, Simulator},
    protocol::Run,
    random::Streams,
    trial::TrialKey,
};
use serde_json::Value;
use std::{collections::BTreeMap, path::Path};

impl TrialKey {
    /// Like [`run_after`](Self::run_after), for a trial that takes no artifact from another one.
    ///
    /// # Errors
    /// The errors of that function, and [`Error::Source`] for a trial that takes artifacts.
    pub fn run(
        &self,
        registry: &Registry,
        folder: Option<&Path>,
        progress: &mut dyn FnMut(u64, u64),
        keeper: &mut dyn Keeper,
    ) -> Result<Recorder, Error> {
        self.run_after(registry, &no_artifact, folder, progress, keeper)
    }

    /// Builds the parts and runs the protocol from the state that `keeper` has of this trial, or from the start;
    /// `progress` receives the steps done and the total steps. `find` looks up artifacts of other trials; artifacts of
    /// this one go into `folder`.
    ///
    /// # Errors
    /// Errors of plugins, [`Error::Source`] for an artifact of another trial that cannot be used, and
    /// [`Error::Stopped`] if `keeper` asked the trial to stop.
    pub fn run_after(
        &self,
        registry: &Registry,
        find: FindArtifact<'_>,
        folder: Option<&Path>,
        progress: &mut dyn FnMut(u64, u64),
        keeper: &mut dyn Keeper,
    ) -> Result<Recorder, Error> {
        loop {
            match self.attempt(registry, find, folder, progress, keeper) {
                // The checkpoint of the trial does not fit it: the next attempt loads an older one or starts again.
                Err(Error::Checkpoint { .. }) if keeper.refuse() => {}
                outcome => return outcome,
            }
        }
    }

    fn attempt(
        &self,
        registry: &Registry,
        find: FindArtifact<'_>,
        folder: Option<&Path>,
        progress: &mut dyn FnMut(u64, u64),
        keeper: &mut dyn Keeper,
    ) -> Result<Recorder, Error> {
        let environment = find_entry(&registry.environments, "environment", &self.environment.plugin)?;
        let protocol = find_entry(&registry.protocols, "protocol", &self.protocol.plugin)?;
        let protocol = (protocol.build)(&self.protocol.loaded(find)?)?;
        let config = self.environment.loaded(find)?;
        let make_environment = || (environment.build)(&config);
        let streams = Streams::new(
            &self.id(),
            &self.environment.stream_id(&environment.about),
            self.seed,
        );
        // It is kept until the trial ends, and with it the data that the environments of a trial share.
        let first_environment = make_environment()?;
        let interface = first_environment.interface();
        let agent = self.build_agent(registry, &interface, &streams, find)?;
        let record = Recorder::default();
        let assignment = Assignment {
            simulator: self.simulator(&streams),
            ..self.assignment(environment.named(&config))
        };
        let mut run = Run {
            make_environment: &make_environment,
            agent,
            streams,
            record,
            progress,
            assignment,
            keeper,
            folder,
        };
        let ran = protocol.run(&mut run).and_then(|()| run.record.all_finite());
        if let Err(error) = ran {
            run.keeper.fails(&run.record);
            return Err(error);
        }
        if let (Some(folder), Actors::Agent(_)) = (folder, &*self.agent) {
            run.agent.export(folder).map_err(Error::of_store)?;
        }
        Ok(run.record)
    }

    /// The task of an agent that trains itself; the protocol adds its length.
    fn assignment(&self, environment: Value) -> Assignment {
        Assignment {
            trial: self.id(),
            seed: self.seed,
            environment,
            ..Assignment::default()
        }
    }

    /// Description of the environment for other programs, which need not know where the study was started.
    fn simulator(&self, streams: &Streams) -> Simulator {
        let mut config = self.environment.config.whole().into_owned();
        for key in self.environment.files.keys() {
            if let Some(Value::String(path)) = config.pointer_mut(key)
                && let Ok(absolute) = std::path::absolute(&*path)
            {
                *path = absolute.display().to_string();
            }
        }
        Simulator {
            plugin: self.environment.plugin.clone(),
            config,
            stream_id: streams.environment_id().to_owned(),
        }
    }

    /// The agent or the policies, newly made; `find` as in [`run_after`](Self::run_after).
    ///
    /// # Errors
    /// The error of the constructor, and [`Error::Source`] for an artifact that cannot be used.
    pub fn build_agent(
        &self,
        registry: &Registry,
        interface: &Interface,
        streams: &Streams,
        find: FindArtifact<'_>,
    ) -> Result<Box<dyn Agent>, Error> {
        match &*self.agent {
            Actors::Cast(cast) => Ok(Box::new(Team::assemble(
                cast, registry, interface, streams, find,
            )?)),
            Actors::Agent(part) => {
                let entry = find_entry(&registry.agents, "agent", &part.plugin)?;
                (entry.build)(&part.loaded(find)?, interface, &mut streams.agent("initialise"))
            }
        }
    }
}

fn find_entry<'a, T>(entries: &'a BTreeMap<&'static str, T>, kind: &str, name: &str) -> Result<&'a T, Error> {
    entries
        .get(name)
        .ok_or_else(|| Error::config(kind, format!("`{name}` is not registered in this program")))
}
