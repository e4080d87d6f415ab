//! TD3 with behaviour cloning: an actor-critic for datasets that stays close to their actions.
//!
//! Fujimoto and Gu 2021, "A minimalist approach to offline reinforcement learning", arXiv:2106.06860
//! (equations are its), on Fujimoto et al. 2018, "Addressing function approximation error in actor-critic
//! methods", arXiv:1802.09477 (TD3).
//!
//! | paper | here | shape |
//! |---|---|---|
//! | s, s' | observations less their mean over the dataset, divided by their deviation (eq. 6) | `[batch, observed]` |
//! | a | actions of the dataset | `[batch, n]` |
//! | pi(s) | `tanh(z)` in a box with limits -1 and 1, `softmax(z)` on a simplex | `[batch, n]` |
//! | Q_1, Q_2 | `critics` of scaled observation and centred action | `[batch, 1]` each |
//! | pi', Q' | `target_policy`, `target_critics` | as above |
//! | epsilon | `clip(N(0, sigma), -c, c)`, sigma 0.2, c 0.5 | `[batch, n]` |
//! | alpha, lambda | `alpha` 2.5; `lambda = alpha / mean abs Q_1(s, pi(s))` over the batch, without gradient | scalars |
//! | gamma, tau, d | `discount`, `target_smoothing`, `policy_delay` | scalars |
//!
//! With `c(a)` the centred action, `a` in a box and `n a - 1` on a simplex:
//! - the target of both critics is `y = r + gamma (1 - terminal) min(Q'_1, Q'_2)(s', a')` with the smoothed
//!   `a' = pi'(s') + epsilon`;
//! - every `policy_delay` updates of the critics the policy descends `-lambda mean(Q_1(s, pi(s))) +
//!   mean((c(pi(s)) - c(a))^2)` (eq. 5) and all targets follow by `tau`.
//!
//! Departures from the paper
//! - Simplex. The paper acts in boxes. Here shares are the softmax of the outputs, and the noise of the
//!   target is added to the outputs before it, so that the smoothed action stays on the simplex. Critics and the
//!   cloning term see `n a - 1`: squares of plain shares are so small that `alpha` would have another meaning
//!   than in a box.
//! - A deviation is enlarged by a thousandth of the typical one of its channel; the paper adds 0.001 to
//!   states without units.
//! - Half the squared error is descended by the critics: the same steps under Adam.
//! - The agent acts alike in training and evaluation; no training asks it to act.
//!
//! Metrics, means over the updates since the last measurement: `critic_loss` half the squared error summed
//! over both critics, `policy_loss` eq. 5, `clone_error` the mean over batch and entries of `|pi(s) - a|`,
//! `mean_value` the mean of `Q_1(s, pi(s))`.

use crate::shared::{
    checkpoint::{self, finite},
    dataset_actor::{ActionSet, ActorSettings, DatasetActor, ScalingSource},
    replay::Batch,
    targets::{bootstrapped, half_squared_error, mean},
};
use burn::{module::Module, tensor::Tensor};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::{
    gaussian::standard_normal,
    network::{Mlp, TwinMlp, matrix, values},
    optimizer::{Adam, TrainedNetwork},
    parameters::{restore, soft_update, store},
    tensor_file::TensorFile,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

const NAME: &str = "td3_bc";

/// Hyper-parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Weight alpha of the critics against the cloning; 0 for cloning alone.
    #[schemars(range(min = 0.0, max = 1e6), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub alpha: f64,
    /// Step size of Adam for the policy.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub actor_learning_rate: f64,
    /// Step size of Adam for both critics.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub critic_learning_rate: f64,
    /// Discount gamma.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub discount: f64,
    /// Smoothing tau of the targets.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub target_smoothing: f64,
    /// Updates of the critics per update of the policy.
    #[schemars(range(min = 1, max = 1000), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub policy_delay: u64,
    /// Standard deviation of the noise on the target policy.
    #[schemars(range(min = 0.0, max = 10.0), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub target_noise: f64,
    /// Largest absolute value of that noise.
    #[schemars(range(min = 0.0, max = 10.0), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub target_noise_limit: f64,
    /// Units of each hidden layer of policy and critics.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub width: usize,
    /// Number of hidden layers of policy and critics.
    #[schemars(range(min = 1, max = 8), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub layers: usize,
    /// Largest Euclidean norm of a gradient, or null for no limit.
    #[schemars(range(min = 0.0))]
    pub gradient_clip: Option<f64>,
    /// Source of the moments by which observations are scaled.
    #[schemars(extend("x-source" = "Fujimoto and Gu 2021, eq. 6"))]
    pub scale_by: ScalingSource,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            alpha: 2.5,
            actor_learning_rate: 3e-4,
            critic_learning_rate: 3e-4,
            discount: 0.99,
            target_smoothing: 0.005,
            policy_delay: 2,
            target_noise: 0.2,
            target_noise_limit: 0.5,
            width: 256,
            layers: 2,
            gradient_clip: None,
            scale_by: ScalingSource::Dataset,
        }
    }
}

