//! Environment `image_samples`: classify one image.
//!
//! An episode is one step. The observation holds the numbers of an image, `[height, width, 3]` in [-1, 1], row
//! by row; the state, from which a regression learns, is 1 for the class of the image and 0 for the others. The
//! last images of the set are held out: measurements show those, learning the others.

use crate::{
    images::Images,
    source::{ImageSource, n_numbers},
};
use contract::{Channel, End, Environment, Error, Metric, PerEpisode, Registry, Rng, Seat, Space, Step};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::sync::Arc;

const NAME: &str = "image_samples";

/// Settings of the `image_samples` environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Source of the images.
    pub images: ImageSource,
    /// Height and width, pixels.
    #[schemars(range(min = 4, max = 96))]
    pub size: usize,
    /// Fraction of the images, counted from the last one, that measurements show and learning does not.
    #[schemars(range(min = 0.01, max = 0.9))]
    pub held_out: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            images: ImageSource::default(),
            size: 16,
            held_out: 0.2,
        }
    }
}

impl contract::Config for Config {}

/// The environment.
#[derive(Debug)]
pub struct ImageSamples {
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    config: Config,
    /// Images, read when the first one is shown.
    images: Option<Arc<Images>>,
    n_images: usize,
    n_shown: usize,
    at: usize,
    answer: Option<usize>,
}

pub(crate) fn register(registry: &mut Registry) {
    registry.environment(NAME, 1, "one image, whose class is to be said", build);
}

fn build(config: Config) -> Result<Box<dyn Environment>, Error> {
    let n_images = config.images.count()?;
    if !config.images.has_labels() {
        return Err(Error::config(
            "images",
            "these images have no labels; name the file of their labels",
        ));
    }
    #[allow(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a share of a count is a count"
    )]
    let n_held_out = (n_images as f64 * config.held_out).ceil() as usize;
    if n_held_out >= n_images {
        let problem = format!("nothing is left to learn from of {n_images} images; lower it");
        return Err(Error::config("held_out", problem));
    }
    let names = config.images.class_names().iter().map(ToString::to_string);
    let seat = Seat {
        name: String::new(),
        observation: Space::Box(pixels(config.size)),
        action: Space::Discrete(names.collect()),
    };
    let accuracy = Metric::new("accuracy", "", "1 where the class was said, else 0");
    Ok(Box::new(ImageSamples {
        seats: vec![seat],
        metrics: vec![accuracy.per_episode(PerEpisode::Last)],
        n_shown: n_images - n_held_out,
        n_images,
        images: None,
        config,
        at: 0,
        answer: None,
    }))
}

/// `pixel_<row>_<column>_<colour>`.
fn pixels(size: usize) -> Vec<Channel> {
    let name = |at: usize| {
        let (pixel, colour) = (at / 3, ["red", "green", "blue"][at % 3]);
        format!("pixel_{}_{}_{colour}", pixel / size, pixel % size)
    };
    (0..n_numbers(size))
        .map(|at| Channel::new(name(at), "").within(-1.0, 1.0).typical(0.0, 0.5))
        .collect()
}

impl ImageSamples {
    fn show(&mut self, at: usize) -> Result<Vec<Vec<f64>>, Error> {
        let images = match self.images.take() {
            Some(images) => images,
            None => self.config.images.load(self.config.size)?,
        };
        self.images = Some(images);
        (self.at, self.answer) = (at, None);
        Ok(vec![self.seen()])
    }

    /// The image; empty before one is shown.
    fn seen(&self) -> Vec<f64> {
        let numbers = self.images.iter().flat_map(|images| images.batch(&[self.at]));
        numbers.map(f64::from).collect()
    }

    /// The class of the image; `None` before one is shown. The constructor checked that there are labels.
    fn class(&self) -> Option<usize> {
        let labels = self.images.as_ref()?.labels()?;
        Some(usize::from(labels[self.at]))
    }
}

impl Environment for ImageSamples {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    fn reset(&mut self, rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        let at = rng.random_range(0..self.n_shown as u64) as usize;
        self.show(at)
    }

    fn reset_to(&mut self, episode: u64, _: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        let n_held_out = (self.n_images - self.n_shown) as u64;
        self.show(self.n_shown + (episode % n_held_out) as usize)
    }

