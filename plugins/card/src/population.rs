//! The thread that owns the device. It answers requests of members, and makes a batch of the waiting runs of one
//! routine, at most half of a cohort. While the device computes for one half, the environments of the other half
//! continue.

use crate::backend::Backend;
use crate::cohort::Cohort;
use plan::Shape;
use plan::cuda::{Batch, Kernels, size};
use plan::executor::{Executor, Lost, Member};
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

/// Time in which further requests of one routine join the first one.
const GATHERING: Duration = Duration::from_micros(50);

/// A member, by its cohort and its number there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Place {
    cohort: usize,
    member: u32,
}

enum Request {
    Admit(Vec<(String, Shape)>, Sender<Result<Place, Lost>>),
    Dismiss(Place),
    Write(Place, String, Vec<f32>, Sender<Result<(), Lost>>),
    Read(Place, String, Sender<Result<Vec<f32>, Lost>>),
    Run(Run),
}

struct Run {
    place: Place,
    kernels: Arc<Kernels>,
    words: Vec<u32>,
    inputs: Vec<f32>,
    answer: Sender<Result<Vec<f32>, Lost>>,
}

/// Members on one device.
#[derive(Debug, Clone)]
pub struct Population {
    requests: Sender<Request>,
}

impl Population {
    /// Opens a device in a thread of its own, which ends with the last copy of the population and the last member.
    ///
    /// # Errors
    /// The error of `open`.
    pub fn new<B: Backend>(open: impl FnOnce() -> Result<B, Lost> + Send + 'static) -> Result<Self, Lost> {
        let (requests, received) = channel();
        let (opened, is_open) = channel();
        std::thread::spawn(move || match open() {
            Ok(backend) => {
                let _ = opened.send(Ok(()));
                Desk::new(backend).work(&received);
            }
            Err(lost) => {
                let _ = opened.send(Err(lost));
            }
        });
        is_open.recv().map_err(gone)??;
        Ok(Self { requests })
    }
}

fn gone<E>(_: E) -> Lost {
    Lost {
        reason: "the thread that drives the card has ended".into(),
    }
}

/// Sends a request and waits for its answer.
fn ask<T>(
    requests: &Sender<Request>,
    request: impl FnOnce(Sender<Result<T, Lost>>) -> Request,
) -> Result<T, Lost> {
    let (answer, answered) = channel();
    requests.send(request(answer)).map_err(gone)?;
    answered.recv().map_err(gone)?
}

impl Executor for Population {
    fn admit(&self, tensors: &[(&str, Shape)]) -> Result<Arc<dyn Member>, Lost> {
        let tensors = tensors.iter().map(|(name, shape)| ((*name).to_owned(), *shape));
        let tensors = tensors.collect();
        let place = ask(&self.requests, |answer| Request::Admit(tensors, answer))?;
        Ok(Arc::new(Admitted {
            place,
            requests: self.requests.clone(),
        }))
    }
}

#[derive(Debug)]
struct Admitted {
    place: Place,
    requests: Sender<Request>,
}

impl Drop for Admitted {
    fn drop(&mut self) {
        // If the thread has ended, it holds no member.
        let _ = self.requests.send(Request::Dismiss(self.place));
    }
}

impl Member for Admitted {
    fn write(&self, tensor: &str, entries: &[f32]) -> Result<(), Lost> {
        let (tensor, entries) = (tensor.to_owned(), entries.to_vec());
        ask(&self.requests, |answer| {
            Request::Write(self.place, tensor, entries, answer)
        })
    }

    fn read(&self, tensor: &str) -> Result<Vec<f32>, Lost> {
        let tensor = tensor.to_owned();
        ask(&self.requests, |answer| Request::Read(self.place, tensor, answer))
    }

    fn run(&self, kernels: &Arc<Kernels>, words: &[u32], inputs: &[f32]) -> Result<Vec<f32>, Lost> {
        ask(&self.requests, |answer| {
            Request::Run(Run {
                place: self.place,
                kernels: Arc::clone(kernels),
                words: words.to_vec(),
                inputs: inputs.to_vec(),
                answer,
            })
        })
    }
}

/// Size of a cohort below which all its members may be in one batch.
const SMALLEST_HALF: usize = 8;

/// Maximum number of running batches: the device begins the next one immediately, while outputs of the last one are
/// sent.
const MOST_FLIGHTS: usize = 2;

/// The device with its members, the waiting runs, and those of running batches.
struct Desk<B> {
    backend: B,
    cohorts: Vec<Cohort>,
    routines: Vec<Arc<Kernels>>,
    /// Waiting runs, each with the index of its routine.
    waiting: VecDeque<(usize, Run)>,
    /// Runs of batches that the device has begun, with the index of their routine.
    flights: VecDeque<(usize, Vec<Run>)>,
}

impl<B: Backend> Desk<B> {
    fn new(backend: B) -> Self {
        Self {
            backend,
            cohorts: Vec::new(),
            routines: Vec::new(),
            waiting: VecDeque::new(),
            flights: VecDeque::new(),
        }
    }

    /// Answers requests until no sender is left.
    fn work(&mut self, received: &Receiver<Request>) {
        loop {
            if self.waiting.is_empty() && self.flights.is_empty() {
                let Ok(request) = received.recv() else { return };
                self.take(request);
            }
            received.try_iter().for_each(|request| self.take(request));
            match self.next() {
                Some((routine, cohort)) if self.flights.len() < MOST_FLIGHTS => {
                    self.gather(received, routine, cohort);
                    self.start(routine, cohort);
                }
                _ => self.finish(),
            }
        }
    }

