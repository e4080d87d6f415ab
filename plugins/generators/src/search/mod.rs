//! Environment `generator_search`: a generator is designed cell by cell, and trained and scored after each
//! cell.
//!
//! Chapter 5 of the thesis; Tian et al. 2020, "Off-policy reinforcement learning for efficient and effective GAN
//! architecture search", ECCV, and its released code.
//!
//! | thesis | here |
//! |---|---|
//! | s | `layer`, `inception_score`, `frechet_distance_hundredth`, and the features of the last cell's map |
//! | a | one option of each choice of the next cell, see [`search_space`](crate::search_space) |
//! | R_t, eq. 5.4 | `IS_t - IS_{t-1} + w (FID_{t-1} - FID_t)` with `w` = `frechet_weight` |
//! | proxy task | `critic_steps` steps of the critic after each cell, all cells so far trained together |
//!
//! An episode begins with a generator of a stem alone and networks with new random weights; the first reward is
//! relative to the scores of that generator. It has three steps. Scores are computed at the resolution of the
//! stage, from `scored_images` images of latent vectors that are the same for every generator, relative to
//! `reference_images` real ones. With `schedule: whole_design` no training and no scoring happens before the
//! third cell: that is how a final design is trained.
//!
//! Departures
//! - Features of the state are the mean of the four central pixels of the map, as the released code computes them (a
//!   bilinear resize to one pixel); the text says "average output".
//! - The released code ends the training of a cell early where losses stop moving; here every cell gets its steps.
//! - A generator whose numbers are no longer finite is scored as one whose images are all grey.
//! - The latent vectors for scoring come from streams of this project, not from NumPy's.

mod drawing;
mod proxy;
mod scoring;
#[cfg(test)]
mod tests;

use crate::{
    architecture::{Architecture, CellArchitecture, N_CELLS},
    images::Images,
    search_space::{CellOptions, choices, effective, genotype},
    source::{ImageSource, shrunk},
    tabular::channels,
};
use contract::{
    Channel, End, Environment, Error, Metric, PerEpisode, Preset, Registry, Rng, Seat, Space, Step, choice,
    drawing::{Graph, Image},
};
use proxy::{GeneratorEvaluation, Losses, Proxy};
use rand::RngCore as _;
use rand_chacha::rand_core::SeedableRng as _;
use schemars::JsonSchema;
use scoring::{Reference, Scores, Scoring};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::sync::Arc;

pub use scoring::ScoringNetwork;

const NAME: &str = "generator_search";
/// Number of images of a finished design that are left for figures.
const N_SAMPLES: usize = 64;

/// Settings of the `generator_search` environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Source of the real images.
    pub images: ImageSource,
    /// Height and width of the finished images, pixels, a multiple of 8.
    #[schemars(range(min = 8, max = 64))]
    pub size: usize,
    /// The network by which images are scored.
    pub sight: ScoringNetwork,
    /// When a design is trained and scored.
    pub schedule: Schedule,
    /// Steps of the critic after each cell, or for the whole design.
    #[schemars(range(min = 1, max = 100_000_000), extend("x-source" = "released code: 782 after each cell"))]
    pub critic_steps: u64,
    /// Steps of the critic for each step of the generator.
    #[schemars(range(min = 1, max = 1000), extend("x-source" = "released code: 5"))]
    pub critic_steps_per_generator_step: u64,
    /// Real images in a step of the critic, and as many generated ones.
    #[schemars(range(min = 2, max = 4096), extend("x-source" = "released code: 64"))]
    pub batch: usize,
    /// Generated images in a step of the generator.
    #[schemars(range(min = 2, max = 4096), extend("x-source" = "released code: 128"))]
    pub generator_batch: usize,
    /// Channels of the generator's maps.
    #[schemars(range(min = 1, max = 1024), extend("x-source" = "released code: 128"))]
    pub generator_channels: usize,
    /// Channels of the discriminator's maps.
    #[schemars(range(min = 1, max = 1024), extend("x-source" = "released code: 64"))]
    pub discriminator_channels: usize,
    /// Length of a latent vector.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "released code: 128"))]
    pub latent: usize,
    /// Learning rate of Adam for both networks.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "released code: 2e-4"))]
    pub learning_rate: f64,
    /// Where given, images are made by an average of the generator's parameters, which keeps this fraction of
    /// itself in every step.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "released code, for the final training: 0.999"))]
    pub average_decay: Option<f64>,
    /// Generated images that are scored. Settings that differ only in this number train on the same random
    /// numbers.
    #[schemars(range(min = 10, max = 1_000_000), extend("x-source" = "released code: 5000", "x-looks" = true))]
    pub scored_images: usize,
    /// Real images with which they are compared, from the first one.
    #[schemars(range(min = 2, max = 10_000_000), extend("x-source" = "released code: 50 000"))]
    pub reference_images: usize,
    /// Number of parts for which the inception score is computed; the score is their mean.
    #[schemars(range(min = 1, max = 1000), extend("x-source" = "released code: 10"))]
    pub splits: usize,
    /// Weight of the Frechet distance in the score, which is the inception score less the weighted distance; 0
    /// for the inception score alone.
    #[schemars(range(min = 0.0, max = 10.0), extend("x-source" = "thesis, section 5.5.1: 0.01"))]
    pub frechet_weight: f64,
}

