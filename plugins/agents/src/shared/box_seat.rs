//! The only seat of an environment with a box of observed channels and actions in a box with limits -1 and 1.
//! Choices among options count as such a box: the largest of a choice's entries decides.

use super::joint::acted;
use super::scaling::{ObservationScaling, Scaling};
use super::seat::{observed, only_seat};
use contract::{Action, Error, Interface, Observation};
use numerics::policy_file::Ports;

/// Maps observations to network inputs, and network outputs to actions.
#[derive(Debug, Clone, PartialEq)]
pub struct BoxSeat {
    /// Centres and spreads of the observed channels.
    pub scaling: Scaling,
    seen: Vec<String>,
    done: Vec<String>,
}

impl BoxSeat {
    /// Builds the seat of an environment.
    ///
    /// # Errors
    /// [`Error::Mismatch`] for several seats, for an observation that is no box, and for an action that is neither a
    /// box with limits -1 and 1 nor choices.
    pub fn new(
        agent: &'static str,
        scaling: ObservationScaling,
        interface: &Interface,
    ) -> Result<Self, Error> {
        let seat = only_seat(agent, interface)?;
        let seen = observed(agent, seat)?;
        let done = acted(agent, seat)?;
        Ok(Self {
            scaling: Scaling::new(scaling, seen),
            seen: seen.iter().map(|channel| channel.name.clone()).collect(),
            done,
        })
    }

    /// Number of entries of an observation.
    #[must_use]
    pub fn n_observed(&self) -> usize {
        self.seen.len()
    }

    /// Number of entries of an action.
    #[must_use]
    pub fn n_acted(&self) -> usize {
        self.done.len()
    }

    /// Scaled observations, row by row, with `n_observed` entries each.
    #[must_use]
    pub fn scaled(&self, observations: &[Observation]) -> Vec<f32> {
        let seen = observations.iter().map(|observation| &observation.seats[0]);
        seen.flat_map(|seen| self.scaling.apply(seen)).collect()
    }

    /// Actions from network outputs, row by row, clamped to -1 and 1.
    ///
    /// # Errors
    /// [`Error::NotFinite`] where an entry is not finite.
    pub fn actions(&self, outputs: &[f32], step: u64) -> Result<Vec<Action>, Error> {
        if let Some(value) = outputs.iter().find(|value| !value.is_finite()) {
            return Err(Error::NotFinite {
                what: "an action".into(),
                step,
                value: f64::from(*value),
            });
        }
        let action = |row: &[f32]| {
            let held = row.iter().map(|entry| f64::from(*entry).clamp(-1.0, 1.0));
            vec![held.collect()]
        };
        Ok(outputs.chunks(self.n_acted()).map(action).collect())
    }

    /// Positions of the observed channels whose names begin with one of `prefixes`; all positions where
    /// `prefixes` is empty.
    ///
    /// # Errors
    /// Names a prefix that no channel begins with.
    pub fn positions(&self, prefixes: &[String]) -> Result<Vec<usize>, String> {
        let begins = |prefix: &String, name: &String| name.starts_with(prefix.as_str());
        let unmet = |prefix: &&String| !self.seen.iter().any(|name| begins(prefix, name));
        if let Some(prefix) = prefixes.iter().find(unmet) {
            let known = self.seen.join(", ");
            return Err(format!(
                "no observed channel begins with `{prefix}`; there are: {known}"
            ));
        }
        let meant = |name: &String| prefixes.is_empty() || prefixes.iter().any(|prefix| begins(prefix, name));
        Ok((0..self.n_observed())
            .filter(|at| meant(&self.seen[*at]))
            .collect())
    }

    /// Hides the channels whose names begin with none of `prefixes`: networks see their typical value
    /// instead. An empty list hides nothing.
    ///
    /// # Errors
    /// Names a prefix that no channel begins with.
    pub fn see_only(&mut self, prefixes: &[String]) -> Result<(), String> {
        let seen = self.positions(prefixes)?;
        self.scaling.flatten(|at| !seen.contains(&at));
        Ok(())
    }

    /// Inputs and outputs of the seat as a policy file describes them.
    #[must_use]
    pub fn ports(&self) -> Ports {
        self.scaling.ports(&self.done)
    }
}

#[cfg(test)]
mod tests {
    use super::super::coordination::interface;
    use super::*;
    use contract::{Channel, Space};

    fn seat(interface: &Interface) -> Result<BoxSeat, Error> {
        BoxSeat::new("tested", ObservationScaling::Typical, interface)
    }

    #[test]
    fn observations_are_scaled_and_actions_held() {
        let mut one = interface(&[2], &[2]);
        if let Space::Box(channels) = &mut one.seats[0].observation {
            channels[1] = channels[1].clone().typical(3.0, 2.0);
        }
        let seat = seat(&one).unwrap();
        let seen = |x: f64| Observation {
            seats: vec![vec![x, 7.0]],
            state: Vec::new(),
        };
        assert_eq!(seat.scaled(&[seen(0.5), seen(-0.5)]), [0.5, 2.0, -0.5, 2.0]);
        let actions = seat.actions(&[0.5, -1.5, 1.0, 0.25], 0).unwrap();
        assert_eq!(actions, [[[0.5, -1.0]], [[1.0, 0.25]]]);
        assert!(matches!(
            seat.actions(&[0.0, f32::NAN], 9),
            Err(Error::NotFinite { step: 9, .. })
        ));
        assert_eq!(seat.ports().center, [0.0, 3.0]);
    }

    #[test]
    fn channels_are_found_by_how_they_begin() {
        let mut one = interface(&[1], &[1]);
        let named = |name: &&str| Channel::new(*name, "");
        one.seats[0].observation = Space::Box(["target_1", "flight", "target_2"].iter().map(named).collect());
        let seat = seat(&one).unwrap();
        let positions = |prefixes: &[&str]| {
            let prefixes: Vec<String> = prefixes.iter().map(ToString::to_string).collect();
            seat.positions(&prefixes)
        };
        assert_eq!(positions(&["target_"]).unwrap(), [0, 2]);
        assert_eq!(positions(&[]).unwrap(), [0, 1, 2]);
        let text = positions(&["target_", "aim"]).unwrap_err();
        assert!(
            text.contains("`aim`") && text.contains("target_1, flight, target_2"),
            "{text}"
        );
    }

    #[test]
    fn other_seats_are_refused() {
        let problem = |change: &dyn Fn(&mut Interface)| {
            let mut one = interface(&[1], &[1]);
            change(&mut one);
            seat(&one).unwrap_err().to_string()
        };
        let text = problem(&|one| one.seats[0].action = Space::Simplex(vec!["a".into()]));
        assert!(
            text.contains("vectors in a box, seat `seat_0` takes a simplex"),
            "{text}"
        );
        let text = problem(&|one| one.seats.push(one.seats[0].clone()));
        assert!(
            text.contains("it plays one seat, the environment has 2"),
            "{text}"
        );
        let text = problem(&|one| one.seats[0].observation = Space::Discrete(Vec::new()));
        assert!(text.contains("the environment shows a discrete choice"), "{text}");
        let wide = Channel::new("force", "N").within(-2.0, 2.0);
        let text = problem(&|one| one.seats[0].action = Space::Box(vec![wide.clone()]));
        assert!(
            text.contains("`force` of seat `seat_0` within -2 and 2"),
            "{text}"
        );
    }
}
