//! Failpoints between the steps of writing, at which a crash test ends the process.
//!
//! The released program installs no hook, and no setting can make it; only the test program does.

use std::{path::Path, sync::OnceLock};

/// Function of a crash test: it gets the name of the boundary and the file that is being written.
type FailpointHook = fn(&'static str, &Path);

static HOOK: OnceLock<FailpointHook> = OnceLock::new();

/// Installs the function that is called at every boundary. Only the first one is kept.
pub fn install(hook: FailpointHook) {
    // A second hook is a mistake of a test program; the first stays in use.
    let _ = HOOK.set(hook);
}

/// Calls the hook, if any, at a boundary.
pub(crate) fn pass(name: &'static str, path: &Path) {
    if let Some(hook) = HOOK.get() {
        hook(name, path);
    }
}
