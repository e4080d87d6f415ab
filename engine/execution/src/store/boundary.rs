//! The boundaries between the steps of writing, where a crash test ends the process.
//!
//! The program that people run installs no hook, and nothing from outside can make it: only the test program
//! does.

use std::{path::Path, sync::OnceLock};

/// Called with the name of the boundary and the file it is about.
type Hook = fn(&'static str, &Path);

static HOOK: OnceLock<Hook> = OnceLock::new();

/// Installs what is called at every boundary. The first one stays.
pub fn install(hook: Hook) {
    // A second hook is a mistake of a test program; the first goes on working.
    let _ = HOOK.set(hook);
}

/// Says that the process is at a boundary.
pub(crate) fn pass(name: &'static str, path: &Path) {
    if let Some(hook) = HOOK.get() {
        hook(name, path);
    }
}
