//! Panics that are caught. They print nothing, and the error or the end of the trial contains their message and their
//! position in the source code.

use crate::Error;
use std::{
    any::Any,
    cell::{Cell, RefCell},
    panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind},
    path::Path,
};

thread_local! {
    /// Number of calls of [`caught`] that are running on this thread.
    static UNDER_WAY: Cell<usize> = const { Cell::new(0) };
    /// Position of the last panic on this thread, as `file:line`.
    static PLACE: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Keeps caught panics from printing; all others are printed as before.
pub fn print_no_caught_ones() {
    let before = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic: &PanicHookInfo<'_>| {
        if UNDER_WAY.get() == 0 {
            return before(panic);
        }
        let place = panic.location().map(|it| format!("{}:{}", it.file(), it.line()));
        PLACE.with_borrow_mut(|last| *last = place);
    }));
}

/// The result of `run`, or the message of its panic.
///
/// # Errors
/// The message of a panic, with its position in the source code if that is known.
pub fn caught<T>(run: impl FnOnce() -> T) -> Result<T, String> {
    UNDER_WAY.set(UNDER_WAY.get() + 1);
    let outcome = catch_unwind(AssertUnwindSafe(run));
    UNDER_WAY.set(UNDER_WAY.get() - 1);
    outcome.map_err(|panic| {
        let place = PLACE
            .take()
            .map_or_else(String::new, |place| format!(" ({place})"));
        message(&*panic) + &place
    })
}

/// Like [`caught`], for the reader of a file: a reader may panic over damaged content.
///
/// # Errors
/// [`Error::Damaged`] for a panic, and the errors of `read`.
pub fn or_damaged<T>(path: &Path, read: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    caught(read).unwrap_or_else(|said| {
        let problem = format!("it cannot be read: its reader stopped with `{said}`");
        let path = path.to_owned();
        Err(Error::Damaged { path, problem })
    })
}

fn message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "a panic without a message".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_an_error_that_says_what_it_said() {
        assert_eq!(caught(|| 7), Ok(7));
        let said = caught(|| panic!("no such {}", "row")).unwrap_err();
        assert!(said.starts_with("no such row"), "{said}");
        let damaged = or_damaged::<()>(Path::new("a.parquet"), || panic!("out of bounds")).unwrap_err();
        assert!(matches!(damaged, Error::Damaged { problem, .. } if problem.contains("out of bounds")));
        assert_eq!(UNDER_WAY.get(), 0);
    }
}