    /// Routine and cohort of the run that has waited longest.
    fn next(&self) -> Option<(usize, usize)> {
        let first = self.waiting.front();
        first.map(|(routine, run)| (*routine, run.place.cohort))
    }

    /// Maximum number of members in a batch: half of the cohort, so that the environments of one half continue while
    /// the device computes for the other.
    fn largest_batch(&self, cohort: usize) -> usize {
        self.cohorts[cohort].n_members().div_ceil(2).max(SMALLEST_HALF)
    }

    /// Takes further requests, until the batch is full or no request arrives in time.
    fn gather(&mut self, received: &Receiver<Request>, routine: usize, cohort: usize) {
        let (is_it, most) = (of_batch(routine, cohort), self.largest_batch(cohort));
        while self.waiting.iter().filter(|run| is_it(run)).count()
            < most.min(self.cohorts[cohort].n_members())
        {
            match received.recv_timeout(GATHERING) {
                Ok(request) => self.take(request),
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => return,
            }
        }
    }

    fn take(&mut self, request: Request) {
        // A member that is gone does not wait for an answer.
        match request {
            Request::Admit(tensors, answer) => {
                let _ = answer.send(self.admit(&tensors));
            }
            Request::Dismiss(Place { cohort, member }) => self.cohorts[cohort].dismiss(member),
            Request::Write(Place { cohort, member }, tensor, entries, answer) => {
                let place = self.cohorts[cohort].tensor(&tensor);
                let written =
                    place.and_then(|place| self.backend.write(cohort, member, place.start, &entries));
                let _ = answer.send(written);
            }
            Request::Read(Place { cohort, member }, tensor, answer) => {
                let place = self.cohorts[cohort].tensor(&tensor);
                let _ = answer.send(place.and_then(|place| self.backend.read(cohort, member, place)));
            }
            Request::Run(run) => {
                let routine = self.routine(&run.kernels);
                self.waiting.push_back((routine, run));
            }
        }
    }

    fn admit(&mut self, tensors: &[(String, Shape)]) -> Result<Place, Lost> {
        let found = self.cohorts.iter().position(|cohort| cohort.takes(tensors));
        let cohort = found.unwrap_or_else(|| {
            self.cohorts.push(Cohort::new(tensors));
            self.cohorts.len() - 1
        });
        let of = &mut self.cohorts[cohort];
        let member = of.admit();
        let reserved = self.backend.reserve(cohort, of.state_size(), of.n_places());
        if reserved.is_err() {
            of.dismiss(member);
        }
        reserved.map(|()| Place { cohort, member })
    }

    fn routine(&mut self, kernels: &Arc<Kernels>) -> usize {
        let mut known = self.routines.iter();
        let same = known.position(|it| Arc::ptr_eq(it, kernels));
        let same = same.or_else(|| self.routines.iter().position(|it| it == kernels));
        same.unwrap_or_else(|| {
            self.routines.push(Arc::clone(kernels));
            self.routines.len() - 1
        })
    }

    /// Begins a batch of waiting runs of a routine and a cohort, in the order of their arrival.
    fn start(&mut self, routine: usize, cohort: usize) {
        let (is_it, most) = (of_batch(routine, cohort), self.largest_batch(cohort));
        let (mut batch, mut others) = (Vec::new(), VecDeque::new());
        for waiting in std::mem::take(&mut self.waiting) {
            if is_it(&waiting) && batch.len() < most {
                batch.push(waiting.1);
            } else {
                others.push_back(waiting);
            }
        }
        self.waiting = others;
        match self.started(routine, cohort, &batch) {
            Ok(()) => self.flights.push_back((routine, batch)),
            Err(lost) => tell(batch, |_| Err(lost.clone())),
        }
    }

    fn started(&mut self, routine: usize, cohort: usize, batch: &[Run]) -> Result<(), Lost> {
        let (kernels, of) = (&self.routines[routine], &self.cohorts[cohort]);
        let members: Vec<u32> = batch.iter().map(|run| run.place.member).collect();
        let runs: Vec<&[u32]> = batch.iter().map(|run| &run.words[..]).collect();
        let inputs: Vec<&[f32]> = batch.iter().map(|run| &run.inputs[..]).collect();
        let batch = Batch {
            kernels,
            state_size: of.state_size(),
            tensors: &of.tensors(kernels)?,
            members: &members,
            runs: &runs,
            inputs: &inputs,
        };
        self.backend.start(cohort, routine, &batch)
    }

    /// Waits for the oldest running batch, and sends its outputs.
    fn finish(&mut self) {
        if let Some((routine, batch)) = self.flights.pop_front() {
            let outputs = self.backend.finish();
            let size = size(&self.routines[routine].outputs);
            tell(batch, |at| {
                let all = outputs.as_ref().map_err(Lost::clone)?;
                Ok(all[at * size..][..size].to_vec())
            });
        }
    }
}

/// Whether a waiting run belongs to a routine and a cohort.
fn of_batch(routine: usize, cohort: usize) -> impl Fn(&(usize, Run)) -> bool {
    move |(of, run)| *of == routine && run.place.cohort == cohort
}

/// Answers the runs of a batch. A member that is gone does not wait for an answer.
fn tell(batch: Vec<Run>, result: impl Fn(usize) -> Result<Vec<f32>, Lost>) {
    for (at, run) in batch.into_iter().enumerate() {
        let _ = run.answer.send(result(at));
    }
}