impl contract::Config for Config {}

/// TD3 with behaviour cloning for one seat.
#[derive(Debug, Clone)]
pub struct Td3Bc {
    config: Config,
    actor: DatasetActor,
    critics: TrainedNetwork<TwinMlp>,
    target_policy: Mlp,
    target_critics: TwinMlp,
    /// Number of updates of the critics.
    n_updates: u64,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "actor-critic for datasets that stays close to the actions that they show (TD3+BC)";
    let traits = AgentTraits::learner([Feed::Dataset], metrics());
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the agent for one seat that observes a box and acts on a simplex or within -1 and 1.
///
/// # Errors
/// [`Error::Mismatch`] for any other seat.
fn build(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(Td3Bc::new(config, interface, rng)?))
}

/// Metrics that [`Td3Bc::learn`] records.
#[must_use]
fn metrics() -> Vec<Metric> {
    vec![
        Metric::new("critic_loss", "", "half the squared error of both critics").lower_is_better(),
        Metric::new(
            "policy_loss",
            "",
            "minus the weighted value of the policy's actions plus the cloning, eq. 5",
        )
        .lower_is_better(),
        Metric::new(
            "clone_error",
            "",
            "mean absolute deviation from the actions of the dataset",
        )
        .lower_is_better(),
        Metric::new(
            "mean_value",
            "",
            "mean of the first critic at the policy's actions",
        ),
    ]
}

impl Td3Bc {
    fn new(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        let Config {
            width,
            layers,
            gradient_clip,
            scale_by,
            ..
        } = config;
        let form = ActorSettings {
            width,
            layers,
            learning_rate: config.actor_learning_rate,
            gradient_clip,
            scale_by,
        };
        let actor = DatasetActor::new(NAME, &form, interface, rng)?;
        let mut critic = || form.network(actor.n_observed() + actor.n_acted(), 1, rng);
        let critics = TwinMlp {
            first: critic(),
            second: critic(),
        };
        Ok(Self {
            target_policy: actor.network.network().valid(),
            target_critics: critics.valid(),
            critics: TrainedNetwork::new(critics, Adam::new(config.critic_learning_rate, gradient_clip)),
            config,
            actor,
            n_updates: 0,
        })
    }

    /// TD3, algorithm 1: both critics descend the squared error to the lower target.
    fn update_critics(&mut self, batch: &Batch, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let target = self.target(batch, rng);
        let (q1, q2) = self
            .critics
            .network()
            .forward(self.judged(&batch.observations, batch.actions.clone()));
        let loss = half_squared_error(q1, target.clone()) + half_squared_error(q2, target);
        record.mean(
            "critic_loss",
            finite("critic_loss", self.n_updates, values(loss.clone())[0])?,
        );
        self.critics.descend(&loss);
        Ok(())
    }

    /// `y = r + gamma (1 - terminal) min(Q'_1, Q'_2)(s', a')`.
    fn target(&self, batch: &Batch, rng: &mut Rng) -> Tensor<2> {
        let next = self.smoothed(&batch.next_observations, rng);
        let (q1, q2) = self
            .target_critics
            .forward(self.judged(&batch.next_observations, next));
        bootstrapped(
            batch.rewards.clone(),
            batch.continues.clone(),
            q1.min_pair(q2),
            self.config.discount,
        )
    }

    /// Noisy actions of the target policy: in a box the noise is added to the action, on a simplex before the
    /// softmax.
    fn smoothed(&self, observations: &Tensor<2>, rng: &mut Rng) -> Tensor<2> {
        let outputs = self.target_policy.forward(observations.clone());
        let [rows, columns] = outputs.dims();
        let Config {
            target_noise,
            target_noise_limit,
            ..
        } = self.config;
        let noise = clipped_noise(rows, columns, target_noise, target_noise_limit, rng);
        match self.actor.actions {
            ActionSet::Cube => (self.actor.actions.act(outputs) + noise).clamp(-1.0, 1.0),
            ActionSet::Simplex => self.actor.actions.act(outputs + noise),
        }
    }

