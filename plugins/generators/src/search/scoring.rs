//! Scoring of generated images: the network, and the real images with which they are compared.

use crate::{
    cache::Cache,
    feature_network::{FeatureNetwork, ImageFeatures, NetworkSizes},
    images::Images,
    inception::{self, Inception},
    scores::{MomentSums, Moments, class_probabilities, frechet_distance, inception_score},
    source::{ImageFile, ImageSource, n_numbers, shrunk},
};
use contract::{Artifact, Error, artifact};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, PoisonError},
};

/// Images that pass the network at once.
const ROWS: usize = 100;

/// The network by which images are scored.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ScoringNetwork {
    /// The classifier that a trial with the agent `image_classifier` left.
    Classifier(Artifact<artifact::Policy>),
    /// Inception-v3 as pytorch-fid uses it, with the weights of a safetensors file: the network of published
    /// scores.
    InceptionV3(ImageFile),
    /// The same form of network with random weights: its features distinguish images, its classes have no
    /// meaning.
    #[default]
    Untrained,
}

impl ScoringNetwork {
    /// Refuses a missing or wrong network; large files are only checked for existence.
    ///
    /// # Errors
    /// [`Error::Config`] for a trial that left no classifier, [`Error::File`] for a missing file.
    pub(super) fn check(&self) -> Result<(), Error> {
        match self {
            Self::Untrained => Ok(()),
            Self::Classifier(product) => classifier(product).map(drop),
            Self::InceptionV3(weights) => {
                let path = weights.file.path();
                std::fs::metadata(path)
                    .map(drop)
                    .map_err(Error::file("find", path))
            }
        }
    }
}

fn classifier(product: &Artifact<artifact::Policy>) -> Result<FeatureNetwork, Error> {
    FeatureNetwork::read(product.folder()?).map_err(|error| {
        let problem = format!("`{}` left no classifier of images: {error}", product.source());
        Error::config("sight.classifier", problem)
    })
}

/// Both scores of generated images.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    /// Inception score, at least 1.
    pub inception: f64,
    /// Fréchet distance to the real images, at least 0.
    pub frechet: f64,
}

/// Scores generated images of each size that generators of the search have.
#[derive(Debug)]
pub struct Scoring {
    network: LoadedNetwork,
    /// Moments of real images by their size.
    real: BTreeMap<usize, Moments>,
    n_splits: usize,
    /// Frechet distances of grey images by their size, for generators whose numbers are not finite.
    grey: BTreeMap<usize, f64>,
}

/// The inputs from which a scoring is made.
#[derive(Debug, Clone, Copy)]
pub struct Reference<'a> {
    /// Source of the real images.
    pub source: &'a ImageSource,
    /// The network by which images are scored.
    pub sight: &'a ScoringNetwork,
    /// Height and width of the images of the last stage, pixels.
    pub size: usize,
    /// Height and width of the images of all stages, pixels.
    pub stages: &'a [usize],
    /// Number of real images, from the first.
    pub count: usize,
    /// Number of parts for which the inception score is computed.
    pub n_splits: usize,
}

impl Scoring {
    /// The scoring of a reference, from the cache if it is there.
    ///
    /// # Errors
    /// Errors of reading images and network, and [`Error::Config`] where there are too few images.
    pub fn of(reference: &Reference<'_>) -> Result<Arc<Self>, Error> {
        static KEPT: Cache<Scoring> = Cache::new();
        let sight = match reference.sight {
            ScoringNetwork::Untrained => "untrained".to_owned(),
            ScoringNetwork::InceptionV3(weights) => weights.file.digest()?.into_owned(),
            ScoringNetwork::Classifier(product) => product.folder()?.display().to_string(),
        };
        let Reference {
            source,
            size,
            stages,
            count,
            n_splits,
            ..
        } = reference;
        let key = format!(
            "{} {sight} {size} {stages:?} {count} {n_splits}",
            source.identity()?
        );
        KEPT.get_or_make(key, || Self::made(reference))
    }

