//! How generated images are scored: by what network, against which real images.

use crate::{
    feature_network::{FeatureNetwork, Form},
    images::Images,
    inception::{self, Inception},
    kept::Kept,
    scores::{MomentSums, Moments, class_probabilities, frechet_distance, inception_score},
    source::{ImageFile, Source, n_numbers, shrunk},
};
use burn::{
    module::Module,
    tensor::{Tensor, TensorData},
};
use contract::{Artifact, Error, artifact};
use numerics::network::{device, values};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, sync::Arc};

/// Images that are seen at once.
const ROWS: usize = 100;

/// By what network images are seen.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Sight {
    /// The classifier that a trial with the agent `image_classifier` left.
    Classifier(Artifact<artifact::Policy>),
    /// Inception-v3 as pytorch-fid uses it, with the weights of a safetensors file: the network of published scores.
    /// Its bits differ between processors.
    InceptionV3(ImageFile),
    /// A network of that form with random weights: its features tell images apart, its classes mean nothing.
    #[default]
    Untrained,
}

impl Sight {
    /// Refuses a network that is not there or something else; large files are only looked for.
    ///
    /// # Errors
    /// [`Error::Config`] for a trial that left no classifier, [`Error::File`] for a file that is not there.
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

fn classifier(product: &Artifact<artifact::Policy>) -> Result<(FeatureNetwork, Form), Error> {
    FeatureNetwork::read(product.folder()?).map_err(|error| {
        let problem = format!("`{}` left no classifier of images: {error}", product.source());
        Error::config("sight.classifier", problem)
    })
}

/// Both scores of generated images.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    /// Of the classes, 1 at least.
    pub inception: f64,
    /// To the real images, 0 at least.
    pub frechet: f64,
}

/// Scores generated images of each size that generators of the search have.
#[derive(Debug)]
pub struct Scoring {
    network: Network,
    /// Moments of real images by their size.
    real: BTreeMap<usize, Moments>,
    n_splits: usize,
    /// The scores of images that are grey all over, for generators whose numbers are none.
    grey: BTreeMap<usize, f64>,
}

/// What a scoring is made of.
#[derive(Debug, Clone, Copy)]
pub struct Reference<'a> {
    /// Where real images come from.
    pub source: &'a Source,
    /// By what network they are seen.
    pub sight: &'a Sight,
    /// Pixels a side of the last stage.
    pub size: usize,
    /// Pixels a side of all stages.
    pub stages: &'a [usize],
    /// How many real images, from the first.
    pub count: usize,
    /// Parts of the generated images that are scored apart.
    pub n_splits: usize,
}

impl Scoring {
    /// The scoring of a reference, made once as long as not many others are asked for.
    ///
    /// # Errors
    /// What reading images and the network say, [`Error::Config`] where there are too few images.
    pub fn of(reference: &Reference<'_>) -> Result<Arc<Self>, Error> {
        static KEPT: Kept<Scoring> = Kept::new();
        let sight = match reference.sight {
            Sight::Untrained => "untrained".to_owned(),
            Sight::InceptionV3(weights) => weights.file.digest()?.into_owned(),
            Sight::Classifier(product) => product.folder()?.display().to_string(),
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
        KEPT.or_made(key, || Self::made(reference))
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
            network: Network::of(reference.sight, reference.size, images.class_names().len())?,
            real: BTreeMap::new(),
            grey: BTreeMap::new(),
            n_splits: reference.n_splits,
        };
        for stage in reference.stages {
            let moments = scoring.moments_of(&images, reference.count, *stage)?;
            let grey = vec![0.0; ROWS * n_numbers(*stage)];
            let mut seen = Seen::new(&scoring, *stage);
            seen.add(
                &scoring,
                Tensor::from_data(TensorData::new(grey, [ROWS, *stage, *stage, 3]), &device()),
            )?;
            let grey = frechet_distance(&seen.moments.moments().map_err(score_error)?, &moments)
                .map_err(score_error)?;
            scoring.grey.insert(*stage, grey.distance);
            scoring.real.insert(*stage, moments);
        }
        Ok(scoring)
    }

    fn moments_of(&self, images: &Images, count: usize, stage: usize) -> Result<Moments, Error> {
        let small = shrunk(images.first(count), stage)?;
        let mut seen = Seen::new(self, stage);
        let all: Vec<usize> = (0..count).collect();
        for rows in all.chunks(ROWS) {
            let numbers = small.batch(rows);
            let batch = Tensor::from_data(TensorData::new(numbers, [rows.len(), stage, stage, 3]), &device());
            seen.add(self, batch)?;
        }
        seen.moments.moments().map_err(score_error)
    }

