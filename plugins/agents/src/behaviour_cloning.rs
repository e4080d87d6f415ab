//! Behaviour cloning: a deterministic policy that imitates the actions of a dataset, without regard to their
//! rewards.
//!
//! Pomerleau 1991, "Efficient training of artificial neural networks for autonomous navigation", Neural
//! Computation 3(1), for the method; Fujimoto and Gu 2021, arXiv:2106.06860, for the networks, the rates and
//! the scaling of observations, so that `td3_bc` differs from it by its critics alone.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | s | observations (scaled by the dataset) | `[batch, observed]` |
//! | a | actions of the dataset | `[batch, n]` |
//! | z | outputs of the network | `[batch, n]` |
//! | pi(s) | `tanh(z)` in a box with limits -1 and 1, `softmax(z)` on a simplex | `[batch, n]` |
//!
//! Loss
//! - In a box: the mean of `(pi(s) - a)^2` over batch and entries.
//! - On a simplex: the cross entropy `-sum_i a_i ln pi_i(s)`, mean over the batch. Both losses are smallest
//!   where the policy is the mean of the shares that were seen at `s`, but the gradient on the logits is `pi
//!   - a` here, which does not vanish where the softmax saturates, while that of the squared error does.
//!
//! Departures: Adam on a network of rectifiers instead of gradient descent on one hidden layer, and no output
//! units that stand for steering angles. The agent acts alike in training and evaluation; no training asks it
//! to act.
//!
//! Metrics, means over the updates since the last measurement: `clone_loss` the loss above, `clone_error` the
//! mean over batch and entries of `|pi(s) - a|`.

use crate::shared::{
    batch::{BatchInputs, plan_of},
    checkpoint::finite,
    dataset_actor::{ActionSet, ActorSettings, DatasetActor, ScalingSource},
};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::equations::network::Network;
use plan::{Descent, Expression, Plans, Processor};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

const NAME: &str = "behaviour_cloning";

/// Hyper-parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Step size of Adam.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub learning_rate: f64,
    /// Units of each hidden layer.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub width: usize,
    /// Number of hidden layers.
    #[schemars(range(min = 1, max = 8), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub layers: usize,
    /// Largest Euclidean norm of a gradient, or null for no limit.
    #[schemars(range(min = 0.0))]
    pub gradient_clip: Option<f64>,
    /// Source of the moments by which observations are scaled.
    #[schemars(extend("x-source" = "Fujimoto and Gu 2021, section 5"))]
    pub scale_by: ScalingSource,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            learning_rate: 3e-4,
            width: 256,
            layers: 2,
            gradient_clip: None,
            scale_by: ScalingSource::Dataset,
        }
    }
}

impl contract::Config for Config {}

/// Policy trained by imitation alone.
#[derive(Debug, Clone)]
pub struct BehaviourCloning {
    config: Config,
    actor: DatasetActor,
    learning: Plans,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "regression of the actions of a dataset, whatever they earned";
    let traits = AgentTraits::learner([Feed::Dataset], metrics());
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the agent for one seat that observes a box and acts on a simplex or within -1 and 1.
///
/// # Errors
/// [`Error::Mismatch`] for any other seat.
fn build(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(BehaviourCloning::new(config, interface, rng)?))
}

/// Metrics that [`BehaviourCloning::learn`] records.
#[must_use]
fn metrics() -> Vec<Metric> {
    vec![
        Metric::new("clone_loss", "", "what the cloning minimises").lower_is_better(),
        Metric::new(
            "clone_error",
            "",
            "mean absolute deviation from the actions of the dataset",
        )
        .lower_is_better(),
    ]
}

impl BehaviourCloning {
    fn new(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        let form = ActorSettings {
            width: config.width,
            layers: config.layers,
            scale_by: config.scale_by,
        };
        Ok(Self {
            actor: DatasetActor::new(NAME, &form, interface, rng)?,
            learning: Plans::default(),
            config,
        })
    }

    /// The plan for a batch of so many rows, and the actor that it trains.
    fn written(&mut self, n_rows: usize) -> (&mut Processor<f32>, &mut DatasetActor) {
        let (actor, config) = (&mut self.actor, &self.config);
        let (set, policy, widths) = (actor.actions, &actor.policy, actor.widths());
        let plan = plan_of(&mut self.learning, n_rows, widths, |batch| {
            update(set, policy, batch, config);
        });
        (plan, actor)
    }
}

