//! Datasets: whole episodes that a trial gathered, from which others learn.
//!
//! A dataset lies in the folder `dataset` of a trial, in the layout of Minari 0.5 (Farama Foundation), which can read
//! it directly:
//!
//! | file | content |
//! |---|---|
//! | `data/metadata.json` | the spaces, the numbers of episodes and steps |
//! | `data/<episode>/metadata.json` | number and length of an episode |
//! | `data/<episode>/part-0.parquet` | an episode of `n` decisions in `n + 1` rows |
//! | `interface.json` | the engine's own [`Interface`], with names and units of all channels |
//!
//! | column | type | row `t` |
//! |---|---|---|
//! | `observations` | vector of f64, i64 for a choice | observation before decision `t`; in the last row the one at the end |
//! | `actions` | vector of f64, i64 for a choice | decision `t`; 0 in the last row |
//! | `rewards` | f64 | reward of decision `t`, the mean of the seats; 0 in the last row |
//! | `terminations`, `truncations` | bool | whether and how decision `t` ended the episode; false in the last row |
//! | `seat_rewards` | vector of f64 | of several seats: the reward of each |
//! | `states` | vector of f64 | of several seats whose environment has one: the full state |
//!
//! Observations are as the environment gave them, in SI units. Shares on a simplex are a box with limits 0 and 1 to
//! Minari. Minari knows only one agent, so several seats are one to it, with their observations and actions one after
//! the other; choices of several seats are vectors of i64. The full state of a single seat is not kept. The same
//! episodes always make the same bytes.

mod episode_file;
mod interface;
mod layout;
mod minari;
#[cfg(test)]
mod tests;

use crate::{Action, End, Environment, Error, Interface, Transition};
use layout::Layout;
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// The folder of a dataset inside that of the trial that gathered it.
pub const FOLDER: &str = "dataset";
const INTERFACE: &str = "interface.json";

/// Checks whether datasets can be made of an environment.
///
/// # Errors
/// [`Error::MixedSeats`] if some seats choose and others do not, [`Error::NoSeats`] if there are none.
pub fn can_hold(interface: &Interface) -> Result<(), Error> {
    Layout::of(interface).map(drop)
}

/// A whole episode of `n` decisions. A vector holds the entries of all seats, one seat after the other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Episode {
    /// Observations before each decision and at the end: `n + 1` vectors.
    pub observations: Vec<Vec<f64>>,
    /// Actions: `n` vectors.
    pub actions: Vec<Vec<f64>>,
    /// Rewards: a number for each seat of each of the `n` decisions.
    pub rewards: Vec<f64>,
    /// For several seats, the full state before each decision and at the end: `n + 1` vectors. Empty for one seat.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub states: Vec<Vec<f64>>,
    /// Ending of the episode.
    pub end: End,
}

impl Episode {
    /// Adds the observations of the seats and, for several seats, the full state.
    pub fn see(&mut self, environment: &dyn Environment, seats: &[Vec<f64>]) {
        self.observations.push(seats.concat());
        if seats.len() > 1 {
            let state = Some(environment.state()).filter(|state| !state.is_empty());
            self.states.extend(state);
        }
    }

    /// Adds the actions of the seats, and their rewards.
    pub fn take(&mut self, action: &Action, rewards: &[f64]) {
        self.actions.push(action.concat());
        self.rewards.extend(rewards);
    }
}

impl Default for Episode {
    /// An episode that has not begun; it counts as cut off until its `end` is set.
    fn default() -> Self {
        Self {
            observations: Vec::new(),
            actions: Vec::new(),
            rewards: Vec::new(),
            states: Vec::new(),
            end: End::Truncated,
        }
    }
}

/// Episodes of an environment, with its interface.
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset {
    /// The interface of the environment in which it was gathered.
    pub interface: Interface,
    /// The episodes, in the order of gathering.
    pub episodes: Vec<Episode>,
}

impl Dataset {
    /// Reads the dataset in a trial's folder.
    ///
    /// # Errors
    /// [`Error::File`] if a file is missing, [`Error::Damaged`] if one is damaged.
    pub fn read(trial: &Path) -> Result<Self, Error> {
        Self::read_from(&trial.join(FOLDER))
    }

    /// Reads the dataset that lies in a folder.
    ///
    /// # Errors
    /// The errors of [`read`](Self::read).
    pub fn read_from(folder: &Path) -> Result<Self, Error> {
        let interface: Interface = read_json(&folder.join(INTERFACE))?;
        let totals: minari::Totals = read_json(&folder.join(minari::METADATA))?;
        let layout = Layout::of(&interface)?;
        let read = |episode| episode_file::read(&folder.join(minari::episode_file(episode)), &layout);
        let episodes = (0..totals.total_episodes)
            .map(read)
            .collect::<Result<Vec<Episode>, _>>()?;
        let steps: usize = episodes.iter().map(|episode| episode.actions.len()).sum();
        if steps as u64 != totals.total_steps {
            let problem = format!(
                "it says {} steps, and the episodes have {steps}",
                totals.total_steps
            );
            return Err(Error::Damaged {
                path: folder.join(minari::METADATA),
                problem,
            });
        }
        Ok(Self { interface, episodes })
    }

