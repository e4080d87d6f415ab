//! The training behind a value as a share of its source's.

use std::fmt;

/// Steps of a training and of that of the source.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TrainingShare {
    /// Steps of the training here.
    pub own: u64,
    /// Steps of the source's training.
    pub paper: u64,
}

impl TrainingShare {
    /// Whether the training was so short that a failure to reach a result does not contradict the source.
    #[must_use]
    pub fn is_too_small(self) -> bool {
        self.own.saturating_mul(2) < self.paper
    }

    /// The share in percent, as in `3.2 %`.
    #[must_use]
    pub fn percent(self) -> String {
        #[allow(clippy::cast_precision_loss, reason = "a share is shown with two digits")]
        let percent = 100.0 * self.own as f64 / self.paper as f64;
        match percent {
            it if it >= 10.0 => format!("{it:.0} %"),
            it if it >= 1.0 => format!("{it:.1} %"),
            it => format!("{it:.2} %"),
        }
    }
}

impl fmt::Display for TrainingShare {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { own, paper } = self;
        write!(
            f,
            "trained for {own} of the source's {paper} steps ({})",
            self.percent()
        )
    }
}
