//! Several choices at once, each among named options: a design in the form of numbers.
//!
//! A vector of [`Space::Choices`](crate::Space::Choices) holds one value per option, choice after choice. The option
//! with the largest value of each choice is selected, the first of equals. Therefore an agent whose actions are numbers
//! between -1 and 1 designs as well as one that draws options: the first decides by its largest output, the second
//! writes 1 for the selected options and -1 for the rest.

use crate::Error;
use serde::{Deserialize, Serialize};

/// One choice among named options.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Choice {
    /// Name of the choice, for example `upsampling`.
    pub name: String,
    /// Names of the options, for example `nearest` and `bilinear`; at least one.
    pub options: Vec<String>,
}

impl Choice {
    /// A choice among these options.
    #[must_use]
    pub fn new(name: impl Into<String>, options: &[&str]) -> Self {
        Self {
            name: name.into(),
            options: options.iter().map(ToString::to_string).collect(),
        }
    }

    /// The option at a position that is written as a number.
    ///
    /// # Errors
    /// [`Error::Action`] for a number that is no position.
    pub fn at(&self, position: f64) -> Result<usize, Error> {
        #[allow(clippy::cast_precision_loss, reason = "nobody names 2^52 options")]
        let found = (0..self.options.len()).find(|option| *option as f64 == position);
        found.ok_or_else(|| Error::Action {
            problem: format!(
                "`{}` is {position}; its options are 0 to {}: {}",
                self.name,
                self.options.len().saturating_sub(1),
                self.options.join(", ")
            ),
        })
    }
}

/// Number of values of a vector over these choices.
#[must_use]
pub fn n_options(choices: &[Choice]) -> usize {
    choices.iter().map(|choice| choice.options.len()).sum()
}

/// Names of the values of such a vector, as `upsampling.nearest`.
#[must_use]
pub fn names(choices: &[Choice]) -> Vec<String> {
    let of_choice = |Choice { name, options }: &Choice| {
        let named = options.iter().map(|option| format!("{name}.{option}"));
        named.collect::<Vec<_>>()
    };
    choices.iter().flat_map(of_choice).collect()
}

/// The index of the option that a vector selects of each choice.
///
/// # Errors
/// [`Error::Action`] for a vector of another length and for a value that is not finite.
pub fn taken(choices: &[Choice], vector: &[f64]) -> Result<Vec<usize>, Error> {
    let length = n_options(choices);
    if vector.len() != length {
        let problem = format!("{} values for {length} options", vector.len());
        return Err(Error::Action { problem });
    }
    if let Some(value) = vector.iter().find(|value| !value.is_finite()) {
        let problem = format!("{value} for an option, which is no finite number");
        return Err(Error::Action { problem });
    }
    let mut rest = vector;
    let largest = |choice: &Choice| {
        let (of_choice, after) = rest.split_at(choice.options.len());
        rest = after;
        first_largest(of_choice)
    };
    Ok(choices.iter().map(largest).collect())
}

/// The place of the first of the largest values; 0 for an empty slice.
#[must_use]
pub fn first_largest(values: &[f64]) -> usize {
    let better = |best: usize, at: usize| if values[at] > values[best] { at } else { best };
    (0..values.len()).fold(0, better)
}

/// The vector that selects these options: 1 for each of them, -1 for the others.
#[must_use]
pub fn vector(choices: &[Choice], taken: &[usize]) -> Vec<f64> {
    let of_choice = |(choice, taken): (&Choice, &usize)| {
        let taken = *taken;
        (0..choice.options.len()).map(move |at| if at == taken { 1.0 } else { -1.0 })
    };
    choices.iter().zip(taken).flat_map(of_choice).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn choices() -> Vec<Choice> {
        vec![
            Choice::new("conv", &["post", "pre"]),
            Choice::new("norm", &["none", "batch", "instance"]),
        ]
    }

    #[test]
    fn every_design_is_read_back_from_its_vector() {
        for conv in 0..2 {
            for norm in 0..3 {
                let vector = vector(&choices(), &[conv, norm]);
                assert_eq!(vector.len(), n_options(&choices()));
                assert_eq!(taken(&choices(), &vector).unwrap(), [conv, norm]);
            }
        }
    }

    #[test]
    fn the_largest_value_decides_and_the_first_of_equals() {
        assert_eq!(taken(&choices(), &[0.2, 0.1, -0.3, -0.1, -0.1]).unwrap(), [0, 1]);
        assert_eq!(taken(&choices(), &[0.0; 5]).unwrap(), [0, 0]);
    }

    #[test]
    fn other_programs_write_positions() {
        let space = crate::Space::Choices(choices());
        assert_eq!(space.n_asked(), 2);
        assert_eq!(space.asked(&[1.0, 2.0]).unwrap(), [-1.0, 1.0, -1.0, -1.0, 1.0]);
        for (entries, why) in [
            (&[1.0][..], "1 entries, and 2 are asked for"),
            (
                &[1.0, 3.0],
                "`norm` is 3; its options are 0 to 2: none, batch, instance",
            ),
            (&[0.5, 0.0], "`conv` is 0.5"),
        ] {
            let told = space.asked(entries).unwrap_err().to_string();
            assert!(told.contains(why), "{told}");
        }
    }

    #[test]
    fn vectors_that_say_nothing_are_refused() {
        let short = taken(&choices(), &[1.0; 4]).unwrap_err().to_string();
        assert!(short.contains("4 values for 5 options"), "{short}");
        let open = taken(&choices(), &[1.0, f64::NAN, 0.0, 0.0, 0.0])
            .unwrap_err()
            .to_string();
        assert!(open.contains("NaN for an option"), "{open}");
    }
}
