//! Joint observations and actions of several seats: which columns belong to which seat.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | s = (o_1, ..., o_N) | joint observation, the seats one after the other | `[batch, n_observed]` |
//! | a = (a_1, ..., a_N) | joint action, the seats one after the other | `[batch, n_acted]` |
//! | o_i, a_i | columns `observed(i)` and `acted(i)` | `[batch, ..]` |

use super::seat::{kind, mismatch, named, observed};
use contract::{Action, Channel, Error, Interface, Observation, Seat, Space};
use numerics::policy_file::Ports;
use plan::Expression;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{
    ops::Range,
    path::{Path, PathBuf},
};

/// Columns of each seat in joint vectors, and the names of these columns.
#[derive(Debug, Clone, PartialEq)]
pub struct JointLayout {
    seats: Vec<String>,
    observed: Vec<Range<usize>>,
    acted: Vec<Range<usize>>,
    observed_names: Vec<String>,
    acted_names: Vec<String>,
}

/// Observations that the policy of a seat sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ObservationScope {
    /// The observation of its own seat.
    #[default]
    Own,
    /// The observations of all seats.
    Joint,
}

impl ObservationScope {
    /// Columns of the joint observation that a seat sees.
    #[must_use]
    pub fn columns(self, layout: &JointLayout, seat: usize) -> Range<usize> {
        match self {
            ObservationScope::Own => layout.observed(seat),
            ObservationScope::Joint => 0..layout.n_observed(),
        }
    }
}

impl JointLayout {
    /// Builds the layout of an environment whose seats all observe a box, and act in a box with limits -1 and
    /// 1 or choose among options, which count as such a box.
    ///
    /// # Errors
    /// [`Error::Mismatch`] for an environment without seats and for any other space.
    pub fn new(agent: &'static str, interface: &Interface) -> Result<Self, Error> {
        if interface.seats.is_empty() {
            return Err(mismatch(agent, "the environment has no seats"));
        }
        let (mut seen, mut done) = (Vec::new(), Vec::new());
        for seat in &interface.seats {
            seen.push(names(observed(agent, seat)?));
            done.push(acted(agent, seat)?);
        }
        Ok(Self {
            seats: interface.seats.iter().map(|seat| seat.name.clone()).collect(),
            observed: ranges(&seen),
            acted: ranges(&done),
            observed_names: seen.concat(),
            acted_names: done.concat(),
        })
    }

    /// Number of seats.
    #[must_use]
    pub fn n_seats(&self) -> usize {
        self.seats.len()
    }

    /// Names of the seats.
    #[must_use]
    pub fn seats(&self) -> &[String] {
        &self.seats
    }

    /// Number of entries of the joint observation.
    #[must_use]
    pub fn n_observed(&self) -> usize {
        self.observed_names.len()
    }

    /// Number of entries of the joint action.
    #[must_use]
    pub fn n_acted(&self) -> usize {
        self.acted_names.len()
    }

    /// Columns of a seat in the joint observation.
    #[must_use]
    pub fn observed(&self, seat: usize) -> Range<usize> {
        self.observed[seat].clone()
    }

    /// Columns of a seat in the joint action.
    #[must_use]
    pub fn acted(&self, seat: usize) -> Range<usize> {
        self.acted[seat].clone()
    }

    /// Number of entries of each seat's action.
    #[must_use]
    pub fn action_sizes(&self) -> Vec<usize> {
        self.acted.iter().map(ExactSizeIterator::len).collect()
    }

    /// Joint observations row by row, with `n_observed` entries each.
    #[must_use]
    #[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
    pub fn observation_rows(&self, rows: &[Observation]) -> Vec<f32> {
        let entries = rows.iter().flat_map(|row| row.seats.iter().flatten());
        entries.map(|entry| *entry as f32).collect()
    }

