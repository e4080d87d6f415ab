//! The parts of the program: the engine's protocols, the environments, those in Python, the agents, programs as agents,
//! the estimators, the generators, the card and buckets, in one registry.

use contract::{Build, Registry};

/// All plugins by name, the version of the numerical code that they share, and the source code that they are
/// built from.
#[must_use]
pub fn registry() -> Registry {
    let build = Build::told(env!("REGIMEN_COMMIT"), env!("REGIMEN_CHANGED"));
    let mut registry = Registry {
        build,
        first_study: Some(("battery", "dirichlet_sac")),
        ..Registry::default()
    };
    registry.shares(numerics::VERSION);
    protocols::register(&mut registry);
    environments::register(&mut registry);
    agents::register(&mut registry);
    estimators::register(&mut registry);
    generators::register(&mut registry);
    programs::register(&mut registry);
    python::register(&mut registry);
    card::register(&mut registry);
    #[cfg(feature = "bucket")]
    bucket::register(&mut registry);
    registry
}