    /// Reads the dataset in a trial's folder for use in an environment with the interface `here`. The seats of both
    /// must have the same channels with the same units, and actions within the same limits. Typical values and limits
    /// of observations may differ.
    ///
    /// # Errors
    /// The errors of [`read`](Self::read), and [`Error::OtherInterface`] for a dataset of another environment.
    pub fn read_for(trial: &Path, here: &Interface) -> Result<Self, Error> {
        let read = Self::read(trial)?;
        match interface::difference(&read.interface, here) {
            None => Ok(read),
            Some(interface::Difference {
                what,
                found,
                expected,
            }) => Err(Error::OtherInterface {
                what,
                found,
                expected,
            }),
        }
    }

    /// Writes a dataset without episodes.
    ///
    /// # Errors
    /// The errors of [`DatasetWriter::create`].
    pub fn write_empty(trial: &Path, interface: &Interface) -> Result<(), Error> {
        DatasetWriter::create(trial, interface)?.finish()
    }

    /// The decisions of all episodes, in order.
    ///
    /// # Errors
    /// [`Error::MixedSeats`], which cannot occur for a dataset that was read.
    pub fn transitions(&self) -> Result<Vec<Transition>, Error> {
        let layout = Layout::of(&self.interface)?;
        let of_episode = |episode| layout.transitions(episode);
        Ok(self.episodes.iter().flat_map(of_episode).collect())
    }
}

/// The id that Minari gives a dataset in a folder at `place` below its root; `None` if its name is no id.
#[must_use]
pub fn id_of(place: &Path) -> Option<String> {
    minari::id_of(place)
}

/// Writes the id, if there is one, and the size of the dataset into its folder, for programs that find datasets by
/// these.
///
/// # Errors
/// The errors of [`Dataset::read_from`].
pub fn name(folder: &Path, id: Option<&str>) -> Result<(), Error> {
    let path = folder.join(minari::METADATA);
    let totals: minari::Totals = read_json(&path)?;
    let mut bytes = 0;
    for episode in 0..totals.total_episodes {
        let rows = folder.join(minari::episode_file(episode));
        let about = rows.with_file_name(minari::EPISODE_METADATA);
        for file in [rows, about] {
            bytes += fs::metadata(&file).map_err(Error::file("read", &file))?.len();
        }
    }
    write_json(&path, &minari::named(read_json(&path)?, id, bytes))
}

/// Writes a dataset episode by episode. Readers find no dataset before [`finish`](Self::finish).
#[derive(Debug)]
pub struct DatasetWriter {
    folder: PathBuf,
    interface: Interface,
    totals: minari::Totals,
    bytes: u64,
}

impl DatasetWriter {
    /// Begins a dataset in a trial's folder; removes an existing one.
    ///
    /// # Errors
    /// The errors of [`can_hold`], and [`Error::File`] if the folder cannot be written.
    pub fn create(trial: &Path, interface: &Interface) -> Result<Self, Error> {
        let folder = trial.join(FOLDER);
        can_hold(interface)?;
        if folder.exists() {
            fs::remove_dir_all(&folder).map_err(Error::file("remove", &folder))?;
        }
        Self::at(&folder, interface)
    }

    /// Begins a dataset in a folder that contains none.
    ///
    /// # Errors
    /// The errors of [`create`](Self::create).
    pub fn at(folder: &Path, interface: &Interface) -> Result<Self, Error> {
        can_hold(interface)?;
        let (folder, interface) = (folder.to_owned(), interface.clone());
        let data = folder.join(minari::DATA);
        fs::create_dir_all(&data).map_err(Error::file("create", &data))?;
        write_json(&folder.join(INTERFACE), &interface)?;
        Ok(Self {
            folder,
            interface,
            totals: minari::Totals::default(),
            bytes: 0,
        })
    }

    /// Adds an episode.
    ///
    /// # Errors
    /// [`Error::Damaged`] for an episode whose lengths do not fit the interface, and errors of writing a file.
    pub fn episode(&mut self, episode: &Episode) -> Result<(), Error> {
        let path = self.folder.join(minari::episode_file(self.totals.total_episodes));
        let layout = Layout::of(&self.interface)?;
        if let Some(problem) = layout.misfit(episode) {
            return Err(Error::Damaged { path, problem });
        }
        let bytes = episode_file::encode(episode, &layout, &path)?;
        let folder = path.parent().unwrap_or(&self.folder);
        fs::create_dir_all(folder).map_err(Error::file("create", folder))?;
        fs::write(&path, &bytes).map_err(Error::file("write", &path))?;
        let steps = episode.actions.len() as u64;
        write_json(
            &folder.join(minari::EPISODE_METADATA),
            &minari::of_episode(self.totals.total_episodes, steps),
        )?;
        self.totals.total_episodes += 1;
        self.totals.total_steps += steps;
        self.bytes += bytes.len() as u64;
        Ok(())
    }

    /// Writes the numbers of episodes and steps, which completes the dataset.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn finish(self) -> Result<(), Error> {
        write_json(
            &self.folder.join(minari::METADATA),
            &minari::of_dataset(&Layout::of(&self.interface)?, &self.totals, self.bytes),
        )
    }
}

fn write_json(path: &Path, content: &impl Serialize) -> Result<(), Error> {
    // Structs of numbers, strings and lists can always be written as JSON.
    let text = serde_json::to_string_pretty(content).expect("it serialises");
    fs::write(path, text).map_err(Error::file("write", path))
}

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, Error> {
    let bytes = fs::read(path).map_err(Error::file("read", path))?;
    let damaged = |source: serde_json::Error| Error::Damaged {
        path: path.to_path_buf(),
        problem: source.to_string(),
    };
    serde_json::from_slice(&bytes).map_err(damaged)
}
