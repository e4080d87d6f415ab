//! Samples of a sweep with the same setting, which occur with whole numbers. They are tried once, with a warning.

use super::sweep::Dimension;
use document::{
    count::count,
    diagnostic::{Diagnostic, Sources},
};

/// Samples of a sweep, several with the same setting. Its display is `6 samples, 2 different settings`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Repeats {
    /// Number of drawn samples.
    pub samples: usize,
    /// Number of different settings among them.
    pub settings: usize,
}

impl Repeats {
    /// The repeats of a dimension; `None` if all of its points differ.
    #[must_use]
    pub fn of(dimension: &Dimension<'_>) -> Option<Self> {
        let (samples, settings) = (dimension.drawn, dimension.n_points());
        (settings < samples).then_some(Self { samples, settings })
    }
}

impl std::fmt::Display for Repeats {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{}, {}",
            count(self.samples, "sample"),
            count(self.settings, "different setting")
        )
    }
}

impl Dimension<'_> {
    /// The warning that some samples have the same setting.
    #[must_use]
    pub fn repeats(&self, sources: &Sources) -> Option<Diagnostic> {
        let repeats = Repeats::of(self)?;
        let key = &self.keys[0];
        let warning = sources.warning(
            key.path.span,
            &format!("sweep.{}", key.swept.key),
            repeats.to_string(),
        );
        Some(
            warning
                .help("samples of whole numbers are rounded; ask for fewer, or list the values in a `grid`"),
        )
    }
}
