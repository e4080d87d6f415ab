//! Datasets for trials of tests that take one: made up for the seats of an environment, so that what learns
//! from them does not move with any simulator.

use contract::{
    Channel, End, Error, Interface, Keeper, Recorder, Registry, Rng, Seat, Space,
    artifact::{Taken, named_in},
    dataset::{DatasetWriter, Episode},
    part::Part,
    random::stream,
    trial::TrialKey,
};
use rand::Rng as _;
use std::path::Path;

/// The same part with a source for every artifact that its config names.
pub(crate) fn with_sources(mut part: Part) -> Part {
    for (at, (kind, reference)) in named_in(&part.config) {
        part.artifacts.insert(
            at,
            Taken {
                trial: reference.from,
                kind,
            },
        );
    }
    part
}

/// Runs a trial; every dataset that it takes is the one that is made up for its environment.
pub(crate) fn run(
    registry: &Registry,
    key: &TrialKey,
    folder: Option<&Path>,
    keeper: &mut dyn Keeper,
) -> Result<Recorder, Error> {
    let source = tempfile::tempdir().unwrap();
    let find = |_: &Taken| {
        let environment =
            (registry.environments[key.environment.plugin.as_str()].build)(&key.environment.config)?;
        make_up(&environment.interface(), source.path())?;
        Ok(source.path().to_path_buf())
    };
    key.run_after(registry, &find, folder, &mut |_, _| {}, keeper)
}

/// Writes a dataset of a few short episodes whose numbers are drawn.
///
/// # Errors
/// [`Error::MixedSeats`] where seats are too unlike.
pub(crate) fn make_up(interface: &Interface, trial: &Path) -> Result<(), Error> {
    let mut writer = DatasetWriter::create(trial, interface)?;
    let mut rng = stream(&["a dataset"]);
    for (n, end) in [
        (3, End::Terminated),
        (5, End::Truncated),
        (1, End::Terminated),
        (8, End::Truncated),
    ] {
        let seats = &interface.seats;
        let mut of_all = |of: fn(&Seat) -> &Space| -> Vec<f64> {
            seats.iter().flat_map(|seat| draw(of(seat), &mut rng)).collect()
        };
        let observations = (0..=n).map(|_| of_all(|seat| &seat.observation)).collect();
        let actions = (0..n).map(|_| of_all(|seat| &seat.action)).collect();
        let has_states = seats.len() > 1 && !interface.state.is_empty();
        let mut state = || {
            interface
                .state
                .iter()
                .map(|channel| near(channel, &mut rng))
                .collect()
        };
        let states = (0..=n).filter(|_| has_states).map(|_| state()).collect();
        writer.episode(&Episode {
            observations,
            actions,
            rewards: (0..n * seats.len())
                .map(|_| rng.random_range(-1.0..1.0))
                .collect(),
            states,
            end,
        })?;
    }
    writer.finish()
}

/// Any vector of a space: around the typical values of channels, and within their limits.
fn draw(space: &Space, rng: &mut Rng) -> Vec<f64> {
    match space {
        Space::Box(channels) => channels.iter().map(|channel| near(channel, rng)).collect(),
        Space::Simplex(names) => {
            let draws: Vec<f64> = names.iter().map(|_| rng.random_range(0.1..1.0)).collect();
            let sum: f64 = draws.iter().sum();
            draws.into_iter().map(|draw| draw / sum).collect()
        }
        Space::Discrete(names) => vec![f64::from(
            rng.random_range(0..u32::try_from(names.len()).unwrap()),
        )],
        Space::Choices(_) => (0..space.len()).map(|_| rng.random_range(-1.0..=1.0)).collect(),
    }
}

fn near(channel: &Channel, rng: &mut Rng) -> f64 {
    (channel.center + channel.spread * rng.random_range(-1.0..1.0)).clamp(channel.low, channel.high)
}
