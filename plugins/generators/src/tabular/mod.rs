//! Environment `tabular_search`: the search for an architecture, with scores from a table instead of training.
//!
//! Observations and rewards are those of `generator_search`, without its cost: both scores and the features of
//! the state come from a fit to architectures that searches really trained (`measured`), or from a landscape
//! that is drawn from a seed (`drawn`), which stands for no generator and serves to try searches. The scores of
//! all 373 248 architectures are known, so the best one is known, and with it the regret of a search.
//!
//! | | |
//! |---|---|
//! | score of a design | `IS - w FID`, with `w` = `frechet_weight` |
//! | reward | gain of the observed score by a cell |
//! | `regret` | the score of the best architecture less that of the design, both without noise |
//!
//! With `noise`, observed scores scatter around the fit, so that a search meets the noise of training.

mod ridge;
mod surrogate;

use crate::{
    cache::Cache,
    search_space::{CellOptions, N_CELLS, choices, effective},
};
use contract::{
    Artifact, Channel, Dataset, End, Environment, Error, Metric, PerEpisode, Registry, Rng, Seat, Space,
    Step, artifact, choice,
};
use numerics::gaussian::standard_normal;
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::sync::{Arc, OnceLock};
use surrogate::{MeasuredArchitecture, Quality, Surrogate, quality};

const NAME: &str = "tabular_search";
/// Architectures of a drawn landscape to which the fit is made.
const N_DRAWN: usize = 1_000;

/// Settings of the `tabular_search` environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Scores of the architectures.
    pub landscape: Landscape,
    /// Weight of the Frechet distance in the score, which is the inception score less the weighted distance; 0
    /// for the inception score alone.
    #[schemars(range(min = 0.0, max = 10.0), extend("x-source" = "thesis, section 5.5.1"))]
    pub frechet_weight: f64,
    /// Whether scores are observed with noise.
    pub noise: bool,
}

/// Scores of the architectures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Landscape {
    /// Fitted to the architectures that searches with `generator_search` tried.
    Measured {
        /// Datasets that searches left, which are joined.
        datasets: Vec<Artifact<artifact::Dataset>>,
    },
    /// Sums of drawn effects of options and of pairs of options.
    Drawn {
        /// Names the random stream of the effects.
        #[serde(default)]
        seed: u64,
    },
}

impl Default for Config {
    fn default() -> Self {
        Self {
            landscape: Landscape::Drawn { seed: 0 },
            frechet_weight: 0.01,
            noise: true,
        }
    }
}

impl contract::Config for Config {}

/// The environment.
#[derive(Debug)]
pub struct TabularSearch {
    config: Config,
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    table: Arc<ScoreTable>,
    design: Design,
}

/// Scores of all architectures: the measured ones, and a fit to them that is made when the first design begins,
/// so that a check is quick.
#[derive(Debug)]
struct ScoreTable {
    measured: Vec<MeasuredArchitecture>,
    weight: f64,
    n_features: usize,
    fitted: OnceLock<FittedTable>,
}

/// The fit, with the best architecture by it.
#[derive(Debug)]
struct FittedTable {
    surrogate: Surrogate,
    quality: Quality,
    /// The score of the best architecture.
    best: f64,
}

/// The design under way.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
struct Design {
    cells: Vec<CellOptions>,
    /// Both scores as they were observed last.
    observed: [f64; 2],
}

/// Registers the environment.
pub(crate) fn register(registry: &mut Registry) {
    let about = "the search for a generator's architecture, where what a design is worth is looked up";
    registry.environment(NAME, 2, about, build);
}

fn build(config: Config) -> Result<Box<dyn Environment>, Error> {
    let table = ScoreTable::of(&config)?;
    let seat = Seat {
        name: String::new(),
        observation: Space::Box(channels(table.n_features)),
        action: Space::Choices(choices()),
    };
    Ok(Box::new(TabularSearch {
        seats: vec![seat],
        metrics: metrics(),
        design: Design::default(),
        table,
        config,
    }))
}

/// The observed quantities of a search: the layer, both scores and the features of the last cell.
pub(crate) fn channels(n_features: usize) -> Vec<Channel> {
    let fixed = [
        Channel::new("layer", "")
            .within(0.0, N_CELLS as f64)
            .typical(1.5, 1.1),
        Channel::new("inception_score", "").typical(2.5, 1.0),
        Channel::new("frechet_distance_hundredth", "").typical(0.5, 0.5),
    ];
    let features = (1..=n_features).map(|number| Channel::new(format!("feature_{number}"), ""));
    fixed.into_iter().chain(features).collect()
}

