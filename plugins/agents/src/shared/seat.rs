//! Checks and look-ups of the seats that agents are built for: the kind of space, and positions of channels
//! by name.

use contract::{Channel, Error, Interface, Seat, Space};

/// Seat of an environment that has a single one.
///
/// # Errors
/// [`Error::Mismatch`] where there is not exactly one seat.
pub fn only_seat<'a>(agent: &'static str, interface: &'a Interface) -> Result<&'a Seat, Error> {
    match interface.seats.as_slice() {
        [seat] => Ok(seat),
        seats => Err(mismatch(
            agent,
            format!("it plays one seat, the environment has {}", seats.len()),
        )),
    }
}

/// Names of the shares of a seat that acts on a simplex.
///
/// # Errors
/// [`Error::Mismatch`] for any other action space and for a simplex without entries.
pub fn simplex<'a>(agent: &'static str, seat: &'a Seat) -> Result<&'a [String], Error> {
    match &seat.action {
        Space::Simplex(names) if !names.is_empty() => Ok(names),
        other => Err(mismatch(
            agent,
            format!(
                "its actions are shares on a simplex, the environment takes {}",
                kind(other)
            ),
        )),
    }
}

/// Observed channels of a seat, in order.
///
/// # Errors
/// [`Error::Mismatch`] where the observation is not a box.
pub fn observed<'a>(agent: &'static str, seat: &'a Seat) -> Result<&'a [Channel], Error> {
    match &seat.observation {
        Space::Box(channels) => Ok(channels),
        other => Err(mismatch(
            agent,
            format!(
                "it observes a box of channels, the environment shows {}",
                kind(other)
            ),
        )),
    }
}

/// Position of the channel called `name`.
///
/// # Errors
/// [`Error::Mismatch`] for an unknown name; the message lists the channels.
pub fn position(agent: &'static str, channels: &[Channel], name: &str) -> Result<usize, Error> {
    channels
        .iter()
        .position(|channel| channel.name == name)
        .ok_or_else(|| {
            let known: Vec<_> = channels.iter().map(|channel| channel.name.as_str()).collect();
            mismatch(
                agent,
                format!("it needs a channel `{name}`; there are: {}", known.join(", ")),
            )
        })
}

/// Rest of the name after `prefix`, for each channel whose name starts with it, in the order of the channels:
/// one per asset.
///
/// # Errors
/// [`Error::Mismatch`] where their number is not `n_assets`.
pub fn assets(
    agent: &'static str,
    channels: &[Channel],
    prefix: &str,
    n_assets: usize,
) -> Result<Vec<String>, Error> {
    let suffixes: Vec<String> = channels
        .iter()
        .filter_map(|channel| channel.name.strip_prefix(prefix))
        .map(str::to_owned)
        .collect();
    if suffixes.len() == n_assets {
        return Ok(suffixes);
    }
    let found = suffixes.len();
    Err(mismatch(
        agent,
        format!("it needs one channel `{prefix}..` per share, found {found} for {n_assets} shares"),
    ))
}

/// Positions of the channels `<prefix><suffix>`, one per suffix.
///
/// # Errors
/// [`Error::Mismatch`] where one is missing.
pub fn positions(
    agent: &'static str,
    channels: &[Channel],
    prefix: &str,
    suffixes: &[String],
) -> Result<Vec<usize>, Error> {
    suffixes
        .iter()
        .map(|suffix| position(agent, channels, &format!("{prefix}{suffix}")))
        .collect()
}

/// Checks that the full state has one channel per entry of the target.
///
/// # Errors
/// [`Error::Mismatch`] where the numbers differ.
pub fn state_of_length(agent: &'static str, interface: &Interface, n_targets: usize) -> Result<(), Error> {
    let found = interface.state.len();
    if found == n_targets {
        return Ok(());
    }
    Err(mismatch(
        agent,
        format!("it reads its target from a state of {n_targets} channels, the environment has {found}"),
    ))
}

/// Error of an agent that does not fit an environment.
#[must_use]
pub fn mismatch(agent: &'static str, problem: impl Into<String>) -> Error {
    Error::Mismatch {
        agent,
        problem: problem.into(),
    }
}

/// Phrase for a seat in messages.
#[must_use]
pub fn named(seat: &Seat) -> String {
    match seat.name.as_str() {
        "" => "the one seat".into(),
        name => format!("seat `{name}`"),
    }
}

/// Phrase for the kind of a space in messages.
#[must_use]
pub fn kind(space: &Space) -> &'static str {
    match space {
        Space::Box(_) => "a box",
        Space::Simplex(names) if names.is_empty() => "an empty simplex",
        Space::Simplex(_) => "a simplex",
        Space::Discrete(_) => "a discrete choice",
        Space::Choices(choices) if choices.len() == 1 => "one choice among options",
        Space::Choices(_) => "several choices at once",
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Interface of one seat that acts on a simplex of `n` shares.
    pub(crate) fn allocation(observed: &[&str], state: &[&str], n: usize) -> Interface {
        let channels = |names: &[&str]| {
            names
                .iter()
                .map(|name| Channel::new(*name, ""))
                .collect::<Vec<_>>()
        };
        let shares = (1..=n).map(|i| format!("share_{i}")).collect();
        let seat = Seat {
            name: String::new(),
            observation: Space::Box(channels(observed)),
            action: Space::Simplex(shares),
        };
        Interface {
            seats: vec![seat],
            state: channels(state),
        }
    }

    #[test]
    fn a_missing_channel_is_named_with_the_existing_ones() {
        let interface = allocation(&["voltage_1", "current_1"], &[], 1);
        let channels = observed("rule", &interface.seats[0]).unwrap();
        assert_eq!(position("rule", channels, "current_1").unwrap(), 1);
        let text = position("rule", channels, "power_demand_w")
            .unwrap_err()
            .to_string();
        assert!(
            text.contains("`power_demand_w`") && text.contains("voltage_1, current_1"),
            "{text}"
        );
    }

    #[test]
    fn spaces_of_another_kind_are_refused() {
        let mut interface = allocation(&["voltage_1"], &[], 1);
        interface.seats[0].action = Space::Discrete(vec!["on".into()]);
        assert!(
            simplex("rule", &interface.seats[0])
                .unwrap_err()
                .to_string()
                .contains("a discrete choice")
        );
        interface.seats.push(interface.seats[0].clone());
        assert!(only_seat("rule", &interface).is_err());
    }

    #[test]
    fn assets_are_counted() {
        let interface = allocation(&["voltage_a", "voltage_b", "power_demand_w"], &[], 2);
        let channels = observed("rule", &interface.seats[0]).unwrap();
        assert_eq!(assets("rule", channels, "voltage_", 2).unwrap(), ["a", "b"]);
        assert!(assets("rule", channels, "voltage_", 3).is_err());
    }
}