    /// Splits rows of joint actions `[rows, n_acted]`, which lie row by row on the host, into one vector per
    /// seat, clamped to -1 and 1.
    ///
    /// # Errors
    /// [`Error::NotFinite`] where an entry is not finite.
    pub fn actions(&self, joint: &[f32], step: u64) -> Result<Vec<Action>, Error> {
        if let Some(value) = joint.iter().find(|value| !value.is_finite()) {
            return Err(Error::NotFinite {
                what: "an action".into(),
                step,
                value: f64::from(*value),
            });
        }
        let seat = |row: &[f32], columns: &Range<usize>| {
            row[columns.clone()]
                .iter()
                .map(|entry| f64::from(*entry).clamp(-1.0, 1.0))
                .collect()
        };
        let split = |row: &[f32]| self.acted.iter().map(|columns| seat(row, columns)).collect();
        Ok(joint.chunks(self.n_acted()).map(split).collect())
    }

    /// Joint actions with the columns of one seat replaced by `action` `[batch, ..]`.
    #[must_use]
    pub fn exchanged<'e>(
        &self,
        joint: Expression<'e>,
        seat: usize,
        action: Expression<'e>,
    ) -> Expression<'e> {
        let part = |at| {
            if at == seat {
                action
            } else {
                joint.columns(self.acted(at))
            }
        };
        let parts: Vec<_> = (0..self.n_seats()).map(part).collect();
        joint.equations().join(&parts)
    }

    /// Path below `dir` for the files of one seat.
    #[must_use]
    pub fn place(&self, dir: &Path, seat: usize) -> PathBuf {
        dir.join(&self.seats[seat])
    }

    /// Path below `dir` for the files of one seat; creates the folder.
    ///
    /// # Errors
    /// [`Error::File`] where the operating system refuses.
    pub fn folder(&self, dir: &Path, seat: usize) -> Result<PathBuf, Error> {
        let path = self.place(dir, seat);
        match std::fs::create_dir_all(&path) {
            Ok(()) => Ok(path),
            Err(source) => Err(Error::File {
                doing: "create",
                path,
                source,
            }),
        }
    }

    /// Inputs and outputs of a policy as its file describes them: the given columns of the joint vectors.
    #[must_use]
    pub fn ports(&self, observed: Range<usize>, acted: Range<usize>) -> Ports {
        let inputs = self.observed_names[observed].to_vec();
        let (center, spread) = (vec![0.0; inputs.len()], vec![1.0; inputs.len()]);
        Ports {
            inputs,
            center,
            spread,
            outputs: self.acted_names[acted].to_vec(),
        }
    }
}

/// Names of the entries of a seat's action, each between -1 and 1: those of a box with these limits, or of
/// choices, each of which takes the option with its largest entry.
///
/// # Errors
/// [`Error::Mismatch`] for any other action space and for one without entries.
pub fn acted(agent: &'static str, seat: &Seat) -> Result<Vec<String>, Error> {
    let who = named(seat);
    if seat.action.is_empty() {
        let problem = format!("{who} has nothing to do: its action has no entries");
        return Err(mismatch(agent, problem));
    }
    match &seat.action {
        Space::Choices(_) => Ok(seat.action.names()),
        Space::Box(channels) => {
            let unfit = |channel: &&Channel| (channel.low, channel.high) != (-1.0, 1.0);
            match channels.iter().find(unfit) {
                None => Ok(names(channels)),
                Some(Channel { name, low, high, .. }) => Err(mismatch(
                    agent,
                    format!("its actions lie within -1 and 1, `{name}` of {who} within {low} and {high}"),
                )),
            }
        }
        other => {
            let taken = kind(other);
            let problem = format!("its actions are vectors in a box, {who} takes {taken}");
            Err(mismatch(agent, problem))
        }
    }
}

fn names(channels: &[Channel]) -> Vec<String> {
    channels.iter().map(|channel| channel.name.clone()).collect()
}

fn ranges(names: &[Vec<String>]) -> Vec<Range<usize>> {
    let mut end = 0;
    let advance = |names: &Vec<String>| {
        let start = end;
        end += names.len();
        start..end
    };
    names.iter().map(advance).collect()
}

#[cfg(test)]
mod tests {
    use super::super::coordination::interface;
    use super::*;
    use plan::{Equations, Processor, State};