    fn made(reference: &Reference<'_>) -> Result<Self, Error> {
        let images = reference.source.load(reference.size)?;
        if reference.count < 2 || reference.count > images.count() {
            let problem = format!(
                "{} images are to be compared with, and there are {}; at least 2 are needed",
                reference.count,
                images.count()
            );
            return Err(Error::config("reference_images", problem));
        }
        let mut scoring = Self {
            network: LoadedNetwork::of(reference.sight, reference.size, images.class_names().len())?,
            real: BTreeMap::new(),
            grey: BTreeMap::new(),
            n_splits: reference.n_splits,
        };
        for stage in reference.stages {
            let moments = scoring.moments_of(&images, reference.count, *stage)?;
            let grey = vec![0.0; ROWS * n_numbers(*stage)];
            let mut seen = ScoringSums::new(&scoring, *stage);
            seen.add(&scoring, &grey)?;
            let grey = frechet_distance(&seen.moments.moments().map_err(score_error)?, &moments)
                .map_err(score_error)?;
            scoring.grey.insert(*stage, grey.distance);
            scoring.real.insert(*stage, moments);
        }
        Ok(scoring)
    }

    fn moments_of(&self, images: &Images, count: usize, stage: usize) -> Result<Moments, Error> {
        let small = shrunk(images.first(count), stage)?;
        let mut seen = ScoringSums::new(self, stage);
        let all: Vec<usize> = (0..count).collect();
        for rows in all.chunks(ROWS) {
            seen.add(self, &small.batch(rows))?;
        }
        seen.moments.moments().map_err(score_error)
    }

    /// Begins to score generated images of this height and width in pixels.
    #[must_use]
    pub fn begin(&self, stage: usize) -> ScoringSums {
        ScoringSums::new(self, stage)
    }

    /// The worst scores of images of this size: those of uniform grey images, for a generator whose numbers are
    /// no longer finite.
    #[must_use]
    pub fn worst(&self, stage: usize) -> Scores {
        Scores {
            inception: 1.0,
            frechet: self.grey[&stage],
        }
    }
}

/// The network of a scoring.
#[derive(Debug)]
enum LoadedNetwork {
    /// With the memory that it computes in.
    Classifier(Box<Mutex<FeatureNetwork>>, NetworkSizes),
    InceptionV3(Box<Inception>),
}

impl LoadedNetwork {
    fn of(sight: &ScoringNetwork, size: usize, classes: usize) -> Result<Self, Error> {
        let classifier_of = |network: FeatureNetwork| {
            let form = network.form();
            Self::Classifier(Box::new(Mutex::new(network)), form)
        };
        match sight {
            ScoringNetwork::Untrained => {
                let form = NetworkSizes {
                    size: size.next_multiple_of(4),
                    channels: 16,
                    classes,
                };
                let mut rng = contract::random::stream(&["untrained feature network"]);
                Ok(classifier_of(FeatureNetwork::new(form, &mut rng)))
            }
            ScoringNetwork::Classifier(product) => classifier(product).map(classifier_of),
            ScoringNetwork::InceptionV3(weights) => {
                let path = weights.file.path();
                let network = Inception::read(path).map_err(|error| Error::Damaged {
                    path: path.into(),
                    problem: error.to_string(),
                })?;
                weights.file.unchanged()?;
                Ok(Self::InceptionV3(Box::new(network)))
            }
        }
    }

    /// Features `[batch, features]` and logits `[batch, classes]` of images `[batch, side, side, 3]`.
    fn see(&self, images: &[f32], side: usize) -> ImageFeatures {
        match self {
            Self::Classifier(network, _) => {
                // A pass changes no number of the network.
                let mut network = network.lock().unwrap_or_else(PoisonError::into_inner);
                network.see(images, side)
            }
            Self::InceptionV3(network) => network.see(images, [side; 2]),
        }
    }

    fn n_features(&self) -> usize {
        match self {
            Self::Classifier(_, form) => 4 * form.channels,
            Self::InceptionV3(_) => inception::FEATURES,
        }
    }

    fn n_classes(&self) -> usize {
        match self {
            Self::Classifier(_, form) => form.classes,
            Self::InceptionV3(_) => inception::CLASSES,
        }
    }
}

/// Sums over the generated images so far.
#[derive(Debug)]
pub struct ScoringSums {
    stage: usize,
    probabilities: Vec<f64>,
    moments: MomentSums,
}

