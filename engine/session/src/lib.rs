//! The use cases of studies as a library: load, check, plan, run, collect and report.
//!
//! Each command of the program is a few lines around a [`Session`]. A program that uses this library opens a session in
//! the same way:
//!
//! ```text
//! let session = Session::open(&registry, Selection::of("study.yaml"), MachineOptions::default(), &Silent)?;
//! let mut planned = session.load_with_looks()?;
//! session.run(&mut planned, &RunOptions::default())?;
//! let reports = session.report(&planned, &ReportOptions::default())?;
//! ```

mod absent;
mod compared;
mod compute;
mod confirmations;
mod device;
mod exit;
mod export;
pub mod export_dataset;
pub mod export_policy;
mod fitting;
mod folders;
mod hosts;
mod import;
mod index;
mod loading;
mod looks;
mod merge;
mod observer;
mod one_trial;
mod options;
mod pack;
mod planned;
mod profiles;
mod programs;
mod provenance;
mod recorded;
mod rehearse;
mod reports;
mod results;
pub mod rollout;
mod run;
mod searches;
mod seen;
mod selection;
mod settings;
mod stages;
mod state;
mod submit;
mod verify;
mod waiting;
mod whole;
mod worker;

pub use compared::Other;
pub use compute::failed_in_words;
pub use confirmations::by_study;
pub use exit::{Exit, Failure};
pub use export::Exported;
pub use import::Import;
pub use index::{Studied, studies_within, write_index};
pub use loading::{Check, Checked, Refused, exit_of};
pub use looks::line as looks_in_words;
pub use merge::{MergedStore, exit_of_merge, merge};
pub use observer::{Follower, Observer, Silent};
pub use options::{ReportOptions, RunOptions, WorkerOptions};
pub use planned::Planned;
pub use programs::{Program, of_commands};
pub use rehearse::Rehearsed;
pub use reports::{Report, Reported};
pub use run::Computed;
pub use searches::{exit_of_searches, lines as searches_in_words};
pub use selection::{MachineOptions, Selection};
pub use settings::Settings;
pub use stages::{lines as stages_in_words, of as stages};
pub use state::{DeviceEstimate, StudyState};
pub use verify::{Verifiable, VerifyOptions, exit_of_receipt};
pub use waiting::Waiting;
pub use worker::serve_if_asked;

use contract::Registry;
use execution::store::Store;
use std::cell::OnceCell;

/// Studies that a person has selected, on one machine.
pub struct Session<'a> {
    /// The plugins of this program.
    pub registry: &'a Registry,
    /// The studies.
    pub selection: Selection,
    /// The settings of the machine.
    pub settings: Settings,
    /// The machine options of the command line, repeated in suggested commands.
    machine: MachineOptions,
    observer: &'a dyn Observer,
    store: OnceCell<Store>,
}

impl<'a> Session<'a> {
    /// Reads the settings of the machine. No study is read yet.
    ///
    /// # Errors
    /// A mistake in `regimen.toml`.
    pub fn open(
        registry: &'a Registry,
        selection: Selection,
        machine: MachineOptions,
        observer: &'a dyn Observer,
    ) -> Result<Self, Failure> {
        Ok(Self {
            registry,
            selection,
            settings: Settings::read(registry, &machine)?,
            machine,
            observer,
            store: OnceCell::new(),
        })
    }

    /// The store of the machine, with the bucket by which it is shared.
    ///
    /// # Errors
    /// A bucket whose address or keys are wrong.
    pub fn store(&self) -> Result<&Store, Failure> {
        if let Some(store) = self.store.get() {
            return Ok(store);
        }
        let store = self.settings.open(self.registry)?;
        Ok(self.store.get_or_init(|| store))
    }

    /// The command `verb` for the same studies, with `more` words at its end, ready to be pasted.
    #[must_use]
    pub fn command(&self, verb: &str, more: &[&str]) -> String {
        selection::command(&self.selection, &self.machine, verb, more)
    }

    /// The command that runs failed trials again.
    #[must_use]
    pub fn again(&self) -> String {
        self.command("run", &["--retry-failed"])
    }

    /// Sends a notice to the observer.
    pub(crate) fn notice(&self, text: &str) {
        self.observer.notice(text);
    }
}
