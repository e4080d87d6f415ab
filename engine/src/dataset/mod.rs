//! Datasets: whole episodes that a trial gathered, for others to learn from.
//!
//! A dataset lies in the folder `dataset` of a trial, in the layout of Minari 0.5 (Farama Foundation), which
//! reads it as it is:
//!
//! | file | what it holds |
//! |---|---|
//! | `data/metadata.json` | the spaces, the numbers of episodes and steps |
//! | `data/<episode>/metadata.json` | number and length of an episode |
//! | `data/<episode>/part-0.parquet` | an episode of `n` decisions in `n + 1` rows |
//! | `interface.json` | the engine's own [`Interface`], with names and units of all channels |
//!
//! | column | type | row `t` |
//! |---|---|---|
//! | `observations` | vector of f64, i64 for a choice | what was seen before decision `t`; the last row is what was seen at the end |
//! | `actions` | vector of f64, i64 for a choice | what was done; 0 in the last row |
//! | `rewards` | f64 | what was earned; 0 in the last row |
//! | `terminations`, `truncations` | bool | whether the episode ended with decision `t`, and how; false in the last row |
//!
//! Observations are as the environment gave them, in SI units; the full state is not kept. Shares on a
//! simplex are a box with limits 0 and 1 to Minari. A dataset is of one seat. The same episodes always make
//! the same bytes.

mod episode_file;
mod interface;
mod minari;
#[cfg(test)]
mod tests;

use crate::{End, Error, Interface, Observation, Seat, Transition, world::fs};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::path::{Path, PathBuf};

/// The folder of a dataset inside that of the trial that gathered it.
pub const FOLDER: &str = "dataset";
const INTERFACE: &str = "interface.json";

/// A whole episode of one seat, of `n` decisions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Episode {
    /// What was seen before each decision and at the end: `n + 1` vectors.
    pub observations: Vec<Vec<f64>>,
    /// What was done: `n` vectors.
    pub actions: Vec<Vec<f64>>,
    /// What was earned: `n` numbers.
    pub rewards: Vec<f64>,
    /// How it ended.
    pub end: End,
}

impl Episode {
    /// Its decisions, in order; the full state is empty.
    pub fn transitions(&self) -> impl Iterator<Item = Transition> + '_ {
        let observe = |at: usize| Observation {
            seats: vec![self.observations[at].clone()],
            state: Vec::new(),
        };
        let last = self.actions.len().saturating_sub(1);
        self.actions
            .iter()
            .zip(&self.rewards)
            .enumerate()
            .map(move |(at, (action, reward))| Transition {
                observation: observe(at),
                action: vec![action.clone()],
                rewards: vec![*reward],
                next_observation: observe(at + 1),
                end: (at == last).then_some(self.end),
            })
    }

    /// What is wrong with its lengths in the spaces of a seat; `None` where nothing is.
    fn misfit(&self, seat: &Seat) -> Option<String> {
        let n = self.actions.len();
        if n == 0 {
            return Some("an episode has no decision".into());
        }
        if self.observations.len() != n + 1 || self.rewards.len() != n {
            let (seen, earned) = (self.observations.len(), self.rewards.len());
            return Some(format!(
                "{n} decisions have {seen} observations and {earned} rewards"
            ));
        }
        let of_other_length =
            |vectors: &[Vec<f64>], length| vectors.iter().find(|vector| vector.len() != length).map(Vec::len);
        let (observed, acted) = (seat.observation.len(), seat.action.len());
        let observation = of_other_length(&self.observations, observed);
        let wrong =
            observation.map(|found| format!("an observation has {found} entries instead of {observed}"));
        let action = of_other_length(&self.actions, acted);
        wrong.or_else(|| action.map(|found| format!("an action has {found} entries instead of {acted}")))
    }
}

