//! Agent `image_classifier`: a [`FeatureNetwork`] that learns to classify images.
//!
//! It descends the cross entropy of batches of examples with Adam. Its policy is the network by which scores
//! describe generated images.
//!
//! Metrics, means over the batches since the last measurement: `cross_entropy`.

use crate::feature_network::{FeatureNetwork, NetworkSizes};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Space, Transition, Updates,
};
use numerics::{
    equations::state_file,
    tensor_file::{TensorFile, TensorFileError},
};
use plan::{Descent, Equations, Expression, Plans, Processor, State};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::Path;

const NAME: &str = "image_classifier";
const STATE: &str = "agent.safetensors";

/// Settings of the `image_classifier` agent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Channels of the first layer; the number of features is four times as large.
    #[schemars(range(min = 1, max = 512))]
    pub channels: usize,
    /// Step size of Adam.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub learning_rate: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            channels: 16,
            learning_rate: 1e-3,
        }
    }
}

impl contract::Config for Config {}

/// The agent.
#[derive(Debug, Clone)]
pub struct ImageClassifier {
    network: FeatureNetwork,
    learning: Plans,
    learning_rate: f64,
    n_updates: u64,
}

pub(crate) fn register(registry: &mut Registry) {
    let about =
        "a convolutional network that says the class of an image, and whose features scores are made of";
    let metric = Metric::new(
        "cross_entropy",
        "nat",
        "minus the mean log probability of the right class",
    );
    let traits = AgentTraits::learner([Feed::Examples], vec![metric.lower_is_better()]);
    registry.agent(NAME, 1, about, traits, |config, interface, rng| {
        Ok(Box::new(ImageClassifier::new(&config, interface, rng)?))
    });
}

impl ImageClassifier {
    /// Builds the agent for one seat that observes a square image and acts by choosing one of several classes.
    ///
    /// # Errors
    /// [`Error::Mismatch`] for any other seat.
    pub fn new(config: &Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        Ok(Self {
            network: FeatureNetwork::new(form(config, interface)?, rng),
            learning: Plans::default(),
            learning_rate: config.learning_rate,
            n_updates: 0,
        })
    }

    /// The plan for so many images, and the state that it trains.
    fn written(&mut self, n_images: usize) -> (&mut Processor<f32>, &mut State<f32>) {
        let (form, rate) = (self.network.form(), self.learning_rate);
        let plan = self.learning.of_rows(n_images, |equations| {
            let loss = cross_entropy(form, equations, n_images);
            equations.output("cross_entropy", loss);
            let descent = Descent::adam("learning_rate", rate, None);
            equations.descend(loss, &form.expressions(equations), &descent);
        });
        (plan, &mut self.network.state)
    }
}

fn form(config: &Config, interface: &Interface) -> Result<NetworkSizes, Error> {
    let mismatch = |problem: String| Error::Mismatch { agent: NAME, problem };
    let [seat] = interface.seats.as_slice() else {
        let seats = interface.seats.len();
        return Err(mismatch(format!(
            "it plays one seat, the environment has {seats}"
        )));
    };
    let (Space::Box(pixels), Space::Discrete(classes)) = (&seat.observation, &seat.action) else {
        return Err(mismatch(
            "it says the class of an image, and there is none to see or none to say".into(),
        ));
    };
    if interface.state.len() != classes.len() {
        return Err(mismatch(
            "it learns from a state that says the class, and there is none".into(),
        ));
    }
    let size = (1..)
        .find(|size| crate::source::n_numbers(*size) >= pixels.len())
        .unwrap_or(1);
    if crate::source::n_numbers(size) != pixels.len() || !size.is_multiple_of(4) {
        let problem = format!(
            "it sees square colour images whose sides are multiples of 4; {} numbers are none",
            pixels.len()
        );
        return Err(mismatch(problem));
    }
    Ok(NetworkSizes {
        size,
        channels: config.channels,
        classes: classes.len(),
    })
}

/// The cross entropy of images and answers `[batch, classes]`, 1 for the right class and 0 for the others, that
/// a caller writes as `images` and `answers`.
fn cross_entropy(form: NetworkSizes, equations: &Equations, n_images: usize) -> Expression<'_> {
    let images = form.images(equations, n_images);
    let answers = equations.input("answers", [n_images, form.classes]);
    equations.routine("update");
    let logs = form.apply(images).logits.log_softmax();
    (logs * answers).sum() * (-1.0 / n_images as f64)
}

/// Numbers of images that are seen, one after the other.
#[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
fn images<'a>(observations: impl Iterator<Item = &'a Observation>) -> Vec<f32> {
    observations
        .flat_map(|one| one.seats[0].iter().map(|number| *number as f32))
        .collect()
}