    fn step(&mut self, actions: &[Vec<f64>], _: &mut Rng) -> Result<Step, Error> {
        let classes = self.config.images.class_names().len();
        let answer = actions[0][0];
        let known = (0..classes).find(|class| *class as f64 == answer);
        let answer = known.ok_or_else(|| Error::Action {
            problem: format!("{answer} is no class; there are 0 to {}", classes - 1),
        })?;
        self.answer = Some(answer);
        let right = f64::from(u8::from(Some(answer) == self.class()));
        let step = Step::new(vec![self.seen()], vec![right], Some(End::Terminated));
        Ok(step.record("accuracy", right))
    }

    fn state_channels(&self) -> Vec<Channel> {
        let names = self.config.images.class_names().iter();
        names
            .map(|name| Channel::new(format!("is_{name}"), "").within(0.0, 1.0))
            .collect()
    }

    fn state(&self) -> Vec<f64> {
        let is = |class: usize| f64::from(u8::from(Some(class) == self.class()));
        (0..self.config.images.class_names().len()).map(is).collect()
    }

    fn trace_channels(&self) -> Vec<Channel> {
        ["class", "said"].map(|name| Channel::new(name, "")).to_vec()
    }

    fn trace(&self) -> Vec<f64> {
        let said = self.answer.map_or(f64::NAN, |class| class as f64);
        vec![self.class().map_or(f64::NAN, |class| class as f64), said]
    }

    fn snapshot(&self) -> Value {
        json!({ "at": self.at, "answer": self.answer })
    }

    fn restore(&mut self, snapshot: &Value) -> Result<(), Error> {
        let at = snapshot["at"].as_u64().and_then(|at| usize::try_from(at).ok());
        let at = at
            .filter(|at| *at < self.n_images)
            .ok_or_else(|| Error::Checkpoint {
                what: NAME,
                problem: format!("it shows image {}", snapshot["at"]),
            })?;
        self.show(at)?;
        self.answer = snapshot["answer"]
            .as_u64()
            .and_then(|class| usize::try_from(class).ok());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::random::stream;

    fn environment(held_out: f64) -> Result<Box<dyn Environment>, Error> {
        let images = serde_json::from_value(json!({ "shapes": { "count": 50 } })).unwrap();
        build(Config {
            images,
            size: 8,
            held_out,
        })
    }

    #[test]
    fn the_class_is_rewarded_and_nothing_else() {
        let (mut shows, mut rng) = (environment(0.2).unwrap(), stream(&["samples"]));
        for _ in 0..20 {
            let seen = shows.reset(&mut rng).unwrap();
            assert_eq!(seen[0].len(), 8 * 8 * 3);
            let class = shows.state().iter().position(|is| *is == 1.0).unwrap();
            assert_eq!(shows.state().iter().sum::<f64>(), 1.0);
            let snapshot = shows.snapshot();
            let earns = |shows: &mut Box<dyn Environment>, said: usize| {
                shows.restore(&snapshot).unwrap();
                shows
                    .step(&[vec![said as f64]], &mut stream(&[]))
                    .unwrap()
                    .rewards[0]
            };
            assert_eq!(earns(&mut shows, class), 1.0);
            assert_eq!(earns(&mut shows, (class + 1) % 10), 0.0);
            assert!(shows.step(&[vec![0.5]], &mut rng).is_err());
        }
    }

    #[test]
    fn measurements_show_what_learning_never_does() {
        let (mut shows, mut rng) = (environment(0.2).unwrap(), stream(&["held out"]));
        let place = |shows: &dyn Environment| shows.snapshot()["at"].as_u64().unwrap();
        for _ in 0..200 {
            shows.reset(&mut rng).unwrap();
            assert!(place(&*shows) < 40);
        }
        let held_out: Vec<u64> = (0..12)
            .map(|episode| {
                shows.reset_to(episode, &mut rng).unwrap();
                place(&*shows)
            })
            .collect();
        assert_eq!(held_out, [40, 41, 42, 43, 44, 45, 46, 47, 48, 49, 40, 41]);
    }

    #[test]
    fn settings_that_leave_nothing_are_refused() {
        let text = environment(0.999).err().unwrap().to_string();
        assert!(
            text.contains("`held_out`: nothing is left to learn from of 50 images"),
            "{text}"
        );
    }
}