/// When a design is trained and scored.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Schedule {
    /// After each cell, with all cells so far.
    #[default]
    EachCell,
    /// Once it is complete, from new random weights.
    WholeDesign,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            images: ImageSource::default(),
            size: 16,
            sight: ScoringNetwork::default(),
            schedule: Schedule::default(),
            critic_steps: 200,
            critic_steps_per_generator_step: 5,
            batch: 32,
            generator_batch: 32,
            generator_channels: 16,
            discriminator_channels: 16,
            latent: 128,
            learning_rate: 2e-4,
            average_decay: None,
            scored_images: 1_000,
            reference_images: 5_000,
            splits: 10,
            frechet_weight: 0.01,
        }
    }
}

impl contract::Config for Config {
    fn presets() -> Vec<Preset> {
        let released = json!({
            "size": 32, "critic_steps": 782, "critic_steps_per_generator_step": 5, "batch": 64,
            "generator_batch": 128, "generator_channels": 128, "discriminator_channels": 64, "latent": 128,
            "learning_rate": 2e-4, "average_decay": null, "scored_images": 5_000, "reference_images": 50_000,
            "splits": 10, "frechet_weight": 0.01, "schedule": "each_cell",
        });
        let mut final_training = released.clone();
        final_training["schedule"] = json!("whole_design");
        final_training["critic_steps"] = json!(750_000);
        final_training["generator_channels"] = json!(256);
        final_training["discriminator_channels"] = json!(128);
        final_training["average_decay"] = json!(0.999);
        final_training["scored_images"] = json!(50_000);
        vec![
            Preset {
                name: "released_code",
                about: "the search of E2GAN's released code, on 50 000 images of 32 pixels",
                values: released,
            },
            Preset {
                name: "released_code_final",
                about: "the final training of E2GAN's released code, 960 epochs on CIFAR-10",
                values: final_training,
            },
        ]
    }
}

impl Config {
    /// Height and width of the stem's map, pixels.
    fn bottom(&self) -> usize {
        self.size >> N_CELLS
    }

    /// Height and width of the images before the first cell and after each, pixels.
    fn stages(&self) -> Vec<usize> {
        (0..=N_CELLS).map(|n_cells| self.bottom() << n_cells).collect()
    }

    /// Refuses settings that would otherwise fail when the first design begins.
    fn check(&self) -> Result<(), Error> {
        let there = self.images.count()?;
        if self.reference_images > there {
            let problem = format!(
                "{} images are to be compared with, and there are {there}; lower it",
                self.reference_images
            );
            return Err(Error::config("reference_images", problem));
        }
        self.sight.check()?;
        if self.size.is_multiple_of(1 << N_CELLS) {
            return Ok(());
        }
        let problem = format!(
            "three cells double a side each, so that {} has to be a multiple of 8",
            self.size
        );
        Err(Error::config("size", problem))
    }
}

/// The environment.
pub struct GeneratorSearch {
    config: Config,
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    /// Made when the first design begins.
    bench: Option<Arc<Bench>>,
    design: Design,
    proxy: Option<Proxy>,
}

/// Real images and scoring, which all designs share.
struct Bench {
    scoring: Arc<Scoring>,
    /// Real images of each stage, from the one after the first cell.
    real: Vec<Images>,
}