fn error_of(error: TensorFileError) -> Error {
    match error {
        TensorFileError::File { doing, path, source } => Error::File { doing, path, source },
        other => Error::Checkpoint {
            what: NAME,
            problem: other.to_string(),
        },
    }
}

impl Agent for ImageClassifier {
    fn act(&mut self, observations: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        let NetworkSizes { size, classes, .. } = self.network.form();
        let logits = self.network.see(&images(observations.iter()), size).logits;
        let largest = |row: &[f32]| {
            let better = |best: usize, at: usize| if row[at] > row[best] { at } else { best };
            (0..row.len()).fold(0, better)
        };
        #[allow(clippy::cast_precision_loss, reason = "few classes")]
        let said = |row: &[f32]| vec![vec![largest(row) as f64]];
        Ok(logits.chunks_exact(classes).map(said).collect())
    }

    #[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
    fn learn(&mut self, transitions: &[Transition], _: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let (plan, state) = self.written(transitions.len());
        let answers = transitions
            .iter()
            .flat_map(|one| one.observation.state.iter().map(|is| *is as f32));
        plan.write("answers", &answers.collect::<Vec<f32>>());
        plan.write("images", &images(transitions.iter().map(|one| &one.observation)));
        plan.run("update", state);
        let value = plan.number("cross_entropy");
        if !value.is_finite() {
            return Err(Error::NotFinite {
                what: "cross_entropy".into(),
                step: self.n_updates,
                value,
            });
        }
        record.mean("cross_entropy", value);
        self.n_updates += 1;
        Ok(())
    }

    fn plan(&mut self, n_rows: usize) -> Option<String> {
        Some(self.written(n_rows).0.graph().to_string())
    }

    fn reads_state(&self) -> bool {
        true
    }

    fn updates(&self) -> Option<Updates> {
        Some(Updates {
            made: self.n_updates,
            first_after: 1,
        })
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        let mut file = TensorFile::default();
        file.header = json!({ "n_updates": self.n_updates });
        state_file::store(&self.network.state, &mut file);
        file.write(&dir.join(STATE)).map_err(error_of)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        let file = TensorFile::read(&dir.join(STATE)).map_err(error_of)?;
        state_file::restore(&mut self.network.state, &file).map_err(error_of)?;
        self.n_updates = file.header["n_updates"]
            .as_u64()
            .ok_or_else(|| Error::Checkpoint {
                what: NAME,
                problem: "it does not say how many updates were made".into(),
            })?;
        Ok(())
    }

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        self.network.write(dir).map_err(error_of)?;
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        let read = FeatureNetwork::read(dir).map_err(error_of)?;
        let (form, own) = (read.form(), self.network.form());
        if form != own {
            return Err(Error::Checkpoint {
                what: NAME,
                problem: format!("the network is {form:?}, here {own:?}"),
            });
        }
        self.network.adopt(&read);
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples;
    use contract::{Environment, random::stream};

    fn shapes() -> Box<dyn Environment> {
        let mut registry = Registry::default();
        samples::register(&mut registry);
        let config = json!({ "images": { "shapes": { "count": 1000 } }, "size": 8, "held_out": 0.25 });
        (registry.environments["image_samples"].build)(&config.into()).unwrap()
    }

    const SMALL: Config = Config {
        channels: 8,
        learning_rate: 3e-3,
    };

    fn agent(interface: &Interface) -> ImageClassifier {
        ImageClassifier::new(&SMALL, interface, &mut stream(&["classifier"])).unwrap()
    }

    fn example(shows: &mut dyn Environment, rng: &mut Rng) -> Transition {
        let observation = Observation {
            seats: shows.reset(rng).unwrap(),
            state: shows.state(),
        };
        Transition {
            next_observation: observation.clone(),
            observation,
            action: Vec::new(),
            rewards: Vec::new(),
            end: None,
        }
    }

    fn accuracy(agent: &mut dyn Agent, shows: &mut dyn Environment, rng: &mut Rng) -> f64 {
        let right = |episode: u64| {
            let seats = shows.reset_to(episode, rng).unwrap();
            let seen = Observation {
                seats,
                state: Vec::new(),
            };
            let action = agent.act(&[seen], Mode::Evaluate, rng).unwrap().remove(0);
            shows.step(&action, rng).unwrap().rewards[0]
        };
        (0..100).map(right).sum::<f64>() / 100.0
    }

