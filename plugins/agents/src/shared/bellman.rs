//! Equations that actor-critics share: targets and losses of critics, and weights that are learned by their
//! logarithm.

use plan::{Descent, Equations, Expression, State};

/// `r + gamma (1 - d) v`; all `[rows, 1]`, `continues` is `1 - d`.
#[must_use]
pub fn bootstrapped<'e>(
    rewards: Expression<'e>,
    continues: Expression<'e>,
    value: Expression<'e>,
    discount: f64,
) -> Expression<'e> {
    rewards + continues * value * discount
}

/// Mean of `(q - target)^2 / 2` over the batch, `[1, 1]` (thesis, eq. 3.16).
#[must_use]
pub fn half_squared_error<'e>(q: Expression<'e>, target: Expression<'e>) -> Expression<'e> {
    (q - target).square().mean() * 0.5
}

/// A positive weight whose logarithm is a parameter, such as the temperature of an entropy or the multiplier of a
/// constraint.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Weight {
    logarithm: String,
    rate: String,
}

impl Weight {
    /// Adds a weight that starts at `first` to a state.
    #[allow(clippy::cast_possible_truncation, reason = "parameters are f32")]
    pub fn new(name: &str, first: f64, state: &mut State<f32>) -> Self {
        let logarithm = format!("log_{name}");
        state.insert(&*logarithm, [1, 1], vec![first.ln() as f32]);
        Self {
            logarithm,
            rate: format!("{name}_learning_rate"),
        }
    }

    /// Current value, above 0.
    #[must_use]
    pub fn value(&self, state: &State<f32>) -> f64 {
        f64::from(state.entries(&self.logarithm)[0]).exp()
    }

    fn logarithm<'e>(&self, equations: &'e Equations) -> Expression<'e> {
        equations.parameter(&self.logarithm, [1, 1])
    }

    /// The weight in equations, `[1, 1]`, through which no gradient passes.
    #[must_use]
    pub fn expression<'e>(&self, equations: &'e Equations) -> Expression<'e> {
        self.logarithm(equations).exp().stop_gradient()
    }

    /// Takes one gradient step of the logarithm up the product `logarithm * excess`: the weight rises where `excess`
    /// `[1, 1]` is positive.
    pub fn rise_with(&self, excess: Expression<'_>, learning_rate: f64) {
        let equations = excess.equations();
        let logarithm = self.logarithm(equations);
        let loss = logarithm * -excess.stop_gradient();
        let descent = Descent::adam(&self.rate, learning_rate, None);
        equations.descend(loss, &[logarithm], &descent);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plan::Processor;

    #[test]
    fn a_terminal_step_has_no_value_behind_it() {
        let equations = Equations::new();
        let column = |numbers: [f64; 2]| equations.constant([2, 1], &numbers);
        equations.routine("target");
        let target = bootstrapped(column([1.0, 1.0]), column([1.0, 0.0]), column([10.0, 10.0]), 0.9);
        equations.output("target", target);
        let loss = half_squared_error(column([1.0, 2.0]), column([3.0, 6.0]));
        equations.output("loss", loss);
        let mut processor = Processor::<f32>::new(equations.into_graph());
        processor.run("target", &mut State::default());
        assert_eq!(processor.entries("target"), [10.0, 1.0]);
        // (0.5 * 4 + 0.5 * 16) / 2.
        assert_eq!(processor.number("loss"), 5.0);
    }

    /// Value of a weight after steps with the same excess.
    fn after(excess: f64, n_steps: usize, rate: f64) -> f64 {
        let mut state = State::default();
        let weight = Weight::new("weight", 0.5, &mut state);
        let equations = Equations::new();
        equations.routine("rise");
        weight.rise_with(equations.constant([1, 1], &[excess]), rate);
        let mut processor = Processor::<f32>::new(equations.into_graph());
        (0..n_steps).for_each(|_| processor.run("rise", &mut state));
        weight.value(&state)
    }

    /// The first step of Adam has the size of the learning rate for any gradient.
    #[test]
    fn a_weight_rises_with_an_excess_and_stays_above_zero() {
        assert!((after(3.0, 1, 0.1) - 0.5 * 0.1f64.exp()).abs() < 1e-6);
        // Every step against a constant gradient has this size.
        assert!((after(-0.7, 3, 0.01) - 0.5 * (-0.03f64).exp()).abs() < 1e-6);
        let fallen = after(-3.0, 200, 0.1);
        assert!(fallen > 0.0 && fallen < 1e-6);
        assert!((after(3.0, 5, 0.0) - 0.5).abs() < 1e-7);
    }
}
