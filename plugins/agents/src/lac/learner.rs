//! Equations of the Lyapunov actor-critics; symbols and equation numbers are those of [`super`].
//!
//! | thesis | here | shape |
//! |---|---|---|
//! | c, s, a, s', s_near | the parts of [`MemoryInputs`] | `[batch, ..]` |
//! | L, L target | `lyapunov`, `target_lyapunov` | `[batch, 1]` |
//! | D | `violation` | `[1, 1]` |
//! | lambda, beta | `multiplier`, `temperature` | `[1, 1]` |

use super::config::Config;
use super::memory::MemoryInputs;
use super::networks::{self, Limits, value};
use crate::shared::{
    batch::BatchInputs,
    bellman::{Weight, bootstrapped, half_squared_error},
};
use contract::Rng;
use numerics::equations::{
    network::Network,
    squashed::{Correction, mean_action, sample},
};
use plan::{Descent, Equations, Expression, State};

/// Networks and weights, and the equations by which they act and learn.
#[derive(Debug, Clone)]
pub(super) struct Learner {
    pub(super) policy: Network,
    pub(super) lyapunov: Network,
    pub(super) target_policy: Network,
    pub(super) target_lyapunov: Network,
    pub(super) multiplier: Weight,
    pub(super) temperature: Weight,
    pub(super) target_entropy: f64,
    n_acted: usize,
    pub(super) limits: Limits,
}

/// Loss of the policy with the means of its parts, each `[1, 1]`.
pub(super) struct PolicyLoss<'e> {
    pub(super) loss: Expression<'e>,
    pub(super) violation: Expression<'e>,
    pub(super) log_pi: Expression<'e>,
    pub(super) action_change: Option<Expression<'e>>,
}

impl Learner {
    #[allow(clippy::cast_precision_loss, reason = "a number of entries is far below 2^52")]
    pub(super) fn new(
        config: &Config,
        [n_seen, n_acted]: [usize; 2],
        state: &mut State<f32>,
        rng: &mut Rng,
    ) -> Self {
        let policy = networks::policy(config, n_seen, n_acted, state, rng);
        let lyapunov = networks::lyapunov(config, n_seen, n_acted, state, rng);
        Self {
            target_policy: policy.copied("target_policy", state),
            target_lyapunov: lyapunov.copied("target_lyapunov", state),
            policy,
            lyapunov,
            multiplier: Weight::new("multiplier", config.first_multiplier, state),
            temperature: Weight::new("temperature", config.first_temperature, state),
            target_entropy: config.target_entropy.unwrap_or(-(n_acted as f64)),
            n_acted,
            limits: Limits {
                low: config.log_sd_low,
                high: config.log_sd_high,
            },
        }
    }

    /// Actions of the policy, drawn and most likely ones.
    pub(super) fn act(&self, observations: Expression<'_>) {
        let equations = observations.equations();
        equations.routine("draw");
        let drawn = self.limits.draw(&self.policy, observations).action;
        equations.output("drawn", drawn);
        equations.routine("choose");
        equations.output("chosen", mean_action(self.policy.apply(observations)));
    }

    /// One update of critic, policy, both weights and both targets.
    pub(super) fn update(&self, batch: BatchInputs<'_>, config: &Config) {
        let equations = batch.observations.equations();
        equations.routine("update");
        let batch = MemoryInputs::of(batch, self.n_acted);
        self.update_lyapunov(batch, config);
        let PolicyLoss {
            violation, log_pi, ..
        } = self.update_policy(batch, config);
        // Eq. 2.9 and 2.8: the weights rise where the value falls too little and where the entropy is too
        // low.
        self.multiplier
            .rise_with(violation, config.multiplier_learning_rate);
        self.temperature
            .rise_with(log_pi + self.target_entropy, config.temperature_learning_rate);
        for (target, source) in [
            (&self.target_lyapunov, &self.lyapunov),
            (&self.target_policy, &self.policy),
        ] {
            let (targets, sources) = (target.parameters(equations), source.parameters(equations));
            equations.follow(&targets, &sources, config.target_smoothing);
        }
    }

