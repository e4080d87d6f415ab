//! Counter-based random streams.
//!
//! Every random number of a trial comes from a named stream. A stream is a `ChaCha8` generator whose key is a hash of
//! the words that name it. Two streams therefore never share numbers, and none of them depends on the order in which
//! they are opened, on the number of workers or on another trial.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// A random stream. It can be serialised and continues at the same number.
pub type Rng = ChaCha8Rng;

/// Opens the stream named by `words`, for example `["environment", <hash>, "train", "3"]`.
#[must_use]
pub fn stream(words: &[&str]) -> Rng {
    let mut hasher = blake3::Hasher::new();
    for word in words {
        // The length before each word keeps ["ab", "c"] and ["a", "bc"] apart.
        hasher.update(&(word.len() as u64).to_le_bytes());
        hasher.update(word.as_bytes());
    }
    Rng::from_seed(*hasher.finalize().as_bytes())
}

/// The environment's stream of a rollout with this seed, which belongs to no trial.
#[must_use]
pub fn rollout(seed: u64) -> Rng {
    stream(&["rollout", "environment", &seed.to_string()])
}

/// The streams of one trial.
///
/// Streams of the environment depend only on the environment and the seed, never on the agent, so that all agents of a
/// study meet the same starts and the same demands (common random numbers). Streams of the agent depend on the whole
/// trial.
#[derive(Debug, Clone)]
pub struct Streams {
    trial_id: String,
    environment_id: String,
    seed: u64,
}

impl Streams {
    /// Streams of the trial `trial_id` whose environment (name, version, resolved config) hashes to
    /// `environment_id`.
    #[must_use]
    pub fn new(trial_id: &str, environment_id: &str, seed: u64) -> Self {
        Self {
            trial_id: trial_id.into(),
            environment_id: environment_id.into(),
            seed,
        }
    }

    /// The key of the environment's streams.
    #[must_use]
    pub fn environment_id(&self) -> &str {
        &self.environment_id
    }

    /// The environment's stream in episode `episode` of `phase`: `train`, `evaluate 3` for the fourth measurement,
    /// `final`.
    #[must_use]
    pub fn environment(&self, phase: &str, episode: u64) -> Rng {
        stream(&[
            "environment",
            &self.environment_id,
            &self.seed.to_string(),
            phase,
            &episode.to_string(),
        ])
    }

    /// The agent's stream for a purpose (`initialise`, `act`, `learn`, `evaluate`).
    #[must_use]
    pub fn agent(&self, purpose: &str) -> Rng {
        stream(&["agent", &self.trial_id, purpose])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngCore;

    #[test]
    fn words_are_kept_apart() {
        assert_ne!(stream(&["ab", "c"]).next_u64(), stream(&["a", "bc"]).next_u64());
        assert_eq!(stream(&["ab", "c"]).next_u64(), stream(&["ab", "c"]).next_u64());
    }

    #[test]
    fn environment_streams_do_not_depend_on_the_trial() {
        let (one, two) = (
            Streams::new("one", "battery", 3),
            Streams::new("two", "battery", 3),
        );
        assert_eq!(
            one.environment("train", 7).next_u64(),
            two.environment("train", 7).next_u64()
        );
        assert_ne!(one.agent("act").next_u64(), two.agent("act").next_u64());
    }

    #[test]
    fn a_stored_stream_continues() {
        let mut rng = stream(&["x"]);
        rng.next_u32();
        let mut copy: Rng = serde_json::from_str(&serde_json::to_string(&rng).unwrap()).unwrap();
        assert_eq!(rng.next_u64(), copy.next_u64());
    }
}
