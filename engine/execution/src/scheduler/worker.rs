//! The program inside a worker process, which runs one trial for each line of input.

use crate::{
    device::Connection,
    store::{RunningTrial, Store},
    world::{clock, fs},
};
use contract::{
    Error, Recorder, Registry, panics,
    resources::Share,
    trial::Trial,
    trial_end::{EndState, TrialEnd},
};
use document::plain_text::brief;
use serde::{Deserialize, Serialize};
use std::{
    io::{BufRead, Write},
    path::PathBuf,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc,
    },
    time::Duration,
};

/// A message to a worker.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Message {
    /// Run a trial.
    Run(Box<Request>),
    /// Save a checkpoint of the running trial and leave it.
    Stop,
}

/// Request for one trial.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Request {
    /// The trial to run.
    pub trial: Trial,
    /// Folder of the store.
    pub store: PathBuf,
    /// Interval between two checkpoints, in seconds.
    pub checkpoint_every_s: f64,
    /// The step at which the trial pauses after the measurement there.
    #[serde(default)]
    pub until: Option<u64>,
    /// Allowed silence, in seconds, of a program that trains itself.
    #[serde(default)]
    pub stalled_after_s: Option<f64>,
    /// The share of the machine that the trial has.
    #[serde(default)]
    pub share: Share,
}

/// Replies of a worker.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reply {
    /// Progress of the trial.
    Progress {
        /// Steps done.
        done: u64,
        /// Total number of steps.
        total: u64,
    },
    /// The trial ended and its end is stored.
    Ended {
        /// End of the trial.
        end: TrialEnd,
    },
    /// The trial was stopped on request and will continue from its checkpoint.
    Stopped,
    /// The trial has reached its pause.
    Paused,
    /// A source of the trial cannot be used; the trial stays missing.
    Unready {
        /// The source, and its problem.
        reason: String,
    },
    /// The device on which the trial's learners compute is lost; the trial stays missing.
    DeviceLost {
        /// The problem, as a sentence.
        problem: String,
    },
    /// The store cannot be written; the trial stays missing.
    StoreRefused {
        /// The failed operation and the error of the system.
        problem: String,
    },
}

/// Answers requests until the input ends.
///
/// If the input ends while a trial runs, the requesting program is gone. The process then exits at once, so that the
/// program that takes over the trial has it alone.
///
/// # Errors
/// [`Error::Worker`] if the other side is gone.
pub fn serve(
    registry: &Registry,
    device: Option<&Connection>,
    input: impl BufRead + Send + 'static,
    mut replies: impl Write,
) -> Result<(), Error> {
    let stops = Stops::default();
    stops.note_signals()?;
    let (sender, requests) = mpsc::channel();
    let asked = stops.clone();
    std::thread::spawn(move || {
        listen(input, &asked, &sender);
        std::process::exit(0);
    });
    while let Ok(request) = requests.recv() {
        let reply = run((registry, device), &request, &stops, &mut replies);
        let panicked = matches!(&reply, Reply::Ended { end } if end.state == EndState::Panicked);
        let last = panicked || matches!(reply, Reply::Stopped) && stops.signalled.load(Ordering::SeqCst);
        say(&mut replies, &reply)?;
        if last {
            // A trial that panicked, or lost a process, may have left memory in any state, so the next trial gets a new
            // process.
            break;
        }
    }
    Ok(())
}

/// Reads messages until the input ends.
fn listen(input: impl BufRead, stops: &Stops, requests: &mpsc::Sender<Request>) {
    for line in input.lines() {
        match line.map(|line| serde_json::from_str(&line)) {
            Ok(Ok(Message::Stop)) => stops.asked.store(true, Ordering::SeqCst),
            Ok(Ok(Message::Run(request))) => {
                stops.asked.store(false, Ordering::SeqCst);
                stops.signalled.store(false, Ordering::SeqCst);
                if requests.send(*request).is_err() {
                    return;
                }
            }
            // Only this program writes here; an incomplete message ends the conversation.
            _ => return,
        }
    }
}

/// The stop requests that reach a worker.
#[derive(Debug, Clone, Default)]
pub(super) struct Stops {
    /// Set when the scheduler asks the running trial to save a checkpoint and exit.
    asked: Arc<AtomicBool>,
    /// A signal to the whole group of processes (Ctrl-C, the end of a batch job) came since the trial began. The
    /// scheduler handles it; processes of the trial may not have survived it.
    signalled: Arc<AtomicBool>,
}

impl Stops {
    fn note_signals(&self) -> Result<(), Error> {
        use signal_hook::consts::{SIGINT, SIGTERM, SIGUSR1};
        for signal in [SIGINT, SIGTERM, SIGUSR1] {
            signal_hook::flag::register(signal, Arc::clone(&self.signalled)).map_err(|source| {
                Error::Worker {
                    problem: format!("cannot listen for signals: {source}"),
                }
            })?;
        }
        Ok(())
    }

    fn has_come(&self) -> bool {
        self.asked.load(Ordering::SeqCst) || self.signalled.load(Ordering::SeqCst)
    }
}

