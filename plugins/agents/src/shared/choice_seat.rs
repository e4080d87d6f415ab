//! Seats that take one of several named options, by its index or by the largest of one number per option.

use super::seat::{kind, mismatch, named};
use contract::{Channel, Error, Interface, Seat, Space, choice};

/// Options of a seat that takes one of them per step.
#[derive(Debug, Clone, PartialEq)]
pub struct ChoiceSeat {
    action: Space,
    names: Vec<String>,
}

impl ChoiceSeat {
    /// Builds the seat from its action space.
    ///
    /// # Errors
    /// [`Error::Mismatch`] for an action that is no choice, for several choices at once and for a choice
    /// without options.
    pub fn new(agent: &'static str, seat: &Seat) -> Result<Self, Error> {
        let names = match &seat.action {
            Space::Discrete(names) if !names.is_empty() => names,
            Space::Choices(choices) if choices.len() == 1 => &choices[0].options,
            other => {
                let (seat, taken) = (named(seat), kind(other));
                let problem = format!("it takes one of several choices, {seat} takes {taken}");
                return Err(mismatch(agent, problem));
            }
        };
        Ok(Self {
            action: seat.action.clone(),
            names: names.clone(),
        })
    }

    /// Names of the options; at least one.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Action that takes `option`.
    #[must_use]
    #[allow(clippy::cast_precision_loss, reason = "nobody names 2^52 options")]
    pub fn action(&self, option: usize) -> Vec<f64> {
        match &self.action {
            Space::Choices(choices) => choice::vector(choices, &[option]),
            _ => vec![option as f64],
        }
    }

    /// Option that `action` takes.
    ///
    /// # Errors
    /// [`Error::Action`] for an action that takes none.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "positions of options"
    )]
    pub fn taken(&self, action: &[f64]) -> Result<usize, Error> {
        let none = || Error::Action {
            problem: format!("{action:?} takes none of {} options", self.names.len()),
        };
        match &self.action {
            Space::Choices(choices) => Ok(choice::taken(choices, action)?[0]),
            _ => match action {
                [option] if *option >= 0.0 && (*option as usize) < self.names.len() => Ok(*option as usize),
                _ => Err(none()),
            },
        }
    }
}

/// Action of a seat that takes the option called `name`.
///
/// # Errors
/// [`Error::Mismatch`] for an unknown name; the message lists the options.
pub fn choice(agent: &'static str, seat: &Seat, name: &str) -> Result<Vec<f64>, Error> {
    let known = ChoiceSeat::new(agent, seat)?;
    let found = known.names.iter().position(|known| known == name);
    found.map(|option| known.action(option)).ok_or_else(|| {
        let (seat, known) = (named(seat), known.names.join(", "));
        mismatch(
            agent,
            format!("{seat} has no choice `{name}`; there are: {known}"),
        )
    })
}

/// Positions of the channels `<seat>.<channel>` of the full state, one per seat.
///
/// # Errors
/// [`Error::Mismatch`] where a channel is missing; the message names it.
pub fn state_of_seats(
    agent: &'static str,
    interface: &Interface,
    channel: &str,
) -> Result<Vec<usize>, Error> {
    let of = |seat: &Seat| state_channel(agent, &interface.state, &format!("{}.{channel}", seat.name));
    interface.seats.iter().map(of).collect()
}

/// Position of a channel in the full state.
///
/// # Errors
/// [`Error::Mismatch`] where no channel has that name.
pub fn state_channel(agent: &'static str, state: &[Channel], name: &str) -> Result<usize, Error> {
    let found = state.iter().position(|channel| channel.name == name);
    found.ok_or_else(|| {
        mismatch(
            agent,
            format!("it reads `{name}` of the full state, which has no such channel"),
        )
    })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Environment with seats `unit_0`, `unit_1`, .. and these choices. Its state has `step` and these
    /// channels of each seat.
    pub(crate) fn interface(n_seats: usize, choices: &[&str], channels: &[&str]) -> Interface {
        let named = |names: &[&str]| names.iter().map(ToString::to_string).collect::<Vec<_>>();
        let seats: Vec<Seat> = (0..n_seats)
            .map(|seat| Seat {
                name: format!("unit_{seat}"),
                observation: Space::Box(vec![Channel::new("seen", "")]),
                action: Space::Discrete(named(choices)),
            })
            .collect();
        let of = |seat: &Seat| {
            let name = seat.name.clone();
            named(channels)
                .into_iter()
                .map(move |channel| Channel::new(format!("{name}.{channel}"), ""))
        };
        let state = [Channel::new("step", "")]
            .into_iter()
            .chain(seats.iter().flat_map(of))
            .collect();
        Interface { seats, state }
    }

    #[test]
    fn choices_and_channels_are_found_by_name() {
        let interface = interface(2, &["rest", "act"], &["wear"]);
        assert_eq!(choice("rule", &interface.seats[1], "act").unwrap(), [1.0]);
        assert_eq!(state_of_seats("rule", &interface, "wear").unwrap(), [1, 2]);
        let text = choice("rule", &interface.seats[1], "sleep")
            .unwrap_err()
            .to_string();
        assert!(
            text.contains("seat `unit_1` has no choice `sleep`; there are: rest, act"),
            "{text}"
        );
        let text = state_of_seats("rule", &interface, "noise")
            .unwrap_err()
            .to_string();
        assert!(text.contains("`unit_0.noise`"), "{text}");
        let mut other = interface.seats[0].clone();
        other.action = Space::Simplex(vec!["share".into()]);
        let text = ChoiceSeat::new("rule", &other).unwrap_err().to_string();
        assert!(text.contains("seat `unit_0` takes a simplex"), "{text}");
        other.name.clear();
        let text = ChoiceSeat::new("rule", &other).unwrap_err().to_string();
        assert!(text.contains("the one seat takes a simplex"), "{text}");
    }

    #[test]
    fn an_option_is_taken_by_its_index_or_by_the_largest_number() {
        let mut seat = interface(1, &["rest", "act", "wait"], &[]).seats.remove(0);
        let by_index = ChoiceSeat::new("rule", &seat).unwrap();
        seat.action = Space::Choices(vec![contract::Choice::new("action", &["rest", "act", "wait"])]);
        let by_number = ChoiceSeat::new("rule", &seat).unwrap();
        assert_eq!(by_index.names(), by_number.names());
        for option in 0..3 {
            for seat in [&by_index, &by_number] {
                assert_eq!(seat.taken(&seat.action(option)).unwrap(), option);
            }
        }
        assert_eq!(by_number.taken(&[0.2, 0.3, -1.0]).unwrap(), 1);
        for nothing in [&[3.0][..], &[-1.0], &[f64::NAN], &[0.0, 1.0]] {
            assert!(by_index.taken(nothing).is_err(), "{nothing:?}");
        }
        let two = contract::Choice::new("other", &["a"]);
        seat.action = Space::Choices(vec![two.clone(), two]);
        let text = ChoiceSeat::new("rule", &seat).unwrap_err().to_string();
        assert!(text.contains("takes several choices at once"), "{text}");
    }
}
