//! A program that runs under its guard, with a reader of its output.

use crate::{
    ProgramConfig,
    lines::Filter,
    output::{self, OutputReader, STREAMS},
    variables,
    working_folder::WorkingFolder,
};
use contract::{Error, ending::Ending, resources::Share};
use execution::guard::{Guarded, Left, Order};
use std::{path::Path, time::Duration};

/// Time between two polls of a program.
const LOOK: Duration = Duration::from_millis(2);

/// Signals with which people, terminals and batch systems stop programs. They are no fault of the stopped program.
const STOPS: [i32; 5] = [1, 2, 9, 10, 15];

/// A program that was started.
#[derive(Debug)]
pub struct Process {
    guarded: Guarded,
    output_reader: OutputReader,
    /// First words of the command, for messages.
    name: String,
}

impl Process {
    /// Starts a program in its working folder.
    ///
    /// # Errors
    /// [`Error::Worker`] where no guard can be started, and [`Error::File`] where the output cannot be written.
    pub fn start(
        config: &ProgramConfig,
        words: Vec<String>,
        (place, share): (&WorkingFolder, &Share),
        output_reader: OutputReader,
    ) -> Result<Self, Error> {
        let name = named(&words);
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
            output_reader,
            name,
        })
    }

    /// Waits for the end of the program for at most `wait`; `None` if it still runs.
    pub fn ends_within(&mut self, wait: Duration) -> Option<Result<(), Error>> {
        let mut left = wait;
        loop {
            self.output_reader.look();
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

    /// Whether any output was read since the last call.
    pub fn has_heard(&mut self) -> bool {
        self.output_reader.has_heard()
    }

    /// Reader of the program's output.
    pub fn output_reader(&self) -> &OutputReader {
        &self.output_reader
    }

    /// Tells the program to end, and waits for its end.
    pub fn stop(&mut self) {
        self.guarded.ask_to_stop();
        self.end();
    }

    fn end(&mut self) -> Left {
        let left = self.guarded.end();
        self.output_reader.end();
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
            said: self.output_reader.last_words(),
        })
    }

    fn noted_well(&self) -> Result<(), Error> {
        match self.output_reader.problem() {
            Some(problem) => Err(Error::Store {
                problem: format!("what a program says cannot be noted: {problem}"),
            }),
            None => Ok(()),
        }
    }
}

/// The first words of a command, for messages: the program with its script or module.
pub fn named(words: &[String]) -> String {
    let module = words.iter().take(5).position(|word| word == "-m");
    let n = module.map_or(2, |place| place + 2);
    words
        .iter()
        .take(n)
        .map(String::as_str)
        .collect::<Vec<_>>()
        .join(" ")
}

/// Time for a program to end after the signal.
fn grace(config: &ProgramConfig) -> Duration {
    Duration::try_from_secs_f64(config.stop.grace_s).unwrap_or_default()
}

/// The reader of a program's output, which notes the study's metrics.
///
/// # Errors
/// [`Error::File`] where the notes cannot be written.
pub fn output_reader(config: &ProgramConfig, place: &WorkingFolder) -> Result<OutputReader, Error> {
    OutputReader::to(&place.notes(), STREAMS.map(|stream| filter(config, stream)))
}

/// The filter for the metrics in a stream.
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

/// Whether a program that ran there ended by itself and with success.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_names_the_script_or_the_module() {
        for (command, name) in [
            ("python train.py --lr 1", "python train.py"),
            ("python -u -m pkg.train --lr 1", "python -u -m pkg.train"),
            ("learn", "learn"),
        ] {
            let words: Vec<String> = command.split(' ').map(str::to_owned).collect();
            assert_eq!(named(&words), name);
        }
    }
}
