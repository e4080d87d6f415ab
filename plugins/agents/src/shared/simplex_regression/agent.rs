//! A network that maps observations to a distribution on the simplex, with any [head](SimplexHead).
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | outputs of the network | `head` | `[batch, OUTPUTS_PER_SHARE * n_shares]` |
//! | targets, draws, centres | `targets`, results of a head's functions | `[batch, n_shares]` |
//! | loss | result of a head's `loss` | `[1, 1]` |

use super::{Progress, RegressionLoss};
use crate::shared::{
    acting, allocation,
    checkpoint::{self, finite},
    scaling::{ObservationScaling, Scaling},
    seat,
};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::{
    activation::Activation,
    equations::{network::Network, state_file},
    policy_file::{Head, Policy, Ports},
    tensor_file::TensorFile,
};
use plan::{Descent, Equations, Expression, Plans, Processor, State};
use rand::RngCore;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{fmt::Debug, marker::PhantomData, path::Path};

/// Distribution on the simplex that is parameterised by the outputs of a network, its `head`.
pub trait SimplexHead: Debug + Send + 'static {
    /// Name under which the agent is registered.
    const NAME: &'static str;
    /// Activations of the three hidden layers.
    const LAYERS: [Activation; 3];
    /// Number of outputs of the network per share.
    const OUTPUTS_PER_SHARE: usize;
    /// Head by which an exported policy computes its shares.
    const EXPORTED: Head;

    /// One draw per row, with shares that sum to 1.
    fn sample(head: Expression<'_>) -> Expression<'_>;

    /// Representative point of the distribution in each row, up to a positive factor.
    fn centre(head: Expression<'_>) -> Expression<'_>;

    /// Loss `[1, 1]` of outputs and targets with one row per example.
    fn loss<'e>(loss: RegressionLoss, head: Expression<'e>, targets: Expression<'e>) -> Expression<'e>;
}

/// Hyper-parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Step size of Adam.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, section 3.4.3: 0.01 and 0.1"))]
    pub learning_rate: f64,
    /// Minimised loss.
    pub loss: RegressionLoss,
    /// Units of each of the three hidden layers.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "thesis, section 3.4.3"))]
    pub width: usize,
    /// Scaling of observations for the networks.
    pub observation_scaling: ObservationScaling,
}

impl Default for Config {
    fn default() -> Self {
        let loss = RegressionLoss::ExpectedError;
        Self {
            learning_rate: 0.01,
            loss,
            width: 64,
            observation_scaling: ObservationScaling::None,
        }
    }
}

impl contract::Config for Config {}

/// Agent that predicts shares with the head `H`.
#[derive(Debug)]
pub struct SimplexRegression<H> {
    scaling: Scaling,
    shares: Vec<String>,
    learner: Learner<H>,
    state: State<f32>,
    acting: Plans,
    learning: Plans,
    progress: Progress,
}

/// The network, and the equations by which it acts and learns.
#[derive(Debug)]
struct Learner<H> {
    network: Network,
    loss: RegressionLoss,
    learning_rate: f64,
    head: PhantomData<H>,
}

/// Registers the agent with a head.
pub fn register<H: SimplexHead>(registry: &mut Registry, version: u32, about: &'static str) {
    let traits = AgentTraits::learner([Feed::Examples], metrics());
    registry.agent(H::NAME, version, about, traits, build::<H>);
}

/// Builds the agent for one seat that acts on a simplex, in an environment whose state is the target.
///
/// # Errors
/// [`Error::Mismatch`] for any other environment.
fn build<H: SimplexHead>(
    config: Config,
    interface: &Interface,
    rng: &mut Rng,
) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(SimplexRegression::<H>::new(&config, interface, rng)?))
}

/// Metrics that [`SimplexRegression::learn`] records.
fn metrics() -> Vec<Metric> {
    vec![Metric::new("loss", "", "what the regression minimises").lower_is_better()]
}