    #[test]
    fn columns_follow_the_seats() {
        let layout = JointLayout::new("x", &interface(&[2, 1, 3], &[1, 2, 1])).unwrap();
        assert_eq!(
            (layout.n_seats(), layout.n_observed(), layout.n_acted()),
            (3, 6, 4)
        );
        assert_eq!((layout.observed(1), layout.observed(2)), (2..3, 3..6));
        assert_eq!(
            (layout.acted(0), layout.acted(1), layout.acted(2)),
            (0..1, 1..3, 3..4)
        );
        assert_eq!(layout.action_sizes(), [1, 2, 1]);
        assert_eq!(layout.ports(3..6, 1..3).outputs, ["act_1_0", "act_1_1"]);
        let seen = Observation {
            seats: vec![vec![1.0, 2.0], vec![3.0], vec![4.0, 5.0, 6.0]],
            state: Vec::new(),
        };
        assert_eq!(layout.observation_rows(&[seen]), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let split = layout.actions(&[0.5, -0.5, 1.5, -1.0], 0).unwrap();
        assert_eq!(split, [[vec![0.5], vec![-0.5, 1.0], vec![-1.0]]]);
        assert!(matches!(
            layout.actions(&[0.0, f32::NAN, 0.0, 0.0], 9),
            Err(Error::NotFinite { step: 9, .. })
        ));
    }

    #[test]
    fn a_seat_is_exchanged() {
        let layout = JointLayout::new("x", &interface(&[1, 1, 1], &[1, 2, 1])).unwrap();
        let exchange = |seat, new: &[f64]| {
            let equations = Equations::new();
            let row = |entries: &[f64]| equations.constant([1, entries.len()], entries);
            equations.routine("exchange");
            let exchanged = layout.exchanged(row(&[1.0, 2.0, 3.0, 4.0]), seat, row(new));
            equations.output("exchanged", exchanged);
            let mut processor = Processor::<f32>::new(equations.into_graph());
            processor.run("exchange", &mut State::default());
            processor.entries("exchanged").to_vec()
        };
        assert_eq!(exchange(0, &[9.0]), [9.0, 2.0, 3.0, 4.0]);
        assert_eq!(exchange(1, &[8.0, 9.0]), [1.0, 8.0, 9.0, 4.0]);
        assert_eq!(exchange(2, &[9.0]), [1.0, 2.0, 3.0, 9.0]);
        assert_eq!(
            (
                ObservationScope::Own.columns(&layout, 2),
                ObservationScope::Joint.columns(&layout, 2)
            ),
            (2..3, 0..3)
        );
    }

    #[test]
    fn the_options_of_a_choice_are_entries() {
        let mut interface = interface(&[1, 1], &[1, 1]);
        interface.seats[1].action = Space::Choices(vec![contract::Choice::new("valve", &["shut", "open"])]);
        let layout = JointLayout::new("x", &interface).unwrap();
        assert_eq!((layout.acted(1), layout.n_acted()), (1..3, 3));
        assert_eq!(layout.ports(1..2, 1..3).outputs, ["valve.shut", "valve.open"]);
    }

    #[test]
    fn other_spaces_are_refused_by_name() {
        let problem = |change: &dyn Fn(&mut Interface)| {
            let mut interface = interface(&[1, 1], &[1, 1]);
            change(&mut interface);
            JointLayout::new("x", &interface).unwrap_err().to_string()
        };
        assert!(problem(&|all| all.seats.clear()).contains("no seats"));
        assert!(problem(&|all| all.seats[1].action = Space::Simplex(vec!["a".into()])).contains("seat_1"));
        assert!(problem(&|all| all.seats[1].action = Space::Box(Vec::new())).contains("no entries"));
        assert!(
            problem(&|all| all.seats[0].observation = Space::Discrete(Vec::new()))
                .contains("a discrete choice")
        );
        let wide = Channel::new("force", "N").within(-2.0, 2.0);
        let text = problem(&|all| all.seats[1].action = Space::Box(vec![wide.clone()]));
        assert!(
            text.contains("`force` of seat `seat_1` within -2 and 2"),
            "{text}"
        );
    }
}
