//! Things that take long to make and are asked for again and again within a process: environments are built anew for
//! every measurement, and mostly need what the last one needed.

use std::sync::{Arc, Mutex, PoisonError};

/// How many of a kind are kept: what trials of one study take turns with.
const MOST: usize = 4;

/// The last things of a kind, by what tells them apart.
#[derive(Debug)]
pub(crate) struct Kept<T>(Mutex<Vec<(String, Arc<T>)>>);

impl<T> Kept<T> {
    pub(crate) const fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// The thing of this name, made where it is not kept. Whoever asks meanwhile waits, and finds it made.
    ///
    /// # Errors
    /// What making it says.
    pub(crate) fn or_made<E>(&self, name: String, make: impl FnOnce() -> Result<T, E>) -> Result<Arc<T>, E> {
        // What panicked while it held the lock has left the list as it was.
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(at) = kept.iter().position(|(known, _)| *known == name) {
            let found = kept.remove(at);
            let thing = Arc::clone(&found.1);
            kept.push(found);
            return Ok(thing);
        }
        let made = Arc::new(make()?);
        if kept.len() == MOST {
            kept.remove(0);
        }
        kept.push((name, Arc::clone(&made)));
        Ok(made)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    #[test]
    fn the_last_ones_are_made_once() {
        let (kept, made) = (Kept::new(), Cell::new(0));
        let ask = |name: &str| {
            let make = || {
                made.set(made.get() + 1);
                Ok::<_, ()>(made.get())
            };
            *kept.or_made(name.to_owned(), make).unwrap()
        };
        assert_eq!(["a", "b", "a", "c", "d", "a"].map(ask), [1, 2, 1, 3, 4, 1]);
        // `b` was asked for longest ago, so that it gives way.
        assert_eq!(["e", "a", "b"].map(ask), [5, 1, 6]);
        assert_eq!(kept.or_made("f".into(), || Err::<i32, _>("no")), Err("no"));
        assert_eq!(ask("b"), 6);
    }
}