/// One update of the policy.
fn update(set: ActionSet, policy: &Network, batch: BatchInputs<'_>, config: &Config) {
    let equations = batch.observations.equations();
    equations.routine("update");
    let outputs = policy.apply(batch.observations);
    let deviation = (set.act(outputs) - batch.actions).abs();
    equations.output("clone_error", deviation.mean());
    let loss = loss(set, outputs, batch.actions);
    equations.output("clone_loss", loss);
    let adam = Descent::adam("learning_rate", config.learning_rate, config.gradient_clip);
    equations.descend(loss, &policy.parameters(equations), &adam);
}

/// Loss `[1, 1]` of the network outputs `z` `[batch, n]` for actions `[batch, n]`.
fn loss<'e>(set: ActionSet, outputs: Expression<'e>, actions: Expression<'e>) -> Expression<'e> {
    match set {
        ActionSet::Cube => (set.act(outputs) - actions).square().mean(),
        ActionSet::Simplex => -(actions * outputs.log_softmax()).sum_columns().mean(),
    }
}

impl Agent for BehaviourCloning {
    fn act(&mut self, observations: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        self.actor.act(observations)
    }

    fn observe_dataset(&mut self, transitions: &[Transition]) -> Result<(), Error> {
        self.actor.observe_dataset(transitions);
        Ok(())
    }

    fn learn(&mut self, transitions: &[Transition], _: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let batch = self.actor.batch(transitions);
        let (plan, actor) = self.written(batch.n_rows);
        batch.write(plan);
        plan.run("update", &mut actor.state);
        let loss = finite("clone_loss", actor.n_updates, plan.number("clone_loss"))?;
        record.mean("clone_loss", loss);
        record.mean("clone_error", plan.number("clone_error"));
        actor.n_updates += 1;
        Ok(())
    }

    fn plan(&mut self, n_rows: usize) -> Option<String> {
        Some(self.written(n_rows).0.graph().to_string())
    }

    fn updates(&self) -> Option<Updates> {
        Some(self.actor.updates())
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        self.actor.save(dir)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        self.actor.load(dir)
    }

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        self.actor.export(dir)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        self.actor.import(dir)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::{
        bandit,
        dataset_actor::tests::{cube, decisions, fit},
        gradient_checks::computed,
    };
    use contract::random::stream;
    use plan::{Equations, State, differences::largest_error};
    use rand::Rng as _;

    fn tiny() -> Config {
        Config {
            width: 16,
            learning_rate: 3e-3,
            ..Config::default()
        }
    }

    fn agent(interface: &Interface) -> Box<dyn Agent> {
        build(tiny(), interface, &mut stream(&["cloning"])).unwrap()
    }

    #[test]
    fn the_losses_by_hand() {
        let of = |set, actions: [f64; 2]| {
            computed(|equations| {
                let row = |entries: &[f64]| equations.constant([1, 2], entries);
                loss(set, row(&[0.0, 3f64.ln()]), row(&actions))
            })[0]
        };
        // softmax(0, ln 3) = (1/4, 3/4); -(0.5 ln 0.25 + 0.5 ln 0.75).
        let cross_entropy = of(ActionSet::Simplex, [0.5, 0.5]);
        assert!(
            (cross_entropy + 0.5 * (0.25f32.ln() + 0.75f32.ln())).abs() < 1e-6,
            "{cross_entropy}"
        );
        // tanh(0) = 0 and tanh(ln 3) = 0.8: (0.1^2 + 0.3^2) / 2.
        let squared = of(ActionSet::Cube, [0.1, 0.5]);
        assert!((squared - 0.05).abs() < 1e-6, "{squared}");
    }

    /// Writes the loss of a parameter `z` as the outputs of a network, and returns both.
    fn loss_of_z(set: ActionSet, actions: [f32; 3], equations: &Equations) -> [Expression<'_>; 2] {
        let outputs = equations.parameter("z", [1, 3]);
        equations.routine("loss");
        let loss = loss(set, outputs, equations.constant([1, 3], &actions.map(f64::from)));
        equations.output("loss", loss);
        [outputs, loss]
    }

