//! Results made by formulas, for tests.

use analysis::results::Results;

/// Two environments, four agents (two of which learn), five seeds; one trial of `ddpg` ran out of memory and
/// one has not run.
pub(crate) fn study() -> Results {
    Results::of(testing::synthetic::study())
}