impl ScoringSums {
    fn new(scoring: &Scoring, stage: usize) -> Self {
        Self {
            stage,
            probabilities: Vec::new(),
            moments: MomentSums::new(scoring.network.n_features()),
        }
    }

    /// Adds images `[batch, stage, stage, 3]`, rounded to the bytes in which they are shown.
    ///
    /// # Errors
    /// [`Error::Model`] where a feature is not finite.
    pub fn add(&mut self, scoring: &Scoring, images: &[f32]) -> Result<(), Error> {
        let bytes = crate::images::to_bytes(images);
        let shown: Vec<f32> = bytes.into_iter().map(crate::images::from_byte).collect();
        let ImageFeatures { features, logits } = scoring.network.see(&shown, self.stage);
        self.probabilities
            .extend(class_probabilities(&logits, scoring.network.n_classes()));
        self.moments.add(&features).map_err(score_error)
    }

    /// Both scores of all images so far.
    ///
    /// # Errors
    /// [`Error::Model`] where there are too few images.
    pub fn scores(&self, scoring: &Scoring) -> Result<Scores, Error> {
        let inception = inception_score(&self.probabilities, scoring.network.n_classes(), scoring.n_splits)
            .map_err(score_error)?;
        let generated = self.moments.moments().map_err(score_error)?;
        let frechet = frechet_distance(&generated, &scoring.real[&self.stage]).map_err(score_error)?;
        Ok(Scores {
            inception: inception.mean,
            frechet: frechet.distance,
        })
    }
}

fn score_error(error: crate::scores::ScoreError) -> Error {
    Error::Model {
        model: "scores of images",
        problem: error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn scoring(count: usize) -> Result<Arc<Scoring>, Error> {
        let source: ImageSource = serde_json::from_value(json!({ "shapes": { "count": 300 } })).unwrap();
        Scoring::of(&Reference {
            source: &source,
            sight: &ScoringNetwork::Untrained,
            size: 8,
            stages: &[4, 8],
            count,
            n_splits: 2,
        })
    }

    fn images(seed: u64, size: usize, numbers: usize) -> Vec<f32> {
        let source: ImageSource =
            serde_json::from_value(json!({ "shapes": { "count": 300, "seed": seed } })).unwrap();
        let images = shrunk((*source.load(8).unwrap()).clone(), size).unwrap();
        let all: Vec<usize> = (0..numbers).collect();
        images.batch(&all)
    }

    #[test]
    fn real_images_are_close_and_grey_ones_far() {
        let scoring = scoring(300).unwrap();
        for size in [4, 8] {
            let scores = |images: Vec<f32>| {
                let mut seen = scoring.begin(size);
                seen.add(&scoring, &images).unwrap();
                seen.scores(&scoring).unwrap()
            };
            let same = scores(images(0, size, 300));
            assert!(same.frechet < 1e-6, "{same:?}");
            let others = scores(images(1, size, 300));
            assert!(
                others.frechet > 1e-6 && others.frechet < 0.2 * scoring.worst(size).frechet,
                "{others:?}"
            );
            assert!(others.inception >= 1.0);
        }
    }

    #[test]
    fn bytes_are_what_is_seen() {
        let scoring = scoring(300).unwrap();
        let of = |images: &[f32]| {
            let mut seen = scoring.begin(8);
            seen.add(&scoring, images).unwrap();
            seen.scores(&scoring).unwrap()
        };
        let exact = images(1, 8, 100);
        let moved: Vec<f32> = exact.iter().map(|x| x + 1e-4).collect();
        assert_eq!(of(&exact), of(&moved));
    }

    #[test]
    fn weights_that_are_none_are_refused_with_their_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("inception.safetensors");
        std::fs::write(&path, b"no weights").unwrap();
        let sight: ScoringNetwork =
            serde_json::from_value(json!({ "inception_v3": { "file": path } })).unwrap();
        let text = LoadedNetwork::of(&sight, 8, 10).unwrap_err().to_string();
        assert!(text.contains("inception.safetensors` is damaged"), "{text}");
    }

    #[test]
    fn more_images_than_there_are_is_refused() {
        let text = scoring(301).unwrap_err().to_string();
        assert!(
            text.contains("`reference_images`: 301 images are to be compared with, and there are 300"),
            "{text}"
        );
    }
}