    #[test]
    fn the_gradients_on_the_outputs_are_those_of_the_formulas() {
        let a = [0.2f32, 0.5, 0.3];
        let mut state = State::default();
        state.insert("z", [1, 3], vec![0.3, -1.2, 0.7]);
        for set in [ActionSet::Simplex, ActionSet::Cube] {
            let equations = Equations::new();
            let [outputs, loss] = loss_of_z(set, a, &equations);
            equations.output("acted", set.act(outputs));
            equations.output("gradient", equations.gradients(loss, &[outputs])[0]);
            let mut plan = Processor::<f32>::new(equations.into_graph());
            plan.run("loss", &mut state.clone());
            let (found, acted) = (plan.entries("gradient"), plan.entries("acted"));
            for i in 0..3 {
                let expected = match set {
                    ActionSet::Simplex => acted[i] - a[i],
                    ActionSet::Cube => 2.0 / 3.0 * (acted[i] - a[i]) * (1.0 - acted[i] * acted[i]),
                };
                let off = (found[i] - expected).abs();
                assert!(off < 1e-6, "{set:?} {i}: {} {expected}", found[i]);
            }
            let equations = Equations::new();
            loss_of_z(set, a, &equations);
            let (graph, wide) = (equations.into_graph(), state.widened());
            let error = largest_error(graph, ["loss", "loss"], &["z"], &wide, &[], 0);
            assert!(error < 1e-6, "{set:?}: {error:e}");
        }
    }

    /// The best shares plus noise of mean zero.
    fn noisy(x: f64, rng: &mut Rng) -> Vec<f64> {
        let noise = rng.random_range(-0.1..0.1);
        bandit::best(x)
            .iter()
            .zip([noise, -noise, 0.0])
            .map(|(share, noise)| share + noise)
            .collect()
    }

    #[test]
    fn it_imitates_actions_and_not_the_best_rewards() {
        let mut rng = stream(&["clone"]);
        // The rewards favour the opposite of the actions in the dataset.
        let data = decisions(500, &mut rng, noisy, |x, action| {
            (action[0] - bandit::best(x)[0]).abs()
        });
        let mut agent = agent(&bandit::interface());
        let before = bandit::error(agent.as_mut(), &mut rng);
        fit(agent.as_mut(), &data, 600, &mut rng);
        let after = bandit::error(agent.as_mut(), &mut rng);
        assert!(before > 0.25 && after < 0.05, "{before} {after}");
    }

    #[test]
    fn it_imitates_actions_in_a_box() {
        let mut rng = stream(&["clone in a box"]);
        let act = |x: f64, rng: &mut Rng| vec![0.8 * x + rng.random_range(-0.1..0.1)];
        let data = decisions(500, &mut rng, act, |_, _| 0.0);
        let mut agent = agent(&cube());
        fit(agent.as_mut(), &data, 600, &mut rng);
        let seen: Vec<_> = [-0.8, 0.0, 0.8]
            .iter()
            .map(|x| Observation {
                seats: vec![vec![*x]],
                state: vec![],
            })
            .collect();
        let actions = agent.act(&seen, Mode::Evaluate, &mut rng).unwrap();
        assert!(
            actions
                .iter()
                .zip([-0.64, 0.0, 0.64])
                .all(|(a, best)| (a[0][0] - best).abs() < 0.1),
            "{actions:?}"
        );
    }

    #[test]
    fn a_saved_agent_continues() {
        bandit::assert_continues(|rng| build(tiny(), &bandit::interface(), rng).unwrap());
    }

    #[test]
    fn the_scaling_by_a_dataset_goes_with_the_agent_and_with_the_policy() {
        crate::shared::dataset_actor::tests::assert_scaling_is_kept(|rng| {
            build(tiny(), &bandit::interface(), rng).unwrap()
        });
    }

    #[test]
    fn recorded_metrics_are_declared_and_the_exported_policy_acts() {
        bandit::assert_declared(agent(&bandit::interface()).as_mut(), &metrics());
        bandit::assert_exports(agent(&bandit::interface()).as_mut());
        bandit::assert_imports(|interface, rng| build(tiny(), interface, rng).unwrap());
    }

    #[test]
    fn members_of_a_population_learn_as_trials_alone() {
        crate::shared::population::assert_members_learn_as_alone(
            |rng| BehaviourCloning::new(tiny(), &bandit::interface(), rng).unwrap(),
            |agent| std::slice::from_mut(&mut agent.learning),
            |agent, rng| drop(bandit::train(agent, 5, rng)),
        );
    }
}