impl<H: SimplexHead> SimplexRegression<H> {
    fn new(config: &Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        let seat = seat::only_seat(H::NAME, interface)?;
        let shares = seat::simplex(H::NAME, seat)?.to_vec();
        seat::state_of_length(H::NAME, interface, shares.len())?;
        let scaling = Scaling::new(config.observation_scaling, seat::observed(H::NAME, seat)?);
        let sizes = [
            scaling.n_channels(),
            config.width,
            config.width,
            config.width,
            H::OUTPUTS_PER_SHARE * shares.len(),
        ];
        let learner = Learner {
            network: Network::new("network", &sizes, &H::LAYERS),
            loss: config.loss,
            learning_rate: config.learning_rate,
            head: PhantomData,
        };
        let mut state = State::default();
        learner.network.initialise(1.0, &mut state, rng);
        Ok(Self {
            scaling,
            shares,
            learner,
            state,
            acting: Plans::default(),
            learning: Plans::default(),
            progress: Progress::default(),
        })
    }

    /// The plan for so many examples, and the state that it trains.
    fn written(&mut self, n_rows: usize) -> (&mut Processor<f32>, &mut State<f32>) {
        let learner = &self.learner;
        let (n_seen, n_shares) = (self.scaling.n_channels(), self.shares.len());
        let plan = self.learning.of_rows(n_rows, |equations| {
            let observations = equations.input("observations", [n_rows, n_seen]);
            learner.update(observations, equations.input("targets", [n_rows, n_shares]));
        });
        (plan, &mut self.state)
    }

    fn ports(&self) -> Ports {
        self.scaling.ports(&self.shares)
    }
}

impl<H: SimplexHead> Learner<H> {
    /// Weights of the shares, drawn and central ones.
    fn act(&self, observations: Expression<'_>) {
        let equations = observations.equations();
        equations.routine("draw");
        equations.output("drawn", H::sample(self.network.apply(observations)));
        equations.routine("choose");
        equations.output("chosen", H::centre(self.network.apply(observations)));
    }

    /// One step against the loss of examples.
    fn update(&self, observations: Expression<'_>, targets: Expression<'_>) {
        let equations: &Equations = observations.equations();
        equations.routine("update");
        let loss = H::loss(self.loss, self.network.apply(observations), targets);
        equations.output("loss", loss);
        let descent = Descent::adam("learning_rate", self.learning_rate, None);
        equations.descend(loss, &self.network.parameters(equations), &descent);
    }
}

