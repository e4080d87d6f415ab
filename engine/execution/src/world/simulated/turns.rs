//! Threads that take turns: each is a process of a simulation, and only one runs at a time.

use super::{
    THIS,
    machine::{Machine, ProcessLifetime, SimulatedProcess},
};
use std::{
    any::Any,
    cell::Cell,
    io,
    panic::{AssertUnwindSafe, catch_unwind, resume_unwind},
    rc::Rc,
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

/// State that the threads share.
struct SharedMachine {
    machine: Mutex<Machine>,
    /// A condition for each place, which is signalled when its process gets the turn, or is gone.
    told: Vec<Condvar>,
    began: Instant,
}

/// The simulated process of a thread.
pub struct Process {
    shared: Arc<SharedMachine>,
    at: usize,
    generation: u64,
    quiet: Cell<bool>,
}

/// Payload of the unwinding of a thread whose process is gone.
struct ProcessLoss;

/// Runs `body` in a process at each place until each has returned that it is done; a process that was killed or is not
/// done is replaced by a new one. Returns the machine.
///
/// # Errors
/// The panic of a process, or the lack of progress, together with the machine.
pub fn start(machine: Machine, body: impl Fn(usize) -> bool + Sync) -> (Machine, Result<(), String>) {
    contract::clock::simulate(super::now);
    let places = machine.processes.len();
    let shared = Arc::new(SharedMachine {
        machine: Mutex::new(machine),
        told: (0..places).map(|_| Condvar::new()).collect(),
        began: crate::world::clock::now(),
    });
    std::thread::scope(|scope| {
        for at in 0..places {
            let (shared, body) = (Arc::clone(&shared), &body);
            scope.spawn(move || live(&shared, at, body));
        }
    });
    let shared = Arc::into_inner(shared).unwrap_or_else(|| unreachable!("every thread has ended"));
    let mut machine = shared
        .machine
        .into_inner()
        .unwrap_or_else(PoisonError::into_inner);
    let outcome = machine.failed.take().map_or(Ok(()), Err);
    (machine, outcome)
}

/// Runs `act` without passing the turn on and without faults; it sees the true state.
pub fn quietly<T>(act: impl FnOnce() -> T) -> T {
    let this = super::this();
    this.iter().for_each(|this| this.quiet.set(true));
    let outcome = act();
    this.iter().for_each(|this| this.quiet.set(false));
    outcome
}

/// Runs one process after the other at a place.
fn live(shared: &Arc<SharedMachine>, at: usize, body: &(impl Fn(usize) -> bool + Sync)) {
    loop {
        let Some(generation) = shared.begin(at) else {
            return;
        };
        let process = Process {
            shared: Arc::clone(shared),
            at,
            generation,
            quiet: Cell::new(false),
        };
        THIS.with(|this| *this.borrow_mut() = Some(Rc::new(process)));
        let outcome = catch_unwind(AssertUnwindSafe(|| body(at)));
        THIS.with(|this| *this.borrow_mut() = None);
        if shared.end(at, generation, outcome) {
            return;
        }
    }
}

impl SharedMachine {
    fn lock(&self) -> MutexGuard<'_, Machine> {
        // A panic of a process ends the simulation, which afterwards only reads the machine.
        self.machine.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until the process of a place begins; `None` if no further one does.
    fn begin(&self, at: usize) -> Option<u64> {
        let mut machine = self.lock();
        loop {
            let entry = &machine.processes[at];
            if machine.failed.is_some() || entry.state == ProcessLifetime::Over {
                return None;
            }
            if machine.turn == Some(at) {
                return Some(entry.generation);
            }
            machine = self.told[at]
                .wait(machine)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Records the end of a process; true if its place is not used any more.
    fn end(&self, at: usize, generation: u64, outcome: Result<bool, Box<dyn Any + Send>>) -> bool {
        let mut machine = self.lock();
        let killed = machine.processes[at].generation != generation;
        match outcome {
            Err(panic) if !panic.is::<ProcessLoss>() => {
                let text = panic.downcast_ref::<String>().cloned();
                let text = text.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()));
                machine
                    .failed
                    .get_or_insert(text.unwrap_or_else(|| "a panic".into()));
            }
            _ if killed => return machine.failed.is_some(),
            Ok(true) => machine.processes[at].state = ProcessLifetime::Over,
            _ => {
                let pause = Duration::from_millis(machine.dice.up_to(5000) as u64);
                machine.replace(at, pause);
            }
        }
        machine.choose();
        self.tell(&machine);
        machine.failed.is_some() || machine.processes[at].state == ProcessLifetime::Over
    }

    /// Wakes the process that has the turn, or every process if the simulation has failed.
    fn tell(&self, machine: &Machine) {
        match machine.turn.filter(|_| machine.failed.is_none()) {
            Some(at) => self.told[at].notify_one(),
            None => self.told.iter().for_each(Condvar::notify_one),
        }
    }
}

impl Process {
    pub fn began(&self) -> Instant {
        self.shared.began
    }

    /// Accesses the machine without a fault.
    pub fn see<T>(&self, look: impl FnOnce(&mut Machine, &Caller) -> T) -> T {
        let mut machine = self.turn();
        let me = self.me(&machine);
        look(&mut machine, &me)
    }

    /// Makes a file operation, which may fail.
    pub fn call<T>(
        &self,
        what: impl FnOnce() -> String,
        act: impl FnOnce(&mut Machine, &Caller) -> io::Result<T>,
    ) -> io::Result<T> {
        if std::thread::panicking() {
            return Err(io::Error::other("the process is gone"));
        }
        let mut machine = self.turn();
        let me = self.me(&machine);
        let fails = if me.quiet { None } else { machine.fails() };
        let outcome = match fails {
            Some(false) => Err(broken()),
            Some(true) => act(&mut machine, &me).and(Err(broken())),
            None => act(&mut machine, &me),
        };
        let said = outcome
            .as_ref()
            .err()
            .map_or_else(String::new, |error| format!(": {error}"));
        if !me.quiet {
            machine.note(|| format!("{} {}{said}", self.at, what()));
        }
        outcome
    }

    pub fn sleep(&self, wait: Duration) {
        let mut machine = self.shared.lock();
        self.hold(&machine);
        machine.delay(self.at, wait);
        drop(machine);
        drop(self.turn());
    }

    /// Waits for the turn; unwinds if the process is gone.
    fn turn(&self) -> MutexGuard<'_, Machine> {
        let mut machine = self.shared.lock();
        self.hold(&machine);
        if self.quiet.get() || std::thread::panicking() {
            return machine;
        }
        machine.pass(self.at);
        if machine.turn != Some(self.at) || machine.failed.is_some() {
            self.shared.tell(&machine);
        }
        loop {
            self.hold(&machine);
            if machine.turn == Some(self.at) {
                return machine;
            }
            machine = self.shared.told[self.at]
                .wait(machine)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Unwinds if the process is gone.
    fn hold(&self, machine: &Machine) {
        let gone = machine.processes[self.at].generation != self.generation || machine.failed.is_some();
        if gone && !std::thread::panicking() {
            resume_unwind(Box::new(ProcessLoss));
        }
    }

    fn me(&self, machine: &Machine) -> Caller {
        let SimulatedProcess { host, pid, .. } = machine.processes[self.at];
        Caller {
            at: self.at,
            host,
            pid,
            quiet: self.quiet.get(),
        }
    }
}

/// Identity of the calling process.
pub struct Caller {
    pub at: usize,
    pub host: usize,
    pub pid: u32,
    pub quiet: bool,
}

fn broken() -> io::Error {
    io::Error::other("input/output error")
}