/// Runs a trial and reports its end.
pub(super) fn run(
    parts: (&Registry, Option<&Connection>),
    request: &Request,
    stops: &Stops,
    replies: &mut impl Write,
) -> Reply {
    match attempt(parts, request, stops, replies) {
        Ok(reply) => reply,
        Err(error @ Error::Source { .. }) => Reply::Unready {
            reason: error.to_string(),
        },
        Err(Error::Device { problem }) => Reply::DeviceLost { problem },
        Err(Error::Store { problem }) => Reply::StoreRefused { problem },
        Err(error) => Reply::StoreRefused {
            problem: error.to_string(),
        },
    }
}

/// Runs the trial and stores its end, or its record at the pause; an error concerns the store or an artifact
/// in it.
fn attempt(
    (registry, device): (&Registry, Option<&Connection>),
    request: &Request,
    stops: &Stops,
    replies: &mut impl Write,
) -> Result<Reply, Error> {
    let store = Store::at(&request.store)
        .by(registry.build.clone())
        .on(device.map(|device| device.name));
    let trial = &request.trial;
    let mut told = clock::now();
    let mut progress = |done, total| {
        if clock::since(told) > Duration::from_millis(200) {
            told = clock::now();
            // If the scheduler is gone, that is noticed when the end is reported.
            let _ = say(replies, &Reply::Progress { done, total });
        }
    };
    let folder = store.folder(&trial.id);
    fs::create_dir_all(&folder).map_err(Error::file("create", &folder))?;
    let every = Duration::try_from_secs_f64(request.checkpoint_every_s).unwrap_or(Duration::MAX);
    let stop = Arc::clone(&stops.asked);
    let patience = request.stalled_after_s.map(Duration::try_from_secs_f64);
    let mut keeper = RunningTrial::open(&folder, &trial.id, every, stop)
        .until(request.until)
        .patient(patience.and_then(Result::ok))
        .sharing(request.share.clone());
    let mut run = || {
        trial.key.run_after(
            registry,
            &|taken| store.artifact(taken),
            Some(&folder),
            &mut progress,
            &mut keeper,
        )
    };
    let outcome = panics::caught(|| match device {
        None => run(),
        Some(Connection { device, .. }) => {
            let mut outcome = None;
            device.during(&mut || outcome = Some(run()))?;
            outcome.unwrap_or(Err(Error::Stopped))
        }
    });
    answered(&store, trial, &keeper, outcome, stops)
}

/// Stores the outcome of a trial and reports it.
fn answered(
    store: &Store,
    trial: &Trial,
    keeper: &RunningTrial,
    outcome: Result<Result<Recorder, Error>, String>,
    stops: &Stops,
) -> Result<Reply, Error> {
    let wall_s = keeper.wall_s();
    let end = |state, reason: &str| TrialEnd {
        state,
        reason: brief(reason),
        wall_s,
        decision_s: None,
        device: None,
        digest: String::new(),
    };
    let folder = store.folder(&trial.id);
    let end = match outcome {
        Ok(Ok(record)) => {
            let end = store.finish(trial, &record, wall_s)?;
            RunningTrial::discard(&folder)?;
            return Ok(Reply::Ended { end });
        }
        Ok(Err(Error::Stopped)) => {
            let Some(record) = keeper.at_pause() else {
                return Ok(Reply::Stopped);
            };
            store.keep_partial(trial, end(EndState::Paused, ""), record)?;
            return Ok(Reply::Paused);
        }
        Ok(Err(error @ (Error::Store { .. } | Error::Source { .. } | Error::Device { .. }))) => {
            return Err(error);
        }
        Ok(Err(error @ Error::NotFinite { .. })) => {
            let end = end(EndState::Nan, &error.to_string());
            // Searches compare a failed trial with others up to its last finite measurement.
            store.keep_partial(trial, end.clone(), keeper.before_error())?;
            end
        }
        // A trial that ends with the signal that stops the run has not failed.
        Ok(Err(_)) | Err(_) if stops.has_come() => return Ok(Reply::Stopped),
        Ok(Err(error @ Error::Silent { .. })) => end(EndState::Timeout, &error.to_string()),
        Ok(Err(error @ Error::Ended { .. })) => end(EndState::Killed, &error.to_string()),
        Ok(Err(error)) => end(EndState::Failed, &error.to_string()),
        Err(said) => end(EndState::Panicked, &said),
    };
    let end = store.acknowledge(trial, end)?;
    if end.state != EndState::Killed {
        // The trial would fail again from its checkpoint; once the cause is fixed it must run from the start.
        RunningTrial::discard(&folder)?;
    }
    Ok(Reply::Ended { end })
}

fn say(replies: &mut impl Write, reply: &Reply) -> Result<(), Error> {
    let broken = |problem: String| Error::Worker { problem };
    let line = serde_json::to_string(reply).map_err(|source| broken(source.to_string()))?;
    writeln!(replies, "{line}")
        .and_then(|()| replies.flush())
        .map_err(|source| broken(source.to_string()))
}
