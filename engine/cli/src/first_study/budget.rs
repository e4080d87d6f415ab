//! The budget of a first study, with its default and with each profile.

/// The budget of a protocol, as lines of its section and as values of the profiles.
pub(super) struct Budget {
    /// The protocol.
    pub(super) protocol: &'static str,
    /// Its keys with their values and comments.
    pub(super) lines: Vec<String>,
    /// Values of the profile `smoke`.
    pub(super) smoke: String,
    /// Values of the profile `paper`.
    pub(super) paper: String,
    /// Number of seeds.
    pub(super) seeds: u64,
}

/// Environment steps of the default budget.
const STEPS: u64 = 48_000;
/// Environments that the protocol steps together; steps are multiples of it.
const TOGETHER: u64 = 64;

/// A training that makes updates with each budget, for an agent whose first update comes after `first_update`
/// transitions.
pub(super) fn training(first_update: u64) -> Budget {
    let whole = |steps: u64| steps.next_multiple_of(2 * TOGETHER);
    // The agent learns in half of the steps, so that their duration predicts that of a longer training.
    let smoke = whole(2 * first_update.max(TOGETHER));
    let steps = whole(STEPS.max(2 * first_update)).next_multiple_of(10 * TOGETHER);
    let every = steps / 10;
    Budget {
        protocol: "train_evaluate",
        lines: vec![
            line(
                &format!("steps: {steps}"),
                "environment steps to learn from; more of them take longer",
            ),
            line(
                &format!("evaluate_every: {every}"),
                "a point of the learning curve",
            ),
            line("episodes: 20", "episodes of such a point"),
            line(
                "final_episodes: 200",
                "episodes of the final measurement, which tables and claims read",
            ),
        ],
        smoke: format!(
            "protocol.steps: {smoke}, protocol.evaluate_every: {}, protocol.episodes: 2, protocol.final_episodes: 4, \
             seeds: 2",
            smoke / 2
        ),
        paper: format!(
            "protocol.steps: {}, protocol.evaluate_every: {}, protocol.final_episodes: 1000, seeds: 10",
            10 * steps,
            10 * every
        ),
        seeds: 3,
    }
}

/// A key with its value and a comment.
fn line(key: &str, about: &str) -> String {
    format!("{key:<24} # {about}")
}

/// A search for designs.
pub(super) fn searching(_: u64) -> Budget {
    Budget {
        protocol: "search",
        lines: vec![
            line("evaluations: 200", "what may be spent on designs"),
            line(
                "final_episodes: 3",
                "how often the chosen design is measured again",
            ),
        ],
        smoke: "protocol.evaluations: 10, protocol.final_episodes: 1, seeds: 2".into(),
        paper: "protocol.evaluations: 1000, seeds: 20".into(),
        seeds: 5,
    }
}