impl<H: SimplexHead> Agent for SimplexRegression<H> {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let (learner, shape) = (&self.learner, [observations.len(), self.scaling.n_channels()]);
        let plan = self.acting.of_rows(observations.len(), |equations| {
            learner.act(equations.input("observations", shape));
        });
        plan.write("observations", &self.scaling.rows(observations));
        let weights = acting::actions(plan, mode, &mut self.state, rng);
        allocation::actions(weights, self.shares.len(), self.progress.n_examples)
    }

    #[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        self.progress.n_examples += transitions.len() as u64;
        let seen = || transitions.iter().map(|transition| &transition.observation);
        let scaled = seen().flat_map(|seen| self.scaling.apply(&seen.seats[0]));
        let observations: Vec<f32> = scaled.collect();
        let targets: Vec<f32> = seen().flat_map(|seen| &seen.state).map(|x| *x as f32).collect();
        let (plan, state) = self.written(transitions.len());
        plan.write("observations", &observations);
        plan.write("targets", &targets);
        plan.run_seeded("update", state, rng.next_u64());
        let loss = plan.number("loss");
        let loss = finite("loss", self.progress.n_examples, loss)?;
        record.mean("loss", loss);
        self.progress.n_updates += 1;
        Ok(())
    }

    fn plan(&mut self, n_rows: usize) -> Option<String> {
        Some(self.written(n_rows).0.graph().to_string())
    }

    fn reads_state(&self) -> bool {
        true
    }

    fn updates(&self) -> Option<Updates> {
        Some(self.progress.updates())
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        let mut file = TensorFile::default();
        state_file::store(&self.state, &mut file);
        checkpoint::write(H::NAME, dir, file, &self.progress)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        let (file, progress) = checkpoint::read(H::NAME, dir)?;
        state_file::restore(&mut self.state, &file).map_err(checkpoint::error_of(H::NAME))?;
        self.progress = progress;
        Ok(())
    }

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        let policy = Policy::new(&self.learner.network, &self.state, self.ports(), H::EXPORTED);
        policy.write(dir).map_err(checkpoint::error_of(H::NAME))?;
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        let (ports, network, state) = (self.ports(), &self.learner.network, &mut self.state);
        checkpoint::import_policy(H::NAME, network, state, dir, &ports, H::EXPORTED)?;
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        dirichlet_regression::Dirichlet, gaussian_softmax_regression::GaussianSoftmax, shared::bandit,
    };
    use contract::random::stream;

    fn config(loss: RegressionLoss) -> Config {
        Config {
            loss,
            width: 16,
            ..Config::default()
        }
    }

    fn agent<H: SimplexHead>(loss: RegressionLoss) -> SimplexRegression<H> {
        let mut rng = stream(&["regression"]);
        SimplexRegression::new(&config(loss), &bandit::interface(), &mut rng).unwrap()
    }

    fn finds_the_target<H: SimplexHead>() {
        for loss in [RegressionLoss::ExpectedError, RegressionLoss::LogLikelihood] {
            let (mut agent, mut rng) = (agent::<H>(loss), stream(&["find"]));
            let before = bandit::error(&mut agent, &mut rng);
            bandit::train(&mut agent, 400, &mut rng);
            let after = bandit::error(&mut agent, &mut rng);
            assert!(before > 0.2 && after < 0.06, "{loss:?} {before} {after}");
        }
    }

    fn is_kept<H: SimplexHead>() {
        bandit::assert_continues(|rng| build::<H>(Config::default(), &bandit::interface(), rng).unwrap());
        bandit::assert_declared(&mut agent::<H>(RegressionLoss::ExpectedError), &metrics());
        bandit::assert_exports(&mut agent::<H>(RegressionLoss::ExpectedError));
        let made = |interface: &Interface, rng: &mut Rng| {
            build::<H>(config(RegressionLoss::ExpectedError), interface, rng)
        };
        bandit::assert_imports(|interface, rng| made(interface, rng).unwrap());
    }

    fn refuses_a_state_that_is_no_target<H: SimplexHead>() {
        let interface = crate::shared::seat::tests::allocation(&["x"], &["best_1"], 3);
        let built = build::<H>(Config::default(), &interface, &mut stream(&["x"]));
        assert!(matches!(built, Err(Error::Mismatch { .. })));
    }

    #[test]
    fn both_losses_find_the_target_with_either_head() {
        finds_the_target::<Dirichlet>();
        finds_the_target::<GaussianSoftmax>();
    }

    #[test]
    fn a_saved_agent_continues_and_an_exported_policy_acts() {
        is_kept::<Dirichlet>();
        is_kept::<GaussianSoftmax>();
    }

    #[test]
    fn a_state_that_is_no_target_is_refused() {
        refuses_a_state_that_is_no_target::<Dirichlet>();
        refuses_a_state_that_is_no_target::<GaussianSoftmax>();
    }

    #[test]
    fn members_of_a_population_learn_as_trials_alone() {
        crate::shared::population::assert_members_learn_as_alone(
            |rng| {
                SimplexRegression::<Dirichlet>::new(
                    &config(RegressionLoss::LogLikelihood),
                    &bandit::interface(),
                    rng,
                )
                .unwrap()
            },
            |agent| std::slice::from_mut(&mut agent.learning),
            |agent, rng| drop(bandit::train(agent, 5, rng)),
        );
    }
}
