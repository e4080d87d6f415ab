//! The thread that owns the device: it answers requests of members, and makes one batch of all runs of one routine that
//! wait. While a batch runs, the other members' environments go on and their requests gather, so the batches grow until
//! card and cores are both at work.

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
    /// That of `open`.
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
        // A thread that has ended holds no member.
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

/// The device with its members and the runs that wait.
struct Desk<B> {
    backend: B,
    cohorts: Vec<Cohort>,
    routines: Vec<Arc<Kernels>>,
    /// Runs by the place of their routine.
    waiting: VecDeque<(usize, Run)>,
    /// Runs of the largest batch so far.
    largest_batch: usize,
}

impl<B: Backend> Desk<B> {
    fn new(backend: B) -> Self {
        Self {
            backend,
            cohorts: Vec::new(),
            routines: Vec::new(),
            waiting: VecDeque::new(),
            largest_batch: 0,
        }
    }

    fn work(&mut self, received: &Receiver<Request>) {
        while let Ok(request) = received.recv() {
            self.take(request);
            while let Some((routine, cohort)) = self.next() {
                self.gather(received, routine, cohort);
                self.run(routine, cohort);
                received.try_iter().for_each(|request| self.take(request));
            }
        }
    }

    /// Routine and cohort of the run that has waited longest.
    fn next(&self) -> Option<(usize, usize)> {
        let first = self.waiting.front();
        first.map(|(routine, run)| (*routine, run.place.cohort))
    }

    /// Takes further requests, until as many runs wait as were in the largest batch, or none comes in time.
    fn gather(&mut self, received: &Receiver<Request>, routine: usize, cohort: usize) {
        received.try_iter().for_each(|request| self.take(request));
        while self.of_batch(routine, cohort).count() < self.largest_batch {
            match received.recv_timeout(GATHERING) {
                Ok(request) => self.take(request),
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => return,
            }
        }
    }

    fn of_batch(&self, routine: usize, cohort: usize) -> impl Iterator<Item = &Run> {
        let waiting = self.waiting.iter();
        waiting.filter_map(move |(of, run)| (*of == routine && run.place.cohort == cohort).then_some(run))
    }

    fn take(&mut self, request: Request) {
        // A member that is gone waits for no answer.
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

    /// Runs all that wait for a routine and belong to a cohort.
    fn run(&mut self, routine: usize, cohort: usize) {
        let waiting = std::mem::take(&mut self.waiting);
        let is_it = |(of, run): &(usize, Run)| *of == routine && run.place.cohort == cohort;
        let (batch, others): (VecDeque<_>, _) = waiting.into_iter().partition(is_it);
        self.waiting = others;
        self.largest_batch = self.largest_batch.max(batch.len());
        let outputs = self.outputs(routine, cohort, &batch);
        let output_size = size(&self.routines[routine].outputs);
        for (at, (_, run)) in batch.into_iter().enumerate() {
            let own = |all: &Vec<f32>| all[at * output_size..][..output_size].to_vec();
            let _ = run.answer.send(outputs.as_ref().map(own).map_err(Lost::clone));
        }
    }

    fn outputs(
        &mut self,
        routine: usize,
        cohort: usize,
        batch: &VecDeque<(usize, Run)>,
    ) -> Result<Vec<f32>, Lost> {
        let (kernels, of) = (&self.routines[routine], &self.cohorts[cohort]);
        let members: Vec<u32> = batch.iter().map(|(_, run)| run.place.member).collect();
        let runs: Vec<u32> = batch
            .iter()
            .flat_map(|(_, run)| run.words.iter().copied())
            .collect();
        let inputs: Vec<f32> = batch
            .iter()
            .flat_map(|(_, run)| run.inputs.iter().copied())
            .collect();
        let batch = Batch {
            kernels,
            state_size: of.state_size(),
            tensors: &of.tensors(kernels)?,
            members: &members,
            runs: &runs,
            inputs: &inputs,
        };
        self.backend.run(cohort, routine, &batch)
    }
}
