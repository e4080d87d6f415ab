//! A trained policy as one file that other programs can use: `policy.safetensors`.
//!
//! The file holds the tensors `policy.layers.<k>.weight` (`[inputs, outputs]`) and `policy.layers.<k>.bias`
//! of a fully connected network, and a JSON text under the metadata key `header` ([`PolicyHeader`]). In
//! numpy:
//!
//! ```python
//! x = (observation - center) / spread
//! for k, activation in enumerate(activations):          # "relu", "leaky_relu" (0.01 below zero), "tanh"
//!     x = activation(x @ weight[k] + bias[k])
//! x = x @ weight[-1] + bias[-1]                          # then the head, then
//! action = action_center + action_spread * head(x)       # where the header has these
//! ```

use crate::activation::Activation;
use crate::equations::{network::Network, state_file::store_network};
use crate::tensor_file::{TensorFile, TensorFileError};
use arithmetic::{
    double,
    products::{Matrix, product},
};
use plan::State;
use rand::RngCore;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Name of the file within a folder.
pub const FILE_NAME: &str = "policy.safetensors";
const FORMAT: u32 = 1;
/// Prefix of the names of the network's tensors.
pub const PREFIX: &str = "policy";

/// Function from the outputs of the network to an action.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Head {
    /// `alpha = softplus(x) + 1`, action `alpha / sum(alpha)`: the mean of the Dirichlet distribution.
    DirichletMean,
    /// `alpha = softplus(x) + 1`, action `(alpha - 1) / sum(alpha - 1)`: the mode of that distribution.
    DirichletMode,
    /// Action `softmax(x)`; `x` is the mean of a Gaussian candidate.
    SoftmaxMean,
    /// Action `tanh(x)`.
    Tanh,
    /// Index of the largest output.
    Argmax,
    /// The outputs themselves.
    Identity,
}

/// Information that a program needs besides the weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PolicyHeader {
    /// Version of this format, 1.
    pub format: u32,
    /// Layer sizes, input first.
    pub sizes: Vec<usize>,
    /// Activation of each hidden layer.
    pub activations: Vec<Activation>,
    /// Names of the observed channels, in order.
    pub inputs: Vec<String>,
    /// Center that is subtracted from each input.
    pub center: Vec<f64>,
    /// Spread by which each centred input is divided.
    pub spread: Vec<f64>,
    /// Names of the entries of the action.
    pub outputs: Vec<String>,
    /// Function from the first `outputs.len()` outputs of the network to the action.
    pub head: Head,
    /// Factor of each entry of the action after the head; absent for 1.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub action_spread: Vec<f64>,
    /// Summand of each entry after that factor; absent for 0.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub action_center: Vec<f64>,
}

/// A policy that can be evaluated.
#[derive(Debug, Clone)]
pub struct Policy {
    /// Header of the file.
    pub header: PolicyHeader,
    /// Weights and biases of the network.
    parameters: TensorFile,
}

/// Names and scaling of a policy's inputs and outputs.
#[derive(Debug, Clone, PartialEq)]
pub struct Ports {
    /// Names of the observed channels.
    pub inputs: Vec<String>,
    /// Center that is subtracted from each input.
    pub center: Vec<f64>,
    /// Spread by which each centred input is divided.
    pub spread: Vec<f64>,
    /// Names of the entries of the action.
    pub outputs: Vec<String>,
}

impl Policy {
    /// Creates a policy from a network and its parameters in a state.
    ///
    /// # Panics
    /// If the state lacks a parameter of the network.
    #[must_use]
    pub fn new(network: &Network, state: &State<f32>, ports: Ports, head: Head) -> Self {
        let mut parameters = TensorFile::default();
        store_network(network, PREFIX, state, &mut parameters);
        let header = header(network.sizes().to_vec(), network.activations(), ports, head);
        Self { header, parameters }
    }

    /// Creates a policy with new weights after He et al. 2015; `sizes` and `activations` as in [`Network::new`].
    #[must_use]
    pub fn untrained(
        sizes: &[usize],
        activations: &[Activation],
        ports: Ports,
        head: Head,
        rng: &mut impl RngCore,
    ) -> Self {
        let (network, mut state) = (Network::new(PREFIX, sizes, activations), State::default());
        network.initialise(1.0, &mut state, rng);
        Self::new(&network, &state, ports, head)
    }

