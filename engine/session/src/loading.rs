//! Reads, checks and plans studies.

use crate::{
    Exit, Failure, Planned, Selection, Session, absent, confirmations, fitting::Machines, looks, searches,
};
use contract::{
    Registry,
    trial_end::{EndState, TrialEnd},
};
use document::{
    count::{count, either},
    diagnostic::{self, Diagnostic},
};
use execution::store::{Announcements, Store};
use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};
use study::{Study, plan::Wanted};

/// A study that cannot be planned: its file, and all its problems.
pub type Refused = (PathBuf, Vec<Diagnostic>);

/// A valid study, with the number of its selected trials.
pub type Checked = (usize, Study);

/// Studies that were checked.
pub struct Check {
    /// The valid studies.
    pub good: Vec<Checked>,
    /// The invalid studies.
    pub refused: Vec<Refused>,
    /// The reason why nothing is selected although all studies are valid, if names are given.
    pub unselected: Option<Failure>,
}

impl Session<'_> {
    /// Plans all selected studies, each followed by its confirmations. The failure holds every problem of every file.
    ///
    /// # Errors
    /// Studies that are wrong, and a selection without trials.
    pub fn load(&self) -> Result<Vec<Planned>, Failure> {
        self.load_with(None)
    }

    fn load_with(&self, announced: Option<&Announcements>) -> Result<Vec<Planned>, Failure> {
        let (planned, refused) = self.read(announced);
        if let Some(failure) = Failure::studies(refused.iter().map(|(_, problems)| problems)) {
            return Err(failure);
        }
        self.selects_something(&planned)?;
        Ok(confirmations::planned(planned, self.registry))
    }

    /// Like [`load`](Self::load), with the settings and looks that follow from the stored results.
    ///
    /// # Errors
    /// The errors of [`load`](Self::load), and a store that cannot be read.
    pub fn load_with_looks(&self) -> Result<Vec<Planned>, Failure> {
        let store = self.store()?;
        let mut planned = self.load_with(Some(&Announcements::of(store.root())))?;
        if let Some(warning) = absent::if_new(store.root()) {
            self.notice(&warning);
        }
        for one in &mut planned {
            self.grow_one(one, store)?;
        }
        confirmations::follow(&mut planned, self.registry);
        Ok(planned)
    }

    /// Extends a study as far as the stored results ask, including results that other machines share.
    fn grow_one(&self, one: &mut Planned, store: &Store) -> Result<(), Failure> {
        let mut said = BTreeSet::new();
        loop {
            let planned = one.plan.trials.len();
            let fetched = store.fetch(one.plan.trials.iter().map(|trial| trial.id.as_str()))?;
            for damage in fetched.damaged {
                let text =
                    format!("warning: {damage}; its trial counts as missing, and `run` computes it again");
                if said.insert(damage) {
                    self.notice(&text);
                }
            }
            searches::grow(one, self.registry, store)?;
            looks::grow(one, self.registry, store);
            // Without new trials or results there is nothing more to add.
            if fetched.taken == 0 && one.plan.trials.len() == planned || store.bucket().is_none() {
                return Ok(());
            }
        }
    }

    /// Extends every study with searches or planned looks as far as its results ask; true if trials were added.
    ///
    /// # Errors
    /// A setting that a search proposes and a plugin refuses, and a store that cannot be read.
    pub fn grow(&self, planned: &mut [Planned]) -> Result<bool, Failure> {
        let store = self.store()?;
        let mut grown = false;
        for one in &mut *planned {
            if searches::grow(one, self.registry, store)? {
                for line in searches::lines(one) {
                    self.notice(&format!("{}:{line}", one.study.name));
                }
                grown = true;
            }
            if looks::grow(one, self.registry, store) {
                let line = looks::line(one).unwrap_or_default();
                self.notice(&format!("{}:{line}", one.study.name));
                grown = true;
            }
        }
        confirmations::follow(planned, self.registry);
        Ok(grown)
    }

    /// The studies that can be planned, and the others.
    fn read(&self, announced: Option<&Announcements>) -> (Vec<Planned>, Vec<Refused>) {
        let (mut planned, mut refused) = (Vec::new(), Vec::new());
        for path in &self.selection.specs {
            match load_one(
                self.registry,
                path,
                &self.selection.only,
                options(&self.selection, announced),
            ) {
                Ok(one) => planned.push(one),
                Err(problems) => refused.push((path.clone(), problems)),
            }
        }
        (planned, refused)
    }

    /// Fails if no trial is selected, or if a selected name is in no study.
    fn selects_something(&self, planned: &[Planned]) -> Result<(), Failure> {
        if let Some(text) = absent::unknown_names(planned, &self.selection.only) {
            return Err(Failure {
                exit: Exit::NothingSelected,
                text,
            });
        }
        // A search has no trials before its first settings are chosen.
        if planned
            .iter()
            .all(|one| one.plan.trials.is_empty() && one.study.searches.is_empty())
        {
            return Err(Failure::nothing_selected());
        }
        Ok(())
    }

    /// The valid studies, and the others. The trials of whole studies are only counted; a selection of trials has to be
    /// planned.
    #[must_use]
    pub fn check(&self) -> Check {
        // The Python environments are started again instead of being taken from their records.
        let announced = Announcements::of(&self.settings.store).doubted();
        if !self.selection.only.is_empty() {
            let (planned, refused) = self.read(Some(&announced));
            let selects = || self.selects_something(&planned).err();
            let unselected = refused.is_empty().then(selects).flatten();
            let good = planned.into_iter().map(|one| (one.plan.trials.len(), one.study));
            return Check {
                good: good.collect(),
                refused,
                unselected,
            };
        }
        let (mut good, mut refused) = (Vec::new(), Vec::new());
        for path in &self.selection.specs {
            match study::load(path, self.registry, &options(&self.selection, Some(&announced))) {
                Ok(study) => good.push((study.n_trials(), study)),
                Err(problems) => refused.push((path.clone(), problems)),
            }
        }
        Check {
            good,
            refused,
            unselected: None,
        }
    }

    /// Refuses studies whose trials fit on none of the machines that the settings name.
    ///
    /// # Errors
    /// The first agent whose trials fit on no machine.
    pub fn check_fit(&self, studies: &[Checked]) -> Result<(), Failure> {
        let Some(machines) = Machines::of(self.registry, &self.settings)? else {
            return Ok(());
        };
        studies.iter().try_for_each(|(_, study)| {
            let agents = study.built_agents();
            machines.refuse_unfit(self.registry, agents.iter().map(|it| &**it))
        })
    }

    /// Warns about studies that can run but are probably a mistake.
    pub fn warn<'s>(&self, studies: impl IntoIterator<Item = &'s Study>) {
        for study in studies.into_iter().filter(|study| !study.warnings.is_empty()) {
            self.notice(&diagnostic::render_first(&study.warnings));
        }
    }

    /// The end of every trial; `None` if it has not run or must run again. Damaged trials are reported.
    pub fn ends(&self, store: &Store, one: &Planned) -> Vec<Option<TrialEnd>> {
        self.ends_and_damage(store, one).0
    }

    /// The same, and whether a trial is damaged.
    pub(crate) fn ends_and_damage(&self, store: &Store, one: &Planned) -> (Vec<Option<TrialEnd>>, bool) {
        let found = store.outcomes(&one.plan.trials);
        for (_, error) in &found.unreadable {
            self.notice(&format!("warning: {error}; the trial counts as missing"));
        }
        (found.all, !found.unreadable.is_empty())
    }

    /// Says how a study's imported runs are used, if it has any.
    pub fn say_imported(&self, one: &Planned, what: &str) {
        for it in &one.study.imported {
            self.notice(&format!(
                "{}: {} of `{}` {} imported and {what}",
                one.study.name,
                count(it.trials.len(), "run"),
                it.origin.name,
                either(&it.trials.len(), "is", "are")
            ));
        }
    }
}