    /// Eq. 5 and 6: the policy ascends the first critic and stays close to the dataset.
    fn update_policy(&mut self, batch: &Batch, record: &mut Recorder) -> Result<(), Error> {
        let policy = self.actor.network.network();
        let (acted, q) = self.acted_and_valued(policy, batch);
        let lambda = self.lambda(&q);
        let loss = self.policy_loss(policy, batch, lambda);
        record.mean(
            "policy_loss",
            finite("policy_loss", self.n_updates, values(loss.clone())[0])?,
        );
        record.mean("mean_value", f64::from(mean(q)));
        record.mean(
            "clone_error",
            f64::from(mean((acted - batch.actions.clone()).abs())),
        );
        self.actor.network.descend(&loss);
        Ok(())
    }

    /// Actions of a policy and their values by the first critic, without gradients.
    fn acted_and_valued(&self, policy: &Mlp, batch: &Batch) -> (Tensor<2>, Tensor<2>) {
        let acted = self
            .actor
            .actions
            .act(policy.valid().forward(batch.observations.clone()));
        let q = self
            .critics
            .network()
            .valid()
            .first
            .forward(self.judged(&batch.observations, acted.clone()));
        (acted, q)
    }

    /// Weight `alpha / mean |Q|`.
    fn lambda(&self, q: &Tensor<2>) -> f64 {
        self.config.alpha / f64::from(mean(q.clone().abs()))
    }

    /// Loss of eq. 5, with a weight without gradient.
    fn policy_loss(&self, policy: &Mlp, batch: &Batch, lambda: f64) -> Tensor<1> {
        let set = self.actor.actions;
        let acted = set.act(policy.forward(batch.observations.clone()));
        let cloning = (set.centred(acted.clone()) - set.centred(batch.actions.clone()))
            .powf_scalar(2.0)
            .mean();
        // An untracked critic: the gradient passes through it to the action alone.
        let q = self
            .critics
            .network()
            .valid()
            .first
            .forward(self.judged(&batch.observations, acted));
        cloning - q.mean() * lambda
    }

    /// Input of the critics: observations and centred actions.
    fn judged(&self, observations: &Tensor<2>, actions: Tensor<2>) -> Tensor<2> {
        Tensor::cat(vec![observations.clone(), self.actor.actions.centred(actions)], 1)
    }

    fn follow(&mut self) {
        let tau = self.config.target_smoothing;
        self.target_critics = soft_update(
            std::mem::take(&mut self.target_critics),
            self.critics.network(),
            tau,
        );
        self.target_policy = soft_update(
            std::mem::take(&mut self.target_policy),
            self.actor.network.network(),
            tau,
        );
    }
}

#[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
fn clipped_noise(rows: usize, columns: usize, sd: f64, limit: f64, rng: &mut Rng) -> Tensor<2> {
    let draw = |_| (sd * standard_normal(rng)).clamp(-limit, limit) as f32;
    matrix((0..rows * columns).map(draw).collect(), columns)
}

impl Agent for Td3Bc {
    fn act(&mut self, observations: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        self.actor.act(observations, self.n_updates)
    }

    fn observe_dataset(&mut self, transitions: &[Transition]) -> Result<(), Error> {
        self.actor.observe_dataset(transitions);
        Ok(())
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        let batch = self.actor.batch(transitions);
        self.update_critics(&batch, rng, record)?;
        self.n_updates += 1;
        if self.n_updates.is_multiple_of(self.config.policy_delay) {
            self.update_policy(&batch, record)?;
            self.follow();
        }
        Ok(())
    }

    fn updates(&self) -> Option<Updates> {
        Some(Updates {
            made: self.n_updates,
            first_after: 1,
        })
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        let mut file = TensorFile::default();
        self.actor.store(&mut file);
        self.critics.store("critics", &mut file);
        store(&self.target_policy, "target_policy", &mut file);
        store(&self.target_critics, "target_critics", &mut file);
        checkpoint::write(NAME, dir, file, &self.n_updates)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        let (file, n_updates) = checkpoint::read(NAME, dir)?;
        let misfit = checkpoint::error_of(NAME);
        self.actor.restore(&file).map_err(&misfit)?;
        self.critics.restore("critics", &file).map_err(&misfit)?;
        self.target_policy = restore(self.target_policy.clone(), "target_policy", &file).map_err(&misfit)?;
        self.target_critics =
            restore(self.target_critics.clone(), "target_critics", &file).map_err(&misfit)?;
        self.n_updates = n_updates;
        Ok(())
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
    };
    use contract::random::stream;
    use numerics::{
        optimizer::gradients,
        parameters::{parameters, with_parameters},
    };
    use rand::Rng as _;