fn metrics() -> Vec<Metric> {
    let last = |metric: Metric| metric.per_episode(PerEpisode::Last);
    vec![
        last(Metric::new(
            "score",
            "",
            "inception score less the weighted Frechet distance, without noise",
        )),
        last(Metric::new(
            "inception_score",
            "",
            "inception score, without noise",
        )),
        last(Metric::new("frechet_distance", "", "Frechet distance, without noise").lower_is_better()),
        last(Metric::new("regret", "", "score that is missed of the best architecture's").lower_is_better()),
        last(
            Metric::new(
                "surrogate_error",
                "",
                "error of the score of held-out architectures, root mean square",
            )
            .lower_is_better(),
        ),
        last(Metric::new(
            "surrogate_rank_correlation",
            "",
            "Spearman's, of the score of held-out architectures",
        )),
    ]
}

impl ScoreTable {
    /// The table of a config, from the cache if it is there.
    fn of(config: &Config) -> Result<Arc<Self>, Error> {
        static KEPT: Cache<ScoreTable> = Cache::new();
        let name = format!("{} {}", config.frechet_weight, identity(&config.landscape)?);
        KEPT.get_or_make(name, || {
            Ok(Self::made(measured(&config.landscape)?, config.frechet_weight))
        })
    }

    fn made(measured: Vec<MeasuredArchitecture>, weight: f64) -> Self {
        Self {
            n_features: measured[0].seen[0].len() - 2,
            measured,
            weight,
            fitted: OnceLock::new(),
        }
    }

    fn fitted(&self) -> &FittedTable {
        self.fitted.get_or_init(|| {
            let surrogate = Surrogate::fit(&self.measured);
            FittedTable {
                quality: quality(&self.measured, self.weight),
                best: surrogate.best(self.weight).0,
                surrogate,
            }
        })
    }
}

/// A text that identifies a landscape within a process.
fn identity(landscape: &Landscape) -> Result<String, Error> {
    match landscape {
        Landscape::Drawn { seed } => Ok(format!("drawn {seed}")),
        Landscape::Measured { datasets } => {
            let folders = datasets
                .iter()
                .map(Artifact::folder)
                .collect::<Result<Vec<_>, _>>()?;
            Ok(format!("measured {folders:?}"))
        }
    }
}

fn measured(landscape: &Landscape) -> Result<Vec<MeasuredArchitecture>, Error> {
    match landscape {
        Landscape::Drawn { seed } => Ok(drawn(*seed)),
        Landscape::Measured { datasets } => {
            let mut all = Vec::new();
            for product in datasets {
                let dataset = Dataset::read(product.folder()?)?;
                all.extend(tried(&dataset, product.source())?);
            }
            if all.is_empty() {
                // In a rehearsal the dataset is empty: one design, so that there is something to look up.
                all.push(MeasuredArchitecture {
                    cells: vec![[0; 6]; N_CELLS],
                    seen: vec![vec![0.0; 3]; N_CELLS + 1],
                });
            }
            if all.iter().any(|one| one.cells.len() == N_CELLS) {
                return Ok(all);
            }
            Err(Error::config(
                "landscape.measured.datasets",
                "they hold no whole architecture",
            ))
        }
    }
}

/// The architectures of a dataset that a search for generators left.
fn tried(dataset: &Dataset, source: &str) -> Result<Vec<MeasuredArchitecture>, Error> {
    let seat = &dataset.interface.seats[0];
    let own = choices();
    let fits = matches!(&seat.action, Space::Choices(choices) if *choices == own)
        && matches!(&seat.observation, Space::Box(channels) if channels.len() > 3 && channels[1].name == "inception_score");
    if !fits {
        let problem = format!("`{source}` left no designs of generators");
        return Err(Error::config("landscape.measured.datasets", problem));
    }
    let one = |episode: &contract::dataset::Episode| {
        let cells = episode.actions.iter().enumerate().map(|(step, action)| {
            let taken = choice::taken(&own, action)?;
            Ok(effective(step, &taken))
        });
        let seen = |row: &Vec<f64>| {
            let mut seen = vec![row[1], 100.0 * row[2]];
            seen.extend(&row[3..]);
            seen
        };
        Ok(MeasuredArchitecture {
            cells: cells.collect::<Result<_, Error>>()?,
            seen: episode.observations.iter().map(seen).collect(),
        })
    };
    dataset.episodes.iter().map(one).collect()
}