    /// Policy whose actions are multiplied by `spread` and shifted by `center` after the head.
    #[must_use]
    pub fn in_units(mut self, center: Vec<f64>, spread: Vec<f64>) -> Self {
        (self.header.action_center, self.header.action_spread) = (center, spread);
        self
    }

    /// Weights and biases of the network between scaling and head.
    pub(crate) fn parameters(&self) -> &TensorFile {
        &self.parameters
    }

    /// Writes `policy.safetensors` into `dir`.
    ///
    /// # Errors
    /// [`TensorFileError::File`] if the operating system refuses.
    pub fn write(&self, dir: &Path) -> Result<(), TensorFileError> {
        let mut file = self.parameters.clone();
        file.header = serde_json::to_value(&self.header).map_err(|source| format_error(&source))?;
        file.write(&dir.join(FILE_NAME))
    }

    /// Reads `policy.safetensors` from `dir`.
    ///
    /// # Errors
    /// [`TensorFileError`] if the file is missing, damaged or of another format.
    pub fn read(dir: &Path) -> Result<Self, TensorFileError> {
        let path = dir.join(FILE_NAME);
        let file = TensorFile::read(&path)?;
        Self::of(&file).map_err(|problem| problem.in_file(&path))
    }

    fn of(file: &TensorFile) -> Result<Self, TensorFileError> {
        let header: PolicyHeader =
            serde_json::from_value(file.header.clone()).map_err(|source| format_error(&source))?;
        header.fits(file)?;
        let mut parameters = TensorFile::default();
        for layer in 0..header.activations.len() + 1 {
            for part in ["weight", "bias"] {
                let name = format!("{PREFIX}.layers.{layer}.{part}");
                parameters.insert(&*name, file.get(&name)?.clone());
            }
        }
        Ok(Self { header, parameters })
    }

    /// Action for one observation, in the units of the channels.
    ///
    /// # Panics
    /// If the length of the observation is not that of `header.inputs`.
    #[must_use]
    pub fn act(&self, observation: &[f64]) -> Vec<f64> {
        let PolicyHeader {
            center,
            spread,
            outputs,
            head,
            action_center,
            action_spread,
            ..
        } = &self.header;
        assert_eq!(observation.len(), center.len(), "entries of an observation");
        #[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
        let scaled = observation
            .iter()
            .zip(center)
            .zip(spread)
            .map(|((x, c), s)| ((x - c) / s) as f32)
            .collect();
        let out = self.outputs(scaled);
        let out: Vec<f64> = out.into_iter().take(outputs.len()).map(f64::from).collect();
        let mut action = head.apply(&out);
        action
            .iter_mut()
            .zip(action_spread)
            .for_each(|(it, spread)| *it *= spread);
        action
            .iter_mut()
            .zip(action_center)
            .for_each(|(it, center)| *it += center);
        action
    }
}

impl Policy {
    /// Outputs of the network for scaled inputs, with the bits of a plan.
    fn outputs(&self, mut x: Vec<f32>) -> Vec<f32> {
        let activations = self.header.activations.iter().map(Some).chain([None]);
        for (layer, activation) in activations.enumerate() {
            // Every policy has the tensors of its layers, which reading checks.
            let part = |part: &str| self.parameters.get(&format!("{PREFIX}.layers.{layer}.{part}"));
            let (Ok(weight), Ok(bias)) = (part("weight"), part("bias")) else {
                break;
            };
            let row = Matrix::new(&x, 1, x.len());
            let mut z = product(row, Matrix::new(&weight.values, x.len(), bias.values.len()));
            z.iter_mut().zip(&bias.values).for_each(|(z, bias)| *z += bias);
            if let Some(activation) = activation {
                activation.apply(&mut z);
            }
            x = z;
        }
        x
    }
}

/// Header of a policy without units of its actions.
fn header(sizes: Vec<usize>, activations: &[Activation], ports: Ports, head: Head) -> PolicyHeader {
    let Ports {
        inputs,
        center,
        spread,
        outputs,
    } = ports;
    PolicyHeader {
        format: FORMAT,
        sizes,
        activations: activations.to_vec(),
        inputs,
        center,
        spread,
        outputs,
        head,
        action_spread: Vec::new(),
        action_center: Vec::new(),
    }
}

