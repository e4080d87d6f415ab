//! The class that Python sees: environments side by side behind a lock.

use crate::{
    config::ConfiguredEnvironment,
    episodes::{Autoreset, Episodes, Start},
    refusal::Refusal,
    spaces::{MetricForm, SeatForm, SpaceForm},
};
use contract::Environment;
use pyo3::{buffer::PyBuffer, exceptions::PyValueError, prelude::*};
use std::{
    path::PathBuf,
    sync::{Mutex, MutexGuard},
};

/// Environments of one config side by side.
#[pyclass(module = "regimen._native", frozen)]
pub struct Simulation {
    episodes: Mutex<Episodes>,
}

#[pymethods]
impl Simulation {
    /// Builds `count` environments with the config `keys` (a JSON text) or `file` (YAML). `autoreset` is the
    /// value of Gymnasium's `AutoresetMode`.
    #[new]
    #[pyo3(signature = (name, keys=None, file=None, count=1, autoreset="Disabled"))]
    fn new(
        py: Python<'_>,
        name: &str,
        keys: Option<&str>,
        file: Option<PathBuf>,
        count: usize,
        autoreset: &str,
    ) -> PyResult<Self> {
        let autoreset = match autoreset {
            "NextStep" => Autoreset::NextStep,
            "SameStep" => Autoreset::SameStep,
            "Disabled" => Autoreset::Disabled,
            other => return Err(PyValueError::new_err(format!("unknown mode `{other}`"))),
        };
        let made = py.detach(|| {
            let configured = ConfiguredEnvironment::new(name, keys, file.as_deref())?;
            Episodes::new(configured, count, autoreset)
        });
        Ok(Self {
            episodes: Mutex::new(made?),
        })
    }

    /// The seats, in order.
    fn seats(&self) -> PyResult<Vec<SeatForm>> {
        let episodes = self.lock()?;
        let first = episodes.environment(0);
        Ok(first.map_or_else(Vec::new, |it| it.seats().iter().map(SeatForm::from).collect()))
    }

    /// The metrics, in order.
    fn metrics(&self) -> PyResult<Vec<MetricForm>> {
        let episodes = self.lock()?;
        let first = episodes.environment(0);
        Ok(first.map_or_else(Vec::new, |it| it.metrics().iter().map(MetricForm::from).collect()))
    }

    /// Space of the full state.
    fn state_space(&self) -> PyResult<SpaceForm> {
        let channels = self.lock()?.environment(0).map(Environment::state_channels);
        Ok(SpaceForm::of_channels(&channels.unwrap_or_default()))
    }

    /// The full state of one environment.
    fn state(&self, place: usize) -> PyResult<Vec<f64>> {
        let state = self.lock()?.environment(place).map(Environment::state);
        state.ok_or_else(|| PyValueError::new_err(format!("there is no environment {place}")))
    }

    /// Number of columns of each section that a step writes: observations, rewards, metrics, state of the
    /// episode, last observations. Each section has a row per environment.
    fn columns(&self) -> PyResult<[usize; 5]> {
        Ok(self.lock()?.layout().columns())
    }

    /// Key of the random streams of a trial in this environment.
    fn stream_id(&self) -> PyResult<String> {
        Ok(self.lock()?.stream_id().to_owned())
    }

    /// Begins an episode in every environment. For each of them, `starts` holds a seed, the number of an episode of the
    /// final measurement and the number of an environment to learn in, or `None`.
    fn reset(
        &self,
        py: Python<'_>,
        starts: Vec<(Option<u64>, Option<u64>, Option<u64>)>,
        observations: PyBuffer<f64>,
    ) -> PyResult<()> {
        let starts: Vec<Start> = starts
            .into_iter()
            .map(|(seed, episode, slot)| Start { seed, episode, slot })
            .collect();
        let numbers = py.detach(|| self.lock()?.reset(&starts))?;
        observations.copy_from_slice(py, &numbers)
    }

    /// Steps all environments and writes the results into `outcome`, in the order of `columns`.
    fn step(&self, py: Python<'_>, actions: PyBuffer<f64>, outcome: PyBuffer<f64>) -> PyResult<()> {
        let asked = actions.to_vec(py)?;
        let numbers = py.detach(|| self.lock()?.step(&asked))?;
        outcome.copy_from_slice(py, &numbers)
    }
}

impl Simulation {
    fn lock(&self) -> Result<MutexGuard<'_, Episodes>, Refusal> {
        self.episodes.lock().map_err(|_| Refusal::Panicked)
    }
}
