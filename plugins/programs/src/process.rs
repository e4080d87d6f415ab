//! A program that runs under its guard, with an ear on what it says.

use crate::{
    ProgramConfig,
    lines::Filter,
    output::{self, Listening, STREAMS},
    variables,
    workplace::Workplace,
};
use contract::{Error, ending::Ending, resources::Share};
use execution::guard::{Guarded, Left, Order};
use std::{path::Path, time::Duration};

/// Time between two looks at a program.
const LOOK: Duration = Duration::from_millis(2);

/// Signals by which people, terminals and batch systems stop programs: no fault of what is stopped.
const STOPS: [i32; 5] = [1, 2, 9, 10, 15];

/// A program that was started.
#[derive(Debug)]
pub struct Process {
    guarded: Guarded,
    listening: Listening,
    /// Its first words, for messages.
    name: String,
}

impl Process {
    /// Starts a program in its working folder.
    ///
    /// # Errors
    /// [`Error::Worker`] where no guard can be started, and [`Error::File`].
    pub fn start(
        config: &ProgramConfig,
        words: Vec<String>,
        (place, share): (&Workplace, &Share),
        listening: Listening,
    ) -> Result<Self, Error> {
        let name = words.iter().take(2).cloned().collect::<Vec<_>>().join(" ");
        let order = Order {
            words,
            folder: place.folder.clone(),
            notes: place.notes(),
            signal: config.stop.signal,
            grace_ms: u64::try_from(grace(config).as_millis()).unwrap_or(u64::MAX),
        };
        let variables = variables::given(config, place, share);
        let guarded = Guarded::start(order, &variables, output::files(&place.notes())?)?;
        Ok(Self {
            guarded,
            listening,
            name,
        })
    }

    /// Waits for its end, not longer than `wait`; `None` where it runs on.
    pub fn ends_within(&mut self, wait: Duration) -> Option<Result<(), Error>> {
        let mut left = wait;
        loop {
            self.listening.look();
            if self.guarded.has_left() {
                let left = self.end();
                return Some(self.judged(left));
            }
            if left.is_zero() {
                return None;
            }
            let now = left.min(LOOK);
            std::thread::sleep(now);
            left -= now;
        }
    }

    /// True where something was heard of it since this was asked last.
    pub fn has_heard(&mut self) -> bool {
        self.listening.has_heard()
    }

    /// The ear on it.
    pub fn listening(&self) -> &Listening {
        &self.listening
    }

    /// Tells it to end, and waits until it has.
    pub fn stop(&mut self) {
        self.guarded.ask_to_stop();
        self.end();
    }

    fn end(&mut self) -> Left {
        let left = self.guarded.end();
        self.listening.end();
        left
    }

    fn judged(&self, left: Left) -> Result<(), Error> {
        let how = match left {
            Left::Ended {
                how: Ending::Code(0), ..
            } => return self.noted_well(),
            Left::Ended {
                how: Ending::Signal(signal),
                ..
            } if STOPS.contains(&signal) => {
                let what = "the program";
                return Err(Error::Ended { what, signal });
            }
            Left::Ended { how, .. } => how,
            Left::Unstarted(problem) => {
                let problem = format!("`{}` cannot be started: {problem}", self.name);
                return Err(Error::Unavailable {
                    key: "run".into(),
                    problem,
                });
            }
            Left::Unguarded(signal) => {
                let what = "the guard of the program";
                return Err(Error::Ended {
                    what,
                    signal: signal.unwrap_or(9),
                });
            }
        };
        Err(Error::Program {
            program: self.name.clone(),
            how,
            said: self.listening.last_words(),
        })
    }

    fn noted_well(&self) -> Result<(), Error> {
        match self.listening.problem() {
            Some(problem) => Err(Error::Store {
                problem: format!("what a program says cannot be noted: {problem}"),
            }),
            None => Ok(()),
        }
    }
}

/// How long a program may take to leave.
pub fn grace(config: &ProgramConfig) -> Duration {
    Duration::try_from_secs_f64(config.stop.grace_s).unwrap_or_default()
}

/// The ear on a program: of what it says, the metrics of the study are noted.
///
/// # Errors
/// [`Error::File`] where nothing can be noted.
pub fn listening(config: &ProgramConfig, place: &Workplace) -> Result<Listening, Error> {
    Listening::to(&place.notes(), STREAMS.map(|stream| filter(config, stream)))
}

/// The metrics in a stream.
fn filter(config: &ProgramConfig, stream: &str) -> Filter {
    let mut filter = Filter::default();
    for reading in config.readings().into_iter().filter(|it| it.from == stream) {
        filter.keys.insert(reading.key);
        match &reading.step {
            Some(step) => drop(filter.steps.insert(step.step().column().to_owned())),
            None => filter.numbers = true,
        }
    }
    filter
}

/// True where a program that worked there ended well, by itself.
pub fn has_ended_well(notes: &Path) -> bool {
    let last = execution::guard::last_ending(notes);
    matches!(
        last,
        Some(Left::Ended {
            how: Ending::Code(0),
            was_asked: false
        })
    )
}