/// Episodes, and what was seen and done in them.
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
    /// [`Error::File`] where a file is missing, [`Error::Damaged`] where one is not what was written.
    pub fn read(trial: &Path) -> Result<Self, Error> {
        Self::read_from(&trial.join(FOLDER))
    }

    /// Reads the dataset that lies in a folder.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_from(folder: &Path) -> Result<Self, Error> {
        let interface: Interface = read_json(&folder.join(INTERFACE))?;
        let totals: minari::Totals = read_json(&folder.join(minari::METADATA))?;
        let seat = only_seat(&interface)?;
        let read = |episode| episode_file::read(&folder.join(minari::episode_file(episode)), seat);
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

    /// Reads the dataset in a trial's folder for use in an environment with the interface `here`. Seats have
    /// to see and do the same: the same channels with the same units, actions within the same limits. Typical
    /// values and limits of what is seen may differ.
    ///
    /// # Errors
    /// As [`read`](Self::read), and [`Error::OtherInterface`] for a dataset of another environment.
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
    /// As [`DatasetWriter::create`].
    pub fn write_empty(trial: &Path, interface: &Interface) -> Result<(), Error> {
        DatasetWriter::create(trial, interface)?.finish()
    }

    /// The decisions of all episodes, in order.
    pub fn transitions(&self) -> impl Iterator<Item = Transition> + '_ {
        self.episodes.iter().flat_map(Episode::transitions)
    }
}

/// Writes a dataset episode by episode. Readers find none before [`finish`](Self::finish).
#[derive(Debug)]
pub struct DatasetWriter {
    folder: PathBuf,
    seat: Seat,
    totals: minari::Totals,
    bytes: u64,
}

impl DatasetWriter {
    /// Begins a dataset in a trial's folder; one that is there is removed.
    ///
    /// # Errors
    /// [`Error::ManySeats`] for an environment that has not exactly one seat, and where the folder cannot be
    /// written.
    pub fn create(trial: &Path, interface: &Interface) -> Result<Self, Error> {
        let folder = trial.join(FOLDER);
        only_seat(interface)?;
        if fs::exists(&folder) {
            fs::remove_dir_all(&folder).map_err(Error::file("remove", &folder))?;
        }
        Self::at(&folder, interface)
    }

    /// Begins a dataset in a folder that holds none.
    ///
    /// # Errors
    /// As [`create`](Self::create).
    pub fn at(folder: &Path, interface: &Interface) -> Result<Self, Error> {
        let (folder, seat) = (folder.to_owned(), only_seat(interface)?.clone());
        let data = folder.join(minari::DATA);
        fs::create_dir_all(&data).map_err(Error::file("create", &data))?;
        write_json(&folder.join(INTERFACE), interface)?;
        Ok(Self {
            folder,
            seat,
            totals: minari::Totals::default(),
            bytes: 0,
        })
    }

    /// Adds an episode.
    ///
    /// # Errors
    /// [`Error::Damaged`] for an episode whose lengths do not fit the interface, and where a file cannot be
    /// written.
    pub fn episode(&mut self, episode: &Episode) -> Result<(), Error> {
        let path = self.folder.join(minari::episode_file(self.totals.total_episodes));
        if let Some(problem) = episode.misfit(&self.seat) {
            return Err(Error::Damaged { path, problem });
        }
        let bytes = episode_file::encode(episode, &self.seat, &path)?;
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

    /// Says how much there is: the dataset is whole then.
    ///
    /// # Errors
    /// Where a file cannot be written.
    pub fn finish(self) -> Result<(), Error> {
        write_json(
            &self.folder.join(minari::METADATA),
            &minari::of_dataset(&self.seat, &self.totals, self.bytes),
        )
    }
}

fn only_seat(interface: &Interface) -> Result<&Seat, Error> {
    match interface.seats.as_slice() {
        [seat] => Ok(seat),
        seats => Err(Error::ManySeats { seats: seats.len() }),
    }
}

fn write_json(path: &Path, content: &impl Serialize) -> Result<(), Error> {
    // Structs of numbers, words and lists always make JSON.
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