    fn tiny() -> Config {
        Config {
            width: 16,
            actor_learning_rate: 1e-3,
            critic_learning_rate: 3e-3,
            ..Config::default()
        }
    }

    fn agent(config: Config, interface: &Interface) -> Td3Bc {
        Td3Bc::new(config, interface, &mut stream(&["td3_bc"])).unwrap()
    }

    /// Shares drawn uniformly from the simplex.
    fn random_shares(_: f64, rng: &mut Rng) -> Vec<f64> {
        let draws: Vec<f64> = (0..3).map(|_| -rng.random::<f64>().max(1e-300).ln()).collect();
        draws
            .iter()
            .map(|draw| draw / draws.iter().sum::<f64>())
            .collect()
    }

    fn reward(x: f64, action: &[f64]) -> f64 {
        -bandit::best(x)
            .iter()
            .zip(action)
            .map(|(best, share)| (best - share).abs())
            .sum::<f64>()
    }

    fn batch_of(agent: &Td3Bc, n: usize) -> Batch {
        agent
            .actor
            .batch(&decisions(n, &mut stream(&["batch"]), random_shares, reward))
    }

    #[test]
    fn the_target_takes_the_lower_target_critic_of_a_smoothed_action() {
        let mut agent = agent(tiny(), &bandit::interface());
        bandit::train(&mut agent, 6, &mut stream(&["target"]));
        let mut batch = batch_of(&agent, 4);
        batch.continues = matrix(vec![1.0, 1.0, 0.0, 1.0], 1);
        let (mut one, mut two) = (stream(&["noise"]), stream(&["noise"]));
        let next = agent.smoothed(&batch.next_observations, &mut one);
        let (q1, q2) = agent
            .target_critics
            .forward(agent.judged(&batch.next_observations, next.clone()));
        let (q1, q2, r) = (values(q1), values(q2), values(batch.rewards.clone()));
        let y = values(agent.target(&batch, &mut two));
        for i in 0..4 {
            let expected = if i == 2 {
                r[i]
            } else {
                r[i] + 0.99 * q1[i].min(q2[i])
            };
            assert!((y[i] - expected).abs() < 1e-6, "{i}: {} {expected}", y[i]);
        }
        let sums = values(next.clone().sum_dim(1));
        assert!(sums.iter().all(|sum| (sum - 1.0).abs() < 1e-6), "{sums:?}");
        let plain = agent
            .actor
            .actions
            .act(agent.target_policy.forward(batch.next_observations));
        assert_ne!(values(next), values(plain));
    }

    #[test]
    fn noise_is_clipped_and_actions_stay_in_the_box() {
        let drawn = values(clipped_noise(4_000, 2, 0.2, 0.3, &mut stream(&["clip"])));
        assert!(
            drawn.iter().all(|x| x.abs() <= 0.3) && drawn.iter().filter(|x| x.abs() == 0.3).count() > 400
        );
        let wild = Config {
            target_noise: 10.0,
            target_noise_limit: 5.0,
            ..tiny()
        };
        let agent = agent(wild, &cube());
        let smoothed = values(agent.smoothed(&matrix(vec![0.1, 0.2, 0.3], 1), &mut stream(&["box"])));
        assert!(
            smoothed.iter().all(|x| x.abs() <= 1.0) && smoothed.iter().any(|x| x.abs() == 1.0),
            "{smoothed:?}"
        );
    }

    #[test]
    fn the_weight_by_hand_does_not_depend_on_the_scale_of_the_rewards() {
        let agent = agent(tiny(), &bandit::interface());
        // 2.5 / ((1 + 3) / 2).
        assert!((agent.lambda(&matrix(vec![1.0, -3.0], 1)) - 1.25).abs() < 1e-6);
        let weighted = |scale: f32| {
            let q = matrix(vec![1.0 * scale, -3.0 * scale], 1);
            agent.lambda(&q) * f64::from(mean(q))
        };
        assert!((weighted(1.0) - weighted(100.0)).abs() < 1e-6);
    }

