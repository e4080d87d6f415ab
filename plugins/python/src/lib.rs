//! Environments that are written in Python: those of Gymnasium, of `PettingZoo`'s parallel interface, and a
//! person's own.
//!
//! The environments of a trial live in one Python process ([`server.py`](../src/server.py)), which this crate
//! starts, asks and ends. Numbers pass through memory that both share, and one byte each way says that they are
//! there; environments that are stepped together are asked together.
//!
//! What determines numbers is in a trial's id: the text of a person's own files, and that of a lock file, against
//! which the installed packages are held whenever Python starts. Which Python runs it is not.

mod config;
mod environment;
mod interface;
mod process;
mod server;

pub use config::PythonConfig;

/// Registers the environment `python`.
pub fn register(registry: &mut engine::Registry) {
    registry.environment(
        "python",
        1,
        "an environment written in Python: of Gymnasium, of PettingZoo's parallel interface, or of your own",
        environment::build,
    );
}
