//! About how long what is missing will take.

use super::{
    planned::{Planned, total_steps},
    waiting::Waiting,
};
use contract::{
    Registry,
    trial_end::{TrialEnd, is_missing},
};
use document::count::{count, duration};
use execution::store::StoredCell;
use study::plan::{self, Estimate};

/// An estimate for the trials that are missing and not blocked, from stored ones.
pub(super) fn estimate(
    registry: &Registry,
    one: &Planned,
    ends: &[Option<TrialEnd>],
    waiting: &Waiting,
    stored: &[StoredCell],
) -> Estimate {
    let trials = one.plan.trials.iter().zip(&one.costs).zip(ends).enumerate();
    let missing = trials
        .filter(|(index, (_, end))| is_missing(end.as_ref()) && !waiting.is_blocked(*index))
        .map(|(_, ((trial, cost), _))| (&**trial, *cost));
    plan::estimate(missing, stored, |key| total_steps(registry, key).unwrap_or(0))
}

/// The last line of an overview.
pub(super) fn line(estimate: &Estimate, blocked: usize, failed: usize, workers: usize) -> String {
    match (estimate.missing, blocked, failed) {
        (0, 1.., _) => format!("  {blocked} blocked, and nothing else is missing"),
        (0, 0, 0) => "  nothing is missing".into(),
        (0, 0, _) => format!("  nothing is missing, but {failed} did not end ok"),
        _ => format!("  {}", in_words(estimate, workers)),
    }
}

/// As in `60 missing: about 3 min on 2 workers, and 20 trials unlike any that is stored`.
fn in_words(estimate: &Estimate, workers: usize) -> String {
    let Estimate { missing, unknown, .. } = *estimate;
    if unknown == missing {
        return format!("{missing} missing: no stored trial tells how long");
    }
    #[allow(clippy::cast_precision_loss, reason = "an estimate")]
    let about = duration(estimate.worker_s / workers.max(1) as f64);
    let rest = match unknown {
        0 => String::new(),
        _ => format!(", and {} unlike any that is stored", count(unknown, "trial")),
    };
    format!(
        "{missing} missing: about {about} on {}{rest}",
        count(workers, "worker")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_known_is_said_beside_the_estimate() {
        let said = |missing, unknown, blocked, failed| {
            let estimate = Estimate {
                missing,
                unknown,
                worker_s: 360.0,
            };
            line(&estimate, blocked, failed, 2)
        };
        assert_eq!(said(60, 0, 0, 0), "  60 missing: about 3 min on 2 workers");
        assert_eq!(
            said(60, 20, 0, 1),
            "  60 missing: about 3 min on 2 workers, and 20 trials unlike any that is stored"
        );
        assert_eq!(said(60, 60, 3, 0), "  60 missing: no stored trial tells how long");
        assert_eq!(said(0, 0, 3, 0), "  3 blocked, and nothing else is missing");
        assert_eq!(said(0, 0, 0, 2), "  nothing is missing, but 2 did not end ok");
        assert_eq!(said(0, 0, 0, 0), "  nothing is missing");
    }
}
