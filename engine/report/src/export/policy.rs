//! Policies of stored trials for other runtimes.
//!
//! The engine knows only the place of a policy in a trial's folder and the facts on it. A
//! [`PolicyForm`](contract::policy_form::PolicyForm) of a plugin recognises the file and converts it.

use super::json_list;
use contract::{
    Channel, Error, Interface, Registry, Seat, Space,
    artifact::{ONNX_FILE, SAVED_FILE},
    policy_form::PortablePolicy,
};
use execution::{store::TrialFile, world::fs};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

/// File name of every policy, in the folder of a trial or in one per seat.
const FILE: &str = "policy.safetensors";

/// A policy file in a trial's folder.
struct PolicyFile {
    form: &'static str,
    /// Path of its file inside the trial's folder.
    file: String,
    policy: PortablePolicy,
}

/// A trial whose policies are converted.
pub struct PolicySubject<'a> {
    /// Id of the trial.
    pub trial: &'a str,
    /// The file that acknowledges the trial.
    pub file: &'a TrialFile,
    /// Folder of the trial; the policy in it was checked against its hashes.
    pub folder: &'a Path,
    /// Observations and actions of the seats of its environment.
    pub interface: &'a Interface,
    /// Plugins of the program.
    pub registry: &'a Registry,
}

/// ONNX files of the policies that a trial left, by name: `policy.onnx`, or `<seat>.onnx` where each seat has its own.
///
/// # Errors
/// [`Error::NoPortablePolicy`] where no form recognises the files, and errors of reading.
pub fn onnx_files(subject: &PolicySubject<'_>) -> Result<BTreeMap<String, Vec<u8>>, Error> {
    let mut files = BTreeMap::new();
    let own = subject.folder.join(ONNX_FILE);
    if fs::is_file(&own) {
        // Another program wrote the file, which is copied as it is.
        let bytes = fs::read(&own).map_err(Error::file("read", &own))?;
        return Ok([(ONNX_FILE.to_owned(), bytes)].into());
    }
    if fs::is_file(&subject.folder.join(SAVED_FILE)) {
        return Err(subject.of_no_form());
    }
    for found in subject.found()? {
        let seat = &found.policy.seat;
        let name = if seat.is_empty() { "policy" } else { seat };
        let bytes = (found.policy.to_onnx)(&subject.properties(&found));
        files.insert(format!("{name}.onnx"), bytes);
    }
    Ok(files)
}

impl PolicySubject<'_> {
    fn found(&self) -> Result<Vec<PolicyFile>, Error> {
        let mut all = Vec::new();
        for (seat, folder, file) in places(self.folder)? {
            let (form, policies) = self.read(&folder)?;
            all.extend(policies.into_iter().map(|mut policy| {
                if policy.seat.is_empty() {
                    policy.seat.clone_from(&seat);
                }
                let file = file.clone();
                PolicyFile { form, file, policy }
            }));
        }
        Ok(all)
    }

    fn read(&self, folder: &Path) -> Result<(&'static str, Vec<PortablePolicy>), Error> {
        for form in self.registry.policy_forms.values() {
            if let Some(policies) = (form.read)(folder)? {
                return Ok((form.name, policies));
            }
        }
        Err(self.of_no_form())
    }

    fn of_no_form(&self) -> Error {
        Error::NoPortablePolicy {
            trial: self.trial.into(),
            agent: self.file.key.agents_by_plugin(),
            known: self.registry.policy_forms.keys().copied().collect(),
        }
    }

    /// Properties in the metadata of a policy's file, in their order there.
    fn properties(&self, found: &PolicyFile) -> Vec<(String, String)> {
        let (key, policy) = (&self.file.key, &found.policy);
        let digest = self.file.files.get(&found.file).cloned().unwrap_or_default();
        let units = |names: &[String], of: fn(&Seat) -> &Space| -> Vec<String> {
            names
                .iter()
                .map(|name| self.unit(&policy.seat, name, of))
                .collect()
        };
        let all = [
            ("program", contract::build::version(self.registry.build.as_ref())),
            ("trial", self.trial.into()),
            ("digest", digest),
            ("environment", key.environment.plugin.clone()),
            ("agent", key.agents_by_plugin()),
            ("seed", key.seed.to_string()),
            ("seat", policy.seat.clone()),
            ("form", found.form.into()),
            ("head", policy.head.clone()),
            ("inputs", json_list(&policy.inputs)),
            (
                "input_units",
                json_list(&units(&policy.inputs, |seat| &seat.observation)),
            ),
            ("outputs", json_list(&policy.outputs)),
            (
                "output_units",
                json_list(&units(&policy.outputs, |seat| &seat.action)),
            ),
        ];
        all.into_iter()
            .map(|(name, value)| (name.to_owned(), value))
            .collect()
    }

    /// The unit of a channel of the seat, else of the first seat with a channel of this name. Empty where no channel
    /// has the name.
    fn unit(&self, seat: &str, name: &str, of: fn(&Seat) -> &Space) -> String {
        let seats = &self.interface.seats;
        let own = seats.iter().filter(|it| it.name == seat);
        let spaces = own.chain(seats).map(of);
        let mut channels = spaces.flat_map(|space| match space {
            Space::Box(channels) => channels.as_slice(),
            _ => &[],
        });
        channels
            .find(|channel: &&Channel| channel.name == name)
            .map_or(String::new(), |channel| channel.unit.clone())
    }
}

/// Seat, folder and path of every policy file of a trial; a policy of the trial itself has no seat.
fn places(trial: &Path) -> Result<Vec<(String, PathBuf, String)>, Error> {
    if fs::is_file(&trial.join(FILE)) {
        return Ok(vec![(String::new(), trial.to_owned(), FILE.into())]);
    }
    let mut seats = execution::store::names(trial)?;
    seats.sort();
    let place = |seat: String| {
        let (folder, file) = (trial.join(&seat), format!("{seat}/{FILE}"));
        fs::is_file(&folder.join(FILE)).then_some((seat, folder, file))
    };
    Ok(seats.into_iter().filter_map(place).collect())
}