    #[test]
    fn the_gradient_of_the_policy_agrees_with_finite_differences() {
        for interface in [bandit::interface(), cube()] {
            let agent = agent(tiny(), &interface);
            let n = agent.actor.n_acted();
            let actions = matrix((0..4 * n).map(|i| 0.1 + 0.05 * i as f32).collect(), n);
            let batch = Batch {
                actions,
                ..batch_of(&self::agent(tiny(), &bandit::interface()), 4)
            };
            let policy = agent.actor.network.network();
            let analytic = gradients(policy, &mut agent.policy_loss(policy, &batch, 1.7).backward());
            let plain = policy.valid();
            let numbers = parameters(&plain);
            let mut largest: f64 = 0.0;
            for (p, parameter) in numbers.iter().enumerate() {
                for i in (0..parameter.values.len()).step_by(5) {
                    let at = |step: f32| {
                        let mut moved = numbers.clone();
                        moved[p].values[i] += step;
                        let moved = with_parameters(plain.clone(), &moved).unwrap();
                        f64::from(values(agent.policy_loss(&moved, &batch, 1.7))[0])
                    };
                    let difference = (at(3e-3) - at(-3e-3)) / 6e-3;
                    let gradient = f64::from(analytic[p][i]);
                    let tolerance = 2e-3 + 2e-2 * gradient.abs();
                    assert!(
                        (difference - gradient).abs() < tolerance,
                        "{} {i}: {difference} {gradient}",
                        parameter.name
                    );
                    largest = largest.max(gradient.abs());
                }
            }
            assert!(largest > 0.02, "{largest}");
        }
    }

    #[test]
    fn the_policy_and_the_targets_wait_for_the_critics() {
        let mut agent = agent(
            Config {
                policy_delay: 3,
                ..tiny()
            },
            &bandit::interface(),
        );
        let data = decisions(8, &mut stream(&["delay"]), random_shares, reward);
        let learn = |agent: &mut Td3Bc| {
            let before = (
                parameters(agent.actor.network.network()),
                parameters(&agent.target_critics),
            );
            agent
                .learn(&data, &mut stream(&["x"]), &mut Recorder::default())
                .unwrap();
            let after = (
                parameters(agent.actor.network.network()),
                parameters(&agent.target_critics),
            );
            [before.0 != after.0, before.1 != after.1]
        };
        let moved: Vec<_> = (0..6).map(|_| learn(&mut agent)).collect();
        assert_eq!(
            moved,
            [
                [false; 2], [false; 2], [true; 2], [false; 2], [false; 2], [true; 2]
            ]
        );
    }

    #[test]
    fn it_does_better_than_the_dataset_and_cloning_does_not() {
        let mut rng = stream(&["better"]);
        let data = decisions(2_000, &mut rng, random_shares, reward);
        let mut error = |config: Config| {
            let mut agent = agent(config, &bandit::interface());
            fit(&mut agent, &data, 1_200, &mut rng);
            bandit::error(&mut agent, &mut rng)
        };
        let (improved, cloned) = (error(tiny()), error(Config { alpha: 0.0, ..tiny() }));
        // Cloning yields the mean of the actions, equal shares; |1/3 - best| adds up to 0.39 on average.
        assert!(cloned > 0.3 && improved < 0.6 * cloned, "{improved} {cloned}");
    }

    #[test]
    fn it_learns_in_a_box() {
        let mut rng = stream(&["box"]);
        let anywhere = |_: f64, rng: &mut Rng| vec![rng.random_range(-1.0..1.0)];
        let data = decisions(2_000, &mut rng, anywhere, |x, action| {
            -(action[0] - 0.8 * x).abs()
        });
        let mut error = |alpha: f64| {
            let mut agent = agent(Config { alpha, ..tiny() }, &cube());
            fit(&mut agent, &data, 1_200, &mut rng);
            let seen: Vec<_> = [-0.9, 0.9]
                .iter()
                .map(|x| Observation {
                    seats: vec![vec![*x]],
                    state: vec![],
                })
                .collect();
            let actions = agent.act(&seen, Mode::Evaluate, &mut rng).unwrap();
            ((actions[0][0][0] + 0.72).abs() + (actions[1][0][0] - 0.72).abs()) / 2.0
        };
        let (improved, cloned) = (error(2.5), error(0.0));
        assert!(cloned > 0.5 && improved < 0.6 * cloned, "{improved} {cloned}");
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
        bandit::assert_declared(&mut agent(tiny(), &bandit::interface()), &metrics());
        bandit::assert_exports(&mut agent(tiny(), &bandit::interface()));
        bandit::assert_imports(|interface, rng| build(tiny(), interface, rng).unwrap());
    }
}
