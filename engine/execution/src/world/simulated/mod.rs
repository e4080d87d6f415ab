//! A machine, or several that share a disk, on which random choices decide what happens next.
//!
//! Every process of the simulation is a thread, and only one of them runs at a time. At each call for a file, a clock
//! or a process the turn may pass to another one, time passes, and a fault may occur: a process is killed or halts for
//! a while, a machine or all of them lose their power, a clock jumps, a call fails, the disk is full, or a machine sees
//! the names in a folder as they were a moment ago. All of this follows from one seed, so that a seed that fails will
//! fail again.
//!
//! A thread outside a simulation uses the real machine, as in most tests.

mod dice;
mod disk;
pub mod files;
mod machine;
mod turns;

pub use machine::{Faults, Machine};
pub use turns::{quietly, start};

use super::process::{ProcessScope, ProcessState};
use std::{
    cell::RefCell,
    rc::Rc,
    time::{Duration, Instant, SystemTime, UNIX_EPOCH},
};
use turns::Process;

thread_local! {
    static THIS: RefCell<Option<Rc<Process>>> = const { RefCell::new(None) };
}

/// The simulated process of this thread, if it is one.
fn this() -> Option<Rc<Process>> {
    THIS.with(|this| this.borrow().clone())
}

pub fn now() -> Option<Instant> {
    let this = this()?;
    Some(this.began() + this.see(|machine, _| machine.time))
}

pub fn date() -> Option<SystemTime> {
    let seen = this()?.see(|machine, me| machine.date(me.host));
    Some(UNIX_EPOCH + seen)
}

/// Sleeps in simulated time; false if the thread is no simulated process.
pub fn sleep(wait: Duration) -> bool {
    this().is_some_and(|this| {
        this.sleep(wait);
        true
    })
}

pub fn process_id() -> Option<u32> {
    Some(this()?.see(|_, me| me.pid))
}

pub fn place() -> Option<ProcessScope> {
    Some(this()?.see(|machine, me| machine.place(me.host)))
}

pub fn look(pid: u32) -> Option<ProcessState> {
    Some(this()?.see(|machine, me| machine.look(me.host, pid)))
}

/// The date by the clock of the disk.
pub fn disk_date() -> Duration {
    this().map_or(Duration::ZERO, |this| this.see(|machine, _| machine.disk_date()))
}

/// Whether a process of the simulation runs; any process may ask.
pub fn lives(pid: u32) -> bool {
    let runs =
        |machine: &mut Machine, _: &turns::Caller| machine.processes.iter().any(|entry| entry.pid == pid);
    this().is_some_and(|this| quietly(|| this.see(runs)))
}

pub fn random_number() -> Option<u64> {
    Some(this()?.see(|machine, _| machine.dice.number()))
}