impl PolicyHeader {
    /// Checks the header against itself and the tensors, before anything is allocated according to its sizes.
    fn fits(&self, file: &TensorFile) -> Result<(), TensorFileError> {
        let Self { sizes, outputs, .. } = self;
        let of_inputs = [&self.inputs.len(), &self.center.len(), &self.spread.len()];
        let in_units = [&self.action_center, &self.action_spread];
        let consistent = self.format == FORMAT
            && self.activations.len() + 2 == sizes.len()
            && sizes.iter().all(|size| *size > 0)
            && of_inputs.iter().all(|length| Some(*length) == sizes.first())
            && sizes
                .last()
                .is_some_and(|last| (1..=*last).contains(&outputs.len()))
            && in_units
                .iter()
                .all(|it| it.is_empty() || it.len() == outputs.len());
        if !consistent {
            return Err(TensorFileError::Format {
                problem: format!(
                    "policy format {}, layers {sizes:?} of {:?}, {} inputs with {} centers and {} spreads, {} outputs",
                    self.format,
                    self.activations,
                    self.inputs.len(),
                    self.center.len(),
                    self.spread.len(),
                    outputs.len()
                ),
            });
        }
        for (layer, ends) in sizes.windows(2).enumerate() {
            let weight = file.get(&format!("{PREFIX}.layers.{layer}.weight"))?;
            let bias = file.get(&format!("{PREFIX}.layers.{layer}.bias"))?;
            if weight.shape != ends || bias.shape != ends[1..] {
                return Err(TensorFileError::Shape {
                    expected: format!("layer {layer} of {ends:?}"),
                    found: format!("{:?} and {:?}", weight.shape, bias.shape),
                });
            }
        }
        Ok(())
    }
}

impl Head {
    /// Action from the network's outputs.
    #[must_use]
    pub fn apply(self, x: &[f64]) -> Vec<f64> {
        match self {
            Head::DirichletMean => normalised(x.iter().map(|x| softplus(*x) + 1.0).collect()),
            Head::DirichletMode => normalised(x.iter().map(|x| softplus(*x)).collect()),
            Head::SoftmaxMean => softmax(x),
            Head::Tanh => x.iter().map(|x| double::tanh(*x)).collect(),
            Head::Argmax => vec![argmax(x)],
            Head::Identity => x.to_vec(),
        }
    }
}

/// Softplus `ln(1 + e^x)` without overflow.
#[must_use]
pub fn softplus(x: f64) -> f64 {
    x.max(0.0) + double::ln_1p(double::exp(-x.abs()))
}

/// Softmax `e^x_i / sum_j e^x_j`; the largest entry is subtracted so that no exponential overflows.
#[must_use]
pub fn softmax(x: &[f64]) -> Vec<f64> {
    let greatest = x.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    normalised(x.iter().map(|x| double::exp(x - greatest)).collect())
}

fn normalised(x: Vec<f64>) -> Vec<f64> {
    let total: f64 = x.iter().sum();
    x.into_iter().map(|x| x / total).collect()
}

#[allow(clippy::cast_precision_loss, reason = "a number of choices is far below 2^52")]
fn argmax(x: &[f64]) -> f64 {
    let best = x.iter().enumerate().fold(
        (0, f64::NEG_INFINITY),
        |best, (i, x)| if *x > best.1 { (i, *x) } else { best },
    );
    best.0 as f64
}