    fn update_lyapunov(&self, batch: MemoryInputs<'_>, config: &Config) {
        let equations = batch.observations.equations();
        let (loss, found) = self.lyapunov_loss(batch, config.discount);
        equations.output("mean_lyapunov", found.mean());
        equations.output("lyapunov_loss", loss);
        let adam = Descent::adam(
            "lyapunov_learning_rate",
            config.lyapunov_learning_rate,
            config.gradient_clip,
        );
        equations.descend(loss, &self.lyapunov.parameters(equations), &adam);
    }

    /// Eq. 2.5: half the squared error of the Lyapunov critic to its target, and its values.
    pub(super) fn lyapunov_loss<'e>(
        &self,
        batch: MemoryInputs<'e>,
        discount: f64,
    ) -> (Expression<'e>, Expression<'e>) {
        let target = self.target(batch, discount);
        let found = value(&self.lyapunov, batch.observations, batch.actions);
        (half_squared_error(found, target), found)
    }

    /// Eq. 2.6: `c + gamma (1 - d) L_target(s', a')` with a sample of the target policy.
    pub(super) fn target<'e>(&self, batch: MemoryInputs<'e>, discount: f64) -> Expression<'e> {
        let next = self.limits.draw(&self.target_policy, batch.next_observations);
        let follows = value(&self.target_lyapunov, batch.next_observations, next.action);
        bootstrapped(batch.costs, batch.continues, follows, discount)
    }

    pub(super) fn update_policy<'e>(&self, batch: MemoryInputs<'e>, config: &Config) -> PolicyLoss<'e> {
        let equations = batch.observations.equations();
        let found = self.policy_loss(batch, config);
        let adam = Descent::adam(
            "actor_learning_rate",
            config.actor_learning_rate,
            config.gradient_clip,
        );
        equations.descend(found.loss, &self.policy.parameters(equations), &adam);
        equations.output("policy_loss", found.loss);
        equations.output("policy_entropy", -found.log_pi);
        equations.output("violation", found.violation);
        equations.output("multiplier", self.weight(equations));
        equations.output("temperature", self.temperature.expression(equations));
        if let Some(change) = found.action_change {
            equations.output("action_change", change);
        }
        found
    }

    /// Eq. 2.7, and eq. 2.10 where the observation before is stored.
    pub(super) fn policy_loss<'e>(&self, batch: MemoryInputs<'e>, config: &Config) -> PolicyLoss<'e> {
        let equations = batch.observations.equations();
        let violation = self.violation(batch, config.decrease);
        let head = self.limits.head(&self.policy, batch.observations);
        let log_pi = sample(head, Correction::Exact).log_density.mean();
        let temperature = self.temperature.expression(equations);
        let loss = violation * self.weight(equations) + log_pi * temperature;
        let action_change = batch.before.map(|before| {
            let moves = mean_action(head) - mean_action(self.policy.apply(before));
            config.smoothness_norm.of(moves)
        });
        PolicyLoss {
            loss: action_change.map_or(loss, |change| loss + change * config.smoothness),
            violation,
            log_pi,
            action_change,
        }
    }

    /// `mean(L(s', f(eps, s')) - L(s, a) + alpha_3 c)`: above 0 where the Lyapunov value falls too little.
    fn violation<'e>(&self, batch: MemoryInputs<'e>, decrease: f64) -> Expression<'e> {
        let next = self.limits.draw(&self.policy, batch.next_observations).action;
        let rise = value(&self.lyapunov, batch.next_observations, next)
            - value(&self.lyapunov, batch.observations, batch.actions);
        (rise + batch.costs * decrease).mean()
    }

    /// Multiplier as it enters the loss, at most 1.
    pub(super) fn weight<'e>(&self, equations: &'e Equations) -> Expression<'e> {
        let multiplier = self.multiplier.expression(equations);
        multiplier.min(equations.constant([1, 1], &[1.0]))
    }
}