/// Loads and plans one study.
pub(crate) fn load_one(
    registry: &Registry,
    path: &Path,
    only: &[String],
    options: study::Options,
) -> Result<Planned, Vec<Diagnostic>> {
    let study = study::load(path, registry, &options)?;
    let mut planned = Planned::of(path, study, options, only);
    planned.replan(registry, Wanted::new());
    if planned
        .options
        .announced
        .as_ref()
        .is_some_and(Announcements::has_store)
    {
        keep_announced(&planned);
    }
    Ok(planned)
}

/// The options for reading the studies of a selection.
pub(crate) fn options(selection: &Selection, announced: Option<&Announcements>) -> study::Options {
    study::Options {
        profile: selection.profile.clone(),
        sets: selection.sets.clone(),
        seeds: selection.seeds,
        announced: announced.cloned(),
        ..study::Options::default()
    }
}

fn keep_announced(one: &Planned) {
    if let Some(records) = &one.options.announced {
        one.study
            .announced
            .iter()
            .for_each(|(id, announced)| records.keep(id, announced));
    }
}

/// Starts the environments of a study that are known only from their records, before its trials run, and stores the
/// interfaces of all of them.
pub(crate) fn try_out(registry: &Registry, one: &Planned) -> Result<(), Failure> {
    if !one.study.is_recalled {
        keep_announced(one);
        return Ok(());
    }
    let options = study::Options {
        announced: one.options.announced.clone().map(Announcements::doubted),
        ..one.options.clone()
    };
    let tried = study::load(&one.path, registry, &options);
    tried.map(drop).map_err(|problems| Failure::study(&problems))
}

/// The exit that fits the states of trials; `None` for one that has not run.
pub fn exit_of(states: impl IntoIterator<Item = Option<EndState>>) -> Exit {
    let exit = |state: Option<EndState>| match state {
        Some(EndState::Ok) => Exit::Ok,
        None | Some(EndState::Killed | EndState::Paused) => Exit::Incomplete,
        Some(_) => Exit::TrialsFailed,
    };
    states.into_iter().map(exit).max().unwrap_or(Exit::Ok)
}