/// The design under way, with everything that determines it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
struct Design {
    /// Names the stream of all random numbers of the design.
    seed: u64,
    cells: Vec<CellOptions>,
    #[serde(skip)]
    seen: Vec<GeneratorEvaluation>,
    #[serde(skip)]
    losses: Losses,
}

/// Registers the environment.
pub(crate) fn register(registry: &mut Registry) {
    let about = "design a generator cell by cell: each one is trained against a discriminator and scored";
    registry.environment(NAME, 2, about, build);
}

fn build(config: Config) -> Result<Box<dyn Environment>, Error> {
    Ok(Box::new(GeneratorSearch::new(config)?))
}

fn metrics() -> Vec<Metric> {
    let last = |metric: Metric| metric.per_episode(PerEpisode::Last);
    vec![
        last(Metric::new(
            "score",
            "",
            "inception score less the weighted Frechet distance",
        )),
        last(Metric::new(
            "inception_score",
            "",
            "inception score at the stage's resolution",
        )),
        last(
            Metric::new(
                "frechet_distance",
                "",
                "Frechet distance at the stage's resolution",
            )
            .lower_is_better(),
        ),
        last(
            Metric::new(
                "discriminator_loss",
                "",
                "hinge loss of the discriminator, mean over the last training",
            )
            .lower_is_better(),
        ),
        last(
            Metric::new(
                "generator_loss",
                "",
                "loss of the generator, mean over the last training",
            )
            .lower_is_better(),
        ),
        last(
            Metric::new(
                "not_finite",
                "",
                "1 where the generator's numbers are no longer finite",
            )
            .lower_is_better(),
        ),
    ]
}

impl Bench {
    fn of(config: &Config) -> Result<Self, Error> {
        let stages = config.stages();
        let scoring = Scoring::of(&Reference {
            source: &config.images,
            sight: &config.sight,
            size: config.size,
            stages: &stages,
            count: config.reference_images,
            n_splits: config.splits,
        })?;
        let images = config.images.load(config.size)?;
        let real = stages[1..].iter().map(|stage| shrunk((*images).clone(), *stage));
        Ok(Self {
            real: real.collect::<Result<_, Error>>()?,
            scoring,
        })
    }
}

impl GeneratorSearch {
    fn new(config: Config) -> Result<Self, Error> {
        config.check()?;
        let seat = Seat {
            name: String::new(),
            observation: Space::Box(channels(config.generator_channels)),
            action: Space::Choices(choices()),
        };
        Ok(Self {
            seats: vec![seat],
            metrics: metrics(),
            bench: None,
            design: Design::default(),
            proxy: None,
            config,
        })
    }

    fn bench(&mut self) -> Result<Arc<Bench>, Error> {
        let bench = match self.bench.take() {
            Some(bench) => bench,
            None => Arc::new(Bench::of(&self.config)?),
        };
        Ok(Arc::clone(self.bench.insert(bench)))
    }

    /// Begins a design with the random numbers of `seed`.
    fn begin(&mut self, seed: u64) -> Result<(), Error> {
        let bench = self.bench()?;
        let proxy = Proxy::new(&self.config, Rng::seed_from_u64(seed));
        self.design = Design {
            seed,
            seen: vec![proxy.look(&self.config, &bench.scoring)?],
            ..Design::default()
        };
        self.proxy = Some(proxy);
        Ok(())
    }

    /// Adds a cell, and trains and scores where the schedule says so.
    fn add(&mut self, cell: CellOptions) -> Result<(), Error> {
        self.design.cells.push(cell);
        let n_cells = self.design.cells.len();
        let form = forms(&self.design.cells)[n_cells - 1];
        let bench = self.bench()?;
        let Some(proxy) = &mut self.proxy else {
            return Ok(());
        };
        proxy.grow(&form);
        let due = self.config.schedule == Schedule::EachCell || n_cells == N_CELLS;
        if due {
            let real = &bench.real[n_cells - 1];
            self.design.losses = proxy.train(&self.config, real, self.config.critic_steps);
            self.design.seen.push(proxy.look(&self.config, &bench.scoring)?);
        } else {
            // Nothing was trained, so the observation stays.
            let before = self.design.seen.last().cloned();
            self.design.seen.extend(before);
        }
        Ok(())
    }

    fn score(&self, scores: Scores) -> f64 {
        scores.inception - self.config.frechet_weight * scores.frechet
    }