    /// Begins to score generated images with this many pixels a side.
    #[must_use]
    pub fn begin(&self, stage: usize) -> Seen {
        Seen::new(self, stage)
    }

    /// The worst that images of this size are scored: all alike and grey, as a generator makes them whose numbers are
    /// no longer finite.
    #[must_use]
    pub fn worst(&self, stage: usize) -> Scores {
        Scores {
            inception: 1.0,
            frechet: self.grey[&stage],
        }
    }
}

/// What sees.
#[derive(Debug)]
enum Network {
    /// Boxed, since both are large.
    Classifier(Box<FeatureNetwork>, Form),
    InceptionV3(Box<Inception>),
}

impl Network {
    fn of(sight: &Sight, size: usize, classes: usize) -> Result<Self, Error> {
        match sight {
            Sight::Untrained => {
                let form = Form {
                    size: size.next_multiple_of(4),
                    channels: 16,
                    classes,
                };
                let mut rng = contract::random::stream(&["untrained feature network"]);
                Ok(Self::Classifier(
                    Box::new(FeatureNetwork::new(form, &mut rng).valid()),
                    form,
                ))
            }
            Sight::Classifier(product) => {
                let (network, form) = classifier(product)?;
                Ok(Self::Classifier(Box::new(network), form))
            }
            Sight::InceptionV3(weights) => {
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

    /// Features `[batch, features]` and logits `[batch, classes]` of images.
    fn see(&self, images: Tensor<4>) -> (Tensor<2>, Tensor<2>) {
        match self {
            Self::Classifier(network, form) => {
                let seen = network.see_resized(images, *form);
                (seen.features, seen.logits)
            }
            Self::InceptionV3(network) => network.see(images),
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

/// Generated images as far as they were seen.
#[derive(Debug)]
pub struct Seen {
    stage: usize,
    probabilities: Vec<f64>,
    moments: MomentSums,
}

impl Seen {
    fn new(scoring: &Scoring, stage: usize) -> Self {
        Self {
            stage,
            probabilities: Vec::new(),
            moments: MomentSums::new(scoring.network.n_features()),
        }
    }

    /// Takes in images `[batch, stage, stage, 3]`, as the bytes that they are shown as.
    ///
    /// # Errors
    /// [`Error::Model`] where a feature is not finite.
    pub fn add(&mut self, scoring: &Scoring, images: Tensor<4>) -> Result<(), Error> {
        let shape = images.dims();
        let bytes = crate::images::to_bytes(&values(images));
        let shown: Vec<f32> = bytes.into_iter().map(crate::images::from_byte).collect();
        let shown = Tensor::from_data(TensorData::new(shown, shape), &device());
        let (features, logits) = scoring.network.see(shown);
        self.probabilities
            .extend(class_probabilities(&values(logits), scoring.network.n_classes()));
        self.moments.add(&values(features)).map_err(score_error)
    }

    /// Both scores of all that was seen.
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
        let source: Source = serde_json::from_value(json!({ "shapes": { "count": 300 } })).unwrap();
        Scoring::of(&Reference {
            source: &source,
            sight: &Sight::Untrained,
            size: 8,
            stages: &[4, 8],
            count,
            n_splits: 2,
        })
    }

    fn images(seed: u64, size: usize, numbers: usize) -> Tensor<4> {
        let source: Source =
            serde_json::from_value(json!({ "shapes": { "count": 300, "seed": seed } })).unwrap();
        let images = shrunk((*source.load(8).unwrap()).clone(), size).unwrap();
        let all: Vec<usize> = (0..numbers).collect();
        Tensor::from_data(
            TensorData::new(images.batch(&all), [numbers, size, size, 3]),
            &device(),
        )
    }

    #[test]
    fn real_images_are_close_and_grey_ones_far() {
        let scoring = scoring(300).unwrap();
        for size in [4, 8] {
            let scores = |images: Tensor<4>| {
                let mut seen = scoring.begin(size);
                seen.add(&scoring, images).unwrap();
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
        let of = |images: Tensor<4>| {
            let mut seen = scoring.begin(8);
            seen.add(&scoring, images).unwrap();
            seen.scores(&scoring).unwrap()
        };
        let exact = images(1, 8, 100);
        assert_eq!(of(exact.clone()), of(exact + 1e-4));
    }

    #[test]
    fn weights_that_are_none_are_refused_with_their_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("inception.safetensors");
        std::fs::write(&path, b"no weights").unwrap();
        let sight: Sight = serde_json::from_value(json!({ "inception_v3": { "file": path } })).unwrap();
        let text = Network::of(&sight, 8, 10).unwrap_err().to_string();
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