fn format_error(source: &serde_json::Error) -> TensorFileError {
    TensorFileError::Format {
        problem: source.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

    /// The error of a file without the file's name.
    fn problem(error: TensorFileError) -> TensorFileError {
        match error {
            TensorFileError::Damaged { problem, .. } => *problem,
            unnamed => panic!("{unnamed} names no file"),
        }
    }

    fn policy(head: Head) -> Policy {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let words = |words: &[&str]| words.iter().map(ToString::to_string).collect();
        let (inputs, outputs) = (
            words(&["voltage_1", "power_demand_w"]),
            words(&["share_1", "share_2", "share_3"]),
        );
        let ports = Ports {
            inputs,
            center: vec![3.4, 34.0],
            spread: vec![0.2, 13.0],
            outputs,
        };
        Policy::untrained(&[2, 8, 3], &[Activation::Tanh], ports, head, &mut rng)
    }

    #[test]
    fn a_written_policy_acts_the_same() {
        let dir = tempfile::tempdir().unwrap();
        let policy = policy(Head::DirichletMean);
        policy.write(dir.path()).unwrap();
        let back = Policy::read(dir.path()).unwrap();
        assert_eq!(back.header, policy.header);
        let action = back.act(&[3.5, 30.0]);
        assert_eq!(action, policy.act(&[3.5, 30.0]));
        assert!((action.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_header_that_contradicts_its_tensors_is_refused_before_allocation() {
        let dir = tempfile::tempdir().unwrap();
        let refused = |change: fn(&mut PolicyHeader)| {
            let mut policy = policy(Head::Tanh);
            change(&mut policy.header);
            policy.write(dir.path()).unwrap();
            problem(Policy::read(dir.path()).unwrap_err())
        };
        // Networks of these sizes would exhaust the memory.
        for change in [
            (|it| it.sizes[0] = 1 << 40) as fn(&mut PolicyHeader),
            |it| it.sizes[1] = 1 << 40,
            |it| it.sizes[1] = 9,
        ] {
            let error = refused(change);
            assert!(
                matches!(
                    error,
                    TensorFileError::Shape { .. } | TensorFileError::Format { .. }
                ),
                "{error}"
            );
        }
        for change in [
            (|it| it.sizes.clear()) as fn(&mut PolicyHeader),
            |it| it.sizes[1] = 0,
            |it| it.inputs.push("more".into()),
            |it| it.center.clear(),
            |it| it.spread.clear(),
            |it| it.outputs.clear(),
            |it| it.outputs.push("more".into()),
            |it| it.action_spread.push(1.0),
            |it| it.format = 2,
        ] {
            let error = refused(change);
            assert!(matches!(error, TensorFileError::Format { .. }), "{error}");
        }
    }

    #[test]
    fn heads_by_hand() {
        let ln = |x: f64| x.ln();
        // softplus(ln(e^k - 1)) = k.
        let x = [ln(1f64.exp() - 1.0), ln(3f64.exp() - 1.0)];
        let close = |a: Vec<f64>, b: [f64; 2]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(close(Head::DirichletMean.apply(&x), [2.0 / 6.0, 4.0 / 6.0]));
        assert!(close(Head::DirichletMode.apply(&x), [0.25, 0.75]));
        assert!(close(Head::SoftmaxMean.apply(&[0.0, ln(3.0)]), [0.25, 0.75]));
        assert_eq!(Head::Argmax.apply(&[0.1, 2.0, -1.0]), [1.0]);
        assert!(softmax(&[1e4, 0.0])[0] > 0.999 && softplus(1e4) == 1e4);
    }

    #[test]
    fn actions_in_units_are_scaled_after_the_head() {
        let dir = tempfile::tempdir().unwrap();
        let plain = policy(Head::Identity);
        let scaled = plain
            .clone()
            .in_units(vec![700.0, 0.0, 1.0], vec![50.0, 2.0, 1.0]);
        scaled.write(dir.path()).unwrap();
        let (x, y) = (
            plain.act(&[3.5, 30.0]),
            Policy::read(dir.path()).unwrap().act(&[3.5, 30.0]),
        );
        assert_eq!(y, [700.0 + 50.0 * x[0], 2.0 * x[1], 1.0 + x[2]]);
    }

    #[test]
    fn another_format_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let mut policy = policy(Head::SoftmaxMean);
        policy.header.format = 2;
        policy.write(dir.path()).unwrap();
        let error = problem(Policy::read(dir.path()).unwrap_err());
        assert!(matches!(error, TensorFileError::Format { .. }), "{error}");
    }

    #[test]
    fn a_flipped_bit_is_refused_or_harmless_and_a_truncated_file_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(FILE_NAME);
        policy(Head::Tanh).write(dir.path()).unwrap();
        let whole = std::fs::read(&path).unwrap();
        let read = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            Policy::read(dir.path())
        };
        for place in 0..whole.len() {
            for bit in 0..8 {
                let mut changed = whole.clone();
                changed[place] ^= 1 << bit;
                match read(&changed) {
                    Ok(policy) => {
                        let n = policy.act(&vec![0.5; policy.header.inputs.len()]).len();
                        assert_eq!(n, policy.header.outputs.len(), "bit {bit} of byte {place}");
                    }
                    Err(error) => assert!(error.to_string().contains(FILE_NAME), "{error}"),
                }
            }
            let error = read(&whole[..place]).unwrap_err().to_string();
            assert!(error.contains(FILE_NAME), "cut at {place}: {error}");
        }
    }
}