    fn observation(&self) -> Vec<f64> {
        let n_cells = self.design.cells.len() as f64;
        let blank = vec![0.0; self.config.generator_channels];
        match self.design.seen.last() {
            None => [vec![n_cells, 0.0, 0.0], blank].concat(),
            Some(look) => {
                let fixed = vec![n_cells, look.scores.inception, 0.01 * look.scores.frechet];
                [fixed, look.features.clone()].concat()
            }
        }
    }
}

/// The cells of a design, with missing ones filled up by first options.
fn forms(cells: &[CellOptions]) -> [CellArchitecture; N_CELLS] {
    let mut all = cells.to_vec();
    all.resize(N_CELLS, [0; 6]);
    // Options within their choices make a genotype within its bounds.
    Architecture::from_genotype(&genotype(&all))
        .expect("options of choices are genes")
        .cells
}

impl Environment for GeneratorSearch {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    fn reset(&mut self, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        self.begin(rng.next_u64())?;
        Ok(vec![self.observation()])
    }

    fn step(&mut self, actions: &[Vec<f64>], _: &mut Rng) -> Result<Step, Error> {
        let step = self.design.cells.len();
        let Some(before) = self
            .design
            .seen
            .last()
            .map(|look| look.scores)
            .filter(|_| step < N_CELLS)
        else {
            let problem = format!("the design has its {N_CELLS} cells, or none was begun");
            return Err(Error::Action { problem });
        };
        let taken = choice::taken(&choices(), &actions[0])?;
        self.add(effective(step, &taken))?;
        let finite = self.design.seen.last().is_some_and(|look| look.finite);
        let scores = self.design.seen.last().map_or(before, |look| look.scores);
        let Losses { critic, generator } = self.design.losses;
        let bounded = |loss: f64| if loss.is_finite() { loss } else { f64::MAX.sqrt() };
        let whole = self.design.cells.len() == N_CELLS;
        let reward = self.score(scores) - self.score(before);
        let end = whole.then_some(End::Terminated);
        Ok(Step::new(vec![self.observation()], vec![reward], end)
            .record("score", self.score(scores))
            .record("inception_score", scores.inception)
            .record("frechet_distance", scores.frechet)
            .record("discriminator_loss", bounded(critic))
            .record("generator_loss", bounded(generator))
            .record("not_finite", f64::from(u8::from(!finite))))
    }

    fn trace_channels(&self) -> Vec<Channel> {
        vec![
            Channel::new("inception_score", ""),
            Channel::new("frechet_distance", ""),
        ]
    }

    fn trace(&self) -> Vec<f64> {
        let scores = self.design.seen.last().map(|look| look.scores);
        scores.map_or(vec![f64::NAN; 2], |scores| vec![scores.inception, scores.frechet])
    }

    fn graph(&self) -> Option<Graph> {
        let whole = self.design.cells.len() == N_CELLS;
        whole.then(|| drawing::graph(&forms(&self.design.cells)))
    }

    fn images(&mut self) -> Result<Vec<Image>, Error> {
        let Some(proxy) = self.proxy.as_ref().filter(|_| self.design.cells.len() == N_CELLS) else {
            return Ok(Vec::new());
        };
        let (side, bytes) = proxy.samples(&self.config, N_SAMPLES);
        #[allow(clippy::cast_possible_truncation, reason = "sides are small")]
        let image = |pixels: &[u8]| Image {
            width: side as u32,
            height: side as u32,
            pixels: pixels.to_vec(),
        };
        Ok(bytes.chunks_exact(side * side * 3).map(image).collect())
    }

    /// The seed and the cells: the same training gives the same bits again.
    fn snapshot(&self) -> Value {
        let begun = !self.design.seen.is_empty();
        json!({ "design": self.design, "begun": begun })
    }

    fn restore(&mut self, snapshot: &Value) -> Result<(), Error> {
        let design = Design::deserialize(&snapshot["design"]).map_err(|source| Error::Checkpoint {
            what: NAME,
            problem: source.to_string(),
        })?;
        (self.design, self.proxy) = (Design::default(), None);
        if snapshot["begun"] != true {
            return Ok(());
        }
        self.begin(design.seed)?;
        design.cells.into_iter().try_for_each(|cell| self.add(cell))
    }
}
