//! A small cache for values that are slow to make: environments are built anew for every measurement, and most
//! need the same images or networks as the one before.

use std::sync::{Arc, Mutex, PoisonError};

/// Values per cache; trials of one study alternate between that many.
const MOST: usize = 4;

/// The values that were used last, by key.
#[derive(Debug)]
pub(crate) struct Cache<T>(Mutex<Vec<(String, Arc<T>)>>);

impl<T> Cache<T> {
    pub(crate) const fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// The value of this key, made where it is not cached. Concurrent callers wait for it.
    ///
    /// # Errors
    /// Errors of `make`.
    pub(crate) fn get_or_make<E>(
        &self,
        name: String,
        make: impl FnOnce() -> Result<T, E>,
    ) -> Result<Arc<T>, E> {
        // A panic while the lock was held has left the list unchanged.
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
        let (kept, made) = (Cache::new(), Cell::new(0));
        let ask = |name: &str| {
            let make = || {
                made.set(made.get() + 1);
                Ok::<_, ()>(made.get())
            };
            *kept.get_or_make(name.to_owned(), make).unwrap()
        };
        assert_eq!(["a", "b", "a", "c", "d", "a"].map(ask), [1, 2, 1, 3, 4, 1]);
        // `b` was used longest ago, so it is dropped.
        assert_eq!(["e", "a", "b"].map(ask), [5, 1, 6]);
        assert_eq!(kept.get_or_make("f".into(), || Err::<i32, _>("no")), Err("no"));
        assert_eq!(ask("b"), 6);
    }
}