    #[test]
    fn it_learns_classes_that_it_was_not_shown_and_leaves_its_network() {
        let (mut shows, mut rng) = (shapes(), stream(&["learns"]));
        let mut agent = agent(&shows.interface());
        assert!(accuracy(&mut agent, &mut *shows, &mut rng) < 0.3);
        let mut record = Recorder::default();
        for _ in 0..400 {
            let batch: Vec<Transition> = (0..32).map(|_| example(&mut *shows, &mut rng)).collect();
            agent.learn(&batch, &mut rng, &mut record).unwrap();
        }
        let learned = accuracy(&mut agent, &mut *shows, &mut rng);
        assert!(learned > 0.4, "{learned}");
        let folder = tempfile::tempdir().unwrap();
        assert!(agent.export(folder.path()).unwrap());
        let mut another = self::agent(&shows.interface());
        assert!(another.import(folder.path()).unwrap());
        assert_eq!(accuracy(&mut another, &mut *shows, &mut rng), learned);
    }

    #[test]
    fn the_gradient_is_that_of_the_cross_entropy() {
        let (mut shows, mut rng) = (shapes(), stream(&["slope"]));
        let form = NetworkSizes {
            size: 8,
            channels: 2,
            classes: 10,
        };
        let mut network = FeatureNetwork::new(form, &mut rng);
        let example = example(&mut *shows, &mut rng);
        let equations = Equations::new();
        let loss = cross_entropy(form, &equations, 1);
        equations.output("loss", loss);
        let parameters = form.expressions(&equations);
        for (at, gradient) in equations.gradients(loss, &parameters).into_iter().enumerate() {
            equations.output(&format!("gradient {at}"), gradient * 1.0);
        }
        let mut plan = plan::Processor::<f32>::new(equations.into_graph());
        plan.write("images", &images(std::iter::once(&example.observation)));
        let answers: Vec<f32> = example.observation.state.iter().map(|is| *is as f32).collect();
        plan.write("answers", &answers);
        plan.run("update", &mut network.state);
        let names: Vec<String> = network
            .state
            .tensors()
            .map(|(name, ..)| name.to_owned())
            .collect();
        let found: Vec<Vec<f32>> = (0..names.len())
            .map(|at| plan.entries(&format!("gradient {at}")).to_vec())
            .collect();
        for (name, found) in names.iter().zip(found) {
            let entry = found.len() / 2;
            let mut moved = |by: f32| {
                let mut state = network.state.clone();
                state.entries_mut(name)[entry] += by;
                plan.run("update", &mut state);
                plan.number("loss")
            };
            let expected = (moved(1e-2) - moved(-1e-2)) / 2e-2;
            let gradient = f64::from(found[entry]);
            assert!(
                (gradient - expected).abs() < 5e-3,
                "{name}: {gradient} {expected}"
            );
        }
    }

    #[test]
    fn a_stored_agent_continues_to_the_same_bits() {
        let (mut shows, mut rng) = (shapes(), stream(&["stored"]));
        let mut one = agent(&shows.interface());
        let mut record = Recorder::default();
        let batches: Vec<Vec<Transition>> = (0..4)
            .map(|_| (0..8).map(|_| example(&mut *shows, &mut rng)).collect())
            .collect();
        for batch in &batches[..2] {
            one.learn(batch, &mut rng, &mut record).unwrap();
        }
        let folder = tempfile::tempdir().unwrap();
        one.save(folder.path()).unwrap();
        let mut two = ImageClassifier::new(&SMALL, &shows.interface(), &mut stream(&["another"])).unwrap();
        two.load(folder.path()).unwrap();
        let mut left = |agent: &mut dyn Agent| {
            for batch in &batches[2..] {
                agent.learn(batch, &mut rng, &mut record).unwrap();
            }
            let folder = tempfile::tempdir().unwrap();
            agent.export(folder.path()).unwrap();
            std::fs::read(folder.path().join(numerics::policy_file::FILE_NAME)).unwrap()
        };
        assert_eq!(left(&mut one), left(&mut two));
    }

    /// Convolutions have no kernels for a card: there a classifier computes on a core.
    #[test]
    fn members_of_a_population_learn_as_trials_alone() {
        let interface = shapes().interface();
        let config = Config { channels: 2, ..SMALL };
        crate::population::assert_members_learn_as_alone(
            |rng| ImageClassifier::new(&config, &interface, rng).unwrap(),
            |agent| std::slice::from_mut(&mut agent.learning),
            |agent, rng| {
                let mut shows = shapes();
                let batch: Vec<Transition> = (0..8).map(|_| example(&mut *shows, rng)).collect();
                agent.learn(&batch, rng, &mut Recorder::default()).unwrap();
            },
        );
    }

    #[test]
    fn a_seat_without_an_image_is_refused() {
        let mut interface = shapes().interface();
        if let Space::Box(pixels) = &mut interface.seats[0].observation {
            pixels.pop();
        }
        let text = ImageClassifier::new(&Config::default(), &interface, &mut stream(&[]))
            .err()
            .unwrap()
            .to_string();
        assert!(text.contains("191 numbers are none"), "{text}");
    }
}
