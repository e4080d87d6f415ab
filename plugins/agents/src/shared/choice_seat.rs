//! Seats that take one of several named choices.

use super::seat::{kind, mismatch};
use engine::{Channel, Error, Interface, Seat, Space};

/// Names of the choices of a seat.
///
/// # Errors
/// [`Error::Mismatch`] for any other action space and for one without choices.
pub fn choices<'a>(agent: &'static str, seat: &'a Seat) -> Result<&'a [String], Error> {
    match &seat.action {
        Space::Discrete(names) if !names.is_empty() => Ok(names),
        other => Err(mismatch(
            agent,
            format!(
                "it takes one of several choices, seat `{}` takes {}",
                seat.name,
                kind(other)
            ),
        )),
    }
}

/// The number, as actions have it, of the choice called `name`.
///
/// # Errors
/// [`Error::Mismatch`] where there is none; the message lists what there is.
#[allow(clippy::cast_precision_loss, reason = "nobody names 2^52 choices")]
pub fn choice(agent: &'static str, seat: &Seat, name: &str) -> Result<f64, Error> {
    let known = choices(agent, seat)?;
    let found = known.iter().position(|known| known == name);
    found.map(|position| position as f64).ok_or_else(|| {
        mismatch(
            agent,
            format!(
                "seat `{}` has no choice `{name}`; there are: {}",
                seat.name,
                known.join(", ")
            ),
        )
    })
}

/// Positions of the channels `<seat>.<channel>` of the full state, one per seat.
///
/// # Errors
/// [`Error::Mismatch`] where one is missing; the message says which.
pub fn state_of_seats(
    agent: &'static str,
    interface: &Interface,
    channel: &str,
) -> Result<Vec<usize>, Error> {
    let of = |seat: &Seat| state_channel(agent, &interface.state, &format!("{}.{channel}", seat.name));
    interface.seats.iter().map(of).collect()
}

/// Position of a channel of the full state.
///
/// # Errors
/// [`Error::Mismatch`] where there is none of that name.
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

    /// Seats `unit_0`, `unit_1`, .. with these choices; the state has `step` and these channels of each seat.
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
        assert_eq!(choice("rule", &interface.seats[1], "act").unwrap(), 1.0);
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
        let text = choices("rule", &other).unwrap_err().to_string();
        assert!(text.contains("seat `unit_0` takes a simplex"), "{text}");
    }
}