/// Architectures of a landscape with drawn effects: each option of a cell adds to the score, and so does each
/// pair of options, a third as much.
fn drawn(seed: u64) -> Vec<MeasuredArchitecture> {
    let effect = |words: &[String]| {
        let words: Vec<&str> = std::iter::once("landscape")
            .chain(words.iter().map(String::as_str))
            .collect();
        contract::random::stream(&words).random::<f64>() - 0.5
    };
    let named = |step: usize, at: usize, option: usize| format!("{seed} {step} {at} {option}");
    let worth = |cells: &[CellOptions]| {
        let options: Vec<String> = cells
            .iter()
            .enumerate()
            .flat_map(|(step, cell)| {
                cell.iter()
                    .enumerate()
                    .map(move |(at, option)| named(step, at, *option))
            })
            .collect();
        let alone: f64 = options.iter().map(|one| effect(std::slice::from_ref(one))).sum();
        let pairs: f64 = (0..options.len())
            .flat_map(|at| (0..at).map(move |other| (other, at)))
            .map(|(one, other)| effect(&[options[one].clone(), options[other].clone()]))
            .sum();
        alone * 0.3 + pairs * 0.1
    };
    let mut rng = contract::random::stream(&["architectures", &seed.to_string()]);
    (0..N_DRAWN)
        .map(|_| {
            let draw = |step: usize, rng: &mut Rng| {
                let taken: Vec<usize> = [2u32, 3, 3, 2, 2, 2]
                    .iter()
                    .map(|size| rng.random_range(0..*size) as usize)
                    .collect();
                effective(step, &taken)
            };
            let cells: Vec<CellOptions> = (0..N_CELLS).map(|step| draw(step, &mut rng)).collect();
            let seen = (0..=N_CELLS).map(|n| {
                let worth = worth(&cells[..n]);
                vec![
                    2.0 + n as f64 * 0.5 + worth,
                    80.0 - 10.0 * n as f64 - 10.0 * worth,
                    worth,
                ]
            });
            MeasuredArchitecture {
                seen: seen.collect(),
                cells,
            }
        })
        .collect()
}

impl TabularSearch {
    fn score(&self, [inception, frechet]: [f64; 2]) -> f64 {
        inception - self.config.frechet_weight * frechet
    }

    /// Both scores of the design so far, without noise.
    fn exact(&self) -> [f64; 2] {
        let seen = self.table.fitted().surrogate.seen(&self.design.cells);
        [seen[0], seen[1]]
    }

    /// The observation after a cell, with noise where the config asks for it.
    fn look(&mut self, rng: &mut Rng) -> Vec<Vec<f64>> {
        let mut seen = self.table.fitted().surrogate.seen(&self.design.cells);
        let n_cells = self.design.cells.len();
        if self.config.noise && n_cells > 0 {
            let spread = self.table.fitted().surrogate.spread(n_cells);
            (0..2).for_each(|score| seen[score] += spread[score] * standard_normal(rng));
        }
        self.design.observed = [seen[0], seen[1]];
        vec![self.observation()]
    }

    fn observation(&self) -> Vec<f64> {
        let [inception, frechet] = self.design.observed;
        let features = self
            .table
            .fitted()
            .surrogate
            .seen(&self.design.cells)
            .split_off(2);
        let fixed = [self.design.cells.len() as f64, inception, 0.01 * frechet];
        fixed.into_iter().chain(features).collect()
    }
}

impl Environment for TabularSearch {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    fn reset(&mut self, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        self.design = Design::default();
        Ok(self.look(rng))
    }

    fn step(&mut self, actions: &[Vec<f64>], rng: &mut Rng) -> Result<Step, Error> {
        let step = self.design.cells.len();
        if step == N_CELLS {
            let problem = format!("the design has its {N_CELLS} cells");
            return Err(Error::Action { problem });
        }
        let taken = choice::taken(&choices(), &actions[0])?;
        let before = self.score(self.design.observed);
        self.design.cells.push(effective(step, &taken));
        let observations = self.look(rng);
        let exact = self.exact();
        let score = self.score(exact);
        let Quality {
            error,
            rank_correlation,
            ..
        } = self.table.fitted().quality;
        let whole = self.design.cells.len() == N_CELLS;
        let reward = self.score(self.design.observed) - before;
        let step = Step::new(observations, vec![reward], whole.then_some(End::Terminated));
        Ok(step
            .record("score", score)
            .record("inception_score", exact[0])
            .record("frechet_distance", exact[1])
            .record("regret", self.table.fitted().best - score)
            .record("surrogate_error", error)
            .record("surrogate_rank_correlation", rank_correlation))
    }

    fn trace_channels(&self) -> Vec<Channel> {
        vec![
            Channel::new("inception_score", ""),
            Channel::new("frechet_distance", ""),
        ]
    }

    fn trace(&self) -> Vec<f64> {
        self.design.observed.to_vec()
    }

    fn snapshot(&self) -> Value {
        // Small numbers, which JSON can represent.
        serde_json::to_value(&self.design).expect("a design serialises")
    }

    fn restore(&mut self, snapshot: &Value) -> Result<(), Error> {
        self.design = Design::deserialize(snapshot).map_err(|source| Error::Checkpoint {
            what: NAME,
            problem: source.to_string(),
        })?;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
