//! Limits of time and memory for the trial run of an external program. Reading a study makes its environments, and none
//! of them may block that forever or without a message.

use crate::{footprint, limits::Limits, world::clock};
use std::{
    cell::RefCell,
    sync::{
        OnceLock,
        mpsc::{RecvTimeoutError, Sender, channel},
    },
    thread::JoinHandle,
    time::Duration,
};

/// Longest time in which an environment is made and rehearsed, independent of the study's limits of a trial.
pub const LONGEST: Duration = Duration::from_secs(300);
/// Time after which a message names the program that is waited for.
const SILENT: Duration = Duration::from_secs(5);
/// Interval between two checks; a process that takes memory as fast as it can gets about 50 MB in it.
const PERIOD: Duration = Duration::from_millis(20);

thread_local! {
    /// Limits that apply while a study is read; the limits of a trial are enforced from outside.
    static LIMITS: RefCell<Option<Limits>> = const { RefCell::new(None) };
}
static SAY: OnceLock<fn(&str)> = OnceLock::new();

/// Runs `tried` under the limits of a trial.
pub fn under<T>(limits: &Limits, tried: impl FnOnce() -> T) -> T {
    let before = LIMITS.replace(Some(limits.clone()));
    let found = tried();
    LIMITS.set(before);
    found
}

/// Sets the function that shows the program that is waited for.
pub fn say_by(say: fn(&str)) {
    // Only the first function is kept.
    let _ = SAY.set(say);
}

/// Thread that enforces the limits of a process that is waited for.
#[derive(Debug)]
pub struct Watch {
    done: Sender<()>,
    thread: JoinHandle<Option<String>>,
}

impl Watch {
    /// Watches a process and its descendants while it is busy with `what`; calls `end` with all their ids
    /// once the limits are exceeded.
    #[must_use]
    pub fn over(pid: u32, what: String, end: impl FnOnce(&[u32]) + Send + 'static) -> Self {
        let of_study = LIMITS.with_borrow(Clone::clone);
        let (is_read, limits) = (of_study.is_some(), of_study.unwrap_or_default());
        let own = Limits {
            wall_time_s: Some(LONGEST.as_secs_f64()),
            ..Limits::default()
        };
        let limits = limits.on(&own);
        let (done, ending) = channel();
        let thread = std::thread::spawn(move || {
            let (begun, mut is_told) = (clock::now(), !is_read);
            while ending.recv_timeout(PERIOD) == Err(RecvTimeoutError::Timeout) {
                let elapsed = clock::since(begun);
                if let Some((_, reason)) = footprint::exceeded(&limits, elapsed, pid) {
                    end(&footprint::family(pid));
                    return Some(format!("{what} was ended: {reason}"));
                }
                if !is_told && elapsed > SILENT {
                    is_told = true;
                    let most = limits.wall_time_s.unwrap_or_default();
                    say(&format!("waiting for {what}, at most {most} s"));
                }
            }
            None
        });
        Self { done, thread }
    }

    /// Ends the watch; returns the reason why the process was ended, if it was.
    #[must_use]
    pub fn end(self) -> Option<String> {
        // The thread may already have ended.
        let _ = self.done.send(());
        self.thread.join().ok().flatten()
    }
}

fn say(text: &str) {
    if let Some(say) = SAY.get() {
        say(text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicBool, Ordering};

    #[test]
    fn what_is_over_a_limit_is_ended_and_named() {
        static ENDED: AtomicBool = AtomicBool::new(false);
        let limits = Limits {
            wall_time_s: Some(0.05),
            ..Limits::default()
        };
        let watch = under(&limits, || {
            Watch::over(std::process::id(), "the pump".into(), |_| {
                ENDED.store(true, Ordering::SeqCst);
            })
        });
        while !ENDED.load(Ordering::SeqCst) {
            std::thread::yield_now();
        }
        assert_eq!(
            watch.end().unwrap(),
            "the pump was ended: it took longer than the limit of 0.05 s"
        );
    }

    #[test]
    fn what_answers_in_time_goes_on() {
        let watch = Watch::over(std::process::id(), "the pump".into(), |_| {
            panic!("nothing is over a limit");
        });
        assert_eq!(watch.end(), None);
    }
}
